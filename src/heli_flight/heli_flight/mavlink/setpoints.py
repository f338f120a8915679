# SPDX-License-Identifier: Apache-2.0
"""Set-points of mode OFFBOARD: what SET_POSITION_TARGET_* ask for, and what of it is followed.

A position is flown to as by a go-to; a velocity is flown while it is renewed. Mixed ones,
accelerations and forces are refused.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_flight.mavlink.link import common
from heli_msgs_bridge.frames import Datum, geodetic_to_ned

Array = NDArray[np.float64]
_POSITION, _VELOCITY, _ACCELERATION = 0b111, 0b111000, 0b111000000
_FORCE, _NO_YAW, _NO_YAW_RATE = 1 << 9, 1 << 10, 1 << 11
_BODY = (
    common.MAV_FRAME_BODY_NED, common.MAV_FRAME_BODY_OFFSET_NED, common.MAV_FRAME_BODY_FRD,
)  # fmt: skip
RELATIVE = (common.MAV_FRAME_GLOBAL_RELATIVE_ALT, common.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
ABSOLUTE = (common.MAV_FRAME_GLOBAL, common.MAV_FRAME_GLOBAL_INT)


class SetpointError(ValueError):
    """A set-point or a place that is not followed; one sentence."""


@dataclass(frozen=True)
class Setpoint:
    """A position or a velocity, and when it came.

    Attributes
    ----------
    pos_ned_m, vel_ned_mps : (3,) array or None
        One of them.
    psi_rad : float or None
        Heading; None: as it is.
    yaw_rate_radps : float
    at_ns : int
        Flight time at which it was heard.
    """

    pos_ned_m: Array | None
    vel_ned_mps: Array | None
    psi_rad: float | None
    yaw_rate_radps: float
    at_ns: int


def place_ned_m(
    lat_e7: int, lon_e7: int, alt_m: float, frame: int, where: Datum, home_ned_m: Array
) -> Array:
    """A place (3,), NED, m.

    Parameters
    ----------
    lat_e7, lon_e7 : int
        1e-7 deg.
    alt_m : float
        Above the ellipsoid or above home, as the frame says.
    frame : int
        MAV_FRAME.
    where : Datum
    home_ned_m : (3,) array

    Raises
    ------
    SetpointError
        Another frame, or no place on Earth.
    """
    if frame not in (*RELATIVE, *ABSOLUTE):
        raise SetpointError(f"frame {frame}: not read; allowed: global, global relative to home")
    lat, lon = lat_e7 * 1e-7, lon_e7 * 1e-7
    if not (abs(lat) <= 90.0 and abs(lon) <= 180.0 and math.isfinite(alt_m)):
        raise SetpointError("latitude, longitude or altitude: no place on Earth")
    out = np.empty(3)
    absolute = frame in ABSOLUTE
    geodetic_to_ned(np.array([lat, lon, alt_m if absolute else where.alt_m]), where, out)
    if not absolute:
        out[2] = home_ned_m[2] - alt_m
    return out


def read_setpoint(
    message: Any, now_ns: int, psi_rad: float, pos_ned_m: Array, where: Datum, home_ned_m: Array
) -> Setpoint:
    """A set-point of SET_POSITION_TARGET_LOCAL_NED or _GLOBAL_INT.

    Parameters
    ----------
    message : MAVLink message
    now_ns : int
    psi_rad, pos_ned_m : float, (3,) array
        Heading and position of the aircraft, for frames that move with it.
    where, home_ned_m
        As of `place_ned_m`.

    Raises
    ------
    SetpointError
        It is mixed, not finite, or in a frame that is not read.
    """
    mask, frame = message.type_mask, message.coordinate_frame
    uses_pos, uses_vel = mask & _POSITION == 0, mask & _VELOCITY == 0
    if mask & _ACCELERATION != _ACCELERATION or mask & _FORCE:
        raise SetpointError("set-point: accelerations and forces are not followed")
    if not uses_pos and (not uses_vel or mask & _POSITION != _POSITION):
        raise SetpointError("set-point: allowed: all of a position, or all of a velocity alone")
    wants_psi, wants_rate = not mask & _NO_YAW, not mask & _NO_YAW_RATE
    used = [*((message.yaw,) if wants_psi else ()), *((message.yaw_rate,) if wants_rate else ())]
    used += [] if uses_pos else [message.vx, message.vy, message.vz]
    if not all(map(math.isfinite, used)):
        raise SetpointError("set-point: its numbers are not finite")
    rate = float(message.yaw_rate) if wants_rate else 0.0
    if not uses_pos:
        return Setpoint(None, _velocity(message, frame, psi_rad), None, rate, now_ns)
    psi = float(message.yaw) if wants_psi else None
    if message.get_type() == "SET_POSITION_TARGET_GLOBAL_INT":
        goal = place_ned_m(message.lat_int, message.lon_int, message.alt, frame, where, home_ned_m)
    else:
        goal = np.array([message.x, message.y, message.z], float)
        if not np.isfinite(goal).all():
            raise SetpointError("set-point: its numbers are not finite")
        if frame == common.MAV_FRAME_LOCAL_OFFSET_NED:
            goal = goal + pos_ned_m
        elif frame != common.MAV_FRAME_LOCAL_NED:
            raise SetpointError(
                f"position in frame {frame}: not read; allowed: local NED, or an offset"
            )
    return Setpoint(goal, None, psi, rate, now_ns)


def _velocity(message: Any, frame: int, psi_rad: float) -> Array:
    """Velocity (3,), NED, m/s."""
    forward, right, down = float(message.vx), float(message.vy), float(message.vz)
    if frame not in _BODY:
        return np.array([forward, right, down])
    c, s = math.cos(psi_rad), math.sin(psi_rad)
    return np.array([c * forward - s * right, s * forward + c * right, down])
