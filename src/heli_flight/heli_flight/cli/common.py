# SPDX-License-Identifier: Apache-2.0
"""Options that several commands of `heli` have, each written once."""

import difflib
import re
import sys
from collections.abc import Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Context
from typer.core import TyperCommand, TyperGroup
from typer.exceptions import TyperException

from heli_flight import interrupts

# -------------------------------------------------------------------------------------------------
# Options under the names that they had before: accepted, with a warning, and in no help.
# -------------------------------------------------------------------------------------------------

RENAMED = (
    ("--laws", "--control-preset"),
    ("--law", "--custom-law"),
    ("--controller", "--attitude-controller"),
    ("--controllers", "--attitude-controller"),
    ("--aircraft", "--vehicles"),
    ("--aircraft", "--namespace"),
)
"""Old name and new one. An old name is meant where a command has the new option and none of the
old name."""
_COUNTS = ("--vehicles",)
_WHOLE_NUMBER = re.compile(r"[+-]?\d+")


def with_new_names(
    words: Sequence[str], values_of: Mapping[str, int], prog: str, warn: bool = True
) -> list[str]:
    """The words of a command line with the present names of its options.

    Parameters
    ----------
    words : sequence of str
        Without the command's own name.
    values_of : mapping
        Option of the command to how many words follow it.
    prog : str
        Begins the warning: one line on stderr, however many old names there are.
    warn : bool

    Returns
    -------
    list of str
        What stands behind `--`, or is the value of an option, is left alone.
    """
    renamed = {old: new for old, new in RENAMED if new in values_of and old not in values_of}
    rest, rewritten, used = list(words), [], {}
    while rest and rest[0] != "--":
        word, equals, value = rest.pop(0).partition("=")
        new = renamed.get(word, word)
        argument = value if equals else (rest or [""])[0]
        # An aircraft's name or file, where a count was meant, is no old use.
        if new != word and (new not in _COUNTS or _WHOLE_NUMBER.fullmatch(argument)):
            used[word] = new
            word = new
        rewritten.append(f"{word}{equals}{value}")
        if not equals:
            follow = values_of.get(word, 0)
            rewritten, rest = [*rewritten, *rest[:follow]], rest[follow:]
    if used and warn:
        renamings = ", ".join(f"{old} is now {new}" for old, new in used.items())
        print(f"{prog.removesuffix('.sh')}: {renamings}", file=sys.stderr)
    return [*rewritten, *rest]


def _new_names(command: Any, ctx: Context, args: list[str]) -> list[str]:
    values_of = {
        name: 0 if getattr(param, "is_flag", False) else param.nargs
        for param in command.get_params(ctx)
        for name in (*param.opts, *param.secondary_opts)
        if name.startswith("-")
    }
    prog = ctx.find_root().info_name or ""
    return with_new_names(args, values_of, prog, not ctx.resilient_parsing)


class CommandWithRenamed(TyperCommand):
    """For `app.command(cls=...)`: a command that takes its options by old names, too."""

    def parse_args(self, ctx: Context, args: list[str]) -> list[str]:  # type: ignore[override]
        """As typer does, by the present names."""
        return super().parse_args(ctx, _new_names(self, ctx, args))


# -------------------------------------------------------------------------------------------------
# A command with options of its own that also has sub-commands: `heli campaign SPEC`, `... report`.
#
# The first word decides: the name of a sub-command, or else the command's own arguments.
# -------------------------------------------------------------------------------------------------

SETTINGS: dict[str, Any] = {
    "invoke_without_command": True,
    "context_settings": {"allow_interspersed_args": True, "allow_extra_args": False},
}
"""Of the Typer: options may follow arguments, and what is left over is refused."""


