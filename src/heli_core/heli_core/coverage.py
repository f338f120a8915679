# SPDX-License-Identifier: Apache-2.0
"""How much of what is judged a record holds: whoever judges a record says so, by this alone.

A figure of a stretch says something of the stretch only if the record has it. So each judge asks
here, names the share, and lets nothing pass as whole that has a gap.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_core.ticks import TICK_S

A_FEW = 5
"""Periods in a row that may be missing: a message or two that are late are no gap."""

Span = tuple[float, float]
"""Begin and end, s; the end is excluded."""


@dataclass(frozen=True)
class Coverage:
    """What of the stretches that are judged a record holds.

    Attributes
    ----------
    spans_s : tuple of (float, float)
        Begin and end of each stretch that was asked for, s, the end excluded; none: nothing was.
    held_s : float
        How much of their length is recorded, s.
    gap_s : (float, float) or None
        Begin and end of the first gap, s.
    """

    spans_s: tuple[Span, ...] = ()
    held_s: float = 0.0
    gap_s: Span | None = None

    @property
    def asked_s(self) -> float:
        """Length of all stretches, s."""
        return math.fsum(end - begin for begin, end in self.spans_s)

    @property
    def share(self) -> float:
        """How much of what was asked for is recorded, 0 to 1; 1 of nothing."""
        return 1.0 if self.is_whole else self.held_s / self.asked_s

    @property
    def is_whole(self) -> bool:
        """True if there is no gap."""
        return self.gap_s is None

    @property
    def sentence(self) -> str:
        """What is missing, one sentence without its full stop; empty if nothing is."""
        if self.gap_s is None:
            return ""
        begin, end = self.gap_s
        # Rounded down: what has a gap is never called whole.
        percent = math.floor(1000.0 * self.share) / 10.0
        return (
            f"{percent:g} % of {words(self.spans_s)} is recorded; the first gap is from "
            f"{begin:.2f} to {end:.2f} s"
        )

    def as_dict(self) -> dict[str, object]:
        """For JSON."""
        return {
            "share": self.share,
            "spans_s": [list(span) for span in self.spans_s],
            "first_gap_s": None if self.gap_s is None else list(self.gap_s),
        }


def coverage_of(
    time_s: ArrayLike,
    spans_s: Iterable[Sequence[float]],
    period_s: float = TICK_S,
    few: int = A_FEW,
) -> Coverage:
    """What of some stretches is recorded.

    Parameters
    ----------
    time_s : (N,) array_like
        Times of what was recorded, s, in any order; what is not finite counts for nothing.
    spans_s : iterable of (float, float)
        Begin and end of each stretch, s, the end excluded. Where two overlap they are one.
    period_s : float
        From one sample to the next, s; each stands for so long.
    few : int
        More than so many of them without a sample are a gap; 0 for whom every sample counts.

    Returns
    -------
    Coverage
    """
    times = np.unique(np.asarray(time_s, dtype=np.float64))
    times = times[np.isfinite(times)]
    spans = _joined(spans_s)
    gaps = [gap for span in spans for gap in _gaps(times, span, period_s, few)]
    asked = math.fsum(end - begin for begin, end in spans)
    held = max(0.0, asked - math.fsum(end - begin for begin, end in gaps))
    return Coverage(spans, held, gaps[0] if gaps else None)


def period_of(time_s: NDArray[np.float64]) -> float:
    """Period of a record that says nothing of it, s: the median of its steps; a tick of none."""
    steps = np.diff(np.unique(time_s))
    return float(np.median(steps)) if steps.size else TICK_S


def least(coverages: Iterable[Coverage]) -> Coverage:
    """That of the smallest share; of none nothing was asked, which is whole."""
    return min(coverages, key=lambda one: one.share, default=Coverage())


def words(spans_s: Iterable[Sequence[float]]) -> str:
    """Stretches in words: 0 to 60 s, or 5 to 18 s and 25 to 60 s; empty of none."""
    return " and ".join(f"{begin:g} to {end:g} s" for begin, end in spans_s)


def _joined(spans_s: Iterable[Sequence[float]]) -> tuple[Span, ...]:
    """Stretches in order, those that overlap as one, those without length left out."""
    joined: list[Span] = []
    for begin, end in sorted((float(begin), float(end)) for begin, end in spans_s):
        if joined and begin <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(joined[-1][1], end)
        elif end > begin:
            joined.append((begin, end))
    return tuple(joined)


def _gaps(times: NDArray[np.float64], span: Span, period_s: float, few: int) -> list[Span]:
    begin, end = span
    # Half a period: times of whole ticks, rounded, are inside or outside beyond doubt.
    inside = times[(times > begin - 0.5 * period_s) & (times < end - 0.5 * period_s)]
    since, until = np.r_[begin, inside + period_s], np.r_[inside, end]
    gaps = np.flatnonzero(until - since > (few + 0.5) * period_s)
    return [(float(since[i]), float(until[i])) for i in gaps]
