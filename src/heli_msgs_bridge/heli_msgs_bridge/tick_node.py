# SPDX-License-Identifier: Apache-2.0
"""A managed node that steps once per tick on the messages of that tick."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import partial
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message

from heli_msgs_bridge import topics
from heli_msgs_bridge.arrivals import Owner
from heli_msgs_bridge.backlog import Backlog
from heli_msgs_bridge.diagnostics import NO_MESSAGE, Level
from heli_msgs_bridge.floods import (
    COMMANDS_AT_ONCE,
    COMMANDS_PER_S,
    MOST_BYTES,
    Limit,
    too_long,
)
from heli_msgs_bridge.frames import Datum
from heli_msgs_bridge.heard_links import HeardLinks
from heli_msgs_bridge.lockstep import Demand
from heli_msgs_bridge.managed_node import Run
from heli_msgs_bridge.messages import (
    CHANNELS,
    ClockDecoder,
    Decoder,
    Encoder,
    Variance,
)
from heli_msgs_bridge.receiver import receiver
from heli_msgs_bridge.senders import (
    NOT_YET_NAMED,
    SENDERS,
    full_name,
    heirs_of,
    senders_of,
    several_in_words,
    strangers_of,
)
from heli_msgs_bridge.services import in_words as in_line
from heli_msgs_bridge.stamps import in_words
from heli_msgs_bridge.stepping import Arrived, Lockstep, Pace, RealTime
from heli_msgs_bridge.successor import Successor
from heli_msgs_bridge.tick_core import Input, Refusals, TickCore

__all__ = ["Arrived", "Input", "Send", "TickCore", "TickNode"]
Send = Callable[[NDArray[np.float64], int], None]
"""Sends a row (NED/FRD), stamped in ns."""
_WATCH_PERIOD_S = 0.05
_SENDERS_PERIOD_S = 1.0
# Real time: wall time after which a silent sender is succeeded by another one of its topic.
_SILENT_OWNER_S = 0.5
# Wall time after which a silent pilot is succeeded by another one.
_SILENT_PILOT_S = 1.0
# Time that is set back to one of these has begun anew; the first tick itself is refused.
_FIRST_TICKS = 10


Core = TypeVar("Core", bound=TickCore)


class TickNode(Successor[Core, Run]):
    """Collects inputs by tick and calls `step` (`stepping` says when)."""

    def __init__(self, values: Mapping[str, Any], **options: Any) -> None:
        super().__init__(values, **options)
        self._owners: dict[str, Owner] = {}
        self._demands: dict[str, Demand] = {}
        # Per topic its sender's name, if it was the only one when it was first heard.
        self._alone: dict[str, str] = {}
        self.links = HeardLinks(self.SPEC.name, {}, values)

    # --- for sub-classes to implement ----------------------------------------------------------

    @abstractmethod
    def step(self, tick: int, arrived: Arrived) -> None:
        """One tick of the node; topics that did not come are absent from `arrived`."""

    def begin_anew(self) -> None:
        """The plant has begun another flight while this node was active: forget the past one."""

    def is_ready(self) -> bool:
        """Whether steps may be made at all; a node that waits for something else says it here."""
        return True

    def silence(self) -> str:
        """Sentence about silent topics and who should send them; empty if there are none."""
        silent = sorted(self.core.pace.silent) if self.configured else []
        if not silent:
            return ""
        parts = [f"'{name}' from {'/'.join(topics.BY_NAME[name].source)}" for name in silent]
        follows = "going on without" if self.values["lockstep"] else "nothing is sent meanwhile"
        return f"{NO_MESSAGE}{', '.join(parts)}: {follows}"

    # --- for sub-classes to use ----------------------------------------------------------------

    def listen(
        self, inputs: tuple[Input, ...], datum: Datum | None = None, leads: bool = False
    ) -> Pace:
        """Subscribe to the inputs and make what decides when to step; called from `configure`.

        Parameters
        ----------
        inputs : tuple of Input
            The first one is the trigger.
        datum : Datum, optional
            For `gps/fix`.
        leads : bool
            True for the node that makes time; in real time it steps by a timer of its own.
        """
        pace: Pace
        owners: dict[str, Owner] = {}
        self._owners, self._alone = owners, {}
        lags = {i.topic: i.demand.lag_ticks for i in inputs}
        self.links = HeardLinks(self.SPEC.name, lags, self.values)
        refused = self.refuse_stamp
        if self.values["lockstep"]:
            pace = Lockstep(
                {i.topic: i.demand for i in inputs},
                self._make_step,
                self.values["peer_timeout_s"],
                self.is_ready,
                lambda: self.get_logger().warning(self.silence()),
                leads,
                refused=refused,
            )
            self.repeat(_WATCH_PERIOD_S, pace.look)
        else:
            trigger, own_tick = (None, lambda: self.tick) if leads else (inputs[0].topic, None)
            pace = RealTime(
                trigger, self._make_step, own_tick, refused=refused, rate=self.rate,
                told=self._tell_silence,
            )  # fmt: skip
            if not leads:
                self.repeat(_WATCH_PERIOD_S, pace.look)
        for item in inputs:
            decoder: Decoder | ClockDecoder
            if item.topic == topics.CLOCK:
                decoder = ClockDecoder()
            else:
                place = datum if item.topic == topics.GPS_FIX else None
                decoder = Decoder(item.topic, place, namespace=self.get_namespace())
            owner = owners[item.topic] = self._owner(item.topic)
            receive = receiver(self, item, decoder, pace)
            ignored = partial(self._look_at_senders, item.topic, owner)
            self.hear(
                item.topic, receive, qos=self.repeated(), raw=True, owner=owner, ignored=ignored
            )
        self.repeat(_SENDERS_PERIOD_S, partial(self._look_at_all_senders, owners))
        self._demands = {item.topic: item.demand for item in inputs}
        return pace

    def _tell_silence(self) -> None:
        """Real time: nobody triggers this node; it says so at once."""
        if self.health.level < Level.ERROR:
            self.report(Level.WARN, self.silence())

    def hear_commands(
        self, topic: str, callback: Callable[[Any], None], most_bytes: int = MOST_BYTES
    ) -> None:
        """Hear whoever sends on a topic, so many a second; the rest is refused unread."""
        limit = Limit(COMMANDS_PER_S, COMMANDS_AT_ONCE, f"messages on {topic}")
        read = self._reader(topic, callback, most_bytes)

        def receive(raw: bytes) -> None:
            if limit.admits():
                read(raw)
            else:
                self.refuse_aloud(topic, f"{topic}: {limit.sentence}")

        self.hear(topic, receive, raw=True)

    def _reader(
        self, topic: str, callback: Callable[[Any], None], most_bytes: int = MOST_BYTES
    ) -> Callable[[bytes], None]:
        """Callback for serialised messages: calls the given one with the message, or refuses."""
        cls = topics.message_class(topics.BY_NAME[topic].type)

        def read(raw: bytes) -> None:
            if why := too_long(topic, len(raw), most_bytes):
                self.refuse_aloud(topic, why)
                return
            try:
                message = deserialize_message(raw, cls)
            except Exception as error:  # rclpy raises what it likes
                self.refuse_aloud(topic, f"{topic}: not a message of its type: {in_line(error)}")
                return
            callback(message)

        return read

    def hear_one(self, topic: str, callback: Callable[[Any], None]) -> None:
        """Hear the first of those who send on a topic; another one when it has been silent.

        Called from `configure`, after `listen`.
        """
        name, read = self.resolve_topic_name(topic), self._reader(topic, callback)
        owner = Owner(lambda: self.count_publishers(name), _SILENT_PILOT_S, 0)
        self._owners[topic] = owner

        def receive(raw: bytes) -> None:
            if topic not in self._alone:
                self._look_who_is_alone(topic)
            read(raw)

        ignored = partial(self._look_at_senders, topic, owner)
        self.hear(topic, receive, raw=True, owner=owner, ignored=ignored)

    def _look_who_is_alone(self, topic: str) -> None:
        """Note the name of a topic's only sender: should another one come, it was the first."""
        senders = senders_of(self, topic)
        if len(senders) == 1 and full_name(senders[0]) != NOT_YET_NAMED:
            self._alone[topic] = full_name(senders[0])

    def _owner(self, topic: str) -> Owner:
        """Who decides whose messages of a topic are used."""
        silence_s = self.values["peer_timeout_s"] if self.values["lockstep"] else _SILENT_OWNER_S
        period_ns = topics.BY_NAME[topic].period_ns(self.rate)
        name, heir = self.resolve_topic_name(topic), heirs_of(self, topic)
        return Owner(lambda: self.count_publishers(name), silence_s, period_ns, heir=heir)

    def _look_at_all_senders(self, owners: Mapping[str, Owner]) -> None:
        """Once a second: whether a topic has more than one sender, and who they are."""
        self.core.rivals.clear()
        for topic, owner in owners.items():
            self._look_at_senders(topic, owner)

    def _look_at_senders(self, topic: str, owner: Owner) -> None:
        """Name the senders of a topic if they are several; also as soon as one is ignored."""
        core, name = self.core, self.resolve_topic_name(topic)
        several = topic not in core.rivals and self.count_publishers(name) > 1
        # Of a node that was started again its predecessor is in the graph for some seconds.
        if several and (not self.respawns or strangers_of(self, topic)):
            first = "" if owner.successions else self._alone.get(topic, "")
            core.rivals[topic] = several_in_words(topic, senders_of(self, topic), first)
        if topic in core.rivals or owner.ignored or owner.successions:
            said = core.rivals.get(topic) or core.senders.get(topic, topic).split("; ignored")[0]
            counted = f"ignored so far: {owner.ignored} messages"
            if owner.successions:
                counted += f"; the sender that is used has changed: {owner.successions} times"
            core.senders[topic] = f"{said}; {counted}"

    def create_sender(
        self,
        topic: str,
        variances: Sequence[Variance] = (),
        datum: Datum | None = None,
        fix_status: int = 0,
        also: Callable[[bytes], None] | None = None,
    ) -> Send:
        """Lifecycle publisher of a stream; returns what sends a row of the core (`Encoder`).

        `also` gets the bytes of each message that was sent.
        """
        encoder = Encoder(topic, variances, datum, self.get_namespace(), fix_status)
        encode, publish = encoder.encode, self.create_output(topic)
        # So that the compiled conversion is loaded before the first tick.
        encode(np.zeros(CHANNELS[topic].size), self.start_ns)

        def send(row: NDArray[np.float64], stamp_ns: int) -> None:
            publish(encode(row, stamp_ns))

        if also is None:
            return send

        def send_and_tell(row: NDArray[np.float64], stamp_ns: int) -> None:
            raw = encode(row, stamp_ns)
            publish(raw)
            also(raw)

        return send_and_tell

    def refuse(self, topic: str, reason: str) -> None:
        """Say, once per reason, that a message of a topic was refused."""
        refused = self.core.refused
        if refused.get(topic) != reason:
            self.get_logger().warning(f"message refused: {reason}")
        refused[topic] = reason

    def refuse_aloud(self, topic: str, why: str) -> None:
        """Count a refused message; log it once a second, say it in /diagnostics for a second."""
        refusals = self.core.refusals.setdefault(topic, Refusals())
        again = refusals.count and self.tick // self.rate.hz == refusals.tick // self.rate.hz
        refusals.count, refusals.why, refusals.tick = refusals.count + 1, why, self.tick
        self.core.refused[topic] = why
        if again:
            return
        level, message = self.health.level, self.health.message
        if level < Level.WARN:
            level, message = Level.WARN, self.refusal()
        else:
            self.get_logger().warning(f"message refused: {why}")
        self.report(level, message, {**self.health.facts, **self._refused_facts()})

    def _refused_facts(self) -> dict[str, str]:
        refusals = self.core.refusals.items()
        said = {f"refused.{topic}": f"{r.count}; {r.why}" for topic, r in refusals}
        return said | {f"{SENDERS}{topic}": why for topic, why in self.core.senders.items()}

    def refusal(self) -> str:
        """Sentence about a message that was refused aloud in the last second; else empty."""
        if not self.configured:
            return ""
        told = self.core.refusals.values()
        recent = (r for r in told if 0 <= self.tick - r.tick < self.rate.hz)
        newest = max(recent, key=lambda r: r.tick, default=None)
        return f"message refused: {newest.why}" if newest is not None else ""

    def refuse_stamp(self, topic: str, tick: int, clock_tick: int) -> None:
        """Refuse aloud a message whose stamp does not fit to the clock."""
        stamp_ns, clock_ns = self.stamp_ns(tick), self.stamp_ns(clock_tick)
        self.refuse_aloud(topic, in_words(topic, stamp_ns, clock_ns, self.start_ns))

    def stamp_ns(self, tick: int) -> int:
        """Message stamp of a tick."""
        return self.start_ns + tick * self.rate.tick_ns

    def warn_or_ok(self, level: Level, message: str, facts: Mapping[str, Any]) -> None:
        """Report the core's state, or what peers do wrong if that is worse."""
        wrong = (
            self.silence()
            or self.refusal()
            or self.links.acting(self.rate.seconds(self.tick))
            or next(iter(self.core.rivals.values()), "")
        )
        if wrong and level < Level.WARN:
            level, message = Level.WARN, wrong
        changed = (level, message) != (self.health.level, self.health.message)
        if changed or self.tick % self.rate.hz == 0:
            unused = {f"messages_{k}": n for k, n in asdict(self.core.pace.counters).items() if n}
            facts = {**facts, **unused, **self.links.facts()}
            self.report(level, message, {**facts, **self._refused_facts()})

    def has_news(self, message: str) -> bool:
        """Whether `warn_or_ok` may have anything to say beyond what was said last."""
        core = self.core
        return bool(
            self.tick % self.rate.hz == 0
            or message != self.health.message
            or core.pace.silent
            or core.refusals
            or core.rivals
        )

    # --- life ----------------------------------------------------------------------------------

    def begin(self) -> None:
        """Begin to step, with what came while the node was getting ready; or go on in the place of
        a predecessor."""
        self.core.stepped = None
        known = self.take_over()
        if known is None:
            self.core.pace.start()
            return
        self.core.stepped = known
        backlog = None
        if self.CATCHES_UP:
            trigger, half_s = next(iter(self._demands)), 0.5 * self.rate.tick_s
            backlog = Backlog(trigger, self._demands, half_s)
        self.core.pace.start(known, backlog)

    def disengage(self) -> None:
        """Cease to step and forget what has been collected."""
        self.core.pace.stop()

    def _make_step(self, tick: int, arrived: Arrived) -> None:
        before, self.core.stepped = self.core.stepped, tick
        if before is not None and tick <= before and tick < _FIRST_TICKS:
            self.get_logger().warning("time has begun anew: another flight")
            for refusals in self.core.refusals.values():
                refusals.tick = tick
            self.links.begin_anew()
            self.begin_anew()
        self.tick = tick
        self.step(tick, self.links.through(tick, arrived))
        self.keep(tick)
        self.send_report()
