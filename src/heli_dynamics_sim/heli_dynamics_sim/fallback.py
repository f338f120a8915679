# SPDX-License-Identifier: Apache-2.0
"""What the actuator side flies while nobody commands it. No ROS.

It knows the commands so far and a gyro, as a receiver or a servo board with failsafe positions
does. While commands come it averages them: that is the trim. It also keeps by how much the attitude
is off its own slow mean: the body rates, integrated and forgotten over the same time. Without a
command for too long it flies

    u = mean - rate * (p, q, r) - angle * (turned about x, y, z)

on lateral, longitudinal and pedal, from then on without forgetting, and the mean collective. Where
one takes over from the other the difference fades away, so that no command jumps.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_math.arrays import copy, scratch
from heli_math.jit import njit
from heli_math.rows import ACTUATOR
from heli_math.ticks import Rate

Array = NDArray[np.float64]

_MOST = 0.98
_TURNED_RAD = 0.6
"""Turned further it is no small angle any more."""
_LATE_TICKS = 2
"""Ticks that are made up for at once count as so many: nobody could answer between them."""
_N = ACTUATOR.size
_AGE, _FADING, _ACTING, _TIMES, _TICKS = range(5)


class FallbackNumbers(NamedTuple):
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


class FallbackState(NamedTuple):
    """What is remembered; changed in place."""

    mean: Array  # (4,) of the commands
    command: Array  # (4,) the last one
    turned: Array  # (3,) angles off the slow mean attitude, rad
    left: Array  # (4,) difference that fades away
    out: Array  # (4,) what is flown
    counts: NDArray[np.int64]  # (5,) age of the command, ticks left to fade, acting, times, ticks


def initial_fallback(trim: Array) -> FallbackState:
    """Before any command (4,) has come, the trim is flown."""
    return FallbackState(
        trim.copy(), trim.copy(), np.zeros(3), np.zeros(_N), trim.copy(), np.zeros(5, np.int64)
    )


@njit
def _fallback(state, n, gyro, out):
    """The command without commands, into out (4,)."""
    copy(out, state.mean)
    for i in range(gyro.shape[0]):
        out[i] -= n.rate[i] * gyro[i] + n.angle[i] * state.turned[i]
    for i in range(out.shape[0]):
        out[i] = min(max(out[i], -_MOST), _MOST)


@njit
def _fade_from(state, n, goal):
    """Go on from what is flown towards a goal (4,)."""
    for i in range(goal.shape[0]):
        state.left[i] = state.out[i] - goal[i]
    state.counts[_FADING] = n.blend_ticks


@njit
def hear(state, n, command):
    """A command (4,) has come."""
    copy(state.command, command)
    state.counts[_AGE] = 0
    if state.counts[_ACTING]:
        state.counts[_ACTING] = 0
        _fade_from(state, n, state.command)


@njit
def step(state, n, gyro_radps, made_up):
    """What is flown for a tick, into state.out; as `Fallback.step`."""
    count, goal, gyro = state.counts, scratch(_N), scratch(3)
    for i in range(gyro_radps.shape[0]):
        gyro[i] = gyro_radps[i] if np.isfinite(gyro_radps[i]) else 0.0
    count[_AGE] += made_up < _LATE_TICKS
    for i in range(gyro.shape[0]):
        state.turned[i] += n.tick_s * gyro[i]
    if not count[_ACTING] and count[_AGE] > n.timeout_ticks:
        count[_ACTING], count[_TIMES] = 1, count[_TIMES] + 1
        _fallback(state, n, gyro, goal)
        _fade_from(state, n, goal)
    if count[_ACTING]:
        count[_TICKS] += 1
        _fallback(state, n, gyro, goal)
    else:
        copy(goal, state.command)
        for i in range(goal.shape[0]):
            state.mean[i] += (1.0 - n.kept) * (state.command[i] - state.mean[i])
        for i in range(gyro.shape[0]):
            state.turned[i] *= n.kept
    for i in range(gyro.shape[0]):
        state.turned[i] = min(max(state.turned[i], -_TURNED_RAD), _TURNED_RAD)
    if count[_FADING]:
        count[_FADING] -= 1
        share = count[_FADING] / n.blend_ticks
        for i in range(goal.shape[0]):
            goal[i] = min(max(goal[i] + state.left[i] * share, -_MOST), _MOST)
    copy(state.out, goal)


class Fallback:
    """The command in force, from who commands or without.

    Parameters
    ----------
    numbers : FallbackNumbers
    trim : (4,) array
        Command before any has come.
    """

    def __init__(self, numbers: FallbackNumbers, trim: Array) -> None:
        self._n, self._state = numbers, initial_fallback(trim)

    @property
    def acting(self) -> bool:
        """True while nobody commands."""
        return bool(self._state.counts[_ACTING])

    @property
    def times(self) -> int:
        """How often it has acted."""
        return int(self._state.counts[_TIMES])

    @property
    def ticks(self) -> int:
        """How long it has acted."""
        return int(self._state.counts[_TICKS])

    def hear(self, command: Array) -> None:
        """A command (4,) has come."""
        hear(self._state, self._n, command)

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
        step(self._state, self._n, gyro_radps, made_up)
        return self._state.out

    def after(self, command: Array | None, gyro_radps: Array) -> Array:
        """What is flown for a tick at which a command (4,) has come, or none; as `step`."""
        if command is not None:
            self.hear(command)
        return self.step(gyro_radps)

    def facts(self) -> dict[str, str]:
        """How often and how long nobody has commanded, for /diagnostics; empty if never."""
        if not self.times:
            return {}
        lasted_s = self.ticks * self._n.tick_s
        return {"without_commands": f"{self.times} times, {lasted_s:.2f} s in all"}
