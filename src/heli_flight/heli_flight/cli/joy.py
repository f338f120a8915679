# SPDX-License-Identifier: Apache-2.0
"""The command `heli joy`: a joystick or a keyboard on the topic `joy`."""

import contextlib
import sys
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from heli_sticks.devices import Device, Reading

EPILOG = (
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
    from heli_sticks import keyboard as keys
    from heli_sticks.sdl_joystick import SdlJoystick, joystick_names

    if listed:
        names = joystick_names()
        for number, name in enumerate(names):
            print(f"{number}: {name}")
        if not names:
            print("no joystick found", file=sys.stderr)
        return 0
    found: Device
    if keyboard:
        found, help_text = keys.TerminalKeys(sys.stdin.fileno()), keys.HELP
    else:
        joystick = SdlJoystick(device)
        found, help_text = joystick, f"{joystick.name}, layout: {joystick.layout}; Ctrl-C ends"
    try:
        _send(found, help_text, rate, topic)
    finally:
        found.close()
    return 0


def _send(found: "Device", help_text: str, rate: float, topic: str) -> None:
    """Open a node and send until it ends."""
    from heli_flight.graph.joy_sender import send
    from heli_flight.graph.ros_session import ros_node
    from heli_flight.terminal import console
    from heli_msgs_bridge import topics
    from heli_msgs_bridge.joy_message import encode_joy

    with ros_node("heli_joy") as node:
        publisher = node.create_publisher(
            topics.message_class(topics.BY_NAME[topics.JOY].type), topic, topics.qos(topics.JOY, 10)
        )
        clock = node.get_clock()

        def publish(reading: "Reading") -> None:
            stamp_ns = clock.now().nanoseconds
            publisher.publish(encode_joy(reading.axes, reading.buttons, stamp_ns))

        console(stderr=True).print(help_text, soft_wrap=True, markup=False)
        with _teller() as told:
            send(found, publish, 1.0 / rate, told)


@contextlib.contextmanager
def _teller() -> Iterator[Callable[["Reading"], None]]:
    """Shows the newest reading in one line of the terminal, if there is one."""
    from heli_flight.graph.joy_sender import in_words
    from heli_flight.terminal import console

    out = console(stderr=True)
    if not out.is_terminal:
        yield lambda reading: None
        return
    with out.status("") as status:
        yield lambda reading: status.update(in_words(reading))
