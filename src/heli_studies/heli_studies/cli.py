# SPDX-License-Identifier: Apache-2.0
"""What studies add to the command `heli`: compare, campaign, design, identify, log, robust, score,
tune.

Each command imports what it needs when it runs.
"""

import os
import time
from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from heli_core.folders import write_whole
from heli_flight.cli import common
from heli_flight.cli.common import (
    EXIT_OF_FLIGHTS,
    SETTINGS,
    Aircraft,
    AnyGps,
    AttitudeController,
    CommandWithRenamed,
    CommandWithWords,
    ControlPreset,
    Duration,
    Faults,
    Gps,
    Json,
    Params,
    ScenarioName,
    Seeds,
    World,
    sub_commands,
)
from heli_studies.tune_command import TUNE_EPILOG, tune

if TYPE_CHECKING:
    from rich.console import Console

    from heli_studies.campaign.rare import Flights
    from heli_studies.campaign.run import Store
    from heli_studies.campaign.spec import Spec


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
    help="Fly laws against each other, and worlds against worlds.",
    no_args_is_help=True,
    rich_markup_mode=None,
    epilog="\b\nexample:\n  heli compare attitude --seeds 1..20",
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
            "--ideal-navigation", help="also without the estimator's errors: the law alone"
        ),
    ] = False,
    flap_back: Annotated[
        bool, typer.Option("--flap-back", help="a rotor that flaps back; the laws do not know")
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
    """Fly every law on the same seeds in the paper's attitude test (Fig. 3, 4)."""
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
    """Fly the nominal aircraft's laws on N perturbed aircraft."""
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
            help="laws of your own in Python, MODULE:NAME or FILE.py:NAME, whose code runs; or "
            "packaged control presets",
        ),
    ],
    seeds: Seeds = "1..20",
    scenario: ScenarioName = "attitude",
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
    """Fly laws of your own against the packaged ones, on the same seeds."""
    from functools import partial

    from heli_flight.fly import FlightOrder, tell_if_it_compiles
    from heli_flight.terminal import console, json_text, steps
    from heli_studies import compare_own as study
    from heli_studies.campaign.run import parse_seeds

    numbers = parse_seeds(seeds)
    order = partial(
        FlightOrder, gps=gps, world=world, duration_s=duration, params=params or [], seed=None
    )
    laws = study.rivals(names, scenario or "attitude", order)
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
    from heli_flight.settings import GPS_PRESETS
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
    """Fly files of laws against each other: worlds, both receivers, perturbed aircraft."""
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


# -------------------------------------------------------------------------------------------------
# The command `heli campaign`: a scenario on many seeds, or a spec with dispersed parameters.
#
# Its sub-commands are registered in `app`, each from a file of its own.
# -------------------------------------------------------------------------------------------------

EPILOG = (
    "\b\nexample:\n  heli campaign --seeds 1..20 --gps rtk --json > campaign.json\n"
    "  heli campaign --seeds 1..20 --gps rtk --faults examples/faults.yaml\n"
    "  heli campaign examples/campaign_small.yaml --out flown\n\n" + EXIT_OF_FLIGHTS
)
_DEFAULT_SEEDS, _SAMPLE = "1..20", 2

campaigns = typer.Typer(cls=CommandWithWords, rich_markup_mode=None, epilog=EPILOG, **SETTINGS)


