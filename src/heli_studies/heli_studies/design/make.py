# SPDX-License-Identifier: Apache-2.0
"""`heli design`: from aircraft and weights to every number that the nodes load, with its proof."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from heli_core.central_controller import GeneralisedPlant, NoControllerError, optimal_gamma
from heli_core.errors import InfeasibleGammaError, RobustError
from heli_core.folders import write_whole
from heli_core.linear import with_servos
from heli_core.rcl_yaml import ParameterError, dump_all
from heli_core.rotations import quat_to_R_nb
from heli_core.rows import ACTUATOR, INPUT_NAMES, MEASURED, NINE, PLANT, SETPOINT
from heli_core.search import search
from heli_core.ticks import TICK_S, ticks_in
from heli_dynamics_sim.aircraft import HelicopterParameters, find_aircraft
from heli_dynamics_sim.config import PlantConfig
from heli_dynamics_sim.linear_aircraft import PARAMETER as LINEAR
from heli_dynamics_sim.trim import (
    MovingModel,
    TrimPoint,
    flap_back_in_hover,
    linearize,
    linearize_moving,
    reduced_state,
    trim,
)
from heli_dynamics_sim.wind import dryden_scales, passing_speed
from heli_flight.position_axes import NAMES, attitude_lags_s, downwind, position_axes
from heli_flight.settings import HOVER_TEST_WORLD, Settings, resolve
from heli_inner_hinf.controller_state import Actuation, ObserverInput, OutputLaw
from heli_inner_hinf.design import LEAST_GAMMA_FACTOR, AttitudeConfig, added_weights
from heli_inner_hinf.loops import (
    COMMANDS,
    N_Y,
    Loop,
    Model,
    flown_loop,
    flown_plant,
    further_delay_s,
    observer_loop,
    state_feedback_loop,
)
from heli_inner_hinf.mu import DiskMargin, smallest
from heli_inner_hinf.output_feedback import OutputWeights, central_law, generalised_plant
from heli_inner_hinf.robust.sampled_norm import HeldPlant, SampledLaw, SampledNorm, sampled_norm
from heli_inner_hinf.synthesis import N_H, N_U, N_X, Matrix, gamma_star, hinf_norm, weights
from heli_inner_hinf.tuning import (
    AxisGains,
    Candidate,
    LawBenchmark,
    LawFamily,
    LoopReport,
    SampledAircraft,
    analyse,
    choose_observer_gain,
    gains_of,
    loops_of,
    model_of,
    tune_pid,
)
from heli_outer_pd.analysis import (
    Axis,
    AxisReport,
    AxisRequirements,
    Gains,
    NoGainsError,
    Sampled,
    best_gains,
    cost,
    drifting,
    dryden_across,
    gains_at,
    law,
)
from heli_outer_pd.analysis import analyse as analyse_axis
from heli_outer_pd.parameters import OBSERVER_DAMPING, outer_params
from heli_outer_pd.position_law import tilt_for
from heli_outer_pd.state import OuterParams, collective_for_thrust
from heli_studies.design import rivals
from heli_studies.design.linear import NO_GROUND, is_linear, linear_basis
from heli_studies.robust import with_values

if TYPE_CHECKING:
    import control

# -------------------------------------------------------------------------------------------------
# What the attitude laws are searched over: the aircraft of the set, and the families of laws.
# -------------------------------------------------------------------------------------------------

_WORTH = 0.01
"""Share of the cost that moves a weight of the shipped law."""


class Member(NamedTuple):
    """An aircraft of the set: factors of the nominal one's values, and ticks of delay.

    Of the corners of the box of +-30 % and 0 to 3 ticks those at which laws come to an end first.
    """

    name: str
    inertia: tuple[float, float, float] = (1.0, 1.0, 1.0)
    rotor_stiffness: float = 1.0
    flapping: float = 1.0
    servo_speed: float = 1.0
    ticks: int | None = None
    disk_margin: float = 0.2
    mass: float = 1.0

    def stretched(self, by: float) -> Member:
        """As far beyond the box: its factors' distances to the nominal ones times `by`."""
        factors = ("rotor_stiffness", "flapping", "servo_speed", "mass")
        further = {key: 1.0 + by * (getattr(self, key) - 1.0) for key in factors}
        roll, pitch, yaw = (1.0 + by * (inertia - 1.0) for inertia in self.inertia)
        return self._replace(inertia=(roll, pitch, yaw), **further)


MEMBERS = (
    Member("flaps back", disk_margin=0.5),
    Member("slow", (1.3, 1.3, 1.3), 0.7, 1.3, 0.7, 2),
    Member("fast", (0.7, 0.7, 0.7), 1.3, 0.7, 0.7, 2),
    Member("stiff and late", (0.7, 0.7, 1.3), 1.3, 1.3, 0.7, 3),
    Member("stiff and light", (0.7, 0.7, 0.7), 1.3, 0.7, 1.3, 2),
    Member("limp and early", (1.3, 0.7, 0.7), 0.7, 1.3, 1.3, 0),
    # the flapping of roll and of pitch meet here
    Member("meeting, early", (1.3, 0.7, 0.7), 1.3, 1.3, 1.3, 0, 0.1),
    Member("meeting, slow", (1.3, 0.7, 0.7), 1.3, 1.3, 0.7, 1),
    Member("meeting, late", (1.3, 0.7, 0.7), 1.3, 1.3, 1.3, 3),
)

_BEYOND = 1.12
"""How far beyond the box `hinf_output` is held to be stable."""
EDGES = (
    *(Member("meeting, heavy", (1.3, 0.7, 0.7), 1.3, 1.3, 0.7, ticks, mass=1.3)
      for ticks in range(4)),
    Member("meeting, heavy, slow", (1.3, 0.7, 0.7), 1.3, 1.3, 0.8, 3, mass=1.3),
    *(Member("quick, heavy", (0.7, 0.7, 0.7), 1.3, 0.7, 1.3, ticks, mass=1.3) for ticks in (0, 1)),
    *(Member("late, heavy", (0.7, 0.7, 1.3), 1.3, 1.3, speed, 3, mass=1.3) for speed in (0.7, 0.8)),
)  # fmt: skip
"""Corners of the set of `heli robust` at which laws of the family `hinf_output` end first."""


