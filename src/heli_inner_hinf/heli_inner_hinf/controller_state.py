# SPDX-License-Identifier: Apache-2.0
"""A dynamic linear controller from the measured states: the kernel of all output feedback.

Each tick of 10 ms, in deviations from trim (`read_inputs` fills v):

    u_lin = C x + D v,   u = clip(u_lin),   x+ = A x + B v + L (u - u_lin)

Heading enters only as psi - psi_ref, so that the controller does not depend on which way is north;
a new psi_ref then moves that error without a motion, and `turn` moves the controller's memory with
it. Errors of pitch and heading are turned by the bank beyond trim into the axes in which the rates
q, r mend them: at 30 deg, which side wind takes, Euler angles cost both loops 30 deg of phase.
"""

import enum
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_core.errors import ShapeError
from heli_core.jit import by_reference, copy_part, njit, scratch
from heli_core.linear import held
from heli_core.rotations import euler_from_quat, wrap_pi
from heli_core.rows import INPUT_NAMES, MEASURED, NAV, NINE, ROTOR, SETPOINT
from heli_core.ticks import TICK_S, Rate
from heli_inner_hinf.regular_form import Matrix

# -------------------------------------------------------------------------------------------------
# Output controller.
# -------------------------------------------------------------------------------------------------

INPUTS = ("phi", "theta", "p", "q", "r", "psi_error", "phi_ref", "theta_ref")
"""v: deviations from trim, rad and rad/s; the first six in the order of `MEASURED`."""
N_V, N_U = len(INPUTS), len(INPUT_NAMES)
MAX_ORDER = 32
"""Most states that a controller may have."""

_PSI_ERROR, _PHI_REF, _THETA_REF = (
    INPUTS.index(name) for name in ("psi_error", "phi_ref", "theta_ref")
)
_MEMORY_S = 1.0
"""States that forget faster than this start at rest; slower ones carry what is flown."""


