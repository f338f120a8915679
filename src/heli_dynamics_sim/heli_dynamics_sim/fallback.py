# SPDX-License-Identifier: Apache-2.0
"""What the actuator side flies in real time while nobody commands it. No ROS.

It knows the commands so far and a gyro, as a receiver or a servo board with failsafe positions
does. While commands come it averages them: that is the trim. It also keeps by how much the attitude
is off its own slow mean: the body rates, integrated and forgotten over the same time. Without a
command for too long it flies

    u = mean - rate * (p, q, r) - angle * (turned about x, y, z)

on lateral, longitudinal and pedal, from then on without forgetting, and the mean collective. Where
one takes over from the other the difference fades away, so that no command jumps.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_math.rows import ACTUATOR
from heli_math.ticks import Rate

Array = NDArray[np.float64]

_MOST = 0.98
_TURNED_RAD = 0.6
"""Turned further it is no small angle any more."""
_LATE_TICKS = 2
"""Ticks that are made up for at once count as so many: nobody could answer between them."""


@dataclass(frozen=True)
class FallbackNumbers:
    """Numbers of the fallback, as `parameter_table` describes them.

    Attributes
    ----------
    timeout_ticks, blend_ticks : int
    kept : float
        Share of the mean that is left after a tick.
    tick_s : float
    rate, angle : (3,) arrays
        s/rad and 1/rad, lateral, longitudinal, pedal.
    """

    timeout_ticks: int
    blend_ticks: int
    kept: float
    tick_s: float
    rate: Array
    angle: Array

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> "FallbackNumbers":
        """From the parameters of the plant."""
        rate = Rate.of_parameters(values)
        return cls(
            max(1, rate.ticks_in(values["actuator_timeout_s"])),
            max(1, rate.ticks_in(values["fallback.blend_s"])),
            float(np.exp(-rate.tick_s / values["fallback.mean_s"])),
            rate.tick_s,
            np.array(values["fallback.rate"], float),
            np.array(values["fallback.angle"], float),
        )


class Fallback:
    """The command in force, from who commands or without.

    Parameters
    ----------
    numbers : FallbackNumbers
    trim : (4,) array
        Command before any has come.

    Attributes
    ----------
    acting : bool
        True while nobody commands.
    times, ticks : int
        How often and how long it has acted.
    """

    def __init__(self, numbers: FallbackNumbers, trim: Array) -> None:
        self._n, self._mean, self._command = numbers, trim.copy(), trim.copy()
        self._turned, self._left, self._fading = np.zeros(3), np.zeros(ACTUATOR.size), 0
        self._out, self._age = trim.copy(), 0
        self.acting, self.times, self.ticks = False, 0, 0

    def hear(self, command: Array) -> None:
        """A command (4,) has come."""
        self._command[:] = command
        self._age = 0
        if self.acting:
            self.acting = False
            self._fade_from(self._command)

    def step(self, gyro_radps: Array, made_up: int = 0) -> Array:
        """What is flown for a tick.

        Parameters
        ----------
        gyro_radps : (3,) array
            Body rates of now, FRD, measured; NaN counts as none.
        made_up : int
            How many ticks were made at once before this one.

        Returns
        -------
        (4,) array
            Actuators within -1..1; valid until the next call.
        """
        n, gyro = self._n, np.nan_to_num(gyro_radps)
        self._age += made_up < _LATE_TICKS
        self._turned += n.tick_s * gyro
        if not self.acting and self._age > n.timeout_ticks:
            self.acting, self.times = True, self.times + 1
            self._fade_from(self._fallback(gyro))
        if self.acting:
            self.ticks += 1
            goal = self._fallback(gyro)
        else:
            self._mean += (1.0 - n.kept) * (self._command - self._mean)
            self._turned *= n.kept
            goal = self._command
        np.clip(self._turned, -_TURNED_RAD, _TURNED_RAD, out=self._turned)
        if self._fading:
            self._fading -= 1
            goal = np.clip(goal + self._left * (self._fading / n.blend_ticks), -_MOST, _MOST)
        self._out[:] = goal
        return self._out

    def facts(self) -> dict[str, str]:
        """How often and how long nobody has commanded, for /diagnostics; empty if never."""
        if not self.times:
            return {}
        lasted_s = self.ticks * self._n.tick_s
        return {"without_commands": f"{self.times} times, {lasted_s:.2f} s in all"}

    def _fallback(self, gyro: Array) -> Array:
        n, u = self._n, self._mean.copy()
        u[ACTUATOR.attitude] -= n.rate * gyro + n.angle * self._turned
        return np.clip(u, -_MOST, _MOST)

    def _fade_from(self, goal: Array) -> None:
        """Go on from what is flown towards a goal."""
        self._left[:] = self._out - goal
        self._fading = self._n.blend_ticks
