# SPDX-License-Identifier: Apache-2.0
"""Node `actions`: a goal's way into the graph and back, by what pilots have without it.

It only listens, so no flight waits for it: services `takeoff`, `land` and `hold`, topics `goto` and
`reference` are how it commands, `odom`, `reference` and /diagnostics what it sees.
"""

import sys
import time
from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from enum import IntEnum, StrEnum
from functools import partial
from importlib import import_module
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from heli_actions.parameters import NODE_NAME, TABLE
from heli_core.rows import NAV, REFERENCE
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_msgs_bridge import frames, topics
from heli_msgs_bridge.command_messages import decode_goto, decode_reference
from heli_msgs_bridge.diagnostics import FACT_MODE, Level, NodeState, state_of
from heli_msgs_bridge.layouts import MessageError
from heli_msgs_bridge.lifecycle_node import ManagedNode, NodeSpec, NodeStartError
from heli_msgs_bridge.messages import Decoder
from heli_msgs_bridge.node_process import run
from heli_msgs_bridge.topics import MAP

# -------------------------------------------------------------------------------------------------
# The table of a goal: from which stage which event leads where. No ROS.
#
# What has no row changes nothing. A row that names kinds of goals wins over one for all of them.
# -------------------------------------------------------------------------------------------------


class Kind(StrEnum):
    """What a goal asks for; also the word for it."""

    TAKEOFF = "takeoff"
    GOTO = "goto"
    FOLLOW = "follow"
    LAND = "land"


class Stage(StrEnum):
    """Where a goal is that has not ended."""

    WAITING = "waiting"
    """Another goal is being asked for; this one is next."""
    ASKED = "asked"
    """The command is with the outer loop, which has not answered."""
    WITHDRAWN = "withdrawn"
    """Asked, and cancelled before the answer."""
    FLOWN = "flown"
    HOLDING = "holding"
    """Cancelled: `hold` is asked."""
    BREAKING = "breaking off"
    """Cancelled on the ground, where nothing is held: `land` is asked."""
    BOUND = "bound"
    """Cancelled, but neither was done: it is flown to its end."""


class GoalEvent(StrEnum):
    """What happens to a goal; the first three answer what it has asked last."""

    GRANTED = "granted"
    REFUSED = "refused"
    UNANSWERED = "unanswered"
    TURN = "its turn"
    CANCEL = "cancel"
    DONE = "done"
    LEFT = "mode left"
    REPLACED = "way replaced"
    LATE = "end not reached"
    PREEMPTED = "preempted"
    SILENT = "silence"
    CLOSED = "closed"


class GoalStatus(StrEnum):
    """How a goal ends, in ROS's words."""

    SUCCEEDED = "succeeded"
    CANCELED = "canceled"
    ABORTED = "aborted"


class Code(IntEnum):
    """Why a goal has ended: the constants of heli_interfaces/action/*.action."""

    DONE = 0
    CANCELED = 1
    REFUSED = 2
    NO_ANSWER = 3
    PREEMPTED = 4
    REPLACED = 5
    MODE_LEFT = 6
    NOT_REACHED = 7
    SILENT = 8
    CLOSED = 9


HOLD, LAND = "hold", "land"
"""Services of the outer loop that a cancelled goal asks for."""


@dataclass(frozen=True)
class GoalEnd:
    """A goal ends."""

    outcome: GoalStatus
    code: Code


@dataclass(frozen=True)
class GoalTransition:
    """One row.

    Attributes
    ----------
    stages : tuple of Stage
    event : GoalEvent
    target : Stage or GoalEnd
    asks : str
        Service that is called on the way; empty for none.
    kinds : tuple of Kind
    """

    stages: tuple[Stage, ...]
    event: GoalEvent
    target: Stage | GoalEnd
    asks: str = ""
    kinds: tuple[Kind, ...] = tuple(Kind)


_UNDER_WAY = (Stage.FLOWN, Stage.BOUND)
_CANCELLED = (Stage.HOLDING, Stage.BREAKING)
_ABORTED, _CANCELED = GoalStatus.ABORTED, GoalEnd(GoalStatus.CANCELED, Code.CANCELED)