class CommandWithWords(TyperGroup):
    """For `Typer(cls=..., **SETTINGS)`; its callback is the command.

    The callback takes a `typer.Context` and returns at once if its `invoked_subcommand` is one.
    """

    def parse_args(self, ctx: Context, args: list[str]) -> list[str]:  # type: ignore[override]
        """Own options and arguments, or none and a sub-command with all that follows."""
        if not args or args[0] not in self.commands:
            if not ctx.resilient_parsing:
                self._refuse_misspelt(ctx, args[:1])
            return super().parse_args(ctx, _new_names(self, ctx, args))
        super().parse_args(ctx, [])
        ctx._protected_args, ctx.args = args[:1], args[1:]
        return ctx.args

    def get_params(self, ctx: Any) -> list[Any]:
        """Own parameters; a sub-command's usage asks, too, and has no use for the arguments."""
        known = super().get_params(ctx)
        return known if ctx.command is self else [p for p in known if p.opts[0].startswith("-")]

    def collect_usage_pieces(self, ctx: Any) -> list[str]:
        """Without what every group says: the sub-commands are listed below."""
        return super().collect_usage_pieces(ctx)[:-1]

    def _refuse_misspelt(self, ctx: Context, words: list[str]) -> None:
        for word in words:
            near = difflib.get_close_matches(word, self.commands, n=1)
            if near and not Path(word).exists():
                ctx.fail(f"No such command or file {word!r}. Did you mean {near[0]!r}?")


def sub_commands(context: Context, incomplete: str) -> list[str]:
    """What the shell offers for the first word; where nothing is offered, it offers files."""
    known: Any = context.command
    return [name for name in known.commands if name.startswith(incomplete)]


# -------------------------------------------------------------------------------------------------
# Runs a command: bad input is one line and exit code 2, never a traceback.
# -------------------------------------------------------------------------------------------------

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
    for argument in sys.argv[1:] if argv is None else argv:
        if not argument.isprintable() and _is_no_utf8(argument):
            # Pages, YAML and JSON would have to name it; so before anything is flown.
            print(f"{name}: {_one_line(argument)}: is not UTF-8", file=sys.stderr)
            return EXIT_BAD_INPUT
    try:
        with interrupts.interrupts_reported():
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
        if isinstance(error, ModuleNotFoundError) and find_spec("rclpy") is None:
            from heli_core.errors import NO_ROS

            print(f"{name}: this command {NO_ROS}", file=sys.stderr)
            return EXIT_BAD_INPUT
        if code is None:
            raise
        print(f"{name}: {_one_line(_sentence_of(error))}", file=sys.stderr)
        return code
    if code == interrupts.EXIT_CODE:
        # typer has turned the KeyboardInterrupt into this code.
        print(interrupts.LINE, file=sys.stderr)
    return int(code or 0)


def _is_no_utf8(text: str) -> bool:
    """Whether a text of the system holds bytes that are no UTF-8; Python keeps them as surrogates.

    PEP 383.
    """
    return any("\ud800" <= character <= "\udfff" for character in text)


_SHOWN = 200


def _sentence_of(error: Exception) -> str:
    """What an error says; where a text could not be encoded, the line of it."""
    if not isinstance(error, UnicodeEncodeError):
        return str(error)
    # As of a working directory or TMPDIR of such a name.
    before, _, _ = error.object[: error.end].rpartition("\n")
    line = error.object[len(before) :].strip().partition("\n")[0]
    return f"{line[:_SHOWN]}: is not UTF-8"


def _refusal(error: Exception) -> int | None:
    """Exit code of what carries one sentence for the user, None for what does not.

    The imports wait until something is raised: help and completion are quick.
    """
    from heli_bags.writer import BagError
    from heli_core.errors import BrokenFlightError, FlightError
    from heli_core.rcl_yaml import ParameterError
    from heli_dynamics_sim.trim import TrimError

    if isinstance(error, BrokenFlightError):
        return EXIT_BROKEN
    refused = (BagError, ParameterError, ValueError, TrimError, FlightError, OSError)
    return EXIT_BAD_INPUT if isinstance(error, refused) else None


def _text_of(error: TyperException) -> str:
    return str(getattr(error, "format_message", lambda: str(error))())


def _one_line(text: str) -> str:
    """What the terminal shows as one line, whatever a file or an argument held."""
    from heli_core.rcl_yaml import printable

    line = " ".join(part.strip() for part in text.splitlines())
    return printable(line, len(line))


