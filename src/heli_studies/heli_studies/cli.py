# SPDX-License-Identifier: Apache-2.0
"""What studies add to the command `heli`: compare, campaign, design, identify, log, robust, score,
tune.

Each command imports what it needs when it runs.
"""

import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from heli_core.folders import write_whole
from heli_flight.cli import common
from heli_flight.cli.common import (
    Aircraft,
    AttitudeController,
    CommandWithRenamed,
    ControlPreset,
    Gps,
    Json,
    Params,
)
from heli_studies.cli_campaign import (
    RARE_EPILOG,
    REPORT_EPILOG,
    WORST_EPILOG,
    campaign_report,
    campaigns,
    rare,
    worst,
)
from heli_studies.cli_compare import compare
from heli_studies.tune_command import TUNE_EPILOG, tune

if TYPE_CHECKING:
    from heli_flight.settings import Settings

# -------------------------------------------------------------------------------------------------
# `heli identify` on the command line.
# -------------------------------------------------------------------------------------------------

RotorStructure = Annotated[
    str,
    typer.Option(
        "--structure",
        metavar="NAME",
        help="of the model: full, or quasi_static_rotor, without flapping states",
    ),
]
YawGyro = Annotated[
    bool, typer.Option("--yaw-gyro/--no-yaw-gyro", help="whether the model has a yaw gyro")
]

IDENTIFY_EPILOG = (
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
    flight: common.FlightNumber = None,
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
    method: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="of A, B and servos: frequency, or output_error, in the time domain from there on",
        ),
    ] = "frequency",
    structure: RotorStructure = "full",
    yaw_gyro: YawGyro = True,
    params: Params = None,
    as_json: Json = False,
) -> int:
    """Identify the aircraft from flight: A, B, E, servos, trims; design its controllers."""
    # The matrices are small: threads of the linear algebra only cost time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from heli_flight.terminal import console
    from heli_studies import identify as command
    from heli_studies.identify_methods import method_of, structure_of
    from heli_studies.identify_report import execute

    wanted = command.IdentifyOrder(
        actuators, gusts, aircraft, params or [], seed, gps, gamma_factor, one_process,
        flight=flight, method=method_of(method), structure=structure_of(structure, yaw_gyro),
    )  # fmt: skip
    outcome = execute(wanted, out)
    if as_json:
        print((out / command.JSON).read_text(encoding="utf-8"), end="")
    else:
        command.print_outcome(outcome, console())
        console().print(f"written: {out} (fly it: heli hover --params {out}/identified.yaml)")
    return command.fly_hover(wanted, out, console(stderr=as_json)) if hover_after else 0


# -------------------------------------------------------------------------------------------------
# `heli score` on the command line.
# -------------------------------------------------------------------------------------------------

SCORE_EPILOG = (
    "\b\nexample:\n  heli score flights/my_flight --mte hover --plot hover.png\n"
    "  heli score rosbag2_2026_11_21 --odom /mavros/odom --mte vertical --start 12 --end 60\n"
    "  heli score flights/my_sweep --response --axis pitch --plot bode.svg\n\n"
    "exit code: 0 desired or adequate and flown as defined (Level 1 or 2), 1 neither, not flown as "
    "defined, not all of it recorded, or ground truth that is not what the plant sent, 2 bad input "
    "(one line)"
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
            autocompletion=common.manoeuvres,
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
        str | None,
        typer.Option(
            metavar="SCALE",
            help="bounds: full, or froude for a small rotor (default: of a manoeuvre that "
            "params.yaml says, its own; else full)",
        ),
    ] = None,
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
    which: common.FlightNumber = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="picture to write: .png, .svg or .pdf")
    ] = None,
    as_json: Json = False,
) -> int:
    """Score a recorded flight: a mission task element of ADS-33E-PRF, or a response."""
    from heli_core.rcl_yaml import ParameterError
    from heli_flight.terminal import answer, told_at_terminal
    from heli_studies.handling import ScoreOrder, print_score, score_manoeuvre

    if (mte is None) is not response:
        raise ParameterError("name one of --mte NAME and --response")
    if plot is not None:
        from heli_studies.handling import check_picture

        check_picture(plot)
    wanted = ScoreOrder(flight, odom, start, end, target, ground, which)
    written = f"written: {plot}" if plot else ""
    if mte is None:
        from heli_studies import handling as swept

        with told_at_terminal("heli score") as tell:
            tell(f"response in {flight}")
            swept_response = swept.score_response(
                wanted, axis, command, disturbance, scale, rotor_diameter
            )
        if plot is not None:
            swept.draw_response(swept_response, plot)
        show = partial(swept.print_response, swept_response)
        answer(swept_response.as_dict(flight), as_json, show, written)
        return swept_response.exit_code
    with told_at_terminal("heli score") as tell:
        tell(f"manoeuvre in {flight}")
        scored = score_manoeuvre(wanted, mte, scale, rotor_diameter)
    if plot is not None:
        from heli_studies.handling import draw_score

        draw_score(scored.track, scored.score, plot)
    answer(scored.as_dict(flight), as_json, partial(print_score, scored), written)
    return scored.exit_code


