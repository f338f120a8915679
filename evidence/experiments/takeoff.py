# SPDX-License-Identifier: Apache-2.0
"""From the ground to the ground over many seeds: winds, slopes, worlds, both receivers; JSON.

Usage: ./heli python -m evidence.experiments.takeoff [--seeds 1..20]
"""

import math
import sys
from typing import Any, NamedTuple

from evidence.files import Results
from evidence.registry import TWENTY, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import GROUND_HEAD, grid, ground_table
from heli_flight.loop import simulate
from heli_flight.result import conditions
from heli_flight.scenario import GROUND_METRICS
from heli_flight.scoring import score
from heli_flight.settings import Settings, resolve

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


def settings(case: Case, gps: str, seed: int | None = None) -> Settings:
    """From the ground to the ground in a case."""
    return resolve("takeoff_land", gps, seed, world=case.world, overrides=case.overrides)


@over(case=CASES, gps=RECEIVERS)
def flown(case: Case, gps: str, seed: int) -> dict[str, Any]:
    """Figures of a flight, whether all are inside, whether it came to nothing."""
    scenario = settings(case, gps, seed)
    flight = simulate(scenario)
    figures = score(flight.record, scenario.scenario).ground
    values = {f.metric.key: f.value for f in figures if f.value is not None}
    return {
        "lost": bool(flight.status),
        "inside": not flight.status and all(figure.inside for figure in figures),
        "broken_off": not flight.status and "takeoff_height" not in values,
        "max": values,
    }


def row(place: Place[dict[str, Any]]) -> dict[str, Any]:
    """Largest figures of a case, how often all are inside, and how often it came to nothing."""
    case, gps = place.point.values()
    largest: dict[str, float] = {}
    for flight in place.flights:
        for key, value in flight["max"].items():
            largest[key] = max(largest.get(key, 0.0), value)
    return {
        "case": case.name,
        "world": case.world,
        "gps": gps,
        "conditions": conditions(settings(case, gps)).splitlines(),
        "max": largest,
        **{key: sum(flight[key] for flight in place.flights)
           for key in ("inside", "broken_off", "lost")},
    }  # fmt: skip


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows."""
    goals = {metric.key: metric.goal for metric in GROUND_METRICS}
    rows = [row(place) for place in flown.places(options)]
    return {"seeds": options.seeds, "goals": goals, "rows": rows}


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
    record = results["takeoff"]
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
        for row in record["rows"]
    ]
    return (
        f"{grid(head, rows)}\n\nLargest over {results.seeds('takeoff')}, truth (height: "
        f"state estimate); inside, broken off, lost: of {len(record['seeds'])} flights of 85 s, "
        "wind with the turbulence that belongs to it."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment))
