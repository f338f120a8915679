# SPDX-License-Identifier: Apache-2.0
"""Measure the plant: integration step, tick and compile time; and the whole loop in one process.

Run it by `./heli python scripts/bench_plant.py [--json]`. One core; the budget of a step of 2 ms
(four derivative evaluations) is 5 us.
"""

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from heli_core.command_line import config_folder
from heli_core.jit import njit_counted
from heli_core.parameters import load, with_common
from heli_core.rows import MEAS, PLANT
from heli_core.ticks import TICK_S
from heli_dynamics_sim import plant
from heli_dynamics_sim.airframe import STEP_S
from heli_dynamics_sim.helicopter import WORK_ROWS, rk4_step, same_air
from heli_dynamics_sim.noise import NoiseStreams
from heli_dynamics_sim.parameters import TABLE
from heli_flight.loop import build, fly_loop
from heli_flight.settings import resolve

STEP_BUDGET_US = 5.0
_COLD = "import sys; sys.path[:0] = {path!r}; import runpy; runpy.run_path({me!r}, run_name='cold')"


def default_config():
    """PlantConfig of the packaged parameters."""
    files = [
        config_folder("heli_core") / "common.yaml",
        config_folder("heli_dynamics_sim") / "plant.yaml",
    ]
    values = load(with_common(TABLE), files, "plant")
    return plant.PlantConfig.from_parameters(values)


@njit_counted
def _steps(x0, u, air, k, work, n):
    """n integration steps, restarted from x0 every 50 so that the flight stays near trim."""
    x = x0.copy()
    for i in range(n):
        if i % 50 == 0:
            x[:] = x0
        rk4_step(x, u, air, k, STEP_S, work)
    return x[0]


@njit_counted
def _ticks(state, x0, rows, u, k, y):
    """One tick of measure and advance per noise row, restarted from x0 every 10 ticks."""
    for tick in range(rows.shape[0]):
        if tick % 10 == 0:
            state.x[:] = x0
        plant.measure(state, tick, rows[tick], k, y)
        plant.advance(state, u, k)


def _best_us(call, n, repeats=5):
    """Least time per item (us) of a call that does n items."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return 1e6 * min(times) / n


def warm_up():
    """Compile what a flight needs; seconds for initial_state, measure, advance and status."""
    config = default_config()
    y = np.zeros(MEAS.size)
    start = time.perf_counter()
    state = plant.initial_state(config, 1)
    plant.measure(state, 0, NoiseStreams(1).row(), config.params, y)
    plant.advance(state, state.x[PLANT.servo].copy(), config.params)
    plant.status(state, config.params)
    return time.perf_counter() - start


def cold_compile_s():
    """`warm_up` in a fresh process with an empty kernel cache."""
    with tempfile.TemporaryDirectory() as cache:
        code = _COLD.format(path=sys.path, me=str(Path(__file__).resolve()))
        environment = os.environ | {"NUMBA_CACHE_DIR": cache}
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True)
    return float(done.stdout)


def loop_times_real_time(repeats=5):
    """Flight time over processor time of the hover test in one process, without its set-up."""
    settings = resolve()
    loops = [build(settings) for _ in range(repeats + 1)]
    fly_loop(loops.pop(), settings)
    times = []
    for loop in loops:
        start = time.process_time()
        fly_loop(loop, settings)
        times.append(time.process_time() - start)
    return settings.scenario.n_ticks * TICK_S / min(times)


def main():
    """Print the table; exit code 1 if a step is over its budget."""
    config = default_config()
    state = plant.initial_state(config, 1)
    x0, u, air = state.x.copy(), state.x[PLANT.servo].copy(), same_air([-2.0, -2.0, 0.2])
    work, y = np.zeros((WORK_ROWS, PLANT.size)), np.zeros(MEAS.size)
    rows = NoiseStreams(1).rows(20000)
    _steps(x0, u, air, config.helicopter.params, work, 1)
    _ticks(state, x0, rows[:1], u, config.params, y)
    n = 100_000
    step = _best_us(lambda: _steps(x0, u, air, config.helicopter.params, work, n), n)
    tick = _best_us(lambda: _ticks(state, x0, rows, u, config.params, y), len(rows))
    draw = _best_us(lambda: NoiseStreams(1).rows(20000), 20000, repeats=3)
    times = loop_times_real_time()
    if "--json" in sys.argv[1:]:
        print(
            json.dumps(
                {
                    "step_us": step,
                    "tick_us": tick,
                    "noise_row_us": draw,
                    "loop_times_real_time": times,
                    "first_compilation_s": cold_compile_s(),
                }
            )
        )
        return 0 if step <= STEP_BUDGET_US else 1
    print(f"RK4 step of {1e3 * STEP_S:g} ms      {step:8.2f} us  (budget {STEP_BUDGET_US:g} us)")
    print(f"tick: measure + advance {tick:8.2f} us  ({1e6 * TICK_S / tick:.0f} times real time)")
    print(f"noise row               {draw:8.2f} us")
    print(f"whole loop, hover test  {times:8.0f} times real time")
    print(f"first compilation       {cold_compile_s():8.1f} s")
    return 0 if step <= STEP_BUDGET_US else 1


if __name__ == "__main__":
    sys.exit(main())
elif __name__ == "cold":
    print(warm_up())
