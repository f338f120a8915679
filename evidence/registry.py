# SPDX-License-Identifier: Apache-2.0
"""Which command makes which result file, and which function renders which table.

Each file of `evidence/experiments` registers what it flies (`produces`) and how it is told
(`table`); `load` imports them all.
"""

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from heli_core.rcl_yaml import ParameterError

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
    needs : str
        What it imports that set-up does not install; empty: nothing.
    """

    name: str
    command: str
    what: str
    seeds: tuple[int, ...] = ()
    relative: float = FLIGHT
    loose: Mapping[str, float] = field(default_factory=dict)
    needs: str = ""


PRODUCERS: dict[str, Producer] = {}
"""By name; filled by `load`."""
TABLES: dict[str, Callable[[Any], str]] = {}
"""What a Markdown file can hold between `results` markers: a table of `files.Results`, by name."""


def produces(*words: Any, **options: Any) -> None:
    """Register a result file; arguments as of `Producer`."""
    producer = Producer(*words, **options)
    PRODUCERS[producer.name] = producer


def table(name: str) -> Callable[[Callable[[Any], str]], Callable[[Any], str]]:
    """Register a function of `files.Results` that gives the Markdown of a table."""

    def registered(render: Callable[[Any], str]) -> Callable[[Any], str]:
        TABLES[name] = render
        return render

    return registered


def load() -> None:
    """Import every experiment, so that `PRODUCERS` and `TABLES` hold what there is."""
    for file in sorted(Path(__file__).with_name("experiments").glob("*.py")):
        if file.stem != "__init__":
            import_module(f"evidence.experiments.{file.stem}")


def chosen(names: Iterable[str]) -> list[Producer]:
    """Producers by name, all if there are no names; after `load`.

    Raises
    ------
    ParameterError
        A name that is none of them.
    """
    wanted = list(names)
    for name in wanted:
        if name not in PRODUCERS:
            raise ParameterError(f"results: {name!r} is none of {', '.join(sorted(PRODUCERS))}")
    return [PRODUCERS[name] for name in wanted] or [PRODUCERS[name] for name in sorted(PRODUCERS)]
