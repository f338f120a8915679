# SPDX-License-Identifier: Apache-2.0
"""Print how good the navigation is: errors on the aircraft, consistency, latency.

Usage: ./heli python -m evidence.experiments.fusion [--seeds 1..20] [--json]

On the aircraft: the hover test, loop closed, rms from 5 s over all seeds, with absolute position
(observer parameter ekf.initial.drift_at_alignment_fraction 1.0: the receiver's error is about the
true origin). Consistency and latency: synthetic flights, see support.estimator_consistency.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import TWENTY, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid, three, world
from heli_core.rotations import rotation_between
from heli_core.rows import MEAS, PLANT
from heli_dynamics_sim import plant
from heli_dynamics_sim.noise import NoiseStreams
from heli_flight.layers import GPS_PRESETS
from heli_flight.loop import simulate
from heli_flight.result import conditions
from heli_flight.settings import Settings, resolve
from heli_observer.layout import ERROR

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tests"))
from support.estimator_consistency import CHECKS_S, SENSORS, bounds, collect, latency_errors
from support.synthetic_sensors import hover_path

SETTLED_TICK = 500
HOVER_M = 0.3  # amplitude of the motion: about 0.5 m/s at the most
ABSOLUTE = {"observer": {"ekf.initial.drift_at_alignment_fraction": 1.0}}


def receiver_error(settings: Settings) -> np.ndarray:
    """Errors (n, 3), m, of the fixes of a flight from 5 s: they do not depend on the motion."""
    config = plant.PlantConfig.from_parameters(settings.nodes["plant"])
    state = plant.initial_state(config, settings.seed)
    rows = NoiseStreams(settings.seed).rows(settings.scenario.n_ticks)
    y, errors = np.zeros(MEAS.size), []
    for tick, row in enumerate(rows):
        plant.measure(state, tick, row, config.params, y)
        if y[MEAS.gps_valid] == 1.0 and y[MEAS.gps_tick] >= SETTLED_TICK:
            errors.append(y[MEAS.gps_pos] - state.x[PLANT.pos])
    return np.array(errors)


def rms(error: np.ndarray) -> np.ndarray:
    """Per column."""
    return np.sqrt(np.mean(np.square(error), axis=0))


def settings_of(gps: str, seed: int) -> Settings:
    """The hover test with absolute position."""
    return resolve("hover", gps, overrides=ABSOLUTE).with_seed(seed)


@over(gps=tuple(GPS_PRESETS))
def errors(gps: str, seed: int) -> dict[str, np.ndarray]:
    """Errors (n, 3) of attitude, velocity, position, and of the receiver's own, of a flight."""
    settings = settings_of(gps, seed)
    record = simulate(settings).record
    settled = slice(SETTLED_TICK, None)
    return {
        "a": rotation_between(record.truth_q_nb, record.nav_q_nb)[settled],
        "v": (record.nav_vel_ned_mps - record.truth_vel_ned_mps)[settled],
        "p": (record.nav_pos_ned_m - record.truth_pos_ned_m)[settled],
        "gps": receiver_error(settings),
    }


def on_the_aircraft(place: Place[dict[str, np.ndarray]], seeds: Sequence[int]) -> dict[str, Any]:
    """Rms of attitude, velocity, position, and of the receiver's own error; three axes each."""
    a, v, p, estimator = (
        rms(np.concatenate([flight[key] for flight in place.flights]))
        for key in ("a", "v", "p", "gps")
    )
    return {
        **place.point,
        "conditions": conditions(settings_of(place.point["gps"], seeds[-1])).splitlines(),
        "attitude_ned_deg": np.degrees(a).tolist(),
        "velocity_ned_mps": v.tolist(),
        "position_ned_m": p.tolist(),
        "receiver_ned_m": estimator.tolist(),
    }


def consistency(gps: str, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Rows: NEES at its lowest and highest of the checked times and NIS, over their degrees."""
    s = collect(resolve("hover", gps).nodes["observer"], seeds)
    entries = [
        (f"NEES, all {ERROR.size} states", s.nees, ERROR.size * s.runs),
        ("NEES, position, velocity, attitude", s.nees_navigation, 9 * s.runs),
        *((f"NIS, {SENSORS[i]}", s.nis[i : i + 1], int(s.dof[i])) for i in range(4)),
    ]
    return [
        {
            "gps": gps,
            "name": name,
            "over_degrees": [float(np.min(values) / dof), float(np.max(values) / dof)],
            "bounds": [float(bound / dof) for bound in bounds(dof)],
            "degrees": dof,
        }
        for name, values, dof in entries
    ]


def latency(gps: str, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Rows: horizontal rms errors with the fixes' latency compensated and ignored."""
    observer = resolve("hover", gps).nodes["observer"]
    errors = latency_errors(observer, seeds, hover_path(amplitude_m=HOVER_M))
    return [
        {"gps": gps, "latency": words, "position_m": float(row[0]), "velocity_mps": float(row[1])}
        for words, row in zip(("compensated", "ignored"), errors, strict=True)
    ]


def navigation_found(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    seeds = options.seeds
    return {
        "times": len(CHECKS_S),
        "aircraft": [on_the_aircraft(place, seeds) for place in errors.places(options)],
        "consistency": [row for gps in GPS_PRESETS for row in consistency(gps, seeds)],
        "latency": [row for gps in GPS_PRESETS for row in latency(gps, seeds)],
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "fusion",
    "./heli python -m evidence.experiments.fusion --seeds 1..20 --json",
    "Errors and consistency of the navigation.",
    TWENTY,
)


@table("fusion")
def fusion(results: Results) -> str:
    """How good the navigation is."""
    record = results["fusion"]
    flown = {"Hover test": [row["conditions"] for row in record["aircraft"]]}
    return (
        f"{fusion_tables(record)}\n\nRms over {results.seeds('fusion')}. First table: hover test, "
        f"loop closed, from 5 s on. The others: synthetic flights. {world(flown)}"
    )


def fusion_tables(results: Mapping[str, Any]) -> str:
    """The three tables of what evidence/experiments/fusion.py has found."""
    aircraft = [
        [
            row["gps"],
            three(row["attitude_ned_deg"], 2),
            three(row["velocity_ned_mps"], 3),
            three(row["position_ned_m"], 3),
            three(row["receiver_ned_m"], 3),
        ]
        for row in results["aircraft"]
    ]
    consistency = [
        [
            row["gps"],
            row["name"],
            " to ".join(dict.fromkeys(f"{value:.3f}" for value in row["over_degrees"])),
            " to ".join(f"{bound:.3f}" for bound in row["bounds"]),
            str(row["degrees"]),
        ]
        for row in results["consistency"]
    ]
    latency = [
        [row["gps"], row["latency"], f"{row['position_m']:.3f}", f"{row['velocity_mps']:.3f}"]
        for row in results["latency"]
    ]
    axes = "north, east, down"
    errors = [f"attitude, deg: {axes}", f"velocity, m/s: {axes}", f"position, m: {axes}"]
    normalised = f"over its degrees of freedom (NEES: at {results['times']} times)"
    return "\n\n".join(
        (
            grid(["GPS", *errors, "the receiver's own error, m"], aircraft),
            grid(
                ["GPS", "normalised error squared", normalised, "bounds 0.999", "degrees"],
                consistency,
            ),
            grid(["GPS", "latency 0.15 s", "horizontal position, m", "velocity, m/s"], latency),
        )
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, navigation_found, tables=fusion_tables))
