# SPDX-License-Identifier: Apache-2.0
"""What the environments of `heli.gym` are: task, action, observation, reward; one or many aircraft.

All is counted over arrays with a row per aircraft, so that one aircraft and many are the same.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np
from gymnasium.spaces import Box
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from heli.arguments import in_python, refused, taken, whole_from
from heli_core.errors import FlightError
from heli_core.rotations import euler_angles
from heli_core.rows import NAV, REFERENCE, SETPOINT, TRUTH
from heli_flight.batch import MOST_TICKS, Batch, step_batch
from heli_flight.fleet import design_file
from heli_flight.fly import tell_if_it_compiles
from heli_flight.settings import resolve
from heli_flight.stepping import CommandLevel
from heli_flight.terminal import console

Array = NDArray[np.float64]

# -------------------------------------------------------------------------------------------------
# The tasks.
# -------------------------------------------------------------------------------------------------

_SEED = whole_from(0)
_AWAY_M = 10.0
"""Of the place to hold: farther away an episode of hover is over."""
_TILT_RAD = math.radians(60.0)
_OVER = -100.0
"""Reward of the step at which an aircraft is lost."""
_STEP_S, _ASKED_RAD = 2.0, (0.2, 0.2, 0.5)
"""Another attitude is asked for so often, and within so much of level and of the heading."""
_LEAN_RAD, _TURN_RAD, _LIFT = 0.3, 0.5, 0.2
"""What an action of 1 asks for at the level of attitudes: roll and pitch, heading, collective."""
_MOTION = ("phi_rad", "theta_rad", "psi_error_rad", "p_radps", "q_radps", "r_radps")


def _last(actions: int) -> tuple[str, ...]:
    return tuple(f"last_action_{i}" for i in range(actions))


@dataclass(frozen=True)
class Task:
    """What an environment asks for.

    Attributes
    ----------
    actions : int
        Numbers of an action; what is missing of four stays in trim.
    names : tuple of str
        Of the observation's numbers.
    """

    actions: int
    names: tuple[str, ...]


TASKS = {
    "hover": Task(
        4,
        (
            "north_error_m", "east_error_m", "down_error_m",
            "vel_north_mps", "vel_east_mps", "vel_down_mps", *_MOTION, *_last(4),
        ),
    ),
    "attitude": Task(
        3, ("phi_error_rad", "theta_error_rad", *_MOTION, *_last(3))
    ),
}  # fmt: skip
"""By name: a place to hold, an attitude to follow while the collective rests in trim."""
COMMANDS = {"actuators": CommandLevel.ACTUATORS, "attitude": CommandLevel.ATTITUDE}
OBSERVED: dict[str, Any] = {"truth": TRUTH, "nav": NAV}


def _wrapped(angle: Array) -> Array:
    """Angles (...), rad, within -pi to pi."""
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


class Fleet:
    """So many aircraft at a task.

    Parameters
    ----------
    task : {"hover", "attitude"}
    n : int
    command : {"actuators", "attitude"}
        What an action is; of the task attitude the actuators. 0 is the trim of the flight's start;
        1 the whole way of an actuator more, or 0.3 rad of roll and pitch, 0.5 rad of heading and
        0.2 of collective.
    observe : {"truth", "nav"}
        How the aircraft moves, or what is known of it on board. An observation's positions and
        velocities are north, east, **down**: above the place to hold, down_error_m is negative.
    aircraft, world
        As of `heli.Simulation`.
    ticks : int
        Of 10 ms, for a step.
    flights : int
        Each aircraft flies so many flights (winds, sensor errors) in turn, as they are drawn.
    threads : int
        That share the aircraft.
    """

    @in_python
    def __init__(
        self,
        task: str,
        n: int,
        *,
        command: str = "actuators",
        observe: str = "truth",
        aircraft: str | None = None,
        world: str = "paper",
        ticks: int = 2,
        flights: int = 8,
        threads: int = 1,
    ) -> None:
        for name, value, known in (
            ("task", task, TASKS), ("command", command, COMMANDS), ("observe", observe, OBSERVED),
        ):  # fmt: skip
            if value not in tuple(known):
                raise refused(name, value, ", ".join(known))
        if task == "attitude" and command != "actuators":
            raise refused("command", command, "of attitude: actuators")
        counts = {"ticks": (ticks, MOST_TICKS), "flights": (flights, 10**6)}
        counts |= {"threads": (threads, 256), "num_envs": (n, 10**6)}
        for name, (number, most) in counts.items():
            taken(name, number, whole_from(1, most))
        tell_if_it_compiles(console(stderr=True), kernel=step_batch)
        settings = resolve("hover", world=world, params=design_file(aircraft))
        self.task, self.n, self.ticks = TASKS[task], n, ticks
        self._hovers, self._level = task == "hover", COMMANDS[command]
        self._row: Any = OBSERVED[observe]
        self._known = flights
        self.batch, self._dt_s = Batch(settings, n, threads), settings.rate.tick_s * ticks
        start = settings.scenario.reference.points[0]
        self._place, self._psi = start[REFERENCE.pos].copy(), float(start[REFERENCE.psi])
        self._seeds = np.zeros((n, flights), np.int64)
        self._trim, self._asked = np.zeros((n, 4)), np.zeros((n, 3))
        self._level_rad = np.zeros((n, 3))
        self._action = np.zeros((n, self.task.actions))
        self._asked_at = np.zeros(n, np.int64)
        self._random: list[np.random.Generator] = []
        self._scale = np.ones(4)
        if self._level == CommandLevel.ATTITUDE:
            self._scale = np.array([_LEAN_RAD, _LEAN_RAD, _TURN_RAD, _LIFT])

    def seed(self, random: list[np.random.Generator]) -> None:
        """Draw the seeds of everyone's flights, from a stream for each aircraft."""
        self._random = random
        self._seeds[:] = [one.integers(2**31 - 1, size=self._known) for one in random]

    def reset(self, which: NDArray[np.int64]) -> None:
        """Begin an episode of those aircraft, each in one of its flights."""
        batch = self.batch
        drawn = {int(i): int(self._random[i].choice(self._seeds[i])) for i in which}
        batch.reset(drawn, self._known)
        trim = batch.u if self._level == CommandLevel.ACTUATORS else batch.setpoint
        self._trim[which] = trim[which]
        self._action[which] = 0.0
        self._level_rad[which] = batch.setpoint[which, SETPOINT.attitude]
        for i in which:
            self._ask(int(i))

    def _ask(self, i: int) -> None:
        """Another attitude for one aircraft, about its trim and the heading of its start."""
        drawn = self._random[i].uniform(-1.0, 1.0, 3) * _ASKED_RAD
        self._asked[i] = self._level_rad[i] + drawn
        self._asked_at[i] = self.batch.ticks[i]

    def step(self, action: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Reward (N,) and whether the episode is over (N,), of an action (N, actions).

        Raises
        ------
        ParameterError
            The action has another shape, or holds what is no finite number.
        """
        batch, actions = self.batch, self.task.actions
        if action.shape != self._action.shape or not np.isfinite(action).all():
            raise refused("action", action.tolist(), f"{self.n} x {actions} finite numbers")
        self._action[:] = np.clip(action, -1.0, 1.0)
        given = self._trim.copy()
        given[:, :actions] += self._scale[:actions] * self._action
        if self._level == CommandLevel.ACTUATORS:
            np.clip(given, -1.0, 1.0, given)
        batch.given[:] = given
        batch.step(self._level, self.ticks)
        reward, over = self._judged()
        reward[over] = _OVER
        late = self._asked_at + round(_STEP_S / self._dt_s) * self.ticks
        for i in np.flatnonzero((batch.ticks >= late) & ~over):
            self._ask(int(i))
        return reward, over

    def _judged(self) -> tuple[Array, NDArray[np.bool_]]:
        """By the truth, whatever is observed."""
        row = self.batch.truth
        euler = euler_angles(row[:, TRUTH.quat])
        over = (self.batch.status != 0) | (np.abs(euler[:, :2]) > _TILT_RAD).any(axis=1)
        if not self._hovers:
            off = euler - self._asked
            off[:, 2] = _wrapped(off[:, 2])
            return 1.0 - np.minimum(np.linalg.norm(off, axis=1) / 0.3, 1.0), over
        away = np.linalg.norm(row[:, TRUTH.pos] - self._place, axis=1)
        speed = np.linalg.norm(row[:, TRUTH.vel], axis=1)
        turned = np.abs(_wrapped(euler[:, 2] - self._psi))
        cost = away / _AWAY_M + 0.1 * speed + 0.2 * turned
        return 1.0 - np.minimum(cost, 1.0), over | (away > _AWAY_M)

    def observation(self) -> NDArray[np.float32]:
        """What is observed (N, names); of what is not known yet on board, zeros."""
        row = self.batch.truth if self._row is TRUTH else self.batch.nav
        place = self._row
        euler = euler_angles(row[:, place.quat])
        psi = _wrapped(euler[:, 2:] - (self._psi if self._hovers else self._asked[:, 2:]))
        motion = [euler[:, :2], psi, row[:, place.rate]]
        if self._hovers:
            parts = [row[:, place.pos] - self._place, row[:, place.vel], *motion]
        else:
            parts = [euler[:, :2] - self._asked[:, :2], *motion]
        made = np.hstack([*parts, self._action])
        return np.nan_to_num(made, nan=0.0).astype(np.float32)

    @property
    def action_space(self) -> Any:
        """Of one aircraft."""
        return Box(-1.0, 1.0, (self.task.actions,), np.float32)

    @property
    def observation_space(self) -> Any:
        """Of one aircraft."""
        return Box(-np.inf, np.inf, (len(self.task.names),), np.float32)


# -------------------------------------------------------------------------------------------------
# The environments.
# -------------------------------------------------------------------------------------------------


def _refuse_before_reset(has_begun: bool) -> None:
    if not has_begun:
        raise FlightError("no episode has begun; call reset() first")


def _as_numbers(action: Any) -> Array:
    """An action as numbers; ParameterError for what is none."""
    try:
        return np.asarray(action, np.float64)
    except (TypeError, ValueError):
        raise refused("action", action, "an array of finite numbers") from None


class HeliEnv(gymnasium.Env[NDArray[np.float32], NDArray[np.float32]]):
    """One aircraft; arguments as of `Fleet`."""

    metadata: dict[str, Any] = {"render_modes": []}

    def __init__(self, task: str, **options: Any) -> None:
        self._fleet = Fleet(task, 1, **options)
        self.action_space = self._fleet.action_space
        self.observation_space = self._fleet.observation_space
        self._seeded = False

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode; a seed draws which flights the aircraft has."""
        super().reset(seed=None if seed is None else taken("seed", seed, _SEED))
        if seed is not None or not self._seeded:
            self._fleet.seed([self.np_random])
            self._seeded = True
        self._fleet.reset(np.zeros(1, np.int64))
        return self._fleet.observation()[0], {"names": self._fleet.task.names}

    def step(
        self, action: NDArray[np.float32]
    ) -> tuple[NDArray[np.float32], float, bool, bool, dict[str, Any]]:
        """Fly on by `ticks`; FlightError before the first reset, ParameterError as of `Fleet`."""
        _refuse_before_reset(self._seeded)
        reward, over = self._fleet.step(_as_numbers(action)[None])
        return self._fleet.observation()[0], float(reward[0]), bool(over[0]), False, {}


class HeliVectorEnv(VectorEnv[NDArray[np.float32], NDArray[np.float32], NDArray[np.float64]]):
    """Many aircraft, one call of compiled code for all; arguments as of `Fleet`.

    An aircraft whose episode is over begins the next one at the next step (`NEXT_STEP`).
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}

    @in_python
    def __init__(
        self, task: str, num_envs: int = 1, max_episode_steps: int = 500, **options: Any
    ) -> None:
        self._fleet, self.num_envs = Fleet(task, num_envs, **options), num_envs
        self.single_action_space = self._fleet.action_space
        self.single_observation_space = self._fleet.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._most, self._steps = max_episode_steps, np.zeros(num_envs, np.int64)
        self._over, self._seeded = np.zeros(num_envs, bool), False

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[NDArray[np.float32], dict[str, Any]]:
        """Begin an episode of everyone; aircraft i of seed s has the flights of one of seed s + i.

        A list says the seed of each.
        """
        if seed is not None or not self._seeded:
            seeds = self._seeds_of(seed)
            self._fleet.seed([gymnasium.utils.seeding.np_random(one)[0] for one in seeds])
            self._seeded = True
        self._fleet.reset(np.arange(self.num_envs))
        self._steps[:], self._over[:] = 0, False
        return self._fleet.observation(), {}

    def _seeds_of(self, seed: Any) -> list[int | None]:
        """The seed of each aircraft."""
        n = self.num_envs
        if seed is None:
            return [None] * n
        if not isinstance(seed, (list, tuple, np.ndarray)):
            first = taken("seed", seed, _SEED)
            return [first + i for i in range(n)]
        if len(seed) != n:
            raise refused("seed", seed, f"a whole number from 0, or {n} of them")
        return [None if one is None else taken("seed", one, _SEED) for one in seed]

    def step(self, actions: NDArray[np.float32]) -> tuple[Any, Any, Any, Any, dict[str, Any]]:
        """Fly on by `ticks`; whoever was over begins anew, which counts as his step.

        FlightError before the first reset, ParameterError as of `Fleet`.
        """
        _refuse_before_reset(self._seeded)
        fleet, anew = self._fleet, np.flatnonzero(self._over)
        reward, terminated = fleet.step(_as_numbers(actions))
        self._steps += 1
        if anew.size:
            fleet.reset(anew)
            self._steps[anew], reward[anew], terminated[anew] = 0, 0.0, False
        truncated = ~terminated & (self._steps >= self._most)
        self._over = terminated | truncated
        return fleet.observation(), reward, terminated, truncated, {}