def yardstick(helicopter: HelicopterParameters, actuation: Actuation) -> LawBenchmark:
    """The nominal aircraft, then `MEMBERS`, all of which flap back.

    Inertias divide their rows, so they need not be those of one rigid body.

    Raises
    ------
    TrimError
    """
    linear = linearize(helicopter, trim(helicopter))
    nominal = SampledAircraft("nominal", linear.A, linear.B, linear.E, actuation)
    others = tuple(_aircraft(one, helicopter, actuation) for one in MEMBERS)
    return LawBenchmark(nominal, others)


def beyond_the_box(
    measure: LawBenchmark, helicopter: HelicopterParameters, actuation: Actuation
) -> LawBenchmark:
    """The same with a floor of `hinf_output` alone: stable with `EDGES`, 12 % beyond the box.

    So that the law of default is proved with some room; others are not held to it. Raises as
    `yardstick`.
    """
    stretched = (one.stretched(_BEYOND) for one in EDGES)
    held = tuple(_aircraft(one, helicopter, actuation) for one in stretched)
    return replace(measure, held_stable=held)


def _aircraft(
    one: Member, helicopter: HelicopterParameters, actuation: Actuation
) -> SampledAircraft:
    values = {
        "mass": one.mass,
        "rotor_stiffness": one.rotor_stiffness,
        "flapping": one.flapping,
        "flap_back": flap_back_in_hover(helicopter),
    }
    changed = with_values(helicopter, values)
    linear = linearize(changed, trim(changed))
    rows = np.ones((len(NINE), 1))
    rows[[NINE.p, NINE.q, NINE.r], 0] = one.inertia
    delay_s = actuation.delay_s if one.ticks is None else one.ticks * TICK_S
    member_actuation = Actuation(
        one.servo_speed * actuation.servo_radps, actuation.servo_damping, delay_s
    )
    plant = (linear.A / rows, linear.B / rows, linear.E / rows)
    return SampledAircraft(one.name, *plant, member_actuation, one.disk_margin)


def searched_output(inner: Mapping[str, Any], measure: LawBenchmark) -> dict[str, Any]:
    """`output` of the inner loop's parameters, moved until no step of a number saves `_WORTH`.

    gamma stays, and `command_effort`, which the feedback does not know: how fast the position loop
    wants its commands followed the cost does not see. The valley of the cost is flat: from far
    starts other numbers cost as little.

    Raises
    ------
    NoLawError
        No law near the present one keeps the floors.
    """
    numbers = measure.best(output_family(inner), (1,), pairs=False, better=_WORTH)
    weights = output_weights(numbers, float(inner["output.command_effort"]))._asdict()
    return {f"output.{name}": np.asarray(value).tolist() for name, value in weights.items()}


def output_family(inner: Mapping[str, Any]) -> LawFamily:
    """`hinf_output` of the inner loop's parameters as a function of the weights `output` adds."""
    config = AttitudeConfig.from_parameters({**inner, "controller": "pid"})
    model = config.A, config.B, config.E, config.C, config.D
    gamma, command_effort = (float(inner[f"output.{key}"]) for key in ("gamma", "command_effort"))

    def law(numbers: Sequence[float]) -> OutputLaw:
        weights = output_weights(numbers, command_effort)
        plant = generalised_plant(*model, weights, config.actuation)
        return central_law(plant, weights, gamma)[0]

    return LawFamily("hinf_output", law, (numbers_of(added_weights(inner)),))


_SHARED = np.array([2, 2, 1, 1])
"""How many of `MEASURED` each of the four numbers of the noise is for: angles, p q, r, psi."""


def output_weights(numbers: Sequence[float], command_effort: float) -> OutputWeights:
    """Weights of `output_family`'s numbers: roll and pitch share their noise."""
    effort, integral, load, noise = np.split(np.asarray(numbers, float), (3, 6, 9))
    return OutputWeights(effort, integral, load, np.repeat(noise, _SHARED), command_effort)


def numbers_of(weights: OutputWeights) -> tuple[float, ...]:
    """The numbers of weights."""
    w = weights
    first_of_each = np.cumsum(_SHARED) - _SHARED
    numbers = (*w.effort, *w.integral, *w.load, *w.noise[first_of_each])
    return tuple(float(number) for number in numbers)


# -------------------------------------------------------------------------------------------------
# The whole loop as it flies, linear: attitude, collective and position of all axes at once.
#
# The three axes of the position loop are designed one by one; here they meet through the aircraft:
# the attitude loop's cross-coupling, the yaw that a collective makes, the speed that the rotors
# meet.
# -------------------------------------------------------------------------------------------------

_AXES, _N, _N_U = 3, len(NINE), len(INPUT_NAMES)
_SPEED, _POSITION = slice(_N, _N + _AXES), slice(_N + _AXES, _N + 2 * _AXES)
_LOWEST_RADPS, _FREQUENCIES = 1e-2, 400


@dataclass(frozen=True)
class CoupledPlant:
    """x+ = A x + B a over the position law's period; M x: of each axis in turn what the law reads.

    a (3,) are the commanded accelerations forward, right, down, m/s2; read are position, m, speed,
    m/s, and the acceleration that the tilt explains, m/s2.
    """

    A: Matrix
    B: Matrix
    M: Matrix
    dt_s: float

    @cached_property
    def response(self) -> tuple[Matrix, NDArray[np.complex128]]:
        """Frequencies (m,), rad/s, and the response (m, 9, 3) of a -> what is read."""
        omega = np.geomspace(_LOWEST_RADPS, 0.999 * np.pi / self.dt_s, _FREQUENCIES)
        z = np.exp(1j * omega * self.dt_s)
        return omega, np.stack([self.M @ _resolved(self.A, self.B, at) for at in z])


