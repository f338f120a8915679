# SPDX-License-Identifier: Apache-2.0
"""What a flight leaves behind: the table beside the paper, result.json, the resolved parameters."""

import json
import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from heli_core.coverage import Coverage, words
from heli_core.folders import write_whole
from heli_core.metrics import CLIMB_METRICS, PATH, ClimbFigure, PaperMetric
from heli_dynamics_sim.config import PlantConfig
from heli_dynamics_sim.wind import GUST, draw_gusts
from heli_flight.flight_file import changes, drawn, drawn_words, flown_faults, identity
from heli_flight.layers import AUTOPILOTS
from heli_flight.scoring import (
    DECIDES,
    SETTLED_S,
    SOURCE_NAMES,
    STRETCHES,
    TRUTH_LESS_DRIFT,
    Figures,
    Score,
    decides,
    figures_of,
    sources_of,
    spans,
)
from heli_flight.settings import Settings, laws_words, own_laws, own_words
from heli_flight.terminal import FittingTable, table
from heli_flight.worlds import PAPER

RESULT = "result.json"
EXIT_INSIDE = 0
EXIT_OUTSIDE = 1

_VERSIONED = ("numpy", "scipy", "numba", "rosbags", "ros-rclpy", "heli-hover")


class Verdict(StrEnum):
    """What a flight is found to be; the first that holds, in this order."""

    FORGED = "forged"
    LOST = "lost"
    PARTIAL = "partial"
    NOT_SCORED = "not scored"
    MEASURED = "measured, not judged"
    OUTSIDE = "outside"
    INSIDE = "inside"


@dataclass(frozen=True)
class Result:
    """Outcome of one flight.

    Attributes
    ----------
    figures : Figures
        Of both stretches, and of the climb.
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
    forged : str
        Why the recorded ground truth is not the plant's, one sentence; empty if it is.
    unheard : str
        Why the recorder may not have heard everything, one sentence; empty if it says that it has.
    """

    figures: Figures
    lost: str
    flown_s: float
    wall_s: float
    notes: Sequence[str] = field(default=())
    aircraft: str = ""
    forged: str = ""
    unheard: str = ""

    def outside(self, stretch: str = DECIDES) -> list[Score]:
        """Scores of a stretch outside the paper's figures, of all records."""
        return [s for s in self.figures.of(stretch) if not s.inside]

    def judged(self, gps: str, stretch: str = DECIDES) -> list[Score]:
        """Those of them that count for the verdict; over `DECIDES` they decide the exit code."""
        return [s for s in self.outside(stretch) if decides(s.source, gps)]

    def coverage(self, gps: str, stretch: str | None = None) -> Coverage:
        """How much of what is judged is recorded, as `Figures.covered`."""
        return self.figures.covered(gps, stretch)

    def partial(self, gps: str) -> str:
        """Why only a part of the flight can be judged, one sentence; empty if all can.

        Of a helicopter that was lost nothing is missing behind its loss.
        """
        lacking = "" if self.lost else self.coverage(gps).sentence
        return "; ".join(filter(None, (self.unheard, lacking)))

    def verdict(self, gps: str) -> Verdict:
        """What decides the exit code, in one word."""
        if self.forged:
            return Verdict.FORGED
        if self.lost:
            return Verdict.LOST
        if self.partial(gps):
            return Verdict.PARTIAL
        if self.judged(gps) or any(not figure.inside for figure in self.figures.ground):
            return Verdict.OUTSIDE
        scores = self.figures.of(DECIDES)
        if not scores:
            return Verdict.NOT_SCORED
        is_bounded = self.figures.ground or figures_of(s.metric for s in scores)
        return Verdict.INSIDE if is_bounded else Verdict.MEASURED

    def exit_code(self, gps: str) -> int:
        """0: what is judged is inside its bounds; 1: not, or lost, forged, partial.

        Also 0 where nothing was to be judged: a flight that was ordered to end before the windows,
        or one that nothing bounds.
        """
        passed = self.verdict(gps) in (Verdict.INSIDE, Verdict.NOT_SCORED, Verdict.MEASURED)
        return EXIT_INSIDE if passed else EXIT_OUTSIDE


def mean_wind(plant: Mapping[str, Any]) -> str:
    """The steady wind of the plant's parameters, in words."""
    if plant["wind.profile"] == "log":
        return f"{plant['wind.w20_mps']:g} m/s at 20 ft, log profile"
    speeds = "/".join(f"{v:g}" for v in plant["wind.profile_speed_mps"])
    return f"{speeds} m/s at {'/'.join(f'{h:g}' for h in plant['wind.profile_altitude_m'])} m"


