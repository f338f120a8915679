# SPDX-License-Identifier: Apache-2.0
"""`python -m heli_hover_test.report BAG`: the report of a recorded flight."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from heli_hover_test.errors import FlightError
from heli_hover_test.report.from_bag import Choice, report_of_bag
from heli_msgs_bridge.parameters import ParameterError

EXIT_BAD_INPUT = 2


def parser() -> argparse.ArgumentParser:
    """Command line of the report."""
    p = argparse.ArgumentParser(
        prog="heli report",
        description="Write report.html and figures of a recorded flight.",
        epilog="example: heli report flights/my_flight",
    )
    p.add_argument("bag", type=Path, help="rosbag2 folder, or the folder of a flight")
    p.add_argument("--out", type=Path, metavar="DIR", help="folder to write (default: beside it)")
    p.add_argument("--scenario", metavar="NAME", help="what was flown (default: as recorded)")
    p.add_argument("--gps", metavar="PRESET", help="receiver (default: as recorded)")
    p.add_argument("--seed", type=int, metavar="N", help="seed of the flight, for its conditions")
    p.add_argument(
        "--params", type=Path, action="append", default=[], metavar="FILE",
        help="parameter file of the flight; repeatable",
    )  # fmt: skip
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code: 2 and one line on stderr for bad input."""
    options = parser().parse_args(argv)
    choice = Choice(options.scenario, options.gps, options.seed, options.params)
    try:
        page = report_of_bag(options.bag, choice, options.out)
    except (ParameterError, FlightError, ValueError, OSError) as error:
        print(f"heli report: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    print(f"written: {page}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
