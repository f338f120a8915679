# SPDX-License-Identifier: Apache-2.0
"""The command `heli hover`, which `./hover_test.sh` is, too."""

import contextlib
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from heli_core.ticks import TICKS_PER_S
from heli_flight.cli.common import (
    EXIT_OF_FLIGHTS,
    AttitudeController,
    CommandWithRenamed,
    ControlPreset,
    Duration,
    Faults,
    Figures,
    FlightNumber,
    Gps,
    Json,
    LivePort,
    Params,
    RecordedGps,
    RecordedScenario,
    ScenarioName,
    World,
    live_order,
)

if TYPE_CHECKING:
    from heli_outer_pd.joystick import Device, Reading


# -------------------------------------------------------------------------------------------------
# Hover.
# -------------------------------------------------------------------------------------------------


def epilog(prog: str) -> str:
    """Examples under the help, as the user has to type them."""
    lines = (
        ("", "the paper's hover test, 60 s"),
        ("--gps rtk --seed 7", "another receiver, another wind"),
        ("--world hard --seed 7", "another aircraft than its controllers know, in gusts"),
        ("--control-preset paper --world paper", "the paper's own controllers, in its own world"),
        ("--scenario attitude --attitude-controller pid", "the attitude test under a PID"),
        ("--custom-law examples/my_law.py:MyLaw", "a controller of your own"),
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


CustomLaw = Annotated[
    list[str] | None,
    typer.Option(
        "--custom-law",
        metavar="LAW",
        help="a controller of your own in Python, MODULE:NAME or FILE.py:NAME, in place of the "
        'attitude controller, or of the position controller (loop = "outer"); its code runs; '
        "repeatable",
    ),
]
Seed = Annotated[int | None, typer.Option(metavar="N", help="seed of wind and sensors")]
Lockstep = Annotated[
    bool,
    typer.Option(
        "--lockstep",
        help="as fast as the machine allows (default, unless the parameter file says otherwise)",
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
        help="start observer, inner or outer loop again if it dies in flight; the flight goes on",
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
Vehicles = Annotated[
    int,
    typer.Option(
        "--vehicles",
        min=1,
        metavar="N",
        help="so many aircraft side by side, heli1, heli2 ..., each with its seed, bag and report",
    ),
]


def hover(
    scenario: ScenarioName = None,
    gps: Gps = None,
    world: World = None,
    laws: ControlPreset = None,
    controller: AttitudeController = None,
    law: CustomLaw = None,
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
    vehicles: Vehicles = 1,
) -> int:
    """Fly the helicopter in wind, by itself, and compare with the paper."""
    from heli_core.rcl_yaml import ParameterError
    from heli_flight.fly import FlightOrder, fly_and_write, fly_several_and_write
    from heli_flight.result import RESULT
    from heli_flight.terminal import console

    if figures and no_report:
        raise ParameterError("--figures: draws the report's charts; not with --no-report")
    modes = {"--realtime": realtime, "--live": live, "--lockstep": lockstep}
    modes["--one-process"] = one_process
    watched = live_order(live, live_port, not no_report, foxglove_port, allow_commands, live_wait)
    order = FlightOrder(
        scenario, gps, controller, _mode(modes), seed, duration, params or (), out, not no_report,
        watched, world, laws, composed, rate, figures, faults, respawn, law=law or (),
    )  # fmt: skip
    if vehicles == 1:
        outcomes = [fly_and_write(order, console(stderr=as_json))]
    else:
        outcomes = fly_several_and_write(order, vehicles, console(stderr=as_json))
    if as_json:
        texts = [(outcome.folder / RESULT).read_text(encoding="utf-8") for outcome in outcomes]
        print(texts[0] if vehicles == 1 else f"[{','.join(texts)}]\n", end="")
    return max(outcome.exit_code for outcome in outcomes)


def _mode(asked: dict[str, bool]) -> str | None:
    """The mode that options ask for, None for the parameter file's.

    Raises
    ------
    ParameterError
        They ask for two.
    """
    from heli_core.rcl_yaml import ParameterError
    from heli_flight.layers import LOCKSTEP, ONE_PROCESS, REAL_TIME

    meant = {"--realtime": REAL_TIME, "--live": REAL_TIME, "--lockstep": LOCKSTEP}
    meant["--one-process"] = ONE_PROCESS
    options = [name for name, is_set in asked.items() if is_set]
    if asked["--live"] and asked["--one-process"]:
        raise ParameterError("--live: shows the ROS graph; it does not go with --one-process")
    if len({meant[name] for name in options}) > 1:
        raise ParameterError(f"{' and '.join(options)}: do not go together; give one of them")
    return meant[options[0]] if options else None


# -------------------------------------------------------------------------------------------------
# The command `heli replay`: a recorded flight on the live view's page.
# -------------------------------------------------------------------------------------------------

REPLAY_EPILOG = (
    "\b\nexample:\n  heli replay flights/my_flight\n"
    "  heli replay flights/my_flight/bag --port 0    # any free port; it is printed\n"
    "  heli replay rosbag2_2026_11_21 --params my.yaml\n\n"
    "On the page: space plays and pauses, left and right go 1 s (with shift 10 s), comma and full "
    "stop one tick, [ and ] to the event before and after, - and + change the speed (0.25 to 16 "
    "times), home and end. The address may name a time: http://127.0.0.1:8080/#t=12.5\n\n"
    "A bag that was cut off is shown as far as it can be restored; it is not changed. Several "
    "browsers may look, each at its own time. Nothing can be commanded.\n\n"
    "exit code: 2 bad input (one line), 130 ended by Ctrl-C"
)


def replay(
    flight: Annotated[
        Path,
        typer.Argument(
            metavar="FLIGHT", help="folder of a flight, rosbag2 folder, or a file of one"
        ),
    ],
    port: Annotated[
        int,
        typer.Option(
            min=0, max=65535, metavar="PORT", help="of the page, on 127.0.0.1; 0: any free one"
        ),
    ] = 8080,
    scenario: RecordedScenario = None,
    gps: RecordedGps = None,
    params: Params = None,
    which: FlightNumber = None,
) -> int:
    """Show a recorded flight in a browser: wind back and forth, slow, fast, from event to event."""
    from heli_flight.replay import replay_of, serve
    from heli_flight.report.write import BagChoice
    from heli_flight.terminal import amount
    from heli_live_view.access import listen

    # A port that is taken is refused before the flight is read, which takes seconds.
    listen(port, "", "--port").close()
    choice = BagChoice(scenario, gps, None, params or [], which)
    with amount("replay") as progress:
        shown, beside = replay_of(flight, choice, progress)
    # At once, where there is no terminal, too: whoever waits for the address reads it.
    serve(shown, port, beside, partial(print, flush=True))
    return 0


# -------------------------------------------------------------------------------------------------
# `heli diff` on the command line.
# -------------------------------------------------------------------------------------------------

DIFF_EPILOG = (
    "\b\nexample:\n  heli diff flights/before flights/after\n"
    "  heli diff soft close heavy_angles --out three.html --json\n\n"
    "exit code: 0 written, 1 written, but only a part of a flight was recorded, or its ground "
    "truth is not what the plant sent, 2 bad input (one line)"
)


def diff(
    flights: Annotated[
        list[Path],
        typer.Argument(metavar="FLIGHT FLIGHT ...", help="folders of flights, or rosbag2 folders"),
    ],
    out: Annotated[
        Path, typer.Option(metavar="FILE", help="page to write; one that is there is replaced")
    ] = Path("diff.html"),
    as_json: Json = False,
) -> int:
    """Lay flights beside each other: parameters that differ, figures, charts in one page."""
    from heli_core.rcl_yaml import ParameterError
    from heli_flight.report.diff import diff as compared
    from heli_flight.report.diff import print_diff, write_diff
    from heli_flight.terminal import amount, answer

    if out.suffix != ".html":
        raise ParameterError(f"--out {out}: a page; its name must end in .html")
    with amount("flights read") as progress:
        comparison = compared(flights, progress)
    try:
        write_diff(comparison, out)
    except OSError as error:
        raise ParameterError(f"--out {out}: cannot be written: {error.strerror}") from None
    content = {**comparison.as_dict(), "page": str(out)}
    answer(content, as_json, partial(print_diff, comparison), f"written: {out}")
    return comparison.exit_code


# -------------------------------------------------------------------------------------------------
# The command `heli fault`: something breaks in the flight that is under way.
# -------------------------------------------------------------------------------------------------

fault = typer.Typer(rich_markup_mode=None)
_FORM = "heli fault WHAT KIND [VALUE ...], --list or --clear"


@fault.command(
    "fault",
    cls=CommandWithRenamed,
    context_settings={"ignore_unknown_options": True},
    epilog="\b\nexample:\n  heli fault gps loss --duration 10\n"
    "  heli fault gyro bias 0.05 0 0 --duration 5\n  heli fault delta_ped offset -0.1\n"
    "  heli fault wind gust 3 0 0 --duration 2\n  heli fault --clear",
)
def fault_command(
    what: Annotated[
        str | None,
        typer.Argument(metavar="WHAT", help="gps, imu, delta_ped, ...: the table Faults"),
    ] = None,
    kind: Annotated[
        str | None, typer.Argument(metavar="KIND", help="loss, bias, stuck, ...")
    ] = None,
    value: Annotated[
        list[str] | None, typer.Argument(metavar="[VALUE ...]", help="the numbers that it has")
    ] = None,
    duration: Annotated[
        float | None, typer.Option(metavar="S", help="how long (default: to the end)")
    ] = None,
    clear: Annotated[bool, typer.Option("--clear", help="end all faults")] = False,
    shown: Annotated[bool, typer.Option("--list", help="print the faults of the flight")] = False,
    namespace: Annotated[
        str, typer.Option(metavar="NAME", help="of the aircraft, where there are several: heli2")
    ] = "",
    timeout: Annotated[
        float, typer.Option(min=0.1, max=600.0, metavar="S", help="wait for the plant's answer")
    ] = 10.0,
    as_json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
) -> int:
    """Break a sensor or an actuator of the running flight, from now on; or send a gust."""
    words = [word for word in (what, kind, clear or None, shown or None) if word is not None]
    if words not in ([what, kind], [True]):
        raise ValueError(f"expected: {_FORM}")
    from heli_flight.graph.nodes import FaultSetter, fault_text, ros_node

    text = None if clear or shown else fault_text(str(what), str(kind), value or [], duration)
    with ros_node("heli_fault") as node:
        plant = FaultSetter(node, namespace, timeout)
        if text is not None:
            plant.add(text)
        reply = plant.clear() if clear else ""
        present = plant.present()
    if as_json:
        print(json.dumps({"faults": present}))
    else:
        print(reply or "\n".join(present))
    return 0


# -------------------------------------------------------------------------------------------------
# The commands `heli echo` and `heli topics`, for those without the `ros2` command.
# -------------------------------------------------------------------------------------------------

graph = typer.Typer(rich_markup_mode=None)

_Settle = Annotated[
    float,
    typer.Option(
        min=0.0,
        max=60.0,
        metavar="S",
        help="take the graph as known when nothing new has come for S, at most 10 s later; "
        "1.5 s are three announcements of a node of ours",
    ),
]


@graph.command(
    epilog="\b\nexample:\n  heli echo odom --count 1\n  heli echo /diagnostics --json > log.jsonl"
)
def echo(
    topic: Annotated[str, typer.Argument(metavar="TOPIC", help="name, with or without the slash")],
    count: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="stop after N messages")
    ] = None,
    timeout: Annotated[
        float | None,
        typer.Option(min=0.0, metavar="S", help="give up after S without a message or a sender"),
    ] = None,
    settle: _Settle = 1.5,
    full: Annotated[bool, typer.Option("--full", help="do not shorten long arrays")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="one line of JSON per message")] = False,
) -> int:
    """Print the messages of a topic of the running graph as they come."""
    from heli_bags.graph_tools import TopicError, listen
    from heli_bags.tools import as_json as json_line
    from heli_bags.tools import as_yaml
    from heli_flight.graph.nodes import ros_node

    with ros_node("heli_echo") as node:
        try:
            for number, (_, message) in enumerate(listen(node, topic, timeout, settle), 1):
                print(json_line(message) if as_json else as_yaml(message, full), flush=True)
                if count is not None and number >= count:
                    break
        except TopicError as error:
            raise ValueError(str(error)) from error
    return 0


