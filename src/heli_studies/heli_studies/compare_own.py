# SPDX-License-Identifier: Apache-2.0
"""`heli compare controller`: controllers in Python against the packaged ones, on the same seeds.

A controller in Python takes several times as long as a compiled one, so workers share the flights.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich.console import Console

from heli_core.python_controller import OUTER, find, short_name
from heli_core.rcl_yaml import ParameterError
from heli_dynamics_sim.trim import TrimError
from heli_flight.fly import FlightOrder
from heli_flight.layers import ONE_PROCESS
from heli_flight.loop import fly_settings
from heli_flight.result import conditions
from heli_flight.scoring import DECIDES, STRETCHES, TRUTH, Figures
from heli_flight.settings import Settings, own_laws
from heli_flight.terminal import table
from heli_flight.worlds import PACKAGED
from heli_studies.campaign.run import FlownSeed
from heli_studies.campaign.spec import NUMBER
from heli_studies.campaign.workers import flier, tasks
from heli_studies.compare_flights import without_seed

_FLOWN = "flown"


@dataclass(frozen=True)
class NamedLaw:
    """A controller that flies against others.

    Attributes
    ----------
    name : str
        For people.
    settings : Settings
        What it flies.
    own : bool
        Whether it is given in Python: **its code runs**.
    """

    name: str
    settings: Settings
    own: bool


def rivals(
    names: Sequence[str], scenario: str | None, order: Callable[..., FlightOrder]
) -> tuple[NamedLaw, ...]:
    """The packaged controllers, and those that are named.

    Parameters
    ----------
    names : sequence of str
        MODULE:NAME or FILE.py:NAME of a controller in Python, or packaged controllers.
    scenario : str, optional
        What to fly; default: `hover` if one of them is a position controller, which flies there
        only, else `attitude`.
    order : callable
        Makes the order of a flight with what else is flown.

    Raises
    ------
    ParameterError, LawError
        Each with one sentence.
    """
    found = list[NamedLaw]()
    for name in dict.fromkeys((PACKAGED, *names)):
        own = ":" in name
        named = {"law": [name]} if own else {"laws": name}
        settings = order(scenario=scenario or "attitude", mode=ONE_PROCESS, **named).resolved()
        if scenario is None and OUTER in own_laws(settings):
            return rivals(names, "hover", order)
        found.append(NamedLaw(short_name(name) if own else name, settings, own))
    if len(found) < 2:
        raise ParameterError(f"{PACKAGED} flies anyway; name another one, such as my_law.py:MyLaw")
    return tuple(found)


@dataclass(frozen=True)
class PairedFlights:
    """Every rival on every seed: what workers fly (`workers.FlightBatch`)."""

    rivals: Sequence[NamedLaw]
    seeds: Sequence[int]
    chunk: int = 1

    @property
    def count(self) -> int:
        """Flights of it."""
        return len(self.rivals) * len(self.seeds)

    def of(self, number: int) -> tuple[NamedLaw, int]:
        """NamedLaw and seed of a flight."""
        seed, rival = divmod(number, len(self.rivals))
        return self.rivals[rival], self.seeds[seed]

    def fly(self, numbers: Sequence[int]) -> list[dict[str, Any]]:
        """A row of each."""
        return [{NUMBER: n, _FLOWN: _flown(*self.of(n))} for n in numbers]

    def killed(self, number: int) -> dict[str, Any]:
        """The row of a flight that ended its process each time."""
        seed = self.of(number)[1]
        why = "the process that flew it ended each time"
        return {NUMBER: number, _FLOWN: FlownSeed(seed, Figures(), why)}


def _flown(rival: NamedLaw, seed: int) -> FlownSeed:
    settings = rival.settings.with_seed(seed)
    try:
        # Found anew: a controller remembers.
        flight = fly_settings(settings)
    except TrimError as error:
        return FlownSeed(seed, Figures(), f"The aircraft cannot hover: {error}")
    return FlownSeed.of(seed, flight, settings)


def compare_own(
    laws: Sequence[NamedLaw],
    seeds: Sequence[int],
    workers: int = 0,
    progress: Callable[[int], None] = lambda done: None,
) -> dict[str, list[FlownSeed]]:
    """Fly every controller on every seed; by a controller's name its flights, by seed.

    Parameters
    ----------
    laws : sequence of NamedLaw
    seeds : sequence of int
    workers : int
        Processes of this machine; 0: this one.
    progress : callable
        Told how many flights are done.

    Raises
    ------
    LawError, FlightError
    """
    for rival in laws:
        if rival.own:
            for source in own_laws(rival.settings).values():
                find(source)  # refused here, not by a worker
    batch, rows = PairedFlights(laws, list(seeds)), list[dict[str, Any]]()
    with flier(workers, resumes=False) as fly:
        for some in fly(batch, tasks(batch, set())):
            rows += some
            progress(len(rows))
    flown: dict[str, list[FlownSeed]] = {rival.name: [] for rival in laws}
    for row in sorted(rows, key=lambda row: row[NUMBER]):
        flown[batch.of(row[NUMBER])[0].name].append(row[_FLOWN])
    return flown


def _largest(flown: Sequence[FlownSeed]) -> dict[tuple[str, str], np.ndarray]:
    """By metric's label and unit the largest errors of the truth (seeds,); NaN of a lost one."""
    found: dict[tuple[str, str], np.ndarray] = {}
    for i, flight in enumerate(flown):
        for score in flight.figures.of(DECIDES):
            if score.source == TRUTH:
                key = score.metric.label, score.metric.unit
                found.setdefault(key, np.full(len(flown), np.nan))[i] = score.max
    return found


def as_dict(laws: Sequence[NamedLaw], flown: dict[str, list[FlownSeed]]) -> dict[str, Any]:
    """For --json."""
    return {
        "conditions": conditions(laws[0].settings).splitlines(),
        "laws": {
            name: [
                {
                    "seed": f.seed,
                    "lost": f.lost,
                    "largest": {
                        s.metric.key: s.max for s in f.figures.of(DECIDES) if s.source == TRUTH
                    },
                }
                for f in flights
            ]
            for name, flights in flown.items()
        },
    }


def print_own(laws: Sequence[NamedLaw], flown: dict[str, list[FlownSeed]], out: Console) -> None:
    """A row per metric: median and worst of each controller, and seeds on which it is better."""
    count = len(next(iter(flown.values())))
    rows = table(
        f"Largest error of the truth, {STRETCHES[DECIDES]}: median (worst) of {count} "
        f"seed{'s' * (count > 1)}; on how many of them it is below {PACKAGED}'s",
        out,
    )
    rows.add_column("metric")
    for name in flown:
        rows.add_column(name, justify="right")
    errors = {name: _largest(flights) for name, flights in flown.items()}
    for (label, unit), known in errors[PACKAGED].items():
        cells = []
        for name in flown:
            values = errors[name].get((label, unit), np.full(count, np.nan))
            if np.isnan(values).all():
                cells.append("-")
                continue
            text = f"{np.nanmedian(values):.3g} ({np.nanmax(values):.3g})"
            better = int((values < known).sum())
            cells.append(text if name == PACKAGED else f"{text}; {better} of {count}")
        rows.add_row(f"{label}, {unit}", *cells)
    out.print(rows)
    out.print(without_seed(conditions(laws[0].settings)))
    for name, flights in flown.items():
        for f in flights:
            if f.lost:
                out.print(f"LOST: {name}, seed {f.seed}: {f.lost}")
