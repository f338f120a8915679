# SPDX-License-Identifier: Apache-2.0
"""Which axis is which stick, which button which command (`sensor_msgs/Joy`'s arrays, no ROS)."""

import contextlib
import math
import os
import select
import termios
import tty
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

from heli_core.errors import StickCause, StickError

# -------------------------------------------------------------------------------------------------
# From the deflection of a stick to what it asks for: dead zone, expo.
#
# Both as in PX4 (`math::deadzone`, `math::expo` in src/lib/mathlib/math/Functions.hpp), whose
# users
# know what the numbers do.
# -------------------------------------------------------------------------------------------------


def without_dead_zone(x: float, dead_zone: float) -> float:
    """Deflection beyond the dead zone, stretched so that full deflection stays full.

    Parameters
    ----------
    x : float
        Deflection, -1 to 1.
    dead_zone : float
        Deflection below which it is none, 0 to less than 1.

    Returns
    -------
    float
        (x - sign(x) d) / (1 - d), 0 for ``|x| <= d``: continuous, no step at the edge.
    """
    if abs(x) <= dead_zone:
        return 0.0
    return (x - math.copysign(dead_zone, x)) / (1.0 - dead_zone)


def expo(x: float, e: float) -> float:
    """Softer about the centre: (1 - e) x + e x^3.

    Parameters
    ----------
    x : float
        Deflection, -1 to 1.
    e : float
        0 (a straight line) to 1 (x^3). The slope is 1 - e in the centre, 1 + 2 e at the stops.
    """
    return (1.0 - e) * x + e * x * x * x


# -------------------------------------------------------------------------------------------------
# Mapping.
# -------------------------------------------------------------------------------------------------

STICKS = ("roll", "pitch", "yaw", "climb")
"""In the order of `Sticks`."""
BUTTONS = ("takeoff", "land", "hold", "velocity", "attitude", "manual")
"""Commands that a button may have: those without an argument."""
NO_BUTTON = -1
MOST_AXES, MOST_BUTTONS = 32, 64
_ROUNDING = 1e-3
"""Beyond 1 by so much an axis is at its stop: drivers scale in single precision."""


class Sticks(NamedTuple):
    """What a pilot asks for, -1 to 1 each.

    Attributes
    ----------
    roll : float
        Right is positive.
    pitch : float
        Nose up is positive: the stick back.
    yaw : float
        Nose right is positive.
    climb : float
        Up is positive; the collective in `manual`.
    """

    roll: float
    pitch: float
    yaw: float
    climb: float


@dataclass(frozen=True)
class Stick:
    """Where a stick is read, and how.

    Attributes
    ----------
    axis : int
        Number of the axis, from 0.
    reversed : bool
        True where the axis' positive end is the stick's negative one.
    dead_zone, expo : float
        See `heli_outer_pd.joystick`.
    """

    axis: int
    reversed: bool
    dead_zone: float
    expo: float

    def value(self, deflection: float) -> float:
        """What the stick asks for at a deflection of its axis, -1 to 1."""
        x = min(max(deflection, -1.0), 1.0)
        return expo(without_dead_zone(-x if self.reversed else x, self.dead_zone), self.expo)


