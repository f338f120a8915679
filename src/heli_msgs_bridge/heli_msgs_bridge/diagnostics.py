# SPDX-License-Identifier: Apache-2.0
"""A node's health as `/diagnostics`: at 1 Hz of its time, and at once when it changes. No ROS.

The node's time is that of its last tick: it runs with the flight, faster or slower than the wall
clock. Where it stands still (before a flight, in a pause, behind a silent peer) the status is
repeated once per second of wall time, so that whoever watches never takes the node for dead.
"""

import contextlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from enum import IntEnum, StrEnum
from typing import Any, NamedTuple

from heli_core.foreign_files import load_json
from heli_core.ticks import NS_PER_S, TICKS_PER_S

FACT_OFFSET = "reference_offset_ned_m"
"""What the outer loop calls the offset (3,) from the reference as given to that which it follows;
an empty list until it has engaged."""
FACT_MODE = "mode"
"""What the outer loop calls the mode that it flies; what it says changes with it."""
FACT_FAILSAFE = "failsafe"
"""What the outer loop calls what it does by itself, a name of `heli_outer_pd.failsafes.Action`;
what it says changes with it."""
FACT_ARMED, FACT_LANDED = "armed", "landed"
"""What the outer loop calls whether a take-off is obeyed, and whether it stands on the ground."""
FACT_HOME = "home_ned_m"
"""What the outer loop calls the place (3,) where its flight began; an empty list until it is
known."""
FACT_CLIMB = "takeoff_height_m"
"""What the outer loop calls the height of the newest take-off that had one of its own, m."""
FACT_WAYS = "reference_since_ns"
"""What the outer loop calls its newest references, each as the flight's time from which it counts,
ns, and its `heli_msgs_bridge.command_messages.key_of`."""
FACT_GOALS = "goals"
"""What the outer loop calls its answers to the newest goals: `GoalAnswer`s in JSON."""
FACT_LAW_FAILED = "own_law_failed"
"""Key of the sentence with which a controller in Python has failed; it is not asked again."""
FACT_STATE = "state"
"""What every node calls its `NodeState`."""
FACT_REFUSED = "refused."
"""What every node calls the messages of a topic, whose name follows, that it has refused: how many,
and why the last one (`refusal_text`)."""
FACT_UNUSABLE = "unusable."
"""What every node calls the number of messages of a topic, whose name follows, that hold no value
that can be used. Who has nothing to say says so by NaN, so they are no fault by themselves."""
FACT_MISSING = "missing_peers"
"""What every node calls the peers that do not listen to it yet: those that it waits for, or without
which it has begun."""
FACT_DISAGREE = "disagreeing_peers"
"""What every node calls the peers that it does not fly with, and what they have otherwise."""
FACT_FLOOD = "refused.requests"
"""What every node calls the number of service calls that came too often, with the reason."""
FACT_GPS_LATENCY = "gps_latency_ns"
"""What the plant calls the time from a fix's stamp to its sending, ns."""
REPEAT_S = 1.0
"""Wall time after which a status is repeated though no tick has passed."""


_MOST_LATENCY_NS = 10 * NS_PER_S
# What a value of a stranger's may lead to; a whole number may be infinite.
_UNREADABLE = (ValueError, TypeError, KeyError, OverflowError)


def offset_of(facts: Mapping[str, str]) -> tuple[float, float, float] | None:
    """The offset that the outer loop tells, NED, m; None if it tells none."""
    with contextlib.suppress(*_UNREADABLE):
        north, east, down = load_json(facts[FACT_OFFSET])
        return float(north), float(east), float(down)
    return None


def climb_of(facts: Mapping[str, str]) -> float | None:
    """The own height of a take-off that the outer loop tells, m; None if it tells none."""
    with contextlib.suppress(*_UNREADABLE):
        return float(facts[FACT_CLIMB])
    return None


def ways_of(facts: Mapping[str, str]) -> list[tuple[int, int]]:
    """From when on references count, ns, and their keys, as the outer loop tells; none if not."""
    with contextlib.suppress(*_UNREADABLE):
        return [(int(since_ns), int(key)) for since_ns, key in load_json(facts[FACT_WAYS])]
    return []


