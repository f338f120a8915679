# SPDX-License-Identifier: Apache-2.0
"""The reference trajectory as a `trajectory_msgs/MultiDOFJointTrajectory` and back.

`header.stamp` is the moment from which `time_from_start` counts; poses and velocities are in the
header's frame (ENU). It is sent once per change, latched, so message objects are fast enough.
"""

import math
import struct
import zlib
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.rotations import euler_from_quat, quat_from_euler
from heli_core.rows import REFERENCE
from heli_core.ticks import LATITUDE_DEG, LONGITUDE_DEG, NS_PER_S
from heli_core.trajectory import MAX_POINTS, Trajectory, TrajectoryError
from heli_msgs_bridge import frames, topics
from heli_msgs_bridge.layouts import FrameError, MessageCause, MessageError, quoted
from heli_msgs_bridge.topics import BASE, MAP, in_namespace

# -------------------------------------------------------------------------------------------------
# Reference message.
# -------------------------------------------------------------------------------------------------

_IN_MAP, _FINITE = f"'{MAP}' (east, north, up)", "finite numbers"


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
    checksum = zlib.crc32(struct.pack("<qQ", stamp.sec, stamp.nanosec))
    for point in message.points[:MAX_POINTS]:
        at = point.time_from_start
        checksum = zlib.crc32(struct.pack("<qQ", at.sec, at.nanosec), checksum)
        for transform in point.transforms[:1]:
            t, r = transform.translation, transform.rotation
            checksum = zlib.crc32(struct.pack("<7d", t.x, t.y, t.z, r.x, r.y, r.z, r.w), checksum)
    return checksum


def _row(point: Any, index: int) -> np.ndarray:
    if len(point.transforms) != 1 or len(point.velocities) > 1:
        raise MessageError(
            f"point {index} has {len(point.transforms)} transforms and "
            f"{len(point.velocities)} velocities; expected one of each",
            MessageCause.LENGTH,
            topic=topics.REFERENCE,
            value=(index, len(point.transforms), len(point.velocities)),
        )
    t, r = point.transforms[0].translation, point.transforms[0].rotation
    v = point.velocities[0].linear if point.velocities else None
    row, q = np.zeros(REFERENCE.size), np.empty(4)
    frames.enu_to_ned(np.array([t.x, t.y, t.z]), row[REFERENCE.pos])
    if v is not None:
        frames.enu_to_ned(np.array([v.x, v.y, v.z]), row[REFERENCE.vel])
    quaternion = np.array([r.x, r.y, r.z, r.w])
    if not abs(math.hypot(*quaternion.tolist()) - 1.0) < 1e-3:
        raise MessageError(
            f"point {index}: not a unit quaternion",
            MessageCause.QUATERNION,
            topic=topics.REFERENCE,
            value=index,
        )
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
        raise FrameError(name, frame, says=" says NED; expected ENU")
    if namespace is not None:
        if frame != MAP:
            raise FrameError(name, frame, f"'{MAP}'")
        base_frame, joint_names = in_namespace(BASE, namespace), list(message.joint_names[:2])
        if joint_names not in ([], [base_frame]):
            names = ", ".join(map(quoted, joint_names))
            raise MessageError(
                f"for {names}",
                MessageCause.AIRCRAFT,
                topic=name,
                value=joint_names,
                allowed=f"'{base_frame}', or no name",
            )
    if len(message.points) > MAX_POINTS:
        # Before they are read, which takes as long as there are many.
        raise MessageError(
            f"holds {len(message.points)} points",
            MessageCause.TOO_LONG,
            topic=name,
            value=len(message.points),
            allowed=f"at most {MAX_POINTS}",
        )
    if not message.points:
        raise MessageError("holds no points", MessageCause.NO_POINTS, topic=name)
    times = [p.time_from_start.sec * NS_PER_S + p.time_from_start.nanosec for p in message.points]
    rows = [_row(point, index) for index, point in enumerate(message.points)]
    stamp = message.header.stamp
    start_ns = stamp.sec * NS_PER_S + stamp.nanosec
    try:
        return Trajectory(start_ns, np.array(times, dtype=np.int64), np.array(rows))
    except TrajectoryError as error:
        finite = np.isfinite(rows).all()
        cause = MessageCause.TRAJECTORY if finite else MessageCause.NOT_FINITE
        raise MessageError(str(error), cause, topic=name) from error