@campaigns.callback()
def campaign(
    context: typer.Context,
    spec: Annotated[
        Path | None,
        typer.Argument(
            metavar="SPEC.yaml",
            help="dispersed parameters; without: many seeds",
            autocompletion=sub_commands,
        ),
    ] = None,
    seeds: Seeds = _DEFAULT_SEEDS,
    scenario: ScenarioName = None,
    gps: AnyGps = None,
    world: World = None,
    laws: ControlPreset = None,
    duration: Duration = None,
    params: Params = None,
    faults: Faults = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="of a spec: folder for its rows; must not exist"),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="of a spec: fly what is missing in --out")
    ] = False,
    workers: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            help="of a spec: processes of this machine (default: its cores; 0: this one)",
        ),
    ] = None,
    scheduler: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="of a spec: a Dask scheduler, tls://host:8786 with Dask's own settings of "
            "certificates; on tcp:// whoever reaches it can run code",
        ),
    ] = None,
    via: Annotated[
        str | None,
        typer.Option(
            metavar="graph", help="of a spec: then fly a sample through the graph and compare"
        ),
    ] = None,
    sample: Annotated[
        int, typer.Option(metavar="N", min=1, help="of --via graph: so many flights")
    ] = _SAMPLE,
    as_json: Json = False,
) -> int:
    """Fly a scenario on many seeds, or a spec of dispersed parameters on many processes."""
    if context.invoked_subcommand:
        return 0
    from heli_core.rcl_yaml import ParameterError

    seed_options = {"--seeds": seeds != _DEFAULT_SEEDS, "--scenario": scenario, "--gps": gps,
            "--world": world, "--control-preset": laws, "--duration": duration is not None,
            "--params": params, "--faults": faults}  # fmt: skip
    spec_options = {"--out": out, "--resume": resume, "--workers": workers is not None,
           "--scheduler": scheduler, "--via": via, "--sample": sample != _SAMPLE}  # fmt: skip
    for names, belongs in ((spec_options, spec is not None), (seed_options, spec is None)):
        named = next((name for name, value in names.items() if value), None)
        if named is not None and not belongs:
            whose = (
                "a spec (heli campaign SPEC.yaml)" if names is spec_options else "a spec's own keys"
            )
            raise ParameterError(f"{named}: belongs to {whose}")
    if spec is None:
        from heli_studies.campaign.seeds import SeedFlightOptions, many_seeds

        asked = SeedFlightOptions(scenario, gps, world, laws, duration, params or [], faults)
        return many_seeds(seeds, asked, as_json)
    if via not in (None, "graph"):
        raise ParameterError(f"--via {via}; allowed: graph")
    if via is None and sample != _SAMPLE:
        raise ParameterError("--sample: belongs to --via graph")
    return _spec(spec, out, resume, workers, scheduler, sample if via else 0, as_json)