@graph.command(epilog="\b\nexample:\n  heli topics --rate\n  heli topics --json")
def topics(
    rate: Annotated[bool, typer.Option("--rate", help="measure messages per second")] = False,
    seconds: Annotated[
        float, typer.Option(min=0.1, max=3600.0, metavar="S", help="wall time to measure for")
    ] = 2.0,
    settle: _Settle = 1.5,
    hidden: Annotated[bool, typer.Option("--all", help="also hidden topics")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="print JSON instead of a table")] = False,
) -> int:
    """List the running graph's topics: name, type, publishers, subscribers, rate."""
    from heli_bags.graph_tools import list_topics, measure
    from heli_flight.graph.nodes import ros_node
    from heli_flight.terminal import amount, console, table

    with ros_node("heli_topics") as node:
        rows, discovery = list_topics(node, hidden, settle)
        if rate:
            with amount("seconds") as progress:
                rows = measure(node, rows, seconds, lambda done: progress(int(done), int(seconds)))
    errors = console(stderr=True)
    errors.print(f"graph: {discovery} (--settle)")
    if as_json:
        print(json.dumps([asdict(row) for row in rows], indent=2))
        return 0
    out = console()
    shown = table("", out)
    for name in ("topic", "type"):
        shown.add_column(name, no_wrap=True)
    for name in ("publishers", "subscribers", *(["rate, 1/s"] if rate else [])):
        shown.add_column(name, justify="right")
    for row in rows:
        measured = "" if row.rate_hz is None else f"{row.rate_hz:.4g}"
        cells = [row.topic, row.type, str(row.publishers), str(row.subscribers)]
        shown.add_row(*cells, *([measured] if rate else []))
    out.print(shown)
    if not any(row.publishers for row in rows):
        errors.print("no topics: does a flight run in this ROS_DOMAIN_ID?")
    return 0