# -------------------------------------------------------------------------------------------------
# A velocity command as a `geometry_msgs/TwistStamped`, as REP-147 has it: `command_velocity`.
# -------------------------------------------------------------------------------------------------


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
    base_frame = in_namespace(BASE, namespace)
    if frame not in (MAP, base_frame):
        raise FrameError(name, frame, f"{_IN_MAP}, '{base_frame}' (forward, left, up, level)")
    v, w = message.twist.linear, message.twist.angular
    linear_mps, turn = np.array([v.x, v.y, v.z], float), np.array([w.x, w.y, w.z], float)
    if not np.isfinite(np.r_[linear_mps, turn]).all():
        raise MessageError(
            f"linear {linear_mps.tolist()}, angular {turn.tolist()}",
            MessageCause.NOT_FINITE,
            topic=name,
            value=[*linear_mps.tolist(), *turn.tolist()],
            allowed=_FINITE,
        )
    if turn[:2].any():
        raise MessageError(
            f"angular {turn.tolist()}",
            MessageCause.AXIS,
            topic=name,
            value=turn.tolist(),
            allowed="x and y are 0",
        )
    vel = np.empty(3)
    if frame == MAP:
        frames.enu_to_ned(linear_mps, vel)
    else:
        frames.flu_to_frd(linear_mps, vel)
        forward, right = vel[0], vel[1]
        sin, cos = math.sin(psi_rad), math.cos(psi_rad)
        vel[0], vel[1] = cos * forward - sin * right, sin * forward + cos * right
    stamp = message.header.stamp
    return VelocityCommand(stamp.sec * NS_PER_S + stamp.nanosec, vel, -float(turn[2]))


# -------------------------------------------------------------------------------------------------
# A goal as a `geometry_msgs/PoseStamped`: position and heading in `map`.
# -------------------------------------------------------------------------------------------------

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
        raise FrameError(name, frame, _IN_MAP)
    p, r = pose.position, pose.orientation
    enu, quaternion = np.array([p.x, p.y, p.z]), np.array([r.x, r.y, r.z, r.w])
    if not np.isfinite(np.r_[enu, quaternion]).all():
        raise MessageError(
            f"position {enu.tolist()}, orientation {quaternion.tolist()}",
            MessageCause.NOT_FINITE,
            topic=name,
            value=[*enu.tolist(), *quaternion.tolist()],
            allowed=_FINITE,
        )
    pos = np.empty(3)
    frames.enu_to_ned(enu, pos)
    phi, theta, psi = attitude_of(name, quaternion)
    tilt_deg = math.degrees(max(abs(phi), abs(theta)))
    if tilt_deg > _LEVEL_DEG:
        raise MessageError(
            f"an orientation tilted by {tilt_deg:.0f} deg",
            MessageCause.NOT_LEVEL,
            topic=name,
            value=tilt_deg,
            allowed=f"level, within {_LEVEL_DEG:g} deg",
        )
    stamp = message.header.stamp
    return GoalPose(stamp.sec * NS_PER_S + stamp.nanosec, pos, psi)


_HIGHEST_M = 100_000.0
"""Above it nothing flies; and the numbers of the conversion stay finite."""


class GoalFix(NamedTuple):
    """Where to go: stamp, ns; position (3,), NED, m, by its latitude, longitude and height."""

    stamp_ns: int
    pos_ned_m: NDArray[np.float64]


def decode_goto_gps(message: Any, origin: frames.Datum) -> GoalFix:
    """The goal of a `NavSatFix` (object of rclpy or of rosbags), about the origin of `map`.

    Latitude and longitude in deg, height above the ellipsoid in m, all WGS-84.

    Raises
    ------
    MessageError
        A number that is not finite, a latitude, longitude or height that is none.
    """
    name = topics.GOTO_GPS
    place = np.array([message.latitude, message.longitude, message.altitude], float)
    if not np.isfinite(place).all():
        problem, cause = f"latitude, longitude, height {place.tolist()}", MessageCause.NOT_FINITE
        raise MessageError(problem, cause, topic=name, value=place.tolist(), allowed=_FINITE)
    if (np.abs(place) > (LATITUDE_DEG, LONGITUDE_DEG, _HIGHEST_M)).any():
        raise MessageError(
            f"latitude {place[0]:g} deg, longitude {place[1]:g} deg, height {place[2]:g} m",
            MessageCause.OUT_OF_RANGE,
            topic=name,
            value=place.tolist(),
            allowed=f"within {LATITUDE_DEG:g} deg, {LONGITUDE_DEG:g} deg and {_HIGHEST_M:g} m",
        )
    pos = np.empty(3)
    frames.geodetic_to_ned(place, origin, pos)
    stamp = message.header.stamp
    return GoalFix(stamp.sec * NS_PER_S + stamp.nanosec, pos)


