# SPDX-License-Identifier: Apache-2.0
"""The command `heli replay`: a recorded flight on the live view's page."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from heli_flight.cli.options import Params, RecordedGps, RecordedScenario

EPILOG = (
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
) -> int:
    """Show a recorded flight in a browser: wind back and forth, slow, fast, from event to event."""
    from heli_flight.report.from_bag import Choice
    from heli_flight.studies.replay.opened import replay_of
    from heli_flight.studies.replay.serving import serve
    from heli_flight.terminal import amount

    with amount("replay") as progress:
        shown, beside = replay_of(flight, Choice(scenario, gps, None, params or []), progress)
    # At once, where there is no terminal, too: whoever waits for the address reads it.
    serve(shown, port, beside, partial(print, flush=True))
    return 0
