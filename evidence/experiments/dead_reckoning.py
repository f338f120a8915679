# SPDX-License-Identifier: Apache-2.0
"""What dead reckoning is off by after the last fix, and of what that is made; JSON.

Usage: ./heli python -m evidence.experiments.dead_reckoning [--seeds 1..10]
"""

import sys
from itertools import pairwise
from math import comb, exp, log, pi, sqrt
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from evidence.files import Results
from evidence.registry import produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid
from heli_core.rotations import quat_to_R_nb
from heli_core.ticks import TICKS_PER_S
from heli_flight.loop import AircraftInLoop, build, fly_loop
from heli_flight.settings import Settings, resolve
from heli_observer import layout

WORLD, RECEIVERS = "honest", ("rtk", "standalone")
FIXES_S, FLOWN_S, SILENT_S = (12.0, 60.0, 180.0), 12.0, (10.0, 30.0)
"""Fixes for so long; flown are those of the second; looked at so long after the last one."""
_HOVERS: dict[str, dict[str, Any]] = {
    "scenario": {"climb.start_s": 400.0, "climb.end_s": 402.0},
    "outer_loop": {"failsafe.land_astray_m": 10000.0, "failsafe.land_after_s": 3600.0},
}
_SIZE = 6
_WAY, _SPEED, _TILT, _TURN, _GUST, _FIRST = range(_SIZE)
"""Way, velocity, acceleration, its rate, gust, velocity at the last fix."""
_LEARNT = _SPEED, _TILT, _TURN
_STEP_S, _EXACT_MPS = 0.05, 1e-3

Array = NDArray[np.float64]


class Flight(NamedTuple):
    """What a flight whose fixes end at `FLOWN_S` has shown.

    Attributes
    ----------
    off : (N, 3) array
        Navigation less truth, NED, m.
    wind : (M, 2) array
        Wind north and east from the last fix on, m/s.
    """

    off: Array
    wind: Array


class Start(NamedTuple):
    """What is not known northward at the last fix, and what comes in from then on.

    Attributes
    ----------
    cov : (3, 3) array
        Covariance of the errors of velocity, m/s, acceleration (tilt and accelerometer bias),
        m/s2, and its rate (gyro bias), m/s3.
    noise : (3,) array
        Spectral densities of what drives the three.
    """

    cov: Array
    noise: Array


def settings(gps: str, end_s: float, seed: int, faults: tuple[str, ...] = ("none",)) -> Settings:
    """A hover at its place that never lands by itself."""
    over = {**_HOVERS, "plant": {"faults": faults}}
    return resolve("hover", gps, seed, end_s, world=WORLD, overrides=over)


def start(loop: AircraftInLoop) -> Start:
    """The filter's own state of knowledge at the end of a flight."""
    k, P = loop.observer_k.ekf, loop.observer_s.P
    R = quat_to_R_nb(loop.observer_s.nominal[layout.NOMINAL.quat : layout.NOMINAL.gyro_bias])
    rows = np.zeros((3, len(P)))
    rows[0, layout.ERROR.vel] = 1.0
    # A tilt about east lets gravity push north; so does what the gyros turn it by.
    rows[1, layout.ERROR.att + 1] = -k.gravity_mps2
    rows[1, layout.ERROR.accel_bias : layout.ERROR.accel_bias + 3] = -R[0]
    rows[2, layout.ERROR.gyro_bias : layout.ERROR.gyro_bias + 3] = k.gravity_mps2 * R[1]
    g2 = k.gravity_mps2**2
    noise = np.array([k.var_vel_step, g2 * k.var_att_step, g2 * k.var_gyro_bias_step])
    return Start(rows @ P @ rows.T, noise / k.dt_s)


def parts(begin: Start, t: float) -> dict[str, float]:
    """Standard deviations, m, of the way after t s: of each cause, and of all with their links."""
    way, sigma = np.array([t, t**2 / 2.0, t**3 / 6.0]), np.sqrt(np.diag(begin.cov))
    noise = float(begin.noise @ [t**3 / 3.0, t**5 / 20.0, t**7 / 252.0])
    sigmas = dict(zip(("velocity", "tilt", "gyro"), (way * sigma).tolist(), strict=True))
    return sigmas | {"noise": sqrt(noise), "all": sqrt(way @ begin.cov @ way + noise)}


def with_drag(begin: Start, t: float, gust_mps: float, gust_s: float) -> float:
    """The least that reading the drag could leave of it, m; infinite gusts: nothing is read.

    A bound: drag gives the speed through the air without error, the mean wind and the gust at the
    last fix are known as well as the speed is, and from then on the gust is a first-order process.
    """
    F, P, noise = np.zeros((_SIZE, _SIZE)), np.zeros((_SIZE, _SIZE)), np.zeros(_SIZE)
    for state, rate in pairwise((_WAY, *_LEARNT)):
        F[state, rate] = 1.0
    F[_GUST, _GUST] = -1.0 / gust_s
    P[np.ix_(_LEARNT, _LEARNT)] = begin.cov
    P[_FIRST], P[:, _FIRST] = P[_SPEED], P[:, _SPEED]
    P[_FIRST, _FIRST] = P[_SPEED, _SPEED]
    noise[list(_LEARNT)] = begin.noise * _STEP_S
    reads = np.isfinite(gust_mps)
    noise[_GUST] = gust_mps**2 * (1.0 - exp(-2.0 * _STEP_S / gust_s)) if reads else 0.0
    Phi, Q, H = expm(F * _STEP_S), np.diag(noise), np.zeros(_SIZE)
    H[_SPEED], H[_GUST], H[_FIRST] = 1.0, -1.0, -1.0
    for _ in range(round(t / _STEP_S)):
        P = Phi @ P @ Phi.T + Q
        if reads:
            gain = P @ H / (H @ P @ H + _EXACT_MPS**2)
            keep = np.eye(_SIZE) - np.outer(gain, H)
            P = keep @ P @ keep.T + _EXACT_MPS**2 * np.outer(gain, gain)
    return sqrt(P[_WAY, _WAY])


