# SPDX-License-Identifier: Apache-2.0
"""`heli compare`: controllers and worlds flown against each other."""

import os
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from heli_core.folders import write_whole
from heli_flight.cli import common
from heli_flight.cli.common import (
    AnyGps,
    CommandWithRenamed,
    ControlPreset,
    Duration,
    Gps,
    Json,
    Params,
    Seeds,
    World,
)

# -------------------------------------------------------------------------------------------------
# Compare.
# -------------------------------------------------------------------------------------------------


def compared_controllers(incomplete: str) -> list[str]:
    """Controllers of a comparison, after those that stand before the last comma."""
    from heli_studies.compare import LAWS

    before, comma, last = incomplete.rpartition(",")
    return [before + comma + name for name in common.beginning(last, [law.key for law in LAWS])]


ComparedControllers = Annotated[
    str,
    typer.Option(
        "--attitude-controller",
        metavar="NAMES",
        help="hinf_output, hinf, hinf_offset_free, lqr, pid: any of them",
        autocompletion=compared_controllers,
    ),
]
ALL_LAWS = "hinf_output,hinf,hinf_offset_free,lqr,pid"


compare = typer.Typer(
    help="Fly controllers against each other, and worlds against worlds.",
    no_args_is_help=True,
    rich_markup_mode=None,
    epilog="\b\nexample:\n  heli compare attitude --seeds 1..20\n"
    "  heli compare controller my_law.py:MyLaw --seeds 1..20",
)


@compare.command(
    "attitude",
    cls=CommandWithRenamed,
    epilog="\b\nexample:\n  heli compare attitude --seeds 1..20 --gusts --out attitude_gusts",
)
def compare_attitude(
    seeds: Seeds = "1..20",
    gusts: Annotated[bool, typer.Option("--gusts", help="with discrete gusts up to 8 m/s")] = False,
    ideal: Annotated[
        bool,
        typer.Option(
            "--ideal-navigation", help="also without the estimator's errors: the controller alone"
        ),
    ] = False,
    flap_back: Annotated[
        bool,
        typer.Option("--flap-back", help="a rotor that flaps back, unknown to the controllers"),
    ] = False,
    controllers: ComparedControllers = ALL_LAWS,
    gps: Gps = None,
    world: World = None,
    duration: Duration = None,
    params: Params = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="folder for attitude.png and .json; must not exist"),
    ] = None,
    as_json: Json = False,
) -> int:
    """Fly every controller on the same seeds in the paper's attitude test (Fig. 3, 4)."""
    from heli_flight.fly import tell_if_it_compiles
    from heli_flight.settings import resolve
    from heli_flight.terminal import being_filled, console, json_text, steps
    from heli_studies import compare_flights
    from heli_studies.campaign.run import parse_seeds
    from heli_studies.compare import parse_laws

    laws, numbers = parse_laws(controllers), parse_seeds(seeds)
    scenario = "attitude_gusts" if gusts else "attitude"
    settings = resolve(scenario, gps, duration_s=duration, params=params or [], world=world)
    start = time.monotonic()
    tell_if_it_compiles(console(stderr=True))
    with being_filled(out) if out else nullcontext():
        with steps("flights", len(numbers) * len(laws)) as progress:
            result = compare_flights.compare_attitude(
                settings, laws, numbers, ideal, flap_back, progress
            )
        if out is not None:
            from heli_studies.compare_flights import draw_attitude

            draw_attitude(result, out / "attitude.png")
            write_whole(out / "attitude.json", json_text(result.as_dict()))
    if as_json:
        print(json_text(result.as_dict()), end="")
        return 0
    compare_flights.print_attitude(result, console())
    console().print(f"{len(numbers) * len(laws)} flights in {time.monotonic() - start:.1f} s")
    if out is not None:
        console().print(f"written: {out}")
    return 0


