# SPDX-License-Identifier: Apache-2.0
"""The command behind ./hover_test.sh: bring the graph up, fly, record, compare with the paper."""

import argparse
import contextlib
import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from heli_bags.reader import Remark
from heli_flight import interrupts
from heli_flight.errors import FlightError, StartError
from heli_flight.graph.live import add_options, check_options, live_view
from heli_flight.graph.processes import check_middleware, start_server
from heli_flight.loop.flight_file import NAME, write_parameters
from heli_flight.loop.flight_section import LOCKSTEP, ONE_PROCESS, REAL_TIME
from heli_flight.loop.layers import GPS_PRESETS, scenario_names
from heli_flight.loop.record import FlightRecord
from heli_flight.loop.result import (
    EXIT_BAD_INPUT,
    EXIT_OUTSIDE,
    RESULT,
    Result,
    print_table,
    write_result,
)
from heli_flight.loop.settings import Settings, resolve
from heli_flight.terminal import NewFolder, being_filled
from heli_inner_hinf.law_state import CONTROLLERS
from heli_parameters.parameters import ParameterError

_EPILOG = """examples:
  ./hover_test.sh                                  the paper's hover test, 60 s
  ./hover_test.sh --gps rtk --seed 7               another GPS, another wind
  ./hover_test.sh --scenario attitude              the paper's attitude test
  ./hover_test.sh --scenario attitude --controller pid    another attitude law
  ./hover_test.sh --params my_weights.yaml         any node's parameters, changed
  ./hover_test.sh --live                           in real time, to be watched in a browser

exit code: 0 inside the paper's figures, 1 outside or helicopter lost (named), 2 bad input
"""


def parser(prog: str = "hover_test.sh") -> argparse.ArgumentParser:
    """Command line of the hover test."""
    p = argparse.ArgumentParser(
        prog=prog,
        description="Fly the helicopter in wind and compare with the paper.",
        epilog=_EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument(
        "--scenario",
        metavar="NAME",
        help=f"what to fly: {' or '.join(scenario_names())} (default: the parameter file's, "
        "else hover)",
    )
    p.add_argument(
        "--controller",
        metavar="LAW",
        help=f"attitude law: {' or '.join(CONTROLLERS)} (default: the parameter of inner_loop)",
    )
    p.add_argument("--duration", type=float, metavar="S", help="length of the flight, s")
    p.add_argument("--seed", type=int, metavar="N", help="seed of wind and sensors")
    p.add_argument("--realtime", action="store_true", help="at the pace of the wall clock")
    p.add_argument(
        "--lockstep",
        action="store_true",
        help="as fast as the machine allows (default, unless the parameter file says otherwise)",
    )
    p.add_argument(
        "--gps",
        metavar="PRESET",
        help=f"receiver: {' or '.join(GPS_PRESETS)} (default: the parameter file's, "
        "else standalone)",
    )
    p.add_argument("--out", type=Path, metavar="DIR", help="folder to write; must not exist")
    p.add_argument(
        "--params",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="parameter file that overrides any node's YAML; repeatable",
    )
    p.add_argument(
        "--one-process",
        action="store_true",
        help="fly the same loop in this process, without ROS and without a bag",
    )
    p.add_argument(
        "--json",
        dest="as_json",
        action="store_true",
        help="print the flight's result.json to stdout, all else to stderr",
    )
    p.add_argument(
        "--no-report",
        dest="report",
        action="store_false",
        help="write no report.html and no figures",
    )
    add_options(p)
    return p


def _free_name(scenario: str, gps: str, seed: int) -> Path:
    """Name of the folder of a flight that is not told where to write."""
    stamp = time.strftime("%Y%m%d-%H%M%S")
    base = Path("flights") / f"{stamp}-{scenario}-{gps}-seed{seed}"
    wanted, count = base, 1
    while wanted.exists():
        count += 1
        wanted = base.with_name(f"{base.name}-{count}")
    return wanted


@contextlib.contextmanager
def _progress_bar(console: Console, duration_s: float) -> Iterator:
    """A bar over simulation time; lines now and then where there is no terminal."""
    if not console.is_terminal:
        tenth = [0]

        def plain(flight_s: float) -> None:
            done = int(10.0 * flight_s / duration_s)
            if done > tenth[0]:
                tenth[0] = done
                console.print(f"flown {flight_s:.0f} s of {duration_s:.0f} s", highlight=False)

        yield plain
        return
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:.1f}/{task.total:.0f} s flown"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=console) as bar:
        task = bar.add_task("flight", total=duration_s)
        yield lambda flight_s: bar.update(task, completed=flight_s)


