# SPDX-License-Identifier: Apache-2.0
"""Which axis is which stick, which button which command (`sensor_msgs/Joy`'s arrays, no ROS)."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from heli_sticks.curve import expo, without_dead_zone
from heli_sticks.errors import Cause, StickError

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
        See `heli_sticks.curve`.
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
                    Cause.TAKEN_TWICE, f"{names} share {what} {number}; allowed: one {what} each"
                )

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any], prefix: str = "joy") -> "StickMap":
        """From the parameters of a node whose names begin so."""
        keys = ("axis", "reversed", "dead_zone", "expo")
        roll, pitch, yaw, climb = (
            Stick(*(values[f"{prefix}.{name}.{key}"] for key in keys)) for name in STICKS
        )
        numbers = {name: int(values[f"{prefix}.button.{name}"]) for name in BUTTONS}
        given = {name: number for name, number in numbers.items() if number != NO_BUTTON}
        return cls((roll, pitch, yaw, climb), given)

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
                Cause.TOO_FEW_AXES,
                f"{name} is on axis {stick.axis}, the joystick has {len(axes)} axes; allowed: "
                f"at least {stick.axis + 1}",
            )
        deflection = float(axes[stick.axis])
        if not math.isfinite(deflection):
            raise StickError(
                Cause.NOT_FINITE,
                f"axis {stick.axis} ({name}) is {deflection}; allowed: a number from -1 to 1",
            )
        if abs(deflection) > 1.0 + _ROUNDING:
            raise StickError(
                Cause.OUT_OF_RANGE,
                f"axis {stick.axis} ({name}) is {deflection:g}; allowed: -1 to 1",
            )
        return stick.value(deflection)


def _times(item: tuple[int, int]) -> int:
    return item[1]


def _is_down(name: str, number: int, buttons: Sequence[int]) -> bool:
    if number >= len(buttons):
        raise StickError(
            Cause.TOO_FEW_BUTTONS,
            f"{name} is on button {number}, the joystick has {len(buttons)} buttons; allowed: "
            f"at least {number + 1}, or {NO_BUTTON} for no button",
        )
    if buttons[number] not in (0, 1):
        raise StickError(
            Cause.OUT_OF_RANGE,
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
                Cause.SEVERAL_BUTTONS,
                f"the buttons of {' and '.join(new)} were pressed at once; allowed: one at a time",
            )
        return new[0] if new else None
