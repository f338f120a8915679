# SPDX-License-Identifier: Apache-2.0
"""From the ground to the ground over many seeds: winds, slopes, worlds, both receivers; JSON.

Usage: ./heli python -m evidence.experiments.takeoff [--seeds 1..20]
"""

import json
import math
from typing import Any, NamedTuple

from evidence.files import Results
from evidence.options import parser_with_seeds
from evidence.registry import TWENTY, produces, table
from evidence.tables import GROUND_HEAD, grid, ground_table
from heli_flight.loop import simulate
from heli_flight.result import conditions
from heli_flight.scenario import GROUND_METRICS
from heli_flight.scoring import score
from heli_flight.settings import resolve

RECEIVERS = ("rtk", "standalone")
SLOPE_DEG = 5.0
_RISE = math.tan(math.radians(SLOPE_DEG))


class Case(NamedTuple):
    """What is beside the scenario's own: air, ground, world."""

    name: str
    world: str = "paper"
    wind_mps: float | None = None
    towards_deg: float = 225.0
    slope: tuple[float, float] = (0.0, 0.0)

    @property
    def overrides(self) -> dict[str, dict[str, Any]]:
        """For `resolve`."""
        if self.wind_mps is None:
            return {}
        return {
            "plant": {
                "wind.profile_speed_mps": [self.wind_mps] * 3,
                "wind.towards_deg": self.towards_deg,
                "ground.slope": list(self.slope),
            }
        }


# The nose points north, where the ground rises ahead, or east, where it rises to the right.
CASES = (
    Case("level, hover test's wind"),
    Case("level, 5 m/s", wind_mps=5.0),
    Case("5 deg up ahead, 5 m/s from ahead", wind_mps=5.0, towards_deg=180.0, slope=(_RISE, 0.0)),
    Case("5 deg up ahead, 5 m/s from behind", wind_mps=5.0, towards_deg=0.0, slope=(_RISE, 0.0)),
    Case("5 deg up ahead, 5 m/s from the side", wind_mps=5.0, towards_deg=90.0, slope=(_RISE, 0.0)),
    Case("5 deg up right, 5 m/s up the slope", wind_mps=5.0, towards_deg=90.0, slope=(0.0, _RISE)),
    Case(
        "5 deg up right, 5 m/s down the slope", wind_mps=5.0, towards_deg=270.0, slope=(0.0, _RISE)
    ),
    Case("level, the world's wind", world="honest"),
)


def row(case: Case, gps: str, seeds: list[int]) -> dict[str, Any]:
    """Largest figures of a case, how often all are inside, and how often it came to nothing."""
    settings = resolve("takeoff_land", gps, world=case.world, overrides=case.overrides)
    largest: dict[str, float] = {}
    inside = broken_off = lost = 0
    for seed in seeds:
        own = resolve("takeoff_land", gps, seed, world=case.world, overrides=case.overrides)
        flight = simulate(own)
        lost += bool(flight.status)
        figures = score(flight.record, own.scenario).ground
        inside += not flight.status and all(figure.inside for figure in figures)
        values = {f.metric.key: f.value for f in figures if f.value is not None}
        broken_off += not flight.status and "takeoff_height" not in values
        for key, value in values.items():
            largest[key] = max(largest.get(key, 0.0), value)
    return {
        "case": case.name,
        "world": case.world,
        "gps": gps,
        "conditions": conditions(settings).splitlines(),
        "max": largest,
        "inside": inside,
        "broken_off": broken_off,
        "lost": lost,
    }


def main() -> None:
    """Print the rows."""
    seeds = parser_with_seeds(__doc__, "1..20").parse_args().seeds
    rows = [row(case, gps, seeds) for case in CASES for gps in RECEIVERS]
    goals = {metric.key: metric.goal for metric in GROUND_METRICS}
    print(json.dumps({"seeds": seeds, "goals": goals, "rows": rows}, indent=2))


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "takeoff",
    "./heli python -m evidence.experiments.takeoff --seeds 1..20",
    "The scenario takeoff_land in winds, on slopes, in two worlds, with both receivers.",
    TWENTY,
)


@table("takeoff")
def takeoff(results: Results) -> str:
    """Largest figures of take-off and landing, case by case."""
    found = results["takeoff"]
    head = [
        "ground and wind, world, receiver",
        *GROUND_HEAD,
        "all inside",
        "take-off broken off",
        "lost",
    ]
    rows = [
        [
            f"{row['case']}, {row['world']}, {row['gps']}",
            *ground_table(row),
            str(row["inside"]),
            str(row["broken_off"]),
            str(row["lost"]),
        ]
        for row in found["rows"]
    ]
    return (
        f"{grid(head, rows)}\n\nLargest over {results.seeds('takeoff')}, truth (height: "
        f"navigation record); inside, broken off, lost: of {len(found['seeds'])} flights of 85 s, "
        "wind with the turbulence that belongs to it."
    )


if __name__ == "__main__":
    main()
