# SPDX-License-Identifier: Apache-2.0
"""The position loop around a designed attitude loop: what its present gains are worth.

The gains are those of the parameters; `heli design` does not choose them. The aircraft's damping by
the air comes from its equations, so there is no report for an aircraft that is identified.
"""

from collections.abc import Mapping
from typing import Any

import control
import numpy as np

from heli_dynamics_sim.config import PlantConfig
from heli_dynamics_sim.linearize import air_damping_per_s
from heli_dynamics_sim.trim import trim
from heli_dynamics_sim.wind import WindKernel, dryden_scales, mean_speed
from heli_inner_hinf.actuation import Actuation
from heli_inner_hinf.loops import Loop
from heli_math.rows import NINE
from heli_math.ticks import TICK_S
from heli_outer_pd.axis_analysis import (
    Axis,
    AxisReport,
    Gains,
    analyse,
    dryden_across,
    dryden_along,
    modelled_heave_damping_per_s,
)
from heli_outer_pd.config import outer_kernel

NAMES = ("forward", "right", "down")


def outer_reports(
    plant: Mapping[str, Any],
    outer: Mapping[str, Any],
    attitude: Loop,
    actuation: Actuation,
) -> tuple[AxisReport, ...]:
    """Margins and rms of the three axes in the wind of the flight's start, exact navigation.

    Parameters
    ----------
    plant, outer : mapping
        Parameters of the plant (aircraft, wind, start) and of the outer loop.
    attitude : Loop
        Continuous loop with the observer; commanded to achieved attitude is read from it.
    actuation : Actuation

    Raises
    ------
    PlantConfigError, TrimError
    """
    config = PlantConfig.from_parameters(plant)
    kernel = outer_kernel(outer)
    altitude_m = -float(config.pos_ned_m[2])
    mean_mps = mean_speed(altitude_m, config.wind)
    towards = np.array([np.cos(config.wind.towards_rad), np.sin(config.wind.towards_rad), 0.0])
    at = trim(config.helicopter, mean_mps * towards, config.psi)
    damping = air_damping_per_s(config.helicopter, at)
    period_s = outer["period_ticks"] * TICK_S
    lags = [kernel.attitude_lag[0], kernel.attitude_lag[1], 0.0]
    modelled = [0.0, 0.0, modelled_heave_damping_per_s(kernel)]
    # The attitude loop's own delay is what its prediction stands for; the collective has a servo.
    delays = [actuation.known_lag_s] * 2 + [actuation.delay_s + 0.5 * TICK_S]
    blocks = [_attitude(attitude, NINE.theta), _attitude(attitude, NINE.phi), _servo(actuation)]
    gusts = _gusts(config.wind, altitude_m, config.wind.towards_rad - config.psi)
    return tuple(
        analyse(
            Axis(blocks[i], delays[i] + 0.5 * period_s, damping[i], lags[i], modelled[i], gusts[i]),
            Gains.of(kernel, i),
        )
        for i in range(len(NAMES))
    )


def _attitude(loop: Loop, state: int) -> control.StateSpace:
    """Commanded to achieved phi or theta."""
    closed = loop.closed
    name = f"{closed.state_labels[state]}_ref"
    B = closed.B[:, [closed.input_labels.index(name)]]
    return control.ss(closed.A, B, np.eye(closed.nstates)[[state]], [[0.0]])


def _servo(actuation: Actuation) -> control.StateSpace:
    w, zeta = actuation.servo_radps, actuation.servo_damping
    return control.tf2ss([w**2], [1.0, 2.0 * zeta * w, w**2])


def _gusts(
    wind: WindKernel, altitude_m: float, off_nose_rad: float
) -> tuple[tuple[control.StateSpace, ...], ...]:
    """Dryden gusts along the three axes, from independent noises."""
    sigma, sigma_w, length_m, length_w_m = dryden_scales(altitude_m, wind.w20_mps)
    if not wind.turbulence:
        sigma = sigma_w = 0.0
    speed_mps = max(mean_speed(altitude_m, wind), wind.airspeed_floor_mps)
    along, across = abs(np.cos(off_nose_rad)), abs(np.sin(off_nose_rad))
    time_s = length_m / speed_mps
    return (
        (dryden_along(along * sigma, time_s), dryden_across(across * sigma, time_s)),
        (dryden_along(across * sigma, time_s), dryden_across(along * sigma, time_s)),
        (dryden_across(sigma_w, length_w_m / speed_mps),),
    )
