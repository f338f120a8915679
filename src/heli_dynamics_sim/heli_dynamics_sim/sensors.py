# SPDX-License-Identifier: Apache-2.0
"""Sensors: IMU, magnetometer, barometer, GPS, rotor speed. All in body FRD and NED, SI.

Every error is a function of the standard normals that are passed in. First-order Gauss-Markov
processes and random walks are stepped exactly. Noise, bias and drift are here; what sensors of some
grade have besides, off by default, in `imu_errors`, `gps_errors` and `installation`. A sample of a
sensor with a jittering clock is taken a little before or after its stamp, to first order.
"""

import math
from typing import NamedTuple

import numpy as np

from heli_dynamics_sim.gps_errors import GpsErrorKernel, GpsErrorState, spoil_fix, step_gps_errors
from heli_dynamics_sim.helicopter import specific_force
from heli_dynamics_sim.imu_errors import ImuErrorKernel, ImuErrorState, clip, distort
from heli_dynamics_sim.installation import (
    PortKernel,
    PowerFieldKernel,
    add_power_field,
    port_error,
)
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.rigid_body import to_body, to_ned
from heli_dynamics_sim.state import attitude_of, rates_of, velocity_of
from heli_math.arrays import fill
from heli_math.atmosphere import pressure_pa
from heli_math.jit import njit
from heli_math.rows import IMU, MEAS, PLANT


class FixRow(NamedTuple):
    """A GPS fix under way (8,)."""

    pos: slice = slice(0, 3)  # NED, m
    vel: slice = slice(3, 6)  # NED, m/s
    tick: int = 6  # of validity
    got: int = 7  # 1.0 if there was one
    size: int = 8


FIX = FixRow()


class ImuKernel(NamedTuple):
    """Per tick, not per root hertz."""

    gyro_white: float  # rad/s
    accel_white: float  # m/s2
    gyro_walk: float  # rad/s per tick
    accel_walk: float  # m/s2 per tick
    gyro_bias: float  # sigma at start, rad/s
    accel_bias: float  # m/s2
    errors: ImuErrorKernel


class MagKernel(NamedTuple):
    """Reads `soft_iron @ field + hard_iron + white`; the state holds the flight's own iron."""

    field_ned_t: np.ndarray  # (3,)
    soft_iron: np.ndarray  # (3, 3)
    hard_iron_t: np.ndarray  # (3,)
    white: float  # T
    period: int  # ticks
    clock_s: float  # sigma of the sampling instant about the stamp
    soft_sigma: float  # of each entry at the start
    hard_sigma_t: float  # of each axis at the start
    power: PowerFieldKernel


class BaroKernel(NamedTuple):
    """ISA pressure at the altitude above the origin, white noise and a slow drift."""

    origin_altitude_m: float
    white: float  # Pa
    drift: float  # stationary sigma, Pa
    decay: float  # per period
    period: int  # ticks
    clock_s: float  # sigma of the sampling instant about the stamp
    port: PortKernel


class GpsKernel(NamedTuple):
    """Fixes that are valid now and arrive later."""

    white_m: np.ndarray  # (3,) NED
    drift_m: np.ndarray  # (3,) stationary sigma, NED
    decay: float  # of the drift, per period
    velocity_mps: float
    period: int  # ticks
    latency: int  # ticks
    lost_tick: int  # from which on there is no fix
    found_tick: int  # and from which on there is one again
    errors: GpsErrorKernel


class RotorSpeedKernel(NamedTuple):
    """A Hall sensor beside the mast: time between the passes of a magnet, told in steps."""

    white: float  # rad/s
    step: float  # rad/s; 0: none
    period: int  # ticks


class SensorKernel(NamedTuple):
    """All sensors."""

    imu: ImuKernel
    mag: MagKernel
    baro: BaroKernel
    gps: GpsKernel
    rotor: RotorSpeedKernel
    imu2: bool  # whether there is a second one, of the same kind as the first


class ImuState(NamedTuple):
    """What an IMU remembers."""

    gyro_bias: np.ndarray  # (3,) rad/s
    accel_bias: np.ndarray  # (3,) m/s2
    errors: ImuErrorState


class SensorState(NamedTuple):
    """What the sensors remember."""

    gyro_bias: np.ndarray  # (3,) rad/s
    accel_bias: np.ndarray  # (3,) m/s2
    baro_drift: np.ndarray  # (1,) Pa
    gps_drift: np.ndarray  # (3,) NED, m
    gps_queue: np.ndarray  # (slots, 8) fixes under way, a FixRow each
    imu: ImuErrorState
    soft_iron: np.ndarray  # (3, 3) of this flight
    hard_iron_t: np.ndarray  # (3,)
    gps: GpsErrorState
    imu2: ImuState  # of the second one, if there is one


