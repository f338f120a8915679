# SPDX-License-Identifier: Apache-2.0
"""`heli score` on the command line."""

from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from heli_flight.cli import completion
from heli_flight.cli.options import Json

EPILOG = (
    "\b\nexample:\n  heli score flights/my_flight --mte hover --plot hover.png\n"
    "  heli score rosbag2_2026_11_21 --odom /mavros/odom --mte vertical --start 12 --end 60\n"
    "  heli score flights/my_sweep --response --axis pitch --plot bode.svg\n\n"
    "exit code: 0 desired or adequate and flown as defined (Level 1 or 2), 1 neither, not flown as "
    "defined, or ground truth that is not what the plant sent, 2 bad input (one line)"
)


def score(
    flight: Annotated[
        Path, typer.Argument(metavar="FLIGHT", help="rosbag2 folder, its file, a flight's folder")
    ],
    mte: Annotated[
        str | None,
        typer.Option(
            "--mte",
            metavar="NAME",
            help="manoeuvre: hover, vertical, pirouette, slalom, lateral-reposition, depart-abort",
            autocompletion=completion.manoeuvres,
        ),
    ] = None,
    response: Annotated[
        bool,
        typer.Option("--response", help="bandwidth, phase delay, quickness instead, of a sweep"),
    ] = False,
    axis: Annotated[
        str, typer.Option(metavar="AXIS", help="of --response: roll, pitch or yaw")
    ] = "roll",
    command: Annotated[
        str | None,
        typer.Option(
            "--input",
            metavar="TOPIC:FIELD",
            help="what was swept for --response (default: attitude_setpoint)",
        ),
    ] = None,
    disturbance: Annotated[
        str | None,
        typer.Option(
            metavar="TOPIC:FIELD",
            help="rad, added to the measured attitude: --response gives disturbance rejection",
        ),
    ] = None,
    scale: Annotated[
        str, typer.Option(metavar="SCALE", help="bounds: full, or froude for a small rotor")
    ] = "full",
    rotor_diameter: Annotated[
        float | None,
        typer.Option(metavar="M", help="for --scale froude (default: the flight's aircraft)"),
    ] = None,
    odom: Annotated[
        str | None,
        typer.Option(
            metavar="TOPIC",
            help="nav_msgs/Odometry, ENU and FLU (default: our ground truth, else the only one)",
        ),
    ] = None,
    start: Annotated[
        float | None,
        typer.Option(
            metavar="S",
            help="from here on, since the first message (default: 3 s before the path that "
            "params.yaml says)",
        ),
    ] = None,
    end: Annotated[
        float | None, typer.Option(metavar="S", help="up to here, since the first message")
    ] = None,
    target: Annotated[
        tuple[float, float, float] | None,
        typer.Option(
            metavar="EAST NORTH UP",
            help="hover point, end of the course or centre of the circle, m (default: what "
            "the flight's params.yaml says, else from the flight)",
        ),
    ] = None,
    ground: Annotated[
        float, typer.Option(metavar="M", help="height of the ground in the topic's frame")
    ] = 0.0,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="picture to write: .png, .svg or .pdf")
    ] = None,
    as_json: Json = False,
) -> int:
    """Score a recorded flight: a mission task element of ADS-33E-PRF, or a response."""
    from heli_flight.studies.handling.command import Wanted, print_score, score_manoeuvre
    from heli_flight.terminal import answer
    from heli_parameters.parameters import ParameterError

    if (mte is None) is not response:
        raise ParameterError("name one of --mte NAME and --response")
    if plot is not None:
        from heli_flight.studies.handling.pictures import check_picture

        check_picture(plot)
    wanted = Wanted(flight, odom, start, end, target, ground)
    written = f"written: {plot}" if plot else ""
    if mte is None:
        from heli_flight.studies.handling import response as swept

        found = swept.score_response(wanted, axis, command, disturbance, scale, rotor_diameter)
        if plot is not None:
            swept.draw_response(found, plot)
        show = partial(swept.print_response, found)
        answer(found.as_dict(flight), as_json, show, written)
        return found.exit_code
    scored = score_manoeuvre(wanted, mte, scale, rotor_diameter)
    if plot is not None:
        from heli_flight.studies.handling.pictures import draw_score

        draw_score(scored.track, scored.score, plot)
    answer(scored.as_dict(flight), as_json, partial(print_score, scored), written)
    return scored.exit_code
