# SPDX-License-Identifier: Apache-2.0
"""What pilots send: velocity in either frame, a joystick; what cannot be is refused in words."""

import math

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from sensor_msgs.msg import Joy

from heli_math.ticks import NS_PER_S
from heli_msgs_bridge.joy_message import decode_joy, encode_joy
from heli_msgs_bridge.messages import MessageError
from heli_msgs_bridge.velocity_message import decode_velocity


def twist(linear=(0.0, 0.0, 0.0), angular=(0.0, 0.0, 0.0), frame="map"):
    message = TwistStamped()
    message.header.frame_id, message.header.stamp.sec = frame, 7
    message.header.stamp.nanosec = 5
    v, w = message.twist.linear, message.twist.angular
    v.x, v.y, v.z = linear
    w.x, w.y, w.z = angular
    return message


def test_east_north_up_becomes_north_east_down_and_a_turn_to_the_left_is_negative():
    found = decode_velocity(twist((1.0, 2.0, 3.0), (0.0, 0.0, 0.5)), 1.234)
    assert found.vel_ned_mps.tolist() == [2.0, 1.0, -3.0]
    assert (found.yaw_rate_radps, found.stamp_ns) == (-0.5, 7 * NS_PER_S + 5)


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
    found = decode_velocity(twist(linear, frame="base_link"), math.radians(psi_deg))
    assert found.vel_ned_mps == pytest.approx(expected, abs=1e-15)


def test_the_heading_frame_is_the_map_turned():
    """Second method: the rotation matrix of the heading on the reversed axes."""
    psi, given = 0.7, np.array([1.1, -0.4, 0.3])
    turn = np.array([[np.cos(psi), -np.sin(psi)], [np.sin(psi), np.cos(psi)]])
    found = decode_velocity(twist(given.tolist(), frame="heli2/base_link"), psi, "/heli2")
    assert found.vel_ned_mps[:2] == pytest.approx(turn @ [given[0], -given[1]], abs=1e-15)
    assert found.vel_ned_mps[2] == -given[2]


@pytest.mark.parametrize(
    ("message", "said"),
    [
        (twist(frame="odom"), "frame 'odom'; allowed: 'map' (east, north, up), 'base_link' ("),
        (twist(frame=""), "frame ''; allowed: 'map'"),
        (twist(frame="heli2/base_link"), "frame 'heli2/base_link'; allowed: "),
        (twist((math.nan, 0.0, 0.0)), "linear [nan, 0.0, 0.0], angular [0.0, 0.0, 0.0]; allowed: "),
        (twist(angular=(0.0, 0.0, math.inf)), "angular [0.0, 0.0, inf]; allowed: finite numbers"),
        (twist(angular=(0.0, 0.1, 0.0)), "angular [0.0, 0.1, 0.0]; allowed: x and y are 0"),
    ],
)
def test_another_command_is_refused(message, said):
    with pytest.raises(MessageError) as refused:
        decode_velocity(message, 0.0)
    assert str(refused.value).startswith("command_velocity: ")
    assert said in str(refused.value)


def test_a_joystick_goes_there_and_back():
    message = encode_joy((0.5, -1.0), (0, 1, 0), 3 * NS_PER_S + 4)
    assert isinstance(message, Joy)
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (3, 4)
    assert decode_joy(message) == ([0.5, -1.0], [0, 1, 0])
