# SPDX-License-Identifier: Apache-2.0
"""A commanded attitude, `command_attitude`, and the climb beside it, `command_climb`."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_math.ticks import NS_PER_S
from heli_msgs_bridge import topics
from heli_msgs_bridge.channels import quoted
from heli_msgs_bridge.frame_ids import BASE, MAP, in_namespace
from heli_msgs_bridge.goto_message import attitude_of
from heli_msgs_bridge.messages import MessageError


class AttitudeCommand(NamedTuple):
    """What attitude to have: stamp, ns; roll, pitch, heading (3,), NED, rad, 0 is north."""

    stamp_ns: int
    attitude_rad: NDArray[np.float64]


class ClimbCommand(NamedTuple):
    """How to climb: stamp, ns; speed, m/s, up is positive."""

    stamp_ns: int
    climb_mps: float


def decode_attitude(message: Any) -> AttitudeCommand:
    """The attitude of a `QuaternionStamped` (object of rclpy or of rosbags).

    As `attitude_setpoint` has it: from the aircraft (forward, left, up) to `map`.

    Raises
    ------
    MessageError
        Another frame, a number that is not finite, no unit quaternion.
    """
    name, frame, q = topics.COMMAND_ATTITUDE, message.header.frame_id, message.quaternion
    if frame != MAP:
        raise MessageError(f"{name}: frame {quoted(frame)}; allowed: '{MAP}' (east, north, up)")
    xyzw = np.array([q.x, q.y, q.z, q.w], float)
    if not np.isfinite(xyzw).all():
        raise MessageError(f"{name}: quaternion {xyzw.tolist()}; allowed: finite numbers")
    stamp = message.header.stamp
    return AttitudeCommand(stamp.sec * NS_PER_S + stamp.nanosec, np.array(attitude_of(name, xyzw)))


def decode_climb(message: Any, namespace: str = "") -> ClimbCommand:
    """The climb of a `TwistStamped` (object of rclpy or of rosbags).

    Parameters
    ----------
    message : TwistStamped
        In `map` or in the aircraft's `base_link`, which is taken as level: up is up.
    namespace : str, optional
        That of the aircraft, in front of its frames.

    Raises
    ------
    MessageError
        Another frame, a number that is not finite, anything but linear z.
    """
    name, frame = topics.COMMAND_CLIMB, message.header.frame_id
    own = in_namespace(BASE, namespace)
    if frame not in (MAP, own):
        raise MessageError(f"{name}: frame {quoted(frame)}; allowed: '{MAP}', '{own}' (level)")
    v, w = message.twist.linear, message.twist.angular
    linear, angular = np.array([v.x, v.y, v.z], float), np.array([w.x, w.y, w.z], float)
    said = f"{name}: linear {linear.tolist()}, angular {angular.tolist()}; allowed: "
    if not np.isfinite(np.r_[linear, angular]).all():
        raise MessageError(f"{said}finite numbers")
    if linear[:2].any() or angular.any():
        raise MessageError(f"{said}linear z alone, the others are 0")
    stamp = message.header.stamp
    return ClimbCommand(stamp.sec * NS_PER_S + stamp.nanosec, float(linear[2]))
