# SPDX-License-Identifier: Apache-2.0
"""What the node `outer_loop` has while it is configured."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from heli_math.rows import NAV, SETPOINT
from heli_math.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.senders import EverSent
from heli_msgs_bridge.tick_node import Send, TickCore
from heli_outer_pd.commands import Commands
from heli_outer_pd.goto import Goto
from heli_outer_pd.late import LateNavigation
from heli_outer_pd.outer_state import OuterKernel
from heli_outer_pd.own_law import OwnPositionLaw
from heli_outer_pd.reference_limits import ReferenceLimits

COMMANDS = (topics.REFERENCE, topics.GOTO, topics.COMMAND_POSE)
"""Topics on which references and goals come."""
UNHEARD = topics.BY_NAME[topics.REFERENCE].kept
"""References of its own that may be under way to itself."""
# References that diagnostics name; once a second is often enough for those of a loaded recorder.
_TOLD = 16


@dataclass(kw_only=True)
class Law(TickCore):
    """What the outer loop has while it is configured.

    Attributes
    ----------
    commands : Commands
        What pilots ask, done or refused.
    kernel : OuterKernel
        Numbers of the law; swapped when parameters change.
    state : array
        State of the law.
    limits : ReferenceLimits
        What a reference may ask for.
    goto : Goto
        How a goto is flown.
    given : Trajectory or None
        The reference, once it has come.
    way : Trajectory or None
        What is followed of it: itself, or from where the law has engaged.
    offset_ned_m : (3,) array or None
        From `given` to `way`; None until the law has engaged.
    home_ned_m : (3,) array or None
        Where the first reference began, or the first position that was held without one.
    heard : LateNavigation
    nav, out : arrays
        Navigation row of this tick and what the law makes of it.
    commanders : dict of EverSent
        Per topic of commands who sends them, or has sent one.
    tell_way : callable
        Sends a way that is followed as a reference.
    own : deque of int
        References of this node that it has not yet heard back, each by its key.
    followed : deque of int
        Those of others that were followed.
    ways : deque of (int, int)
        Of both the newest, each with the stamp from which it counts, ns, before its key.
    repeated : list of int
        Of those, what a predecessor has heard and this node will hear once more.
    armed : bool
        Whether a take-off is obeyed.
    flies : OwnPositionLaw
        The law's place, taken by one in Python or by none.
    """

    commands: Commands
    kernel: OuterKernel
    state: np.ndarray
    send_attitude: Send
    send_collective: Send
    tell_way: Callable[[Any], None]
    limits: ReferenceLimits
    goto: Goto
    heard: LateNavigation
    given: Trajectory | None = None
    way: Trajectory | None = None
    offset_ned_m: np.ndarray | None = None
    home_ned_m: np.ndarray | None = None
    nav: np.ndarray = field(default_factory=lambda: np.full(NAV.size, np.nan))
    out: np.ndarray = field(default_factory=lambda: np.zeros(SETPOINT.size))
    commanders: dict[str, EverSent] = field(
        default_factory=lambda: {t: EverSent() for t in COMMANDS}
    )
    own: deque[int] = field(default_factory=lambda: deque(maxlen=UNHEARD))
    followed: deque[int] = field(default_factory=lambda: deque(maxlen=UNHEARD))
    ways: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=_TOLD))
    repeated: list[int] = field(default_factory=list)
    armed: bool = True
    flies: OwnPositionLaw = field(default_factory=lambda: OwnPositionLaw(None))