def coupled_plant(
    moving: MovingModel,
    at: TrimPoint,
    attitude: Loop,
    actuation: Actuation,
    kernel: OuterParams,
    period_ticks: int,
) -> CoupledPlant:
    """Aircraft in its mean wind, servos, delay and attitude law, from commands to what is held.

    Parameters
    ----------
    moving, at
        The aircraft about its trim.
    attitude : Loop
        As flown; of it the controller is used, with its errors turned by the trim's bank if it
        turns them.
    actuation : Actuation
        Of the collective, too.
    params : OuterParams
        Its thrust map turns an acceleration down into a collective.
    period_ticks : int
    """
    n = _N + 2 * _AXES
    A, B = np.zeros((n, n)), np.zeros((n, moving.B.shape[1]))
    A[: _SPEED.stop, :_N], B[: _SPEED.stop] = moving.A, moving.B
    A[: _SPEED.stop, _SPEED] = -moving.E @ quat_to_R_nb(at.x[PLANT.quat]).T
    A[_POSITION, _SPEED] = np.eye(_AXES)
    Ad, Bd = flown_plant(A, B, actuation)
    nine = reduced_state(at.x)
    tilt = nine[[NINE.phi, NINE.theta]]
    hang = kernel.trim[[SETPOINT.phi, SETPOINT.theta]]
    law_, y = attitude.controller, np.eye(len(Ad))[list(MEASURED)]
    if attitude.turned:
        law_ = _turned(law_, float(tilt[0] - hang[0]))
    to_law, from_law = np.split(law_.B, [len(MEASURED)], axis=1), Bd[:, :_N_U]
    direct = np.split(law_.D, [len(MEASURED)], axis=1)
    commands = np.zeros((len(COMMANDS), _AXES))
    against = kernel.g * np.tan((tilt - hang) * [1.0, -1.0])[::-1]
    per_mps2 = _tilt_per_mps2(against, kernel)
    commands[COMMANDS.index("theta_ref"), 0] = -per_mps2[0]
    commands[COMMANDS.index("phi_ref"), 1] = per_mps2[1]
    per_weight = _collective_per_weight(kernel)
    lift = np.cos(tilt[0]) * np.cos(tilt[1])
    collective = np.outer(Bd[:, _N_U], [0.0, 0.0, -per_weight / (kernel.g * lift)])
    one = np.block(
        [[Ad + from_law @ direct[0] @ y, from_law @ law_.C], [to_law[0] @ y, law_.A]],
    )
    enters = np.vstack([from_law @ direct[1] @ commands + collective, to_law[1] @ commands])
    enters = np.hstack([enters, np.vstack([Bd[:, _N_U:], np.zeros((len(law_.A), 1))])])
    power, held = np.eye(len(one)), np.zeros_like(enters)
    for _ in range(period_ticks):
        held, power = one @ held + enters, one @ power
    held, held_collective = held[:, :_AXES], held[:, _AXES]
    eye = np.eye(len(one))
    compensated = per_weight / lift * (np.tan(tilt) @ eye[[NINE.phi, NINE.theta]])
    power += np.outer(held_collective, compensated)
    explained = np.zeros((_AXES, len(one)))
    explained[:2, [NINE.theta, NINE.phi]] = np.diag([-1.0, 1.0]) / per_mps2
    # The observer is kept in NED, which turns against the nose.
    explained[:2, NINE.psi] = -against[1], against[0]
    read = [(eye[_POSITION.start + i], eye[_SPEED.start + i], explained[i]) for i in range(_AXES)]
    M = np.concatenate(read)
    # What is held against the wind turns as the nose does.
    power += held @ np.outer([against[1], -against[0], 0.0], eye[NINE.psi])
    return CoupledPlant(power, held, M, period_ticks * attitude.dt)


def common_disk_margin(
    plant: CoupledPlant, axes: tuple[Axis, ...], gains: tuple[Gains, ...]
) -> DiskMargin:
    """Of the loop broken at all three commands at once; 0 if it is not stable."""
    laws = [law(axis_gains, axis) for axis_gains, axis in zip(gains, axes, strict=True)]
    A, B, C, D = (block_diag(*(one[part] for one in laws)) for part in range(4))
    closed = np.block([[plant.A + plant.B @ D @ plant.M, plant.B @ C], [B @ plant.M, A]])
    if np.max(np.abs(np.linalg.eigvals(closed))) >= 1.0:
        return DiskMargin(0.0, 0.0)
    omega, moved = plant.response
    commanded = np.stack([C @ _resolved(A, B, at) + D for at in np.exp(1j * omega * plant.dt_s)])
    return smallest(-commanded @ moved, omega)


def _turned(law_: control.StateSpace, bank_rad: float) -> control.StateSpace:
    """The law behind `controller_state.read_inputs` at a lasting bank beyond trim."""
    pitch, heading = (MEASURED.index(i) for i in (NINE.theta, NINE.psi))
    wanted = len(MEASURED) + COMMANDS.index("theta_ref")
    turn = np.eye(law_.ninputs)
    c, s = np.cos(bank_rad), np.sin(bank_rad)
    turn[np.ix_([pitch, heading], [pitch, heading, wanted])] = [[c, s, 1.0 - c], [-s, c, s]]
    import control

    return control.ss(law_.A, law_.B @ turn, law_.C, law_.D @ turn, law_.dt)


def _resolved(A: Matrix, B: Matrix, z: complex) -> np.ndarray:
    return np.linalg.solve(z * np.eye(len(A)) - A, B)


def _tilt_per_mps2(acceleration: Matrix, kernel: OuterParams) -> Matrix:
    """Slope of (21), rad s2/m, about the accelerations (2,) that are held, m/s2."""
    step = 1e-4
    return np.array(
        [
            (tilt_for(a + step, kernel) - tilt_for(a - step, kernel)) / (2.0 * step)
            for a in acceleration
        ]
    )


