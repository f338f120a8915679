# SPDX-License-Identifier: Apache-2.0
"""`heli identify`: fly two experiments or take their bags, fit, design, compare, report, fly."""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from heli_flight import interrupts
from heli_flight.errors import FlightError
from heli_flight.loop.flight_file import NAME, write_parameters
from heli_flight.loop.flight_section import LOCKSTEP, ONE_PROCESS
from heli_flight.loop.result import versions
from heli_flight.loop.settings import Settings, resolve
from heli_flight.loop.worlds import PAPER
from heli_flight.studies.compiles import tell_if_it_compiles
from heli_flight.studies.flight import FlightOrder, fly_and_write
from heli_flight.studies.identify.compare import Row, Truth, misses, table, truth_of
from heli_flight.studies.identify.data import (
    experiment_of_bag,
    experiment_of_record,
)
from heli_flight.studies.identify.fit import Identification, identify
from heli_flight.studies.identify.parameter_table import Given, read_given
from heli_flight.terminal import being_filled, console, json_text, silent, steps
from heli_flight.terminal import table as text_table
from heli_identification.experiment import Experiment
from heli_math.ticks import seconds
from heli_parameters.locate import config_folder
from heli_parameters.parameters import ParameterError

SCENARIOS = {"actuators": "identify_actuators", "gusts": "identify_gusts"}
YAML, JSON, HOVER = "identified.yaml", "identification.json", "hover"
_STEPS = 5


@dataclass(frozen=True)
class Wanted:
    """What the user asks for.

    Attributes
    ----------
    actuators, gusts : Path or None
        Bags; None: fly.
    aircraft : str or None
        Aircraft file that is flown and compared with.
    params : sequence of Path
    seed : int or None
    gps : str or None
    gamma_factor : float or None
    one_process : bool
    quiet : bool
        Whether nothing is told of its progress.
    """

    actuators: Path | None = None
    gusts: Path | None = None
    aircraft: str | None = None
    params: Sequence[Path] = ()
    seed: int | None = None
    gps: str | None = None
    gamma_factor: float | None = None
    one_process: bool = False
    quiet: bool = False

    def progress(self, what: str, total: int) -> AbstractContextManager[Callable[[float], None]]:
        """Progress on stderr, or none."""
        return nullcontext(lambda done: None) if self.quiet else steps(what, total)

    @property
    def from_bags(self) -> bool:
        """Whether bags are given."""
        return self.actuators is not None


@dataclass(frozen=True)
class Outcome:
    """What was found.

    Attributes
    ----------
    found : Identification
    truth : Truth or None
        None where the aircraft file is not known.
    rows : sequence of Row
    settings : Settings
        Of the first experiment.
    """

    found: Identification
    truth: Truth | None
    rows: Sequence[Row]
    settings: Settings

    @property
    def zeros(self) -> tuple[str, ...]:
        """Entries of A and B that the flight does not tell from zero; E has its own."""
        return tuple(n for n in self.found.ab.taken_for_zero if not n.startswith("E"))


def layers(wanted: Wanted) -> list[Path]:
    """Parameter files under which an aircraft flies before it is identified, weakest first.

    A packaged aircraft other than the default has a packaged design; its PID flies the experiments.
    """
    files = list(wanted.params)
    if wanted.aircraft is not None:
        name = f"{Path(wanted.aircraft).stem}.yaml"
        design = config_folder("heli_flight") / "designs" / name
        if design.is_file():
            files.insert(0, design)
    return files


def settings_of(wanted: Wanted, kind: str) -> Settings:
    """Parameters of an experiment."""
    overrides = {"plant": {"aircraft_file": wanted.aircraft}} if wanted.aircraft else None
    mode = ONE_PROCESS if wanted.one_process else LOCKSTEP
    return resolve(SCENARIOS[kind], wanted.gps, wanted.seed, None, mode, layers(wanted), overrides)


