# SPDX-License-Identifier: Apache-2.0
"""A recorded flight as a ULog with PX4's names, for PX4 Flight Review and PlotJuggler.

Topics and fields as in https://docs.px4.io/main/en/msg_docs/: NED and FRD, SI, rad, quaternions
(w, x, y, z) body -> NED. Only what means the same as PX4's bears PX4's name.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_bags.ulog import Table, ulog
from heli_flight.report.from_bag import Recorded
from heli_math.rotations import quat_from_euler
from heli_math.rows import IMU, REFERENCE
from heli_math.ticks import Rate

HELICOPTER = 4
"""MAV_TYPE_HELICOPTER of MAVLink."""
_SERVOS = 8  # of actuator_servos; NaN where there is none
_Array = NDArray[np.float64]


def ulog_of(flight: Recorded) -> bytes:
    """The flight's log; a row is left out while its numbers are unknown."""
    record = flight.record
    time_us = np.round(record.time_s * 1e6).astype(np.uint64)
    tables = [
        *_motion("", record.nav_pos_ned_m, record.nav_vel_ned_mps, record.nav_q_nb,
                 record.nav_rate_body_radps),
        *_motion("_groundtruth", record.truth_pos_ned_m, record.truth_vel_ned_mps,
                 record.truth_q_nb, record.truth_rate_body_radps),
        _place("vehicle_local_position_setpoint", record.reference[:, REFERENCE.pos],
               record.reference[:, REFERENCE.vel], {"yaw": record.reference[:, REFERENCE.psi]}),
        _setpoint(record.setpoint),
        _servos(record.u),
    ]  # fmt: skip
    if record.imu is not None:
        tables.append(_sensed(record.imu, flight.settings.rate))
    infos = {"sys_name": "heli-hover", "ver_sw": flight.commit or "unknown"}
    return ulog(time_us, tables, infos, _parameters(flight.settings.nodes))


def _table(name: str, fields: Mapping[str, _Array]) -> Table:
    """A table of floats, with the rows that are known."""
    known = np.all([np.isfinite(a).reshape(len(a), -1).all(axis=1) for a in fields.values()], 0)
    return Table(name, {key: a.astype(np.float32) for key, a in fields.items()}, known)


def _place(name: str, pos: _Array, vel: _Array, more: Mapping[str, _Array]) -> Table:
    axes = zip(("x", "y", "z", "vx", "vy", "vz"), np.hstack([pos, vel]).T, strict=True)
    return _table(name, {**dict(axes), **more})


def _motion(suffix: str, pos: _Array, vel: _Array, quat: _Array, rate: _Array) -> list[Table]:
    w, x, y, z = quat.T
    heading = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    place = _place(f"vehicle_local_position{suffix}", pos, vel, {"heading": heading})
    valid = np.ones(len(pos), dtype=bool)
    flags = dict.fromkeys(("xy_valid", "z_valid", "v_xy_valid", "v_z_valid"), valid)
    return [
        Table(place.name, {**place.fields, **flags}, place.present),
        _table(f"vehicle_attitude{suffix}", {"q": quat}),
        _table(f"vehicle_angular_velocity{suffix}", {"xyz": rate}),
    ]


def _setpoint(euler: _Array) -> Table:
    quat = np.array([quat_from_euler(*angles) for angles in euler])
    names = ("roll_body", "pitch_body", "yaw_body")
    return _table(
        "vehicle_attitude_setpoint", {**dict(zip(names, euler.T, strict=True)), "q_d": quat}
    )


def _servos(u: _Array) -> Table:
    known = _table("actuator_servos", {"control": u})
    control = np.full((len(u), _SERVOS), np.nan, dtype=np.float32)
    control[:, : u.shape[1]] = u
    return Table(known.name, {"control": control}, known.present)


def _sensed(imu: _Array, rate: Rate) -> Table:
    table = _table(
        "sensor_combined", {"gyro_rad": imu[:, IMU.rate], "accelerometer_m_s2": imu[:, IMU.force]}
    )
    step = np.full(len(imu), rate.tick_ns // 1000, dtype=np.uint32)
    steps = {"gyro_integral_dt": step, "accelerometer_integral_dt": step}
    return Table(table.name, {**table.fields, **steps}, table.present)


def _parameters(nodes: Mapping[str, Mapping[str, Any]]) -> dict[str, int | float]:
    """Every number of every node as `node.name`; lists and texts have no place in a ULog."""
    return {"MAV_TYPE": HELICOPTER} | {
        f"{node}.{name}": int(value) if isinstance(value, bool) else value
        for node, values in nodes.items()
        for name, value in values.items()
        if isinstance(value, (int, float))
    }
