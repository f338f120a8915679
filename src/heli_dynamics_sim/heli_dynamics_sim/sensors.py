# SPDX-License-Identifier: Apache-2.0
"""Sensors: IMU, magnetometer, barometer, GPS. All in body FRD and NED, SI.

Every error is a function of the standard normals that are passed in. First-order Gauss-Markov
processes and random walks are stepped exactly.
"""

import math
from typing import NamedTuple

import numpy as np

from heli_dynamics_sim.helicopter import specific_force
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.rigid_body import to_body, to_ned
from heli_dynamics_sim.state import attitude_of, velocity_of
from heli_math.atmosphere import pressure_pa
from heli_math.jit import njit
from heli_math.rows import MEAS, PLANT


class FixRow(NamedTuple):
    """A GPS fix under way (7,)."""

    pos: slice = slice(0, 3)  # NED, m
    vel: slice = slice(3, 6)  # NED, m/s
    tick: int = 6  # of validity
    size: int = 7


FIX = FixRow()


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

    gyro_bias: np.ndarray  # (3,) rad/s
    accel_bias: np.ndarray  # (3,) m/s2
    baro_drift: np.ndarray  # (1,) Pa
    gps_drift: np.ndarray  # (3,) NED, m
    gps_queue: np.ndarray  # (slots, 7) fixes under way, a FixRow each


@njit
def gauss_markov_step(x, decay, sigma, n):
    """Next value of a stationary first-order Gauss-Markov process with this sigma."""
    return decay * x + sigma * math.sqrt(1.0 - decay * decay) * n


@njit
def read_imu(sensors, tick, x, air, noise, aircraft, k, y):
    """Fill specific force and rates of the measurement row y; biases walk."""
    force, rate, true_rate = y[MEAS.force], y[MEAS.rate], x[PLANT.rate]
    gyro, accel = noise[NOISE.gyro], noise[NOISE.accel]
    gyro_walk, accel_walk = noise[NOISE.gyro_walk], noise[NOISE.accel_walk]
    specific_force(x, air, aircraft, force)
    for i in range(3):
        if tick > 0:
            sensors.gyro_bias[i] += k.gyro_walk * gyro_walk[i]
            sensors.accel_bias[i] += k.accel_walk * accel_walk[i]
        force[i] += sensors.accel_bias[i] + k.accel_white * accel[i]
        rate[i] = true_rate[i] + sensors.gyro_bias[i] + k.gyro_white * gyro[i]


@njit
def read_mag(tick, x, noise, k, y):
    """Fill the magnetometer's places of the row y; zeros between the periods."""
    mag, white = y[MEAS.mag], noise[NOISE.mag]
    y[MEAS.mag_valid] = 1.0 if tick % k.period == 0 else 0.0
    if y[MEAS.mag_valid] == 0.0:
        mag[0] = mag[1] = mag[2] = 0.0
        return
    f = k.field_ned_t
    b0, b1, b2 = to_body(attitude_of(x), f[0], f[1], f[2])
    for i in range(3):
        mag[i] = k.soft_iron[i, 0] * b0 + k.soft_iron[i, 1] * b1 + k.soft_iron[i, 2] * b2
        mag[i] += k.hard_iron_t[i] + k.white * white[i]


@njit
def read_baro(sensors, tick, x, noise, k, y):
    """Fill the barometer's places of the row y; zero between the periods."""
    y[MEAS.baro_valid] = 1.0 if tick % k.period == 0 else 0.0
    if y[MEAS.baro_valid] == 0.0:
        y[MEAS.baro] = 0.0
        return
    if tick > 0:
        sensors.baro_drift[0] = gauss_markov_step(
            sensors.baro_drift[0], k.decay, k.drift, noise[NOISE.baro_drift]
        )
    y[MEAS.baro] = pressure_pa(k.origin_altitude_m - x[PLANT.down]) + sensors.baro_drift[0]
    y[MEAS.baro] += k.white * noise[NOISE.baro]


@njit
def take_fix(sensors, tick, x, noise, k):
    """Measure position and velocity at `tick` and send them on their way."""
    slot = ((tick + k.latency) // k.period) % sensors.gps_queue.shape[0]
    u, v, w = velocity_of(x)
    fix = sensors.gps_queue[slot]
    pos, vel, true_pos = fix[FIX.pos], fix[FIX.vel], x[PLANT.pos]
    white_pos, white_vel = noise[NOISE.gps_pos], noise[NOISE.gps_vel]
    vel[0], vel[1], vel[2] = to_ned(attitude_of(x), u, v, w)
    for i in range(3):
        pos[i] = true_pos[i] + sensors.gps_drift[i] + k.white_m[i] * white_pos[i]
        vel[i] += k.velocity_mps * white_vel[i]
    fix[FIX.tick] = tick


@njit
def read_gps(sensors, tick, x, noise, k, y):
    """Fill the row y's places of GPS with the fix that arrives; zeros if none does.

    Fixes arrive at the multiples of the period and were valid `latency` ticks before.
    """
    drift = noise[NOISE.gps_drift]
    if (tick + k.latency) % k.period == 0:
        for i in range(3):
            sensors.gps_drift[i] = gauss_markov_step(
                sensors.gps_drift[i], k.decay, k.drift_m[i], drift[i]
            )
        take_fix(sensors, tick, x, noise, k)
    pos, vel = y[MEAS.gps_pos], y[MEAS.gps_vel]
    y[MEAS.gps_valid] = 1.0 if tick % k.period == 0 else 0.0
    y[MEAS.gps_tick] = 0.0
    for i in range(3):
        pos[i] = vel[i] = 0.0
    if y[MEAS.gps_valid] == 1.0:
        fix = sensors.gps_queue[(tick // k.period) % sensors.gps_queue.shape[0]]
        fix_pos, fix_vel = fix[FIX.pos], fix[FIX.vel]
        for i in range(3):
            pos[i], vel[i] = fix_pos[i], fix_vel[i]
        y[MEAS.gps_tick] = fix[FIX.tick]


@njit
def read_sensors(sensors, tick, x, air, noise, aircraft, k, y):
    """Fill what sensors say of the measurement row y at a tick."""
    read_imu(sensors, tick, x, air, noise, aircraft, k.imu, y)
    read_mag(tick, x, noise, k.mag, y)
    read_baro(sensors, tick, x, noise, k.baro, y)
    read_gps(sensors, tick, x, noise, k.gps, y)
