# SPDX-License-Identifier: Apache-2.0
"""Print what the navigation's errors are in each world, and what they are made of in `honest`.

Usage: ./heli python -m evidence.experiments.navigation [--seeds 1..20] [--json]

The hover test, loop closed. An error is split into what stays over a flight from 5 s on and what
moves; beside it the standard deviation that the filter states. A part of the error is what goes
when its cause is taken out of the simulation, while the filter is told the same.
"""

import sys
from collections.abc import Mapping
from functools import cache
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import TWENTY, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid, three
from heli_core.rotations import rotation_between
from heli_core.ticks import ticks_in
from heli_flight.layers import GPS_PRESETS
from heli_flight.loop import build, fly_loop
from heli_flight.settings import Settings, resolve
from heli_inner_hinf.controller_state import AttitudeParams
from heli_inner_hinf.design import AttitudeConfig

WORLDS = ("paper", "honest", "hard")
ALIGNED, SETTLED = ticks_in(0.5), ticks_in(5.0)
_ZERO = [0.0, 0.0, 0.0]
CAUSES: Mapping[str, Mapping[str, Any]] = {
    "all": {},
    "accelerometers without bias, scale, misalignment": {
        "imu.accel_bias_sigma_mps2": 0.0,
        "imu.accel_scale_sigma": 0.0,
        "imu.accel_misalignment_rad": 0.0,
    },
    "ideal gyros": {
        "imu.gyro_noise_density": 0.0,
        "imu.gyro_bias_sigma_radps": 0.0,
        "imu.gyro_bias_walk": 0.0,
        "imu.gyro_scale_sigma": 0.0,
        "imu.gyro_misalignment_rad": 0.0,
    },
    "no vibration": {
        f"imu.vibration.{part}": _ZERO
        for part in ("rev_mps2", "rev_radps", "blade_mps2", "blade_radps")
    },
    "GPS velocity without noise": {"gps.velocity_mps": 0.0},
    "compass without iron and currents": {
        "mag.hard_iron_t": _ZERO,
        "mag.soft_iron": np.eye(3).ravel().tolist(),
        "mag.hard_iron_sigma_t": 0.0,
        "mag.soft_iron_sigma": 0.0,
        "mag.power_field_t_per_w": _ZERO,
    },
}
"""What is taken out, by name: parameters of the plant's sensors."""


def rms(values: list[np.ndarray]) -> list[float]:
    """Over flights and ticks, per axis."""
    return np.sqrt(np.mean(np.square(np.concatenate(values)), axis=0)).tolist()


@cache
def settings_of(world: str, gps: str, cause: str) -> tuple[Settings, AttitudeParams]:
    """The hover test with a cause taken out, and its controller."""
    changes = {"plant": {f"sensors.{key}": value for key, value in CAUSES[cause].items()}}
    settings = resolve("hover", gps, world=world, overrides=changes)
    return settings, AttitudeConfig.from_parameters(settings.nodes["inner_loop"]).params


@over(world=WORLDS, gps=tuple(GPS_PRESETS), cause=tuple(CAUSES))
def errors(world: str, gps: str, cause: str, seed: int) -> dict[str, np.ndarray]:
    """Errors of a flight (n, 3): north, east, down, or a_s, b_s, d_int."""
    settings, law = settings_of(world, gps, cause)
    flown = settings.with_seed(seed)
    r = fly_loop(build(flown, law=law), flown).record
    assert r.nav_sigma_att_rad is not None and r.nav_sigma_vel_mps is not None
    assert r.nav_rotor is not None and r.truth_rotor is not None
    attitude = np.degrees(rotation_between(r.truth_q_nb, r.nav_q_nb))
    settled = attitude[SETTLED:]
    stays = settled.mean(axis=0, keepdims=True)
    rotor = (r.nav_rotor - r.truth_rotor)[SETTLED:]
    return {
        "attitude_start_deg": attitude[ALIGNED:SETTLED],
        "attitude_deg": settled,
        "attitude_stays_deg": stays,
        "attitude_moves_deg": settled - stays,
        "attitude_stated_deg": np.degrees(r.nav_sigma_att_rad[SETTLED:]),
        "velocity_mps": (r.nav_vel_ned_mps - r.truth_vel_ned_mps)[SETTLED:],
        "velocity_stated_mps": r.nav_sigma_vel_mps[SETTLED:],
        "rotor_rad": rotor,
        "rotor_moves_rad": rotor - rotor.mean(axis=0),
    }


def row(place: Place[dict[str, np.ndarray]]) -> dict[str, Any]:
    """Rms errors over all flights of a place; three axes each."""
    world, gps, _ = place.point.values()
    names = place.flights[0]
    return {
        "world": world,
        "gps": gps,
        **{name: rms([flight[name] for flight in place.flights]) for name in names},
    }


def errors_found(options: Options) -> dict[str, Any]:
    """All that the tables show: each world as it is, and in `honest` each cause taken out."""
    whole = next(iter(CAUSES))
    flown = [p for p in errors.points if p["cause"] == whole or p["world"] == "honest"]
    rows = [(place.point, row(place)) for place in errors.places(options, flown)]
    return {
        "worlds": [entry for point, entry in rows if point["cause"] == whole],
        "parts": [
            {"cause": point["cause"], **entry}
            for point, entry in rows
            if point["world"] == "honest"
        ],
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "navigation",
    "./heli python -m evidence.experiments.navigation --seeds 1..20 --json",
    "Errors of the navigation in the worlds, and their causes.",
    TWENTY,
)


@table("navigation")
def navigation(results: Results) -> str:
    """The navigation's errors in each world, and their causes."""
    return (
        f"{navigation_tables(results['navigation'])}\n\nRms over {results.seeds('navigation')}, "
        "hover test, loop closed; north, east, down. Start: from 0.5 to 5 s; all others from 5 s "
        "on. Stated: the filter's own standard deviation. Second table: the world `honest`, one "
        "cause taken out of the simulation at a time, the filter told the same."
    )


def navigation_tables(results: Mapping[str, Any]) -> str:
    """The two tables of what evidence/experiments/navigation.py has found."""
    parts_of = {"start": "start_deg", "all": "deg", "stays": "stays_deg", "moves": "moves_deg"}
    keys = [*parts_of.values(), "stated_deg"]
    worlds = [
        [
            f"{row['world']}, {row['gps']}",
            *(three(row[f"attitude_{key}"], 2) for key in keys),
            f"{three(row['velocity_mps'], 3)} ({three(row['velocity_stated_mps'], 3)})",
            three([1e3 * value for value in row["rotor_rad"]], 1),
            three([1e3 * value for value in row["rotor_moves_rad"]], 1),
        ]
        for row in results["worlds"]
    ]
    head = ["world, GPS", *(f"attitude, deg: {name}" for name in (*parts_of, "stated"))]
    head += ["velocity, m/s (stated)", "a_s, b_s, d_int, mrad", "of it what moves"]
    causes = [
        [
            f"{row['gps']}: {row['cause']}",
            *(three(row[f"attitude_{key}"], 2) for key in parts_of.values()),
            three(row["velocity_mps"], 3),
        ]
        for row in results["parts"]
    ]
    parts = ["honest, GPS: simulated", *(f"attitude, deg: {name}" for name in parts_of)]
    return f"{grid(head, worlds)}\n\n{grid([*parts, 'velocity, m/s'], causes)}"


if __name__ == "__main__":
    sys.exit(print_result(__doc__, errors_found, tables=navigation_tables))
