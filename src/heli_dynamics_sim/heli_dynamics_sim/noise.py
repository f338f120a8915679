# SPDX-License-Identifier: Apache-2.0
"""Random numbers: one independent stream of standard normals per source, all from one seed.

The njit kernels hold no generator: each tick takes one row. A source's stream does not change when
another source is switched off or draws more.
"""

import numpy as np
from numpy.typing import NDArray

# name and numbers per tick, in the order of the row
_SOURCES = (("wind", 5), ("imu", 12), ("mag", 3), ("baro", 2), ("gps", 9))
# wind 0:5 along, across (2), down (2)
WIND_AT = 0
# imu 5:17 gyro white (3), accelerometer white (3), gyro walk (3), accelerometer walk (3)
IMU_AT = 5
# mag 17:20 white (3)
MAG_AT = 17
# baro 20:22 white, drift
BARO_AT = 20
# gps 22:31 position white (3), velocity white (3), drift (3)
GPS_AT = 22
N_NOISE = 31


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
        children = np.random.SeedSequence(seed).spawn(2 * len(_SOURCES))
        half = len(_SOURCES)
        self._streams = [np.random.default_rng(child) for child in children[:half]]
        self._initial = [np.random.default_rng(child) for child in children[half:]]

    @staticmethod
    def _draw(streams: list[np.random.Generator], n: int) -> NDArray[np.float64]:
        parts = [
            stream.standard_normal((n, size))
            for stream, (_, size) in zip(streams, _SOURCES, strict=True)
        ]
        return np.hstack(parts)

    def rows(self, n: int) -> NDArray[np.float64]:
        """The next n rows (n, N_NOISE); n calls of `row` give exactly the same."""
        return self._draw(self._streams, n)

    def row(self) -> NDArray[np.float64]:
        """The next row (N_NOISE,)."""
        return self._draw(self._streams, 1)[0]

    def initial_rows(self, n: int) -> NDArray[np.float64]:
        """n rows (n, N_NOISE) for the state before the first tick, from streams of their own."""
        return self._draw(self._initial, n)
