# SPDX-License-Identifier: Apache-2.0
"""The nominal aircraft's controllers on aircraft that differ from it.

A command of `heli` flies it.
"""

from collections.abc import Mapping
from typing import Any

from evidence.files import Results
from evidence.registry import produces, table
from evidence.tables import LAWS, grid, world

produces(
    "robustness",
    "./heli compare robustness --n 200 --json",
    "The nominal aircraft's controllers on aircraft that differ from it.",
    tuple(range(1, 201)),
)


@table("robustness")
def robustness(results: Results) -> str:
    """Median and worst error on perturbed aircraft."""
    record = results["robustness"]
    by_key = {(row["perturbation"], row["law"]): row for row in record["outcomes"]}
    rows = []
    for key in dict.fromkeys(row["perturbation"] for row in record["outcomes"]):
        cells = [by_key[key, law] for law in LAWS]
        flown = f"{cells[0]['name']} ({cells[0]['flown']})"
        rows.append([flown, *(_spread(row) for row in cells)])
    beyond = sum(row["flown"] - row["kept"] for row in record["outcomes"])
    flown = sum(row["flown"] for row in record["outcomes"])
    return (
        f"{grid(['aircraft (flown)', *LAWS.values()], rows)}\n\nLargest of roll and pitch error "
        f"from truth, deg, as median / worst; beyond {record['limit_deg']:g} deg or lost: {beyond} "
        f"of {flown} flights.\n{world({'gusts': [record['conditions']]})}"
    )


def _spread(row: Mapping[str, Any]) -> str:
    lost = f"; {row['lost']} lost" if row["lost"] else ""
    return f"{row['median_deg']:.2f} / {row['worst_deg']:.2f}{lost}"
