# SPDX-License-Identifier: Apache-2.0
"""Named causes for which a joystick's reading, or a map of its axes, is refused."""

from enum import Enum

from heli_math.causes import CausedError


class Cause(Enum):
    """Why it was refused."""

    NOT_FINITE = "an axis is not finite"
    OUT_OF_RANGE = "an axis or a button is out of its range"
    TOO_FEW_AXES = "an axis that a stick is on is missing"
    TOO_FEW_BUTTONS = "a button of a command is missing"
    SEVERAL_BUTTONS = "buttons of several commands are pressed at once"
    TAKEN_TWICE = "two sticks share an axis, or two commands a button"


class StickError(CausedError):
    """A reading or a map that is refused; `cause` is a `Cause`."""
