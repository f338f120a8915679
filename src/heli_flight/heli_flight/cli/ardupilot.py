# SPDX-License-Identifier: Apache-2.0
"""The command `heli ardupilot`: the plant as the physics of ArduPilot's software in the loop."""

from pathlib import Path
from typing import Annotated

import typer

from heli_flight.cli.common import (
    Aircraft,
    AutopilotDuration,
    AutopilotLive,
    Faults,
    LivePort,
    NewFolder,
    NoReport,
    Params,
    WindSeed,
    World,
    beginning,
    live_order,
)

_PLATES = ("H3_120", "H3_140", "H1")
_IMU = ("true", "measured")

EPILOG = (
    "\b\nexample:\n  heli ardupilot --print-params > helion.parm\n"
    "  heli ardupilot --world honest --seed 7    # then, in another terminal:\n"
    "  arducopter-heli --model JSON:127.0.0.1 --defaults helion.parm\n\n"
    "exit code: 0 flown and written, 1 a helicopter was lost (named), 2 bad input (one line), "
    "130 ended before ArduPilot came"
)


def _plates(incomplete: str) -> list[str]:
    return beginning(incomplete, _PLATES)


def ardupilot(
    aircraft: Aircraft = None,
    world: World = None,
    seed: WindSeed = None,
    params: Params = None,
    faults: Faults = None,
    swash: Annotated[
        str,
        typer.Option(
            "--swash",
            metavar="TYPE",
            help=f"swashplate: {', '.join(_PLATES)}",
            autocompletion=_plates,
        ),
    ] = "H3_120",
    parm: Annotated[
        Path | None,
        typer.Option(
            "--parm",
            metavar="FILE",
            help="ArduPilot's parameters as it has loaded them, if its servos are not as "
            "--print-params says",
        ),
    ] = None,
    imu: Annotated[
        str,
        typer.Option(
            "--imu",
            metavar="KIND",
            help="rates and specific force that ArduPilot is told: true, or measured by our IMU "
            "with its noise, bias, vibration and faults",
        ),
    ] = "true",
    port: Annotated[
        int,
        typer.Option(
            min=0,
            max=65535,
            metavar="PORT",
            help="UDP port on 127.0.0.1, of instance 0; 0: any free one",
        ),
    ] = 9002,
    vehicles: Annotated[
        int,
        typer.Option(
            "--vehicles",
            min=1,
            metavar="N",
            help="so many, each for an instance of ArduPilot (-I 0, -I 1 ...): its port 10 higher, "
            "its own air, seed and folder",
        ),
    ] = 1,
    duration: AutopilotDuration = None,
    out: NewFolder = None,
    no_report: NoReport = False,
    live: AutopilotLive = False,
    live_port: LivePort = None,
    print_params: Annotated[
        bool,
        typer.Option(
            "--print-params",
            help="print ArduPilot's parameters for the aircraft (a .parm file) and end",
        ),
    ] = False,
) -> int:
    """Let ArduPilot fly the helicopter: our plant is the physics of its software in the loop."""
    from heli_core.rcl_yaml import ParameterError
    from heli_flight import interrupts
    from heli_flight.ardupilot.server import ArduPilotOrder, fly, helicopter_of
    from heli_flight.ardupilot.servos import file_text, parameters
    from heli_flight.terminal import console

    for name, value, known in (("--swash", swash, _PLATES), ("--imu", imu, _IMU)):
        if value not in known:
            raise ParameterError(f"{name} {value}: unknown; known: {', '.join(known)}")
    order = ArduPilotOrder(
        aircraft, swash, parm, imu == "measured", port, vehicles, world, seed, duration,
        params or (), faults, out, not no_report, live_order(live, live_port, not no_report),
    )  # fmt: skip
    if print_params:
        settings = order.resolved()
        helicopter = helicopter_of(settings)
        name = Path(settings.nodes["plant"]["aircraft_file"]).stem
        print(file_text(parameters(helicopter, swash), f"ArduPilot (heli) on {name}"), end="")
        return 0
    flights = fly(order, console())
    if not flights:
        return interrupts.EXIT_CODE
    return int(any(flight.result.lost for flight in flights))
