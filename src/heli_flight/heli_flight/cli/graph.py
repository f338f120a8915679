# SPDX-License-Identifier: Apache-2.0
"""The commands `heli echo` and `heli topics`, for those without the `ros2` command."""

import json
from dataclasses import asdict
from typing import Annotated

import typer

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
    from heli_bags.message_text import as_json as json_line
    from heli_bags.message_text import as_yaml
    from heli_flight.graph.ros_session import ros_node

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
    from heli_flight.graph.ros_session import ros_node
    from heli_flight.terminal import amount, console, table

    with ros_node("heli_topics") as node:
        found, discovery = list_topics(node, hidden, settle)
        if rate:
            with amount("seconds") as progress:
                found = measure(
                    node, found, seconds, lambda done: progress(int(done), int(seconds))
                )
    errors = console(stderr=True)
    errors.print(f"graph: {discovery} (--settle)")
    if as_json:
        print(json.dumps([asdict(row) for row in found], indent=2))
        return 0
    out = console()
    shown = table("", out)
    for name in ("topic", "type"):
        shown.add_column(name, no_wrap=True)
    for name in ("publishers", "subscribers", *(["rate, 1/s"] if rate else [])):
        shown.add_column(name, justify="right")
    for row in found:
        measured = "" if row.rate_hz is None else f"{row.rate_hz:.4g}"
        cells = [row.topic, row.type, str(row.publishers), str(row.subscribers)]
        shown.add_row(*cells, *([measured] if rate else []))
    out.print(shown)
    if not any(row.publishers for row in found):
        errors.print("no topics: does a flight run in this ROS_DOMAIN_ID?")
    return 0
