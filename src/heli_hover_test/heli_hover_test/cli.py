# SPDX-License-Identifier: Apache-2.0
"""The command `heli`: hover, campaign, design, compare, report, bag.

A sub-command imports what it needs when it runs, so that help and completion are quick.
"""

import json
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer
from typer.exceptions import TyperException

from heli_hover_test import completion
from heli_hover_test.cli_bag import bag

EXIT_BAD_INPUT = 2
EXIT_INTERRUPTED = 130

app = typer.Typer(
    name="heli",
    help="Autonomous hover of a small helicopter: fly, design, compare, report.",
    no_args_is_help=True,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    epilog="heli COMMAND --help shows a command's options and an example.\n\n"
    "exit code: 0 done, 1 a flight outside the paper's figures or lost, 2 bad input (one line), "
    "130 interrupted",
)
compare = typer.Typer(
    help="Fly H-infinity, LQR and PID against each other.",
    no_args_is_help=True,
    rich_markup_mode=None,
    epilog="\b\nexample:\n  heli compare attitude --seeds 1..20",
)
app.add_typer(compare, name="compare")
app.add_typer(bag, name="bag")

Params = Annotated[
    list[Path] | None,
    typer.Option(
        "--params", metavar="FILE", help="parameter file over any node's YAML; repeatable"
    ),
]
Json = Annotated[bool, typer.Option("--json", help="print JSON instead of tables")]
Gps = Annotated[
    str,
    typer.Option(
        "--gps",
        metavar="PRESET",
        help="receiver: standalone or rtk",
        autocompletion=completion.gps_presets,
    ),
]
Laws = Annotated[
    str,
    typer.Option(
        "--controllers",
        metavar="LAWS",
        help="hinf, hinf_offset_free, lqr, pid: any of them",
        autocompletion=completion.compared_laws,
    ),
]
Seeds = Annotated[str, typer.Option("--seeds", metavar="SEEDS", help="1..20, 7 or 1,5,9")]
ALL_LAWS = "hinf,hinf_offset_free,lqr,pid"


@app.command(
    cls=completion.HoverCommand,
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    add_help_option=False,
    epilog="\b\nexample:\n  heli hover --scenario attitude --controller pid --seed 3",
)
def hover(context: typer.Context) -> int:
    """Fly the hover test or another scenario."""
    from heli_hover_test import hover_test

    return hover_test.main(context.args, prog="heli hover")


