# SPDX-License-Identifier: Apache-2.0
"""When a node steps, decided by the stamps of what arrives. No ROS.

`Lockstep` steps when all that the schedule demands for a tick has come, `RealTime` when the trigger
comes. Both are built when a node is configured, and step between `start` and `stop`.
"""

import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from heli_math.ticks import OF_100_HZ, Rate
from heli_msgs_bridge.backlog import Backlog
from heli_msgs_bridge.lockstep import Counters, Demand, TickAssembler
from heli_msgs_bridge.stamps import AHEAD_TICKS, Refused, Setting

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
    told : callable, optional
        Called when topics have become silent.
    leads : bool
        True for the node that makes time: it begins at tick 0, and goes on, one step per `look`,
        when even its trigger is silent.
    now_s : callable, optional
        Wall time, s.
    refused : callable, optional
        Told of stamps too far from the clock, which is the next step or the trigger's newest.

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
        told: Callable[[], None] = lambda: None,
        leads: bool = False,
        now_s: Callable[[], float] = time.monotonic,
        refused: Refused = lambda topic, tick, clock_tick: None,
    ) -> None:
        self._assembler = TickAssembler(demands)
        self._trigger = next(iter(demands))
        self._lags = {topic: demand.lag_ticks for topic, demand in demands.items()}
        # A trigger that comes every so many ticks is ahead by as many.
        self._most_ticks = AHEAD_TICKS - 1 + demands[self._trigger].every_ticks
        self._setting, self._refused = Setting(), refused
        self._step, self._ready, self._told, self._now_s = step, ready, told, now_s
        self._peer_timeout_s, self._leads = peer_timeout_s, leads
        self._collecting, self._stepping = True, False
        self._newest_trigger: int | None = None
        self._repeated_until = -1
        self._progress_s = 0.0
        self.silent: set[str] = set()

    @property
    def counters(self) -> Counters:
        """What was not used so far."""
        return self._assembler.counters

    def expect(self, topics: Iterable[str], expected: bool) -> None:
        """Do (not) wait for these topics; what comes of them is used nevertheless."""
        for topic in topics:
            self._assembler.waive(topic, not expected)

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
            self._assembler.start(0 if self._leads else waiting[0])
            self._newest_trigger = self._newest_in_a_row()
            self.resume()

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
        self._newest_trigger, self._repeated_until = None, -1
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
                assembler.start(tick)
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
        self.silent.update(missing)
        self.expect(missing, False)
        self._told()
        if self._trigger in missing:
            self._make_step()
        self.resume()

    def _is_passed(self) -> bool:
        """Whether the trigger's sender has gone on to a later tick than that of the next step."""
        tick, newest = self._assembler.next_tick, self._newest_trigger
        return tick is not None and newest is not None and self._repeated_until < tick < newest

    def _make_step(self) -> None:
        tick = self._assembler.next_tick
        assert tick is not None
        self._progress_s = self._now_s()
        self._step(tick, self._assembler.take())


class RealTime:
    """Steps when the trigger comes, with the newest of each topic since the last step.

    Its clock is the trigger's newest tick and the wall time that has gone since.

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
    told : callable, optional
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
        told: Callable[[], None] = lambda: None,
    ) -> None:
        self._trigger, self._step = trigger, step
        self._per_s, self._ahead = rate.hz, rate.of(AHEAD_TICKS)
        self._own_tick, self._now_s, self._refused = own_tick, now_s, refused
        self._told = told
        self._stepping = self._paused = False
        self._backlog: Backlog | None = None
        self._anchor: tuple[int, float] | None = None
        self._setting = Setting()
        self._newest: dict[str, int] = {}
        self._arrived: dict[str, tuple[int, Any]] = {}
        self.counters = Counters()
        self.silent: set[str] = set()

    def expect(self, topics: Iterable[str], expected: bool) -> None:
        """Nothing is waited for, so there is nothing to change."""

    def start(self, after: int | None = None, backlog: Backlog | None = None) -> None:
        """Begin to step, or go on after a pause; with a backlog, from what it collects."""
        self._stepping, self._paused, self._backlog = True, False, backlog

    def pause(self) -> None:
        """Cease to step, and keep what comes: `start` goes on."""
        self._stepping, self._paused = False, True

    def stop(self) -> None:
        """Cease to step and forget what has been collected."""
        self._stepping = self._paused = False
        self._anchor = self._backlog = None
        self._setting.fits()
        self._newest.clear()
        self._arrived.clear()
        self.silent.clear()

    def _now_tick(self) -> int | None:
        """The clock; None before the trigger has come."""
        if self._own_tick is not None:
            return self._own_tick()
        if self._anchor is None:
            return None
        tick, at_s = self._anchor
        return tick + int((self._now_s() - at_s) * self._per_s)

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
        now = self._now_tick()
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
            if self._anchor is None:
                self._forget_from(tick + self._ahead + 1)
            self._anchor = (tick, self._now_s())
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
            self._anchor = (tick, self._now_s())
            self._step(tick, arrived)

    def collect(self) -> Arrived:
        """What has arrived since the last call."""
        arrived, self._arrived = self._arrived, {}
        return arrived

    def resume(self) -> None:
        """No step ever waits here, so there is none to resume."""

    def look(self) -> None:
        """To be called now and then: notice that the trigger is silent. Nobody is waited for."""
        trigger, anchor = self._trigger, self._anchor
        if trigger is None or anchor is None or not self._stepping or trigger in self.silent:
            return
        if self._now_s() - anchor[1] > SILENT_S:
            self.silent.add(trigger)
            self._told()


Pace = Lockstep | RealTime
