# SPDX-License-Identifier: Apache-2.0
"""The attitude loop over the airspeed, and forward flight at 10 m/s as it is flown; JSON.

Usage: ./heli python -m evidence.experiments.airspeed [--seeds 1..20]
"""

import os
import sys
from collections.abc import Mapping, Sequence
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from numpy.typing import NDArray

from evidence.files import Results
from evidence.registry import MARGIN, TWENTY, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid, world
from heli_core.metrics import attitude_errors
from heli_core.rows import ACTUATOR, REFERENCE
from heli_core.ticks import TICK_S, TICKS_PER_S
from heli_flight.loop import simulate
from heli_flight.record import FlightRecord
from heli_flight.result import conditions
from heli_flight.settings import Settings, resolve
from heli_studies.robust import ACROSS_MPS, SPEEDS_MPS, OverAirspeed, over_airspeed

LAWS = ("packaged", "hinf", "lqg", "pid", "indi")
WORLDS, RECEIVERS = ("paper", "honest"), ("rtk", "standalone")
_AFTER_TICKS = TICKS_PER_S
"""How long the attitude goes on moving when the reference has come to its speed."""
_LEAST_MPS2 = 1e-3
GOAL_DEG = 2.0


def over_speeds(spectrum: OverAirspeed) -> list[dict[str, Any]]:
    """Per speed ahead: trim straight ahead, the slowest mode and the least margins of all there."""
    rows = []
    for speed in SPEEDS_MPS:
        there = [p for p in spectrum.points if p.point.ahead_mps == speed]
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


def bound_of(name: str, spectrum: OverAirspeed) -> dict[str, Any]:
    """What the loops straight ahead share."""
    refused = isinstance(spectrum.bound, str)
    return {
        "laws": name,
        "contraction": None if isinstance(spectrum.bound, str) else spectrum.bound.contraction,
        "between": None if refused else spectrum.between,
        "radius": max(p.judgement.radius for p in spectrum.points),
        "disk_input": min(p.judgement.disk_input for p in spectrum.points),
        "disk_output": min(p.judgement.disk_output for p in spectrum.points),
    }


def transition(record: FlightRecord) -> NDArray[np.bool_]:
    """Where the reference gains or loses speed, and a second after it; (N,)."""
    speed = np.linalg.norm(record.reference[:, REFERENCE.vel], axis=1)
    gains = np.abs(np.diff(speed, prepend=speed[0])) > _LEAST_MPS2 * TICK_S
    return np.convolve(gains, np.ones(_AFTER_TICKS))[: gains.size] > 0.5


def settings_of(scenario: str, world: str, gps: str) -> Settings:
    """A packaged scenario."""
    return resolve(scenario, gps, world=world)


def begin_s(world: str, gps: str) -> float:
    """Start of the way of the scenario forward_flight."""
    return float(settings_of("forward_flight", world, gps).scenario.windows_s[0, 0])


@over(world=WORLDS, gps=RECEIVERS)
def forward(world: str, gps: str, seed: int) -> dict[str, Any]:
    """Largest errors of the scenario forward_flight from the start of its way on, truth."""
    flight = simulate(settings_of("forward_flight", world, gps).with_seed(seed))
    return {"lost": bool(flight.status), "max": errors(flight.record, begin_s(world, gps))}


@over(world=WORLDS, gps=RECEIVERS)
def hover(world: str, gps: str, seed: int) -> dict[str, float]:
    """Largest attitude errors in hover, for comparison: what receiver and air alone make."""
    r = simulate(settings_of("hover", world, gps).with_seed(seed)).record
    from_s = begin_s(world, gps)
    return {
        key: float(np.max(np.abs(values[r.time_s >= from_s])))
        for key, values in attitude_errors(r.truth_q_nb, r.setpoint).items()
    }


def row(ahead: Place[dict[str, Any]], there: Place[dict[str, float]]) -> dict[str, Any]:
    """Largest errors in a world with a receiver, forward and in hover."""
    turned = [max(one["max"][f"{axis}, transition"] for axis in ("roll", "pitch"))
              for one in ahead.flights]  # fmt: skip
    return {
        **ahead.point,
        "conditions": conditions(settings_of("forward_flight", **ahead.point)).splitlines(),
        "lost": sum(one["lost"] for one in ahead.flights),
        "inside_transition": sum(error_deg < GOAL_DEG for error_deg in turned),
        "max": largest([one["max"] for one in ahead.flights]),
        "hover": largest(there.flights),
    }


