# SPDX-License-Identifier: Apache-2.0
"""A velocity command as a `geometry_msgs/TwistStamped`, as REP-147 has it: `command_velocity`."""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_math.ticks import NS_PER_S
from heli_msgs_bridge import frames, topics
from heli_msgs_bridge.channels import quoted
from heli_msgs_bridge.frame_ids import BASE, MAP, in_namespace
from heli_msgs_bridge.messages import MessageError


class VelocityCommand(NamedTuple):
    """How to move: stamp, ns; velocity (3,), NED, m/s; rate of the heading, rad/s, right is up."""

    stamp_ns: int
    vel_ned_mps: NDArray[np.float64]
    yaw_rate_radps: float


def decode_velocity(message: Any, psi_rad: float, namespace: str = "") -> VelocityCommand:
    """The velocity of a message (object of rclpy or of rosbags).

    Parameters
    ----------
    message : TwistStamped
        In `map` (east, north, up) or in the aircraft's `base_link` (forward, left, up), which is
        taken as level: forward is where the nose points, up is up.
    psi_rad : float
        The present heading, 0 is north.
    namespace : str, optional
        That of the aircraft, in front of its frames.

    Raises
    ------
    MessageError
        Another frame, a number that is not finite, a rate about another axis than up.
    """
    name, frame = topics.COMMAND_VELOCITY, message.header.frame_id
    own = in_namespace(BASE, namespace)
    if frame not in (MAP, own):
        raise MessageError(
            f"{name}: frame {quoted(frame)}; allowed: '{MAP}' (east, north, up), '{own}' (forward, "
            "left, up, level)"
        )
    v, w = message.twist.linear, message.twist.angular
    given, turn = np.array([v.x, v.y, v.z], float), np.array([w.x, w.y, w.z], float)
    if not np.isfinite(np.r_[given, turn]).all():
        raise MessageError(
            f"{name}: linear {given.tolist()}, angular {turn.tolist()}; allowed: finite numbers"
        )
    if turn[:2].any():
        raise MessageError(f"{name}: angular {turn.tolist()}; allowed: x and y are 0")
    vel = np.empty(3)
    if frame == MAP:
        frames.enu_to_ned(given, vel)
    else:
        frames.flu_to_frd(given, vel)
        forward, right = vel[0], vel[1]
        sin, cos = math.sin(psi_rad), math.cos(psi_rad)
        vel[0], vel[1] = cos * forward - sin * right, sin * forward + cos * right
    stamp = message.header.stamp
    return VelocityCommand(stamp.sec * NS_PER_S + stamp.nanosec, vel, -float(turn[2]))
