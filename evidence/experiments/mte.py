# SPDX-License-Identifier: Apache-2.0
"""How well the autopilot flies the scored manoeuvres, in two worlds with both receivers; JSON.

Usage: ./heli python -m evidence.experiments.mte [--seeds 1..20]
"""

import sys
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from evidence.files import Results
from evidence.registry import TWENTY, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid, world
from heli_analysis.handling.definitions import FULL_SCALE, MANOEUVRES
from heli_analysis.handling.scoring import CriterionResult, HandlingLevel, ManoeuvreScore
from heli_core.errors import HandlingError
from heli_core.rcl_yaml import ParameterError
from heli_flight.loop import simulate
from heli_flight.result import conditions
from heli_flight.scenario import FROUDE
from heli_flight.settings import Settings, resolve
from heli_studies.handling import score_flown

WORLDS, RECEIVERS = ("paper", "honest"), ("rtk", "standalone")


def scenario_of(name: str) -> str:
    """The packaged scenario of a manoeuvre."""
    return f"mte_{name.replace('-', '_')}"


class Scored(NamedTuple):
    """The score of a flight; why there is none; whether it was lost."""

    score: ManoeuvreScore | None = None
    missing: str = ""
    lost: bool = False


def settings_of(manoeuvre: str, scale: str, world: str, gps: str, seed: int) -> Settings:
    """The flight of a manoeuvre; raises ParameterError if it is not flown at this size."""
    overrides = {"scenario": {"path.scale": scale}}
    return resolve(scenario_of(manoeuvre), gps, seed, world=world, overrides=overrides)


@over(manoeuvre=tuple(MANOEUVRES), scale=(FROUDE, FULL_SCALE.name), world=WORLDS, gps=RECEIVERS)
def flown(manoeuvre: str, scale: str, world: str, gps: str, seed: int) -> Scored:
    """Fly a manoeuvre and score it."""
    settings = settings_of(manoeuvre, scale, world, gps, seed)
    flight = simulate(settings)
    if flight.sentence:
        return Scored(lost=True)
    try:
        return Scored(score_flown(settings, flight.record))
    except HandlingError as error:
        return Scored(missing=f"seed {seed}: {error}")


def criterion(results: Sequence[CriterionResult]) -> dict[str, Any]:
    """Bounds, the worst value of all flights and how many were at which level."""
    bounds = results[0].criterion
    values = [r.value for r in results if r.value is not None]
    levels = Counter(r.level for r in results)
    return {
        "name": bounds.name,
        "unit": bounds.quantity.value,
        "desired": bounds.desired,
        "adequate": bounds.adequate,
        "at_least": bounds.at_least,
        "worst": (min if bounds.at_least else max)(values, default=None),
        "levels": {level.value: levels[level] for level in HandlingLevel},
    }


