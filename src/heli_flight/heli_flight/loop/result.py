# SPDX-License-Identifier: Apache-2.0
"""What a flight leaves behind: the table beside the paper, result.json, the resolved parameters."""

import json
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from heli_flight.loop.flight_file import changes, identity
from heli_flight.loop.scoring import METRICS, SOURCES, Score
from heli_flight.loop.settings import Settings
from heli_flight.terminal import table
from heli_math.ticks import seconds

RESULT = "result.json"
EXIT_INSIDE = 0
EXIT_OUTSIDE = 1

_VERSIONED = ("numpy", "scipy", "numba", "rosbags", "ros-rclpy", "heli-hover")


@dataclass(frozen=True)
class Result:
    """Outcome of one flight.

    Attributes
    ----------
    scores : sequence of Score
    lost : str
        Why the helicopter was lost, one sentence; empty if it was not.
    flown_s : float
        Flight time.
    wall_s : float
        Wall time of the flight itself, without start-up.
    notes : sequence of str
        What the reader should know: faults met, messages lost.
    aircraft : str
        Namespace that it flew in, among others; empty if it flew alone.
    """

    scores: Sequence[Score]
    lost: str
    flown_s: float
    wall_s: float
    notes: Sequence[str] = field(default=())
    aircraft: str = ""

    @property
    def outside(self) -> list[Score]:
        """Scores outside the paper's figures."""
        return [s for s in self.scores if not s.inside]

    def judged(self, gps: str) -> list[Score]:
        """Scores outside the paper's figures that decide the exit code.

        The navigation record always counts, as in the paper. Ground truth counts where the
        receiver can know it: with rtk. A standalone receiver drifts by 1 m.
        """
        return [s for s in self.outside if s.source == "navigation" or gps == "rtk"]

    def exit_code(self, gps: str) -> int:
        """0: nothing that is judged is outside the paper's figures; 1: outside, or lost."""
        return EXIT_OUTSIDE if self.lost or self.judged(gps) else EXIT_INSIDE


def conditions(settings: Settings) -> str:
    """Wind and sensors in two lines: they stand next to every comparison."""
    p = settings.nodes["plant"]
    speeds = "/".join(f"{v:g}" for v in p["wind.profile_speed_mps"])
    heights = "/".join(f"{h:g}" for h in p["wind.profile_altitude_m"])
    turbulence = "MIL-F-8785C Dryden turbulence" if p["wind.turbulence"] else "no turbulence"
    gusts = np.reshape(p["wind.gust.amplitude_mps"], (-1, 3))
    peak = np.linalg.norm(gusts, axis=1).max(initial=0.0)
    if peak > 0.0:
        turbulence += f", {len(gusts)} discrete gusts up to {peak:.3g} m/s"
    return (
        f"simulated: wind {speeds} m/s at {heights} m towards {p['wind.towards_deg']:g} deg, "
        f"{turbulence}; seed {settings.seed}\n"
        f"GPS {settings.gps}: white {p['sensors.gps.white_m']:g} m, drift "
        f"{p['sensors.gps.drift_m']:g} m, velocity {p['sensors.gps.velocity_mps']:g} m/s; "
        "the paper's numbers are from flight"
    )


def judged_by(settings: Settings) -> str:
    """What is held against the paper's figures and decides the exit code, in words."""
    who = "navigation record and ground truth" if settings.gps == "rtk" else "navigation record"
    end_s = seconds(settings.scenario.n_ticks)
    windows = [(a, min(b, end_s)) for a, b in settings.scenario.windows_s if a < min(b, end_s)]
    when = " and ".join(f"{a:g} to {b:g} s" for a, b in windows) or "nothing: too short a flight"
    return f"{who}, {when}"


_LEGEND = "! outside the paper's figure. "
_DECIDES = {
    "standalone": (
        "The navigation record decides, as in the paper: ground truth holds the drift of the "
        "standalone receiver, too, which no instrument on board can see."
    ),
    "rtk": "The navigation record and, as an RTK receiver knows it, ground truth decide.",
}


def print_table(result: Result, settings: Settings, console: Console) -> None:
    """Metric, this flight from navigation and from truth, the paper."""
    kind = settings.scenario.kind
    title = {"hover": "Hover test", "attitude": "Attitude test"}[kind]
    title += f" of {result.aircraft}" if result.aircraft else ""
    if result.scores:
        rows = table(f"{title}: largest magnitude (rms) in the scored phases", console)
        rows.add_column("metric")
        for name in ("navigation record", "ground truth", "paper"):
            rows.add_column(name, justify="right")
        rows.add_column("verdict")
        by_key = {(s.metric.key, s.source): s for s in result.scores}
        judged = result.judged(settings.gps)
        for metric in METRICS[kind]:
            cells = []
            for source in SOURCES:
                s = by_key[metric.key, source]
                mark = "" if s.inside else " !"
                cells.append(f"{s.max:.2f} ({s.rms:.2f}) {metric.unit}{mark}")
            bad = any(s.metric is metric for s in judged)
            rows.add_row(
                metric.label,
                *cells,
                f"{metric.paper:g} {metric.unit}",
                "OUTSIDE" if bad else "inside",
            )
        console.print(rows)
        console.print(f"judged: {judged_by(settings)}", highlight=False)
        if result.outside:
            console.print(_LEGEND + _DECIDES[settings.gps], highlight=False)
    else:
        console.print("not scored: the flight ended before the first scored phase")
    console.print(conditions(settings), highlight=False)
    for note in result.notes:
        console.print(f"note: {note}", highlight=False)
    if result.lost:
        console.print(f"LOST after {result.flown_s:.2f} s: {result.lost}", highlight=False)


def versions() -> dict[str, str]:
    """Versions that a reader needs to repeat the flight."""
    found = {"python": platform.python_version(), "machine": platform.machine()}
    for name in _VERSIONED:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def write_result(
    result: Result, settings: Settings, folder: Path, extra: Mapping[str, Any]
) -> None:
    """Write result.json into the flight's folder."""
    content = {
        "aircraft": result.aircraft or None,
        **identity(settings, changes(settings)),
        "exit_code": result.exit_code(settings.gps),
        "lost": result.lost,
        "judged": judged_by(settings),
        "outside": [f"{s.metric.key} ({s.source})" for s in result.judged(settings.gps)],
        "flown_s": result.flown_s,
        "wall_s": round(result.wall_s, 3),
        "real_time_factor": round(result.flown_s / result.wall_s, 3) if result.wall_s > 0 else None,
        "metrics": [s.as_dict() for s in result.scores],
        "conditions": conditions(settings).splitlines(),
        "notes": list(result.notes),
        "versions": versions(),
        "parameter_files": [str(path) for path in settings.files],
        **extra,
    }
    (folder / RESULT).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