def conditions(settings: Settings) -> str:
    """World, wind and sensors in two lines: they stand next to every comparison."""
    p = settings.nodes["plant"]
    mean = mean_wind(p) + ("," if p["wind.profile"] == "log" else "")
    turbulence = "MIL-F-8785C Dryden turbulence" if p["wind.turbulence"] else "no turbulence"
    gusts = np.reshape(p["wind.gust.amplitude_mps"], (-1, 3))
    peak = np.linalg.norm(gusts, axis=1).max(initial=0.0)
    if peak > 0.0:
        turbulence += f", {len(gusts)} discrete gusts up to {peak:.3g} m/s"
    rate, shares = p["wind.random_gusts.rate_per_min"], p["wind.random_gusts.amplitude_w20"]
    if rate > 0.0:
        least, most = shares
        turbulence += f", {rate:g} random gusts a minute of {least:g} to {most:g} of the 20 ft wind"
    world = "" if settings.world == PAPER else f"world {Path(settings.world).stem}, "
    fast = f"; IMU, observer and inner loop at {settings.rate.hz} Hz"
    return (
        f"simulated: {world}wind {mean} towards {p['wind.towards_deg']:g} deg, "
        f"{turbulence}; seed {settings.seed}{fast if settings.rate.fold != 1 else ''}\n"
        f"GPS {settings.gps}: white {p['sensors.gps.white_m']:g} m, drift "
        f"{p['sensors.gps.drift_m']:g} m, velocity {p['sensors.gps.velocity_mps']:g} m/s; "
        "the paper's numbers are from flight"
    )


def fault_words(settings: Settings) -> str:
    """The faults of a flight in words, on one line; empty without."""
    return "; ".join(fault.words for fault in flown_faults(settings))


def random_gusts(settings: Settings) -> list[dict[str, Any]]:
    """The random gusts that the flight's seed draws, in the order of their starts."""
    p = settings.nodes["plant"]
    if not p["wind.random_gusts.rate_per_min"]:
        return []
    # The air of a linear aircraft is that of any other.
    k = PlantConfig.from_parameters({**p, "linear_model": ""}).wind
    gusts = draw_gusts(settings.seed, k.random, k.w20_mps, k.towards_rad)
    return [
        {
            "start_s": float(gust[GUST.start]),
            "duration_s": float(gust[GUST.duration]),
            "peak_ned_mps": gust[GUST.peak].tolist(),
        }
        for gust in gusts
    ]


def phases(settings: Settings, stretch: str = DECIDES, until_s: float | None = None) -> str:
    """When a stretch is, in words: 0 to 60 s, or 5 to 18 s and 25 to 60 s.

    `until_s` as of `Figures`: what comes later is not scored.
    """
    scenario = settings.scenario
    if until_s is not None:
        scenario = scenario.cut_to(scenario.begin_s, until_s)
    return words(spans(scenario, stretch)) or "nothing: too short a flight"


def judged_by(settings: Settings, until_s: float | None = None) -> str:
    """What is compared with bounds and decides the exit code, in words."""
    who = " and ".join(SOURCE_NAMES[s] for s in SOURCE_NAMES if decides(s, settings.gps))
    return f"{who}, {phases(settings, until_s=until_s)}"


def sentence(result: Result, settings: Settings) -> str:
    """What the flight is found to be, one sentence: the first of the page, the last of a command.

    Where the navigation record, which decides, is inside and ground truth, less the receiver's
    drift at engagement, is not, it says both.
    """
    gps = settings.gps
    found = result.verdict(gps)
    when = f"from {phases(settings, until_s=result.figures.until_s)}"
    if found is Verdict.FORGED:
        return f"Forged: {result.forged}"
    if found is Verdict.LOST:
        return f"Lost after {result.flown_s:.2f} s: {result.lost}"
    if found is Verdict.PARTIAL:
        return f"Partial: {result.partial(gps)}"
    if found is Verdict.NOT_SCORED:
        return "Not scored: nothing was flown of what is scored"
    if found is Verdict.MEASURED:
        return f"Measured {when}, not judged: nothing bounds it; score.bounds of the scenario does"
    bounds = figures_of(settings.scenario.metrics) or "the goals"
    missed = [figure.metric.label for figure in result.figures.ground if not figure.inside]
    if found is Verdict.OUTSIDE:
        outside = [f"{s.metric.label} ({_of_bound(s)})" for s in _largest_of_each(result, gps)]
        words = [f"{bounds} {when} in {', '.join(outside)}"] if outside else []
        words += [f"the goals on the ground in {', '.join(missed)}"] if missed else []
        return f"Outside {' and '.join(words)}"
    beyond = [
        f"{s.metric.label} ({_of_bound(s)})"
        for s in result.outside()
        if s.source == TRUTH_LESS_DRIFT
    ]
    also = f"; drift-corrected ground truth is not in {', '.join(beyond)}"
    return f"Inside {bounds} {when}{also if beyond and gps == 'standalone' else ''}"


