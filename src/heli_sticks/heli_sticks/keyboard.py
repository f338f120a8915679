# SPDX-License-Identifier: Apache-2.0
"""A terminal's keys as a joystick, without a window: it tells of presses, not of releases."""

import contextlib
import os
import select
import termios
import tty

from heli_sticks.devices import LEFT_X, LEFT_Y, RIGHT_X, RIGHT_Y, DeviceError, Reading

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
BUTTONS = {"t": 3, "l": 1, "h": 0, "v": 9, "f": 2, "m": 10}
"""Key to button: those of the packaged layout (`joy.button.*` of the outer loop)."""
HELP = (
    "w s: climb, descend; a d: nose left, right; arrows: forward, back, left, right\n"
    "t: take-off, l: land, h: hold, f: attitude, v: velocity, m: manual; space: centre; q: end"
)
_CENTRE, _ENDS = " ", ("q", "\x04")
_NUMBER_OF_BUTTONS = max(BUTTONS.values()) + 1


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
        elif key in BUTTONS:
            self._down.add(BUTTONS[key])

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
