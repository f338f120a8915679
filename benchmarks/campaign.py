# SPDX-License-Identifier: Apache-2.0
"""Measure a campaign on one and on two workers, and a worker's memory over many flights.

Run it by `./heli python benchmarks/campaign.py [--quick] [--json]`. Both as `heli campaign` flies
them, on processes of this machine, with rows in Parquet. Speed: hover tests of 60 s on dispersed
aircraft, with one worker and with two in turn, without the workers' start. Memory: short flights on
one worker, its resident memory after every few of them.
"""

import argparse
import json
import multiprocessing
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import yaml

from heli_studies.campaign.run import Store
from heli_studies.campaign.spec import CAUSE, FlightEnding, Spec, spec_of
from heli_studies.campaign.workers import Fly, flier, tasks

SPEC = Path(__file__).resolve().parents[1] / "examples" / "campaign_paper.yaml"
FLIGHTS, ROUNDS, CHUNK, WORKERS = 200, 3, 5, (1, 2)
SHORT_FLIGHTS, SHORT_S, LOOKS = 10_000, 1.0, 20
_WARM_TASKS = 4
QUICK = {"flights": 4, "rounds": 1, "short_flights": 20, "looks": 2}
GOALS = {"flights_1000_s": 75.0, "efficiency": 0.9}
_MB = 1e-6


def _spec(folder: Path, **changes: Any) -> tuple[Spec, Path]:
    told = yaml.safe_load(SPEC.read_text(encoding="utf-8")) | changes
    file = folder / "spec.yaml"
    file.write_text(yaml.safe_dump(told), encoding="utf-8")
    return spec_of(file), file


def _flown(fly: Fly, spec: Spec, file: Path, todo: Sequence[Sequence[int]], to: Path) -> float:
    """Wall time (s) of these flights, the rows' files included."""
    begun = time.perf_counter()
    store = Store.begin(to, spec, file)
    count = 0
    for rows in fly(spec, todo):
        store.put(rows)
        count += len(rows)
        assert all(row[CAUSE] == FlightEnding.FLOWN for row in rows)
    assert count == sum(map(len, todo))
    return time.perf_counter() - begun


def speed(flights: int, rounds: int) -> dict[str, Any]:
    """Flights per second by number of workers, medians of rounds in turn; and the efficiency."""
    rates: dict[int, list[float]] = {workers: [] for workers in WORKERS}
    with tempfile.TemporaryDirectory(prefix="heli_benchmark_") as folder:
        spec, file = _spec(Path(folder), flights=flights, chunk=min(CHUNK, flights // 2))
        todo = tasks(spec, set())
        for number in range(rounds):
            for workers in WORKERS:
                with flier(workers) as fly:
                    # Each worker loads the kernels with its first flight.
                    list(fly(spec, [[0]] * _WARM_TASKS * workers))
                    wall = _flown(fly, spec, file, todo, Path(folder, f"{number}_{workers}"))
                rates[workers].append(flights / wall)
                print(f"{workers} workers: {flights / wall:.2f} flights/s", file=sys.stderr)
    middle = {workers: statistics.median(found) for workers, found in rates.items()}
    one, most = min(WORKERS), max(WORKERS)
    return {
        "flights": flights, "rounds": rounds,
        "duration_s": float(spec.base.scenario_parameters["duration_s"]),
        "rates": {str(workers): rate for workers, rate in middle.items()},
        "flights_1000_s": 1000.0 / middle[most],
        "efficiency": middle[most] / (most * middle[one]),
    }  # fmt: skip


def _resident_mb(process: int) -> float:
    pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") * _MB


def memory(flights: int, looks: int) -> dict[str, Any]:
    """Resident memory (MB) of a worker after so many flights."""
    found: list[dict[str, float]] = []
    with tempfile.TemporaryDirectory(prefix="heli_benchmark_") as folder:
        spec, file = _spec(Path(folder), flights=flights, duration_s=SHORT_S, chunk=10)
        todo = tasks(spec, set())
        step = max(1, len(todo) // looks)
        with flier(1) as fly:
            done = 0
            for first in range(0, len(todo), step):
                some = todo[first : first + step]
                _flown(fly, spec, file, some, Path(folder, str(first)))
                done += sum(map(len, some))
                (worker,) = multiprocessing.active_children()
                resident = _resident_mb(worker.pid)
                found.append({"flights": done, "resident_mb": resident})
                print(f"{done} flights: {resident:.1f} MB", file=sys.stderr)
    return {"duration_s": SHORT_S, "looks": found}


def main() -> int:
    """Print the figures; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a few flights")
    parser.add_argument("--json", action="store_true", help="print JSON")
    asked = parser.parse_args()
    whole = {
        "flights": FLIGHTS, "rounds": ROUNDS, "short_flights": SHORT_FLIGHTS, "looks": LOOKS,
    }  # fmt: skip
    size = QUICK if asked.quick else whole
    found = {
        "speed": speed(size["flights"], size["rounds"]),
        "memory": memory(size["short_flights"], size["looks"]),
        "goals": GOALS,
    }
    if asked.json:
        print(json.dumps(found))
        return 0
    told = found["speed"]
    for workers, rate in told["rates"].items():
        print(f"{workers} workers: {rate:.2f} flights of {told['duration_s']:g} s per second")
    print(f"1000 flights in {told['flights_1000_s']:.0f} s (goal {GOALS['flights_1000_s']:g}); "
          f"efficiency {told['efficiency']:.2f} (goal {GOALS['efficiency']:g})")  # fmt: skip
    for look in found["memory"]["looks"]:
        print(f"{look['flights']:6.0f} short flights: {look['resident_mb']:.1f} MB")
    return 0


if __name__ == "__main__":
    sys.exit(main())
