# SPDX-License-Identifier: Apache-2.0
"""A campaign's folder, read for its report: finished or not."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pyarrow as pa

from heli_flight.studies.dispersion.again import write_again
from heli_flight.studies.dispersion.report_charts import Array, column
from heli_flight.studies.dispersion.row import FIGURE, INPUT
from heli_flight.studies.dispersion.spec import Spec, spec_of
from heli_flight.studies.dispersion.store import SPEC_NAME, Store, about_of
from heli_flight.studies.dispersion.summary import Summary, summary_of
from heli_flight.studies.dispersion.worst import Case, cases, judged_figures, worst
from heli_math.paper_metrics import BY_KEY, Metric
from heli_parameters.parameters import ParameterError

WORST = "worst"
SHOWN = 10
"""Worst cases that are told."""


@dataclass(frozen=True)
class Told:
    """A campaign's folder, read.

    Attributes
    ----------
    folder : Path
    about : mapping
        As of `about_of`.
    table : pa.Table
        Rows.
    summary : Summary
    cases : sequence of Case
    again : mapping
        Number of a worst case to the file that flies it again.
    why_not : str
        Why there are none of these; empty if there are.
    """

    folder: Path
    about: Mapping[str, Any]
    table: pa.Table
    summary: Summary
    cases: Sequence[Case]
    again: Mapping[int, Path]
    why_not: str

    @property
    def inputs(self) -> dict[str, list[object]]:
        """Name of each dispersed parameter to one value a flight."""
        names = [name for name in self.table.column_names if name.startswith(INPUT)]
        return {name.removeprefix(INPUT): self.table[name].to_pylist() for name in names}

    @property
    def figures(self) -> dict[str, tuple[Metric, Array]]:
        """Judged figures: name to its metric and a value a flight."""
        judged = judged_figures(self.table, self.about["flown"]["gps"])
        return {
            name.removeprefix(FIGURE): (BY_KEY[key], column(self.table, name))
            for name, (key, _, _) in judged.items()
        }

    @property
    def missing(self) -> int:
        """Flights of the spec that have no row yet."""
        return int(self.about["flights"]) - self.table.num_rows


def read_campaign(folder: Path) -> Told:
    """Read a campaign's folder, finished or not, and write the files that fly its worst again.

    Raises
    ------
    ParameterError
        It holds no campaign, or none of its flights has ended.
    """
    about, table = about_of(folder), Store(folder).table()
    if not table.num_rows:
        raise ParameterError(f"{folder}: no flight has ended yet; --resume flies them")
    found = cases(table, about["flown"]["gps"])
    numbers = [case.number for case in worst(found, SHOWN)]
    again, why_not = _again(folder, about, numbers)
    return Told(
        folder, about, table, summary_of(table, about["flown"]["gps"]), found, again, why_not
    )


def _again(
    folder: Path, about: Mapping[str, Any], numbers: Sequence[int]
) -> tuple[dict[int, Path], str]:
    spec = _spec(folder, about)
    if spec is None:
        return {}, (
            f"The spec {about['file']} is gone or has changed: no files to fly these again."
        )
    try:
        written = write_again(spec, numbers, folder / WORST)
    except (ParameterError, OSError) as error:
        return {}, f"No files to fly these again: {error}."
    return {int(path.parent.name.rpartition("_")[2]): path for path in written}, ""


def _spec(folder: Path, about: Mapping[str, Any]) -> Spec | None:
    """The spec that was flown: the user's file, or the copy; None if both are others by now."""
    for file in (Path(about["file"]), folder / SPEC_NAME):
        try:
            spec = spec_of(file)
            if spec.identity == about["spec"]:
                return spec
        except (ParameterError, OSError):
            continue
    return None
