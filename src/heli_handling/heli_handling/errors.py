# SPDX-License-Identifier: Apache-2.0
"""Named causes for which a flight is not scored."""

from enum import Enum

from heli_math.causes import CausedError


class Cause(Enum):
    """Why a flight was not scored."""

    NOT_FINITE = "a signal holds a value that is not finite"
    SHAPE = "a signal has the wrong shape"
    UNKNOWN = "no such manoeuvre, scale or axis"
    TOO_SHORT = "the flight is shorter than the manoeuvre"
    NO_PHASES = "the manoeuvre is not in the flight"
    NO_EXCITATION = "the input does not move"
    LOW_COHERENCE = "the response is lost in noise"


class HandlingError(CausedError):
    """A flight that is not scored; `cause` is a `Cause`."""
