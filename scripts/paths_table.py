# SPDX-License-Identifier: Apache-2.0
"""How closely the scenarios along a path are flown, in two worlds with both receivers; JSON.

Usage: ./heli python scripts/paths_table.py [--seeds 1..20]
"""

import json
from typing import Any

from seeds_option import parser_with_seeds

from heli_flight.loop.result import conditions
from heli_flight.loop.scoring import DECIDES, sources_of
from heli_flight.loop.settings import resolve
from heli_flight.studies.campaign import fly_seeds, inside_of, worst

SCENARIOS = ("figure_eight", "orbit", "waypoints")
WORLDS, RECEIVERS = ("paper", "honest"), ("rtk", "standalone")


def row(scenario: str, world: str, gps: str, seeds: list[int]) -> dict[str, Any]:
    """Largest errors of a scenario from 5 s on, per metric and record."""
    settings = resolve(scenario, gps, world=world)
    flown = fly_seeds(settings, seeds)
    largest = worst(flown, DECIDES)
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


if __name__ == "__main__":
    main()
