# SPDX-License-Identifier: Apache-2.0
"""How far every parameter of a set may be stretched before an aircraft of it is unstable."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from heli_core.command_line import config_folder
from heli_core.errors import RobustError
from heli_core.parameters import Parameter, load
from heli_core.rcl_yaml import ParameterError
from heli_core.rotations import quat_from_euler, quat_to_R_nb
from heli_core.rows import ACTUATOR, ATTITUDE, INPUT_NAMES, MEASURED, NINE, PLANT, TRUTH
from heli_core.ticks import TICK_S, ticks_in
from heli_dynamics_sim import plant
from heli_dynamics_sim.aircraft import AircraftError, HelicopterParameters
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.trim import (
    ReducedModel,
    TrimError,
    TrimPoint,
    flap_back_in_hover,
    linearize,
    reduced_state,
    smooth_params,
    trim,
)
from heli_flight.loop import AircraftInLoop, build, fly
from heli_flight.record import empty_track
from heli_flight.settings import Settings
from heli_flight.terminal import table
from heli_inner_hinf.controller_state import Actuation, ObserverInput
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import (
    N_Y,
    Assessment,
    OutputFeedback,
    closed_loop,
    judge,
    linear_law_of,
    sampled_controller,
)
from heli_inner_hinf.robust.certificate import (
    CommonBound,
    RobustCertificate,
    certify,
    common_bound,
    contraction_of,
)
from heli_inner_hinf.robust.parts import ProvedPart, loop_of, prove_in_parts
from heli_inner_hinf.robust.uncertain import Range, Uncertain, uncertain_Matrix
from heli_inner_hinf.robust.worst_case import (
    GainFamily,
    InstabilityOnset,
    UncertainFamily,
    WorstGain,
    worst_gain,
)
from heli_inner_hinf.tuning import model_of

# -------------------------------------------------------------------------------------------------
# The linear aircraft as a function of its named parameters: a linear fractional transformation.
#
# Eleven states: the nine of eq. (9) and the horizontal velocity over ground, without which flap-
# back
# would not enter. Each row is multiplied by what its equation of motion divides by (an inertia,
# the
# mass, the flapping time constant); what then is left is smooth and nearly straight in the others,
# and a polynomial of second order through aircraft that were trimmed and linearised one by one.
# How
# far it is from others that were not used for it is measured.
# -------------------------------------------------------------------------------------------------

N_STATES = len(NINE) + 2
_STEP, _STEP_MPS = 1e-5, 1e-3
_SAMPLES, _CHECKS = 70, 20
_SHARE = 5e-3  # of a row: what changes it by less is left to the measured residual
_CHANNEL = 1e-3  # of a parameter's largest channel: the same

SCALED: Mapping[str, str] = {
    "mass": "mass_kg",
    "inertia_xx": "inertia_xx_kgm2",
    "inertia_yy": "inertia_yy_kgm2",
    "inertia_zz": "inertia_zz_kgm2",
    "rotor_stiffness": "hub_stiffness_nmprad",
    "flapping": "flap_time_constant_s",
    "thrust": "main_lift_slope",
    "servo_speed": "servo_bandwidth_radps",
}
"""Parameters whose ranges are factors of the aircraft's own; `flap_back` is in rad s/m."""
_DIVIDES: Mapping[str, tuple[int, ...]] = {
    "inertia_xx": (NINE.p,),
    "inertia_yy": (NINE.q,),
    "inertia_zz": (NINE.r,),
    "flapping": (NINE.a_s, NINE.b_s),
    "mass": (len(NINE), len(NINE) + 1),
}
_INERTIAS = ("inertia_xx", "inertia_yy", "inertia_zz")
EXACT = (*_INERTIAS, "servo_speed")
"""Enter by their row, or behind the servos, alone."""


def with_values(
    aircraft: HelicopterParameters, values: Mapping[str, float]
) -> HelicopterParameters:
    """The aircraft with factors of `SCALED` and, where it is named, `flap_back`, rad s/m."""
    changes = {
        SCALED[name]: getattr(aircraft, SCALED[name]) * value
        for name, value in values.items()
        if name != "flap_back"
    }
    if "flap_back" in values:
        changes["flap_back_radpmps"] = values["flap_back"]
    return replace(aircraft, **changes)


def linear(aircraft: HelicopterParameters) -> tuple[uncertain_Matrix, uncertain_Matrix]:
    """A (11, 11), B (11, 3) about hover in still air: the nine, then velocity north, east, m/s."""
    at = trim(aircraft)
    model = ReducedModel(smooth_params(aircraft, at, "descent"), at)
    still = model.velocity_ned.copy()
    n, inputs = len(NINE), len(INPUT_NAMES)

    def slope(z: NDArray[np.float64], velocity: NDArray[np.float64]) -> NDArray[np.float64]:
        model.velocity_ned = still + np.append(velocity, 0.0)
        rates = model(z)[:n]
        attitude = quat_to_R_nb(quat_from_euler(z[NINE.phi], z[NINE.theta], z[NINE.psi]))
        return np.append(rates, (attitude @ model.out[PLANT.vel])[:2])

    def central(place: int, step: float) -> NDArray[np.float64]:
        z, v = np.zeros(model.z0.size), np.zeros(2)
        (z if place < n + inputs else v)[place if place < n + inputs else place - n - inputs] = step
        return (slope(model.z0 + z, v) - slope(model.z0 - z, -v)) / (2.0 * step)

    steps = [_STEP] * (n + inputs) + [_STEP_MPS] * 2
    columns = [
        (4.0 * central(i, 0.5 * step) - central(i, step)) / 3.0 for i, step in enumerate(steps)
    ]
    full = np.column_stack(columns)
    return full[:, [*range(n), n + inputs, n + inputs + 1]], full[:, n : n + inputs]


