# SPDX-License-Identifier: Apache-2.0
"""`heli compare laws`: files of laws against each other, in every world and on perturbed aircraft.

All fly the attitude test on the same seeds: with both receivers and with ideal navigation, which
shows the law alone, in each world, and on aircraft that differ from the nominal one. Errors are
those of ground truth. Every flight is a thread's own, and none changes another: how many fly at a
time changes no number.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from heli_dynamics_sim import plant
from heli_dynamics_sim.trim import TrimError
from heli_flight.loop.closed_loop import Flight, build, fly_loop
from heli_flight.loop.laws import LAWS, PACKAGED, SECTIONS
from heli_flight.loop.result import conditions
from heli_flight.loop.settings import Settings, resolve
from heli_flight.studies.compare.flown import Margins, margins_as_flown
from heli_flight.studies.compare.laws import AXES, attitude_errors_deg
from heli_flight.studies.compare.robustness import TOGETHER, perturbed
from heli_flight.terminal import table
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.law_state import AttitudeKernel
from heli_math.rows import ACTUATOR
from heli_parameters.parameters import ParameterError

RIVAL = "pid"
NAVIGATIONS = {"standalone": "standalone GPS", "rtk": "RTK", "ideal": "ideal navigation"}
SCENARIO = "attitude_gusts"
AIRCRAFT_PARTS = (*TOGETHER, "flap_back")
"""What is drawn anew per aircraft, within 30 %, and that its rotor flaps back."""
FIGURES = ("worst_deg", "median_deg", "rms_deg")
"""Of a row, by which laws are held against each other: the smaller, the better."""


@dataclass(frozen=True)
class Place:
    """Where laws are flown.

    Attributes
    ----------
    world, navigation : str
        Packaged world or the path of one; one of `NAVIGATIONS`.
    parts : tuple of str
        Of the aircraft, that differ from the world's (`robustness.perturbed`).
    """

    world: str
    navigation: str
    parts: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """For tables."""
        aircraft = ", +-30 % aircraft" if self.parts else ""
        return f"{Path(self.world).stem}, {NAVIGATIONS[self.navigation]}{aircraft}"

    def settings(self, laws: str, duration_s: float | None) -> Settings:
        """What is flown there with laws, but for the seed; raises ParameterError."""
        gps = "rtk" if self.navigation == "ideal" else self.navigation
        return resolve(SCENARIO, gps, None, duration_s, world=self.world, laws=laws)


@dataclass(frozen=True)
class Run:
    """One flight: errors of roll and pitch from truth over the scored stretch, deg, and travel.

    Attributes
    ----------
    max_deg, rms_deg : (2,) ndarray
        inf if the helicopter was lost.
    travel_per_s : (3,) ndarray
        What d_lat, d_lon, d_ped move in a second; nan if it was lost.
    """

    max_deg: np.ndarray
    rms_deg: np.ndarray
    travel_per_s: np.ndarray

    @property
    def lost(self) -> bool:
        """Whether the helicopter was lost, or could not hover at all."""
        return not np.isfinite(self.max_deg).all()


_Nodes = Mapping[str, Mapping[str, Any]]
_LOST = Run(np.full(2, np.inf), np.full(2, np.inf), np.full(3, np.nan))


@dataclass
class Comparison:
    """Flights by place and law, in the order of the place's seeds; margins by law, None: not known.

    `default` is the law that flies unless others are named, empty if it is none of these.
    """

    laws: Sequence[str]
    seeds: Mapping[Place, Sequence[int]]
    default: str = ""
    conditions: dict[Place, str] = field(default_factory=dict)
    runs: dict[tuple[Place, str], list[Run]] = field(default_factory=dict)
    margins: dict[str, Margins | None] = field(default_factory=dict)

    def summary(self) -> list[dict[str, Any]]:
        """A row per place, law and axis."""
        return [
            self._row(place, law, axis)
            for place in self.seeds
            for axis in range(len(AXES))
            for law in self.laws
        ]

    def _row(self, place: Place, law: str, axis: int) -> dict[str, Any]:
        runs = self.runs[place, law]
        kept = [run for run in runs if not run.lost]
        worst = [run.max_deg[axis] for run in runs]
        rivals = [run.max_deg[axis] for run in self.runs.get((place, RIVAL), [])]
        won = int(np.sum(np.less(worst, rivals))) if rivals else None
        return {
            "place": place.name,
            "law": Path(law).stem,
            "axis": AXES[axis],
            "flown": len(runs),
            "lost": len(runs) - len(kept),
            "worst_deg": _finite(max((run.max_deg[axis] for run in kept), default=np.nan)),
            "median_deg": _finite(float(np.median(worst))),
            "rms_deg": _finite(_pooled([run.rms_deg[axis] for run in kept])),
            "won_over_pid": None if law == RIVAL else won,
            "travel_per_s": _finite(_mean([run.travel_per_s[axis] for run in kept])),
        }

    def as_dict(self) -> dict[str, Any]:
        """For --json."""
        return {
            "scenario": SCENARIO,
            "laws": [Path(law).stem for law in self.laws],
            "default": Path(self.default).stem,
            "places": [
                {
                    "name": place.name,
                    "seeds": list(seeds),
                    "conditions": self.conditions[place].splitlines(),
                }
                for place, seeds in self.seeds.items()
            ],
            "margins": {
                Path(law).stem: m and {"input": m.input, "output": m.output, "delay_s": m.delay_s}
                for law, m in self.margins.items()
            },
            "rows": self.summary(),
        }


def parse_laws(text: str) -> tuple[str, ...]:
    """Files of laws of "packaged,pid"; of "all" the packaged ones that differ from one another.

    Raises
    ------
    ParameterError
        A name is unknown or stands there twice.
    """
    if text == "all":
        told: dict[str, _Nodes] = {}
        # Last the one that changes nothing: what it equals is better known by its own name.
        for name in sorted(LAWS.names(), key=lambda name: name == PACKAGED):
            nodes = _nodes(name)
            if not any(_same(nodes, other) for other in told.values()):
                told[name] = nodes
        return tuple(told)
    names = text.split(",")
    for name in names:
        LAWS.file(name)
    stems = [Path(name).stem for name in names]
    twice = [stem for stem in stems if stems.count(stem) > 1]
    if twice:
        raise ParameterError(f"--laws {text}: {twice[0]} stands there twice")
    return tuple(names)


def _nodes(laws: str) -> _Nodes:
    """All that is flown with laws which they may tell, by node and parameter."""
    settings = resolve(SCENARIO, "rtk", world="paper", laws=laws)
    return {section: settings.nodes[section] for section in SECTIONS}


def _same(a: _Nodes, b: _Nodes) -> bool:
    return all(np.array_equal(a[node][key], b[node][key]) for node in a for key in a[node])


def places(
    worlds: Sequence[str], seeds: Sequence[int], aircraft: int
) -> dict[Place, Sequence[int]]:
    """Every world with every navigation on the seeds, then so many perturbed aircraft."""
    found: dict[Place, Sequence[int]] = {
        Place(world, navigation): seeds for world in worlds for navigation in NAVIGATIONS
    }
    if aircraft:
        found[Place("paper", "rtk", AIRCRAFT_PARTS)] = range(1, aircraft + 1)
    return found


def compare(
    laws: Sequence[str],
    where: Mapping[Place, Sequence[int]],
    duration_s: float | None = None,
    jobs: int = 1,
    progress: Callable[[int], None] = lambda done: None,
) -> Comparison:
    """Fly every law at every place on its seeds, so many flights at a time.

    Progress is told how many flights are done.

    Raises
    ------
    ParameterError, SynthesisError
        Laws that cannot be flown.
    """
    nodes, usual = {law: _nodes(law) for law in laws}, _nodes(PACKAGED)
    result = Comparison(laws, where, next((law for law in laws if _same(nodes[law], usual)), ""))
    kernels: dict[str, AttitudeKernel] = {}
    for law, own in nodes.items():
        kernels[law] = AttitudeConfig.from_parameters(own["inner_loop"]).kernel
        result.margins[law] = margins_as_flown(own)
    done, pool = 0, ThreadPoolExecutor(jobs)
    try:
        for place, seeds in where.items():
            settings = {law: place.settings(law, duration_s) for law in laws}
            result.conditions[place] = conditions(settings[laws[0]])
            for runs in pool.map(partial(_flown, place, settings, kernels), seeds):
                for law, run in runs.items():
                    result.runs.setdefault((place, law), []).append(run)
                done += len(laws)
                progress(done)
    finally:
        pool.shutdown(cancel_futures=True)
    return result


def _flown(
    place: Place, settings: Mapping[str, Settings], kernels: Mapping[str, AttitudeKernel], seed: int
) -> dict[str, Run]:
    """The flights of a seed at a place, by law, all of the same aircraft in the same air."""
    own = {law: given.with_seed(seed) for law, given in settings.items()}
    nominal = plant.PlantConfig.from_parameters(next(iter(own.values())).nodes["plant"])
    aircraft, ideal = perturbed(nominal, place.parts, seed), place.navigation == "ideal"
    try:
        loops = {law: build(own[law], ideal, aircraft, kernels[law]) for law in own}
    except TrimError:
        # No actuator setting holds this aircraft in this wind: no law can.
        return dict.fromkeys(own, _LOST)
    return {law: _scored(fly_loop(loops[law], own[law]), own[law]) for law in own}


def _scored(flight: Flight, settings: Settings) -> Run:
    """What a flight shows over the scored stretch."""
    scored = settings.scenario.scored(flight.record.time_s)
    if flight.sentence or not scored.any():
        return _LOST
    error = attitude_errors_deg(flight.record, "truth")[scored]
    moved = np.abs(np.diff(flight.record.u[scored, ACTUATOR.attitude], axis=0))
    time_s = flight.record.time_s[scored]
    return Run(
        np.abs(error).max(axis=0),
        np.sqrt(np.mean(error**2, axis=0)),
        moved.sum(axis=0) / (time_s[-1] - time_s[0]),
    )


def _pooled(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else float("nan")


def _finite(value: float) -> float | None:
    """The value, None for what JSON has not."""
    return float(value) if np.isfinite(value) else None


def print_comparison(result: Comparison, out: Console) -> None:
    """Per place and axis worst / median and rms of each law, and on how many flights it won."""
    rows = table(
        "Largest attitude error from truth: worst / median over the flights, rms, deg; on how "
        "many it is below the PID's; *: smallest of the row",
        out,
    )
    content = result.as_dict()
    rows.add_column("place, axis")
    for head in heads(content):
        rows.add_column(head, justify="right")
    for place in content["places"]:
        for axis in AXES:
            own = rows_of(content, place["name"], axis)
            rows.add_row(title(place, axis), *(cell(row, smallest(own), "{}*") for row in own))
    rows.add_row("disk margin, input / output; further delay", *margin_cells(content))
    out.print(rows)
    for place, said in result.conditions.items():
        out.print(f"{place.name}: {said.splitlines()[0]}", highlight=False)


def heads(content: Mapping[str, Any]) -> list[str]:
    """Laws as a table names them."""
    default = content["default"]
    return [f"{law} (default)" if law == default else law for law in content["laws"]]


def title(place: Mapping[str, Any], axis: str) -> str:
    """A place's row as a table names it."""
    return f"{place['name']} ({len(place['seeds'])}), {axis}"


