# SPDX-License-Identifier: Apache-2.0
"""Synthetic flights with known truth, to verify the filter without an aircraft model.

A smooth path (a sum of sines and a climb, faded in from hover) and a smooth attitude are given;
what sensors would read follows from them by differentiation, with errors drawn from the statistics
that the observer is configured for. None of the filter's own kernels are used.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from heli_core.atmosphere import pressure_pa
from heli_core.rows import MEAS, NAV
from heli_core.ticks import TICK_S, ticks_in

Array = NDArray[np.float64]
_STEP_S = 1e-3


@dataclass(frozen=True)
class Path:
    """Prescribed motion: functions of time (s, vector) to rows, NED m and Euler angles rad."""

    position: Callable[[Array], Array]
    euler: Callable[[Array], Array]


@dataclass(frozen=True)
class Flight:
    """Truth by ticks and the measurement rows of the observer.

    Attributes
    ----------
    y : ndarray (n, 20)
    pos, vel : ndarray (n, 3), NED
    q : ndarray (n, 4)
    rate, gyro_bias, accel_bias : ndarray (n, 3), body
    drift : ndarray (n, 3)
        GPS position drift, NED, m.
    baro_bias, mag_error : ndarray (n,)
        Pa, rad.
    """

    y: Array
    pos: Array
    vel: Array
    q: Array
    rate: Array
    gyro_bias: Array
    accel_bias: Array
    drift: Array
    baro_bias: Array
    mag_error: Array

    def attitude_error(self, nav: Array, ticks: Array | Sequence[int]) -> Array:
        """Rotation vectors (n, 3), NED, rad, from the attitude of rows of `nav` to the true one."""
        true, estimated = (np.roll(q[ticks], -1, axis=1) for q in (self.q, nav[:, NAV.quat]))
        return (Rotation.from_quat(true) * Rotation.from_quat(estimated).inv()).as_rotvec()


def fade_in(t: Array, seconds: float) -> Array:
    """0 before t = 0, 1 after `seconds`, a quintic with continuous acceleration between."""
    s = np.clip(t / seconds, 0.0, 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s * s)


def hover_path(amplitude_m: float = 0.5, tilt_rad: float = 0.05, climb_mps: float = 0.0) -> Path:
    """Hover with some motion, as gusts cause it; a climb of 4 s from 18 s on."""

    def position(t: Array) -> Array:
        f = fade_in(t, 4.0)[:, None] * amplitude_m
        w = np.column_stack(
            [
                np.sin(0.9 * t) + 0.4 * np.sin(2.3 * t),
                np.sin(0.7 * t + 1.0) - np.sin(1.0),
                0.5 * np.sin(0.5 * t),
            ]
        )
        height = 10.0 + 4.0 * climb_mps * fade_in(t - 18.0, 4.0)
        return f * w + np.column_stack([0.0 * t, 0.0 * t, -height])

    def euler(t: Array) -> Array:
        f = fade_in(t, 4.0)[:, None] * tilt_rad
        w = np.column_stack([np.sin(1.7 * t), np.sin(1.3 * t + 0.5), 2.0 * np.sin(0.4 * t)])
        return f * w + np.array([0.04, 0.001, 0.3])

    return Path(position, euler)


def turning_path(psi_rate_radps: float) -> Path:
    """Hover that turns about the vertical with a constant rate after fading in."""
    hover = hover_path()

    def euler(t: Array) -> Array:
        angles = hover.euler(t)
        angles[:, 2] += psi_rate_radps * fade_in(t, 4.0) * t
        return angles

    return Path(hover.position, euler)


def _derivative(f: Callable[[Array], Array], t: Array) -> Array:
    """First derivative by fourth-order central differences."""
    h = _STEP_S
    return (8.0 * (f(t + h) - f(t - h)) - (f(t + 2 * h) - f(t - 2 * h))) / (12.0 * h)


def rotation_matrices(euler: Array) -> Array:
    """R_nb (n, 3, 3) of 3-2-1 Euler angles (n, 3), as the product of three elementary rotations."""
    c, s = np.cos(euler), np.sin(euler)
    zero, one = np.zeros(len(euler)), np.ones(len(euler))

    def stack(rows: list[list[Array]]) -> Array:
        return np.moveaxis(np.array(rows), 2, 0)

    roll = stack([[one, zero, zero], [zero, c[:, 0], -s[:, 0]], [zero, s[:, 0], c[:, 0]]])
    pitch = stack([[c[:, 1], zero, s[:, 1]], [zero, one, zero], [-s[:, 1], zero, c[:, 1]]])
    yaw = stack([[c[:, 2], -s[:, 2], zero], [s[:, 2], c[:, 2], zero], [zero, zero, one]])
    return yaw @ pitch @ roll


def _quaternions(euler: Array) -> Array:
    """Unit quaternions (n, 4) of 3-2-1 Euler angles (n, 3)."""
    c, s = np.cos(0.5 * euler).T, np.sin(0.5 * euler).T
    return np.column_stack(
        [
            c[0] * c[1] * c[2] + s[0] * s[1] * s[2],
            s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
            c[0] * s[1] * c[2] + s[0] * c[1] * s[2],
            c[0] * c[1] * s[2] - s[0] * s[1] * c[2],
        ]
    )


def _body_rates(path: Path, t: Array, R: Array) -> Array:
    """Body rates (n, 3) from R' dR/dt."""
    dR = _derivative(lambda s: rotation_matrices(path.euler(s)).reshape(len(s), 9), t)
    W = np.transpose(R, (0, 2, 1)) @ dR.reshape(-1, 3, 3)
    return np.column_stack([W[:, 2, 1], W[:, 0, 2], W[:, 1, 0]])


