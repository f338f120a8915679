#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""The node graph in real time: from sensor to actuator, missed ticks, load of the processor.

    ./heli python benchmarks/latency.py [--seconds S] [--rate HZ] [--composed] [--quick] [--json]

A flight at the wall clock's pace (100 Hz, or --rate 400) after the bare ring of `ring.py` at the
same pace. In both somebody listens to `imu/data_raw` and `actuators` as the recorder does, and
reads when each was sent (DDS source timestamps): the latency of a tick is from its Imu to its
actuators. A tick is missed whose actuators come after the next Imu, or never. The load is that of
all processes of the flight, its supervisor among them, in the second half of it.
"""

import argparse
import contextlib
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import ring

from heli_core.ticks import OF_100_HZ, RATES_HZ, TICK_NS, Rate
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of

SECONDS, QUICK_SECONDS = 60.0, 5.0
GOAL_RATIO, GOAL_LOAD = 1.5, 0.6
_SETTLE_S = 1.0
_LIMIT_S = 120.0
_INTERRUPTED = 130


def listen(ready: Any, over: Any, told: Any) -> None:
    """Process that notes when messages were sent, by topic and stamp (ns), until it is over."""
    import rclpy
    from rclpy.experimental.events_executor import EventsExecutor
    from rclpy.signals import SignalHandlerOptions

    from heli_msgs_bridge.sources import with_info

    sent: dict[str, dict[int, int]] = {topics.IMU: {}, topics.ACTUATORS: {}}
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.SIGINT)
    node, executor = rclpy.create_node("bench_listener"), EventsExecutor()

    def noting(times: dict[int, int]) -> Any:
        def note(raw: bytes, info: Any) -> None:
            times[stamp_of(raw)] = info["source_timestamp"]

        return with_info(note)

    for name, times in sent.items():
        kind = topics.message_class(topics.BY_NAME[name].type)
        node.create_subscription(kind, name, noting(times), topics.qos(name), raw=True)
    executor.add_node(node)
    ready.set()
    while not over.is_set():
        executor.spin_once(timeout_sec=0.1)
    told.send((sent[topics.IMU], sent[topics.ACTUATORS]))
    executor.shutdown()
    node.destroy_node()
    rclpy.shutdown()


class Listener:
    """The process of `listen`, from `with` on."""

    def __init__(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._mine, theirs = context.Pipe(duplex=False)
        self._ready, self._over = context.Event(), context.Event()
        arguments = (self._ready, self._over, theirs)
        self._process = context.Process(target=listen, args=arguments, daemon=True)

    def __enter__(self) -> "Listener":
        self._process.start()
        if not self._ready.wait(_LIMIT_S):
            raise SystemExit("latency: the listener did not start")
        return self

    def __exit__(self, *_: object) -> None:
        self._over.set()

    def heard(self) -> tuple[dict[int, int], dict[int, int]]:
        """When each Imu and each actuators was sent, by stamp."""
        self._over.set()
        if not self._mine.poll(_LIMIT_S):
            raise SystemExit("latency: the listener is silent")
        imu, actuators = self._mine.recv()
        self._process.join(_LIMIT_S)
        return imu, actuators


def figures(
    imu: dict[int, int], actuators: dict[int, int], settle: int, tick_ns: int
) -> dict[str, float]:
    """Latencies, us, and missed ticks, from the settled part.

    Parameters
    ----------
    imu, actuators : dict
        Stamp to the time of sending, ns.
    settle : int
        So many ticks are left out at the beginning.
    tick_ns : int
        From stamp to stamp.
    """
    stamps = sorted(imu)[settle:-1]
    if not stamps:
        raise SystemExit("latency: too few messages were heard")
    late_ns = [actuators[s] - imu[s] for s in stamps if s in actuators]
    missed = sum(s not in actuators or actuators[s] > imu.get(s + tick_ns, 0) for s in stamps)
    p50, p99 = np.percentile(late_ns, (50, 99)) / 1e3
    return {"ticks": len(stamps), "missed": missed, "p50_us": float(p50), "p99_us": float(p99)}


def of_ring(seconds: float, composed: bool, rate: Rate) -> dict[str, float]:
    """Figures of the ring of message objects at the flight's pace; it counts cycles by 10 ms."""
    cycles, outer_every = rate.ticks_in(seconds), rate.of(ring.OUTER_EVERY)
    with Listener() as listener:
        ring.run(ring.Order(composed, "objects", cycles, rate.tick_s, outer_every))
        return figures(*listener.heard(), rate.ticks_in(_SETTLE_S), TICK_NS)


