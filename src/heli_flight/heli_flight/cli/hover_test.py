# SPDX-License-Identifier: Apache-2.0
"""The command behind ./hover_test.sh: bring the graph up, fly, record, compare with the paper."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console

from heli_flight import interrupts
from heli_flight.errors import FlightError, StartError
from heli_flight.graph.live import LiveOrder
from heli_flight.loop.flight_section import LOCKSTEP, ONE_PROCESS, REAL_TIME
from heli_flight.loop.layers import GPS_PRESETS, scenario_names
from heli_flight.loop.result import (
    EXIT_BAD_INPUT,
    EXIT_OUTSIDE,
    RESULT,
)
from heli_flight.studies.flight import FlightOrder, fly_and_write
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
    _add_live_options(p)
    return p


def _add_live_options(parser: argparse.ArgumentParser) -> None:
    """Options of the live view."""
    group = parser.add_argument_group("live view")
    group.add_argument(
        "--live",
        action="store_true",
        help="show the flight in a browser and to Foxglove; in real time",
    )
    group.add_argument(
        "--live-port", type=int, metavar="PORT", help="port of the page, 0: any (default 8080)"
    )
    group.add_argument(
        "--foxglove-port", type=int, metavar="PORT", help="port for Foxglove, 0: any (default 8765)"
    )
    group.add_argument(
        "--allow-commands",
        action="store_true",
        help="print a token that lets its holder command gusts, mode and reference",
    )


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


def _order(options: argparse.Namespace) -> FlightOrder:
    """The order that the options give; raises ParameterError."""
    live = LiveOrder(options.live, options.live_port, options.foxglove_port, options.allow_commands)
    return FlightOrder(
        scenario=options.scenario,
        gps=options.gps,
        controller=options.controller,
        seed=options.seed,
        duration_s=options.duration,
        mode=_mode(options),
        params=options.params,
        out=options.out,
        report=options.report,
        live=live,
    )


def command(argv: Sequence[str] | None, prog: str) -> int:
    """Parse, fly, say in one line what was wrong; returns the exit code. Ctrl-C passes through."""
    options = parser(prog).parse_args(argv)
    stream = sys.stderr if options.as_json else sys.stdout
    console = Console(stderr=options.as_json, width=None if stream.isatty() else 110)
    try:
        outcome = fly_and_write(_order(options), console)
        if options.as_json:
            print((outcome.folder / RESULT).read_text(encoding="utf-8"), end="")
        return outcome.code
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
