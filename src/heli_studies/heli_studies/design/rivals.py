# SPDX-License-Identifier: Apache-2.0
"""The mu law: output feedback for every aircraft of a set, by D-K iteration.

The set, about the loop as flown: K_beta over inertia of roll and of pitch, the flapping's rate, the
whole of yaw, each as a share of itself; at each servo a relative error that grows with frequency,
as more delay or another servo has. All of them are taken for complex numbers of modulus up to one,
which is more than the real parameters can do. The performance: wind, loads in the actuators'
places and noise come in, attitude errors (with their integrals, nearly) and commands go out.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from heli_inner_hinf.actuation import Actuation
from heli_inner_hinf.as_flown import flown_plant
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.output_feedback import as_law
from heli_inner_hinf.output_law import MAX_ORDER, OutputLaw
from heli_inner_hinf.regular_form import Matrix
from heli_inner_hinf.weights import N_H, N_U, N_X
from heli_math.central_controller import GeneralisedPlant, System, to_sampled
from heli_math.linear_systems import held, with_servos
from heli_math.rows import NINE
from heli_math.state_names import ATTITUDE, MEASURED
from heli_math.ticks import TICK_S
from heli_robust.errors import Cause, RobustError
from heli_robust.reduction import balancing, truncated
from heli_robust.scaled_mu import scaled_mu
from heli_robust.synthesis import closed_loop, dk_iteration, response

N_Y = len(MEASURED)
N_PARAMETERS = 5
_YAW = N_PARAMETERS - 1
SCALARS = N_PARAMETERS + N_U
_FLAPPING = (
    (NINE.p, NINE.b_s),
    (NINE.q, NINE.a_s),
)


@dataclass(frozen=True)
class MuWeights:
    """The set and the performance.

    Attributes
    ----------
    stiffness, flapping, yaw : float
        Share of K_beta / inertia, of the flapping's rate, of yaw's row, that is not known.
    input_low, input_high : float
        Relative error at each servo, slow and fast.
    input_s : float
        The error is 1 at about 1 / input_s, rad/s: delay that is not known.
    wind_mps : float
        Wind of modulus one.
    load : float
        Load in the place of each actuator.
    noise : tuple of 6 float
        phi, theta, p, q, r, psi, rad and rad/s.
    attitude : tuple of 3 float
        phi, theta, psi, 1/rad: an error of its inverse is as bad as can be borne.
    integral_radps : float
        Below it the weight of the attitude rises as that of an integral.
    command : tuple of 3 float
        d_lat, d_lon, d_ped.
    """

    stiffness: float = 0.4
    flapping: float = 0.3
    yaw: float = 0.3
    input_low: float = 0.2
    input_high: float = 1.5
    input_s: float = 0.02
    wind_mps: float = 3.0
    load: float = 0.1
    noise: tuple[float, ...] = (0.01, 0.01, 0.1, 0.1, 0.05, 0.01)
    attitude: tuple[float, ...] = (10.0, 10.0, 5.0)
    integral_radps: float = 2.0
    command: tuple[float, ...] = (2.0, 2.0, 2.0)


_ANGLES = np.geomspace(1e-4, 3.0, 60)
"""Where mu is looked at: 0.01 to 300 rad/s."""
_MOST_LOSS = 0.01
"""By this share at most mu may grow when the law is reduced."""
_FORGETTING_RADPS = 0.002
"""The integrals forget so slowly: a lasting error is reduced to a thousandth, not to nothing."""


class MuDesign(NamedTuple):
    """The law with what is proved of it.

    Attributes
    ----------
    law : OutputLaw
    peaks : tuple of float
        Largest bound of mu, round by round of the D-K iteration.
    full_order : int
        Of the law before it was reduced.
    mu : float
        Of the reduced law: performance and set are kept to 1 / mu of their sizes.
    mu_stability : float
        Of the reduced law for the set alone: every member up to 1 / mu_stability of it is stable.
    """

    law: OutputLaw
    peaks: tuple[float, ...]
    full_order: int
    mu: float
    mu_stability: float


def mu_design(config: AttitudeConfig, weights: MuWeights) -> MuDesign:
    """The reduced law of an aircraft's attitude loop.

    Raises
    ------
    RobustError
        NOT_CONVERGED: no law for the nominal aircraft, or none that may be reduced.
    """
    plant = mu_plant(config.A, config.B, config.E, config.actuation, weights)
    found = dk_iteration(plant, (1,) * SCALARS, _ANGLES)
    full = found.controller.system
    _, W, V = balancing(full)

    def answer(order: int) -> np.ndarray | None:
        """Response of the closed loop with the law of an order, if it is stable."""
        closed = closed_loop(plant, truncated(full, W, V, order))
        stable = np.max(np.abs(np.linalg.eigvals(closed.A))) < 1.0
        return response(closed, _ANGLES) if stable else None

    order, mu, M = full.A.shape[0], found.peak, answer(full.A.shape[0])
    while order > 1 and (less := answer(order - 1)) is not None:
        peak = float(np.max(scaled_mu(less, SCALARS)[0]))
        if peak > (1.0 + _MOST_LOSS) * found.peak:
            break
        order, mu, M = order - 1, peak, less
    if M is None or order > MAX_ORDER:
        raise RobustError(
            Cause.NOT_CONVERGED,
            f"D-K iteration: a law of {MAX_ORDER} states, the most that fly, loses more than "
            f"{_MOST_LOSS:.0%} of mu = {found.peak:.3g}",
        )
    stability = float(np.max(scaled_mu(M[:, :SCALARS, :SCALARS], SCALARS)[0]))
    small = truncated(full, W, V, order)
    closed = _flown(config, small)
    law = as_law(closed, small, W[:order] @ found.controller.input_of_u, closed.C)
    return MuDesign(law, found.peaks, full.A.shape[0], mu, stability)


def _flown(config: AttitudeConfig, law: System) -> System:
    """u -> h of the loop as flown: states of the plant, then of the law; h of eq. (11)."""
    A, B = flown_plant(config.A, config.B, config.actuation)
    y = np.eye(A.shape[0])[list(MEASURED)]
    h = np.hstack([config.C, np.zeros((N_H, A.shape[0] - N_X))])
    return System(
        np.block([[A + B @ law.D @ y, B @ law.C], [law.B @ y, law.A]]),
        np.vstack([B, np.zeros((law.A.shape[0], N_U))]),
        np.hstack([h + config.D @ law.D @ y, config.D @ law.C]),
        config.D,
    )


def mu_plant(
    A: Matrix, B: Matrix, E: Matrix, actuation: Actuation, weights: MuWeights
) -> GeneralisedPlant:
    """The plant for `dk_iteration`; its first `SCALARS` z and w belong to the set.

    States: those of `flown_plant`, then three of the servos' error and three of the integrals.

    Parameters
    ----------
    A, B, E : (9, 9), (9, 3), (9, 3) arrays
        Eq. (9), SI and rad.
    """
    Ad, Bu = flown_plant(A, B, actuation)
    size, n = Ad.shape[0], N_X + 2 * N_U
    into, out = _parameters(A, B, weights)
    servo = with_servos(A, B, actuation.servo_radps, actuation.servo_damping)[0]
    wind = np.vstack([weights.wind_mps * E, np.zeros((2 * N_U, N_U))])
    through = np.zeros((size, into.shape[1] + N_U))
    through[:n] = held(servo, np.hstack([into, wind]), TICK_S)[1]
    at_output, at_attitude = np.eye(size)[list(MEASURED)], np.eye(size)[list(ATTITUDE)]
    attitude_of_y = np.eye(N_X)[np.ix_(ATTITUDE, MEASURED)]
    noise = np.diag(weights.noise)

    rise = weights.input_high / weights.input_s
    error = _lag(rise, (weights.input_low - weights.input_high) * rise, weights.input_high)
    slow = weights.integral_radps - _FORGETTING_RADPS
    integral = _lag(_FORGETTING_RADPS, slow, 1.0)
    weigh = np.diag(weights.attitude)
    integral = integral._replace(C=weigh @ integral.C, D=weigh @ integral.D)

    k = N_PARAMETERS
    states = {"plant": size, "error": N_U, "integral": N_U}
    inputs = {"parameter": k, "servo": N_U, "wind": N_U, "load": N_U, "noise": N_Y,
              "u": N_U}  # fmt: skip
    outputs = {"parameter": k, "servo": N_U, "attitude": N_U, "command": N_U,
               "y": N_Y}  # fmt: skip
    x, w, z = _places(states), _places(inputs), _places(outputs)
    a, b = np.zeros((size + 2 * N_U,) * 2), np.zeros((size + 2 * N_U, sum(inputs.values())))
    c = np.zeros((sum(outputs.values()), a.shape[0]))
    d = np.zeros((c.shape[0], b.shape[1]))
    a[x["plant"], x["plant"]], a[x["error"], x["error"]] = Ad, error.A
    a[x["integral"], x["integral"]] = integral.A
    a[x["integral"], x["plant"]] = integral.B @ at_attitude
    b[x["plant"], w["parameter"]], b[x["plant"], w["wind"]] = through[:, :k], through[:, k:]
    b[x["plant"], w["servo"]], b[x["plant"], w["u"]] = Bu, Bu
    b[x["plant"], w["load"]] = weights.load * Bu
    b[x["error"], w["u"]] = error.B
    c[z["parameter"], : out.shape[1]] = out
    c[z["servo"], x["error"]], d[z["servo"], w["u"]] = error.C, error.D
    c[z["attitude"], x["integral"]] = integral.C
    c[z["attitude"], x["plant"]] = integral.D @ at_attitude
    d[z["command"], w["u"]] = np.diag(weights.command)
    c[z["y"], x["plant"]] = at_output
    b[x["integral"], w["noise"]] = integral.B @ attitude_of_y @ noise
    d[z["attitude"], w["noise"]] = integral.D @ attitude_of_y @ noise
    d[z["y"], w["noise"]] = noise
    return GeneralisedPlant(System(a, b, c, d), N_U, N_Y)


def _parameters(A: Matrix, B: Matrix, weights: MuWeights) -> tuple[Matrix, Matrix]:
    """Where the parameters' errors enter x' (15, 5), and what they are a share of (5, 15)."""
    into, out = np.zeros((N_X + 2 * N_U, N_PARAMETERS)), np.zeros((N_PARAMETERS, N_X + 2 * N_U))
    rows = np.hstack([A, B])
    for i, (rate, flap) in enumerate(_FLAPPING):
        into[rate, i] = into[flap, 2 + i] = 1.0
        out[i, flap] = weights.stiffness * A[rate, flap]
        own = rows[flap].copy()
        own[[NINE.p, NINE.q]] = 0.0
        out[2 + i, : N_X + N_U] = weights.flapping * own
    into[NINE.r, _YAW] = 1.0
    out[_YAW, : N_X + N_U] = weights.yaw * rows[NINE.r]
    return into, out


def _lag(pole_radps: float, slow: float, direct: float) -> System:
    """Three of slow / (s + pole) + direct, one step a tick by the bilinear map."""
    eye = np.eye(N_U)
    return to_sampled(System(-pole_radps * TICK_S * eye, eye, slow * TICK_S * eye, direct * eye))


def _places(sizes: dict[str, int]) -> dict[str, slice]:
    ends = np.cumsum([0, *sizes.values()])
    return {name: slice(int(ends[i]), int(ends[i + 1])) for i, name in enumerate(sizes)}
