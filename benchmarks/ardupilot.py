# SPDX-License-Identifier: Apache-2.0
"""What a frame of ArduPilot costs: microseconds, and beside an echo over the same loopback.

    ./heli python benchmarks/ardupilot.py [--quick] [--json]

One run, parts in turn: the answer to a packet without a socket, with and without the bag that is
recorded meanwhile, at 400 and 1200 steps a second; the round trip of a packet to a process that
answers it by `heli ardupilot`'s loop, and to one that sends as many bytes back at once. What counts
are processor times, medians and ratios: means and times of the wall are the machine's.
"""

import argparse
import json
import multiprocessing
import os
import socket
import statistics
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))

from heli_flight.ardupilot import server  # noqa: E402
from heli_flight.ardupilot.physics import Physics  # noqa: E402
from heli_flight.ardupilot.session import Vehicle  # noqa: E402
from support.sitl_client import h3_120, packet, read  # noqa: E402

GOAL_US = 100.0
RATES_HZ = (400, 1200)
_SENDER = ("127.0.0.1", 1)
_PULSES = h3_120(0.02, 0.0, 0.3, 0.0)


def _vehicle(folder: Path | None) -> Vehicle:
    order = server.ArduPilotOrder(seed=1, world="honest")
    settings = order.resolved()
    servos = order.servos(settings)
    if folder is not None:
        return Vehicle(server._flights(settings, servos, False, folder), lambda line: None)
    return Vehicle(lambda rate: (Physics(settings, rate, servos), None), lambda line: None)


def answers(rate_hz: int, frames: int, folder: Path | None) -> dict[str, float]:
    """Wall time of answers, us, the first one left out; and processor time of one on average."""
    vehicle, spent = _vehicle(folder), []
    packets = [packet(_PULSES, count, rate_hz) for count in range(1, frames + 1)]
    vehicle.answer(packets[0], _SENDER, 1)
    busy_s = time.process_time()
    for data in packets[1:]:
        began_ns = time.perf_counter_ns()
        vehicle.answer(data, _SENDER, began_ns)
        spent.append((time.perf_counter_ns() - began_ns) / 1e3)
    busy_s = time.process_time() - busy_s
    vehicle.close()
    return {**_row(spent), "cpu_us": round(1e6 * busy_s / (frames - 1), 1)}


def _serve(pipe: Any, folder: str | None) -> None:
    """A process that answers: a vehicle, or without a folder an echo of as many bytes."""
    sock = server.bound(0)
    if folder is None:
        sock.setblocking(True)
        text = b"x" * 300
        pipe.send(sock.getsockname())
        while True:
            _, sender = sock.recvfrom(2048)
            sock.sendto(text, sender)
    door = server.Door("heli1", sock, _vehicle(Path(folder)))
    pipe.send(sock.getsockname())
    server.serve([door], lambda line: None)


def round_trips_us(rate_hz: int, frames: int, folder: Path | None) -> list[float]:
    """Wall time from a packet to its answer, us, the first one left out."""
    ours, theirs = multiprocessing.Pipe()
    process = multiprocessing.get_context("spawn").Process(
        target=_serve, args=(theirs, folder and str(folder)), daemon=True
    )
    process.start()
    address, spent = ours.recv(), []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        sock.settimeout(60.0)
        for count in range(1, frames + 1):
            data = packet(_PULSES, count, rate_hz)
            began_ns = time.perf_counter_ns()
            sock.sendto(data, address)
            text = sock.recv(2048)
            spent.append((time.perf_counter_ns() - began_ns) / 1e3)
    if folder is not None:
        read(text)
    process.terminate()
    process.join()
    return spent[1:]


def _row(spent: list[float]) -> dict[str, float]:
    ordered = sorted(spent)
    return {
        "mean_us": round(statistics.fmean(ordered), 1),
        "p50_us": round(ordered[len(ordered) // 2], 1),
        "p99_us": round(ordered[len(ordered) * 99 // 100], 1),
    }


def measure(seconds: float) -> dict[str, Any]:
    """All parts, for so many seconds of flight each."""
    found: dict[str, Any] = {"goal_us": GOAL_US, "load": round(os.getloadavg()[0], 1), "rates": {}}
    for rate_hz in RATES_HZ:
        frames = round(seconds * rate_hz)
        with tempfile.TemporaryDirectory(prefix="heli_ardupilot_") as place:
            folder = Path(place)
            row = {
                "answer": answers(rate_hz, frames, None),
                "answer_recorded": answers(rate_hz, frames, folder / "a"),
                "round_trip": _row(round_trips_us(rate_hz, frames, folder / "b")),
                "echo": _row(round_trips_us(rate_hz, frames, None)),
            }
        row["of_goal"] = round(row["answer_recorded"]["cpu_us"] / GOAL_US, 3)
        row["round_trip_over_echo"] = round(row["round_trip"]["p50_us"] / row["echo"]["p50_us"], 2)
        row["times_real_time"] = round(1e6 / (row["round_trip"]["mean_us"] * rate_hz), 2)
        found["rates"][str(rate_hz)] = row
    return found


def main() -> int:
    """Measure and print; returns the exit code."""
    parser = argparse.ArgumentParser(description="Microseconds of a frame of ArduPilot.")
    parser.add_argument("--quick", action="store_true", help="a second of flight instead of 30")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    found = measure(1.0 if asked.quick else 30.0)
    if asked.json:
        print(json.dumps(found))
        return 0
    print(f"load {found['load']}; goal: an answer, recorded, {GOAL_US:g} us of a processor")
    for rate_hz, row in found["rates"].items():
        print(f"{rate_hz} Hz")
        for part in ("answer", "answer_recorded", "round_trip", "echo"):
            words = "  ".join(
                f"{name.removesuffix('_us')} {us:.1f}" for name, us in row[part].items()
            )
            print(f"  {part:16} {words} us")
        print(
            f"  of the goal {row['of_goal']}, round trip over echo {row['round_trip_over_echo']}, "
            f"{row['times_real_time']} times real time"
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
