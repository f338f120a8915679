# SPDX-License-Identifier: Apache-2.0
"""`heli score --mte`: from a bag to a table of levels."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from heli_flight.studies.handling.data import Flight, flight_of, own_course, scale_of
from heli_flight.terminal import table
from heli_handling.definitions import FULL, MANOEUVRES, Scale
from heli_handling.scoring import Level, Score, score
from heli_handling.tracks import Track
from heli_parameters.parameters import ParameterError

SCALES = (FULL.name, "froude")
EXIT_NEITHER = 1
"""Outside of the bounds, or not flown as defined."""


@dataclass(frozen=True)
class Wanted:
    """What the user asks for.

    Attributes
    ----------
    path : Path
    odom : str or None
        Topic.
    start_s, end_s : float or None
        Since the topic's first message.
    target_enu_m : (float, float, float) or None
        Hover point, end of the course or centre of the circle.
    ground_m : float
        Height of the ground in the topic's frame.
    """

    path: Path
    odom: str | None = None
    start_s: float | None = None
    end_s: float | None = None
    target_enu_m: tuple[float, float, float] | None = None
    ground_m: float = 0.0


@dataclass(frozen=True)
class Scored:
    """A score, the flight, the stretch of its track, and remarks on both."""

    flight: Flight
    track: Track
    score: Score
    remarks: tuple[str, ...]

    @property
    def exit_code(self) -> int:
        """0 for desired or adequate, if it was the manoeuvre as it is defined, and really flown."""
        found = self.score
        failed = found.level is Level.NEITHER or not found.complete or bool(self.flight.forged)
        return EXIT_NEITHER if failed else 0

    def as_dict(self, path: Path) -> dict[str, Any]:
        """For JSON."""
        return {
            **self.score.as_dict(),
            "flight": str(path),
            "topic": self.flight.topic,
            "start_ns": self.flight.start_ns,
            "forged": self.flight.forged,
            "remarks": list(self.remarks),
        }


def checked_scale(name: str, path: Path, rotor_diameter_m: float | None) -> tuple[Scale, str]:
    """As `scale_of`, and ParameterError for another name."""
    if name not in SCALES:
        raise ParameterError(f"--scale {name}: is none of {', '.join(SCALES)}")
    return scale_of(name, path, rotor_diameter_m)


def score_manoeuvre(
    wanted: Wanted, name: str, scale_name: str, rotor_diameter_m: float | None
) -> Scored:
    """Score a manoeuvre of a bag.

    Raises
    ------
    ParameterError, BagError, HandlingError
        With one sentence.
    """
    if name not in MANOEUVRES:
        raise ParameterError(f"--mte {name}: is none of {', '.join(MANOEUVRES)}")
    scale, why = checked_scale(scale_name, wanted.path, rotor_diameter_m)
    flight = flight_of(wanted.path, wanted.odom)
    target, start_s, ours = None, wanted.start_s, ""
    if wanted.target_enu_m is not None:
        east, north, up = wanted.target_enu_m
        target = np.array([north, east, -up])
    elif wanted.odom is None and (course := own_course(wanted.path, name, scale)) is not None:
        target, begins_s = course
        start_s = begins_s if start_s is None else start_s
        north, east, down = target
        ours = (
            f"scored by where it was to be flown (params.yaml): target {east:.2f} {north:.2f} "
            f"{-down:.2f}, from {start_s:g} s on"
        )
    track = flight.track.between(start_s, wanted.end_s)
    found = score(track, name, scale, target, wanted.ground_m)
    remarks = (*flight.remarks, *filter(None, (why, ours)), *found.found.remarks)
    return Scored(flight, track, found, remarks)


def print_score(scored: Scored, out: Console) -> None:
    """Criteria, conditions and phases as tables."""
    found = scored.score
    shown = table(
        f"ADS-33E-PRF {found.table.paragraph} {found.table.title}, scale {found.scale.name}: "
        f"{found.level.value}{'' if found.complete else ', not flown as defined'}",
        out,
    )
    shown.add_column("criterion", no_wrap=True)
    for name in ("worst", "at, s", "desired", "adequate"):
        shown.add_column(name, justify="right")
    shown.add_column("level")
    for result in found.results:
        c = result.criterion
        sign = ">=" if c.at_least else "<="
        unit = c.quantity.value
        flown = ("not flown", "") if result.value is None else _flown(result.value, result.at_s)
        level = "" if result.level is None else result.level.value
        bounds = (f"{sign} {c.desired:.3g} {unit}", f"{sign} {c.adequate:.3g} {unit}")
        shown.add_row(c.text, *flown, *bounds, level)
    for given in found.conditions:
        limits = given.condition
        said = "not flown" if given.value is None else f"{given.value:.3g}"
        span = f"{limits.low:.3g} to {limits.high:.3g} {limits.quantity.value}"
        met = "as defined" if given.met else "" if given.value is None else "not as defined"
        shown.add_row(f"({limits.text})", said, "", span, "", met)
    out.print(shown)
    phases = ", ".join(f"{p.name} {p.start_s:.2f} to {p.end_s:.2f} s" for p in found.found.phases)
    out.print(f"{scored.flight.topic}: {phases}", soft_wrap=True, markup=False)
    for remark in scored.remarks:
        out.print(remark, soft_wrap=True, markup=False)
    print_forged(scored.flight, out)


def print_forged(flight: Flight, out: Console) -> None:
    """Say where the ground truth is not the plant's."""
    if flight.forged:
        out.print(f"FORGED: {flight.forged}", soft_wrap=True, markup=False)


def _flown(value: float, at_s: float | None) -> tuple[str, str]:
    return f"{value:.3g}", "" if at_s is None else f"{at_s:.2f}"
