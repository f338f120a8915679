# SPDX-License-Identifier: Apache-2.0
"""Several aircraft in one world: how many, and the seed of each."""

from numpy.random import SeedSequence

MOST_AIRCRAFT = 9
"""Of more, one machine's ROS domain could not hold the participants."""


def seed_of(seed: int, number: int) -> int:
    """Seed of an aircraft (0 is the first) of a flight of several: independent of one another.

    It does not depend on how many fly, so that each can be flown again alone.
    """
    (own,) = SeedSequence(seed).spawn(number + 1)[number].generate_state(1)
    # Parameters are signed.
    return int(own) >> 1
