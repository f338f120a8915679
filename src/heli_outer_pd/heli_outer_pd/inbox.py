# SPDX-License-Identifier: Apache-2.0
"""What the outer loop has heard of the navigation; its stamp says how old it is."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.jit import by_reference, copy, fill, njit
from heli_core.rows import NAV
from heli_core.ticks import Rate

_NEVER = -(2**62)


@by_reference
class LatestNavigation(NamedTuple):
    """The newest navigation row, changed in place."""

    nav: np.ndarray  # (31,)
    tick: np.ndarray  # (1,) int64, of its stamp


def no_navigation() -> LatestNavigation:
    """Before the first message."""
    return LatestNavigation(np.full(NAV.size, np.nan), np.full(1, _NEVER, np.int64))


@njit
def keep_newest(heard, stamp, nav):
    """Keep a navigation row (31,) stamped with a tick, if it is newer than the last one."""
    if stamp > heard.tick[0]:
        copy(heard.nav, nav)
        heard.tick[0] = stamp


@njit
def navigation_at(heard, tick, timeout_ticks, tick_s, out):
    """The newest row, its position carried on by its velocity, into out (31,); NaN if too old.

    Attitude and velocity stay as they were heard. True if it is of another tick, or none.
    """
    age = tick - heard.tick[0]
    if not 0 <= age <= timeout_ticks:
        fill(out, np.nan)
        return True
    copy(out, heard.nav)
    if age > 0:
        pos, vel = out[NAV.pos], out[NAV.vel]
        for i in range(pos.shape[0]):
            pos[i] += age * tick_s * vel[i]
    return age > 0


class LateNavigation:
    """The navigation of a node, whose kernels are loaded before the first tick.

    Parameters
    ----------
    timeout_s : float
        Age of navigation that is none any more.
    rate : Rate
        Of the ticks.
    """

    def __init__(self, timeout_s: float, rate: Rate) -> None:
        self._oldest, self._tick_s = max(1, rate.ticks_in(timeout_s)), rate.tick_s
        self.forget()
        spare = np.full(NAV.size, np.nan)
        keep_newest(self._heard, 0, spare)
        self.fill(0, spare)
        self.forget()

    def forget(self) -> None:
        """Another flight: nothing has been heard."""
        self._heard = no_navigation()

    def hear(self, stamp: int, nav: NDArray[np.float64] | None) -> None:
        """A row (31,) stamped with a tick has come; None: it has not."""
        if nav is not None:
            keep_newest(self._heard, stamp, nav)

    def fill(self, tick: int, out: NDArray[np.float64]) -> bool:
        """Navigation at a tick into out (31,); whether it is of another tick, or none."""
        return navigation_at(self._heard, tick, self._oldest, self._tick_s, out)
