# SPDX-License-Identifier: Apache-2.0
"""Hovers that lose the receiver: truth after 30 s, where they land, what is possible at all; JSON.

Usage: ./heli python -m evidence.experiments.gps_lost [--seeds 5001..5040]
"""

import sys
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from evidence.experiments import dead_reckoning
from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid
from heli_core.ticks import TICKS_PER_S
from heli_flight.loop import build, fly_loop, simulate
from heli_flight.settings import Settings, resolve

WORLDS, RECEIVERS = ("paper", "honest"), ("rtk", "standalone")
FIXES_S, LOST_S, LANDED_S = 12.0, 30.0, 45.0
"""Fixes for so long; then none, looked at so long after; so long it is flown until it stands."""
CURVE_S = (2.0, 5.0, 8.0, 10.0, 12.0, 15.0, 20.0, 25.0, 30.0)
LONG_S = 60.0
"""The bounds beside are also those of a hover that had fixes for so long."""
GOAL_M = 10.0
_STAYS: dict[str, Any] = {"climb.start_s": 400.0, "climb.end_s": 402.0}
_NEVER: dict[str, Any] = {"failsafe.land_astray_m": 10000.0, "failsafe.land_after_s": 3600.0}
_BEFORE_S, _LIFTED_M = 0.5, 0.05
"""Higher than it ends by the second it is in the air; speeds are of the first before."""

Array = NDArray[np.float64]


class Flight(NamedTuple):
    """Figures of one seed.

    Attributes
    ----------
    drift : (len(CURVE_S), 2) array
        How far navigation has gone from truth since the last fix, north and east, m, where it
        never lands.
    wind : (N, 2) array
        Wind north and east from the last fix on, m/s.
    figures : dict
        Distances in the plane, m; times since the last fix, s; speeds, m/s. None where it has not
        come to that.
    """

    drift: Array
    wind: Array
    figures: dict[str, float | None]


def settings(world: str, gps: str, seed: int, end_s: float, lost: bool, lands: bool) -> Settings:
    """A hover at its place whose fixes end at `FIXES_S`, if `lost`."""
    faults = (f"{{what: gps, kind: loss, start_s: {FIXES_S}}}",) if lost else ("none",)
    over = {"plant": {"faults": faults}, "scenario": _STAYS, "outer_loop": {} if lands else _NEVER}
    return resolve("hover", gps, seed, end_s, world=world, overrides=over)


def landing(world: str, gps: str, seed: int) -> tuple[dict[str, float | None], Array]:
    """Figures of a flight whose receiver is lost for good; its truth (N, 2) north and east, m.

    Until fixes would come back it is the flight that loses them for `LOST_S`, too.
    """
    flight = simulate(settings(world, gps, seed, FIXES_S + LANDED_S, True, True))
    record, begun = flight.record, round(FIXES_S * TICKS_PER_S)
    pos, vel, down = record.truth_pos_ned_m, record.truth_vel_ned_mps, None
    found: dict[str, float | None] = dict.fromkeys(("landing_s", "down_s", "away_m", "sink_mps",
                                                    "sideways_mps"))  # fmt: skip
    found["lost"] = float(bool(flight.status))
    if record.mode is not None and (record.mode == "land").any():
        lands = np.flatnonzero(record.mode == "land")
        found["landing_s"] = float(lands[0] - begun) / TICKS_PER_S
        down = int(lands[-1]) if record.mode[-1] == "standing" else None
    if down is not None:
        air = int(np.flatnonzero(pos[:, 2] < pos[-1, 2] - _LIFTED_M)[-1])
        # It may rock on its skids for a while longer.
        before = min(air, down) - round(_BEFORE_S * TICKS_PER_S)
        found |= {
            "down_s": float(down - begun) / TICKS_PER_S,
            "away_m": float(np.linalg.norm(pos[-1, :2])),
            "sink_mps": float(np.abs(vel[before : down + 1, 2]).max()),
            "sideways_mps": float(np.linalg.norm(vel[before, :2])),
        }
    return found, pos[:, :2]


