# SPDX-License-Identifier: Apache-2.0
"""The attitude controllers that others are compared with, as families of the same search.

Their numbers are parameters of the inner loop, so that whoever chooses a controller flies what the
search found for it; only those of LQR, whose weights there are H-infinity's, stand in the
controllers `lqr`. PID and INDI are not held to the floors at the corners of the set: kept to these
they fly worse than without, and no baseline is detuned. Nor is their heading searched for: the cost
weighs it little, and the search would give it away.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.central_controller import GeneralisedPlant, System, to_sampled
from heli_core.errors import RobustCause, RobustError
from heli_core.linear import held, with_servos
from heli_core.rows import ATTITUDE, MEASURED, NINE
from heli_core.search import STRIDES
from heli_core.ticks import TICK_S
from heli_inner_hinf.controller_state import MAX_ORDER, Actuation, ObserverInput, OutputLaw
from heli_inner_hinf.design import AttitudeConfig, added_weights
from heli_inner_hinf.loops import N_Y, N_Z, Model, as_output_law, flown_plant, pid_as_output_law
from heli_inner_hinf.mu import scaled_mu
from heli_inner_hinf.output_feedback import IndiGains, as_law, generalised_plant, indi_law, lqg_law
from heli_inner_hinf.regular_form import N_H, N_U, N_X, Matrix, output_selector, weights
from heli_inner_hinf.robust.mu_synthesis import closed_loop, dk_iteration, response
from heli_inner_hinf.robust.uncertain import balancing, truncated
from heli_inner_hinf.synthesis import lqr
from heli_inner_hinf.tuning import LawBenchmark, LawFamily

# -------------------------------------------------------------------------------------------------
# Rivals.
# -------------------------------------------------------------------------------------------------

_PID = ("pid.K_P", "pid.K_I", "pid.K_D")
_INDI = tuple(f"indi.{gain}" for gain in IndiGains._fields)
_LQG = ("lqg.effort", "lqg.integral", "lqg.load", "lqg.noise")
_LQR = ("C11", "C22", "D11", "offset_free_radps")
KEYS = {"pid": _PID, "indi": _INDI, "lqg": _LQG, "lqr": _LQR}
"""By controller, and control preset, the parameters of the inner loop that the search chooses."""
KEPT = -1
PID_FLOOR = 0.45
"""Disk margin that the PID keeps: with that of the others it would be slower than by its rule."""


class _Shape(NamedTuple):
    """How a controller's parameters are made of positive numbers.

    By parameter: which number each of its values is (`KEPT`: none, it stays), its sign, and what
    stands there now.
    """

    places: Mapping[str, NDArray[np.int64]]
    signs: Mapping[str, NDArray[np.float64]]
    now: Mapping[str, NDArray[np.float64]]

    def parameters(self, numbers: Sequence[float]) -> dict[str, NDArray[np.float64]]:
        """The parameters that are these numbers; arrays are flat."""
        n = np.asarray(numbers, float)
        return {
            key: np.where(places == KEPT, self.now[key], self.signs[key] * n[places])
            for key, places in self.places.items()
        }

    def numbers(self) -> tuple[float, ...]:
        """The numbers that the parameters are now."""
        by_place = {
            place: abs(float(value))
            for key, places in self.places.items()
            for place, value in zip(places, self.now[key], strict=True)
            if place != KEPT
        }
        return tuple(by_place[place] for place in sorted(by_place))


def _shape(controller: str, inner: Mapping[str, Any]) -> _Shape:
    """Of PID and INDI roll and pitch; of LQG all, roll and pitch with one noise.

    Of LQR the diagonals but the first weight on an actuator, to which the others are relative.
    """
    keys = KEYS[controller]
    now = {key: np.asarray(inner[key], float).ravel() for key in keys}
    signs = {key: np.where(values < 0.0, -1.0, 1.0) for key, values in now.items()}
    if controller == "lqr":
        return _Shape(_lqr_places(), signs, now)
    places = {}
    for i, key in enumerate(keys):
        if controller != "lqg":
            within = [2 * i, 2 * i + 1, KEPT]
        elif key == "lqg.noise":
            within = [3 * i, 3 * i, 3 * i + 1, 3 * i + 1, 3 * i + 2, 3 * i + 3]
        else:
            within = [3 * i, 3 * i + 1, 3 * i + 2]
        places[key] = np.array(within)
    return _Shape(places, signs, now)


def _lqr_places() -> dict[str, NDArray[np.int64]]:
    """Nine numbers: phi, theta, p, q of C11, r, psi of C22, d_lon, d_ped of D11, the shift."""
    C11, C22, D11 = np.full((4, 4), KEPT), np.full((2, 5), KEPT), np.full((3, 3), KEPT)
    C11[range(4), range(4)] = range(4)
    np.put(C22, [2, 9], [4, 5])
    D11[1, 1], D11[2, 2] = 6, 7
    flat = (C11.ravel(), C22.ravel(), D11.ravel(), np.array([8]))
    return dict(zip(_LQR, flat, strict=True))


def _maker(
    config: AttitudeConfig, controller: str, observer: Mapping[str, Any]
) -> Callable[[Mapping[str, Any]], OutputLaw]:
    """The controller of the controller's parameters."""
    if controller == "pid":
        return lambda p: pid_as_output_law(*(p[key] for key in _PID))
    if controller == "indi":
        return lambda p: indi_law(
            config.A, config.B, IndiGains(*(p[key] for key in _INDI)), config.actuation
        )
    if controller == "lqr":
        return lambda p: _lqr_law(config, p, observer)
    model = config.A, config.B, config.E, config.C, config.D
    return lambda p: lqg_law(generalised_plant(*model, added_weights(p, "lqg"), config.actuation))


