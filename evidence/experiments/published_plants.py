# SPDX-License-Identifier: Apache-2.0
"""Designs for published linear aircraft, flown on each in three worlds.

A command of `heli` flies it.
"""

from typing import Any

from evidence.files import Results
from evidence.registry import MARGIN, TWENTY, produces, table
from evidence.tables import grid
from heli_studies.design.make import LONGEST_DELAY_S
from heli_studies.published import AXES, cell
from heli_studies.robust_linear import HEADS, cells

produces(
    "published_plants",
    "./heli compare aircraft --aircraft all --seeds 1..20 --json",
    "Designs for published linear aircraft, flown on each in three worlds.",
    TWENTY,
    MARGIN,
)
produces(
    "published_robustness",
    "./heli robust --aircraft all --json",
    "Margins of those designs, and A and B up to 30 % off, sampled.",
    (),
    MARGIN,
)


@table("published_robustness")
def published_robustness(results: Results) -> str:
    """Margins, unstable aircraft of the box, and whether the certificate applies."""
    rows = results["published_robustness"]["rows"]
    body = [[f"{row['aircraft']}, {row['law']}", *cells(row)] for row in rows]
    return (
        f"{grid(['aircraft, controller', *HEADS], body)}\n\nAttitude loop as flown, with the "
        "published delay. Disk: all channels at once; gain, either way, and phase: the smallest of "
        "d_lat, d_lon, d_ped, the others closed; further delay: all channels at once, "
        f"{1e3 * LONGEST_DELAY_S:.0f} ms at most tried. Entries of A and B, each by itself up to "
        f"{rows[0]['box']['relative']:.0%} off: aircraft at corners drawn at random, and inside. "
        "Sampled, not proved."
    )


@table("published_plants")
def published_plants(results: Results) -> str:
    """Inside the paper's figures, largest errors, lost, by aircraft, controller and world."""
    head = [
        "aircraft, controller, world",
        "inside the paper's figures",
        *(f"{a}, m" for a in AXES),
        "lost",
    ]
    body = [
        [
            f"{r['aircraft']}, {r['law']}, {r['world']}",
            f"{r['inside']} of {r['flown']}",
            *(cell(r, axis) for axis in AXES),
            str(r["lost"]),
        ]
        for r in results["published_plants"]["rows"]
    ]
    return (
        f"{grid(head, body)}\n\nHover test with RTK, {results.seeds('published_plants')}. Inside: "
        "within the paper's figures in the scored windows, exit code 0. Largest "
        "drift-corrected errors of a flight, from 5 s to the end, the climb "
        "against its reference: median / worst of the flights that were not lost."
    )


@table("published_plants_designs")
def designs(results: Results) -> str:
    """Bound, its infimum and margins of each design, with the aircraft's own delay."""
    head = ["aircraft", "delay, ms", "fastest unstable pole, 1/s", "controller", "gamma / gamma*",
            "disk margin, input / output"]  # fmt: skip
    return grid(head, [_design(row) for row in results["published_plants"]["designs"]])


def _design(row: dict[str, Any]) -> list[str]:
    departs = max(real for real, _ in row["poles"])
    return [
        f"[{row['name']}]({row['source']})",
        f"{1e3 * row['delay_s']:.0f}",
        f"{departs:.2f}" if departs > 1e-3 else "none",
        row["law"],
        f"{row['gamma']:.3g} / {row['gamma_star']:.3g}",
        f"{row['disk_input']:.2f} / {row['disk_output']:.2f}",
    ]