# -------------------------------------------------------------------------------------------------
# The command `heli joy`: a joystick or a keyboard on the topic `joy`.
# -------------------------------------------------------------------------------------------------

JOY_EPILOG = (
    "\b\nexample:\n  heli hover --scenario by_hand --realtime    # in another terminal\n"
    "  heli joy --keyboard\n\n"
    "exit code: 0 ended by the pilot (q), 1 the joystick was unplugged, 2 there is none or bad "
    "input, 130 interrupted"
)


def joy(
    keyboard: Annotated[
        bool, typer.Option("--keyboard", help="the keys of this terminal instead of a joystick")
    ] = False,
    device: Annotated[
        int, typer.Option(min=0, metavar="N", help="which joystick (heli joy --list)")
    ] = 0,
    listed: Annotated[bool, typer.Option("--list", help="name the joysticks and end")] = False,
    rate: Annotated[
        float, typer.Option(min=5.0, max=200.0, metavar="HZ", help="messages per second")
    ] = 50.0,
    topic: Annotated[
        str, typer.Option(metavar="TOPIC", help="such as heli2/joy for one aircraft of several")
    ] = "joy",
) -> int:
    """Send a joystick, or a terminal's keys, as sensor_msgs/Joy."""
    from heli_outer_pd import joystick as keys
    from heli_outer_pd.joystick import SdlJoystick, joystick_names

    if listed:
        names = joystick_names()
        for number, name in enumerate(names):
            print(f"{number}: {name}")
        if not names:
            print("no joystick found", file=sys.stderr)
        return 0
    input_device: Device
    if keyboard:
        input_device, help_text = keys.TerminalKeys(sys.stdin.fileno()), keys.HELP
    else:
        joystick = SdlJoystick(device)
        input_device, help_text = (
            joystick,
            f"{joystick.name}, layout: {joystick.layout}; Ctrl-C ends",
        )
    try:
        _send(input_device, help_text, rate, topic)
    finally:
        input_device.close()
    return 0


