# SPDX-License-Identifier: Apache-2.0
"""A managed node that steps once per tick on the messages of that tick."""

from abc import abstractmethod
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message

from heli_core.ticks import Rate
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.diagnostics import (
    FACT_REFUSED,
    FACT_UNUSABLE,
    NO_MESSAGE,
    Level,
    NodeState,
    refusal_text,
)
from heli_msgs_bridge.frames import Datum
from heli_msgs_bridge.handover import HandoverRecord, handover_file_of
from heli_msgs_bridge.layouts import CHANNELS, CutOffError, FrameError, MessageError
from heli_msgs_bridge.lifecycle_node import Core, ManagedNode, Run
from heli_msgs_bridge.links import HeardLinks
from heli_msgs_bridge.lockstep import (
    AHEAD_TICKS,
    Arrived,
    Backlog,
    Demand,
    Lockstep,
    Pace,
    RealTime,
    stamp_refusal,
)
from heli_msgs_bridge.message_size import MOST_BYTES, too_long
from heli_msgs_bridge.messages import Decoder, Encoder, StampDecoder, Variance
from heli_msgs_bridge.peers import disagreeing
from heli_msgs_bridge.services import (
    COMMANDS_AT_ONCE,
    COMMANDS_PER_S,
    RateLimit,
)
from heli_msgs_bridge.services import error_line as in_line
from heli_msgs_bridge.sources import (
    NOT_YET_NAMED,
    PublisherLock,
    TopicSenders,
    full_name,
    lock_of,
    senders_of,
    several,
    strangers_of,
)

# -------------------------------------------------------------------------------------------------
# What a node that steps by tick hears, and what it has while it is configured.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Input:
    """A topic that a step uses.

    Attributes
    ----------
    topic : str
    demand : Demand
        When lockstep waits for it.
    off_tick : bool
        True if stamps between ticks are allowed (they count for the tick before).
    """

    topic: str
    demand: Demand
    off_tick: bool = False


@dataclass(kw_only=True)
class TickCore:
    """What every tick node has while it is configured.

    Attributes
    ----------
    pace : Lockstep or RealTime
        When it steps; made by `TickNode.listen`.
    stepped : int or None
        Newest tick of the present activation.
    refused : dict of str
        Per topic, why its last refused message was refused.
    unusable : Counter
        Per topic, how many messages held no value that can be used: not finite, or cut off.
    refusals : dict of Refusals
        Per topic, the messages that /diagnostics speaks of: those whose stamps did not fit to the
        clock, references that were not followed.
    rivals : dict of TopicSenders
        Per topic that has more than one sender now, who they are.
    senders : dict of TopicSenders
        The same of all that had more than one, with what was ignored.
    """

    pace: Pace
    stepped: int | None = None
    refused: dict[str, str] = field(default_factory=dict)
    unusable: Counter[str] = field(default_factory=Counter)
    refusals: dict[str, "Refusals"] = field(default_factory=dict)
    rivals: dict[str, TopicSenders] = field(default_factory=dict)
    senders: dict[str, TopicSenders] = field(default_factory=dict)


@dataclass
class Refusals:
    """Messages of a topic that were refused: how many, why, tick of the last."""

    count: int = 0
    why: str = ""
    tick: int = 0


# -------------------------------------------------------------------------------------------------
# From the serialised messages of a topic to rows by tick.
# -------------------------------------------------------------------------------------------------

# Of a message that holds a stamp.
_LEAST_BYTES = 12


class SubscribingNode(Protocol):
    """What is needed of a node that hears."""

    start_ns: int
    tick: int
    rate: Rate

    @property
    def heard_until(self) -> int | None:
        """Tick up to which a predecessor has heard."""

    def refuse(self, topic: str, reason: str) -> None:
        """Say that a message was refused."""

    def refuse_aloud(self, topic: str, why: str) -> None:
        """The same, counted."""

    def refuse_stamp(self, topic: str, tick: int, clock_tick: int) -> None:
        """Say that a stamp does not fit to the clock."""


