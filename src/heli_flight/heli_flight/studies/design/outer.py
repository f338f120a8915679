# SPDX-License-Identifier: Apache-2.0
"""The position loop around a designed attitude loop: its gains, what they are worth, the limit.

Air, aircraft's terms and wind are those of the hover test's world, with nothing drawn: the loop's
acceleration comes from the aircraft's equations about its trim in the mean wind. So there is no
report for an aircraft that is identified.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from heli_dynamics_sim.config import PlantConfig
from heli_dynamics_sim.linearize import linearize_moving
from heli_dynamics_sim.trim import trim
from heli_dynamics_sim.wind import dryden_scales, passing_speed
from heli_flight.loop.position_axes import NAMES, downwind, position_axes
from heli_flight.studies.design.coupled import CoupledPlant, common_disk_margin, coupled_plant
from heli_inner_hinf.actuation import Actuation
from heli_inner_hinf.disk_margin import DiskMargin
from heli_inner_hinf.loops import Loop, Model
from heli_math.grid_search import search
from heli_math.ticks import TICK_S
from heli_outer_pd.axis_analysis import (
    Axis,
    AxisReport,
    Gains,
    Sampled,
    analyse,
    drifting,
    dryden_across,
)
from heli_outer_pd.config import OBSERVER_DAMPING, outer_kernel
from heli_outer_pd.gain_search import NoGainsError, Wanted, best_gains, cost, gains_at

# A half of the paper's speeds and a quarter of its positions at 3.5 sigma; the margins that issue
# from the doubt of mass, thrust and delay.
_WANTED = tuple(
    Wanted(position / 3.5, speed / 3.5, disk_margin=0.6, disk_margin_of_others=0.4)
    for position, speed in ((0.16, 0.15), (0.25, 0.15), (0.10, 0.09))
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
        kernel = outer_kernel(outer)
        return tuple(analyse(axis, Gains.of(kernel, i)) for i, axis in enumerate(self.axes))

    def common_margin(self, outer: Mapping[str, Any]) -> DiskMargin:
        """Disk margin with phi_ref, theta_ref and the collective broken together."""
        kernel = outer_kernel(outer)
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
        found = self._held_in_bank(alone, filter_s)
        K_P, K_D, bandwidth, lead_s = (list(column) for column in zip(*found, strict=True))
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
            own = sum(cost(gains[i], self.axes[i], self.others[i], _WANTED[i]) for i in range(2))
            if not np.isfinite(own):
                return np.inf
            missed = sum(
                max(0.0, floor - common_disk_margin(plant, self.axes, gains).alpha)
                for plant, floor in self.banked
            )
            return own if missed <= 0.0 else _MISSED * (1.0 + missed)

        found = search((*alone[0], *alone[1]), price, (1,), pairs=False)
        if price(found) >= _MISSED:
            raise NoGainsError(
                "position loop: no gains near those of the single axes keep the floors of the "
                "common disk margin in side wind: the attitude loop is too slow"
            )
        return rows(found)


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
    flown = attitude, actuation, around.kernel, around.period_ticks
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