@dataclass(frozen=True)
class StickMap:
    """The layout of a joystick.

    Attributes
    ----------
    sticks : tuple of Stick
        Roll, pitch, yaw, climb.
    buttons : mapping of str to int
        Command to number of its button, from 0; commands without a button are left out.

    Raises
    ------
    StickError
        Two sticks on one axis, two commands on one button.
    """

    sticks: tuple[Stick, Stick, Stick, Stick]
    buttons: Mapping[str, int]

    def __post_init__(self) -> None:
        axes = {name: stick.axis for name, stick in zip(STICKS, self.sticks, strict=True)}
        for what, taken in (("axis", axes), ("button", self.buttons)):
            number, times = max(Counter(taken.values()).items(), key=_times, default=(0, 0))
            if times > 1:
                names = " and ".join(name for name, n in taken.items() if n == number)
                raise StickError(
                    StickCause.TAKEN_TWICE,
                    f"{names} share {what} {number}; allowed: one {what} each",
                )

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], prefix: str = "joy") -> "StickMap":
        """From the parameters of a node whose names begin so."""
        keys = ("axis", "reversed", "dead_zone", "expo")
        roll, pitch, yaw, climb = (
            Stick(*(values[f"{prefix}.{name}.{key}"] for key in keys)) for name in STICKS
        )
        numbers = {name: int(values[f"{prefix}.button.{name}"]) for name in BUTTONS}
        buttons = {name: number for name, number in numbers.items() if number != NO_BUTTON}
        return cls((roll, pitch, yaw, climb), buttons)

    def read(self, axes: Sequence[float], buttons: Sequence[int]) -> tuple[Sticks, frozenset[str]]:
        """What the sticks ask for, and the commands whose buttons are down.

        Parameters
        ----------
        axes : sequence of float
            -1 to 1; left and forward positive, as ROS has it.
        buttons : sequence of int
            1 is down, 0 is not.

        Raises
        ------
        StickError
            With the axis or button, its number and what is allowed.
        """
        values = (self._value(name, i, axes) for i, name in enumerate(STICKS))
        return Sticks(*values), frozenset(
            name for name, number in self.buttons.items() if _is_down(name, number, buttons)
        )

    def _value(self, name: str, index: int, axes: Sequence[float]) -> float:
        stick = self.sticks[index]
        if stick.axis >= len(axes):
            raise StickError(
                StickCause.TOO_FEW_AXES,
                f"{name} is on axis {stick.axis}, the joystick has {len(axes)} axes; allowed: "
                f"at least {stick.axis + 1}",
            )
        deflection = float(axes[stick.axis])
        if not math.isfinite(deflection):
            raise StickError(
                StickCause.NOT_FINITE,
                f"axis {stick.axis} ({name}) is {deflection}; allowed: a number from -1 to 1",
            )
        if abs(deflection) > 1.0 + _ROUNDING:
            raise StickError(
                StickCause.OUT_OF_RANGE,
                f"axis {stick.axis} ({name}) is {deflection:g}; allowed: -1 to 1",
            )
        return stick.value(deflection)


def _times(item: tuple[int, int]) -> int:
    return item[1]


def _is_down(name: str, number: int, buttons: Sequence[int]) -> bool:
    if number >= len(buttons):
        raise StickError(
            StickCause.TOO_FEW_BUTTONS,
            f"{name} is on button {number}, the joystick has {len(buttons)} buttons; allowed: "
            f"at least {number + 1}, or {NO_BUTTON} for no button",
        )
    if buttons[number] not in (0, 1):
        raise StickError(
            StickCause.OUT_OF_RANGE,
            f"button {number} ({name}) is {buttons[number]}; allowed: 0 or 1",
        )
    return bool(buttons[number])


class Presses:
    """Tells a button that goes down from one that stays down.

    A button that is down at first is none that was pressed: whoever begins to listen does not
    obey what was meant for another time.
    """

    def __init__(self) -> None:
        self._down: frozenset[str] | None = None

    def forget(self) -> None:
        """Somebody else's buttons come next."""
        self._down = None

    def pressed(self, down: frozenset[str]) -> str | None:
        """The command whose button has just been pressed; None for none.

        Parameters
        ----------
        down : frozenset of str
            Commands whose buttons are down now.

        Raises
        ------
        StickError
            Several at once: which of them was meant is not known.
        """
        before, self._down = self._down, down
        new = sorted(down - before) if before is not None else []
        if len(new) > 1:
            raise StickError(
                StickCause.SEVERAL_BUTTONS,
                f"the buttons of {' and '.join(new)} were pressed at once; allowed: one at a time",
            )
        return new[0] if new else None


# -------------------------------------------------------------------------------------------------
# What a joystick and a keyboard have in common, as `sensor_msgs/Joy` wants it. No ROS.
# -------------------------------------------------------------------------------------------------

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


# -------------------------------------------------------------------------------------------------
# A terminal's keys as a joystick, without a window: it tells of presses, not of releases.
# -------------------------------------------------------------------------------------------------