GOAL_TABLE: tuple[GoalTransition, ...] = (
    GoalTransition((Stage.WAITING,), GoalEvent.TURN, Stage.ASKED),
    GoalTransition((Stage.WAITING,), GoalEvent.CANCEL, _CANCELED),
    GoalTransition((Stage.ASKED,), GoalEvent.GRANTED, Stage.FLOWN),
    GoalTransition((Stage.ASKED,), GoalEvent.REFUSED, GoalEnd(_ABORTED, Code.REFUSED)),
    GoalTransition((Stage.ASKED,), GoalEvent.CANCEL, Stage.WITHDRAWN),
    GoalTransition((Stage.WITHDRAWN,), GoalEvent.GRANTED, Stage.HOLDING, HOLD),
    GoalTransition((Stage.WITHDRAWN,), GoalEvent.REFUSED, _CANCELED),
    GoalTransition((Stage.FLOWN,), GoalEvent.CANCEL, Stage.HOLDING, HOLD),
    # A reference is refused later than it is taken for granted.
    GoalTransition((Stage.FLOWN,), GoalEvent.REFUSED, GoalEnd(_ABORTED, Code.REFUSED),
                   kinds=(Kind.FOLLOW,)),
    GoalTransition(_CANCELLED, GoalEvent.GRANTED, _CANCELED),
    GoalTransition((Stage.HOLDING,), GoalEvent.REFUSED, Stage.BREAKING, LAND, (Kind.TAKEOFF,)),
    GoalTransition(_CANCELLED, GoalEvent.REFUSED, Stage.BOUND),
    GoalTransition((Stage.ASKED, Stage.WITHDRAWN, *_CANCELLED), GoalEvent.UNANSWERED,
        GoalEnd(_ABORTED, Code.NO_ANSWER)),
    GoalTransition(_UNDER_WAY, GoalEvent.DONE, GoalEnd(GoalStatus.SUCCEEDED, Code.DONE)),
    GoalTransition(_UNDER_WAY, GoalEvent.LEFT, GoalEnd(_ABORTED, Code.MODE_LEFT)),
    GoalTransition(_UNDER_WAY, GoalEvent.REPLACED, GoalEnd(_ABORTED, Code.REPLACED)),
    GoalTransition(_UNDER_WAY, GoalEvent.LATE, GoalEnd(_ABORTED, Code.NOT_REACHED)),
    GoalTransition(tuple(Stage), GoalEvent.PREEMPTED, GoalEnd(_ABORTED, Code.PREEMPTED)),
    GoalTransition(tuple(Stage), GoalEvent.SILENT, GoalEnd(_ABORTED, Code.SILENT)),
    GoalTransition(tuple(Stage), GoalEvent.CLOSED, GoalEnd(_ABORTED, Code.CLOSED)),
)  # fmt: skip
"""Every step of every goal."""


def row_of(kind: Kind, stage: Stage, event: GoalEvent) -> GoalTransition | None:
    """The row of an event; None where it means nothing."""
    rows = [r for r in GOAL_TABLE if r.event == event and stage in r.stages and kind in r.kinds]
    return min(rows, key=lambda row: len(row.kinds), default=None)


@dataclass(frozen=True)
class Rule:
    """What a kind of goal is, in the words of the outer loop.

    Attributes
    ----------
    service : str
        Service that begins it; empty: a message on `topic` does.
    topic : str
    modes : frozenset of str
        Modes in which it is under way.
    done : str
        Mode that tells its end; empty: its end is a place and a time.
    """

    modes: frozenset[str]
    service: str = ""
    topic: str = ""
    done: str = ""


ALONG_A_WAY = frozenset({"trajectory", "hover"})
STANDING = "standing"
RULES: dict[Kind, Rule] = {
    Kind.TAKEOFF: Rule(frozenset({"takeoff"}), service="takeoff", done="hover"),
    Kind.GOTO: Rule(ALONG_A_WAY, topic="goto"),
    Kind.FOLLOW: Rule(ALONG_A_WAY, topic="reference"),
    Kind.LAND: Rule(frozenset({"land"}), service="land", done=STANDING),
}


# -------------------------------------------------------------------------------------------------
# Action servers whose goals are ended from outside, in one thread.
#
# rclpy would have a goal's callback wait for its end: in a thread of its own, or by polling at
# full
# speed. Here a goal is kept, and its callback runs when there is something to return.
# -------------------------------------------------------------------------------------------------


class DeferredServer(ActionServer):
    """Server of one action.

    Parameters
    ----------
    node : Node
    kind : Kind
    action_type : type
    name : str
    admits : callable
        Whether goals are taken now.
    taken, cancelled : callable
        Called with the kind (not of a cancelled one) and the handle of a goal that is executing,
        or is to be cancelled.
    """

    def __init__(
        self,
        node: Node,
        kind: Kind,
        action_type: Any,
        name: str,
        admits: Callable[[], bool],
        taken: Callable[[Kind, Any], None],
        cancelled: Callable[[Any], None],
    ) -> None:
        self._kind, self._taken = kind, taken

        def admit(goal: Any) -> GoalResponse:
            return GoalResponse.ACCEPT if admits() else GoalResponse.REJECT

        def cancel(handle: Any) -> CancelResponse:
            cancelled(handle)
            return CancelResponse.ACCEPT

        super().__init__(
            node, action_type, name, _nothing, goal_callback=admit, cancel_callback=cancel
        )

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """rclpy's hook: a goal is executing. It is told, not run."""
        if execute_callback is None:
            self._taken(self._kind, goal_handle)
        else:
            super().notify_execute(goal_handle, execute_callback)

    def finish(self, goal_handle: Any, outcome: GoalStatus, result: Any) -> None:
        """End a goal."""
        self.notify_execute(goal_handle, partial(_end, outcome, result))


def _nothing(goal_handle: Any) -> None:
    """rclpy wants a callback; goals are never run by it."""


def _end(outcome: GoalStatus, result: Any, goal_handle: Any) -> Any:
    if goal_handle.is_active:
        {
            GoalStatus.SUCCEEDED: goal_handle.succeed,
            GoalStatus.CANCELED: goal_handle.canceled,
            GoalStatus.ABORTED: goal_handle.abort,
        }[outcome]()
    return result


# -------------------------------------------------------------------------------------------------
# What is seen of a flight by who only listens. No ROS.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]


class Way(NamedTuple):
    """A reference: where it ends (3,), NED, m, and when, ns of stamps."""

    start_ns: int
    end_ns: int
    end_ned_m: Array


