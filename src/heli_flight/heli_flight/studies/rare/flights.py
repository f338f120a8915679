# SPDX-License-Identifier: Apache-2.0
"""A metric of a flight as a function of the dispersions' normal scores; every row is kept."""

import difflib
import math
import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_flight.errors import FlightError
from heli_flight.loop.scoring import METRICS, TRUTH_LESS_DRIFT, Metric, sources_of
from heli_flight.studies.dispersion.cluster import (
    Rows,
    connected,
    fly_here,
    fly_on,
    tasks,
)
from heli_flight.studies.dispersion.row import CAUSE, FIGURE, NUMBER, Cause
from heli_flight.studies.dispersion.spec import Spec
from heli_flight.studies.rare.points import Points
from heli_math.paper_metrics import POSITIONS
from heli_math.ticks import seconds
from heli_parameters.parameters import ParameterError

Array = NDArray[np.float64]
Fly = Callable[[Spec, Sequence[Sequence[int]]], Iterator[Rows]]
_TASKS = 8


@dataclass(frozen=True)
class Asked:
    """A metric and its bound.

    Attributes
    ----------
    name : str
        As rows name it: altitude (truth).
    metric : Metric
    bound : float
        In the metric's unit: the paper's figure, or another one.
    """

    name: str
    metric: Metric
    bound: float


def asked_of(spec: Spec, name: str, beyond: float | None = None) -> Asked:
    """Find a metric of the spec's flights by its name.

    Raises
    ------
    ParameterError
        There is none of this name, or nothing is scored in so short a flight.
    """
    known = {
        f"{metric.key} ({source})": metric
        for source in sources_of(spec.base.gps)
        for metric in METRICS[spec.base.scenario.kind]
        if source != TRUTH_LESS_DRIFT or metric.key in POSITIONS
    }
    if name not in known:
        near = difflib.get_close_matches(name, known, n=1)
        hint = f"; did you mean {near[0]}?" if near else ""
        raise ParameterError(f"--of {name!r}: unknown{hint}; allowed: {', '.join(known)}")
    end_s = seconds(spec.base.scenario.n_ticks)
    windows = spec.base.scenario.windows_s
    if not any(first < min(last, end_s) for first, last in windows):
        raise ParameterError(f"duration_s: {end_s:g}: ends before anything is scored")
    bound = known[name].paper if beyond is None else beyond
    if not math.isfinite(bound) or bound <= 0.0:
        raise ParameterError(f"--beyond: {bound}; allowed: a number above 0")
    return Asked(name, known[name], bound)


@dataclass
class Flights:
    """Called with scores (n, d) it flies there and gives the metric (n,), +inf if it did not fly.

    A flight that throws, is lost or refused is so beyond every bound; its row says the cause.

    Attributes
    ----------
    spec : Spec
    asked : Asked
    keep : callable
        Is given the rows of a task as they come.
    fly : callable
        From a spec and tasks to rows, in any order.
    told : callable
        Is given the number of flights so far.
    marks : dict
        Further columns of the rows to come.
    """

    spec: Spec
    asked: Asked
    keep: Callable[[Rows], None]
    fly: Fly = fly_here
    told: Callable[[int], None] = lambda flown: None
    marks: dict[str, Any] = field(default_factory=dict)
    scores: list[Array] = field(default_factory=list)
    values: list[Array] = field(default_factory=list)
    causes: dict[str, int] = field(default_factory=dict)

    @property
    def count(self) -> int:
        """Flights of whole calls so far."""
        return sum(map(len, self.scores))

    def __call__(self, scores: Array) -> Array:
        """Fly; the numbers of flights go on where the last call ended."""
        first, values = self.count, np.full(len(scores), np.inf)
        chunk = min(self.spec.chunk, max(1, len(scores) // _TASKS))
        batch = replace(Points.of(self.spec, scores), chunk=chunk)
        flown = 0
        for rows in self.fly(batch, tasks(batch, set())):
            for row in rows:
                values[row[NUMBER]] = self._value(row)
                self.causes[row[CAUSE]] = self.causes.get(row[CAUSE], 0) + 1
            self.keep([{**row, NUMBER: first + row[NUMBER], **self.marks} for row in rows])
            flown += len(rows)
            self.told(first + flown)
        self.scores.append(scores)
        self.values.append(values)
        return values

    def _value(self, row: dict[str, Any]) -> float:
        value = row.get(f"{FIGURE}{self.asked.name}", math.inf)
        flown = row[CAUSE] == Cause.FLOWN and not math.isnan(value)
        return float(value) if flown else math.inf

    def all(self) -> tuple[Points, Array]:
        """All flights so far, to be flown again by number, and their values (N,)."""
        if not self.scores:
            return Points.of(self.spec), np.zeros(0)
        return Points.of(self.spec, np.concatenate(self.scores)), np.concatenate(self.values)


@contextmanager
def flier(workers: int | None, scheduler: str | None) -> Iterator[Fly]:
    """Who flies: this process (0 workers), processes of this machine, or another cluster.

    The cluster stays for all calls.

    Raises
    ------
    ParameterError
        The scheduler cannot be reached.
    """
    many = len(os.sched_getaffinity(0)) if workers is None else workers
    if scheduler is None and many == 0:
        yield fly_here
        return
    with connected(many, scheduler) as client:
        yield partial(_fly_on, client)


def _fly_on(client: Any, spec: Spec, todo: Sequence[Sequence[int]]) -> Iterator[Rows]:
    try:
        yield from fly_on(client, spec, todo)
    except FlightError:
        raise FlightError("the scheduler is gone; what was flown stays") from None
