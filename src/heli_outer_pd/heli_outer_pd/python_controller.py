# SPDX-License-Identifier: Apache-2.0
"""A controller given in Python, flown in place of the position controller.

It reads x (31,), the navigation row (places `NAV`: position, velocity NED, quaternion, body rates
...), and r (10,), the reference without jumps (places `SHAPED`: position, velocity, acceleration
NED, heading), and gives phi, theta, psi (rad, absolute) and the collective (-1..1), every
`period_ticks`. It flies where the position controller follows a reference in the air. On the
ground, by a pilot's sticks, and without a position the packaged controller goes on, which also runs
beside it, so that wind, modes and failsafes are as they are; where it begins, the difference to
what was flown fades. Roll and pitch are cut at `tilt_limit_deg` off trim.
"""

import math
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from heli_core.inbox import Inbox
from heli_core.python_controller import OUTER, LawError, PythonLaw, find
from heli_core.rotations import wrap_pi
from heli_core.rows import SETPOINT, SHAPED
from heli_core.signals import add_sweep
from heli_core.ticks import NS_PER_S
from heli_outer_pd.manual_controller import count_at_limit
from heli_outer_pd.outer_loop import OuterLoopState, step
from heli_outer_pd.reference import shaped_reference_at, window_of
from heli_outer_pd.state import (
    FLIES,
    MACHINE,
    MEMORY,
    POSITION_VALID,
    ROTOR_DRIVEN,
    OuterParams,
    OuterState,
    OuterStatus,
)

Array = NDArray[np.float64]
_COLLECTIVE_LIMIT = 0.98  # as of the position controller
_FADE_S = 0.5  # as where a pilot hands over


class OwnPositionLaw:
    """What steps the outer loop, with the controller in place of the packaged one.

    Parameters
    ----------
    law : PythonLaw or None
        Of the outer loop; None: the packaged controller flies.
    """

    def __init__(self, law: PythonLaw | None) -> None:
        self.law = law
        self._begins, self._from_trim = True, True
        self._fade, self._reference = np.zeros(SETPOINT.size), np.zeros(SHAPED.size)

    @property
    def failure(self) -> str:
        """What the controller has done wrong in flight, and what is flown; empty for nothing."""
        if self.law is None or not self.law.failure:
            return ""
        return f"{self.law.failure}; the last good command is held"

    def begin(self) -> None:
        """Another flight."""
        self._begins, self._from_trim = True, True

    def step(
        self,
        state: OuterLoopState,
        inbox: Inbox,
        tick: int,
        period_ticks: int,
        time_ns: int,
        times_ns: NDArray[np.int64],
        points: Array,
        k: OuterParams,
        out: Array,
        packaged: Callable[..., int] = step,
    ) -> int:
        """One tick; arguments and outcome as of `outer_loop.step`, which is `packaged`.

        Where the controller has failed the last command is repeated: BAD_REFERENCE, and
        `law.failure`.
        """
        reference = time_ns, times_ns, points
        if self.law is None:
            return packaged(state, inbox, tick, period_ticks, *reference, k, out)
        flown, nav, time_s = state.law, state.nav, tick * state.heard.tick_s
        before = flown.x[MEMORY.command].copy()
        code = packaged(state, inbox, tick, period_ticks, *reference, k, out)
        if code != OuterStatus.OK:
            return code
        if not _leads(flown):
            self._begins, self._from_trim = True, False
            return code
        ref = self._reference
        window_ns = window_of(k, flown)
        shaped_reference_at(time_ns, window_ns, k.heading_lead_s, times_ns, points, ref)
        if self._begins:
            self.law.reset(nav, ref, before, tick, time_s)
        made = self.law.step(nav, ref, tick, time_s)
        if made is None:
            out[:] = flown.x[MEMORY.command] = before
            return OuterStatus.BAD_REFERENCE
        out[:] = flown.x[MEMORY.command] = self._limited(self._faded(made, before, k), k)
        count_at_limit(out[SETPOINT.col], k, flown)
        if k.sweep.shape != 0:
            add_sweep(time_ns / NS_PER_S, k.sweep, out)
        return code

    def _faded(self, made: Array, before: Array, k: OuterParams) -> Array:
        """What is made, and what is left of the difference to who flew before."""
        if self._begins:
            self._fade[:] = 0.0 if self._from_trim else before - made
            self._fade[SETPOINT.psi] = wrap_pi(float(self._fade[SETPOINT.psi]))
            self._begins = False
        made += self._fade
        self._fade *= math.exp(-k.dt_s / _FADE_S)
        return made

    def _limited(self, made: Array, k: OuterParams) -> Array:
        for place in (SETPOINT.phi, SETPOINT.theta):
            low, high = k.trim[place] - k.tilt_limit, k.trim[place] + k.tilt_limit
            made[place] = min(max(made[place], low), high)
        made[SETPOINT.col] = min(max(made[SETPOINT.col], -_COLLECTIVE_LIMIT), _COLLECTIVE_LIMIT)
        return made


def _leads(state: OuterState) -> bool:
    """Whether the controller is called: on a reference, with position and rotor at its speed."""
    known = (
        state.machine[MACHINE.guidance] == FLIES
        and state.machine[MACHINE.position] == POSITION_VALID
    )
    return bool(known and state.machine[MACHINE.rotor] == ROTOR_DRIVEN)


def own_law(source: str) -> OwnPositionLaw:
    """The controller of the parameter `own_law`; empty: the packaged one.

    Raises
    ------
    LawError
    """
    if not source:
        return OwnPositionLaw(None)
    law = find(source)
    if law.loop != OUTER:
        raise LawError(f"controller {law.name}: is of the {law.loop} loop; here: the {OUTER} loop")
    return OwnPositionLaw(law)
