# SPDX-License-Identifier: Apache-2.0
"""Commands with an id, and what becomes of them: under way, done, replaced, left. No ROS."""

from typing import NamedTuple

from heli_core.rows import REFERENCE
from heli_core.trajectory import Trajectory
from heli_msgs_bridge.diagnostics import GoalAnswer, GoalState, goals_text
from heli_outer_pd.modes import LANDING, TAKING_OFF, Command, Fact, Phase
from heli_outer_pd.phases import Phases

_TOLD = 16
"""So many answers are told; that of the goal that is under way always is."""


class GoalPhases(NamedTuple):
    """Phases in which a command is under way, and the one that ends it; None: its place does."""

    under_way: tuple[Phase, ...]
    done: Phase | None = None


GOALS = {
    Command.TAKEOFF: GoalPhases(TAKING_OFF, Phase.HOVER),
    Command.LAND: GoalPhases(LANDING, Phase.STANDING),
    Command.GOTO: GoalPhases((Phase.TRAJECTORY, Phase.HOVER)),
    Command.FOLLOW: GoalPhases((Phase.TRAJECTORY, Phase.HOVER)),
}
"""Commands that take a while; any other is done when it is obeyed."""


class Goals:
    """The answers to goals; at most one of them is under way."""

    def __init__(self) -> None:
        self._answers: dict[str, GoalAnswer] = {}
        self._active: GoalAnswer | None = None
        self._entered = 0

    def knows(self, goal_id: str) -> bool:
        """Whether a goal has been answered."""
        return goal_id in self._answers

    def as_text(self) -> str:
        """All answers as a value of `FACT_GOALS`; empty if there is none."""
        return goals_text(self._answers.values()) if self._answers else ""

    def refuse(self, goal_id: str, command: Command, sentence: str, cause: str) -> None:
        """A goal is not done, for a cause by its name; what is under way goes on."""
        answer = GoalAnswer(goal_id, command.value, GoalState.REFUSED, sentence, cause=cause)
        self._add(answer)

    def begin(self, goal_id: str, command: Command, sentence: str, phases: Phases) -> None:
        """A goal has been obeyed: it takes the place of the one that was under way."""
        if self._active is not None:
            self._active.state = GoalState.PREEMPTED
            self._active = None
        answer = GoalAnswer(goal_id, command.value, GoalState.SUCCEEDED, sentence)
        if command in GOALS:
            answer.state, self._active = GoalState.ACTIVE, answer
            self._entered = len(phases.history)
        self._add(answer)
        self.look(phases)

    def end(self) -> None:
        """Another flight begins, or the controller anew: nothing is under way."""
        if self._active is not None:
            self._active.state, self._active = GoalState.LEFT, None

    def look(self, phases: Phases) -> bool:
        """See what has become of the goal that is under way; True if its answer has changed.

        Called after each step of the controller.
        """
        goal, phase = self._active, phases.phase
        if goal is None:
            return False
        before, way = (goal.state, goal.end_ns), phases.trajectory
        under_way, done = GOALS[Command(goal.command)]
        if phase == done:
            goal.state = GoalState.SUCCEEDED
        elif phase not in under_way:
            goal.state = GoalState.LEFT
        elif done is None and self._is_replaced(phases):
            goal.state = GoalState.REPLACED
        flown = done is None or phase == Phase.CLIMBING
        if flown and goal.state != GoalState.LEFT and way is not None:
            goal.end_ned_m, goal.end_ns = _end_of(way)
        if goal.state != GoalState.ACTIVE:
            self._active = None
        return before != (goal.state, goal.end_ns)

    def _is_replaced(self, phases: Phases) -> bool:
        """Whether something else than the end of its way has led to where it is."""
        entered, self._entered = len(phases.history) - self._entered, len(phases.history)
        return entered > 1 or (entered == 1 and phases.event != Fact.ARRIVED)

    def _add(self, answer: GoalAnswer) -> None:
        self._answers[answer.goal_id] = answer
        past = [known for known in self._answers.values() if known is not self._active]
        if len(self._answers) > _TOLD:
            del self._answers[past[0].goal_id]


def _end_of(way: Trajectory) -> tuple[list[float], int]:
    """Where a way ends (3,), NED, m, and when, a stamp."""
    return way.points[-1, REFERENCE.pos].tolist(), way.start_ns + int(way.times_ns[-1])
