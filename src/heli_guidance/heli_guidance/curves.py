# SPDX-License-Identifier: Apache-2.0
"""Level curves by their arc length."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.special import ellipj, ellipk

from heli_guidance.errors import Cause, PathError

Array = NDArray[np.float64]

_STEP_M = 0.01  # of a table over a curve's length
_LEAST_TURNS = 2


class Curve(Protocol):
    """A curve in a horizontal plane; the closed ones can be flown several times."""

    @property
    def lap_m(self) -> float:
        """Its length, m."""
        ...

    @property
    def curvature_1pm(self) -> float:
        """Its largest curvature, 1/m."""
        ...

    @property
    def centre_ned_m(self) -> Array:
        """What it goes around (3,), NED, m."""
        ...

    def at(self, along_m: float) -> tuple[Array, float]:
        """Position (3,), NED, m, and course (rad, 0 is north) at an arc length from its start."""
        ...


def _checked(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise PathError(Cause.BAD_SIZE, f"{name} is {value:g} m; allowed: a positive number")


@dataclass(frozen=True)
class Circle:
    """A circle.

    Attributes
    ----------
    start_ned_m : (3,) array
        A point on it.
    course_rad : float
        Course there, 0 is north.
    radius_m : float
    clockwise : bool
        Seen from above: turning to the right.
    """

    start_ned_m: Array
    course_rad: float
    radius_m: float
    clockwise: bool = True

    def __post_init__(self) -> None:
        _checked("radius", self.radius_m)

    @property
    def lap_m(self) -> float:
        """Its length, m."""
        return 2.0 * math.pi * self.radius_m

    @property
    def curvature_1pm(self) -> float:
        """Its curvature, 1/m."""
        return 1.0 / self.radius_m

    @property
    def _turn(self) -> float:
        return 1.0 if self.clockwise else -1.0

    @property
    def centre_ned_m(self) -> Array:
        """Its centre (3,), NED, m."""
        to_centre = self.course_rad + self._turn * math.pi / 2.0
        away = np.array([math.cos(to_centre), math.sin(to_centre), 0.0])
        return np.asarray(self.start_ned_m, float) + self.radius_m * away

    def at(self, along_m: float) -> tuple[Array, float]:
        """Position (3,), NED, m, and course (rad, 0 is north) at an arc length from its start."""
        course = self.course_rad + self._turn * along_m / self.radius_m
        outwards = course - self._turn * math.pi / 2.0
        away = np.array([math.cos(outwards), math.sin(outwards), 0.0])
        return self.centre_ned_m + self.radius_m * away, course


@dataclass(frozen=True)
class Lemniscate:
    """A figure eight: Bernoulli's lemniscate, begun at its crossing, where it is straight.

    With half its length a, r^2 = a^2 cos 2 theta, its arc length is an elliptic integral and
    r = a sl(s / a) with Gauss's lemniscate sine sl(u) = sd(sqrt(2) u | 1/2) / sqrt(2) (DLMF 22.12,
    22.18.1): position at an arc length is exact. The curvature 3 r / a^2 is largest at the tips.

    Attributes
    ----------
    centre_ned_m : (3,) array
        The crossing.
    axis_rad : float
        Direction from tip to tip, 0 is north.
    length_m : float
        From tip to tip.
    """

    centre_ned_m: Array
    axis_rad: float
    length_m: float

    def __post_init__(self) -> None:
        _checked("length", self.length_m)

    @property
    def _half_m(self) -> float:
        return 0.5 * self.length_m

    @property
    def lap_m(self) -> float:
        """Its length, m: four quarters of K(1/2) / sqrt(2) each."""
        return float(4.0 * self._half_m * ellipk(0.5) / math.sqrt(2.0))

    @property
    def curvature_1pm(self) -> float:
        """Its curvature at the tips, 1/m."""
        return 3.0 / self._half_m

    def at(self, along_m: float) -> tuple[Array, float]:
        """Position (3,), NED, m, and course (rad, 0 is north) at an arc length from its start."""
        u = along_m / self._half_m
        sn, cn, dn, _ = ellipj(math.sqrt(2.0) * u, 0.5)
        # r / a, negative on the half behind, and its derivative: 1, then -1 at crossings.
        r, slope = sn / (math.sqrt(2.0) * dn), cn / dn**2
        ahead = r * math.sqrt(0.5 * (1.0 + r * r))
        aside = r * slope / math.sqrt(2.0 * (1.0 + r * r))
        theta = math.atan2(slope, 1.0 + r * r)
        # The tangent stands at 2 theta + 90 degrees to the radius; theta falls on the way out.
        course = self.axis_rad + 3.0 * theta - math.pi / 2.0
        c, s = math.cos(self.axis_rad), math.sin(self.axis_rad)
        a = self._half_m
        level = a * np.array([c * ahead - s * aside, s * ahead + c * aside, 0.0])
        return np.asarray(self.centre_ned_m, float) + level, course


def _rise(share: Array) -> Array:
    """From 0, straight, to 1 with the slope and curvature of a cosine, over half its wave.

    The quintic of these six conditions.
    """
    level = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    return level - 0.5 * math.pi**2 * share**3 * (1.0 - share) ** 2


@dataclass(frozen=True)
class Slalom:
    """Turns to alternate sides of a line, straight before and after them.

    A sine from the first turn to the last, joined to the line by polynomials as long as half its
    wave, so that curvature is continuous. Its arc length is summed up over `_STEP_M`.

    Attributes
    ----------
    start_ned_m : (3,) array
        On the line.
    course_rad : float
        Of the line, 0 is north; the first turn is to its right.
    interval_m : float
        From turn to turn, along the line.
    aside_m : float
        Of the turns from the line.
    turns : int
        At least 2.
    run_m : float
        Straight, before the first turn and after the last.
    """

    start_ned_m: Array
    course_rad: float
    interval_m: float
    aside_m: float
    turns: int
    run_m: float

    def __post_init__(self) -> None:
        for name in ("interval", "aside", "run"):
            _checked(name, getattr(self, f"{name}_m"))
        if self.turns < _LEAST_TURNS:
            raise PathError(
                Cause.BAD_SIZE, f"turns are {self.turns}; allowed: at least {_LEAST_TURNS}"
            )

    @cached_property
    def _table(self) -> tuple[Array, Array, Array, Array]:
        """Along the line, aside of it, arc length and direction off it, at close points."""
        whole = (self.turns + 1) * self.interval_m + 2.0 * self.run_m
        x = np.linspace(0.0, whole, math.ceil(whole / _STEP_M) + 1)
        u = (x - self.run_m) / self.interval_m
        last = -1.0 if self.turns % 2 == 0 else 1.0
        y = self.aside_m * np.where(
            u < 1.0,
            _rise(np.clip(u, 0.0, 1.0)),
            np.where(
                u < self.turns,
                np.cos(math.pi * (u - 1.0)),
                last * _rise(np.clip(self.turns + 1.0 - u, 0.0, 1.0)),
            ),
        )
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
        return x, y, arc, np.arctan(np.gradient(y, x))

    @property
    def lap_m(self) -> float:
        """Its length, m."""
        return float(self._table[2][-1])

    @property
    def curvature_1pm(self) -> float:
        """Its largest curvature, 1/m."""
        _, _, arc, off = self._table
        return float(np.abs(np.gradient(off, arc)).max())

    @property
    def centre_ned_m(self) -> Array:
        """The middle of its line (3,), NED, m."""
        return self._placed(0.5 * float(self._table[0][-1]), 0.0)

    def at(self, along_m: float) -> tuple[Array, float]:
        """Position (3,), NED, m, and course (rad, 0 is north) at an arc length from its start."""
        x, y, arc, off = self._table
        ahead, aside, turned = (float(np.interp(along_m, arc, of)) for of in (x, y, off))
        return self._placed(ahead, aside), self.course_rad + turned

    def _placed(self, ahead_m: float, right_m: float) -> Array:
        c, s = math.cos(self.course_rad), math.sin(self.course_rad)
        level = np.array([c * ahead_m - s * right_m, s * ahead_m + c * right_m, 0.0])
        return np.asarray(self.start_ned_m, float) + level
