# SPDX-License-Identifier: Apache-2.0
"""Print what `heli tune` makes of the packaged PID, by its goals and in flight, as JSON.

Usage: ./heli python -m evidence.experiments.tune [--seeds 1..5]

The goals are the packaged ones; beside the PID stands output feedback of order 4. Both PIDs are
flown in the scenario `attitude_gusts` with RTK, in the worlds `paper` and `honest`; errors are of
truth, in the scored window.
"""

import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from evidence.files import Results
from evidence.registry import FIT, NOT_COMPARED, produces, table
from evidence.sweep import Options, over, print_result
from evidence.tables import grid
from heli_core.command_line import config_folder
from heli_flight.scoring import DECIDES
from heli_flight.settings import Settings, resolve
from heli_studies.campaign.run import FlownSeed, fly_seeds
from heli_studies.tune import PACKAGED, TuneOrder, as_dict, run

SCENARIO, GPS = "attitude_gusts", "rtk"
WORLDS = ("paper", "honest")
AXES = ("roll", "pitch")
VARIANTS: Mapping[str, tuple[Path, ...]] = {
    "shipped": (),
    "tuned": (config_folder("heli_flight") / PACKAGED,),
}
ORDERS = {"pid": TuneOrder(), "output:4": TuneOrder("output:4")}


def settings_of(world: str, files: Sequence[Path]) -> Settings:
    """The flight of a variant in a world."""
    return resolve(SCENARIO, gps=GPS, laws="pid", world=world, params=files)


@over(variant=tuple(VARIANTS), world=WORLDS)
def flown(variant: str, world: str, seed: int) -> FlownSeed:
    """Figures of a flight."""
    return fly_seeds(settings_of(world, VARIANTS[variant]), [seed])[0]


def rms(flights: Sequence[FlownSeed], axis: str) -> float:
    """Median over the flights of the RMS error of an axis, deg."""
    scores = [s for f in flights for s in f.figures.of(DECIDES)]
    of = [s.rms for s in scores if (s.metric.key, s.source) == (axis, "truth")]
    return float(np.median(of))


def experiment(options: Options) -> dict[str, Any]:
    """All that the tables show."""
    places = list(flown.places(options, flown.points))
    return {
        "tuned": [as_dict(run(order)) for order in ORDERS.values()],
        "rms_deg": [
            {**place.point, **{axis: rms(place.flights, axis) for axis in AXES}} for place in places
        ],
    }


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "tune",
    "./heli python -m evidence.experiments.tune --seeds 1..5",
    "What `heli tune` makes of the packaged PID, and an output feedback of order 4.",
    tuple(range(1, 6)),
    relative=FIT,
    loose={"parameters": NOT_COMPARED, "starts": NOT_COMPARED},
)


@table("tune")
def tune(results: Results) -> str:
    """The goals before and after, and what is flown."""
    record = results["tune"]
    pid, output = record["tuned"]
    head = ["goal", "aircraft", "bound", "PID as shipped", "PID tuned", "output feedback, order 4"]
    rows = [
        [
            f"{one['name']}{', hard' if one['hard'] else ''}",
            one["aircraft"],
            f"{one['bound']:g}",
            f"{one['before']:.3f}",
            f"{one['value']:.3f}",
            f"{other['value']:.3f}",
        ]
        for one, other in zip(pid["goals"], output["goals"], strict=True)
    ]
    flights = [
        [one["variant"], one["world"], *(f"{one[axis]:.3f}" for axis in AXES)]
        for one in record["rms_deg"]
    ]
    seeds = results.read["tune"]["seeds"]
    return (
        f"{grid(head, rows)}\n\nIn flight, attitude in gusts with RTK: RMS error from truth, "
        f"median over seeds {seeds[0]} to {seeds[-1]}.\n\n"
        f"{grid(['PID', 'world', *(f'{axis}, deg' for axis in AXES)], flights)}"
    )


if __name__ == "__main__":
    sys.exit(print_result(__doc__, experiment, "1..5"))
