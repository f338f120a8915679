# SPDX-License-Identifier: Apache-2.0
"""One flight from order to folder: resolve, fly, score, write. What every command that flies calls.

The folder holds params.yaml, result.json, report.html, figures/ if asked for, of a flight of the
graph bag/, logs/ and graph.yaml, of one of this process record.npz.
"""

import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from heli_bags.reader import Remark
from heli_core.errors import BrokenFlightError, FlightError, StartError
from heli_core.faults import NONE
from heli_core.jit import is_compiled
from heli_core.python_controller import PARAMETER, PythonLaw, find
from heli_core.rcl_yaml import ParameterError
from heli_core.ticks import seconds
from heli_dynamics_sim.linear_aircraft import PARAMETER as LINEAR
from heli_flight import interrupts
from heli_flight.flight_file import NAME, NO_PROCESSES, read_faults, write_parameters
from heli_flight.graph.live import LiveOrder, LiveView, live_view
from heli_flight.graph.processes import (
    SHARED_MEMORY,
    check_middleware,
    has_shared_memory,
    start_server,
)
from heli_flight.layers import AUTOPILOTS, ONE_PROCESS, hover_test_world
from heli_flight.parts import Parts
from heli_flight.process_faults import PROCESS
from heli_flight.record import FlightRecord, write_record
from heli_flight.result import Result, print_table, sentence, write_result
from heli_flight.scoring import score
from heli_flight.settings import (
    LAW_NODES,
    MOST_AIRCRAFT,
    Settings,
    own_laws,
    refuse_unnamed,
    resolve,
    seed_of,
)
from heli_flight.terminal import NewFolder, being_filled, flight_time, in_turn, silent

# -------------------------------------------------------------------------------------------------
# What the first flight in one process on a machine waits for, said before it waits.
#
# Set-up compiles what the nodes fly; the loop of one process is compiled by whom flies it first.
# -------------------------------------------------------------------------------------------------

COMPILES = (
    "heli: compiles the loop for this machine: once, some 10 to 40 seconds; from then on a "
    "flight of 60 s takes about a second"
)


def tell_if_it_compiles(say: Console, own_laws: bool = False, kernel: Any = None) -> bool:
    """Say so if a flight in this process would compile the loop; whether it would.

    Parameters
    ----------
    say : Console
    own_laws : bool
        Whether controllers in Python fly: the parts of a tick are then compiled one by one.
    kernel : callable, optional
        What flies, if it is another one.
    """
    from heli_flight.loop import act, fly_ticks

    kernel = kernel or (act if own_laws else fly_ticks)
    compiles = not getattr(kernel, "signatures", True) and not is_compiled(kernel)
    if compiles:
        say.print(COMPILES, highlight=False, soft_wrap=True, markup=False)
    return compiles


STILL_S = 10.0
"""Wall time after which is told that it still compiles: without a cache that takes minutes."""


@contextmanager
def still_compiling(say: Console, compiles: bool) -> Iterator[Callable[[], None]]:
    """Say every `STILL_S` that it still compiles, until the function that it gives is called."""
    done, begun_s = threading.Event(), time.monotonic()

    def tell() -> None:
        while not done.wait(STILL_S):
            line = f"heli: still compiling, {time.monotonic() - begun_s:.0f} s"
            say.print(line, highlight=False, markup=False)

    teller = threading.Thread(target=tell, daemon=True)
    if compiles:
        teller.start()
    try:
        yield done.set
    finally:
        done.set()
        if compiles:
            teller.join()


NODES_COMPILE = (
    "heli: compiles the nodes for this machine and this user: once, a minute or two; with set-up "
    "they are compiled already"
)


def tell_what_slows_nodes(say: Console) -> bool:
    """Say so if a flight through the graph has to compile its nodes first (with another HOME than
    set-up's, or changed sources), or if they have no shared memory; whether it compiles."""
    from heli_dynamics_sim.plant import advance
    from heli_observer.observer import step

    compiles = not (is_compiled(advance) and is_compiled(step))
    if compiles:
        say.print(NODES_COMPILE, highlight=False, soft_wrap=True, markup=False)
    if not has_shared_memory():
        words = f"{SHARED_MEMORY} cannot be written to: messages go over UDP, which takes longer"
        say.print(words, highlight=False, soft_wrap=True, markup=False)
    return compiles


