# SPDX-License-Identifier: Apache-2.0
"""Search for rounded numbers of least price: designs that come out the same on every machine.

It goes along a grid of rounded numbers until no neighbour is better, and a neighbour is better only
if it is so by far more than rounding, or by what is worth a step.
"""

from collections.abc import Callable, Sequence
from itertools import combinations, product

import numpy as np

GRID = (1.0, 1.1, 1.2, 1.3, 1.5, 1.6, 1.8, 2.0, 2.2, 2.4, 2.7, 3.0,
        3.3, 3.6, 3.9, 4.3, 4.7, 5.1, 5.6, 6.2, 6.8, 7.5, 8.2, 9.1)  # fmt: skip
"""One decade of the E24 series of IEC 60063."""
STRIDES = (4, 2, 1)
"""Places of the grid by which a search goes, the coarsest first."""

BETTER = 1e-4
"""Share of the price that a step must save."""

_Steps = tuple[int | None, ...]


def on_grid(step: int) -> float:
    """The number `step` places above 1 on the grid."""
    decade, place = divmod(step, len(GRID))
    return float(f"{GRID[place]}e{decade}")


def place_of(value: float) -> int:
    """The place of the number of the grid that is nearest to a positive value, by ratio."""
    decade = int(np.floor(np.log10(value)))
    around = range(decade * len(GRID), (decade + 1) * len(GRID) + 1)
    return min(around, key=lambda step: abs(np.log(on_grid(step) / value)))


def search(
    start: Sequence[float],
    price: Callable[[Sequence[float]], float],
    strides: Sequence[int] = STRIDES,
    pairs: bool = True,
    better: float = BETTER,
) -> tuple[float, ...]:
    """From `start` along the grid to numbers that no neighbour betters; a 0 stays 0.

    Parameters
    ----------
    start : sequence of n floats
        None negative.
    price : callable
        Of n numbers; inf where they are not allowed.
    strides : sequence of int
        By so many places of the grid it goes, one stride after the other.
    pairs : bool
        Neighbours differ in up to two numbers, else in one.
    better : float
        Share of the price that a step must save.
    """
    at = tuple(place_of(value) if value > 0.0 else None for value in start)
    known: dict[_Steps, float] = {}

    def values(steps: _Steps) -> tuple[float, ...]:
        return tuple(0.0 if step is None else on_grid(step) for step in steps)

    def priced(steps: _Steps) -> float:
        if steps not in known:
            known[steps] = price(values(steps))
        return known[steps]

    moves = _moves([i for i, step in enumerate(at) if step is not None], len(at), pairs)
    for size in strides:
        while True:
            around = [_moved(at, move, size) for move in moves]
            best = min(around, key=priced)
            if not priced(best) < priced(at) * (1.0 - better):
                break
            at = best
    return values(at)


def _moved(at: _Steps, move: tuple[int, ...], size: int) -> _Steps:
    ways = zip(at, move, strict=True)
    return tuple(None if step is None else step + size * way for step, way in ways)


def _moves(places: Sequence[int], n: int, pairs: bool) -> list[tuple[int, ...]]:
    """One of n numbers up or down, or two of them together."""
    eye = np.eye(n, dtype=int)
    ones = [sign * eye[i] for i in places for sign in (1, -1)]
    twos = [
        a * eye[i] + b * eye[j]
        for i, j in combinations(places, 2)
        for a, b in product((1, -1), repeat=2)
    ]
    return [tuple(int(step) for step in move) for move in (*ones, *(twos if pairs else ()))]
