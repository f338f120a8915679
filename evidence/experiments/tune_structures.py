# SPDX-License-Identifier: Apache-2.0
"""Print what `heli tune` makes of state feedback, of three aircraft and of a cascade, as JSON.

Usage: ./heli python -m evidence.experiments.tune_structures [--seeds 1..5]

Goals are the packaged ones, in the world `honest`; of state feedback a flown one, too, of seeds 101
to 103. PID and position controller of the cascade are flown in `hover`, world `honest`, with RTK;
errors are of truth, in the scored window.
"""

import sys
from collections.abc import Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import yaml

from evidence.experiments.tune import GPS, rms
from evidence.files import Results
from evidence.registry import FIT, NOT_COMPARED, produces, table
from evidence.sweep import Options, print_result
from evidence.tables import grid
from heli_core.command_line import config_folder
from heli_flight.settings import resolve
from heli_studies.campaign.run import fly_seeds
from heli_studies.tune import TuneOrder, as_dict, run
from heli_studies.tune_flown import FLOWN

WORLD = "honest"
PLACE = ("longitudinal", "lateral", "altitude")
THREE = ("helion", "xcell60", "logo600")
CHOOSING: Mapping[str, Any] = {
    "name": FLOWN,
    "kind": FLOWN,
    "seeds": [101, 102, 103],
    "bound": 0.55,
}


def tuned() -> dict[str, dict[str, Any]]:
    """By name what was tuned: `as_dict`."""
    packaged = config_folder("heli_flight") / "tune.yaml"
    rows = yaml.safe_load(packaged.read_text(encoding="utf-8"))["goals"]
    with TemporaryDirectory() as folder:
        goals = Path(folder) / "goals.yaml"
        goals.write_text(yaml.safe_dump({"goals": [*rows, dict(CHOOSING)]}), encoding="utf-8")
        orders = {
            "state": TuneOrder("state", worlds=(WORLD,), goals=goals),
            "three": TuneOrder(aircraft=THREE, worlds=(WORLD,)),
            "cascade": TuneOrder("cascade", worlds=(WORLD,)),
        }
        return {name: as_dict(run(order)) for name, order in orders.items()}


def hovered(values: Mapping[str, Mapping[str, Any]], options: Options) -> dict[str, float]:
    """RMS errors of place, m, with parameters over the preset `pid`."""
    settings = resolve("hover", gps=GPS, laws="pid", world=WORLD, overrides=values)
    flights = fly_seeds(settings, options.seeds)
    return {axis: rms(flights, axis) for axis in PLACE}


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    found = tuned()
    return {
        "tuned": found,
        "hover_rms_m": [
            {"variant": "shipped", **hovered({}, options)},
            {"variant": "tuned", **hovered(found["cascade"]["parameters"], options)},
        ],
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "tune_structures",
    "./heli python -m evidence.experiments.tune_structures --seeds 1..5",
    "What `heli tune` makes of state feedback, of one PID for three aircraft, and of a cascade.",
    tuple(range(1, 6)),
    relative=FIT,
    loose={"parameters": NOT_COMPARED, "starts": NOT_COMPARED, "gains": NOT_COMPARED},
)


def goals(record: Mapping[str, Any]) -> str:
    """Of each goal its bound, what the search began with and what came of it."""
    rows = [
        [
            f"{one['name']}{', hard' if one['hard'] else ''}",
            one["aircraft"],
            f"{one['bound']:g}",
            f"{one['before']:.3f}",
            f"{one['value']:.3f}",
            "yes" if one["met"] else "no",
        ]
        for one in record["goals"]
    ]
    return grid(["goal", "aircraft", "bound", "began with", "tuned", "met"], rows)


@table("tune_structures")
def tune_structures(results: Results) -> str:
    """The goals before and after, and what is flown of the cascade."""
    record, seeds = results["tune_structures"], results.read["tune_structures"]["seeds"]
    found = record["tuned"]
    hover = [
        [one["variant"], *(f"{one[axis]:.3f}" for axis in PLACE)] for one in record["hover_rms_m"]
    ]
    first, *_, last = CHOOSING["seeds"]
    parts = [
        f"State feedback, begun with F, G of the synthesis; `flown`: seeds {first} to {last}.",
        goals(found["state"]),
        "One PID for three aircraft, begun with the rule's for the first.",
        goals(found["three"]),
        "PID and position controller, begun with those of the preset `pid`.",
        goals(found["cascade"]),
        "The same in `hover`, world `honest`, RTK: RMS error of place from truth, median over "
        f"seeds {seeds[0]} to {seeds[-1]}.",
        grid(["PID and position controller", *(f"{axis}, m" for axis in PLACE)], hover),
    ]
    return "\n\n".join(parts)


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..5"))