@compare.command(
    "robustness",
    cls=CommandWithRenamed,
    epilog="\b\nexample:\n  heli compare robustness --n 200 --json > robustness.json",
)
def compare_robustness(
    n: Annotated[
        int, typer.Option("--n", min=1, max=100000, metavar="N", help="perturbed aircraft")
    ] = 200,
    first_seed: Annotated[
        int, typer.Option("--seed", min=0, metavar="N", help="seed of the first aircraft")
    ] = 1,
    calm: Annotated[bool, typer.Option("--no-gusts", help="without the discrete gusts")] = False,
    controllers: ComparedControllers = ALL_LAWS,
    gps: Gps = None,
    world: World = None,
    duration: Duration = None,
    params: Params = None,
    as_json: Json = False,
) -> int:
    """Fly the nominal aircraft's controllers on N perturbed aircraft."""
    from heli_flight.settings import resolve
    from heli_flight.terminal import console, json_text, steps
    from heli_studies import compare as robustness
    from heli_studies.compare import parse_laws

    laws = parse_laws(controllers)
    scenario = "attitude" if calm else "attitude_gusts"
    settings = resolve(scenario, gps, duration_s=duration, params=params or [], world=world)
    total = sum(robustness.aircraft_of(p, n) for p in robustness.PERTURBATIONS)
    start = time.monotonic()
    with steps("aircraft", total) as progress:
        outcomes = robustness.compare(settings, laws, n, first_seed, progress=progress)
    if as_json:
        print(json_text(robustness.as_dict(outcomes, settings, n)), end="")
        return 0
    robustness.print_outcomes(outcomes, laws, settings, console())
    console().print(f"{total * len(laws)} flights in {time.monotonic() - start:.1f} s")
    return 0


@compare.command(
    "controller",
    epilog="\b\nexample:\n  heli compare controller examples/my_law.py:MyLaw --seeds 1..20",
)
def compare_controller(
    names: Annotated[
        list[str],
        typer.Argument(
            metavar="LAW...",
            help="your controllers in Python, MODULE:NAME or FILE.py:NAME, whose code runs; or "
            "packaged control presets",
        ),
    ],
    seeds: Seeds = "1..20",
    scenario: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="what to fly, as with `heli hover` (default: hover with a position controller, "
            "else attitude)",
            autocompletion=common.scenarios,
        ),
    ] = None,
    gps: Gps = None,
    world: World = None,
    duration: Duration = None,
    params: Params = None,
    workers: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            help="processes of this machine (default: its cores; 0: this one)",
        ),
    ] = None,
    as_json: Json = False,
) -> int:
    """Fly controllers of your own against the packaged ones, on the same seeds."""
    from functools import partial

    from heli_flight.fly import FlightOrder, tell_if_it_compiles
    from heli_flight.terminal import console, json_text, steps
    from heli_studies import compare_own as study
    from heli_studies.campaign.run import parse_seeds

    numbers = parse_seeds(seeds)
    order = partial(
        FlightOrder, gps=gps, world=world, duration_s=duration, params=params or [], seed=None
    )
    laws = study.rivals(names, scenario, order)
    cores = len(os.sched_getaffinity(0))
    start, total = time.monotonic(), len(laws) * len(numbers)
    for own in {rival.own for rival in laws}:
        tell_if_it_compiles(console(stderr=True), own)
    many = min(cores if workers is None else workers, total)
    with steps("flights", total) as progress:
        flown = study.compare_own(laws, numbers, many, progress)
    if as_json:
        print(json_text(study.as_dict(laws, flown)), end="")
        return 0
    study.print_own(laws, flown, console())
    console().print(f"{total} flights in {time.monotonic() - start:.1f} s")
    return 0


@compare.command(
    "aircraft",
    epilog="\b\nexample:\n  heli compare aircraft --aircraft all --seeds 1..20\n"
    "  heli compare aircraft --aircraft blade360 --worlds honest",
)
def compare_aircraft(
    aircraft: Annotated[
        str,
        typer.Option("--aircraft", metavar="NAMES", help="published linear aircraft: any, or all"),
    ] = "all",
    seeds: Seeds = "1..20",
    worlds: Annotated[
        str,
        typer.Option("--worlds", metavar="NAMES", help="paper, honest, hard, YAML files: any"),
    ] = "paper,honest,hard",
    as_json: Json = False,
) -> int:
    """Design for published linear aircraft and fly the hover test on each."""
    from heli_flight.fly import tell_if_it_compiles
    from heli_flight.terminal import console, json_text, steps
    from heli_studies import published as study
    from heli_studies.campaign.run import parse_seeds

    names, numbers, where = study.names_of(aircraft), parse_seeds(seeds), worlds.split(",")
    start, total = time.monotonic(), len(names) * len(study.LAWS) * len(where) * len(numbers)
    tell_if_it_compiles(console(stderr=True), True)
    with steps("flights", total) as progress:
        content = study.compare_aircraft(names, where, numbers, progress)
    if as_json:
        print(json_text(content), end="")
        return 0
    study.print_aircraft(content, console())
    console().print(f"{total} flights in {time.monotonic() - start:.1f} s")
    return 0