def _spec(
    path: Path, out: Path | None, resume: bool, workers: int | None, scheduler: str | None,
    sample: int, as_json: bool,
) -> int:  # fmt: skip
    """Fly a spec; rows into a folder as they come; then a sample of them through the graph."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from heli_core.rcl_yaml import ParameterError
    from heli_studies.campaign.run import Store
    from heli_studies.campaign.spec import spec_of

    if out is None:
        raise ParameterError("--out: missing; a spec's rows need a folder that does not exist")
    if scheduler is not None and workers is not None:
        raise ParameterError("--workers: a scheduler has its own; allowed: one of the two")
    spec = spec_of(path)
    store = Store.resume(out, spec) if resume else Store.begin(out, spec, path)
    with store.held():
        return _fly_missing(spec, store, (workers, scheduler), sample, as_json)


def _fly_missing(
    spec: "Spec", store: "Store", who: tuple[int | None, str | None], sample: int, as_json: bool
) -> int:
    """Fly what a folder lacks, and tell what it holds then."""
    from heli_flight.fly import tell_if_it_compiles
    from heli_flight.terminal import console, json_text, long_steps
    from heli_studies.campaign.run import campaign_as_dict, flown_of, print_summary, summary_of
    from heli_studies.campaign.spec import EXIT_CODE, write_rerun_files
    from heli_studies.campaign.workers import flier, tasks

    out, (workers, scheduler) = store.folder, who
    for part in store.damaged():
        words = f"damaged, its flights fly again: {part}"
        console(stderr=True).print(words, soft_wrap=True, markup=False)
    done = store.done()
    todo, cores = tasks(spec, done), len(os.sched_getaffinity(0))
    flown, failed, begun = len(done), 0, time.monotonic()
    if todo:
        many = min(cores if workers is None else workers, len(todo))
        flights = long_steps("flights", len(spec.inputs), flown)
        if scheduler is None:
            tell_if_it_compiles(console(stderr=True))
        with store.kept_if_flown(), flier(many, scheduler) as fly, flights as progress:
            for rows in fly(spec, todo):
                store.put(rows)
                flown += len(rows)
                failed += sum(bool(row[EXIT_CODE]) for row in rows)
                progress(flown, f"{failed} of {flown - len(done)} outside")
    wall_s = time.monotonic() - begun
    summary = summary_of(store.table(), flown_of(spec))
    again = write_rerun_files(spec, summary.worst, out / "worst")
    content = campaign_as_dict(spec, summary)
    if not as_json:
        print_summary(console(), spec, summary, out, again)
        rate = (flown - len(done)) / wall_s if wall_s > 0.0 else 0.0
        console().print(f"{flown - len(done)} flights in {wall_s:.1f} s ({rate:.1f} per second)")
    code = int(summary.failed > 0)
    if sample:
        from heli_studies.campaign.run import as_list, check, print_compared

        compared = check(spec, store.table(), sample, out)
        content["graph"] = as_list(compared)
        code |= not all(one.same for one in compared)
        if not as_json:
            print_compared(console(), compared)
    if as_json:
        print(json_text(content), end="")
    return code


# -------------------------------------------------------------------------------------------------
# The commands `heli campaign rare` and `heli campaign worst`: what a sample hardly ever meets.
# -------------------------------------------------------------------------------------------------

_FARTHEST = 6.0
_EXIT = "exit code: 0 done, 2 bad input, 130 interrupted (what stands is told, and in result.json)"
RARE_EPILOG = (
    "\b\nexample:\n  heli campaign rare examples/campaign_small.yaml --of 'altitude (truth)' "
    "--beyond 0.8 --out rare\n\n" + _EXIT
)
WORST_EPILOG = (
    "\b\nexample:\n  heli campaign worst examples/campaign_small.yaml --of 'lateral (truth)' "
    "--flights 300 --out worst\n\n" + _EXIT
)

_Spec = Annotated[
    Path,
    typer.Argument(metavar="SPEC.yaml", help="its dispersions; how it samples does not count"),
]
_Out = Annotated[
    Path, typer.Option("--out", metavar="DIR", help="folder for rows and result; must not exist")
]
_Of = Annotated[
    str, typer.Option("--of", metavar="METRIC", help="as rows name it, such as 'altitude (truth)'")
]
_Seed = Annotated[int, typer.Option("--seed", metavar="N", min=0, help="of the search alone")]
_Workers = Annotated[
    int | None,
    typer.Option(
        metavar="N",
        min=0,
        help="processes of this machine (default: its cores; 0: this one)",
    ),
]
_Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="a Dask scheduler, tls://host:8786 with Dask's own settings of certificates; on "
        "tcp:// whoever reaches it can run code",
    ),
]


def rare(
    spec: _Spec,
    of: _Of,
    out: _Out,
    beyond: Annotated[
        float | None,
        typer.Option(metavar="BOUND", help="in the metric's unit (default: the paper's figure)"),
    ] = None,
    per_level: Annotated[
        int, typer.Option(metavar="N", help="flights of a level, a multiple of 10")
    ] = 2500,
    most_flights: Annotated[
        int, typer.Option(metavar="N", help="no level is begun that would need more in all")
    ] = 20_000,
    seed: _Seed = 1,
    workers: _Workers = None,
    scheduler: _Scheduler = None,
    as_json: Json = False,
) -> int:
    """Probability that a metric leaves its bound, down to 1e-6, by subset simulation."""
    from heli_core.rcl_yaml import ParameterError
    from heli_studies.campaign import rare as words
    from heli_studies.campaign.rare import (
        LENGTH,
        Ended,
        SubsetLevel,
        seed_is_random,
        subset_simulation,
    )

    if per_level % LENGTH or per_level < 2 * LENGTH:
        raise ParameterError(
            f"--per-level: {per_level}; allowed: a multiple of {LENGTH} from {2 * LENGTH} on"
        )
    if most_flights < per_level:
        raise ParameterError(f"--most-flights: {most_flights}; allowed: from {per_level} on")
    flights = _flights(spec, of, beyond, out, workers, scheduler, None)
    levels: list[SubsetLevel] = []
    ended: list[Ended] = []

    def remark() -> str:
        past = (
            f"{of} > {levels[-1].threshold:.3g}: {levels[-1].probability:.2g}, " if levels else ""
        )
        return f"{past}level {len(levels)}"

    def keep_level(level: SubsetLevel) -> None:
        levels.append(level)
        flights.marks["level"] = len(levels)

    def run() -> None:
        drawn = int(seed_is_random(flights.spec))
        flights.marks["level"] = 0
        estimate = subset_simulation(
            flights, len(flights.spec.names) + drawn, flights.asked.bound, per_level, most_flights,
            seed, drawn, keep_level,
        )  # fmt: skip
        ended.append(estimate.ended)

    def content() -> dict[str, Any]:
        return words.rare_dict(flights, levels, ended[0] if ended else None, seed)

    def show(console: "Console") -> None:
        words.print_rare(console, flights, levels, ended[0] if ended else None)

    return _searched(
        flights, run, remark, most_flights, (workers, scheduler), out, content, show, as_json
    )


def worst(
    spec: _Spec,
    of: _Of,
    out: _Out,
    flights: Annotated[
        int, typer.Option("--flights", metavar="N", help="of the optimiser, and of random search")
    ] = 300,
    sigma: Annotated[
        float,
        typer.Option(
            metavar="S", help="how far out, in sigma: each quantile from Phi(-S) to Phi(S)"
        ),
    ] = 3.0,
    seed: _Seed = 1,
    workers: _Workers = None,
    scheduler: _Scheduler = None,
    as_json: Json = False,
) -> int:
    """Largest metric inside the dispersions, by CMA-ES beside as many flights at random."""
    from heli_core.rcl_yaml import ParameterError
    from heli_studies.campaign import rare as words
    from heli_studies.campaign.rare import LEAST, Search, at_random, by_cma

    if flights < LEAST:
        raise ParameterError(f"--flights: {flights}; allowed: an integer from {LEAST} on")
    if not 0.0 < sigma <= _FARTHEST:
        raise ParameterError(f"--sigma: {sigma}; allowed: a number above 0, at most {_FARTHEST:g}")
    flown = _flights(spec, of, None, out, workers, scheduler, sigma)
    searches = [("CMA-ES", Search()), ("random", Search())]

    def remark() -> str:
        now = [(name, s.best) for name, s in searches if s.evaluations]
        return ", ".join(f"{name} {best:.3g}" for name, best in now)

    def run() -> None:
        for (name, search), find in zip(searches, (by_cma, at_random), strict=True):
            flown.marks["search"] = name
            find(flown, len(flown.spec.names), sigma, flights, seed, search)

    def content() -> dict[str, Any]:
        return words.worst_dict(flown, searches, sigma, seed)

    def show(console: "Console") -> None:
        words.print_worst(console, flown, searches, sigma)

    return _searched(
        flown, run, remark, 2 * flights, (workers, scheduler), out, content, show, as_json
    )


def _flights(
    path: Path, of: str, beyond: float | None, out: Path, workers: int | None,
    scheduler: str | None, reach: float | None,
) -> "Flights":  # fmt: skip
    """What is asked, checked before anything flies; the folder is made."""
    # The matrices are small: threads of the linear algebra only cost time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from heli_core.rcl_yaml import ParameterError
    from heli_studies.campaign.rare import REACH, Flights, Points, asked_of, check_reach
    from heli_studies.campaign.run import Store
    from heli_studies.campaign.spec import spec_of

    if scheduler is not None and workers is not None:
        raise ParameterError("--workers: a scheduler has its own; allowed: one of the two")
    spec = spec_of(path)
    asked = asked_of(spec, of, beyond)
    check_reach(spec, REACH if reach is None else reach)
    store = Store.begin(out, Points.of(spec), path, resumes=False)
    return Flights(spec, asked, store.put)


def _searched(
    flights: "Flights", run: Callable[[], None], remark: Callable[[], str], most: int,
    who: tuple[int | None, str | None], out: Path, content: Callable[[], dict[str, Any]],
    show: "Callable[[Console], None]", as_json: bool,
) -> int:  # fmt: skip
    """Run a search, tell and keep what it has found; what stands, if it is broken off."""
    from heli_core.errors import FlightError
    from heli_flight.terminal import console, json_text, long_steps
    from heli_studies.campaign.rare import print_folder
    from heli_studies.campaign.spec import write_rerun_files
    from heli_studies.campaign.workers import flier

    def finish(broken: bool) -> None:
        result = content()
        points, _ = flights.all()
        again = write_rerun_files(points, result["again"], out / "worst")
        write_whole(out / "result.json", json_text(result))
        if as_json and not broken:
            print(json_text(result), end="")
            return
        show(console(stderr=broken))
        print_folder(console(stderr=broken), out, again)

    workers, scheduler = who
    many = len(os.sched_getaffinity(0)) if workers is None else workers
    try:
        with flier(many, scheduler, resumes=False) as fly, long_steps("flights", most) as progress:
            flights.fly, flights.report_count = fly, lambda flown: progress(flown, remark())
            run()
    except (KeyboardInterrupt, FlightError):
        finish(broken=True)
        raise
    finish(broken=False)
    return 0


# -------------------------------------------------------------------------------------------------
# The command `heli campaign report`: one page of a campaign's folder.
# -------------------------------------------------------------------------------------------------

REPORT_EPILOG = (
    "\b\nexample:\n  heli campaign report flown\n\n"
    "exit code: 0 written, 2 bad input. A campaign that was broken off is told as far as it came."
)


def campaign_report(
    folder: Annotated[Path, typer.Argument(metavar="DIR", help="the --out of a campaign")],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="folder to write (default: the campaign's own)"),
    ] = None,
    as_json: Json = False,
) -> int:
    """Write report.html and figures of a campaign: distributions, causes, what explains them."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from heli_flight.terminal import json_text, steps
    from heli_studies.campaign.report import STEPS, as_dict, read_campaign, write_page

    with steps("report", STEPS) as progress:
        campaign_folder = read_campaign(folder)
        page = write_page(campaign_folder, out or folder, progress)
    if as_json:
        print(json_text(as_dict(campaign_folder, page)), end="")
        return 0
    print(f"written: {page}")
    return 0


