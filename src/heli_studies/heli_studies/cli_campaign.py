# SPDX-License-Identifier: Apache-2.0
"""`heli campaign`: flights by the hundred, the rare ones, the worst ones, their page."""

import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from heli_core.folders import write_whole
from heli_flight.cli.common import (
    EXIT_OF_FLIGHTS,
    SETTINGS,
    AnyGps,
    CommandWithWords,
    ControlPreset,
    Duration,
    Faults,
    Json,
    Params,
    ScenarioName,
    Seeds,
    World,
    sub_commands,
)

if TYPE_CHECKING:
    from rich.console import Console

    from heli_studies.campaign.rare import Flights
    from heli_studies.campaign.run import Store
    from heli_studies.campaign.spec import Spec


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
    """Run a search, tell and keep what it has found; the result so far, if interrupted."""
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
    "exit code: 0 written, 2 bad input. Of an interrupted campaign it tells what was flown."
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