def off_tick_refusal(topic: str, stamp_ns: int) -> str:
    """Why a message whose stamp lies between two ticks is refused."""
    return f"{topic}: stamp {stamp_ns} ns is not on a tick"


class Taker(Protocol):
    """What takes messages by tick: a pace."""

    def take(self, topic: str, tick: int, value: Any) -> None:
        """A message stamped with a tick; None if it cannot be used."""


class Absence:
    """That some topics have no message of a tick: to a pace, one of each that cannot be used.

    Parameters
    ----------
    pace : Taker
    absent : sequence of str
        The topics.
    """

    def __init__(self, pace: Taker, absent: Sequence[str]) -> None:
        self._pace, self._absent = pace, tuple(absent)

    def take(self, topic: str, tick: int, value: Any) -> None:
        """The message that says so."""
        for name in self._absent:
            self._pace.take(name, tick, None)


def receiver(
    node: SubscribingNode, item: Input, decoder: Decoder | StampDecoder, pace: Taker
) -> Callable[[bytes], bool]:
    """Callback for the serialised messages of a topic; returns whether one is of its type.

    Parameters
    ----------
    node : SubscribingNode
        Told of what is refused.
    item : Input
    decoder : Decoder or StampDecoder
        Of its topic.
    pace : Taker
        Takes a row, or None for one that is none, by tick.
    """
    topic, off_tick, start_ns = item.topic, item.off_tick, node.start_ns
    earliest, tick_ns = -item.demand.lag_ticks, node.rate.tick_ns
    decode, refuse = decoder.decode, partial(node.refuse, item.topic)
    aloud = partial(node.refuse_aloud, item.topic)
    since = node.heard_until
    lag = item.demand.lag_ticks

    def receive(raw: bytes) -> bool:
        nonlocal since
        if since is not None and len(raw) >= _LEAST_BYTES:
            # Of what is repeated, what the predecessor has heard.
            if (stamp_of(raw) - start_ns) // tick_ns + lag <= since:
                return True
            since = None
        try:
            value = decode(raw).copy()
        except CutOffError as error:
            refuse(str(error))
            return False
        except FrameError as error:
            value = None
            aloud(str(error))
        except MessageError as error:
            value = None
            refuse(str(error))
        tick, rest = divmod(decoder.stamp_ns - start_ns, tick_ns)
        if tick < earliest:
            node.refuse_stamp(topic, tick, node.tick)
        elif rest and not off_tick:
            aloud(off_tick_refusal(topic, decoder.stamp_ns))
        else:
            pace.take(topic, tick, value)
        return True

    return receive


# -------------------------------------------------------------------------------------------------
# A node that goes on in flight where its predecessor, which was killed, has ended.
# -------------------------------------------------------------------------------------------------

# After a start in flight, for so many ticks, messages that nobody answers are sent again.
_AGAIN_S, _AGAIN_TICKS = 0.1, 50
# So many of each topic: who hears it may be dead, too, and some ticks behind. None is then so old
# that it could set a clock.
_LAST = AHEAD_TICKS


