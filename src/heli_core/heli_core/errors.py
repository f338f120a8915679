# SPDX-License-Identifier: Apache-2.0
"""Named causes for which a path is refused."""

from enum import Enum
from typing import Any, Self

# -------------------------------------------------------------------------------------------------
# Refusals with a named cause: the base of the packages' errors.
# -------------------------------------------------------------------------------------------------


class CausedError(ValueError):
    """Something that is refused.

    Attributes
    ----------
    cause : Enum
        For programs; the message is one sentence for people and names what is wrong and its number.
    """

    def __init__(self, cause: Enum, sentence: str) -> None:
        super().__init__(sentence)
        self.cause = cause


# -------------------------------------------------------------------------------------------------
# Errors.
# -------------------------------------------------------------------------------------------------


class PathCause(Enum):
    """Why it was refused."""

    NOT_FINITE = "a position, a heading or a time is not finite"
    BAD_LIMIT = "a limit is not a positive number"
    BAD_SIZE = "a length, a radius or a number of laps is not positive"
    TOO_FAST = "the motion at the start is beyond the limits"
    TOO_TIGHT = "the curve cannot be flown within the limits"
    TOO_LONG = "the trajectory would have too many points"


class PathError(CausedError):
    """A path that is refused; `cause` is a `PathCause`."""


# -------------------------------------------------------------------------------------------------
# Named causes for which a flight is not scored.
# -------------------------------------------------------------------------------------------------


class HandlingCause(Enum):
    """Why a flight was not scored."""

    NOT_FINITE = "a signal holds a value that is not finite"
    SHAPE = "a signal has the wrong shape"
    UNKNOWN = "no such manoeuvre, scale or axis"
    TOO_SHORT = "the flight is shorter than the manoeuvre"
    NO_PHASES = "the manoeuvre is not in the flight"
    NO_EXCITATION = "the input does not move"
    LOW_COHERENCE = "the response is lost in noise"


class HandlingError(CausedError):
    """A flight that is not scored; `cause` is a `HandlingCause`."""


# -------------------------------------------------------------------------------------------------
# Named causes for which an identification is refused.
# -------------------------------------------------------------------------------------------------


class IdentificationCause(Enum):
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
    """An identification that is refused; `cause` is a `IdentificationCause`."""


# -------------------------------------------------------------------------------------------------
# Named causes for which a proof or a synthesis is refused.
# -------------------------------------------------------------------------------------------------


class RobustCause(Enum):
    """Why it was refused."""

    NOT_FINITE = "a matrix holds a value that is not finite"
    UNSTABLE = "the loop is not stable"
    BAD_RANGE = "a range is upside down or does not include the nominal value"
    NO_CERTIFICATE = "no scalings certify the level asked for"
    NOT_CONVERGED = "the synthesis does not converge"


class RobustError(CausedError):
    """A proof or a synthesis that is refused; `cause` is a `RobustCause`."""


# -------------------------------------------------------------------------------------------------
# Named causes for which a joystick's reading, or a map of its axes, is refused.
# -------------------------------------------------------------------------------------------------


class StickCause(Enum):
    """Why it was refused."""

    NOT_FINITE = "an axis is not finite"
    OUT_OF_RANGE = "an axis or a button is out of its range"
    TOO_FEW_AXES = "an axis that a stick is on is missing"
    TOO_FEW_BUTTONS = "a button of a command is missing"
    SEVERAL_BUTTONS = "buttons of several commands are pressed at once"
    TAKEN_TWICE = "two sticks share an axis, or two commands a button"


class StickError(CausedError):
    """A reading or a map that is refused; `cause` is a `StickCause`."""


# -------------------------------------------------------------------------------------------------
# Named causes why a design is refused; each message is one sentence for the user.
# -------------------------------------------------------------------------------------------------


class SynthesisError(ValueError):
    """A design that cannot be made; the base of all named causes below.

    Attributes
    ----------
    argument : str
        Argument of the function in Python that is to blame; empty where it is none.
    """

    argument = ""


class ShapeError(SynthesisError):
    """A matrix has the wrong shape, holds NaN or inf, or lacks the rank it needs.

    Attributes
    ----------
    name : str
        Name of the matrix.
    """

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name


class NotStabilizableError(SynthesisError):
    """(A, B) has an uncontrollable mode that is not stable.

    Attributes
    ----------
    mode : complex
        The eigenvalue, rad/s.
    """

    def __init__(self, mode: complex) -> None:
        super().__init__(
            f"(A, B) is not stabilisable: the mode at {_mode(mode)} rad/s is not stable and no "
            "input reaches it"
        )
        self.mode = mode


class InvariantZeroError(SynthesisError):
    """(A, B, C, D) has an invariant zero on the imaginary axis.

    Attributes
    ----------
    zero : complex
        The zero, rad/s.
    """

    def __init__(self, zero: complex) -> None:
        super().__init__(
            f"(A, B, C, D) has an invariant zero on the imaginary axis, at {_mode(zero)} rad/s: "
            "the weights C, D do not see a mode that is not damped by itself"
        )
        self.zero = zero


class InfeasibleGammaError(SynthesisError):
    """gamma is not above gamma*, so that no stabilising controller of its kind reaches it.

    Attributes
    ----------
    gamma, gamma_star : float
        What was asked for and the infimum.
    """

    def __init__(self, gamma: float, gamma_star: float, key: str = "gamma") -> None:
        super().__init__(
            f"{key} = {gamma:.10g} is infeasible: it must be finite and above "
            f"gamma* = {gamma_star:.10g} of this aircraft and these weights"
        )
        self.gamma = gamma
        self.gamma_star = gamma_star