@dataclass
class FlightStatus:
    """The newest of everything; times are stamps in ns, flight time.

    Attributes
    ----------
    now_ns : int
        Newest stamp of all.
    odom_ns, told_ns : int
        Stamp of the navigation and of what the outer loop said; 0 before the first.
    pos_ned_m : (3,) array
    quat : (4,) array
        Navigated attitude, FRD to NED.
    mode, said : str
        Mode that is flown, and the outer loop's sentence.
    given : bool
        Whether the way that is followed is a reference of others, not one of the outer loop's.
    refusals : dict
        Per topic how many messages were refused, and why the last one.
    trajectory : Way or None
        The newest reference.
    trajectories : int
        How many have come.
    stood_down_m : float
        Height, down, at which it last stood.
    odom_wall_s, told_wall_s : float
        Wall time at which both were heard.
    """

    now_ns: int = 0
    odom_ns: int = 0
    told_ns: int = 0
    pos_ned_m: Array = field(default_factory=lambda: np.zeros(3))
    quat: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    mode: str = ""
    said: str = ""
    given: bool = False
    refusals: dict[str, tuple[int, str]] = field(default_factory=dict)
    trajectory: Way | None = None
    trajectories: int = 0
    stood_down_m: float = 0.0
    odom_wall_s: float = 0.0
    told_wall_s: float = 0.0

    def begin_anew(self) -> None:
        """Another flight: forget the past one, but not that something was heard just now."""
        fresh = FlightStatus(odom_wall_s=self.odom_wall_s, told_wall_s=self.told_wall_s)
        vars(self).update(vars(fresh))

    def odom(
        self,
        stamp_ns: int,
        pos_ned_m: Array,
        quat: Array,
        wall_s: float,
    ) -> None:
        """Navigation: position (3,), NED, m, and attitude (4,), FRD to NED."""
        self.odom_ns, self.now_ns = stamp_ns, max(self.now_ns, stamp_ns)
        self.odom_wall_s = wall_s
        self.pos_ned_m, self.quat = pos_ned_m.copy(), quat.copy()
        if self.mode == STANDING:
            self.stood_down_m = float(pos_ned_m[2])

    def told(self, stamp_ns: int, said: str, facts: Mapping[str, str], wall_s: float) -> None:
        """What the outer loop says of itself; its facts by name."""
        self.told_ns, self.now_ns = stamp_ns, max(self.now_ns, stamp_ns)
        self.told_wall_s = wall_s
        self.said, self.mode = said, facts.get("mode", self.mode)
        self.given = facts.get("reference", "given" if self.given else "") == "given"
        for name, text in facts.items():
            kind, _, topic = name.partition(".")
            count, _, why = text.partition("; ")
            if kind == "refused" and count.isdecimal():
                self.refusals[topic] = int(count), why

    def hear(self, way: Way) -> None:
        """A reference."""
        self.trajectory, self.trajectories = way, self.trajectories + 1

    def refused(self, topic: str) -> int:
        """How many messages of a topic were refused."""
        return self.refusals.get(topic, (0, ""))[0]


# -------------------------------------------------------------------------------------------------
# Goals from their coming to their end: one is flown, one asked for, one waits. No ROS.
#
# A goal that the outer loop grants takes the place of the one that is flown, which is aborted; one
# that it refuses ends, and what is flown goes on. Of those that wait the newest stays. That is how
# Nav2's servers preempt, but that they cannot refuse.
# -------------------------------------------------------------------------------------------------

_SAME_PLACE_M = 1e-3
_TOLD_EVERY_NS = NS_PER_S + TICK_NS
"""The outer loop says its mode once per simulated second, and at once when its sentence changes."""
NOT_KNOWN = -1.0


@dataclass(frozen=True)
class GoalRequest:
    """What a goal asks for.

    Attributes
    ----------
    kind : Kind
    end_ned_m : (3,) array or None
        Where a goto or a trajectory ends, NED, m.
    end_ns : int or None
        When a trajectory ends, a stamp; a goto's end is told by the outer loop.
    message : object
        What is sent on its topic.
    """

    kind: Kind
    end_ned_m: Array | None = None
    end_ns: int | None = None
    message: Any = None


@dataclass(frozen=True)
class GoalFeedback:
    """Where a goal is.

    Attributes
    ----------
    stamp_ns : int
    mode : str
    pos_ned_m, quat : arrays
        Navigated position (3,), NED, m, and attitude (4,), FRD to NED.
    left_m : float
        Distance to the end; of a take-off and a landing the height. NOT_KNOWN is -1.
    left_s : float
        Flight time until the end of its way.
    """

    stamp_ns: int
    mode: str
    pos_ned_m: Array
    quat: Array
    left_m: float
    left_s: float


@dataclass(frozen=True)
class GoalLimits:
    """The node's parameters: times, s, and a distance, m.

    Times of `answer_s` and `silence_s` are over when both have passed, flight time and wall time:
    a flight in lockstep is faster than answers are, a pause stops the one and not the other.
    """

    answer_s: float
    silence_s: float
    wall_silence_s: float
    patience_s: float
    tolerance_m: float


class Actuator(Protocol):
    """What carries out what the desk decides."""

    def ask(self, key: Hashable, service: str) -> None:
        """Call a service of the outer loop for a goal; `GoalManager.answered` gets the answer."""

    def send(self, topic: str, message: Any) -> None:
        """Publish a goal's message."""

    def finish(self, key: Hashable, outcome: GoalStatus, code: Code, sentence: str) -> None:
        """End a goal."""


