# SPDX-License-Identifier: Apache-2.0
"""The command `heli campaign`: a scenario on many seeds, or a spec with dispersed parameters.

Its sub-commands are registered in `app`, each from a file of its own.
"""

import os
import time
from pathlib import Path
from typing import Annotated

import typer

from heli_flight.cli.group import SETTINGS, CommandWithWords, sub_commands
from heli_flight.cli.options import (
    EXIT_OF_FLIGHTS,
    AnyGps,
    Duration,
    Faults,
    Json,
    Laws,
    Params,
    ScenarioName,
    Seeds,
    World,
)

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
    laws: Laws = None,
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
        typer.Option(metavar="ADDRESS", help="of a spec: a Dask scheduler, tcp://host:8786"),
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
    from heli_parameters.parameters import ParameterError

    said = {"--seeds": seeds != _DEFAULT_SEEDS, "--scenario": scenario, "--gps": gps,
            "--world": world, "--laws": laws, "--duration": duration is not None,
            "--params": params, "--faults": faults}  # fmt: skip
    own = {"--out": out, "--resume": resume, "--workers": workers is not None,
           "--scheduler": scheduler, "--via": via, "--sample": sample != _SAMPLE}  # fmt: skip
    for names, belongs in ((own, spec is not None), (said, spec is None)):
        named = next((name for name, value in names.items() if value), None)
        if named is not None and not belongs:
            whose = "a spec (heli campaign SPEC.yaml)" if names is own else "a spec's own keys"
            raise ParameterError(f"{named}: belongs to {whose}")
    if spec is None:
        from heli_flight.cli.campaign_seeds import Asked, many_seeds

        asked = Asked(scenario, gps, world, laws, duration, params or [], faults)
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
    from heli_flight.studies.compiles import tell_if_it_compiles
    from heli_flight.studies.dispersion.again import write_again
    from heli_flight.studies.dispersion.cluster import fly_by_dask, fly_here, tasks
    from heli_flight.studies.dispersion.row import EXIT_CODE
    from heli_flight.studies.dispersion.spec import spec_of
    from heli_flight.studies.dispersion.store import Store
    from heli_flight.studies.dispersion.summary import summary_of
    from heli_flight.studies.dispersion.words import as_dict, print_summary
    from heli_flight.terminal import console, json_text, long_steps
    from heli_parameters.parameters import ParameterError

    if out is None:
        raise ParameterError("--out: missing; a spec's rows need a folder that does not exist")
    if scheduler is not None and workers is not None:
        raise ParameterError("--workers: a scheduler has its own; allowed: one of the two")
    spec = spec_of(path)
    store = Store.resume(out, spec) if resume else Store.begin(out, spec, path)
    done = store.done() if resume else set()
    todo, cores = tasks(spec, done), len(os.sched_getaffinity(0))
    flown, failed, begun = len(done), 0, time.monotonic()
    if todo:
        many = min(cores if workers is None else workers, len(todo))
        here = scheduler is None and many == 0
        coming = fly_here(spec, todo) if here else fly_by_dask(spec, todo, many, scheduler)
        flights = long_steps("flights", len(spec.inputs), flown)
        if scheduler is None:
            tell_if_it_compiles(console(stderr=True))
        with store.kept_if_flown(), flights as progress:
            for rows in coming:
                store.put(rows)
                flown += len(rows)
                failed += sum(bool(row[EXIT_CODE]) for row in rows)
                progress(flown, f"{failed} of {flown - len(done)} outside")
    wall_s = time.monotonic() - begun
    summary = summary_of(store.table(), spec.base.gps)
    again = write_again(spec, summary.worst, out / "worst")
    content = as_dict(spec, summary)
    if not as_json:
        print_summary(console(), spec, summary, out, again)
        rate = (flown - len(done)) / wall_s if wall_s > 0.0 else 0.0
        console().print(f"{flown - len(done)} flights in {wall_s:.1f} s ({rate:.1f} per second)")
    code = int(summary.failed > 0)
    if sample:
        from heli_flight.studies.dispersion.through_graph import as_list, check, print_compared

        compared = check(spec, store.table(), sample, out)
        content["graph"] = as_list(compared)
        code |= not all(one.same for one in compared)
        if not as_json:
            print_compared(console(), compared)
    if as_json:
        print(json_text(content), end="")
    return code
