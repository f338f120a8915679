# SPDX-License-Identifier: Apache-2.0
"""Responses of the attitude loop to sweeps and steps flown in calm air, by controller; JSON.

Usage: ./heli python -m evidence.experiments.response [--seeds 1..5]

Beside what was flown stands what the linear model of the same loop gives. The seeds are those of
the sensors' errors: the air stands still.
"""

import sys
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np

from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid
from heli_analysis.handling.scoring import (
    AXES,
    AttitudeChange,
    FrequencyResponse,
    bandwidth,
    changes,
    rejection,
)
from heli_core.errors import FlightError
from heli_core.signals import PARTS
from heli_flight.loop import simulate
from heli_flight.record import FlightRecord
from heli_flight.result import conditions
from heli_flight.settings import Settings, resolve
from heli_studies.handling import LinearLoop, grid_radps, rejected, swept, true_track

LAWS = ("hinf_output", "hinf", "pid")
WORLD, RECEIVER = "paper", "rtk"


def settings_of(scenario: str, laws: str, axis: str) -> Settings:
    """A packaged scenario about an axis."""
    overrides = {"outer_loop": {"sweep.axis": axis}, "inner_loop": {"disturbance.axis": axis}}
    return resolve(scenario, RECEIVER, world=WORLD, laws=laws, overrides=overrides)


def record_of(settings: Settings, seed: int) -> FlightRecord:
    """The record of a flight; raises FlightError if it was lost."""
    flight = simulate(settings.with_seed(seed))
    if flight.sentence:
        raise FlightError(f"seed {seed}: {flight.sentence}")
    return flight.record


class Responses(NamedTuple):
    """Of one seed: the answer to the sweep and to the disturbance, the changes of the steps."""

    command: FrequencyResponse
    disturbance: FrequencyResponse
    changes: list[AttitudeChange]


@over(laws=LAWS, axis=AXES)
def flown(laws: str, axis: str, seed: int) -> Responses:
    """Fly a sweep, a disturbance and steps about an axis."""
    k = AXES.index(axis)
    sweep, disturbance, steps = (
        settings_of(scenario, laws, axis)
        for scenario in ("attitude_sweep", "attitude_disturbance", "attitude_steps")
    )
    track = true_track(record_of(steps, seed))
    return Responses(
        swept(sweep, record_of(sweep, seed), k),
        rejected(disturbance, record_of(disturbance, seed), k),
        list(changes(track.time_s, track.attitude_rad[:, k])),
    )


def range_of(rows: Sequence[dict[str, float | None]]) -> dict[str, list[float] | None]:
    """Least and largest value per measure; None where a flight does not reach it."""
    ranges: dict[str, list[float] | None] = {}
    for key in rows[0]:
        values = [one[key] for one in rows]
        known = [value for value in values if value is not None]
        ranges[key] = [min(known), max(known)] if len(known) == len(values) else None
    return ranges


def apart_db(responses: Sequence[FrequencyResponse], linear: FrequencyResponse) -> float:
    """How far the gains of responses are from a linear one, rms over their coherent lines, dB."""
    apart = [
        20.0 * np.log10(np.abs(f.response / np.interp(f.omega_radps, linear.omega_radps,
                                                      linear.response)))
        for f in responses
    ]  # fmt: skip
    return float(np.sqrt(np.mean(np.concatenate(apart) ** 2)))


def steps(laws: str, axis: str, flights: Sequence[Responses]) -> list[dict[str, Any]]:
    """Quickness of the changes that end before the next step, by the size of the step."""
    settings = settings_of("attitude_steps", laws, axis)
    start, length = (settings.nodes["outer_loop"][f"sweep.{k}"] for k in ("start_s", "duration_s"))
    size = settings.nodes["outer_loop"]["sweep.amplitude_deg"]
    by_size: dict[float, list[AttitudeChange]] = {size: [], 0.5 * size: []}
    for flight in flights:
        for change in flight.changes:
            if change.peak_s - change.start_s < length / PARTS:
                early = change.start_s < start + 0.5 * length
                by_size[size if early else 0.5 * size].append(change)
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
        for step, of_step in by_size.items()
        if of_step
    ]


def row(place: Place[Responses]) -> dict[str, Any]:
    """Measures of an axis under a controller, flown and by the linear model."""
    laws, axis = place.point.values()
    settings = settings_of("attitude_sweep", laws, axis)
    responses = [flight.command for flight in place.flights]
    loop, omega = LinearLoop(settings), grid_radps()
    linear = loop.to_command(omega, axis)
    rejections = [flight.disturbance for flight in place.flights]
    of_linear = loop.to_disturbance(omega, axis)
    return {
        **place.point,
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
        "steps": steps(laws, axis, place.flights),
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows."""
    return {"seeds": options.seeds, "rows": [row(place) for place in flown.places(options)]}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "response",
    "./heli python -m evidence.experiments.response --seeds 1..5",
    "Responses of the attitude loop to sweeps and steps, by controller.",
    tuple(range(1, 6)),
    MARGIN,
)


@table("response")
def response(results: Results) -> str:
    """Bandwidth, phase delay, quickness and disturbance rejection by controller and axis."""
    record = results["response"]
    head = [
        "controller, axis",
        "bandwidth, rad/s",
        "6 dB of gain, rad/s",
        "phase delay, s",
        "DRB, rad/s",
        "DRP, dB",
        "quickness, 1/s, step of 20, 10 deg",
    ]
    rows = [
        [
            f"`{row['laws']}`, {row['axis']}",
            *(
                _beside(row["flown"][key], row["linear"][key])
                for key in ("phase_radps", "gain_radps", "phase_delay_s")
            ),
            *(
                _beside(row["rejection"][key], row["linear_rejection"][key])
                for key in ("bandwidth_radps", "peak_db")
            ),
            ", ".join(_span(step["quickness_per_s"]) for step in row["steps"]),
        ]
        for row in record["rows"]
    ]
    command, rejection = (
        max(row[key] for row in record["rows"])
        for key in ("rms_difference_db", "rejection_difference_db")
    )
    return (
        f"{grid(head, rows)}\n\nFlown, of {len(record['seeds'])} flights "
        f"({results.seeds('response')}) the least and the largest, in calm air, RTK; in brackets "
        "the linear model of the same loop. Gains of both differ over the coherent lines by "
        f"{command:.1f} dB rms at most (response to the command, "
        f"{_span(record['rows'][0]['coherent_radps'])} rad/s for the first) and {rejection:.1f} dB "
        "(rejection of disturbances)."
    )


def _beside(flown: list[float] | None, linear: float | None) -> str:
    """What was flown, and in brackets the linear model's."""
    return f"{'not reached' if flown is None else _span(flown)} ({_number(linear)})"


def _span(ends: list[float]) -> str:
    low, high = (_number(end) for end in ends)
    return low if low == high else f"{low} to {high}"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}"


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..5"))