# -------------------------------------------------------------------------------------------------
# One flight in this process, scored; nothing is written.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class UnwrittenFlight:
    """A flight before it is written: `extra` is what result.json holds beside the result.

    `live` is its live view, if it had one.
    """

    result: Result
    extra: Mapping[str, Any]
    record: FlightRecord
    remarks: Sequence[Remark] = ()
    live: LiveView | None = None


def fly_one_process(
    settings: Settings,
    out: Console,
    laws: Sequence[PythonLaw] = (),
    parts: Parts | None = None,
) -> UnwrittenFlight:
    """Fly in this process and score; nothing is written.

    Parameters
    ----------
    settings : Settings
    out : Console
        Gets the progress, and is told if the loop is compiled first.
    laws : sequence of PythonLaw
        Flown in place of those that the settings name.
    parts : Parts, optional
        Objects that fly in place of compiled parts.
    """
    from heli_flight.loop import fly_settings

    flies_python = bool(laws or parts or own_laws(settings) or settings.nodes["plant"][LINEAR])
    with still_compiling(out, tell_if_it_compiles(out, flies_python)):
        if not flies_python:
            # Loads the compiled loop, so that flying is timed.
            fly_settings(replace(settings, scenario=replace(settings.scenario, n_ticks=4)))
    start = time.monotonic()
    with flight_time(out, seconds(settings.scenario.n_ticks)) as progress:
        flight = fly_settings(settings, laws, progress, parts)
    wall_s = time.monotonic() - start
    figures = score(flight.record, settings.scenario, settings.rate)
    result = Result(figures, flight.sentence, settings.rate.seconds(len(flight.record)), wall_s)
    return UnwrittenFlight(result, {"mode": ONE_PROCESS}, flight.record)


# -------------------------------------------------------------------------------------------------
# The report of a flight that has just ended: the page at once, its figures after it.
# -------------------------------------------------------------------------------------------------


def report_of_flight(
    flight: UnwrittenFlight,
    settings: Settings,
    folder: Path,
    say: Callable[[str], None],
    figures: bool,
) -> Path | None:
    """Write the report; a disk that is full costs the report, not the flight.

    Parameters
    ----------
    flight : UnwrittenFlight
    settings : Settings
        What was flown.
    folder : Path
        The flight's.
    say : callable
        Prints a line.
    figures : bool
        Whether to write the page's charts as files, too: the page is told before them, and their
        progress goes to stderr.

    Returns
    -------
    Path or None
        The page; None if it could not be written, which has been said.
    """
    from heli_flight.report.data import events_of
    from heli_flight.report.write import FIGURES, PAGE, write_report

    mode = flight.extra["mode"]
    how = mode if mode == ONE_PROCESS else f"ROS 2 graph, {mode}"
    how += ", its nodes in one process" if flight.extra.get("composed") else ""
    events = events_of(flight.remarks, settings)
    try:
        with interrupts.interrupts_reported(), in_turn() as tell:

            def drawn(done: int, total: int) -> None:
                # The page is there before the first of its figures.
                if done == 0:
                    say(f"report: {folder / PAGE}")
                tell("figures", done, total)

            write_report(
                flight.record, settings, flight.result, folder, how, events, figures=figures,
                remarks=flight.remarks, drawn=drawn,
            )  # fmt: skip
    except OSError as error:
        say(f"no report: {error}")
        return None
    except KeyboardInterrupt:
        (folder / PAGE).unlink(missing_ok=True)
        shutil.rmtree(folder / FIGURES, ignore_errors=True)
        raise
    return folder / PAGE


