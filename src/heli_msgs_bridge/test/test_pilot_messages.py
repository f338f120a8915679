# SPDX-License-Identifier: Apache-2.0
"""What pilots send: velocity in either frame, a joystick; what cannot be is refused in words."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import QuaternionStamped, TwistStamped
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Joy

from heli_core.rotations import euler_angles, quat_from_euler
from heli_core.ticks import NS_PER_S
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import (
    decode_attitude,
    decode_climb,
    decode_joy,
    decode_velocity,
    encode_joy,
)
from heli_msgs_bridge.layouts import MessageCause, MessageError
from heli_msgs_bridge.messages import Encoder


def twist(linear=(0.0, 0.0, 0.0), angular=(0.0, 0.0, 0.0), frame="map"):
    message = TwistStamped()
    message.header.frame_id, message.header.stamp.sec = frame, 7
    message.header.stamp.nanosec = 5
    v, w = message.twist.linear, message.twist.angular
    v.x, v.y, v.z = linear
    w.x, w.y, w.z = angular
    return message


def test_east_north_up_becomes_north_east_down_and_a_turn_to_the_left_is_negative():
    command = decode_velocity(twist((1.0, 2.0, 3.0), (0.0, 0.0, 0.5)), 1.234)
    assert command.vel_ned_mps.tolist() == [2.0, 1.0, -3.0]
    assert (command.yaw_rate_radps, command.stamp_ns) == (-0.5, 7 * NS_PER_S + 5)


@pytest.mark.parametrize(
    ("psi_deg", "linear", "expected"),
    [
        (0.0, (2.0, 0.0, 0.0), (2.0, 0.0, 0.0)),  # nose north, forward
        (90.0, (2.0, 0.0, 0.0), (0.0, 2.0, 0.0)),  # nose east, forward
        (90.0, (0.0, 1.0, 0.0), (1.0, 0.0, 0.0)),  # nose east, to the left: north
        (180.0, (1.0, 1.0, 0.5), (-1.0, 1.0, -0.5)),
    ],
)
def test_forward_is_where_the_nose_points(psi_deg, linear, expected):
    command = decode_velocity(twist(linear, frame="base_link"), math.radians(psi_deg))
    assert command.vel_ned_mps == pytest.approx(expected, abs=1e-15)


def test_the_heading_frame_is_the_map_turned():
    """Second method: the rotation matrix of the heading on the reversed axes."""
    psi, linear = 0.7, np.array([1.1, -0.4, 0.3])
    turn = np.array([[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]])
    command = decode_velocity(twist(linear.tolist(), frame="heli2/base_link"), psi, "/heli2")
    assert command.vel_ned_mps[:2] == pytest.approx(turn @ [linear[0], -linear[1]], abs=1e-15)
    assert command.vel_ned_mps[2] == -linear[2]


@pytest.mark.parametrize(
    ("message", "cause", "words"),
    [
        (
            twist(frame="odom"),
            MessageCause.FRAME,
            "frame 'odom'; allowed: 'map' (east, north, up), 'base_link' (",
        ),
        (twist(frame=""), MessageCause.FRAME, "frame ''; allowed: 'map'"),
        (twist(frame="heli2/base_link"), MessageCause.FRAME, "frame 'heli2/base_link'; allowed: "),
        (
            twist((math.nan, 0.0, 0.0)),
            MessageCause.NOT_FINITE,
            "linear [nan, 0.0, 0.0], angular [0.0, 0.0, 0.0]; allowed: ",
        ),
        (
            twist(angular=(0.0, 0.0, math.inf)),
            MessageCause.NOT_FINITE,
            "angular [0.0, 0.0, inf]; allowed: finite numbers",
        ),
        (
            twist(angular=(0.0, 0.1, 0.0)),
            MessageCause.AXIS,
            "angular [0.0, 0.1, 0.0]; allowed: x and y are 0",
        ),
    ],
)
def test_another_command_is_refused(message, cause, words):
    with pytest.raises(MessageError) as refused:
        decode_velocity(message, 0.0)
    error = refused.value
    assert (error.topic, error.cause) == ("command_velocity", cause)
    assert str(error).startswith("command_velocity: ") and words in str(error)


def attitude(x=0.0, y=0.0, z=0.0, w=1.0, frame="map"):
    message = QuaternionStamped()
    message.header.frame_id, message.header.stamp.sec = frame, 7
    q = message.quaternion
    q.x, q.y, q.z, q.w = x, y, z, w
    return message


def about(axis, angle_deg):
    """A rotation by hand: x, y, z, w."""
    half = math.radians(angle_deg) / 2.0
    return [*(math.sin(half) * np.array(axis, float)), math.cos(half)]


def then(first, second):
    """The product of two quaternions x, y, z, w: the second about the axes that the first made."""
    (x1, y1, z1, w1), (x2, y2, z2, w2) = first, second
    return [
        w1 * x2 + x1 * w2 + y1 * z2 - z1 * y2,
        w1 * y2 - x1 * z2 + y1 * w2 + z1 * x2,
        w1 * z2 + x1 * y2 - y1 * x2 + z1 * w2,
        w1 * w2 - x1 * x2 - y1 * y2 - z1 * z2,
    ]


FORWARD, LEFT, UP = (1, 0, 0), (0, 1, 0), (0, 0, 1)


@pytest.mark.parametrize(
    ("xyzw", "expected_deg"),
    [
        (about(UP, 0.0), (0.0, 0.0, 90.0)),  # nose east
        (about(UP, 90.0), (0.0, 0.0, 0.0)),  # nose north
        (about(UP, 180.0), (0.0, 0.0, -90.0)),  # nose west
        (about(UP, -90.0), (0.0, 0.0, 180.0)),  # nose south
        (then(about(UP, 90.0), about(FORWARD, 10.0)), (10.0, 0.0, 0.0)),  # right side down
        (then(about(UP, 90.0), about(LEFT, 10.0)), (0.0, -10.0, 0.0)),  # nose down
        (then(about(UP, 45.0), about(LEFT, -15.0)), (0.0, 15.0, 45.0)),  # nose up, to northeast
        ([-c for c in about(UP, 90.0)], (0.0, 0.0, 0.0)),  # the same rotation
    ],
)
def test_an_attitude_by_its_cardinal_cases(xyzw, expected_deg):
    command = decode_attitude(attitude(*xyzw))
    off = np.degrees(command.attitude_rad) - expected_deg
    assert (off + 180.0) % 360.0 - 180.0 == pytest.approx(np.zeros(3), abs=1e-9)
    assert command.stamp_ns == 7 * NS_PER_S


def test_an_attitude_is_read_as_attitude_setpoint_is_written():
    """Second method: the bytes of the law's own setpoint, which mean the same."""
    attitude_rad = np.radians([12.0, -7.0, -163.0])
    encoded = deserialize_message(
        Encoder(topics.ATTITUDE_SETPOINT).encode(attitude_rad, 7 * NS_PER_S), QuaternionStamped
    )
    assert decode_attitude(encoded).attitude_rad == pytest.approx(attitude_rad, abs=1e-14)
    again = euler_angles(quat_from_euler(*attitude_rad)[None])[0]
    assert again == pytest.approx(attitude_rad, abs=1e-14)


