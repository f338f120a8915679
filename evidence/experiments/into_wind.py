# SPDX-License-Identifier: Apache-2.0
"""How well the nose is turned into the wind, over seeds, winds and worlds; JSON.

Usage: ./heli python -m evidence.experiments.into_wind [--seeds 1..20]
"""

import sys
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import TWENTY, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid
from heli_core.rotations import euler_angles
from heli_flight.loop import simulate
from heli_flight.result import conditions
from heli_flight.settings import Settings, resolve

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
    air: dict[str, Any] = {
        "wind.towards_deg": towards_deg(seed),
        "wind.profile_speed_mps": [wind_mps] * 3,
    }
    if world == "honest":
        air["wind.w20_mps"] = wind_mps
    overrides = {"plant": air, "outer_loop": _HOVER}
    return resolve("takeoff_land", "standalone", seed, world=world, overrides=overrides)


@over(world=WORLDS, wind_mps=WINDS_MPS)
def flown(world: str, wind_mps: float, seed: int) -> tuple[float, float | None]:
    """Mean angle between nose and mean wind at the end, deg; time from which on it is small, s."""
    scenario = settings(world, wind_mps, seed)
    record = simulate(scenario).record
    psi_deg = np.degrees(np.unwrap(euler_angles(record.truth_q_nb)[:, 2]))
    last = record.time_s > record.time_s[-1] - _LAST_S
    off = (psi_deg - towards_deg(seed)) % 360.0 - 180.0
    mean = float((psi_deg[last].mean() - towards_deg(seed)) % 360.0 - 180.0)
    hovers = record.mode == "hover"
    far = np.flatnonzero(np.abs(off) > _WITHIN_DEG)
    since = record.time_s[far[-1]] - record.time_s[np.flatnonzero(hovers)[0]] if far.size else 0.0
    return abs(mean), None if abs(mean) > _WITHIN_DEG else max(float(since), 0.0)


def row(place: Place[tuple[float, float | None]], seeds: list[int]) -> dict[str, Any]:
    """Figures of a world and wind."""
    off = np.array([mean for mean, _ in place.flights])
    took = [since for _, since in place.flights if since is not None]
    return {
        **place.point,
        "conditions": conditions(settings(**place.point, seed=seeds[0])).splitlines(),
        "median_deg": float(np.median(off)),
        "max_deg": float(off.max()),
        "within": int((off <= _WITHIN_DEG).sum()),
        "median_took_s": float(np.median(took)) if took else None,
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows."""
    rows = [row(place, options.seeds) for place in flown.places(options)]
    return {"seeds": options.seeds, "within_deg": _WITHIN_DEG, "rows": rows}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "into_wind",
    "./heli python -m evidence.experiments.into_wind --seeds 1..20",
    "The nose turned into winds from anywhere, in two worlds.",
    TWENTY,
)


@table("into_wind")
def into_wind(results: Results) -> str:
    """Angle between nose and wind, world by world."""
    record = results["into_wind"]
    near = f"within {record['within_deg']:g} deg"
    head = ["world, wind", "median, deg", "largest, deg", near, "after, median, s"]
    rows = [
        [
            f"{row['world']}, {row['wind_mps']:g} m/s",
            f"{row['median_deg']:.0f}",
            f"{row['max_deg']:.0f}",
            str(row["within"]),
            "–" if row["median_took_s"] is None else f"{row['median_took_s']:.0f}",
        ]
        for row in record["rows"]
    ]
    return (
        f"{grid(head, rows)}\n\nAngle between the nose, truth, mean of the last 20 s of flights of "
        "85 s, and the mean wind, which comes from anywhere; the nose points north at first; "
        f"{results.seeds('into_wind')}; within: of {len(record['seeds'])} flights; after: from the "
        "beginning of the hover. Simulated, turbulence on, standalone receiver."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment))
