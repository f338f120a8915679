# SPDX-License-Identifier: Apache-2.0
"""What a joystick and a keyboard have in common, as `sensor_msgs/Joy` wants it. No ROS."""

from typing import NamedTuple, Protocol

LEFT_X, LEFT_Y, RIGHT_X, RIGHT_Y = 0, 1, 2, 3
"""Axes of a game controller, as SDL numbers them."""


class DeviceError(OSError):
    """There is no device, or it has gone; the message is one line for the user."""


class Reading(NamedTuple):
    """Where everything is now.

    Attributes
    ----------
    axes : tuple of float
        -1 to 1; left and forward are positive, as `joy` of ROS has it (SDL: right and back).
    buttons : tuple of int
        1 is down, 0 is not.
    """

    axes: tuple[float, ...]
    buttons: tuple[int, ...]


class Device(Protocol):
    """Something with axes and buttons."""

    @property
    def name(self) -> str:
        """What people call it, in a few words."""

    def read(self, now_s: float) -> Reading | None:
        """Where everything is at a time of the steady clock; None: the pilot has ended.

        Raises
        ------
        DeviceError
            It has gone.
        """

    def close(self) -> None:
        """Give it back."""