@dataclass(eq=False)
class ActiveGoal:
    """A goal that has not ended.

    Attributes
    ----------
    key : hashable
    order : GoalRequest
    stage : Stage
    asked_ns, asked_wall_s : int, float
        When it asked last, stamp and wall time.
    granted_ns : int
        When it was granted; 0 before.
    mode_before : str
        Mode when it was asked for.
    refusals, trajectories : int
        Refused messages of its topic, and references, when it was asked for.
    trajectory : Way or None
        What the outer loop flies for it.
    note : str
        What is to be told at its end besides.
    """

    key: Hashable
    order: GoalRequest
    stage: Stage = Stage.WAITING
    asked_ns: int = 0
    asked_wall_s: float = 0.0
    mode_before: str = ""
    refusals: int = 0
    trajectories: int = 0
    granted_ns: int = 0
    trajectory: Way | None = None
    note: str = ""


class GoalManager:
    """Takes goals and looks after them.

    Parameters
    ----------
    hands : Actuator
    seen : FlightStatus
        Of the flight; whoever hears it writes it, and calls `look` after it.
    limits : GoalLimits
    """

    def __init__(self, hands: Actuator, seen: FlightStatus, limits: GoalLimits) -> None:
        self._hands, self._seen, self.limits = hands, seen, limits
        self._asked: ActiveGoal | None = None
        self._flown: ActiveGoal | None = None
        self._next: ActiveGoal | None = None
        self._wall_s = 0.0

    @property
    def goals(self) -> tuple[ActiveGoal, ...]:
        """Those that have not ended."""
        return tuple(goal for goal in (self._flown, self._asked, self._next) if goal is not None)

    # --- from clients ----------------------------------------------------------------------------

    def take(self, key: Hashable, order: GoalRequest) -> None:
        """A goal has come: ask the outer loop for it, once the one before is answered."""
        if self._next is not None:
            self._preempt(self._next, order.kind)
        self._next = ActiveGoal(key, order)
        self._go_on()

    def cancel(self, key: Hashable) -> None:
        """A client has cancelled a goal."""
        for goal in self.goals:
            if goal.key == key:
                self._happens(goal, GoalEvent.CANCEL, f"{goal.order.kind}: cancelled")

    def close(self) -> None:
        """No goal is looked after any more."""
        for goal in self.goals:
            kind = goal.order.kind
            self._happens(
                goal, GoalEvent.CLOSED, f"{kind}: the node is deactivated; the flight goes on"
            )

    # --- from the flight -------------------------------------------------------------------------

    def answered(self, key: Hashable, done: bool, sentence: str) -> None:
        """A service has answered what was asked for a goal."""
        for goal in self.goals:
            if goal.key == key:
                if goal.stage in (Stage.HOLDING, Stage.BREAKING):
                    goal.note = "" if done else f"; not cancelled: {sentence}"
                self._happens(goal, GoalEvent.GRANTED if done else GoalEvent.REFUSED, sentence)
        self._go_on()

    def hear(self, way: Way) -> None:
        """A reference has come: of those who asked for it, or of others."""
        self._seen.hear(way)
        for goal in self.goals:
            if self._is_its_own(goal, way):
                goal.trajectory = way

    def odom(self, stamp_ns: int, pos_ned_m: Array, quat: Array, wall_s: float) -> None:
        """Navigation has come; as `FlightStatus.odom`, which also sees another flight begin."""
        if stamp_ns < self._seen.odom_ns - NS_PER_S:
            for goal in self.goals:
                self._happens(
                    goal, GoalEvent.SILENT, f"{goal.order.kind}: another flight has begun"
                )
            self._seen.begin_anew()
        self._seen.odom(stamp_ns, pos_ned_m, quat, wall_s)

    def look(self, wall_s: float) -> None:
        """Draw the conclusions from what is seen; call it often."""
        self._wall_s = wall_s
        for goal in self.goals:
            # It may have come before anything was heard of the flight.
            goal.asked_ns = goal.asked_ns or self._seen.now_ns
            self._look_for_silence(goal)
        if self._asked is not None:
            self._look_for_an_answer(self._asked)
        self._go_on()
        if self._flown is not None and self._asked is None:
            # While another is being asked for, what changes may be its doing.
            self._look_at_the_flight(self._flown)

    def feedback(self) -> tuple[Hashable, Kind, GoalFeedback] | None:
        """Of the goal that is flown, if there is one."""
        goal, seen = self._flown, self._seen
        if goal is None:
            return None
        end_ns = goal.order.end_ns if goal.trajectory is None else goal.trajectory.end_ns
        left_s = NOT_KNOWN if end_ns is None else max(0.0, (end_ns - seen.now_ns) / NS_PER_S)
        where = seen.pos_ned_m.copy(), seen.quat.copy()
        told = GoalFeedback(seen.now_ns, seen.mode, *where, self._left_m(goal), left_s)
        return goal.key, goal.order.kind, told

    # --- conclusions -----------------------------------------------------------------------------

    def _left_m(self, goal: ActiveGoal) -> float:
        here, kind = self._seen.pos_ned_m, goal.order.kind
        if kind == Kind.LAND:
            return max(0.0, float(self._seen.stood_down_m - here[2]))
        if kind == Kind.TAKEOFF:
            return (
                NOT_KNOWN
                if goal.trajectory is None
                else max(0.0, float(here[2] - goal.trajectory.end_ned_m[2]))
            )
        assert goal.order.end_ned_m is not None
        return float(np.linalg.norm(here - goal.order.end_ned_m))

    def _is_its_own(self, goal: ActiveGoal, way: Way) -> bool:
        """A take-off's is the highest, its climb; a goto's ends where it is to."""
        if goal.order.kind == Kind.TAKEOFF:
            return goal.trajectory is None or bool(way.end_ned_m[2] < goal.trajectory.end_ned_m[2])
        end = goal.order.end_ned_m
        same = end is not None and float(np.linalg.norm(way.end_ned_m - end)) < _SAME_PLACE_M
        return same and (goal.order.end_ns is None or way.end_ns == goal.order.end_ns)

    def _look_for_silence(self, goal: ActiveGoal) -> None:
        seen, limits, kind = self._seen, self.limits, goal.order.kind
        if self._wall_s - max(seen.odom_wall_s, seen.told_wall_s) > limits.wall_silence_s:
            wall = f"for {limits.wall_silence_s:g} s of wall time"
            self._happens(goal, GoalEvent.SILENT, f"{kind}: nothing of the flight is heard {wall}")
            return
        for name, last_ns, last_wall_s in (
            ("navigation", seen.odom_ns, seen.odom_wall_s),
            ("outer_loop", seen.told_ns, seen.told_wall_s),
        ):
            silent_s = self._passed_s(
                max(last_ns, goal.asked_ns), max(last_wall_s, goal.asked_wall_s)
            )
            if silent_s > limits.silence_s:
                said = f"nothing is heard of {name} for {limits.silence_s:g} s"
                self._happens(goal, GoalEvent.SILENT, f"{kind}: {said}")
                return

    def _passed_s(self, since_ns: int, since_wall_s: float) -> float:
        """Time that has passed by both clocks, s."""
        return min((self._seen.now_ns - since_ns) / NS_PER_S, self._wall_s - since_wall_s)

    def _look_for_an_answer(self, goal: ActiveGoal) -> None:
        seen, rule, kind = self._seen, RULES[goal.order.kind], goal.order.kind
        if rule.topic and seen.refused(rule.topic) > goal.refusals:
            self._happens(goal, GoalEvent.REFUSED, seen.refusals[rule.topic][1])
        elif kind == Kind.GOTO and goal.trajectory is not None:
            self._happens(goal, GoalEvent.GRANTED, "")
        elif kind == Kind.FOLLOW and self._follows(goal):
            self._happens(goal, GoalEvent.GRANTED, "")
        else:
            self._look_at_the_time(goal)

    def _follows(self, goal: ActiveGoal) -> bool:
        """Whether the outer loop follows a trajectory that was given to it."""
        seen = self._seen
        late = seen.told_ns - goal.asked_ns > _TOLD_EVERY_NS
        return late and seen.given and seen.mode == "trajectory"

    def _look_at_the_time(self, goal: ActiveGoal) -> None:
        """An answer that does not come."""
        if self._passed_s(goal.asked_ns, goal.asked_wall_s) > self.limits.answer_s:
            said = f"no answer of the outer loop in {self.limits.answer_s:g} s"
            self._happens(goal, GoalEvent.UNANSWERED, f"{goal.order.kind}: {said}")

    def _look_at_the_flight(self, goal: ActiveGoal) -> None:
        if goal.stage in (Stage.HOLDING, Stage.BREAKING):
            self._look_at_the_time(goal)
            return
        seen, rule, kind = self._seen, RULES[goal.order.kind], goal.order.kind
        if kind == Kind.FOLLOW and seen.refused(rule.topic) > goal.refusals:
            self._happens(goal, GoalEvent.REFUSED, seen.refusals[rule.topic][1])
            return
        # Until it is told anew, the mode is that from before the goal.
        news = seen.told_ns - goal.granted_ns > _TOLD_EVERY_NS or seen.mode != goal.mode_before
        if news and seen.mode == rule.done:
            self._look_at_the_end(goal)
        elif news and seen.mode not in rule.modes:
            said = f"{kind}: left for mode {seen.mode} ({seen.said})"
            self._happens(goal, GoalEvent.LEFT, said)
        elif not rule.done:
            self._look_along_the_way(goal)

    def _look_at_the_end(self, goal: ActiveGoal) -> None:
        """The mode that ends it is there; a climb may have been ended by a hold."""
        kind, left_m = goal.order.kind, self._left_m(goal)
        if kind == Kind.TAKEOFF and left_m > self.limits.tolerance_m:
            said = f"{kind}: hovers, with {left_m:.1f} m left to climb"
            self._happens(goal, GoalEvent.LATE, said)
        else:
            self._happens(goal, GoalEvent.DONE, f"{kind}: done, mode {self._seen.mode}")

    def _look_along_the_way(self, goal: ActiveGoal) -> None:
        seen, limits, kind = self._seen, self.limits, goal.order.kind
        if (
            seen.trajectories > goal.trajectories
            and seen.trajectory is not None
            and not self._is_its_own(goal, seen.trajectory)
        ):
            north, east, down = seen.trajectory.end_ned_m
            to = f"{east:.2f} m east, {north:.2f} m north, {-down:.2f} m high"
            self._happens(goal, GoalEvent.REPLACED, f"{kind}: another way is flown, to {to}")
            return
        end_ns = goal.order.end_ns if goal.trajectory is None else goal.trajectory.end_ns
        left_m = self._left_m(goal)
        if end_ns is None or seen.odom_ns < end_ns:
            return
        if left_m <= limits.tolerance_m:
            self._happens(goal, GoalEvent.DONE, f"{kind}: there, {left_m:.2f} m off")
        elif seen.odom_ns > end_ns + round(limits.patience_s * NS_PER_S):
            said = f"{kind}: {left_m:.2f} m off {limits.patience_s:g} s after the end of its way"
            self._happens(goal, GoalEvent.LATE, f"{said}; allowed: {limits.tolerance_m:g} m")

    # --- the table -------------------------------------------------------------------------------

    def _happens(self, goal: ActiveGoal, event: GoalEvent, sentence: str) -> None:
        """Go on as the table says."""
        row = row_of(goal.order.kind, goal.stage, event)
        if row is None or goal not in self.goals:
            return
        if isinstance(row.target, GoalEnd):
            self._forget(goal)
            said = sentence + goal.note
            self._hands.finish(goal.key, row.target.outcome, row.target.code, said)
            return
        if goal is self._asked and event == GoalEvent.GRANTED:
            self._fly(goal)
        goal.stage = row.target
        if row.asks:
            goal.asked_ns, goal.asked_wall_s = self._seen.now_ns, self._wall_s
            self._hands.ask(goal.key, row.asks)

    def _go_on(self) -> None:
        """Ask for what waits, if nothing is asked for."""
        goal, seen = self._next, self._seen
        if goal is None or self._asked is not None:
            return
        self._asked, self._next = goal, None
        rule = RULES[goal.order.kind]
        goal.asked_ns, goal.asked_wall_s, goal.mode_before = seen.now_ns, self._wall_s, seen.mode
        goal.refusals, goal.trajectories = seen.refused(rule.topic), seen.trajectories
        self._happens(goal, GoalEvent.TURN, "")
        if rule.service:
            self._hands.ask(goal.key, rule.service)
        else:
            self._hands.send(rule.topic, goal.order.message)

    def _fly(self, goal: ActiveGoal) -> None:
        """It is flown from now on, in the place of what was flown."""
        if self._flown is not None:
            self._preempt(self._flown, goal.order.kind)
        self._flown, self._asked = goal, None
        goal.granted_ns = self._seen.now_ns

    def _preempt(self, goal: ActiveGoal, by: Kind) -> None:
        self._happens(goal, GoalEvent.PREEMPTED, f"{goal.order.kind}: {by} took its place")

    def _forget(self, goal: ActiveGoal) -> None:
        self._asked = None if self._asked is goal else self._asked
        self._flown = None if self._flown is goal else self._flown
        self._next = None if self._next is goal else self._next


