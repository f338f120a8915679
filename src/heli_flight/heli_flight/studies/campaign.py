# SPDX-License-Identifier: Apache-2.0
"""Many flights of a scenario in one process: the largest value per metric beside the paper."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.console import Console

from heli_dynamics_sim.trim import TrimError
from heli_flight.loop.closed_loop import Flight, simulate
from heli_flight.loop.result import Result, conditions
from heli_flight.loop.scenario import Scenario
from heli_flight.loop.scoring import (
    DECIDES,
    METRICS,
    SOURCE_NAMES,
    STRETCHES,
    Figures,
    Score,
    figures_of,
    score,
    sources_of,
)
from heli_flight.loop.settings import Settings
from heli_flight.studies.share import Share
from heli_flight.terminal import table as text_table
from heli_flight.text_table import FittingTable
from heli_math.paper_metrics import PATH
from heli_parameters.parameters import ParameterError


@dataclass(frozen=True)
class FlownSeed:
    """Figures of one flight, or why the helicopter was lost."""

    seed: int
    figures: Figures
    lost: str

    @classmethod
    def of(cls, seed: int, flight: Flight, scenario: Scenario) -> "FlownSeed":
        """What a flight has shown; of a lost one nothing is scored."""
        figures = Figures() if flight.sentence else score(flight.record, scenario)
        return cls(seed, figures, flight.sentence)

    def exit_code(self, gps: str) -> int:
        """As the hover test's, `Result.exit_code`."""
        return Result(self.figures, self.lost, 0.0, 0.0).exit_code(gps)


def with_seed(settings: Settings, seed: int) -> Settings:
    """The same flight in another wind, with other sensor errors, on another aircraft if drawn."""
    return settings.with_seed(seed)


def fly_seeds(
    settings: Settings, seeds: Iterable[int], progress: Callable[[int], None] = lambda done: None
) -> list[FlownSeed]:
    """Fly a scenario once per seed; progress is told how many have been flown."""
    flown: list[FlownSeed] = []
    for seed in seeds:
        try:
            flight = simulate(settings.with_seed(seed))
        except TrimError as error:
            # An aircraft that was drawn, in this wind: no actuator setting holds it.
            flown.append(FlownSeed(seed, Figures(), f"The aircraft cannot hover: {error}"))
            progress(len(flown))
            continue
        flown.append(FlownSeed.of(seed, flight, settings.scenario))
        progress(len(flown))
    return flown


def worst(flown: Sequence[FlownSeed], stretch: str = DECIDES) -> Mapping[tuple[str, str], Score]:
    """Per (metric key, source) the score of a stretch with the largest magnitude over all seeds."""
    found: dict[tuple[str, str], Score] = {}
    for flight in flown:
        for s in flight.figures.of(stretch):
            key = (s.metric.key, s.source)
            if key not in found or s.max > found[key].max:
                found[key] = s
    return found


def parse_seeds(text: str) -> list[int]:
    """Seeds of "1..20", "7", "1,5,9" or "1..20,2001..2020".

    Raises
    ------
    ParameterError
        If the text is none of these.
    """
    seeds: list[int] = []
    try:
        for part in text.split(","):
            first, _, last = part.partition("..")
            seeds += range(int(first), int(last or first) + 1)
            if int(last or first) < int(first):
                raise ValueError(part)
    except ValueError:
        seeds = []
    if not seeds or min(seeds) < 0:
        raise ParameterError(f"--seeds {text}: write 1..20, 7, 1,5,9 or 1..20,31..40")
    return seeds


def table(
    columns: Mapping[str, Sequence[FlownSeed]], kind: str, out: Console, stretch: str = DECIDES
) -> FittingTable:
    """Largest magnitude over seeds per metric, per GPS preset and source."""
    rows = text_table(STRETCHES[stretch], out)
    rows.add_column("metric")
    places = [(gps, source) for gps in columns for source in sources_of(gps)]
    for name in (
        "goal" if kind == PATH else "paper",
        *(f"{gps}, {SOURCE_NAMES[source]}" for gps, source in places),
    ):
        rows.add_column(name, justify="right")
    extremes = {gps: worst(flown, stretch) for gps, flown in columns.items()}
    for metric in METRICS[kind]:
        found = [extremes[gps].get((metric.key, source)) for gps, source in places]
        cells = ["-" if s is None else f"{s.max:.2f}" for s in found]
        rows.add_row(metric.label, f"{metric.paper:g} {metric.unit}", *cells)
    return rows


def inside_of(flown: Sequence[FlownSeed], gps: str, stretch: str) -> int:
    """How many flights were not lost and are inside the paper's figures over a stretch."""
    return sum(
        not f.lost and not Result(f.figures, "", 0.0, 0.0).judged(gps, stretch) for f in flown
    )


def survived(flown: Sequence[FlownSeed]) -> Share:
    """The flights that were not lost."""
    return Share(sum(not f.lost for f in flown), len(flown))


def remarks(columns: Mapping[str, Sequence[FlownSeed]], kind: str) -> list[str]:
    """Sentences: how many were inside, and each flight that was lost or outside (`DECIDES`)."""
    lines = [
        f"{STRETCHES[stretch]}, {gps}: {inside_of(flown, gps, stretch)} of {len(flown)} flights "
        f"inside {figures_of(kind)}"
        for stretch in STRETCHES
        for gps, flown in columns.items()
    ]
    for gps, flown in columns.items():
        for f in flown:
            if f.lost:
                lines.append(f"lost: {gps}, seed {f.seed}: {f.lost}")
                continue
            for s in Result(f.figures, "", 0.0, 0.0).judged(gps):
                lines.append(
                    f"outside the paper's figures: {gps}, seed {f.seed}: {s.metric.label} "
                    f"({s.source}) {s.max:.3g} {s.metric.unit}, allowed: {s.metric.paper:g}"
                )
    return lines


def as_dict(
    columns: Mapping[str, Sequence[FlownSeed]], settings: Mapping[str, Settings]
) -> dict[str, Any]:
    """For --json: per receiver the largest magnitude of each metric, and every flight."""
    content: dict[str, Any] = {}
    for gps, flown in columns.items():
        content[gps] = {
            "conditions": conditions(settings[gps]).splitlines(),
            "inside": {stretch: inside_of(flown, gps, stretch) for stretch in STRETCHES},
            "metrics": [
                s.as_dict() for stretch in STRETCHES for s in worst(flown, stretch).values()
            ],
            "flights": [_flight_row(f, gps) for f in flown],
        }
    return content


def _flight_row(f: FlownSeed, gps: str) -> dict[str, Any]:
    return {
        "seed": f.seed,
        "lost": f.lost,
        "exit_code": f.exit_code(gps),
        "max_whole": {s.name: s.max for s in f.figures.whole},
        "max": {s.name: s.max for s in f.figures.windows},
        "climb": {f"{c.metric.key} ({c.source})": c.value for c in f.figures.climb},
    }
