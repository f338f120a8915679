# SPDX-License-Identifier: Apache-2.0
"""The hover test on aircraft that the controllers do not know: terms on, eq. (7); JSON.

Usage: ./heli python -m evidence.experiments.term_flights [--seeds 1..20]

One process, both receivers, the packaged design; the aircraft in flight differs, nothing else.
"""

import sys
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from evidence.files import Results
from evidence.registry import TWENTY, produces, table
from evidence.sweep import Options, Place, over, print_result
from evidence.tables import grid, world
from heli_core.metrics import METRICS
from heli_dynamics_sim import plant
from heli_dynamics_sim.aircraft import ModelOptions
from heli_flight.layers import GPS_PRESETS
from heli_flight.loop import build, fly_loop
from heli_flight.result import conditions
from heli_flight.scoring import STRETCHES, WINDOWS
from heli_flight.settings import resolve
from heli_studies.campaign.run import FlownSeed, inside_of, worst_of_seeds

ROTOR = ("flap_back", "inflow", "ground_effect", "vortex_ring")
AIRCRAFT: dict[str, dict[str, Any]] = {
    "as identified": {},
    "coupling by eq. (7)": {"coupling": "eq7"},
    "flap_back": {"terms": ModelOptions(flap_back=True)},
    "the rotor's four terms": {"terms": ModelOptions()._replace(**dict.fromkeys(ROTOR, True))},
}


@over(gps=tuple(GPS_PRESETS), aircraft=tuple(AIRCRAFT))
def fly(gps: str, aircraft: str, seed: int) -> FlownSeed:
    """The flight of an aircraft with its fields changed."""
    settings = resolve("hover", gps)
    nominal = plant.PlantConfig.from_parameters(settings.nodes["plant"])
    config = replace(nominal, helicopter=replace(nominal.helicopter, **AIRCRAFT[aircraft]))
    flight = fly_loop(build(settings.with_seed(seed), plant_config=config), settings)
    return FlownSeed.of(seed, flight, settings)


def row_of(place: Place[FlownSeed]) -> dict[str, Any]:
    """How many were lost and inside the paper's figures, and the largest value per metric."""
    gps, flown = place.point["gps"], place.flights
    return {
        "aircraft": place.point["aircraft"],
        "gps": gps,
        "flights": len(flown),
        "lost": sum(bool(f.lost) for f in flown),
        "sentences": sorted({f.lost for f in flown if f.lost}),
        "inside": {stretch: inside_of(flown, gps, stretch) for stretch in STRETCHES},
        "max": {
            stretch: {s.name: s.max for s in worst_of_seeds(flown, stretch).values()}
            for stretch in STRETCHES
        },
    }


def experiment(options: Options) -> dict[str, Any]:
    """All that the table shows."""
    conditions_of = [conditions(resolve("hover", gps)).splitlines() for gps in GPS_PRESETS]
    rows = [row_of(place) for place in fly.places(options)]
    return {"seeds": options.seeds, "conditions": conditions_of, "rows": rows}


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "term_flights",
    "./heli python -m evidence.experiments.term_flights --seeds 1..20",
    "The hover test with terms of the rotor, and with eq. (7), unknown to the controllers.",
    TWENTY,
)


@table("term_flights")
def term_flights(results: Results) -> str:
    """The hover test on aircraft that the controllers do not know."""
    record = results["term_flights"]
    rows = []
    for row in record["rows"]:
        most = row["max"][WINDOWS]
        inside = [f"{row['inside'][stretch]} of {row['flights']}" for stretch in STRETCHES]
        rows.append([row["aircraft"], row["gps"], str(row["lost"]), *inside, *_largest(most)])
    head = ["aircraft in flight", "GPS", "lost", *(f"inside, {w}" for w in STRETCHES.values())]
    head += [f"{metric.label}, {metric.unit}" for metric in METRICS["hover"]]
    flown = {"Hover test": record["conditions"]}
    return (
        f"{grid(head, rows)}\n\nInside: the paper's figures, state estimate. Largest values "
        f"over the windows and {results.seeds('term_flights')}, state estimate. {world(flown)}"
    )


def _largest(most: Mapping[str, Any]) -> list[str]:
    names = [f"{metric.key} (navigation)" for metric in METRICS["hover"]]
    return [f"{most[name]:.2f}" if name in most else "-" for name in names]


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment))
