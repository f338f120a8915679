# SPDX-License-Identifier: Apache-2.0
"""An attitude that messages command, and who leads: they or a pilot's sticks. No ROS."""

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from heli_math.rows import SETPOINT
from heli_outer_pd.reference_limits import ReferenceRefused

Array = NDArray[np.float64]

_MOVED = 0.1
"""A stick that is so far from where it was when messages began to lead takes over, of 1."""
_ROUNDING_RAD = 1e-6
"""What a quaternion may lose of an angle."""


class _Patience(Protocol):
    """How long silence may last."""

    @property
    def timeout_ns(self) -> int:
        """Without a message."""


class Asked(NamedTuple):
    """What messages command.

    Attributes
    ----------
    attitude : (3,) array
        Roll, pitch, heading, NED, rad.
    heard_ns : int or None
        Stamp at which it was heard.
    climb_mps : float
    climb_ns : int or None
        Stamp at which that was heard.
    leads : bool
        Whether this is flown in mode attitude, and not the sticks.
    rest : (4,) array or None
        The sticks as they were when this began to lead, once they are heard.
    """

    attitude: Array
    heard_ns: int | None = None
    climb_mps: float = 0.0
    climb_ns: int | None = None
    leads: bool = False
    rest: Array | None = None

    def is_silent(self, now_ns: int, n: _Patience) -> bool:
        """Whether no attitude has been heard for too long."""
        return self.heard_ns is None or now_ns - self.heard_ns > n.timeout_ns

    def climb_at(self, now_ns: int, timeout_ns: int, most_mps: float) -> float:
        """Speed of the climb, m/s, cut to the largest; none once it is not renewed."""
        if self.climb_ns is None or now_ns - self.climb_ns > timeout_ns:
            return 0.0
        return min(max(self.climb_mps, -most_mps), most_mps)

    def beside(self, sticks: Array) -> "Asked":
        """With sticks (4,) heard meanwhile: one that has been moved takes over."""
        if self.rest is None:
            return self._replace(rest=sticks)
        moved = float(np.abs(sticks - self.rest).max()) > _MOVED
        return self._replace(leads=not moved)


NOTHING = Asked(np.zeros(3))
"""Never heard."""


def judged(attitude_rad: Array, hover_rad: Array, most_rad: float) -> Array:
    """An attitude (3,) that may be commanded.

    Parameters
    ----------
    attitude_rad : (3,) array
        Roll, pitch, heading.
    hover_rad : (2,) array
        Roll and pitch of hover.
    most_rad : float
        How far off these the first two may be.

    Raises
    ------
    ReferenceRefused
        A number is not finite, or it is tilted more.
    """
    if attitude_rad.shape != (3,) or not np.isfinite(attitude_rad).all():
        raise ReferenceRefused(f"attitude {attitude_rad.tolist()} rad; allowed: three numbers")
    tilt = attitude_rad[: SETPOINT.psi]
    if (np.abs(tilt - hover_rad) > most_rad + _ROUNDING_RAD).any():
        given = np.degrees(tilt)
        low, high = np.degrees(hover_rad - most_rad), np.degrees(hover_rad + most_rad)
        raise ReferenceRefused(
            f"roll {given[0]:z.1f} deg, pitch {given[1]:z.1f} deg nose up; allowed: roll "
            f"{low[0]:.1f} to {high[0]:.1f} deg, pitch {low[1]:.1f} to {high[1]:.1f} deg, which "
            f"are {math.degrees(most_rad):g} deg off hover's"
        )
    return attitude_rad
