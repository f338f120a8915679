# SPDX-License-Identifier: Apache-2.0
"""What explains the spread of a figure over a campaign's flights: rank correlations."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

_FEWEST = 8
"""Flights below which nothing is said."""


@dataclass(frozen=True)
class Influence:
    """Of one input on one figure.

    Attributes
    ----------
    name : str
        Of the input.
    rank_correlation : float
        Spearman's, -1 to 1. Of an input of names (a choice): the square root of the share of the
        ranks' variance that lies between them, 0 to 1. NaN if one of the two does not vary.
    p_value : float
        Of a correlation as large by chance (of names: Kruskal and Wallis's test).
    """

    name: str
    rank_correlation: float
    p_value: float


def influences(
    inputs: Mapping[str, Sequence[object]], figure: NDArray[np.float64]
) -> list[Influence]:
    """Of each input, the strongest first; none of fewer than eight flights.

    Parameters
    ----------
    inputs : mapping
        Name to one value a flight.
    figure : (N,) array
        NaN where a flight has none.
    """
    known = np.isfinite(figure)
    if known.sum() < _FEWEST:
        return []
    found = []
    for name, column in inputs.items():
        values = [value for value, good in zip(column, known, strict=True) if good]
        of_one = _of_names if isinstance(values[0], str) else _of_numbers
        found.append(Influence(name, *of_one(values, figure[known])))
    return sorted(found, key=_strength, reverse=True)


def _strength(influence: Influence) -> float:
    rho = influence.rank_correlation
    return abs(rho) if math.isfinite(rho) else -1.0


def _of_numbers(values: Sequence[object], figure: NDArray[np.float64]) -> tuple[float, float]:
    numbers = np.array(values, dtype=float)
    if np.ptp(numbers) == 0.0 or np.ptp(figure) == 0.0:
        return math.nan, math.nan
    found = stats.spearmanr(numbers, figure)
    return float(found.statistic), float(found.pvalue)


def _of_names(values: Sequence[object], figure: NDArray[np.float64]) -> tuple[float, float]:
    named = np.array(values)
    groups = [figure[named == name] for name in sorted(set(values), key=str)]
    if len(groups) < 2 or np.ptp(figure) == 0.0:
        return math.nan, math.nan
    ranks = stats.rankdata(figure)
    between = sum(
        len(own) * (own.mean() - ranks.mean()) ** 2
        for own in (ranks[named == name] for name in sorted(set(values), key=str))
    )
    share = between / float(((ranks - ranks.mean()) ** 2).sum())
    return math.sqrt(share), float(stats.kruskal(*groups).pvalue)


def explained(inputs: Mapping[str, Sequence[object]], figure: NDArray[np.float64]) -> float:
    """Share of the variance of a figure's ranks that the inputs' ranks explain, linearly together.

    Adjusted for the number of inputs (Ezekiel 1930), at least 0; NaN of too few flights. The rest
    is what the seed draws, wind and noise, and what is not monotonic.
    """
    known = np.isfinite(figure)
    columns = []
    for column in inputs.values():
        values = np.array([v for v, good in zip(column, known, strict=True) if good])
        if values.dtype.kind in "US":
            columns += [values == name for name in np.unique(values)[1:]]
        elif np.ptp(values.astype(float)) > 0.0:
            columns.append(stats.rankdata(values.astype(float)))
    count, ranks = int(known.sum()), stats.rankdata(figure[known])
    free = count - len(columns) - 1
    if count < _FEWEST or free < 1 or not columns or np.ptp(ranks) == 0.0:
        return math.nan
    matrix = np.column_stack([np.ones(count), *columns]).astype(float)
    rest = ranks - matrix @ np.linalg.lstsq(matrix, ranks, rcond=None)[0]
    left = float(rest @ rest) / float(((ranks - ranks.mean()) ** 2).sum())
    return max(0.0, 1.0 - left * (count - 1) / free)
