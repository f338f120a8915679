# SPDX-License-Identifier: Apache-2.0
"""Singular values and margins of the design that flew."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from heli_dynamics_sim.plant import PlantConfig
from heli_flight.loop.laws import own_laws
from heli_flight.loop.settings import Settings
from heli_inner_hinf.actuation import Actuation, ObserverInput
from heli_inner_hinf.attitude_disturbance import AXES
from heli_inner_hinf.design import AttitudeConfig
from heli_parameters.python_law import INNER

if TYPE_CHECKING:
    from heli_inner_hinf.analysis import LoopReport
    from heli_inner_hinf.loops import Loop

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
class AxisNumbers:
    """What the attitude loop as flown is worth about one axis, the others closed.

    Attributes
    ----------
    rejection_radps : float or None
        Disturbance rejection bandwidth: below it more than 3 dB are taken off; None: nowhere.
    peak_db, peak_radps : float
        Where it adds most to a disturbance.
    crossover_radps : float or None
        Of the loop broken at the axis' actuator.
    phase_bandwidth_radps, gain_bandwidth_radps : float or None
        Of attitude to its command, as ADS-33E defines them.
    """

    rejection_radps: float | None
    peak_db: float
    peak_radps: float
    crossover_radps: float | None
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
    """

    controller: str
    bound: Bound | None
    loops: list[LoopReport]
    omega: list[np.ndarray]
    wind_to_h: list[np.ndarray]
    wind_to_u: list[np.ndarray]
    rate_hz: int
    axes: Sequence[AxisNumbers] = ()


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
    )


def _axes(loop: Loop) -> list[AxisNumbers]:
    from heli_handling.response import FrequencyResponse, bandwidth, rejection
    from heli_inner_hinf.attitude_responses import attitude_responses

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
                found.crossover_radps(axis),
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
