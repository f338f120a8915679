# SPDX-License-Identifier: Apache-2.0
"""Identified models as systems of python-control with named signals.

For analysis and pictures: python-control takes seconds to import, so the fits do not use this
module. What they use (`response.transfer`) is compared with it in the tests.
"""

import control
import numpy as np

from heli_identification.actuators import IdentifiedAB
from heli_identification.experiment import ACTUATORS, RATES
from heli_identification.gusts import IdentifiedE
from heli_identification.places import AIR
from heli_identification.places import RATES as RATE_STATES
from heli_identification.response import FastModel
from heli_math.linear_systems import held, held_late, with_delay_line, with_servos
from heli_math.state_space import WIND, hover_system
from heli_math.ticks import TICK_S

COMMANDS = tuple(f"d_{name}" for name in ACTUATORS)


def identified_system(actuators: IdentifiedAB, gusts: IdentifiedE) -> control.StateSpace:
    """A, B, E of eq. (10), as `heli_math.state_space.hover_system`."""
    return hover_system(actuators.A, actuators.B, gusts.E, "identified")


def sampled_rates(model: FastModel) -> control.StateSpace:
    """p, q, r at the ticks after commands and gusts that are held over a tick, exactly.

    Parameters
    ----------
    model : FastModel

    Returns
    -------
    control.StateSpace
        Inputs `COMMANDS` as sent, then `WIND` (m/s); outputs p, q, r (rad/s); sampled.
    """
    F, G = with_servos(model.A, model.B, model.servo_radps, model.servo_damping)
    A, B = with_delay_line(held_late(F, G, TICK_S, model.delay_s))
    E = np.zeros((F.shape[0], len(WIND)))
    E[: model.E.shape[0]] = model.E[:, AIR.velocity]
    B_wind = np.zeros((A.shape[0], len(WIND)))
    B_wind[: F.shape[0]] = held(F, E, TICK_S)[1]
    return control.ss(
        A,
        np.hstack([B, B_wind]),
        np.eye(A.shape[0])[RATE_STATES],
        np.zeros((len(RATES), len(COMMANDS) + len(WIND))),
        TICK_S,
        inputs=[*COMMANDS, *WIND],
        outputs=list(RATES),
    )