def encode_origin(origin: frames.Datum) -> Any:
    """The origin of `map` as a `NavSatFix` (imports ROS messages); its stamp is zero: always."""
    message = topics.message_class(topics.KNOWN[topics.ORIGIN].type)()
    message.header.frame_id = MAP
    message.latitude, message.longitude = origin.lat_deg, origin.lon_deg
    message.altitude = origin.alt_m
    return message


def encode_home(pos_ned_m: NDArray[np.float64], stamp_ns: int) -> Any:
    """Where a flight began (3,), NED, m, as a `PointStamped` in `map` (imports ROS messages)."""
    message, enu = topics.message_class(topics.KNOWN[topics.HOME].type)(), np.empty(3)
    message.header.frame_id = MAP
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
    frames.ned_to_enu(pos_ned_m, enu)
    message.point.x, message.point.y, message.point.z = enu.tolist()
    return message


def attitude_of(name: str, xyzw: NDArray[np.float64]) -> tuple[float, float, float]:
    """Roll, pitch, heading, NED, rad, of an ENU/FLU quaternion (4,) on a topic of this name.

    MessageError if it is no unit quaternion.
    """
    length = math.hypot(*xyzw.tolist())
    if abs(length - 1.0) > _UNIT_ERROR:
        raise MessageError(
            f"a quaternion of length {length:.3g}",
            MessageCause.QUATERNION,
            topic=name,
            value=length,
            allowed="1",
        )
    q = np.empty(4)
    frames.quat_enu_flu_to_ned_frd(xyzw, q)
    phi, theta, psi = euler_from_quat(q)
    return float(phi), float(theta), float(psi)


# -------------------------------------------------------------------------------------------------
# A commanded attitude, `command_attitude`, and the climb beside it, `command_climb`.
# -------------------------------------------------------------------------------------------------


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
        raise FrameError(name, frame, _IN_MAP)
    xyzw = np.array([q.x, q.y, q.z, q.w], float)
    if not np.isfinite(xyzw).all():
        raise MessageError(
            f"quaternion {xyzw.tolist()}",
            MessageCause.NOT_FINITE,
            topic=name,
            value=xyzw.tolist(),
            allowed=_FINITE,
        )
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
    base_frame = in_namespace(BASE, namespace)
    if frame not in (MAP, base_frame):
        raise FrameError(name, frame, f"'{MAP}', '{base_frame}' (level)")
    v, w = message.twist.linear, message.twist.angular
    linear, angular = np.array([v.x, v.y, v.z], float), np.array([w.x, w.y, w.z], float)
    value = [*linear.tolist(), *angular.tolist()]
    problem = f"linear {linear.tolist()}, angular {angular.tolist()}"
    if not np.isfinite(value).all():
        cause = MessageCause.NOT_FINITE
        raise MessageError(problem, cause, topic=name, value=value, allowed=_FINITE)
    if linear[:2].any() or angular.any():
        allowed = "linear z alone, the others are 0"
        raise MessageError(problem, MessageCause.AXIS, topic=name, value=value, allowed=allowed)
    stamp = message.header.stamp
    return ClimbCommand(stamp.sec * NS_PER_S + stamp.nanosec, float(linear[2]))


# -------------------------------------------------------------------------------------------------
# A command with an id, `goal`: whoever sends it is answered by that id in /diagnostics.
#
# One type for all: the first two of `joint_names` are the command and the id; points are those of a
# trajectory to follow, one with the pose of a goto, none of a command without an argument.
# -------------------------------------------------------------------------------------------------

_TAKEOFF, _GOTO, _FOLLOW = "takeoff", "goto", "follow"
_PLAIN = ("land", "hold", "velocity", "attitude", "manual")
PLAIN_COMMANDS = (_TAKEOFF, *_PLAIN)
"""Commands that need nothing beside their name."""
_MOST_ID = 64


class GoalCommand(NamedTuple):
    """A command, its id, and what it holds.

    A goto holds a `PoseStamped`, a trajectory to follow a reference message, a take-off its height
    above where it stands, m, if it has one of its own; all others nothing (None).
    """

    command: str
    goal_id: str
    argument: Any


