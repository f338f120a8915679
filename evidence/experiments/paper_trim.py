# SPDX-License-Identifier: Apache-2.0
"""The aircraft of `examples/paper_trim.yaml`: its trim beside Table 1, and the hover test; JSON.

Usage: ./heli python -m evidence.experiments.paper_trim [--seeds 1..5]

Its controllers are designed for it, with the packaged weights (`heli design --aircraft`).
"""

import sys
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from evidence.experiments.trim_table import PAPER, trim_of
from evidence.files import Results
from evidence.registry import MARGIN, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import RECEIVERS, grid, world
from heli_core.metrics import METRICS
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_flight.loop import simulate
from heli_flight.result import conditions
from heli_flight.scoring import WINDOWS
from heli_flight.settings import Settings, resolve
from heli_studies.campaign.run import FlownSeed, inside_of, worst_of_seeds
from heli_studies.design.make import make_design, write_yaml

AIRCRAFT = Path(__file__).resolve().parents[2] / "examples/paper_trim.yaml"
SOLVED: Mapping[str, str] = {
    "tail_arm_m": "tail rotor's arm, m",
    "tail_height_m": "tail rotor's height, m",
    "hfin_arm_m": "horizontal fin's arm, m",
    "flap_lon_from_lon_rad": "longitudinal cyclic per d_lon, rad",
    "flap_lat_from_lat_rad": "lateral cyclic per d_lat, rad",
    "collective_offset_rad": "blade pitch at d_col = 0, rad",
}
"""What the file has other than HeLion."""
_NAVIGATION = "navigation"


@cache
def _made() -> Any:
    return make_design(aircraft=str(AIRCRAFT))


def settings_of(gps: str) -> Settings:
    """The hover test of this aircraft under its own design."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "design.yaml"
        write_yaml(_made(), path)
        return resolve("hover", gps, params=[path])


@over(gps=tuple(RECEIVERS))
def flown(gps: str, seed: int) -> FlownSeed:
    """Figures of a flight."""
    settings = settings_of(gps)
    return FlownSeed.of(seed, simulate(settings.with_seed(seed)), settings)


def row(place: Place[FlownSeed]) -> dict[str, Any]:
    """Flights inside the paper's figures, and the largest figures by the navigation record."""
    worst = worst_of_seeds(place.flights, WINDOWS).values()
    return {
        **place.point,
        "flights": len(place.flights),
        "inside": inside_of(place.flights, place.point["gps"], WINDOWS),
        "max": {s.metric.key: s.max for s in worst if s.source == _NAVIGATION},
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    helion = HelicopterParameters.from_yaml("helion.yaml")
    aircraft = HelicopterParameters.from_yaml(AIRCRAFT)
    return {
        "trim": trim_of(aircraft),
        "paper": PAPER,
        "solved": {
            name: {"helion": getattr(helion, name), "paper_trim": getattr(aircraft, name)}
            for name in SOLVED
        },
        "flown": [row(place) for place in flown.places(options)],
        "conditions": [conditions(settings_of(gps)).splitlines() for gps in RECEIVERS],
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "paper_trim",
    "./heli python -m evidence.experiments.paper_trim --seeds 1..5",
    "An aircraft with the paper's trim, and its hover test.",
    (1, 2, 3, 4, 5),
    MARGIN,
)


@table("paper_trim")
def paper_trim(results: Results) -> str:
    """Its trim, what it has other than HeLion, and how it flies."""
    record = results["paper_trim"]
    trims = [
        [name, f"{theirs:.4f}", f"{record['trim'][name]:.4f}"]
        for name, theirs in record["paper"].items()
    ]
    numbers = [
        [SOLVED[name], f"{pair['helion']:g}", f"{pair['paper_trim']:g}"]
        for name, pair in record["solved"].items()
    ]
    metrics = METRICS["hover"]
    flights = [
        [
            RECEIVERS[r["gps"]],
            f"{r['inside']} of {r['flights']}",
            *(f"{r['max'][m.key]:.2f} ({m.paper:g})" for m in metrics),
        ]
        for r in record["flown"]
    ]
    head = ["receiver", "inside", *(f"{m.label}, {m.unit}" for m in metrics)]
    furthest = np.max([abs(record["trim"][k] - v) for k, v in record["paper"].items()])
    return (
        f"{grid(['', 'the paper, Table 1', 'paper_trim'], trims)}\n\n"
        f"{grid(['solved for it', 'HeLion', 'paper_trim'], numbers)}\n\n"
        f"{grid(head, flights)}\n\n"
        f"Trim: no entry is further off than {furthest:.1g}. Hover test, default controllers "
        f"designed for it, largest by the state estimate in the scored windows (the paper's), "
        f"{results.seeds('paper_trim')}. {world({'hover test': record['conditions']})}"
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..5"))
