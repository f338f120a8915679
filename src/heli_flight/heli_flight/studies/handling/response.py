# SPDX-License-Identifier: Apache-2.0
"""`heli score --response`: bandwidth, phase delay, quickness, disturbance rejection of a bag."""

from dataclasses import dataclass
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from heli_flight.report.plot_style import BLUE, GREEN, GREY, ORANGE, picture
from heli_flight.studies.handling.command import EXIT_NEITHER, Wanted, checked_scale, print_forged
from heli_flight.studies.handling.data import Flight, flight_of, signal_of
from heli_flight.terminal import table
from heli_handling.boundaries import AXES, Measure, check_axis, of_bandwidth, of_rejection
from heli_handling.definitions import Scale
from heli_handling.quickness import Change, changes
from heli_handling.response import (
    LEAST_COHERENCE,
    FrequencyResponse,
    bandwidth,
    frequency_response,
    rejection,
    resampled,
)
from heli_msgs_bridge import topics

SCHEMA = 1
"""Number of the layout of `Responses.as_dict`."""


@dataclass(frozen=True)
class Responses:
    """What a flight says of an axis.

    Attributes
    ----------
    flight : Flight
    axis : str
    source : str
        What was swept.
    scale : Scale
    found : FrequencyResponse
    measures : tuple of Measure
    changes : tuple of Change
        Of attitude, from steady ones.
    remarks : tuple of str
    """

    flight: Flight
    axis: str
    source: str
    scale: Scale
    found: FrequencyResponse
    measures: tuple[Measure, ...]
    changes: tuple[Change, ...]
    remarks: tuple[str, ...]

    @property
    def exit_code(self) -> int:
        """0 unless a measure is below its levels, or the ground truth is forged."""
        failed = any(m.level == "below" for m in self.measures) or bool(self.flight.forged)
        return EXIT_NEITHER if failed else 0

    def as_dict(self, path: Path) -> dict[str, Any]:
        """For JSON."""
        return {
            "schema": SCHEMA,
            "response": self.axis,
            "source": self.source,
            "scale": {"name": self.scale.name, "length_ratio": self.scale.ratio},
            "coherent_from_radps": float(self.found.omega_radps[0]),
            "coherent_to_radps": float(self.found.omega_radps[-1]),
            "measures": [measure.as_dict() for measure in self.measures],
            "changes": [change.as_dict() for change in self.changes],
            "omega_radps": self.found.omega_radps.tolist(),
            "gain_db": self.found.gain_db.tolist(),
            "phase_deg": self.found.phase_deg.tolist(),
            "coherence": self.found.coherence.tolist(),
            "flight": str(path),
            "topic": self.flight.topic,
            "start_ns": self.flight.start_ns,
            "forged": self.flight.forged,
            "remarks": list(self.remarks),
        }


def score_response(
    wanted: Wanted,
    axis: str,
    command: str | None,
    disturbance: str | None,
    scale_name: str,
    rotor_diameter_m: float | None,
) -> Responses:
    """Response of an axis to its command, or of its attitude to a disturbance of the measured one.

    Raises
    ------
    ParameterError, BagError, HandlingError
        With one sentence.
    """
    check_axis(axis)
    scale, why = checked_scale(scale_name, wanted.path, rotor_diameter_m)
    flight = flight_of(wanted.path, wanted.odom)
    track = flight.track.between(wanted.start_s, wanted.end_s)
    source = disturbance or command or topics.ATTITUDE_SETPOINT
    given_s, given = signal_of(wanted.path, source, axis, flight.start_ns)
    angle = track.attitude_rad[:, AXES.index(axis)]
    both = (max(track.time_s[0], given_s[0]), min(track.time_s[-1], given_s[-1]))
    step_s = float(np.median(np.diff(track.time_s)))
    at_s = np.arange(both[0], both[1], step_s)
    swept, answer = resampled(given_s, given, at_s), resampled(track.time_s, angle, at_s)
    if disturbance:
        # The disturbed attitude is the true one and the disturbance.
        found = frequency_response(at_s, swept, answer + swept)
        measures = of_rejection(rejection(found), axis, scale)
    else:
        found = frequency_response(at_s, swept, answer)
        measures = of_bandwidth(bandwidth(found), axis, scale)
    remarks = (*flight.remarks, *([why] if why else []))
    seen = tuple(changes(track.time_s, angle))
    return Responses(flight, axis, source, scale, found, tuple(measures), seen, remarks)


def print_response(responses: Responses, out: Console) -> None:
    """Measures and changes as tables."""
    shown = table(f"{responses.axis}, {responses.source}, scale {responses.scale.name}", out)
    shown.add_column("measure", no_wrap=True)
    for name in ("value", "Level 1", "Level 2"):
        shown.add_column(name, justify="right")
    shown.add_column("level")
    for m in responses.measures:
        sign = ">=" if m.at_least else "<="
        value = "not reached" if m.value is None else f"{m.value:.3g} {m.unit}"
        bounds = ["" if b is None else f"{sign} {b:.3g} {m.unit}" for b in (m.level1, m.level2)]
        shown.add_row(m.text, value, *bounds, m.level or "")
    for change in responses.changes:
        what = f"quickness, {change.peak_deg:.1f} deg at {change.start_s:.1f} s"
        shown.add_row(what, f"{change.quickness_per_s:.3g} 1/s", "", "", "")
    out.print(shown)
    print_forged(responses.flight, out)
    omega = responses.found.omega_radps
    out.print(
        f"{responses.flight.topic}: coherence above {LEAST_COHERENCE:g} from {omega[0]:.3g} to "
        f"{omega[-1]:.3g} rad/s",
        soft_wrap=True,
        markup=False,
    )
    for remark in responses.remarks:
        out.print(remark, soft_wrap=True, markup=False)


def draw_response(responses: Responses, path: Path) -> None:
    """Gain, phase and coherence over frequency, with what was read from them."""
    found = responses.found
    with picture(path, 3, 1, (6.0, 6.6), sharex=True) as (figure, axes):
        gain, phase, coherence = axes[:, 0]
        gain.semilogx(found.omega_radps, found.gain_db, color=BLUE)
        gain.set_ylabel("gain, dB")
        phase.semilogx(found.omega_radps, found.phase_deg, color=BLUE)
        phase.set_ylabel("phase, deg")
        coherence.semilogx(found.omega_radps, found.coherence, color=GREY)
        coherence.axhline(LEAST_COHERENCE, color=ORANGE, linewidth=0.9)
        coherence.set_ylim(0.0, 1.05)
        coherence.set_ylabel("coherence")
        coherence.set_xlabel("frequency, rad/s")
        frequencies = (m for m in responses.measures if m.unit == "rad/s")
        for colour, measure in zip(cycle((GREEN, ORANGE, GREY)), frequencies, strict=False):
            if measure.value is not None:
                for ax in (gain, phase):
                    label = f"{measure.text}: {measure.value:.3g} rad/s"
                    ax.axvline(measure.value, color=colour, linestyle=":", label=label)
        gain.legend(loc="lower left")
        figure.suptitle(f"{responses.axis}: {responses.source}")
