# SPDX-License-Identifier: Apache-2.0
"""The worst aircraft flown: the nonlinear loop along the direction that destabilises it.

One process, still air, sensors without noise, the flown navigation, attitude only: the aircraft is
in its own trim, which laws and observer are told, so that what is left is the motion about it. It
gets a small push, and the oscillation's growth is read off its envelope.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from heli_dynamics_sim import plant
from heli_dynamics_sim.linearize import reduced_state
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.trim import Trim, trim
from heli_flight.loop.closed_loop import Loop, build, fly
from heli_flight.loop.settings import Settings
from heli_flight.loop.track import empty_track
from heli_flight.studies.robust.aircraft import EXACT, AircraftSet, with_values
from heli_math.rows import ACTUATOR, NINE, PLANT, TRUTH
from heli_math.ticks import TICK_S, ticks_in

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
) -> tuple[Loop, Trim]:
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
    told = {"trim.x": reduced_state(at.x), "trim.u": at.u}
    nodes = {
        name: {**own, **told} if name in ("observer", "inner_loop") else own
        for name, own in settings.nodes.items()
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
    own = loop.plant_k.aircraft._replace(body=mass)
    return loop._replace(plant_k=loop.plant_k._replace(aircraft=own), period_ticks=_NEVER), at
