#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Where a tick of the graph in lockstep goes: processor time of each process, by what it does.

    ./heli python benchmarks/graph_profile.py [--py-spy PATH] [--seconds S] [--before FILE] [--json]

Processor time is what Linux says (`schedstat`), of the thread that serves a process's nodes and of
those of DDS. Where the four nodes share a process, which hardly ever waits, py-spy (a developer's
tool, no part of this stack) looks 200 times a second what that thread does. `--before` puts what
this script said of an earlier state beside it.
"""

import argparse
import contextlib
import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import ring

from heli_core.ticks import TICKS_PER_S

SHAPES = {
    "four processes": ("plant", "observer", "inner_loop", "outer_loop", "recorder"),
    "one process": ("composed", "recorder"),
}
SECONDS, ROUNDS, SAMPLES_PER_S = 20.0, 3, 200
_PLACES = (
    ("publish", ("rclpy/publisher.py", "create_output", "lifecycle/")),
    ("executor, taking messages", ("Spinning.serve",)),
    ("bytes and arrays", ("cdr.py", "messages.py", "transforms.py", "diagnostics.py")),
    ("bag", ("heli_bags/", "rosbag2/")),
    ("which message when", ("heli_msgs_bridge/",)),
    ("kernels and steps", ("/node.py", "heli_", "numpy/")),
)
"""What a sample counts as: the first whose words are in its innermost frame."""


def what(frame: str) -> str:
    """What the innermost frame of a sample does."""
    found = (name for name, words in _PLACES if any(word in frame for word in words))
    return next(found, "other")


def shares(raw: str) -> dict[str, float]:
    """Shares of what the serving thread does, from py-spy's raw stacks."""
    counts: Counter[str] = Counter()
    for line in raw.splitlines():
        stack, _, count = line.rpartition(" ")
        if "Spinning.serve" in stack:
            counts[what(stack.rpartition(";")[2])] += int(count)
    total = sum(counts.values())
    return {name: count / total for name, count in counts.most_common()}


def processor_ns(pid: int) -> tuple[int, int]:
    """Processor time of a process so far: of its first thread, and of the others."""
    own = others = 0
    for task in Path(f"/proc/{pid}/task").iterdir():
        spent = int((task / "schedstat").read_text().split()[0])
        own, others = (spent, others) if task.name == str(pid) else (own, others + spent)
    return own, others


def pid_of(log: Path) -> int:
    """The process that writes a log."""
    for link in Path("/proc").glob("[0-9]*/fd/1"):
        try:
            if os.readlink(link) == str(log):
                return int(link.parts[2])
        except OSError:
            continue
    raise SystemExit(f"graph_profile: nobody writes {log}")


def fly(shape: str, seconds: float, py_spy: str = "") -> dict[str, Any]:
    """Fly once; without py-spy processor time per tick and process, with it shares."""
    names, found = SHAPES[shape], {}
    with tempfile.TemporaryDirectory(prefix="heli_bench_") as folder:
        out = Path(folder) / "flight"
        command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report", "--json"]
        command += ["--lockstep", "--world", "paper", "--seed", "1", "--duration", str(seconds)]
        command += ["--out", str(out), *(["--composed"] if "composed" in names else [])]
        flying = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        log = out / "logs" / f"{names[0]}.log"
        while not (log.is_file() and "flying" in log.read_text()) and flying.poll() is None:
            time.sleep(0.01)
        pids = {name: pid_of(out / "logs" / f"{name}.log") for name in names}
        if py_spy:
            watching = {
                name: subprocess.Popen(
                    [py_spy, "record", "-p", str(pid), "-d", "600", "-r", str(SAMPLES_PER_S)]
                    + ["-f", "raw", "-o", f"{folder}/{name}"],
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                )
                for name, pid in pids.items()
                if name == "composed"
            }
            flying.communicate()
            for name, watcher in watching.items():
                watcher.wait(60.0)
                found[name] = shares(Path(folder, name).read_text())
            return found
        begun = {name: processor_ns(pid) for name, pid in pids.items()}
        newest = dict(begun)
        while "flight over" not in log.read_text() and flying.poll() is None:
            with contextlib.suppress(OSError):  # one has ended
                newest = {name: processor_ns(pid) for name, pid in pids.items()}
            time.sleep(0.02)
        flying.communicate()
        ticks = seconds * TICKS_PER_S
        for name in names:
            own, others = (now - was for now, was in zip(newest[name], begun[name], strict=True))
            found[name] = {"own_us": own / ticks / 1e3, "dds_us": others / ticks / 1e3}
        return found


def measure(rounds: int, seconds: float, py_spy: str) -> dict[str, Any]:
    """Per shape and process: microseconds of a tick, of the threads of DDS and by what is done."""
    found: dict[str, Any] = {}
    for shape, names in SHAPES.items():
        flown = [fly(shape, seconds) for _ in range(rounds)]
        seen = fly(shape, seconds, py_spy) if shape == "one process" else {}
        found[shape] = {}
        for name in names:
            own, dds = (
                statistics.median(flight[name][key] for flight in flown)
                for key in ("own_us", "dds_us")
            )
            found[shape][name] = {"own_us": own, "dds_us": dds}
            if name in seen:
                parts = {part: share * own for part, share in seen[name].items()}
                found[shape][name]["parts_us"] = parts
    return found


def show(state: str, found: Mapping[str, Any]) -> None:
    """Print what was found of a state."""
    for shape, processes in found.items():
        for name, spent in processes.items():
            parts = spent.get("parts_us", {}).items()
            said = ", ".join(f"{part} {us:.0f}" for part, us in parts) or "parts not looked at"
            print(
                f"{state}: {shape}: {name} {spent['own_us']:.0f} us a tick ({said}), "
                f"threads of DDS {spent['dds_us']:.0f}"
            )


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--py-spy", default="py-spy", help="the program, if it is not on PATH")
    parser.add_argument("--seconds", type=float, default=SECONDS, help="length of a flight")
    parser.add_argument("--rounds", type=int, default=ROUNDS, help="flights without py-spy")
    parser.add_argument("--before", type=Path, help="what --json printed of an earlier state")
    parser.add_argument("--json", action="store_true", help="print JSON")
    asked = parser.parse_args()
    program = shutil.which(asked.py_spy)
    if program is None:
        raise SystemExit(f"graph_profile: no program '{asked.py_spy}'; pip install py-spy")
    ring.use_free_domain()
    states = {"after": measure(asked.rounds, asked.seconds, program)}
    if asked.before is not None and asked.before.is_file():
        earlier = json.loads(asked.before.read_text())
        states = {"before": earlier.get("before", earlier["after"]), **states}
    if asked.json:
        print(json.dumps(states | {"rounds": asked.rounds, "seconds": asked.seconds}))
    else:
        for state, found in states.items():
            show(state, found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
