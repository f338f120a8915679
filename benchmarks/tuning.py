#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Parameters set in a flight in real time: what it costs the actuators.

    ./heli python benchmarks/tuning.py [--sets N] [--busy N] [--phase S] [--json]

A recorded flight at the wall clock's pace, in four phases of equal length: nothing is set; the
inner loop's `output.gamma` is set to the value that it has; it is set to a new value each time, a
synthesis each; nothing is set. As in `latency.py` a tick is missed whose actuators come after the
next Imu; the longest silence is that between two messages on `actuators`. /diagnostics says how
often the plant flew without commands (`actuator_timeout_s` of silence). Busy loops beside it make
the load.
"""

import argparse
import json
import multiprocessing
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import latency
import ring

from heli_core.ticks import NS_PER_S, TICK_NS
from heli_msgs_bridge import topics

PHASES = ("nothing before", "own value", "new values", "nothing after")
PARAMETER, FIRST, STEP = "output.gamma", 4.3, 0.05
_AIRBORNE_S, _LIMIT_S = 5.0, 300.0


def _burn() -> None:
    while True:
        sum(range(10_000))


class Tuner:
    """Sets the parameter, and hears what the plant says of missing commands."""

    def __init__(self) -> None:
        import rclpy
        from diagnostic_msgs.msg import DiagnosticArray
        from rcl_interfaces.srv import SetParameters

        self.node, self._rclpy, self._kind = rclpy.create_node("tuner"), rclpy, SetParameters
        self._client = self.node.create_client(SetParameters, "/inner_loop/set_parameters")
        self.node.create_subscription(
            DiagnosticArray, topics.DIAGNOSTICS, self._hear, topics.qos(topics.DIAGNOSTICS)
        )
        self.plant: dict[str, str] = {}

    def _hear(self, message: Any) -> None:
        for status in message.status:
            if status.name == "plant":
                self.plant = {pair.key: pair.value for pair in status.values}

    def spin_until(self, condition: Any) -> None:
        """Serve until it holds; SystemExit after a limit."""
        limit_s = time.monotonic() + _LIMIT_S
        while not condition():
            if time.monotonic() > limit_s:
                raise SystemExit("tuning: the flight is silent")
            self._rclpy.spin_once(self.node, timeout_sec=0.05)

    def flown_s(self) -> float:
        """Flight time that was told last, s."""
        return float(self.plant.get("flown_s", "-1"))

    def set(self, value: float) -> tuple[bool, float]:
        """Whether it was accepted, and how long the answer took, s."""
        from rclpy.parameter import Parameter

        self.spin_until(self._client.service_is_ready)
        request = self._kind.Request()
        request.parameters = [Parameter(PARAMETER, value=value).to_parameter_msg()]
        begun_s, future = time.monotonic(), self._client.call_async(request)
        self.spin_until(future.done)
        return future.result().results[0].successful, time.monotonic() - begun_s


def of_phase(
    imu: dict[int, int], actuators: dict[int, int], span_ns: tuple[int, int]
) -> dict[str, float]:
    """Missed ticks and the longest silence of what was sent in a span of wall time."""
    stamps = [s for s, sent in imu.items() if span_ns[0] <= sent < span_ns[1]]
    late = sum(
        s not in actuators or actuators[s] > imu.get(s + TICK_NS, actuators[s]) for s in stamps
    )
    sent = sorted(at for at in actuators.values() if span_ns[0] <= at < span_ns[1])
    longest = max((b - a for a, b in zip(sent, sent[1:], strict=False)), default=0)
    return {"ticks": len(stamps), "missed": late, "longest_silence_ms": longest / 1e6}


def measure(sets: int, busy: int, phase_s: float) -> dict[str, Any]:
    """One flight, phase by phase."""
    import rclpy

    ring.use_free_domain()
    rclpy.init(args=[])
    context = multiprocessing.get_context("spawn")
    loops = [context.Process(target=_burn, daemon=True) for _ in range(busy)]
    rows: dict[str, dict[str, Any]] = {}
    with (
        tempfile.TemporaryDirectory(prefix="heli_bench_") as folder,
        latency.Listener() as listener,
    ):
        duration = str(len(PHASES) * phase_s + 6 * _AIRBORNE_S)
        command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report", "--realtime"]
        command += ["--world", "paper", "--seed", "1", "--duration", duration]
        command += ["--out", f"{folder}/flight"]
        tuner = Tuner()
        flying = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        with latency.ended_too(flying):
            tuner.spin_until(lambda: tuner.flown_s() > 0.0)
            for loop in loops:
                loop.start()
            airborne_s = tuner.flown_s() + _AIRBORNE_S
            tuner.spin_until(lambda: tuner.flown_s() > airborne_s)
            value, spans = FIRST, []
            for name in PHASES:
                begun_ns, before = time.time_ns(), tuner.plant.get("without_commands", "none")
                answers = []
                for _ in range(sets if "value" in name else 0):
                    value += STEP if name == "new values" else 0.0
                    answers.append(tuner.set(value))
                end_ns = begun_ns + int(phase_s * NS_PER_S)
                tuner.spin_until(lambda end_ns=end_ns: time.time_ns() >= end_ns)
                spans.append((begun_ns, time.time_ns()))
                rows[name] = {
                    "load": os.getloadavg()[0],
                    "accepted": sum(done for done, _ in answers),
                    "longest_answer_s": max((s for _, s in answers), default=0.0),
                    "without_commands": (before, tuner.plant.get("without_commands", "none")),
                }
        for loop in loops:
            loop.terminate()
        imu, actuators = listener.heard()
        for name, span in zip(PHASES, spans, strict=True):
            rows[name] |= of_phase(imu, actuators, span)
        lost = Path(folder, "flight", "logs", "plant.log").read_text()
    tuner.node.destroy_node()
    rclpy.shutdown()
    return {"sets": sets, "busy": busy, "phase_s": phase_s, "phases": rows,
            "shifted": lost.count("time is shifted")}  # fmt: skip


def show(found: dict[str, Any]) -> None:
    """Print the table."""
    print(f"{found['sets']} sets in {found['phase_s']:g} s each, {found['busy']} busy loops")
    for name, row in found["phases"].items():
        print(
            f"{name:<15} load {row['load']:4.1f}; missed {row['missed']:3} of {row['ticks']}, "
            f"longest silence {row['longest_silence_ms']:6.1f} ms, accepted {row['accepted']}, "
            f"longest answer {row['longest_answer_s']:.2f} s, flown without commands "
            f"{' -> '.join(row['without_commands'])}"
        )
    print(f"the plant's time was shifted {found['shifted']} times")


def main() -> int:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--sets", type=int, default=8, help="in each of the two phases")
    parser.add_argument("--busy", type=int, default=0, help="busy loops beside the flight")
    parser.add_argument("--phase", type=float, default=15.0, help="length of a phase, s")
    parser.add_argument("--json", action="store_true", help="print JSON")
    asked = parser.parse_args()
    found = measure(asked.sets, asked.busy, asked.phase)
    if asked.json:
        print(json.dumps(found))
    else:
        show(found)
    return 0


if __name__ == "__main__":
    sys.exit(main())
