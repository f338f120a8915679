# SPDX-License-Identifier: Apache-2.0
"""`heli.campaign`: many flights, one row each."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from heli.arguments import in_python, refused, whole
from heli.flight import html_table, write_table
from heli.flying import flown, laws_of, ordered
from heli_core.metrics import PaperMetric
from heli_core.python_controller import LawError, in_one_line
from heli_core.rcl_yaml import ParameterError
from heli_dynamics_sim.trim import TrimError
from heli_flight.fly import tell_if_it_compiles
from heli_flight.parts import Parts
from heli_flight.settings import Settings
from heli_flight.terminal import console, long_steps, silent
from heli_studies.campaign.run import parse_seeds
from heli_studies.campaign.spec import NUMBER, FlightEnding, spec_of
from heli_studies.campaign.workers import flier, tasks

if TYPE_CHECKING:
    import pyarrow
    from matplotlib.figure import Figure

_SEEDS = "integers from 0, or text such as '1..20'"
_OPTIONS = (
    "scenario", "gps", "world", "laws", "controller", "duration_s", "params", "faults", "law",
    "rate_hz",
)  # fmt: skip
_SHOWN = 12
_ACROSS = 3


class Campaign(Sequence[Mapping[str, Any]]):
    """Rows of flights: `campaign[0]["seed"]`, `campaign.column("max.altitude (navigation)")`.

    Every row has `seed`, `cause` (flown, lost ...), `sentence` (why), `exit_code`, and per metric
    and record the largest magnitude: `max.` over the scored windows, `max_whole.` over the flight.
    """

    def __init__(
        self, rows: Iterable[Mapping[str, Any]], metrics: Sequence[PaperMetric] = ()
    ) -> None:
        self._rows, self._metrics = list(rows), metrics

    def __getitem__(self, index: Any) -> Any:
        some = self._rows[index]
        return Campaign(some, self._metrics) if isinstance(index, slice) else some

    def __len__(self) -> int:
        return len(self._rows)

    def __iter__(self) -> Iterator[Mapping[str, Any]]:
        return iter(self._rows)

    @property
    def names(self) -> list[str]:
        """Columns that any row has."""
        return list(dict.fromkeys(name for row in self._rows for name in row))

    def column(self, name: str) -> list[Any]:
        """One column, None where a row has it not; KeyError for a name that no row has."""
        if name not in self.names:
            raise KeyError(f"no column {name!r}; known: {', '.join(self.names)}")
        return [row.get(name) for row in self._rows]

    @property
    def inside(self) -> int:
        """How many flights were inside the paper's figures in the scored windows."""
        return sum(row["exit_code"] == 0 for row in self._rows)

    @property
    def lost(self) -> int:
        """How many flights did not reach their end."""
        return sum(row["cause"] != "flown" for row in self._rows)

    def to_arrow(self) -> pyarrow.Table:
        """The rows as a table of pyarrow."""
        import pyarrow

        return pyarrow.table({name: self.column(name) for name in self.names})

    def to_dataframe(self) -> Any:
        """The rows as a DataFrame of pandas; ImportError with a sentence where there is none."""
        from heli.flight import as_dataframe

        return as_dataframe(self.to_arrow())

    @in_python
    def write(self, path: str | os.PathLike[str]) -> Path:
        """Write the rows into a file: .csv or .parquet; ParameterError for another ending."""
        return write_table(self.to_arrow(), path)

    def plot(self) -> Figure:
        """The share of the flights that stay below each size of an error, by metric.

        A figure of matplotlib: truth and state estimate over the scored windows, and the bound.
        """
        return draw(self, self._metrics, self._summary())

    def _summary(self) -> str:
        return (
            f"{len(self)} flights, {self.inside} inside the paper's figures in the scored windows, "
            f"{self.lost} lost"
        )

    def _table(self) -> tuple[list[str], list[list[str]]]:
        known = ("seed", "cause", "exit_code")
        figures = [n for n in self.names if n.startswith("max.") and n.endswith("(navigation)")]
        head = [*known, *(n.removeprefix("max.").split(" ")[0] for n in figures)]
        rows = []
        for row in self._rows[:_SHOWN]:
            values = [row.get(name) for name in figures]
            cells = ["-" if value is None else f"{value:.3f}" for value in values]
            rows.append([*(str(row[name]) for name in known), *cells])
        return head, rows

    def __repr__(self) -> str:
        head, rows = self._table()
        widths = [max(len(row[i]) for row in [head, *rows]) for i in range(len(head))]
        lines = (
            "  ".join(cell.rjust(width) for cell, width in zip(row, widths, strict=True))
            for row in [head, *rows]
        )
        more = ["..."] if len(self) > _SHOWN else []
        return "\n".join([self._summary(), *lines, *more])

    def _repr_html_(self) -> str:
        return html_table(*self._table(), self._summary())