def _fly_one_process(settings: Settings, console: Console) -> tuple[Result, FlightRecord]:
    from heli_flight.loop import closed_loop
    from heli_flight.loop.scoring import score

    closed_loop.simulate(_shortened(settings))  # loads the compiled loop, so that flying is timed
    start = time.monotonic()
    with _progress_bar(console, settings.scenario.n_ticks / 100.0) as progress:
        flight = closed_loop.simulate(settings, progress=progress)
    wall = time.monotonic() - start
    scores, flown_s = score(flight.record, settings.scenario), len(flight.record) / 100.0
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


def _mode(options: argparse.Namespace) -> str | None:
    """The mode that the options ask for, None for the parameter file's.

    Raises
    ------
    ParameterError
        They ask for two.
    """
    asked = {
        "--realtime": (options.realtime, REAL_TIME),
        "--live": (options.live, REAL_TIME),
        "--lockstep": (options.lockstep, LOCKSTEP),
        "--one-process": (options.one_process, ONE_PROCESS),
    }
    given = {name: mode for name, (is_given, mode) in asked.items() if is_given}
    if len(set(given.values())) > 1:
        raise ParameterError(f"{' and '.join(given)}: do not go together; give one of them")
    return next(iter(given.values()), None)


def _noted(folder: NewFolder, progress: Callable[[float], None]) -> Callable[[float], None]:
    """Progress that notes that there is something to keep once the helicopter flies."""

    def note(flight_s: float) -> None:
        folder.stays = folder.stays or flight_s > 0.0
        progress(flight_s)

    return note


def _flown(
    options: argparse.Namespace, settings: Settings, folder: NewFolder, console: Console
) -> tuple[Result, Mapping[str, Any], FlightRecord, Sequence[Remark]]:
    """Fly as the options say: the outcome, what result.json holds beside it, record, remarks."""
    write_parameters(settings, folder.path / NAME)
    if settings.mode == ONE_PROCESS:
        result, record = _fly_one_process(settings, console)
        return result, {"mode": ONE_PROCESS}, record, ()
    check_middleware()
    start_server()
    from heli_flight.graph.flight import fly_graph

    interrupts.check()
    live = live_view(options, settings)
    with _progress_bar(console, settings.scenario.n_ticks / 100.0) as bar:
        progress = _noted(folder, bar)
        try:
            result, extra, flight = fly_graph(settings, folder.path, progress, live, _say(console))
        except FlightError as error:
            folder.stays |= not isinstance(error, StartError)
            raise
    return result, extra, flight.record, flight.remarks


def fly(options: argparse.Namespace, console: Console) -> int:
    """Resolve, fly, score, write; returns the exit code.

    Raises
    ------
    ParameterError, MissingFileError
        Bad input.
    StartError
        The graph could not be brought up.
    FlightError
        The graph broke in flight; the bag so far is kept, as it is when Ctrl-C ends a flight.
    """
    check_options(options)
    settings = resolve(
        options.scenario,
        options.gps,
        options.seed,
        options.duration,
        _mode(options),
        options.params,
        controller=options.controller,
    )
    for remark in settings.remarks:
        _say(console)(remark)
    folder = options.out or _free_name(settings.scenario_name, settings.gps, settings.seed)
    with being_filled(folder) as new:
        result, extra, record, remarks = _flown(options, settings, new, console)
        with interrupts.held_back():
            write_result(result, settings, folder, extra)
            new.stays = True
    print_table(result, settings, console)
    if options.report:
        _report(record, remarks, settings, result, folder, extra["mode"], console)
    factor = result.flown_s / result.wall_s if result.wall_s > 0 else 0.0
    console.print(
        f"{result.flown_s:.2f} s flown in {result.wall_s:.2f} s ({factor:.2f} times real time)",
        highlight=False,
    )
    console.print(f"written: {folder}", highlight=False, soft_wrap=True)
    if options.as_json:
        print((folder / RESULT).read_text(encoding="utf-8"), end="")
    code = result.exit_code(settings.gps)
    if code and not result.lost:
        names = ", ".join(f"{s.metric.label} ({s.source})" for s in result.judged(settings.gps))
        console.print(f"outside the paper's figures: {names}", highlight=False)
    return code


def command(argv: Sequence[str] | None, prog: str) -> int:
    """Parse, fly, say in one line what was wrong; returns the exit code. Ctrl-C passes through."""
    options = parser(prog).parse_args(argv)
    stream = sys.stderr if options.as_json else sys.stdout
    console = Console(stderr=options.as_json, width=None if stream.isatty() else 110)
    try:
        return fly(options, console)
    except (ParameterError, OSError, FlightError, ValueError) as error:
        print(f"hover_test: {error}", file=sys.stderr)
        broken = isinstance(error, FlightError) and not isinstance(error, StartError)
        return EXIT_OUTSIDE if broken else EXIT_BAD_INPUT


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of ./hover_test.sh; returns the exit code."""
    try:
        return command(argv, "hover_test.sh")
    except KeyboardInterrupt:
        print(interrupts.LINE, file=sys.stderr)
        return interrupts.EXIT_CODE


if __name__ == "__main__":
    sys.exit(main())
