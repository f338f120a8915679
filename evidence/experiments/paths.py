# SPDX-License-Identifier: Apache-2.0
"""How closely the scenarios along a path are flown, in two worlds with both receivers; JSON.

Usage: ./heli python -m evidence.experiments.paths [--seeds 1..20]
"""

import json
from typing import Any

from evidence.files import Results
from evidence.options import parser_with_seeds
from evidence.registry import TWENTY, produces, table
from evidence.tables import grid, world
from heli_core.metrics import METRICS, PATH
from heli_flight.result import conditions
from heli_flight.scoring import DECIDES, TRUTH, TRUTH_LESS_DRIFT, sources_of
from heli_flight.settings import resolve
from heli_studies.campaign.run import fly_seeds, inside_of, worst_of_seeds

SCENARIOS = ("figure_eight", "orbit", "waypoints")
WORLDS, RECEIVERS = ("paper", "honest"), ("rtk", "standalone")


def row(scenario: str, world: str, gps: str, seeds: list[int]) -> dict[str, Any]:
    """Largest errors of a scenario from 5 s on, per metric and record."""
    settings = resolve(scenario, gps, world=world)
    flown = fly_seeds(settings, seeds)
    largest = worst_of_seeds(flown, DECIDES)
    return {
        "scenario": scenario,
        "world": world,
        "gps": gps,
        "conditions": conditions(settings).splitlines(),
        "inside": inside_of(flown, gps, DECIDES),
        "lost": sum(bool(flight.lost) for flight in flown),
        "max": {
            f"{key}, {source}": score.max
            for (key, source), score in largest.items()
            if source in sources_of(gps)
        },
    }


def main() -> None:
    """Print the rows."""
    seeds = parser_with_seeds(__doc__, "1..20").parse_args().seeds
    rows = [
        row(scenario, world, gps, seeds)
        for scenario in SCENARIOS
        for world in WORLDS
        for gps in RECEIVERS
    ]
    print(json.dumps({"seeds": seeds, "rows": rows}, indent=2))


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "paths",
    "./heli python -m evidence.experiments.paths --seeds 1..20",
    "How closely the scenarios along a path are flown, with both receivers.",
    TWENTY,
)


@table("paths")
def paths(results: Results) -> str:
    """Largest errors along paths from truth, and without the receiver's drift."""
    found = results["paths"]
    near, turn = (f"{m.label}, {m.unit} (goal {m.paper:g})" for m in METRICS[PATH])
    head = ["path", near, "less drift at engagement, m", turn, "inside", "lost"]
    rows = []
    for row in found["rows"]:
        largest = row["max"]
        drifts = largest.get(f"position, {TRUTH_LESS_DRIFT}")
        rows.append(
            [
                f"{row['scenario'].replace('_', ' ')}, {row['world']}, {row['gps']}",
                f"{largest[f'position, {TRUTH}']:.2f}",
                "–" if drifts is None else f"{drifts:.2f}",
                f"{largest[f'heading, {TRUTH}']:.1f}",
                str(row["inside"]),
                str(row["lost"]),
            ]
        )
    winds = {row["world"]: [row["conditions"]] for row in found["rows"]}
    return (
        f"{grid(head, rows)}\n\nLargest from 5 s to the end, truth, {results.seeds('paths')}; "
        f"inside and lost: of {len(found['seeds'])} flights, by the records that a receiver is "
        f"judged by (standalone: navigation alone). {world(winds)}"
    )


if __name__ == "__main__":
    main()