# -------------------------------------------------------------------------------------------------
# `heli identify` on the command line.
# -------------------------------------------------------------------------------------------------

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
    params: Params = None,
    as_json: Json = False,
) -> int:
    """Identify the aircraft from flight: A, B, E, servos, trims; design observer and laws."""
    # The matrices are small: threads of the linear algebra only cost time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from heli_flight.terminal import console
    from heli_studies import identify as command
    from heli_studies.identify_report import execute

    wanted = command.IdentifyOrder(
        actuators, gusts, aircraft, params or [], seed, gps, gamma_factor, one_process,
        flight=flight,
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
    from heli_flight.terminal import answer
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

        swept_response = swept.score_response(
            wanted, axis, command, disturbance, scale, rotor_diameter
        )
        if plot is not None:
            swept.draw_response(swept_response, plot)
        show = partial(swept.print_response, swept_response)
        answer(swept_response.as_dict(flight), as_json, show, written)
        return swept_response.exit_code
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
    "  heli hover --params my_design/design.yaml"
)


def design(
    params: Params = None,
    aircraft: Aircraft = None,
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
    from heli_flight.terminal import (
        answer,
        being_filled,
        console,
        json_text,
        refuse_existing,
        steps,
    )
    from heli_studies.design.make import make_design, write_yaml
    from heli_studies.design.report import as_dict, print_design

    refuse_existing(out)
    with steps("design", 2 if out else 1) as progress:
        made = make_design(params or [], aircraft, gamma, gamma_factor, search or check, controller)
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
    "  heli robust --control-preset paper --fly --params ranges.yaml"
)


