# SPDX-License-Identifier: Apache-2.0
"""Goals from their coming to their end: one is flown, one asked for, one waits. No ROS.

A goal that the outer loop grants takes the place of the one that is flown, which is aborted; one
that it refuses ends, and what is flown goes on. Of those that wait the newest stays. That is how
Nav2's servers preempt, but that they cannot refuse.
"""

from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from heli_actions.seen import Seen, Way
from heli_actions.table import RULES, Code, End, Event, Kind, Outcome, Stage, row_of
from heli_math.ticks import NS_PER_S, TICK_NS

Array = NDArray[np.float64]
_SAME_PLACE_M = 1e-3
_TOLD_EVERY_NS = NS_PER_S + TICK_NS
"""The outer loop says its mode once per simulated second, and at once when its sentence changes."""
NOT_KNOWN = -1.0


@dataclass(frozen=True)
class Order:
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
class Feedback:
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
class Limits:
    """The node's parameters: times, s, and a distance, m.

    Times of `answer_s` and `silence_s` are over when both have passed, flight time and wall time:
    a flight in lockstep is faster than answers are, a pause stops the one and not the other.
    """

    answer_s: float
    silence_s: float
    wall_silence_s: float
    patience_s: float
    tolerance_m: float


class Hands(Protocol):
    """What carries out what the desk decides."""

    def ask(self, key: Hashable, service: str) -> None:
        """Call a service of the outer loop for a goal; the answer goes to `Desk.answered`."""

    def send(self, topic: str, message: Any) -> None:
        """Publish a goal's message."""

    def finish(self, key: Hashable, outcome: Outcome, code: Code, sentence: str) -> None:
        """End a goal."""


@dataclass(eq=False)
class Goal:
    """A goal that has not ended.

    Attributes
    ----------
    key : hashable
    order : Order
    stage : Stage
    asked_ns, asked_wall_s : int, float
        When it asked last, stamp and wall time.
    granted_ns : int
        When it was granted; 0 before.
    mode_before : str
        Mode when it was asked for.
    refusals, ways : int
        Refused messages of its topic, and references, when it was asked for.
    way : Way or None
        What the outer loop flies for it.
    note : str
        What is to be told at its end besides.
    """

    key: Hashable
    order: Order
    stage: Stage = Stage.WAITING
    asked_ns: int = 0
    asked_wall_s: float = 0.0
    mode_before: str = ""
    refusals: int = 0
    ways: int = 0
    granted_ns: int = 0
    way: Way | None = None
    note: str = ""


