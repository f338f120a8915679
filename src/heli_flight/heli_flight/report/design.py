# SPDX-License-Identifier: Apache-2.0
"""Singular values and margins of the design that flew."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from heli_dynamics_sim.plant import PlantConfig
from heli_flight.loop.laws import own_laws
from heli_flight.loop.settings import Settings
from heli_inner_hinf.actuation import Actuation, ObserverInput
from heli_inner_hinf.design import AttitudeConfig
from heli_parameters.python_law import INNER

if TYPE_CHECKING:
    from heli_inner_hinf.analysis import LoopReport

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
    """

    controller: str
    bound: Bound | None
    loops: list[LoopReport]
    omega: list[np.ndarray]
    wind_to_h: list[np.ndarray]
    wind_to_u: list[np.ndarray]
    rate_hz: int


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
    )


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
