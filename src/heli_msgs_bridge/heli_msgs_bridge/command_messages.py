# SPDX-License-Identifier: Apache-2.0
"""The reference trajectory as a `trajectory_msgs/MultiDOFJointTrajectory` and back.

`header.stamp` is the moment from which `time_from_start` counts; poses and velocities are in the
header's frame (ENU). It is sent once per change, latched, so message objects are fast enough.
"""

import math
import struct
import zlib
from typing import Any

import numpy as np

from heli_math.rotations import euler_from_quat, quat_from_euler
from heli_math.rows import REFERENCE
from heli_math.ticks import NS_PER_S
from heli_math.trajectory import MAX_POINTS, Trajectory, TrajectoryError
from heli_msgs_bridge import frames, topics
from heli_msgs_bridge.channels import quoted
from heli_msgs_bridge.frame_ids import BASE, MAP, in_namespace
from heli_msgs_bridge.messages import MessageError


def encode_reference(reference: Trajectory, namespace: str = "") -> Any:
    """Message object of a trajectory for the aircraft in a namespace (imports ROS messages)."""
    from geometry_msgs.msg import Transform, Twist
    from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

    message = MultiDOFJointTrajectory()
    message.header.frame_id = MAP
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(reference.start_ns, NS_PER_S)
    message.joint_names = [in_namespace(BASE, namespace)]
    enu, q = np.empty(3), np.empty(4)
    for time_ns, point in zip(reference.times_ns.tolist(), reference.points, strict=True):
        pose, twist, row = Transform(), Twist(), MultiDOFJointTrajectoryPoint()
        frames.ned_to_enu(point[REFERENCE.pos], enu)
        pose.translation.x, pose.translation.y, pose.translation.z = enu.tolist()
        frames.ned_to_enu(point[REFERENCE.vel], enu)
        twist.linear.x, twist.linear.y, twist.linear.z = enu.tolist()
        frames.quat_ned_frd_to_enu_flu(quat_from_euler(0.0, 0.0, point[REFERENCE.psi]), q)
        rotation = pose.rotation
        rotation.x, rotation.y, rotation.z, rotation.w = q.tolist()
        row.time_from_start.sec, row.time_from_start.nanosec = divmod(time_ns, NS_PER_S)
        row.transforms, row.velocities = [pose], [twist]
        message.points.append(row)
    return message


def key_of(message: Any) -> int:
    """What tells a reference message from others: a sum of its times, places and headings.

    Of a message with more than may be decoded, only of as much: it takes no longer, however long.
    """
    stamp = message.header.stamp
    found = zlib.crc32(struct.pack("<qQ", stamp.sec, stamp.nanosec))
    for point in message.points[:MAX_POINTS]:
        at = point.time_from_start
        found = zlib.crc32(struct.pack("<qQ", at.sec, at.nanosec), found)
        for transform in point.transforms[:1]:
            t, r = transform.translation, transform.rotation
            found = zlib.crc32(struct.pack("<7d", t.x, t.y, t.z, r.x, r.y, r.z, r.w), found)
    return found


def _row(point: Any, index: int) -> np.ndarray:
    if len(point.transforms) != 1 or len(point.velocities) > 1:
        raise MessageError(
            f"{topics.REFERENCE}: point {index} has {len(point.transforms)} transforms and "
            f"{len(point.velocities)} velocities; expected one of each"
        )
    t, r = point.transforms[0].translation, point.transforms[0].rotation
    v = point.velocities[0].linear if point.velocities else None
    row, q = np.zeros(REFERENCE.size), np.empty(4)
    frames.enu_to_ned(np.array([t.x, t.y, t.z]), row[REFERENCE.pos])
    if v is not None:
        frames.enu_to_ned(np.array([v.x, v.y, v.z]), row[REFERENCE.vel])
    quaternion = np.array([r.x, r.y, r.z, r.w])
    if not abs(math.hypot(*quaternion.tolist()) - 1.0) < 1e-3:
        raise MessageError(f"{topics.REFERENCE}: point {index}: not a unit quaternion")
    frames.quat_enu_flu_to_ned_frd(quaternion, q)
    _, _, row[REFERENCE.psi] = euler_from_quat(q)
    return row


def decode_reference(message: Any, namespace: str | None = None) -> Trajectory:
    """The trajectory of a reference message (object of rclpy or of rosbags).

    Parameters
    ----------
    message : MultiDOFJointTrajectory
    namespace : str, optional
        Of the aircraft that follows: a way in another frame than `map`, or that names another
        aircraft, is refused. Left out, any name is taken (bags of others).

    Raises
    ------
    MessageError
        No points or too many, times that do not increase, values that are not finite, a frame that
        is not ENU.
    """
    name, frame = topics.REFERENCE, message.header.frame_id
    if frame.endswith(("_ned", "_frd")):
        raise MessageError(f"{name}: frame {quoted(frame)} says NED; expected ENU")
    if namespace is not None:
        if frame != MAP:
            raise MessageError(f"{name}: frame {quoted(frame)}; allowed: '{MAP}'")
        own, given = in_namespace(BASE, namespace), list(message.joint_names[:2])
        if given not in ([], [own]):
            said = ", ".join(map(quoted, given))
            raise MessageError(f"{name}: for {said}; allowed: '{own}', or no name")
    if len(message.points) > MAX_POINTS:
        # Before they are read, which takes as long as there are many.
        raise MessageError(
            f"{name}: holds {len(message.points)} points; allowed: at most {MAX_POINTS}"
        )
    if not message.points:
        raise MessageError(f"{name}: holds no points")
    times = [p.time_from_start.sec * NS_PER_S + p.time_from_start.nanosec for p in message.points]
    rows = [_row(point, index) for index, point in enumerate(message.points)]
    stamp = message.header.stamp
    start_ns = stamp.sec * NS_PER_S + stamp.nanosec
    try:
        return Trajectory(start_ns, np.array(times, dtype=np.int64), np.array(rows))
    except TrajectoryError as error:
        raise MessageError(f"{name}: {error}") from error
