# SPDX-License-Identifier: Apache-2.0
"""Serves the actions takeoff, goto, follow and land of a flying graph, with feedback and cancel."""

from heli_core.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "goals": [
            "Code",
            "GoalManager",
            "GoalFeedback",
            "Actuator",
            "Kind",
            "GoalRequest",
            "GoalStatus",
        ],
        "interfaces": ["Interfaces"],
        "foreign_mode": ["Attitude", "ForeignMode", "Moment", "Requirement", "Velocity"],
        "pilot": ["Feedback", "Pilot", "PilotGoal"],
        "errors": [
            "FlightNotHeard",
            "FlightSilent",
            "GoalCanceled",
            "GoalClosed",
            "GoalError",
            "GoalNotReached",
            "GoalPreempted",
            "GoalRefused",
            "GoalReplaced",
            "GoalUnanswered",
            "ModeLeft",
            "PilotError",
        ],
    },
)
