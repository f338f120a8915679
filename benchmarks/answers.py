#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""How long nodes take to answer, in each state of their lives, beside a bare node.

    ./heli python benchmarks/answers.py [--seconds S] [--realtime] [--cold] [--busy N] [--json]

Every node of a flight is asked for its state (`get_state`) and for a parameter (`get_parameters`)
from its first sign of life to the end of the flight, again and again, one request after the other;
so is a bare lifecycle node of rclpy in a process of its own, whose answers cost nothing: what it
takes is DDS, the executor and who asks. A time counts for the state that `get_state` has named
last. With `--cold` the flight has an empty cache, so that its nodes compile while they configure;
busy loops beside it make the load.
"""

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Callable
from typing import Any

import latency
import numpy as np
import ring

NODES = ("plant", "observer", "inner_loop", "outer_loop", "recorder")
BARE, GOAL_S = "bare_node", 0.2
SECONDS, _PAUSE_S, _LIMIT_S, _COLD_LIMIT_S = 30.0, 0.02, 300.0, 900.0


def _burn() -> None:
    while True:
        sum(range(10_000))


def _serve_bare(ready: Any, over: Any) -> None:
    """Process of a lifecycle node that does nothing but answer."""
    import rclpy
    from rclpy.experimental.events_executor import EventsExecutor
    from rclpy.lifecycle import LifecycleNode
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.SIGINT)
    node, executor = LifecycleNode(BARE), EventsExecutor()
    node.declare_parameter("rate_hz", 100)
    executor.add_node(node)
    ready.set()
    while not over.is_set():
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


class Asker:
    """Asks one node for state and parameter in turn, and notes how long each answer took.

    Attributes
    ----------
    times_s : dict
        Per state the times, s.
    """

    def __init__(self, node: Any, name: str) -> None:
        from lifecycle_msgs.srv import GetState
        from rcl_interfaces.srv import GetParameters

        self._state = node.create_client(GetState, f"/{name}/get_state")
        self._parameters = node.create_client(GetParameters, f"/{name}/get_parameters")
        self._parameter_request = GetParameters.Request(names=["rate_hz"])
        self._state_request = GetState.Request()
        self._label, self._asks_state = "unknown", True
        self._future: Any = None
        self._asked_s, self._free_s = 0.0, 0.0
        self.times_s: dict[str, list[float]] = defaultdict(list)

    def step(self) -> None:
        """Take the answer if it has come; ask again after a pause."""
        now_s = time.monotonic()
        if self._future is not None:
            if not self._future.done():
                return
            response, self._future = self._future.result(), None
            if self._asks_state:
                self._label = response.current_state.label
            self.times_s[self._label].append(now_s - self._asked_s)
            self._asks_state, self._free_s = not self._asks_state, now_s + _PAUSE_S
        client = self._state if self._asks_state else self._parameters
        if now_s >= self._free_s and client.service_is_ready():
            request = self._state_request if self._asks_state else self._parameter_request
            self._asked_s, self._future = now_s, client.call_async(request)


def _ask_while(askers: list[Asker], spin: Callable[[], None], flying: Any, limit_s: float) -> None:
    end_s = time.monotonic() + limit_s
    while flying.poll() is None:
        if time.monotonic() > end_s:
            raise SystemExit("answers: the flight does not end")
        for asker in askers:
            asker.step()
        spin()


def figures(times_s: list[float]) -> dict[str, float]:
    """Count, percentiles (ms) and how many took longer than the goal."""
    p50, p99, most = np.percentile(times_s, (50, 99, 100)) * 1e3
    over = int(np.count_nonzero(np.array(times_s) > GOAL_S))
    return {"answers": len(times_s), "p50_ms": float(p50), "p99_ms": float(p99),
            "max_ms": float(most), "over_goal": over}  # fmt: skip


def measure(seconds: float, realtime: bool, cold: bool, busy: int) -> dict[str, Any]:
    """One flight and the bare node beside it."""
    import rclpy
    from rclpy.experimental.events_executor import EventsExecutor

    ring.use_free_domain()
    context = multiprocessing.get_context("spawn")
    ready, over = context.Event(), context.Event()
    bare = context.Process(target=_serve_bare, args=(ready, over), daemon=True)
    loops = [context.Process(target=_burn, daemon=True) for _ in range(busy)]
    rclpy.init(args=[])
    node, executor = rclpy.create_node("asker"), EventsExecutor()
    executor.add_node(node)
    askers = {name: Asker(node, name) for name in (*NODES, BARE)}
    with tempfile.TemporaryDirectory(prefix="heli_bench_") as folder:
        command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report"]
        command += ["--world", "paper", "--seed", "1", "--duration", str(seconds)]
        command += ["--out", f"{folder}/flight", *(["--realtime"] if realtime else [])]
        env = dict(os.environ) | ({"HELI_KERNEL_CACHE": f"{folder}/cache"} if cold else {})
        bare.start()
        if not ready.wait(_LIMIT_S):
            raise SystemExit("answers: the bare node did not start")
        for loop in loops:
            loop.start()
        load = os.getloadavg()[0]
        flying = subprocess.Popen(
            command, env=env, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
        )
        with latency.ended_too(flying):
            limit_s = seconds + (_COLD_LIMIT_S if cold else _LIMIT_S)
            _ask_while(list(askers.values()), lambda: executor.spin_once(0.002), flying, limit_s)
            _, said = flying.communicate()
        if flying.returncode not in (0, 1):
            raise SystemExit(f"answers: {said.decode().strip()}")
        for loop in loops:
            loop.terminate()
        over.set()
        bare.join(_LIMIT_S)
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()
    return _summary(askers) | {
        "seconds": seconds, "realtime": realtime, "cold": cold, "busy": busy,
        "machine": {"cores": len(os.sched_getaffinity(0)), "load_before": load},
    }  # fmt: skip


def _summary(askers: dict[str, Asker]) -> dict[str, Any]:
    by_state: dict[str, list[float]] = defaultdict(list)
    by_node = {}
    for name, asker in askers.items():
        if name == BARE:
            continue
        by_node[name] = figures([t for times in asker.times_s.values() for t in times])
        for state, times in asker.times_s.items():
            by_state[state] += times
    bare = figures([t for times in askers[BARE].times_s.values() for t in times])
    states = {state: figures(times) for state, times in sorted(by_state.items())}
    ratios = {state: row["p50_ms"] / bare["p50_ms"] for state, row in states.items()}
    return {"states": states, "nodes": by_node, "bare": bare, "ratios": ratios}


def show(measured: dict[str, Any]) -> None:
    """Print the tables."""
    rows = {**measured["states"], **measured["nodes"], "(bare node)": measured["bare"]}
    for name, row in rows.items():
        print(
            f"{name:<14} {row['answers']:6} answers; p50 {row['p50_ms']:7.1f} ms, "
            f"p99 {row['p99_ms']:7.1f} ms, longest {row['max_ms']:7.1f} ms, "
            f"over {GOAL_S:g} s: {row['over_goal']}"
        )


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=SECONDS, help="length of the flight, s")
    parser.add_argument("--realtime", action="store_true", help="at the wall clock's pace")
    parser.add_argument("--cold", action="store_true", help="compile while configuring")
    parser.add_argument("--busy", type=int, default=0, help="busy loops beside the flight")
    parser.add_argument("--json", action="store_true", help="print JSON")
    asked = parser.parse_args()
    measured = measure(asked.seconds, asked.realtime, asked.cold, asked.busy)
    if asked.json:
        print(json.dumps(measured))
    else:
        show(measured)
    return 0


if __name__ == "__main__":
    sys.exit(main())
