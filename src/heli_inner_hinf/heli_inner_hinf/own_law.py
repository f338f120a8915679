# SPDX-License-Identifier: Apache-2.0
"""A law given in Python, flown in the place of the attitude law.

It reads x (9,), the states of eq. (10) (places `NINE`, rad and rad/s, absolute), and r (3,), the
commanded phi, theta, psi (places `SETPOINT`, rad, absolute), and gives d_lat, d_lon, d_ped,
absolute, in (-1, 1), every tick. What is around a law stays: on the ground the actuators rest in
trim, a pilot's hand goes before it, its actuators are cut at `actuator_limit`, and where it begins
in flight the difference to what was flown fades.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from heli_inner_hinf.law_state import (
    LAST_R,
    LAST_U,
    LAST_X,
    OFFSET,
    RELAXED,
    RUN,
    AttitudeKernel,
    AttitudeStatus,
)
from heli_parameters.python_law import INNER, LawError, PythonLaw, find

Array = NDArray[np.float64]


class OwnAttitudeLaw:
    """What calls the law once a tick.

    Parameters
    ----------
    law : PythonLaw or None
        Of the inner loop; None: the packaged law flies.
    """

    def __init__(self, law: PythonLaw | None) -> None:
        self.law = law
        self._begins, self._from_trim = True, True

    @property
    def failure(self) -> str:
        """What the law has done wrong in flight, and what is flown; empty for nothing."""
        if self.law is None or not self.law.failure:
            return ""
        return f"{self.law.failure}; the last good command is held"

    def begin(self, in_flight: bool = False) -> None:
        """Another flight, or one that is taken over from what is flown."""
        self._begins, self._from_trim = True, not in_flight

    def step(
        self,
        tick: int,
        time_s: float,
        x9: Array,
        r3: Array,
        collective: float,
        hand3: Array,
        k: AttitudeKernel,
        state: Array,
        u3: Array,
        packaged: Callable[..., int],
    ) -> int:
        """One tick; arguments and outcome as of `ground_law.law_or_hand`, which is `packaged`.

        Where the law has failed the last command is repeated: NOT_FINITE, and `law.failure`.
        """
        if self.law is None:
            return packaged(x9, r3, collective, hand3, k, state, u3)
        stands = (collective - k.ground_collective) * k.ground_side > 0.0
        if stands or np.isfinite(hand3).all():
            self.begin(in_flight=True)
            return packaged(x9, r3, collective, hand3, k, state, u3)
        last = state[LAST_U : LAST_U + 3]
        u3[:] = last
        if not (np.isfinite(x9).all() and np.isfinite(r3).all()):
            return AttitudeStatus.NOT_FINITE
        if self._begins:
            self.law.reset(x9, r3, last, tick, time_s)
        made = self.law.step(x9, r3, tick, time_s)
        if made is None:
            return AttitudeStatus.NOT_FINITE
        offset = state[OFFSET : OFFSET + 3]
        if self._begins:
            offset[:] = 0.0 if self._from_trim else last - made
            self._begins, state[RELAXED] = False, 0.0
        made += offset
        offset *= k.offset_decay
        u3[:] = np.clip(made, -k.limit, k.limit)
        last[:] = u3
        state[LAST_X : LAST_X + 9], state[LAST_R : LAST_R + 3], state[RUN] = x9, r3, 1.0
        return AttitudeStatus.OK if np.array_equal(u3, made) else AttitudeStatus.SATURATED


def own_law(source: str) -> OwnAttitudeLaw:
    """The law of the parameter `own_law`; empty: the packaged one.

    Raises
    ------
    LawError
    """
    if not source:
        return OwnAttitudeLaw(None)
    law = find(source)
    if law.loop != INNER:
        raise LawError(f"law {law.name}: is of the {law.loop} loop; here: the {INNER} loop")
    return OwnAttitudeLaw(law)
