# SPDX-License-Identifier: Apache-2.0
"""Named causes for which a path is refused."""

from enum import Enum

from heli_math.causes import CausedError


class Cause(Enum):
    """Why it was refused."""

    NOT_FINITE = "a position, a heading or a time is not finite"
    BAD_LIMIT = "a limit is not a positive number"
    BAD_SIZE = "a length, a radius or a number of laps is not positive"
    TOO_FAST = "the motion at the start is beyond the limits"
    TOO_TIGHT = "the curve cannot be flown within the limits"
    TOO_LONG = "the trajectory would have too many points"


class PathError(CausedError):
    """A path that is refused; `cause` is a `Cause`."""
