# SPDX-License-Identifier: Apache-2.0
"""A flight in this process tick by tick: whoever holds it commands at any level of the cascade.

A step begins where a tick knows the most: sensors are read and the state is estimated (`perceive`).
It commands, has the plant fly to the next tick, and perceives there:

    begin: perceive(0)
    step:  command(n) -> act(n) -> perceive(n + 1)

These are the kernels of `loop.fly_ticks` between other brackets, so that a flight whose steps
command nothing of their own is the flight of `loop.fly_loop`, bit for bit.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_core.errors import FlightError
from heli_core.jit import copy, direct, njit, scratch
from heli_core.rows import ACTUATOR, NINE, SETPOINT, TRUTH
from heli_dynamics_sim import plant
from heli_dynamics_sim.noise import NoiseStreams
from heli_flight.course import Course
from heli_flight.loop import (
    AircraftInLoop,
    TicksWithParts,
    act,
    build,
    command_actuators,
    control,
    first_commands,
    guide,
    hear,
    listen,
    perceive,
    what_changes,
)
from heli_flight.parts import Parts, with_linear, without_linear
from heli_flight.settings import Settings, without_own
from heli_inner_hinf import estimate
from heli_inner_hinf.ground_and_manual import stand_by
from heli_outer_pd.modes import Phase, Refusal
from heli_outer_pd.phases import Phases
from heli_outer_pd.state import MEMORY

# -------------------------------------------------------------------------------------------------
# One step, compiled.
# -------------------------------------------------------------------------------------------------


class CommandLevel(IntEnum):
    """At which level of the cascade a step commands."""

    GUIDANCE = 0
    """The flight's own way, or a velocity: every packaged controller flies."""
    ATTITUDE = 1
    """Roll, pitch, heading and collective: the attitude controller flies."""
    ACTUATORS = 2
    """The actuators themselves."""


class VelocityRow(NamedTuple):
    """A velocity that is commanded (4,)."""

    vel: slice = slice(0, 3)  # NED, m/s
    yaw_rate: int = 3  # to the right, rad/s
    size: int = 4


VELOCITY = VelocityRow()
_GUIDANCE, _ATTITUDE, _ACTUATORS = (int(level) for level in CommandLevel)
_N_SETPOINT = SETPOINT.size
_CHANGED = -2
"""Outcome of a step after which the phases are to be asked before their time."""


@njit
def follow_others(loop, setpoint):
    """The position controller takes a setpoint (4,) of others for its own last command."""
    copy(loop.outer_s.law.x[MEMORY.command], setpoint)


@njit
def take_actuators(loop, links, tick, given, setpoint, u):
    """Actuators (4,) that are given fly; the controllers go on from them when they are asked again.

    setpoint (4,): out, the attitude that is flown, as far as it is known, and the collective.
    """
    hear(loop, links, tick, False, setpoint)
    x9, attitude = loop.rows.x9, loop.rows.aim[estimate.COMMAND.attitude]
    copy(u, given)
    stand_by(x9, attitude, u[ACTUATOR.attitude], loop.inner_s)
    estimate.commanded(loop.estimate_s, tick, u[ACTUATOR.attitude], loop.estimate_k)
    if np.isfinite(x9[NINE.phi]):
        setpoint[SETPOINT.phi], setpoint[SETPOINT.theta] = x9[NINE.phi], x9[NINE.theta]
        setpoint[SETPOINT.psi] = x9[NINE.psi]
    setpoint[SETPOINT.col] = u[ACTUATOR.col]


@njit
def command(loop, links, tick, level, given, times_ns, points, setpoint, u):
    """The actuators (4,) of a tick, by the controllers from a level on; arguments as of `step`."""
    if level == _GUIDANCE:
        guide(loop, links, tick, times_ns, points, setpoint)
        listen(loop, links, tick, setpoint)
        control(loop, tick)
        command_actuators(loop, tick, u)
        return
    # The position controller keeps looking, so that it may take over at any time; nobody follows
    # it.
    guide(loop, links, tick, times_ns, points, scratch(_N_SETPOINT))
    if level == _ATTITUDE:
        copy(setpoint, given)
        hear(loop, links, tick, True, setpoint)
        control(loop, tick)
        command_actuators(loop, tick, u)
    else:
        take_actuators(loop, links, tick, given, setpoint, u)
    follow_others(loop, setpoint)