@compare.command(
    "worlds",
    cls=CommandWithRenamed,
    epilog="\b\nexample:\n  heli compare worlds --seeds 1..20\n"
    "  heli compare worlds --worlds honest --w20 2,4,6,8",
)
def compare_worlds(
    seeds: Seeds = "1..20",
    worlds: Annotated[
        str,
        typer.Option("--worlds", metavar="NAMES", help="paper, honest, hard, YAML files: any"),
    ] = "paper,honest,hard",
    w20: Annotated[
        str | None,
        typer.Option(
            "--w20", metavar="SPEEDS", help="each world in each of these winds at 20 ft, m/s"
        ),
    ] = None,
    laws: ControlPreset = None,
    gps: AnyGps = None,
    duration: Duration = None,
    params: Params = None,
    as_json: Json = False,
) -> int:
    """Fly the hover test in several worlds on the same seeds."""
    from heli_flight.fly import tell_if_it_compiles
    from heli_flight.layers import GPS_PRESETS
    from heli_flight.terminal import console, json_text, steps
    from heli_studies import compare_flights as study
    from heli_studies.campaign.run import parse_seeds

    numbers = parse_seeds(seeds)
    receivers = [gps] if gps else list(GPS_PRESETS)
    where = study.world_places(
        worlds.split(","), receivers, _speeds(w20), duration, params or [], laws
    )
    start = time.monotonic()
    tell_if_it_compiles(console(stderr=True))
    with steps("flights", len(numbers) * len(where)) as progress:
        content = study.worlds_as_dict(where, study.compare_worlds(where, numbers, progress))
    if as_json:
        print(json_text({"seeds": numbers, **content}), end="")
        return 0
    study.print_worlds(content, console())
    console().print(f"{len(numbers) * len(where)} flights in {time.monotonic() - start:.1f} s")
    return 0


@compare.command(
    "laws",
    cls=CommandWithRenamed,
    epilog="\b\nexample:\n  heli compare laws --control-preset packaged,paper,pid --worlds honest\n"
    "  heli compare laws --out laws",
)
def compare_laws(
    laws: Annotated[
        str,
        typer.Option(
            "--control-preset",
            metavar="NAMES",
            help="packaged names, YAML files: any, or all",
            autocompletion=common.control_presets,
        ),
    ] = "all",
    worlds: Annotated[
        str,
        typer.Option("--worlds", metavar="NAMES", help="paper, honest, hard, YAML files: any"),
    ] = "paper,honest,hard",
    seeds: Seeds = "1..20",
    n: Annotated[
        int,
        typer.Option("--n", min=0, max=100000, metavar="N", help="perturbed aircraft, too"),
    ] = 200,
    duration: Duration = None,
    jobs: Annotated[
        int | None,
        typer.Option(min=1, max=1000, metavar="N", help="flights at a time (default: every core)"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="folder for laws.png and .json; must not exist"),
    ] = None,
    as_json: Json = False,
) -> int:
    """Fly control presets against each other: worlds, both receivers, perturbed aircraft."""
    from heli_flight.fly import tell_if_it_compiles
    from heli_flight.terminal import being_filled, console, json_text, steps
    from heli_studies import compare_flights
    from heli_studies.campaign.run import parse_seeds

    rivals = compare_flights.parse_laws(laws)
    where = compare_flights.test_conditions(worlds.split(","), parse_seeds(seeds), n)
    start, total = time.monotonic(), len(rivals) * sum(map(len, where.values()))
    at_once = jobs or len(os.sched_getaffinity(0))
    tell_if_it_compiles(console(stderr=True))
    with being_filled(out) if out else nullcontext():
        with steps("flights", total) as progress:
            result = compare_flights.compare_laws(rivals, where, duration, at_once, progress)
        if out is not None:
            from heli_studies.compare_flights import draw_law_matrix

            draw_law_matrix(result.as_dict(), out / "laws.png")
            write_whole(out / "laws.json", json_text(result.as_dict()))
    if as_json:
        print(json_text(result.as_dict()), end="")
        return 0
    compare_flights.print_law_matrix(result, console())
    console().print(f"{total} flights in {time.monotonic() - start:.1f} s")
    if out is not None:
        console().print(f"written: {out}")
    return 0


def _speeds(text: str | None) -> list[float]:
    """Speeds of "2,4,6".

    Raises
    ------
    ParameterError
    """
    from heli_core.rcl_yaml import ParameterError

    try:
        return [float(part) for part in text.split(",")] if text else []
    except ValueError:
        raise ParameterError(f"--w20 {text}: write speeds in m/s, such as 2,4,6,8") from None
