# SPDX-License-Identifier: Apache-2.0
"""Hover with lever arms and a late IMU, known to the observer and not: errors, NEES, margins; JSON.

Usage: ./heli python -m evidence.experiments.imu_filter [--seeds 1..40]

The hover test, RTK, the default controllers. The low-pass is a Butterworth filter of second order
at 44.8 Hz: 5.0 ms. The arms are those of an IMU and an antenna on an aircraft of this size; nothing
was tuned to either. NEES as `consistency` has it. Margins are linear: of the attitude loop as
flown, everything that it measures behind the filter; where the delay is known, attitudes go on over
it with the rates.
"""

import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np

from evidence.experiments.consistency import (
    GOAL,
    QUANTITIES,
    SETTLED,
    cell,
    lasting_error_m,
    normalised_of,
    over_flights,
)
from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.sweep import Options, over, print_result
from evidence.tables import grid
from heli_core.linear import held_and_linear
from heli_core.rotations import euler_from_quat, rotation_between
from heli_core.rows import MEASURED, STATE_NAMES
from heli_dynamics_sim.config import imu_delay_s
from heli_flight.loop import build, fly_loop
from heli_flight.settings import Settings, resolve
from heli_inner_hinf.controller_state import AttitudeParams
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import Loop, disk_margin, further_delay_s
from heli_inner_hinf.tuning import model_of
from heli_studies.compare import loop_as_flown
from heli_studies.design.make import LONGEST_DELAY_S

WORLDS = ("honest", "hard", "paper")
CUT_OFF_HZ = 44.8
ARMS = {
    "sensors.imu.lever_arm_m": [0.1, 0.0, 0.05],
    "sensors.gps.lever_arm_m": [-0.3, 0.0, -0.2],
}
ARMS_UNKNOWN = {"ekf.imu.lever_arm_m": [0.0] * 3, "ekf.gps.lever_arm_m": [0.0] * 3}
LATE = {"sensors.imu.lowpass_hz": CUT_OFF_HZ, "sensors.imu.lowpass_motion": True}
LATE_UNKNOWN = {"ekf.imu.delay_s": 0.0}
SENSORS: Mapping[str, tuple[Mapping[str, Any], Mapping[str, Any]]] = {
    "as shipped": ({}, {}),
    "arms, known": (ARMS, {}),
    "arms, not known": (ARMS, ARMS_UNKNOWN),
    "low-pass, known": (LATE, {}),
    "low-pass, not known": (LATE, LATE_UNKNOWN),
}
"""By name: what the plant has, and what the observer is told otherwise."""
LAWS = ("hinf_output", "hinf", "pid")
DEFAULT = "hinf_output"
_TURNING = {"phi": "p", "theta": "q", "psi": "r"}


@cache
def settings_of(world: str, sensors: str) -> tuple[Settings, AttitudeParams]:
    """The hover test, and its controller."""
    of_plant, of_observer = SENSORS[sensors]
    over_files = {"plant": of_plant, "observer": of_observer}
    settings = resolve("hover", "rtk", world=world, overrides=over_files)
    return settings, AttitudeConfig.from_parameters(settings.nodes["inner_loop"]).params


def rms(errors: np.ndarray) -> float:
    """Root mean square of the lengths of errors (N, n)."""
    return float(np.sqrt(np.square(errors).sum(axis=1).mean()))


@over(world=WORLDS, sensors=tuple(SENSORS))
def flown(world: str, sensors: str, seed: int) -> dict[str, Any]:
    """Figures of a flight, from 5 s on."""
    settings, law = settings_of(world, sensors)
    one = settings.with_seed(seed)
    flight = fly_loop(build(one, law=law), one)
    r = flight.record
    attitude = np.degrees(rotation_between(r.truth_q_nb, r.nav_q_nb))[SETTLED:]
    tilt = np.degrees([euler_from_quat(q)[:2] for q in r.truth_q_nb])[SETTLED:]
    return {
        "lost": bool(flight.sentence),
        "nees": normalised_of(r, lasting_error_m(one)),
        "estimate": {
            "position_m": rms((r.nav_pos_ned_m - r.truth_pos_ned_m)[SETTLED:]),
            "velocity_mps": rms((r.nav_vel_ned_mps - r.truth_vel_ned_mps)[SETTLED:]),
            "tilt_deg": rms(attitude[:, :2]),
            "heading_deg": rms(attitude[:, 2:]),
        },
        "flown": {
            "tilt_deg": rms(tilt - tilt.mean(axis=0)),
            "rates_degps": rms(np.degrees(r.truth_rate_body_radps)[SETTLED:, :2]),
        },
    }


def read_late(loop: Loop, known: bool) -> Loop:
    """The loop whose controller reads all that is measured behind the IMU's low-pass.

    known: the attitude that it reads goes on by the delay with the rates that it reads.
    """
    import control

    names, w = [STATE_NAMES[i] for i in MEASURED], 2.0 * np.pi * CUT_OFF_HZ
    A, B = np.array([[0.0, 1.0], [-w * w, -np.sqrt(2.0) * w]]), np.array([[0.0], [w * w]])
    Phi, _, g0, g1 = held_and_linear(A, np.zeros((2, 0)), B, loop.dt)
    # z(n) is the filter's state at tick n less what y(n) adds.
    out, each = np.array([[1.0, 0.0]]), np.eye(len(names))
    ahead = each.copy()
    for angle, rate in _TURNING.items():
        ahead[names.index(angle), names.index(rate)] = imu_delay_s(True, CUT_OFF_HZ) * known
    commands = loop.controller.ninputs - len(names)
    direct = np.eye(loop.controller.ninputs)
    direct[: len(names), : len(names)] = ahead @ np.kron(each, out @ g1)
    lowpass = control.ss(
        np.kron(each, Phi),
        np.hstack([np.kron(each, Phi @ g1 + g0), np.zeros((2 * len(names), commands))]),
        np.vstack([ahead @ np.kron(each, out), np.zeros((commands, 2 * len(names)))]),
        direct,
        loop.dt,
    )
    signals = {"inputs": loop.controller.input_labels, "outputs": loop.controller.output_labels}
    return replace(loop, controller=control.ss(loop.controller * lowpass, **signals))


