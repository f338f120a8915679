# SPDX-License-Identifier: Apache-2.0
"""A sweep whose flights cost nothing, in a module that worker processes can import."""

import os
from typing import NamedTuple

from evidence.sweep import over


class Figures(NamedTuple):
    """What a flight shows, and which process flew it."""

    label: str
    share: float
    process: int


@over(world=("paper", "honest"), gps=("rtk", "standalone"), variant=(0.1, 0.3))
def flown(world: str, gps: str, variant: float, seed: int) -> Figures:
    """Figures that follow from the arguments alone, but for the process."""
    return Figures(f"{world} {gps} {variant} {seed}", variant / 3.0 * seed, os.getpid())