@app.command(
    epilog="\b\nexample:\n  heli campaign --seeds 1..20 --gps rtk --json > campaign.json\n\n"
    "exit code: 0 inside the paper's figures, 1 outside on a seed or helicopter lost, 2 bad input"
)
def campaign(
    seeds: Seeds = "1..20",
    scenario: Annotated[
        str,
        typer.Option(metavar="NAME", help="what to fly", autocompletion=completion.scenarios),
    ] = "hover",
    gps: Annotated[
        str | None,
        typer.Option(
            metavar="PRESET",
            help="receiver: standalone or rtk (default: both)",
            autocompletion=completion.gps_presets,
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option(metavar="S", help="length of a flight (default: scenario's)")
    ] = None,
    params: Params = None,
    as_json: Json = False,
) -> int:
    """Fly a scenario on many seeds in this process: largest value of each metric."""
    from heli_hover_test import campaign as many
    from heli_hover_test.settings import GPS_PRESETS, resolve
    from heli_hover_test.terminal import console, steps

    numbers, presets = many.parse_seeds(seeds), [gps] if gps else list(GPS_PRESETS)
    settings = {
        name: resolve(scenario, name, duration_s=duration, params=params or []) for name in presets
    }
    start, columns, done = time.monotonic(), {}, 0
    with steps("flights", len(numbers) * len(presets)) as progress:
        for name in presets:
            columns[name] = many.fly_seeds(
                settings[name], numbers, lambda n, done=done: progress(done + n)
            )
            done += len(numbers)
    code = max(f.exit_code(name) for name, flown in columns.items() for f in flown)
    if as_json:
        content = {"scenario": scenario, "seeds": numbers, "exit_code": code}
        print(_text(content | {"receivers": many.as_dict(columns, settings)}), end="")
        return code
    out = console()
    out.print(f"{scenario}, seeds {seeds}: largest magnitude over seeds", soft_wrap=True)
    out.print(many.table(columns, settings[presets[0]].scenario.kind), soft_wrap=True)
    for line in many.remarks(columns):
        out.print(line, soft_wrap=True, markup=False)
    out.print(f"{done} flights in {time.monotonic() - start:.1f} s")
    return code


@app.command(
    epilog="\b\nexample:\n  heli design --params weights.yaml --gamma-factor 1.2 --out my_design\n"
    "  heli hover --params my_design/design.yaml"
)
def design(
    params: Params = None,
    aircraft: Annotated[
        str | None,
        typer.Option(
            metavar="FILE",
            help="aircraft file (default: the plant's)",
            autocompletion=completion.aircraft,
        ),
    ] = None,
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
    as_json: Json = False,
) -> int:
    """Design the inner loop of an aircraft: certificate, margins, pictures, YAML."""
    # The matrices are small: threads of the linear algebra only cost time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from heli_hover_test.design import make_design, write_yaml
    from heli_hover_test.design_report import as_dict, print_design
    from heli_hover_test.terminal import console, new_folder, refuse_existing, steps

    refuse_existing(out)
    with steps("design", 2 if out else 1) as progress:
        made = make_design(params or [], aircraft, gamma, gamma_factor)
        progress(1)
        if out is not None:
            from heli_hover_test.design_pictures import draw_all

            new_folder(out)
            write_yaml(made, out / "design.yaml")
            draw_all(made, out)
            (out / "design.json").write_text(_text(as_dict(made)), encoding="utf-8")
            progress(2)
    if as_json:
        print(_text(as_dict(made)), end="")
        return 0
    print_design(made, console())
    if out is not None:
        console().print(f"written: {out} (fly it: heli hover --params {out}/design.yaml)")
    return 0


@app.command(
    epilog="\b\nexample:\n  heli report flights/my_flight\n"
    "  heli report rosbag2_2026_11_21 --params my.yaml"
)
def report(
    bag: Annotated[Path, typer.Argument(help="rosbag2 folder, or the folder of a flight")],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="folder to write (default: beside the bag)")
    ] = None,
    scenario: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="what was flown (default: as recorded)",
            autocompletion=completion.scenarios,
        ),
    ] = None,
    gps: Annotated[
        str | None,
        typer.Option(
            metavar="PRESET",
            help="receiver (default: as recorded)",
            autocompletion=completion.gps_presets,
        ),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", help="seed of the flight, for its conditions")
    ] = None,
    params: Params = None,
    as_json: Json = False,
) -> int:
    """Write report.html and the paper's figures of a recorded flight."""
    from heli_hover_test.report import STEPS, Choice, report_of_bag
    from heli_hover_test.terminal import steps

    choice = Choice(scenario, gps, seed, params or [])
    with steps("report", STEPS) as progress:
        page = report_of_bag(bag, choice, out, progress)
    if as_json:
        figures = sorted(str(path) for path in (page.parent / "figures").iterdir())
        print(_text({"report": str(page), "figures": figures}), end="")
        return 0
    print(f"written: {page}")
    return 0


@compare.command(
    "attitude",
    epilog="\b\nexample:\n  heli compare attitude --seeds 1..20 --gusts --out attitude_gusts",
)
def compare_attitude(
    seeds: Seeds = "1..20",
    gusts: Annotated[bool, typer.Option("--gusts", help="with discrete gusts up to 8 m/s")] = False,
    ideal: Annotated[
        bool,
        typer.Option(
            "--ideal-navigation", help="also without the estimator's errors: the law alone"
        ),
    ] = False,
    controllers: Laws = ALL_LAWS,
    gps: Gps = "standalone",
    duration: Annotated[
        float | None, typer.Option(metavar="S", help="length of a flight (default 60)")
    ] = None,
    params: Params = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="folder for attitude.png and .json; must not exist"),
    ] = None,
    as_json: Json = False,
) -> int:
    """Fly every law on the same seeds in the paper's attitude test (Fig. 3, 4)."""
    from heli_hover_test import compare_attitude as attitude
    from heli_hover_test.campaign import parse_seeds
    from heli_hover_test.laws import parse_laws
    from heli_hover_test.settings import resolve
    from heli_hover_test.terminal import console, new_folder, steps

    laws, numbers = parse_laws(controllers), parse_seeds(seeds)
    scenario = "attitude_gusts" if gusts else "attitude"
    settings = resolve(scenario, gps, duration_s=duration, params=params or [])
    if out is not None:
        new_folder(out)
    start = time.monotonic()
    with steps("flights", len(numbers) * len(laws)) as progress:
        result = attitude.compare(settings, laws, numbers, ideal, progress)
    if out is not None:
        from heli_hover_test.attitude_picture import draw

        draw(result, out / "attitude.png")
        (out / "attitude.json").write_text(_text(result.as_dict()), encoding="utf-8")
    if as_json:
        print(_text(result.as_dict()), end="")
        return 0
    attitude.print_comparison(result, console())
    console().print(f"{len(numbers) * len(laws)} flights in {time.monotonic() - start:.1f} s")
    if out is not None:
        console().print(f"written: {out}")
    return 0


