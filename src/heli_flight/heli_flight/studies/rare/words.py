# SPDX-License-Identifier: Apache-2.0
"""What rare failures and worst cases are told as: for people, and as JSON."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from heli_flight.studies.rare.flights import Flights
from heli_flight.studies.rare.points import one_seed, seed_is_random
from heli_flight.studies.rare.subset import Ended, Level
from heli_flight.studies.rare.worst import Search
from heli_flight.terminal import table

MOST_AGAIN = 5


def largest(flights: Flights) -> list[int]:
    """Numbers of the flights with the largest values, at most `MOST_AGAIN`; lost ones first."""
    _, values = flights.all()
    return [int(n) for n in np.argsort(-values, kind="stable")[:MOST_AGAIN]]


def likeliest(flights: Flights) -> int | None:
    """Of the flights beyond the bound the one whose parameters are the likeliest."""
    points, values = flights.all()
    beyond = np.flatnonzero(values > flights.asked.bound)
    if not beyond.size:
        return None
    scores = points.scores[beyond, : len(points.names)]
    return int(beyond[(scores * scores).sum(axis=1).argmin()])


def noise(flights: Flights, drawn: bool) -> str:
    """What becomes of wind and sensor noise, in words."""
    if drawn:
        return "wind and sensors: a seed of its own per flight, drawn like the dispersions"
    given = "the spec's" if not seed_is_random(flights.spec) else "the spec has one for each"
    return f"wind and sensors: seed {one_seed(flights.spec)} in every flight ({given})"


def _common(flights: Flights) -> dict[str, Any]:
    asked = flights.asked
    return {
        "spec": flights.spec.identity,
        "dispersed": list(flights.spec.names),
        "metric": asked.name,
        "unit": asked.metric.unit,
        "bound": asked.bound,
        "paper": asked.metric.paper,
        "flights": flights.count,
        "causes": dict(flights.causes),
        "again": largest(flights),
    }


def rare_dict(
    flights: Flights, levels: Sequence[Level], ended: Ended | None, seed: int
) -> dict[str, Any]:
    """Of subset simulation, for result.json; `ended` is None if it was interrupted."""
    near = likeliest(flights)
    common = _common(flights)
    again = common["again"] if near is None else [near, *common["again"]]
    reached, last = ended is Ended.REACHED, levels[-1] if levels else None
    answer = {
        "probability": last.probability if reached and last else None,
        "cov": last.cov if reached and last else None,
        "interval": list(last.interval) if reached and last else None,
        "not_above": list(last.interval)[1] if last else None,
    }
    return {
        **common,
        "again": list(dict.fromkeys(again)),
        "seed": seed,
        "seed_drawn": seed_is_random(flights.spec),
        "ended": ended.value if ended else "interrupted",
        **answer,
        "likeliest": near,
        "levels": [
            {
                "threshold": level.threshold, "share": level.share, "accepted": level.accepted,
                "flights": level.flights, "probability": level.probability, "cov": level.cov,
                "cov_au_beck": level.au_beck,
            }
            for level in levels
        ],
    }  # fmt: skip


def rare_answer(flights: Flights, levels: Sequence[Level], ended: Ended | None) -> str:
    """The probability, or what stands of it, in one line."""
    asked = flights.asked
    if not levels:
        return "no level is done"
    last = levels[-1]
    low, high = last.interval
    figures = (
        f"{last.probability:.3g} (coefficient of variation {last.cov:.2f}, 95 %: "
        f"{low:.2g} to {high:.2g})"
    )
    if ended is Ended.REACHED:
        return f"P({asked.name} > {asked.bound:g} {asked.metric.unit}) = {figures}"
    return (
        f"{ended.value if ended else 'interrupted'}: P({asked.name} > {last.threshold:.4g} "
        f"{asked.metric.unit}) = {figures}; to be beyond {asked.bound:g} is rarer"
    )


def print_rare(
    out: Console, flights: Flights, levels: Sequence[Level], ended: Ended | None
) -> None:
    """The levels, the probability and what it is of."""
    unit = flights.asked.metric.unit
    rows = table(f"subset simulation, {flights.asked.name}", out)
    for name in ("level", f"beyond, {unit}", "probability", "cov", "moves accepted", "flights"):
        rows.add_column(name, justify="right")
    for number, level in enumerate(levels):
        accepted = f"{level.accepted:.0%}" if math.isfinite(level.accepted) else "-"
        rows.add_row(
            f"{number}", f"{level.threshold:.4g}", f"{level.probability:.3g}",
            f"{level.cov:.2f}", accepted, f"{level.flights}",
        )  # fmt: skip
    out.print(rows)
    lines = [rare_answer(flights, levels, ended), _flown(flights)]
    lines.append(noise(flights, seed_is_random(flights.spec)))
    near = likeliest(flights)
    if near is not None:
        points, _ = flights.all()
        values = zip(points.names, points.inputs[near], strict=True)
        said = ", ".join(f"{name} {_cell(value)}" for name, value in values)
        lines.append(f"likeliest flight beyond: {near}: {said}")
    _print(out, lines)


def worst_dict(
    flights: Flights, searches: Sequence[tuple[str, Search]], reach: float, seed: int
) -> dict[str, Any]:
    """Of a search for the worst case, for result.json."""
    points, _ = flights.all()
    found: dict[str, Any] = {}
    first = 0
    for name, search in searches:
        number = first + search.at if search.at >= 0 else None
        found[name] = {
            "value": search.best, "lost": search.lost, "flights": search.evaluations,
            "after": search.at + 1, "flight": number,
            "inputs": {} if number is None
            else dict(zip(points.names, points.inputs[number], strict=True)),
        }  # fmt: skip
        first += search.evaluations
    best = [search.best for _, search in searches if search.at >= 0]
    more = best[0] - best[1] if len(best) == 2 and all(map(math.isfinite, best)) else None
    return {
        **_common(flights),
        "seed": seed,
        "flight_seed": one_seed(flights.spec),
        "sigma": reach,
        "searches": found,
        "larger_by": more,
    }


def print_worst(
    out: Console, flights: Flights, searches: Sequence[tuple[str, Search]], reach: float
) -> None:
    """The worst case that each search has found, and by how much one beats the other."""
    asked, unit = flights.asked, flights.asked.metric.unit
    points, _ = flights.all()
    rows = table(f"worst case, {asked.name}, {reach:g} sigma", out)
    rows.add_column("")
    for name, _ in searches:
        rows.add_column(name, justify="right")
    begins = np.cumsum([0, *(search.evaluations for _, search in searches)])
    at = [begin + s.at for begin, (_, s) in zip(begins, searches, strict=False) if s.at >= 0]
    rows.add_row("largest", *(_value(s, unit) for _, s in searches))
    rows.add_row("found by flight", *(f"{s.at + 1} of {s.evaluations}" for _, s in searches))
    for i, name in enumerate(points.names):
        rows.add_row(name, *(_cell(points.inputs[number][i]) for number in at))
    out.print(rows)
    lines = [_flown(flights), noise(flights, False)]
    best = [search for _, search in searches if search.at >= 0]
    if len(best) == 2:
        lines.insert(0, _beaten(best[0], best[1], unit))
    _print(out, lines)


def _beaten(ours: Search, other: Search, unit: str) -> str:
    if ours.lost and other.lost:
        return f"both lose the aircraft: by flight {ours.at + 1} and by flight {other.at + 1}"
    if ours.lost or other.lost:
        who = "CMA-ES" if ours.lost else "random search"
        return f"{who} alone finds a flight that is lost"
    more = ours.best - other.best
    share = more / other.best if other.best > 0.0 else math.inf
    word = "beats" if more > 0.0 else "does not beat"
    return f"CMA-ES {word} random search of the same flights: {more:+.3g} {unit} ({share:+.0%})"


def _value(search: Search, unit: str) -> str:
    return "not flown to the end" if search.lost else f"{search.best:.4g} {unit}"


def _cell(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _flown(flights: Flights) -> str:
    causes = ", ".join(f"{count} {cause}" for cause, count in flights.causes.items())
    return f"{flights.count} flights: {causes}; not flown to the end counts as beyond the bound"


def print_folder(out: Console, folder: Path, again: Sequence[Path]) -> None:
    """How to fly what was found again, and where everything is."""
    lines = [f"again: heli hover --params {path}" for path in again]
    _print(out, [*lines, f"rows: {folder}/rows/*.parquet, result: {folder}/result.json"])


def _print(out: Console, lines: Sequence[str]) -> None:
    for line in lines:
        out.print(line, soft_wrap=True, markup=False)
