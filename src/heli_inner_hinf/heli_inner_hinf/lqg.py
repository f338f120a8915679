# SPDX-License-Identifier: Apache-2.0
"""`controller: lqg`: output feedback with integral action by LQR and Kalman filter.

The yardstick beside `hinf_output`: the same plant as it flies and the same weights, with white
noise of unit intensity in place of the worst case.
"""

import numpy as np
from scipy.linalg import solve_discrete_are

from heli_inner_hinf.output_law import N_U, OutputLaw, output_law
from heli_inner_hinf.regular_form import Matrix
from heli_inner_hinf.weights import N_X
from heli_math.central_controller import GeneralisedPlant
from heli_math.state_names import ATTITUDE, MEASURED
from heli_math.ticks import TICK_S

_UNWINDING_S = 0.2
"""Time constant with which the integrators give way while an actuator is at its limit."""


def lqg_law(plant: GeneralisedPlant, tick_s: float = TICK_S) -> OutputLaw:
    """The law that is best on average for `output_feedback.generalised_plant`.

    States: the predicted state of the plant, then the integrals of phi, theta, psi. What is cut off
    a command reaches the prediction as the plant hears it. A new command shifts the state by a unit
    of that angle, which is an equilibrium of eq. (9), and the integrals by what costs least from
    there, so that they are no reason for an overshoot.
    """
    A, B, C, D = plant.system
    n, n_w, n_z, n_i = A.shape[0] - N_U, B.shape[1] - N_U, C.shape[0] - plant.n_y, N_U
    B_u, C_z, D_z = B[:, n_w:], C[:n_z], D[:n_z, n_w:]
    P = solve_discrete_are(A, B_u, C_z.T @ C_z, D_z.T @ D_z, s=C_z.T @ D_z)
    price = D_z.T @ D_z + B_u.T @ P @ B_u
    K = np.linalg.solve(price, B_u.T @ P @ A + D_z.T @ C_z)
    K_x, K_i = K[:, :n], K[:, n:]
    a, b, c = A[:n, :n], B_u[:n], C[n_z:, :n]
    M = kalman_gain(a, B[:n, :n_w], c, D[n_z:, :n_w])

    seen = np.eye(n) - M @ c
    y_sees = np.eye(N_X)[np.ix_(ATTITUDE, MEASURED)]
    integrate = A[n:, :n] @ c.T
    # the integrals take y as it was measured, of which x_estimated leaves a rest
    of_rest = np.linalg.solve(price, B_u.T @ P[:, n:]) @ integrate @ (np.eye(plant.n_y) - c @ M)
    shift = np.zeros((n + n_i, N_U))
    shift[ATTITUDE, range(N_U)] = 1.0
    shift[n:] = -np.linalg.solve(P[n:, n:], P[n:, list(ATTITUDE)])
    C_k = np.hstack([of_rest @ c - K_x @ seen, -K_i])
    D_y = -of_rest - K_x @ M
    L = np.vstack([b, -np.linalg.inv(K_i) / (_UNWINDING_S / tick_s)])
    free = np.block([[a @ seen, np.zeros((n, n_i))], [np.zeros((n_i, n)), np.eye(n_i)]])
    hears = np.vstack([a @ M, integrate])
    told = np.vstack([b, np.zeros((n_i, N_U))])
    A_k, B_y = free + told @ C_k, hears + told @ D_y
    # u and the next state do not change when y, the command and the state shift together
    B_r = (np.eye(n + n_i) - A_k) @ shift - B_y @ y_sees.T
    D_r = -C_k @ shift - D_y @ y_sees.T
    commands = slice(0, 2)
    return output_law(
        A_k,
        np.hstack([B_y, B_r[:, commands]]),
        C_k,
        np.hstack([D_y, D_r[:, commands]]),
        L,
        shift[:, 2],
    )


def kalman_gain(A: Matrix, B_w: Matrix, C: Matrix, D_w: Matrix) -> Matrix:
    """M of x = x_predicted + M (y - C x_predicted), for white w of unit intensity; no w in both."""
    spread = solve_discrete_are(A.T, C.T, B_w @ B_w.T, D_w @ D_w.T)
    return spread @ C.T @ np.linalg.inv(C @ spread @ C.T + D_w @ D_w.T)
