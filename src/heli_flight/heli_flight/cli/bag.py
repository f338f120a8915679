# SPDX-License-Identifier: Apache-2.0
"""The command `heli bag`: a sub-command imports what it needs."""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from heli_flight.cli.options import Json
from heli_math.ticks import TICKS_PER_S

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


@bag.command(epilog="\b\nexample:\n  heli bag info flights/my_flight --json")
def info(path: Bag, as_json: Json = False) -> int:
    """Show what a bag holds: topics, types, counts, rates, length, size."""
    from heli_bags.tools import bag_info
    from heli_flight.terminal import console, table

    found = bag_info(path)
    if as_json:
        print(json.dumps(asdict(found), indent=2))
        return 0
    out = console()
    shown = table(found.path, out)
    for name in ("topic", "type"):
        shown.add_column(name, no_wrap=True)
    for name in ("messages", "rate, 1/s"):
        shown.add_column(name, justify="right")
    shown.add_column("QoS")
    for row in found.topics:
        qos = f"{row.reliability}, {row.durability}"
        shown.add_row(row.topic, row.type, str(row.messages), f"{row.rate_hz:.4g}", qos)
    out.print(shown)
    out.print(
        f"{found.messages} messages in {found.duration_s:.2f} s from {found.start_s:.2f} s; "
        f"{len(found.files)} {found.storage} file(s), {found.size_bytes / 1e6:.2f} MB"
    )
    return 0


@bag.command(
    epilog="\b\nexample:\n  heli bag echo flights/my_flight odom --count 1\n"
    "  heli bag echo rosbag2_2026_11_21 /imu/data_raw --json > imu.jsonl"
)
def echo(
    path: Bag,
    topic: Annotated[str, typer.Argument(metavar="TOPIC", help="name, with or without the slash")],
    count: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="stop after N messages")
    ] = None,
    full: Annotated[bool, typer.Option("--full", help="do not shorten long arrays")] = False,
    as_json: Annotated[bool, typer.Option("--json", help="one line of JSON per message")] = False,
) -> int:
    """Print a topic's messages."""
    from heli_bags.message_text import as_json as json_line
    from heli_bags.message_text import as_yaml
    from heli_bags.tools import bag_messages

    for _, _, stamp_ns, message in bag_messages(path, [topic], count):
        print(json_line(message, stamp_ns=stamp_ns) if as_json else as_yaml(message, full))
    return 0


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
    as_json: Json = False,
) -> int:
    """Publish a bag's messages as they were recorded, with /clock."""
    from heli_bags.player import Choice, Player
    from heli_bags.tools import bag_of, require_whole
    from heli_flight.graph.ros_session import ros_node
    from heli_flight.terminal import amount

    require_whole(bag_of(path))
    choice = Choice(rate, start, duration, topic or [], exclude or [], loop, clock)
    with ros_node("heli_bag_play") as node, amount("seconds") as progress:
        player = Player(node, path, choice, lambda done, total: progress(int(done), int(total)))
        played = player.run()
    if as_json:
        print(json.dumps(played, indent=2))
        return 0
    print(f"played: {sum(played.values())} messages of {len(played)} topics")
    return 0


@bag.command(epilog="\b\nexample:\n  heli bag csv flights/my_flight --topic odom --out tables")
def csv(
    path: Bag,
    out: Annotated[
        Path, typer.Option("--out", metavar="DIR", help="folder to make, one file per topic")
    ],
    topic: Topics = None,
    as_json: Json = False,
) -> int:
    """Write topics as CSV tables: stamp, then one column per field."""
    from heli_bags.tools import chosen, opened, write_csv
    from heli_flight.terminal import amount, being_filled, refuse_existing

    refuse_existing(out)
    with opened(path) as reader:
        chosen(reader, path, topic or [])
    with being_filled(out), amount("messages") as progress:
        written = write_csv(path, out, topic or [], progress)
    if as_json:
        print(json.dumps({str(out / name): rows for name, rows in written.items()}, indent=2))
        return 0
    print(f"written: {out} ({len(written)} tables, {sum(written.values())} rows)")
    return 0


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
    as_json: Json = False,
) -> int:
    """Write a flight as ULog, for PX4 Flight Review and PlotJuggler."""
    from heli_flight.report.as_ulog import ulog_of
    from heli_flight.report.from_bag import recorded
    from heli_flight.terminal import refuse_existing

    refuse_existing(out)
    flight = recorded(path)
    # Without --out it is made anew, as a report is.
    written = out or flight.folder / "flight.ulg"
    content = ulog_of(flight)
    written.parent.mkdir(parents=True, exist_ok=True)
    written.write_bytes(content)
    if as_json:
        print(json.dumps({"ulog": str(written), "bytes": len(content)}))
        return 0
    print(f"written: {written} ({len(content) / 1e6:.2f} MB)")
    return 0


@bag.command(
    epilog="\b\nexample:\n  heli bag repair flights/my_flight/bag\n"
    "  heli bag repair flights/my_flight/bag --in-place && heli report flights/my_flight"
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
    """Restore a bag that was cut off or never closed; the damaged one is kept."""
    from heli_bags.repair import repair as restore
    from heli_bags.tools import bag_of
    from heli_flight.terminal import amount

    with amount("messages") as progress:
        done = restore(bag_of(path), out, in_place, progress)
    if as_json:
        print(json.dumps({"repaired": done is not None, **(done.as_dict() if done else {})}))
        return 0
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
    for note in done.notes:
        print(f"note: {note}")
    print(f"written: {done.folder}; the damaged bag is kept in {done.source}")
    return 0