def margins_of(law: str) -> list[dict[str, Any]]:
    """Margins of the attitude loop as flown: without the low-pass, and behind it."""
    settings = resolve("hover", "rtk", world="honest", laws="packaged" if law == DEFAULT else law)
    loop, config = (
        loop_as_flown(settings.nodes),
        AttitudeConfig.from_parameters(settings.nodes["inner_loop"]),
    )
    assert loop is not None  # of the packaged controllers it is known
    loops = {
        "as shipped": loop,
        "low-pass, known": read_late(loop, True),
        "low-pass, not known": read_late(loop, False),
    }
    return [
        {
            "law": law,
            "sensors": sensors,
            "input": disk_margin(one, "input").alpha,
            "output": disk_margin(one, "output").alpha,
            "delay_s": further_delay_s(one, model_of(config), config.actuation, LONGEST_DELAY_S),
        }
        for sensors, one in loops.items()
    ]


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    rows = []
    for place in flown.places(options):
        flights = place.flights
        rows.append(
            {
                **place.point,
                "lost": sum(flight["lost"] for flight in flights),
                "nees": {
                    name: over_flights([flight["nees"][name] for flight in flights])
                    for name in QUANTITIES
                },
                **{
                    part: {
                        key: float(np.median([flight[part][key] for flight in flights]))
                        for key in flights[0][part]
                    }
                    for part in ("estimate", "flown")
                },
            }
        )
    return {
        "goal": list(GOAL),
        "cut_off_hz": CUT_OFF_HZ,
        "delay_s": imu_delay_s(True, CUT_OFF_HZ),
        "arms_m": dict(ARMS),
        "rows": rows,
        "margins": [row for law in LAWS for row in margins_of(law)],
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "imu_filter",
    "./heli python -m evidence.experiments.imu_filter --seeds 1..40 --json",
    "Lever arms and the delay of the IMU's low-pass, known to the observer and not.",
    tuple(range(1, 41)),
    relative=MARGIN,
)


@table("imu_filter")
def imu_filter(results: Results) -> str:
    """What lever arms and the IMU's delay cost the estimate, known and not."""
    record = results["imu_filter"]
    return (
        f"{flights_table(record)}\n\nHover test, RTK, {results.seeds('imu_filter')}, default "
        "controllers, from 5 s on. NEES over degrees of freedom: mean (north, east, down; the "
        "worst flight), outside of the goal: bold. Errors of the estimate, and by how much the "
        "aircraft tilts about its mean: root mean square, median flight. IMU at "
        f"{record['arms_m']['sensors.imu.lever_arm_m']} m, antenna at "
        f"{record['arms_m']['sensors.gps.lever_arm_m']} m; low-pass {record['cut_off_hz']:g} Hz, "
        f"{1e3 * record['delay_s']:.1f} ms."
    )


@table("imu_filter_margins")
def imu_filter_margins(results: Results) -> str:
    """Margins of the attitude loop behind the IMU's low-pass."""
    return margins_table(results["imu_filter"])


def flights_table(record: Mapping[str, Any]) -> str:
    """The table of the flights."""
    rows = []
    for row in record["rows"]:
        estimate, of_aircraft = row["estimate"], row["flown"]
        rows.append(
            [
                row["world"],
                row["sensors"] + (f" ({row['lost']} lost)" if row["lost"] else ""),
                *(cell(row["nees"][name], record["goal"]) for name in QUANTITIES),
                f"{1e2 * estimate['position_m']:.1f} cm, {1e2 * estimate['velocity_mps']:.1f} cm/s",
                f"{estimate['tilt_deg']:.3f}, {estimate['heading_deg']:.2f} deg",
                f"{of_aircraft['tilt_deg']:.2f} deg, {of_aircraft['rates_degps']:.1f} deg/s",
            ]
        )
    head = ["world", "sensors", *(f"NEES, {name}" for name in QUANTITIES)]
    head += ["position, velocity off by", "tilt, heading off by", "flown tilt, roll and pitch rate"]
    return grid(head, rows)


def margins_table(record: Mapping[str, Any]) -> str:
    """The table of the margins."""
    rows = [
        [
            row["law"] + " (default)" * (row["law"] == DEFAULT),
            row["sensors"],
            f"{row['input']:.2f} / {row['output']:.2f}",
            f"{1e3 * row['delay_s']:.0f} ms",
        ]
        for row in record["margins"]
    ]
    head = ["controller", "sensors", "disk margin, input / output", "further delay survived"]
    return grid(head, rows)


def tables(record: Mapping[str, Any]) -> str:
    """Both."""
    return f"{flights_table(record)}\n\n{margins_table(record)}"


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, seeds="1..40", tables=tables))
