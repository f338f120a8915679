# SPDX-License-Identifier: Apache-2.0
"""The proof of the packaged attitude controller over a set of aircraft, and others beside it.

Usage: ./heli python -m evidence.experiments.robust [--control-preset hinf,pid,lqg,mu]

The packaged controller: all that `heli robust --fly` finds. Of the others the worst aircraft found
at each delay, sampled exactly; no proof, which costs most of the time. Prints JSON.
"""

import argparse
import math
import os
import sys
from collections.abc import Mapping
from typing import Any

from evidence.files import Results
from evidence.registry import MARGIN, NOT_COMPARED, produces, table
from evidence.tables import grid
from heli_studies.robust import BROKEN_AT

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from heli_core.rcl_yaml import ParameterError
from heli_flight.cli.common import with_new_names
from heli_flight.settings import resolve
from heli_flight.terminal import json_text
from heli_studies import robust as prove
from heli_studies.robust import (
    AircraftRanges,
    AircraftSet,
    feedback_flown,
    read_ranges,
    uncertain_loop,
)


def onsets(laws: str, aircraft: AircraftSet, asked: AircraftRanges) -> dict[str, object]:
    """Sizes at which the worst aircraft found is unstable, delay by delay; 0: the nominal one is.

    None: none up to `heli_studies.robust.FURTHEST` times the set.
    """
    law = feedback_flown(resolve(laws=laws))
    sizes: list[float | None] = []
    for ticks in asked.delays_ticks:
        try:
            onset = prove.onset_of(uncertain_loop(aircraft, law, ticks), ticks)
        except ParameterError:
            sizes.append(0.0)
            continue
        exact = prove.exact_onset(aircraft, law, ticks, onset)
        first = onset.size if math.isnan(exact) else exact
        sizes.append(first if onset.deltas else None)
    return {"laws": laws, "at_most": sizes}


def main() -> int:
    """Exit code 2, with a sentence, where the packaged controller cannot be proved at all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--control-preset", default="hinf,pid,lqg,mu")
    words = with_new_names(sys.argv[1:], {"--control-preset": 1}, parser.prog)
    others = parser.parse_args(words).control_preset.split(",")
    asked = read_ranges([])
    try:
        proof = prove.prove(resolve(), asked, flown=True)
    except ParameterError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    curves = [onsets(name, proof.aircraft, asked) for name in others]
    print(json_text({"packaged": prove.as_dict(proof), "others": curves}), end="")
    return 0


# -------------------------------------------------------------------------------------------------
# How it is told.
# -------------------------------------------------------------------------------------------------

produces(
    "robust",
    "./heli python -m evidence.experiments.robust",
    "The proof of the packaged attitude controller over the named set, others beside it.",
    relative=MARGIN,
    # How many pieces a proof takes, and how clear it is, hang on rounding.
    loose={"pieces": NOT_COMPARED, "largest_psi": NOT_COMPARED},
)


@table("robust")
def robust(results: Results) -> str:
    """What is proved of the packaged controller over the set, and where others lose it."""
    record = results["robust"]
    packaged = record["packaged"]
    head = ["transport delay, ticks", *(str(case["delay_ticks"]) for case in packaged["cases"])]
    rows = [
        [name, *(_size(case[key]) for case in packaged["cases"])]
        for name, key in (
            ("packaged controller: proved stable up to", "margin_proved"),
            ("unstable, worst aircraft found, at", "margin_at_most"),
            ("the same, sampled exactly", "exact_onset"),
            ("the same, flown (nonlinear)", "flown_onset"),
        )
    ]
    gaps = [case["margin_at_most"] / case["margin_proved"] - 1.0 for case in packaged["cases"]]
    rows.insert(2, ["gap between the two, %", *(f"{100.0 * gap:.1f}" for gap in gaps)])
    rows += [
        [f"`{law['laws']}`: unstable, sampled exactly, at", *map(_size, law["at_most"])]
        for law in record["others"]
    ]
    return (
        f"{grid(head, rows)}\n\nIn ranges of the set (config/robust.yaml of heli_flight): 1 is the "
        "set itself, 0: already the nominal aircraft is lost; –: not within 5 % of the line above, "
        f"or none up to three times the set. {_parts(packaged)}{_over_the_set(packaged)}"
    )


def _parts(packaged: Mapping[str, Any]) -> str:
    cut = [(c["delay_ticks"], c["parts"]) for c in packaged["cases"] if c.get("parts", 1) > 1]
    proved = (f"with {ticks} ticks the box is proved in {parts} parts" for ticks, parts in cut)
    return f"{'; '.join(proved).capitalize()}. " if cut else ""


def _over_the_set(packaged: Mapping[str, Any]) -> str:
    gain, disks = packaged["wind_to_h"], packaged["inverse_disk_margin"]
    model = (
        f"The linear model is within {100.0 * packaged['model_residual']:.2f} % of the aircraft."
    )
    if gain is None:
        return f"The whole set is not proved stable, so no worst gain is stated. {model}"
    return (
        f"Over the whole set, at {packaged['worst_delay_ticks']} ticks: norm from horizontal "
        f"wind to h: "
        f"at most {gain['proved']:.3f} (an aircraft has {gain['found']:.3f}, the nominal one "
        f"{gain['nominal']:.3f}); disk margin "
        + "; ".join(f"{BROKEN_AT[at]}: {_inverse(disk)}" for at, disk in disks.items())
        + f". {model}"
    )


def _inverse(disk: Mapping[str, float]) -> str:
    return (
        f"at least {1.0 / disk['proved']:.2f} (an aircraft has {1.0 / disk['found']:.2f}, the "
        f"nominal one {1.0 / disk['nominal']:.2f})"
    )


def _size(size: float | None) -> str:
    return "–" if size is None else f"{size:.3f}"


if __name__ == "__main__":
    sys.exit(main())
