# SPDX-License-Identifier: Apache-2.0
"""What sensors remember before tick 0, drawn from the stationary distributions."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_dynamics_sim.gps_errors import FEWEST_SATELLITES, GpsErrorKernel, GpsErrorState, uniform
from heli_dynamics_sim.imu_errors import ImuErrorState
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.sensors import (
    FIX,
    GpsKernel,
    ImuKernel,
    ImuState,
    SensorKernel,
    SensorState,
    take_fix,
)
from heli_math.rows import IMU


class OnceRow(NamedTuple):
    """Standard normals that a flight's sensors draw once (28,)."""

    gains: slice = slice(0, 18)  # scale and misalignment of both triads
    soft_iron: slice = slice(18, 24)
    hard_iron: slice = slice(24, 27)
    azimuth: int = 27
    size: int = 28


ONCE = OnceRow()


def fix_slots(gps: GpsKernel) -> int:
    """Length of the queue of fixes under way."""
    return gps.latency // gps.period + 1


def initial_sensors(
    k: SensorKernel,
    rows: NDArray[np.float64],
    once: NDArray[np.float64],
    once_imu2: NDArray[np.float64],
    x: NDArray[np.float64],
) -> SensorState:
    """Biases, drifts, scale factors, iron and the fixes under way of a flight.

    Parameters
    ----------
    k : SensorKernel
    rows : (fix_slots, n) array
        Standard normals, places of `noise.NOISE`.
    once : (28,) array
        Standard normals, places of ONCE.
    once_imu2 : (18,) array
        The same of a second IMU: scale and misalignment of both triads.
    x : (n,) array
        State of the plant at the start, places of `rows.PLANT`: the fixes under way are its.
    """
    gps, first = k.gps, rows[0]
    # The rotor stands anywhere, all azimuths alike.
    azimuth = 2.0 * math.pi * uniform(once[ONCE.azimuth])
    sensors = SensorState(
        gyro_bias=k.imu.gyro_bias * first[NOISE.gyro],
        accel_bias=k.imu.accel_bias * first[NOISE.accel],
        baro_drift=np.array([k.baro.drift * first[NOISE.baro]]),
        gps_drift=gps.drift_m * first[NOISE.gps_drift],
        gps_queue=np.zeros((rows.shape[0], FIX.size)),
        imu=_imu_errors(k.imu, once[ONCE.gains], azimuth),
        soft_iron=k.mag.soft_iron + k.mag.soft_sigma * _symmetric(once[ONCE.soft_iron]),
        hard_iron_t=k.mag.hard_iron_t + k.mag.hard_sigma_t * once[ONCE.hard_iron],
        gps=_gps_errors(gps.errors, first),
        imu2=ImuState(
            k.imu.gyro_bias * first[NOISE.gyro2],
            k.imu.accel_bias * first[NOISE.accel2],
            _imu_errors(k.imu, once_imu2, azimuth),
        ),
    )
    for i in range(rows.shape[0]):
        valid = i * gps.period - gps.latency
        if valid < 0:
            take_fix(sensors, valid, x, rows[i], gps)
    return sensors


def _imu_errors(k: ImuKernel, gains: NDArray[np.float64], azimuth: float) -> ImuErrorState:
    """Scale and misalignment (18 normals); the rotor's azimuth is that of the aircraft."""
    sigma = k.errors.gain_sigma
    return ImuErrorState(
        np.eye(3) + sigma * gains.reshape(2, 3, 3), np.array([azimuth]), np.zeros(IMU.size)
    )


def _symmetric(six: NDArray[np.float64]) -> NDArray[np.float64]:
    """Symmetric matrix (3, 3) of its six entries: induced magnetisation is reciprocal."""
    a, b, c, d, e, f = six
    return np.array([[a, d, e], [d, b, f], [e, f, c]])


def _gps_errors(k: GpsErrorKernel, first: NDArray[np.float64]) -> GpsErrorState:
    """Stationary, but the flight begins with a fix: enough satellites, no outage."""
    draw = float(uniform(first[NOISE.gps_satellites]))
    blocked, part = 0, np.exp(-k.blocked)
    while draw > part and blocked < k.satellites - FEWEST_SATELLITES:
        draw -= part
        blocked += 1
        part *= k.blocked / blocked
    return GpsErrorState(
        multipath=k.multipath_m * first[NOISE.gps_multipath],
        jump=k.jump_m * first[NOISE.gps_jump],
        blocked=np.array([float(blocked)]),
        out=np.zeros(1),
    )
