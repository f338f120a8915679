# SPDX-License-Identifier: Apache-2.0
"""Gains of one axis of the position loop, searched: least error under a floor on the margins.

The cost is the sum of the squares of position's and speed's standard deviation in units of what is
wanted of each, over the axis as modelled and its `others` (later, lighter, less damped). Every one
of them must keep its margin's floor. The search is that of `heli_math.grid_search`, which ends at
the same gains on every machine.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from heli_math.grid_search import search
from heli_outer_pd.axis_analysis import Axis, Gains, deviations, disk_margin, open_loop

# K_P, K_D, bandwidth of the observer, lead: what parameters allow, and where the search begins.
_BOUNDS = (20.0, 20.0, 7.5, 1.0)
_STARTS_LED = ((0.43, 1.1, 0.3, 0.3), (1.0, 2.2, 1.0, 0.3))
_STARTS = ((3.0, 4.7, 1.6, 0.0), (6.2, 6.2, 3.0, 0.0))


class NoGainsError(ValueError):
    """No gains of the grid keep the margins; the message says of which axis and by how much."""


@dataclass(frozen=True)
class Wanted:
    """What the gains of an axis are chosen for.

    Attributes
    ----------
    position_m, speed_mps : float
        Units of the cost.
    disk_margin : float
        Floor of the axis as modelled.
    disk_margin_of_others : float
        Floor of each of the others.
    """

    position_m: float
    speed_mps: float
    disk_margin: float
    disk_margin_of_others: float


def gains_at(values: Sequence[float], damping: float, lead_filter_s: float) -> Gains:
    """Gains of K_P, K_D, the observer's bandwidth and the lead."""
    K_P, K_D, bandwidth, lead_s = values
    return Gains(K_P, K_D, 2.0 * damping * bandwidth, bandwidth**2, lead_s, lead_filter_s)


def cost(gains: Gains, axis: Axis, others: Sequence[Axis], wanted: Wanted) -> float:
    """Of the gains, inf where a margin is below its floor or a loop unstable."""
    floors = [wanted.disk_margin] + [wanted.disk_margin_of_others] * len(others)
    total = 0.0
    for one, floor in zip((axis, *others), floors, strict=True):
        if not disk_margin(open_loop(one, gains)[1]) >= floor:
            return np.inf
        rms = deviations(one, gains)
        if rms is None:
            return np.inf
        total += (rms[0] / wanted.position_m) ** 2 + (rms[1] / wanted.speed_mps) ** 2
    return float(total / len(floors))


def best_gains(
    name: str,
    axis: Axis,
    others: Sequence[Axis],
    wanted: Wanted,
    damping: float,
    lead_filter_s: float,
) -> tuple[float, ...]:
    """K_P, K_D, the observer's bandwidth and the lead (0 without a modelled lag) of an axis.

    Parameters
    ----------
    name : str
        Of the axis, for the error.
    axis, others, wanted
        As of `cost`.
    damping, lead_filter_s : float
        Of the disturbance observer; time constant of the lead's filter.

    Raises
    ------
    NoGainsError
        None of the gains that the search begins with keeps the margins.
    """

    def price(values: Sequence[float]) -> float:
        if any(value > bound for value, bound in zip(values, _BOUNDS, strict=True)):
            return np.inf
        return cost(gains_at(values, damping, lead_filter_s), axis, others, wanted)

    led = axis.modelled_lag_s > 0.0
    found = [search(start, price) for start in (_STARTS_LED if led else _STARTS)]
    best = min(found, key=price)
    if not np.isfinite(price(best)):
        floors = f"{wanted.disk_margin:g} (others {wanted.disk_margin_of_others:g})"
        raise NoGainsError(
            f"position loop, {name}: no gains near those that the search begins with keep a disk "
            f"margin of {floors}: the attitude loop is too slow, or unstable"
        )
    return best
