# SPDX-License-Identifier: Apache-2.0
"""Print what `heli tune` makes of its structures, by their goals and in flight, as JSON.

Usage: ./heli python -m evidence.experiments.tune [--seeds 1..10]

Goals are the packaged ones, for the plant's aircraft in the worlds `paper` and `honest`, and one
PID for three aircraft. PID and state feedback are tuned with a flown goal, too, of seeds 101 to
103, by which the PID is the better of two starts. The packaged PIDs are flown in the scenario
`attitude_gusts`, PID and position controller of the cascade in `hover`, with RTK; errors are of
truth, in the scored window.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml

from evidence.files import Results
from evidence.registry import FIT, NOT_COMPARED, produces, table
from evidence.sweep import Options, over, print_result
from evidence.tables import grid
from heli_core.command_line import config_folder
from heli_flight.scoring import DECIDES
from heli_flight.settings import Settings, resolve
from heli_studies.campaign.run import FlownSeed, fly_seeds
from heli_studies.tune import PACKAGED, TuneOrder, as_dict, run
from heli_studies.tune_flown import FLOWN

SCENARIO, GPS = "attitude_gusts", "rtk"
WORLDS = ("paper", "honest")
AXES = ("roll", "pitch")
PLACE = ("longitudinal", "lateral", "altitude")
VARIANTS: Mapping[str, tuple[Path, ...]] = {
    "shipped": (),
    "tuned": (config_folder("heli_flight") / PACKAGED,),
}
THREE = ("helion", "xcell60", "logo600")
CHOOSING_SEEDS = [101, 102, 103]
HOVERED_SEEDS = range(1, 6)
FLOWN_BOUND_DEG = 0.55


def settings_of(world: str, files: Sequence[Path]) -> Settings:
    """The flight of a variant in a world."""
    return resolve(SCENARIO, gps=GPS, laws="pid", world=world, params=files)


@over(variant=tuple(VARIANTS), world=WORLDS)
def flown(variant: str, world: str, seed: int) -> FlownSeed:
    """Figures of a flight."""
    return fly_seeds(settings_of(world, VARIANTS[variant]), [seed])[0]


def rms(flights: Sequence[FlownSeed], axis: str) -> float:
    """Median over the flights of the RMS error of an axis, deg or m."""
    scores = [s for f in flights for s in f.figures.of(DECIDES)]
    of = [s.rms for s in scores if (s.metric.key, s.source) == (axis, "truth")]
    return float(np.median(of))


def tuned() -> dict[str, dict[str, Any]]:
    """By name what was tuned: `as_dict`."""
    packaged = config_folder("heli_flight") / "tune.yaml"
    rows = yaml.safe_load(packaged.read_text(encoding="utf-8"))["goals"]
    rows.append({"name": FLOWN, "kind": FLOWN, "seeds": CHOOSING_SEEDS, "bound": FLOWN_BOUND_DEG})
    with TemporaryDirectory() as folder:
        goals = Path(folder) / "goals.yaml"
        goals.write_text(yaml.safe_dump({"goals": rows}), encoding="utf-8")
        orders = {
            "pid": TuneOrder(),
            "output:4": TuneOrder("output:4"),
            "state": TuneOrder("state", goals=goals),
            "two_starts": TuneOrder(goals=goals, starts=2),
            "three": TuneOrder(aircraft=THREE, worlds=("honest",)),
            "cascade": TuneOrder("cascade"),
        }
        return {name: as_dict(run(order)) for name, order in orders.items()}


def hovered(values: Mapping[str, Mapping[str, Any]]) -> dict[str, float]:
    """RMS errors of place in `hover`, m, world `honest`, with parameters over the preset `pid`."""
    settings = resolve("hover", gps=GPS, laws="pid", world="honest", overrides=values)
    flights = fly_seeds(settings, HOVERED_SEEDS)
    return {axis: rms(flights, axis) for axis in PLACE}


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    places = list(flown.places(options, flown.points))
    found = tuned()
    return {
        "tuned": found,
        "rms_deg": [
            {**place.point, **{axis: rms(place.flights, axis) for axis in AXES}} for place in places
        ],
        "better_of_seeds": {
            axis: sum(
                rms([mine], axis) < rms([its], axis)
                for its, mine in zip(places[1].flights, places[3].flights, strict=True)
            )
            for axis in AXES
        },
        "hover_rms_m": [
            {"variant": "shipped", **hovered({})},
            {"variant": "tuned", **hovered(found["cascade"]["parameters"])},
        ],
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "tune",
    "./heli python -m evidence.experiments.tune --seeds 1..10",
    "What `heli tune` makes of PID, output and state feedback, a cascade, and three aircraft.",
    tuple(range(1, 11)),
    relative=FIT,
    loose={"parameters": NOT_COMPARED, "starts": NOT_COMPARED, "gains": NOT_COMPARED},
)


def goal_rows(record: Mapping[str, Any], *others: Mapping[str, Any]) -> list[list[str]]:
    """Of each goal its bound, what the search began with, what came of it and of the others."""
    return [
        [
            f"{one['name']}{', hard' if one['hard'] else ''}",
            one["aircraft"],
            f"{one['bound']:g}",
            f"{one['before']:.3f}",
            *(f"{each['value']:.3f}" for each in (one, *beside)),
        ]
        for one, *beside in zip(record["goals"], *(other["goals"] for other in others), strict=True)
    ]


@table("tune")
def tune(results: Results) -> str:
    """The goals before and after, and what is flown."""
    record = results["tune"]
    found = record["tuned"]
    head = ["goal", "aircraft", "bound", "PID as shipped", "PID tuned", "output feedback, order 4"]
    began = ["goal", "aircraft", "bound", "began with", "tuned"]
    flights = [
        [one["variant"], one["world"], *(f"{one[axis]:.3f}" for axis in AXES)]
        for one in record["rms_deg"]
    ]
    hover = [
        [one["variant"], *(f"{one[axis]:.3f}" for axis in PLACE)] for one in record["hover_rms_m"]
    ]
    seeds = results.read["tune"]["seeds"]
    better = [f"{axis} {record['better_of_seeds'][axis]}" for axis in AXES]
    of_two = [one for one in found["two_starts"]["goals"] if one["kind"] == FLOWN]
    chosen = [[one["aircraft"], f"{one['before']:.3f}", f"{one['value']:.3f}"] for one in of_two]
    return "\n\n".join(
        [
            grid(head, goal_rows(found["pid"], found["output:4"])),
            "State feedback: F and G of eq. (17), from those of the synthesis; `flown` is the "
            "larger of roll's and pitch's RMS error in `attitude_gusts`, deg, median over seeds "
            f"{CHOOSING_SEEDS[0]} to {CHOOSING_SEEDS[-1]}.",
            grid(began, goal_rows(found["state"])),
            "One PID for three aircraft, from the rule's for the first.",
            grid(began, goal_rows(found["three"])),
            "Cascade: the PID and the position controller's K_P and K_D, from those of the preset "
            "`pid`.",
            grid(began, goal_rows(found["cascade"])),
            "In flight, attitude in gusts with RTK: RMS error from truth, median over seeds "
            f"{seeds[0]} to {seeds[-1]}. In `honest` the tuned one is better on so many of "
            f"{len(seeds)} seeds: {', '.join(better)}.",
            grid(["PID", "world", *(f"{axis}, deg" for axis in AXES)], flights),
            "The PID of two starts that a flown goal chose, its seeds as above: the larger RMS "
            "error, deg.",
            grid(["world", "shipped", "chosen"], chosen),
            "The cascade in `hover`, world `honest`, RTK: RMS error of place from truth, median "
            f"over seeds {HOVERED_SEEDS[0]} to {HOVERED_SEEDS[-1]}.",
            grid(["PID and position controller", *(f"{axis}, m" for axis in PLACE)], hover),
        ]
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..10"))