class Desk:
    """Takes goals and looks after them.

    Parameters
    ----------
    hands : Hands
    seen : Seen
        Of the flight; whoever hears it writes it, and calls `look` after it.
    limits : Limits
    """

    def __init__(self, hands: Hands, seen: Seen, limits: Limits) -> None:
        self._hands, self._seen, self.limits = hands, seen, limits
        self._asked: Goal | None = None
        self._flown: Goal | None = None
        self._next: Goal | None = None
        self._wall_s = 0.0

    @property
    def goals(self) -> tuple[Goal, ...]:
        """Those that have not ended."""
        return tuple(goal for goal in (self._flown, self._asked, self._next) if goal is not None)

    # --- from clients ----------------------------------------------------------------------------

    def take(self, key: Hashable, order: Order) -> None:
        """A goal has come: ask the outer loop for it, once the one before is answered."""
        if self._next is not None:
            self._preempt(self._next, order.kind)
        self._next = Goal(key, order)
        self._go_on()

    def cancel(self, key: Hashable) -> None:
        """A client has cancelled a goal."""
        for goal in self.goals:
            if goal.key == key:
                self._happens(goal, Event.CANCEL, f"{goal.order.kind}: cancelled")

    def close(self) -> None:
        """No goal is looked after any more."""
        for goal in self.goals:
            kind = goal.order.kind
            self._happens(
                goal, Event.CLOSED, f"{kind}: the node is deactivated; the flight goes on"
            )

    # --- from the flight -------------------------------------------------------------------------

    def answered(self, key: Hashable, done: bool, sentence: str) -> None:
        """A service has answered what was asked for a goal."""
        for goal in self.goals:
            if goal.key == key:
                if goal.stage in (Stage.HOLDING, Stage.BREAKING):
                    goal.note = "" if done else f"; not cancelled: {sentence}"
                self._happens(goal, Event.GRANTED if done else Event.REFUSED, sentence)
        self._go_on()

    def hear(self, way: Way) -> None:
        """A reference has come: of those who asked for it, or of others."""
        self._seen.hear(way)
        for goal in self.goals:
            if self._is_its_own(goal, way):
                goal.way = way

    def odom(self, stamp_ns: int, pos_ned_m: Array, quat: Array, wall_s: float) -> None:
        """Navigation has come; as `Seen.odom`, which also sees another flight begin."""
        if stamp_ns < self._seen.odom_ns - NS_PER_S:
            for goal in self.goals:
                self._happens(goal, Event.SILENT, f"{goal.order.kind}: another flight has begun")
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

    def feedback(self) -> tuple[Hashable, Kind, Feedback] | None:
        """Of the goal that is flown, if there is one."""
        goal, seen = self._flown, self._seen
        if goal is None:
            return None
        end_ns = goal.order.end_ns if goal.way is None else goal.way.end_ns
        left_s = NOT_KNOWN if end_ns is None else max(0.0, (end_ns - seen.now_ns) / NS_PER_S)
        where = seen.pos_ned_m.copy(), seen.quat.copy()
        told = Feedback(seen.now_ns, seen.mode, *where, self._left_m(goal), left_s)
        return goal.key, goal.order.kind, told

    # --- conclusions -----------------------------------------------------------------------------

    def _left_m(self, goal: Goal) -> float:
        here, kind = self._seen.pos_ned_m, goal.order.kind
        if kind == Kind.LAND:
            return max(0.0, float(self._seen.stood_down_m - here[2]))
        if kind == Kind.TAKEOFF:
            return (
                NOT_KNOWN if goal.way is None else max(0.0, float(here[2] - goal.way.end_ned_m[2]))
            )
        assert goal.order.end_ned_m is not None
        return float(np.linalg.norm(here - goal.order.end_ned_m))

    def _is_its_own(self, goal: Goal, way: Way) -> bool:
        """A take-off's is the highest, its climb; a goto's ends where it is to."""
        if goal.order.kind == Kind.TAKEOFF:
            return goal.way is None or bool(way.end_ned_m[2] < goal.way.end_ned_m[2])
        end = goal.order.end_ned_m
        same = end is not None and float(np.linalg.norm(way.end_ned_m - end)) < _SAME_PLACE_M
        return same and (goal.order.end_ns is None or way.end_ns == goal.order.end_ns)

    def _look_for_silence(self, goal: Goal) -> None:
        seen, limits, kind = self._seen, self.limits, goal.order.kind
        if self._wall_s - max(seen.odom_wall_s, seen.told_wall_s) > limits.wall_silence_s:
            wall = f"for {limits.wall_silence_s:g} s of wall time"
            self._happens(goal, Event.SILENT, f"{kind}: nothing of the flight is heard {wall}")
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
                self._happens(goal, Event.SILENT, f"{kind}: {said}")
                return

    def _passed_s(self, since_ns: int, since_wall_s: float) -> float:
        """Time that has passed by both clocks, s."""
        return min((self._seen.now_ns - since_ns) / NS_PER_S, self._wall_s - since_wall_s)

    def _look_for_an_answer(self, goal: Goal) -> None:
        seen, rule, kind = self._seen, RULES[goal.order.kind], goal.order.kind
        if rule.topic and seen.refused(rule.topic) > goal.refusals:
            self._happens(goal, Event.REFUSED, seen.refusals[rule.topic][1])
        elif kind == Kind.GOTO and goal.way is not None:
            self._happens(goal, Event.GRANTED, "")
        elif kind == Kind.FOLLOW and self._follows(goal):
            self._happens(goal, Event.GRANTED, "")
        else:
            self._look_at_the_time(goal)

    def _follows(self, goal: Goal) -> bool:
        """Whether the outer loop follows a trajectory that was given to it."""
        seen = self._seen
        late = seen.told_ns - goal.asked_ns > _TOLD_EVERY_NS
        return late and seen.given and seen.mode == "trajectory"

    def _look_at_the_time(self, goal: Goal) -> None:
        """An answer that does not come."""
        if self._passed_s(goal.asked_ns, goal.asked_wall_s) > self.limits.answer_s:
            said = f"no answer of the outer loop in {self.limits.answer_s:g} s"
            self._happens(goal, Event.UNANSWERED, f"{goal.order.kind}: {said}")

    def _look_at_the_flight(self, goal: Goal) -> None:
        if goal.stage in (Stage.HOLDING, Stage.BREAKING):
            self._look_at_the_time(goal)
            return
        seen, rule, kind = self._seen, RULES[goal.order.kind], goal.order.kind
        if kind == Kind.FOLLOW and seen.refused(rule.topic) > goal.refusals:
            self._happens(goal, Event.REFUSED, seen.refusals[rule.topic][1])
            return
        # Until it is told anew, the mode is that from before the goal.
        news = seen.told_ns - goal.granted_ns > _TOLD_EVERY_NS or seen.mode != goal.mode_before
        if news and seen.mode == rule.done:
            self._look_at_the_end(goal)
        elif news and seen.mode not in rule.modes:
            said = f"{kind}: left for mode {seen.mode} ({seen.said})"
            self._happens(goal, Event.LEFT, said)
        elif not rule.done:
            self._look_along_the_way(goal)

    def _look_at_the_end(self, goal: Goal) -> None:
        """The mode that ends it is there; a climb may have been ended by a hold."""
        kind, left_m = goal.order.kind, self._left_m(goal)
        if kind == Kind.TAKEOFF and left_m > self.limits.tolerance_m:
            said = f"{kind}: hovers, with {left_m:.1f} m left to climb"
            self._happens(goal, Event.LATE, said)
        else:
            self._happens(goal, Event.DONE, f"{kind}: done, mode {self._seen.mode}")

    def _look_along_the_way(self, goal: Goal) -> None:
        seen, limits, kind = self._seen, self.limits, goal.order.kind
        if seen.ways > goal.ways and seen.way is not None and not self._is_its_own(goal, seen.way):
            north, east, down = seen.way.end_ned_m
            to = f"{east:.2f} m east, {north:.2f} m north, {-down:.2f} m high"
            self._happens(goal, Event.REPLACED, f"{kind}: another way is flown, to {to}")
            return
        end_ns = goal.order.end_ns if goal.way is None else goal.way.end_ns
        left_m = self._left_m(goal)
        if end_ns is None or seen.odom_ns < end_ns:
            return
        if left_m <= limits.tolerance_m:
            self._happens(goal, Event.DONE, f"{kind}: there, {left_m:.2f} m off")
        elif seen.odom_ns > end_ns + round(limits.patience_s * NS_PER_S):
            said = f"{kind}: {left_m:.2f} m off {limits.patience_s:g} s after the end of its way"
            self._happens(goal, Event.LATE, f"{said}; allowed: {limits.tolerance_m:g} m")

    # --- the table -------------------------------------------------------------------------------

    def _happens(self, goal: Goal, event: Event, sentence: str) -> None:
        """Go on as the table says."""
        row = row_of(goal.order.kind, goal.stage, event)
        if row is None or goal not in self.goals:
            return
        if isinstance(row.target, End):
            self._forget(goal)
            said = sentence + goal.note
            self._hands.finish(goal.key, row.target.outcome, row.target.code, said)
            return
        if goal is self._asked and event == Event.GRANTED:
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
        goal.refusals, goal.ways = seen.refused(rule.topic), seen.ways
        self._happens(goal, Event.TURN, "")
        if rule.service:
            self._hands.ask(goal.key, rule.service)
        else:
            self._hands.send(rule.topic, goal.order.message)

    def _fly(self, goal: Goal) -> None:
        """It is flown from now on, in the place of what was flown."""
        if self._flown is not None:
            self._preempt(self._flown, goal.order.kind)
        self._flown, self._asked = goal, None
        goal.granted_ns = self._seen.now_ns

    def _preempt(self, goal: Goal, by: Kind) -> None:
        self._happens(goal, Event.PREEMPTED, f"{goal.order.kind}: {by} took its place")

    def _forget(self, goal: Goal) -> None:
        self._asked = None if self._asked is goal else self._asked
        self._flown = None if self._flown is goal else self._flown
        self._next = None if self._next is goal else self._next