def _collective_per_weight(kernel: OuterParams) -> float:
    """What the law's thrust map makes of a thrust, in units of the weight, at trim."""
    k, step = kernel, 1e-4
    weight, tilt = k.mass * k.g, np.cos(k.trim[SETPOINT.phi]) * np.cos(k.trim[SETPOINT.theta])
    d_col = k.trim[SETPOINT.col]
    more, less = (
        collective_for_thrust(
            weight / tilt + sign * step * weight, 0.0, weight / tilt, d_col, k.rotor
        )
        for sign in (1.0, -1.0)
    )
    return float((more - less) / (2.0 * step))


# -------------------------------------------------------------------------------------------------
# The position loop around a designed attitude loop: its gains, what they are worth, the limit.
#
# Air, aircraft's terms and wind are those of the hover test's world, with nothing drawn: the
# loop's
# acceleration comes from the aircraft's equations about its trim in the mean wind. So there is no
# report for an aircraft that is identified.
# -------------------------------------------------------------------------------------------------

# A half of the paper's speeds and a quarter of its positions at 3.5 sigma; the margins that issue
# from the doubt of mass, thrust and delay; tilt that shakes by a sixth of the paper's 1.7 deg.
_WANTED = tuple(
    AxisRequirements(
        position / 3.5, speed / 3.5, disk_margin=0.6, disk_margin_of_others=0.4, step_mps2=step
    )
    for position, speed, step in ((0.16, 0.15, 0.05), (0.25, 0.15, 0.05), (0.10, 0.09, np.inf))
)
_DOUBT = 0.3
"""Of the acceleration that a command gives (mass, slope of the thrust) and of the servos' speed."""
_BANKED = ((8.0, 0.3), (10.0, 0.2))
"""Side wind from either side, m/s: 20 and 30 deg of bank; the common margin's floor there."""
_MISSED = 1e6
"""Price of gains that miss the floors in banked flight, before what they miss them by."""


@dataclass(frozen=True)
class PositionLoop:
    """The loop's parts that an aircraft decides.

    Attributes
    ----------
    axes : tuple of Axis
        Forward, right, down, as modelled.
    others : tuple of tuple of Axis
        Of each axis a tick later, that with slower servos, and with more and with less acceleration
        per command.
    lags_s : (2,) array
        Lag of pitch and roll behind their commands at low frequency.
    coupled : CoupledPlant
        The axes as they meet in the aircraft.
    banked : tuple of (CoupledPlant, float)
        The same in side wind, and the floor of the common margin there.
    """

    axes: tuple[Axis, ...]
    others: tuple[tuple[Axis, ...], ...]
    lags_s: np.ndarray
    coupled: CoupledPlant
    banked: tuple[tuple[CoupledPlant, float], ...] = ()

    def reports(self, outer: Mapping[str, Any]) -> tuple[AxisReport, ...]:
        """Of the gains of the outer loop's parameters."""
        kernel = outer_params(outer)
        return tuple(analyse_axis(axis, Gains.of(kernel, i)) for i, axis in enumerate(self.axes))

    def common_margin(self, outer: Mapping[str, Any]) -> DiskMargin:
        """Disk margin with phi_ref, theta_ref and the collective broken together."""
        kernel = outer_params(outer)
        gains = tuple(Gains.of(kernel, i) for i in range(len(self.axes)))
        return common_disk_margin(self.coupled, self.axes, gains)

    def chosen(self, outer: Mapping[str, Any]) -> dict[str, list[float]]:
        """Gains that the search yields, as parameters of the outer loop.

        Raises
        ------
        NoGainsError
            An axis has none that keep the margins.
        """
        filter_s = outer["attitude_lead.filter_s"]
        alone = [
            best_gains(NAMES[i], axis, self.others[i], _WANTED[i], OBSERVER_DAMPING, filter_s)
            for i, axis in enumerate(self.axes)
        ]
        gains = self._held_in_bank(alone, filter_s)
        K_P, K_D, bandwidth, lead_s = (list(column) for column in zip(*gains, strict=True))
        return {
            "K_P": K_P,
            "K_D": K_D,
            "disturbance.bandwidth_radps": bandwidth,
            "attitude_lead.lead_s": lead_s[:2],
        }

    def _held_in_bank(
        self, alone: Sequence[Sequence[float]], filter_s: float
    ) -> list[tuple[float, ...]]:
        """From each axis' own gains to such as keep the floors in banked flight, too.

        There the axes meet: a pitch turns the nose, and the nose what is held against the wind.
        """
        down = tuple(alone[-1])

        def rows(numbers: Sequence[float]) -> list[tuple[float, ...]]:
            return [*(tuple(row.tolist()) for row in np.split(np.array(numbers), 2)), down]

        def price(numbers: Sequence[float]) -> float:
            gains = tuple(gains_at(row, OBSERVER_DAMPING, filter_s) for row in rows(numbers))
            axes_cost = sum(
                cost(gains[i], self.axes[i], self.others[i], _WANTED[i]) for i in range(2)
            )
            if not np.isfinite(axes_cost):
                return np.inf
            missed = sum(
                max(0.0, floor - common_disk_margin(plant, self.axes, gains).alpha)
                for plant, floor in self.banked
            )
            return axes_cost if missed <= 0.0 else _MISSED * (1.0 + missed)

        optimum = search((*alone[0], *alone[1]), price, (1,), pairs=False)
        if price(optimum) >= _MISSED:
            raise NoGainsError(
                "position loop: no gains near those of the single axes keep the floors of the "
                "common disk margin in side wind: the attitude loop is too slow"
            )
        return rows(optimum)


