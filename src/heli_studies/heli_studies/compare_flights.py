# SPDX-License-Identifier: Apache-2.0
"""`heli compare laws`: control presets compared, in every world and on perturbed aircraft.

All fly the attitude test on the same seeds: with both receivers and with ideal navigation, which
shows the controller alone, in each world, and on aircraft that differ from the nominal one. Errors
are those of ground truth. Every flight is a thread's own, and none changes another: how many fly at
a time changes no number.
"""

import statistics
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from heli_core.metrics import ATTITUDE_DEG, METRICS, PaperMetric
from heli_core.rcl_yaml import ParameterError
from heli_core.rows import ACTUATOR
from heli_dynamics_sim import plant
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.plant import PlantStatus
from heli_dynamics_sim.trim import TrimError, flap_back_in_hover
from heli_flight.flight_file import drawn
from heli_flight.loop import LoopFlight, build, fly_loop, simulate
from heli_flight.report.figures import BLUE, GREY, ORANGE, RED, picture
from heli_flight.result import Result, conditions, mean_wind
from heli_flight.scoring import STRETCHES, Figures, score, sources_of
from heli_flight.settings import Settings, resolve
from heli_flight.terminal import table
from heli_flight.worlds import LAWS, PACKAGED, SECTIONS
from heli_inner_hinf.controller_state import AttitudeParams
from heli_inner_hinf.design import AttitudeConfig
from heli_studies.campaign.run import with_seed
from heli_studies.compare import (
    AXES,
    TOGETHER,
    ComparedLaw,
    Margins,
    attitude_errors_deg,
    largest,
    margins_as_flown,
    perturbed,
    with_law,
)

# -------------------------------------------------------------------------------------------------
# Everywhere.
# -------------------------------------------------------------------------------------------------

RIVAL = "pid"
NAVIGATIONS = {"standalone": "standalone GPS", "rtk": "RTK", "ideal": "ideal navigation"}
SCENARIO = "attitude_gusts"
AIRCRAFT_PARTS = (*TOGETHER, "flap_back")
"""What is drawn anew per aircraft, within 30 %, and that its rotor flaps back."""
FIGURES = ("worst_deg", "median_deg", "rms_deg")
"""Of a row, by which controllers are compared with each other: the smaller, the better."""


