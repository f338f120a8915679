# SPDX-License-Identifier: Apache-2.0
"""The command `heli fault`: something breaks in the flight that is under way."""

import json
from typing import Annotated

import typer

fault = typer.Typer(rich_markup_mode=None)
_FORM = "heli fault WHAT KIND [VALUE ...], --list or --clear"


@fault.command(
    "fault",
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
    aircraft: Annotated[
        str, typer.Option(metavar="NAME", help="its namespace, where there are several")
    ] = "",
    timeout: Annotated[
        float, typer.Option(min=0.1, max=600.0, metavar="S", help="wait for the plant's answer")
    ] = 10.0,
    as_json: Annotated[bool, typer.Option("--json", help="print JSON")] = False,
) -> int:
    """Break a sensor or an actuator of the running flight, from now on; or send a gust."""
    given = [word for word in (what, kind, clear or None, shown or None) if word is not None]
    if given not in ([what, kind], [True]):
        raise ValueError(f"expected: {_FORM}")
    from heli_flight.graph.fault_setter import FaultSetter, fault_text
    from heli_flight.graph.ros_session import ros_node

    text = None if clear or shown else fault_text(str(what), str(kind), value or [], duration)
    with ros_node("heli_fault") as node:
        plant = FaultSetter(node, aircraft, timeout)
        if text is not None:
            plant.add(text)
        said = plant.clear() if clear else ""
        present = plant.present()
    if as_json:
        print(json.dumps({"faults": present}))
    else:
        print(said or "\n".join(present))
    return 0