def _with_the_law_to_fly(settings: Settings, wanted: Wanted) -> Settings:
    """The same with the law that will fly what is found: the experiments' own is another."""
    inner = settings.nodes["inner_loop"]
    flies = resolve(params=layers(wanted)).nodes["inner_loop"]["controller"]
    return replace(settings, nodes={**settings.nodes, "inner_loop": {**inner, "controller": flies}})


def run(wanted: Wanted, folder: Path | None) -> Outcome:
    """Experiments, fits, design, comparison.

    Parameters
    ----------
    wanted : Wanted
    folder : Path, optional
        Where flights through the graph leave their bags.

    Raises
    ------
    ParameterError, BagDataError, IdentificationError, SynthesisError, FlightError
        Each with one sentence.
    """
    if (wanted.actuators is None) != (wanted.gusts is None):
        raise ParameterError("--actuators and --gusts: give both bags, or none to fly them")
    settings = _with_the_law_to_fly(settings_of(wanted, "actuators"), wanted)
    given = read_given(wanted.aircraft or settings.nodes["plant"]["aircraft_file"], wanted.params)
    experiments = {
        kind: _experiment(wanted, kind, given, folder) for kind in ("actuators", "gusts")
    }
    known = not wanted.from_bags or wanted.aircraft is not None
    with wanted.progress("identification", _STEPS) as progress:
        done = [0]

        def tell(_: str) -> None:
            progress(done[0])
            done[0] += 1

        found = identify(
            experiments["actuators"], experiments["gusts"], given, settings, wanted.gamma_factor,
            tell,
        )  # fmt: skip
        truth = truth_of(settings, None, found.design.attitude.gamma) if known else None
        progress(_STEPS)
    return Outcome(found, truth, table(found, truth), settings)


def _experiment(wanted: Wanted, kind: str, given: Given, folder: Path | None) -> Experiment:
    settings = settings_of(wanted, kind)
    start_time_s = settings.nodes["plant"]["start_time_s"]
    bag = wanted.actuators if kind == "actuators" else wanted.gusts
    if bag is not None:
        return experiment_of_bag(bag, kind, given, start_time_s)
    length_s = seconds(settings.scenario.n_ticks)
    if length_s < given.end_s:
        raise ParameterError(
            f"identify: periods: {given.periods} of {given.period_s:g} s from {given.start_s:g} s "
            f"on do not fit into the scenario's duration_s = {length_s:g} s"
        )
    with wanted.progress(f"flight: {kind}, s", round(length_s)) as progress:
        if wanted.one_process or folder is None:
            return _fly_alone(settings, given, lambda s: progress(int(s)), wanted.quiet)
        _fly_graph(settings, folder / kind, lambda s: progress(int(s)))
    return experiment_of_bag(folder / kind, kind, given, start_time_s)


def _fly_alone(settings: Settings, given: Given, progress: Any, quiet: bool) -> Experiment:
    from heli_flight.loop import closed_loop

    tell_if_it_compiles(silent() if quiet else console(stderr=True))
    flight = closed_loop.simulate(settings, progress=progress)
    if flight.sentence:
        raise FlightError(f"{settings.scenario_name}: {flight.sentence}")
    return experiment_of_record(flight.record, given)


def _fly_graph(settings: Settings, folder: Path, progress: Any) -> None:
    from heli_flight.graph.flight import fly_graph

    folder.mkdir()
    write_parameters(settings, folder / NAME)
    result, _, _ = fly_graph(settings, folder, progress)
    if result.lost:
        raise FlightError(f"{settings.scenario_name}: {result.lost}")