@njit
def step(loop, links, tick, level, given, noise_row, times_ns, points, setpoint, u, truth):
    """From tick, which has been perceived, to tick + 1.

    Parameters
    ----------
    loop : AircraftInLoop
    links : Links or None
        Those of the loop.
    tick, level : int
        `CommandLevel`.
    given : (4,) array
        Of ATTITUDE phi, theta, psi, collective (places of `SETPOINT`), of ACTUATORS these.
    noise_row : (NOISE.size,) array
        Of tick + 1.
    times_ns, points : arrays
        The way of the flight.
    setpoint, u : (4,) arrays
        In place: what is commanded.
    truth : (19,) array
        Out, at tick + 1.

    Returns
    -------
    int
        0, a PlantStatus, or below zero: the phases are to be asked.
    """
    before = what_changes(loop.outer_s)
    command(loop, links, tick, level, given, times_ns, points, setpoint, u)
    changed = what_changes(loop.outer_s) != before
    act(loop, links, tick, u)
    perceive(loop, links, tick + 1, noise_row, u, truth)
    status = plant.status(loop.plant_s, loop.plant_k)
    if status != 0:
        return status
    return _CHANGED if changed else 0


# -------------------------------------------------------------------------------------------------
# Random numbers of a flight that may be flown again from any of its ticks.
# -------------------------------------------------------------------------------------------------

_DRAWN = 128


class _Drawn:
    """A stretch of a flight's random numbers; the next one is drawn when it is first asked for.

    Whoever holds a stretch can fly on from there, as often as he likes; those that nobody holds are
    forgotten.
    """

    def __init__(self, streams: NoiseStreams) -> None:
        self.rows, self._streams = streams.rows(_DRAWN), streams
        self._next: _Drawn | None = None

    def next(self) -> "_Drawn":
        if self._next is None:
            self._next = _Drawn(self._streams)
        return self._next


# -------------------------------------------------------------------------------------------------
# The flight.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class SavedFlight:
    """A flight at a tick: all that it goes on from. `SteppedFlight.restore` takes it.

    Attributes
    ----------
    tick : int
    seed : int
    arrays : tuple of ndarray
        Copies of every state.
    drawn, course, parts, sent : object
        Random numbers, way and phases, what objects of the user remember, last velocity.
    status, level : int
    """

    tick: int
    seed: int
    arrays: tuple[NDArray[Any], ...]
    drawn: _Drawn
    course: Course
    parts: Any
    sent: NDArray[np.float64] | None
    status: int
    level: int
    failure: str


def _states(numbers: Any) -> Iterator[NDArray[Any]]:
    """Every array in a tuple of tuples."""
    if isinstance(numbers, np.ndarray):
        yield numbers
    elif isinstance(numbers, tuple):
        for member in numbers:
            yield from _states(member)


def _states_of(loop: AircraftInLoop) -> Iterator[NDArray[Any]]:
    """Every array of a loop that a tick may change."""
    if loop.links is not None:
        yield from _states(loop.links.s)
    for name, member in loop._asdict().items():
        if name != "links" and not name.endswith("_k"):
            yield from _states(member)


