# SPDX-License-Identifier: Apache-2.0
"""Print how the navigation's errors compare with the standard deviations that it states, by world.

Usage: ./heli python -m evidence.experiments.consistency [--seeds 1..40] [--json]

The hover test, loop closed: normalised error squared (NEES) over its degrees of freedom, each axis
by the deviation that is sent with it (Y. Bar-Shalom, X. R. Li, T. Kirubarajan, Estimation with
Applications to Tracking and Navigation, 2001, section 5.4), mean from 5 s on. It is 1 for a filter
that knows how good it is. Position and its sigma count from the alignment, as the filter is
packaged, so what of the receiver's first fix lasts (drift, multipath, a wrong fix) is taken off.
"""

import sys
from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import produces, table
from evidence.sweep import Options, over, print_result
from evidence.tables import grid, three
from heli_core.rotations import rotation_between
from heli_core.ticks import ticks_in
from heli_dynamics_sim import plant
from heli_dynamics_sim.config import PlantConfig
from heli_dynamics_sim.sensors import dilution
from heli_flight.layers import GPS_PRESETS
from heli_flight.loop import build, fly_loop
from heli_flight.record import FlightRecord
from heli_flight.settings import Settings, resolve
from heli_inner_hinf.controller_state import AttitudeParams
from heli_inner_hinf.design import AttitudeConfig

WORLDS = ("paper", "honest", "hard")
QUANTITIES = ("position", "velocity", "attitude")
GOAL = (0.7, 1.5)
SETTLED = ticks_in(5.0)


@cache
def settings_of(world: str, gps: str) -> tuple[Settings, AttitudeParams]:
    """The hover test, and its controller."""
    settings = resolve("hover", gps, world=world)
    return settings, AttitudeConfig.from_parameters(settings.nodes["inner_loop"]).params


def lasting_error_m(settings: Settings) -> np.ndarray:
    """What the receiver's first fix is off by (3,), NED, without its white noise.

    The filter aligns by it: it was valid before tick 0.
    """
    config = PlantConfig.from_parameters(settings.nodes["plant"])
    sensors, k = plant.initial_state(config, settings.seed).sensors, config.sensors.gps.errors
    lasting = sensors.gps_drift.copy()
    if k.on:
        lasting += dilution(sensors.gps, k) * sensors.gps.multipath + sensors.gps.jump
    return lasting


@over(world=WORLDS, gps=tuple(GPS_PRESETS))
def normalised(world: str, gps: str, seed: int) -> dict[str, np.ndarray]:
    """Mean over a flight of the normalised errors squared (3,): north, east, down."""
    settings, law = settings_of(world, gps)
    flown = settings.with_seed(seed)
    record = fly_loop(build(flown, law=law), flown).record
    return normalised_of(record, lasting_error_m(flown))


def normalised_of(r: FlightRecord, home_m: np.ndarray) -> dict[str, np.ndarray]:
    """Mean over a flight of the normalised errors squared (3,): north, east, down.

    home_m (3,), NED, is taken off the position's.
    """
    ratios = {
        "position": (r.nav_pos_ned_m - r.truth_pos_ned_m - home_m, r.nav_sigma_pos_m),
        "velocity": (r.nav_vel_ned_mps - r.truth_vel_ned_mps, r.nav_sigma_vel_mps),
        "attitude": (rotation_between(r.truth_q_nb, r.nav_q_nb), r.nav_sigma_att_rad),
    }
    means = {}
    for name, (error, sigma) in ratios.items():
        assert sigma is not None
        means[name] = np.square(error / sigma)[SETTLED:].mean(axis=0)
    return means


def consistency_found(options: Options) -> dict[str, Any]:
    """All that the table shows: by world and receiver the mean over flights, and the worst."""
    rows = []
    for place in normalised.places(options):
        row: dict[str, Any] = {**place.point}
        for name in QUANTITIES:
            row[name] = over_flights([flight[name] for flight in place.flights])
        rows.append(row)
    return {"goal": list(GOAL), "rows": rows}


def over_flights(flights: Sequence[np.ndarray]) -> dict[str, Any]:
    """Normalised errors squared of flights, (3,) each: their mean, and the worst."""
    each = np.array(flights)
    return {
        "nees_over_dof": float(each.mean()),
        "by_axis": each.mean(axis=0).tolist(),
        "median": float(np.median(each.mean(axis=1))),
        "worst": float(each.mean(axis=1).max()),
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "consistency",
    "./heli python -m evidence.experiments.consistency --seeds 1..40 --json",
    "Errors of the navigation beside what it states, in every world.",
    tuple(range(1, 41)),
)


@table("consistency")
def consistency(results: Results) -> str:
    """The navigation's normalised errors squared, by world and receiver."""
    return (
        f"{consistency_table(results['consistency'])}\n\nNormalised error squared over its degrees "
        f"of freedom, {results.seeds('consistency')}, hover test, loop closed, from 5 s on: mean "
        "(north, east, down; the worst flight). Outside of the goal: bold."
    )


def consistency_table(results: Mapping[str, Any]) -> str:
    """The table of what evidence/experiments/consistency.py has found."""
    low, high = results["goal"]
    rows = []
    for row in results["rows"]:
        cells = [f"{row['world']}, {row['gps']}"]
        for name in QUANTITIES:
            cells.append(cell(row[name], results["goal"]))
        rows.append(cells)
    return grid(["world, GPS", *(f"{name}, goal {low:g} to {high:g}" for name in QUANTITIES)], rows)


def cell(found: Mapping[str, Any], goal: Sequence[float]) -> str:
    """Mean (by axis; worst flight) of `over_flights`; bold outside of the goal."""
    low, high = goal
    mean = f"{found['nees_over_dof']:.2f}"
    mean = mean if low <= found["nees_over_dof"] <= high else f"**{mean}**"
    return f"{mean} ({three(found['by_axis'], 2)}; {found['worst']:.1f})"


if __name__ == "__main__":
    sys.exit(print_result(__doc__, consistency_found, tables=consistency_table))
