# SPDX-License-Identifier: Apache-2.0
"""The search of position gains: the coupled plant of the outer loop, its margins, what it costs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

from heli_core.rotations import quat_to_R_nb
from heli_core.rows import INPUT_NAMES, MEASURED, NINE, PLANT, SETPOINT
from heli_core.search import search
from heli_core.ticks import TICK_S
from heli_dynamics_sim.config import PlantConfig
from heli_dynamics_sim.trim import (
    MovingModel,
    TrimPoint,
    linearize_moving,
    reduced_state,
    trim,
)
from heli_dynamics_sim.wind import dryden_scales, passing_speed
from heli_flight.position_axes import NAMES, downwind, position_axes
from heli_inner_hinf.controller_state import Actuation
from heli_inner_hinf.loops import (
    COMMANDS,
    Loop,
    Model,
    flown_plant,
)
from heli_inner_hinf.mu import DiskMargin, smallest
from heli_inner_hinf.regular_form import Matrix
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

if TYPE_CHECKING:
    import control


# -------------------------------------------------------------------------------------------------
# The whole loop as it flies, linear: attitude, collective and position of all axes at once.
#
# The three axes of the position loop are designed one by one; here they meet through the aircraft:
# the attitude loop's cross-coupling, the yaw that a collective makes, the speed that the rotors
# meet.
# -------------------------------------------------------------------------------------------------

_AXES, _N, _N_U = 3, len(NINE), len(INPUT_NAMES)
SPEED, POSITION = slice(_N, _N + _AXES), slice(_N + _AXES, _N + 2 * _AXES)
_LOWEST_RADPS, _FREQUENCIES = 1e-2, 400


@dataclass(frozen=True)
class CoupledPlant:
    """x+ = A x + B a over the position controller's period; M x: its inputs, axis by axis.

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


class CommandedAircraft(NamedTuple):
    """An aircraft behind servos and delay, and what the position controller's command is to it.

    Attributes
    ----------
    A, B : (n, n), (n, 4) arrays
        One tick; states: the nine, speed and position (heading frame, deviations), then those of
        servos and delay; inputs: the actuators.
    commands : (3, 3) array
        phi_ref, theta_ref, psi_ref of the commanded accelerations, rad s2/m.
    collective : (3,) array
        Of the commanded accelerations, s2/m.
    compensated : (n,) array
        Collective for the lift that tilt takes, of the state.
    explained : (3, n) array
        Accelerations that the tilt explains, m/s2.
    turned : (3,) array
        Commanded acceleration per heading, as what is compared with the wind turns, m/s2/rad.
    bank_rad : float
        In the trim, beyond that of still air.
    """

    A: Matrix
    B: Matrix
    commands: Matrix
    collective: Matrix
    compensated: Matrix
    explained: Matrix
    turned: Matrix
    bank_rad: float


def moving_system(moving: MovingModel, at: TrimPoint) -> tuple[Matrix, Matrix, Matrix]:
    """A (15, 15), B (15, 4), E (15, 3) of the nine, speed and position; air in the body's axes."""
    n = _N + 2 * _AXES
    A, B, E = np.zeros((n, n)), np.zeros((n, moving.B.shape[1])), np.zeros((n, _AXES))
    A[: SPEED.stop, :_N], B[: SPEED.stop], E[: SPEED.stop] = moving.A, moving.B, moving.E
    A[: SPEED.stop, SPEED] = -moving.E @ quat_to_R_nb(at.x[PLANT.quat]).T
    A[POSITION, SPEED] = np.eye(_AXES)
    return A, B, E


def commanded_aircraft(
    moving: MovingModel, at: TrimPoint, actuation: Actuation, kernel: OuterParams
) -> CommandedAircraft:
    """The aircraft about its trim; the thrust map is the kernel's."""
    A, B, _ = moving_system(moving, at)
    Ad, Bd = flown_plant(A, B, actuation)
    nine = reduced_state(at.x)
    tilt = nine[[NINE.phi, NINE.theta]]
    hang = kernel.trim[[SETPOINT.phi, SETPOINT.theta]]
    commands = np.zeros((len(COMMANDS), _AXES))
    against = kernel.g * np.tan((tilt - hang) * [1.0, -1.0])[::-1]
    per_mps2 = _tilt_per_mps2(against, kernel)
    commands[COMMANDS.index("theta_ref"), 0] = -per_mps2[0]
    commands[COMMANDS.index("phi_ref"), 1] = per_mps2[1]
    per_weight = _collective_per_weight(kernel)
    lift = np.cos(tilt[0]) * np.cos(tilt[1])
    eye = np.eye(len(Ad))
    explained = np.zeros((_AXES, len(Ad)))
    explained[:2, [NINE.theta, NINE.phi]] = np.diag([-1.0, 1.0]) / per_mps2
    # The observer is kept in NED, which turns against the nose.
    explained[:2, NINE.psi] = -against[1], against[0]
    return CommandedAircraft(
        A=Ad,
        B=Bd,
        commands=commands,
        collective=np.array([0.0, 0.0, -per_weight / (kernel.g * lift)]),
        compensated=per_weight / lift * (np.tan(tilt) @ eye[[NINE.phi, NINE.theta]]),
        explained=explained,
        turned=np.array([against[1], -against[0], 0.0]),
        bank_rad=float(tilt[0] - hang[0]),
    )