def _send(device: "Device", help_text: str, rate: float, topic: str) -> None:
    """Open a node and send until it ends."""
    from heli_flight.graph.nodes import ros_node, send
    from heli_flight.terminal import console
    from heli_msgs_bridge import topics
    from heli_msgs_bridge.command_messages import encode_joy

    with ros_node("heli_joy") as node:
        publisher = node.create_publisher(
            topics.message_class(topics.BY_NAME[topics.JOY].type), topic, topics.qos(topics.JOY, 10)
        )
        clock = node.get_clock()

        def publish(reading: "Reading") -> None:
            stamp_ns = clock.now().nanoseconds
            publisher.publish(encode_joy(reading.axes, reading.buttons, stamp_ns))

        console(stderr=True).print(help_text, soft_wrap=True, markup=False)
        with _teller() as show:
            send(device, publish, 1.0 / rate, show)


@contextlib.contextmanager
def _teller() -> Iterator[Callable[["Reading"], None]]:
    """Shows the newest reading in one line of the terminal, if there is one."""
    from heli_flight.graph.nodes import in_words
    from heli_flight.terminal import console

    out = console(stderr=True)
    if not out.is_terminal:
        yield lambda reading: None
        return
    with out.status("") as status:
        yield lambda reading: status.update(in_words(reading))