def encode_goal(command: str, goal_id: str, argument: Any = None) -> Any:
    """The message of a command with an id (imports ROS messages).

    Parameters
    ----------
    command : str
        `takeoff`, `goto`, `follow`, `land`, `hold`, `velocity`, `attitude` or `manual`.
    goal_id : str
    argument : PoseStamped, MultiDOFJointTrajectory or float, optional
        Of a goto; of a trajectory to follow; of a take-off its height above where it stands, m.
    """
    from geometry_msgs.msg import Transform
    from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

    message = MultiDOFJointTrajectory()
    message.joint_names = [command, goal_id]
    if argument is None:
        message.header.frame_id = MAP
        return message
    if command == _TAKEOFF:
        up = Transform()
        up.translation.z = float(argument)
        message.header.frame_id = MAP
        message.points = [MultiDOFJointTrajectoryPoint(transforms=[up])]
        return message
    message.header = argument.header
    if command == _FOLLOW:
        message.joint_names = [command, goal_id, *argument.joint_names]
        message.points = argument.points
        return message
    place, p = Transform(), argument.pose.position
    place.translation.x, place.translation.y, place.translation.z = p.x, p.y, p.z
    place.rotation = argument.pose.orientation
    message.points = [MultiDOFJointTrajectoryPoint(transforms=[place])]
    return message


def decode_goal(message: Any) -> GoalCommand:
    """The command of a message, its argument not yet read (imports ROS messages).

    Raises
    ------
    MessageError
        No command and id, not the points that the command needs, or a height that is none.
    """
    from geometry_msgs.msg import PoseStamped
    from trajectory_msgs.msg import MultiDOFJointTrajectory

    name, joint_names = topics.GOAL, list(message.joint_names[:2])
    commands = (_TAKEOFF, _GOTO, _FOLLOW, *_PLAIN)
    if (
        len(joint_names) < 2
        or joint_names[0] not in commands
        or not 0 < len(joint_names[1]) <= _MOST_ID
    ):
        quoted_names = ", ".join(map(quoted, joint_names))
        raise MessageError(
            f"joint_names {quoted_names or 'empty'}",
            MessageCause.COMMAND,
            topic=name,
            value=joint_names,
            allowed=f"a command ({', '.join(commands)}) and an id of 1 to {_MOST_ID} characters",
        )
    command, goal_id = joint_names
    if command == _FOLLOW:
        names = list(message.joint_names[2:])
        return GoalCommand(
            command,
            goal_id,
            MultiDOFJointTrajectory(
                header=message.header, joint_names=names, points=message.points
            ),
        )
    if command in _PLAIN:
        return GoalCommand(command, goal_id, None)
    if command == _TAKEOFF and not message.points:
        return GoalCommand(command, goal_id, None)
    if len(message.points) != 1 or len(message.points[0].transforms) != 1:
        raise MessageError(
            f"{command} without a pose; expected one point with one",
            MessageCause.LENGTH,
            topic=name,
            value=len(message.points),
        )
    place, pose = message.points[0].transforms[0], PoseStamped(header=message.header)
    if command == _TAKEOFF:
        height_m = float(place.translation.z)
        if not math.isfinite(height_m):
            raise MessageError(
                f"{command} to a height of {height_m} m",
                MessageCause.NOT_FINITE,
                topic=name,
                value=height_m,
                allowed=_FINITE,
            )
        return GoalCommand(command, goal_id, height_m)
    p, at = pose.pose.position, place.translation
    p.x, p.y, p.z, pose.pose.orientation = at.x, at.y, at.z, place.rotation
    return GoalCommand(command, goal_id, pose)


# -------------------------------------------------------------------------------------------------
# A joystick's state as a `sensor_msgs/Joy`. Its stamp is of any clock: that of the joystick.
# -------------------------------------------------------------------------------------------------

FRAME = "joy"
"""As ROS's package `joy` names it."""


def encode_joy(axes: Sequence[float], buttons: Sequence[int], stamp_ns: int) -> Any:
    """The message of axes, -1 to 1, and buttons, 0 or 1 (imports ROS messages)."""
    message = topics.message_class(topics.BY_NAME[topics.JOY].type)()
    message.header.frame_id = FRAME
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
    message.axes, message.buttons = list(map(float, axes)), list(map(int, buttons))
    return message


def decode_joy(message: Any) -> tuple[list[float], list[int]]:
    """Axes and buttons of a message (object of rclpy or of rosbags)."""
    return list(map(float, message.axes)), list(map(int, message.buttons))