def largest(flights: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Of each figure the largest."""
    return {key: max(0.0, *(one[key] for one in flights)) for key in flights[0]}


def errors(record: FlightRecord, from_s: float) -> dict[str, float]:
    """Largest absolute values of one flight, truth."""
    on = record.time_s >= from_s
    away = record.truth_pos_ned_m - record.reference[:, REFERENCE.pos]
    attitude = attitude_errors(record.truth_q_nb, record.setpoint)
    estimates = {
        **attitude,
        "altitude": away[:, 2],
        "position": np.linalg.norm(away, axis=1),
        "speed": np.linalg.norm(record.truth_vel_ned_mps, axis=1),
        "airspeed": np.linalg.norm(record.truth_vel_ned_mps - record.wind_ned_mps, axis=1),
    }
    largest = {key: float(np.max(np.abs(values[on]))) for key, values in estimates.items()}
    there = transition(record) & on
    for key, values in attitude.items():
        largest[f"{key}, transition"] = float(np.max(np.abs(values[there])))
    return largest


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    packaged = over_airspeed(resolve())
    others = [bound_of(name, over_airspeed(resolve(laws=name))) for name in LAWS[1:]]
    flown = zip(list(forward.places(options)), hover.places(options), strict=True)
    return {
        "seeds": options.seeds,
        "across_mps": ACROSS_MPS,
        "flap_back_radpmps": max(one.point.flap_back_radpmps for one in packaged.points),
        "speeds": over_speeds(packaged),
        "bounds": [bound_of(LAWS[0], packaged), *others],
        "flights": [row(ahead, there) for ahead, there in flown],
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "airspeed",
    "./heli python -m evidence.experiments.airspeed --seeds 1..20",
    "The attitude loop from hover to 12 m/s, and the scenario forward_flight.",
    TWENTY,
    MARGIN,
)


_FLOWN = {
    "roll, transition": "roll error in the transitions, deg (goal 2)",
    "pitch, transition": "pitch error in the transitions, deg (goal 2)",
    "roll": "roll error, deg",
    "pitch": "pitch error, deg",
    "altitude": "altitude error, m (goal 1)",
    "position": "position error, m",
    "speed": "speed over ground, m/s",
    "airspeed": "airspeed, m/s",
}


@table("airspeed")
def airspeed(results: Results) -> str:
    """Trim and loop at each speed, and what the loops share."""
    record = results["airspeed"]
    head = [
        "ahead, m/s", "trim phi, theta, deg", "d_lon, over flap-back", "d_col",
        "slowest mode, s", "disk margin in / out",
    ]  # fmt: skip
    rows = [
        [
            f"{row['ahead_mps']:g}",
            "{:.1f}, {:.1f}".format(*row["phi_theta_deg"]),
            "{:.3f} to {:.3f}".format(*row["d_lon"]),
            f"{row['d_col']:.3f}",
            f"{TICK_S / (1.0 - row['radius']):.2f}",
            f"{row['disk_input']:.2f} / {row['disk_output']:.2f}",
        ]
        for row in record["speeds"]
    ]
    across, flap_back = record["across_mps"], record.get("flap_back_radpmps", 0.0015)
    return (
        f"{grid(head, rows)}\n\nModes and margins: the worst of air from the side of "
        f"{min(across):g} to {max(across):g} m/s and flap-back 0 to {flap_back:.2g} rad s/m. "
        f"{' '.join(map(_shared, record['bounds']))}"
    )


def _shared(bound: dict[str, Any]) -> str:
    if bound["contraction"] is None:
        return f"`{bound['laws']}`: no shared bound was found."
    each = TICK_S / (1.0 - bound["contraction"])
    return (
        f"`{bound['laws']}`: one quadratic form shrinks by {1.0 - bound['contraction']:.4f} a tick "
        f"at least ({each:.1f} s), between these speeds by {1.0 - bound['between']:.4f}."
    )


@table("airspeed_flown")
def airspeed_flown(results: Results) -> str:
    """Largest errors in forward flight."""
    record = results["airspeed"]
    rows = [
        [
            f"{row['world']}, {row['gps']}",
            *(f"{row['max'][key]:.2f}" for key in _FLOWN),
            str(row["inside_transition"]),
            f"{row['hover']['roll']:.2f}, {row['hover']['pitch']:.2f}",
            str(row["lost"]),
        ]
        for row in record["flights"]
    ]
    winds = {row["world"]: [row["conditions"]] for row in record["flights"]}
    head = ["world, receiver", *_FLOWN.values(), "transitions inside", "hover: roll, pitch", "lost"]
    return (
        f"{grid(head, rows)}\n\nLargest from the start of the way to the end, truth, "
        f"{results.seeds('airspeed')}; attitude against the outer loop's command. Transitions: "
        f"while the reference gains or loses speed, and a second after; inside: seeds with both "
        f"errors below 2 deg there. Hover: the scenario `hover` over the same "
        f"time. {world(winds)}"
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment))