@dataclass(frozen=True)
class AircraftSet:
    """Every aircraft whose parameters lie in their ranges.

    Attributes
    ----------
    aircraft : HelicopterParameters
    ranges : tuple of Range
        By the names of `SCALED`, and `flap_back`.
    model : Uncertain
        (11, 14): A and B of `linear`, without servos.
    residual : float
        Largest error of a row of the model, relative to the row, over aircraft not used for it.
    """

    aircraft: HelicopterParameters
    ranges: tuple[Range, ...]
    model: Uncertain
    residual: float

    def values(self, deltas: Mapping[str, float]) -> dict[str, float]:
        """Values of the parameters at deviations; those not named are nominal.

        However far the ranges are stretched, no rotor flaps forward.
        """
        values = {r.name: r.value(deltas.get(r.name, 0.0)) for r in self.ranges}
        if "flap_back" in values:
            values["flap_back"] = max(0.0, values["flap_back"])
        return values

    def linear(self, deltas: Mapping[str, float]) -> tuple[uncertain_Matrix, uncertain_Matrix]:
        """A (11, 11), B (11, 3) of one aircraft, linearised anew.

        Its inertias divide their rows, so they need not be those of one rigid body.
        """
        values = self.values(deltas)
        others = {name: value for name, value in values.items() if name not in EXACT}
        A, B = linear(with_values(self.aircraft, others))
        for name in _INERTIAS:
            for place in _DIVIDES[name]:
                A[place] /= values.get(name, 1.0)
                B[place] /= values.get(name, 1.0)
        return A, B

    def speed_of_servos(self) -> Uncertain:
        """Factor (1, 1) of the servos' bandwidth."""
        for r in self.ranges:
            if r.name == "servo_speed":
                return r.matrix
        return Uncertain.constant(np.eye(1))


