# SPDX-License-Identifier: Apache-2.0
"""Landings from 10 m after the last fix, in two worlds, with both receivers; JSON.

Usage: ./heli python -m evidence.experiments.blind_landing [--seeds 1..20]
"""

import sys
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import MARGIN, TWENTY, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid
from heli_core.rows import ACTUATOR
from heli_core.ticks import TICKS_PER_S
from heli_flight.loop import simulate
from heli_flight.record import FlightRecord
from heli_flight.result import conditions
from heli_flight.scoring import score
from heli_flight.settings import Settings, resolve

WORLDS, RECEIVERS = ("paper", "honest"), ("rtk", "standalone")
LAST_FIX_S = 40.0
"""The hover begins about 16 s after the start."""
WAITS_S = (5.0, 30.0, 60.0)
"""From the last fix to the landing."""
ORDERED_ONLY_M = 10000.0
"""Its widest: the landing that is ordered is measured, not the one that would come of itself."""
_DESCENT_S = 45.0
_LIFTED_M, _BEFORE_S = 0.05, 0.5
"""Higher than it ends by the first it is in the air; its sideways speed is of the second before."""


def settings(world: str, gps: str, wait_s: float, seed: int = 1) -> Settings:
    """Take-off, hover, the receiver lost, a landing."""
    orders: dict[str, Any] = {
        "commands.at_s": [2.0, LAST_FIX_S + wait_s],
        "commands.what": ["takeoff", "land"],
        "commands.goto_ned_m": [],
        "failsafe.land_astray_m": ORDERED_ONLY_M,
    }
    lost: dict[str, Any] = {"sensors.gps.outage.from_s": LAST_FIX_S}
    overrides = {"plant": lost, "outer_loop": orders}
    duration_s = LAST_FIX_S + wait_s + _DESCENT_S
    return resolve("takeoff_land", gps, seed, duration_s, world=world, overrides=overrides)


def lost_at(record: FlightRecord, period: int, limit_mps: float) -> int | None:
    """Tick of the controller's step at which the position is lost in the air; None for none."""
    assert record.nav_sigma_vel_mps is not None
    sigma = record.nav_sigma_vel_mps[::period, :2].max(axis=1)
    beyond = np.flatnonzero(sigma > limit_mps) * period
    return int(beyond[0]) if beyond.size and beyond[0] < _last_in_the_air(record) else None


def _last_in_the_air(record: FlightRecord) -> int:
    """Last tick at which it is higher than it ends."""
    down = record.truth_pos_ned_m[:, 2]
    return int(np.flatnonzero(down < down[-1] - _LIFTED_M)[-1])


@over(world=WORLDS, gps=RECEIVERS, wait_s=WAITS_S)
def flown(world: str, gps: str, wait_s: float, seed: int) -> dict[str, Any]:
    """Figures of a flight; None where there are none."""
    scenario = settings(world, gps, wait_s, seed)
    flight = simulate(scenario)
    record, law = flight.record, scenario.nodes["outer_loop"]
    assert record.mode is not None  # it begins on the ground
    figures = {f.metric.key: f.value for f in score(record, scenario.scenario).ground}
    stands = not flight.status and record.mode[-1] == "standing"
    pos, last = record.truth_pos_ned_m, round(LAST_FIX_S * TICKS_PER_S)
    lost = lost_at(record, law["period_ticks"], law["land.blind_sigma_mps"])
    outcome: dict[str, Any] = {
        "stands": stands,
        "tilt_deg": figures["touch_down_tilt"],
        "sink_mps": figures["touch_down_speed"],
        "skid_m": figures["landing_skid"],
        "drift_m": float(np.linalg.norm((pos[-1] - pos[last])[:2])),
        "lost_after_s": None if lost is None else lost / TICKS_PER_S - LAST_FIX_S,
        "attitude_deg": None,
        "collective": None,
        "sideways_mps": None,
    }
    if stands:
        before = _last_in_the_air(record) - round(_BEFORE_S * TICKS_PER_S)
        outcome["sideways_mps"] = float(np.linalg.norm(record.truth_vel_ned_mps[before, :2]))
    if lost is not None:
        step = np.diff(np.unwrap(record.setpoint[[lost - 1, lost]], axis=0), axis=0)
        outcome["attitude_deg"] = float(np.degrees(np.abs(step).max()))
        outcome["collective"] = float(abs(np.diff(record.u[[lost - 1, lost], ACTUATOR.col])[0]))
    return outcome


def row(place: Place[dict[str, Any]], seeds: list[int]) -> dict[str, Any]:
    """Figures of a world, a receiver and a time without fixes."""
    flights = place.flights

    def of(key: str) -> list[float]:
        return [one[key] for one in flights if one[key] is not None]

    return {
        **place.point,
        "conditions": conditions(settings(**place.point, seed=seeds[0])).splitlines(),
        "stands": sum(one["stands"] for one in flights),
        "position_lost": len(of("lost_after_s")),
        "median": {
            key: float(np.median(of(key))) if of(key) else None
            for key in ("lost_after_s", "drift_m", "sideways_mps")
        },
        "max": {
            key: max(of(key), default=None)
            for key in ("sink_mps", "sideways_mps", "drift_m", "skid_m", "tilt_deg",
                        "attitude_deg", "collective")
        },
    }  # fmt: skip


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows."""
    rows = [row(place, options.seeds) for place in flown.places(options)]
    return {"seeds": options.seeds, "last_fix_s": LAST_FIX_S, "rows": rows}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "blind_landing",
    "./heli python -m evidence.experiments.blind_landing --seeds 1..20",
    "Landings after the last fix, in two worlds with both receivers.",
    TWENTY,
    # Without a place to hold nothing keeps a difference small.
    MARGIN,
)


@table("blind_landing")
def blind_landing(results: Results) -> str:
    """Landings so long after the last fix, world by world and receiver by receiver."""
    record = results["blind_landing"]

    def cell(value: Any, form: str) -> str:
        return "–" if value is None else f"{value:{form}}"

    head = [
        "world, receiver",
        "landing after, s",
        "stands",
        "position lost",
        "touch-down, m/s",
        "sideways then, m/s",
        "drift, m",
        "skid, m",
        "tilt from the touch-down on, deg",
        "step of the set-point, deg",
        "of the collective",
    ]
    rows = []
    for row in record["rows"]:
        most, median = row["max"], row["median"]
        rows.append(
            [
                f"{row['world']}, {row['gps']}",
                f"{row['wait_s']:.0f}",
                str(row["stands"]),
                str(row["position_lost"]),
                cell(most["sink_mps"], ".2f"),
                f"{cell(median['sideways_mps'], '.1f')} / {cell(most['sideways_mps'], '.1f')}",
                f"{cell(median['drift_m'], '.0f')} / {cell(most['drift_m'], '.0f')}",
                cell(most["skid_m"], ".1f"),
                cell(most["tilt_deg"], ".1f"),
                cell(most["attitude_deg"], ".2f"),
                cell(most["collective"], ".4f"),
            ]
        )
    return (
        f"{grid(head, rows)}\n\nHover at 10 m, the last fix after "
        f"{record['last_fix_s']:.0f} s, the landing commanded so long after it; truth, "
        f"{results.seeds('blind_landing')}. Stands, position lost (in the air): of "
        f"{len(record['seeds'])} flights; largest, sideways and drift since the last fix: median / "
        "largest; sideways: half a second before it stands; step: of the first command after the "
        "position was lost. Simulated, the scenario's wind, turbulence on, level ground."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment))
