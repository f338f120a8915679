# SPDX-License-Identifier: Apache-2.0
"""`heli run` and `heli python`: nodes and scripts with this environment's interpreter."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from heli_flight.cli import completion

programs = typer.Typer(rich_markup_mode=None)

# What follows the program's name belongs to the program, `--help` too.
_PASSED_ON = {"ignore_unknown_options": True, "allow_interspersed_args": False}


@programs.command(
    context_settings=_PASSED_ON,
    epilog="\b\nexample:\n  heli run heli_observer observer --ros-args --params-file my.yaml",
)
def run(
    package: Annotated[
        str, typer.Argument(metavar="PACKAGE", autocompletion=completion.node_packages)
    ],
    node: Annotated[str, typer.Argument(metavar="NODE", autocompletion=completion.nodes)],
    arguments: Annotated[
        list[str] | None, typer.Argument(metavar="ARGUMENTS", help="of the node")
    ] = None,
) -> int:
    """Start one node, as `ros2 run` does where ROS is installed."""
    from heli_parameters.locate import executable

    _become(executable(package, node), arguments or [])


@programs.command(
    context_settings=_PASSED_ON,
    epilog="\b\nexample:\n  heli python scripts/bench_recorder.py --help",
)
def python(
    arguments: Annotated[
        list[str] | None,
        typer.Argument(metavar="ARGUMENTS", help="of python: a script and its own, -m, -c, -"),
    ] = None,
) -> int:
    """Run Python as the stack does: its interpreter, its packages, its ROS."""
    _become(None, arguments or [])


def _become(script: Path | None, arguments: Sequence[str]) -> NoReturn:
    """Replace this process, so that signals and exit code are the program's own."""
    words = [sys.executable, *([str(script)] if script else []), *arguments]
    sys.stdout.flush()
    os.execv(sys.executable, words)