def position_loop(
    plant: Mapping[str, Any],
    outer: Mapping[str, Any],
    attitude: Loop,
    model: Model,
    actuation: Actuation,
) -> PositionLoop:
    """The three axes around an attitude loop as flown.

    Parameters
    ----------
    plant, outer : mapping
        Parameters of the plant (aircraft, wind, start) and of the outer loop; of the latter's gains
        nothing is used.
    attitude : Loop
        As flown.
    model : Model
        What the attitude loop was designed for.
    actuation : Actuation

    Raises
    ------
    PlantConfigError, TrimError
    """
    around = position_axes(plant, outer, attitude, model)
    gusts = _gusts(around.config)
    nominal = around.axes(actuation, gusts)
    late = replace(actuation, delay_s=actuation.delay_s + TICK_S)
    slow_and_late = replace(late, servo_radps=(1.0 - _DOUBT) * late.servo_radps)
    others = tuple(
        (*later, _stronger(axis, 1.0 + _DOUBT), _stronger(axis, 1.0 - _DOUBT))
        for axis, *later in zip(
            nominal, around.axes(late, gusts), around.axes(slow_and_late, gusts), strict=True
        )
    )
    flown = attitude, actuation, around.params, around.period_ticks
    coupled = coupled_plant(around.moving, around.at, *flown)
    banked = []
    for speed_mps, floor in _BANKED:
        for side in (-1.0, 1.0):
            held = trim(around.config.helicopter, np.array([0.0, side * speed_mps, 0.0]), 0.0)
            leaning = linearize_moving(around.config.helicopter, held)
            banked.append((coupled_plant(leaning, held, *flown), floor))
    return PositionLoop(nominal, others, around.lags_s, coupled, tuple(banked))


def _gusts(config: PlantConfig) -> tuple[tuple[Sampled, ...], ...]:
    """Turbulence along each axis where the flight begins."""
    wind, altitude_m = config.wind, -float(config.pos_ned_m[2])
    sigma, sigma_w, length_m, length_w_m = dryden_scales(altitude_m, wind.w20_mps)
    speed_mps = passing_speed(altitude_m, wind)
    time_s = length_m / speed_mps
    along, across = np.abs(downwind(config)[:2])
    return (
        (drifting(along * sigma, time_s), dryden_across(across * sigma, time_s)),
        (drifting(across * sigma, time_s), dryden_across(along * sigma, time_s)),
        (dryden_across(sigma_w, length_w_m / speed_mps),),
    )


def _stronger(axis: Axis, factor: float) -> Axis:
    """The axis with so much more acceleration per command."""
    act = axis.actuation
    commanded = np.array([factor, 1.0])
    return replace(axis, actuation=act._replace(B=act.B * commanded, D=act.D * commanded))


# -------------------------------------------------------------------------------------------------
# Which bounds on the norm a design is asked to keep.
# -------------------------------------------------------------------------------------------------

_BOUND_KEYS = {"hinf_output": "output.gamma", "hinf": "gamma"}
"""By controller the parameter that bounds its norm; the others have none."""


def bound_of(
    inner: Mapping[str, Any], gamma: float | None, factor: float | None, actuation: Actuation
) -> dict[str, float]:
    """The bounds of a design: of the controller that flies as it is asked for.

    Parameters
    ----------
    inner : mapping
        The inner loop's parameters.
    gamma, factor : float or None
        The bound itself, or as a multiple of gamma*; without either the parameter.
    actuation : Actuation

    Returns
    -------
    dict
        Parameters of the inner loop by name. The packaged `output.gamma` is raised for an aircraft
        that has no law below it; one that was asked for is not.

    Raises
    ------
    ParameterError
        Both are given, or the controller has no bound.
    SynthesisError
    """
    if gamma is not None and factor is not None:
        raise ParameterError("gamma and gamma factor: give one of them, not both")
    controller = inner["controller"]
    key = _BOUND_KEYS.get(controller)
    if key is None and not (gamma is None and factor is None):
        option = "gamma" if factor is None else "gamma factor"
        raise ParameterError(
            f"{option}: controller {controller} has no bound on its norm; "
            f"{' and '.join(_BOUND_KEYS)} have"
        )
    if key is not None and gamma is not None:
        if not 0.0 < gamma < np.inf:
            raise InfeasibleGammaError(gamma, _gamma_star(inner, actuation), key)
        return {key: gamma}
    if key is not None and factor is not None:
        return {key: factor * _gamma_star(inner, actuation)}
    return {"output.gamma": _output_gamma(inner, actuation)}


def _gamma_star(inner: Mapping[str, Any], actuation: Actuation) -> float:
    """gamma* of the controller that flies, which has one."""
    if inner["controller"] == "hinf_output":
        return optimal_gamma(_output_plant(inner, actuation), float(inner["output.gamma"])).value
    C, D = weights(inner["C11"], inner["C22"], inner["D11"])
    return gamma_star(inner["model.A"], inner["model.B"], inner["model.E"], C, D).value


def _output_plant(inner: Mapping[str, Any], actuation: Actuation) -> GeneralisedPlant:
    model = inner["model.A"], inner["model.B"], inner["model.E"]
    C, D = weights(inner["C11"], inner["C22"], inner["D11"])
    return generalised_plant(*model, C, D, added_weights(inner), actuation)


def _output_gamma(inner: Mapping[str, Any], actuation: Actuation) -> float:
    """`output.gamma`; for an aircraft that has no law below the packaged one a bound above it."""
    gamma = float(inner["output.gamma"])
    if gamma != resolve().nodes["inner_loop"]["output.gamma"]:
        return gamma
    try:
        star = optimal_gamma(_output_plant(inner, actuation), gamma).value
    except NoControllerError:
        return gamma  # what flies it says why
    least = LEAST_GAMMA_FACTOR * star
    return gamma if gamma >= least else float(f"{least:.3g}")


# -------------------------------------------------------------------------------------------------
# The norm wind -> h of the attitude loop as flown, between its samples as well.
#
# The wind blows and h of eq. (11) is counted at every instant, the law acts a hundred times a
# second.
# -------------------------------------------------------------------------------------------------

_FAST_SERVO = Actuation(1000.0, 1.0, 0.0)
"""Servos that cost nothing, and no transport delay."""


