# SPDX-License-Identifier: Apache-2.0
"""Hovers whose engine stops: how fast they touch down with the failsafe and without; JSON.

Usage: ./heli python -m evidence.experiments.engine_out [--seeds 11..20]
"""

import sys
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid
from heli_core.ticks import TICKS_PER_S
from heli_dynamics_sim.config import PlantConfig
from heli_flight.loop import simulate
from heli_flight.settings import Settings, resolve

WORLDS, NAVIGATIONS, HEIGHTS_M = ("honest", "hard"), ("truth", "rtk", "standalone"), (10.0, 20.0)
BEGIN_S, END_S = 12.0, 26.0
SKIDS_M, GEAR_MPS, UPRIGHT_DEG = 0.3, 1.5, 20.0
"""Height of the c.g. that counts as touch-down; what the gear bears; tilt of one that stands."""
_STAYS = {"climb.start_s": 200.0, "climb.end_s": 202.0}
_OFF = {"failsafe.rotor_slow_share": 0.0}


def settings(world: str, navigation: str, height_m: float, failsafe: bool, seed: int) -> Settings:
    """A hover at its place whose engine stops at `BEGIN_S`."""
    stops = f"{{what: engine, kind: stop, start_s: {BEGIN_S}}}"
    over: dict[str, dict[str, Any]] = {
        "plant": {"faults": (stops,)},
        "scenario": {**_STAYS, "start_pos_ned_m": [0.0, 0.0, -height_m]},
        "outer_loop": {} if failsafe else _OFF,
    }
    gps = "rtk" if navigation == "truth" else navigation
    return resolve("hover", gps, seed, END_S, world=world, overrides=over)


@over(world=WORLDS, height_m=HEIGHTS_M, navigation=NAVIGATIONS, failsafe=(False, True))
def touch_down(
    world: str, height_m: float, navigation: str, failsafe: bool, seed: int
) -> dict[str, Any]:
    """Speed down and along the ground, m/s, and tilt, deg, as it touches down."""
    scenario = settings(world, navigation, height_m, failsafe, seed)
    record = simulate(scenario, true_navigation=navigation == "truth").record
    begun = round(BEGIN_S * TICKS_PER_S)
    low = np.flatnonzero(-record.truth_pos_ned_m[begun:, 2] < SKIDS_M)
    at = begun + int(low[0]) if len(low) else len(record.time_s) - 1
    north, east, down = record.truth_vel_ned_mps[at]
    _, x, y, _ = record.truth_q_nb[at]
    stands = record.mode is not None and bool((record.mode == "standing").any())
    return {
        "down_mps": float(down),
        "along_mps": float(np.hypot(north, east)),
        "tilt_deg": float(np.degrees(np.arccos(1.0 - 2.0 * (x * x + y * y)))),
        "after_s": at / TICKS_PER_S - BEGIN_S,
        "stands": stands,
    }


def row(place: Place[dict[str, Any]]) -> dict[str, Any]:
    """Figures of a world, a navigation and a height."""
    flights = place.flights
    worst = {
        key: max(one[key] for one in flights)
        for key in ("down_mps", "along_mps", "tilt_deg", "after_s")
    }
    kept = [one["down_mps"] < GEAR_MPS and one["tilt_deg"] < UPRIGHT_DEG for one in flights]
    return {
        **{axis: place.point[axis] for axis in ("world", "navigation", "height_m", "failsafe")},
        "kept": sum(kept),
        "stands": sum(one["stands"] for one in flights),
        "median": {"down_mps": float(np.median([one["down_mps"] for one in flights]))},
        "max": worst,
    }


def energies() -> dict[str, float]:
    """What the rotor holds at its speed, J, and what the weight gives per metre, J."""
    aircraft = PlantConfig.from_parameters(resolve("hover").nodes["plant"]).params.aircraft
    engine, body = aircraft.engine, aircraft.body
    return {
        "rotor_j": 0.5 * engine.inertia * engine.speed**2,
        "fall_j_per_m": body.mass * body.gravity,
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows."""
    rows = [row(place) for place in touch_down.places(options)]
    return {
        "seeds": options.seeds, "begin_s": BEGIN_S, "gear_mps": GEAR_MPS, "tilt_deg": UPRIGHT_DEG,
        **energies(), "rows": rows,
    }  # fmt: skip


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "engine_out",
    "./heli python -m evidence.experiments.engine_out --seeds 11..20",
    "Hovers whose engine stops, with the failsafe and without.",
    tuple(range(11, 21)),
    # What falls without an engine keeps no difference small.
    MARGIN,
)


@table("engine_out")
def engine_out(results: Results) -> str:
    """Hovers whose engine stops: touch-down before and after the failsafe."""
    record = results["engine_out"]
    n = len(record["seeds"])

    def key(row: Any) -> tuple[Any, ...]:
        return row["world"], row["height_m"], row["navigation"]

    before = {key(row): row for row in record["rows"] if not row["failsafe"]}
    rows = []
    for row in record["rows"]:
        if not row["failsafe"]:
            continue
        most, was = row["max"], before[key(row)]
        rows.append([
            row["world"], f"{row['height_m']:g}", row["navigation"],
            f"{was['median']['down_mps']:.1f} / {was['max']['down_mps']:.1f}",
            f"{row['median']['down_mps']:.1f} / {most['down_mps']:.1f}",
            f"{was['kept']} to {row['kept']} of {n}", f"{row['stands']} of {n}",
            f"{most['tilt_deg']:.0f}", f"{most['along_mps']:.1f}", f"{most['after_s']:.1f}",
        ])  # fmt: skip
    head = ["world", "from, m", "navigation", "before, m/s: median / worst",
            "with it, m/s: median / worst", "gear kept", "stood", "tilt, deg", "along, m/s",
            "after, s"]  # fmt: skip
    return (
        f"{grid(head, rows)}\n\nOf {n} flights each (seeds {record['seeds'][0]} to "
        f"{record['seeds'][-1]}, none of those on which it was made): speed downwards at the "
        f"touch-down, the failsafe off and on. Gear kept: slower than {record['gear_mps']:g} m/s "
        f"and tilted less than {record['tilt_deg']:g} deg. Stood: the mode standing was reached. "
        "The last three: worst with the failsafe. Navigation truth: the loops get the true state. "
        f"At its speed the rotor holds {record['rotor_j']:.0f} J; the weight gives "
        f"{record['fall_j_per_m']:.0f} J per metre of height."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "11..20"))