def _largest_of_each(result: Result, gps: str) -> list[Score]:
    """Of each metric that is outside the largest score."""
    largest: dict[str, Score] = {}
    for s in result.judged(gps):
        if s.metric.key not in largest or s.max > largest[s.metric.key].max:
            largest[s.metric.key] = s
    return list(largest.values())


def _of_bound(s: Score) -> str:
    return f"{s.max:.2f} of {s.metric.bound_text}"


def verdict(result: Result, settings: Settings, stretch: str) -> str:
    """One sentence: inside its figures over a stretch, what is outside of them, what is missing."""
    when = f"{STRETCHES[stretch]}, {phases(settings, stretch, result.figures.until_s)}"
    lacking = result.coverage(settings.gps, stretch)
    if not result.figures.of(stretch) and lacking.is_whole:
        return f"{when}: not scored"
    records: dict[str, list[str]] = {}
    for s in result.judged(settings.gps, stretch):
        records.setdefault(s.metric.label, []).append(SOURCE_NAMES[s.source])
    metrics: dict[str, list[str]] = {}
    for label, sources in records.items():
        metrics.setdefault(" and ".join(sources), []).append(label)
    names = "; ".join(f"{', '.join(labels)} ({sources})" for sources, labels in metrics.items())
    reasons = [f"outside in {names}"] if names else []
    reasons += [] if lacking.is_whole else [f"partial: {lacking.sentence}"]
    bounds = figures_of(s.metric for s in result.figures.of(stretch))
    good = f"inside {bounds}" if bounds else "measured; nothing bounds it"
    return f"{when}: " + ("; ".join(reasons) or good)


_TITLES = {"hover": "Hover test", "attitude": "Attitude test", PATH: "Path"}
_COUNTS = {
    "standalone": (
        f"The state estimate decides, as in the paper. Ground truth includes GPS drift, which the "
        f"aircraft cannot observe. The drift-corrected column removes the offset present at "
        f"t = {SETTLED_S:g} s (not later drift) and so shows controller performance."
    ),
    "rtk": "The state estimate and ground truth decide: an RTK receiver has no large drift.",
}


def print_table(result: Result, settings: Settings, console: Console) -> None:
    """Metric, this flight from its records, the bound: the whole flight first, then the windows."""
    until_s = result.figures.until_s
    if any(result.figures.of(stretch) for stretch in STRETCHES):
        for stretch in STRETCHES:
            if result.figures.of(stretch):
                console.print(_stretch_table(result, settings, stretch, console))
            console.print(verdict(result, settings, stretch), highlight=False)
        if result.figures.climb:
            console.print(_climb_table(result, settings, console))
        if result.figures.ground:
            console.print(_ground_table(result, console))
        console.print(f"judged: {judged_by(settings, until_s)}", highlight=False)
        if any(result.outside(stretch) for stretch in STRETCHES):
            console.print(f"! outside. {_COUNTS[settings.gps]}", highlight=False)
        if until_s is not None:
            words = f"from {until_s:.2f} s on it flew where it was told to: that is not scored"
            console.print(words, highlight=False)
    else:
        why = "nothing was flown"
        if (autopilot := AUTOPILOTS.get(settings.mode)) is not None:
            why = f"{autopilot} does not tell where it wanted to be"
        console.print(f"not scored: {why}")
    console.print(conditions(settings), highlight=False)
    if flown_faults(settings):
        console.print(f"faults: {fault_words(settings)}", highlight=False)
    if drawn(settings):
        console.print(drawn_words(settings), highlight=False)
    console.print(f"controllers: {laws_words(settings)}", highlight=False)
    if own_words(settings):
        console.print(f"own controller: {own_words(settings)}", highlight=False)
    for note in result.notes:
        console.print(f"note: {note}", highlight=False)
    if result.lost:
        console.print(f"LOST after {result.flown_s:.2f} s: {result.lost}", highlight=False)
    if result.forged:
        console.print(f"FORGED: {result.forged}", highlight=False)
    if result.partial(settings.gps):
        console.print(f"PARTIAL: {result.partial(settings.gps)}", highlight=False)


def _stretch_table(
    result: Result, settings: Settings, stretch: str, console: Console
) -> FittingTable:
    kind, sources = settings.scenario.kind, sources_of(settings.gps)
    title = _TITLES[kind]
    title += f" of {result.aircraft}" if result.aircraft else ""
    rows = table(f"{title}, {STRETCHES[stretch]}: largest magnitude (rms)", console)
    rows.add_column("metric")
    metrics = settings.scenario.metrics
    for name in (*(SOURCE_NAMES[source] for source in sources), bound_head(metrics)):
        rows.add_column(name, justify="right")
    rows.add_column("verdict")
    judged = result.judged(settings.gps, stretch)
    good = "inside" if result.coverage(settings.gps, stretch).is_whole else Verdict.PARTIAL.value
    for metric in metrics:
        scores = [result.figures.find(stretch, metric.key, source) for source in sources]
        bad = any(s.metric.key == metric.key for s in judged)
        rows.add_row(
            metric.label,
            *("-" if s is None else _cell(s) for s in scores),
            metric.bound_text,
            ("OUTSIDE" if bad else good) if metric.bounded else "-",
        )
    return rows