# -------------------------------------------------------------------------------------------------
# The command `heli bag`: a sub-command imports what it needs.
# -------------------------------------------------------------------------------------------------

bag = typer.Typer(
    help="Look into a recorded bag, play it, repair it.",
    no_args_is_help=True,
    rich_markup_mode=None,
    epilog="\b\nexample:\n  heli bag info flights/my_flight",
)

Bag = Annotated[
    Path, typer.Argument(metavar="BAG", help="rosbag2 folder, its file, or a flight's folder")
]
Topics = Annotated[
    list[str] | None,
    typer.Option("--topic", metavar="TOPIC", help="only this topic; repeatable (default: all)"),
]
_SHORT = 1


def _shown(sentence: str) -> str:
    """A sentence with names out of a bag, without what steers a terminal."""
    from heli_core.rcl_yaml import printable

    return printable(sentence, len(sentence))


def _short_of(shortfall: Sequence[str]) -> int:
    """Say why less was read than the bag lists; the exit code."""
    for sentence in shortfall:
        print(f"not read: {_shown(sentence)}", file=sys.stderr)
    return _SHORT if shortfall else 0


@bag.command(epilog="\b\nexample:\n  heli bag info flights/my_flight --json")
def info(path: Bag, as_json: Json = False) -> int:
    """Show what a bag holds: topics, types, counts, rates, length, size."""
    from heli_bags.tools import bag_info
    from heli_flight.terminal import console, table

    contents = bag_info(path)
    if as_json:
        print(json.dumps(asdict(contents), indent=2))
        return _short_of(contents.missing)
    out = console()
    shown = table(contents.path, out)
    for name in ("topic", "type"):
        shown.add_column(name, no_wrap=True)
    for name in ("messages", "rate, 1/s"):
        shown.add_column(name, justify="right")
    shown.add_column("QoS")
    for row in contents.topics:
        qos = f"{row.reliability}, {row.durability}" if row.reliability else ""
        shown.add_row(row.topic, row.type, str(row.messages), f"{row.rate_hz:.4g}", qos)
    out.print(shown)
    for row in contents.topics:
        if row.unreadable:
            print(_shown(f"cannot be read: {row.topic}: {row.unreadable}"))
    out.print(
        f"{contents.messages} messages in {contents.duration_s:.2f} s "
        f"from {contents.start_s:.2f} s; "
        f"{len(contents.files)} {contents.storage} file(s), {contents.size_bytes / 1e6:.2f} MB"
    )
    if len(contents.flights) > 1:
        spans = ", ".join(f"{start:.2f} s to {end:.2f} s" for start, end in contents.flights)
        print(f"its clock goes back: {len(contents.flights)} flights: {spans}")
    return _short_of(contents.missing)


