# SPDX-License-Identifier: Apache-2.0
"""Runs a command: bad input is one line and exit code 2, never a traceback."""

import sys
from collections.abc import Sequence

import typer
from typer.exceptions import TyperException

from heli_flight import interrupts

EXIT_BROKEN = 1
EXIT_BAD_INPUT = 2


def run(app: typer.Typer, argv: Sequence[str] | None, prog: str) -> int:
    """Run an application of commands; returns the exit code.

    Parameters
    ----------
    app : Typer
    argv : sequence of str, optional
        Default: of this process.
    prog : str
        What the user has typed; its name begins every refusal.
    """
    name = prog.removesuffix(".sh")
    try:
        with interrupts.told():
            code = app(args=argv, prog_name=prog, standalone_mode=False)
    except TyperException as error:
        if type(error).__name__ == "NoArgsIsHelpError":
            # Not a mistake in a line, but the whole help, as it stands.
            print(_text_of(error), file=sys.stderr)
            return EXIT_BAD_INPUT
        print(f"{name}: {_one_line(_text_of(error))}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except Exception as error:
        code = _refusal(error)
        if code is None:
            raise
        print(f"{name}: {_one_line(str(error))}", file=sys.stderr)
        return code
    if code == interrupts.EXIT_CODE:
        # typer has turned the KeyboardInterrupt into this code.
        print(interrupts.LINE, file=sys.stderr)
    return int(code or 0)


def _refusal(error: Exception) -> int | None:
    """Exit code of what carries one sentence for the user, None for what does not.

    The imports wait until something is raised: help and completion are quick.
    """
    from heli_bags.folder import BagError
    from heli_dynamics_sim.trim import TrimError
    from heli_flight.errors import BrokenFlightError, FlightError
    from heli_parameters.parameters import ParameterError

    if isinstance(error, BrokenFlightError):
        return EXIT_BROKEN
    refused = (BagError, ParameterError, ValueError, TrimError, FlightError, OSError)
    return EXIT_BAD_INPUT if isinstance(error, refused) else None


def _text_of(error: TyperException) -> str:
    return str(getattr(error, "format_message", lambda: str(error))())


def _one_line(text: str) -> str:
    """What the terminal shows as one line, whatever a file or an argument held."""
    from heli_parameters.printable import printable

    line = " ".join(part.strip() for part in text.splitlines())
    return printable(line, len(line))