@over(world=WORLDS, gps=RECEIVERS)
def flown(world: str, gps: str, seed: int) -> Flight:
    """One seed: with the failsafes, without the fault, and with the fault but never landing."""
    begun, at = round(FIXES_S * TICKS_PER_S), round((FIXES_S + LOST_S) * TICKS_PER_S)
    found, truth = landing(world, gps, seed)
    end_s = FIXES_S + LOST_S + 0.1
    sound = simulate(settings(world, gps, seed, end_s, False, True)).record.truth_pos_ned_m[:, :2]
    stays = simulate(settings(world, gps, seed, end_s, True, False)).record
    off = (stays.nav_pos_ned_m - stays.truth_pos_ned_m)[:, :2]
    times = begun + np.round(np.array(CURVE_S) * TICKS_PER_S).astype(int)
    reached = len(truth) > at
    found |= {
        "truth_m": float(np.linalg.norm(truth[at])) if reached else None,
        "apart_m": float(np.linalg.norm(truth[at] - sound[at])) if reached else None,
        "sound_m": float(np.linalg.norm(sound[at])),
        "stays_m": float(np.linalg.norm(stays.truth_pos_ned_m[at, :2])),
    }
    return Flight(off[times] - off[begun], stays.wind_ned_mps[begun:, :2], found)


def curve(place: Place[Flight], seeds: list[int]) -> list[dict[str, Any]]:
    """Dead reckoning over time: what the filter's covariance says, what was flown."""
    world, gps = place.point["world"], place.point["gps"]
    none = np.zeros((0, 3))
    gusts = dead_reckoning.gusts([dead_reckoning.Flight(none, one.wind) for one in place.flights])
    begins = []
    for fixes_s in (FIXES_S, LONG_S):
        scenario = settings(world, gps, seeds[0], fixes_s, False, False)
        loop = build(scenario)
        fly_loop(loop, scenario)
        begins.append(dead_reckoning.start(loop))
    drift = np.array([one.drift for one in place.flights])
    worst = dead_reckoning.worst_of(len(seeds))
    points = []
    for i, t in enumerate(CURVE_S):
        sigma = [dead_reckoning.parts(begin, t) for begin in begins]
        drag = [dead_reckoning.with_drag(begin, t, *gusts) for begin in begins]
        points.append({
            "silent_s": t, "sigma_m": sigma[0],
            "worst_m": worst * sigma[0]["all"], "worst_drag_m": worst * drag[0],
            "worst_long_m": worst * sigma[1]["all"], "worst_long_drag_m": worst * drag[1],
            "flown_rms_m": float(np.sqrt(np.mean(drift[:, i] ** 2))),
            "flown_median_m": float(np.median(np.linalg.norm(drift[:, i], axis=1))),
            "flown_worst_m": float(np.linalg.norm(drift[:, i], axis=1).max()),
        })  # fmt: skip
    return points


def row(place: Place[Flight], seeds: list[int]) -> dict[str, Any]:
    """Figures of a world and a receiver."""
    figures = [one.figures for one in place.flights]

    def of(key: str) -> list[float]:
        return [value for one in figures if (value := one[key]) is not None]

    keys = ("truth_m", "apart_m", "sound_m", "stays_m", "landing_s", "down_s", "away_m", "sink_mps",
            "sideways_mps")  # fmt: skip
    return {
        **place.point,
        "lost": int(sum(of("lost"))),
        "down": len(of("down_s")),
        "beyond": sum(value > GOAL_M for value in of("truth_m")),
        "median": {key: float(np.median(of(key))) if of(key) else None for key in keys},
        "max": {key: max(of(key), default=None) for key in keys},
        "curve": curve(place, seeds),
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    rows = [row(place, options.seeds) for place in flown.places(options)]
    content = {"seeds": options.seeds, "fixes_s": FIXES_S, "lost_s": LOST_S, "goal_m": GOAL_M}
    return content | {"long_s": LONG_S, "rows": rows}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "gps_lost",
    "./heli python -m evidence.experiments.gps_lost --seeds 5001..5040",
    "Hovers that lose the receiver: truth after 30 s, where they land, what is possible.",
    tuple(range(5001, 5041)),
    # As of a landing without a place to hold.
    MARGIN,
)


