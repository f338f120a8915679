# SPDX-License-Identifier: Apache-2.0
"""The command `heli px4`: plant and sensors as the simulator of PX4's software in the loop."""

from pathlib import Path
from typing import Annotated

import typer

from heli_flight.cli.common import (
    Aircraft,
    AutopilotDuration,
    AutopilotLive,
    Faults,
    Gps,
    LivePort,
    NewFolder,
    NoReport,
    Params,
    WindSeed,
    World,
    live_order,
)

EPILOG = (
    "\b\nexample:\n  heli px4 --print-params > helion.params\n"
    "  heli px4 --world honest --seed 7    # then PX4's SITL without a simulator of its own\n\n"
    "exit code: 0 flown and written, 1 a helicopter was lost (named), 2 bad input (one line), "
    "130 ended before PX4 came"
)


def px4(
    aircraft: Aircraft = None,
    world: World = None,
    gps: Gps = None,
    seed: WindSeed = None,
    params: Params = None,
    faults: Faults = None,
    rate: Annotated[
        int, typer.Option(metavar="HZ", help="HIL_SENSOR a second: whole hundreds, 200 to 1000")
    ] = 400,
    port: Annotated[
        int,
        typer.Option(
            min=0,
            max=65535,
            metavar="PORT",
            help="TCP port on 127.0.0.1; PX4's instance N looks on 4560 + N; 0: any free one",
        ),
    ] = 4560,
    duration: AutopilotDuration = None,
    out: NewFolder = None,
    no_report: NoReport = False,
    live: AutopilotLive = False,
    live_port: LivePort = None,
    print_params: Annotated[
        bool,
        typer.Option(
            "--print-params",
            help="print PX4's parameters for the aircraft (a file for QGroundControl) and end",
        ),
    ] = False,
) -> int:
    """Let PX4 fly the helicopter: plant and sensors are its simulator (simulator_mavlink)."""
    from heli_flight import interrupts
    from heli_flight.px4.server import Px4Order, fly
    from heli_flight.px4.servos import file_text
    from heli_flight.terminal import console

    order = Px4Order(
        aircraft, rate, port, world, gps, seed, duration, params or (), faults, out, not no_report,
        live_order(live, live_port, not no_report),
    )  # fmt: skip
    if print_params:
        name = Path(order.resolved().nodes["plant"]["aircraft_file"]).stem
        print(file_text(order.parameters(), f"PX4 (helicopter, tail servo) on {name}"), end="")
        return 0
    flights = fly(order, console())
    if not flights:
        return interrupts.EXIT_CODE
    return int(any(flight.result.lost for flight in flights))
