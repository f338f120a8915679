# SPDX-License-Identifier: Apache-2.0
"""Where the numbers are that a fault changes: of sensors and of actuators."""

from typing import NamedTuple

from heli_dynamics_sim.noise import NOISE
from heli_math.rows import ACTUATOR, MEAS


class Sensor(NamedTuple):
    """Where a sensor's numbers are."""

    first: int  # place in the measurement row
    axes: int  # numbers that a value has
    numbers: int  # of a sample
    flag: int  # place of its flag, negative: none
    lost: int  # place in the row of normals of the one that decides what is lost
    normals: int  # and of the first of those for its numbers


_GPS, IMU, IMU2 = MEAS.gps_pos.start, MEAS.imu.start, MEAS.imu2.start
_LOST = NOISE.fault_lost.start


def _sensor(first: int, axes: int, numbers: int, flag: int, lost: int) -> Sensor:
    return Sensor(first, axes, numbers, flag, _LOST + lost, NOISE.fault.start + first)


def _second(first: int, axes: int) -> Sensor:
    normals = NOISE.fault_imu2.start + first - IMU2
    return Sensor(first, axes, axes, -1, NOISE.fault_imu2_lost, normals)


SECOND = {
    "imu2": _second(IMU2, 6),
    "accel2": _second(MEAS.force2.start, 3),
    "gyro2": _second(MEAS.rate2.start, 3),
}
SENSORS = {
    "gps": _sensor(_GPS, 3, 6, MEAS.gps_valid, 0),
    "gps_velocity": _sensor(MEAS.gps_vel.start, 3, 3, -1, 1),
    "imu": _sensor(IMU, 6, 6, -1, 2),
    "accel": _sensor(MEAS.force.start, 3, 3, -1, 2),
    "gyro": _sensor(MEAS.rate.start, 3, 3, -1, 2),
    "mag": _sensor(MEAS.mag.start, 3, 3, MEAS.mag_valid, 3),
    "baro": _sensor(MEAS.baro, 1, 1, MEAS.baro_valid, 4),
    "rotor_speed": Sensor(
        MEAS.rotor, 1, 1, MEAS.rotor_valid, NOISE.fault_rotor_lost, NOISE.fault_rotor
    ),
    **SECOND,
}
ACTUATORS = {
    "delta_lat": ACTUATOR.lat,
    "delta_lon": ACTUATOR.lon,
    "delta_ped": ACTUATOR.ped,
    "delta_col": ACTUATOR.col,
}