# -------------------------------------------------------------------------------------------------
# What the shell offers when the user presses Tab: scenarios, worlds, presets, aircraft.
#
# Used by typer's completion (`heli --install-completion`). Imports wait until Tab is pressed. Where
# nothing is offered the shell offers files.
# -------------------------------------------------------------------------------------------------


def scenarios(incomplete: str) -> list[str]:
    """Packaged scenarios."""
    from heli_flight.layers import scenario_names

    return beginning(incomplete, scenario_names())


def worlds(incomplete: str) -> list[str]:
    """Packaged worlds."""
    from heli_flight.worlds import WORLDS

    return beginning(incomplete, WORLDS.names())


def control_presets(incomplete: str) -> list[str]:
    """Packaged files of controllers' parameters."""
    from heli_flight.worlds import LAWS

    return beginning(incomplete, LAWS.names())


def gps_presets(incomplete: str) -> list[str]:
    """Receivers."""
    from heli_flight.layers import GPS_PRESETS

    return beginning(incomplete, GPS_PRESETS)


def controllers(incomplete: str) -> list[str]:
    """Attitude controllers."""
    from heli_inner_hinf.controller_state import CONTROLLERS

    return beginning(incomplete, CONTROLLERS)


def manoeuvres(incomplete: str) -> list[str]:
    """Manoeuvres that can be scored."""
    from heli_analysis.handling.definitions import MANOEUVRES

    return beginning(incomplete, MANOEUVRES)


def aircraft(incomplete: str) -> list[str]:
    """Packaged aircraft."""
    from heli_core.command_line import config_folder

    packaged = (config_folder("heli_dynamics_sim") / "aircraft").glob("*.yaml")
    return beginning(incomplete, sorted(path.name for path in packaged))


def node_packages(incomplete: str) -> list[str]:
    """Packages that hold a node."""
    return beginning(incomplete, sorted({package for package, _ in _executables()}))


def nodes(context: Context, incomplete: str) -> list[str]:
    """Nodes of the package that stands before."""
    mine = [name for package, name in _executables() if package == context.params["package"]]
    return beginning(incomplete, sorted(mine))


def _executables() -> list[tuple[str, str]]:
    """Package and name of what `heli run` can start."""
    from heli_core.command_line import executables

    return executables("heli_")


def beginning(incomplete: str, names: Any) -> list[str]:
    """Those of some names that begin as what stands before the Tab."""
    return [name for name in names if name.startswith(incomplete)]


# -------------------------------------------------------------------------------------------------
# Options.
# -------------------------------------------------------------------------------------------------

EXIT_OF_FLIGHTS = (
    "exit code: 0 inside the bounds, or nothing bounds it, 1 outside or helicopter lost (named), "
    "2 bad input, "
    "130 interrupted. Judged are the scored windows alone (hover: 5 to 18 s and 25 s to the end, "
    "attitude: from 5 s on): the state estimate, with an RTK receiver ground truth, too. A "
    "flight that ends before the first of them is not judged (0). The figures of the whole "
    "flight, climb included, are given first and decide nothing."
)
Figures = Annotated[
    bool,
    typer.Option(
        "--figures", help="also figures/: each chart of the report as PNG and SVG, for a paper"
    ),
]
Params = Annotated[
    list[Path] | None,
    typer.Option(
        "--params", metavar="FILE", help="parameter file over any node's YAML; repeatable"
    ),
]
Faults = Annotated[
    Path | None,
    typer.Option(
        "--faults",
        metavar="FILE",
        help="YAML file of faults of sensors, actuators and links, each with its time "
        "(default: the parameter file's, else none)",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="print JSON instead of tables")]
