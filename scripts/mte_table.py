# SPDX-License-Identifier: Apache-2.0
"""How well the autopilot flies the scored manoeuvres, in two worlds with both receivers; JSON.

Usage: ./heli python scripts/mte_table.py [--seeds 1..20]
"""

import json
from collections import Counter
from collections.abc import Sequence
from typing import Any

from seeds_option import parser_with_seeds

from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.result import conditions
from heli_flight.loop.scenario_mte import FROUDE
from heli_flight.loop.settings import Settings, resolve
from heli_flight.studies.handling.flown import score_flown
from heli_handling.definitions import FULL, MANOEUVRES
from heli_handling.errors import HandlingError
from heli_handling.scoring import Level, Result, Score
from heli_parameters.parameters import ParameterError

WORLDS, RECEIVERS = ("paper", "honest"), ("rtk", "standalone")


def scenario_of(name: str) -> str:
    """The packaged scenario of a manoeuvre."""
    return f"mte_{name.replace('-', '_')}"


def flown(settings: Settings, seeds: Sequence[int]) -> tuple[list[Score], list[str], int]:
    """Scores; why there is none for a flight; and how many were lost."""
    scores: list[Score] = []
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


def criterion(results: Sequence[Result]) -> dict[str, Any]:
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
        "levels": {level.value: levels[level] for level in Level},
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
        "levels": {level.value: levels[level] for level in Level},
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
        for scale in (FROUDE, FULL.name)
        for world in WORLDS
        for gps in RECEIVERS
    ]
    print(json.dumps({"seeds": seeds, "rows": rows}, indent=2))


if __name__ == "__main__":
    main()