def aircraft_set(aircraft: HelicopterParameters, ranges: Sequence[Range]) -> AircraftSet:
    """The linear model of every aircraft in the ranges.

    Raises
    ------
    AircraftError, TrimError
        A corner of the ranges is no aircraft, or cannot hover.
    """
    smooth = [r for r in ranges if r.name not in EXACT]
    rng = np.random.default_rng(20)
    deltas = rng.uniform(-1.0, 1.0, (_SAMPLES + _CHECKS, len(smooth)))
    deltas[: _SAMPLES // 2] = np.where(deltas[: _SAMPLES // 2] > 0.0, 1.0, -1.0)
    rows = np.array([_undivided(aircraft, smooth, delta) for delta in deltas])
    centre = _undivided(aircraft, smooth, np.zeros(len(smooth)))
    terms: list[tuple[int, ...]] = [(i,) for i in range(len(smooth))]
    terms += [(i, j) for i in range(len(smooth)) for j in range(i, len(smooth))]
    columns = np.array([[np.prod(delta[list(term)]) for term in terms] for delta in deltas])
    flat = (rows - centre).reshape(len(rows), -1)
    coefficients = np.linalg.lstsq(columns[:_SAMPLES], flat[:_SAMPLES], rcond=None)[0]
    left, right = _sizes(centre)
    model = Uncertain.constant(centre)
    for term, coefficient in zip(terms, coefficients, strict=True):
        scaled = coefficient.reshape(centre.shape) / left[:, None] / right
        U, sigma, Vh = np.linalg.svd(scaled)
        keep = int(np.sum(sigma > _SHARE))
        if keep == 0:
            continue
        part: Uncertain | uncertain_Matrix = right * Vh[:keep]
        for i in term:
            delta = Range(smooth[i].name, 0.0, -1.0, 1.0).matrix
            wide = [
                [delta if a == b else np.zeros((1, 1)) for b in range(keep)] for a in range(keep)
            ]
            part = Uncertain.stacked(wide) @ part
        model = model + (left[:, None] * U[:, :keep] * sigma[:keep]) @ part
    model = _divided(model, ranges, left, right)
    residual = 0.0
    for delta, truth in zip(deltas[_SAMPLES:], rows[_SAMPLES:], strict=True):
        named = {r.name: d for r, d in zip(smooth, delta, strict=True)}
        divided_truth = truth / _factors({r.name: r.value(named[r.name]) for r in smooth})[:, None]
        error = (model.at(named) - divided_truth) / left[:, None] / right
        residual = max(residual, float(np.max(np.linalg.norm(error, axis=1))))
    return AircraftSet(aircraft, tuple(ranges), model, residual)


def _undivided(
    aircraft: HelicopterParameters, ranges: Sequence[Range], delta: NDArray[np.float64]
) -> uncertain_Matrix:
    """A and B with the rows of `_DIVIDES` times the factor of their parameter."""
    values = {r.name: r.value(float(d)) for r, d in zip(ranges, delta, strict=True)}
    return np.hstack(linear(with_values(aircraft, values))) * _factors(values)[:, None]


def _factors(values: Mapping[str, float]) -> NDArray[np.float64]:
    """What divides each row (11,)."""
    factors = np.ones(N_STATES)
    for name, places in _DIVIDES.items():
        factors[list(places)] = values.get(name, 1.0)
    return factors


def _divided(
    model: Uncertain,
    ranges: Sequence[Range],
    left: NDArray[np.float64],
    right: NDArray[np.float64],
) -> Uncertain:
    """The rows divided; as few channels as matter, in the sizes of `_sizes`."""
    divisors = {place: name for name, places in _DIVIDES.items() for place in places}
    by_name = {r.name: r.matrix.inverse() for r in ranges}
    one = Uncertain.constant(np.eye(1))
    rows = [
        [
            by_name.get(divisors.get(i, ""), one) if i == j else np.zeros((1, 1))
            for j in range(N_STATES)
        ]
        for i in range(N_STATES)
    ]
    full = Uncertain.stacked(rows) @ model
    even = Uncertain(
        full.channels,
        full.A,
        full.B / right,
        full.C / left[:, None],
        full.D / left[:, None] / right,
    ).reduced(_CHANNEL)
    return Uncertain(even.channels, even.A, even.B * right, left[:, None] * even.C, full.D)


def _sizes(rows: uncertain_Matrix) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How large each row and column counts: columns of typical motions, rows of what these do."""
    columns = np.array([0.1, 0.1, 0.5, 0.5, 0.02, 0.02, 0.5, 0.1, 0.1, 5.0, 5.0, 0.1, 0.1, 0.1])
    columns = 1.0 / columns
    sizes = np.linalg.norm(rows / columns, axis=1)
    return np.where(sizes > 0.0, sizes, 1.0), columns


# -------------------------------------------------------------------------------------------------
# The worst aircraft flown: the nonlinear loop along the direction that destabilises it.
#
# One process, still air, sensors without noise, the flown navigation, attitude only: the aircraft
# is
# in its own trim, which controllers and observer are told, so that what is left is the motion about
# it. It gets a small push, and the oscillation's growth is read off its envelope.
# -------------------------------------------------------------------------------------------------

_SETTLED_S = 3.0
"""The observer has aligned, and what its first estimate did has died out."""
_PUSH_RADPS = 1e-4
_WINDOW_S, _PERIODS, _WINDOWS = 1.0, 6.0, 12
_NEVER = 2**31


def growth_in_flight(
    settings: Settings,
    aircraft: AircraftSet,
    deltas: Mapping[str, float],
    delay_ticks: int,
    frequency_radps: float,
) -> float:
    """Growth of the oscillation near a frequency, 1/s, of one aircraft in flight; below 0: decay.

    Parameters
    ----------
    settings : Settings
    aircraft : AircraftSet
    deltas : mapping of str to float
        Its parameters' deviations, in ranges.
    delay_ticks : int
    frequency_radps : float
        Of the mode that is nearest to the axis.

    Raises
    ------
    TrimError, AircraftError
        This aircraft cannot hover.
    """
    loop, at = _loop(settings, aircraft, aircraft.values(deltas), delay_ticks)
    settled = ticks_in(_SETTLED_S)
    width = ticks_in(max(_WINDOW_S, 2.0 * np.pi * _PERIODS / frequency_radps))
    track = empty_track(settled + _WINDOWS * width, excited=False)
    setpoint = np.append(reduced_state(at.x)[[NINE.phi, NINE.theta, NINE.psi]], at.u[ACTUATOR.col])
    u = at.u.copy()
    points = settings.scenario.reference.points.copy()
    quiet, first = np.zeros((len(track.truth), NOISE.size)), 1
    for count in (settled - first, _WINDOWS * width):
        flown, status = fly(
            loop, first, count, quiet, settings.scenario.reference.times_ns, points,
            setpoint, u, track,
        )  # fmt: skip
        if status:
            return np.inf
        loop.plant_s.x[PLANT.rate] += _PUSH_RADPS
        first += flown
    return _slope(track.truth[settled:, TRUTH.rate], width, frequency_radps)


def _slope(rate: np.ndarray, width: int, frequency_radps: float) -> float:
    """Growth of log of the amplitude at a frequency, 1/s: one window (Hann) after the other."""
    time_s = TICK_S * np.arange(width)
    window = np.hanning(width) * np.exp(-1j * frequency_radps * time_s)
    parts = rate.reshape(-1, width, rate.shape[1])
    amplitude = np.linalg.norm(np.einsum("k,nkj->nj", window, parts), axis=1)
    later = np.arange(len(parts)) >= 2  # faster modes have died out
    middle_s = (np.arange(len(parts)) + 0.5) * width * TICK_S
    return float(np.polyfit(middle_s[later], np.log(amplitude[later]), 1)[0])


def _loop(
    settings: Settings, aircraft: AircraftSet, values: Mapping[str, float], delay_ticks: int
) -> tuple[AircraftInLoop, TrimPoint]:
    """The loop of one aircraft in its own trim, in still air; the position loop never runs.

    Inertias enter behind the checks of the aircraft's file, as they need not be one rigid body's.
    """
    others = {name: value for name, value in values.items() if name not in EXACT}
    body = with_values(aircraft.aircraft, others)
    body = replace(
        body,
        servo_bandwidth_radps=values.get("servo_speed", 1.0) * body.servo_bandwidth_radps,
    )
    at = trim(body)
    trims = {"trim.x": reduced_state(at.x), "trim.u": at.u}
    nodes = {
        name: {**parameters, **trims} if name in ("observer", "inner_loop") else parameters
        for name, parameters in settings.nodes.items()
    }
    config = plant.PlantConfig.from_parameters(nodes["plant"])
    wind = config.wind
    still = wind._replace(
        profile_speed_mps=0.0 * wind.profile_speed_mps,
        w20_mps=0.0,
        turbulence=False,
        gust_amplitude_mps=0.0 * wind.gust_amplitude_mps,
        sines=wind.sines._replace(on=False),
    )
    config = replace(config, helicopter=body, wind=still, delay_ticks=delay_ticks)
    loop = build(replace(settings, nodes=nodes), plant_config=config)
    mass = loop.plant_k.aircraft.body
    mass = mass._replace(
        j_xx=values.get("inertia_xx", 1.0) * mass.j_xx,
        j_yy=values.get("inertia_yy", 1.0) * mass.j_yy,
        j_zz=values.get("inertia_zz", 1.0) * mass.j_zz,
    )
    parameters = loop.plant_k.aircraft._replace(body=mass)
    # The setpoint is sent once and stays.
    held = loop.estimate_k._replace(setpoint_timeout_ticks=_NEVER)
    loop = loop._replace(estimate_k=held, period_ticks=_NEVER)
    return loop._replace(plant_k=loop.plant_k._replace(aircraft=parameters)), at


# -------------------------------------------------------------------------------------------------
# The attitude loop as flown, with every aircraft of a set in it.
#
# The proof wants a rational loop: the controller, the delay and the hold are mapped exactly from z
# to the plane of w by z = (c + w) / (c - w), and there the aircraft's own s stands for w. With c
# fitted at `MATCHED_RADPS` both agree there, and nearly so below; the hold is (1 + 1/z) / 2, that
# is its trapezoid. `exact` has neither approximation, for one aircraft: the tests and the report
# compare.
# -------------------------------------------------------------------------------------------------

MATCHED_RADPS = 25.0  # near where the margins are lost
_N_U = len(INPUT_NAMES)
_PLANE = MATCHED_RADPS / np.tan(0.5 * MATCHED_RADPS * TICK_S)


def feedback_flown(settings: Settings) -> OutputFeedback:
    """The settings' linear controller with observer and prediction, measured states to u."""
    nodes = settings.nodes
    config = AttitudeConfig.from_parameters(nodes["inner_loop"])
    law = linear_law_of(config.params)
    if law is not None:
        return OutputFeedback(law.A, law.B[:, :N_Y], law.C, law.D[:, :N_Y], MEASURED)
    observer = nodes["observer"]
    feed = ObserverInput.from_parameters(observer)
    K = np.reshape(observer["K"], (-1, N_Y))
    controller = sampled_controller(model_of(config), K, config.prediction_s, feed)
    return OutputFeedback(
        controller.A, controller.B[:, :N_Y], controller.C, controller.D[:, :N_Y], MEASURED
    )


def uncertain_loop(aircraft: AircraftSet, law: OutputFeedback, delay_ticks: int) -> Uncertain:
    """State matrix of the closed loop for every aircraft of the set."""
    parts = _parts(aircraft, law, delay_ticks)
    return Uncertain.stacked([[parts.plant @ parts.x_and_u], [parts.law_rates]]).reduced()


def wind_to_h(
    aircraft: AircraftSet,
    law: OutputFeedback,
    delay_ticks: int,
    C: uncertain_Matrix,
    D: uncertain_Matrix,
) -> GainFamily:
    """Horizontal wind (north, east, m/s) to h = C x + D u of eq. (11), u behind the servos.

    Nothing depends on the ground's speed but through the air's: wind is motion the other way.
    """
    parts = _parts(aircraft, law, delay_ticks)
    n, size = N_STATES, parts.law_rates.shape[1]
    moving = np.zeros((parts.x_and_u.shape[0], 2))
    moving[len(NINE) : n] = -np.eye(2)
    h = np.zeros((len(C), size))
    h[:, : len(NINE)], h[:, n : n + _N_U] = C, D
    rows: list[list[Uncertain | uncertain_Matrix]] = [
        [parts.plant @ np.hstack([parts.x_and_u, moving])],
        [np.hstack([parts.law_rates, np.zeros((len(parts.law_rates), 2))])],
        [np.hstack([h, np.zeros((len(h), 2))])],
    ]
    return GainFamily(Uncertain.stacked(rows).reduced(), size)


def disks_at_input(aircraft: AircraftSet, law: OutputFeedback, delay_ticks: int) -> GainFamily:
    """Its gain is 1 / alpha: commands times (1 + d / 2) / (1 - d / 2), |d| < alpha, are held."""
    parts = _parts(aircraft, law, delay_ticks)
    u = parts.x_and_u[-_N_U:]
    added = np.vstack([np.zeros((parts.x_and_u.shape[0] - _N_U, _N_U)), np.eye(_N_U)])
    return _disks(parts, u, added, np.zeros((len(parts.law_rates), _N_U)))


def disks_at_output(
    aircraft: AircraftSet,
    law: OutputFeedback,
    delay_ticks: int,
    channels: Sequence[int] | None = None,
) -> GainFamily:
    """The same at the inputs of controller and observer: `channels` of `law.measured`, or all."""
    parts = _parts(aircraft, law, delay_ticks)
    chosen = list(range(len(law.measured)) if channels is None else channels)
    added = np.zeros((parts.x_and_u.shape[0], len(chosen)))
    added[-_N_U:] = parts.read.D[:, chosen]
    return _disks(parts, parts.y[chosen], added, parts.read.B[:, chosen])


def _disks(
    parts: "_Parts", signal: uncertain_Matrix, to_plant: uncertain_Matrix, to_law: uncertain_Matrix
) -> GainFamily:
    """w = d z is added to a signal (from all states), z = signal + w / 2; so it reaches both."""
    size, k = parts.law_rates.shape[1], len(signal)
    rows: list[list[Uncertain | uncertain_Matrix]] = [
        [parts.plant @ np.hstack([parts.x_and_u, to_plant])],
        [np.hstack([parts.law_rates, to_law])],
        [np.hstack([signal, 0.5 * np.eye(k)])],
    ]
    return GainFamily(Uncertain.stacked(rows).reduced(), size, k)


class _Parts(NamedTuple):
    """plant: [A, B] with servos; its (x, u), x' and y of the controller from all states; law."""

    plant: Uncertain
    x_and_u: uncertain_Matrix
    law_rates: uncertain_Matrix
    y: uncertain_Matrix
    read: "_Law"


def _parts(aircraft: AircraftSet, law: OutputFeedback, delay_ticks: int) -> _Parts:
    plant = _with_servos(aircraft)
    flown = _in_plane(_late_and_held(law, delay_ticks))
    n, k = plant.D.shape[0], len(flown.A)
    y = np.eye(n, n + k)[list(law.measured)]
    u = flown.D @ y + np.hstack([np.zeros((_N_U, n)), flown.C])
    law_rates = flown.B @ y + np.hstack([np.zeros((k, n)), flown.A])
    return _Parts(plant, np.vstack([np.eye(n, n + k), u]), law_rates, y, flown)


def exact(
    aircraft: AircraftSet, deltas: dict[str, float], law: OutputFeedback, delay_ticks: int
) -> float:
    """Largest growth, 1/s, of the sampled loop with one aircraft, discretised exactly."""
    nominal, speed = aircraft.aircraft, aircraft.values(deltas).get("servo_speed", 1.0)
    lag = Actuation(
        speed * nominal.servo_bandwidth_radps, nominal.servo_damping, delay_ticks * TICK_S
    )
    poles = np.linalg.eigvals(closed_loop(*aircraft.linear(deltas), law, lag))
    return float(np.log(np.max(np.abs(poles))) / TICK_S)


def _with_servos(aircraft: AircraftSet) -> Uncertain:
    """Aircraft behind its servos: [A, B] (17, 20); states of the servos: position, rate / w."""
    nominal, eye, none = aircraft.aircraft, np.eye(_N_U), np.zeros((_N_U, _N_U))
    w, zeta = nominal.servo_bandwidth_radps, nominal.servo_damping
    moves = w * np.block([[none, eye, none], [-eye, -2.0 * zeta * eye, eye]])
    speed = aircraft.speed_of_servos()
    faster = [
        [speed if i == j else np.zeros((1, 1)) for j in range(2 * _N_U)] for i in range(2 * _N_U)
    ]
    servos = Uncertain.stacked(faster) @ np.hstack([np.zeros((2 * _N_U, N_STATES)), moves])
    return Uncertain.stacked(
        [[aircraft.model @ np.eye(N_STATES + _N_U, N_STATES + 3 * _N_U)], [servos]]
    )


class _Law(NamedTuple):
    A: uncertain_Matrix
    B: uncertain_Matrix
    C: uncertain_Matrix
    D: uncertain_Matrix


def _late_and_held(law: OutputFeedback, delay_ticks: int) -> _Law:
    """The controller, its command `delay_ticks` late, held: half of it and half of the last."""
    n, depth = len(law.A), delay_ticks + 1
    size = n + _N_U * depth
    A, B = np.zeros((size, size)), np.zeros((size, law.B.shape[1]))
    A[:n, :n], B[:n] = law.A, law.B
    A[n : n + _N_U, :n], B[n : n + _N_U] = law.C, law.D
    A[n + _N_U :, n : size - _N_U] = np.eye(_N_U * (depth - 1))
    # u_n, then u_(n-1), ...: (3, size) each, and what of y goes straight through.
    past = [np.hstack([law.C, np.zeros((_N_U, size - n))])]
    past += [np.eye(size)[n + _N_U * i : n + _N_U * (i + 1)] for i in range(depth)]
    through = [law.D] + [np.zeros_like(law.D)] * depth
    return _Law(
        A,
        B,
        0.5 * (past[delay_ticks] + past[delay_ticks + 1]),
        0.5 * (through[delay_ticks] + through[delay_ticks + 1]),
    )


def _in_plane(law: _Law) -> _Law:
    """The same controller with w for z = (c + w) / (c - w); exact."""
    inverse = np.linalg.inv(law.A + np.eye(len(law.A)))
    root = np.sqrt(2.0 * _PLANE)
    return _Law(
        _PLANE * inverse @ (law.A - np.eye(len(law.A))),
        root * inverse @ law.B,
        root * law.C @ inverse,
        law.D - law.C @ inverse @ law.B,
    )


# -------------------------------------------------------------------------------------------------
# The attitude loop over the airspeed: one controller from hover to forward flight.
#
# The aircraft is trimmed and linearised in winds that to it are flight through still air; the
# controller, servos, delay and 100 Hz are those that fly. A quadratic bound that the loops of
# flight straight ahead share says that airspeed and flap-back may change as quickly as they like
# (`common_bound`): the controller needs no schedule. What trim needs meanwhile, integral action and
# the disturbance estimate find. With air from the side too each loop is judged by itself.
# -------------------------------------------------------------------------------------------------

SPEEDS_MPS = (0.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0)
ACROSS_MPS = (-4.0, 0.0, 4.0)
FLAP_BACKS = (0.0, 1.0, 2.0)
"""Of the aircraft's own in hover, as the set of `heli robust` has it."""
_BETWEEN_MPS = tuple(0.5 * k for k in range(25))
_BETWEEN_FLAP_BACKS = (0.5, 1.5)


class Point(NamedTuple):
    """An aircraft in steady flight.

    Attributes
    ----------
    ahead_mps, right_mps : float
        Velocity through the air.
    flap_back_radpmps : float
    """

    ahead_mps: float
    right_mps: float
    flap_back_radpmps: float


@dataclass(frozen=True, eq=False)
class AtPoint:
    """The aircraft there, and its loop.

    Attributes
    ----------
    point : Point
    attitude_rad : (2,) array
        Trim phi, theta.
    u : (4,) array
        Trim d_lat, d_lon, d_ped, d_col.
    loop : (n, n) array
        State matrix of the loop as flown, one step a tick.
    judgement : Assessment
    """

    point: Point
    attitude_rad: uncertain_Matrix
    u: uncertain_Matrix
    loop: uncertain_Matrix
    judgement: Assessment


@dataclass(frozen=True, eq=False)
class OverAirspeed:
    """What is found.

    Attributes
    ----------
    points : sequence of AtPoint
        Ahead and to the sides.
    bound : CommonBound or str
        What all loops of flight straight ahead share; or why none was found.
    between : float
        Largest contraction, by the same bound, at speeds and flap-backs between those; NaN without.
    """

    points: Sequence[AtPoint]
    bound: CommonBound | str
    between: float


def over_airspeed(settings: Settings) -> OverAirspeed:
    """Trim, linearise, close and bound the loops of the settings' aircraft and controller.

    Raises
    ------
    TrimError
        The aircraft cannot fly that fast.
    """
    law = feedback_flown(settings)
    aircraft = HelicopterParameters.from_yaml(settings.nodes["plant"]["aircraft_file"])
    actuation = AttitudeConfig.from_parameters(settings.nodes["inner_loop"]).actuation
    own = flap_back_in_hover(aircraft)
    points = [
        at(aircraft, law, actuation, Point(ahead, right, share * own))
        for ahead in SPEEDS_MPS
        for right in ACROSS_MPS
        for share in FLAP_BACKS
    ]
    try:
        bound = common_bound([point.loop for point in points if point.point.right_mps == 0.0])
    except RobustError as error:
        return OverAirspeed(points, str(error), math.nan)
    between = (
        at(aircraft, law, actuation, Point(ahead, 0.0, share * own)).loop
        for ahead in _BETWEEN_MPS
        for share in _BETWEEN_FLAP_BACKS
    )
    return OverAirspeed(points, bound, max(contraction_of(A, bound.P) for A in between))


def at(
    aircraft: HelicopterParameters, law: OutputFeedback, actuation: Actuation, point: Point
) -> AtPoint:
    """One of them."""
    flapping = replace(aircraft, flap_back_radpmps=point.flap_back_radpmps)
    balance = trim(flapping, [-point.ahead_mps, -point.right_mps, 0.0], 0.0)
    model = linearize(flapping, balance)
    return AtPoint(
        point,
        model.x_trim[[NINE.phi, NINE.theta]],
        balance.u,
        closed_loop(model.A, model.B, law, actuation),
        judge(model.A, model.B, law, actuation),
    )


# -------------------------------------------------------------------------------------------------
# The set of aircraft of `heli robust`; values stand in config/robust.yaml.
# -------------------------------------------------------------------------------------------------

NODE_NAME = "robust"
_DELAY, _GAP = "delay_ticks", "gap"
_MOST_TICKS = 10


def _row(name: str, unit: str, upper: float) -> Parameter:
    of = f"{SCALED[name]}, as a factor" if name in SCALED else "the rotor's flap-back"
    return Parameter(
        name, "double[]", f"Low, nominal and high {of}", unit, lower=0.0, upper=upper, shape=(3,)
    )


TABLE: tuple[Parameter, ...] = (
    *(_row(name, "1", 4.0) for name in SCALED),
    _row("flap_back", "rad s/m", 0.1),
    Parameter(
        _DELAY, "double[]", "Fewest and most ticks of transport delay", "ticks",
        lower=0, upper=_MOST_TICKS, shape=(2,),
    ),
    Parameter(
        _GAP, "double", "How far the proof may stay behind the worst aircraft found", "1",
        lower=0.001, upper=1.0,
    ),
)  # fmt: skip


class AircraftRanges(NamedTuple):
    """Ranges of the parameters, delays (ticks) one by one, and the gap of the proof."""

    ranges: tuple[Range, ...]
    delays_ticks: tuple[int, ...]
    gap: float


def read_ranges(params: Sequence[Path]) -> AircraftRanges:
    """The packaged set under the user's files; sections of other nodes are passed over.

    Raises
    ------
    ParameterError
        Also for a range that is upside down or does not include its nominal value.
    """
    values = load(TABLE, [config_folder("heli_flight") / "robust.yaml", *params], NODE_NAME)
    ranges = []
    for name in [*SCALED, "flap_back"]:
        low, nominal, high = (float(value) for value in values[name])
        try:
            ranges.append(Range(name, nominal, low, high))
        except RobustError as error:
            raise ParameterError(f"{NODE_NAME}: {error}") from None
    fewest, most = (float(value) for value in values[_DELAY])
    if fewest > most or not (fewest.is_integer() and most.is_integer()):
        raise ParameterError(
            f"{NODE_NAME}: {_DELAY}: {fewest:g} .. {most:g} is not allowed; allowed: whole "
            "numbers, the fewest first"
        )
    return AircraftRanges(
        tuple(ranges), tuple(range(int(fewest), int(most) + 1)), float(values[_GAP])
    )


# -------------------------------------------------------------------------------------------------
# Prove.
# -------------------------------------------------------------------------------------------------

FURTHEST = 3.0
"""Ranges are stretched up to this; there +-30 % is a tenth to nearly twice."""
FIVE_PERCENT = 0.05
BROKEN_AT = {
    "input": "at the input",
    "attitude": "at measured roll, pitch and heading",
    "output": "at all six outputs at once, the rates with them",
}
"""Where a disk margin is taken; all channels there at once."""
_ATTITUDE = tuple(MEASURED.index(i) for i in ATTITUDE)


@dataclass(frozen=True)
class DelayCase:
    """What is proved at one delay.

    Attributes
    ----------
    delay_ticks : int
    onset : Onset
        The worst aircraft found; nothing smaller was found to be unstable.
    certificate : RobustCertificate
        Up to 1 / level times the ranges no aircraft is unstable.
    parts : tuple of ProvedPart
        Where that stays further behind the worst aircraft than asked: the larger box, `whole` times
        the ranges, proved in parts. Empty where it did not, or where not all parts are proved.
    whole : float
    largest_psi : float
        The second look at the proof; holds below 0.
    exact_onset : float
        Size at which the same aircraft is unstable with the loop sampled exactly; nan where that is
        more than 5 % away.
    flown_onset : float
        The same in the nonlinear simulation; nan also where it was not flown.
    """

    delay_ticks: int
    onset: InstabilityOnset
    certificate: RobustCertificate
    largest_psi: float
    exact_onset: float
    flown_onset: float = float("nan")
    parts: tuple[ProvedPart, ...] = ()
    whole: float = 0.0

    @property
    def proved(self) -> float:
        """The robust stability margin is not below this."""
        return self.whole if self.parts else 1.0 / self.certificate.level

    @property
    def pieces(self) -> int:
        """Intervals of frequency that the proof is made of."""
        if self.parts:
            return sum(len(part.certificate.pieces) for part in self.parts)
        return len(self.certificate.pieces)


@dataclass(frozen=True)
class Proof:
    """All cases of a set, one a delay.

    Attributes
    ----------
    aircraft : AircraftSet
    law : OutputFeedback
    cases : tuple of DelayCase
    gain : WorstGain or None
        At the worst delay, over the set: horizontal wind (m/s) to h of eq. (11). None where the set
        is not proved stable.
    disks : mapping of str to WorstGain
        Inverse disk margins there, by `BROKEN_AT`; empty where the set is not proved stable.
    """

    aircraft: AircraftSet
    law: OutputFeedback
    cases: tuple[DelayCase, ...]
    gain: WorstGain | None = None
    disks: Mapping[str, WorstGain] = field(default_factory=dict)

    @property
    def worst(self) -> DelayCase:
        """The delay at which least is proved."""
        return min(self.cases, key=lambda case: case.proved)


def prove(
    settings: Settings,
    asked: AircraftRanges,
    progress: Callable[[float], None] = lambda done: None,
    flown: bool = False,
) -> Proof:
    """Prove stability of the settings' attitude loop for every aircraft of the set.

    Parameters
    ----------
    settings : Settings
    asked : AircraftRanges
    progress : callable
        Told how many delays are done.
    flown : bool
        Whether the worst aircraft of each delay is flown, too.

    Raises
    ------
    ParameterError
        An aircraft of the ranges cannot hover, or the loop is unstable with the nominal one.
    """
    aircraft, law = set_of(settings, asked), feedback_flown(settings)
    cases = []
    for done, ticks in enumerate(asked.delays_ticks):
        case = _case(aircraft, law, ticks, asked.gap)
        if flown and case.onset.deltas:
            case = replace(case, flown_onset=_flown_onset(settings, aircraft, case))
        cases.append(case)
        progress(done + 1)
    return _with_gains(Proof(aircraft, law, tuple(cases)), settings, asked.gap)


def set_of(settings: Settings, asked: AircraftRanges) -> AircraftSet:
    """The settings' aircraft with every parameter in its range; raises as `prove`."""
    nominal = HelicopterParameters.from_yaml(settings.nodes["plant"]["aircraft_file"])
    try:
        return aircraft_set(nominal, asked.ranges)
    except (AircraftError, TrimError) as error:
        raise ParameterError(
            f"robust: {_culprit(nominal, asked.ranges)}: an aircraft of the ranges cannot be "
            f"flown, no controller can hold it: {error}"
        ) from None


def _culprit(nominal: HelicopterParameters, ranges: Sequence[Range]) -> str:
    """The first range with an end that alone no trim holds."""
    for r in ranges:
        for end in (r.low, r.high):
            try:
                trim(with_values(nominal, {r.name: end}))
            except (AircraftError, TrimError):
                return f"{r.name} {end:g}"
    return "several parameters together"


def onset_of(A: Uncertain, ticks: int) -> InstabilityOnset:
    """The worst aircraft found of a loop's state matrix; raises as `prove`."""
    family = UncertainFamily(A)
    growth = family.abscissa(np.zeros(len(family.names)))
    if growth >= 0.0:
        raise ParameterError(
            f"robust: the loop is unstable with the nominal aircraft and {ticks} ticks of delay "
            f"(a mode grows at {growth:.3g} 1/s), so there is nothing to prove; delay_ticks"
        )
    return family.onset(FURTHEST)


def _case(aircraft: AircraftSet, law: OutputFeedback, ticks: int, gap: float) -> DelayCase:
    A = uncertain_loop(aircraft, law, ticks)
    onset = onset_of(A, ticks)
    system, blocks = loop_of(A)
    wanted, parts = min(onset.size, FURTHEST) / (1.0 + gap), tuple[ProvedPart, ...]()
    try:
        proof = certify(system, blocks, 1.0 / wanted)
        if proof.level * wanted > 1.0 and np.isfinite(onset.size):
            parts = prove_in_parts(A, wanted, onset.frequency_radps)
    except RobustError as error:
        raise ParameterError(f"robust: {ticks} ticks of delay: {error}") from None
    looks = [part.largest_psi for part in parts] or [proof.largest_psi(system)]
    found = exact_onset(aircraft, law, ticks, onset)
    return DelayCase(ticks, onset, proof, max(looks), found, parts=parts, whole=wanted)


def _with_gains(proof: Proof, settings: Settings, gap: float) -> Proof:
    """The worst gain and disk margin at the worst delay, if the whole set is proved stable."""
    ticks = proof.worst.delay_ticks
    if proof.worst.proved <= 1.0:
        return proof
    config = AttitudeConfig.from_parameters(settings.nodes["inner_loop"])
    wind = wind_to_h(proof.aircraft, proof.law, ticks, config.C, config.D)
    loop = proof.aircraft, proof.law, ticks
    families = disks_at_input(*loop), disks_at_output(*loop, _ATTITUDE), disks_at_output(*loop)
    try:
        disks = [worst_gain(family, gap) for family in families]
        return replace(
            proof, gain=worst_gain(wind, gap), disks=dict(zip(BROKEN_AT, disks, strict=True))
        )
    except RobustError as error:
        raise ParameterError(f"robust: worst gain, {ticks} ticks of delay: {error}") from None


def exact_onset(
    aircraft: AircraftSet, law: OutputFeedback, ticks: int, onset: InstabilityOnset
) -> float:
    """The size at which the loop, sampled exactly, is unstable along the same direction."""

    def growth(factor: float) -> float:
        return exact(aircraft, {k: factor * d for k, d in onset.deltas.items()}, law, ticks)

    return onset.size * _first_growth(growth, 1e-5) if onset.deltas else float("nan")


def _flown_onset(settings: Settings, aircraft: AircraftSet, case: DelayCase) -> float:
    """The size at which the oscillation grows in the nonlinear simulation."""

    def growth(factor: float) -> float:
        deltas = {k: factor * d for k, d in case.onset.deltas.items()}
        frequency = case.onset.frequency_radps
        try:
            return growth_in_flight(settings, aircraft, deltas, case.delay_ticks, frequency)
        except (AircraftError, TrimError) as error:
            raise ParameterError(f"robust: the worst aircraft cannot be flown: {error}") from None

    return case.onset.size * _first_growth(growth, 2e-3)


def _first_growth(growth: Callable[[float], float], within: float) -> float:
    """The factor, 5 % from one at most, at which a growth changes its sign; nan if nowhere."""
    stable, unstable = 1.0 - FIVE_PERCENT, 1.0 + FIVE_PERCENT
    if growth(stable) >= 0.0 or growth(unstable) < 0.0:
        return float("nan")
    while unstable - stable > within:
        middle = 0.5 * (stable + unstable)
        stable, unstable = (stable, middle) if growth(middle) >= 0.0 else (middle, unstable)
    return unstable


def as_dict(proof: Proof) -> dict[str, Any]:
    """For --json and result files."""
    return {
        "ranges": {r.name: [r.low, r.nominal, r.high] for r in proof.aircraft.ranges},
        "model_residual": proof.aircraft.residual,
        "robustly_stable": proof.worst.proved > 1.0,
        "cases": [
            {
                "delay_ticks": case.delay_ticks,
                "margin_proved": case.proved,
                "margin_at_most": _finite(case.onset.size),
                "frequency_radps": case.onset.frequency_radps,
                "exact_onset": _finite(case.exact_onset),
                "flown_onset": _finite(case.flown_onset),
                "gap": _finite(case.onset.size / case.proved - 1.0),
                "parts": max(len(case.parts), 1),
                "pieces": case.pieces,
                "largest_psi": case.largest_psi,
                "worst_aircraft": proof.aircraft.values(case.onset.deltas),
            }
            for case in proof.cases
        ],
        "worst_delay_ticks": proof.worst.delay_ticks,
        "wind_to_h": _gain(proof, proof.gain),
        "inverse_disk_margin": {at: _gain(proof, proof.disks.get(at)) for at in BROKEN_AT},
    }


def _gain(proof: Proof, worst_gain: WorstGain | None) -> dict[str, Any] | None:
    if worst_gain is None:
        return None
    return {
        "nominal": worst_gain.nominal,
        "found": worst_gain.lower,
        "proved": worst_gain.upper,
        "frequency_radps": worst_gain.frequency_radps,
        "aircraft": proof.aircraft.values(worst_gain.deltas),
    }


def print_proof(proof: Proof, out: Console) -> None:
    """The table of cases, the worst aircraft, and the verdict in one sentence."""
    rows = table("Robust stability margin, in ranges: 1 is the set itself", out)
    heads = (
        "delay, ticks",
        "proved",
        "at most",
        "gap, %",
        "rad/s",
        "exact loop",
        "flown",
        "pieces",
    )
    for head in heads:
        rows.add_column(head, justify="right")
    for case in proof.cases:
        size = case.onset.size
        rows.add_row(
            str(case.delay_ticks),
            f"{case.proved:.3f}",
            f"{size:.3f}" if np.isfinite(size) else f"> {FURTHEST:g}",
            f"{100.0 * (size / case.proved - 1.0):.1f}" if np.isfinite(size) else "-",
            f"{case.onset.frequency_radps:.2f}" if case.onset.deltas else "-",
            f"{case.exact_onset:.3f}" if np.isfinite(case.exact_onset) else "-",
            f"{case.flown_onset:.3f}" if np.isfinite(case.flown_onset) else "-",
            str(case.pieces),
        )
    out.print(rows)
    worst = proof.worst
    box = table(f"Parameter box, and the aircraft at the onset ({worst.delay_ticks} ticks)", out)
    for head in ("parameter", "low", "nominal", "high", "onset"):
        box.add_column(head, justify="left" if head == "parameter" else "right")
    values: Mapping[str, float] = proof.aircraft.values(worst.onset.deltas)
    for r in proof.aircraft.ranges:
        at = f"{values[r.name]:.4g}" if r.name in worst.onset.deltas else "any"
        box.add_row(r.name, f"{r.low:g}", f"{r.nominal:g}", f"{r.high:g}", at)
    out.print(box)
    held = "is" if worst.proved > 1.0 else "is not proved to be"
    out.print(
        f"The loop {held} stable with every aircraft of the set: the least margin is "
        f"{worst.proved:.3f}, at {worst.delay_ticks} ticks of delay. The linear model is within "
        f"{100.0 * proof.aircraft.residual:.2f} % of aircraft that were not used for it.",
        soft_wrap=True,
    )
    if proof.gain:
        out.print(
            f"Over the set, at {worst.delay_ticks} ticks: the norm from horizontal wind to h is at "
            f"most {proof.gain.upper:.4f} (an aircraft has {proof.gain.lower:.4f}, the nominal one "
            f"{proof.gain.nominal:.4f}). Disk margins:",
            soft_wrap=True,
        )
    for at, disk in proof.disks.items():
        out.print(
            f"{BROKEN_AT[at]}: at least {1.0 / disk.upper:.3f} (an aircraft has "
            f"{1.0 / disk.lower:.3f}, the nominal one {1.0 / disk.nominal:.3f}).",
            soft_wrap=True,
        )


def draw(proof: Proof, path: Path) -> None:
    """The parameter box: ranges, what is proved, and the aircraft at the onset."""
    from heli_flight.report.figures import BLUE, GREEN, GREY, RED, picture

    ranges, worst = proof.aircraft.ranges, proof.worst
    with picture(path, 1, 1, (6.3, 3.4)) as (_, axes):
        ax = axes[0, 0]
        for row, r in enumerate(ranges):
            ax.plot([-1.0, 1.0], [row, row], color=GREY, lw=7, alpha=0.35, solid_capstyle="butt")
            ax.plot([-worst.proved, worst.proved], [row, row], color=GREEN, lw=2)
            if r.name in worst.onset.deltas:
                ax.plot(worst.onset.deltas[r.name], row, "D", color=RED, ms=5)
        ax.plot([], [], color=GREY, lw=7, alpha=0.35, label="the set")
        ax.plot([], [], color=GREEN, lw=2, label="proved stable")
        ax.plot([], [], "D", color=RED, ms=5, label="unstable aircraft")
        ax.axvline(0.0, color=BLUE, lw=0.7)
        ax.set_yticks(range(len(ranges)), [r.name.replace("_", " ") for r in ranges])
        ax.invert_yaxis()
        ax.set_xlabel(f"deviation, in ranges ({worst.delay_ticks} ticks of delay)")
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.16), ncols=3)


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
