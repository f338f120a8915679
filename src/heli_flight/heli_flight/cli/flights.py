# SPDX-License-Identifier: Apache-2.0
"""The command `heli hover`, which `./hover_test.sh` is, too."""

from pathlib import Path
from typing import Annotated, Any

import typer

from heli_flight.cli import completion
from heli_flight.cli.options import (
    EXIT_OF_FLIGHTS,
    Duration,
    Faults,
    Figures,
    Gps,
    Laws,
    Params,
    ScenarioName,
    World,
)


def epilog(prog: str) -> str:
    """Examples under the help, as the user has to type them."""
    lines = (
        ("", "the paper's hover test, 60 s"),
        ("--gps rtk --seed 7", "another receiver, another wind"),
        ("--world hard --seed 7", "another aircraft than its laws know, in gusts"),
        ("--laws paper --world paper", "the paper's own laws, in its own world"),
        ("--scenario attitude --controller pid", "the attitude test under another law"),
        ("--law examples/my_law.py:MyLaw", "a law of your own"),
        ("--params my_weights.yaml", "any node's parameters, changed"),
        ("--params flights/a/params.yaml", "a flight again"),
        ("--faults my_faults.yaml", "with sensors, actuators or links that fail"),
        ("--rate 400", "IMU, observer and inner loop at 400 Hz"),
        ("--live", "in real time, to be watched in a browser"),
        ("--live --live-wait", "the same, beginning when a browser looks"),
    )
    width = max(len(options) for options, _ in lines)
    shown = "\n".join(f"  {prog} {options:<{width}}  {what}" for options, what in lines)
    return f"\b\nexamples:\n{shown}\n\n{EXIT_OF_FLIGHTS}"


Law = Annotated[
    str | None,
    typer.Option(
        metavar="LAW",
        help="attitude law: hinf_output, hinf, lqg, lqr, pid, indi, matrices "
        "(default: the parameter of inner_loop)",
        autocompletion=completion.controllers,
    ),
]
OwnLaw = Annotated[
    list[str] | None,
    typer.Option(
        "--law",
        metavar="LAW",
        help="a law of your own in Python, MODULE:NAME or FILE.py:NAME, in the place of the "
        'attitude law, or of the position law (loop = "outer"); its code runs; repeatable',
    ),
]
Seed = Annotated[int | None, typer.Option(metavar="N", help="seed of wind and sensors")]
Lockstep = Annotated[
    bool,
    typer.Option(
        "--lockstep",
        help="as fast as the machine allows (default, unless the parameter file says else)",
    ),
]
Realtime = Annotated[bool, typer.Option("--realtime", help="at the pace of the wall clock")]
OneProcess = Annotated[
    bool,
    typer.Option(
        "--one-process", help="the same loop in this process, without ROS and without a bag"
    ),
]
Composed = Annotated[
    bool,
    typer.Option(
        "--composed",
        help="the graph's four nodes in one process, still over DDS topics: the same flight, "
        "sooner",
    ),
]
Respawn = Annotated[
    bool,
    typer.Option(
        "--respawn",
        help="start observer, inner or outer loop again if it dies in flight; it rejoins",
    ),
]
RateHz = Annotated[
    int | None,
    typer.Option(
        "--rate",
        metavar="HZ",
        help="of IMU, observer and inner loop: 100, 200 or 400 (default 100); outer loop and GPS "
        "stay as they are",
    ),
]
Out = Annotated[Path | None, typer.Option(metavar="DIR", help="folder to write; must not exist")]
NoReport = Annotated[bool, typer.Option("--no-report", help="write no report.html")]
ResultJson = Annotated[
    bool,
    typer.Option(
        "--json",
        help="print the flight's result.json (a list of several) to stdout, all else to stderr",
    ),
]
Live = Annotated[
    bool,
    typer.Option("--live", help="show the flight in a browser; in real time"),
]
LivePort = Annotated[
    int | None,
    typer.Option(metavar="PORT", help="with --live: port of the page, 0: any (default 8080)"),
]
FoxglovePort = Annotated[
    int | None,
    typer.Option(
        metavar="PORT", help="with --live: serve Foxglove, too, on this port, 0: any (else closed)"
    ),
]
LiveWait = Annotated[
    bool,
    typer.Option(
        "--live-wait",
        help="with --live: wait for the first browser before the flight begins, for at most the "
        "parameter viewer_limit_s of live_view (600 s)",
    ),
]
AllowCommands = Annotated[
    bool,
    typer.Option(
        "--allow-commands",
        help="with --live: print a token that lets its holder command gusts, mode, reference",
    ),
]