@njit
def gauss_markov_step(x, decay, sigma, n):
    """Next value of a stationary first-order Gauss-Markov process with this sigma."""
    return decay * x + sigma * math.sqrt(1.0 - decay * decay) * n


@njit
def rotor_speed(x, aircraft):
    """Speed of the main rotor, rad/s: a state, or as the aircraft's file says."""
    return x[PLANT.omega] if aircraft.terms.rotor_speed else aircraft.main.speed


class ImuNormals(NamedTuple):
    """Standard normals of an IMU at a tick, (3,) each, and of its clock."""

    gyro: np.ndarray
    accel: np.ndarray
    gyro_walk: np.ndarray
    accel_walk: np.ndarray
    clock: float


@njit
def _read_imu(imu, tick, x, air, normals, aircraft, k, out):
    """What one IMU (ImuState) says, (6,), places of `rows.IMU`; its biases walk."""
    force, rate, true_rate = out[IMU.force], out[IMU.rate], x[PLANT.rate]
    specific_force(x, air, aircraft, force)
    for i in range(3):
        rate[i] = true_rate[i]
    if k.errors.on:
        distort(imu.errors, tick, rotor_speed(x, aircraft), normals.clock, k.errors, out)
    for i in range(3):
        if tick > 0:
            imu.gyro_bias[i] += k.gyro_walk * normals.gyro_walk[i]
            imu.accel_bias[i] += k.accel_walk * normals.accel_walk[i]
        force[i] += imu.accel_bias[i] + k.accel_white * normals.accel[i]
        rate[i] = rate[i] + imu.gyro_bias[i] + k.gyro_white * normals.gyro[i]
    if k.errors.on:
        clip(k.errors, out)


@njit
def read_imu(sensors, tick, x, air, noise, aircraft, k, y):
    """Fill specific force and rates of the measurement row y; biases walk."""
    first = ImuState(sensors.gyro_bias, sensors.accel_bias, sensors.imu)
    normals = ImuNormals(
        noise[NOISE.gyro],
        noise[NOISE.accel],
        noise[NOISE.gyro_walk],
        noise[NOISE.accel_walk],
        noise[NOISE.imu_clock],
    )
    _read_imu(first, tick, x, air, normals, aircraft, k, y[MEAS.imu])


@njit
def read_imu2(sensors, tick, x, air, noise, aircraft, k, y):
    """The same of the second IMU: errors of its own, shaken by the same rotor; zeros without it."""
    if not k.imu2:
        fill(y[MEAS.imu2], 0.0)
        return
    normals = ImuNormals(
        noise[NOISE.gyro2],
        noise[NOISE.accel2],
        noise[NOISE.gyro2_walk],
        noise[NOISE.accel2_walk],
        noise[NOISE.imu2_clock],
    )
    _read_imu(sensors.imu2, tick, x, air, normals, aircraft, k.imu, y[MEAS.imu2])


@njit
def read_mag(sensors, tick, x, air, noise, aircraft, k, y):
    """Fill the magnetometer's places of the row y; zeros between the periods."""
    mag, white = y[MEAS.mag], noise[NOISE.mag]
    y[MEAS.mag_valid] = 1.0 if tick % k.period == 0 else 0.0
    if y[MEAS.mag_valid] == 0.0:
        mag[0] = mag[1] = mag[2] = 0.0
        return
    f = k.field_ned_t
    b0, b1, b2 = to_body(attitude_of(x), f[0], f[1], f[2])
    if k.clock_s > 0.0:
        # db/dt = b x omega in turning axes
        late_s, (p, q, r) = k.clock_s * noise[NOISE.mag_clock], rates_of(x)
        b0, b1, b2 = (
            b0 + late_s * (b1 * r - b2 * q),
            b1 + late_s * (b2 * p - b0 * r),
            b2 + late_s * (b0 * q - b1 * p),
        )
    soft, hard = sensors.soft_iron, sensors.hard_iron_t
    for i in range(3):
        mag[i] = soft[i, 0] * b0 + soft[i, 1] * b1 + soft[i, 2] * b2
        mag[i] += hard[i] + k.white * white[i]
    if k.power.on:
        add_power_field(x, air, aircraft, k.power, mag)