def norm_between_samples(model: Model, actuation: Actuation, flown: Loop) -> SampledNorm:
    """The norm from wind u v w (m/s) to h (9), enclosed; the law is that of the loop as flown.

    Raises
    ------
    RobustError
        The loop is not stable.
    """
    A, B = with_servos(model.A, model.B, actuation.servo_radps, actuation.servo_damping)
    n, rates = A.shape[0], np.zeros((N_H, N_U))
    plant = HeldPlant(
        A=A,
        B=B,
        E=np.vstack([model.E, np.zeros((n - N_X, N_U))]),
        C=np.hstack([model.C, model.D, rates]),
        C_y=np.eye(n)[list(MEASURED)],
        tick_s=TICK_S,
        delay_s=actuation.delay_s,
    )
    law = flown.controller
    return sampled_norm(plant, SampledLaw(law.A, law.B[:, :N_Y], law.C, law.D[:, :N_Y]))


def norms_on_the_way(
    model: Model, K: Matrix, prediction_s: float, feed: ObserverInput, actuation: Actuation
) -> list[tuple[str, float]]:
    """Norm wind -> h from what is proved to what is flown, one cause more at each step.

    Of state feedback (hinf, lqr), observer included. Output feedback has no such way: it is made
    on the plant as flown, and its norm is `norm_between_samples`.

    Returns
    -------
    list of (cause, norm)
        inf where the loop is not stable.
    """
    norms = []
    for name, loop in (
        ("state feedback", state_feedback_loop(model)),
        ("with the observer", observer_loop(model, K)),
    ):
        T = loop.wind_to_h
        stable = loop.stability() < 0.0
        norms.append((name, hinf_norm(T.A, T.B, T.C)[0] if stable else np.inf))
    late = replace(actuation, delay_s=0.0)
    no_delay = replace(feed, u_delay_ticks=0)
    for name, prediction, fed, lag in (
        ("at 100 Hz", 0.0, replace(no_delay, servo_radps=0.0), _FAST_SERVO),
        ("with servos", 0.0, no_delay, late),
        ("with transport delay", 0.0, feed, actuation),
        ("with prediction", prediction_s, feed, actuation),
    ):
        flown = flown_loop(model, K, prediction, fed, lag)
        try:
            norms.append((name, norm_between_samples(model, lag, flown).upper))
        except RobustError:
            norms.append((name, np.inf))
    return norms


# -------------------------------------------------------------------------------------------------
# Make.
# -------------------------------------------------------------------------------------------------

_MAX_DELAY_TICKS = 2
LONGEST_DELAY_S = 0.2


@dataclass(frozen=True)
class Basis:
    """What a design is made from: calculated from an aircraft file, or identified in flight.

    Attributes
    ----------
    source : str
        Where the numbers come from, for people.
    system : control.StateSpace
        Linear model about trim, eq. (9), SI and rad, as `heli_core.linear.hover_system`.
    x_trim : (9,) array
        Trim of the nine states; psi is 0.
    u_trim : (4,) array
        Trim of d_lat, d_lon, d_ped, d_col.
    actuation : Actuation
        Servo and transport delay.
    outer : mapping
        Parameters of the outer loop: mass, gravity, rotor.* of the thrust map.
    plant : mapping
        Parameters of the plant that belong to the aircraft; empty for one that is not simulated.
    residual : float
        Largest residual of the trim; nan where it was measured.
    """

    source: str
    system: control.StateSpace
    x_trim: np.ndarray
    u_trim: np.ndarray
    actuation: Actuation
    outer: Mapping[str, Any]
    plant: Mapping[str, Any]
    residual: float

    @property
    def A(self) -> np.ndarray:
        """(9, 9), see `system`."""
        return self.system.A

    @property
    def B(self) -> np.ndarray:
        """(9, 3): effect of d_lat d_lon d_ped."""
        return self.system.B[:, : len(INPUT_NAMES)]

    @property
    def E(self) -> np.ndarray:
        """(9, 3): effect of the wind."""
        return self.system.B[:, len(INPUT_NAMES) :]


@dataclass(frozen=True)
class FinishedDesign:
    """A finished design.

    Attributes
    ----------
    basis : Basis
        Model, trim and actuation that it is made from.
    attitude : AttitudeConfig
        Judged inner loop: model, F, G, certificate.
    observer : Candidate
        The reduced-order observer (19) and its margins.
    pid : tuple of AxisGains
        The PID of the same aircraft, by its rule.
    loops : tuple of Loop
        State feedback, with observer, as flown; of output feedback as flown alone.
    reports : tuple of LoopReport
        Of the loops.
    between_samples : SampledNorm
        Norm wind -> h of the loop as flown, between its samples as well.
    further_delay_s : float
        What the loop as flown survives on top of its own delay.
    outer : tuple of AxisReport
        The position loop with its present gains, forward, right, down; empty for an identified
        and for a linear aircraft.
    outer_together : DiskMargin or None
        With its three channels broken together, the axes as they meet in the aircraft.
    values : dict
        Node name to the parameters that the design decides.
    remarks : tuple of str
        Sentences about the parameters that it was made from, as of `Settings`.
    """

    basis: Basis
    attitude: AttitudeConfig
    observer: Candidate
    pid: tuple[AxisGains, ...]
    loops: tuple[Loop, ...]
    reports: tuple[LoopReport, ...]
    between_samples: SampledNorm
    further_delay_s: float
    outer: tuple[AxisReport, ...]
    outer_together: DiskMargin | None
    values: Mapping[str, Mapping[str, Any]]
    remarks: tuple[str, ...] = ()

    @property
    def actuation(self) -> Actuation:
        """Servo and delay of the aircraft."""
        return self.basis.actuation

    @property
    def model(self) -> Model:
        """The linear model with its state feedback."""
        return model_of(self.attitude)

    @property
    def observer_input(self) -> ObserverInput:
        """How the command enters the observer."""
        return observer_input(self.actuation)


