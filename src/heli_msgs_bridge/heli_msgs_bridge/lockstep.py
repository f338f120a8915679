# SPDX-License-Identifier: Apache-2.0
"""Which messages belong to a tick, and whether all of them have come. No ROS."""

import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from heli_core.ticks import NS_PER_S, OF_100_HZ, Rate

# -------------------------------------------------------------------------------------------------
# Lockstep.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Demand:
    """What a step needs from one topic.

    Attributes
    ----------
    every_ticks : int
        The step of tick n needs it if n is a multiple of this.
    lag_ticks : int
        The message for step n is stamped n - lag_ticks.
    first_tick : int
        Steps before this one do without it.
    """

    every_ticks: int = 1
    lag_ticks: int = 0
    first_tick: int = 0

    def due(self, tick: int) -> bool:
        """True if the step of this tick needs a message."""
        return tick >= self.first_tick and tick % self.every_ticks == 0


@dataclass
class Counters:
    """What was not used: duplicates, messages of past ticks, and of ticks too far ahead."""

    duplicate: int = 0
    late: int = 0
    ahead: int = 0


class TickAssembler:
    """Collects messages by tick in bounded memory.

    Parameters
    ----------
    demands : mapping of topic to Demand
        What a step needs.
    window_ticks : int
        How many ticks ahead of the next step are kept.
    """

    def __init__(self, demands: Mapping[str, Demand], window_ticks: int = 64) -> None:
        self._demands = dict(demands)
        self._waived: set[str] = set()
        self._window = window_ticks
        self._slots: dict[int, dict[str, Any]] = {}
        self.next_tick: int | None = None
        self.counters = Counters()
        # What the step of a tick waits for; looked at several times a tick, so kept.
        self._needed: frozenset[str] = frozenset()
        self._needed_at: int | None = None

    def reset(self) -> None:
        """Forget everything but the demands."""
        self._slots.clear()
        self.next_tick = None
        self._waived.clear()
        self._needed_at = None

    def waive(self, topic: str, waived: bool = True) -> None:
        """Do (not) wait for a topic; what comes is used nevertheless."""
        if waived:
            self._waived.add(topic)
        else:
            self._waived.discard(topic)
        self._needed_at = None

    def add(self, topic: str, stamp_tick: int, value: Any) -> bool:
        """Take a message; `value` None means that it came but cannot be used.

        Returns
        -------
        bool
            True if it was kept.
        """
        tick = stamp_tick + self._demands[topic].lag_ticks
        first = self.next_tick
        if first is not None and tick < first:
            self.counters.late += 1
            return False
        if first is not None and tick >= first + self._window:
            self.counters.ahead += 1
            return False
        slot = self._slots.get(tick)
        if slot is None:
            slot = self._slots[tick] = {}
        elif topic in slot:
            self.counters.duplicate += 1
            return False
        slot[topic] = value
        if first is None and len(self._slots) > self._window:
            oldest = min(self._slots)
            self.counters.late += len(self._slots.pop(oldest))
            return oldest != tick
        return True

    def start(self, tick: int) -> None:
        """Set the first tick to be stepped; what is outside of its window is dropped."""
        self.next_tick = tick
        for kept in list(self._slots):
            if kept < tick:
                self.counters.late += len(self._slots.pop(kept))
            elif kept >= tick + self._window:
                self.counters.ahead += len(self._slots.pop(kept))

    def kept(self, topic: str) -> list[int]:
        """Ticks for which a message of the topic is kept, ascending."""
        return sorted(tick for tick, slot in self._slots.items() if topic in slot)

    def missing(self) -> tuple[str, ...]:
        """Topics that the next step still waits for; all of them before the first tick is known."""
        tick = self.next_tick
        if tick is None:
            return tuple(self._demands)
        slot, needed = self._slots.get(tick, {}), self._needed_by(tick)
        return tuple(topic for topic in self._demands if topic in needed and topic not in slot)

    def _needed_by(self, tick: int) -> frozenset[str]:
        """Topics that the step of a tick demands and that are waited for."""
        if tick != self._needed_at:
            self._needed_at, waived = tick, self._waived
            self._needed = frozenset(
                t for t, demand in self._demands.items() if demand.due(tick) and t not in waived
            )
        return self._needed

    def complete(self) -> bool:
        """True if everything that the next step demands has come, and at least one message.

        So nothing steps on silence, though all topics be waived or none be due.
        """
        tick = self.next_tick
        if tick is None:
            return False
        slot = self._slots.get(tick)
        return slot is not None and self._needed_by(tick) <= slot.keys()

    def take(self) -> dict[str, Any]:
        """Messages of the next step (complete or not), which thereby is done.

        Raises
        ------
        RuntimeError
            If no first tick has been set.
        """
        if self.next_tick is None:
            raise RuntimeError("take() before start()")
        slot = self._slots.pop(self.next_tick, {})
        self.next_tick += 1
        return slot


