# SPDX-License-Identifier: Apache-2.0
"""Past states for browsers that join late: thinned, bounded, the whole flight. No ROS."""

MAX_ROWS = 1200
_FIRST_PERIOD_S = 0.1


class History:
    """State rows, ready as JSON texts, at most ten a second and at most `limit`.

    When it is full, every second row is dropped and the spacing doubles, so that it always covers
    the flight from its beginning.
    """

    def __init__(self, limit: int = MAX_ROWS) -> None:
        self._limit = limit
        self.clear()

    def clear(self) -> None:
        """Forget the flight."""
        self._period_s = _FIRST_PERIOD_S
        self._next_s = -float("inf")
        self.rows: list[str] = []

    def wants(self, time_s: float) -> bool:
        """True if a row of this flight time is to be kept."""
        return time_s >= self._next_s

    def add(self, time_s: float, row: str) -> None:
        """Keep a row (JSON text) of a flight time (s)."""
        if len(self.rows) >= self._limit:
            self.rows = self.rows[::2]
            self._period_s *= 2.0
        self.rows.append(row)
        self._next_s = time_s + self._period_s - 1e-6