def rows_of(content: Mapping[str, Any], place: str, axis: str) -> list[Mapping[str, Any]]:
    """The rows of one place and axis, in the order of the laws."""
    return [row for row in content["rows"] if (row["place"], row["axis"]) == (place, axis)]


def smallest(rows: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Of each of `FIGURES` the smallest, as it is printed; of laws that lost no aircraft."""
    kept = [row for row in rows if not row["lost"]]
    return {key: _printed(min(row[key] for row in kept)) for key in FIGURES if kept}


def is_best(row: Mapping[str, Any], least: Mapping[str, str], key: str) -> bool:
    """Whether a row's number is the `smallest`; several can be."""
    return not row["lost"] and _printed(row[key]) == least[key]


def _printed(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def cell(row: Mapping[str, Any], least: Mapping[str, str], mark: str) -> str:
    """A law's numbers in a row of a table; `mark` is put about those that are the `least`."""
    if row["lost"] == row["flown"]:
        return "lost"
    worst, median, rms = (
        (mark if is_best(row, least, key) else "{}").format(_printed(row[key])) for key in FIGURES
    )
    text = f"{worst} / {median}, {rms}"
    text += "" if row["won_over_pid"] is None else f"; {row['won_over_pid']}"
    return f"{text}; {row['lost']} lost" if row["lost"] else text


def margin_cells(content: Mapping[str, Any]) -> list[str]:
    """Margins of each law as a table says them."""
    return [
        f"{m['input']:.2f} / {m['output']:.2f}; {1e3 * m['delay_s']:.0f} ms" if m else "–"
        for m in (content["margins"][law] for law in content["laws"])
    ]
