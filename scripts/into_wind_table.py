# SPDX-License-Identifier: Apache-2.0
"""How well the nose is turned into the wind, over seeds, winds and worlds; JSON.

Usage: ./heli python scripts/into_wind_table.py [--seeds 1..20]
"""

import json
from typing import Any

import numpy as np
from seeds_option import parser_with_seeds

from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.result import conditions
from heli_flight.loop.settings import Settings, resolve
from heli_math.rotations import euler_angles

WORLDS = ("paper", "honest")
WINDS_MPS = (3.0, 5.0)
_LAST_S = 20.0
_WITHIN_DEG = 20.0
# From the start of hover on; the nose points north at first, the wind comes from anywhere.
_HOVER = {"goto.heading": "wind", "commands.at_s": [2.0], "commands.what": ["takeoff"],
          "commands.goto_ned_m": []}  # fmt: skip


def towards_deg(seed: int) -> float:
    """Direction of the wind of a flight, deg."""
    return float(np.random.default_rng(seed).uniform(0.0, 360.0))


def settings(world: str, wind_mps: float, seed: int) -> Settings:
    """A hover at 10 m after a take-off."""
    air = {"wind.towards_deg": towards_deg(seed), "wind.profile_speed_mps": [wind_mps] * 3}
    if world == "honest":
        air["wind.w20_mps"] = wind_mps
    overrides = {"plant": air, "outer_loop": _HOVER}
    return resolve("takeoff_land", "standalone", seed, world=world, overrides=overrides)


def flown(world: str, wind_mps: float, seed: int) -> tuple[float, float | None]:
    """Mean angle between nose and mean wind at the end, deg; time from which on it is small, s."""
    given = settings(world, wind_mps, seed)
    record = simulate(given).record
    psi_deg = np.degrees(np.unwrap(euler_angles(record.truth_q_nb)[:, 2]))
    last = record.time_s > record.time_s[-1] - _LAST_S
    off = (psi_deg - towards_deg(seed)) % 360.0 - 180.0
    mean = float((psi_deg[last].mean() - towards_deg(seed)) % 360.0 - 180.0)
    hovers = record.mode == "hover"
    far = np.flatnonzero(np.abs(off) > _WITHIN_DEG)
    since = record.time_s[far[-1]] - record.time_s[np.flatnonzero(hovers)[0]] if far.size else 0.0
    return abs(mean), None if abs(mean) > _WITHIN_DEG else max(float(since), 0.0)


def row(world: str, wind_mps: float, seeds: list[int]) -> dict[str, Any]:
    """Figures of a world and wind."""
    found = [flown(world, wind_mps, seed) for seed in seeds]
    off = np.array([mean for mean, _ in found])
    took = [since for _, since in found if since is not None]
    return {
        "world": world,
        "wind_mps": wind_mps,
        "conditions": conditions(settings(world, wind_mps, seeds[0])).splitlines(),
        "median_deg": float(np.median(off)),
        "max_deg": float(off.max()),
        "within": int((off <= _WITHIN_DEG).sum()),
        "median_took_s": float(np.median(took)) if took else None,
    }


def main() -> None:
    """Print the rows."""
    seeds = parser_with_seeds(__doc__, "1..20").parse_args().seeds
    rows = [row(world, wind, seeds) for world in WORLDS for wind in WINDS_MPS]
    print(json.dumps({"seeds": seeds, "within_deg": _WITHIN_DEG, "rows": rows}, indent=2))


if __name__ == "__main__":
    main()
