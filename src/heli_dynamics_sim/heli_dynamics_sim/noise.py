# SPDX-License-Identifier: Apache-2.0
"""Random numbers: one independent stream of standard normals per source, all from one seed.

The njit kernels hold no generator: each tick takes one row. A source's stream does not change when
another source is switched off or draws more.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.sensors import NORMALS, PLAIN


class NoiseRow(NamedTuple):
    """Standard normals of a tick (89,), source by source in the order of `_SOURCES`.

    Behind these places stand those of `sensors.PLAIN`: white noise and faults of each.
    """

    wind: slice = slice(0, 5)  # along, across (2), down (2)
    gyro: slice = slice(5, 8)  # white
    accel: slice = slice(8, 11)  # white
    gyro_walk: slice = slice(11, 14)
    accel_walk: slice = slice(14, 17)
    mag: slice = slice(17, 20)  # white
    baro: int = 20  # white
    baro_drift: int = 21
    gps_pos: slice = slice(22, 25)  # white
    gps_vel: slice = slice(25, 28)  # white
    gps_drift: slice = slice(28, 31)
    turn: int = 31  # rotational gust about the wind's axis
    imu_clock: int = 32
    mag_clock: int = 33
    baro_clock: int = 34
    gps_clock: int = 35
    gps_multipath: slice = slice(36, 39)
    gps_satellites: int = 39
    gps_outage: int = 40
    gps_jump: slice = slice(41, 44)
    gps_jump_now: int = 44
    fault: slice = slice(45, 61)  # of faults, for each number that a sensor says
    fault_lost: slice = slice(61, 66)  # whether a sensor's sample is lost by a fault
    gyro2: slice = slice(66, 69)  # of a second IMU, as above
    accel2: slice = slice(69, 72)
    gyro2_walk: slice = slice(72, 75)
    accel2_walk: slice = slice(75, 78)
    imu2_clock: int = 78
    fault_imu2: slice = slice(79, 85)  # as `fault`
    fault_imu2_lost: int = 85
    size: int = NORMALS


class Source(NamedTuple):
    """What a source draws, and from which children of the seed's sequence."""

    size: int  # numbers per tick
    stream: int  # child for the ticks
    start: int  # child for the state before the first tick


NOISE = NoiseRow()
# In the order of the row. A new source takes the next two children: all others keep their numbers,
# and with them every flight that has been flown.
_SOURCES = (
    Source(5, 0, 5),  # wind
    Source(12, 1, 6),  # IMU
    Source(3, 2, 7),  # magnetometer
    Source(2, 3, 8),  # barometer
    Source(9, 4, 9),  # GPS
    Source(1, 10, 11),  # rotational gusts
    Source(4, 13, 14),  # clocks of the sensors
    Source(3, 15, 16),  # multipath
    Source(1, 17, 18),  # satellites
    Source(1, 19, 20),  # outages
    Source(4, 21, 22),  # jumps
    Source(21, 24, 25),  # faults
    Source(20, 26, 27),  # second IMU: errors, clock, faults
    # White noise and faults of each other sensor.
    *(Source(2 * row.numbers + 1, 29 + 2 * i, 30 + 2 * i) for i, row in enumerate(PLAIN)),
)
_GUSTS = 12  # child of the random gusts
_ONCE = 23  # child for what the sensors of a flight draw once
_ONCE_IMU2 = 28  # and for what its second IMU does


def gust_generator(seed: int) -> np.random.Generator:
    """The stream that a flight's random gusts are drawn from, once."""
    return np.random.default_rng(np.random.SeedSequence(seed).spawn(_GUSTS + 1)[_GUSTS])


class NoiseStreams:
    """The streams of one flight.

    Parameters
    ----------
    seed : int
        Not negative. The same seed gives the same numbers, bit for bit.

    Raises
    ------
    ValueError
        If the seed is negative.
    """

    def __init__(self, seed: int) -> None:
        if seed < 0:
            raise ValueError(f"seed {seed} is not allowed; allowed: an integer >= 0")
        last = max(_ONCE_IMU2, *(child for s in _SOURCES for child in (s.stream, s.start)))
        children = np.random.SeedSequence(seed).spawn(last + 1)
        self._streams = [np.random.default_rng(children[s.stream]) for s in _SOURCES]
        self._initial = [np.random.default_rng(children[s.start]) for s in _SOURCES]
        self._once = np.random.default_rng(children[_ONCE])
        self._once_imu2 = np.random.default_rng(children[_ONCE_IMU2])

    @staticmethod
    def _draw(streams: list[np.random.Generator], n: int) -> NDArray[np.float64]:
        parts = [
            stream.standard_normal((n, source.size))
            for stream, source in zip(streams, _SOURCES, strict=True)
        ]
        return np.hstack(parts)

    def rows(self, n: int) -> NDArray[np.float64]:
        """The next n rows (n, 89); n calls of `row` give exactly the same."""
        return self._draw(self._streams, n)

    def row(self) -> NDArray[np.float64]:
        """The next row (89,)."""
        return self._draw(self._streams, 1)[0]

    def initial_rows(self, n: int) -> NDArray[np.float64]:
        """n rows (n, 89) for the state before the first tick, from streams of their own."""
        return self._draw(self._initial, n)

    def once(self, n: int) -> NDArray[np.float64]:
        """n numbers of what stays for a flight (scale factors, iron), from their own stream."""
        return self._once.standard_normal(n)

    def once_imu2(self, n: int) -> NDArray[np.float64]:
        """The same of a second IMU."""
        return self._once_imu2.standard_normal(n)


_DRAWN = 64


def one_by_one(noise: NoiseStreams) -> Iterator[np.ndarray]:
    """The rows of a flight, drawn ahead: many at once take as long as two."""
    while True:
        yield from noise.rows(_DRAWN)
