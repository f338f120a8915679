# SPDX-License-Identifier: Apache-2.0
"""Consistency of the navigation filter: its errors beside what its covariance says of them.

On synthetic flights with known truth (`synthetic`), all errors drawn from the statistics that the
filter is configured for. Normalised errors squared are then chi-square distributed: Y. Bar-Shalom,
X. R. Li, T. Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, section
5.4. For verification; the observer itself uses none of it.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from scipy.stats import chi2

from heli_core.rows import MEAS, NAV
from heli_core.ticks import seconds, ticks_in
from heli_observer import layout as L
from heli_observer.observer import ObserverConfig, initial_state, observe
from support.synthetic_sensors import Flight, Path, hover_path, synthesize

Array = NDArray[np.float64]
SECONDS = 60.0
CHECKS_S = (2, 5, 10, 20, 30, 40, 50, 60)
SENSORS = ("GPS position", "GPS velocity", "magnetometer", "barometer")
_FUSED = [L.COUNT.gps_fused, L.COUNT.gps_fused, L.COUNT.mag_fused, L.COUNT.baro_fused]
_NIS = [L.DIAG.nis_pos, L.DIAG.nis_vel, L.DIAG.nis_mag, L.DIAG.nis_baro]
_REJECTED = [
    L.COUNT.mag_rejected,
    L.COUNT.baro_rejected,
    L.COUNT.gps_pos_rejected,
    L.COUNT.gps_vel_rejected,
]
DOF = np.array([3, 3, 1, 1])
_NAVIGATION = slice(L.ERROR.pos, L.ERROR.att + 3)  # position, velocity and attitude stand first


def rotation(q: Array) -> Rotation:
    """SciPy's rotation of a quaternion (4,) w, x, y, z."""
    return Rotation.from_quat(np.roll(q, -1))


def error_state(flight: Flight, tick: int, x: Array) -> Array:
    """Truth minus nominal state x (21,) at a tick, in the filter's error coordinates (20,)."""
    e = np.empty(L.ERROR.size)
    for at, true, nominal in (
        (L.ERROR.pos, flight.pos, L.NOMINAL.pos),
        (L.ERROR.vel, flight.vel, L.NOMINAL.vel),
        (L.ERROR.gyro_bias, flight.gyro_bias, L.NOMINAL.gyro_bias),
        (L.ERROR.accel_bias, flight.accel_bias, L.NOMINAL.accel_bias),
        (L.ERROR.drift, flight.drift, L.NOMINAL.drift),
    ):
        e[at : at + 3] = true[tick] - x[nominal : nominal + 3]
    turn = rotation(flight.q[tick]) * rotation(x[L.NOMINAL.quat : L.NOMINAL.quat + 4]).inv()
    e[L.ERROR.att : L.ERROR.att + 3] = turn.as_rotvec()
    e[L.ERROR.baro_bias] = flight.baro_bias[tick] - x[L.NOMINAL.baro_bias]
    e[L.ERROR.mag_error] = flight.mag_error[tick] - x[L.NOMINAL.mag_error]
    return e


def sent_errors(flight: Flight, tick: int, nav: Array) -> Array:
    """Errors (3, 3) of position, velocity and attitude as sent, over the deviations sent."""
    turn = rotation(flight.q[tick]) * rotation(nav[NAV.quat]).inv()
    errors = flight.pos[tick] - nav[NAV.pos], flight.vel[tick] - nav[NAV.vel], turn.as_rotvec()
    return np.array(errors) / [nav[NAV.sigma_pos], nav[NAV.sigma_vel], nav[NAV.sigma_att]]


