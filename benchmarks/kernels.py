# SPDX-License-Identifier: Apache-2.0
"""What compiling costs: kernels of set-up, and those of the first flight in one process.

    ./heli python benchmarks/kernels.py [--against CHECKOUT] [--quick] [--json]

CPU seconds and compilations, each part from an empty cache, in one process; of another checkout
that is set up, too, one after the other, and the ratio. The parts are those that set-up compiles
side by side.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

FLIGHT = "first flight in one process"


def measure(quick: bool) -> dict[str, dict[str, float]]:
    """CPU seconds and compilations of each part, in this process; quick: of the cheapest one."""
    from numba.core import event

    from heli_flight import loop
    from heli_flight.graph import warm_up
    from heli_flight.settings import resolve

    class Counter(event.Listener):  # type: ignore[misc]
        compiled = 0

        def on_start(self, event: object) -> None:
            self.compiled += 1

        def on_end(self, event: object) -> None:
            return

    counter, found = Counter(), {}
    event.register("numba:compile", counter)
    settings = resolve()
    parts = [(part.__name__.strip("_"), part) for part in warm_up._PARTS]
    for name, part in parts[-1:] if quick else [*parts, (FLIGHT, loop.simulate)]:
        began_s, before = time.process_time(), counter.compiled
        part(settings)
        spent_s = time.process_time() - began_s
        found[name] = {"cpu_s": round(spent_s, 2), "compiled": counter.compiled - before}
    return found


def of_checkout(top: Path, quick: bool) -> dict[str, dict[str, float]]:
    """The same in a process of a checkout's environment, from an empty cache."""
    with tempfile.TemporaryDirectory(prefix="heli_kernels_") as cache:
        env = {**os.environ, "HELI_KERNEL_CACHE": cache, "XDG_CACHE_HOME": cache}
        command = [str(top / "heli"), "python", str(Path(__file__).resolve()), "--inside"]
        command += ["--quick"] if quick else []
        done = subprocess.run(command, env=env, check=True, stdout=subprocess.PIPE, text=True)
    found: dict[str, dict[str, float]] = json.loads(done.stdout)
    return found


def totals(found: dict[str, dict[str, float]]) -> tuple[float, float]:
    """CPU seconds of set-up's kernels, and of the first flight's."""
    flight = found.get(FLIGHT, {}).get("cpu_s", 0.0)
    return sum(part["cpu_s"] for part in found.values()) - flight, flight


def main() -> int:
    """Measure and print; returns the exit code."""
    parser = argparse.ArgumentParser(description="CPU seconds of compiling.")
    parser.add_argument("--against", type=Path, help="another checkout, set up")
    parser.add_argument("--quick", action="store_true", help="the cheapest part alone")
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--inside", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.inside:
        print(json.dumps(measure(asked.quick)))
        return 0
    here = Path(__file__).resolve().parents[1]
    tops = [here] if asked.against is None else [asked.against.resolve(), here]
    found = {str(top): of_checkout(top, asked.quick) for top in tops}
    if asked.json:
        print(json.dumps(found))
        return 0
    for top, parts in found.items():
        print(top)
        for name, part in parts.items():
            print(f"  {name:28} {part['cpu_s']:7.2f} s CPU  {part['compiled']:4.0f} compiled")
    if asked.against is not None and not asked.quick:
        before, after = (totals(parts) for parts in found.values())
        ratios = [new / old for new, old in zip(after, before, strict=True)]
        print(f"set-up's kernels {ratios[0]:.2f}, first flight's {ratios[1]:.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