class RespawnableNode(ManagedNode[Core, Run]):
    """Leaves after each step what a successor needs, and begins with what it was left.

    Attributes
    ----------
    memory : Memory or None
        None where nobody is started again.
    """

    CATCHES_UP: ClassVar[bool] = False
    """Whether in real time, too, it steps through what it has missed when it is started again."""

    def __init__(self, values: Mapping[str, Any], **options: Any) -> None:
        self.memory = handover_file_of(self.SPEC.name)
        self._handover: HandoverRecord | None = self.memory.load() if self.memory else None
        # Parameters that the predecessor was told in flight.
        before = self._handover.content[0] if self._handover else {}
        super().__init__({**values, **before}, **options)
        self._said_tick: int | None = None
        if self.memory is not None and self.values["lockstep"]:
            self.sent = defaultdict(partial(deque, maxlen=_LAST))

    def save_state(self) -> Any:
        """What a successor would go on from, if this node were killed now; None for nothing."""
        return None

    def restore_state(self, content: Any, gap: bool) -> None:
        """Go on from what a predecessor has remembered; called before the first step.

        Parameters
        ----------
        content : object
            What `save_state` gave.
        gap : bool
            Whether ticks were flown without this node that it will not step through.
        """

    def keep(self, tick: int) -> None:
        """After the step of a tick: write down what a successor would need."""
        if self.memory is not None and (content := self.save_state()) is not None:
            self.memory.keep(tick, (self.changed, dict(self.sent or {}), content))

    @property
    def heard_until(self) -> int | None:
        """Tick up to which a predecessor has stepped, before the first step; None without one."""
        return self._handover.tick if self._handover else None

    def repeated(self) -> Any:
        """QoS by which a node that is started again hears what it has missed; None for others."""
        wanted = self._handover is not None and (self.values["lockstep"] or self.CATCHES_UP)
        return topics.qos(topics.IMU, repeats=True) if wanted else None

    def take_over(self) -> int | None:
        """Go on in a predecessor's place; its last tick, or None if there was none."""
        known, self._handover = self._handover, None
        if known is None:
            return None
        self.tick = known.tick
        self.changed, sent, content = known.content
        self.restore_state(content, not (self.values["lockstep"] or self.CATCHES_UP))
        message = f"started again in flight, after {self.rate.seconds(known.tick):.2f} s of it"
        self.get_logger().warning(message)
        if self.sent is not None:
            # Each waits for the other there, so whoever did not know this node yet hears it again,
            # and another that died with it what only the dead one had sent.
            for topic, raws in sent.items():
                self.sent[topic].extend(raws)
            self.create_wall_timer(_AGAIN_S, partial(self._say_again, known.tick + _AGAIN_TICKS))
        return known.tick

    def _say_again(self, until: int) -> None:
        """Lockstep, soon after a start in flight: send the last messages again if none followed."""
        if self.tick > until or self.sent is None:
            return
        if self.tick == self._said_tick:
            for topic, raws in self.sent.items():
                for raw in raws:
                    self.outputs[topic].handle.publish_raw(raw)
        self._said_tick = self.tick


# -------------------------------------------------------------------------------------------------
# Tick node.
# -------------------------------------------------------------------------------------------------

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


NodeCore = TypeVar("NodeCore", bound=TickCore)