def make_design(
    params: Sequence[Path] = (),
    aircraft: str | None = None,
    gamma: float | None = None,
    gamma_factor: float | None = None,
    search: bool = False,
    controller: str | None = None,
) -> FinishedDesign:
    """Trim, linearise, synthesise, choose the observer, tune the PID, analyse.

    `output` and the position loop's gains are searched for if asked, else stay those of the
    parameters.

    Parameters
    ----------
    params : sequence of path
        rcl parameter files with weights and whatever else shall differ from the packaged values.
    aircraft : str, optional
        An aircraft file, or the bare name of a packaged one; default: the plant's.
    gamma : float, optional
        Bound on the norm of the controller that flies; default: the parameter.
    gamma_factor : float, optional
        Bound as a multiple of its gamma*, instead.
    search : bool
        Search for the position loop's gains, and, for the parameters' own aircraft, for `output`
        from the present numbers; another aircraft keeps these.
    controller : str, optional
        Which attitude controller flies; default: the parameters'.

    Raises
    ------
    ParameterError, AircraftError, TrimError, SynthesisError, NoGainsError
        Each with a sentence; the same as the nodes give.
    """
    settings = resolve(params=params, controller=controller).at_100_hz("heli design")
    air = resolve(params=params, world=HOVER_TEST_WORLD).nodes["plant"]
    basis = aircraft_basis(settings, aircraft)
    measure = None
    if search and aircraft is None:
        helicopter = HelicopterParameters.from_yaml(settings.nodes["plant"]["aircraft_file"])
        common = yardstick(helicopter, basis.actuation)
        measure = beyond_the_box(common, helicopter, basis.actuation)
    return design_of(basis, settings, gamma, gamma_factor, air, search, measure)


def aircraft_basis(settings: Settings, aircraft: str | None = None) -> Basis:
    """Trim and linearise an aircraft file; arguments and errors as in `make_design`."""
    plant = settings.nodes["plant"]
    linear_model = aircraft or plant[LINEAR]
    if is_linear(linear_model):
        return Basis(**linear_basis(linear_model, plant)._asdict())
    file = aircraft or plant["aircraft_file"]
    helicopter = HelicopterParameters.from_yaml(file)
    if aircraft is not None and Path(file).is_file():
        file = str(find_aircraft(file).resolve())
    at = trim(helicopter)
    linear = linearize(helicopter, at)
    x_trim = linear.x_trim.copy()
    x_trim[NINE.psi] = 0.0
    delay_ticks = min(int(plant["delay_ticks"]), _MAX_DELAY_TICKS)
    return Basis(
        source=f"aircraft {file}",
        system=linear.system,
        x_trim=x_trim,
        u_trim=at.u,
        actuation=Actuation(
            helicopter.servo_bandwidth_radps, helicopter.servo_damping, delay_ticks * TICK_S
        ),
        outer={
            "mass": helicopter.mass_kg,
            "gravity": helicopter.gravity_mps2,
            "rotor.rho": helicopter.air_density_kgpm3,
            "rotor.omega": helicopter.main_speed_radps,
            "rotor.radius": helicopter.main_radius_m,
            "rotor.lift_slope": helicopter.main_lift_slope,
            "rotor.blades": round(helicopter.main_blades),
            "rotor.chord": helicopter.main_chord_m,
            "rotor.K_col": helicopter.collective_gain_rad,
        },
        plant={"aircraft_file": file},
        residual=float(at.residual),
    )