@njit
def read_baro(sensors, tick, x, air, noise, aircraft, k, y):
    """Fill the barometer's places of the row y; zero between the periods."""
    y[MEAS.baro_valid] = 1.0 if tick % k.period == 0 else 0.0
    if y[MEAS.baro_valid] == 0.0:
        y[MEAS.baro] = 0.0
        return
    if tick > 0:
        sensors.baro_drift[0] = gauss_markov_step(
            sensors.baro_drift[0], k.decay, k.drift, noise[NOISE.baro_drift]
        )
    down = x[PLANT.down]
    if k.clock_s > 0.0:
        u, v, w = velocity_of(x)
        down += k.clock_s * noise[NOISE.baro_clock] * to_ned(attitude_of(x), u, v, w)[2]
    y[MEAS.baro] = pressure_pa(k.origin_altitude_m - down) + sensors.baro_drift[0]
    y[MEAS.baro] += k.white * noise[NOISE.baro]
    if k.port.on:
        y[MEAS.baro] += port_error(x, air, aircraft, k.port)


@njit
def take_fix(sensors, tick, x, noise, k):
    """Measure position and velocity at `tick` and send them on their way."""
    slot = ((tick + k.latency) // k.period) % sensors.gps_queue.shape[0]
    u, v, w = velocity_of(x)
    fix = sensors.gps_queue[slot]
    pos, vel, true_pos = fix[FIX.pos], fix[FIX.vel], x[PLANT.pos]
    white_pos, white_vel = noise[NOISE.gps_pos], noise[NOISE.gps_vel]
    velocity = to_ned(attitude_of(x), u, v, w)
    vel[0], vel[1], vel[2] = velocity
    for i in range(3):
        pos[i] = true_pos[i] + sensors.gps_drift[i] + k.white_m[i] * white_pos[i]
        vel[i] += k.velocity_mps * white_vel[i]
    fix[FIX.tick], fix[FIX.got] = tick, 1.0
    if k.errors.on and not spoil_fix(sensors.gps, noise, k, velocity, pos, vel):
        fix[FIX.got] = 0.0
    if k.lost_tick <= tick < k.found_tick:
        fix[FIX.got] = 0.0


@njit
def read_gps(sensors, tick, x, noise, k, y):
    """Fill the row y's places of GPS with the fix that arrives; zeros if none does.

    Fixes arrive at the multiples of the period and were valid `latency` ticks before; a receiver
    without a fix then has none.
    """
    drift = noise[NOISE.gps_drift]
    if (tick + k.latency) % k.period == 0:
        for i in range(3):
            sensors.gps_drift[i] = gauss_markov_step(
                sensors.gps_drift[i], k.decay, k.drift_m[i], drift[i]
            )
        if k.errors.on:
            step_gps_errors(sensors.gps, noise, k.errors)
        take_fix(sensors, tick, x, noise, k)
    pos, vel = y[MEAS.gps_pos], y[MEAS.gps_vel]
    y[MEAS.gps_valid] = y[MEAS.gps_tick] = 0.0
    for i in range(3):
        pos[i] = vel[i] = 0.0
    fix = sensors.gps_queue[(tick // k.period) % sensors.gps_queue.shape[0]]
    if tick % k.period == 0 and fix[FIX.got] == 1.0:
        fix_pos, fix_vel = fix[FIX.pos], fix[FIX.vel]
        for i in range(3):
            pos[i], vel[i] = fix_pos[i], fix_vel[i]
        y[MEAS.gps_valid], y[MEAS.gps_tick] = 1.0, fix[FIX.tick]


@njit
def read_rotor(tick, x, noise, aircraft, k, y):
    """Fill the rotor speed's places of the row y; zero between the periods."""
    y[MEAS.rotor_valid] = 1.0 if tick % k.period == 0 else 0.0
    if y[MEAS.rotor_valid] == 0.0:
        y[MEAS.rotor] = 0.0
        return
    speed = rotor_speed(x, aircraft) + k.white * noise[NOISE.rotor]
    y[MEAS.rotor] = k.step * round(speed / k.step) if k.step > 0.0 else speed


@njit
def read_sensors(sensors, tick, x, air, noise, aircraft, k, y):
    """Fill what sensors say of the measurement row y at a tick."""
    read_imu(sensors, tick, x, air, noise, aircraft, k.imu, y)
    read_mag(sensors, tick, x, air, noise, aircraft, k.mag, y)
    read_baro(sensors, tick, x, air, noise, aircraft, k.baro, y)
    read_gps(sensors, tick, x, noise, k.gps, y)
    read_rotor(tick, x, noise, aircraft, k.rotor, y)
    read_imu2(sensors, tick, x, air, noise, aircraft, k, y)