# -------------------------------------------------------------------------------------------------
# Flight.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FlightOrder:
    """What is to be flown; None: what the parameter files say, else the packaged default.

    Attributes
    ----------
    scenario, gps, controller, mode : str, optional
        As for `resolve`.
    seed : int, optional
    duration_s : float, optional
    params : sequence of Path
        The user's parameter files.
    out : Path, optional
        Folder to make; default: one under flights/ with date and time.
    report : bool
        Whether to write report.html.
    live : LiveOrder, optional
        To be shown in a browser; needs a mode of the graph.
    world : str, optional
        As for `resolve`, but the hover test has a default of its own (`hover_test_world`).
    laws : str, optional
        As for `resolve`.
    composed : bool
        Whether the nodes of the loop are in one process; needs a mode of the graph.
    rate_hz : int, optional
        As for `resolve`.
    figures : bool
        Whether to write the report's charts as files, too.
    faults : Path, optional
        File of faults; they take the place of those of the parameter files.
    respawn : bool
        Whether nodes that die in flight are started again; needs a process for each.
    over : mapping of node name to mapping of parameter name to value
        Stronger than all files, as `overrides` of `resolve`.
    law : sequence of str
        Controllers in Python, MODULE:NAME or FILE.py:NAME: **their code runs**. One that files name
        is flown only if it is named here, too.
    """

    scenario: str | None = None
    gps: str | None = None
    controller: str | None = None
    mode: str | None = None
    seed: int | None = None
    duration_s: float | None = None
    params: Sequence[Path] = ()
    out: Path | None = None
    report: bool = True
    live: LiveOrder | None = None
    world: str | None = None
    laws: str | None = None
    composed: bool = False
    rate_hz: int | None = None
    figures: bool = False
    faults: Path | None = None
    respawn: bool = False
    over: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    law: Sequence[str] = ()

    def resolved(self, seed: int | None = None) -> Settings:
        """What is flown, or its seed and what this draws replaced; raises ParameterError."""
        read = read_faults(self.faults)
        over = {section: dict(values) for section, values in self.over.items()}
        for section, values in (read.nodes or {}).items():
            over.setdefault(section, {}).update(values)
        for law in map(find, self.law):
            over.setdefault(LAW_NODES[law.loop], {})[PARAMETER] = law.source
        settings = resolve(
            self.scenario,
            self.gps,
            self.seed if seed is None else seed,
            self.duration_s,
            self.mode,
            self.params,
            over,
            controller=self.controller,
            world=hover_test_world(self.world, self.scenario, self.params),
            laws=self.laws,
            rate_hz=self.rate_hz,
            process_faults=read.process,
        )
        refuse_unnamed(settings, over)
        _refuse_autopilot(settings)
        return settings


@dataclass(frozen=True)
class FinishedFlight:
    """A flight that is over.

    Attributes
    ----------
    settings : Settings
        What was flown.
    result : Result
    folder : Path
        Where all of it lies.
    """

    settings: Settings
    result: Result
    folder: Path

    @property
    def exit_code(self) -> int:
        """As `Result.exit_code`."""
        return self.result.exit_code(self.settings.gps)


def fly_and_write(order: FlightOrder, out: Console | None = None) -> FinishedFlight:
    """Resolve, fly, score, write.

    Parameters
    ----------
    order : FlightOrder
    out : Console, optional
        Gets progress, the table beside the paper and where things lie; default: nobody does.

    Returns
    -------
    FinishedFlight

    Raises
    ------
    ParameterError, MissingFileError
        Bad input.
    StartError
        The graph could not be brought up.
    BrokenFlightError
        The graph broke in flight; the bag so far is kept, as it is when Ctrl-C ends a flight.
    """
    out = out or silent()
    settings = order.resolved()
    _refuse_composed(order, settings)
    _refuse_respawn(order, settings)
    _refuse_process_faults(settings, order.composed or settings.mode == ONE_PROCESS)
    _refuse_rate(order, settings)
    for remark in settings.remarks:
        _say(out)(remark)
    folder = order.out or free_name(settings)
    with being_filled(folder) as new:
        flight = _flown(order, settings, new, out)
        with interrupts.held_back():
            write_result(flight.result, settings, folder, flight.extra)
            if settings.mode == ONE_PROCESS:
                write_record(flight.record, folder)
            new.stays = True
    outcome = _shown(order, flight, FinishedFlight(settings, flight.result, folder), out)
    if order.report and flight.live is not None:
        from heli_flight.replay import serve_after

        serve_after(folder, flight.live, _say(out))
    return outcome


