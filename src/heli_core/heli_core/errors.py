# SPDX-License-Identifier: Apache-2.0
"""Named causes why a design is refused; each message is one sentence for the user."""


class SynthesisError(ValueError):
    """A design that cannot be made; the base of all named causes below."""


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
    """gamma is not above gamma*, so that no stabilising law of its kind reaches it.

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
    """The loop as flown is not stable with this law.

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
    """The loop as flown has less disk margin with this law than `margin_floor`."""

    def __init__(self, controller: str, where: str, margin: float, floor: float) -> None:
        super().__init__(
            f"controller: {controller} leaves the loop as flown a disk margin of {margin:.3g} at "
            f"the plant's {where}; allowed: margin_floor = {floor:g} or more"
        )


def _mode(value: complex) -> str:
    if value.imag == 0.0:
        return f"{value.real:.3g}"
    return f"{value.real:.3g} {'+' if value.imag > 0 else '-'} {abs(value.imag):.3g}j"
