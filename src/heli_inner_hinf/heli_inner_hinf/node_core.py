# SPDX-License-Identifier: Apache-2.0
"""What the node `inner_loop` has while it is configured, and while it is active."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from heli_inner_hinf.attitude_disturbance import PLACES
from heli_inner_hinf.design import LiveDesign
from heli_inner_hinf.estimate import (
    EstimateKernel,
    EstimateState,
)
from heli_inner_hinf.excitation import (
    ExcitationKernel,
    ExcitationStatus,
)
from heli_inner_hinf.ground_law import law_or_hand
from heli_inner_hinf.law_state import AttitudeKernel
from heli_inner_hinf.own_law import OwnAttitudeLaw
from heli_math.rows import ACTUATOR, NINE
from heli_math.sweep import SweepKernel, add_sweep
from heli_msgs_bridge.tick_node import Send, TickCore


@dataclass
class Exciter:
    """Excitation for identification; its topic exists only while one is configured."""

    kernel: ExcitationKernel
    send: Send
    state: np.ndarray
    status: ExcitationStatus = ExcitationStatus.SILENT


@dataclass
class Disturber:
    """What is added to the measured attitude; its topic exists only while a sweep is configured."""

    kernel: SweepKernel
    send: Send
    tick_s: float
    added: np.ndarray = field(default_factory=lambda: np.zeros(len(NINE)))

    def disturb(self, tick: int, stamp_ns: int, x9: np.ndarray) -> None:
        """Add the sweep of this tick to the angles among the states (9,) and publish it."""
        self.added[:] = 0.0
        add_sweep(tick * self.tick_s, self.kernel, self.added)
        x9 += self.added
        self.send(self.added[list(PLACES)], stamp_ns)


@dataclass(kw_only=True)
class Loop(TickCore):
    """What the inner loop has while it is configured.

    Attributes
    ----------
    design : LiveDesign
        Law and its state.
    exciter : Exciter or None
    disturber : Disturber or None
    collective : float
        As the outer loop sent it last; before that, the trim's.
    model, known : EstimateKernel, EstimateState
        The newest estimate, and what carries it on to now.
    flown_tick : int or None
        Tick of the last command that was sent.
    x9, u3 : arrays
        Estimate and output of the law.
    hand3 : (3,) array
        A pilot's deflections, flown in place of the law; NaN for none.
    total : (4,) array
        Last command that was sent.
    flown : AttitudeKernel or None
        Numbers that `law` is compiled for.
    law : callable
        `law_or_hand`, compiled.
    own : OwnAttitudeLaw
        Its place, taken by one in Python or by none.
    """

    design: LiveDesign
    send: Send
    exciter: Exciter | None
    disturber: Disturber | None
    collective: float
    model: EstimateKernel
    known: EstimateState
    flown_tick: int | None = None
    x9: np.ndarray = field(default_factory=lambda: np.full(len(NINE), np.nan))
    u3: np.ndarray = field(default_factory=lambda: np.zeros(3))
    hand3: np.ndarray = field(default_factory=lambda: np.full(3, np.nan))
    total: np.ndarray = field(default_factory=lambda: np.zeros(ACTUATOR.size))
    flown: AttitudeKernel | None = None
    law: Callable[..., int] = law_or_hand
    own: OwnAttitudeLaw = field(default_factory=lambda: OwnAttitudeLaw(None))


@dataclass
class Holding:
    """What the inner loop has while it is active.

    Attributes
    ----------
    r3 : (3,) array
        Setpoint, rad; at first the trim attitude and the heading that will be found.
    setpoint_tick : int or None
        Stamp of the setpoint; None: nobody has sent one.
    first : bool
        True until a step has been made.
    resumes : bool
        True while the flight is to be taken over from the command that is flown.
    """

    r3: np.ndarray
    setpoint_tick: int | None = None
    first: bool = True
    resumes: bool = False
