# SPDX-License-Identifier: Apache-2.0
"""`controller: indi`: incremental dynamic inversion of the body rates, as a law of `output_law`.

What the aircraft does is measured instead of modelled, as in Smeur, Chu, de Croon (Journal of
Guidance, Control, and Dynamics 39(3), 2016): what is wanted is compared with what is measured
behind a low-pass filter, and the difference, divided by the control's effectiveness, is added to
the actuators' positions, which a model of delay and servos behind the same filter gives.

With its stiff hub and yaw gyro this aircraft turns at a rate for a command (the disc, or the gyro,
stands where the moments balance), so that rates are inverted here, and not angular accelerations,
whose path to p, q goes through the lightly damped flapping. The acceleration and the unfiltered
rate only damp that mode. The increment integrates: a lasting moment leaves no error.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_inner_hinf.actuation import Actuation
from heli_inner_hinf.as_flown import flown_plant
from heli_inner_hinf.errors import ShapeError
from heli_inner_hinf.output_law import INPUTS, N_U, N_V, OutputLaw, output_law
from heli_inner_hinf.regular_form import Matrix
from heli_math.linear_systems import held
from heli_math.rows import NINE
from heli_math.state_names import ATTITUDE

_DAMPING = 0.7
"""Of the low-pass filters."""
_RATES = [INPUTS.index(name) for name in ("p", "q", "r")]
_ANGLES = [INPUTS.index(name) for name in ("phi", "theta", "psi_error")]
_COMMANDS = [INPUTS.index(name) for name in ("phi_ref", "theta_ref")]


class IndiGains(NamedTuple):
    """Tuning of the law, each (3,) for roll, pitch, yaw.

    Attributes
    ----------
    angle : array
        Wanted rate per error of the angle, 1/s.
    rate : array
        Share of the rate that is compared unfiltered, 0 to 1.
    acceleration : array
        Rate that counts as much as an angular acceleration, s.
    filter_radps : array
        Natural frequency of the low-pass filter, rad/s.
    """

    angle: NDArray[np.float64]
    rate: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    filter_radps: NDArray[np.float64]


def effectiveness(A: Matrix, B: Matrix) -> Matrix:
    """G (3, 3), rad/s: the lasting p, q, r of a lasting d_lat, d_lon, d_ped, at any attitude.

    Raises
    ------
    ShapeError
        There is none, or it cannot be inverted.
    """
    inside = [i for i in range(A.shape[0]) if i not in ATTITUDE]
    own = A[np.ix_(inside, inside)]
    if np.linalg.matrix_rank(own) < len(inside):
        raise ShapeError("model.A", "model.A has no lasting rates of a lasting command to invert")
    G = -np.linalg.solve(own, B[inside])[[inside.index(i) for i in (NINE.p, NINE.q, NINE.r)]]
    if np.linalg.matrix_rank(G) < N_U:
        raise ShapeError("model.B", "model.B gives no control over all three rates to invert")
    return np.asarray(G)


def indi_law(A: Matrix, B: Matrix, gains: IndiGains, actuation: Actuation) -> OutputLaw:
    """The law for A (9, 9), B (9, 3) of eq. (9).

    u = G^-1 (wanted rate - measured one) + position, the last two behind the filter. States: the
    filtered rates and their derivatives, the filtered positions of the actuators and their
    derivatives, the servos' positions and rates, the commands on their way.

    Raises
    ------
    ShapeError
        The control's effectiveness cannot be inverted.
    """
    G = effectiveness(A, B)
    W = np.diag(gains.filter_radps)
    eye, none = np.eye(N_U), np.zeros((N_U, N_U))
    low_pass = np.block([[none, eye], [-(W**2), -2.0 * _DAMPING * W]])
    enters = np.vstack([none, W**2])
    A_y, B_y = held(low_pass, enters, actuation.tick_s)
    A_u, B_u = flown_plant(low_pass, enters, actuation)
    n_y, n_u = A_y.shape[0], A_u.shape[0]

    measured, angles, commands = np.eye(N_V)[_RATES], np.eye(N_V)[_ANGLES], np.zeros((N_U, N_V))
    commands[: len(_COMMANDS)] = np.eye(N_V)[_COMMANDS]
    share = np.diag(gains.rate)
    D = np.linalg.solve(G, np.diag(gains.angle) @ (commands - angles) - share @ measured)
    filtered = np.hstack([eye - share, np.diag(gains.acceleration)])
    C = np.hstack([-np.linalg.solve(G, filtered), np.eye(N_U, n_u)])
    L = np.vstack([np.zeros((n_y, N_U)), B_u])
    own = np.block([[A_y, np.zeros((n_y, n_u))], [np.zeros((n_u, n_y)), A_u]])
    hears = np.vstack([B_y @ measured, np.zeros((n_u, N_V))])
    return output_law(own + L @ C, hears + L @ D, C, D, L)
