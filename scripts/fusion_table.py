# SPDX-License-Identifier: Apache-2.0
"""Print how good the navigation is: errors on the aircraft, consistency, latency.

Usage: ./heli python scripts/fusion_table.py [--seeds 1..20] [--json]

On the aircraft: the hover test, loop closed, rms from 5 s over all seeds, with absolute position
(observer parameter ekf.initial.drift_at_alignment_fraction 1.0: the receiver's error is about the
true origin). Consistency and latency: synthetic flights, see heli_observer.testing.consistency.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from seeds_option import print_tables

from heli_dynamics_sim import plant
from heli_dynamics_sim.noise import NoiseStreams
from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.layers import GPS_PRESETS
from heli_flight.loop.result import conditions
from heli_flight.loop.settings import Settings, resolve
from heli_flight.studies.results.tables_of_parts import fusion_tables
from heli_math.rotations import rotation_between
from heli_math.rows import MEAS, PLANT
from heli_observer.layout import N_ERROR
from heli_observer.testing.consistency import CHECKS_S, SENSORS, bounds, collect, latency_errors
from heli_observer.testing.synthetic import hover_path

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
        plant.measure(state, tick, row, config.kernel, y)
        if y[MEAS.gps_valid] == 1.0 and y[MEAS.gps_tick] >= SETTLED_TICK:
            errors.append(y[MEAS.gps_pos] - state.x[PLANT.pos])
    return np.array(errors)


def rms(error: np.ndarray) -> np.ndarray:
    """Per column."""
    return np.sqrt(np.mean(np.square(error), axis=0))


def on_the_aircraft(gps: str, seeds: Sequence[int]) -> dict[str, Any]:
    """Rms of attitude, velocity, position, and of the receiver's own error; three axes each."""
    errors: dict[str, list[np.ndarray]] = {"a": [], "v": [], "p": [], "gps": []}
    for seed in seeds:
        settings = resolve("hover", gps, overrides=ABSOLUTE).with_seed(seed)
        record = simulate(settings).record
        settled = slice(SETTLED_TICK, None)
        errors["a"].append(rotation_between(record.truth_q_nb, record.nav_q_nb)[settled])
        errors["v"].append((record.nav_vel_ned_mps - record.truth_vel_ned_mps)[settled])
        errors["p"].append((record.nav_pos_ned_m - record.truth_pos_ned_m)[settled])
        errors["gps"].append(receiver_error(settings))
    a, v, p, own = (rms(np.concatenate(errors[key])) for key in ("a", "v", "p", "gps"))
    return {
        "gps": gps,
        "conditions": conditions(settings).splitlines(),
        "attitude_ned_deg": np.degrees(a).tolist(),
        "velocity_ned_mps": v.tolist(),
        "position_ned_m": p.tolist(),
        "receiver_ned_m": own.tolist(),
    }


def consistency(gps: str, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Rows: NEES at its lowest and highest of the checked times and NIS, over their degrees."""
    s = collect(resolve("hover", gps).nodes["observer"], seeds)
    found = [
        (f"NEES, all {N_ERROR} states", s.nees, N_ERROR * s.runs),
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
        for name, values, dof in found
    ]


def latency(gps: str, seeds: Sequence[int]) -> list[dict[str, Any]]:
    """Rows: horizontal rms errors with the fixes' latency compensated and ignored."""
    observer = resolve("hover", gps).nodes["observer"]
    errors = latency_errors(observer, seeds, hover_path(amplitude_m=HOVER_M))
    return [
        {"gps": gps, "latency": words, "position_m": float(row[0]), "velocity_mps": float(row[1])}
        for words, row in zip(("compensated", "ignored"), errors, strict=True)
    ]


def navigation_found(seeds: Sequence[int]) -> dict[str, Any]:
    """All that the tables show."""
    return {
        "times": len(CHECKS_S),
        "aircraft": [on_the_aircraft(gps, seeds) for gps in GPS_PRESETS],
        "consistency": [row for gps in GPS_PRESETS for row in consistency(gps, seeds)],
        "latency": [row for gps in GPS_PRESETS for row in latency(gps, seeds)],
    }


if __name__ == "__main__":
    print_tables(__doc__, navigation_found, fusion_tables)
