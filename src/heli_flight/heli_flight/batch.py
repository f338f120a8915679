# SPDX-License-Identifier: Apache-2.0
"""Many aircraft, stepped together: one call of compiled code for all of them, for several ticks.

Each is a flight of its own (`stepping.SteppedFlight`), with its own seed, and flies what it would
fly alone, bit for bit. Commanded are attitudes or actuators; a velocity needs the phases of a
flight, which are Python.
"""

from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.jit import addresses_of, at_address, by_reference, copy, direct, njit_unlocked
from heli_core.rows import ACTUATOR, NAV, SETPOINT, TRUTH
from heli_dynamics_sim.noise import NOISE
from heli_flight.loop import AircraftInLoop
from heli_flight.settings import Settings
from heli_flight.stepping import CommandLevel, SavedFlight, SteppedFlight, step

_ROWS = 256
MOST_TICKS = 64
"""Of one step of a batch."""


class BatchedAt(NamedTuple):
    """Places of `Batched.at` (3,)."""

    tick: int = 0
    noise: int = 1  # row of the next tick's random numbers
    status: int = 2  # PlantStatus; not 0: it flies no more
    size: int = 3


AT = BatchedAt()


@by_reference
class Batched(NamedTuple):
    """One aircraft of a batch; arrays are changed in place."""

    loop: AircraftInLoop
    setpoint: NDArray[np.float64]  # (4,)
    u: NDArray[np.float64]  # (4,)
    truth: NDArray[np.float64]  # (19,)
    nav: NDArray[np.float64]  # (31,)
    given: NDArray[np.float64]  # (4,) what is commanded
    times_ns: NDArray[np.int64]
    points: NDArray[np.float64]
    noise: NDArray[np.float64]  # (256, NOISE.size)
    at: NDArray[np.int64]  # (3,) places of `AT`


@njit_unlocked
def step_batch(like, addresses, level, n_ticks):
    """`stepping.step` of each aircraft, n_ticks times.

    Parameters
    ----------
    like : Batched
        One of them: all have its type.
    addresses : (N,) int64 array
        Of each one, as of `heli_core.jit.addresses_of`.
    level, n_ticks : int
        ATTITUDE or ACTUATORS.
    """
    for i in range(addresses.shape[0]):
        one = at_address(like, addresses[i])
        at = one.at
        for _ in range(n_ticks):
            if at[AT.status] != 0:
                break
            row, links = one.noise[at[AT.noise]], one.loop.links
            reference, commands = (one.times_ns, one.points), (one.setpoint, one.u, one.truth)
            tick, given = at[AT.tick], one.given
            status = step(one.loop, links, tick, level, given, row, *reference, *commands)
            at[AT.tick] += 1
            at[AT.noise] += 1
            at[AT.status] = max(status, 0)
        copy(one.nav, one.loop.rows.nav)


class Batch:
    """So many aircraft.

    Parameters
    ----------
    settings : Settings
        Of each, but for its seed.
    n : int
    threads : int
        That share the aircraft.

    Attributes
    ----------
    truth, nav, u, setpoint, given : (N, 19), (N, 31), (N, 4) arrays
        Of each; `given` is written before a step.
    status, ticks : (N,) arrays
        PlantStatus: not 0, and it flies no more; tick.
    """

    def __init__(self, settings: Settings, n: int, threads: int = 1) -> None:
        self._settings, self._n = settings, n
        self.truth, self.nav = np.zeros((n, TRUTH.size)), np.zeros((n, NAV.size))
        self.u, self.setpoint = np.zeros((n, ACTUATOR.size)), np.zeros((n, SETPOINT.size))
        self.given = np.zeros((n, SETPOINT.size))
        self._at = np.zeros((n, AT.size), np.int64)
        self.ticks, self.status = self._at[:, AT.tick], self._at[:, AT.status]
        self._noise = np.zeros((n, _ROWS, NOISE.size))
        self._left = np.zeros(n, np.int64)
        self._drawn: list[Iterator[NDArray[np.float64]]] = [iter(())] * n
        self._known: list[dict[int, tuple[SteppedFlight, SavedFlight]]] = [{} for _ in range(n)]
        self._flying: list[Batched] = []
        self._addresses = np.zeros(n, np.int64)
        self._shares = [share for share in np.array_split(np.arange(n), threads) if len(share)]
        self._pool = ThreadPoolExecutor(threads) if len(self._shares) > 1 else None
        self._step: Callable[..., None] | None = None

    def reset(self, seeds: Mapping[int, int], most: int = 8) -> None:
        """Begin flights anew.

        Parameters
        ----------
        seeds : mapping of int to int
            Aircraft to seed; the first call names all.
        most : int
            So many flights of an aircraft are kept: one that is flown again begins at once.
        """
        begun = {i: self._begun(i, seed, most) for i, seed in seeds.items()}
        self._flying = [begun.get(i) or self._flying[i] for i in range(self._n)]
        self._addresses = addresses_of(self._flying)
        if self._step is None:
            like = self._flying[0], self._addresses, int(CommandLevel.ACTUATORS), 1
            self._step = direct(step_batch, *like)

    def _begun(self, i: int, seed: int, most: int) -> Batched:
        known = self._known[i]
        if seed in known:
            flight, first = known[seed]
            flight.restore(first)
        else:
            while len(known) >= most:
                del known[next(iter(known))]
            flight = SteppedFlight(self._settings.with_seed(seed))
            known[seed] = flight, flight.save()
        self.truth[i], self.nav[i] = flight.truth, flight.loop.rows.nav
        self.u[i], self.setpoint[i] = flight.u, flight.setpoint
        self._at[i], self._left[i] = 0, 0
        self._drawn[i] = flight.noise()
        return Batched(
            flight.loop, self.setpoint[i], self.u[i], self.truth[i], self.nav[i], self.given[i],
            *flight.way, self._noise[i], self._at[i],
        )  # fmt: skip

    def _draw(self, n_ticks: int) -> None:
        """Random numbers for so many ticks of everyone."""
        for i in np.flatnonzero(self._left < n_ticks):
            rows, first, left = self._noise[i], self._at[i, AT.noise], self._left[i]
            rows[:left] = rows[first : first + left]
            while left < n_ticks:
                drawn = next(self._drawn[i])
                rows[left : left + len(drawn)] = drawn
                left += len(drawn)
            self._at[i, AT.noise], self._left[i] = 0, left

    def step(self, level: CommandLevel, n_ticks: int) -> None:
        """Fly `given` for so many ticks, `MOST_TICKS` at most; whoever is lost stays as it is."""
        self._draw(n_ticks)
        like, code = self._flying[0], self._step
        assert code is not None
        parts = [(like, self._addresses[share], int(level), n_ticks) for share in self._shares]
        if self._pool is None:
            code(*parts[0])
        else:
            list(self._pool.map(lambda part: code(*part), parts))
        self._left -= n_ticks
