# SPDX-License-Identifier: Apache-2.0
"""Singular values and margins of the design that flew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from heli_dynamics_sim.plant import PlantConfig
from heli_dynamics_sim.trim import TrimError
from heli_flight.loop.laws import own_laws
from heli_flight.loop.settings import Settings
from heli_inner_hinf.actuation import Actuation, ObserverInput
from heli_inner_hinf.attitude_disturbance import AXES
from heli_inner_hinf.design import AttitudeConfig
from heli_parameters.python_law import INNER, OUTER

if TYPE_CHECKING:
    from heli_inner_hinf.analysis import LoopReport
    from heli_inner_hinf.loops import Loop, Model

_POINTS = 240


@dataclass(frozen=True)
class Bound:
    """What was asked of the worst case, and what can be had.

    Attributes
    ----------
    gamma, gamma_star : float
        The bound and its infimum, eq. (14).
    of : str
        What it bounds, in words.
    """

    gamma: float
    gamma_star: float
    of: str


@dataclass(frozen=True)
class LoopNumbers:
    """What a loop as flown is worth along or about one axis.

    Attributes
    ----------
    rejection_radps : float or None
        Disturbance rejection bandwidth: below it more than 3 dB are taken off; None: nowhere.
    peak_db, peak_radps : float
        Where it adds most to a disturbance.
    crossover_radps : float or None
        Of the attitude loop broken at the axis' actuator, the others closed; of the position loop
        broken at the commanded acceleration.
    """

    rejection_radps: float | None
    peak_db: float
    peak_radps: float
    crossover_radps: float | None


@dataclass(frozen=True)
class AxisNumbers(LoopNumbers):
    """The same of attitude, with its response to its command.

    Attributes
    ----------
    phase_bandwidth_radps, gain_bandwidth_radps : float or None
        As ADS-33E defines them.
    """

    phase_bandwidth_radps: float | None
    gain_bandwidth_radps: float | None


@dataclass(frozen=True)
class Design:
    """The flown design's numbers.

    Attributes
    ----------
    controller : str
    bound : Bound or None
        That of the law that flew; None for a law that is designed without one.
    loops : sequence of LoopReport
        As flown: sampled, with servos and delay; before it, for state feedback: every state known,
        and with the observer (19).
    omega : sequence of (m,) ndarray
        Frequencies of each loop, rad/s.
    wind_to_h, wind_to_u : sequence of (m, 3) ndarray
        Singular values of each loop from wind (m/s).
    rate_hz : int
        At which the law steps.
    axes : sequence of AxisNumbers
        Roll, pitch, yaw of the loop as flown; empty for an unstable one.
    position : sequence of LoopNumbers
        Forward, right, down; empty where no such loop flew, or the aircraft has no trim.
    """

    controller: str
    bound: Bound | None
    loops: list[LoopReport]
    omega: list[np.ndarray]
    wind_to_h: list[np.ndarray]
    wind_to_u: list[np.ndarray]
    rate_hz: int
    axes: Sequence[AxisNumbers] = ()
    position: Sequence[LoopNumbers] = ()


def flown_design(settings: Settings) -> Design | None:
    """Analyse the inner loop of a flight; None for a law whose linear form is not known.

    Raises
    ------
    ValueError
        As the design's parts raise it, each with a sentence.
    """
    if INNER in own_laws(settings):
        return None
    # python-control takes seconds to import: not before it is needed
    from heli_inner_hinf import analysis

    config = AttitudeConfig.from_parameters(settings.nodes["inner_loop"])
    seen = settings.nodes["observer"]
    plant = PlantConfig.from_parameters(settings.nodes["plant"])
    aircraft = plant.helicopter
    actuation = Actuation(
        aircraft.servo_bandwidth_radps,
        aircraft.servo_damping,
        plant.rate.tick_s * plant.delay_ticks,
        plant.rate.tick_s,
    )
    feed = ObserverInput.from_parameters(seen)
    K = np.reshape(np.asarray(seen["K"], float), (3, 6))
    loops = analysis.loops_of(config, K, feed, actuation)
    if not loops:
        return None
    top = [0.999 * np.pi / loop.dt if loop.dt else 1e3 for loop in loops]
    omega = [np.geomspace(1e-2, end, _POINTS) for end in top]
    values = [analysis.singular_values(loop, w) for loop, w in zip(loops, omega, strict=True)]
    return Design(
        config.controller,
        _bound(config),
        [analysis.analyse(loop) for loop in loops],
        omega,
        [hv for hv, _ in values],
        [uv for _, uv in values],
        plant.rate.hz,
        _axes(loops[-1]),
        _position(settings, loops[-1], analysis.model_of(config), actuation),
    )


def _position(
    settings: Settings, loop: Loop, model: Model, actuation: Actuation
) -> list[LoopNumbers]:
    from heli_flight.loop.position_axes import position_axes
    from heli_handling.response import FrequencyResponse, rejection
    from heli_inner_hinf.attitude_responses import crossover_radps
    from heli_outer_pd.axis_analysis import Gains, open_loop

    plant, outer = settings.nodes["plant"], settings.nodes["outer_loop"]
    flown = settings.scenario.kind != "attitude" and OUTER not in own_laws(settings)
    if not flown or settings.rate.fold != 1 or loop.stability() >= 0.0:
        return []
    try:
        around = position_axes(plant, outer, loop, model)
    except TrimError:
        return []
    numbers = []
    for i, axis in enumerate(around.axes(actuation)):
        omega, broken = open_loop(axis, Gains.of(around.kernel, i))
        found = FrequencyResponse(omega, 1.0 / (1.0 + broken), np.ones(omega.size))
        rejected, crossover = rejection(found), crossover_radps(omega, broken)
        numbers.append(
            LoopNumbers(rejected.bandwidth_radps, rejected.peak_db, rejected.peak_radps, crossover)
        )
    return numbers


def _axes(loop: Loop) -> list[AxisNumbers]:
    from heli_handling.response import FrequencyResponse, bandwidth, rejection
    from heli_inner_hinf.attitude_responses import attitude_responses, crossover_radps

    if loop.stability() >= 0.0:
        return []
    found = attitude_responses(loop)
    numbers = []
    for axis in range(len(AXES)):
        known = np.ones(found.omega_radps.size)
        rejected = rejection(
            FrequencyResponse(found.omega_radps, found.to_disturbance[axis], known)
        )
        answered = bandwidth(FrequencyResponse(found.omega_radps, found.to_command[axis], known))
        numbers.append(
            AxisNumbers(
                rejected.bandwidth_radps,
                rejected.peak_db,
                rejected.peak_radps,
                crossover_radps(found.omega_radps, found.broken[axis]),
                answered.phase_radps,
                answered.gain_radps,
            )
        )
    return numbers


def _bound(config: AttitudeConfig) -> Bound | None:
    """The bound below which the law was synthesised."""
    if config.output is not None:
        return Bound(
            config.output.gamma,
            config.output.gamma_star.value,
            "of output feedback; wind, load and noise to h and the integrals, weighted by `output`",
        )
    if config.controller == "hinf":
        own = config.synthesis
        return Bound(own.gamma, own.gamma_star.value, "of state feedback; wind to h")
    return None
