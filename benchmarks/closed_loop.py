# SPDX-License-Identifier: Apache-2.0
"""Measure the closed loop in one process beside rotorpy's, and what a flight costs besides.

Run it by `./heli python benchmarks/closed_loop.py [--quick] [--json]`. One core. The peer is
rotorpy 1.2.0 (PyPI; later versions' Dryden wind needs torch): its Environment at 100 Hz, a
quadrotor held by its SE(3) controller in its Dryden wind. It gets an environment of its own in the
user's cache, about 400 MB, at the first run. `--quick`: one short round, without peer and
report.

Times are processor time; what counts are ratios within one run.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
import venv
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from heli_core.jit import cache_root
from heli_core.ticks import TICK_S
from heli_flight.loop import build, fly_loop
from heli_flight.scoring import score
from heli_flight.settings import resolve

ROUNDS, FLIGHT_S, QUICK_S = 5, 60.0, 5.0
GOAL_TIMES_REAL_TIME, GOAL_START_S = 600.0, 1.5
PEER = "rotorpy==1.2.0"
_PEER_FLIGHT = """
import sys, time
import numpy as np
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.environments import Environment
from rotorpy.trajectories.hover_traj import HoverTraj
from rotorpy.vehicles.crazyflie_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor
from rotorpy.wind.dryden_winds import DrydenGust
np.random.seed(1)
gust = DrydenGust(avg_wind=np.array([2.5, 2.5, 0.0]), sig_wind=np.array([0.5, 0.5, 0.2]))
world = Environment(vehicle=Multirotor(quad_params), controller=SE3Control(quad_params),
                    trajectory=HoverTraj(), wind_profile=gust, sim_rate=100)
start = time.process_time()
flown = world.run(t_final=float(sys.argv[1]), use_mocap=False, verbose=False)
print(flown["time"][-1] / (time.process_time() - start))
"""


def peer_python() -> Path:
    """Python of an environment with the peer, made when it is missing."""
    folder = cache_root().parent / f"benchmarks/{PEER.replace('==', '-')}"
    python = folder / "bin/python"
    if not (folder / "whole").exists():
        print(f"installing {PEER} into {folder} (once, about 400 MB)", file=sys.stderr)
        venv.create(folder, clear=True, with_pip=True)
        words = [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check", PEER]
        subprocess.run(words, check=True, stdout=sys.stderr)
        (folder / "whole").touch()
    return python


def peer_times_real_time(python: Path, duration_s: float) -> float:
    """Flight time over processor time of the peer."""
    words = [str(python), "-W", "ignore", "-c", _PEER_FLIGHT, str(duration_s)]
    return float(subprocess.run(words, check=True, capture_output=True, text=True).stdout)


def own_flight(duration_s: float) -> dict[str, float]:
    """Processor time (s) of the parts of a flight: files and checks, set-up, loop, scoring."""
    times, last = {}, time.process_time()

    def part(name: str) -> None:
        nonlocal last
        now = time.process_time()
        times[name], last = now - last, now

    settings = resolve(seed=1, duration_s=duration_s)
    part("resolve_s")
    loop = build(settings)
    part("build_s")
    flight = fly_loop(loop, settings)
    part("fly_s")
    score(flight.record, settings.scenario)
    part("score_s")
    times["times_real_time"] = len(flight.record.time_s) * TICK_S / times["fly_s"]
    return times


def start_s(*words: str) -> float:
    """Wall time (s) of a command of this interpreter, in a folder of its own."""
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        done = subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True)
        taken = time.perf_counter() - start
    if done.returncode not in (0, 1):
        raise RuntimeError(done.stderr)
    return taken


def measure(rounds: int, duration_s: float, peer: Path | None) -> dict[str, Any]:
    """All figures: medians over rounds, in each of which everything is measured in turn."""
    own_flight(duration_s)
    hover = ["-m", "heli_flight.cli.app", "hover", "--one-process", "--duration", "1"]
    rows: list[dict[str, float]] = []
    for number in range(rounds):
        row = own_flight(duration_s)
        row["command_s"] = start_s(*hover, "--no-report")
        if duration_s == FLIGHT_S:
            row["command_with_report_s"] = start_s(*hover)
        row["imports_s"] = start_s("-c", "import numpy, scipy.linalg, numba")
        if peer is not None:
            row["peer_times_real_time"] = peer_times_real_time(peer, duration_s)
        rows.append(row)
        print(f"round {number + 1} of {rounds}", file=sys.stderr)
    found: dict[str, Any] = {key: statistics.median(r[key] for r in rows) for key in rows[0]}
    found |= {"rounds": rounds, "duration_s": duration_s}
    found["goal_times_real_time"] = GOAL_TIMES_REAL_TIME
    found["command_over_imports"] = found["command_s"] / found["imports_s"]
    if peer is not None:
        found["peer"] = PEER
        found["times_peer"] = found["times_real_time"] / found["peer_times_real_time"]
    return found


def main() -> int:
    """Print the figures; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--quick", action="store_true", help="one short round, without peer and report"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")
    asked = parser.parse_args()
    quick = asked.quick
    found = measure(*((1, QUICK_S, None) if quick else (ROUNDS, FLIGHT_S, peer_python())))
    if asked.json:
        print(json.dumps(found))
        return 0
    goal = f"goal {GOAL_TIMES_REAL_TIME:g}"
    print(f"closed loop             {found['times_real_time']:8.0f} times real time ({goal})")
    if not quick:
        print(f"{PEER:<23} {found['peer_times_real_time']:8.1f} times real time")
        print(f"ratio                   {found['times_peer']:8.0f}")
    for key, name in (("resolve_s", "files and checks"), ("build_s", "set-up of the loop"),
                      ("fly_s", f"flight of {found['duration_s']:g} s"),
                      ("score_s", "scoring")):  # fmt: skip
        print(f"{name:<23} {1e3 * found[key]:8.1f} ms")
    print(f"heli hover, 1 s, warm   {found['command_s']:8.2f} s without a report (goal "
          f"{GOAL_START_S:g}), {found['command_over_imports']:.1f} times its imports")  # fmt: skip
    if not quick:
        print(f"                        {found['command_with_report_s']:8.2f} s with one")
    return 0


if __name__ == "__main__":
    sys.exit(main())