class FeedforwardError(SynthesisError):
    """C_out (A + BF)^-1 B is singular: the inputs cannot set the chosen outputs independently."""


class CertificateError(SynthesisError):
    """The solution does not pass its own acceptance rule (the problem is too badly conditioned)."""


class UnstableLoopError(SynthesisError):
    """The loop as flown is not stable with this controller.

    Attributes
    ----------
    radius : float
        Largest modulus of the closed loop's eigenvalues, per tick.
    """

    def __init__(self, controller: str, radius: float) -> None:
        super().__init__(
            f"controller: {controller} does not stabilise the loop as flown: an eigenvalue per "
            f"tick has modulus {radius:.6g}; allowed: below 1"
        )
        self.radius = radius


class MarginError(SynthesisError):
    """The loop as flown has less disk margin with this controller than `margin_floor`.

    Attributes
    ----------
    controller, where : str
        Which one, and where in the loop: at the plant: input or output.
    margin, floor : float
        What it has and what it has to have.
    """

    def __init__(self, controller: str, where: str, margin: float, floor: float) -> None:
        super().__init__(
            f"controller: {controller} leaves the loop as flown a disk margin of {margin:.3g} at "
            f"the plant's {where}; allowed: margin_floor = {floor:g} or more"
        )
        self.controller, self.where, self.margin, self.floor = controller, where, margin, floor


def _mode(value: complex) -> str:
    if value.imag == 0.0:
        return f"{value.real:.3g}"
    return f"{value.real:.3g} {'+' if value.imag > 0 else '-'} {abs(value.imag):.3g}j"


# -------------------------------------------------------------------------------------------------
# Named causes for a flight that could not be made.
# -------------------------------------------------------------------------------------------------


class FlightError(Exception):
    """The graph could not be brought up or kept up; the message is one line for the user.

    Attributes
    ----------
    argument : str
        Argument of the function in Python that is to blame; empty where it is none.
    """

    argument = ""


class StartError(FlightError):
    """The graph could not be brought up; nothing was flown."""


class BrokenFlightError(FlightError):
    """A flight broke off, or was recorded in part; what was recorded until then is kept."""


# -------------------------------------------------------------------------------------------------
# Parameters that are refused, with the facts of which the sentence is made.
# -------------------------------------------------------------------------------------------------


class ParameterCause(Enum):
    """Why a parameter or a parameter file is refused."""

    UNREADABLE = "a file is missing, or cannot be read or written"
    SYNTAX = "it is not YAML, or not as rcl reads it"
    UNKNOWN_NODE = "the graph has no such node"
    UNKNOWN_KEY = "the node has no such parameter"
    RENAMED_KEY = "the parameter has another name now"
    TWICE = "a key stands there twice"
    MISSING = "there is no value"
    TYPE = "the value is of another type"
    LENGTH = "an array has another number of elements"
    NOT_FINITE = "a number is not finite"
    CHOICE = "the value is none of those to choose from"
    BOUNDS = "a number is out of bounds"
    READ_ONLY = "it is fixed while the node runs"
    CONFLICT = "it does not go together with another value"


class ParameterRefusal(Exception):
    """A parameter that cannot be used, whatever it is of; the message is one line for the user.

    Parameters
    ----------
    problem : str
        What is wrong, in words; the line is made of it and of the facts.

    Attributes
    ----------
    cause : ParameterCause or None
        For programs; None where none is named.
    where, key : str
        `file:line`, or `-p rule`, and the parameter's name; empty where they are not known.
    value : Any
        What is refused; None where it is not a matter of a value.
    allowed : str
        What would be allowed, in words.
    meant : str
        The name that an unknown one was probably meant for.
    argument : str
        Argument of the function in Python that was called with it; empty where it is none.
    """

    argument = ""

    def __init__(
        self,
        problem: str,
        cause: ParameterCause | None = None,
        *,
        where: str = "",
        key: str = "",
        value: Any = None,
        allowed: str = "",
        meant: str = "",
    ) -> None:
        super().__init__(problem)
        self.problem, self.cause, self.where, self.key = problem, cause, where, key
        self.value, self.allowed, self.meant = value, allowed, meant

    def __str__(self) -> str:
        line = ": ".join(part for part in (self.where, self.key, self.problem) if part)
        return f"{line}; allowed: {self.allowed}" if self.allowed else line

    @classmethod
    def like(cls, other: "ParameterRefusal") -> Self:
        """The facts of another refusal."""
        same = cls(other.problem, other.cause)
        same.__dict__.update(vars(other))
        return same

    @classmethod
    def of_argument(cls, name: str, value: Any, allowed: str) -> Self:
        """The refusal of an argument of a function in Python."""
        error = cls(f"{name} {value!r}: not allowed", value=value, allowed=allowed)
        error.argument = name
        return error

    def placed(self, where: str, key: str) -> Self:
        """The same of a parameter at a place."""
        self.where, self.key = where, key
        return self


class ParameterError(ParameterRefusal):
    """A parameter or parameter file that cannot be used."""


NO_ROS = (
    "needs ROS 2 Jazzy, which is not installed here: pip install 'heli-hover[ros]' on Linux on "
    "x86_64, or source your own; --one-process, designs, campaigns and reports need none"
)
"""What is said where the graph is asked for and there is no ROS."""


class PlantConfigError(ParameterRefusal, ValueError):
    """Parameters of the plant that do not fit together."""


class PartError(ValueError):
    """An object that cannot fly as a part; the message names it and what is allowed.

    Attributes
    ----------
    argument : str
        Argument that it was given as; empty where it is not known.
    """

    def __init__(self, sentence: str, argument: str = "") -> None:
        super().__init__(sentence)
        self.argument = argument
