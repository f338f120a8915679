# SPDX-License-Identifier: Apache-2.0
"""What ./hover_test.sh runs: the command `heli hover` by itself."""

import sys
from collections.abc import Sequence

import typer

from heli_flight import interrupts
from heli_flight.cli.common import CommandWithRenamed, run
from heli_flight.cli.flights import epilog, hover

PROG = "hover_test.sh"

app = typer.Typer(rich_markup_mode=None, pretty_exceptions_enable=False, add_completion=False)
app.command(cls=CommandWithRenamed, epilog=epilog(f"./{PROG}"))(hover)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point of ./hover_test.sh; returns the exit code."""
    return run(app, argv, PROG)


if __name__ == "__main__":
    sys.exit(interrupts.run(lambda: main))