class SteppedFlight:
    """One flight, tick by tick.

    Parameters
    ----------
    settings : Settings
    parts : Parts, optional
        Objects that fly in place of compiled parts.

    Raises
    ------
    LawError, PartError, ParameterError, TrimError, SynthesisError

    Attributes
    ----------
    loop : AircraftInLoop
        `loop.rows` has what is measured and what is estimated.
    tick : int
    truth : (19,) array
        Places of `TRUTH`.
    setpoint, u : (4,) arrays
        What was commanded last; places of `SETPOINT` and `ACTUATOR`.
    status : PlantStatus
    """

    def __init__(self, settings: Settings, parts: Parts | None = None) -> None:
        self.settings, self.rate = settings, settings.rate
        compiled = replace(settings, nodes=without_linear(settings.nodes))
        self.loop = loop = build(without_own(compiled))
        self._parts = with_linear(parts or Parts(), settings.nodes)
        self._ticks = TicksWithParts(loop, self._parts, settings) if self._parts else None
        self.setpoint, self.u = first_commands(loop, settings)
        self.truth, self._given = np.zeros(TRUTH.size), np.zeros(SETPOINT.size)
        self.tick, self.status, self._level = 0, plant.PlantStatus.OK, _GUIDANCE
        self._course = Course(loop.outer_k, loop.outer_s, settings, loop.period_ticks)
        self._due = self._course.unasked(0) - 1
        self._sent: NDArray[np.float64] | None = None
        self._states = [*_states_of(loop), self.setpoint, self.u, self.truth]
        self._drawn = _Drawn(NoiseStreams(settings.seed))
        self._step: Callable[..., int] = (
            direct(step, *self._arguments(_GUIDANCE)) if self._ticks is None else self._step_parts
        )
        self._perceive(self._drawn.rows[0])

    @property
    def failure(self) -> str:
        """What an object of the user has done wrong, one sentence; empty for nothing."""
        return self._ticks.failure if self._ticks else ""

    @property
    def sentence(self) -> str:
        """Why the flight is over; empty while it flies."""
        return self.failure or ("" if self.status == 0 else self.status.sentence)

    @property
    def way(self) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
        """What the position controller follows: times, ns, and points."""
        return self._course.times_ns, self._course.points

    @property
    def phases(self) -> Phases:
        """What the flight does between the ground and the ground; for commands there is `ask`."""
        return self._course.phases

    def ask(self, asked: Callable[[Phases, int, NDArray[np.float64]], Refusal | None]) -> str:
        """Have the phases asked for something between two steps, and follow what they make of it.

        Parameters
        ----------
        asked : callable
            Of the phases, the stamp of the position controller's last step, ns, and its navigation
            row; what it returns is what the phases say.

        Returns
        -------
        str
            Why it is refused, one sentence; empty if it is done.

        Raises
        ------
        ReferenceRefused
            No way within the limits; nothing has changed.
        """
        refused = asked(self._course.phases, self._last_step_ns(), self.loop.outer_s.nav)
        if refused is not None:
            return refused.sentence
        self._sent = None
        self._take()
        return ""

    def noise(self) -> Iterator[NDArray[np.float64]]:
        """The random numbers of the ticks to come, in stretches (n, NOISE.size)."""
        drawn, at = self._drawn, (self.tick + 1) % _DRAWN
        if at:
            yield drawn.rows[at:]
        while True:
            drawn = drawn.next()
            yield drawn.rows

    def _perceive(self, noise_row: NDArray[np.float64]) -> None:
        if self._ticks is None:
            perceive(self.loop, self.loop.links, self.tick, noise_row, self.u, self.truth)
        else:
            self._ticks.perceive(self.loop, self.tick, noise_row, self.u, self.truth)

    def _arguments(self, level: int) -> tuple[Any, ...]:
        tick, loop, course = self.tick, self.loop, self._course
        at = (tick + 1) % _DRAWN
        if at == 0:
            self._drawn = self._drawn.next()
        row = self._drawn.rows[at]
        reference = course.times_ns, course.points
        return (
            loop, loop.links, tick, level, self._given, row, *reference, self.setpoint, self.u,
            self.truth,
        )  # fmt: skip

    def _step_parts(
        self,
        loop: AircraftInLoop,
        links: Any,
        tick: int,
        level: int,
        given: NDArray[np.float64],
        noise_row: NDArray[np.float64],
        times_ns: NDArray[np.int64],
        points: NDArray[np.float64],
        setpoint: NDArray[np.float64],
        u: NDArray[np.float64],
        truth: NDArray[np.float64],
    ) -> int:
        """As `step`, with objects of the user."""
        ticks = self._ticks
        assert ticks is not None
        before = what_changes(loop.outer_s)
        if level == _GUIDANCE:
            ticks.command(loop, tick, times_ns, points, setpoint, u)
        else:
            ticks.guide(loop, tick, times_ns, points, np.zeros(_N_SETPOINT))
            if level == _ATTITUDE:
                setpoint[:] = given
                hear(loop, links, tick, True, setpoint)
                ticks.control(loop, tick)
                command_actuators(loop, tick, u)
            else:
                take_actuators(loop, links, tick, given, setpoint, u)
            follow_others(loop, setpoint)
        changed = bool(what_changes(loop.outer_s) != before)
        if ticks.act(loop, tick, u) == 0:
            ticks.perceive(loop, tick + 1, noise_row, u, truth)
        return ticks.status(loop) or (_CHANGED if changed else 0)

    @property
    def has_own_plant(self) -> bool:
        """Whether an object flies in place of the simulated helicopter."""
        return self._parts.plant is not None

    # ---------------------------------------------------------------------------------------------

    def step(self, level: CommandLevel, given: ArrayLike | None = None) -> None:
        """Fly to the next tick.

        Parameters
        ----------
        level : CommandLevel
        given : (4,) array, optional
            Of ATTITUDE and ACTUATORS, as of the kernel `step`; of GUIDANCE a velocity, NED, m/s,
            and a rate of turn, rad/s, that is flown while it is given; None: the flight's own way,
            or, after others have flown, a halt.

        Raises
        ------
        FlightError
            The flight is over.
        ReferenceRefused, FlightError
            The velocity cannot be flown; nothing has changed.
        """
        if self.sentence:
            raise FlightError(f"the flight is over: {self.sentence} reset() begins another")
        if level == CommandLevel.GUIDANCE:
            if self._level != _GUIDANCE:
                self._resume()
            if given is not None:
                self._fly_at(given)
        else:
            self._given[:] = given
        self._level = int(level)
        last, status = self.tick, self._step(*self._arguments(self._level))
        self.tick += 1
        if status > 0:
            self.status = plant.PlantStatus(status)
        if status == _CHANGED or last == self._due or last == 0:
            guided = self._level == _GUIDANCE or last == 0
            self._ask(last, status <= 0 and not self.failure and guided)

    def _ask(self, last: int, flies: bool) -> None:
        self._course.after(last, self.setpoint, flies)
        self._due = last + self._course.unasked(last + 1)

    def _last_step_ns(self) -> int:
        """Stamp of the position controller's last step, ns; the flight's first before that."""
        period = self.loop.period_ticks
        return max(self.tick - 1, 0) // period * period * self.rate.tick_ns

    def _resume(self) -> None:
        self._course.phases.resume(self._last_step_ns(), self.loop.outer_s.nav)
        self._take()

    def _fly_at(self, velocity: ArrayLike) -> None:
        """Fly a velocity (4,) from the controller's next step on, if it is due or has changed."""
        phases, now_ns = self._course.phases, self._last_step_ns()
        if self.tick == 0 or self.tick % self.loop.period_ticks:
            return  # the controller steps later, and is told then
        wanted = np.array(velocity, np.float64)
        if self._sent is not None and phases.phase == Phase.VELOCITY:
            old_ns = now_ns - phases.cruise_ns
            if np.array_equal(self._sent, wanted) and old_ns < phases.numbers.sticks.timeout_ns / 2:
                return
        vel, rate = wanted[VELOCITY.vel], float(wanted[VELOCITY.yaw_rate])
        refused = phases.velocity(vel, rate, now_ns, self.loop.outer_s.nav)
        if isinstance(refused, Refusal):
            raise FlightError(refused.sentence)
        self._sent = wanted
        self._take()

    def _take(self) -> None:
        """Follow the phases' way, which others than the controller's step have changed."""
        self._course.scripted = True
        self._course.take()
        self._due = self.tick + self._course.unasked(self.tick) - 1

    # ---------------------------------------------------------------------------------------------

    def save(self) -> SavedFlight:
        """All that the flight goes on from, as copies.

        Raises
        ------
        PartError
            An object of the user cannot be copied.
        """
        arrays = tuple(array.copy() for array in self._states)
        parts = None if self._ticks is None else self._ticks.memory()
        drawn, course = self._drawn, self._course.copied()
        return SavedFlight(
            self.tick, self.settings.seed, arrays, drawn, course, parts, self._sent,
            int(self.status), self._level, self.failure,
        )  # fmt: skip

    def restore(self, moment: SavedFlight) -> None:
        """Go on from a moment, of this flight or of one with the same settings.

        Raises
        ------
        FlightError
            It is of another aircraft, other controllers, or another seed.
        """
        same = len(moment.arrays) == len(self._states) and all(
            a.shape == b.shape for a, b in zip(moment.arrays, self._states, strict=True)
        )
        if not same or moment.seed != self.settings.seed:
            raise FlightError(
                f"the state is of seed {moment.seed} and {len(moment.arrays)} arrays, the flight "
                f"of seed {self.settings.seed} and {len(self._states)}; allowed: a state of a "
                "flight with the same arguments"
            )
        for array, saved in zip(self._states, moment.arrays, strict=True):
            np.copyto(array, saved)
        self.tick, self._level = moment.tick, moment.level
        self.status, self._sent = plant.PlantStatus(moment.status), moment.sent
        self._drawn = moment.drawn
        self._course = moment.course.copied(self.loop.outer_k, self.loop.outer_s)
        if self._ticks is not None:
            self._ticks.remember(moment.parts, moment.failure)
        self._due = self.tick + self._course.unasked(self.tick) - 1
