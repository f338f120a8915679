#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Speed of the node graph in lockstep beside a bare ring of rclpy nodes, in turn.

    ./heli python benchmarks/graph.py [--rounds N] [--seconds S] [--quick] [--json]

The ring (`ring.py`) does nothing but pass messages on: a cycle of it stands beside a tick of the
flight, which computes, sends three times as many messages and has all of them recorded. Both with a
process per node, and with the four nodes in one. Each round measures everything once; a ratio is
that of one round, and what is given is the median of the rounds. Ratios are what counts: rates are
the machine's.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import ring

from heli_core.ticks import TICKS_PER_S

SHAPES = {"four processes": False, "one process": True}
GOALS = {"four processes": 0.8, "one process": 0.6}
"""Ticks per second of the graph over cycles per second of the ring of message objects."""
ROUNDS, SECONDS, CYCLES = 5, 30.0, 3000
QUICK_SECONDS, QUICK_CYCLES = 2.0, 300
SEED = 1


def ticks_per_s(composed: bool, seconds: float) -> float:
    """Ticks per second of wall time of a recorded hover flight, by the plant's own clock.

    Raises
    ------
    SystemExit
        The flight failed, or its bag has gaps: then it is no flight to measure.
    """
    with tempfile.TemporaryDirectory(prefix="heli_bench_") as folder:
        command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report", "--json"]
        command += ["--lockstep", "--world", "paper", "--seed", str(SEED)]
        command += ["--duration", str(seconds), "--out", str(Path(folder) / "flight")]
        command += ["--composed"] if composed else []
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode not in (0, 1):
            raise SystemExit(f"graph: {done.stderr.strip() or 'the flight failed'}")
        result = json.loads(done.stdout)
    if result["notes"] or result["lost"]:
        raise SystemExit(f"graph: {'; '.join([result['lost'], *result['notes']])}")
    return float(result["real_time_factor"] * TICKS_PER_S)


def one_round(
    shapes: Sequence[str], forms: Sequence[str], seconds: float, cycles: int
) -> dict[str, dict[str, float]]:
    """Rates per shape: of the graph, and of the ring in its forms."""
    found: dict[str, dict[str, float]] = {}
    for shape in shapes:
        composed = SHAPES[shape]
        rates = {form: ring.cycles_per_s(ring.Order(composed, form, cycles)) for form in forms}
        found[shape] = {**rates, "graph": ticks_per_s(composed, seconds)}
    return found


def measure(
    rounds: int, shapes: Sequence[str], forms: Sequence[str], seconds: float, cycles: int
) -> dict[str, Any]:
    """Medians over rounds: rates, and ratios of the graph to the ring."""
    ring.use_free_domain()
    load_before = os.getloadavg()[0]
    flown = [one_round(shapes, forms, seconds, cycles) for _ in range(rounds)]
    rates = {
        shape: {name: statistics.median(r[shape][name] for r in flown) for name in flown[0][shape]}
        for shape in shapes
    }
    ratios = {
        shape: {
            form: statistics.median(r[shape]["graph"] / r[shape][form] for r in flown)
            for form in forms
        }
        for shape in shapes
    }
    return {
        "rounds": rounds,
        "seconds": seconds,
        "cycles": cycles,
        "goals": GOALS,
        "machine": {"cores": len(os.sched_getaffinity(0)), "load_before": load_before},
        "rates": rates,
        "ratios": ratios,
    }


def show(found: dict[str, Any]) -> None:
    """Print the table."""
    machine = found["machine"]
    print(
        f"medians of {found['rounds']} rounds in turn, flights of {found['seconds']:g} s, "
        f"{machine['cores']} cores, load before {machine['load_before']:.1f}"
    )
    for shape, rates in found["rates"].items():
        print(
            f"{shape}: graph {rates['graph']:.0f} ticks/s, "
            f"{rates['graph'] / TICKS_PER_S:.1f} times real time"
        )
        for form, ratio in found["ratios"][shape].items():
            goal = f" (goal {found['goals'][shape]:g})" if form == "objects" else ""
            print(f"  ring of {form:<8} {rates[form]:6.0f} cycles/s, ratio {ratio:.2f}{goal}")


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rounds", type=int, default=ROUNDS)
    parser.add_argument("--seconds", type=float, default=SECONDS, help="length of a flight")
    parser.add_argument("--quick", action="store_true", help="one short round of one process")
    parser.add_argument("--json", action="store_true", help="print JSON")
    asked = parser.parse_args()
    if asked.quick:
        found = measure(1, ["one process"], ring.FORMS[:1], QUICK_SECONDS, QUICK_CYCLES)
    else:
        found = measure(asked.rounds, list(SHAPES), ring.FORMS, asked.seconds, CYCLES)
    if asked.json:
        print(json.dumps(found))
    else:
        show(found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
