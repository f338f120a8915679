# SPDX-License-Identifier: Apache-2.0
"""One flight from order to folder: resolve, fly, score, write. What commands and studies call."""

import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console

from heli_bags.reader import Remark
from heli_flight import interrupts
from heli_flight.errors import FlightError, StartError
from heli_flight.graph.live import LiveOrder, check_options, live_view
from heli_flight.graph.processes import check_middleware, start_server
from heli_flight.loop.flight_file import NAME, write_parameters
from heli_flight.loop.flight_section import ONE_PROCESS
from heli_flight.loop.record import FlightRecord
from heli_flight.loop.result import Result, print_table, write_result
from heli_flight.loop.settings import Settings, resolve
from heli_flight.terminal import NewFolder, being_filled, flight_time
from heli_math.ticks import seconds


@dataclass(frozen=True)
class FlightOrder:
    """What shall be flown; None where the parameter files or the packaged values decide.

    Attributes
    ----------
    scenario, gps, controller : str, optional
    seed : int, optional
    duration_s : float, optional
    mode : str, optional
        One of `flight_section`'s: lockstep, real time, one process.
    params : sequence of Path
        Parameter files, weakest first.
    out : Path, optional
        Folder to write; must not exist. Default: a new one under flights/.
    report : bool
        Write report.html and figures.
    live : LiveOrder
    """

    scenario: str | None = None
    gps: str | None = None
    controller: str | None = None
    seed: int | None = None
    duration_s: float | None = None
    mode: str | None = None
    params: Sequence[Path] = ()
    out: Path | None = None
    report: bool = True
    live: LiveOrder = field(default_factory=LiveOrder)


@dataclass(frozen=True)
class Outcome:
    """What came of an order: everything resolved, scored and written; exit code 0 or 1."""

    settings: Settings
    result: Result
    folder: Path
    code: int


def _free_name(scenario: str, gps: str, seed: int) -> Path:
    """Name of the folder of a flight that is not told where to write."""
    stamp = time.strftime("%Y%m%d-%H%M%S")
    base = Path("flights") / f"{stamp}-{scenario}-{gps}-seed{seed}"
    wanted, count = base, 1
    while wanted.exists():
        count += 1
        wanted = base.with_name(f"{base.name}-{count}")
    return wanted


def _fly_one_process(settings: Settings, console: Console) -> tuple[Result, FlightRecord]:
    from heli_flight.loop import closed_loop
    from heli_flight.loop.scoring import score

    closed_loop.simulate(_shortened(settings))  # loads the compiled loop, so that flying is timed
    start = time.monotonic()
    with flight_time(console, seconds(settings.scenario.n_ticks)) as progress:
        flight = closed_loop.simulate(settings, progress=progress)
    wall = time.monotonic() - start
    scores, flown_s = score(flight.record, settings.scenario), seconds(len(flight.record))
    return Result(scores, flight.sentence, flown_s, wall), flight.record


def _report(
    record: FlightRecord,
    remarks: Sequence[Remark],
    settings: Settings,
    result: Result,
    folder: Path,
    mode: str,
    console: Console,
) -> None:
    """Write report.html and figures; a disk that is full costs the report, not the flight."""
    from heli_flight.report import FIGURES, PAGE, events_of, write_report

    how = mode if mode == ONE_PROCESS else f"ROS 2 graph, {mode}"
    try:
        page = write_report(record, settings, result, folder, how, events_of(remarks, settings))
    except OSError as error:
        console.print(f"no report: {error}", highlight=False)
        return
    except KeyboardInterrupt:
        (folder / PAGE).unlink(missing_ok=True)
        shutil.rmtree(folder / FIGURES, ignore_errors=True)
        raise
    console.print(f"report: {page}", highlight=False, soft_wrap=True)


def _say(console: Console) -> Callable[[str], None]:
    """Prints a line as it is, for addresses that are to be clicked or copied."""
    return lambda line: console.print(line, highlight=False, soft_wrap=True, markup=False)


def _shortened(settings: Settings) -> Settings:
    from dataclasses import replace

    return replace(settings, scenario=replace(settings.scenario, n_ticks=4))


def _noted(folder: NewFolder, progress: Callable[[float], None]) -> Callable[[float], None]:
    """Progress that notes that there is something to keep once the helicopter flies."""

    def note(flight_s: float) -> None:
        folder.stays = folder.stays or flight_s > 0.0
        progress(flight_s)

    return note


def _flown(
    order: FlightOrder, settings: Settings, folder: NewFolder, console: Console
) -> tuple[Result, Mapping[str, Any], FlightRecord, Sequence[Remark]]:
    """Fly as the order says: the outcome, what result.json holds beside it, record, remarks."""
    write_parameters(settings, folder.path / NAME)
    if settings.mode == ONE_PROCESS:
        result, record = _fly_one_process(settings, console)
        return result, {"mode": ONE_PROCESS}, record, ()
    check_middleware()
    start_server()
    from heli_flight.graph.flight import fly_graph

    interrupts.check()
    live = live_view(order.live, settings)
    with flight_time(console, seconds(settings.scenario.n_ticks)) as bar:
        progress = _noted(folder, bar)
        try:
            result, extra, flight = fly_graph(settings, folder.path, progress, live, _say(console))
        except FlightError as error:
            folder.stays |= not isinstance(error, StartError)
            raise
    return result, extra, flight.record, flight.remarks


def fly_and_write(order: FlightOrder, console: Console) -> Outcome:
    """Resolve, fly, score, write, and say on the console what came of it.

    Raises
    ------
    ParameterError, MissingFileError
        Bad input.
    StartError
        The graph could not be brought up.
    FlightError
        The graph broke in flight; the bag so far is kept, as it is when Ctrl-C ends a flight.
    """
    check_options(order.live, order.mode == ONE_PROCESS)
    settings = resolve(
        order.scenario,
        order.gps,
        order.seed,
        order.duration_s,
        order.mode,
        order.params,
        controller=order.controller,
    )
    for remark in settings.remarks:
        _say(console)(remark)
    folder = order.out or _free_name(settings.scenario_name, settings.gps, settings.seed)
    with being_filled(folder) as new:
        result, extra, record, remarks = _flown(order, settings, new, console)
        with interrupts.held_back():
            write_result(result, settings, folder, extra)
            new.stays = True
    print_table(result, settings, console)
    if order.report:
        _report(record, remarks, settings, result, folder, extra["mode"], console)
    factor = result.flown_s / result.wall_s if result.wall_s > 0 else 0.0
    console.print(
        f"{result.flown_s:.2f} s flown in {result.wall_s:.2f} s ({factor:.2f} times real time)",
        highlight=False,
    )
    console.print(f"written: {folder}", highlight=False, soft_wrap=True)
    code = result.exit_code(settings.gps)
    if code and not result.lost:
        names = ", ".join(f"{s.metric.label} ({s.source})" for s in result.judged(settings.gps))
        console.print(f"outside the paper's figures: {names}", highlight=False)
    return Outcome(settings, result, folder, code)
