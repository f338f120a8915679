# SPDX-License-Identifier: Apache-2.0
"""A joystick's state as a `sensor_msgs/Joy`. Its stamp is of any clock: that of the joystick."""

from collections.abc import Sequence
from typing import Any

from heli_math.ticks import NS_PER_S
from heli_msgs_bridge import topics

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
