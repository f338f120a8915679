# SPDX-License-Identifier: Apache-2.0
"""The command `heli`: hover, replay, ardupilot, px4, mavlink, campaign, design, identify, compare,
report, score, diff, list, new, bag, log, echo, topics, fault, joy, takeoff, goto, land, mode,
results, run, python, setup.

A sub-command imports what it needs when it runs, so that help and completion are quick.
"""

import os
import sys
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from heli_flight import interrupts
from heli_flight.cli import common
from heli_flight.cli.ardupilot import EPILOG as ARDUPILOT_EPILOG
from heli_flight.cli.ardupilot import ardupilot
from heli_flight.cli.common import (
    CommandWithRenamed,
    Figures,
    FlightNumber,
    Json,
    Params,
    RecordedGps,
    RecordedScenario,
    run,
)
from heli_flight.cli.flights import (
    DIFF_EPILOG,
    JOY_EPILOG,
    REPLAY_EPILOG,
    bag,
    diff,
    epilog,
    fault,
    graph,
    hover,
    joy,
    replay,
)
from heli_flight.cli.listing import LIST_EPILOG, list_packaged
from heli_flight.cli.mavlink import EPILOG as MAVLINK_EPILOG
from heli_flight.cli.mavlink import mavlink
from heli_flight.cli.new import new
from heli_flight.cli.pilot import pilot
from heli_flight.cli.px4 import EPILOG as PX4_EPILOG
from heli_flight.cli.px4 import px4
from heli_flight.cli.sections import Sectioned

# -------------------------------------------------------------------------------------------------
# `heli run` and `heli python`: nodes and scripts with this environment's interpreter.
# -------------------------------------------------------------------------------------------------

programs = typer.Typer(rich_markup_mode=None)

# What follows the program's name belongs to the program, `--help` too.
_PASSED_ON = {"ignore_unknown_options": True, "allow_interspersed_args": False}


@programs.command(
    "run",
    context_settings=_PASSED_ON,
    epilog="\b\nexample:\n  heli run heli_observer observer --ros-args --params-file my.yaml",
)
def run_node(
    package: Annotated[str, typer.Argument(metavar="PACKAGE", autocompletion=common.node_packages)],
    node: Annotated[str, typer.Argument(metavar="NODE", autocompletion=common.nodes)],
    arguments: Annotated[
        list[str] | None, typer.Argument(metavar="ARGUMENTS", help="of the node")
    ] = None,
) -> int:
    """Start one node, as `ros2 run` does where ROS is installed."""
    from heli_core.command_line import executable

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


# -------------------------------------------------------------------------------------------------
# App.
# -------------------------------------------------------------------------------------------------

app = typer.Typer(
    name="heli",
    cls=Sectioned,
    help="Autonomous hover of a small helicopter: fly, design, identify, compare, report.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    epilog="heli COMMAND --help shows a command's options and an example.\n\n"
    "exit code: 0 done, 1 a flight outside its bounds, lost, or recorded in part, 2 bad "
    "input (one line), 130 interrupted",
)


def _tell_version(asked: bool) -> None:
    if asked:
        from heli_core.version import version

        print(f"heli {version()}")
        raise typer.Exit


@app.callback()
def heli(
    version: Annotated[
        bool,
        typer.Option("--version", callback=_tell_version, is_eager=True, help="print the version"),
    ] = False,
) -> None:
    """Name of the command's own options."""


app.add_typer(bag, name="bag")
app.add_typer(fault)
app.add_typer(graph)
app.add_typer(new, name="new")
app.add_typer(pilot)
app.add_typer(programs)
app.command(epilog=JOY_EPILOG)(joy)
app.command(cls=CommandWithRenamed, epilog=epilog("heli hover"))(hover)
app.command(epilog=REPLAY_EPILOG)(replay)
app.command(epilog=DIFF_EPILOG)(diff)
app.command("list", epilog=LIST_EPILOG)(list_packaged)
app.command(epilog=ARDUPILOT_EPILOG)(ardupilot)
app.command(epilog=PX4_EPILOG)(px4)
app.command(epilog=MAVLINK_EPILOG)(mavlink)