def gps_latency_of(facts: Mapping[str, str]) -> int | None:
    """From a fix's stamp to its sending, ns, as the plant tells; None if it tells none."""
    with contextlib.suppress(*_UNREADABLE):
        latency_ns = int(facts[FACT_GPS_LATENCY])
        return latency_ns if 0 <= latency_ns <= _MOST_LATENCY_NS else None
    return None


def hardware_of(namespace: str) -> str:
    """The aircraft that flies in a namespace: its name is that of the namespace."""
    return namespace.strip("/") or "helicopter"


NO_MESSAGE = "no message on "
"""How a node begins to say that it hears nothing on a topic."""


class NodeState(StrEnum):
    """Where a node is in its life, and in the flight."""

    UNCONFIGURED = "unconfigured"
    CONFIGURED = "configured"
    WAITING = "waiting"
    """For its peers, or for what it needs before it can begin its work."""
    ACTIVE = "active"
    """Activated; it has not made a step."""
    RUNNING = "running"
    """At its work; how, its sentence tells."""
    WITHOUT_INPUT = "without_input"
    """At its work, but nothing comes on a topic that it needs."""
    FINISHED = "finished"
    """Its work is done: the flight is over, or shown to the end."""
    INACTIVE = "inactive"
    """Deactivated."""
    FAILED = "failed"
    """A transition, or its work, has failed."""


_SENTENCES = {
    "unconfigured": NodeState.UNCONFIGURED,
    "configured": NodeState.CONFIGURED,
    "active": NodeState.ACTIVE,
    "inactive": NodeState.INACTIVE,
    "the flight is over": NodeState.FINISHED,
}
_BEGINNINGS = {"waiting for ": NodeState.WAITING, NO_MESSAGE: NodeState.WITHOUT_INPUT}


def state_of(facts: Mapping[str, str], message: str) -> NodeState:
    """The state that a status tells; of bags from before the key `state`, by its sentence."""
    with contextlib.suppress(ValueError, KeyError):
        return NodeState(facts[FACT_STATE])
    begun = (state for words, state in _BEGINNINGS.items() if message.startswith(words))
    return _SENTENCES.get(message) or next(begun, NodeState.RUNNING)


def refusal_text(count: int, why: str) -> str:
    """How many messages were refused, and why the last one, as a value of `FACT_REFUSED`."""
    return f"{count}; {why}"


def refusal_of(text: str) -> tuple[int, str]:
    """Count and reason out of `refusal_text`; a count of 0 for what is none."""
    count, _, why = text.partition("; ")
    return int(count) if count.isdecimal() else 0, why


class GoalState(StrEnum):
    """What has become of a goal that was sent to the outer loop."""

    REFUSED = "refused"
    """Not done; the flight goes on as before."""
    ACTIVE = "active"
    """Under way; a goto and a trajectory also while their end is held."""
    SUCCEEDED = "succeeded"
    """What it asked for is done: a take-off hovers, a landing stands."""
    PREEMPTED = "preempted"
    """Another goal took its place."""
    REPLACED = "replaced"
    """Another way is followed, which is none of a goal."""
    LEFT = "left"
    """Its mode was left."""


@dataclass
class GoalAnswer:
    """What the outer loop says of a goal.

    Attributes
    ----------
    goal_id : str
    command : str
        A name of `heli_outer_pd.modes.Command`.
    state : GoalState
    sentence : str
        What follows from it, or why it is refused.
    end_ned_m : list of float or None
        Where what is flown for it, or in its place, ends (3,), NED, m; None where that is not
        known yet.
    end_ns : int or None
        When, a stamp.
    cause : str
        Why it is refused, for programs: the name of a `heli_outer_pd.modes.RefusalCause` or
        `Guard`, of a `heli_core.errors.PathCause` or a `heli_msgs_bridge.layouts.MessageCause`;
        empty where it is not refused.
    """

    goal_id: str
    command: str
    state: GoalState
    sentence: str
    end_ned_m: list[float] | None = None
    end_ns: int | None = None
    cause: str = ""