@dataclass(frozen=True)
class FlightCondition:
    """Where controllers are flown.

    Attributes
    ----------
    world, navigation : str
        Packaged world or the path of one; one of `NAVIGATIONS`.
    parts : tuple of str
        Of the aircraft, that differ from the world's (`compare.perturbed`).
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
        """What is flown there with controllers, but for the seed; raises ParameterError."""
        gps = "rtk" if self.navigation == "ideal" else self.navigation
        return resolve(SCENARIO, gps, None, duration_s, world=self.world, laws=laws)


@dataclass(frozen=True)
class LawRun:
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
_LOST = LawRun(np.full(2, np.inf), np.full(2, np.inf), np.full(3, np.nan))


@dataclass
class LawMatrix:
    """Flights by place and controller, by the place's seeds; margins by controller, or None.

    `default` is the controller that flies unless others are named, empty if it is none of these.
    """

    laws: Sequence[str]
    seeds: Mapping[FlightCondition, Sequence[int]]
    default: str = ""
    conditions: dict[FlightCondition, str] = field(default_factory=dict)
    runs: dict[tuple[FlightCondition, str], list[LawRun]] = field(default_factory=dict)
    margins: dict[str, Margins | None] = field(default_factory=dict)

    def summary(self) -> list[dict[str, Any]]:
        """A row per place, controller and axis."""
        return [
            self._row(place, law, axis)
            for place in self.seeds
            for axis in range(len(AXES))
            for law in self.laws
        ]

    def _row(self, place: FlightCondition, law: str, axis: int) -> dict[str, Any]:
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
    """Control presets of "packaged,pid"; of "all" the packaged ones that differ from one another.

    Raises
    ------
    ParameterError
        A name is unknown or stands there twice.
    """
    if text == "all":
        distinct: dict[str, _Nodes] = {}
        # Last the one that changes nothing: what it equals is better known by its own name.
        for name in sorted(LAWS.names(), key=lambda name: name == PACKAGED):
            nodes = _nodes(name)
            if not any(_same(nodes, other) for other in distinct.values()):
                distinct[name] = nodes
        return tuple(distinct)
    names = text.split(",")
    for name in names:
        LAWS.file(name)
    stems = [Path(name).stem for name in names]
    twice = [stem for stem in stems if stems.count(stem) > 1]
    if twice:
        raise ParameterError(f"--control-preset {text}: {twice[0]} stands there twice")
    return tuple(names)


def _nodes(laws: str) -> _Nodes:
    """All that is flown with controllers which they may tell, by node and parameter."""
    settings = resolve(SCENARIO, "rtk", world="paper", laws=laws)
    return {section: settings.nodes[section] for section in SECTIONS}


def _same(a: _Nodes, b: _Nodes) -> bool:
    return all(np.array_equal(a[node][key], b[node][key]) for node in a for key in a[node])


def test_conditions(
    worlds: Sequence[str], seeds: Sequence[int], aircraft: int
) -> dict[FlightCondition, Sequence[int]]:
    """Every world with every navigation on the seeds, then so many perturbed aircraft."""
    seeds_by_condition: dict[FlightCondition, Sequence[int]] = {
        FlightCondition(world, navigation): seeds for world in worlds for navigation in NAVIGATIONS
    }
    if aircraft:
        seeds_by_condition[FlightCondition("paper", "rtk", AIRCRAFT_PARTS)] = range(1, aircraft + 1)
    return seeds_by_condition


def compare_laws(
    laws: Sequence[str],
    where: Mapping[FlightCondition, Sequence[int]],
    duration_s: float | None = None,
    jobs: int = 1,
    progress: Callable[[int], None] = lambda done: None,
) -> LawMatrix:
    """Fly every controller at every place on its seeds, so many flights at a time.

    Progress is told how many flights are done.

    Raises
    ------
    ParameterError, SynthesisError
        Controllers that cannot be flown.
    """
    nodes, usual = {law: _nodes(law) for law in laws}, _nodes(PACKAGED)
    result = LawMatrix(laws, where, next((law for law in laws if _same(nodes[law], usual)), ""))
    kernels: dict[str, AttitudeParams] = {}
    for law, parameters in nodes.items():
        kernels[law] = AttitudeConfig.from_parameters(parameters["inner_loop"]).params
        result.margins[law] = margins_as_flown(parameters)
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
    place: FlightCondition,
    settings: Mapping[str, Settings],
    kernels: Mapping[str, AttitudeParams],
    seed: int,
) -> dict[str, LawRun]:
    """The flights of a seed at a place, by controller, all of the same aircraft in the same air."""
    seed_settings = {law: law_settings.with_seed(seed) for law, law_settings in settings.items()}
    nominal = plant.PlantConfig.from_parameters(next(iter(seed_settings.values())).nodes["plant"])
    aircraft, ideal = perturbed(nominal, place.parts, seed), place.navigation == "ideal"
    try:
        loops = {
            law: build(seed_settings[law], ideal, aircraft, kernels[law]) for law in seed_settings
        }
    except TrimError:
        # No actuator setting holds this aircraft in this wind: no controller can.
        return dict.fromkeys(seed_settings, _LOST)
    return {
        law: _scored(fly_loop(loops[law], seed_settings[law]), seed_settings[law])
        for law in seed_settings
    }


def _scored(flight: LoopFlight, settings: Settings) -> LawRun:
    """What a flight shows over the scored stretch."""
    scored = settings.scenario.scored(flight.record.time_s)
    if flight.sentence or not scored.any():
        return _LOST
    error = attitude_errors_deg(flight.record, "truth")[scored]
    moved = np.abs(np.diff(flight.record.u[scored, ACTUATOR.attitude], axis=0))
    time_s = flight.record.time_s[scored]
    return LawRun(
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


def print_law_matrix(result: LawMatrix, out: Console) -> None:
    """Per place and axis worst / median and rms of each controller, and flights that it won."""
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
            law_rows = rows_of(content, place["name"], axis)
            rows.add_row(
                condition_title(place, axis),
                *(cell(row, smallest(law_rows), "{}*") for row in law_rows),
            )
    rows.add_row("disk margin, input / output; further delay", *margin_cells(content))
    out.print(rows)
    for place, condition_text in result.conditions.items():
        out.print(f"{place.name}: {condition_text.splitlines()[0]}", highlight=False)


def heads(content: Mapping[str, Any]) -> list[str]:
    """Controllers as a table names them."""
    default = content["default"]
    return [f"{law} (default)" if law == default else law for law in content["laws"]]


def condition_title(place: Mapping[str, Any], axis: str) -> str:
    """A place's row as a table names it."""
    return f"{place['name']} ({len(place['seeds'])}), {axis}"


