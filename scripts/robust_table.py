# SPDX-License-Identifier: Apache-2.0
"""The proof of the packaged attitude law over the named set of aircraft, and other laws beside it.

Usage: ./heli python scripts/robust_table.py [--laws hinf,pid,lqg,mu]

The packaged law: all that `heli robust --fly` finds. Of the others the worst aircraft found at each
delay, sampled exactly; no proof, which costs most of the time. Prints JSON.
"""

import argparse
import math
import os
import sys

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from heli_flight.loop.settings import resolve
from heli_flight.studies.robust import prove
from heli_flight.studies.robust.aircraft import AircraftSet
from heli_flight.studies.robust.loop import feedback_flown, uncertain_loop
from heli_flight.studies.robust.parameter_table import AircraftRanges, read_ranges
from heli_flight.terminal import json_text
from heli_parameters.parameters import ParameterError


def onsets(laws: str, aircraft: AircraftSet, asked: AircraftRanges) -> dict[str, object]:
    """Sizes at which the worst aircraft found is unstable, delay by delay; 0: the nominal one is.

    None: none up to `prove.FURTHEST` times the set.
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
        found = onset.size if math.isnan(exact) else exact
        sizes.append(found if onset.deltas else None)
    return {"laws": laws, "at_most": sizes}


def main() -> int:
    """Exit code 2, with a sentence, where the packaged law cannot be proved at all."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--laws", default="hinf,pid,lqg,mu")
    others = parser.parse_args().laws.split(",")
    asked = read_ranges([])
    try:
        proof = prove.prove(resolve(), asked, flown=True)
    except ParameterError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    found = [onsets(name, proof.aircraft, asked) for name in others]
    print(json_text({"packaged": prove.as_dict(proof), "others": found}), end="")
    return 0


if __name__ == "__main__":
    sys.exit(main())
