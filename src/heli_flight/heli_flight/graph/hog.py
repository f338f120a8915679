# SPDX-License-Identifier: Apache-2.0
"""A process that takes all the time of a core that it gets, until it is killed."""

import os
from collections.abc import Sequence


def main(arguments: Sequence[str]) -> int:
    """Be busy while the parent lives; it kills this process."""
    parent = os.getppid()
    while os.getppid() == parent:
        sum(range(100_000))
    return 0
