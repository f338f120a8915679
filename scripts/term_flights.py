# SPDX-License-Identifier: Apache-2.0
"""The hover test on aircraft that the controllers do not know: terms on, eq. (7); JSON.

Usage: ./heli python scripts/term_flights.py [--seeds 1..20]

One process, both receivers, the packaged design; the aircraft in flight differs, nothing else.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from seeds_option import parser_with_seeds

from heli_dynamics_sim import plant
from heli_dynamics_sim.terms import Terms
from heli_flight.loop.closed_loop import build, fly_loop
from heli_flight.loop.layers import GPS_PRESETS
from heli_flight.loop.result import conditions
from heli_flight.loop.scoring import STRETCHES
from heli_flight.loop.settings import Settings, resolve
from heli_flight.studies.campaign import FlownSeed, inside_of, worst

ROTOR = ("flap_back", "inflow", "ground_effect", "vortex_ring")
AIRCRAFT: dict[str, dict[str, Any]] = {
    "as identified": {},
    "coupling by eq. (7)": {"coupling": "eq7"},
    "flap_back": {"terms": Terms(flap_back=True)},
    "the rotor's four terms": {"terms": Terms()._replace(**dict.fromkeys(ROTOR, True))},
}


def fly(settings: Settings, changes: dict[str, Any], seeds: Sequence[int]) -> list[FlownSeed]:
    """The flights of an aircraft with these fields changed."""
    nominal = plant.PlantConfig.from_parameters(settings.nodes["plant"])
    config = replace(nominal, helicopter=replace(nominal.helicopter, **changes))
    flown = []
    for seed in seeds:
        flight = fly_loop(build(settings.with_seed(seed), plant_config=config), settings)
        flown.append(FlownSeed.of(seed, flight, settings.scenario))
    return flown


def row_of(name: str, gps: str, flown: Sequence[FlownSeed]) -> dict[str, Any]:
    """How many were lost and inside the paper's figures, and the largest value per metric."""
    return {
        "aircraft": name,
        "gps": gps,
        "flights": len(flown),
        "lost": sum(bool(f.lost) for f in flown),
        "sentences": sorted({f.lost for f in flown if f.lost}),
        "inside": {stretch: inside_of(flown, gps, stretch) for stretch in STRETCHES},
        "max": {
            stretch: {s.name: s.max for s in worst(flown, stretch).values()}
            for stretch in STRETCHES
        },
    }


def main() -> None:
    """Print the JSON."""
    seeds = parser_with_seeds(__doc__).parse_args().seeds
    rows, told = [], []
    for gps in GPS_PRESETS:
        settings = resolve("hover", gps)
        told.append(conditions(settings).splitlines())
        for name, changes in AIRCRAFT.items():
            rows.append(row_of(name, gps, fly(settings, changes, seeds)))
    print(json.dumps({"seeds": seeds, "conditions": told, "rows": rows}))


if __name__ == "__main__":
    main()