def goals_text(answers: Iterable[GoalAnswer]) -> str:
    """Answers as a value of `FACT_GOALS`."""
    return json.dumps([asdict(answer) for answer in answers])


def goals_of(facts: Mapping[str, str]) -> list[GoalAnswer]:
    """The answers that the outer loop tells; none if not."""
    with contextlib.suppress(*_UNREADABLE):
        answers = [GoalAnswer(**fields) for fields in load_json(facts[FACT_GOALS])]
        for answer in answers:
            answer.state = GoalState(answer.state)
        return answers
    return []


class OuterLoopTold(NamedTuple):
    """What the outer loop says of itself: stamp, ns; one sentence; its facts by name."""

    stamp_ns: int
    sentence: str
    facts: dict[str, str]


def outer_loop_of(message: Any, namespace: str) -> Iterator[OuterLoopTold]:
    """What a DiagnosticArray says of the outer loop of the aircraft in a namespace.

    An outer loop that is not active flies the mode `inactive`.
    """
    stamp_ns = message.header.stamp.sec * NS_PER_S + message.header.stamp.nanosec
    for status in message.status:
        facts = {pair.key: pair.value for pair in status.values}
        outer_loop = FACT_MODE in facts or FACT_GOALS in facts
        if status.name.rpartition("/")[0].strip("/") != namespace.strip("/") or not outer_loop:
            continue
        if state_of(facts, status.message) == NodeState.INACTIVE:
            facts[FACT_MODE] = NodeState.INACTIVE.value
        yield OuterLoopTold(stamp_ns, status.message, facts)


class Level(IntEnum):
    """Levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


def status_array(
    stamp_ns: int, name: str, hardware: str, message: str, values: Mapping[str, str]
) -> Any:
    """A DiagnosticArray with one status, OK, of a node's full name and its aircraft."""
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

    array = DiagnosticArray()
    array.header.stamp.sec, array.header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
    pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
    status = DiagnosticStatus(name=name, hardware_id=hardware, message=message, values=pairs)
    array.status = [status]
    return array


class Reporter:
    """Publishes one status of a node.

    Parameters
    ----------
    publisher : rclpy publisher of diagnostic_msgs/DiagnosticArray
    name : str
        Status name, the node's full name.
    hardware : str
        The aircraft that it belongs to.
    per_s : int
        The node's ticks of a second.
    """

    def __init__(self, publisher: Any, name: str, hardware: str, per_s: int = TICKS_PER_S) -> None:
        from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

        self._publisher, self._key_value, self._per_s = publisher, KeyValue, per_s
        self._array, self._status = DiagnosticArray(), DiagnosticStatus()
        self._status.name, self._status.hardware_id = name, hardware
        self._array.status = [self._status]
        self._published: tuple[Level, str, NodeState] | None = None
        self._due_tick = 0
        self._silent = True

    def is_due(self, tick: int, level: Level, message: str, state: NodeState) -> bool:
        """True if the status changed or a simulated second has passed."""
        # A due tick of another second than the next: time was set back.
        due = not self._due_tick - self._per_s <= tick < self._due_tick
        return due or (level, message, state) != self._published

    def was_silent(self) -> bool:
        """True if nothing new has been sent since the last call."""
        silent, self._silent = self._silent, True
        return silent

    def publish(
        self,
        stamp_ns: int,
        tick: int,
        level: Level,
        message: str,
        values: Mapping[str, Any],
        state: NodeState = NodeState.RUNNING,
        repeated: bool = False,
    ) -> None:
        """Send a status, stamped in simulation time; `repeated` if no tick asks for it."""
        self._silent = repeated
        self._published = (level, message, state)
        self._due_tick = (tick // self._per_s + 1) * self._per_s
        stamp = self._array.header.stamp
        stamp.sec, stamp.nanosec = divmod(stamp_ns, NS_PER_S)
        self._status.level = bytes([int(level)])
        self._status.message = message
        self._status.values = [
            self._key_value(key=key, value=str(value))
            for key, value in {FACT_STATE: state, **values}.items()
        ]
        self._publisher.publish(self._array)