def row(place: Place[Scored], settings: Settings) -> dict[str, Any]:
    """All flights of a manoeuvre."""
    scores = [one.score for one in place.flights if one.score is not None]
    levels = Counter(score.level for score in scores)
    return {
        **place.point,
        "conditions": conditions(settings).splitlines(),
        "lost": sum(one.lost for one in place.flights),
        "missing": [one.missing for one in place.flights if one.missing],
        "not_as_defined": sum(not score.complete for score in scores),
        "levels": {level.value: levels[level] for level in HandlingLevel},
        "criteria": [
            criterion(results) for results in zip(*(s.results for s in scores), strict=True)
        ],
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show; of a manoeuvre that is not flown, `refused` says why."""
    batch: list[Settings | str] = []
    for point in flown.points:
        try:
            batch.append(settings_of(**point, seed=options.seeds[0]))
        except ParameterError as error:
            batch.append(str(error))
    both = list(zip(flown.points, batch, strict=True))
    places = flown.places(options, [point for point, of in both if not isinstance(of, str)])
    rows = [
        {**point, "refused": of} if isinstance(of, str) else row(next(places), of)
        for point, of in both
    ]
    return {"seeds": options.seeds, "rows": rows}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "mte",
    "./heli python -m evidence.experiments.mte --seeds 1..20",
    "How well the scored manoeuvres are flown, with both receivers.",
    TWENTY,
)


_LEVELS = [level.value for level in HandlingLevel]


_FULL = "full"


@table("mte")
def mte(results: Results) -> str:
    """Levels of the manoeuvres over all seeds, and the worst value of each criterion."""
    record = results["mte"]
    head = ["manoeuvre", "world, receiver", *_LEVELS, "not as defined", "worst of all flights"]
    rows = [[_manoeuvre(row), _place(row), *_flights(row)] for row in _flown(record)]
    refused = [
        f"{row['manoeuvre']} at full size ({row['refused'].partition('takes ')[2]})"
        for row in {r["manoeuvre"]: r for r in record["rows"] if "refused" in r}.values()
    ]
    flown_in = {row["world"]: [row["conditions"]] for row in _flown(record)}
    return (
        f"{grid(head, rows)}\n\nOf {len(record['seeds'])} flights each, {results.seeds('mte')}, "
        f"the "
        "default controller; worst values by ground truth, in brackets where the worst is only "
        "adequate, in bold where it is neither. Refused: "
        f"{'; '.join(refused)}. {world(flown_in)}"
    )


@table("mte_short")
def mte_short(results: Results) -> str:
    """Where not every flight is desired: the criteria, per size and receiver."""
    lines = []
    for scale in dict.fromkeys(row["scale"] for row in _flown(results["mte"])):
        for gps in dict.fromkeys(row["gps"] for row in _flown(results["mte"])):
            rows = [r for r in _flown(results["mte"]) if (r["scale"], r["gps"]) == (scale, gps)]
            short = {
                level: _names(rows, level)
                for level in (HandlingLevel.NEITHER.value, HandlingLevel.ADEQUATE.value)
            }
            levels = "; ".join(f"{level} in some flights: {', '.join(n)}" if n else f"{level}: none"
                             for level, n in short.items())  # fmt: skip
            all_of = sum(sum(row["levels"].values()) + len(row["missing"]) for row in rows)
            desired = sum(row["levels"][HandlingLevel.DESIRED.value] for row in rows)
            lines.append(
                f"- {_size(scale)}, {gps}: {desired} of {all_of} flights desired; {levels}."
            )
    return "\n".join(lines)


def _flown(results: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [row for row in results["rows"] if "refused" not in row]


def _size(scale: str) -> str:
    return "full size" if scale == _FULL else "scaled"


def _manoeuvre(row: Mapping[str, Any]) -> str:
    return f"{row['manoeuvre']}, {_size(row['scale'])}"


def _place(row: Mapping[str, Any]) -> str:
    return f"{row['world']}, {row['gps']}"


def _flights(row: Mapping[str, Any]) -> list[str]:
    worst = ", ".join(_worst(criterion) for criterion in row["criteria"])
    undefined = row["not_as_defined"] + len(row["missing"]) + row["lost"]
    return [*(str(row["levels"][level]) for level in _LEVELS), str(undefined), worst]


def _worst(criterion: Mapping[str, Any]) -> str:
    """Name and worst value, marked by its level."""
    value = criterion["worst"]
    cell = "–" if value is None else f"{value:.3g} {criterion['unit']}"
    if criterion["levels"][HandlingLevel.NEITHER.value]:
        cell = f"**{cell}**"
    elif criterion["levels"][HandlingLevel.ADEQUATE.value]:
        cell = f"({cell})"
    return f"{criterion['name']} {cell}"


def _names(rows: list[Mapping[str, Any]], level: str) -> list[str]:
    """Criteria of manoeuvres that were at a level in a flight."""
    return list(
        dict.fromkeys(
            f"{row['manoeuvre']} {criterion['name']}"
            for row in rows
            for criterion in row["criteria"]
            if criterion["levels"][level]
        )
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment))