class TickNode(RespawnableNode[NodeCore, Run]):
    """Collects inputs by tick and calls `step` (`stepping` says when)."""

    def __init__(self, values: Mapping[str, Any], **options: Any) -> None:
        super().__init__(values, **options)
        self._owners: dict[str, PublisherLock] = {}
        self._demands: dict[str, Demand] = {}
        # Per topic, why nothing that comes on it is used.
        self._barred: dict[str, str] = {}
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
        owners: dict[str, PublisherLock] = {}
        self._owners, self._alone = owners, {}
        lags = {i.topic: i.demand.lag_ticks for i in inputs}
        self.links = HeardLinks(self.SPEC.name, lags, self.values)
        refused = self.refuse_stamp
        if self.values["lockstep"]:
            leader = topics.BY_NAME[topics.CLOCK].source
            pace = Lockstep(
                {i.topic: i.demand for i in inputs},
                self._make_step,
                self.values["peer_timeout_s"],
                self.is_ready,
                lambda: self.get_logger().warning(self.silence()),
                leads,
                refused=refused,
                of_leader=() if leads else [t for t in lags if topics.BY_NAME[t].source == leader],
            )
            # Who leads flies at the pace of the wall clock where nobody commands.
            self.create_wall_timer(self.rate.tick_s if leads else _WATCH_PERIOD_S, pace.look)
        else:
            trigger, own_tick = (None, lambda: self.tick) if leads else (inputs[0].topic, None)
            pace = RealTime(
                trigger, self._make_step, own_tick, refused=refused, rate=self.rate,
                on_silence=self._tell_silence,
            )  # fmt: skip
            if not leads:
                self.create_wall_timer(_WATCH_PERIOD_S, pace.look)
        # The clock first: who finds the others in the graph knows that it is heard, too.
        for item in sorted(inputs, key=lambda i: i.topic != topics.CLOCK):
            if item.topic == topics.CLOCK:
                self._hear(item, StampDecoder(item.topic), pace)
            else:
                place = datum if item.topic == topics.GPS_FIX else None
                self._hear(item, Decoder(item.topic, place, namespace=self.get_namespace()), pace)
        for row in topics.TABLE:
            if absent := [name for name in row.replaces if name in lags]:
                self._hear(Input(row.name, Demand()), StampDecoder(row.name), Absence(pace, absent))
        self.create_wall_timer(_SENDERS_PERIOD_S, partial(self._look_at_all_senders, owners))
        self._demands = {item.topic: item.demand for item in inputs}
        return pace

    def _hear(self, item: Input, decoder: Decoder | StampDecoder, pace: Taker) -> None:
        """Subscribe to a topic: the messages of its owner become rows by tick."""
        owner = self._owners[item.topic] = self._owner(item.topic)
        receive = receiver(self, item, decoder, pace)

        def hear(raw: bytes) -> bool:
            if item.topic in self._barred:
                self.refuse_aloud(item.topic, f"{item.topic}: {self._barred[item.topic]}")
                return False
            return receive(raw)

        ignored = partial(self._look_at_senders, item.topic, owner)
        self.subscribe(
            item.topic, hear, qos=self.repeated(), raw=True, owner=owner, ignored=ignored
        )

    def judge_peers(self) -> None:
        """Bar the topics whose senders do not agree with this node.

        Who is followed now stays followed: a node tells its terms before it sends, so false terms
        of another one stop nothing. A peer may be heard before its publishers are known.
        """
        broken, barred = self.agreement.broken, dict[str, str]()
        for topic, owner in list(self._owners.items()) if broken else ():
            senders = {name for _, name in senders_of(self, topic)}
            bad = (broken.keys() & senders) | self.agreement.of_kinds(topics.BY_NAME[topic].source)
            if bad and (topic in self._barred or not owner.followed):
                barred[topic] = disagreeing({name: broken[name] for name in bad})
        self._barred = barred

    def _tell_silence(self) -> None:
        """Real time: nobody triggers this node; it says so at once."""
        if self.health.level < Level.ERROR:
            self.report(Level.WARN, self.silence(), state=NodeState.WITHOUT_INPUT)

    def hear_commands(
        self, topic: str, callback: Callable[[Any], None], most_bytes: int = MOST_BYTES
    ) -> None:
        """Hear whoever sends on a topic, so many a second; the rest is refused unread."""
        limit = RateLimit(COMMANDS_PER_S, COMMANDS_AT_ONCE, f"messages on {topic}")
        read = self._reader(topic, callback, most_bytes)

        def receive(raw: bytes) -> None:
            if limit.admits():
                read(raw)
            else:
                self.refuse_aloud(topic, f"{topic}: {limit.sentence}")

        self.subscribe(topic, receive, raw=True)

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
        owner = PublisherLock(lambda: self.count_publishers(name), _SILENT_PILOT_S, 0)
        self._owners[topic] = owner

        def receive(raw: bytes) -> None:
            if topic not in self._alone:
                self._look_who_is_alone(topic)
            read(raw)

        ignored = partial(self._look_at_senders, topic, owner)
        self.subscribe(topic, receive, raw=True, owner=owner, ignored=ignored)

    def _look_who_is_alone(self, topic: str) -> None:
        """Note the name of a topic's only sender: should another one come, it was the first."""
        senders = senders_of(self, topic)
        if len(senders) == 1 and full_name(senders[0]) != NOT_YET_NAMED:
            self._alone[topic] = full_name(senders[0])

    def _owner(self, topic: str) -> PublisherLock:
        """Who decides whose messages of a topic are used."""
        silence_s = self.values["peer_timeout_s"] if self.values["lockstep"] else _SILENT_OWNER_S
        period_ns = topics.BY_NAME[topic].period_ns(self.rate)
        return lock_of(self, topic, silence_s, period_ns)

    def _look_at_all_senders(self, owners: Mapping[str, PublisherLock]) -> None:
        """Once a second: whether a topic has more than one sender, and who they are."""
        self.core.rivals.clear()
        if self.agreement.broken:
            self.agreement.keep(name for _, name in senders_of(self, topics.AGREEMENT))
            self.judge_peers()
        for topic, owner in owners.items():
            self._look_at_senders(topic, owner)

    def _look_at_senders(self, topic: str, owner: PublisherLock) -> None:
        """Name the senders of a topic if they are several; also as soon as one is ignored."""
        core, name = self.core, self.resolve_topic_name(topic)
        new = topic not in core.rivals and self.count_publishers(name) > 1
        # Of a node that was started again its predecessor is in the graph for some seconds.
        if new and (not self.respawns or strangers_of(self, topic)):
            first = "" if owner.successions else self._alone.get(topic, "")
            core.rivals[topic] = several(topic, senders_of(self, topic), first)
        if topic in core.rivals or owner.ignored or owner.successions:
            known = core.rivals.get(topic) or core.senders.get(topic) or TopicSenders(topic)
            core.senders[topic] = replace(
                known, ignored=owner.ignored, successions=owner.successions
            )

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
        encode, publish = encoder.encode, self.create_topic_publisher(topic)
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
        self.core.unusable[topic] += 1

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
        facts = {**self.health.facts, **self._refused_facts()}
        self.report(level, message, facts, self.health.state)

    def _refused_facts(self) -> dict[str, str]:
        facts = {
            f"{FACT_REFUSED}{topic}": refusal_text(refusals.count, refusals.why)
            for topic, refusals in self.core.refusals.items()
        }
        facts |= {f"{FACT_UNUSABLE}{t}": str(n) for t, n in self.core.unusable.items()}
        for senders in self.core.senders.values():
            facts |= senders.facts()
        return facts

    def refusal(self) -> str:
        """Sentence about a message that was refused aloud in the last second; else empty."""
        if not self.configured:
            return ""
        refusals = self.core.refusals.values()
        recent = (r for r in refusals if 0 <= self.tick - r.tick < self.rate.hz)
        newest = max(recent, key=lambda r: r.tick, default=None)
        return f"message refused: {newest.why}" if newest is not None else ""

    def refuse_stamp(self, topic: str, tick: int, clock_tick: int) -> None:
        """Reject, with a warning, a message whose stamp does not fit the clock."""
        stamp_ns, clock_ns = self.stamp_ns(tick), self.stamp_ns(clock_tick)
        self.refuse_aloud(topic, stamp_refusal(topic, stamp_ns, clock_ns, self.start_ns))

    @property
    def now_tick(self) -> int:
        """Tick of now: in real time the step's trigger may be late, and time goes on meanwhile."""
        pace = self.core.pace
        known = pace.now_tick() if isinstance(pace, RealTime) else None
        return self.tick if known is None else max(self.tick, known)

    def stamp_ns(self, tick: int) -> int:
        """Message stamp of a tick."""
        return self.start_ns + tick * self.rate.tick_ns

    def warn_or_ok(
        self,
        level: Level,
        message: str,
        facts: Mapping[str, Any],
        state: NodeState = NodeState.RUNNING,
    ) -> None:
        """Report the core's state, or what peers do wrong if that is worse."""
        silence = self.silence()
        wrong = (
            silence
            or self.refusal()
            or self.links.acting(self.rate.seconds(self.tick))
            or next((rival.sentence for rival in self.core.rivals.values()), "")
        )
        if wrong and level < Level.WARN:
            level, message = Level.WARN, wrong
            state = NodeState.WITHOUT_INPUT if silence else state
        changed = (level, message) != (self.health.level, self.health.message)
        if changed or self.urgent or self.tick % self.rate.hz == 0:
            unused = {f"messages_{k}": n for k, n in asdict(self.core.pace.counters).items() if n}
            facts = {**facts, **unused, **self.links.facts()}
            self.report(level, message, {**facts, **self._refused_facts()}, state)

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
        """Begin to step, with what came while the node was getting ready; or go on in place of
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
