# SPDX-License-Identifier: Apache-2.0
"""A goal as a `geometry_msgs/PoseStamped`: position and heading in `map`."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_math.rotations import euler_from_quat
from heli_math.ticks import NS_PER_S
from heli_msgs_bridge import frames, topics
from heli_msgs_bridge.channels import quoted
from heli_msgs_bridge.frame_ids import MAP
from heli_msgs_bridge.messages import MessageError

_LEVEL_DEG = 1.0
_UNIT_ERROR = 1e-3


class GoalPose(NamedTuple):
    """Where to go: stamp, ns; position (3,), NED, m; heading, rad, 0 is north."""

    stamp_ns: int
    pos_ned_m: NDArray[np.float64]
    psi_rad: float


def decode_goto(message: Any, name: str = topics.GOTO) -> GoalPose:
    """The goal of a message (object of rclpy or of rosbags) on a topic of this name.

    Raises
    ------
    MessageError
        Another frame than `map`, a number that is not finite, an orientation that is none or is
        not level.
    """
    frame, pose = message.header.frame_id, message.pose
    if frame != MAP:
        raise MessageError(f"{name}: frame {quoted(frame)}; allowed: '{MAP}' (east, north, up)")
    p, r = pose.position, pose.orientation
    enu, quaternion = np.array([p.x, p.y, p.z]), np.array([r.x, r.y, r.z, r.w])
    if not np.isfinite(np.r_[enu, quaternion]).all():
        raise MessageError(
            f"{name}: position {enu.tolist()}, orientation {quaternion.tolist()}; allowed: finite "
            "numbers"
        )
    pos = np.empty(3)
    frames.enu_to_ned(enu, pos)
    phi, theta, psi = attitude_of(name, quaternion)
    tilt_deg = math.degrees(max(abs(phi), abs(theta)))
    if tilt_deg > _LEVEL_DEG:
        raise MessageError(
            f"{name}: an orientation tilted by {tilt_deg:.0f} deg; allowed: level, within "
            f"{_LEVEL_DEG:g} deg"
        )
    stamp = message.header.stamp
    return GoalPose(stamp.sec * NS_PER_S + stamp.nanosec, pos, psi)


def attitude_of(name: str, xyzw: NDArray[np.float64]) -> tuple[float, float, float]:
    """Roll, pitch, heading, NED, rad, of an ENU/FLU quaternion (4,) on a topic of this name.

    MessageError if it is no unit quaternion.
    """
    length = math.hypot(*xyzw.tolist())
    if abs(length - 1.0) > _UNIT_ERROR:
        raise MessageError(f"{name}: a quaternion of length {length:.3g}; allowed: 1")
    q = np.empty(4)
    frames.quat_enu_flu_to_ned_frd(xyzw, q)
    phi, theta, psi = euler_from_quat(q)
    return float(phi), float(theta), float(psi)