# -------------------------------------------------------------------------------------------------
# Between the actions' messages and the desk. The types are given, so no ROS is imported here.
# -------------------------------------------------------------------------------------------------

PACKAGE = "heli_interfaces"
NOT_BUILT = (
    f"{PACKAGE} is not built: its types need ROS 2 from apt (colcon build, see the README of "
    "heli_actions); without it command by the services takeoff, land and hold and the topic goto"
)


def interface_types() -> dict[Kind, Any]:
    """The actions of heli_interfaces.

    Raises
    ------
    LookupError
        They are not built; with a sentence.
    """
    try:
        module = import_module(f"{PACKAGE}.action")
        return {kind: getattr(module, kind.capitalize()) for kind in Kind}
    except (ImportError, AttributeError) as error:
        raise LookupError(NOT_BUILT) from error


class Interfaces:
    """Orders out of goals, feedback and results into messages.

    Parameters
    ----------
    types : mapping
        Per kind its action: `ActiveGoal`, `GoalFeedback` and `Result` as heli_interfaces has them.
    """

    def __init__(self, types: Mapping[Kind, Any]) -> None:
        self.types = types

    def order(self, kind: Kind, goal: Any, now_ns: int) -> GoalRequest:
        """What a goal asks for; a stamp of zero stands for now.

        Raises
        ------
        MessageError
            A frame, a number or an orientation that is not allowed.
        """
        if kind == Kind.GOTO:
            _stamp(goal.pose.header, now_ns)
            return GoalRequest(kind, decode_goto(goal.pose).pos_ned_m, message=goal.pose)
        if kind == Kind.FOLLOW:
            if goal.trajectory.header.frame_id != MAP:
                frame = goal.trajectory.header.frame_id
                raise MessageError(f"{kind}: frame '{frame}'; allowed: '{MAP}' (east, north, up)")
            _stamp(goal.trajectory.header, now_ns)
            way = decode_reference(goal.trajectory)
            end_ned_m, end_ns = way.points[-1, REFERENCE.pos], way.start_ns + int(way.times_ns[-1])
            return GoalRequest(kind, end_ned_m, end_ns, goal.trajectory)
        return GoalRequest(kind)

    def feedback(self, kind: Kind, told: GoalFeedback) -> Any:
        """Feedback message of a goal."""
        message = self.types[kind].Feedback()
        message.mode = told.mode
        header, pose = message.pose.header, message.pose.pose
        header.frame_id = MAP
        header.stamp.sec, header.stamp.nanosec = divmod(told.stamp_ns, NS_PER_S)
        enu, q = np.empty(3), np.empty(4)
        frames.ned_to_enu(told.pos_ned_m, enu)
        frames.quat_ned_frd_to_enu_flu(told.quat, q)
        pose.position.x, pose.position.y, pose.position.z = enu.tolist()
        r = pose.orientation
        r.x, r.y, r.z, r.w = q.tolist()
        if kind in (Kind.TAKEOFF, Kind.LAND):
            message.height_left_m = told.left_m
        else:
            message.distance_left_m = told.left_m
        if kind != Kind.LAND:
            message.time_left_s = told.left_s
        return message

    def result(self, kind: Kind, outcome: GoalStatus, code: Code, sentence: str) -> Any:
        """Result message of a goal."""
        message = self.types[kind].Result()
        message.success = outcome == GoalStatus.SUCCEEDED
        message.code, message.message = int(code), sentence
        return message