@in_python
def campaign(
    spec: str | os.PathLike[str] | None = None,
    *,
    seeds: str | Iterable[int] | None = None,
    workers: int = 0,
    quiet: bool = False,
    **options: Any,
) -> Campaign:
    """Fly a scenario on many seeds, or a spec with dispersed parameters.

    Parameters
    ----------
    spec : path, optional
        A campaign's YAML file, as of `heli campaign SPEC.yaml`; it says all but the next two.
    seeds : "1..20", or integers, optional
        Of the flights of one scenario.
    workers : int
        So many processes; 0: this one. A controller in Python comes along, a lambda, too; a script
        that flies on workers does so below `if __name__ == "__main__":`.
    quiet : bool
        True: no progress.
    **options
        Of seeds: scenario, gps, world, laws, controller, duration_s, params, faults, law, rate_hz,
        as of `heli.fly`.

    Returns
    -------
    Campaign

    Raises
    ------
    ParameterError, LawError
        Each with one sentence. A flight that is lost, or whose aircraft cannot hover, is a row.

    Examples
    --------
    >>> table = heli.campaign(seeds="1..20", gps="rtk")
    >>> max(table.column("max.altitude (truth)"))
    """
    if (spec is None) == (seeds is None):
        raise ParameterError("spec, seeds: give one of them")
    if spec is not None:
        if options:
            raise ParameterError(f"{', '.join(options)}: a spec's own keys say it")
        return _of_spec(Path(spec), workers, quiet)
    wanted = parse_seeds(seeds) if isinstance(seeds, str) else _whole(seeds)
    if not wanted:
        raise refused("seeds", seeds, _SEEDS)
    for name, value in options.items():
        if name not in _OPTIONS:
            raise refused(name, value, f"the arguments {', '.join(_OPTIONS)}")
    return _of_seeds(wanted, options, workers, quiet)


def _whole(seeds: Any) -> list[int]:
    """Seeds as integers."""
    if isinstance(seeds, int):
        seeds = [seeds]
    try:
        return [whole("seeds", seed) or 0 for seed in seeds]
    except TypeError:
        raise refused("seeds", seeds, _SEEDS) from None


def _of_spec(path: Path, workers: int, quiet: bool) -> Campaign:
    tell_if_it_compiles(silent() if quiet else console(stderr=True))
    spec, rows = spec_of(path), []
    todo = tasks(spec, set())
    with flier(workers) as fly, _progress(len(spec.inputs), quiet) as progress:
        for some in fly(spec, todo):
            rows += some
            progress(len(rows), "")
    rows.sort(key=lambda row: row["flight"])
    return Campaign(rows, spec.base.scenario.metrics)


def _progress(total: int, quiet: bool) -> Any:
    return nullcontext(lambda done, remark: None) if quiet else long_steps("flights", total)


