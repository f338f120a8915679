# SPDX-License-Identifier: Apache-2.0
"""Hovers with faults of the links between nodes: how far off, tilt, lost; both receivers; JSON.

Usage: ./heli python -m evidence.experiments.links [--seeds 1..10]
"""

import sys
from functools import cache
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid
from heli_core.rows import REFERENCE
from heli_core.ticks import TICKS_PER_S
from heli_flight.layers import NODES
from heli_flight.loop import LoopFlight, simulate
from heli_flight.settings import Settings, resolve
from heli_msgs_bridge import topics
from heli_msgs_bridge.links import ALWAYS

WORLD, RECEIVERS = "honest", ("rtk", "standalone")
BEGIN_S, END_S = 12.0, 60.0
_STAYS = {"climb.start_s": 200.0, "climb.end_s": 202.0}


def _fault(kind: str, value: float, duration_s: float | None = None, **over: str) -> str:
    fault = {"what": "link", "from": "any", "to": "any", **over, "kind": kind, "value": value}
    fault |= {"start_s": BEGIN_S} | ({} if duration_s is None else {"duration_s": duration_s})
    return "{" + ", ".join(f"{key}: {setting}" for key, setting in fault.items()) + "}"


def _one(topic: str, sink: str, kind: str, value: float, for_s: float | None = None) -> str:
    return _fault(kind, value, for_s, to=sink, topic=topic)


_ODOM, _ACTUATORS = topics.ODOM, topics.ACTUATORS
ROWS: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("20 % loss and 30 ms on all", (_fault("loss", 0.2), _fault("delay", 0.03))),
    ("20 % loss on all", (_fault("loss", 0.2),)),
    ("50 % loss on all", (_fault("loss", 0.5),)),
    ("30 ms on all", (_fault("delay", 0.03),)),
    ("every pair exchanged on all", (_fault("reorder", 1.0),)),
    ("every message twice on all", (_fault("duplicate", 1.0),)),
    *(
        (f"50 % loss on `{topic}` to {sink}", (_one(topic, sink, "loss", 0.5),))
        for topic, sink in ALWAYS
    ),
    ("100 ms on `odom`", (_fault("delay", 0.1, topic=_ODOM),)),
    ("100 ms on `odom` to inner_loop", (_one(_ODOM, "inner_loop", "delay", 0.1),)),
    ("100 ms on `odom` to outer_loop", (_one(_ODOM, "outer_loop", "delay", 0.1),)),
    ("100 ms on `imu/data_raw`", (_fault("delay", 0.1, topic=topics.IMU),)),
    ("50 ms on `actuators`", (_fault("delay", 0.05, topic=_ACTUATORS),)),
    ("100 ms on `actuators`", (_fault("delay", 0.1, topic=_ACTUATORS),)),
    ("`odom` to inner_loop lost for 0.5 s", (_one(_ODOM, "inner_loop", "loss", 1.0, 0.5),)),
    ("`odom` to outer_loop lost for 0.5 s", (_one(_ODOM, "outer_loop", "loss", 1.0, 0.5),)),
    ("`imu/data_raw` lost for 0.5 s", (_fault("loss", 1.0, 0.5, topic=topics.IMU),)),
    ("`actuators` to plant lost for 0.5 s", (_one(_ACTUATORS, "plant", "loss", 1.0, 0.5),)),
    ("set-points lost for 2 s",
     (_fault("loss", 1.0, 2.0, **{"from": "outer_loop", "to": "inner_loop"}),)),
)  # fmt: skip
"""Words and faults."""
_FAULTS = dict(ROWS)


def settings(faults: tuple[str, ...], gps: str, seed: int) -> Settings:
    """A hover at its place, with faults from `BEGIN_S` on."""
    over: dict[str, dict[str, Any]] = {node.name: {"link_faults": faults} for node in NODES}
    return resolve("hover", gps, seed, END_S, world=WORLD, overrides=over | {"scenario": _STAYS})