STEP = 0.25
"""Of full deflection, for each press."""
CENTRE_S = 0.7
"""So long after its last press a stick is in the centre: longer than a terminal waits before it
repeats a key that is held (X: 0.66 s)."""
AXES = {
    "w": (LEFT_Y, 1), "s": (LEFT_Y, -1), "a": (LEFT_X, 1), "d": (LEFT_X, -1),
    "\x1b[A": (RIGHT_Y, 1), "\x1b[B": (RIGHT_Y, -1),
    "\x1b[D": (RIGHT_X, 1), "\x1b[C": (RIGHT_X, -1),
}  # fmt: skip
"""Key to axis and direction, left and forward positive: as a gamepad in mode 2 has them."""
KEY_BUTTONS = {"t": 3, "l": 1, "h": 0, "v": 9, "f": 2, "m": 10}
"""Key to button: those of the packaged layout (`joy.button.*` of the outer loop)."""
HELP = (
    "w s: climb, descend; a d: nose left, right; arrows: forward, back, left, right\n"
    "t: take-off, l: land, h: hold, f: attitude, v: velocity, m: manual; space: centre; q: end"
)
_CENTRE, _ENDS = " ", ("q", "\x04")
_NUMBER_OF_BUTTONS = max(KEY_BUTTONS.values()) + 1


class KeyboardSticks:
    """What presses of keys make of four axes and a few buttons.

    A press moves a stick by `STEP`; one that points the other way takes it to the centre first.
    Without another press it is in the centre again after `CENTRE_S`.
    """

    def __init__(self) -> None:
        self._axes = [0.0] * (max(RIGHT_X, RIGHT_Y) + 1)
        self._moved_s = [0.0] * len(self._axes)
        self._down: set[int] = set()

    def press(self, key: str, now_s: float) -> None:
        """Take a key; one that means nothing is passed over."""
        if key == _CENTRE:
            self._axes = [0.0] * len(self._axes)
        elif key in AXES:
            axis, way = AXES[key]
            self._centre(now_s)
            at = self._axes[axis]
            self._axes[axis] = 0.0 if at * way < 0.0 else min(max(at + way * STEP, -1.0), 1.0)
            self._moved_s[axis] = now_s
        elif key in KEY_BUTTONS:
            self._down.add(KEY_BUTTONS[key])

    def _centre(self, now_s: float) -> None:
        for axis, moved_s in enumerate(self._moved_s):
            if now_s - moved_s > CENTRE_S:
                self._axes[axis] = 0.0

    def read(self, now_s: float) -> Reading:
        """Where everything is; a button that was pressed is down this once."""
        self._centre(now_s)
        down, self._down = self._down, set()
        return Reading(tuple(self._axes), tuple(int(i in down) for i in range(_NUMBER_OF_BUTTONS)))


class TerminalKeys:
    """The keys of a terminal, without Enter and without an echo.

    Parameters
    ----------
    fd : int
        File descriptor of the terminal; `close` makes it as it was.

    Raises
    ------
    DeviceError
        It is none.
    """

    name = "keyboard"

    def __init__(self, fd: int) -> None:
        if not os.isatty(fd):
            raise DeviceError(
                "no keyboard: standard input is no terminal; allowed: a terminal, or a joystick"
            )
        self._fd, self._before = fd, termios.tcgetattr(fd)
        self._sticks, self._half = KeyboardSticks(), ""
        tty.setcbreak(fd)

    def read(self, now_s: float) -> Reading | None:
        """Take the keys that have been pressed; None: the pilot has ended, or the terminal has."""
        while select.select([self._fd], [], [], 0.0)[0]:
            typed = self._typed()
            keys, self._half = split_keys(self._half + typed)
            if not typed or any(key in _ENDS for key in keys):
                return None
            for key in keys:
                self._sticks.press(key, now_s)
        return self._sticks.read(now_s)

    def _typed(self) -> str:
        """What has been typed; empty if the terminal has gone."""
        try:
            return os.read(self._fd, 1024).decode("utf-8", "replace")
        except OSError:
            return ""

    def close(self) -> None:
        """Make the terminal as it was."""
        with contextlib.suppress(termios.error):
            termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)


def split_keys(typed: str) -> tuple[list[str], str]:
    """Keys of what a terminal has sent, and the beginning of one that is not complete.

    An arrow is three characters: ESC [ A, or ESC O A in the keypad's application mode.
    """
    keys, half = [], ""
    for character in typed:
        half += character
        if half not in ("\x1b", "\x1b[", "\x1bO"):
            keys.append(half.replace("\x1bO", "\x1b["))
            half = ""
    return keys, half


# -------------------------------------------------------------------------------------------------
# A joystick, a gamepad or a transmitter at the USB, through SDL (pygame). No window is opened.
# -------------------------------------------------------------------------------------------------

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
