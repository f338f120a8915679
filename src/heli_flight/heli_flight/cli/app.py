# SPDX-License-Identifier: Apache-2.0
"""The command `heli`: hover, replay, campaign, design, identify, compare, report, score, diff, bag,
echo, topics, fault, joy, results, run, python.

A sub-command imports what it needs when it runs, so that help and completion are quick.
"""

import os
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from heli_flight import interrupts
from heli_flight.cli.bag import bag
from heli_flight.cli.campaign import campaigns
from heli_flight.cli.campaign_rare import RARE_EPILOG, WORST_EPILOG, rare, worst
from heli_flight.cli.campaign_report import REPORT_EPILOG, campaign_report
from heli_flight.cli.compare import compare
from heli_flight.cli.diff import EPILOG as DIFF_EPILOG
from heli_flight.cli.diff import diff
from heli_flight.cli.fault import fault
from heli_flight.cli.graph import graph
from heli_flight.cli.hover import epilog, hover
from heli_flight.cli.identify import EPILOG, identify
from heli_flight.cli.joy import EPILOG as JOY_EPILOG
from heli_flight.cli.joy import joy
from heli_flight.cli.options import (
    Aircraft,
    Figures,
    Json,
    Laws,
    Params,
    RecordedGps,
    RecordedScenario,
)
from heli_flight.cli.programs import programs
from heli_flight.cli.replay import EPILOG as REPLAY_EPILOG
from heli_flight.cli.replay import replay
from heli_flight.cli.results import results
from heli_flight.cli.run import run
from heli_flight.cli.score import EPILOG as SCORE_EPILOG
from heli_flight.cli.score import score

app = typer.Typer(
    name="heli",
    help="Autonomous hover of a small helicopter: fly, design, identify, compare, report.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    epilog="heli COMMAND --help shows a command's options and an example.\n\n"
    "exit code: 0 done, 1 a flight outside the paper's figures or lost, 2 bad input (one line), "
    "130 interrupted",
)
app.add_typer(compare, name="compare")
app.add_typer(bag, name="bag")
app.add_typer(campaigns, name="campaign")
campaigns.command("report", epilog=REPORT_EPILOG)(campaign_report)
campaigns.command(epilog=RARE_EPILOG)(rare)
campaigns.command(epilog=WORST_EPILOG)(worst)
app.add_typer(fault)
app.add_typer(graph)
app.add_typer(programs)
app.add_typer(results, name="results")
app.command(epilog=EPILOG)(identify)
app.command(epilog=JOY_EPILOG)(joy)
app.command(epilog=epilog("heli hover"))(hover)
app.command(epilog=REPLAY_EPILOG)(replay)
app.command(epilog=SCORE_EPILOG)(score)
app.command(epilog=DIFF_EPILOG)(diff)


