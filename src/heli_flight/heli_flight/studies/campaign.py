# SPDX-License-Identifier: Apache-2.0
"""Many flights of a scenario in one process: the largest value per metric beside the paper."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rich.console import Console

from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.result import Result, conditions
from heli_flight.loop.scoring import METRICS, SOURCES, Score, score
from heli_flight.loop.settings import Settings
from heli_flight.terminal import table as text_table
from heli_flight.text_table import FittingTable
from heli_parameters.parameters import ParameterError


@dataclass(frozen=True)
class FlownSeed:
    """Scores of one flight, or why the helicopter was lost."""

    seed: int
    scores: Sequence[Score]
    lost: str

    def exit_code(self, gps: str) -> int:
        """As the hover test's, `Result.exit_code`."""
        return Result(self.scores, self.lost, 0.0, 0.0).exit_code(gps)


def with_seed(settings: Settings, seed: int) -> Settings:
    """The same flight in another wind, with other sensor errors."""
    plant = {**settings.nodes["plant"], "seed": seed}
    return replace(settings, seed=seed, nodes={**settings.nodes, "plant": plant})


def fly_seeds(
    settings: Settings, seeds: Iterable[int], progress: Callable[[int], None] = lambda done: None
) -> list[FlownSeed]:
    """Fly a scenario once per seed; progress is told how many have been flown."""
    flown: list[FlownSeed] = []
    for seed in seeds:
        flight = simulate(with_seed(settings, seed))
        scores = [] if flight.sentence else score(flight.record, settings.scenario)
        flown.append(FlownSeed(seed, scores, flight.sentence))
        progress(len(flown))
    return flown


def worst(flown: Sequence[FlownSeed]) -> Mapping[tuple[str, str], Score]:
    """Per (metric key, source) the score with the largest magnitude over all seeds."""
    found: dict[tuple[str, str], Score] = {}
    for flight in flown:
        for s in flight.scores:
            key = (s.metric.key, s.source)
            if key not in found or s.max > found[key].max:
                found[key] = s
    return found


def parse_seeds(text: str) -> list[int]:
    """Seeds of "1..20", "7" or "1,5,9".

    Raises
    ------
    ParameterError
        If the text is none of these.
    """
    try:
        if ".." in text:
            first, last = (int(part) for part in text.split(".."))
            seeds = list(range(first, last + 1))
        else:
            seeds = [int(part) for part in text.split(",")]
    except ValueError:
        seeds = []
    if not seeds or min(seeds) < 0:
        raise ParameterError(f"--seeds {text}: write 1..20, 7 or 1,5,9")
    return seeds


def table(columns: Mapping[str, Sequence[FlownSeed]], kind: str, out: Console) -> FittingTable:
    """Largest magnitude over seeds per metric, per GPS preset and source."""
    rows = text_table("", out)
    rows.add_column("metric")
    for name in ("paper", *(f"{gps}, {source}" for gps in columns for source in SOURCES)):
        rows.add_column(name, justify="right")
    extremes: dict[str, Any] = {gps: worst(flown) for gps, flown in columns.items()}
    for metric in METRICS[kind]:
        found = [extremes[gps].get((metric.key, s)) for gps in columns for s in SOURCES]
        cells = ["-" if s is None else f"{s.max:.2f}" for s in found]
        rows.add_row(metric.label, f"{metric.paper:g} {metric.unit}", *cells)
    return rows


def remarks(columns: Mapping[str, Sequence[FlownSeed]]) -> list[str]:
    """A sentence for each flight that was lost or left the paper's figures."""
    lines = []
    for gps, flown in columns.items():
        for f in flown:
            if f.lost:
                lines.append(f"lost: {gps}, seed {f.seed}: {f.lost}")
                continue
            for s in Result(f.scores, "", 0.0, 0.0).judged(gps):
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
        flights = [
            {
                "seed": f.seed,
                "lost": f.lost,
                "exit_code": f.exit_code(gps),
                "max": {f"{s.metric.key} ({s.source})": s.max for s in f.scores},
            }
            for f in flown
        ]
        content[gps] = {
            "conditions": conditions(settings[gps]).splitlines(),
            "metrics": [s.as_dict() for s in worst(flown).values()],
            "flights": flights,
        }
    return content