@dataclass
class Statistics:
    """Sums over flights of normalised errors squared.

    Attributes
    ----------
    runs : int
        Flights.
    nees, nees_navigation : (checks,) ndarray
        Of the whole error state; of position, velocity and attitude only.
    output : (checks, 3) ndarray
        Of position, velocity, attitude as sent, over the standard deviations sent with them.
    nis, dof : (sensors,) ndarray
        Innovations of `SENSORS`, and their degrees of freedom.
    rejected : int
        Samples that a gate refused.
    """

    runs: int = 0
    nees: Array = field(default_factory=lambda: np.zeros(len(CHECKS_S)))
    nees_navigation: Array = field(default_factory=lambda: np.zeros(len(CHECKS_S)))
    output: Array = field(default_factory=lambda: np.zeros((len(CHECKS_S), 3)))
    nis: Array = field(default_factory=lambda: np.zeros(len(SENSORS)))
    dof: Array = field(default_factory=lambda: np.zeros(len(SENSORS)))
    rejected: int = 0


def collect(
    parameters: Mapping[str, Any],
    seeds: Iterable[int],
    filter_changes: Mapping[str, Any] | None = None,
) -> Statistics:
    """Fly the seeds; world and filter have the parameters, the filter with changes.

    Parameters
    ----------
    parameters : mapping
        Of the observer; they describe the sensors.
    seeds : iterable of int
    filter_changes : mapping, optional
        What the filter wrongly believes.
    """
    config = ObserverConfig({**parameters, **(filter_changes or {})})
    total = Statistics()
    for seed in seeds:
        flight = synthesize(hover_path(climb_mps=2.5), parameters, SECONDS, seed)
        _add_flight(total, flight, config, np.array(parameters["trim.u"]))
    return total


def _add_flight(total: Statistics, flight: Flight, config: ObserverConfig, u: Array) -> None:
    k, out, state = config.params, np.empty(NAV.size), initial_state(config)
    before = state.count[_FUSED].copy()
    for tick in range(len(flight.y)):
        observe(state, tick, flight.y[tick], u, k, out)
        fused = state.count[_FUSED] - before
        before = state.count[_FUSED].copy()
        if tick > 0:
            total.nis += fused * state.diag[_NIS]
            total.dof += fused * DOF
        if seconds(tick) in CHECKS_S:
            i = CHECKS_S.index(seconds(tick))
            e = error_state(flight, tick - k.horizon_ticks, state.nominal)
            total.nees[i] += e @ np.linalg.solve(state.P, e)
            nav_error, P = e[_NAVIGATION], state.P[_NAVIGATION, _NAVIGATION]
            total.nees_navigation[i] += nav_error @ np.linalg.solve(P, nav_error)
            total.output[i] += (sent_errors(flight, tick, out) ** 2).sum(axis=1)
    total.rejected += int(state.count[_REJECTED].sum())
    total.runs += 1


def bounds(dof: Any, probability: float = 0.999) -> tuple[Array, Array]:
    """Two-sided bounds of a sum that is chi-square distributed with dof."""
    tail = 0.5 * (1.0 - probability)
    return chi2.ppf(tail, dof), chi2.ppf(1.0 - tail, dof)


def latency_errors(
    parameters: Mapping[str, Any], seeds: Iterable[int], path: Path, start_s: float = 10.0
) -> Array:
    """Horizontal rms errors (2, 2): position m and velocity m/s, of two filters on each flight.

    Row 0 knows when each fix was true, row 1 takes it for as new as its arrival.
    """
    config = ObserverConfig({**parameters, "ekf.gate_probability": 1.0 - 1e-12})
    sums, count, u = np.zeros((2, 2)), 0, np.array(parameters["trim.u"])
    for seed in seeds:
        flight = synthesize(path, parameters, 40.0, seed)
        truth = ((NAV.pos, flight.pos), (NAV.vel, flight.vel))
        arrival = flight.y.copy()
        arrival[:, MEAS.gps_tick] = np.arange(len(arrival))
        for row, measured in enumerate((flight.y, arrival)):
            state, out = initial_state(config), np.empty(NAV.size)
            for tick, y in enumerate(measured):
                observe(state, tick, y, u, config.params, out)
                if tick >= ticks_in(start_s):
                    for i, (place, true) in enumerate(truth):
                        sums[row, i] += ((out[place] - true[tick])[:2] ** 2).sum()
        count += 2 * (len(flight.y) - ticks_in(start_s))
    return np.sqrt(sums / count)