def coupled_plant(
    moving: MovingModel,
    at: TrimPoint,
    attitude: Loop,
    actuation: Actuation,
    kernel: OuterParams,
    period_ticks: int,
) -> CoupledPlant:
    """Aircraft in mean wind, servos, delay and attitude controller, from commands to outputs.

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
    flown = commanded_aircraft(moving, at, actuation, kernel)
    law_, y = attitude.controller, np.eye(len(flown.A))[list(MEASURED)]
    if attitude.turned:
        law_ = _turned(law_, flown.bank_rad)
    to_law, from_law = np.split(law_.B, [len(MEASURED)], axis=1), flown.B[:, :_N_U]
    direct = np.split(law_.D, [len(MEASURED)], axis=1)
    collective = np.outer(flown.B[:, _N_U], flown.collective)
    one = np.block(
        [[flown.A + from_law @ direct[0] @ y, from_law @ law_.C], [to_law[0] @ y, law_.A]],
    )
    enters = np.vstack(
        [from_law @ direct[1] @ flown.commands + collective, to_law[1] @ flown.commands]
    )
    enters = np.hstack([enters, np.vstack([flown.B[:, _N_U:], np.zeros((len(law_.A), 1))])])
    power, held = np.eye(len(one)), np.zeros_like(enters)
    for _ in range(period_ticks):
        held, power = one @ held + enters, one @ power
    held, held_collective = held[:, :_AXES], held[:, _AXES]
    eye = np.eye(len(one))
    beside = np.zeros(len(law_.A))
    power += np.outer(held_collective, np.append(flown.compensated, beside))
    explained = np.hstack([flown.explained, np.tile(beside, (_AXES, 1))])
    read = [(eye[POSITION.start + i], eye[SPEED.start + i], explained[i]) for i in range(_AXES)]
    M = np.concatenate(read)
    # What is compared with the wind turns as the nose does.
    power += held @ np.outer(flown.turned, eye[NINE.psi])
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
    """The controller behind `controller_state.read_inputs` at a lasting bank beyond trim."""
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
    """What the controller's thrust map makes of a thrust, in units of the weight, at trim."""
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

WANTED = tuple(
    AxisRequirements(
        position / 3.5, speed / 3.5, disk_margin=0.6, disk_margin_of_others=others, step_mps2=step
    )
    for position, speed, others, step in (
        (0.16, 0.15, 0.4, 0.05),
        (0.25, 0.15, 0.4, 0.05),
        (0.10, 0.09, 0.4, 0.1),
    )
)
"""A half of the paper's speeds and a quarter of its positions at 3.5 sigma; the margins that issue
from the doubt of mass, thrust and delay; tilt that shakes by a sixth of the paper's 1.7 deg, thrust
by a hundredth of the weight."""
_AT_ONCE_RADPS = 500.0
"""Of servos that act at once."""
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
            best_gains(NAMES[i], axis, self.others[i], WANTED[i], OBSERVER_DAMPING, filter_s)
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

        There the axes meet: a pitch turns the nose, and the nose what is compared with the wind.
        """
        down = tuple(alone[-1])

        def rows(numbers: Sequence[float]) -> list[tuple[float, ...]]:
            return [*(tuple(row.tolist()) for row in np.split(np.array(numbers), 2)), down]

        def price(numbers: Sequence[float]) -> float:
            gains = tuple(gains_at(row, OBSERVER_DAMPING, filter_s) for row in rows(numbers))
            axes_cost = sum(
                cost(gains[i], self.axes[i], self.others[i], WANTED[i]) for i in range(2)
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
    gusts = gusts_along(around.config)
    nominal = around.axes(actuation, gusts)
    late = replace(actuation, delay_s=actuation.delay_s + TICK_S)
    slow_and_late = replace(late, servo_radps=(1.0 - _DOUBT) * late.servo_radps)
    others = tuple(
        (*later, _stronger(axis, 1.0 + _DOUBT), _stronger(axis, 1.0 - _DOUBT))
        for axis, *later in zip(
            nominal, around.axes(late, gusts), around.axes(slow_and_late, gusts), strict=True
        )
    )
    # The controller predicts over the collective's lag; it must bear that there is none.
    at_once = replace(actuation, delay_s=0.0, servo_radps=_AT_ONCE_RADPS)
    others = (*others[:2], (*others[2], around.axes(at_once, gusts)[2]))
    flown = attitude, actuation, around.params, around.period_ticks
    coupled = coupled_plant(around.moving, around.at, *flown)
    banked = []
    for speed_mps, floor in _BANKED:
        for side in (-1.0, 1.0):
            held = trim(around.config.helicopter, np.array([0.0, side * speed_mps, 0.0]), 0.0)
            leaning = linearize_moving(around.config.helicopter, held)
            banked.append((coupled_plant(leaning, held, *flown), floor))
    return PositionLoop(nominal, others, around.lags_s, coupled, tuple(banked))


def gusts_along(config: PlantConfig) -> tuple[tuple[Sampled, ...], ...]:
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