def as_dict(outcome: Outcome) -> dict[str, Any]:
    """Everything for JSON."""
    found, given = outcome.found, outcome.found.given
    missed = misses(outcome.rows)
    return {
        "measured_on_the_ground": dict(given.ground),
        "experiments": {
            "period_s": given.period_s, "periods": given.periods, "start_s": given.start_s,
            "coherence": {**found.ab.coherence, **found.wind.coherence},
        },
        "taken_for_zero": list(outcome.zeros),
        "delay_ticks": found.ab.delay_ticks,
        "E_rw": dict(found.wind.E_rw),
        "collective": asdict(found.collective),
        "fits": {name: {"cost": fit.cost, "expected_cost": fit.expected_cost,
                        "cost_sigma": fit.cost_sigma}
                 for name, fit in (("actuators", found.ab.estimate),
                                   ("gusts", found.wind.estimate))},
        "entries": [row.as_dict() for row in outcome.rows],
        "compared_with": outcome.truth.basis.source if outcome.truth else None,
        "misses": [row.name for row in missed],
        "gamma": found.design.attitude.gamma,
        "gamma_star": found.design.attitude.synthesis.gamma_star.value,
        "observer": {"K": found.design.observer.K.tolist(),
                     "poles_radps": list(found.design.observer.poles)},
        "versions": versions(),
    }  # fmt: skip


def write(outcome: Outcome, folder: Path) -> None:
    """Write identified.yaml, identification.json with what `as_dict` gives, and the page."""
    from heli_flight.studies.design.make import write_yaml
    from heli_flight.studies.identify.report import write_page

    write_yaml(outcome.found.design, folder / YAML, "heli identify, from flight data")
    (folder / JSON).write_text(json_text(as_dict(outcome)), encoding="utf-8")
    write_page(outcome, folder)


def print_outcome(outcome: Outcome, out: Console) -> None:
    """The table, and what to know of it."""
    known = outcome.truth is not None
    rows = text_table("Identified from flight, two sigma; significant entries", out)
    names = ["", "identified", "+-"] + (["truth", "deviation", ""] if known else [])
    for i, name in enumerate(names):
        rows.add_column(name, justify="right" if i else "left")
    for row in outcome.rows:
        if not row.significant:
            continue
        cells = [row.name, f"{row.value:.5g}", _two_sigma(row)]
        if known:
            mark = {True: "met", False: "MISSED", None: ""}[row.met]
            cells += [f"{row.truth:.5g}", row.deviation_text, mark]
        rows.add_row(*cells)
    out.print(rows)
    if outcome.zeros:
        zero = ", ".join(outcome.zeros)
        out.print(f"not told from zero: {zero}", soft_wrap=True)
    if known:
        judged = [row for row in outcome.rows if row.met is not None]
        missed = misses(outcome.rows)
        out.print(
            f"targets (A, B, servos, norms 5 %, E 10 %): {len(judged) - len(missed)} of "
            f"{len(judged)} met" + "".join(f"; {row.name} missed" for row in missed),
            soft_wrap=True,
        )


def _two_sigma(row: Row) -> str:
    return f"{2.0 * row.sigma:.2g}" if np.isfinite(row.sigma) and row.sigma > 0.0 else ""


def fly_hover(wanted: Wanted, folder: Path, out: Console) -> int:
    """The hover test with what was identified; exit code of the hover test."""
    order = FlightOrder(
        scenario="hover",
        gps=wanted.gps,
        seed=wanted.seed,
        mode=ONE_PROCESS if wanted.one_process else LOCKSTEP,
        params=(*layers(wanted), folder / YAML),
        out=folder / HOVER,
        world=PAPER,
    )
    return fly_and_write(order, out).exit_code


def execute(wanted: Wanted, folder: Path) -> Outcome:
    """`run` and `write` in a new folder; a failure leaves the bags that were flown, else nothing.

    An interrupt waits until all is written.

    Raises
    ------
    ParameterError, BagDataError, IdentificationError, SynthesisError, FlightError
    """
    with being_filled(folder) as new:
        try:
            if not (wanted.from_bags or wanted.one_process):
                from heli_flight.graph.processes import check_middleware, start_server

                check_middleware()
                start_server()
            outcome = run(wanted, folder)
            with interrupts.held_back():
                write(outcome, folder)
        finally:
            new.stays = any(folder.glob("*/bag"))
    return outcome
