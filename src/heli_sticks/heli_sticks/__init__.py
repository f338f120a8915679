# SPDX-License-Identifier: Apache-2.0
"""A pilot's sticks: from joystick or keyboard to four numbers and commands by name. No ROS."""

from heli_math.faces import face

__getattr__, __dir__, __all__ = face(
    __name__,
    {
        "curve": ["expo", "without_dead_zone"],
        "devices": ["Device", "DeviceError", "Reading"],
        "errors": ["Cause", "StickError"],
        "keyboard": ["KeyboardSticks", "TerminalKeys"],
        "mapping": ["Presses", "StickMap", "Sticks"],
        "sdl_joystick": ["SdlJoystick"],
    },
)
