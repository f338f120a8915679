# SPDX-License-Identifier: Apache-2.0
"""Measure steps of `heli.Simulation` and of the environments of `heli.gym`, beside rotorpy's.

Run it by `./heli python benchmarks/gym_steps.py [--quick] [--json]`. All in one run, in turn. A
Python loop at 100 Hz that does nothing but step; `heli/Hover-v0` alone and many in one call, on one
thread and on two, a step being two ticks of 10 ms. The peer is rotorpy 1.2.0 (PyPI): its
QuadrotorEnv at 100 Hz, one tick a step, a quadrotor without wind, sensors, or estimator; it gets an
environment of its own in the user's cache, about 400 MB, at the first run. gym-pybullet-drones is
in no package registry, so it is not measured. `--quick`: one short round, without peer.

Ticks a second compare: a step is as long as one wants. Times are wall time.
"""

import argparse
import json
import os
import statistics
import subprocess
import sys
import time
import venv
from collections.abc import Callable
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import gymnasium
import numpy as np

import heli
import heli.gym
from heli_core.jit import cache_root
from heli_core.ticks import TICK_S

ROUNDS, STEPS, QUICK_STEPS = 5, 6000, 200
GOAL_TIMES_REAL_TIME = 200.0
MANY, TICKS = 64, 2
PEER = "rotorpy==1.2.0"
_PEER_STEPS = """
import sys, time
import numpy as np
from rotorpy.learning.quadrotor_environments import QuadrotorEnv
env = QuadrotorEnv(control_mode="cmd_motor_speeds", sim_rate=100, max_time=1e9)
env.reset(seed=1)
action, n = np.zeros(4, np.float32), int(sys.argv[1])
start = time.perf_counter()
for _ in range(n):
    over = env.step(action)[2]
    if over:
        env.reset()
print(n / (time.perf_counter() - start))
"""


def peer_python() -> Path:
    """Python of an environment with the peer, made when it is missing."""
    folder = cache_root().parent / "benchmarks" / f"gym-{PEER.replace('==', '-')}"
    python = folder / "bin/python"
    if not (folder / "whole").exists():
        print(f"installing {PEER} into {folder} (once, about 400 MB)", file=sys.stderr)
        venv.create(folder, clear=True, with_pip=True)
        words = [str(python), "-m", "pip", "install", "-q", "--disable-pip-version-check"]
        subprocess.run([*words, PEER, "gymnasium"], check=True, stdout=sys.stderr)
        (folder / "whole").touch()
    return python


def rate(step: Callable[[], Any], n: int) -> float:
    """Calls a second."""
    start = time.perf_counter()
    for _ in range(n):
        step()
    return n / (time.perf_counter() - start)


def simulations(n: int) -> dict[str, float]:
    """Ticks a second of a Python loop, by what it commands."""
    found = {}
    sim = heli.Simulation(world="paper", seed=1, quiet=True)
    u = sim.reset().u.row
    commands: dict[str, dict[str, Any]] = {
        "nothing": {}, "velocity": {"velocity": [0.0, 0.0, 0.0]},
        "attitude": {"attitude": sim.step().setpoint.row}, "actuators": {"actuators": u},
    }  # fmt: skip
    for name, command in commands.items():
        sim.reset()
        for _ in range(20):
            sim.step()
        found[f"simulation_{name}"] = rate(lambda command=command: sim.step(**command), n)  # type: ignore[misc]
        if sim.step().lost:
            raise RuntimeError(f"the loop that commands {name} was lost")
    return found


def environments(n: int) -> dict[str, float]:
    """Ticks a second of environments, attitudes commanded so that none is lost."""
    options = {"command": "attitude", "ticks": TICKS, "flights": 1}
    alone = gymnasium.make("heli/Hover-v0", **options, disable_env_checker=True).unwrapped
    alone.reset(seed=1)
    action = np.zeros(4, np.float32)
    found = {"alone": TICKS * rate(lambda: alone.step(action), n)}
    for threads in (1, 2):
        envs = gymnasium.make_vec(
            "heli/Hover-v0", num_envs=MANY, vectorization_mode="vector_entry_point",
            max_episode_steps=10**6, threads=threads, **options,
        )  # fmt: skip
        envs.reset(seed=1)
        actions = np.zeros((MANY, 4), np.float32)
        name = "many" if threads == 1 else "many_two_threads"
        found[name] = MANY * TICKS * rate(lambda: envs.step(actions), max(n // MANY, 5))  # noqa: B023
    return found


def measure(rounds: int, n: int, peer: Path | None) -> dict[str, Any]:
    """Ticks a second: medians over rounds, in each of which everything is measured in turn."""
    simulations(50)
    rows: list[dict[str, float]] = []
    for number in range(rounds):
        row = simulations(n) | environments(n)
        if peer is not None:
            words = [str(peer), "-W", "ignore", "-c", _PEER_STEPS, str(n // 10)]
            row["peer"] = float(subprocess.run(words, check=True, capture_output=True).stdout)
        rows.append(row)
        print(f"round {number + 1} of {rounds}", file=sys.stderr)
    ticks = {key: statistics.median(row[key] for row in rows) for key in rows[0]}
    found: dict[str, Any] = {
        "ticks_per_s": ticks, "rounds": rounds, "steps": n, "many": MANY,
        "times_real_time": ticks["simulation_nothing"] * TICK_S,
        "goal_times_real_time": GOAL_TIMES_REAL_TIME, "ticks_of_a_step": TICKS,
    }  # fmt: skip
    if peer is not None:
        found |= {"peer": PEER, "times_peer_alone": ticks["alone"] / ticks["peer"]}
        found["times_peer_many"] = ticks["many"] / ticks["peer"]
    return found


def main() -> int:
    """Print the figures; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="one short round, without peer")
    parser.add_argument("--json", action="store_true", help="print JSON")
    asked = parser.parse_args()
    found = measure(*((1, QUICK_STEPS, None) if asked.quick else (ROUNDS, STEPS, peer_python())))
    if asked.json:
        print(json.dumps(found))
        return 0
    for name, value in found["ticks_per_s"].items():
        words = f"{PEER}, QuadrotorEnv" if name == "peer" else name.replace("_", ": ", 1)
        print(f"{words:<30} {value:10.0f} ticks/s {value * TICK_S:8.0f} times real time")
    print(f"goal of a loop that does nothing: {GOAL_TIMES_REAL_TIME:g} times real time")
    print("gym-pybullet-drones: in no package registry, not measured")
    return 0


if __name__ == "__main__":
    sys.exit(main())
