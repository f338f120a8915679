# SPDX-License-Identifier: Apache-2.0
"""The hover test in the worlds, with both receivers.

A command of `heli` flies it.
"""

from collections.abc import Mapping, Sequence
from typing import Any

from evidence.files import Results
from evidence.registry import TWENTY, produces, table
from evidence.tables import RECEIVERS, RECORDS, grid
from heli_studies.compare_flights import JUDGED

produces(
    "worlds",
    "./heli compare worlds --seeds 1..20,2001..2020 --json",
    "The hover test in the worlds, with both receivers.",
    (*TWENTY, *range(2001, 2021)),
)
produces(
    "worlds_paper",
    "./heli compare worlds --control-preset paper --seeds 1..20,2001..2020 --json",
    "The hover test in the worlds under the paper's own controllers.",
    (*TWENTY, *range(2001, 2021)),
)
produces(
    "w20",
    "./heli compare worlds --worlds honest --w20 2,4,6,8 --seeds 1..20 --json",
    "The hover test in the honest world over the wind at 20 ft.",
    TWENTY,
)


_STRETCHES = {"whole": "whole flight", "windows": "scored windows"}


@table("worlds")
def worlds(results: Results) -> str:
    """The hover test in every world, both receivers."""
    return _table(results, "worlds")


@table("worlds_paper")
def worlds_paper(results: Results) -> str:
    """The same under the paper's own controllers."""
    return _table(results, "worlds_paper")


@table("w20")
def w20(results: Results) -> str:
    """The hover test over the wind at 20 ft."""
    return _table(results, "w20")


def _table(results: Results, name: str) -> str:
    places = results[name]["places"]
    head = ["metric, stretch", "paper (flight)"]
    head += [f"{row['name']}, {RECEIVERS[row['gps']]}" for row in places]
    rows = []
    for stretch, words in _STRETCHES.items():
        for metric in _metrics(places[0], stretch):
            cells = [_cell(row, metric["key"], stretch) for row in places]
            paper = f"{metric['paper']:g} {metric['unit']}"
            rows.append([f"{metric['label']}, {words}", paper, *cells])
    rows.append(["flights with exit code 0", "", *(f"{_share(row)}" for row in places)])
    rows.append(["lost", "", *(_lost(row) for row in places)])
    records = "; ".join(f"{RECEIVERS[gps]}: {RECORDS[record]}" for gps, record in JUDGED.items())
    flown = places[0]["flown"]
    return (
        f"{grid(head, rows)}\n\nLargest magnitude in a flight, median / worst over "
        f"{_seeds(results, name)} ({flown} flights a column) without those that were lost; how "
        f"many are inside the paper's figure. Measured from: {records}.\n{_conditions(places)}"
    )


def _seeds(results: Results, name: str) -> str:
    """Seeds in words; two runs of them."""
    text = results.read[name]["command"].split("--seeds ")[1].split()[0]
    return "seeds " + " and ".join(part.replace("..", " to ") for part in text.split(","))


def _metrics(row: Mapping[str, Any], stretch: str) -> list[Mapping[str, Any]]:
    record = JUDGED[row["gps"]]
    return [m for m in row["metrics"] if (m["stretch"], m["measured_from"]) == (stretch, record)]


def _cell(row: Mapping[str, Any], key: str, stretch: str) -> str:
    matches = [m for m in _metrics(row, stretch) if m["key"] == key]
    if not matches:
        return "–"
    return f"{matches[0]['median']:.2f} / {matches[0]['worst']:.2f}; {matches[0]['inside']}"


def _share(row: Mapping[str, Any]) -> str:
    return f"{row['exit_code_0']} of {row['flown']}"


def _lost(row: Mapping[str, Any]) -> str:
    """How many were lost, by status."""
    status = [flight["status"] for flight in row["lost"]]
    kinds = [f"{status.count(kind)} {kind}" for kind in dict.fromkeys(status)]
    return ", ".join(kinds) or "0"


def _conditions(places: Sequence[Mapping[str, Any]]) -> str:
    """Air and receivers of all columns; each said once."""
    sources: dict[str, None] = {}
    for row in places:
        for line in row["conditions"]:
            source = line.removeprefix("simulated: ").split("; seed ")[0]
            sources[source.removesuffix("; the paper's numbers are from flight")] = None
    return f"Simulated. {'; '.join(sources)}."
