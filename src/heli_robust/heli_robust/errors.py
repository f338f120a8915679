# SPDX-License-Identifier: Apache-2.0
"""Named causes for which a proof or a synthesis is refused."""

from enum import Enum

from heli_math.causes import CausedError


class Cause(Enum):
    """Why it was refused."""

    NOT_FINITE = "a matrix holds a value that is not finite"
    UNSTABLE = "the loop is not stable"
    BAD_RANGE = "a range is upside down or does not include the nominal value"
    NO_CERTIFICATE = "no scalings certify the level asked for"
    NOT_CONVERGED = "the synthesis does not converge"


class RobustError(CausedError):
    """A proof or a synthesis that is refused; `cause` is a `Cause`."""