def _lqr_law(
    config: AttitudeConfig, p: Mapping[str, Any], observer: Mapping[str, Any]
) -> OutputLaw:
    """LQR of C11, C22, D11 with its offset-free target, behind the prediction and observer (19)."""
    shapes = {"C11": (4, 4), "C22": (2, 5), "D11": (3, 3)}
    C, D = weights(*(np.reshape(p[key], shape) for key, shape in shapes.items()))
    gains = lqr(config.A, config.B, config.E, C, D, output_selector())
    shift_rate = float(p["offset_free_radps"][0])
    model = Model(config.A, config.B, config.E, C, D, gains.F, gains.G, shift_rate)
    K = np.reshape(observer["K"], (N_Z, N_Y))
    return as_output_law(model, K, config.prediction_s, ObserverInput.from_parameters(observer))


def family(controller: str, nodes: Mapping[str, Mapping[str, Any]]) -> LawFamily:
    """The family of one of `KEYS` about the parameters of inner loop and observer."""
    inner = nodes["inner_loop"]
    config = AttitudeConfig.from_parameters({**inner, "controller": "pid"})
    shape, make = _shape(controller, inner), _maker(config, controller, nodes["observer"])
    return LawFamily(
        controller, lambda numbers: make(shape.parameters(numbers)), (shape.numbers(),)
    )


def measure_of(controller: str, common: LawBenchmark) -> LawBenchmark:
    """What one of `KEYS` is measured by.

    PID and INDI: the nominal aircraft, and the one that flaps back; the PID with its own floor.
    """
    if controller in ("lqg", "lqr"):
        return common
    flaps_back, wanted = common.others[0], common.wanted
    if controller == "pid":
        flaps_back = replace(flaps_back, disk_margin=PID_FLOOR)
        wanted = wanted._replace(disk_margin=PID_FLOOR)
    return replace(common, others=(flaps_back,), wanted=wanted)


def chosen(
    controller: str,
    nodes: Mapping[str, Mapping[str, Any]],
    common: LawBenchmark,
    strides: Sequence[int] = STRIDES,
    pairs: bool = True,
) -> dict[str, NDArray[np.float64]]:
    """Parameters, flat, that the search chooses for one of `KEYS`, from the present ones on.

    Parameters
    ----------
    controller : str
    nodes : mapping
        Parameters of inner loop and observer as the controllers of the controller's name fly them.
    common : Yardstick
        What all controllers are measured by.
    strides, pairs
        As of `heli_core.search.search`.

    Raises
    ------
    NoLawError
        No controller of the family keeps the floors.
    """
    optimum = measure_of(controller, common).best(family(controller, nodes), strides, pairs)
    return _shape(controller, nodes["inner_loop"]).parameters(optimum)


# -------------------------------------------------------------------------------------------------
# The mu controller: output feedback for every aircraft of a set, by D-K iteration.
#
# The set, about the loop as flown: K_beta over inertia of roll and of pitch, the flapping's rate,
# the
# whole of yaw, each as a share of itself; at each servo a relative error that grows with
# frequency,
# as more delay or another servo has. All of them are taken for complex numbers of modulus up to
# one,
# which is more than the real parameters can do. The performance: wind, loads in the actuators'
# places and noise come in, attitude errors (with their integrals, nearly) and commands go out.
# -------------------------------------------------------------------------------------------------