def _gauss_markov(
    rng: np.random.Generator, n: int, sigma: Array, tau_s: float, start: float = 1.0
) -> Array:
    """First-order Gauss-Markov processes (n, len(sigma)), one row per tick.

    They start with the fraction `start` of their stationary sigma.
    """
    decay = np.exp(-TICK_S / tau_s)
    x = np.empty((n, len(sigma)))
    x[0] = start * sigma * rng.standard_normal(len(sigma))
    w = rng.standard_normal((n, len(sigma))) * sigma * np.sqrt(1.0 - decay**2)
    for i in range(1, n):
        x[i] = decay * x[i - 1] + w[i]
    return x


def _walk(rng: np.random.Generator, n: int, m: int, start: float, density: float) -> Array:
    """Random walks (n, m): sigma at the start, density per sqrt(s)."""
    steps = rng.standard_normal((n, m)) * density * np.sqrt(TICK_S)
    steps[0] = start * rng.standard_normal(m)
    return np.cumsum(steps, axis=0)


def synthesize(
    path: Path, parameters: Mapping[str, Any], seconds: float, seed: int, noise: float = 1.0
) -> Flight:
    """Fly a path with the sensors that the observer's parameters describe.

    Parameters
    ----------
    path : Path
    parameters : mapping
        Observer parameters (schedule.*, ekf.*).
    seconds : float
        Length of the flight.
    seed : int
    noise : float
        Factor on every error; 0.0 gives ideal sensors.
    """
    v = parameters
    rng = np.random.default_rng(seed)
    lead = v["schedule.gps_latency_ticks"]
    n = ticks_in(seconds) + 1
    tick = np.arange(-lead, n)
    t = tick * TICK_S
    euler = path.euler(t)
    R = rotation_matrices(euler)
    Rt = np.transpose(R, (0, 2, 1))
    pos, vel = path.position(t), _derivative(path.position, t)
    acc = _derivative(lambda s: _derivative(path.position, s), t)
    rate = _body_rates(path, t, R)
    m = len(tick)
    imu, initial, gps = "ekf.imu.", "ekf.initial.", "ekf.gps."
    bg = noise * _walk(rng, m, 3, v[initial + "gyro_bias_radps"], v[imu + "gyro_bias_walk"])
    ba = noise * _walk(rng, m, 3, v[initial + "accel_bias_mps2"], v[imu + "accel_bias_walk"])
    drift_sigma = np.array([v[gps + "drift_horizontal_m"]] * 2 + [v[gps + "drift_vertical_m"]])
    tau = v[gps + "drift_time_constant_s"]
    start = v[initial + "drift_at_alignment_fraction"]
    drift = noise * _gauss_markov(rng, m, drift_sigma, tau, start)
    bb = noise * _walk(rng, m, 1, 20.0, v["ekf.baro.bias_walk"])[:, 0]
    mag_sigma = np.array([v["ekf.mag.heading_error_rad"]])
    tau = v["ekf.mag.heading_error_time_constant_s"]
    me = noise * _gauss_markov(rng, m, mag_sigma, tau)[:, 0]
    # white errors in the places of what they spoil
    white = noise * rng.standard_normal((m, MEAS.mag_valid))
    per_tick = 1.0 / np.sqrt(TICK_S)
    y = np.zeros((m, MEAS.sensed))
    force = (Rt @ (acc - np.array([0.0, 0.0, v["ekf.gravity_mps2"]]))[:, :, None])[:, :, 0]
    density = v[imu + "accel_noise_density"] * per_tick
    y[:, MEAS.force] = force + ba + density * white[:, MEAS.force]
    density = v[imu + "gyro_noise_density"] * per_tick
    y[:, MEAS.rate] = rate + bg + density * white[:, MEAS.rate]
    north, east, down = v["ekf.mag.field_ned_t"]
    c, s = np.cos(-me), np.sin(-me)
    field = np.column_stack([c * north - s * east, s * north + c * east, np.full(m, down)])
    turned = (Rt @ field[:, :, None])[:, :, 0]
    y[:, MEAS.mag] = turned + v["ekf.mag.noise_t"] * white[:, MEAS.mag]
    pressure = np.array([pressure_pa(v["ekf.origin_altitude_m"] - p) for p in pos[:, 2]])
    y[:, MEAS.baro] = pressure + bb + v["ekf.baro.noise_pa"] * white[:, MEAS.baro]
    wide, high = v[gps + "position_horizontal_m"], v[gps + "position_vertical_m"]
    fix_pos = pos + drift + white[:, MEAS.gps_pos] * [wide, wide, high]
    wide, high = v[gps + "velocity_horizontal_mps"], v[gps + "velocity_vertical_mps"]
    fix_vel = vel + white[:, MEAS.gps_vel] * [wide, wide, high]
    y[lead:, MEAS.gps_pos], y[lead:, MEAS.gps_vel] = fix_pos[: m - lead], fix_vel[: m - lead]
    y[:, MEAS.mag_valid] = tick % v["schedule.mag_period_ticks"] == 0
    y[:, MEAS.baro_valid] = tick % v["schedule.baro_period_ticks"] == 0
    y[:, MEAS.gps_valid] = tick % v["schedule.gps_period_ticks"] == 0
    y[:, MEAS.gps_tick] = tick - lead
    parts = (y, pos, vel, _quaternions(euler), rate, bg, ba, drift, bb, me)
    return Flight(*(np.ascontiguousarray(part[lead:]) for part in parts))
