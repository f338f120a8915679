# SPDX-License-Identifier: Apache-2.0
"""Goals from their coming to their end, and what is seen of the flight. No ROS."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from heli_core.ticks import NS_PER_S
from heli_msgs_bridge.diagnostics import (
    FACT_MODE,
    GoalAnswer,
    GoalState,
    NodeState,
    goals_of,
    offset_of,
)

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
"""Commands that a cancelled goal asks for."""


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
        Command that is sent on the way; empty for none.
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


# -------------------------------------------------------------------------------------------------
# What is seen of a flight by who only listens. No ROS.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]


@dataclass
class FlightStatus:
    """The newest of everything; times are stamps in ns, flight time.

    Attributes
    ----------
    now_ns : int
        Newest stamp of all.
    odom_ns, outer_loop_ns : int
        Stamp of the navigation and of what the outer loop said; 0 before the first.
    pos_ned_m : (3,) array
    quat : (4,) array
        Navigated attitude, FRD to NED.
    mode, sentence : str
        Mode that is flown, and the outer loop's sentence.
    facts : mapping
        The outer loop's facts by name.
    answers : dict of GoalAnswer
        By id, what the outer loop says of goals.
    stood_down_m : float
        Height, down, at which it last stood.
    odom_wall_s, outer_loop_wall_s : float
        Wall time at which both were heard.
    """

    now_ns: int = 0
    odom_ns: int = 0
    outer_loop_ns: int = 0
    pos_ned_m: Array = field(default_factory=lambda: np.zeros(3))
    quat: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    mode: str = ""
    sentence: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)
    answers: dict[str, GoalAnswer] = field(default_factory=dict)
    stood_down_m: float = 0.0
    odom_wall_s: float = 0.0
    outer_loop_wall_s: float = 0.0

    @property
    def ready(self) -> bool:
        """Whether the outer loop has begun to hold a position, so that it can be commanded."""
        return offset_of(self.facts) is not None

    def begin_anew(self) -> None:
        """Another flight: forget the past one, but not that something was heard just now."""
        fresh = FlightStatus(odom_wall_s=self.odom_wall_s, outer_loop_wall_s=self.outer_loop_wall_s)
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

    def diagnostics(
        self, stamp_ns: int, sentence: str, facts: Mapping[str, str], wall_s: float
    ) -> None:
        """What the outer loop says of itself; its facts by name."""
        self.outer_loop_ns, self.now_ns = stamp_ns, max(self.now_ns, stamp_ns)
        self.outer_loop_wall_s, self.facts = wall_s, facts
        self.sentence, self.mode = sentence, facts.get(FACT_MODE, self.mode)
        self.answers = {answer.goal_id: answer for answer in goals_of(facts)}


# -------------------------------------------------------------------------------------------------
# Goals from their coming to their end: one is flown, one asked for, one waits. No ROS.
#
# A goal that the outer loop grants takes the place of the one that is flown, which is aborted; one
# that it refuses ends, and what is flown goes on. Of those that wait the newest stays. That is how
# Nav2's servers preempt, but that they cannot refuse.
# -------------------------------------------------------------------------------------------------

STANDING = "standing"
"""Mode in which heights are counted from where it is."""
_AGAIN_S = 0.5
"""Wall time after which a command is sent again that is not answered; its id makes it one."""
_ASKING = (Stage.ASKED, Stage.WITHDRAWN, Stage.HOLDING, Stage.BREAKING)
"""Stages in which an answer is waited for."""
NOT_KNOWN = -1.0


@dataclass(frozen=True)
class GoalRequest:
    """What a goal asks for.

    Attributes
    ----------
    kind : Kind
    end_ned_m : (3,) array or None
        Where a goto or a trajectory ends, NED, m.
    message : object
        Its pose, its trajectory.
    """

    kind: Kind
    end_ned_m: Array | None = None
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
    """What carries out what the manager decides."""

    def send(self, command: str, goal_id: str, argument: Any) -> None:
        """Send a command with an id to the outer loop."""

    def finish(self, key: str, outcome: GoalStatus, code: Code, sentence: str) -> None:
        """End a goal."""


@dataclass(eq=False)
class ActiveGoal:
    """A goal that has not ended.

    Attributes
    ----------
    key : str
        Its id.
    order : GoalRequest
    stage : Stage
    asked : str
        The command that it has sent last; empty before the first.
    asked_ns, asked_wall_s, sent_wall_s : int, float, float
        When, stamp and wall time, and when it was sent again.
    note : str
        What is to be told at its end besides.
    """

    key: str
    order: GoalRequest
    stage: Stage = Stage.WAITING
    asked: str = ""
    asked_ns: int = 0
    asked_wall_s: float = 0.0
    sent_wall_s: float = 0.0
    note: str = ""

    @property
    def asked_id(self) -> str:
        """The id of that command: the goal's own, or one for what its cancelling asks."""
        return self.key if self.asked == self.order.kind else f"{self.key}/{self.asked}"