def family(pid: int) -> list[int]:
    """A process and all that descend from it."""
    found = [pid]
    for path in Path("/proc").glob(f"{pid}/task/*/children"):
        with contextlib.suppress(OSError):
            for child in path.read_text().split():
                found += family(int(child))
    return found


def processor_s(pids: list[int]) -> float:
    """Processor time of processes so far; those that have ended count no more."""
    total = 0.0
    for pid in pids:
        try:
            fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
        except OSError:
            continue
        user, system = map(int, fields[11:13])
        total += (user + system) / os.sysconf("SC_CLK_TCK")
    return total


@contextlib.contextmanager
def ended_too(flying: subprocess.Popen[bytes]) -> Iterator[None]:
    """Interrupt a flight that is still under way when the measurement ends, and wait for it."""
    try:
        yield
    finally:
        if flying.poll() is None:
            flying.send_signal(signal.SIGINT)
            flying.communicate(timeout=_LIMIT_S)


def of_graph(seconds: float, composed: bool, rate: Rate) -> dict[str, float]:
    """Figures of a recorded flight in real time, and its load as a share of a core."""
    with tempfile.TemporaryDirectory(prefix="heli_bench_") as folder, Listener() as listener:
        command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report", "--realtime"]
        command += ["--world", "paper", "--seed", "1", "--duration", str(seconds)]
        command += ["--rate", str(rate.hz)]
        command += ["--out", f"{folder}/flight", *(["--composed"] if composed else [])]
        log = Path(folder) / "flight" / "logs" / ("composed.log" if composed else "plant.log")
        flying = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        with ended_too(flying):
            while not (log.is_file() and "flying" in log.read_text()) and flying.poll() is None:
                time.sleep(0.05)
            time.sleep(seconds / 2.0)
            pids = family(flying.pid)
            begun_s, used_s = time.monotonic(), processor_s(pids)
            time.sleep(seconds / 4.0)
            load = (processor_s(pids) - used_s) / (time.monotonic() - begun_s)
            _, said = flying.communicate(timeout=seconds + _LIMIT_S)
        if flying.returncode not in (0, 1):
            raise SystemExit(f"latency: {said.decode().strip()}")
        told = figures(*listener.heard(), rate.ticks_in(_SETTLE_S), rate.tick_ns)
        return {**told, "load": load}


def measure(seconds: float, composed: bool, rate: Rate = OF_100_HZ) -> dict[str, Any]:
    """Ring and graph, one after the other."""
    ring.use_free_domain()
    load_before = os.getloadavg()[0]
    bare, graph = of_ring(seconds, composed, rate), of_graph(seconds, composed, rate)
    return {
        "seconds": seconds,
        "rate_hz": rate.hz,
        "composed": composed,
        "machine": {"cores": len(os.sched_getaffinity(0)), "load_before": load_before},
        "ring": bare,
        "graph": graph,
        "ratios": {key: graph[key] / bare[key] for key in ("p50_us", "p99_us")},
    }


def show(found: dict[str, Any]) -> None:
    """Print the table."""
    machine = found["machine"]
    print(
        f"{found['seconds']:g} s at {found['rate_hz']} Hz, "
        f"{'one process' if found['composed'] else 'four processes'}, {machine['cores']} cores, "
        f"load before {machine['load_before']:.1f}"
    )
    for name in ("ring", "graph"):
        row = found[name]
        print(
            f"{name:<6} sensor to actuator p50 {row['p50_us']:5.0f} us, p99 {row['p99_us']:6.0f} "
            f"us; missed {row['missed']} of {row['ticks']} ticks"
        )
    p50, p99 = found["ratios"]["p50_us"], found["ratios"]["p99_us"]
    print(f"ratio  p50 {p50:.2f}, p99 {p99:.2f} (goal {GOAL_RATIO:g})")
    print(f"load of the graph {found['graph']['load']:.0%} of a core (goal {GOAL_LOAD:.0%})")


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=SECONDS, help="length of each")
    parser.add_argument("--rate", type=int, choices=RATES_HZ, default=OF_100_HZ.hz, help="Hz")
    parser.add_argument("--composed", action="store_true", help="the four nodes in one process")
    parser.add_argument("--quick", action="store_true", help=f"{QUICK_SECONDS:g} s of each")
    parser.add_argument("--json", action="store_true", help="print JSON")
    asked = parser.parse_args()
    seconds = QUICK_SECONDS if asked.quick else asked.seconds
    # Asked to end, it ends what it has started, as on Ctrl-C.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        found = measure(seconds, asked.composed, Rate.of_hz(asked.rate))
    except KeyboardInterrupt:
        return _INTERRUPTED
    if asked.json:
        print(json.dumps(found))
    else:
        show(found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