# -------------------------------------------------------------------------------------------------
# The commands `heli design` and `heli robust`.
# -------------------------------------------------------------------------------------------------

DESIGN_EPILOG = (
    "\b\nexample:\n  heli design --params weights.yaml --gamma-factor 1.2 --out my_design\n"
    "  heli hover --params my_design/design.yaml\n"
    "  heli design --identified my_aircraft --gamma-factor 1.3 --out my_design"
)


def design(
    params: Params = None,
    aircraft: Aircraft = None,
    identified: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="model that `heli identify` wrote, or its folder, as the aircraft"
        ),
    ] = None,
    controller: AttitudeController = None,
    gamma: Annotated[
        float | None,
        typer.Option(
            metavar="G",
            help="bound on the norm of the controller that flies, hinf_output or hinf (default: "
            "the parameter output.gamma or gamma)",
        ),
    ] = None,
    gamma_factor: Annotated[
        float | None,
        typer.Option(metavar="K", help="bound as a multiple of its gamma*, such as 1.2"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="folder for design.yaml and pictures; must not exist"),
    ] = None,
    search: Annotated[
        bool, typer.Option(help="search for output's weights and the position loop's gains, too")
    ] = False,
    check: Annotated[
        bool,
        typer.Option(help="search, and say where the packaged YAML holds something else (code 1)"),
    ] = False,
    as_json: Json = False,
) -> int:
    """Design the loops of an aircraft: certificate, margins, gains, pictures, YAML."""
    # The matrices are small: threads of the linear algebra only cost time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from heli_core.rcl_yaml import ParameterError
    from heli_flight.terminal import (
        answer,
        being_filled,
        console,
        json_text,
        refuse_existing,
        steps,
    )
    from heli_studies.design.identified import design_of_identified
    from heli_studies.design.make import make_design, write_yaml
    from heli_studies.design.report import as_dict, print_design

    refuse_existing(out)
    if identified is not None and (aircraft is not None or search or check):
        raise ParameterError("--identified: goes with none of --aircraft, --search, --check")
    with steps("design", 2 if out else 1) as progress:
        if identified is not None:
            made = design_of_identified(identified, params or [], gamma, gamma_factor, controller)
        else:
            made = make_design(
                params or [], aircraft, gamma, gamma_factor, search or check, controller
            )
        progress(1)
        if out is not None:
            from heli_studies.design.report import draw_all

            with being_filled(out):
                write_yaml(made, out / "design.yaml")
                draw_all(made, out)
                write_whole(out / "design.json", json_text(as_dict(made)))
            progress(2)
    for remark in made.remarks:
        console(stderr=True).print(remark, highlight=False, soft_wrap=True, markup=False)
    if check:
        from heli_studies.design.make import differences

        differing = differences(made, params or [])
        for line in differing or ["the packaged YAML holds what the searches yield"]:
            console().print(line, soft_wrap=True, markup=False)
        return 1 if differing else 0
    written = f"written: {out} (fly it: heli hover --params {out}/design.yaml)" if out else ""
    return answer(as_dict(made), as_json, partial(print_design, made), written)