def rows_of(content: Mapping[str, Any], place: str, axis: str) -> list[Mapping[str, Any]]:
    """The rows of one place and axis, in the order of the controllers."""
    return [row for row in content["rows"] if (row["place"], row["axis"]) == (place, axis)]


def smallest(rows: Sequence[Mapping[str, Any]]) -> dict[str, str]:
    """Of each of `FIGURES` the smallest, as it is printed; of controllers that lost no aircraft."""
    kept = [row for row in rows if not row["lost"]]
    return {key: _printed(min(row[key] for row in kept)) for key in FIGURES if kept}


def is_best(row: Mapping[str, Any], least: Mapping[str, str], key: str) -> bool:
    """Whether a row's number is the `smallest`; several can be."""
    return not row["lost"] and _printed(row[key]) == least[key]


def _printed(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def cell(row: Mapping[str, Any], least: Mapping[str, str], mark: str) -> str:
    """A controller's numbers in a table's row; `mark` is put about those that are `least`."""
    if row["lost"] == row["flown"]:
        return "lost"
    worst, median, rms = (
        (mark if is_best(row, least, key) else "{}").format(_printed(row[key])) for key in FIGURES
    )
    text = f"{worst} / {median}, {rms}"
    text += "" if row["won_over_pid"] is None else f"; {row['won_over_pid']}"
    return f"{text}; {row['lost']} lost" if row["lost"] else text


def margin_cells(content: Mapping[str, Any]) -> list[str]:
    """Margins of each controller as a table says them."""
    return [
        f"{m['input']:.2f} / {m['output']:.2f}; {1e3 * m['delay_s']:.0f} ms" if m else "–"
        for m in (content["margins"][law] for law in content["laws"])
    ]


# -------------------------------------------------------------------------------------------------
# `heli compare attitude`: the controllers on the same seeds in the paper's attitude test
# (Fig. 3, 4).
# -------------------------------------------------------------------------------------------------

SOURCES = ("navigation", "truth", "ideal")
"""On-board record, ground truth, and ground truth of a flight with ideal navigation."""
PAPER_DEG = {law: bound for law, (bound, _) in ATTITUDE_DEG.items()}


@dataclass(frozen=True)
class AttitudeFlight:
    """One flight, scored; errors in deg over the scored stretch.

    Attributes
    ----------
    law : str
    seed : int
    source : str
        One of SOURCES.
    max_deg, rms_deg : tuple of two floats
        Roll, pitch; nan if the helicopter was lost.
    lost : str
        Why, one sentence; empty if it was not.
    """

    law: str
    seed: int
    source: str
    max_deg: tuple[float, float]
    rms_deg: tuple[float, float]
    lost: str


@dataclass
class AttitudeComparison:
    """All flights, and the first seed's in full for the picture."""

    settings: Settings
    laws: tuple[ComparedLaw, ...]
    seeds: list[int]
    flap_back: bool = False
    flights: list[AttitudeFlight] = field(default_factory=list)
    shown: dict[str, LoopFlight] = field(default_factory=dict)

    @property
    def sources(self) -> list[str]:
        """Sources that were flown, in order."""
        flown = {flight.source for flight in self.flights}
        return [source for source in SOURCES if source in flown]

    @property
    def flap_back_radpmps(self) -> float:
        """How far the rotor flaps back once it has settled, per air speed: that of the aircraft."""
        if not self.flap_back:
            return 0.0
        file = self.settings.nodes["plant"]["aircraft_file"]
        return flap_back_in_hover(HelicopterParameters.from_yaml(file))

    def of(self, law: str, source: str) -> dict[int, AttitudeFlight]:
        """Flights of a controller by seed."""
        return {f.seed: f for f in self.flights if (f.law, f.source) == (law, source)}

    def wins(self, law: str, source: str, axis: int) -> int | None:
        """Seeds on which the controller's largest error is below the PID's; None without a PID."""
        mine, rival = self.of(law, source), self.of(RIVAL, source)
        if not rival or law == RIVAL:
            return None
        return sum(
            not mine[s].lost
            and (rival[s].lost != "" or mine[s].max_deg[axis] < rival[s].max_deg[axis])
            for s in self.seeds
        )

    def summary(self) -> list[dict[str, Any]]:
        """One row per controller and source: largest and rms over all seeds, wins over the PID."""
        rows = []
        for law in self.laws:
            for source in self.sources:
                flights = list(self.of(law.key, source).values())
                good = [f for f in flights if not f.lost]
                row: dict[str, Any] = {"law": law.key, "source": source}
                for i, axis in enumerate(AXES):
                    row[f"{axis}_max_deg"] = largest([f.max_deg[i] for f in good])
                    row[f"{axis}_rms_deg"] = _attitude_pooled([f.rms_deg[i] for f in good])
                    row[f"{axis}_wins_over_pid"] = self.wins(law.key, source, i)
                row["lost"] = len(flights) - len(good)
                rows.append(row)
        return rows

    def as_dict(self) -> dict[str, Any]:
        """For --json."""
        return {
            "scenario": self.settings.scenario_name,
            "seeds": self.seeds,
            "flap_back_radpmps": self.flap_back_radpmps,
            "conditions": conditions(self.settings).splitlines(),
            "paper_max_deg": PAPER_DEG,
            "summary": self.summary(),
            "flights": [asdict(flight) for flight in self.flights],
        }


def compare_attitude(
    settings: Settings,
    laws: tuple[ComparedLaw, ...],
    seeds: Sequence[int],
    ideal: bool = False,
    flap_back: bool = False,
    progress: Callable[[int], None] = lambda done: None,
) -> AttitudeComparison:
    """Fly every controller on every seed.

    Parameters
    ----------
    settings : Settings
        An attitude scenario.
    laws, seeds : sequence
    ideal : bool
        Also with ideal navigation, which shows the controller without the estimator.
    flap_back : bool
        The rotor flaps back as its blades and bar do, which controllers and observer do not know.
    progress : callable
        Told how many flights are done.
    """
    result = AttitudeComparison(settings, laws, list(seeds), flap_back)
    done = 0
    for seed in seeds:
        nominal = plant.PlantConfig.from_parameters(with_seed(settings, seed).nodes["plant"])
        aircraft = perturbed(nominal, ("flap_back",) if flap_back else (), seed=0)
        for law in laws:
            flown = with_law(with_seed(settings, seed), law)
            flight = fly_loop(build(flown, plant_config=aircraft), flown)
            for source in SOURCES[:2]:
                result.flights.append(scored(flight, flown, law, source))
            if seed == seeds[0]:
                result.shown[law.key] = flight
            if ideal:
                best = fly_loop(build(flown, true_navigation=True, plant_config=aircraft), flown)
                result.flights.append(scored(best, flown, law, "ideal"))
            done += 1
            progress(done)
    return result


def scored(flight: LoopFlight, settings: Settings, law: ComparedLaw, source: str) -> AttitudeFlight:
    """Largest and rms errors of a flight over the scenario's scored stretch."""
    record = flight.record
    mask = settings.scenario.scored(record.time_s)
    nothing = (float("nan"), float("nan"))
    if flight.sentence or not mask.any():
        lost = flight.sentence or "the flight ended before the first scored stretch"
        return AttitudeFlight(law.key, settings.seed, source, nothing, nothing, lost)
    error = attitude_errors_deg(record, "navigation" if source == "navigation" else "truth")[mask]
    worst, rms = np.abs(error).max(axis=0), np.sqrt(np.mean(error**2, axis=0))
    return AttitudeFlight(
        law.key,
        settings.seed,
        source,
        (float(worst[0]), float(worst[1])),
        (float(rms[0]), float(rms[1])),
        "",
    )


def print_attitude(result: AttitudeComparison, out: Console) -> None:
    """The table beside the paper's figures, with its conditions."""
    count = len(result.seeds)
    rows = table(
        f"Attitude error over {count} seed{'s' * (count > 1)}: largest (rms), deg; on how many of "
        "them the largest is below the PID's",
        out,
    )
    rows.add_column("controller")
    heads = {"navigation": "state estimate", "truth": "truth", "ideal": "ideal navigation"}
    for source in result.sources:
        for axis in AXES:
            rows.add_column(f"{axis}, {heads[source]}", justify="right")
    rows.add_column("paper", justify="right")
    summary_rows = {(row["law"], row["source"]): row for row in result.summary()}
    for law in result.laws:
        cells = []
        for source in result.sources:
            row = summary_rows[law.key, source]
            for axis in AXES:
                text = f"{row[f'{axis}_max_deg']:.2f} ({row[f'{axis}_rms_deg']:.2f})"
                wins = row[f"{axis}_wins_over_pid"]
                cells.append(text if wins is None else f"{text}; {wins} of {count}")
        paper = f"+-{PAPER_DEG[law.key]:g}" if law.key in PAPER_DEG else ""
        rows.add_row(law.name, *cells, paper)
    out.print(rows)
    out.print(without_seed(conditions(result.settings)))
    if result.flap_back:
        settled = result.flap_back_radpmps
        out.print(f"the rotor flaps back by {settled:.2g} rad s/m in hover, unknown to all")
    for flight in result.flights:
        if flight.lost and flight.source == "truth":
            out.print(f"LOST: {flight.law}, seed {flight.seed}: {flight.lost}")


def without_seed(text: str) -> str:
    """Conditions of a flight without the seed, for a comparison over several."""
    first, _, rest = text.partition("; seed")
    return first + "\n" + rest.partition("\n")[2]


def _attitude_pooled(values: Sequence[float]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values else float("nan")


# -------------------------------------------------------------------------------------------------
# The paper's Fig. 3 and 4 side by side: roll and pitch under the controllers, same wind, same seed.
# -------------------------------------------------------------------------------------------------

_COLOURS = {"pid": RED, "lqr": ORANGE}


def draw_attitude(result: AttitudeComparison, path: Path) -> None:
    """Write the picture of the first seed; PID on the left, as in the paper."""
    laws = sorted(result.laws, key=lambda law: law.key != "pid")
    size = (3.0 * len(laws) + 0.8, 4.2)
    with picture(path, 2, len(laws), size, sharex=True, sharey="row") as (figure, axes):
        for column, law in zip(axes.T, laws, strict=True):
            record = result.shown[law.key].record
            truth = attitude_errors_deg(record, "truth")
            navigation = attitude_errors_deg(record, "navigation")
            for i, axis in enumerate(column):
                _gusts(axis, result)
                axis.plot(record.time_s, truth[:, i], color=GREY, lw=0.8, label="ground truth")
                colour = _COLOURS.get(law.key, BLUE)
                axis.plot(
                    record.time_s, navigation[:, i], color=colour, lw=0.9, label="state estimate"
                )
            paper = PAPER_DEG.get(law.key)
            note = f"\n(paper, in flight: ±{paper:g}°)" if paper else "\n"
            column[0].set_title(law.name + note)
            column[1].set_xlabel("time (s)")
            column[0].set_xlim(0.0, record.time_s[-1])
        for i, name in enumerate(AXES):
            axes[i, 0].set_ylabel(f"{name} error (deg)")
            bound = 1.2 * _largest_scored(result, i)
            axes[i, 0].set_ylim(-bound, bound)
        axes[1, -1].legend(loc="lower right", ncols=2)
        figure.suptitle(_title(result), fontsize=10)


def _largest_scored(result: AttitudeComparison, axis: int) -> float:
    """Largest error (deg) that is scored, over the shown flights; at least 0.05."""
    largest_deg = [0.05]
    for flight in result.shown.values():
        mask = result.settings.scenario.scored(flight.record.time_s)
        for source in ("navigation", "truth"):
            error = attitude_errors_deg(flight.record, source)[mask, axis]
            largest_deg.append(float(np.abs(error).max(initial=0.0)))
    return max(largest_deg)


def _gusts(axis, result: AttitudeComparison) -> None:
    """Shade the discrete gusts."""
    p = result.settings.nodes["plant"]
    peaks = np.linalg.norm(np.reshape(p["wind.gust.amplitude_mps"], (-1, 3)), axis=1)
    for start, length, peak in zip(
        p["wind.gust.start_s"], p["wind.gust.duration_s"], peaks, strict=True
    ):
        if peak > 0.0:
            axis.axvspan(start, start + length, color="#eeeeee", lw=0)


def _title(result: AttitudeComparison) -> str:
    p = result.settings.nodes["plant"]
    peak = np.linalg.norm(np.reshape(p["wind.gust.amplitude_mps"], (-1, 3)), axis=1).max()
    gusts = f", discrete gusts up to {peak:.3g} m/s (shaded)" if peak > 0.0 else ""
    turbulence = " with turbulence" if p["wind.turbulence"] else ""
    begin = np.ravel(result.settings.scenario.windows_s)[0]
    return (
        f"Simulated: wind {mean_wind(p)}{turbulence}{gusts}; seed {result.seeds[0]}; "
        f"scored from {begin:g} s on"
    )


# -------------------------------------------------------------------------------------------------
# The picture of `heli compare laws`: median and worst of each controller at each place.
# -------------------------------------------------------------------------------------------------

_MARKS = "osD^vP*X"


def draw_law_matrix(content: Mapping[str, Any], path: Path) -> None:
    """Write it from what `heli compare laws --json` says: a column of marks per place."""
    from matplotlib import colormaps
    from matplotlib.ticker import LogLocator

    names = [place["name"] for place in content["places"]]
    laws = content["laws"]
    with picture(path, len(AXES), 1, (1.1 * len(names) + 1.5, 6.0), sharex=True) as (figure, axes):
        for (axis,), key in zip(axes, AXES, strict=True):
            for number, law in enumerate(laws):
                rows = [r for r in content["rows"] if (r["law"], r["axis"]) == (law, key)]
                x = np.arange(len(rows)) + 0.8 * ((number + 0.5) / len(laws) - 0.5)
                worst = np.array([r["worst_deg"] for r in rows], float)
                median = np.array([r["median_deg"] for r in rows], float)
                colour = colormaps["tab10"](number)
                axis.vlines(x, median, worst, color=colour, lw=1.0)
                axis.plot(x, worst, "_", color=colour, ms=6)
                mark = _MARKS[number % len(_MARKS)]
                axis.plot(x, median, mark, color=colour, ms=4, label=law)
            axis.set_yscale("log")
            axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
            axis.yaxis.set_major_formatter("{x:g}")
            axis.yaxis.set_minor_formatter("")
            axis.set_ylabel(f"largest {key} error (deg)")
            axis.set_xticks(range(len(names)), [name.replace(", ", "\n") for name in names])
            axis.grid(False, axis="x")
        handles, labels = axes[0, 0].get_legend_handles_labels()
        title = "Mark: median over the flights; line: up to the worst"
        figure.legend(handles, labels, loc="outside upper center", ncols=len(laws), title=title)


# -------------------------------------------------------------------------------------------------
# `heli compare worlds`: today's controllers in several worlds, on the same seeds, with both
# receivers.
#
# How much falls outside the paper's figures is the result. One process; the compiled loop is
# reused.
# -------------------------------------------------------------------------------------------------

JUDGED = {"standalone": "navigation", "rtk": "truth"}
"""What a receiver can know, which its tables hold against the paper; JSON has all records."""
NO_TRIM = "NO_TRIM"
"""What a flight is called whose aircraft no actuator setting holds: it is lost before it begins."""


@dataclass(frozen=True)
class WorldFlight:
    """One flight.

    Attributes
    ----------
    seed : int
    figures : Figures
        None of a flight that was lost.
    status : str
        Name of the `PlantStatus`, or `NO_TRIM`.
    at_s : float
        Flight time that was flown.
    aircraft : dict
        What the seed drew.
    """

    seed: int
    figures: Figures
    status: str
    at_s: float
    aircraft: Mapping[str, float | int]

    @property
    def lost(self) -> bool:
        """Whether the helicopter was lost."""
        return self.status != PlantStatus.OK.name

    def exit_code(self, gps: str) -> int:
        """As the hover test's."""
        return Result(self.figures, self.status if self.lost else "", 0.0, 0.0).exit_code(gps)


@dataclass(frozen=True)
class WorldAndReceiver:
    """A world with a receiver, and what it is called.

    Attributes
    ----------
    name : str
        Of the world, and what is changed in it.
    gps : str
    settings : Settings
    """

    name: str
    gps: str
    settings: Settings


def world_places(
    worlds: Sequence[str],
    receivers: Sequence[str],
    w20_mps: Sequence[float] = (),
    duration_s: float | None = None,
    params: Sequence[Path] = (),
    laws: str | None = None,
) -> list[WorldAndReceiver]:
    """Every world with every receiver, and with every wind at 20 ft if winds are given.

    Raises
    ------
    ParameterError
    """
    places = []
    for world in worlds:
        for wind in w20_mps or (None,):
            name = Path(world).stem + ("" if wind is None else f", W20 {wind:g} m/s")
            changes = {} if wind is None else {"plant": {"wind.w20_mps": float(wind)}}
            for gps in receivers:
                settings = resolve(
                    "hover", gps, None, duration_s, params=params, overrides=changes, world=world,
                    laws=laws,
                )  # fmt: skip
                places.append(WorldAndReceiver(name, gps, settings))
    return places


def fly_world_seed(settings: Settings, seed: int) -> WorldFlight:
    """One flight of a seed."""
    seed_settings = settings.with_seed(seed)
    try:
        flight = simulate(seed_settings)
    except TrimError:
        return WorldFlight(seed, Figures(), NO_TRIM, 0.0, drawn(seed_settings))
    figures = Figures()
    if not flight.sentence:
        figures = score(flight.record, seed_settings.scenario, seed_settings.rate)
    return WorldFlight(
        seed,
        figures,
        flight.status.name,
        seed_settings.rate.seconds(len(flight.record)),
        drawn(seed_settings),
    )


def compare_worlds(
    where: Sequence[WorldAndReceiver],
    seeds: Sequence[int],
    progress: Callable[[int], None] = lambda done: None,
) -> list[list[WorldFlight]]:
    """Fly every seed at every place; progress is told how many flights are done."""
    flights_by_place, done = [], 0
    for place in where:
        flights = []
        for seed in seeds:
            flights.append(fly_world_seed(place.settings, seed))
            done += 1
            progress(done)
        flights_by_place.append(flights)
    return flights_by_place


def _row(
    metric: PaperMetric, stretch: str, source: str, flights: Sequence[WorldFlight]
) -> dict[str, Any] | None:
    """Median, worst and how many are inside, of a metric over the flights that were not lost."""
    scores = [flight.figures.find(stretch, metric.key, source) for flight in flights]
    values = [s.max for s in scores if s is not None]
    if not values:
        return None
    return {
        "key": metric.key,
        "label": metric.label,
        "unit": metric.unit,
        "paper": metric.paper,
        "stretch": stretch,
        "measured_from": source,
        "median": statistics.median(values),
        "worst": max(values),
        "inside": sum(s.inside for s in scores if s is not None),
    }


def worlds_as_dict(
    where: Sequence[WorldAndReceiver], flights_by_place: Sequence[Sequence[WorldFlight]]
) -> dict[str, Any]:
    """For --json: per world and receiver the figures over the seeds, and who was lost, and how."""
    rows = []
    for place, flights in zip(where, flights_by_place, strict=True):
        kind = place.settings.scenario.kind
        metrics = [
            _row(metric, stretch, source, flights)
            for stretch in STRETCHES
            for metric in METRICS[kind]
            for source in sources_of(place.gps)
        ]
        lost = [flight for flight in flights if flight.lost]
        rows.append(
            {
                "name": place.name,
                "world": Path(place.settings.world).stem,
                "gps": place.gps,
                "laws": Path(place.settings.laws).stem,
                "w20_mps": place.settings.nodes["plant"]["wind.w20_mps"],
                "conditions": conditions(place.settings).splitlines(),
                "flown": len(flights),
                "exit_code_0": sum(flight.exit_code(place.gps) == 0 for flight in flights),
                "metrics": [row for row in metrics if row is not None],
                "lost": [
                    {"seed": f.seed, "status": f.status, "at_s": f.at_s, "draw": dict(f.aircraft)}
                    for f in lost
                ],
            }
        )
    return {"places": rows}


def print_worlds(content: Mapping[str, Any], out: Console) -> None:
    """Per metric the median and the worst in every world, and how many are inside."""
    places = content["places"]
    for stretch, words in STRETCHES.items():
        rows = table(f"{words}: median / worst over the flights, and how many are inside", out)
        rows.add_column("metric")
        rows.add_column("paper", justify="right")
        for place in places:
            rows.add_column(f"{place['name']}, {place['gps']}", justify="right")
        for metric in METRICS["hover"]:
            cells = [_cell(place, metric.key, stretch) for place in places]
            rows.add_row(metric.label, f"{metric.paper:g} {metric.unit}", *cells)
        out.print(rows)
    out.print("measured from: " + "; ".join(f"{g}: {r}" for g, r in JUDGED.items()))
    for place in places:
        kept = f"{place['exit_code_0']} of {place['flown']} flights with exit code 0"
        out.print(f"{place['name']}, {place['gps']}: {kept}", highlight=False)
        for flight in place["lost"]:
            out.print(
                f"  lost: seed {flight['seed']}, {flight['status']} after {flight['at_s']:.2f} s",
                highlight=False,
            )


def _cell(place: Mapping[str, Any], key: str, stretch: str) -> str:
    wanted = (key, stretch, JUDGED[place["gps"]])
    for row in place["metrics"]:
        if (row["key"], row["stretch"], row["measured_from"]) == wanted:
            return f"{row['median']:.2f} / {row['worst']:.2f}; {row['inside']} of {place['flown']}"
    return "-"
