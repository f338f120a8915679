# SPDX-License-Identifier: Apache-2.0
"""A sample of a campaign's flights through the real graph: does it fly what the rows say?"""

import math
import shutil
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa
from rich.console import Console

from heli_flight.loop.flight_section import LOCKSTEP
from heli_flight.loop.result import Result
from heli_flight.studies.dispersion.again import write_again
from heli_flight.studies.dispersion.row import CAUSE, FIGURE, NUMBER, WHOLE, Cause
from heli_flight.studies.dispersion.spec import Spec
from heli_flight.studies.flight import FlightOrder, fly_and_write
from heli_flight.terminal import steps, table
from heli_parameters.parameters import ParameterError

FOLDER = "graph"
TOLERANCE = 1e-6
"""How far a figure may differ, in its own unit: messages turn frames and round."""


@dataclass(frozen=True)
class Compared:
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
    flew = [n for n, c in zip(numbers, causes, strict=True) if c in (Cause.FLOWN, Cause.LOST)]
    count = min(count, len(flew))
    return [flew[(2 * i + 1) * len(flew) // (2 * count)] for i in range(count)]


def check(
    spec: Spec, rows: pa.Table, count: int, folder: Path,
    fly: Callable[[FlightOrder], Any] = fly_and_write,
) -> list[Compared]:  # fmt: skip
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
    numbers, found = sample(rows, count), []
    with steps("flights through the graph", max(len(numbers), 1)) as progress:
        for one in _flown(spec, rows, numbers, folder, fly):
            found.append(one)
            progress(len(found))
    return found


def _flown(
    spec: Spec, rows: pa.Table, numbers: Sequence[int], folder: Path,
    fly: Callable[[FlightOrder], Any],
) -> Iterator[Compared]:  # fmt: skip
    by_number = {row[NUMBER]: row for row in rows.to_pylist()}
    for number in numbers:
        own = folder / FOLDER / f"flight_{number}"
        try:
            if own.exists():
                shutil.rmtree(own)
        except OSError as error:
            raise ParameterError(f"{own}: {error.strerror or error}") from None
        (file,) = write_again(spec, [number], folder / FOLDER)
        order = FlightOrder(mode=LOCKSTEP, params=[file], out=own / "flight", report=False)
        outcome = fly(order)
        figure, difference = _largest(by_number[number], outcome.result)
        yield Compared(number, figure, difference, str(own / "flight"))


def _largest(row: dict[str, Any], result: Result) -> tuple[str, float]:
    """The figure that differs most, and by how much."""
    if bool(result.lost) != (row[CAUSE] == Cause.LOST):
        return CAUSE, math.inf
    if result.lost:
        return CAUSE, 0.0
    flown = {f"{WHOLE}{s.name}": s.max for s in result.figures.whole}
    flown |= {f"{FIGURE}{s.name}": s.max for s in result.figures.windows}
    told = {k: v for k, v in row.items() if k.startswith((WHOLE, FIGURE)) and v is not None}
    if flown.keys() != told.keys():
        return min(flown.keys() ^ told.keys()), math.inf
    off = {name: abs(value - told[name]) for name, value in flown.items()}
    name = max(off, key=lambda key: off[key], default="")
    return name, off.get(name, 0.0)


def as_list(found: Sequence[Compared]) -> list[dict[str, Any]]:
    """For --json."""
    return [asdict(one) | {"same": one.same} for one in found]


def print_compared(out: Console, found: Sequence[Compared]) -> None:
    """A row a flight, and a sentence."""
    if not found:
        out.print("no flight has flown: none goes through the graph")
        return
    rows = table("through the graph, beside the rows", out)
    for name in ("flight", "figure that differs most", "difference", ""):
        rows.add_column(name)
    for one in found:
        mark = "same" if one.same else "DIFFERS"
        rows.add_row(str(one.number), one.figure, f"{one.difference:.3g}", mark)
    out.print(rows)
    same = sum(one.same for one in found)
    out.print(
        f"{same} of {len(found)} flights through the graph have the figures of their rows within "
        f"{TOLERANCE:g}; they lie in {Path(found[0].folder).parent.parent}",
        soft_wrap=True, markup=False,
    )  # fmt: skip