@by_reference
class OutputLaw(NamedTuple):
    """Numbers of the controller; actuators in (-1, 1), angles rad, rates rad/s, one step a tick.

    Attributes
    ----------
    A, B, C, D : (n, n), (n, 8), (3, n), (3, 8) arrays
        x+ = A x + B v, u = C x + D v; n from 0 to `MAX_ORDER`, v as `INPUTS`.
    L : (n, 3) array
        What the cut-off part of the command, u - u_lin, does to the state (conditioning against
        wind-up); for a controller with an observer inside its input matrix: the observer then hears
        what was really flown.
    turn : (n,) array
        By how much the state follows, per rad by which a new psi_ref moves the heading error; for a
        controller with an observer of that error inside the unit vector of its estimate.
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    C: NDArray[np.float64]
    D: NDArray[np.float64]
    L: NDArray[np.float64]
    turn: NDArray[np.float64]


def output_law(
    A: ArrayLike,
    B: ArrayLike,
    C: ArrayLike,
    D: ArrayLike,
    L: ArrayLike | None = None,
    turn: ArrayLike | None = None,
) -> OutputLaw:
    """A checked controller from its matrices, flat by rows or shaped; L, turn: zero by default.

    Raises
    ------
    ShapeError
        Names the matrix `law.A` ... `law.turn`: wrong shape, not finite, or too many states.
    """
    a = np.asarray(A, float)
    order = round(a.size**0.5)
    if order**2 != a.size or order > MAX_ORDER:
        raise ShapeError(
            "law.A",
            f"law.A has {a.size} numbers, but must be square (n x n, row by row) with n at most "
            f"{MAX_ORDER}",
        )
    L = np.zeros((order, N_U)) if L is None else L
    turn = np.zeros(order) if turn is None else turn
    return OutputLaw(
        _matrix("A", a, (order, order)),
        _matrix("B", B, (order, N_V)),
        _matrix("C", C, (N_U, order)),
        _matrix("D", D, (N_U, N_V)),
        _matrix("L", L, (order, N_U)),
        _matrix("turn", turn, (order,)),
    )


def _matrix(name: str, value: ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    array = np.array(value, dtype=np.float64)
    if array.shape != shape and not (array.ndim == 1 and array.size == np.prod(shape)):
        wanted, have = (" x ".join(map(str, s)) for s in (shape, array.shape))
        raise ShapeError(f"law.{name}", f"law.{name} must be {wanted} (order of law.A), is {have}")
    if not np.isfinite(array).all():
        raise ShapeError(f"law.{name}", f"law.{name} holds a value that is not finite (NaN or inf)")
    return np.ascontiguousarray(array.reshape(shape))


NO_LAW = output_law(np.zeros((0, 0)), np.zeros((0, N_V)), np.zeros((N_U, 0)), np.zeros((N_U, N_V)))
"""What the kernel of another kind of controller carries."""


@njit
def read_inputs(x9, r3, x_trim, v):
    """v (8,), places of `INPUTS`, of absolute states (9,) and commands (3,), rad and rad/s."""
    for i in range(_PSI_ERROR):
        v[i] = x9[MEASURED[i]] - x_trim[MEASURED[i]]
    v[_PSI_ERROR] = wrap_pi(x9[NINE.psi] - r3[SETPOINT.psi])
    v[_PHI_REF] = r3[SETPOINT.phi] - x_trim[NINE.phi]
    v[_THETA_REF] = r3[SETPOINT.theta] - x_trim[NINE.theta]
    # v[0] is the bank beyond trim, v[1] the pitch.
    c, s = math.cos(v[0]), math.sin(v[0])
    pitch_error, heading_error = v[1] - v[_THETA_REF], v[_PSI_ERROR]
    v[1] = v[_THETA_REF] + c * pitch_error + s * heading_error
    v[_PSI_ERROR] = c * heading_error - s * pitch_error


@njit
def command(law, x, v, u3):
    """u_lin = C x + D v, deviation from trim, into u3 (3,)."""
    for i in range(N_U):
        total = 0.0
        for j in range(x.size):
            total += law.C[i, j] * x[j]
        for j in range(N_V):
            total += law.D[i, j] * v[j]
        u3[i] = total


@njit
def advance(law, x, v, cut):
    """x+ = A x + B v + L cut, in place; cut (3,) is u - u_lin."""
    n = x.size
    old = scratch(MAX_ORDER)
    copy_part(old, 0, x, 0, n)
    for i in range(n):
        total = 0.0
        for j in range(n):
            total += law.A[i, j] * old[j]
        for j in range(N_V):
            total += law.B[i, j] * v[j]
        for j in range(N_U):
            total += law.L[i, j] * cut[j]
        x[i] = total


def state_at_rest(
    law: OutputLaw, v: ArrayLike, u: ArrayLike, tick_s: float = TICK_S
) -> NDArray[np.float64]:
    """State (n,) at which the controller rests with v (8,) held and commands u (3,), if it can.

    Least squares of the drift in one tick and of the command's error, in which modes that forget in
    less than a second rest, and slower ones, integrators above all, carry the command.
    """
    rows, of_v, of_u = _at_rest(law, tick_s)
    return np.linalg.lstsq(rows, of_v @ np.asarray(v, float) + of_u @ np.asarray(u, float))[0]


def rest_map(law: OutputLaw, tick_s: float = TICK_S) -> NDArray[np.float64]:
    """`state_at_rest` as a matrix (n, 11) that takes v and u, one behind the other."""
    rows, of_v, of_u = _at_rest(law, tick_s)
    return np.ascontiguousarray(np.linalg.pinv(rows) @ np.hstack([of_v, of_u]))


def _at_rest(law: OutputLaw, tick_s: float) -> tuple[NDArray[np.float64], ...]:
    """(rows, of_v, of_u): least squares of rows x = of_v v + of_u u is the state at rest."""
    n = law.A.shape[0]
    weight = tick_s / _MEMORY_S
    rows = np.vstack([np.eye(n) - law.A, weight * law.C])
    of_v = np.vstack([law.B, -weight * law.D])
    of_u = np.vstack([np.zeros((n, N_U)), weight * np.eye(N_U)])
    return rows, of_v, of_u


# -------------------------------------------------------------------------------------------------
# What every attitude controller shares: the kernel's numbers and the layout of its small state
# array.
# -------------------------------------------------------------------------------------------------

CONTROLLERS = {
    "hinf_output": 2,
    "hinf": 0,
    "lqg": 2,
    "lqr": 0,
    "pid": 1,
    "matrices": 2,
    "indi": 2,
}
"""Names in the YAML and the kind of controller that each is."""

STATE_FEEDBACK, PID, OUTPUT_FEEDBACK = 0, 1, 2
"""Kinds of controller, by which the kernel chooses."""

# Layout of the state array (N_LAW_STATE,): where a part begins.
LAST_U = 0  # (3) last output, -1..1
INTEGRAL = 3  # (3) PID: integrators, actuator units; state feedback: shift of the target, rad
OFFSET = 6  # (3) bumpless offset, actuator units, fading
LAST_X = 9  # (9) newest finite x9
LAST_R = 18  # (3) newest finite r3
RUN = 21  # 1.0 once the controller has run
RELAXED = 22  # 1.0 while it rests on the ground, 2.0 while a pilot flies by hand
MEMORY = 23  # (MAX_ORDER) output feedback: its state x, then unused places
N_LAW_STATE = MEMORY + MAX_ORDER

SHIFT_LIMIT_RAD = 0.1
"""The offset-free target of state feedback is shifted by at most this, per axis."""


class AttitudeStatus(enum.IntEnum):
    """What `attitude_law` reports beside its output."""

    OK = 0
    SATURATED = 1
    NOT_FINITE = 2
    ON_GROUND = 3
    BY_HAND = 4

    @property
    def sentence(self) -> str:
        """The status in words."""
        return (
            "attitude is held",
            "an actuator is at its limit",
            "the estimate or the setpoint is not finite: the last good command is held",
            "on the ground: cyclic and pedal rest in trim",
            "flown by hand",
        )[int(self)]


@by_reference
class AttitudeParams(NamedTuple):
    """Numbers of an attitude controller; angles rad, rates rad/s, actuators in (-1, 1).

    Attributes
    ----------
    controller : int
        Kind of the controller (`CONTROLLERS`).
    F, H, G : (3, 9), (3, 3), (3, 3) arrays
        State feedback (of the state predicted over the known lag: F Phi of eq. (15)), feedback of
        the last command (F Gamma; zero without prediction) and feedforward of eq. (15), (17).
    x_trim, u_trim : (9,), (3,) arrays
        Trim of the nine states and of d_lat, d_lon, d_ped.
    limit : float
        Actuators stay within +-limit < 1.
    K_P, K_I, K_D : (3,) arrays
        PID gains of roll, pitch, yaw: 1/rad, 1/(rad s), s/rad.
    offset_decay : float
        Factor per tick by which the bumpless offset fades.
    shift_rate : float
        Rate at which a lasting error shifts the target of state feedback, rad/s; 0: eq. (17) as
        it stands.
    law : OutputLaw
        Matrices of output feedback; of order zero for the other kinds.
    rest : (n, 11) array
        `controller_state.rest_map` of it.
    ground_collective, ground_side : float
        Collectives beyond the first, on the side of the sign of the second, are those of standing.
    tick_s : float
        Between two steps of the controller, s.
    """

    controller: int
    F: np.ndarray
    H: np.ndarray
    G: np.ndarray
    x_trim: np.ndarray
    u_trim: np.ndarray
    limit: float
    K_P: np.ndarray
    K_I: np.ndarray
    K_D: np.ndarray
    offset_decay: float
    shift_rate: float
    law: OutputLaw
    rest: np.ndarray
    ground_collective: float
    ground_side: float
    tick_s: float


def initial_law_state(k: AttitudeParams) -> np.ndarray:
    """State (N_LAW_STATE,) of a controller that has flown its trim so far."""
    state = np.zeros(N_LAW_STATE)
    state[LAST_U : LAST_U + 3] = np.clip(k.u_trim, -k.limit, k.limit)
    state[LAST_X : LAST_X + 9] = k.x_trim
    state[LAST_R + SETPOINT.phi] = k.x_trim[NINE.phi]
    state[LAST_R + SETPOINT.theta] = k.x_trim[NINE.theta]
    state[LAST_R + SETPOINT.psi] = k.x_trim[NINE.psi]
    return state


@njit
def nine_states(nav, rotor, x9):
    """Nine states of eq. (10) of a navigation row and a row of rotor states, into x9 (9,)."""
    x9[NINE.phi], x9[NINE.theta], x9[NINE.psi] = euler_from_quat(nav[NAV.quat])
    x9[NINE.p], x9[NINE.q], x9[NINE.r] = nav[NAV.p], nav[NAV.q], nav[NAV.r]
    x9[NINE.a_s], x9[NINE.b_s] = rotor[ROTOR.a_s], rotor[ROTOR.b_s]
    x9[NINE.d_int] = rotor[ROTOR.d_int]


@njit
def save_state(x9, r3, state):
    """Keep what a controller has read, for whoever goes on from it."""
    copy_part(state, LAST_X, x9, 0, 9)
    copy_part(state, LAST_R, r3, 0, 3)


@njit
def all_finite(values):
    """Whether no element of the vector is NaN or inf."""
    for v in values:
        if not np.isfinite(v):
            return False
    return True


# -------------------------------------------------------------------------------------------------
# What lies between command and rotor, how the observer hears of it, and the prediction over it.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Actuation:
    """What lies between command and rotor.

    Attributes
    ----------
    servo_radps, servo_damping : float
        Natural frequency (rad/s) and damping of each servo.
    delay_s : float
        Transport delay from the computation within tick n, s (0.01: acts from tick n+1).
    tick_s : float
        Between two steps of the controller, s.
    """

    servo_radps: float = 38.0
    servo_damping: float = 0.51
    delay_s: float = TICK_S
    tick_s: float = TICK_S

    @property
    def known_lag_s(self) -> float:
        """Transport delay, half a tick of hold and the servo's low-frequency lag 2 zeta / w, s."""
        return self.delay_s + 0.5 * self.tick_s + 2.0 * self.servo_damping / self.servo_radps


