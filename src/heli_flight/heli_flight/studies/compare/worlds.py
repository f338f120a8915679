# SPDX-License-Identifier: Apache-2.0
"""`heli compare worlds`: today's laws in several worlds, on the same seeds, with both receivers.

How much falls outside the paper's figures is the result. One process; the compiled loop is reused.
"""

import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rich.console import Console

from heli_dynamics_sim.plant import PlantStatus
from heli_dynamics_sim.trim import TrimError
from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.flight_file import drawn
from heli_flight.loop.result import Result, conditions
from heli_flight.loop.scoring import METRICS, STRETCHES, Figures, score, sources_of
from heli_flight.loop.settings import Settings, resolve
from heli_flight.terminal import table
from heli_math.paper_metrics import Metric

JUDGED = {"standalone": "navigation", "rtk": "truth"}
"""What a receiver can know, which its tables hold against the paper; JSON has all records."""
NO_TRIM = "NO_TRIM"
"""What a flight is called whose aircraft no actuator setting holds: it is lost before it begins."""


@dataclass(frozen=True)
class Flown:
    """One flight.

    Attributes
    ----------
    seed : int
    figures : Figures
        None of a flight that was lost.
    status : str
        Name of the `PlantStatus`, or `NO_TRIM`.
    at_s : float
        Flight time that was flown.
    aircraft : dict
        What the seed drew.
    """

    seed: int
    figures: Figures
    status: str
    at_s: float
    aircraft: Mapping[str, float | int]

    @property
    def lost(self) -> bool:
        """Whether the helicopter was lost."""
        return self.status != PlantStatus.OK.name

    def exit_code(self, gps: str) -> int:
        """As the hover test's."""
        return Result(self.figures, self.status if self.lost else "", 0.0, 0.0).exit_code(gps)


@dataclass(frozen=True)
class Place:
    """A world with a receiver, and what it is called.

    Attributes
    ----------
    name : str
        Of the world, and what is changed in it.
    gps : str
    settings : Settings
    """

    name: str
    gps: str
    settings: Settings


def places(
    worlds: Sequence[str],
    receivers: Sequence[str],
    w20_mps: Sequence[float] = (),
    duration_s: float | None = None,
    params: Sequence[Path] = (),
    laws: str | None = None,
) -> list[Place]:
    """Every world with every receiver, and with every wind at 20 ft if winds are given.

    Raises
    ------
    ParameterError
    """
    found = []
    for world in worlds:
        for wind in w20_mps or (None,):
            name = Path(world).stem + ("" if wind is None else f", W20 {wind:g} m/s")
            changes = {} if wind is None else {"plant": {"wind.w20_mps": float(wind)}}
            for gps in receivers:
                settings = resolve(
                    "hover", gps, None, duration_s, params=params, overrides=changes, world=world,
                    laws=laws,
                )  # fmt: skip
                found.append(Place(name, gps, settings))
    return found


def fly(settings: Settings, seed: int) -> Flown:
    """One flight of a seed."""
    own = settings.with_seed(seed)
    try:
        flight = simulate(own)
    except TrimError:
        return Flown(seed, Figures(), NO_TRIM, 0.0, drawn(own))
    figures = Figures() if flight.sentence else score(flight.record, own.scenario)
    return Flown(
        seed, figures, flight.status.name, own.rate.seconds(len(flight.record)), drawn(own)
    )


def compare(
    where: Sequence[Place],
    seeds: Sequence[int],
    progress: Callable[[int], None] = lambda done: None,
) -> list[list[Flown]]:
    """Fly every seed at every place; progress is told how many flights are done."""
    found, done = [], 0
    for place in where:
        flights = []
        for seed in seeds:
            flights.append(fly(place.settings, seed))
            done += 1
            progress(done)
        found.append(flights)
    return found


def _row(
    metric: Metric, stretch: str, source: str, flights: Sequence[Flown]
) -> dict[str, Any] | None:
    """Median, worst and how many are inside, of a metric over the flights that were not lost."""
    found = [flight.figures.find(stretch, metric.key, source) for flight in flights]
    values = [s.max for s in found if s is not None]
    if not values:
        return None
    return {
        "key": metric.key,
        "label": metric.label,
        "unit": metric.unit,
        "paper": metric.paper,
        "stretch": stretch,
        "measured_from": source,
        "median": statistics.median(values),
        "worst": max(values),
        "inside": sum(s.inside for s in found if s is not None),
    }


def as_dict(where: Sequence[Place], found: Sequence[Sequence[Flown]]) -> dict[str, Any]:
    """For --json: per world and receiver the figures over the seeds, and who was lost, and how."""
    rows = []
    for place, flights in zip(where, found, strict=True):
        kind = place.settings.scenario.kind
        metrics = [
            _row(metric, stretch, source, flights)
            for stretch in STRETCHES
            for metric in METRICS[kind]
            for source in sources_of(place.gps)
        ]
        lost = [flight for flight in flights if flight.lost]
        rows.append(
            {
                "name": place.name,
                "world": Path(place.settings.world).stem,
                "gps": place.gps,
                "laws": Path(place.settings.laws).stem,
                "w20_mps": place.settings.nodes["plant"]["wind.w20_mps"],
                "conditions": conditions(place.settings).splitlines(),
                "flown": len(flights),
                "exit_code_0": sum(flight.exit_code(place.gps) == 0 for flight in flights),
                "metrics": [row for row in metrics if row is not None],
                "lost": [
                    {"seed": f.seed, "status": f.status, "at_s": f.at_s, "draw": dict(f.aircraft)}
                    for f in lost
                ],
            }
        )
    return {"places": rows}


def print_comparison(content: Mapping[str, Any], out: Console) -> None:
    """Per metric the median and the worst in every world, and how many are inside."""
    places = content["places"]
    for stretch, words in STRETCHES.items():
        rows = table(f"{words}: median / worst over the flights, and how many are inside", out)
        rows.add_column("metric")
        rows.add_column("paper", justify="right")
        for place in places:
            rows.add_column(f"{place['name']}, {place['gps']}", justify="right")
        for metric in METRICS["hover"]:
            cells = [_cell(place, metric.key, stretch) for place in places]
            rows.add_row(metric.label, f"{metric.paper:g} {metric.unit}", *cells)
        out.print(rows)
    out.print("measured from: " + "; ".join(f"{g}: {r}" for g, r in JUDGED.items()))
    for place in places:
        kept = f"{place['exit_code_0']} of {place['flown']} flights with exit code 0"
        out.print(f"{place['name']}, {place['gps']}: {kept}", highlight=False)
        for flight in place["lost"]:
            out.print(
                f"  lost: seed {flight['seed']}, {flight['status']} after {flight['at_s']:.2f} s",
                highlight=False,
            )


def _cell(place: Mapping[str, Any], key: str, stretch: str) -> str:
    wanted = (key, stretch, JUDGED[place["gps"]])
    for row in place["metrics"]:
        if (row["key"], row["stretch"], row["measured_from"]) == wanted:
            return f"{row['median']:.2f} / {row['worst']:.2f}; {row['inside']} of {place['flown']}"
    return "-"