@bag.command(
    "echo",
    epilog="\b\nexample:\n  heli bag echo flights/my_flight odom --count 1\n"
    "  heli bag echo rosbag2_2026_11_21 /imu/data_raw --json > imu.jsonl",
)
def echo_bag(
    path: Bag,
    topic: Annotated[str, typer.Argument(metavar="TOPIC", help="name, with or without the slash")],
    count: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="stop after N messages")
    ] = None,
    full: Annotated[bool, typer.Option("--full", help="do not shorten long arrays")] = False,
    flight: FlightNumber = None,
    as_json: Annotated[bool, typer.Option("--json", help="one line of JSON per message")] = False,
) -> int:
    """Print a topic's messages."""
    from heli_bags.tools import as_json as json_line
    from heli_bags.tools import as_yaml, bag_messages

    shortfall: list[str] = []
    for _, _, stamp_ns, message in bag_messages(path, [topic], count, flight, shortfall):
        print(json_line(message, stamp_ns=stamp_ns) if as_json else as_yaml(message, full))
    return _short_of(shortfall)


@bag.command(
    epilog="\b\nexample:\n  heli bag play flights/my_flight --rate 2 --topic imu/data_raw\n"
    "  heli bag play flights/my_flight --exclude odom --start 5 --loop"
)
def play(
    path: Bag,
    rate: Annotated[
        float, typer.Option(min=0.001, max=1000.0, metavar="R", help="times as fast as recorded")
    ] = 1.0,
    start: Annotated[
        float, typer.Option(min=0.0, metavar="S", help="begin so long after the first message")
    ] = 0.0,
    duration: Annotated[
        float | None, typer.Option(min=0.001, metavar="S", help="stop after so much bag time")
    ] = None,
    topic: Topics = None,
    exclude: Annotated[
        list[str] | None,
        typer.Option("--exclude", metavar="TOPIC", help="leave this topic out; repeatable"),
    ] = None,
    loop: Annotated[bool, typer.Option("--loop", help="begin again until Ctrl-C")] = False,
    clock: Annotated[
        float,
        typer.Option(
            "--clock",
            min=0.0,
            max=10000.0,
            metavar="HZ",
            help="rate of /clock if the bag holds none; 0: no clock",
        ),
    ] = float(TICKS_PER_S),
    flight: FlightNumber = None,
    as_json: Json = False,
) -> int:
    """Publish a bag's messages as they were recorded, with /clock."""
    from heli_bags.opening import bag_of, require_whole
    from heli_bags.player import PlayChoice, Player
    from heli_flight.graph.nodes import ros_node
    from heli_flight.terminal import amount

    require_whole(bag_of(path))
    choice = PlayChoice(rate, start, duration, topic or [], exclude or [], loop, clock, flight)
    with ros_node("heli_bag_play") as node, amount("seconds") as progress:
        player = Player(node, path, choice, lambda done, total: progress(int(done), int(total)))
        played = player.run()
    if as_json:
        print(json.dumps(played, indent=2))
    else:
        print(f"played: {sum(played.values())} messages of {len(played)} topics")
    return _short_of(player.shortfall)


