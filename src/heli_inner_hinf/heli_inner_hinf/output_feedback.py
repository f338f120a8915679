# SPDX-License-Identifier: Apache-2.0
"""`controller: hinf_output`: discrete H-infinity output feedback with integral action.

The plant is the one that flies: the nine states of eq. (9), servos, transport delay, sampled at
its rate, and the integrals of phi, theta, psi (order 21 with a delay of one tick). Into it come the
wind (m/s), a load in every actuator's place that stands for all moments that the model lacks
(flap-back, another trim), and the noise of the six measurements; out of it h of eq. (11), which
C11, C22, D11 weigh as for `controller: hinf`, and the weighted integrals. The controller is the
central controller below `output.gamma` (`heli_core.central_controller`).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from heli_core.central_controller import (
    CentralController,
    GammaInfimum,
    GeneralisedPlant,
    NoControllerError,
    System,
    central_controller,
    optimal_gamma,
    to_continuous,
)
from heli_core.errors import CertificateError, InfeasibleGammaError, ShapeError
from heli_core.linear import held, with_servos
from heli_core.rows import ATTITUDE, MEASURED, NINE
from heli_core.ticks import TICK_S
from heli_inner_hinf.controller_state import INPUTS, N_V, Actuation, OutputLaw, output_law
from heli_inner_hinf.loops import flown_plant
from heli_inner_hinf.regular_form import N_H, N_U, N_X, Matrix
from heli_inner_hinf.synthesis import hinf_norm

# -------------------------------------------------------------------------------------------------
# Output feedback.
# -------------------------------------------------------------------------------------------------

_MOST_RESIDUAL = 1e-6
_RIDGE = 1e-10
"""Share of the trace that makes the energy of the controller's own states invertible."""
_UNWINDING_S = 0.2
"""Time constant with which an integrator gives way while an actuator is at its limit."""


class OutputWeights(NamedTuple):
    """What is added to C11, C22, D11.

    Attributes
    ----------
    effort : (3,) array
        Factors on the weights D11 of d_lat, d_lon, d_ped.
    integral : (3,) array
        Weights on the integrals of phi, theta, psi, 1/(rad s). Larger: a lasting error goes sooner.
    load : (3,) array
        Load in place of d_lat, d_lon, d_ped per m/s of wind; stands for moments that the model
        lacks. Larger: the controller trusts its model less.
    noise : (6,) array
        Noise of phi, theta, p, q, r, psi per m/s of wind, rad and rad/s. Larger: less is read into
        them.
    command_effort : float
        Further factor on D11 where a commanded attitude is followed. Smaller: faster; the feedback
        stays as it is.
    """

    effort: NDArray[np.float64]
    integral: NDArray[np.float64]
    load: NDArray[np.float64]
    noise: NDArray[np.float64]
    command_effort: float


@dataclass(frozen=True)
class OutputSynthesis:
    """A controller with its certificate.

    Attributes
    ----------
    law : OutputLaw
    controller : CentralController
        With rho(X Y) / gamma^2 and the residual of both Riccati equations.
    norm, norm_frequency : float
        ||(wind, load, noise) -> (h, integrals)||_inf of the sampled closed loop, and where (rad/s),
        by a Hamiltonian matrix of the closed loop alone.
    plant : GeneralisedPlant
    """

    law: OutputLaw
    controller: CentralController
    norm: float
    norm_frequency: float
    plant: GeneralisedPlant

    @property
    def gamma(self) -> float:
        """The bound."""
        return self.controller.gamma

    @cached_property
    def gamma_star(self) -> GammaInfimum:
        """gamma* and what ends feasibility there."""
        return optimal_gamma(self.plant, self.gamma)


