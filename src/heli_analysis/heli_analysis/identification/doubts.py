# SPDX-License-Identifier: Apache-2.0
"""What a fit tells against the structure that was chosen for it.

A state too many shows as a pole that the data cannot place: a disc faster than what is excited, a
yaw gyro whose gain is not told from zero. A state too few shows as a response that the model does
not explain beyond the noise, if the excitation reaches where that state acts: a slow gyro or a fast
disc hides in servos, delay and damping, and nothing is seen then.
"""

import enum

from heli_analysis.identification.actuators import IdentifiedAB
from heli_analysis.identification.structure import FLAPPING, STATE, Rotor

FASTEST_FLAPPING_1PS = 150.0
"""A disc beyond it follows at once for the excitation, which ends below 60 rad/s."""
LEAST_SIGMAS = 3.0
MOST_UNEXPLAINED = 0.01
"""Of the responses' RMS: the right structure leaves nothing beyond the noise."""


class StructureDoubt(enum.Enum):
    """What speaks against a structure."""

    UNEXPLAINED = "responses hold more than the structure explains: a state may be missing"
    NO_FLAPPING = "no lag of the rotor is seen: quasi_static_rotor may be enough"
    NO_GYRO = "the yaw gyro's gain is not told from zero: there may be none"


def structure_doubts(identified: IdentifiedAB) -> tuple[StructureDoubt, ...]:
    """All that speak against the structure of a fit; empty: nothing does."""
    found, structure, fast = [], identified.structure, identified.fast
    if identified.estimate.distortion > MOST_UNEXPLAINED:
        found.append(StructureDoubt.UNEXPLAINED)
    if structure.rotor is Rotor.FULL:
        rate = float(-fast.A[STATE.a_s, STATE.a_s])
        if rate > FASTEST_FLAPPING_1PS or rate < LEAST_SIGMAS * identified.sigma[FLAPPING]:
            found.append(StructureDoubt.NO_FLAPPING)
    if structure.yaw_gyro:
        gain = float(fast.A[STATE.r, STATE.d_int])
        if abs(gain) < LEAST_SIGMAS * identified.sigma["A(r,d_int)"]:
            found.append(StructureDoubt.NO_GYRO)
    return tuple(found)
