# SPDX-License-Identifier: Apache-2.0
"""The paper's own sequence over many seeds, two worlds, both receivers: ground, changes; JSON.

Usage: ./heli python -m evidence.experiments.sequence [--seeds 1..20]

A change of modes is what the first command of the new mode differs from the last one of the old;
later: the largest step of the set-point in the two seconds after.
"""

import sys
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import TWENTY, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import GROUND_HEAD, grid, ground_table
from heli_core.rotations import euler_angles, wrap_pi
from heli_core.rows import ACTUATOR
from heli_flight.loop import simulate
from heli_flight.record import FlightRecord
from heli_flight.result import conditions
from heli_flight.scenario import GROUND_METRICS
from heli_flight.scoring import score
from heli_flight.settings import resolve

SCENARIO = "sequence"
WORLDS, RECEIVERS = ("paper", "honest"), ("rtk", "standalone")
_AFTER_TICKS = 200
_AIR_M = 1.0
"""Changes above so much are counted: below it the ground carries a part."""


def changes(record: FlightRecord, period: int) -> list[dict[str, Any]]:
    """Steps of the set-point, deg, and the collective at each change of modes in the air."""
    assert record.mode is not None  # the scenario begins on the ground
    entries = []
    began = np.flatnonzero(record.mode[1:] != record.mode[:-1]) + 1
    tilt = np.degrees(np.hypot(*euler_angles(record.truth_q_nb)[:, :2].T))
    for i in began.tolist():
        first = i + period
        if -record.truth_pos_ned_m[i, 2] < _AIR_M or first >= len(record):
            continue
        later = np.unwrap(record.setpoint[first : i + _AFTER_TICKS : period], axis=0)
        turned = [wrap_pi(float(a)) for a in record.setpoint[first] - record.setpoint[i]]
        entries.append(
            {
                "change": f"{record.mode[i - 1]} to {record.mode[i]}",
                "attitude_deg": float(np.degrees(np.abs(turned).max())),
                "collective": float(abs(record.u[first, ACTUATOR.col] - record.u[i, ACTUATOR.col])),
                "later_deg": float(np.degrees(np.abs(np.diff(later, axis=0)).max())),
                "tilt_deg": float(tilt[i : i + _AFTER_TICKS].max()),
            }
        )
    return entries


def worst(flights: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Of each change the largest of each number, and how often it was flown."""
    rows = []
    for name in dict.fromkeys(one["change"] for one in flights):
        these = [one for one in flights if one["change"] == name]
        largest = {
            key: max(one[key] for one in these)
            for key in ("attitude_deg", "collective", "later_deg", "tilt_deg")
        }
        rows.append({"change": name, "flown": len(these), **largest})
    return rows


@over(world=WORLDS, gps=RECEIVERS)
def flown(world: str, gps: str, seed: int) -> dict[str, Any]:
    """Figures of a flight on the ground, whether all are inside, and its changes."""
    scenario = resolve(SCENARIO, gps, seed, world=world)
    flight = simulate(scenario)
    figures = score(flight.record, scenario.scenario).ground
    return {
        "lost": bool(flight.status),
        "inside": not flight.status and all(figure.inside for figure in figures),
        "max": {f.metric.key: f.value for f in figures if f.value is not None},
        "changes": changes(flight.record, scenario.nodes["outer_loop"]["period_ticks"]),
    }


def row(place: Place[dict[str, Any]]) -> dict[str, Any]:
    """Largest figures on the ground, how often all are inside, and the changes."""
    largest: dict[str, float] = {}
    for flight in place.flights:
        for key, value in flight["max"].items():
            largest[key] = max(largest.get(key, 0.0), value)
    return {
        **place.point,
        "conditions": conditions(resolve(SCENARIO, **place.point)).splitlines(),
        "max": largest,
        "inside": sum(flight["inside"] for flight in place.flights),
        "lost": sum(flight["lost"] for flight in place.flights),
        "changes": worst([one for flight in place.flights for one in flight["changes"]]),
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    goals = {metric.key: metric.goal for metric in GROUND_METRICS}
    rows = [row(place) for place in flown.places(options)]
    return {"seeds": options.seeds, "goals": goals, "rows": rows}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "sequence",
    "./heli python -m evidence.experiments.sequence --seeds 1..20",
    "The scenario sequence in two worlds with both receivers: ground, changes of modes.",
    TWENTY,
)


@table("sequence")
def sequence(results: Results) -> str:
    """Largest figures of the paper's own sequence on the ground."""
    record = results["sequence"]
    head = ["world, receiver", *GROUND_HEAD, "all inside", "lost"]
    rows = [
        [f"{row['world']}, {row['gps']}", *ground_table(row), str(row["inside"]), str(row["lost"])]
        for row in record["rows"]
    ]
    return (
        f"{grid(head, rows)}\n\nLargest over {results.seeds('sequence')}, truth (height: "
        f"state estimate); inside, lost: of {len(record['seeds'])} flights; the scripted pilot "
        "sees the navigation, 0.2 s late."
    )


@table("sequence_changes")
def sequence_changes(results: Results) -> str:
    """What a change of modes does to the commands, largest over the seeds."""
    record = results["sequence"]
    head = [
        "world, receiver",
        "change",
        "flown",
        "set-point, deg",
        "collective",
        "later set-point, deg",
        "tilt, deg",
    ]
    rows = [
        [
            f"{row['world']}, {row['gps']}",
            one["change"],
            str(one["flown"]),
            f"{one['attitude_deg']:.2f}",
            f"{one['collective']:.4f}",
            f"{one['later_deg']:.2f}",
            f"{one['tilt_deg']:.1f}",
        ]
        for row in record["rows"]
        for one in row["changes"]
    ]
    return (
        f"{grid(head, rows)}\n\nThe first command of the new mode against the last one of the "
        "old, a step of the controller before, with what the receiver's noise makes of it, at "
        "changes more than 1 m above the ground; later set-point: its largest step in the 2 s "
        "after, sticks and reference included; tilt: the largest of these. Largest over "
        f"{results.seeds('sequence')}."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment))