def _stamp(header: Any, now_ns: int) -> None:
    if not header.stamp.sec and not header.stamp.nanosec:
        header.stamp.sec, header.stamp.nanosec = divmod(now_ns, NS_PER_S)


# -------------------------------------------------------------------------------------------------
# Node.
# -------------------------------------------------------------------------------------------------

PREFIX = "actions"
"""Of the actions' names: a service `takeoff` and a topic `goto` are there already."""
_LOOK_S, _SLOW_PERIOD_S = 0.05, 1.0
_SERVICES = (RULES[Kind.TAKEOFF].service, LAND, HOLD)


@dataclass
class Serving:
    """What the node has while it is configured.

    Attributes
    ----------
    desk : GoalManager
    seen : FlightStatus
    interfaces : Interfaces
    clients : dict
        Per service its client.
    servers : dict
        Per kind of goals its server.
    publishers : dict
        Per topic its publisher, from the first message on: in lockstep the outer loop would wait
        for whoever might send a reference.
    handles : dict
        Goals that have not ended, with their kind.
    unasked : list
        Calls to services that are not there yet.
    odom : Decoder
    newest : bytes
        The newest navigation that was not looked at; empty for none.
    told_s : float
        When feedback was sent last, wall time.
    """

    desk: GoalManager
    seen: FlightStatus
    interfaces: Interfaces
    clients: dict[str, Any]
    servers: dict[Kind, DeferredServer] = field(default_factory=dict)
    publishers: dict[str, Any] = field(default_factory=dict)
    handles: dict[Hashable, tuple[Kind, Any]] = field(default_factory=dict)
    unasked: list[tuple[Hashable, str]] = field(default_factory=list)
    odom: Decoder = field(default_factory=lambda: Decoder(topics.ODOM))
    newest: bytes = b""
    told_s: float = 0.0