def tilt_deg(flight: LoopFlight) -> float:
    """Largest tilt from `BEGIN_S` on."""
    _, x, y, _ = flight.record.truth_q_nb[round(BEGIN_S * TICKS_PER_S) :].T
    return float(np.degrees(np.arccos(1.0 - 2.0 * (x * x + y * y))).max())


@cache
def sound(gps: str, seed: int) -> tuple[np.ndarray, float]:
    """Positions, NED, m, and largest tilt, deg, of the flight without a fault."""
    flight = simulate(settings(("none",), gps, seed))
    return flight.record.truth_pos_ned_m, tilt_deg(flight)


@over(fault=tuple(_FAULTS), gps=RECEIVERS)
def flown(fault: str, gps: str, seed: int) -> dict[str, Any]:
    """Figures of a flight."""
    flight = simulate(settings(_FAULTS[fault], gps, seed))
    begun, pos = round(BEGIN_S * TICKS_PER_S), flight.record.truth_pos_ned_m
    asked = flight.record.reference[begun:, REFERENCE.pos]
    whole, sound_tilt_deg = sound(gps, seed)
    return {
        "lost": bool(flight.status),
        "gave_up": bool((asked != asked[0]).any()),
        "off_m": float(np.linalg.norm((pos - whole[: len(pos)])[begun:], axis=1).max()),
        "tilt_deg": tilt_deg(flight),
        "place_m": float(np.linalg.norm(pos[begun:] - asked[0], axis=1).max()),
        "sound_tilt_deg": sound_tilt_deg,
    }


def row(place: Place[dict[str, Any]]) -> dict[str, Any]:
    """Figures of a fault with a receiver."""
    flights = place.flights

    def most(key: str) -> float:
        return max(one[key] for one in flights)

    return {
        **place.point,
        "faults": list(_FAULTS[place.point["fault"]]),
        "lost": sum(one["lost"] for one in flights),
        "gave_up": sum(one["gave_up"] for one in flights),
        "median": {"off_m": float(np.median([one["off_m"] for one in flights]))},
        "max": {key: most(key) for key in ("off_m", "tilt_deg", "place_m")},
        "sound": {"tilt_deg": most("sound_tilt_deg")},
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows."""
    content = {"seeds": options.seeds, "world": WORLD, "begin_s": BEGIN_S, "end_s": END_S}
    return content | {"rows": [row(place) for place in flown.places(options)]}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "links",
    "./heli python -m evidence.experiments.links --seeds 1..10",
    "Hovers with faults of the links between nodes, with both receivers.",
    tuple(range(1, 11)),
    # What is nearly lost keeps no difference small.
    MARGIN,
)


@table("links")
def links(results: Results) -> str:
    """Faults of links in the hover: lost, off, tilt."""
    record = results["links"]
    head = ["fault", "receiver", "lost", "gave up its place", "off, m: median / worst",
            "from its place, m, worst", "tilt, deg, worst", "without the fault"]  # fmt: skip
    rows = []
    for row in record["rows"]:
        most, sound = row["max"], row["sound"]
        rows.append([
            row["fault"], row["gps"], str(row["lost"]), str(row["gave_up"]),
            f"{row['median']['off_m']:.2f} / {most['off_m']:.2f}", f"{most['place_m']:.2f}",
            f"{most['tilt_deg']:.1f}", f"{sound['tilt_deg']:.1f}",
        ])  # fmt: skip
    return (
        f"{grid(head, rows)}\n\nOf {len(record['seeds'])} flights each (seeds {record['seeds'][0]} "
        f"to {record['seeds'][-1]}): hover at 10 m, world {record['world']}, default controllers, "
        f"one process, the fault from {record['begin_s']:g} s on, {record['end_s']:g} s long. Off: "
        "largest distance from the same flight without the fault; from its place: from the first "
        "reference; both from truth, lost ones among them until they are. Gave up its place: the "
        "position counted as lost meanwhile, and another one was held when it was found again."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..10"))