def robust(
    laws: ControlPreset = None,
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
    from heli_flight.settings import resolve
    from heli_flight.terminal import answer, being_filled, json_text, refuse_existing, steps
    from heli_studies import robust as prove
    from heli_studies.robust import read_ranges

    refuse_existing(out)
    asked = read_ranges(params or [])
    settings = resolve(params=params or [], laws=laws).at_100_hz("heli robust")
    with steps("delays", len(asked.delays_ticks)) as progress:
        proof = prove.prove(settings, asked, progress, fly)
    if out is not None:
        with being_filled(out):
            prove.draw(proof, out / "box.png")
            write_whole(out / "robust.json", json_text(prove.as_dict(proof)))
    written = f"written: {out}" if out else ""
    return answer(prove.as_dict(proof), as_json, partial(prove.print_proof, proof), written)


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
    from heli_flight.terminal import answer
    from heli_studies.logs.info import cropped, info_of
    from heli_studies.logs.read import read_log
    from heli_studies.logs.show import draw_info, print_info

    if plot is not None:
        from heli_studies.handling import check_picture

        check_picture(plot)
    info = info_of(cropped(read_log(log, columns), start, end))
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
    as_json: Json = False,
) -> int:
    """Identify each axis from a log: gain, pole, delay, feed-forward; A and B where it allows."""
    # The matrices are small: threads of the linear algebra only cost time.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    from heli_flight.terminal import answer, being_filled, json_text, refuse_existing
    from heli_studies.logs.fit import draw_fit, fit_log, print_fit, responses_csv
    from heli_studies.logs.info import cropped, info_of
    from heli_studies.logs.read import read_log

    refuse_existing(out)
    fitted = fit_log(info_of(cropped(read_log(log, columns), start, end)))
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