@dataclass(frozen=True)
class ObserverInput:
    """How u enters the reduced-order observer.

    Attributes
    ----------
    u_delay_ticks : int
        Over [n, n+1] the observer uses the command u_(n - u_delay_ticks); 1 is true to a delay of
        one tick.
    servo_radps, servo_damping : float
        Servo model (exact ZOH) between that command and the observer; servo_radps = 0: none.
    tick_s : float
        Between two steps of the observer, s.
    """

    u_delay_ticks: int = 1
    servo_radps: float = 38.0
    servo_damping: float = 0.51
    tick_s: float = TICK_S

    @classmethod
    def from_parameters(cls, observer: Mapping[str, Any]) -> "ObserverInput":
        """That of the observer's parameters."""
        rate = Rate.of_parameters(observer)
        return cls(
            rate.of(int(observer["u_delay_ticks"])),
            observer["servo.frequency_radps"],
            observer["servo.damping"],
            rate.tick_s,
        )


def predicting_gains(A: Matrix, B: Matrix, F: Matrix, prediction_s: float) -> tuple[Matrix, Matrix]:
    """F Phi (3, 9) and F Gamma (3, 3) over `prediction_s`, with u held.

    The controller then is u_n = F Phi x_n + F Gamma u_(n-1). At rest Phi x + Gamma u = x, so that
    the feedforward G of eq. (15) stays as it is.
    """
    if prediction_s == 0.0:
        return F.copy(), np.zeros((F.shape[0], B.shape[1]))
    Phi, Gamma = held(A, B, prediction_s)
    return F @ Phi, F @ Gamma
