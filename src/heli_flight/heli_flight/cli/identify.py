# SPDX-License-Identifier: Apache-2.0
"""`heli identify` on the command line."""

import os
from pathlib import Path
from typing import Annotated

import typer

from heli_flight.cli.options import Aircraft, Gps, Json, Params

EPILOG = (
    "\b\nexample:\n  heli identify --seed 7 --out my_aircraft --hover\n"
    "  heli identify --actuators bags/a --gusts bags/g --out my_aircraft\n"
    "  heli hover --params my_aircraft/identified.yaml"
)


def identify(
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="folder for all that is written; must not exist")
    ],
    actuators: Annotated[
        Path | None,
        typer.Option(metavar="BAG", help="bag of identify_actuators (default: fly it)"),
    ] = None,
    gusts: Annotated[
        Path | None, typer.Option(metavar="BAG", help="bag of identify_gusts (default: fly it)")
    ] = None,
    aircraft: Aircraft = None,
    seed: Annotated[int | None, typer.Option(metavar="N", help="seed of wind and sensors")] = None,
    gps: Gps = None,
    gamma_factor: Annotated[
        float | None,
        typer.Option(metavar="K", help="bound on the norm as a multiple of gamma*, such as 1.2"),
    ] = None,
    one_process: Annotated[
        bool, typer.Option("--one-process", help="fly in this process, without ROS and bags")
    ] = False,
    hover_after: Annotated[
        bool, typer.Option("--hover", help="then fly the hover test with what was identified")
    ] = False,
    params: Params = None,
    as_json: Json = False,
) -> int:
    """Identify the aircraft from flight: A, B, E, servos, trims; design observer and laws."""
    # The matrices are small: threads of the linear algebra only cost time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from heli_flight.studies.identify import command
    from heli_flight.terminal import console

    wanted = command.Wanted(
        actuators, gusts, aircraft, params or [], seed, gps, gamma_factor, one_process
    )
    outcome = command.execute(wanted, out)
    if as_json:
        print((out / command.JSON).read_text(encoding="utf-8"), end="")
    else:
        command.print_outcome(outcome, console())
        console().print(f"written: {out} (fly it: heli hover --params {out}/identified.yaml)")
    return command.fly_hover(wanted, out, console(stderr=as_json)) if hover_after else 0