@app.command(
    epilog="\b\nexample:\n  heli design --params weights.yaml --gamma-factor 1.2 --out my_design\n"
    "  heli hover --params my_design/design.yaml"
)
def design(
    params: Params = None,
    aircraft: Aircraft = None,
    gamma: Annotated[
        float | None, typer.Option(metavar="G", help="bound on the norm (default: the parameter)")
    ] = None,
    gamma_factor: Annotated[
        float | None, typer.Option(metavar="K", help="bound as a multiple of gamma*, such as 1.2")
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
    from heli_flight.studies.design.make import make_design, write_yaml
    from heli_flight.studies.design.report import as_dict, print_design
    from heli_flight.terminal import (
        answer,
        being_filled,
        console,
        json_text,
        refuse_existing,
        steps,
    )

    refuse_existing(out)
    with steps("design", 2 if out else 1) as progress:
        made = make_design(params or [], aircraft, gamma, gamma_factor, search or check)
        progress(1)
        if out is not None:
            from heli_flight.studies.design.pictures import draw_all

            with being_filled(out):
                write_yaml(made, out / "design.yaml")
                draw_all(made, out)
                (out / "design.json").write_text(json_text(as_dict(made)), encoding="utf-8")
            progress(2)
    if check:
        from heli_flight.studies.design.check import differences

        found = differences(made, params or [])
        for line in found or ["the packaged YAML holds what the searches yield"]:
            console().print(line, soft_wrap=True, markup=False)
        return 1 if found else 0
    written = f"written: {out} (fly it: heli hover --params {out}/design.yaml)" if out else ""
    return answer(as_dict(made), as_json, partial(print_design, made), written)


@app.command(
    epilog="\b\nexample:\n  heli robust --out proof\n"
    "  heli robust --laws paper --fly --params ranges.yaml"
)
def robust(
    laws: Laws = None,
    params: Params = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="folder for robust.json and box.png; must not exist"),
    ] = None,
    fly: Annotated[
        bool,
        typer.Option("--fly", help="fly the worst aircraft found, in the nonlinear simulation"),
    ] = False,
    as_json: Json = False,
) -> int:
    """Prove the attitude loop stable for every aircraft of a set (section robust of a file)."""
    # The matrices are small: threads of the linear algebra only cost time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from heli_flight.loop.settings import resolve
    from heli_flight.studies.robust import prove
    from heli_flight.studies.robust.parameter_table import read_ranges
    from heli_flight.terminal import answer, being_filled, json_text, refuse_existing, steps

    refuse_existing(out)
    asked = read_ranges(params or [])
    settings = resolve(params=params or [], laws=laws).at_100_hz("heli robust")
    with steps("delays", len(asked.delays_ticks)) as progress:
        proof = prove.prove(settings, asked, progress, fly)
    if out is not None:
        with being_filled(out):
            prove.draw(proof, out / "box.png")
            (out / "robust.json").write_text(json_text(prove.as_dict(proof)), encoding="utf-8")
    written = f"written: {out}" if out else ""
    return answer(prove.as_dict(proof), as_json, partial(prove.print_proof, proof), written)


@app.command(
    epilog="\b\nexample:\n  heli report flights/my_flight --figures --pdf\n"
    "  heli report rosbag2_2026_11_21 --params my.yaml\n\n"
    "exit code: 0 written, 1 written, but its ground truth is not what the plant sent, 2 bad input "
    "(one line)"
)
def report(
    bag: Annotated[Path, typer.Argument(help="rosbag2 folder, or the folder of a flight")],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="folder to write (default: beside the bag)")
    ] = None,
    scenario: RecordedScenario = None,
    gps: RecordedGps = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", help="seed of the flight, for its conditions")
    ] = None,
    params: Params = None,
    figures: Figures = False,
    pdf: Annotated[
        bool, typer.Option("--pdf", help="also report.pdf: the page, printed by a Chromium")
    ] = False,
    as_json: Json = False,
) -> int:
    """Write report.html, the flight beside the paper's figures, of a recorded flight."""
    from heli_flight.report import STEPS, Choice, recorded, report_of
    from heli_flight.report.pdf import printer, write_pdf
    from heli_flight.terminal import in_turn, json_text

    choice = Choice(scenario, gps, seed, params or [])
    program = printer() if pdf else ""
    with in_turn() as tell:
        tell("report", 0, STEPS)
        flight = recorded(bag, choice)
        tell("report", 1, STEPS)
        page = report_of(flight, out, figures, partial(tell, "figures"))
        if not figures:
            tell("report", STEPS, STEPS)
        printed = None
        if pdf:
            tell("pdf", 0, 1)
            printed = write_pdf(page, program)
            tell("pdf", 1, 1)
    result = flight.result
    if as_json:
        drawn = sorted(str(path) for path in (page.parent / "figures").iterdir()) if figures else []
        content = {"report": str(page), "figures": drawn, "forged": result.forged}
        content |= {"pdf": str(printed)} if printed else {}
        print(json_text(content), end="")
        return 1 if result.forged else 0
    if result.forged:
        print(f"FORGED: {result.forged}")
    for written in filter(None, (page, printed)):
        print(f"written: {written}")
    return 1 if result.forged else 0


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code: 2 and one line on stderr for bad input."""
    return run(app, argv, "heli")


if __name__ == "__main__":
    sys.exit(interrupts.run(lambda: main))