def synthesize_output(
    A: Matrix,
    B: Matrix,
    E: Matrix,
    C: Matrix,
    D: Matrix,
    weights: OutputWeights,
    actuation: Actuation,
    gamma: float,
) -> OutputSynthesis:
    """The controller below gamma, accepted only with its certificate.

    Parameters
    ----------
    A, B, E : (9, 9), (9, 3), (9, 3) arrays
        Eq. (9), SI and rad.
    C, D : (9, 9), (9, 3) arrays
        Eq. (11), (12).
    weights : OutputWeights
    actuation : Actuation
    gamma : float
        Bound on the norm from (wind, load, noise) to (h, weighted integrals).

    Raises
    ------
    InfeasibleGammaError
        gamma is not above gamma*; with the number.
    CertificateError
        The closed loop is not stable, its norm not below gamma, or a residual too large.
    """
    plant = generalised_plant(A, B, E, C, D, weights, actuation)
    try:
        law, controller, closed = central_law(plant, weights, gamma, actuation.tick_s)
    except NoControllerError as exc:
        raise _refused(plant, gamma) from exc
    norm, at = hinf_norm(*to_continuous(closed))
    radius = float(np.max(np.abs(np.linalg.eigvals(closed.A))))
    if not (radius < 1.0 and norm < gamma and controller.residual < _MOST_RESIDUAL):
        raise CertificateError(
            f"output.gamma = {gamma:g}: the controller fails its certificate (largest eigenvalue "
            f"{radius:.6f}, norm {norm:.6g}, residual of the Riccati equations "
            f"{controller.residual:.1e})"
        )
    frequency = float(2.0 * np.arctan(0.5 * at) / actuation.tick_s)
    return OutputSynthesis(law, controller, norm, frequency, plant)


def central_law(
    plant: GeneralisedPlant, weights: OutputWeights, gamma: float, tick_s: float = TICK_S
) -> tuple[OutputLaw, CentralController, System]:
    """The controller below gamma, without its certificate; the controller; the closed loop.

    Raises
    ------
    NoControllerError
        gamma is not above gamma*.
    """
    controller = central_controller(plant, gamma)
    closed = _closed(plant, controller.system)
    cost = _command_cost(closed.C, weights)
    law = as_law(closed, controller.system, controller.input_of_u, cost, tick_s)
    return law, controller, closed


def generalised_plant(
    A: Matrix,
    B: Matrix,
    E: Matrix,
    C: Matrix,
    D: Matrix,
    weights: OutputWeights,
    actuation: Actuation,
) -> GeneralisedPlant:
    """(wind, load, noise, u) -> (h, weighted integrals, measurements), one step a tick.

    States: those of `flown_plant`, then the integrals of the measured phi, theta, psi.
    """
    Ad, Bd = flown_plant(A, B, actuation)
    n, n_y = Ad.shape[0], len(MEASURED)
    behind, _ = with_servos(A, B, actuation.servo_radps, actuation.servo_damping)
    acting = np.zeros((behind.shape[0], 2 * N_U))
    acting[:N_X] = np.hstack([E, B * weights.load])
    measured = np.eye(n)[list(MEASURED)]
    integrated = actuation.tick_s * np.eye(N_X)[np.ix_(ATTITUDE, MEASURED)]
    noise = np.diag(weights.noise)
    A_g = np.block([[Ad, np.zeros((n, N_U))], [integrated @ measured, np.eye(N_U)]])
    B_g = np.zeros((n + N_U, 2 * N_U + n_y + N_U))
    B_g[: behind.shape[0], : 2 * N_U] = held(behind, acting, actuation.tick_s)[1]
    B_g[n:, 2 * N_U : -N_U] = integrated @ noise
    B_g[:n, -N_U:] = Bd
    n_h = C.shape[0]
    C_g, D_g = np.zeros((n_h + N_U + n_y, n + N_U)), np.zeros((n_h + N_U + n_y, B_g.shape[1]))
    C_g[:n_h, :N_X], D_g[:n_h, -N_U:] = C, D * weights.effort
    C_g[n_h : n_h + N_U, n:] = np.diag(weights.integral)
    C_g[-n_y:, :n], D_g[-n_y:, 2 * N_U : -N_U] = measured, noise
    return GeneralisedPlant(System(A_g, B_g, C_g, D_g), N_U, n_y, N_U)