class GoalManager:
    """Takes goals and looks after them.

    Parameters
    ----------
    hands : Actuator
    flight : FlightStatus
        Of the flight; whoever hears it writes it, and calls `look` after it.
    limits : GoalLimits
    """

    def __init__(self, hands: Actuator, flight: FlightStatus, limits: GoalLimits) -> None:
        self._hands, self._flight, self.limits = hands, flight, limits
        self._asked: ActiveGoal | None = None
        self._flown: ActiveGoal | None = None
        self._next: ActiveGoal | None = None
        self._wall_s = 0.0

    @property
    def goals(self) -> tuple[ActiveGoal, ...]:
        """Those that have not ended."""
        return tuple(goal for goal in (self._flown, self._asked, self._next) if goal is not None)

    # --- from clients ----------------------------------------------------------------------------

    def accept(self, key: str, order: GoalRequest) -> None:
        """A goal has come: ask the outer loop for it, once the one before is answered."""
        if self._next is not None:
            self._preempt(self._next, order.kind)
        self._next = ActiveGoal(key, order)
        self._go_on()

    def cancel(self, key: str) -> None:
        """A client has cancelled a goal."""
        for goal in self.goals:
            if goal.key == key:
                self._on_event(goal, GoalEvent.CANCEL, f"{goal.order.kind}: cancelled")

    def close(self) -> None:
        """No goal is looked after any more."""
        for goal in self.goals:
            kind = goal.order.kind
            self._on_event(
                goal, GoalEvent.CLOSED, f"{kind}: the node is deactivated; the flight goes on"
            )

    # --- from the flight -------------------------------------------------------------------------

    def odom(self, stamp_ns: int, pos_ned_m: Array, quat: Array, wall_s: float) -> None:
        """Navigation has come; as `FlightStatus.odom`, which also sees another flight begin."""
        if stamp_ns < self._flight.odom_ns - NS_PER_S:
            for goal in self.goals:
                self._on_event(
                    goal, GoalEvent.SILENT, f"{goal.order.kind}: another flight has begun"
                )
            self._flight.begin_anew()
        self._flight.odom(stamp_ns, pos_ned_m, quat, wall_s)

    def update(self, wall_s: float) -> None:
        """Draw the conclusions from what is seen; call it often."""
        self._wall_s = wall_s
        for goal in self.goals:
            # It may have come before anything was heard of the flight.
            goal.asked_ns = goal.asked_ns or self._flight.now_ns
            self._look_for_silence(goal)
        for goal in self.goals:
            if goal.stage in _ASKING:
                self._look_for_an_answer(goal)
        self._go_on()
        if self._flown is not None and self._asked is None:
            # While another is being asked for, what changes may be its doing.
            self._look_at_the_flight(self._flown)

    def feedback(self) -> tuple[str, Kind, GoalFeedback] | None:
        """Of the goal that is flown, if there is one."""
        goal, flight = self._flown, self._flight
        if goal is None:
            return None
        answer = flight.answers.get(goal.key)
        end_ns = None if answer is None else answer.end_ns
        left_s = NOT_KNOWN if end_ns is None else max(0.0, (end_ns - flight.now_ns) / NS_PER_S)
        where = flight.pos_ned_m.copy(), flight.quat.copy()
        feedback = GoalFeedback(flight.now_ns, flight.mode, *where, self._left_m(goal), left_s)
        return goal.key, goal.order.kind, feedback

    # --- conclusions -----------------------------------------------------------------------------

    def _left_m(self, goal: ActiveGoal) -> float:
        here, kind = self._flight.pos_ned_m, goal.order.kind
        if kind == Kind.LAND:
            return max(0.0, float(self._flight.stood_down_m - here[2]))
        if kind == Kind.TAKEOFF:
            answer = self._flight.answers.get(goal.key)
            if answer is None or answer.end_ned_m is None:
                return NOT_KNOWN
            return max(0.0, float(here[2] - answer.end_ned_m[2]))
        assert goal.order.end_ned_m is not None
        return float(np.linalg.norm(here - goal.order.end_ned_m))

    def _look_for_silence(self, goal: ActiveGoal) -> None:
        flight, limits, kind = self._flight, self.limits, goal.order.kind
        if self._wall_s - max(flight.odom_wall_s, flight.outer_loop_wall_s) > limits.wall_silence_s:
            wall = f"for {limits.wall_silence_s:g} s of wall time"
            self._on_event(goal, GoalEvent.SILENT, f"{kind}: nothing of the flight is heard {wall}")
            return
        for name, last_ns, last_wall_s in (
            ("navigation", flight.odom_ns, flight.odom_wall_s),
            ("outer_loop", flight.outer_loop_ns, flight.outer_loop_wall_s),
        ):
            silent_s = self._passed_s(
                max(last_ns, goal.asked_ns), max(last_wall_s, goal.asked_wall_s)
            )
            if silent_s > limits.silence_s:
                silence = f"nothing is heard of {name} for {limits.silence_s:g} s"
                self._on_event(goal, GoalEvent.SILENT, f"{kind}: {silence}")
                return

    def _passed_s(self, since_ns: int, since_wall_s: float) -> float:
        """Time that has passed by both clocks, s."""
        return min((self._flight.now_ns - since_ns) / NS_PER_S, self._wall_s - since_wall_s)

    def _look_for_an_answer(self, goal: ActiveGoal) -> None:
        answer, kind = self._flight.answers.get(goal.asked_id), goal.order.kind
        if answer is not None:
            done = answer.state != GoalState.REFUSED
            if goal.stage in _CANCELLED:
                goal.note = "" if done else f"; not cancelled: {answer.sentence}"
            self._on_event(goal, GoalEvent.GRANTED if done else GoalEvent.REFUSED, answer.sentence)
        elif self._passed_s(goal.asked_ns, goal.asked_wall_s) > self.limits.answer_s:
            silence = f"no answer of the outer loop in {self.limits.answer_s:g} s"
            self._on_event(goal, GoalEvent.UNANSWERED, f"{kind}: {silence}")
        elif self._wall_s - goal.sent_wall_s > _AGAIN_S:
            self._send(goal)

    def _look_at_the_flight(self, goal: ActiveGoal) -> None:
        flight, kind, answer = self._flight, goal.order.kind, self._flight.answers.get(goal.key)
        if answer is None or goal.stage in _CANCELLED:
            return
        if answer.state == GoalState.LEFT or flight.mode == NodeState.INACTIVE:
            sentence = f"{kind}: left for mode {flight.mode} ({flight.sentence})"
            self._on_event(goal, GoalEvent.LEFT, sentence)
        elif answer.state == GoalState.SUCCEEDED:
            self._look_at_the_end(goal)
        elif answer.state == GoalState.PREEMPTED:
            self._on_event(goal, GoalEvent.PREEMPTED, f"{kind}: another goal took its place")
        elif answer.state == GoalState.REPLACED:
            north, east, down = answer.end_ned_m or (np.nan,) * 3
            to = f"{east:.2f} m east, {north:.2f} m north, {-down:.2f} m high"
            self._on_event(goal, GoalEvent.REPLACED, f"{kind}: another way is flown, to {to}")
        elif kind in (Kind.GOTO, Kind.FOLLOW):
            self._look_along_the_way(goal, answer.end_ns)

    def _look_at_the_end(self, goal: ActiveGoal) -> None:
        """The mode that ends it is there; a climb may have been ended by a hold."""
        kind, left_m = goal.order.kind, self._left_m(goal)
        if kind == Kind.TAKEOFF and left_m > self.limits.tolerance_m:
            sentence = f"{kind}: hovers, with {left_m:.1f} m left to climb"
            self._on_event(goal, GoalEvent.LATE, sentence)
        else:
            self._on_event(goal, GoalEvent.DONE, f"{kind}: done, mode {self._flight.mode}")

    def _look_along_the_way(self, goal: ActiveGoal, end_ns: int | None) -> None:
        flight, limits, kind = self._flight, self.limits, goal.order.kind
        left_m = self._left_m(goal)
        if end_ns is None or flight.odom_ns < end_ns:
            return
        if left_m <= limits.tolerance_m:
            self._on_event(goal, GoalEvent.DONE, f"{kind}: there, {left_m:.2f} m off")
        elif flight.odom_ns > end_ns + round(limits.patience_s * NS_PER_S):
            sentence = (
                f"{kind}: {left_m:.2f} m off {limits.patience_s:g} s after the end of its way"
            )
            self._on_event(goal, GoalEvent.LATE, f"{sentence}; allowed: {limits.tolerance_m:g} m")

    # --- the table -------------------------------------------------------------------------------

    def _on_event(self, goal: ActiveGoal, event: GoalEvent, sentence: str) -> None:
        """Go on as the table says."""
        row = row_of(goal.order.kind, goal.stage, event)
        if row is None or goal not in self.goals:
            return
        if isinstance(row.target, GoalEnd):
            self._forget(goal)
            self._hands.finish(goal.key, row.target.outcome, row.target.code, sentence + goal.note)
            return
        if goal is self._asked and event == GoalEvent.GRANTED:
            self._fly(goal)
        goal.stage = row.target
        if row.asks:
            self._ask(goal, row.asks)

    def _go_on(self) -> None:
        """Ask for what waits, if nothing is asked for."""
        goal = self._next
        if goal is None or self._asked is not None:
            return
        self._asked, self._next = goal, None
        self._on_event(goal, GoalEvent.TURN, "")
        self._ask(goal, goal.order.kind)

    def _ask(self, goal: ActiveGoal, command: str) -> None:
        """Send a command for a goal; its answer is looked for from now on."""
        goal.asked, goal.asked_ns, goal.asked_wall_s = command, self._flight.now_ns, self._wall_s
        self._send(goal)

    def _send(self, goal: ActiveGoal) -> None:
        goal.sent_wall_s = self._wall_s
        argument = goal.order.message if goal.asked_id == goal.key else None
        self._hands.send(goal.asked, goal.asked_id, argument)

    def _fly(self, goal: ActiveGoal) -> None:
        """It is flown from now on, in place of what was flown."""
        if self._flown is not None:
            self._preempt(self._flown, goal.order.kind)
        self._flown, self._asked = goal, None

    def _preempt(self, goal: ActiveGoal, by: Kind) -> None:
        self._on_event(goal, GoalEvent.PREEMPTED, f"{goal.order.kind}: {by} took its place")

    def _forget(self, goal: ActiveGoal) -> None:
        self._asked = None if self._asked is goal else self._asked
        self._flown = None if self._flown is goal else self._flown
        self._next = None if self._next is goal else self._next