def _both(row: dict[str, Any], key: str, form: str) -> str:
    median, most = row["median"][key], row["max"][key]
    return "–" if median is None else f"{median:{form}} / {most:{form}}"


@table("gps_lost")
def gps_lost(results: Results) -> str:
    """Where a hover is 30 s after the last fix, and where it lands."""
    record = results["gps_lost"]
    head = ["world", "receiver", "truth after 30 s, m", "beyond the goal",
            "from the same flight without the fault, m", "that one itself, m",
            "if it never lands, m", "lands after, s", "stands", "after, s", "away, m",
            "touch-down, m/s", "sideways then, m/s"]  # fmt: skip
    rows = []
    for row in record["rows"]:
        cells = [_both(row, key, ".1f") for key in ("apart_m", "sound_m", "stays_m", "landing_s")]
        ends = [_both(row, key, form) for key, form in
                (("down_s", ".0f"), ("away_m", ".1f"), ("sink_mps", ".2f"),
                 ("sideways_mps", ".2f"))]  # fmt: skip
        rows.append([row["world"], row["gps"], _both(row, "truth_m", ".1f"), str(row["beyond"]),
                     *cells, str(row["down"]), *ends])  # fmt: skip
    n = len(record["seeds"])
    return (
        f"{grid(head, rows)}\n\nHover at 10 m, the last fix after {record['fixes_s']:g} s, default "
        f"controllers; median / worst of {n} flights that nothing was tuned on "
        f"({results.seeds('gps_lost')}). Truth: horizontal distance from the place that is to be "
        f"held, {record['lost_s']:g} s after the last fix; goal {record['goal_m']:g} m. Stands, "
        f"away: fixes lost for good, of {n} flights; distance from that place where it comes to "
        f"stand. Touch-down, sideways: of the last half second in the air."
    )


@table("gps_lost_curve")
def gps_lost_curve(results: Results) -> str:
    """Dead reckoning over time beside what is possible."""
    record = results["gps_lost"]
    fixes, long = f"{record['fixes_s']:g}", f"{record['long_s']:g}"
    head = ["world", "receiver", "s", "tilt", "gyro", "velocity", "noise", "all", "flown: rms",
            "median / worst", "worst, expected", "drag read",
            f"{long} s of fixes", "drag read"]  # fmt: skip
    rows = []
    for row in record["rows"]:
        for at in row["curve"]:
            causes = [f"{at['sigma_m'][key]:.2f}"
                      for key in ("tilt", "gyro", "velocity", "noise", "all")]  # fmt: skip
            worst = [f"{at[key]:.1f}" for key in
                     ("worst_m", "worst_drag_m", "worst_long_m", "worst_long_drag_m")]  # fmt: skip
            rows.append([
                row["world"], row["gps"], f"{at['silent_s']:g}", *causes,
                f"{at['flown_rms_m']:.2f}",
                f"{at['flown_median_m']:.1f} / {at['flown_worst_m']:.1f}", *worst,
            ])  # fmt: skip
    n = len(record["seeds"])
    return (
        f"{grid(head, rows)}\n\nMetres that dead reckoning is off by so long after the last fix, "
        f"in flights that never land. Tilt to all: one standard deviation northward, from the "
        f"filter's covariance after {fixes} s of fixes (seed {record['seeds'][0]}) and its noise "
        f"since. Flown: rms of an axis, distance, {results.seeds('gps_lost')}. Worst, expected: "
        f"mean of the largest of {n} distances by that covariance. Drag read: the least that any "
        f"model of drag could leave of it: speed through the air without error, the wind at the "
        f"last fix known, gusts from then on as the flights have them."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "5001..5040"))