ROBUST_EPILOG = (
    "\b\nexample:\n  heli robust --out proof\n"
    "  heli robust --control-preset paper --fly --params ranges.yaml\n"
    "  heli robust --aircraft blade360"
)


def robust(
    laws: ControlPreset = None,
    params: Params = None,
    aircraft: Annotated[
        str | None,
        typer.Option(
            metavar="NAMES",
            help="published linear aircraft, with the controllers designed for each: all, or "
            "names with commas between",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="folder for robust.json and, of an aircraft file, box.png; must not exist",
        ),
    ] = None,
    fly: Annotated[
        bool,
        typer.Option("--fly", help="fly the worst aircraft found, in the nonlinear simulation"),
    ] = False,
    as_json: Json = False,
) -> int:
    """Prove the attitude loop stable for every aircraft of a set (section robust of a file).

    Of a linear aircraft: margins, and entries of A and B up to 30 % off, sampled.
    """
    # The matrices are small: threads of the linear algebra only cost time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from heli_core.rcl_yaml import ParameterError
    from heli_flight.settings import resolve
    from heli_flight.terminal import answer, being_filled, json_text, refuse_existing, steps
    from heli_studies import robust as prove
    from heli_studies.robust import read_ranges

    refuse_existing(out)
    if aircraft is not None and (params or laws or fly):
        raise ParameterError("--aircraft: goes with none of --params, --control-preset, --fly")
    if aircraft is not None:
        from heli_studies.published import names_of

        return _robust_linear(names_of(aircraft), None, out, as_json)
    asked = read_ranges(params or [])
    settings = resolve(params=params or [], laws=laws).at_100_hz("heli robust")
    if settings.nodes["plant"]["linear_model"]:
        if fly:
            raise ParameterError("--fly: flies an aircraft file; the plant is a linear aircraft")
        return _robust_linear([], settings, out, as_json)
    with steps("delays", len(asked.delays_ticks)) as progress:
        proof = prove.prove(settings, asked, progress, fly)
    if out is not None:
        with being_filled(out):
            prove.draw(proof, out / "box.png")
            write_whole(out / "robust.json", json_text(prove.as_dict(proof)))
    written = f"written: {out}" if out else ""
    return answer(prove.as_dict(proof), as_json, partial(prove.print_proof, proof), written)


def _robust_linear(
    names: list[str], settings: "Settings | None", out: Path | None, as_json: bool
) -> int:
    """Of packaged names with what is designed for them, or of the settings' own."""
    from heli_flight.terminal import answer, being_filled, json_text
    from heli_studies.robust_linear import as_dict, judged, print_robustness, robustness_of

    found = robustness_of(names) if settings is None else [judged(settings)]
    content = {"rows": [as_dict(one) for one in found]}
    if out is not None:
        with being_filled(out):
            write_whole(out / "robust.json", json_text(content))
    written = f"written: {out}" if out else ""
    return answer(content, as_json, partial(print_robustness, found), written)


# -------------------------------------------------------------------------------------------------
# `heli log`: logs of others.
# -------------------------------------------------------------------------------------------------

logs = typer.Typer(
    help="Look into a flight log of others: ArduPilot, PX4, CSV, MATLAB, ROS 2 bags.",
    no_args_is_help=True,
    rich_markup_mode=None,
    epilog="\b\nexample:\n  heli log info 00000012.BIN --plot log.png",
)

LOG_EPILOG = (
    "\b\nexample:\n  heli log info 00000012.BIN --plot log.png\n"
    "  heli log info flight.csv --map columns.yaml --json\n"
    "  heli log info rosbag2_2026_11_21 --map topics.yaml\n\n"
    "exit code: 0 read, whatever can be identified from it, 2 bad input (one line)"
)