def bound_head(metrics: Iterable[PaperMetric]) -> str:
    """Head of the column of bounds: whose they are."""
    names = dict.fromkeys(metric.bound_name for metric in metrics)
    return next(iter(names)) if len(names) == 1 else "bound"


def _cell(s: Score) -> str:
    return f"{s.max:.2f} ({s.rms:.2f}) {s.metric.unit}{'' if s.inside else ' !'}"


def _climb_table(result: Result, settings: Settings, console: Console) -> FittingTable:
    rows = table("Climb", console)
    rows.add_column("figure")
    sources = sources_of(settings.gps)
    for source in sources:
        rows.add_column(SOURCE_NAMES[source], justify="right")
    by_key = {(f.metric.key, f.source): f for f in result.figures.climb}
    for metric in CLIMB_METRICS:
        figures = [by_key.get((metric.key, source)) for source in sources]
        rows.add_row(metric.label, *(climb_cell(figure) for figure in figures))
    return rows


def _ground_table(result: Result, console: Console) -> FittingTable:
    rows = table("From the ground to the ground", console)
    rows.add_column("figure")
    for name in ("this flight", "goal"):
        rows.add_column(name, justify="right")
    rows.add_column("verdict")
    for figure in result.figures.ground:
        metric = figure.metric
        verdict_word = "inside" if figure.inside else "OUTSIDE"
        rows.add_row(metric.label, figure.cell, f"{metric.goal:g} {metric.unit}", verdict_word)
    return rows


def climb_cell(figure: ClimbFigure | None) -> str:
    """A figure of the climb as a table says it."""
    if figure is None:
        return "-"
    if figure.value is None:
        return "not reached"
    return f"{figure.value:.2f} {figure.metric.unit}"


def versions() -> dict[str, str]:
    """Versions that a reader needs to repeat the flight."""
    installed = {"python": platform.python_version(), "machine": platform.machine()}
    for name in _VERSIONED:
        try:
            installed[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return installed


def _verdict_row(result: Result, settings: Settings, stretch: str) -> dict[str, Any]:
    """What result.json says of a stretch; inside is null where not all of it was scored."""
    outside = [s.name for s in result.judged(settings.gps, stretch)]
    coverage = result.coverage(settings.gps, stretch)
    return {
        "stretch": STRETCHES[stretch],
        "when": phases(settings, stretch, result.figures.until_s),
        "inside": not outside if result.figures.of(stretch) and coverage.is_whole else None,
        "outside": outside,
        "decides": stretch == DECIDES,
        "coverage": coverage.as_dict(),
    }


def write_result(
    result: Result, settings: Settings, folder: Path, extra: Mapping[str, Any]
) -> None:
    """Write result.json into the flight's folder."""
    content = {
        "aircraft": result.aircraft or None,
        **identity(settings, changes(settings)),
        "rate_hz": settings.rate.hz,
        "own_laws": own_laws(settings),
        "draw": drawn(settings),
        "exit_code": result.exit_code(settings.gps),
        "verdict": result.verdict(settings.gps).value,
        "coverage": result.coverage(settings.gps).as_dict(),
        "lost": result.lost,
        "forged": result.forged,
        "partial": result.partial(settings.gps),
        "unheard": result.unheard,
        "judged": judged_by(settings, result.figures.until_s),
        "sentence": sentence(result, settings),
        "until_s": result.figures.until_s,
        "outside": [s.name for s in result.judged(settings.gps)],
        "verdicts": {stretch: _verdict_row(result, settings, stretch) for stretch in STRETCHES},
        "flown_s": result.flown_s,
        "wall_s": round(result.wall_s, 3),
        "real_time_factor": round(result.flown_s / result.wall_s, 3) if result.wall_s > 0 else None,
        "metrics": [s.as_dict() for s in result.figures.all],
        "climb": [figure.as_dict() for figure in result.figures.climb],
        "ground": [figure.as_dict() for figure in result.figures.ground],
        "conditions": conditions(settings).splitlines(),
        "random_gusts": random_gusts(settings),
        "faults": [fault.as_dict() for fault in flown_faults(settings)],
        "notes": list(result.notes),
        "versions": versions(),
        "parameter_files": [str(path) for path in settings.files],
        **extra,
    }
    write_whole(folder / RESULT, json.dumps(content, indent=2) + "\n")