Gps = Annotated[
    str | None,
    typer.Option(
        "--gps",
        metavar="PRESET",
        help="receiver: standalone or rtk (default: the parameter file's, else standalone)",
        autocompletion=gps_presets,
    ),
]
World = Annotated[
    str | None,
    typer.Option(
        "--world",
        metavar="NAME",
        help="air, sensors and what the seed draws of the aircraft: paper, honest, hard, or a "
        "YAML file (default: the parameter file's, else honest for the hover test, else paper)",
        autocompletion=worlds,
    ),
]
AttitudeController = Annotated[
    str | None,
    typer.Option(
        "--attitude-controller",
        metavar="NAME",
        help="hinf_output, hinf, lqg, lqr, pid, indi or matrices "
        "(default: the parameter `controller` of inner_loop)",
        autocompletion=controllers,
    ),
]
ControlPreset = Annotated[
    str | None,
    typer.Option(
        "--control-preset",
        metavar="NAME",
        help="attitude controller, position controller and observer with their parameters: "
        "packaged, hinf_output, hinf, indi, lqg, lqr, mu, pid, paper, or a YAML file "
        "(default: the parameter file's, else packaged)",
        autocompletion=control_presets,
    ),
]
Seeds = Annotated[
    str, typer.Option("--seeds", metavar="SEEDS", help="1..20, 7, 1,5,9 or 1..20,31..40")
]
Duration = Annotated[
    float | None,
    typer.Option(
        metavar="S", help="length of a flight (default: the parameter file's, else the scenario's)"
    ),
]
WindSeed = Annotated[
    int | None, typer.Option("--seed", metavar="N", help="seed of wind and sensors")
]
AutopilotDuration = Annotated[
    float | None,
    typer.Option("--duration", metavar="S", help="flight time after which it ends (default: 3600)"),
]
AutopilotLive = Annotated[bool, typer.Option("--live", help="show the flight in a browser")]
LivePort = Annotated[
    int | None,
    typer.Option(metavar="PORT", help="with --live: port of the page, 0: any (default 8080)"),
]
NewFolder = Annotated[
    Path | None, typer.Option("--out", metavar="DIR", help="folder to write; must not exist")
]
NoReport = Annotated[bool, typer.Option("--no-report", help="write no report.html")]
RecordedScenario = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="what was flown (default: as recorded)",
        autocompletion=scenarios,
    ),
]
FlightNumber = Annotated[
    int | None,
    typer.Option(
        "--flight",
        min=1,
        metavar="N",
        help="of a bag whose clock goes back: which flight (default: the last)",
    ),
]
RecordedGps = Annotated[
    str | None,
    typer.Option(
        metavar="PRESET",
        help="receiver (default: as recorded)",
        autocompletion=gps_presets,
    ),
]
ScenarioName = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="what to fly: hover, attitude, attitude_gusts, figure_eight, orbit, waypoints, "
        "forward_flight, takeoff_land, by_hand, sequence, attitude_sweep, attitude_steps, "
        "attitude_disturbance, mte_hover, mte_vertical, mte_pirouette, "
        "mte_slalom, mte_lateral_reposition, mte_depart_abort, "
        "identify_actuators or identify_gusts (default: the parameter file's, else hover)",
        autocompletion=scenarios,
    ),
]
AnyGps = Annotated[
    str | None,
    typer.Option(
        metavar="PRESET",
        help="receiver: standalone or rtk (default: the parameter file's, else both)",
        autocompletion=gps_presets,
    ),
]
Aircraft = Annotated[
    str | None,
    typer.Option(
        "--aircraft",
        metavar="NAME",
        help="helion, xcell60, logo600, or a YAML file (default: the plant's)",
        autocompletion=aircraft,
    ),
]


def live_order(
    live: bool,
    port: int | None,
    report: bool,
    foxglove_port: int | None = None,
    allow_commands: bool = False,
    wait: bool = False,
) -> Any:
    """The live view that is asked for, None for none; its options need --live."""
    from heli_core.rcl_yaml import ParameterError
    from heli_flight.graph.live import LiveOrder

    needs_live = {
        "--live-port": port is not None,
        "--foxglove-port": foxglove_port is not None,
        "--allow-commands": allow_commands,
        "--live-wait": wait,
    }
    for name, is_set in needs_live.items():
        if is_set and not live:
            raise ParameterError(f"{name}: needs --live")
    return LiveOrder(port, foxglove_port, allow_commands, wait, report) if live else None
