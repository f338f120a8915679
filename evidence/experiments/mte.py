# SPDX-License-Identifier: Apache-2.0
"""How well the autopilot flies the scored manoeuvres, in two worlds with both receivers; JSON.

Usage: ./heli python -m evidence.experiments.mte [--seeds 1..20]
"""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

from evidence.files import Results
from evidence.options import parser_with_seeds
from evidence.registry import TWENTY, produces, table
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


def flown(settings: Settings, seeds: Sequence[int]) -> tuple[list[ManoeuvreScore], list[str], int]:
    """Scores; why there is none for a flight; and how many were lost."""
    scores: list[ManoeuvreScore] = []
    missing: list[str] = []
    lost = 0
    for seed in seeds:
        of_seed = settings.with_seed(seed)
        flight = simulate(of_seed)
        lost += bool(flight.sentence)
        if flight.sentence:
            continue
        try:
            scores.append(score_flown(of_seed, flight.record))
        except HandlingError as error:
            missing.append(f"seed {seed}: {error}")
    return scores, missing, lost


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


def row(name: str, scale: str, world: str, gps: str, seeds: Sequence[int]) -> dict[str, Any]:
    """All flights of a manoeuvre; `refused` says why none is flown."""
    head: dict[str, Any] = {"manoeuvre": name, "scale": scale, "world": world, "gps": gps}
    overrides = {"scenario": {"path.scale": scale}}
    try:
        settings = resolve(scenario_of(name), gps, seeds[0], world=world, overrides=overrides)
    except ParameterError as error:
        return {**head, "refused": str(error)}
    scores, missing, lost = flown(settings, seeds)
    levels = Counter(score.level for score in scores)
    return {
        **head,
        "conditions": conditions(settings).splitlines(),
        "lost": lost,
        "missing": missing,
        "not_as_defined": sum(not score.complete for score in scores),
        "levels": {level.value: levels[level] for level in HandlingLevel},
        "criteria": [
            criterion(results) for results in zip(*(s.results for s in scores), strict=True)
        ],
    }


def main() -> None:
    """Print the rows."""
    seeds = parser_with_seeds(__doc__, "1..20").parse_args().seeds
    rows = [
        row(name, scale, world, gps, seeds)
        for name in MANOEUVRES
        for scale in (FROUDE, FULL_SCALE.name)
        for world in WORLDS
        for gps in RECEIVERS
    ]
    print(json.dumps({"seeds": seeds, "rows": rows}, indent=2))


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
    found = results["mte"]
    head = ["manoeuvre", "world, receiver", *_LEVELS, "not as defined", "worst of all flights"]
    rows = [[_manoeuvre(row), _place(row), *_flights(row)] for row in _flown(found)]
    refused = [
        f"{row['manoeuvre']} at full size ({row['refused'].partition('takes ')[2]})"
        for row in {r["manoeuvre"]: r for r in found["rows"] if "refused" in r}.values()
    ]
    flown_in = {row["world"]: [row["conditions"]] for row in _flown(found)}
    return (
        f"{grid(head, rows)}\n\nOf {len(found['seeds'])} flights each, {results.seeds('mte')}, the "
        "default law; worst values by ground truth, in brackets where the worst is only "
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
            said = "; ".join(f"{level} in some flights: {', '.join(n)}" if n else f"{level}: none"
                             for level, n in short.items())  # fmt: skip
            all_of = sum(sum(row["levels"].values()) + len(row["missing"]) for row in rows)
            desired = sum(row["levels"][HandlingLevel.DESIRED.value] for row in rows)
            lines.append(f"- {_size(scale)}, {gps}: {desired} of {all_of} flights desired; {said}.")
    return "\n".join(lines)


def _flown(found: Mapping[str, Any]) -> list[Mapping[str, Any]]:
    return [row for row in found["rows"] if "refused" not in row]


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
    said = "–" if value is None else f"{value:.3g} {criterion['unit']}"
    if criterion["levels"][HandlingLevel.NEITHER.value]:
        said = f"**{said}**"
    elif criterion["levels"][HandlingLevel.ADEQUATE.value]:
        said = f"({said})"
    return f"{criterion['name']} {said}"


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
    main()
