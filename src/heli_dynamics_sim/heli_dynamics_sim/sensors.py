# SPDX-License-Identifier: Apache-2.0
"""Sensors: IMU, magnetometer, barometer, GPS. All in body FRD and NED, SI.

Every error is a function of the standard normals that are passed in. First-order Gauss-Markov
processes and random walks are stepped exactly.
"""

import math
from typing import NamedTuple

import numpy as np

from heli_dynamics_sim.helicopter import specific_force
from heli_dynamics_sim.noise import BARO_AT, GPS_AT, IMU_AT, MAG_AT
from heli_dynamics_sim.rigid_body import to_body, to_ned
from heli_math.atmosphere import pressure_pa
from heli_math.jit import njit

GPS_FIX = 7  # position (3), velocity (3), tick of validity


class ImuKernel(NamedTuple):
    """Per tick, not per root hertz."""

    gyro_white: float  # rad/s
    accel_white: float  # m/s2
    gyro_walk: float  # rad/s per tick
    accel_walk: float  # m/s2 per tick
    gyro_bias: float  # sigma at start, rad/s
    accel_bias: float  # m/s2


class MagKernel(NamedTuple):
    """Reads `soft_iron @ field + hard_iron + white`."""

    field_ned_t: np.ndarray  # (3,)
    soft_iron: np.ndarray  # (3, 3)
    hard_iron_t: np.ndarray  # (3,)
    white: float  # T
    period: int  # ticks


class BaroKernel(NamedTuple):
    """ISA pressure at the altitude above the origin, white noise and a slow drift."""

    origin_altitude_m: float
    white: float  # Pa
    drift: float  # stationary sigma, Pa
    decay: float  # per period
    period: int  # ticks


class GpsKernel(NamedTuple):
    """Fixes that are valid now and arrive later."""

    white_m: np.ndarray  # (3,) NED
    drift_m: np.ndarray  # (3,) stationary sigma, NED
    decay: float  # of the drift, per period
    velocity_mps: float
    period: int  # ticks
    latency: int  # ticks


class SensorKernel(NamedTuple):
    """All sensors."""

    imu: ImuKernel
    mag: MagKernel
    baro: BaroKernel
    gps: GpsKernel


class SensorState(NamedTuple):
    """What the sensors remember."""

    bias: np.ndarray  # (6,) gyro rad/s, accelerometer m/s2
    baro_drift: np.ndarray  # (1,) Pa
    gps_drift: np.ndarray  # (3,) NED, m
    gps_queue: np.ndarray  # (slots, GPS_FIX) fixes under way


@njit
def gauss_markov_step(x, decay, sigma, n):
    """Next value of a stationary first-order Gauss-Markov process with this sigma."""
    return decay * x + sigma * math.sqrt(1.0 - decay * decay) * n


@njit
def read_imu(sensors, tick, x, wind, noise, aircraft, k, y):
    """Fill y[0:3] (specific force, m/s2) and y[3:6] (rates, rad/s); biases walk."""
    specific_force(x, wind, aircraft, y)
    for i in range(3):
        if tick > 0:
            sensors.bias[i] += k.gyro_walk * noise[IMU_AT + 6 + i]
            sensors.bias[3 + i] += k.accel_walk * noise[IMU_AT + 9 + i]
        y[i] += sensors.bias[3 + i] + k.accel_white * noise[IMU_AT + 3 + i]
        y[3 + i] = x[10 + i] + sensors.bias[i] + k.gyro_white * noise[IMU_AT + i]


@njit
def read_mag(tick, x, noise, k, y):
    """Fill y[6:9] (T) and y[16]; zeros between the periods."""
    y[16] = 1.0 if tick % k.period == 0 else 0.0
    if y[16] == 0.0:
        y[6] = y[7] = y[8] = 0.0
        return
    f = k.field_ned_t
    b0, b1, b2 = to_body(x[6], x[7], x[8], x[9], f[0], f[1], f[2])
    for i in range(3):
        y[6 + i] = k.soft_iron[i, 0] * b0 + k.soft_iron[i, 1] * b1 + k.soft_iron[i, 2] * b2
        y[6 + i] += k.hard_iron_t[i] + k.white * noise[MAG_AT + i]


@njit
def read_baro(sensors, tick, x, noise, k, y):
    """Fill y[9] (Pa) and y[17]; zero between the periods."""
    y[17] = 1.0 if tick % k.period == 0 else 0.0
    if y[17] == 0.0:
        y[9] = 0.0
        return
    if tick > 0:
        sensors.baro_drift[0] = gauss_markov_step(
            sensors.baro_drift[0], k.decay, k.drift, noise[BARO_AT + 1]
        )
    y[9] = pressure_pa(k.origin_altitude_m - x[2]) + sensors.baro_drift[0]
    y[9] += k.white * noise[BARO_AT]


@njit
def take_fix(sensors, tick, x, noise, k):
    """Measure position and velocity at `tick` and send them on their way."""
    slot = ((tick + k.latency) // k.period) % sensors.gps_queue.shape[0]
    v0, v1, v2 = to_ned(x[6], x[7], x[8], x[9], x[3], x[4], x[5])
    fix = sensors.gps_queue[slot]
    fix[3], fix[4], fix[5] = v0, v1, v2
    for i in range(3):
        fix[i] = x[i] + sensors.gps_drift[i] + k.white_m[i] * noise[GPS_AT + i]
        fix[3 + i] += k.velocity_mps * noise[GPS_AT + 3 + i]
    fix[6] = tick


@njit
def read_gps(sensors, tick, x, noise, k, y):
    """Fill y[10:16] (NED, m, m/s), y[18] and y[19] with the fix that arrives; zeros if none does.

    Fixes arrive at the multiples of the period and were valid `latency` ticks before.
    """
    if (tick + k.latency) % k.period == 0:
        for i in range(3):
            sensors.gps_drift[i] = gauss_markov_step(
                sensors.gps_drift[i], k.decay, k.drift_m[i], noise[GPS_AT + 6 + i]
            )
        take_fix(sensors, tick, x, noise, k)
    y[18] = 1.0 if tick % k.period == 0 else 0.0
    y[19] = 0.0
    for i in range(6):
        y[10 + i] = 0.0
    if y[18] == 1.0:
        fix = sensors.gps_queue[(tick // k.period) % sensors.gps_queue.shape[0]]
        for i in range(6):
            y[10 + i] = fix[i]
        y[19] = fix[6]


@njit
def read_sensors(sensors, tick, x, wind, noise, aircraft, k, y):
    """Fill y[0:20] at a tick; see `state` for the layout."""
    read_imu(sensors, tick, x, wind, noise, aircraft, k.imu, y)
    read_mag(tick, x, noise, k.mag, y)
    read_baro(sensors, tick, x, noise, k.baro, y)
    read_gps(sensors, tick, x, noise, k.gps, y)