Log = Annotated[
    Path,
    typer.Argument(
        metavar="LOG", help=".bin (ArduPilot), .ulg (PX4), .csv, .mat, rosbag2, a flight"
    ),
]
LogColumns = Annotated[
    Path | None,
    typer.Option(
        "--map",
        metavar="FILE",
        help="YAML file: which column is which signal, its unit and sign; for .csv, .mat and "
        "bags of others",
    ),
]
LogStart = Annotated[
    float | None, typer.Option("--start", metavar="S", help="from here on, since the first row")
]
LogEnd = Annotated[
    float | None, typer.Option("--end", metavar="S", help="up to here, since the first row")
]


@logs.command("info", epilog=LOG_EPILOG)
def log_info(
    log: Log,
    columns: LogColumns = None,
    start: LogStart = None,
    end: LogEnd = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="FILE", help="picture to write: .png, .svg or .pdf")
    ] = None,
    as_json: Json = False,
) -> int:
    """Show what a log holds, what was excited, and what can be identified from it."""
    from heli_flight.terminal import answer, told_at_terminal
    from heli_studies.logs.info import cropped, info_of
    from heli_studies.logs.read import read_log
    from heli_studies.logs.show import draw_info, print_info

    if plot is not None:
        from heli_studies.handling import check_picture

        check_picture(plot)
    with told_at_terminal("heli log") as tell:
        tell(f"reads {log}")
        rows = cropped(read_log(log, columns), start, end)
        tell("excitation and responses")
        info = info_of(rows)
        if plot is not None:
            draw_info(info, plot)
    written = f"written: {plot}" if plot else ""
    return answer(info.as_dict(), as_json, partial(print_info, info), written)


@logs.command(
    "identify",
    epilog="\b\nexample:\n  heli log identify 00000012.BIN --out model\n\n"
    "exit code: 0 read, whatever was identified (the JSON names what was not and why), 2 bad "
    "input (one line)",
)
def log_identify(
    log: Log,
    columns: LogColumns = None,
    start: LogStart = None,
    end: LogEnd = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", help="folder for model.json, responses.csv, bode.png; must not exist"
        ),
    ] = None,
    structure: RotorStructure = "full",
    yaw_gyro: YawGyro = True,
    as_json: Json = False,
) -> int:
    """Identify each axis from a log: gain, pole, delay, feed-forward; A and B where it allows."""
    # The matrices are small: threads of the linear algebra only cost time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from heli_flight.terminal import (
        answer,
        being_filled,
        json_text,
        refuse_existing,
        told_at_terminal,
    )
    from heli_studies.identify_methods import structure_of
    from heli_studies.logs.fit import draw_fit, fit_log, print_fit, responses_csv
    from heli_studies.logs.info import cropped, info_of
    from heli_studies.logs.read import read_log

    refuse_existing(out)
    wanted = structure_of(structure, yaw_gyro)
    with told_at_terminal("heli log") as tell:
        tell(f"reads {log}")
        rows = cropped(read_log(log, columns), start, end)
        tell("excitation, responses and fit")
        fitted = fit_log(info_of(rows), wanted)
        if out is not None:
            with being_filled(out):
                write_whole(out / "model.json", json_text(fitted.as_dict()))
                write_whole(out / "responses.csv", responses_csv(fitted.info))
                draw_fit(fitted, out / "bode.png")
    written = f"written: {out}" if out else ""
    return answer(fitted.as_dict(), as_json, partial(print_fit, fitted), written)


def add_to(app: typer.Typer) -> None:
    """Give the command `heli` what studies bring."""
    app.add_typer(compare, name="compare")
    app.add_typer(campaigns, name="campaign")
    campaigns.command("report", epilog=REPORT_EPILOG)(campaign_report)
    campaigns.command(epilog=RARE_EPILOG)(rare)
    campaigns.command(epilog=WORST_EPILOG)(worst)
    app.command(cls=CommandWithRenamed, epilog=DESIGN_EPILOG)(design)
    app.command(epilog=IDENTIFY_EPILOG)(identify)
    app.command(cls=CommandWithRenamed, epilog=ROBUST_EPILOG)(robust)
    app.command(epilog=SCORE_EPILOG)(score)
    app.command(epilog=TUNE_EPILOG)(tune)
    app.add_typer(logs, name="log")
