# SPDX-License-Identifier: Apache-2.0
"""Measure what grows with the number: of tasks of a campaign, of participants of a ROS domain.

Run it by `./heli python benchmarks/scaling.py [--quick] [--json]`. Tasks: nothing is flown, a task
returns rows as long as a campaign's, so that what is left is the scheduler and the way there and
back. Participants: each is a ROS context with one node, in four processes; what is measured is the
time from their start until each knows all others, and the processor time that this takes.
"""

import argparse
import json
import multiprocessing
import os
import statistics
import sys
import time
from multiprocessing.synchronize import Barrier
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from heli_flight.graph.nodes import prepare_environment
from heli_flight.graph.processes import DISCOVERY, DOMAIN, domain_reserved

TASKS, QUICK_TASKS, WORKERS, ROW_KEYS = 5000, 200, 2, 40
# Where Fast DDS looks for others; beyond 32 participants those of one machine only do not suffice.
ALONE, SUBNET = "LOCALHOST", "SUBNET"
COUNTS = ((2, ALONE), (10, ALONE), (32, ALONE), (40, ALONE), (40, SUBNET))
QUICK_COUNTS = ((2, ALONE), (4, ALONE))
PROCESSES, ROUNDS = 4, 1
_LIMIT_S, _END_LIMIT_S = 30.0, 10.0


def _no_flight(number: int) -> list[dict[str, float]]:
    return [{f"metric_{key}": float(number) for key in range(ROW_KEYS)}]


def tasks(count: int) -> dict[str, float]:
    """Tasks per second of two workers, and processor time (s) per task of scheduler and client."""
    from distributed import Client, LocalCluster, as_completed

    with (
        LocalCluster(
            n_workers=WORKERS, threads_per_worker=1, processes=True, dashboard_address="127.0.0.1:0"
        ) as cluster,
        Client(cluster) as client,
    ):
        client.gather(client.map(_no_flight, range(100), pure=False))
        begun, spent = time.perf_counter(), time.process_time()
        waiting = [client.submit(_no_flight, number, pure=False) for number in range(count)]
        done = sum(len(rows) for _, rows in as_completed(waiting, with_results=True))
        wall, cpu = time.perf_counter() - begun, time.process_time() - spent
    assert done == count
    return {"tasks": count, "tasks_per_s": count / wall, "scheduler_s_per_task": cpu / count}


def _take_part(own: int, all_of_them: int, begin: Barrier, told: Any) -> None:
    """Open `own` participants at once and wait until each of them sees all."""
    import rclpy
    from rclpy.context import Context
    from rclpy.node import Node
    from rclpy.signals import SignalHandlerOptions

    begin.wait()
    spent = time.process_time()
    contexts, nodes = [], []
    for number in range(own):
        context = Context()
        rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
        name = f"part_{os.getpid()}_{number}"
        contexts.append(context)
        nodes.append(
            Node(name, context=context, enable_rosout=False, start_parameter_services=False)
        )
    until = time.perf_counter() + _LIMIT_S
    seen = 0
    while seen < all_of_them and time.perf_counter() < until:
        seen = min(len(set(node.get_node_names())) for node in nodes)
        time.sleep(0.005)
    told.put((time.process_time() - spent, seen))
    begin.wait()
    for node, context in zip(nodes, contexts, strict=True):
        node.destroy_node()
        context.try_shutdown()


def participants(count: int, where: str) -> dict[str, float]:
    """Wall time (s) until all know all, processor time (s) of all, and how many were seen.

    Parameters
    ----------
    count : int
    where : str
        ROS_AUTOMATIC_DISCOVERY_RANGE.
    """
    spawn = multiprocessing.get_context("spawn")
    shares = [count // PROCESSES + (k < count % PROCESSES) for k in range(PROCESSES)]
    shares = [share for share in shares if share]
    begin, told = spawn.Barrier(len(shares) + 1), spawn.Queue()
    with domain_reserved() as domain:
        os.environ.update({DOMAIN: str(domain), DISCOVERY: where})
        started = [
            spawn.Process(target=_take_part, args=(share, count, begin, told)) for share in shares
        ]
        for process in started:
            process.start()
        begin.wait()
        begun = time.perf_counter()
        answers = [told.get(timeout=2.0 * _LIMIT_S) for _ in shares]
        wall = time.perf_counter() - begun
        begin.wait()
        for process in started:
            # Among forty some do not come back from their end: Fast DDS (2.14) waits, busily, for a
            # call of discovery that waits for the same participant's lock.
            process.join(_END_LIMIT_S)
            process.kill()
    cpu = sum(answer[0] for answer in answers)
    return {"wall_s": wall, "cpu_s": cpu, "seen": min(answer[1] for answer in answers)}


def measure(count: int, counts: tuple[tuple[int, str], ...], rounds: int) -> dict[str, Any]:
    """All figures; of participants the median of the rounds."""
    prepare_environment()
    found: dict[str, Any] = {"empty_tasks": tasks(count), "participants": []}
    for number, where in counts:
        rows = [participants(number, where) for _ in range(rounds)]
        middle = {key: statistics.median(row[key] for row in rows) for key in rows[0]}
        found["participants"].append({"count": number, "range": where, **middle})
        print(f"{number} participants, {where}", file=sys.stderr)
    return found


def main() -> int:
    """Print the figures; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="a few tasks and participants")
    parser.add_argument("--json", action="store_true", help="print JSON")
    asked = parser.parse_args()
    quick = asked.quick
    found = measure(*((QUICK_TASKS, QUICK_COUNTS, 1) if quick else (TASKS, COUNTS, ROUNDS)))
    if asked.json:
        print(json.dumps(found))
        return 0
    empty = found["empty_tasks"]
    print(f"empty tasks, {WORKERS} workers: {empty['tasks_per_s']:.0f} per second; scheduler and "
          f"client {1e6 * empty['scheduler_s_per_task']:.0f} us each")  # fmt: skip
    for row in found["participants"]:
        saw = "all know all" if row["seen"] == row["count"] else f"only {row['seen']:.0f} seen"
        print(f"{row['count']:3d} participants, {row['range']:<9} {saw} after "
              f"{row['wall_s']:.2f} s, processor time {row['cpu_s']:.2f} s")  # fmt: skip
    return 0


if __name__ == "__main__":
    sys.exit(main())
