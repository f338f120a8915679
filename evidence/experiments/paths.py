# SPDX-License-Identifier: Apache-2.0
"""How closely the scenarios along a path are flown, in two worlds with both receivers; JSON.

Usage: ./heli python -m evidence.experiments.paths [--seeds 1..20]
"""

import sys
from typing import Any

from evidence.files import Results
from evidence.registry import TWENTY, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid, world
from heli_core.metrics import METRICS, PATH
from heli_flight.result import conditions
from heli_flight.scoring import DECIDES, TRUTH, TRUTH_LESS_DRIFT, sources_of
from heli_flight.settings import resolve
from heli_studies.campaign.run import FlownSeed, fly_seeds, inside_of, worst_of_seeds

SCENARIOS = ("figure_eight", "orbit", "waypoints")
WORLDS, RECEIVERS = ("paper", "honest"), ("rtk", "standalone")


@over(scenario=SCENARIOS, world=WORLDS, gps=RECEIVERS)
def flown(scenario: str, world: str, gps: str, seed: int) -> FlownSeed:
    """Figures of a flight."""
    return fly_seeds(resolve(scenario, gps, world=world), [seed])[0]


def row(place: Place[FlownSeed]) -> dict[str, Any]:
    """Largest errors of a scenario from 5 s on, per metric and record."""
    scenario, world, gps = place.point.values()
    largest = worst_of_seeds(place.flights, DECIDES)
    return {
        **place.point,
        "conditions": conditions(resolve(scenario, gps, world=world)).splitlines(),
        "inside": inside_of(place.flights, gps, DECIDES),
        "lost": sum(bool(flight.lost) for flight in place.flights),
        "max": {
            f"{key}, {source}": score.max
            for (key, source), score in largest.items()
            if source in sources_of(gps)
        },
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows."""
    return {"seeds": options.seeds, "rows": [row(place) for place in flown.places(options)]}


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
    record = results["paths"]
    near, turn = (f"{m.label}, {m.unit} (goal {m.paper:g})" for m in METRICS[PATH])
    head = ["path", near, "drift-corrected, m", turn, "inside", "lost"]
    rows = []
    for row in record["rows"]:
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
    winds = {row["world"]: [row["conditions"]] for row in record["rows"]}
    return (
        f"{grid(head, rows)}\n\nLargest from 5 s to the end, truth, {results.seeds('paths')}; "
        f"inside and lost: of {len(record['seeds'])} flights, by the records that a receiver is "
        f"judged by (standalone: navigation alone). {world(winds)}"
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment))