@pytest.mark.parametrize(
    ("message", "cause", "words"),
    [
        (
            attitude(frame="base_link"),
            MessageCause.FRAME,
            "frame 'base_link'; allowed: 'map' (east, north, up)",
        ),
        (attitude(frame=""), MessageCause.FRAME, "frame ''; allowed: 'map'"),
        (attitude(frame="map_ned"), MessageCause.FRAME, "frame 'map_ned'; allowed: 'map'"),
        (
            attitude(x=math.nan),
            MessageCause.NOT_FINITE,
            "quaternion [nan, 0.0, 0.0, 1.0]; allowed: finite numbers",
        ),
        (attitude(w=0.0), MessageCause.QUATERNION, "a quaternion of length 0; allowed: 1"),
        (attitude(z=0.1), MessageCause.QUATERNION, "a quaternion of length 1; allowed: 1"),
        (attitude(w=1.1), MessageCause.QUATERNION, "a quaternion of length 1.1; allowed: 1"),
    ],
)
def test_another_attitude_is_refused(message, cause, words):
    with pytest.raises(MessageError) as refused:
        decode_attitude(message)
    error = refused.value
    assert (error.topic, error.cause) == ("command_attitude", cause)
    assert str(error).startswith("command_attitude: ") and words in str(error)


def test_a_climb_is_up_in_either_frame():
    for frame, namespace in (("map", ""), ("base_link", ""), ("heli2/base_link", "/heli2")):
        command = decode_climb(twist((0.0, 0.0, -0.7), frame=frame), namespace)
        assert command == (7 * NS_PER_S + 5, -0.7)


@pytest.mark.parametrize(
    ("message", "cause", "words"),
    [
        (
            twist(frame="odom"),
            MessageCause.FRAME,
            "frame 'odom'; allowed: 'map', 'base_link' (level)",
        ),
        (
            twist((0.0, 0.0, math.inf)),
            MessageCause.NOT_FINITE,
            "linear [0.0, 0.0, inf], angular [0.0, 0.0, 0.0]; allowed: finite numbers",
        ),
        (
            twist((0.1, 0.0, 1.0)),
            MessageCause.AXIS,
            "linear [0.1, 0.0, 1.0], angular [0.0, 0.0, 0.0]; allowed: linear "
            "z alone, the others are 0",
        ),
        (twist((0.0, 0.1, 0.0)), MessageCause.AXIS, "allowed: linear z alone"),
        (
            twist(angular=(0.0, 0.0, 0.1)),
            MessageCause.AXIS,
            "angular [0.0, 0.0, 0.1]; allowed: linear z alone",
        ),
    ],
)
def test_another_climb_is_refused(message, cause, words):
    with pytest.raises(MessageError) as refused:
        decode_climb(message)
    error = refused.value
    assert (error.topic, error.cause) == ("command_climb", cause)
    assert str(error).startswith("command_climb: ") and words in str(error)


def test_a_joystick_goes_there_and_back():
    message = encode_joy((0.5, -1.0), (0, 1, 0), 3 * NS_PER_S + 4)
    assert isinstance(message, Joy)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (3, 4)
    assert decode_joy(message) == ([0.5, -1.0], [0, 1, 0])
