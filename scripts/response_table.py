# SPDX-License-Identifier: Apache-2.0
"""Responses of the attitude loop to sweeps and steps flown in calm air, by law; JSON.

Usage: ./heli python scripts/response_table.py [--seeds 1..5]

Beside what was flown stands what the linear model of the same loop gives. The seeds are those of
the sensors' errors: the air stands still.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from seeds_option import parser_with_seeds

from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.record import FlightRecord
from heli_flight.loop.result import conditions
from heli_flight.loop.settings import Settings, resolve
from heli_flight.studies.handling.flown import rejected, swept, true_track
from heli_flight.studies.handling.linear import LinearLoop, grid_radps
from heli_handling.boundaries import AXES
from heli_handling.quickness import Change, changes
from heli_handling.response import FrequencyResponse, bandwidth, rejection
from heli_math.sweep import PARTS

LAWS = ("hinf_output", "hinf", "pid")
WORLD, RECEIVER = "paper", "rtk"


def settings_of(scenario: str, laws: str, axis: str) -> Settings:
    """A packaged scenario about an axis."""
    overrides = {"outer_loop": {"sweep.axis": axis}, "inner_loop": {"disturbance.axis": axis}}
    return resolve(scenario, RECEIVER, world=WORLD, laws=laws, overrides=overrides)


def flown(settings: Settings, seed: int) -> FlightRecord:
    """The record of a flight; a lost one ends the script."""
    flight = simulate(settings.with_seed(seed))
    if flight.sentence:
        raise SystemExit(f"seed {seed}: {flight.sentence}")
    return flight.record


def range_of(found: Sequence[dict[str, float | None]]) -> dict[str, list[float] | None]:
    """Least and largest value per measure; None where a flight does not reach it."""
    ranges: dict[str, list[float] | None] = {}
    for key in found[0]:
        values = [one[key] for one in found]
        known = [value for value in values if value is not None]
        ranges[key] = [min(known), max(known)] if len(known) == len(values) else None
    return ranges


def apart_db(found: Sequence[FrequencyResponse], linear: FrequencyResponse) -> float:
    """How far the gains of responses are from a linear one, rms over their coherent lines, dB."""
    apart = [
        20.0 * np.log10(np.abs(f.response / np.interp(f.omega_radps, linear.omega_radps,
                                                      linear.response)))
        for f in found
    ]  # fmt: skip
    return float(np.sqrt(np.mean(np.concatenate(apart) ** 2)))


def steps(laws: str, axis: str, seeds: Sequence[int]) -> list[dict[str, float]]:
    """Quickness of the changes that end before the next step, by the size of the step."""
    settings = settings_of("attitude_steps", laws, axis)
    start, length = (settings.nodes["outer_loop"][f"sweep.{k}"] for k in ("start_s", "duration_s"))
    size = settings.nodes["outer_loop"]["sweep.amplitude_deg"]
    found: dict[float, list[Change]] = {size: [], 0.5 * size: []}
    for seed in seeds:
        track = true_track(flown(settings, seed))
        for change in changes(track.time_s, track.attitude_rad[:, AXES.index(axis)]):
            if change.peak_s - change.start_s < length / PARTS:
                early = change.start_s < start + 0.5 * length
                found[size if early else 0.5 * size].append(change)
    return [
        {
            "step_deg": step,
            "changes": len(of_step),
            "peak_deg": [min(c.peak_deg for c in of_step), max(c.peak_deg for c in of_step)],
            "quickness_per_s": [
                min(c.quickness_per_s for c in of_step),
                max(c.quickness_per_s for c in of_step),
            ],
        }
        for step, of_step in found.items()
        if of_step
    ]


def row(laws: str, axis: str, seeds: Sequence[int]) -> dict[str, Any]:
    """Measures of an axis under a law, flown and by the linear model."""
    settings, k = settings_of("attitude_sweep", laws, axis), AXES.index(axis)
    responses = [swept(settings, flown(settings, seed), k) for seed in seeds]
    loop, omega = LinearLoop(settings), grid_radps()
    linear = loop.to_command(omega, axis)
    disturbed = settings_of("attitude_disturbance", laws, axis)
    rejections = [rejected(disturbed, flown(disturbed, seed), k) for seed in seeds]
    of_linear = loop.to_disturbance(omega, axis)
    return {
        "laws": laws,
        "axis": axis,
        "conditions": conditions(settings).splitlines(),
        "coherent_radps": [
            max(float(f.omega_radps[0]) for f in responses),
            min(float(f.omega_radps[-1]) for f in responses),
        ],
        "flown": range_of([asdict(bandwidth(f)) for f in responses]),
        "linear": asdict(bandwidth(linear)),
        "rms_difference_db": apart_db(responses, linear),
        "rejection": range_of([asdict(rejection(f)) for f in rejections]),
        "linear_rejection": asdict(rejection(of_linear)),
        "rejection_difference_db": apart_db(rejections, of_linear),
        "steps": steps(laws, axis, seeds),
    }


def main() -> None:
    """Print the rows."""
    seeds = parser_with_seeds(__doc__, "1..5").parse_args().seeds
    rows = [row(laws, axis, seeds) for laws in LAWS for axis in AXES]
    print(json.dumps({"seeds": seeds, "rows": rows}, indent=2))


if __name__ == "__main__":
    main()