class SeedFlights:
    """Flights of one scenario on many seeds: what workers fly (`workers.FlightBatch`).

    Parameters
    ----------
    settings : Settings
    law : Any
        As of `heli.fly`.
    seeds : sequence of int
    """

    chunk = 1

    def __init__(self, settings: Settings, law: Any, seeds: Sequence[int]) -> None:
        self.settings, self.law, self.seeds = settings, law, seeds

    @property
    def count(self) -> int:
        """Flights of it."""
        return len(self.seeds)

    def fly(self, numbers: Sequence[int]) -> list[dict[str, Any]]:
        """A row of each."""
        return [
            {NUMBER: n} | _row(self.settings.with_seed(self.seeds[n]), self.law) for n in numbers
        ]

    def killed(self, number: int) -> dict[str, Any]:
        """The row of a flight that ended its process each time."""
        sentence = "the process that flew it ended each time"
        row = {NUMBER: number, "seed": self.seeds[number], "cause": FlightEnding.KILLED.value}
        return row | {"sentence": sentence, "exit_code": 1}

    def __getstate__(self) -> dict[str, Any]:
        from distributed.protocol.pickle import dumps  # takes what is defined in a notebook, too

        try:
            return vars(self) | {"law": dumps(self.law)}
        except Exception as error:
            raise LawError(
                f"controller {type(self.law).__name__}: cannot be sent to workers: "
                f"{in_one_line(error)}; allowed: workers=0, or a controller in a file, "
                "law='my_law.py:NAME'"
            ) from error

    def __setstate__(self, state: dict[str, Any]) -> None:
        from distributed.protocol.pickle import loads

        try:
            law = loads(state["law"])
        except Exception as error:
            raise LawError(f"controller: a worker cannot load it: {in_one_line(error)}") from error
        self.__dict__.update(state | {"law": law})


def _of_seeds(
    seeds: Sequence[int], options: Mapping[str, Any], workers: int, quiet: bool
) -> Campaign:
    law = options.get("law")
    settings = ordered(laws_of(law), **{n: v for n, v in options.items() if n != "law"}).resolved()
    batch = SeedFlights(settings, law, seeds)
    tell_if_it_compiles(silent() if quiet else console(stderr=True), law is not None)
    rows: list[dict[str, Any]] = []
    with flier(workers) as fly, _progress(len(seeds), quiet) as progress:
        for some in fly(batch, tasks(batch, set())):
            rows += some
            progress(len(rows), "")
    rows.sort(key=lambda row: row.pop(NUMBER))
    return Campaign(rows, settings.scenario.metrics)


def draw(rows: Campaign, metrics: Sequence[PaperMetric], title: str) -> Figure:
    """The distribution of each metric beside its bound; of a lost flight there is no error."""
    import matplotlib.pyplot as plt

    from heli_flight.report.data import PALETTE

    shown = [m for m in metrics if f"max.{m.key} (truth)" in rows.names]
    across = max(min(len(shown), _ACROSS), 1)
    down = max(-(-len(shown) // across), 1)
    figure, axes = plt.subplots(
        down, across, figsize=(3.6 * across, 2.8 * down), layout="constrained", squeeze=False
    )
    # A notebook would show it a second time at the end of the cell.
    plt.close(figure)
    figure.suptitle(title, fontsize=9, wrap=True)
    for axis in axes.flat[len(shown) :]:
        axis.set_visible(False)
    for axis, metric in zip(axes.flat, shown, strict=False):
        for source, name in (("truth", "truth"), ("navigation", "nav")):
            column = rows.column(f"max.{metric.key} ({source})")
            errors = sorted(value for value in column if value is not None)
            share = [(i + 1) / len(rows) for i in range(len(errors))]
            color = PALETTE[name][0]
            axis.step(errors, share, where="post", color=color, label=source)
            axis.plot(errors, share, ".", color=color)
        if metric.bounded:
            axis.axvline(metric.paper, color="#444444", linestyle="--", label=metric.bound_name)
        axis.set(xlabel=f"{metric.label} ({metric.unit})", ylabel="share of flights")
        axis.set_xlim(left=0.0)
        axis.set_ylim(0.0, 1.02)
        axis.grid(True, color="#dddddd", linewidth=0.5)
        axis.legend(fontsize=8)
    return figure


def _row(settings: Any, law: Any) -> dict[str, Any]:
    begun = {"seed": settings.seed}
    try:
        # Made anew: a controller remembers.
        flight = flown(settings, silent(), Parts(controllers=laws_of(law)))
    except TrimError as error:
        return begun | {"cause": "no trim holds it", "sentence": str(error), "exit_code": 1}
    cause = "lost" if flight.lost else "flown"
    row = begun | {"cause": cause, "sentence": flight.lost, "exit_code": flight.exit_code}
    if flight.lost:
        return row
    for stretch, name in (("windows", "max"), ("whole", "max_whole")):
        for source in ("navigation", "truth", "truth_less_drift"):
            for metric in flight.metrics.of(source, stretch).values():
                row[f"{name}.{metric.name} ({source})"] = metric.value
    return row