def worst_of(n: int) -> float:
    """Mean of the largest of n distances in the plane, in standard deviations of an axis."""
    return sum((-1) ** (k + 1) * comb(n, k) * sqrt(pi / (2 * k)) for k in range(1, n + 1))


@over(gps=RECEIVERS)
def silent(gps: str, seed: int) -> Flight:
    """Fly without fixes from `FLOWN_S` on."""
    lost = (f"{{what: gps, kind: loss, start_s: {FLOWN_S}}}",)
    scenario = settings(gps, FLOWN_S + max(SILENT_S) + 1.0, seed, lost)
    r = fly_loop(build(scenario), scenario).record
    wind = r.wind_ned_mps[round(FLOWN_S * TICKS_PER_S) :, :2]
    return Flight(r.nav_pos_ned_m - r.truth_pos_ned_m, wind)


def gusts(flights: list[Flight]) -> tuple[float, float]:
    """Standard deviation, m/s, and correlation time, s, of the wind from the last fix on."""
    winds = [f.wind for f in flights]
    mean = np.mean([w.mean(axis=0) for w in winds], axis=0)
    less = [w - mean for w in winds]
    var = float(np.mean([np.mean(w**2) for w in less]))
    near = float(np.mean([np.mean(w[:-TICKS_PER_S] * w[TICKS_PER_S:]) for w in less]))
    return sqrt(var), -1.0 / log(near / var)


def flown(flights: list[Flight], t: float) -> dict[str, float]:
    """How far navigation has gone from truth since the last fix: rms of an axis, and the worst."""
    first, last = round(FLOWN_S * TICKS_PER_S), round((FLOWN_S + t) * TICKS_PER_S)
    off = np.array([f.off for f in flights])
    way = (off[:, last] - off[:, first])[:, :2]
    return {"rms_m": float(np.sqrt(np.mean(way**2))),
            "worst_m": float(np.linalg.norm(way, axis=1).max())}  # fmt: skip


def rows(place: Place[Flight], seeds: list[int]) -> list[dict[str, Any]]:
    """Figures of a receiver."""
    gps, flights = place.point["gps"], place.flights
    gust_mps, gust_s = gusts(flights)
    entries = []
    for fixes_s in FIXES_S:
        scenario = settings(gps, fixes_s, seeds[0])
        loop = build(scenario)
        fly_loop(loop, scenario)
        begin = start(loop)
        for t in SILENT_S:
            sigma = parts(begin, t)
            entries.append({
                "gps": gps, "fixes_s": fixes_s, "silent_s": t, "sigma_m": sigma,
                "with_drag_m": with_drag(begin, t, gust_mps, gust_s),
                "gust_mps": gust_mps, "gust_s": gust_s,
                "expected_worst_m": worst_of(len(seeds)) * sigma["all"],
                "flown": flown(flights, t) if fixes_s == FLOWN_S else None,
            })  # fmt: skip
    return entries


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows."""
    seeds = options.seeds
    of = [row for place in silent.places(options) for row in rows(place, seeds)]
    return {"seeds": seeds, "world": WORLD, "worst_of_sigma": worst_of(len(seeds)), "rows": of}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "dead_reckoning",
    "./heli python -m evidence.experiments.dead_reckoning --seeds 1..10",
    "What dead reckoning is off by after the last fix, and of what that is made.",
    tuple(range(1, 11)),
)


@table("dead_reckoning")
def dead_reckoning(results: Results) -> str:
    """What dead reckoning is off by after the last fix: causes, bound with drag, flown."""
    record = results["dead_reckoning"]
    rows = []
    for row in record["rows"]:
        causes = [f"{row['sigma_m'][key]:.2f}" for key in ("velocity", "tilt", "gyro", "noise")]
        flown = row["flown"]
        rows.append([
            row["gps"], f"{row['fixes_s']:.0f}", f"{row['silent_s']:.0f}", *causes,
            f"{row['sigma_m']['all']:.2f}", f"{row['with_drag_m']:.2f}",
            f"{row['expected_worst_m']:.1f}",
            "" if flown is None else f"{flown['rms_m']:.2f} / {flown['worst_m']:.1f}",
        ])  # fmt: skip
    head = ["receiver", "fixes for, s", "then none for, s", "velocity", "tilt, accelerometers",
            "gyro bias", "noise", "all", "drag read, at least", "worst of all, expected",
            "flown: rms / worst"]  # fmt: skip
    gust, n = record["rows"][-1], len(record["seeds"])
    return (
        f"{grid(head, rows)}\n\nMetres since the last fix; one standard deviation northward, from "
        f"the filter's covariance at the last fix (hover, world {record['world']}, seed "
        f"{record['seeds'][0]}) and its noise since. All: with the links between the causes. Worst "
        f"expected: the mean of the largest of {n} distances in the plane, "
        f"{record['worst_of_sigma']:.2f} times all. Drag read: speed through the air without "
        f"error, "
        "mean wind and gust at the last fix known, gusts then a first-order process of "
        f"{gust['gust_mps']:.2f} m/s and {gust['gust_s']:.0f} s, which the flights' wind has. "
        f"Flown: error of the navigation against truth, seeds {record['seeds'][0]} to "
        f"{record['seeds'][-1]}, rms of an axis / largest distance."
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..10"))