MU_N_Y = len(MEASURED)
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
        Load in place of each actuator.
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
"""By this share at most mu may grow when the controller is reduced."""
_FORGETTING_RADPS = 0.002
"""The integrals forget so slowly: a lasting error is reduced to a thousandth, not to nothing."""


class MuDesign(NamedTuple):
    """The controller with what is proved of it.

    Attributes
    ----------
    law : OutputLaw
    peaks : tuple of float
        Largest bound of mu, round by round of the D-K iteration.
    full_order : int
        Of the controller before it was reduced.
    mu : float
        Of the reduced controller: performance and set are kept to 1 / mu of their sizes.
    mu_stability : float
        Of the reduced controller for the set alone: every member up to 1 / mu_stability of it is
        stable.
    """

    law: OutputLaw
    peaks: tuple[float, ...]
    full_order: int
    mu: float
    mu_stability: float


def mu_design(config: AttitudeConfig, weights: MuWeights) -> MuDesign:
    """The reduced controller of an aircraft's attitude loop.

    Raises
    ------
    RobustError
        NOT_CONVERGED: no controller for the nominal aircraft, or none that may be reduced.
    """
    plant = mu_plant(config.A, config.B, config.E, config.actuation, weights)
    synthesis = dk_iteration(plant, (1,) * SCALARS, _ANGLES)
    full = synthesis.controller.system
    _, W, V = balancing(full)

    def answer(order: int) -> np.ndarray | None:
        """Response of the closed loop with the controller of an order, if it is stable."""
        closed = closed_loop(plant, truncated(full, W, V, order))
        stable = np.max(np.abs(np.linalg.eigvals(closed.A))) < 1.0
        return response(closed, _ANGLES) if stable else None

    order, mu, M = full.A.shape[0], synthesis.peak, answer(full.A.shape[0])
    while order > 1 and (less := answer(order - 1)) is not None:
        peak = float(np.max(scaled_mu(less, SCALARS)[0]))
        if peak > (1.0 + _MOST_LOSS) * synthesis.peak:
            break
        order, mu, M = order - 1, peak, less
    if M is None or order > MAX_ORDER:
        raise RobustError(
            RobustCause.NOT_CONVERGED,
            f"D-K iteration: a controller of {MAX_ORDER} states, the most allowed, loses more than "
            f"{_MOST_LOSS:.0%} of mu = {synthesis.peak:.3g}",
        )
    stability = float(np.max(scaled_mu(M[:, :SCALARS, :SCALARS], SCALARS)[0]))
    small = truncated(full, W, V, order)
    closed = _flown(config, small)
    law = as_law(closed, small, W[:order] @ synthesis.controller.input_of_u, closed.C)
    return MuDesign(law, synthesis.peaks, full.A.shape[0], mu, stability)


def _flown(config: AttitudeConfig, law: System) -> System:
    """u -> h of the loop as flown: states of the plant, then of the controller; h of eq. (11)."""
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
    inputs = {"parameter": k, "servo": N_U, "wind": N_U, "load": N_U, "noise": MU_N_Y,
              "u": N_U}  # fmt: skip
    outputs = {"parameter": k, "servo": N_U, "attitude": N_U, "command": N_U,
               "y": MU_N_Y}  # fmt: skip
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
    return GeneralisedPlant(System(a, b, c, d), N_U, MU_N_Y)


def _parameters(A: Matrix, B: Matrix, weights: MuWeights) -> tuple[Matrix, Matrix]:
    """Where the parameters' errors enter x' (15, 5), and what they are a share of (5, 15)."""
    into, out = np.zeros((N_X + 2 * N_U, N_PARAMETERS)), np.zeros((N_PARAMETERS, N_X + 2 * N_U))
    rows = np.hstack([A, B])
    for i, (rate, flap) in enumerate(_FLAPPING):
        into[rate, i] = into[flap, 2 + i] = 1.0
        out[i, flap] = weights.stiffness * A[rate, flap]
        flap_row = rows[flap].copy()
        flap_row[[NINE.p, NINE.q]] = 0.0
        out[2 + i, : N_X + N_U] = weights.flapping * flap_row
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
