# SPDX-License-Identifier: Apache-2.0
"""A campaign's summary for people and as JSON."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rich.console import Console

from heli_flight.studies.dispersion.spec import Spec
from heli_flight.studies.dispersion.summary import QUANTILES, Summary
from heli_flight.terminal import table


def as_dict(spec: Spec, summary: Summary) -> dict[str, Any]:
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
