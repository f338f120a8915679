# SPDX-License-Identifier: Apache-2.0
"""A joystick, a gamepad or a transmitter at the USB, through SDL (pygame). No window is opened."""

import contextlib
import os
from collections.abc import Callable
from typing import Any

from heli_sticks.devices import DeviceError, Reading

_RAW = 32767.0
"""SDL's largest deflection of a game controller's axis, as an integer."""
_QUIET = {
    "PYGAME_HIDE_SUPPORT_PROMPT": "1",
    # Nothing is drawn, and no window has the focus that SDL would wait for.
    "SDL_VIDEODRIVER": "dummy",
    "SDL_JOYSTICK_ALLOW_BACKGROUND_EVENTS": "1",
}


def _sdl() -> Any:
    """pygame with its joysticks begun."""
    for name, value in _QUIET.items():
        os.environ.setdefault(name, value)
    try:
        import pygame
        import pygame._sdl2.controller
    except ImportError as error:
        raise DeviceError(
            f"no joystick can be read: pygame is missing ({error}); install python3-pygame (apt) "
            "or pygame-ce (pip)"
        ) from None
    pygame.display.init()
    pygame.joystick.init()
    pygame._sdl2.controller.init()
    pygame.event.pump()
    return pygame


def joystick_names() -> list[str]:
    """Names of what is plugged in; its place is the number to open it by."""
    pygame = _sdl()
    return [pygame.joystick.Joystick(i).get_name() for i in range(pygame.joystick.get_count())]


class SdlJoystick:
    """One joystick.

    What SDL knows as a game controller comes in SDL's layout, the same for all of them: axes left
    x, left y, right x, right y, triggers; buttons A, B, X, Y ... (as `game_controller_node` of
    ROS's package `joy`). Anything else comes in its own (as `joy_node`).

    Parameters
    ----------
    number : int, optional
        Which one, from 0.

    Raises
    ------
    DeviceError
        There is none of this number; names those that there are.
    """

    def __init__(self, number: int = 0) -> None:
        self._pygame = pygame = _sdl()
        names = joystick_names()
        if not 0 <= number < len(names):
            there = ", ".join(f"{i} ({name})" for i, name in enumerate(names))
            raise DeviceError(
                f"no joystick {number}; allowed: {there}"
                if names
                else "no joystick found: plug one in, look whether you may read "
                "/dev/input/event*, or use --keyboard"
            )
        self._stick = pygame.joystick.Joystick(number)
        self.name, self._gone = names[number], False
        self._read: Callable[[], Reading] = self._raw
        if pygame._sdl2.controller.is_controller(number):
            self._pad = pygame._sdl2.controller.Controller.from_joystick(self._stick)
            self._read = self._as_controller

    @property
    def layout(self) -> str:
        """Whose order axes and buttons have: `game controller`, or its `own`."""
        return "own" if self._read == self._raw else "game controller"

    def read(self, now_s: float) -> Reading:
        """Where everything is now.

        Raises
        ------
        DeviceError
            It has been unplugged.
        """
        for event in self._pygame.event.get(self._pygame.JOYDEVICEREMOVED):
            self._gone |= event.instance_id == self._stick.get_instance_id()
        self._pygame.event.clear()
        if self._gone:
            raise DeviceError(f"the joystick {self.name!r} has been unplugged")
        return self._read()

    def _raw(self) -> Reading:
        stick = self._stick
        return Reading(
            tuple(_of_ros(stick.get_axis(i)) for i in range(stick.get_numaxes())),
            tuple(int(stick.get_button(i)) for i in range(stick.get_numbuttons())),
        )

    def _as_controller(self) -> Reading:
        pygame, pad = self._pygame, self._pad
        axes = range(pygame.CONTROLLER_AXIS_MAX)
        buttons = range(pygame.CONTROLLER_BUTTON_MAX)
        return Reading(
            tuple(_of_ros(pad.get_axis(i) / _RAW) for i in axes),
            tuple(int(pad.get_button(i)) for i in buttons),
        )

    def close(self) -> None:
        """Give it back."""
        with contextlib.suppress(self._pygame.error):
            self._pygame.joystick.quit()
            self._pygame.display.quit()


def _of_ros(axis: float) -> float:
    """Left and forward positive; SDL's negative end is a 32768th longer than the other."""
    return -min(max(axis, -1.0), 1.0) + 0.0