@bag.command(epilog="\b\nexample:\n  heli bag csv flights/my_flight --topic odom --out tables")
def csv(
    path: Bag,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="folder to make, one file per topic")
    ],
    topic: Topics = None,
    flight: FlightNumber = None,
    as_json: Json = False,
) -> int:
    """Write topics as CSV tables: stamp, then one column per field."""
    from heli_bags.opening import opened
    from heli_bags.tools import readable, write_csv
    from heli_flight.terminal import amount, being_filled, refuse_existing

    refuse_existing(out)
    shortfall: list[str] = []
    with opened(path, flight) as reader:
        readable(reader, path, topic or [])
    with being_filled(out), amount("messages") as progress:
        rows = write_csv(path, out, topic or [], progress, flight, shortfall)
    if as_json:
        print(json.dumps({str(out / name): count for name, count in rows.items()}, indent=2))
    else:
        print(f"written: {out} ({len(rows)} tables, {sum(rows.values())} rows)")
    return _short_of(shortfall)


@bag.command(
    epilog="\b\nexample:\n  heli bag ulog flights/my_flight\n"
    "  heli bag ulog flights/my_flight --out my_flight.ulg"
)
def ulog(
    path: Bag,
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="file to make (default: flight.ulg beside it)"),
    ] = None,
    flight: FlightNumber = None,
    as_json: Json = False,
) -> int:
    """Write a flight as ULog, for PX4 Flight Review and PlotJuggler."""
    from heli_core.folders import write_whole
    from heli_flight.report.write import BagChoice, recorded, ulog_of
    from heli_flight.terminal import refuse_existing

    refuse_existing(out)
    recording = recorded(path, BagChoice(flight=flight))
    # Without --out it is made anew, as a report is.
    written = out or recording.folder / "flight.ulg"
    content = ulog_of(recording)
    written.parent.mkdir(parents=True, exist_ok=True)
    write_whole(written, content)
    if as_json:
        print(json.dumps({"ulog": str(written), "bytes": len(content)}))
        return 0
    for note in recording.bag_notes:
        print(f"note: {note}")
    print(f"written: {written} ({len(content) / 1e6:.2f} MB)")
    return 0


@bag.command(
    epilog="\b\nexample:\n  heli bag repair flights/my_flight/bag\n"
    "  heli bag repair flights/my_flight/bag --in-place; heli report flights/my_flight"
)
def repair(
    path: Bag,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="DIR", help="new bag (default: BAG_repaired)")
    ] = None,
    in_place: Annotated[
        bool, typer.Option("--in-place", help="keep the damaged one as BAG_damaged instead")
    ] = False,
    as_json: Json = False,
) -> int:
    """Restore a bag that was cut off or never closed; the damaged one is kept.

    Exit code 1: messages that it counts are lost.
    """
    from heli_bags.opening import bag_of
    from heli_bags.repair import repair as restore
    from heli_flight.terminal import amount

    with amount("messages") as progress:
        done = restore(bag_of(path), out, in_place, progress)
    if as_json:
        print(json.dumps({"repaired": done is not None, **(done.as_dict() if done else {})}))
        return _SHORT if done and not done.is_whole else 0
    if done is None:
        print(f"{bag_of(path)}: nothing to repair")
        return 0
    print(f"{done.source}: {done.trouble}")
    what = f"{done.messages} messages of {len(done.counts)} topics"
    print(f"restored: {what}, {done.duration_s:.2f} s")
    if done.lost_bytes:
        print(f"lost: {done.lost_bytes} bytes at the end hold no complete message")
    if done.damaged_chunks:
        print(f"lost: {done.damaged_chunks} chunks whose content is damaged")
    if done.nameless:
        print(f"lost: {done.nameless} messages of no topic of the bag")
    if done.missing:
        lost = ", ".join(f"{_shown(name)} {number}" for name, number in done.missing.items())
        print(f"lost: {sum(done.missing.values())} messages that metadata.yaml counts: {lost}")
    for note in done.notes:
        print(f"note: {note}")
    print(f"written: {done.folder}; the damaged bag is kept in {done.source}")
    return 0 if done.is_whole else _SHORT