class ActionsNode(ManagedNode[Serving, None]):
    """Active means: goals are taken. What is flown goes on when it is deactivated."""

    SPEC = NodeSpec(NODE_NAME, "heli_actions", TABLE, f"{NODE_NAME}.yaml")

    def __init__(self, values: Mapping[str, Any], **options: Any) -> None:
        # Before there is anything in the graph: without types there is no such node.
        self._interfaces = self.interfaces()
        super().__init__(values, **options)

    def interfaces(self) -> Interfaces:
        """The types that are served; `NodeStartError` if they are not there."""
        try:
            return Interfaces(interface_types())
        except LookupError as error:
            raise NodeStartError(str(error)) from error

    def configure(self) -> Serving:
        """Begin to listen; serve the actions."""
        interfaces, seen, wall_s = self._interfaces, FlightStatus(), time.monotonic()
        seen.odom_wall_s = seen.told_wall_s = wall_s
        clients = {name: self.create_client(Trigger, name) for name in _SERVICES}
        for client in clients.values():
            self.at_end(partial(self.destroy_client, client))
        core = Serving(
            GoalManager(self, seen, self._limits(self.values)), seen, interfaces, clients
        )
        self.at_end(partial(self._close_publishers, core))
        self._publisher(core, topics.GOTO)
        best_effort = QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.BEST_EFFORT
        )
        self.subscribe(topics.ODOM, self._on_odom, best_effort, raw=True)
        self.subscribe(topics.DIAGNOSTICS, self._on_diagnostics)
        self.subscribe(topics.REFERENCE, self._on_reference)
        for kind, action_type in interfaces.types.items():
            core.servers[kind] = DeferredServer(
                self, kind, action_type, f"{PREFIX}/{kind}", lambda: self.active,
                self.guarded(self._on_goal), self.guarded(self._on_cancel),
            )  # fmt: skip
            self.at_end(core.servers[kind].destroy)
        self.create_wall_timer(_LOOK_S, self._look)
        self.create_wall_timer(_SLOW_PERIOD_S, self._say_how_it_is)
        return core

    def disengage(self) -> None:
        """Let go of the goals; the flight goes on."""
        self.core.desk.close()

    def _limits(self, values: Mapping[str, Any]) -> GoalLimits:
        return GoalLimits(**{row.name: values[row.name] for row in fields(GoalLimits)})

    def _publisher(self, core: Serving, topic: str) -> Any:
        if topic not in core.publishers:
            cls = topics.message_class(topics.BY_NAME[topic].type)
            core.publishers[topic] = self.create_publisher(cls, topic, topics.qos(topic))
        return core.publishers[topic]

    def _close_publishers(self, core: Serving) -> None:
        for publisher in core.publishers.values():
            self.destroy_publisher(publisher)

    # --- what the desk has done ------------------------------------------------------------------

    def ask(self, key: Hashable, service: str) -> None:
        """Call a service for a goal, as soon as it is there."""
        client = self.core.clients[service]
        if not client.service_is_ready():
            self.core.unasked.append((key, service))
            return
        answered = self.guarded(partial(self._on_answer, key))
        client.call_async(Trigger.Request()).add_done_callback(answered)

    def send(self, topic: str, message: Any) -> None:
        """Publish a goal's message."""
        self._publisher(self.core, topic).publish(message)

    def finish(self, key: Hashable, outcome: GoalStatus, code: Code, sentence: str) -> None:
        """End a goal, aloud."""
        core = self.core
        kind, handle = core.handles.pop(key)
        result = core.interfaces.result(kind, outcome, code, sentence)
        core.servers[kind].finish(handle, outcome, result)
        said = f"{kind} {outcome} ({code.name}): {sentence}"
        # rclpy ties a severity to the calling line: two lines are needed.
        if outcome == GoalStatus.ABORTED:
            self.get_logger().warning(said)
        else:
            self.get_logger().info(said)

    # --- from clients ----------------------------------------------------------------------------

    def _on_goal(self, kind: Kind, handle: Any) -> None:
        core, key = self.core, bytes(handle.goal_id.uuid)
        core.handles[key] = kind, handle
        self._take_newest()
        try:
            order = core.interfaces.order(kind, handle.request, core.seen.now_ns)
        except MessageError as error:
            self.finish(key, GoalStatus.ABORTED, Code.REFUSED, str(error))
            return
        core.desk.take(key, order)

    def _on_cancel(self, handle: Any) -> None:
        self.core.desk.cancel(bytes(handle.goal_id.uuid))

    # --- from the flight -------------------------------------------------------------------------

    def _on_answer(self, key: Hashable, future: Any) -> None:
        answer = future.result()
        self._take_newest()  # it is granted at the time that is flown now
        if answer is not None:
            self.core.desk.answered(key, answer.success, answer.message)

    def _on_odom(self, raw: bytes) -> None:
        self.core.newest = raw

    def _on_diagnostics(self, message: Any) -> None:
        core, own = self.core, self.get_namespace().strip("/")
        for status in message.status:
            facts = {pair.key: pair.value for pair in status.values}
            if status.name.rpartition("/")[0].strip("/") != own or FACT_MODE not in facts:
                continue
            if state_of(facts, status.message) == NodeState.INACTIVE:
                facts[FACT_MODE] = NodeState.INACTIVE.value
            stamp = message.header.stamp
            stamp_ns = stamp.sec * NS_PER_S + stamp.nanosec
            core.seen.told(stamp_ns, status.message, facts, time.monotonic())

    def _on_reference(self, message: Any) -> None:
        try:
            way = decode_reference(message)
        except MessageError:
            return  # the outer loop refuses it aloud
        end_ns = way.start_ns + int(way.times_ns[-1])
        self.core.desk.hear(Way(way.start_ns, end_ns, way.points[-1, REFERENCE.pos].copy()))

    def _take_newest(self) -> None:
        core, raw = self.core, self.core.newest
        core.newest = b""
        if not raw:
            return
        try:
            nav = core.odom.decode(raw)
        except MessageError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=5.0)
            return
        if np.isfinite(nav[NAV.pos]).all() and np.isfinite(nav[NAV.quat]).all():
            now = core.odom.stamp_ns, nav[NAV.pos], nav[NAV.quat], time.monotonic()
            core.desk.odom(*now)

    # --- twenty times a second -------------------------------------------------------------------

    def _look(self) -> None:
        core, wall_s = self.core, time.monotonic()
        self._take_newest()
        core.desk.look(wall_s)
        waiting, core.unasked = core.unasked, []
        for key, service in waiting:
            if key in core.handles:
                self.ask(key, service)
        if wall_s - core.told_s >= self.values["feedback_period_s"]:
            core.told_s = wall_s
            self._send_feedback()

    def _send_feedback(self) -> None:
        told = self.core.desk.feedback()
        if told is not None:
            key, kind, feedback = told
            handle = self.core.handles[key][1]
            handle.publish_feedback(self.core.interfaces.feedback(kind, feedback))

    def _say_how_it_is(self) -> None:
        """Once a second."""
        core = self.core
        self.tick = max(0, core.seen.now_ns - self.start_ns) // self.rate.tick_ns
        goals = {goal.order.kind.value: goal.stage.value for goal in core.desk.goals}
        if self.active:
            self.report(Level.OK, "takes goals", goals)

    def validate(self, values: Mapping[str, Any], changed: Collection[str]) -> GoalLimits:
        """Other limits."""
        return self._limits(values)

    def apply(self, judged: GoalLimits, changed: Collection[str]) -> None:
        """They hold for the goals that are under way, too."""
        if self.configured:
            self.core.desk.limits = judged


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_actions actions`."""
    return run(ActionsNode, args)


if __name__ == "__main__":
    sys.exit(main())
