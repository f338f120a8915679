# SPDX-License-Identifier: Apache-2.0
"""The command `heli mavlink`: the simulated helicopter as a vehicle for ground stations."""

from typing import Annotated

import typer

from heli_flight.cli.common import Aircraft, Faults, Gps, Params, WindSeed, World, beginning

_AUTOPILOTS = ("generic", "px4")

EPILOG = (
    "\b\nexample:\n  heli mavlink --world honest --seed 7    # then, in another terminal:\n"
    "  mavproxy.py --master udp:127.0.0.1:14550\n\n"
    "exit code: 0 ended, 1 the helicopter was lost (named), 2 bad input (one line)"
)


def _autopilots(incomplete: str) -> list[str]:
    return beginning(incomplete, _AUTOPILOTS)


def mavlink(
    aircraft: Aircraft = None,
    world: World = None,
    gps: Gps = None,
    seed: WindSeed = None,
    params: Params = None,
    faults: Faults = None,
    port: Annotated[
        list[int] | None,
        typer.Option(
            min=1,
            max=65535,
            metavar="PORT",
            help="UDP port on 127.0.0.1 on which a station waits; repeatable (default: 14550)",
        ),
    ] = None,
    local_port: Annotated[
        int,
        typer.Option(
            "--local-port",
            min=0,
            max=65535,
            metavar="PORT",
            help="UDP port on 127.0.0.1 from which it sends; 0: any free one",
        ),
    ] = 0,
    system: Annotated[
        int, typer.Option("--system", min=1, max=250, metavar="ID", help="its MAVLink system id")
    ] = 1,
    autopilot: Annotated[
        str,
        typer.Option(
            "--autopilot",
            metavar="KIND",
            help="what it says it is: generic, or px4 for stations that offer take-off, go-to and "
            "modes by name only to firmware that they know",
            autocompletion=_autopilots,
        ),
    ] = "generic",
    speed: Annotated[
        float, typer.Option(metavar="X", help="times real time, to 100 at most")
    ] = 1.0,
    duration: Annotated[
        float | None,
        typer.Option(min=0.0, metavar="S", help="flight time after which it ends (default: never)"),
    ] = None,
) -> int:
    """Be a MAVLink vehicle: ground stations and MAVSDK see and fly the helicopter."""
    from heli_core.errors import ParameterError
    from heli_flight.fleet import design_file

    if autopilot not in _AUTOPILOTS:
        known = ", ".join(_AUTOPILOTS)
        raise ParameterError(f"--autopilot {autopilot}: unknown; known: {known}")
    from heli_flight.layers import ONE_PROCESS
    from heli_flight.mavlink.link import common
    from heli_flight.mavlink.server import MavlinkOrder, flight_order, fly
    from heli_flight.terminal import console

    kinds = (common.MAV_AUTOPILOT_GENERIC, common.MAV_AUTOPILOT_PX4)
    order = flight_order(
        None, [*design_file(aircraft), *(params or ())], world=world, gps=gps, seed=seed,
        faults=faults, mode=ONE_PROCESS,
    )  # fmt: skip
    lost = fly(
        MavlinkOrder(
            order,
            port or (14550,),
            system,
            kinds[_AUTOPILOTS.index(autopilot)],
            speed,
            duration,
            local_port,
        ),
        console(),
    )
    return int(bool(lost))
