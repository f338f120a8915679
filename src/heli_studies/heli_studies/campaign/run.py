# SPDX-License-Identifier: Apache-2.0
"""A campaign's folder: its spec, and its rows as Parquet, a file per task.

A file appears whole or not at all, so that a killed campaign goes on where it was.
"""

import contextlib
import fcntl
import heapq
import json
import math
import os
import shutil
import stat
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from rich.console import Console
from scipy import stats
from scipy.special import betaincinv

from heli_core.errors import ParameterCause
from heli_core.foreign_files import (
    FileCause,
    FileError,
    open_regular,
    read_json,
    too_large,
    within_budget,
)
from heli_core.metrics import BY_KEY, METRICS, PaperMetric
from heli_core.rcl_yaml import ParameterError, file_refusal
from heli_dynamics_sim.trim import TrimError
from heli_flight.fly import FlightOrder, fly_and_write
from heli_flight.layers import GPS_PRESETS, LOCKSTEP
from heli_flight.loop import LoopFlight, simulate
from heli_flight.result import Result, bound_head, conditions
from heli_flight.scoring import (
    DECIDES,
    SOURCE_NAMES,
    SOURCES,
    STRETCHES,
    Figures,
    Score,
    decides,
    figures_of,
    score,
    sources_of,
)
from heli_flight.settings import Settings, sources_commit
from heli_flight.terminal import FittingTable, steps, table
from heli_flight.terminal import table as text_table
from heli_studies.campaign.spec import (
    CAUSE,
    COVERAGE,
    EXIT_CODE,
    FIGURE,
    FIXED,
    INPUT,
    NUMBER,
    SEARCH,
    SEED,
    SENTENCE,
    WHOLE,
    FlightEnding,
    Spec,
    write_rerun_files,
)
from heli_studies.campaign.workers import Rows

# -------------------------------------------------------------------------------------------------
# Store.
# -------------------------------------------------------------------------------------------------

SPEC_NAME, ABOUT_NAME, ROWS, _LOCK = "spec.yaml", "campaign.json", "rows", "lock"
_PART = "part-{:08d}.parquet"
_MOST_ROWS, _MOST_COLUMNS = 100_000, 2000
_TOLD = {"spec": str, "commit": str, "flights": int, "file": str, "flown": dict, "disperse": dict}
_FLOWN = {
    "kind": str, "scenario": str, "world": str, "gps": str, "laws": str, "sampling": str,
    "duration_s": float,
}  # fmt: skip
_MOST_CHARACTERS = 1_000_000
_LEAST_BOUND = 1e-9
_INPUT_KINDS = (
    pa.types.is_integer, pa.types.is_floating, pa.types.is_string, pa.types.is_boolean,
)  # fmt: skip
_IS_KIND = {
    NUMBER: pa.types.is_integer, SEED: pa.types.is_integer, EXIT_CODE: pa.types.is_integer,
    CAUSE: pa.types.is_string, SENTENCE: pa.types.is_string, COVERAGE: pa.types.is_floating,
}  # fmt: skip


class FolderInUseError(ParameterError):
    """Another campaign flies into the folder."""


def about_of(folder: Path, option: str = "") -> dict[str, Any]:
    """What a campaign's folder says of itself.

    Keys: `spec` (its identity), `commit`, `flights`, `file` (the spec's), `flown` (what all flights
    share, by name), `disperse` (each parameter's distribution, in words).

    Raises
    ------
    ParameterError
        It holds no campaign (cause UNREADABLE), a damaged one (SYNTAX, TYPE), or a search.
    """
    try:
        about = read_json(folder / ABOUT_NAME)
    except FileError as error:
        missing = error.cause in (FileCause.UNREADABLE, FileCause.NOT_REGULAR)
        raise ParameterError(
            f"{option}{folder}: holds no campaign: {error}",
            ParameterCause.UNREADABLE if missing else ParameterCause.SYNTAX,
        ) from None
    wrong = _wrong(about, _TOLD) or _wrong(about["flown"], _FLOWN)
    if not wrong and about["flown"]["sampling"] != SEARCH:
        flown = about["flown"]
        known = flown["kind"] in METRICS and flown["gps"] in GPS_PRESETS and about["flights"] > 0
        known = known and all(isinstance(how, str) for how in about["disperse"].values())
        known = known and _are_bounds(flown.get("bounds", {}))
        wrong = "" if known else "values"
    if wrong:
        raise ParameterError(
            f"{option}{folder}: holds no campaign: {ABOUT_NAME} is damaged, or of another "
            f"version: {wrong}",
            ParameterCause.TYPE,
        )
    if about["flown"]["sampling"] == SEARCH:
        raise ParameterError(
            f"{option}{folder}: holds the flights of a search, which are no sample; its result is "
            f"in {folder}/result.json"
        )
    return about


