# SPDX-License-Identifier: Apache-2.0
"""What every attitude law shares: the kernel's numbers and the layout of its small state array."""

import enum
from typing import NamedTuple

import numpy as np

from heli_inner_hinf.output_law import MAX_ORDER, OutputLaw
from heli_math.arrays import copy_part
from heli_math.jit import njit
from heli_math.rotations import euler_from_quat
from heli_math.rows import NAV, NINE, ROTOR, SETPOINT

CONTROLLERS = {
    "hinf_output": 2,
    "hinf": 0,
    "lqg": 2,
    "lqr": 0,
    "pid": 1,
    "matrices": 2,
    "indi": 2,
}
"""Names in the YAML and the kind of law that each is."""

STATE_FEEDBACK, PID, OUTPUT_FEEDBACK = 0, 1, 2
"""Kinds of law, by which the kernel chooses."""

# Layout of the state array (N_LAW_STATE,): where a part begins.
LAST_U = 0  # (3) last output, -1..1
INTEGRAL = 3  # (3) PID: integrators, actuator units; state feedback: shift of the target, rad
OFFSET = 6  # (3) bumpless offset, actuator units, fading
LAST_X = 9  # (9) newest finite x9
LAST_R = 18  # (3) newest finite r3
RUN = 21  # 1.0 once the law has run
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


class AttitudeKernel(NamedTuple):
    """Numbers of an attitude law; angles rad, rates rad/s, actuators in (-1, 1).

    Attributes
    ----------
    controller : int
        Kind of the law (`CONTROLLERS`).
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
        `output_law.rest_map` of it.
    ground_collective, ground_side : float
        Collectives beyond the first, on the side of the sign of the second, are those of standing.
    tick_s : float
        Between two steps of the law, s.
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


def initial_law_state(k: AttitudeKernel) -> np.ndarray:
    """State (N_LAW_STATE,) of a law that has flown its trim so far."""
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
def remember(x9, r3, state):
    """Keep what a law has read, for whoever goes on from it."""
    copy_part(state, LAST_X, x9, 0, 9)
    copy_part(state, LAST_R, r3, 0, 3)


@njit
def all_finite(values):
    """Whether no element of the vector is NaN or inf."""
    for v in values:
        if not np.isfinite(v):
            return False
    return True
