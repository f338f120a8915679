# SPDX-License-Identifier: Apache-2.0
"""The loop as flown, in plain arrays: what a law is judged by before it may fly.

Whatever flies imports this; `loops` makes python-control's systems of the same arrays.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from heli_inner_hinf.actuation import Actuation
from heli_inner_hinf.disk_margin import smallest
from heli_inner_hinf.frequency import grid, logarithms
from heli_inner_hinf.law_state import OUTPUT_FEEDBACK, PID, STATE_FEEDBACK, AttitudeKernel
from heli_inner_hinf.output_law import INPUTS, N_U, N_V, OutputLaw, output_law
from heli_inner_hinf.regular_form import Matrix
from heli_math.linear_systems import held_late, with_delay_line, with_servos
from heli_math.state_names import ATTITUDE, MEASURED, STATE_NAMES
from heli_math.ticks import TICK_S

_AXES = (("phi", "p", "phi_ref"), ("theta", "q", "theta_ref"), ("psi_error", "r", ""))
_TOP = 0.9999 * np.pi  # rad per tick


class Feedback(NamedTuple):
    """x+ = A x + B y, u = C x + D y, without commands; `measured`: places of y among the nine."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix
    measured: tuple[int, ...]


class Judgement(NamedTuple):
    """What the loop as flown is worth with a law: of state feedback without the observer's part.

    Attributes
    ----------
    radius : float
        Largest modulus of its eigenvalues, per tick; stable below one.
    disk_input, disk_output : float
        Disk margins (`DiskMargin.alpha`), all channels at once, at the plant's input and at what
        the law reads; 0 if the loop is not stable.
    """

    radius: float
    disk_input: float
    disk_output: float

    @property
    def stable(self) -> bool:
        """Whether every mode dies out; an eigenvalue of one is a heading that nobody holds."""
        return self.radius < 1.0 - 1e-9


def flown_plant(A: Matrix, B: Matrix, actuation: Actuation) -> tuple[Matrix, Matrix]:
    """A, B of x' = A x + B u behind servos and delay, one step a tick; exact.

    States: x, the servos' positions and rates, then u_(n-1), u_(n-2), ... as far back as the delay
    needs.
    """
    behind = with_servos(A, B, actuation.servo_radps, actuation.servo_damping)
    return with_delay_line(held_late(*behind, actuation.tick_s, actuation.delay_s))


def pid_as_output_law(
    K_P: ArrayLike, K_I: ArrayLike, K_D: ArrayLike, tick_s: float = TICK_S
) -> OutputLaw:
    """The PID of three axes away from the limits, states: its integrators; gains as in the YAML."""
    p, i, d = (np.diag(np.asarray(gain, float)) for gain in (K_P, K_I, K_D))
    error, rate = np.zeros((N_U, N_V)), np.zeros((N_U, N_V))
    for axis, (angle, turning, reference) in enumerate(_AXES):
        error[axis, INPUTS.index(angle)] = -1.0
        rate[axis, INPUTS.index(turning)] = 1.0
        if reference:
            error[axis, INPUTS.index(reference)] = 1.0
    step = tick_s * i @ error
    return output_law(np.eye(N_U), step, np.eye(N_U), p @ error - d @ rate + step)


def linear_law_of(k: AttitudeKernel) -> OutputLaw | None:
    """Output feedback, or what equals the PID away from the limits; None for other kinds of law."""
    if k.controller == PID:
        return pid_as_output_law(k.K_P, k.K_I, k.K_D, k.tick_s)
    return k.law if k.controller == OUTPUT_FEEDBACK else None


def feedback_of(k: AttitudeKernel) -> Feedback | None:
    """Linear feedback of a kernel away from the limits; None for a kind that is not known here.

    State feedback is taken with every state measured: what the observer costs, `loops` tells.
    """
    if k.controller == STATE_FEEDBACK:
        return _state_feedback(k)
    law = linear_law_of(k)
    return None if law is None else feedback_of_law(law)


def feedback_of_law(law: OutputLaw) -> Feedback:
    """A law without commands."""
    n_y = len(MEASURED)
    return Feedback(law.A, law.B[:, :n_y], law.C, law.D[:, :n_y], MEASURED)


def _state_feedback(k: AttitudeKernel) -> Feedback:
    """u = F x + H u_last + G s, s the shift of the offset-free target; states u_last, s."""
    everything = tuple(range(len(STATE_NAMES)))
    if k.shift_rate == 0.0:
        return Feedback(k.H, k.F, k.H, k.F, everything)
    eye, none = np.eye(N_U), np.zeros((N_U, N_U))
    attitude = np.eye(len(STATE_NAMES))[list(ATTITUDE)]
    A = np.block([[k.H, k.G], [none, eye]])
    B = np.vstack([k.F, -k.tick_s * k.shift_rate * attitude])
    return Feedback(A, B, np.hstack([k.H, k.G]), k.F, everything)


def closed_loop(A: Matrix, B: Matrix, feedback: Feedback, actuation: Actuation) -> Matrix:
    """State matrix of the loop of A (9, 9), B (9, 3) as flown; plant's states, then the law's."""
    return closed(*flown_plant(A, B, actuation), feedback)


def closed(Ad: Matrix, Bd: Matrix, feedback: Feedback) -> Matrix:
    """The same of `flown_plant`."""
    y = np.eye(Ad.shape[0])[list(feedback.measured)]
    return np.block(
        [[Ad + Bd @ feedback.D @ y, Bd @ feedback.C], [feedback.B @ y, feedback.A]],
    )


def judge(A: Matrix, B: Matrix, feedback: Feedback, actuation: Actuation) -> Judgement:
    """Stability and disk margins of the loop as flown with A (9, 9), B (9, 3) of eq. (9)."""
    poles = np.linalg.eigvals(closed_loop(A, B, feedback, actuation))
    judgement = Judgement(float(np.max(np.abs(poles))), 0.0, 0.0)
    if not judgement.stable:
        return judgement
    tick_s = actuation.tick_s
    omega = grid(logarithms(poles, tick_s), 1e-2, _TOP / tick_s, 200, near=9)
    Ad, Bd = flown_plant(A, B, actuation)
    P = sampled_response(Ad, Bd, omega, tick_s)[:, list(feedback.measured)]
    K = feedback.C @ sampled_response(feedback.A, feedback.B, omega, tick_s) + feedback.D
    return judgement._replace(
        disk_input=smallest(-K @ P, omega).alpha, disk_output=smallest(-P @ K, omega).alpha
    )


def sampled_response(A: Matrix, B: Matrix, omega: Matrix, tick_s: float = TICK_S) -> np.ndarray:
    """(z I - A)^-1 B, (m, n, k), on the unit circle at omega (m,), rad/s."""
    z = np.exp(1j * omega * tick_s)[:, None, None]
    right = np.broadcast_to(B.astype(complex), (omega.size, *B.shape))
    return np.linalg.solve(z * np.eye(A.shape[0]) - A, right)