def _are_bounds(bounds: Any) -> bool:
    """Whether these are bounds as `_about` writes them."""
    return isinstance(bounds, dict) and all(
        key in BY_KEY
        and isinstance(pair, list)
        and len(pair) == 2
        and (pair[0] is None or (isinstance(pair[0], int | float) and pair[0] >= 0.0))
        and isinstance(pair[1], str)
        for key, pair in bounds.items()
    )


def bounds_of(flown: Mapping[str, Any]) -> tuple[PaperMetric, ...]:
    """The metrics of a campaign's flights with what bounds them, by `flown` of `about_of`.

    A campaign of before there were bounds of one's own has the kind's.
    """
    told = flown.get("bounds", {})
    return tuple(
        replace(metric, paper=math.inf if bound is None else float(bound), source=source)
        for metric in METRICS[flown["kind"]]
        for bound, source in [told.get(metric.key, (metric.paper, metric.source))]
    )


def _wrong(content: Any, keys: Mapping[str, type]) -> str:
    """The first key that is missing or of another kind; empty if there is none."""
    if not isinstance(content, dict):
        return "no keys"
    return next((key for key, kind in keys.items() if not isinstance(content.get(key), kind)), "")


def _rows_of(part: Path, columns: list[str] | None = None) -> pa.Table:
    """The rows of a file; ParameterError for one whose index counts more than any of ours has."""
    try:
        with open_regular(part) as file, pq.ParquetFile(file) as held:
            about = held.metadata
            if about.num_rows > _MOST_ROWS or about.num_columns > _MOST_COLUMNS:
                raise too_large(f"a table of {about.num_rows} x {about.num_columns}", part)
            groups = [about.row_group(n) for n in range(about.num_row_groups)]
            within_budget(sum(group.total_byte_size for group in groups), "a table", part)
            return held.read(columns)
    except FileError as error:
        raise file_refusal(error, part, "rows") from None


def flown_of(spec: Spec) -> dict[str, Any]:
    """What all flights of a spec share, as `about_of` has it."""
    base = spec.base
    return {
        "kind": base.scenario.kind, "scenario": base.scenario_name, "world": base.world,
        "gps": base.gps, "laws": base.laws, "sampling": spec.sampling,
        "duration_s": float(base.scenario_parameters["duration_s"]),
        "bounds": {m.key: [m.as_dict()["paper"], m.source] for m in base.scenario.metrics},
    }  # fmt: skip


def _about(spec: Spec, file: Path) -> dict[str, Any]:
    return {
        "spec": spec.identity, "commit": sources_commit(), "flights": len(spec.inputs),
        "file": str(file.resolve()), "flown": flown_of(spec),
        "disperse": {name: str(how) for name, how in spec.disperse.items()},
    }  # fmt: skip


