# SPDX-License-Identifier: Apache-2.0
"""The commands `heli takeoff`, `goto`, `land` and `mode`: a pilot of the running flight."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated

import typer

from heli_flight.cli.common import EXIT_BROKEN, CommandWithRenamed, beginning

if TYPE_CHECKING:
    from heli_actions.pilot import Feedback, Pilot

pilot = typer.Typer(rich_markup_mode=None)

_EXIT = (
    "exit code: 0 done, 1 it has ended otherwise (one line), 2 refused, or no flight is heard "
    "(one line), 130 interrupted: the aircraft holds"
)
_MODES = ("hover", "velocity", "attitude", "manual", "land", "takeoff")
_NUMBERS = {"ignore_unknown_options": True}
"""A negative number is no option."""
Namespace = Annotated[
    str, typer.Option(metavar="NAME", help="of the aircraft, where there are several: heli2")
]
Wait = Annotated[
    float,
    typer.Option(min=0.1, max=3600.0, metavar="S", help="for a flight that can be commanded"),
]
Quiet = Annotated[bool, typer.Option("--quiet", help="do not tell how it goes on")]


def _modes(incomplete: str) -> list[str]:
    return beginning(incomplete, _MODES)


def _epilog(*examples: str) -> str:
    return "\b\nexample:\n" + "\n".join(f"  {line}" for line in examples) + f"\n\n{_EXIT}"


def _fly(
    namespace: str,
    wait_s: float,
    quiet: bool,
    ask: "Callable[[Pilot, Callable[[Feedback], None]], str]",
) -> int:
    """Have a pilot do something and tell how it goes on; print what was done, or why not."""
    from heli_actions.errors import FlightNotHeard, GoalError, GoalRefused
    from heli_actions.pilot import Pilot
    from heli_flight.graph.nodes import ros_node

    try:
        with (
            ros_node("heli_pilot") as node,
            Pilot(namespace, wait_s=wait_s, context=node.context) as commander,
        ):
            with _teller(quiet) as tell:
                done = ask(commander, tell)
            print(done, flush=True)
    except (FlightNotHeard, GoalRefused) as error:
        raise ValueError(str(error)) from error
    except GoalError as error:
        print(f"heli: {error}", file=sys.stderr)
        return EXIT_BROKEN
    return 0


def _in_words(feedback: "Feedback") -> str:
    """Where a goal is, on one line."""
    left = "" if feedback.left_m is None else f", {feedback.left_m:.1f} m left"
    east, north, up = feedback.pos_enu_m
    place = f"{east:.1f} m east, {north:.1f} m north, {up:.1f} m high"
    return f"{feedback.mode}: {place}{left}"


@contextlib.contextmanager
def _teller(quiet: bool) -> "Iterator[Callable[[Feedback], None]]":
    """Shows how a goal goes on, in one line of the terminal, if there is one."""
    from heli_flight.terminal import console

    out = console(stderr=True)
    if quiet or not out.is_terminal:
        yield lambda feedback: None
        return
    with out.status("") as status:
        yield lambda feedback: status.update(_in_words(feedback))


@pilot.command(
    cls=CommandWithRenamed, epilog=_epilog("heli takeoff", "heli takeoff 5 --namespace heli2")
)
def takeoff(
    height: Annotated[
        float | None,
        typer.Argument(
            metavar="[HEIGHT]", help="above where it stands, m (default: takeoff.height_m)"
        ),
    ] = None,
    namespace: Namespace = "",
    wait: Wait = 120.0,
    quiet: Quiet = False,
) -> int:
    """Have the aircraft take off and hover; ends when it does."""
    return _fly(namespace, wait, quiet, lambda p, tell: p.takeoff(height, on_feedback=tell))


@pilot.command(
    cls=CommandWithRenamed,
    context_settings=_NUMBERS,
    epilog=_epilog(
        "heli goto 10 0 5", "heli goto -10 4 5 --heading 90", "heli goto --gps 28.1702 112.9301 62"
    ),
)
def goto(
    east: Annotated[float, typer.Argument(metavar="EAST", help="m from the origin of map")],
    north: Annotated[float, typer.Argument(metavar="NORTH", help="m")],
    up: Annotated[float, typer.Argument(metavar="UP", help="m")],
    heading: Annotated[
        float | None,
        typer.Option(metavar="DEG", help="of the nose, 0 is north, 90 east (default: as it is)"),
    ] = None,
    gps: Annotated[
        bool,
        typer.Option(
            "--gps", help="instead: latitude and longitude, deg, height over the ellipsoid, m"
        ),
    ] = False,
    namespace: Namespace = "",
    wait: Wait = 120.0,
    quiet: Quiet = False,
) -> int:
    """Fly to a point and hold it; ends when the aircraft is there."""
    place = east, north, up, heading

    def ask(commander: "Pilot", tell: "Callable[[Feedback], None]") -> str:
        go = commander.goto_gps if gps else commander.goto
        return str(go(*place, on_feedback=tell))

    return _fly(namespace, wait, quiet, ask)


@pilot.command(cls=CommandWithRenamed, epilog=_epilog("heli land"))
def land(namespace: Namespace = "", wait: Wait = 120.0, quiet: Quiet = False) -> int:
    """Have the aircraft land; ends when it stands."""
    return _fly(namespace, wait, quiet, lambda p, tell: p.land(on_feedback=tell))


@pilot.command(cls=CommandWithRenamed, epilog=_epilog("heli mode hover", "heli mode velocity"))
def mode(
    name: Annotated[
        str,
        typer.Argument(metavar="MODE", help=", ".join(_MODES), autocompletion=_modes),
    ],
    namespace: Namespace = "",
    wait: Wait = 120.0,
) -> int:
    """Command a mode by its name; ends when it is obeyed."""
    return _fly(namespace, wait, True, lambda p, _: p.mode(name))