# -------------------------------------------------------------------------------------------------
# How far a message's stamp may be from the clock of the node that hears it. No ROS.
#
# A node knows time from its trigger. A stamp of another clock must neither be flown nor make what
# comes after it late.
# -------------------------------------------------------------------------------------------------

Refused = Callable[[str, int, int], None]
"""Told of a message whose stamp does not fit: topic, its tick, the tick of the node's clock."""

AHEAD_TICKS = 4
"""How far a stamp may be ahead of the node's clock; in real time in ticks of 10 ms. No node stamps
the future, so a message is ahead only by what the listener has not heard yet: in lockstep one tick,
as nobody goes on before this node has stepped; in real time the same, as the clock runs on by wall
time. The rest is for messages of the trigger that were lost on the way."""


class ClockGuard:
    """When the trigger, which is the clock of a node, may set it anew.

    One message that does not fit is refused. Two in a row that fit to each other are the time of
    whoever sends: the clock was wrong, or time was begun anew.
    """

    def __init__(self) -> None:
        self._doubted: int | None = None

    def fits(self) -> None:
        """A message has come that fits."""
        self._doubted = None

    def sets_clock(self, tick: int, most_ticks: int) -> bool:
        """Whether a message that does not fit continues the one before it."""
        before, self._doubted = self._doubted, tick
        sets = before is not None and 0 < tick - before <= most_ticks
        if sets:
            self._doubted = None
        return sets


class TriggerClock:
    """The flight's time in real time: by the trigger's stamps and the wall time since.

    The trigger may come late. What it is made of goes another way: of a plant whose observer cannot
    run for a while, `odom` comes late and `rotor_speed` does not. A late one says no more than that
    time is not before its stamp, so the least late one of the last second or two counts.

    Parameters
    ----------
    per_s : int
        Ticks of a second.
    now_s : callable
        Wall time, s.
    """

    WINDOW_S = 1.0
    """Wall time after which the clock may go back: time was shifted, or all comes later now."""

    def __init__(self, per_s: int, now_s: Callable[[], float]) -> None:
        self._per_s, self._now_s = per_s, now_s
        # Tick and wall time of the least late one, in the window before and in the present one.
        self._least_late: list[tuple[int, float]] = []
        self._begun_s = 0.0

    def now(self) -> int | None:
        """Tick of now; None before the trigger has come."""
        now_s = self._now_s()
        ticks = [tick + int((now_s - at_s) * self._per_s) for tick, at_s in self._least_late]
        return max(ticks, default=None)

    def hear(self, tick: int) -> None:
        """The trigger has come."""
        now_s, present = self._now_s(), self._least_late[-1:]
        if not present or now_s - self._begun_s >= self.WINDOW_S:
            self._least_late, self._begun_s = [*present, (tick, now_s)], now_s
        elif tick >= present[0][0] + int((now_s - present[0][1]) * self._per_s):
            self._least_late[-1] = tick, now_s

    def forget(self) -> None:
        """Time has been set anew, or nobody steps."""
        self._least_late.clear()


def stamp_refusal(topic: str, stamp_ns: int, clock_ns: int, start_ns: int) -> str:
    """Why a stamp is refused.

    Parameters
    ----------
    topic : str
    stamp_ns, clock_ns, start_ns : int
        Of the message, of the node that heard it, and of tick 0.
    """
    stamp_s, clock_s, start_s = (ns / NS_PER_S for ns in (stamp_ns, clock_ns, start_ns))
    if stamp_ns == 0:
        return f"{topic}: the stamp is zero; stamp messages with the flight's time, /clock"
    if stamp_ns < start_ns:
        return f"{topic}: stamped {stamp_s:.2f} s, before the flight's first moment, {start_s:g} s"
    side = "ahead of" if stamp_ns > clock_ns else "behind"
    return f"{topic}: stamped {stamp_s:.2f} s, {side} this node's clock, {clock_s:.2f} s"


