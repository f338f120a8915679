# SPDX-License-Identifier: Apache-2.0
"""The command `heli compare`: attitude, robustness, worlds, laws. Each imports what it needs."""

import os
import time
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from heli_flight.cli.options import (
    ALL_LAWS,
    AnyGps,
    ComparedLaws,
    Duration,
    Gps,
    Json,
    Laws,
    Params,
    Seeds,
    World,
)

compare = typer.Typer(
    help="Fly laws against each other, and worlds against worlds.",
    no_args_is_help=True,
    rich_markup_mode=None,
    epilog="\b\nexample:\n  heli compare attitude --seeds 1..20",
)


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
    flap_back: Annotated[
        bool, typer.Option("--flap-back", help="a rotor that flaps back; the laws do not know")
    ] = False,
    controllers: ComparedLaws = ALL_LAWS,
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
    """Fly every law on the same seeds in the paper's attitude test (Fig. 3, 4)."""
    from heli_flight.loop.settings import resolve
    from heli_flight.studies.campaign import parse_seeds
    from heli_flight.studies.compare import attitude
    from heli_flight.studies.compare.laws import parse_laws
    from heli_flight.studies.compiles import tell_if_it_compiles
    from heli_flight.terminal import being_filled, console, json_text, steps

    laws, numbers = parse_laws(controllers), parse_seeds(seeds)
    scenario = "attitude_gusts" if gusts else "attitude"
    settings = resolve(scenario, gps, duration_s=duration, params=params or [], world=world)
    start = time.monotonic()
    tell_if_it_compiles(console(stderr=True))
    with being_filled(out) if out else nullcontext():
        with steps("flights", len(numbers) * len(laws)) as progress:
            result = attitude.compare(settings, laws, numbers, ideal, flap_back, progress)
        if out is not None:
            from heli_flight.studies.compare.attitude_picture import draw

            draw(result, out / "attitude.png")
            (out / "attitude.json").write_text(json_text(result.as_dict()), encoding="utf-8")
    if as_json:
        print(json_text(result.as_dict()), end="")
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
    controllers: ComparedLaws = ALL_LAWS,
    gps: Gps = None,
    world: World = None,
    duration: Duration = None,
    params: Params = None,
    as_json: Json = False,
) -> int:
    """Fly the nominal aircraft's laws on N perturbed aircraft."""
    from heli_flight.loop.settings import resolve
    from heli_flight.studies.compare import robustness
    from heli_flight.studies.compare.laws import parse_laws
    from heli_flight.terminal import console, json_text, steps

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
    "worlds",
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
    laws: Laws = None,
    gps: AnyGps = None,
    duration: Duration = None,
    params: Params = None,
    as_json: Json = False,
) -> int:
    """Fly the hover test in several worlds on the same seeds."""
    from heli_flight.loop.layers import GPS_PRESETS
    from heli_flight.studies.campaign import parse_seeds
    from heli_flight.studies.compare import worlds as study
    from heli_flight.studies.compiles import tell_if_it_compiles
    from heli_flight.terminal import console, json_text, steps

    numbers = parse_seeds(seeds)
    receivers = [gps] if gps else list(GPS_PRESETS)
    where = study.places(worlds.split(","), receivers, _speeds(w20), duration, params or [], laws)
    start = time.monotonic()
    tell_if_it_compiles(console(stderr=True))
    with steps("flights", len(numbers) * len(where)) as progress:
        content = study.as_dict(where, study.compare(where, numbers, progress))
    if as_json:
        print(json_text({"seeds": numbers, **content}), end="")
        return 0
    study.print_comparison(content, console())
    console().print(f"{len(numbers) * len(where)} flights in {time.monotonic() - start:.1f} s")
    return 0


@compare.command(
    "laws",
    epilog="\b\nexample:\n  heli compare laws --laws packaged,paper,pid --worlds honest\n"
    "  heli compare laws --out laws",
)
def compare_laws(
    laws: Annotated[
        str,
        typer.Option("--laws", metavar="NAMES", help="packaged laws, YAML files: any, or all"),
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
    """Fly files of laws against each other: worlds, both receivers, perturbed aircraft."""
    from heli_flight.studies.campaign import parse_seeds
    from heli_flight.studies.compare import everywhere
    from heli_flight.studies.compiles import tell_if_it_compiles
    from heli_flight.terminal import being_filled, console, json_text, steps

    rivals = everywhere.parse_laws(laws)
    where = everywhere.places(worlds.split(","), parse_seeds(seeds), n)
    start, total = time.monotonic(), len(rivals) * sum(map(len, where.values()))
    at_once = jobs or len(os.sched_getaffinity(0))
    tell_if_it_compiles(console(stderr=True))
    with being_filled(out) if out else nullcontext():
        with steps("flights", total) as progress:
            result = everywhere.compare(rivals, where, duration, at_once, progress)
        if out is not None:
            from heli_flight.studies.compare.everywhere_picture import draw

            draw(result.as_dict(), out / "laws.png")
            (out / "laws.json").write_text(json_text(result.as_dict()), encoding="utf-8")
    if as_json:
        print(json_text(result.as_dict()), end="")
        return 0
    everywhere.print_comparison(result, console())
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
    from heli_parameters.parameters import ParameterError

    try:
        return [float(part) for part in text.split(",")] if text else []
    except ValueError:
        raise ParameterError(f"--w20 {text}: write speeds in m/s, such as 2,4,6,8") from None
