# SPDX-License-Identifier: Apache-2.0
"""The attitude loop over the airspeed, and forward flight at 10 m/s as it is flown; JSON.

Usage: ./heli python scripts/airspeed_table.py [--seeds 1..20]
"""

import json
import os
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from seeds_option import parser_with_seeds

from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.result import conditions
from heli_flight.loop.settings import resolve
from heli_flight.studies.robust.airspeed import ACROSS_MPS, SPEEDS_MPS, OverAirspeed, over_airspeed
from heli_math.paper_metrics import attitude_errors
from heli_math.rows import ACTUATOR, REFERENCE

LAWS = ("packaged", "hinf", "lqg", "pid", "indi")
WORLDS, RECEIVERS = ("paper", "honest"), ("rtk", "standalone")
_SETTLED_S = 5.0


def over_speeds(found: OverAirspeed) -> list[dict[str, Any]]:
    """Per speed ahead: trim straight ahead, the slowest mode and the least margins of all there."""
    rows = []
    for speed in SPEEDS_MPS:
        there = [p for p in found.points if p.point.ahead_mps == speed]
        straight = [p for p in there if p.point.right_mps == 0.0]
        lon = [float(p.u[ACTUATOR.lon]) for p in straight]
        rows.append(
            {
                "ahead_mps": speed,
                "phi_theta_deg": np.degrees(straight[0].attitude_rad).tolist(),
                "d_lon": [min(lon), max(lon)],
                "d_col": float(straight[0].u[ACTUATOR.col]),
                "radius": max(p.judgement.radius for p in there),
                "disk_input": min(p.judgement.disk_input for p in there),
                "disk_output": min(p.judgement.disk_output for p in there),
            }
        )
    return rows


def bound_of(name: str, found: OverAirspeed) -> dict[str, Any]:
    """What the loops straight ahead share."""
    refused = isinstance(found.bound, str)
    return {
        "laws": name,
        "contraction": None if isinstance(found.bound, str) else found.bound.contraction,
        "between": None if refused else found.between,
        "radius": max(p.judgement.radius for p in found.points),
        "disk_input": min(p.judgement.disk_input for p in found.points),
        "disk_output": min(p.judgement.disk_output for p in found.points),
    }


def flights(world: str, gps: str, seeds: list[int]) -> dict[str, Any]:
    """Largest errors of the scenario forward_flight from 5 s on, truth."""
    settings = resolve("forward_flight", gps, world=world)
    largest: dict[str, float] = {}
    lost = 0
    for seed in seeds:
        flight = simulate(settings.with_seed(seed))
        lost += bool(flight.status)
        r = flight.record
        on = r.time_s >= _SETTLED_S
        away = r.truth_pos_ned_m - r.reference[:, REFERENCE.pos]
        own = {
            **attitude_errors(r.truth_q_nb, r.setpoint),
            "altitude": away[:, 2],
            "position": np.linalg.norm(away, axis=1),
            "speed": np.linalg.norm(r.truth_vel_ned_mps, axis=1),
            "airspeed": np.linalg.norm(r.truth_vel_ned_mps - r.wind_ned_mps, axis=1),
        }
        for key, values in own.items():
            largest[key] = max(largest.get(key, 0.0), float(np.max(np.abs(values[on]))))
    return {
        "world": world,
        "gps": gps,
        "conditions": conditions(settings).splitlines(),
        "lost": lost,
        "max": largest,
    }


def main() -> None:
    """Print what was found."""
    seeds = parser_with_seeds(__doc__, "1..20").parse_args().seeds
    packaged = over_airspeed(resolve())
    others = [bound_of(name, over_airspeed(resolve(laws=name))) for name in LAWS[1:]]
    found = {
        "seeds": seeds,
        "across_mps": ACROSS_MPS,
        "speeds": over_speeds(packaged),
        "bounds": [bound_of(LAWS[0], packaged), *others],
        "flights": [flights(world, gps, seeds) for world in WORLDS for gps in RECEIVERS],
    }
    print(json.dumps(found, indent=2))


if __name__ == "__main__":
    main()
