# SPDX-License-Identifier: Apache-2.0
"""Named causes for which an identification is refused."""

from enum import Enum

from heli_math.causes import CausedError


class Cause(Enum):
    """Why an identification was refused."""

    NOT_FINITE = "a signal holds a value that is not finite"
    SHAPE = "a signal has the wrong shape"
    GAP = "the samples are not one tick apart"
    TOO_SHORT = "the record ends before the excitation's periods do"
    NO_EXCITATION = "a channel is not excited"
    NOT_PERIODIC = "the excitation is not the same in every period"
    LOW_COHERENCE = "the response is lost in noise"
    TOO_FEW_LINES = "fewer frequencies are excited than the model needs"
    NOT_CONVERGED = "the fit did not converge"
    UNSTABLE = "the fitted model is unphysical"


class IdentificationError(CausedError):
    """An identification that is refused; `cause` is a `Cause`."""