@dataclass(frozen=True)
class Store:
    """The folder of a campaign.

    Attributes
    ----------
    folder : Path
    resumes : bool
        Whether `--resume` goes on with it.
    flights : int or None
        Of the whole campaign; None: it is not known.
    fixed : tuple of str
        Columns that each row fills.
    """

    folder: Path
    resumes: bool = True
    flights: int | None = None
    fixed: tuple[str, ...] = FIXED

    @classmethod
    def begin(cls, folder: Path, spec: Spec, file: Path, resumes: bool = True) -> "Store":
        """A new folder; raises ParameterError if there is one, or none can be made."""
        store = cls(folder, resumes)
        try:
            # Of two campaigns that begin at once, one makes it.
            folder.mkdir(parents=True)
            (folder / ROWS).mkdir()
            shutil.copyfile(file, folder / SPEC_NAME)
            about = _about(spec, file)
            store._write(folder / ABOUT_NAME, json.dumps(about, indent=2).encode())
        except FileExistsError:
            way = "--resume goes on with it" if resumes else "name a new folder"
            raise ParameterError(f"--out {folder}: exists already; {way}") from None
        except OSError as error:
            raise ParameterError(f"--out {folder}: {error.strerror or error}") from None
        return store

    @classmethod
    def resume(cls, folder: Path, spec: Spec) -> "Store":
        """The folder of an interrupted campaign; ParameterError if it is of another."""
        about = about_of(folder, "--out ")
        if about["spec"] != spec.identity:
            raise ParameterError(
                f"--out {folder}: holds rows of another spec; allowed: the spec that it was begun "
                f"with ({folder / SPEC_NAME}), or another folder"
            )
        if about.get("commit") != sources_commit():
            raise ParameterError(
                f"--out {folder}: begun with the sources of {about.get('commit')}, these are "
                f"{sources_commit()}; allowed: the same, or another folder"
            )
        return cls(folder, flights=spec.count)

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Keep other campaigns out of the folder; ends with this process at the latest.

        Raises
        ------
        FolderInUseError
            Another campaign flies into it.
        ParameterError
            It cannot be held.
        """
        path = self.folder / _LOCK
        try:
            lock = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o644)
        except OSError as error:
            raise ParameterError(f"{path}: {error.strerror}", ParameterCause.UNREADABLE) from None
        with open(lock, "rb"):
            try:
                if not stat.S_ISREG(os.fstat(lock).st_mode):
                    raise ParameterError(f"{path}: is no file", ParameterCause.UNREADABLE)
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                raise FolderInUseError(
                    f"{self.folder}: another campaign flies into it; allowed: another folder, or "
                    "--resume when that one has ended"
                ) from None
            except OSError as error:
                raise ParameterError(
                    f"{path}: {error.strerror}", ParameterCause.UNREADABLE
                ) from None
            yield

    @contextlib.contextmanager
    def kept_if_flown(self) -> Iterator[None]:
        """Take a folder without rows away again if what fills it fails."""
        try:
            yield
        except BaseException:
            if not self._parts():
                shutil.rmtree(self.folder, ignore_errors=True)
            raise

    def done(self) -> set[int]:
        """Numbers of the flights whose rows are here; a damaged file is taken away."""
        parts, damaged = self._read()
        for part in damaged:
            # What cannot be taken away is told by who writes in its place.
            with contextlib.suppress(OSError):
                part.unlink()
        return {number for table in parts for number in table[NUMBER].to_pylist()}

    def damaged(self) -> list[Path]:
        """Files whose rows cannot be used."""
        return self._read()[1]

    def put(self, rows: Rows) -> None:
        """Keep the rows of a task.

        Raises
        ------
        ParameterError
            The disk is full, or the folder has gone.
        """
        names = dict.fromkeys(name for row in rows for name in row)
        table = pa.Table.from_pylist([{n: row.get(n) for n in names} for row in rows])
        sink = pa.BufferOutputStream()
        pq.write_table(table, sink, compression="zstd")
        part = self.folder / ROWS / _PART.format(min(row[NUMBER] for row in rows))
        try:
            self._write(part, sink.getvalue().to_pybytes())
        except OSError as error:
            stays = "what was flown stays" + ", --resume goes on" * self.resumes
            raise ParameterError(f"{self.folder}: {error.strerror or error}; {stays}") from None

    def table(self) -> pa.Table:
        """All rows, by number; what a flight has no figure for is null.

        A damaged file holds none: its flights are missing.
        """
        parts, _ = self._read()
        if not parts:
            return pa.table({NUMBER: pa.array([], pa.int64())})
        return pa.concat_tables(parts, promote_options="permissive").sort_by(NUMBER)

    def _read(self) -> tuple[list[pa.Table], list[Path]]:
        """Tables of the files that can be used together, and the others."""
        tables, damaged, known, schema = list[pa.Table](), list[Path](), set[int](), pa.schema([])
        for part in self._parts():
            try:
                table = self._table_of(part)
                schemas = pa.unify_schemas([schema, table.schema], promote_options="permissive")
                numbers = set(table[NUMBER].to_pylist())
                if len(numbers) < table.num_rows or numbers & known:
                    raise ValueError("a flight twice")
                inputs = {name for name in table.column_names if name.startswith(INPUT)}
                if tables and inputs != {n for n in tables[0].column_names if n.startswith(INPUT)}:
                    raise ValueError("of another campaign")
            except (pa.ArrowException, OSError, ValueError):
                damaged.append(part)
                continue
            schema, known = schemas, known | numbers
            tables.append(table)
        return tables, damaged

    def _table_of(self, part: Path) -> pa.Table:
        """A file's rows; raises ValueError, OSError or an ArrowException if it is damaged."""
        if part.is_symlink() or not part.is_file():
            raise ValueError("no file")
        table, most = _rows_of(part), self.flights
        if most is not None and table.num_rows > most:
            raise ValueError("more rows than flights")
        for name in self.fixed:
            column = table[name] if name in table.column_names else None
            if column is None or column.null_count or not _IS_KIND[name](column.type):
                raise ValueError(name)
        for field in table.schema:
            figure = pa.types.is_floating(field.type) or pa.types.is_null(field.type)
            if field.name.startswith((FIGURE, WHOLE)) and not figure:
                raise ValueError(field.name)
            if field.name.startswith(INPUT) and (
                not any(is_kind(field.type) for is_kind in _INPUT_KINDS)
                or table[field.name].null_count
            ):
                raise ValueError(field.name)
        numbers = table[NUMBER].to_pylist()
        if min(numbers, default=-1) < 0 or (most is not None and max(numbers) >= most):
            raise ValueError(NUMBER)
        if CAUSE in self.fixed and not set(table[CAUSE].to_pylist()) <= set(FlightEnding):
            raise ValueError(CAUSE)
        return table

    def _parts(self) -> list[Path]:
        return sorted((self.folder / ROWS).glob("part-*.parquet"))

    @staticmethod
    def _write(path: Path, content: bytes) -> None:
        """Whole or not at all, also if the machine stops."""
        made = path.with_name(f".{path.name}.{os.getpid()}")
        try:
            with made.open("wb") as file:
                file.write(content)
                file.flush()
                os.fsync(file.fileno())
            made.replace(path)
        finally:
            made.unlink(missing_ok=True)


