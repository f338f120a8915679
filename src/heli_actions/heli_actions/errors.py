# SPDX-License-Identifier: Apache-2.0
"""Why a pilot's goal was not done: one exception for each code of a goal's end. No ROS."""

from heli_actions.goals import Code


class PilotError(Exception):
    """What a pilot asked for was not done; the message is one sentence."""


class FlightNotHeard(PilotError):
    """No flight is heard, or none that is ready to be commanded."""


class GoalError(PilotError):
    """A goal has ended otherwise than done.

    Attributes
    ----------
    code : Code
        How it ended.
    cause : str
        Why it was refused, as `heli_msgs_bridge.diagnostics.GoalAnswer.cause` names it; empty for
        what was not refused.
    """

    def __init__(self, code: Code, sentence: str, cause: str = "") -> None:
        super().__init__(sentence)
        self.code, self.cause = code, cause


class GoalCanceled(GoalError):
    """It was cancelled: the aircraft holds, or has broken off its take-off."""


class GoalRefused(GoalError):
    """The outer loop does not do it; `cause` says why, and the flight goes on as before."""


class GoalUnanswered(GoalError):
    """The outer loop has not answered in time."""


class GoalPreempted(GoalError):
    """Another goal took its place."""


class GoalReplaced(GoalError):
    """Somebody else gave another way."""


class ModeLeft(GoalError):
    """A pilot took over, a landing was commanded, the take-off was aborted."""


class GoalNotReached(GoalError):
    """Its way is over, and the aircraft is not where it ends."""


class FlightSilent(GoalError):
    """Nothing is heard of the flight any more, or another one has begun."""


class GoalClosed(GoalError):
    """Nobody looks after it any more; the flight goes on."""


ERRORS: dict[Code, type[GoalError]] = {
    Code.CANCELED: GoalCanceled,
    Code.REFUSED: GoalRefused,
    Code.NO_ANSWER: GoalUnanswered,
    Code.PREEMPTED: GoalPreempted,
    Code.REPLACED: GoalReplaced,
    Code.MODE_LEFT: ModeLeft,
    Code.NOT_REACHED: GoalNotReached,
    Code.SILENT: FlightSilent,
    Code.CLOSED: GoalClosed,
}
"""The exception of each code but `DONE`."""


def goal_error(code: Code, sentence: str, cause: str = "") -> GoalError:
    """The exception of a goal that has ended so."""
    return ERRORS[code](code, sentence, cause)
