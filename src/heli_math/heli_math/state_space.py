# SPDX-License-Identifier: Apache-2.0
"""The linear helicopter of eq. (9) and (10) as a system of python-control with named signals.

For analysis: python-control takes seconds to import, so whatever flies does not import this module.
"""

import control
import numpy as np
from numpy.typing import NDArray

from heli_math.state_names import INPUT_NAMES, STATE_NAMES, WIND_NAMES

WIND = tuple(f"wind_{name}" for name in WIND_NAMES)
"""Velocity of the air in body axes as inputs, m/s (`u`, `v`, `w` of E)."""


def hover_system(
    A: NDArray[np.float64], B: NDArray[np.float64], E: NDArray[np.float64], name: str
) -> control.StateSpace:
    """x' = A x + B u + E w, deviations from trim, all states as outputs.

    Parameters
    ----------
    A, B, E : (9, 9), (9, 3), (9, 3) arrays
        SI and rad; states `STATE_NAMES`.
    name : str
        Of the system.

    Returns
    -------
    control.StateSpace
        Inputs d_lat d_lon d_ped, then `WIND`.
    """
    return control.ss(
        A,
        np.hstack([B, E]),
        np.eye(len(STATE_NAMES)),
        np.zeros((len(STATE_NAMES), len(INPUT_NAMES) + len(WIND))),
        name=name,
        states=list(STATE_NAMES),
        inputs=[*INPUT_NAMES, *WIND],
        outputs=list(STATE_NAMES),
    )