# -------------------------------------------------------------------------------------------------
# What a node that was started again has missed, in the order of time. No ROS.
#
# Its senders repeat what they have sent, each topic by itself, as fast as it goes. A step must not
# be
# made before what belongs to it has come, so all of it is collected first.
# -------------------------------------------------------------------------------------------------

_LIMIT_S = 0.15


class Backlog:
    """Messages of the past, until the trigger comes at its own pace again.

    Parameters
    ----------
    trigger : str
    demands : mapping of str to Demand
        Of each topic: how often it comes, and how late.
    pace_s : float
        Wall time between two messages of the trigger that are not repeated but new, at the least.
    now_s : callable, optional
        Wall time, s.
    """

    def __init__(
        self,
        trigger: str,
        demands: Mapping[str, Demand],
        pace_s: float,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._trigger, self._demands = trigger, dict(demands)
        self._pace_s, self._now_s = pace_s, now_s
        self._begun_s = self._came_s = 0.0
        self._is_new = False
        self._kept: dict[str, dict[int, Any]] = defaultdict(dict)

    def take(self, topic: str, tick: int, value: Any) -> None:
        """A message stamped with a tick."""
        now_s = self._now_s()
        if not self._kept:
            self._begun_s = self._came_s = now_s
        self._kept[topic].setdefault(tick, value)
        if topic == self._trigger:
            self._is_new, self._came_s = now_s - self._came_s >= self._pace_s, now_s

    def complete(self) -> bool:
        """Whether it can be flown: the trigger is new, and who sends at all has caught up; or
        after a limit."""
        if not self._kept[self._trigger]:
            return False
        newest = max(self._kept[self._trigger])
        level = all(
            newest - max(self._kept[topic]) <= demand.lag_ticks + demand.every_ticks
            for topic, demand in self._demands.items()
            # What answers this node's own messages cannot have come since.
            if self._kept[topic] and not demand.first_tick
        )
        return (self._is_new and level) or self._now_s() - self._begun_s > _LIMIT_S

    def steps(self) -> Iterator[tuple[int, dict[str, tuple[int, Any]]]]:
        """Ticks of the trigger in order, each with the newest of every topic since the one before.

        A message counts from the tick on at which it is due: a fix comes late.
        """
        waiting = {
            topic: sorted(ticks.items(), reverse=True) for topic, ticks in self._kept.items()
        }
        for tick in sorted(self._kept[self._trigger]):
            arrived = {}
            for topic, left in waiting.items():
                while left and left[-1][0] + self._demands[topic].lag_ticks <= tick:
                    arrived[topic] = left.pop()
            yield tick, arrived


# -------------------------------------------------------------------------------------------------
# When a node steps, decided by the stamps of what arrives. No ROS.
#
# `Lockstep` steps when all that the schedule demands for a tick has come, `RealTime` when the
# trigger
# comes. Both are built when a node is configured, and step between `start` and `stop`.
# -------------------------------------------------------------------------------------------------

Arrived = Mapping[str, tuple[int, Any]]
"""Per topic: stamp tick, and the array or None if the message could not be used."""
Step = Callable[[int, Arrived], None]
_REPEATED_TICKS = 2
"""Lockstep, after a start in a predecessor's place: ticks whose messages are repeated, each topic
by itself, so that a later one of the trigger does not mean that no more will come. Time stands
still meanwhile: the trigger is ahead by one tick, if the predecessor died before it noted a step.
"""
SILENT_S = 0.15
"""Real time: wall time after which a node that nothing triggers says so."""


class Lockstep:
    """Steps in order, each with the messages of its tick, and waits for a silent peer so long.

    The trigger's message begins a tick. One of a later tick means that its sender has gone on: then
    nothing more will come for this one. What comes before `start` is kept for it, what comes after
    `stop` is not.

    Parameters
    ----------
    demands : mapping of topic to Demand
        The first topic is the trigger.
    step : callable
        Gets the tick and what has arrived for it; topics that did not come are absent.
    peer_timeout_s : float
        Wall time without a step after which missing topics are called silent.
    ready : callable, optional
        Whether steps may be made at all.
    on_silence : callable, optional
        Called when topics have become silent.
    leads : bool
        True for the node that makes time: it begins at tick 0, and goes on, one step per `look`,
        when even its trigger is silent. So `look` is to be called once a tick.
    now_s : callable, optional
        Wall time, s.
    refused : callable, optional
        Told of stamps too far from the clock, which is the next step or the trigger's newest.
    of_leader : iterable of str, optional
        Topics of the node that makes time. It may have begun without this node, and be connected
        to it topic by topic: a node that joins it in flight waits for none that it never heard.

    Attributes
    ----------
    silent : set of str
        Topics that are not waited for until they come again.
    """

    def __init__(
        self,
        demands: Mapping[str, Demand],
        step: Step,
        peer_timeout_s: float,
        ready: Callable[[], bool] = lambda: True,
        on_silence: Callable[[], None] = lambda: None,
        leads: bool = False,
        now_s: Callable[[], float] = time.monotonic,
        refused: Refused = lambda topic, tick, clock_tick: None,
        of_leader: Iterable[str] = (),
    ) -> None:
        self._assembler = TickAssembler(demands)
        self._trigger = next(iter(demands))
        self._lags = {topic: demand.lag_ticks for topic, demand in demands.items()}
        # A trigger that comes every so many ticks is ahead by as many.
        self._most_ticks = AHEAD_TICKS - 1 + demands[self._trigger].every_ticks
        self._setting, self._refused = ClockGuard(), refused
        self._step, self._ready, self._on_silence, self._now_s = step, ready, on_silence, now_s
        self._peer_timeout_s, self._leads = peer_timeout_s, leads
        self._collecting, self._stepping = True, False
        self._newest_trigger: int | None = None
        self._repeated_until: int | None = None
        self._progress_s = 0.0
        self._unheard = set(of_leader)
        self.silent: set[str] = set()

    @property
    def counters(self) -> Counters:
        """What was not used so far."""
        return self._assembler.counters

    def expect(self, topics: Iterable[str], expected: bool) -> None:
        """Do (not) wait for these topics; what comes of them is used nevertheless."""
        for topic in topics:
            self._assembler.waive(topic, not expected)

    def go_without(self, topics: Iterable[str]) -> None:
        """Call topics silent whose senders are known to be absent; until they come."""
        self.silent.update(topics)
        self.expect(topics, False)

    def start(self, after: int | None = None, backlog: Backlog | None = None) -> None:
        """Begin, with what came while the node was getting ready; or go on after a pause.

        With a tick `after`, of a node's predecessor, begin with the one that follows it.
        """
        self._stepping, self._progress_s = True, self._now_s()
        if self._assembler.next_tick is not None:
            self.resume()
            return
        if after is not None:
            self._assembler.start(after + 1)
            self._repeated_until = after + _REPEATED_TICKS
            self._newest_trigger = self._newest_in_a_row()
            self.resume()
            return
        waiting = self._assembler.kept(self._trigger)
        if self._leads or waiting:
            self._begin_at(0 if self._leads else waiting[0])
            self._newest_trigger = self._newest_in_a_row()
            self.resume()

    def _begin_at(self, tick: int) -> None:
        self._assembler.start(tick)
        if tick > 0:
            self.go_without(self._unheard)

    def _newest_in_a_row(self) -> int | None:
        """Newest trigger that is kept, of those that follow one another without a long gap."""
        newest = None
        for tick in self._assembler.kept(self._trigger):
            if newest is not None and tick - newest > self._most_ticks:
                break
            newest = tick
        return newest

    def pause(self) -> None:
        """Cease to step, and keep what has been collected and what comes: `start` goes on."""
        self._collecting, self._stepping = True, False

    def stop(self) -> None:
        """Cease to step and forget what has been collected."""
        self._collecting = self._stepping = False
        self._assembler.reset()
        self._newest_trigger = self._repeated_until = None
        self._setting.fits()
        self.silent.clear()

    def _fits(self, topic: str, tick: int) -> bool:
        """Whether a message may be used now or soon; a trigger that does not fit may set the clock.

        What is late is left to the assembler. The node that makes time has its own clock.
        """
        first = self._assembler.next_tick
        if first is None:
            return True
        newest, step = self._newest_trigger, tick + self._lags[topic]
        now = first if newest is None else max(first, newest)
        sets = topic == self._trigger and not self._leads
        ahead = step > now + self._most_ticks
        if not ahead and not (sets and step < first - self._most_ticks):
            if sets:
                self._setting.fits()
            return True
        if sets and self._setting.sets_clock(step, self._most_ticks):
            self._assembler.start(step)
            self._newest_trigger = None
            return True
        self._refused(topic, tick, now)
        if ahead:
            self.counters.ahead += 1
        else:
            self.counters.late += 1
        return False

    def take(self, topic: str, tick: int, value: Any) -> None:
        """A message stamped with a tick; None if it cannot be used."""
        self._unheard.discard(topic)
        if not (self._collecting or self._stepping):
            return
        assembler = self._assembler
        if not self._fits(topic, tick):
            return
        if topic in self.silent:
            self.silent.discard(topic)
            assembler.waive(topic, False)
        if not assembler.add(topic, tick, (tick, value)) or not self._stepping:
            return
        if topic == self._trigger:
            if assembler.next_tick is None:
                self._begin_at(tick)
            newest = self._newest_trigger
            self._newest_trigger = tick if newest is None else max(tick, newest)
        self.resume()

    def resume(self) -> None:
        """Make the steps that nothing more can come for."""
        while self._stepping and (self._assembler.complete() or self._is_passed()):
            if not self._ready():
                return
            self._make_step()

    def look(self) -> None:
        """To be called now and then: after the bounded wait, go on without those who are silent."""
        if not self._stepping or self._assembler.next_tick is None:
            return
        self.resume()
        if self._trigger in self.silent:
            self._make_step()
            return
        missing = self._assembler.missing()
        waits = self._trigger in missing and not self._leads
        if not missing or waits or self._now_s() - self._progress_s < self._peer_timeout_s:
            return
        self.go_without(missing)
        self._on_silence()
        if self._trigger in missing:
            self._make_step()
        self.resume()

    def _is_passed(self) -> bool:
        """Whether the trigger's sender has gone on to a later tick than that of the next step."""
        tick, newest = self._assembler.next_tick, self._newest_trigger
        if tick is None or newest is None or tick >= newest:
            return False
        return self._repeated_until is None or tick > self._repeated_until

    def _make_step(self) -> None:
        tick = self._assembler.next_tick
        assert tick is not None
        self._progress_s = self._now_s()
        self._step(tick, self._assembler.take())


class RealTime:
    """Steps when the trigger comes, with the newest of each topic since the last step.

    Its clock is a `TriggerClock`.

    Parameters
    ----------
    trigger : str or None
        None: it never steps by itself, `collect` is called by who keeps time.
    step : callable
        Gets the tick and what has arrived since the last one.
    own_tick : callable, optional
        The clock of who keeps time.
    now_s : callable, optional
        Wall time, s.
    refused : callable, optional
        Told of stamps too far from the clock.
    rate : Rate, optional
        Of the ticks.
    on_silence : callable, optional
        Called when the trigger has become silent.

    Attributes
    ----------
    counters : Counters
        What was not used so far.
    silent : set of str
        The trigger, if it has been silent for long; nobody is waited for. That of who keeps time is
        filled and emptied by it.
    """

    def __init__(
        self,
        trigger: str | None,
        step: Step,
        own_tick: Callable[[], int] | None = None,
        now_s: Callable[[], float] = time.monotonic,
        refused: Refused = lambda topic, tick, clock_tick: None,
        rate: Rate = OF_100_HZ,
        on_silence: Callable[[], None] = lambda: None,
    ) -> None:
        self._trigger, self._step = trigger, step
        self._ahead = rate.of(AHEAD_TICKS)
        self._own_tick, self._now_s, self._refused = own_tick, now_s, refused
        self._on_silence = on_silence
        self._stepping = self._paused = False
        self._backlog: Backlog | None = None
        self._clock = TriggerClock(rate.hz, now_s)
        self._heard_s: float | None = None
        self._setting = ClockGuard()
        self._newest: dict[str, int] = {}
        self._arrived: dict[str, tuple[int, Any]] = {}
        self.counters = Counters()
        self.silent: set[str] = set()

    def expect(self, topics: Iterable[str], expected: bool) -> None:
        """Nothing is waited for, so there is nothing to change."""

    def go_without(self, topics: Iterable[str]) -> None:
        """The same: who keeps time notices by itself that nobody commands."""

    def start(self, after: int | None = None, backlog: Backlog | None = None) -> None:
        """Begin to step, or go on after a pause; with a backlog, from what it collects."""
        self._stepping, self._paused, self._backlog = True, False, backlog

    def pause(self) -> None:
        """Cease to step, and keep what comes: `start` goes on."""
        self._stepping, self._paused = False, True

    def stop(self) -> None:
        """Cease to step and forget what has been collected."""
        self._stepping = self._paused = False
        self._heard_s = self._backlog = None
        self._clock.forget()
        self._setting.fits()
        self._newest.clear()
        self._arrived.clear()
        self.silent.clear()

    def now_tick(self) -> int | None:
        """The clock; None before the trigger has come."""
        return self._clock.now() if self._own_tick is None else self._own_tick()

    def _fits(self, topic: str, tick: int, now: int | None) -> bool:
        """Whether a message is not ahead of the clock; a trigger that does not fit may set it."""
        if now is None:
            return True
        sets = topic == self._trigger
        known = self._newest.get(topic, tick)
        if tick <= now + self._ahead and not (sets and tick < known - self._ahead):
            if sets:
                self._setting.fits()
            return True
        if sets and self._setting.sets_clock(tick, self._ahead):
            self._forget_from(tick)
            self._clock.forget()
            return True
        self._refused(topic, tick, now)
        if tick > now:
            self.counters.ahead += 1
        else:
            self.counters.late += 1
        return False

    def _forget_from(self, tick: int) -> None:
        """Forget what is stamped with this tick or a later one."""
        for topic in [name for name, known in self._newest.items() if known >= tick]:
            del self._newest[topic]
            self._arrived.pop(topic, None)

    def take(self, topic: str, tick: int, value: Any) -> None:
        """A message stamped with a tick; dropped if it is not newer than the one before."""
        if not (self._stepping or self._paused):
            return
        if self._backlog is not None:
            self._backlog.take(topic, tick, value)
            self._catch_up(self._backlog)
            return
        now = self.now_tick()
        if not self._fits(topic, tick, now):
            return
        known = self._newest.get(topic)
        if known is not None and tick <= known:
            if tick == known:
                self.counters.duplicate += 1
            else:
                self.counters.late += 1
            return
        if topic == self._trigger:
            self._newest[topic] = tick
            if self._heard_s is None:
                self._forget_from(tick + self._ahead + 1)
            self._heard_s = self._now_s()
            self._clock.hear(tick)
            self.silent.discard(topic)
        else:
            # A stamp a little ahead must not make the next one late.
            self._newest[topic] = tick if now is None else min(tick, now)
        self._arrived[topic] = (tick, value)
        # Before tick 0 there is no flight.
        if topic == self._trigger and tick >= 0 and self._stepping:
            self._step(tick, self.collect())

    def _catch_up(self, backlog: Backlog) -> None:
        """Fly what was missed, when all of it has come."""
        if not backlog.complete():
            return
        self._backlog = None
        for tick, arrived in backlog.steps():
            for topic, (stamp, _) in arrived.items():
                self._newest[topic] = stamp
            self._heard_s = self._now_s()
            self._clock.hear(tick)
            self._step(tick, arrived)

    def collect(self) -> Arrived:
        """What has arrived since the last call."""
        arrived, self._arrived = self._arrived, {}
        return arrived

    def resume(self) -> None:
        """No step ever waits here, so there is none to resume."""

    def look(self) -> None:
        """To be called now and then: notice that the trigger is silent. Nobody is waited for."""
        trigger, heard_s = self._trigger, self._heard_s
        if trigger is None or heard_s is None or not self._stepping or trigger in self.silent:
            return
        if self._now_s() - heard_s > SILENT_S:
            self.silent.add(trigger)
            self._on_silence()


Pace = Lockstep | RealTime