@app.command(
    epilog="\b\nexample:\n  heli report flights/my_flight --figures --pdf\n"
    "  heli report rosbag2_2026_11_21 --params my.yaml\n\n"
    "exit code: 0 written, 1 written, but only a part of the flight was recorded, or its ground "
    "truth is not what the plant sent, 2 bad input (one line)"
)
def report(
    bag: Annotated[Path, typer.Argument(help="rosbag2 folder, or the folder of a flight")],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="folder to write (default: beside the bag)")
    ] = None,
    scenario: RecordedScenario = None,
    gps: RecordedGps = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", help="seed of the flight, for its conditions")
    ] = None,
    params: Params = None,
    flight_number: FlightNumber = None,
    figures: Figures = False,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="also report.pdf: the page, printed by a Chromium")
    ] = False,
    as_json: Json = False,
) -> int:
    """Write report.html, the flight beside the paper's figures, of a recorded flight."""
    from heli_flight.report.page import printer, write_pdf
    from heli_flight.report.write import STEPS, BagChoice, recorded, report_of
    from heli_flight.terminal import in_turn, json_text

    choice = BagChoice(scenario, gps, seed, params or [], flight_number)
    program = printer() if pdf else ""
    with in_turn() as tell:
        tell("report", 0, STEPS)
        flight = recorded(bag, choice)
        tell("report", 1, STEPS)
        page = report_of(flight, out, figures, partial(tell, "figures"))
        if not figures:
            tell("report", STEPS, STEPS)
        printed = None
        if pdf:
            tell("pdf", 0, 1)
            printed = write_pdf(page, program)
            tell("pdf", 1, 1)
    result, receiver = flight.result, flight.settings.gps
    # A report tells what was flown, good or bad; it fails where the record is not that flight.
    lacking = result.partial(receiver)
    code = 1 if result.forged or lacking else 0
    if as_json:
        drawn = sorted(str(path) for path in (page.parent / "figures").iterdir()) if figures else []
        content: dict[str, object] = {"report": str(page), "figures": drawn}
        content |= {"forged": result.forged}
        content |= {"verdict": result.verdict(receiver).value, "partial": lacking}
        content |= {"coverage": result.coverage(receiver).as_dict()}
        content |= {"notes": list(flight.bag_notes)}
        content |= {"pdf": str(printed)} if printed else {}
        print(json_text(content), end="")
        return code
    if result.forged:
        print(f"FORGED: {result.forged}")
    if lacking:
        print(f"PARTIAL: {lacking}")
    for note in flight.bag_notes:
        print(f"note: {note}")
    for written in filter(None, (page, printed)):
        print(f"written: {written}")
    return code


@app.command(
    epilog="\b\nexample:\n  heli setup --interfaces\n\n"
    "exit code: 0 all is there, 2 it cannot be built (one line)"
)
def setup(
    interfaces: Annotated[
        bool,
        typer.Option(help="build the types of actions (heli_interfaces) and of /tf, once; minutes"),
    ] = False,
) -> None:
    """Say what is set up; build what a flight does without, the types of actions and transforms."""
    from heli_flight.interface_build import are_built, build, can_build

    prefix = Path(sys.prefix)
    if interfaces:
        can_build(_CHECKOUT)
        build(_CHECKOUT, prefix, lambda line: print(line, file=sys.stderr, flush=True))
    there = find_spec("heli_interfaces") is not None and (
        not interfaces or are_built(_CHECKOUT, prefix)
    )
    print(f"environment: {prefix}")
    print(f"types of actions and transforms: {'there' if there else 'not built'}")


# Studies are an extra: where it is installed it brings commands of its own.
if find_spec("heli_studies") is not None:
    import_module("heli_studies.cli").add_to(app)
# What the documents publish is made in a checkout of the repository alone: nothing is loaded from
# whatever folder an installed package happens to lie in.
_CHECKOUT = Path(__file__).resolve().parents[4]
if (
    Path(__file__).resolve() == _CHECKOUT / "src/heli_flight/heli_flight/cli/app.py"
    and (_CHECKOUT / "evidence/cli.py").is_file()
):
    sys.path.append(str(_CHECKOUT))
    import_module("evidence.cli").add_to(app)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code: 2 and one line on stderr for bad input."""
    return run(app, argv, "heli")


if __name__ == "__main__":
    sys.exit(interrupts.run(lambda: main))
