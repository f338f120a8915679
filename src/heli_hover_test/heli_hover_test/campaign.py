# SPDX-License-Identifier: Apache-2.0
"""Many flights of a scenario in one process: largest value over seeds per metric, beside the paper.

python -m heli_hover_test.campaign --scenario hover --seeds 1..20
"""

import argparse
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from heli_hover_test.closed_loop import simulate
from heli_hover_test.scoring import METRICS, SOURCES, Score, score
from heli_hover_test.settings import GPS_PRESETS, Settings, resolve
from heli_msgs_bridge.parameters import ParameterError


@dataclass(frozen=True)
class FlownSeed:
    """Scores of one flight, or why the helicopter was lost."""

    seed: int
    scores: Sequence[Score]
    lost: str


def with_seed(settings: Settings, seed: int) -> Settings:
    """The same flight in another wind, with other sensor errors."""
    plant = {**settings.nodes["plant"], "seed": seed}
    return replace(settings, seed=seed, nodes={**settings.nodes, "plant": plant})


def fly_seeds(settings: Settings, seeds: Iterable[int]) -> list[FlownSeed]:
    """Fly a scenario once per seed."""
    flown = []
    for seed in seeds:
        flight = simulate(with_seed(settings, seed))
        scores = [] if flight.sentence else score(flight.record, settings.scenario)
        flown.append(FlownSeed(seed, scores, flight.sentence))
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


def table(columns: Mapping[str, Sequence[FlownSeed]], kind: str) -> str:
    """Markdown table: largest magnitude over seeds per metric, per GPS preset and source."""
    names = [f"{gps}, {source}" for gps in columns for source in SOURCES]
    lines = ["| metric | paper | " + " | ".join(names) + " |", "|---" * (2 + len(names)) + "|"]
    extremes: dict[str, Any] = {gps: worst(flown) for gps, flown in columns.items()}
    for metric in METRICS[kind]:
        cells = [
            f"{extremes[gps][metric.key, source].max:.2f}" for gps in columns for source in SOURCES
        ]
        paper = f"{metric.paper:g} {metric.unit}"
        lines.append(f"| {metric.label} | {paper} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """Command line; 0 unless a helicopter was lost (1) or the input was bad (2)."""
    p = argparse.ArgumentParser(prog="heli_hover_test.campaign", description=__doc__)
    p.add_argument("--scenario", default="hover")
    p.add_argument("--seeds", default="1..20")
    options = p.parse_args(argv)
    try:
        seeds = parse_seeds(options.seeds)
        presets = {gps: resolve(options.scenario, gps=gps) for gps in GPS_PRESETS}
    except ParameterError as error:
        print(f"campaign: {error}", file=sys.stderr)
        return 2
    start = time.monotonic()
    columns = {gps: fly_seeds(settings, seeds) for gps, settings in presets.items()}
    kind = presets["rtk"].scenario.kind
    print(f"{options.scenario}, seeds {options.seeds}: largest magnitude over seeds")
    print(table(columns, kind))
    lost = [(gps, f.seed, f.lost) for gps, flown in columns.items() for f in flown if f.lost]
    for gps, seed, sentence in lost:
        print(f"lost: {gps}, seed {seed}: {sentence}")
    print(f"{len(seeds) * len(columns)} flights in {time.monotonic() - start:.1f} s")
    return 1 if lost else 0


if __name__ == "__main__":
    sys.exit(main())