def _closed(plant: GeneralisedPlant, controller: System) -> System:
    """(wind, load, noise) -> (h, integrals) of the loop: states of plant, then of controller.

    The integrals of the plant are those that the controller forms: xi = S x, from xi+ - xi = R x.
    """
    A, B, C, D = plant.system
    n, n_z, n_w = A.shape[0] - N_U, C.shape[0] - plant.n_y, B.shape[1] - N_U
    B_u, C_y = B[:n, n_w:], C[n_z:, :n]
    D_z, D_w = D[:n_z, n_w:], D[n_z:, :n_w]
    K = controller
    A_c = np.block([[A[:n, :n] + B_u @ K.D @ C_y, B_u @ K.C], [K.B @ C_y, K.A]])
    B_c = np.vstack([B[:n, :n_w] + B_u @ K.D @ D_w, K.B @ D_w])
    C_c = np.hstack([C[:n_z, :n] + D_z @ K.D @ C_y, D_z @ K.C])
    growth = np.hstack([A[n:, :n], np.zeros((N_U, K.A.shape[0]))])
    S = np.linalg.solve((A_c - np.eye(A_c.shape[0])).T, growth.T).T
    return System(A_c, B_c, C_c + C[:n_z, n:] @ S, D_z @ K.D @ D_w)


def as_law(
    closed: System,
    controller: System,
    input_of_u: Matrix,
    cost: Matrix,
    tick_s: float = TICK_S,
) -> OutputLaw:
    """A controller from y to u with its commands and its conditioning against wind-up.

    A step of the commanded attitude shifts plant and controller alike, as every attitude is an
    equilibrium of eq. (9). M is the controller's state that goes best with a unit error: the least
    energy of `cost` from there. So the integrals are no reason for an overshoot. The cut-off part
    of a command moves the state as a Kalman filter would that hears the flown command: the observer
    inside as it is moved by u, the integrators within `_UNWINDING_S`.

    Parameters
    ----------
    closed : System
        The loop as flown: states of the plant, the nine first, then of the controller.
    controller : System
    input_of_u : (n, 3) array
        As in `CentralController`.
    cost : (k, n) array
        Of the loop's states, see above.
    tick_s : float
        Between two steps of the controller, s.
    """
    A, B, C, D = controller
    n = closed.A.shape[0] - A.shape[0]
    energy = solve_discrete_lyapunov(closed.A.T, cost.T @ cost)
    energy_of_states, across = energy[n:, n:], energy[n:, list(ATTITUDE)]
    M = -np.linalg.solve(
        energy_of_states + _RIDGE * np.trace(energy_of_states) * np.eye(A.shape[0]), across
    )
    select = np.eye(N_X)[np.ix_(MEASURED, ATTITUDE)]
    to_state, to_command = (np.eye(A.shape[0]) - A) @ M - B @ select, -C @ M - D @ select
    integrators = np.linalg.svd(A - np.eye(A.shape[0]))[2][-N_U:].T
    integrators = integrators @ np.linalg.inv(C @ integrators) * (tick_s / _UNWINDING_S)
    moved = np.hstack([input_of_u, integrators])
    spread = solve_discrete_are(A.T, C.T, moved @ moved.T, np.eye(N_U))
    L = np.linalg.solve(C @ spread @ C.T + np.eye(N_U), C @ spread @ A.T).T
    commands = slice(0, 2)
    return output_law(
        A,
        np.hstack([B, to_state[:, commands]]),
        C,
        np.hstack([D, to_command[:, commands]]),
        L,
        M[:, 2],
    )


def _command_cost(C: Matrix, weights: OutputWeights) -> Matrix:
    """The rows of h, those of the actuators with the effort that commands are worth."""
    cost = C[:N_H].copy()
    cost[:N_U] *= weights.command_effort
    return cost


def _refused(plant: GeneralisedPlant, gamma: float) -> InfeasibleGammaError | CertificateError:
    """Why there is no controller below gamma."""
    try:
        optimum = optimal_gamma(plant)
    except NoControllerError as exc:
        return CertificateError(f"no output feedback exists at any gamma: {exc}")
    return InfeasibleGammaError(gamma, optimum.value, "output.gamma")