@compare.command(
    "robustness", epilog="\b\nexample:\n  heli compare robustness --n 200 --json > robustness.json"
)
def compare_robustness(
    n: Annotated[
        int, typer.Option("--n", min=1, max=100000, metavar="N", help="perturbed aircraft")
    ] = 200,
    first_seed: Annotated[
        int, typer.Option("--seed", min=0, metavar="N", help="seed of the first aircraft")
    ] = 1,
    calm: Annotated[bool, typer.Option("--no-gusts", help="without the discrete gusts")] = False,
    controllers: Laws = ALL_LAWS,
    gps: Gps = "standalone",
    duration: Annotated[
        float | None, typer.Option(metavar="S", help="length of a flight (default 60)")
    ] = None,
    params: Params = None,
    as_json: Json = False,
) -> int:
    """Fly the nominal aircraft's laws on N perturbed aircraft."""
    from heli_hover_test import compare_robustness as robustness
    from heli_hover_test.laws import parse_laws
    from heli_hover_test.settings import resolve
    from heli_hover_test.terminal import console, steps

    laws = parse_laws(controllers)
    scenario = "attitude" if calm else "attitude_gusts"
    settings = resolve(scenario, gps, duration_s=duration, params=params or [])
    total = sum(robustness.aircraft_of(p, n) for p in robustness.PERTURBATIONS)
    start = time.monotonic()
    with steps("aircraft", total) as progress:
        outcomes = robustness.compare(settings, laws, n, first_seed, progress=progress)
    if as_json:
        print(_text(robustness.as_dict(outcomes, settings, n)), end="")
        return 0
    robustness.print_outcomes(outcomes, laws, settings, console())
    console().print(f"{total * len(laws)} flights in {time.monotonic() - start:.1f} s")
    return 0


def _text(content: Any) -> str:
    return json.dumps(_plain(content), indent=2, allow_nan=False) + "\n"


def _plain(content: Any) -> Any:
    """The content with None for what is not finite: JSON has no such numbers."""
    if isinstance(content, dict):
        return {key: _plain(value) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [_plain(value) for value in content]
    if (
        isinstance(content, float)
        and content != content
        or content in (float("inf"), -float("inf"))
    ):
        return None
    return content


def _refusals() -> tuple[type[Exception], ...]:
    """What counts as bad input; all carry one sentence. Imported only when something is raised."""
    from heli_dynamics_sim.trim import TrimError
    from heli_hover_test.errors import FlightError
    from heli_msgs_bridge.bag_folder import BagError
    from heli_msgs_bridge.parameters import ParameterError

    return (BagError, ParameterError, ValueError, TrimError, FlightError, OSError)


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code: 2 and one line on stderr for bad input."""
    try:
        code = app(args=argv, prog_name="heli", standalone_mode=False)
    except KeyboardInterrupt:
        print("interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except TyperException as error:
        print(f"heli: {_one_line(error)}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except Exception as error:
        if not isinstance(error, _refusals()):
            raise
        print(f"heli: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    return int(code or 0)


def _one_line(error: TyperException) -> str:
    text = getattr(error, "format_message", lambda: str(error))()
    return " ".join(text.split())


if __name__ == "__main__":
    sys.exit(main())
