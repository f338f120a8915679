# SPDX-License-Identifier: Apache-2.0
"""One result file and what makes it, and how closely another machine must repeat it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

TWENTY = tuple(range(1, 21))
FLIGHT = 1e-6
"""Relative tolerance of what a flight gives on another processor or with other libraries: rounding
differs there, and the closed loop keeps the difference small (docs/reproducibility.md)."""
MARGIN = 1e-3
"""The same of margins and norms, which are sought on grids."""
FIT = 1e-3
"""The same of what is fitted to flights: an optimiser ends within its own tolerance."""
NOT_COMPARED = math.inf


@dataclass(frozen=True)
class Producer:
    """One result file and what makes it.

    Attributes
    ----------
    name : str
        docs/results/<name>.json.
    command : str
        What is run in the top folder of the checkout; prints JSON to stdout. Exit code 0 or 1: a
        flight outside the paper's figures is a result.
    what : str
        One sentence.
    seeds : tuple of int
        Of wind and sensors; empty if nothing is random.
    relative : float
        Largest relative difference between a file and a fresh run on another kind of processor or
        with other versions. With the same ones every number must be the same, bit for bit.
    loose : mapping of str to float
        Keys of what depends on the machine's load, with the relative difference allowed in any
        case; inf: has to be there, is not compared.
    """

    name: str
    command: str
    what: str
    seeds: tuple[int, ...] = ()
    relative: float = FLIGHT
    loose: Mapping[str, float] = field(default_factory=dict)
