# SPDX-License-Identifier: Apache-2.0
"""Print how good the navigation is: errors on the aircraft, consistency, latency, as Markdown.

Usage: python scripts/fusion_table.py [--seeds 1..20]

On the aircraft: the hover test, loop closed, rms from 5 s over all seeds, with absolute position
(observer parameter ekf.initial.gps_drift_fraction 1.0: the receiver's error is about the true
origin). Consistency and latency: synthetic flights, see heli_observer.consistency.
"""

import argparse
import sys

import numpy as np

from heli_dynamics_sim import plant
from heli_dynamics_sim.noise import NoiseStreams
from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.layers import GPS_PRESETS
from heli_flight.loop.settings import Settings, resolve
from heli_flight.studies.campaign import parse_seeds, with_seed
from heli_math.rotations import rotation_between
from heli_math.rows import MEAS
from heli_observer.consistency import CHECKS_S, SENSORS, bounds, collect, latency_errors
from heli_observer.layout import N_ERROR
from heli_observer.synthetic import hover_path

SETTLED_TICK = 500
HOVER_M = 0.3  # amplitude of the motion: about 0.5 m/s at the most
ABSOLUTE = {"observer": {"ekf.initial.gps_drift_fraction": 1.0}}


def receiver_error(settings: Settings) -> np.ndarray:
    """Errors (n, 3), m, of the fixes of a flight from 5 s: they do not depend on the motion."""
    config = plant.PlantConfig.from_parameters(settings.nodes["plant"])
    state = plant.initial_state(config, settings.seed)
    rows = NoiseStreams(settings.seed).rows(settings.scenario.n_ticks)
    y, errors = np.zeros(MEAS.size), []
    for tick, row in enumerate(rows):
        plant.measure(state, tick, row, config.kernel, y)
        if y[18] == 1.0 and y[19] >= SETTLED_TICK:
            errors.append(y[10:13] - state.x[0:3])
    return np.array(errors)


def rms(error: np.ndarray) -> np.ndarray:
    """Per column."""
    return np.sqrt(np.mean(np.square(error), axis=0))


def on_the_aircraft(gps: str, seeds: list[int]) -> str:
    """One row: attitude, velocity, position, the receiver's own error."""
    errors: dict[str, list[np.ndarray]] = {"a": [], "v": [], "p": [], "gps": []}
    for seed in seeds:
        settings = with_seed(resolve("hover", gps, overrides=ABSOLUTE), seed)
        record = simulate(settings).record
        settled = slice(SETTLED_TICK, None)
        errors["a"].append(rotation_between(record.truth_q_nb, record.nav_q_nb)[settled])
        errors["v"].append((record.nav_vel_ned_mps - record.truth_vel_ned_mps)[settled])
        errors["p"].append((record.nav_pos_ned_m - record.truth_pos_ned_m)[settled])
        errors["gps"].append(receiver_error(settings))
    a, v, p, own = (rms(np.concatenate(errors[key])) for key in ("a", "v", "p", "gps"))
    degrees = np.degrees(a)
    cells = (
        f"{np.linalg.norm(degrees):.2f} ({three(degrees, 2)})",
        three(v, 3),
        three(p, 3),
        three(own, 3),
    )
    return f"| {gps} | " + " | ".join(cells) + " |"


def three(values: np.ndarray, digits: int) -> str:
    """Three numbers in a cell."""
    return ", ".join(f"{value:.{digits}f}" for value in values)


def consistency(gps: str, seeds: list[int]) -> list[str]:
    """Rows: NEES at its lowest and highest of the checked times and NIS, over their degrees."""
    s = collect(resolve("hover", gps).nodes["observer"], seeds)
    found = [
        ("NEES, all 20 states", s.nees, N_ERROR * s.runs),
        ("NEES, position, velocity, attitude", s.nees_navigation, 9 * s.runs),
        *((f"NIS, {SENSORS[i]}", s.nis[i : i + 1], int(s.dof[i])) for i in range(4)),
    ]
    return [
        f"| {gps} | {name} | {span(values / dof)} | {span(np.array(bounds(dof)) / dof)} | {dof} |"
        for name, values, dof in found
    ]


def span(values: np.ndarray) -> str:
    """One number, or the lowest and the highest."""
    low, high = values.min(), values.max()
    return f"{low:.3f}" if values.size == 1 else f"{low:.3f} to {high:.3f}"


TABLES = (
    "| GPS | attitude, deg: all (north, east, down) | velocity NED, m/s | position NED, m "
    "| the receiver's own error NED, m |\n|---|---|---|---|---|",
    "\n| GPS | normalised error squared | over its degrees of freedom "
    f"(NEES: at {len(CHECKS_S)} times) | bounds 0.999 | degrees |\n|---|---|---|---|---|",
    "\n| GPS | latency 0.15 s | position, m | velocity, m/s |\n|---|---|---|---|",
)


def main() -> int:
    """Print all tables; 0."""
    p = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    p.add_argument("--seeds", default="1..20")
    seeds = parse_seeds(p.parse_args().seeds)
    print(TABLES[0])
    for gps in GPS_PRESETS:
        print(on_the_aircraft(gps, seeds), flush=True)
    print(TABLES[1])
    for gps in GPS_PRESETS:
        print("\n".join(consistency(gps, seeds)), flush=True)
    print(TABLES[2])
    for gps in GPS_PRESETS:
        observer = resolve("hover", gps).nodes["observer"]
        errors = latency_errors(observer, seeds, hover_path(amplitude_m=HOVER_M))
        for words, row in zip(("compensated", "ignored"), errors, strict=True):
            print(f"| {gps} | {words} | {row[0]:.3f} | {row[1]:.3f} |", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