Aircraft = Annotated[
    int,
    typer.Option(
        "--aircraft",
        min=1,
        metavar="N",
        help="so many side by side, heli1, heli2 ..., each with its seed, bag and report",
    ),
]


def hover(
    scenario: ScenarioName = None,
    gps: Gps = None,
    world: World = None,
    laws: Laws = None,
    controller: Law = None,
    law: OwnLaw = None,
    seed: Seed = None,
    duration: Duration = None,
    params: Params = None,
    faults: Faults = None,
    lockstep: Lockstep = False,
    realtime: Realtime = False,
    one_process: OneProcess = False,
    composed: Composed = False,
    respawn: Respawn = False,
    rate: RateHz = None,
    out: Out = None,
    no_report: NoReport = False,
    figures: Figures = False,
    as_json: ResultJson = False,
    live: Live = False,
    live_port: LivePort = None,
    foxglove_port: FoxglovePort = None,
    allow_commands: AllowCommands = False,
    live_wait: LiveWait = False,
    aircraft: Aircraft = 1,
) -> int:
    """Fly the helicopter in wind, by itself, and compare with the paper."""
    from heli_flight.loop.result import RESULT
    from heli_flight.studies.flight import FlightOrder, fly_and_write, fly_several_and_write
    from heli_flight.terminal import console
    from heli_parameters.parameters import ParameterError

    if figures and no_report:
        raise ParameterError("--figures: draws the report's charts; not with --no-report")
    modes = {"--realtime": realtime, "--live": live, "--lockstep": lockstep}
    modes["--one-process"] = one_process
    watched = _live(live, live_port, foxglove_port, allow_commands, live_wait, not no_report)
    order = FlightOrder(
        scenario, gps, controller, _mode(modes), seed, duration, params or (), out, not no_report,
        watched, world, laws, composed, rate, figures, faults, respawn, law=law or (),
    )  # fmt: skip
    if aircraft == 1:
        outcomes = [fly_and_write(order, console(stderr=as_json))]
    else:
        outcomes = fly_several_and_write(order, aircraft, console(stderr=as_json))
    if as_json:
        texts = [(outcome.folder / RESULT).read_text(encoding="utf-8") for outcome in outcomes]
        print(texts[0] if aircraft == 1 else f"[{','.join(texts)}]\n", end="")
    return max(outcome.exit_code for outcome in outcomes)


def _mode(asked: dict[str, bool]) -> str | None:
    """The mode that options ask for, None for the parameter file's.

    Raises
    ------
    ParameterError
        They ask for two.
    """
    from heli_flight.loop.flight_section import LOCKSTEP, ONE_PROCESS, REAL_TIME
    from heli_parameters.parameters import ParameterError

    meant = {"--realtime": REAL_TIME, "--live": REAL_TIME, "--lockstep": LOCKSTEP}
    meant["--one-process"] = ONE_PROCESS
    given = [name for name, is_given in asked.items() if is_given]
    if asked["--live"] and asked["--one-process"]:
        raise ParameterError("--live: shows the ROS graph; it does not go with --one-process")
    if len({meant[name] for name in given}) > 1:
        raise ParameterError(f"{' and '.join(given)}: do not go together; give one of them")
    return meant[given[0]] if given else None


def _live(
    live: bool,
    port: int | None,
    foxglove_port: int | None,
    allow_commands: bool,
    wait: bool,
    report: bool,
) -> Any:
    """The live view that is asked for, None for none; its options need --live."""
    from heli_flight.graph.live import LiveOrder
    from heli_parameters.parameters import ParameterError

    given = {
        "--live-port": port is not None,
        "--foxglove-port": foxglove_port is not None,
        "--allow-commands": allow_commands,
        "--live-wait": wait,
    }
    for name, is_given in given.items():
        if is_given and not live:
            raise ParameterError(f"{name}: needs --live")
    return LiveOrder(port, foxglove_port, allow_commands, wait, report) if live else None