# -------------------------------------------------------------------------------------------------
# A sample of a campaign's flights through the real graph: does it fly what the rows say?
# -------------------------------------------------------------------------------------------------

FOLDER = "graph"
TOLERANCE = 1e-6
"""How far a figure may differ, in its own unit: messages turn frames and round."""


@dataclass(frozen=True)
class GraphComparison:
    """A flight through the graph beside its row.

    Attributes
    ----------
    number : int
    figure : str
        Column of the figure that differs most; empty where there is none.
    difference : float
        Of that figure, in its unit; infinite if one of the two has none or was lost alone.
    folder : str
        Where the flight lies, with its bag.
    """

    number: int
    figure: str
    difference: float
    folder: str

    @property
    def same(self) -> bool:
        """Whether both are the same flight."""
        return self.difference <= TOLERANCE


def sample(rows: pa.Table, count: int) -> list[int]:
    """Numbers of flights evenly among those that flew, to the end or not; at most so many."""
    causes, numbers = rows[CAUSE].to_pylist(), rows[NUMBER].to_pylist()
    flew = [
        n
        for n, c in zip(numbers, causes, strict=True)
        if c in (FlightEnding.FLOWN, FlightEnding.LOST)
    ]
    count = min(count, len(flew))
    return [flew[(2 * i + 1) * len(flew) // (2 * count)] for i in range(count)]


def check(
    spec: Spec, rows: pa.Table, count: int, folder: Path,
    fly: Callable[[FlightOrder], Any] = fly_and_write,
) -> list[GraphComparison]:  # fmt: skip
    """Fly a sample through the graph, one after the other, and compare.

    Parameters
    ----------
    spec : Spec
    rows : pa.Table
        As of `Store.table`.
    count : int
        Of the sample.
    folder : Path
        The campaign's; flights lie in graph/flight_N/flight. One that is there is flown anew.
    fly : callable
        Flies an order and gives an outcome.

    Raises
    ------
    ParameterError, FlightError
        The folder cannot be written, or the graph does not come up.
    """
    numbers, comparisons = sample(rows, count), []
    with steps("flights through the graph", max(len(numbers), 1)) as progress:
        for one in _flown(spec, rows, numbers, folder, fly):
            comparisons.append(one)
            progress(len(comparisons))
    return comparisons


def _flown(
    spec: Spec, rows: pa.Table, numbers: Sequence[int], folder: Path,
    fly: Callable[[FlightOrder], Any],
) -> Iterator[GraphComparison]:  # fmt: skip
    by_number = {row[NUMBER]: row for row in rows.to_pylist()}
    for number in numbers:
        flight_folder = folder / FOLDER / f"flight_{number}"
        try:
            if flight_folder.exists():
                shutil.rmtree(flight_folder)
        except OSError as error:
            raise ParameterError(f"{flight_folder}: {error.strerror or error}") from None
        (file,) = write_rerun_files(spec, [number], folder / FOLDER)
        order = FlightOrder(
            mode=LOCKSTEP, params=[file], out=flight_folder / "flight", report=False
        )
        outcome = fly(order)
        figure, difference = _largest(by_number[number], outcome.result, spec.base.gps)
        yield GraphComparison(number, figure, difference, str(flight_folder / "flight"))


def _largest(row: dict[str, Any], result: Result, gps: str) -> tuple[str, float]:
    """The figure that differs most, and by how much."""
    if bool(result.lost) != (row[CAUSE] == FlightEnding.LOST):
        return CAUSE, math.inf
    if result.lost:
        return CAUSE, 0.0
    if not result.figures.covered(gps).is_whole:
        return COVERAGE, math.inf
    flown = {f"{WHOLE}{s.name}": s.max for s in result.figures.whole}
    flown |= {f"{FIGURE}{s.name}": s.max for s in result.figures.windows}
    stored = {k: v for k, v in row.items() if k.startswith((WHOLE, FIGURE)) and v is not None}
    if flown.keys() != stored.keys():
        return min(flown.keys() ^ stored.keys()), math.inf
    off = {name: abs(value - stored[name]) for name, value in flown.items()}
    name = max(off, key=lambda key: off[key], default="")
    return name, off.get(name, 0.0)


def as_list(comparisons: Sequence[GraphComparison]) -> list[dict[str, Any]]:
    """For --json."""
    return [asdict(one) | {"same": one.same} for one in comparisons]


def print_compared(out: Console, comparisons: Sequence[GraphComparison]) -> None:
    """A row a flight, and a sentence."""
    if not comparisons:
        out.print("no flight has flown: none goes through the graph")
        return
    rows = table("through the graph, beside the rows", out)
    for name in ("flight", "figure that differs most", "difference", ""):
        rows.add_column(name)
    for one in comparisons:
        mark = "same" if one.same else "DIFFERS"
        rows.add_row(str(one.number), one.figure, f"{one.difference:.3g}", mark)
    out.print(rows)
    same = sum(one.same for one in comparisons)
    out.print(
        f"{same} of {len(comparisons)} flights through the graph have the figures of their rows "
        f"within {TOLERANCE:g}; they lie in {Path(comparisons[0].folder).parent.parent}",
        soft_wrap=True, markup=False,
    )  # fmt: skip


# -------------------------------------------------------------------------------------------------
# Which flights of a campaign came worst: those that did not end, then by their distance from the
#
# bounds.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class WorstFlight:
    """A flight.

    Attributes
    ----------
    number, seed : int
    cause, sentence : str
    failed : bool
        Lost, refused or outside of what is judged.
    figure : str
        Name of the judged figure that is the largest part of its bound; empty without any.
    value, share : float
        That figure, and as a part of its bound; NaN without any.
    """

    number: int
    seed: int
    cause: str
    sentence: str
    failed: bool
    figure: str
    value: float
    share: float


def judged_figures(table: pa.Table, flown: Mapping[str, Any]) -> dict[str, tuple[PaperMetric, str]]:
    """Columns of what decides a verdict: the metric with its bound, and the record."""
    gps = flown["gps"]
    names = {
        f"{FIGURE}{metric.key} ({source})": (metric, source)
        for metric in bounds_of(flown)
        for source in SOURCES
        if decides(source, gps)
    }
    return {name: figure for name, figure in names.items() if name in table.column_names}


def cases(table: pa.Table, flown: Mapping[str, Any]) -> list[WorstFlight]:
    """Every flight of rows as of `Store.table`; `flown` as of `about_of`."""
    judged = judged_figures(table, flown)
    wanted = [NUMBER, SEED, CAUSE, SENTENCE, EXIT_CODE, *judged]
    return [_case(row, judged) for row in table.select(wanted).to_pylist()]


def _case(row: dict[str, object], judged: dict[str, tuple[PaperMetric, str]]) -> WorstFlight:
    parts = {
        name: float(str(row[name])) / max(metric.paper, _LEAST_BOUND)
        for name, (metric, _) in judged.items()
        if row[name] is not None
    }
    name = max(parts, key=lambda key: parts[key], default="")
    return WorstFlight(
        int(str(row[NUMBER])), int(str(row[SEED])), str(row[CAUSE]), str(row[SENTENCE]),
        bool(row[EXIT_CODE]), name.removeprefix(FIGURE),
        float(str(row[name])) if name else math.nan, parts.get(name, math.nan),
    )  # fmt: skip


def worst_flights(judged_flights: Sequence[WorstFlight], count: int) -> list[WorstFlight]:
    """The worst of them, the worst first: what did not end (by number), what failed, the rest."""

    def place(case: WorstFlight) -> tuple[bool, bool, float, int]:
        share = 0.0 if math.isnan(case.share) else case.share
        return case.cause == FlightEnding.FLOWN, not case.failed, -share, case.number

    return heapq.nsmallest(count, judged_flights, key=place)


# -------------------------------------------------------------------------------------------------
# What explains the spread of a figure over a campaign's flights: rank correlations.
# -------------------------------------------------------------------------------------------------

_FEWEST = 8
"""Flights below which nothing is said."""


@dataclass(frozen=True)
class Sensitivity:
    """Of one input on one figure.

    Attributes
    ----------
    name : str
        Of the input.
    rank_correlation : float
        Spearman's, -1 to 1. Of an input of names (a choice): the square root of the share of the
        ranks' variance that lies between them, 0 to 1. NaN if one of the two does not vary.
    p_value : float
        Of a correlation as large by chance (of names: Kruskal and Wallis's test).
    """

    name: str
    rank_correlation: float
    p_value: float


def sensitivities(
    inputs: Mapping[str, Sequence[object]], figure: NDArray[np.float64]
) -> list[Sensitivity]:
    """Of each input, the strongest first; none of fewer than eight flights.

    Parameters
    ----------
    inputs : mapping
        Name to one value a flight.
    figure : (N,) array
        NaN where a flight has none.
    """
    known = np.isfinite(figure)
    if known.sum() < _FEWEST:
        return []
    influences = []
    for name, column in inputs.items():
        values = [value for value, good in zip(column, known, strict=True) if good]
        of_one = _of_names if isinstance(values[0], str) else _of_numbers
        influences.append(Sensitivity(name, *of_one(values, figure[known])))
    return sorted(influences, key=_strength, reverse=True)


def _strength(influence: Sensitivity) -> float:
    rho = influence.rank_correlation
    return abs(rho) if math.isfinite(rho) else -1.0


def _of_numbers(values: Sequence[object], figure: NDArray[np.float64]) -> tuple[float, float]:
    numbers = np.array(values, dtype=float)
    if np.ptp(numbers) == 0.0 or np.ptp(figure) == 0.0:
        return math.nan, math.nan
    correlation = stats.spearmanr(numbers, figure)
    return float(correlation.statistic), float(correlation.pvalue)


def _of_names(values: Sequence[object], figure: NDArray[np.float64]) -> tuple[float, float]:
    named = np.array(values)
    groups = [figure[named == name] for name in sorted(set(values), key=str)]
    if len(groups) < 2 or np.ptp(figure) == 0.0:
        return math.nan, math.nan
    ranks = stats.rankdata(figure)
    between = sum(
        len(group_ranks) * (group_ranks.mean() - ranks.mean()) ** 2
        for group_ranks in (ranks[named == name] for name in sorted(set(values), key=str))
    )
    share = between / float(((ranks - ranks.mean()) ** 2).sum())
    return math.sqrt(share), float(stats.kruskal(*groups).pvalue)


def explained_variance(
    inputs: Mapping[str, Sequence[object]], figure: NDArray[np.float64]
) -> float:
    """Share of the variance of a figure's ranks that the inputs' ranks explain, linearly together.

    Adjusted for the number of inputs (Ezekiel 1930), at least 0; NaN of too few flights. The rest
    is what the seed draws, wind and noise, and what is not monotonic.
    """
    known = np.isfinite(figure)
    columns = []
    for column in inputs.values():
        values = np.array([v for v, good in zip(column, known, strict=True) if good])
        if values.dtype.kind in "US":
            columns += [values == name for name in np.unique(values)[1:]]
        elif np.ptp(values.astype(float)) > 0.0:
            columns.append(stats.rankdata(values.astype(float)))
    count, ranks = int(known.sum()), stats.rankdata(figure[known])
    free = count - len(columns) - 1
    if count < _FEWEST or free < 1 or not columns or np.ptp(ranks) == 0.0:
        return math.nan
    matrix = np.column_stack([np.ones(count), *columns]).astype(float)
    rest = ranks - matrix @ np.linalg.lstsq(matrix, ranks, rcond=None)[0]
    left = float(rest @ rest) / float(((ranks - ranks.mean()) ** 2).sum())
    return max(0.0, 1.0 - left * (count - 1) / free)


# -------------------------------------------------------------------------------------------------
# How sure a share of flights is.
# -------------------------------------------------------------------------------------------------

_CONFIDENCE = 0.95


@dataclass(frozen=True)
class Share:
    """So many flights of all.

    Attributes
    ----------
    hits, flights : int
    """

    hits: int
    flights: int

    @property
    def interval(self) -> tuple[float, float]:
        """95 % interval of the probability behind it (Clopper, Pearson 1934); 0, 1 of no flight."""
        tail, misses = 0.5 * (1.0 - _CONFIDENCE), self.flights - self.hits
        low = float(betaincinv(self.hits, misses + 1, tail)) if self.hits else 0.0
        high = float(betaincinv(self.hits + 1, misses, 1.0 - tail)) if misses else 1.0
        return low, high

    @property
    def words(self) -> str:
        """As a line tells it."""
        low, high = self.interval
        share = self.hits / self.flights if self.flights else 0.0
        counted = f"{self.hits} of {self.flights} flights, {share:.1%}"
        return f"{counted} ({low:.1%} to {high:.1%} at 95 %)"


# -------------------------------------------------------------------------------------------------
# What a campaign has found: causes, how many are outside, quantiles of each figure.
# -------------------------------------------------------------------------------------------------

_WORST = 10
QUANTILES = (0.5, 0.95, 0.99, 1.0)


@dataclass(frozen=True)
class Summary:
    """Of a campaign.

    Attributes
    ----------
    flights : int
    causes : dict
        Cause to number of flights.
    failed : int
        Flights lost, refused or outside of what is judged.
    interval : (float, float)
        95 % interval of their share (Clopper, Pearson 1934).
    survived : Share
        Flights that came to their end in the air, inside or outside.
    quantiles : dict
        Figure to its quantiles (`QUANTILES`) over the flights that ended in the air.
    worst : list of int
        Numbers of the flights that failed, at most ten: the lost ones first, then those farthest
        outside.
    """

    flights: int
    causes: dict[str, int]
    failed: int
    interval: tuple[float, float]
    survived: Share
    quantiles: dict[str, list[float]]
    worst: list[int]


def summary_of(table: pa.Table, flown: Mapping[str, Any]) -> Summary:
    """Summarise rows as of `Store.table`; `flown` as of `about_of` says what is judged."""
    count = table.num_rows
    if not count:
        return Summary(0, {}, 0, (0.0, 1.0), Share(0, 0), {}, [])
    failing = [case for case in cases(table, flown) if case.failed]
    quantiles = {
        name.removeprefix(FIGURE): _quantiles(table[name])
        for name in table.column_names
        if name.startswith(FIGURE)
    }
    causes = Counter(table[CAUSE].to_pylist())
    return Summary(
        count,
        dict(causes),
        len(failing),
        Share(len(failing), count).interval,
        Share(causes[FlightEnding.FLOWN], count),
        quantiles,
        [case.number for case in worst_flights(failing, _WORST)],
    )


def _quantiles(column: Any) -> list[float]:
    values = np.array([v for v in column.to_pylist() if v is not None], dtype=float)
    return [] if not values.size else [float(q) for q in np.quantile(values, QUANTILES)]


# -------------------------------------------------------------------------------------------------
# A campaign's summary for people and as JSON.
# -------------------------------------------------------------------------------------------------


def campaign_as_dict(spec: Spec, summary: Summary) -> dict[str, Any]:
    """For --json."""
    return {
        "spec": spec.identity,
        "dispersed": list(spec.names),
        "flights": summary.flights,
        "causes": summary.causes,
        "failed": summary.failed,
        "interval": list(summary.interval),
        "survived": summary.survived.hits,
        "survived_interval": list(summary.survived.interval),
        "quantiles": {
            name: dict(zip(map(str, QUANTILES), values, strict=False))
            for name, values in summary.quantiles.items()
        },
        "worst": summary.worst,
    }


def print_summary(
    out: Console, spec: Spec, summary: Summary, folder: Path, again: Sequence[Path]
) -> None:
    """Quantiles of each figure, how many failed, how to fly these again, where the rows are."""
    rows = table("quantiles over flights, scored windows", out)
    rows.add_column("metric (record)")
    for name in ("median", "95 %", "99 %", "largest"):
        rows.add_column(name, justify="right")
    for name, values in summary.quantiles.items():
        rows.add_row(name, *(f"{value:.3g}" for value in values))
    out.print(rows)
    low, high = summary.interval
    causes = ", ".join(f"{count} {cause}" for cause, count in summary.causes.items())
    lines = [
        f"{summary.flights} flights, {spec.sampling}, dispersed: {', '.join(spec.names) or 'none'}",
        f"{causes}; outside or not flown to the end: {summary.failed}, "
        f"{summary.failed / max(summary.flights, 1):.2%} ({low:.2%} to {high:.2%} at 95 %)",
    ]
    if spec.faults:
        lines.append(f"survived, with {spec.faults}: {summary.survived.words}")
    if summary.worst:
        lines.append(f"flights that failed, the lost first: {', '.join(map(str, summary.worst))}")
    lines += [f"again: heli hover --params {path}" for path in again]
    lines.append(f"rows: {folder}/rows/*.parquet")
    for line in lines:
        out.print(line, soft_wrap=True, markup=False)


# -------------------------------------------------------------------------------------------------
# Many flights of a scenario in one process: the largest value per metric beside the paper.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FlownSeed:
    """Figures of one flight, or why the helicopter was lost."""

    seed: int
    figures: Figures
    lost: str

    @classmethod
    def of(cls, seed: int, flight: LoopFlight, settings: Settings) -> "FlownSeed":
        """What a flight has shown; of a lost one nothing is scored."""
        if flight.sentence:
            return cls(seed, Figures(), flight.sentence)
        return cls(seed, score(flight.record, settings.scenario, settings.rate), "")

    def exit_code(self, gps: str) -> int:
        """As the hover test's, `Result.exit_code`."""
        return Result(self.figures, self.lost, 0.0, 0.0).exit_code(gps)


def with_seed(settings: Settings, seed: int) -> Settings:
    """The same flight in another wind, with other sensor errors, on another aircraft if drawn."""
    return settings.with_seed(seed)


def fly_seeds(
    settings: Settings, seeds: Iterable[int], progress: Callable[[int], None] = lambda done: None
) -> list[FlownSeed]:
    """Fly a scenario once per seed; progress is told how many have been flown."""
    flown: list[FlownSeed] = []
    for seed in seeds:
        try:
            flight = simulate(settings.with_seed(seed))
        except TrimError as error:
            # An aircraft that was drawn, in this wind: no actuator setting holds it.
            flown.append(FlownSeed(seed, Figures(), f"The aircraft cannot hover: {error}"))
            progress(len(flown))
            continue
        flown.append(FlownSeed.of(seed, flight, settings))
        progress(len(flown))
    return flown


def worst_of_seeds(
    flown: Sequence[FlownSeed], stretch: str = DECIDES
) -> Mapping[tuple[str, str], Score]:
    """Per (metric key, source) the score of a stretch with the largest magnitude over all seeds."""
    largest: dict[tuple[str, str], Score] = {}
    for flight in flown:
        for s in flight.figures.of(stretch):
            key = (s.metric.key, s.source)
            if key not in largest or s.max > largest[key].max:
                largest[key] = s
    return largest


def parse_seeds(text: str) -> list[int]:
    """Seeds of "1..20", "7", "1,5,9" or "1..20,2001..2020".

    Raises
    ------
    ParameterError
        If the text is none of these.
    """
    seeds: list[int] = []
    try:
        for part in text.split(","):
            first, _, last = part.partition("..")
            seeds += range(int(first), int(last or first) + 1)
            if int(last or first) < int(first):
                raise ValueError(part)
    except ValueError:
        seeds = []
    if not seeds or min(seeds) < 0:
        raise ParameterError(f"--seeds {text}: write 1..20, 7, 1,5,9 or 1..20,31..40")
    return seeds


def seeds_table(
    columns: Mapping[str, Sequence[FlownSeed]], kind: str, out: Console, stretch: str = DECIDES
) -> FittingTable:
    """Largest magnitude over seeds per metric, per GPS preset and source."""
    rows = text_table(STRETCHES[stretch], out)
    rows.add_column("metric")
    places = [(gps, source) for gps in columns for source in sources_of(gps)]
    extremes = {gps: worst_of_seeds(flown, stretch) for gps, flown in columns.items()}
    found: dict[PaperMetric, list[Score | None]] = {}
    for metric in METRICS[kind]:
        scores = [extremes[gps].get((metric.key, source)) for gps, source in places]
        found[next((s.metric for s in scores if s), metric)] = scores
    for name in (
        bound_head(found),
        *(f"{gps}, {SOURCE_NAMES[source]}" for gps, source in places),
    ):
        rows.add_column(name, justify="right")
    for metric, scores in found.items():
        cells = ["-" if s is None else f"{s.max:.2f}" for s in scores]
        rows.add_row(metric.label, metric.bound_text, *cells)
    return rows


def inside_of(flown: Sequence[FlownSeed], gps: str, stretch: str) -> int:
    """How many flights were not lost and are inside the paper's figures over a stretch."""
    return sum(
        not f.lost
        and f.figures.covered(gps, stretch).is_whole
        and not Result(f.figures, "", 0.0, 0.0).judged(gps, stretch)
        for f in flown
    )


def survived(flown: Sequence[FlownSeed]) -> Share:
    """The flights that were not lost."""
    return Share(sum(not f.lost for f in flown), len(flown))


def remarks(columns: Mapping[str, Sequence[FlownSeed]], kind: str) -> list[str]:
    """Sentences: how many were inside, and each flight that was lost or outside (`DECIDES`)."""
    bounds = figures_of(
        [s.metric for flown in columns.values() for f in flown for s in f.figures.all]
        or METRICS[kind]
    )
    lines = [
        f"{STRETCHES[stretch]}, {gps}: {inside_of(flown, gps, stretch)} of {len(flown)} flights "
        + (f"inside {bounds}" if bounds else "flown to the end; nothing bounds them")
        for stretch in STRETCHES
        for gps, flown in columns.items()
    ]
    for gps, flown in columns.items():
        for f in flown:
            if f.lost:
                lines.append(f"lost: {gps}, seed {f.seed}: {f.lost}")
                continue
            lacking = f.figures.covered(gps)
            if not lacking.is_whole:
                lines.append(f"partial: {gps}, seed {f.seed}: {lacking.sentence}")
            for s in Result(f.figures, "", 0.0, 0.0).judged(gps):
                lines.append(
                    f"outside {bounds}: {gps}, seed {f.seed}: {s.metric.label} "
                    f"({s.source}) {s.max:.3g} {s.metric.unit}, allowed: {s.metric.paper:g}"
                )
    return lines


def seeds_as_dict(
    columns: Mapping[str, Sequence[FlownSeed]], settings: Mapping[str, Settings]
) -> dict[str, Any]:
    """For --json: per receiver the largest magnitude of each metric, and every flight."""
    content: dict[str, Any] = {}
    for gps, flown in columns.items():
        content[gps] = {
            "conditions": conditions(settings[gps]).splitlines(),
            "inside": {stretch: inside_of(flown, gps, stretch) for stretch in STRETCHES},
            "metrics": [
                s.as_dict()
                for stretch in STRETCHES
                for s in worst_of_seeds(flown, stretch).values()
            ],
            "flights": [_flight_row(f, gps) for f in flown],
        }
    return content


def _flight_row(f: FlownSeed, gps: str) -> dict[str, Any]:
    return {
        "seed": f.seed,
        "lost": f.lost,
        "exit_code": f.exit_code(gps),
        "coverage": 0.0 if f.lost else f.figures.covered(gps).share,
        "max_whole": {s.name: s.max for s in f.figures.whole},
        "max": {s.name: s.max for s in f.figures.windows},
        "climb": {f"{c.metric.key} ({c.source})": c.value for c in f.figures.climb},
    }
