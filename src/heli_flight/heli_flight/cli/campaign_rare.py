# SPDX-License-Identifier: Apache-2.0
"""The commands `heli campaign rare` and `heli campaign worst`: what a sample hardly ever meets."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from heli_flight.cli.options import Json

if TYPE_CHECKING:
    from rich.console import Console

    from heli_flight.studies.rare.flights import Flights

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
    str | None, typer.Option(metavar="ADDRESS", help="a Dask scheduler, tcp://host:8786")
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
    from heli_flight.studies.rare import words
    from heli_flight.studies.rare.points import seed_is_random
    from heli_flight.studies.rare.subset import LENGTH, Ended, Level, subset_simulation
    from heli_parameters.parameters import ParameterError

    if per_level % LENGTH or per_level < 2 * LENGTH:
        raise ParameterError(
            f"--per-level: {per_level}; allowed: a multiple of {LENGTH} from {2 * LENGTH} on"
        )
    if most_flights < per_level:
        raise ParameterError(f"--most-flights: {most_flights}; allowed: from {per_level} on")
    flights = _flights(spec, of, beyond, out, workers, scheduler, None)
    levels: list[Level] = []
    ended: list[Ended] = []

    def remark() -> str:
        past = (
            f"{of} > {levels[-1].threshold:.3g}: {levels[-1].probability:.2g}, " if levels else ""
        )
        return f"{past}level {len(levels)}"

    def told(level: Level) -> None:
        levels.append(level)
        flights.marks["level"] = len(levels)

    def run() -> None:
        drawn = int(seed_is_random(flights.spec))
        flights.marks["level"] = 0
        found = subset_simulation(
            flights, len(flights.spec.names) + drawn, flights.asked.bound, per_level, most_flights,
            seed, drawn, told,
        )  # fmt: skip
        ended.append(found.ended)

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
    from heli_flight.studies.rare import words
    from heli_flight.studies.rare.worst import LEAST, Search, at_random, by_cma
    from heli_parameters.parameters import ParameterError

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
    from heli_flight.studies.dispersion.spec import spec_of
    from heli_flight.studies.dispersion.store import Store
    from heli_flight.studies.rare.flights import Flights, asked_of
    from heli_flight.studies.rare.points import REACH, Points, check_reach
    from heli_parameters.parameters import ParameterError

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
    from heli_flight.errors import FlightError
    from heli_flight.studies.dispersion.again import write_again
    from heli_flight.studies.rare.flights import flier
    from heli_flight.studies.rare.words import print_folder
    from heli_flight.terminal import console, json_text, long_steps

    def finish(broken: bool) -> None:
        found = content()
        points, _ = flights.all()
        again = write_again(points, found["again"], out / "worst")
        (out / "result.json").write_text(json_text(found), encoding="utf-8")
        if as_json and not broken:
            print(json_text(found), end="")
            return
        show(console(stderr=broken))
        print_folder(console(stderr=broken), out, again)

    try:
        with flier(*who) as fly, long_steps("flights", most) as progress:
            flights.fly, flights.told = fly, lambda flown: progress(flown, remark())
            run()
    except (KeyboardInterrupt, FlightError):
        finish(broken=True)
        raise
    finish(broken=False)
    return 0