# -------------------------------------------------------------------------------------------------
# `controller: lqg`: output feedback with integral action by LQR and Kalman filter.
#
# The yardstick beside `hinf_output`: the same plant as it flies and the same weights, with white
# noise of unit intensity in place of the worst case.
# -------------------------------------------------------------------------------------------------

"""Time constant with which the integrators give way while an actuator is at its limit."""


def lqg_law(plant: GeneralisedPlant, tick_s: float = TICK_S) -> OutputLaw:
    """The controller that is best on average for `output_feedback.generalised_plant`.

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

    uncorrected = np.eye(n) - M @ c
    y_sees = np.eye(N_X)[np.ix_(ATTITUDE, MEASURED)]
    integrate = A[n:, :n] @ c.T
    # the integrals take y as it was measured, of which x_estimated leaves a rest
    of_rest = np.linalg.solve(price, B_u.T @ P[:, n:]) @ integrate @ (np.eye(plant.n_y) - c @ M)
    shift = np.zeros((n + n_i, N_U))
    shift[ATTITUDE, range(N_U)] = 1.0
    shift[n:] = -np.linalg.solve(P[n:, n:], P[n:, list(ATTITUDE)])
    C_k = np.hstack([of_rest @ c - K_x @ uncorrected, -K_i])
    D_y = -of_rest - K_x @ M
    L = np.vstack([b, -np.linalg.inv(K_i) / (_UNWINDING_S / tick_s)])
    free = np.block([[a @ uncorrected, np.zeros((n, n_i))], [np.zeros((n_i, n)), np.eye(n_i)]])
    hears = np.vstack([a @ M, integrate])
    input_to_state = np.vstack([b, np.zeros((n_i, N_U))])
    A_k, B_y = free + input_to_state @ C_k, hears + input_to_state @ D_y
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


# -------------------------------------------------------------------------------------------------
# `controller: indi`: incremental dynamic inversion of the body rates, as a controller of
# `output_law`.
#
# What the aircraft does is measured instead of modelled, as in Smeur, Chu, de Croon (Journal of
# Guidance, Control, and Dynamics 39(3), 2016): what is wanted is compared with what is measured
# behind a low-pass filter, and the difference, divided by the control's effectiveness, is added to
# the actuators' positions, which a model of delay and servos behind the same filter gives.
#
# With its stiff hub and yaw gyro this aircraft turns at a rate for a command (the disc, or the
# gyro,
# stands where the moments balance), so that rates are inverted here, and not angular
# accelerations,
# whose path to p, q goes through the lightly damped flapping. The acceleration and the unfiltered
# rate only damp that mode. The increment integrates: a lasting moment leaves no error.
# -------------------------------------------------------------------------------------------------

_DAMPING = 0.7
"""Of the low-pass filters."""
_RATES = [INPUTS.index(name) for name in ("p", "q", "r")]
_ANGLES = [INPUTS.index(name) for name in ("phi", "theta", "psi_error")]
_COMMANDS = [INPUTS.index(name) for name in ("phi_ref", "theta_ref")]


class IndiGains(NamedTuple):
    """Tuning of the controller, each (3,) for roll, pitch, yaw.

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
    A_inside = A[np.ix_(inside, inside)]
    if np.linalg.matrix_rank(A_inside) < len(inside):
        raise ShapeError("model.A", "model.A has no lasting rates of a lasting command to invert")
    G = -np.linalg.solve(A_inside, B[inside])[[inside.index(i) for i in (NINE.p, NINE.q, NINE.r)]]
    if np.linalg.matrix_rank(G) < N_U:
        raise ShapeError("model.B", "model.B gives no control over all three rates to invert")
    return np.asarray(G)


def indi_law(A: Matrix, B: Matrix, gains: IndiGains, actuation: Actuation) -> OutputLaw:
    """The controller for A (9, 9), B (9, 3) of eq. (9).

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
    A_open = np.block([[A_y, np.zeros((n_y, n_u))], [np.zeros((n_u, n_y)), A_u]])
    hears = np.vstack([B_y @ measured, np.zeros((n_u, N_V))])
    return output_law(A_open + L @ C, hears + L @ D, C, D, L)