def design_of(
    basis: Basis,
    settings: Settings,
    gamma: float | None = None,
    gamma_factor: float | None = None,
    air: Mapping[str, Any] | None = None,
    search: bool = False,
    measure: LawBenchmark | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> FinishedDesign:
    """Synthesise, choose the observer, tune the PID, analyse; no aircraft file is read.

    Parameters
    ----------
    basis : Basis
    settings : Settings
        Weights, gamma and whatever else the inner loop's parameters hold.
    gamma, gamma_factor
        As in `make_design`.
    search : bool
        Search for the position loop's gains.
    air : mapping, optional
        Parameters of the plant in whose wind and with whose terms the position loop is judged;
        default: the settings'.
    measure : Yardstick, optional
        Search by it for the numbers of `output`.
    tell : callable
        Told what comes next, a few words.

    Raises
    ------
    ParameterError, SynthesisError
    """
    actuation = basis.actuation
    tell("attitude law and its certificate")
    inner: dict[str, Any] = {
        **settings.nodes["inner_loop"],
        "model.A": basis.A,
        "model.B": basis.B,
        "model.E": basis.E,
        "trim.x": basis.x_trim,
        "trim.u": basis.u_trim,
        "servo.frequency_radps": actuation.servo_radps,
        "servo.damping": actuation.servo_damping,
        "delay_ticks": ticks_in(actuation.delay_s),
        "prediction_s": round(actuation.known_lag_s, 3),
    }
    inner |= bound_of(inner, gamma, gamma_factor, actuation)
    if measure is not None:
        inner |= searched_output(inner, measure)
    attitude = AttitudeConfig.from_parameters(inner)
    inner["gamma"] = attitude.synthesis.gamma
    feed = observer_input(actuation)
    model = model_of(attitude)
    tell("observer")
    plain = replace(model, shift_rate=0.0)
    best, _ = choose_observer_gain(plain, attitude.prediction_s, actuation, feed)
    tell("PID")
    pid = tune_pid(plain, actuation)
    inner |= {f"pid.{name}": gains for name, gains in gains_of(pid).items()}
    loops = loops_of(attitude, best.K, feed, actuation)
    values: dict[str, dict[str, Any]] = {
        "inner_loop": {key: inner[key] for key in _INNER_KEYS},
        "observer": _observer_values(inner, best, actuation),
        "outer_loop": _outer_values(basis, loops[-1]),
    }
    outer: tuple[AxisReport, ...] = ()
    together = None
    if basis.plant:
        values["plant"] = dict(basis.plant)
    if LINEAR in basis.plant:
        values["inner_loop"] |= NO_GROUND
    if basis.plant and LINEAR not in basis.plant:
        tell("position loop")
        outer_parameters = {**settings.nodes["outer_loop"], **values["outer_loop"]}
        around = {**(air or settings.nodes["plant"]), **basis.plant}
        position = position_loop(around, outer_parameters, loops[-1], model, actuation)
        if search:
            values["outer_loop"] |= position.chosen(outer_parameters)
        outer = position.reports(outer_parameters | values["outer_loop"])
        together = position.common_margin(outer_parameters | values["outer_loop"])
    tell("margins of the loop as flown")
    return FinishedDesign(
        basis=basis,
        attitude=attitude,
        observer=best,
        pid=pid,
        loops=loops,
        reports=tuple(analyse(loop) for loop in loops),
        between_samples=norm_between_samples(model, actuation, loops[-1]),
        further_delay_s=further_delay_s(loops[-1], model, actuation, LONGEST_DELAY_S),
        outer=outer,
        outer_together=together,
        values=values,
        remarks=settings.remarks,
    )


_INNER_KEYS = (
    "gamma", "C11", "C22", "D11", "output.gamma", "output.effort", "output.integral",
    "output.load", "output.noise", "output.command_effort",
    "trim.x", "trim.u", "model.A", "model.B", "model.E",
    "servo.frequency_radps", "servo.damping", "delay_ticks", "prediction_s",
    "pid.K_P", "pid.K_I", "pid.K_D",
)  # fmt: skip


def observer_input(actuation: Actuation) -> ObserverInput:
    """The observer is fed the command as late as the aircraft, through a model of its servos."""
    return ObserverInput(
        ticks_in(actuation.delay_s), actuation.servo_radps, actuation.servo_damping
    )


def _observer_values(
    inner: Mapping[str, Any], best: Candidate, actuation: Actuation
) -> dict[str, Any]:
    return {
        "model.A": inner["model.A"],
        "model.B": inner["model.B"],
        "trim.x": inner["trim.x"],
        "trim.u": inner["trim.u"],
        "K": best.K,
        "u_delay_ticks": ticks_in(actuation.delay_s),
        "servo.frequency_radps": actuation.servo_radps,
        "servo.damping": actuation.servo_damping,
    }


def _outer_values(basis: Basis, attitude: Loop) -> dict[str, Any]:
    return {
        "mass": basis.outer["mass"],
        "gravity": basis.outer["gravity"],
        "trim.phi": float(basis.x_trim[NINE.phi]),
        "trim.theta": float(basis.x_trim[NINE.theta]),
        "trim.d_col": float(basis.u_trim[ACTUATOR.col]),
        "disturbance.attitude_lag_s": np.round(attitude_lags_s(attitude), 2),
        **{
            key: value
            for key, value in basis.outer.items()
            if key.startswith("rotor.") or key == "blade_pitch_floor"
        },
    }


def write_yaml(design: FinishedDesign, path: Path, by: str = "heli design") -> None:
    """Write the rcl parameter file that plant, observer, inner and outer loop load; `by`: who."""
    dump_all(design.values, path)
    bound = design.attitude.bound
    controller = design.attitude.controller
    certificate = (
        "without a bound on its norm"
        if bound is None
        else (
            f"gamma = {bound.gamma:.8g}, gamma* = {bound.gamma_star.value:.10g}, "
            f"norm = {bound.norm:.6g}"
        )
    )
    flown = design.reports[-1]
    plant = "plant, " if "plant" in design.values else ""
    head = (
        f"# Design by {by}: one file for {plant}observer, inner_loop and outer_loop.\n"
        f"# {controller}: {certificate}\n"
        f"# as flown: disk margin {flown.disk_input.alpha:.3f} at the plant input, "
        f"{flown.disk_output.alpha:.3f} at its output\n"
        "# Arrays are flat, row by row; units and meaning: the packaged YAML of each node.\n"
    )
    write_whole(path, head + path.read_text(encoding="utf-8"))


# -------------------------------------------------------------------------------------------------
# `heli design --check`: whether the packaged YAML holds what the searches yield.
# -------------------------------------------------------------------------------------------------

SEARCHED = {
    "inner_loop": (
        "output.effort",
        "output.integral",
        "output.load",
        "output.noise",
    ),
    "outer_loop": (
        "K_P",
        "K_D",
        "disturbance.bandwidth_radps",
        "disturbance.attitude_lag_s",
        "attitude_lead.lead_s",
    ),
}
"""By node the parameters that a search chooses, on a grid of rounded numbers."""


def differences(design: FinishedDesign, params: Sequence[Path] = ()) -> list[str]:
    """Where what is shipped is not what the searches yield, a sentence each.

    Parameters
    ----------
    design : FinishedDesign
        Made with the searches.
    params : sequence of path
        Parameter files that the design was made with.
    """
    nodes = resolve(params=params).nodes
    yielded = {
        node: {key: design.values[node][key] for key in keys} for node, keys in SEARCHED.items()
    }
    sentences = [
        line
        for node, values in yielded.items()
        for line in _parameter_differences(node, nodes[node], values)
    ]
    actuation = AttitudeConfig.from_parameters(
        {**nodes["inner_loop"], "controller": "pid"}
    ).actuation
    helicopter = HelicopterParameters.from_yaml(nodes["plant"]["aircraft_file"])
    measure = yardstick(helicopter, actuation)
    for controller in rivals.KEYS:
        rival_nodes = resolve(params=params, laws=controller).nodes
        # One number at a time, from what is shipped on.
        optimum = rivals.chosen(controller, rival_nodes, measure, (1,), pairs=False)
        sentences += _parameter_differences(
            f"laws {controller}: inner_loop", rival_nodes["inner_loop"], optimum
        )
    return sentences


def _parameter_differences(
    where: str, shipped: Mapping[str, Any], yielded: Mapping[str, Any]
) -> list[str]:
    """A sentence for each parameter that differs."""
    return [
        f"{where}: {key}: shipped {np.asarray(shipped[key]).tolist()}, the search yields "
        f"{np.asarray(value).tolist()}"
        for key, value in yielded.items()
        if not np.array_equal(np.ravel(shipped[key]), np.ravel(value))
    ]