def fly_several_and_write(
    order: FlightOrder, count: int, out: Console | None = None
) -> list[FinishedFlight]:
    """The same for several aircraft side by side, each with a folder, a seed and a report.

    Parameters
    ----------
    order : FlightOrder
        Its seed is that from which each aircraft's comes (`seed_of`).
    count : int
        Number of aircraft; they are called heli1, heli2 ...
    out : Console, optional
        As for `fly_and_write`.

    Returns
    -------
    list of Outcome

    Raises
    ------
    ParameterError, MissingFileError, StartError, BrokenFlightError
        As `fly_and_write`; more aircraft than there may be, a live view, or one process.
    """
    out = out or silent()
    settings = _of_several(order, count)
    for remark in settings["heli1"].remarks:
        _say(out)(remark)
    folder = order.out or free_name(settings["heli1"])
    with being_filled(folder) as new:
        flights = _flown_together(order, settings, new, out)
        with interrupts.held_back():
            for name, flight in flights.items():
                write_result(flight.result, settings[name], folder / name, flight.extra)
            new.stays = True
    outcomes = []
    for name, flight in flights.items():
        _say(out)(f"{name}, seed {settings[name].seed}:")
        outcome = FinishedFlight(settings[name], flight.result, folder / name)
        outcomes.append(_shown(order, flight, outcome, out))
    return outcomes


def _shown(
    order: FlightOrder, flight: UnwrittenFlight, outcome: FinishedFlight, out: Console
) -> FinishedFlight:
    """The outcome of a flight that is written, after table, report and how it ended."""
    print_table(flight.result, outcome.settings, out)
    page = None
    if order.report:
        page = report_of_flight(flight, outcome.settings, outcome.folder, _say(out), order.figures)
    print_end(outcome, page, out)
    return outcome


def _refuse_autopilot(settings: Settings) -> None:
    if settings.mode in AUTOPILOTS:
        raise ParameterError(
            f"flight: mode: {settings.mode}: is flown by heli {settings.mode}; allowed here: "
            "--realtime, --lockstep or --one-process beside this file"
        )


def _refuse_composed(order: FlightOrder, settings: Settings) -> None:
    if order.composed and settings.mode == ONE_PROCESS:
        raise ParameterError("--composed: needs the ROS graph; it does not go with --one-process")


def _refuse_respawn(order: FlightOrder, settings: Settings) -> None:
    """Only who has a process of its own can be started again."""
    if order.respawn and settings.mode == ONE_PROCESS:
        raise ParameterError("--respawn: needs the ROS graph; it does not go with --one-process")
    if order.respawn and order.composed:
        raise ParameterError(
            "--respawn: needs a process for each node; it does not go with --composed"
        )


def _refuse_process_faults(settings: Settings, none_has_one: bool) -> None:
    if none_has_one and settings.process_faults != (NONE,):
        raise ParameterError(f"faults: what: {PROCESS}: {NO_PROCESSES}")


def _refuse_rate(order: FlightOrder, settings: Settings) -> None:
    """The live view counts samples of 10 ms."""
    if settings.rate.fold != 1 and order.live:
        raise ParameterError(f"rate_hz: {settings.rate.hz} does not go with --live; show 100")


