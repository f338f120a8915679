# SPDX-License-Identifier: Apache-2.0
"""How sure a share of flights is."""

from dataclasses import dataclass

from scipy.special import betaincinv

_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Share:
    """So many flights of all.

    Attributes
    ----------
    hits, flights : int
    """

    hits: int
    flights: int

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the probability behind it (Clopper, Pearson 1934); 0, 1 of no flight."""
        tail, misses = 0.5 * (1.0 - _CONFIDENCE), self.flights - self.hits
        low = float(betaincinv(self.hits, misses + 1, tail)) if self.hits else 0.0
        high = float(betaincinv(self.hits + 1, misses, 1.0 - tail)) if misses else 1.0
        return low, high

    @property
    def words(self) -> str:
        """As a line tells it."""
        low, high = self.interval
        share = self.hits / self.flights if self.flights else 0.0
        told = f"{self.hits} of {self.flights} flights, {share:.1%}"
        return f"{told} ({low:.1%} to {high:.1%} at 95 %)"
