# SPDX-License-Identifier: Apache-2.0
"""Every control preset in the worlds and on perturbed aircraft.

A command of `heli` flies it.
"""

from collections.abc import Mapping
from itertools import product
from typing import Any

from evidence.files import Results
from evidence.registry import TWENTY, produces, table
from evidence.tables import grid, world
from heli_studies import compare_flights
from heli_studies.compare import AXES

produces(
    "laws_everywhere",
    "./heli compare laws --seeds 1..20,2001..2020 --n 60 --json",
    "Every control preset in the worlds and on perturbed aircraft.",
    (*TWENTY, *range(2001, 2021)),
)


_ACTUATORS = {"roll": "d_lat", "pitch": "d_lon"}


@table("laws_everywhere")
def laws_everywhere(results: Results) -> str:
    """Worst, median, rms and seeds won of every controller in every case; the best in bold."""
    record = results["laws_everywhere"]
    rows, won = [], {law: dict.fromkeys(compare_flights.FIGURES, 0) for law in record["laws"]}
    for place in record["places"]:
        for axis in AXES:
            shown = compare_flights.rows_of(record, place["name"], axis)
            least = compare_flights.smallest(shown)
            cells = [compare_flights.cell(row, least, "**{}**") for row in shown]
            rows.append([compare_flights.condition_title(place, axis), *cells])
            for row, key in product(shown, compare_flights.FIGURES):
                won[row["law"]][key] += compare_flights.is_best(row, least, key)
    counts = ["{} / {}, {}".format(*won[law].values()) for law in record["laws"]]
    rows.append([f"on how many of these {len(rows)} rows it is smallest", *counts])
    rows += [_travel(record, axis, name) for axis, name in _ACTUATORS.items()]
    margins = compare_flights.margin_cells(record)
    rows.append(["disk margin as flown, input / output; further delay survived", *margins])
    head = ["place (flights), axis", *compare_flights.heads(record)]
    return (
        f"{grid(head, rows)}\n\nLargest error from truth, 5 s to 60 s, deg: worst / median over "
        "the flights, rms; on how many it is below the PID's. Bold: smallest of the row, "
        f"nothing lost. {_conditions(record)}"
    )


def _travel(results: Mapping[str, Any], axis: str, name: str) -> list[str]:
    """What an actuator moves in a second under each controller: over all places, least to most."""
    cells = []
    for law in results["laws"]:
        moved = [
            r["travel_per_s"] for r in results["rows"]
            if (r["law"], r["axis"]) == (law, axis) and r["travel_per_s"] is not None
        ]  # fmt: skip
        cells.append(f"{min(moved):.2f} to {max(moved):.2f}" if moved else "–")
    return [f"travel of {name} in a second, over the places", *cells]


def _conditions(results: Mapping[str, Any]) -> str:
    return world(
        {place["name"].split(",")[0]: [place["conditions"]] for place in results["places"]}
    )
