#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Digests of what flies, bit for bit: whether a change of the code changed a flight.

    ./heli python scripts/flight_digests.py before.json        # at the commit before
    ./heli python scripts/flight_digests.py after.json --against before.json

Seeds 1 to 5 of hover and attitude with both receivers in the worlds paper and honest; the whole
flight from the ground to the ground, a sequence of commands, one flight whose links have faults,
one identification. A digest is the SHA-256 of all signals of a flight: truth, navigation record,
reference, set-point, actuators and wind. Exit code 1 where one differs or is missing.
"""

import argparse
import hashlib
import itertools
import json
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import heli

SEEDS = range(1, 6)
GROUPS = ("truth", "nav", "reference", "setpoint", "u", "wind")
# Of link faults `heli.fly` takes a file only.
LINK_FAULTS = """
faults:
  - {what: link, from: observer, to: inner_loop, topic: odom, kind: loss, value: 0.5,
     start_s: 10.0, duration_s: 10.0}
  - {what: link, from: inner_loop, to: plant, topic: actuators, kind: delay, value: 0.02,
     start_s: 25.0, duration_s: 5.0}
"""


def orders(folder: Path) -> Iterator[tuple[str, dict[str, Any]]]:
    """Name of each flight, and the arguments of `heli.fly`; files go into the folder."""
    for scenario, gps, world, seed in itertools.product(
        ("hover", "attitude"), ("standalone", "rtk"), ("paper", "honest"), SEEDS
    ):
        order = {"scenario": scenario, "gps": gps, "world": world, "seed": seed}
        yield f"{scenario} {gps} {world} {seed}", order
    for scenario in ("takeoff_land", "sequence"):
        yield f"{scenario} 1", {"scenario": scenario, "seed": 1}
    faults = folder / "faults.yaml"
    faults.write_text(LINK_FAULTS)
    yield "hover with link faults 1", {"seed": 1, "faults": faults}


def digest(arrays: dict[str, Any]) -> str:
    """SHA-256 (hex) of names, shapes, types and bytes of arrays."""
    total = hashlib.sha256()
    for name, values in sorted(arrays.items()):
        array = np.ascontiguousarray(values)
        total.update(f"{name} {array.shape} {array.dtype}".encode() + array.tobytes())
    return total.hexdigest()


def of_flight(order: dict[str, Any]) -> str:
    """Digest of a flight flown now, in this process."""
    flight = heli.fly(**order, quiet=True)
    return digest({f"{g}.{n}": v for g in GROUPS for n, v in getattr(flight, g).items()})


def of_identification() -> str:
    """Digest of what an identification finds from its two flights."""
    found = heli.identify(seed=1, quiet=True)
    return digest({"A": found.A, "B": found.B, "E": found.E})


def main() -> int:
    """Fly, write, compare; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path, help="JSON file to write")
    parser.add_argument("--against", type=Path, help="JSON file of another commit")
    given = parser.parse_args()
    found = {}
    with tempfile.TemporaryDirectory() as folder:
        for name, order in orders(Path(folder)):
            found[name] = of_flight(order)
            print(f"{name}: {found[name]}", flush=True)
    found["identification 1"] = of_identification()
    given.out.write_text(json.dumps(found, indent=1) + "\n")
    if given.against is None:
        return 0
    before = json.loads(given.against.read_text())
    differs = [n for n in sorted({*before, *found}) if before.get(n) != found.get(n)]
    print(f"{len(before)} before, {len(found)} now, {len(differs)} differ", *differs, sep="\n  ")
    return 1 if differs else 0


if __name__ == "__main__":
    sys.exit(main())