def _of_several(order: FlightOrder, count: int) -> dict[str, Settings]:
    """What each aircraft flies, by its name."""
    if not 1 < count <= MOST_AIRCRAFT:
        raise ParameterError(f"--vehicles {count}: allowed are 1 to {MOST_AIRCRAFT}")
    if order.respawn:
        raise ParameterError("--respawn: is for one aircraft; it does not go with --vehicles")
    if order.live:
        raise ParameterError("--live: shows one aircraft; it does not go with --vehicles")

    base = order.resolved()
    _refuse_process_faults(base, True)
    if base.mode == ONE_PROCESS:
        raise ParameterError("--vehicles: needs the ROS graph; it does not go with one process")
    if base.rate.fold != 1:
        raise ParameterError(f"rate_hz: {base.rate.hz} does not go with --vehicles")
    return {f"heli{i + 1}": order.resolved(seed_of(base.seed, i)) for i in range(count)}


def _flown_together(
    order: FlightOrder, settings: Mapping[str, Settings], folder: NewFolder, out: Console
) -> dict[str, UnwrittenFlight]:
    for name, aircraft_settings in settings.items():
        (folder.path / name).mkdir()
        write_parameters(aircraft_settings, folder.path / name / NAME)
    check_middleware()
    start_server()
    compiles = tell_what_slows_nodes(out)
    from heli_flight.graph.flight import fly_several

    interrupts.check()
    with _in_flight(settings["heli1"], folder, out, compiles) as progress:
        outcomes = fly_several(settings, folder.path, progress, _say(out), order.composed)
    return {
        name: UnwrittenFlight(r, extra, f.record, f.remarks)
        for name, (r, extra, f) in outcomes.items()
    }


def free_name(settings: Settings) -> Path:
    """Name of the folder of a flight that is not told where to write."""
    stamp = time.strftime("%Y%m%d-%H%M%S")
    name = f"{stamp}-{settings.scenario_name}-{settings.gps}-seed{settings.seed}"
    base = wanted = Path("flights") / name
    count = 1
    while wanted.exists():
        count += 1
        wanted = base.with_name(f"{name}-{count}")
    return wanted


def _flown(
    order: FlightOrder, settings: Settings, folder: NewFolder, out: Console
) -> UnwrittenFlight:
    """Fly, in this process or through the graph."""
    write_parameters(settings, folder.path / NAME)
    if settings.mode == ONE_PROCESS:
        return fly_one_process(settings, out)
    check_middleware()
    start_server()
    compiles = tell_what_slows_nodes(out)
    from heli_flight.graph.flight import fly_graph

    interrupts.check()
    live = live_view(order.live, settings) if order.live else None
    with _in_flight(settings, folder, out, compiles) as progress:
        result, extra, flight = fly_graph(
            settings, folder.path, progress, live, _say(out), order.composed, order.respawn
        )
    return UnwrittenFlight(result, extra, flight.record, flight.remarks, live)


@contextmanager
def _in_flight(
    settings: Settings, folder: NewFolder, out: Console, compiles: bool
) -> Iterator[Callable[[float], None]]:
    """Progress of a graph's flight; there is something to keep once a helicopter flies."""
    length_s = seconds(settings.scenario.n_ticks)
    with still_compiling(out, compiles) as flies, flight_time(out, length_s) as bar:

        def note(flight_s: float) -> None:
            if flight_s > 0.0:
                folder.stays = True
                flies()
            bar(flight_s)

        try:
            yield note
        except StartError:
            raise
        except FlightError as error:
            folder.stays = True
            raise BrokenFlightError(str(error)) from error


def print_end(outcome: FinishedFlight, page: Path | None, out: Console) -> None:
    """How fast it was, where it lies; last the verdict, and where the report is."""
    result, say = outcome.result, _say(out)
    factor = result.flown_s / result.wall_s if result.wall_s > 0 else 0.0
    say(f"{result.flown_s:.2f} s flown in {result.wall_s:.2f} s ({factor:.2f} times real time)")
    say(f"written: {outcome.folder}")
    report = f"; report: {page}" if page else ""
    say(f"{sentence(result, outcome.settings)}{report}")


def _say(out: Console) -> Callable[[str], None]:
    """Prints a line as it is, for addresses that are to be clicked or copied."""
    return lambda line: out.print(line, highlight=False, soft_wrap=True, markup=False)
