# SPDX-License-Identifier: Apache-2.0
"""Options that several commands of `heli` have, each written once."""

from pathlib import Path
from typing import Annotated

import typer

from heli_flight.cli import completion

EXIT_OF_FLIGHTS = (
    "exit code: 0 inside the paper's figures, 1 outside or helicopter lost (named), 2 bad input, "
    "130 interrupted. Judged are the scored windows alone (hover: 5 to 18 s and 25 s to the end, "
    "attitude: from 5 s on): the navigation record, with an RTK receiver ground truth, too. A "
    "flight that ends before the first of them is not judged (0). The figures of the whole "
    "flight, climb included, are given first and decide nothing."
)
Figures = Annotated[
    bool,
    typer.Option(
        "--figures", help="also figures/: each chart of the report as PNG and SVG, for a paper"
    ),
]
Params = Annotated[
    list[Path] | None,
    typer.Option(
        "--params", metavar="FILE", help="parameter file over any node's YAML; repeatable"
    ),
]
Faults = Annotated[
    Path | None,
    typer.Option(
        "--faults",
        metavar="FILE",
        help="YAML file of faults of sensors, actuators and links, each with its time "
        "(default: the parameter file's, else none)",
    ),
]
Json = Annotated[bool, typer.Option("--json", help="print JSON instead of tables")]
Gps = Annotated[
    str | None,
    typer.Option(
        "--gps",
        metavar="PRESET",
        help="receiver: standalone or rtk (default: the parameter file's, else standalone)",
        autocompletion=completion.gps_presets,
    ),
]
World = Annotated[
    str | None,
    typer.Option(
        "--world",
        metavar="NAME",
        help="air, sensors and what the seed draws of the aircraft: paper, honest, hard, or a "
        "YAML file (default: the parameter file's, else honest for the hover test, else paper)",
        autocompletion=completion.worlds,
    ),
]
Laws = Annotated[
    str | None,
    typer.Option(
        "--laws",
        metavar="NAME",
        help="attitude law, position law and observer: packaged, paper, or a YAML file (default: "
        "the parameter file's, else packaged)",
        autocompletion=completion.laws,
    ),
]
ComparedLaws = Annotated[
    str,
    typer.Option(
        "--controllers",
        metavar="LAWS",
        help="hinf_output, hinf, hinf_offset_free, lqr, pid: any of them",
        autocompletion=completion.compared_laws,
    ),
]
Seeds = Annotated[
    str, typer.Option("--seeds", metavar="SEEDS", help="1..20, 7, 1,5,9 or 1..20,31..40")
]
ALL_LAWS = "hinf_output,hinf,hinf_offset_free,lqr,pid"
Duration = Annotated[
    float | None,
    typer.Option(
        metavar="S", help="length of a flight (default: the parameter file's, else the scenario's)"
    ),
]
RecordedScenario = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="what was flown (default: as recorded)",
        autocompletion=completion.scenarios,
    ),
]
RecordedGps = Annotated[
    str | None,
    typer.Option(
        metavar="PRESET",
        help="receiver (default: as recorded)",
        autocompletion=completion.gps_presets,
    ),
]
ScenarioName = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="what to fly: hover, attitude, attitude_gusts, figure_eight, orbit, waypoints, "
        "forward_flight, takeoff_land, by_hand, sequence, attitude_sweep, attitude_steps, "
        "attitude_disturbance, mte_hover, mte_vertical, mte_pirouette, "
        "mte_slalom, mte_lateral_reposition, mte_depart_abort, "
        "identify_actuators or identify_gusts (default: the parameter file's, else hover)",
        autocompletion=completion.scenarios,
    ),
]
AnyGps = Annotated[
    str | None,
    typer.Option(
        metavar="PRESET",
        help="receiver: standalone or rtk (default: the parameter file's, else both)",
        autocompletion=completion.gps_presets,
    ),
]
Aircraft = Annotated[
    str | None,
    typer.Option(
        metavar="FILE",
        help="aircraft file (default: the plant's)",
        autocompletion=completion.aircraft,
    ),
]
