#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Throughput and loss of the recorder: a process that publishes, the recorder, a count in the bag.

    ./heli python scripts/bench_recorder.py --rate 5000 --topics 10 --seconds 10

Every message carries its number; a message counts as recorded only if its number is in the bag.
"""

import argparse
import json
import multiprocessing
import os
import shutil
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

KIND = "sensor_msgs/msg/Imu"
_SETTLE_S, _LIMIT_S = 30.0, 60.0


def topic_names(count: int) -> list[str]:
    """Topics of the benchmark."""
    return [f"bench/t{number}" for number in range(count)]


def publish(names: list[str], rate: float, seconds: float, sent: multiprocessing.Queue) -> None:
    """Publish numbered messages in bursts of 10 ms, wait until they are acknowledged."""
    import numpy as np
    import rclpy
    from rclpy.duration import Duration

    from heli_msgs_bridge import topics
    from heli_msgs_bridge.layouts import CHANNELS
    from heli_msgs_bridge.messages import Encoder

    rclpy.init(args=[])
    node = rclpy.create_node("bench_publisher")
    cls, qos = topics.message_class(KIND), topics.qos("")
    publishers = [node.create_publisher(cls, f"/{name}", qos) for name in names]
    limit = time.monotonic() + _SETTLE_S
    while any(p.get_subscription_count() == 0 for p in publishers):
        if time.monotonic() > limit:
            sent.put({"error": "the recorder did not subscribe"})
            return
        time.sleep(0.01)
    raw = bytearray(Encoder(topics.IMU).encode(np.zeros(CHANNELS[topics.IMU].size), 0))
    numbers, begun, slices = [0] * len(names), time.monotonic(), round(seconds * 100)
    total = 0
    for step in range(1, slices + 1):
        for _ in range(round(step * rate / 100) - total):
            at = total % len(names)
            struct.pack_into("<I", raw, 8, numbers[at])
            publishers[at].publish(bytes(raw))
            numbers[at] += 1
            total += 1
        wait = begun + step / 100 - time.monotonic()
        if wait > 0.0:
            time.sleep(wait)
    took_s = time.monotonic() - begun
    acked = all(p.wait_for_all_acked(Duration(seconds=_LIMIT_S)) for p in publishers)
    sent.put({"counts": numbers, "seconds": took_s, "acknowledged": acked})
    rclpy.shutdown()


def deactivate() -> None:
    """Ask the recorder to drain, as a flight's supervisor does."""
    import rclpy
    from lifecycle_msgs.msg import Transition
    from lifecycle_msgs.srv import ChangeState

    rclpy.init(args=[])
    node = rclpy.create_node("bench_supervisor")
    client = node.create_client(ChangeState, "/recorder/change_state")
    client.wait_for_service(timeout_sec=_SETTLE_S)
    request = ChangeState.Request()
    request.transition.id = Transition.TRANSITION_DEACTIVATE
    rclpy.spin_until_future_complete(node, client.call_async(request), timeout_sec=_LIMIT_S)
    rclpy.shutdown()


def cpu_seconds(pid: int) -> float:
    """Processor time of a process so far."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def count(bag: Path, names: list[str]) -> dict[str, int]:
    """Different numbers per topic in the bag."""
    from rosbags.rosbag2 import Reader

    seen: dict[str, set[int]] = {name: set() for name in names}
    with Reader(bag) as reader:
        for connection, _, raw in reader.messages():
            seen[connection.topic.lstrip("/")].add(struct.unpack_from("<I", raw, 8)[0])
    return {name: len(numbers) for name, numbers in seen.items()}


def bench(
    rate: float, n_topics: int, seconds: float, storage: str, compression: str, folder: Path
) -> dict[str, object]:
    """One run; returns what was sent, recorded and lost."""
    names, bag = topic_names(n_topics), folder / "bench"
    wanted = ", ".join(f"'{name}:{KIND}'" for name in names)
    parameters = folder / "recorder.yaml"
    parameters.write_text(
        f"/**/recorder:\n  ros__parameters:\n    bag: {bag}\n    topics: [{wanted}]\n"
        f"    storage: {storage}\n    compression: {compression}\n"
    )
    command = [sys.executable, "-m", "heli_bags.node", "--ros-args"]
    recorder = subprocess.Popen(
        [*command, "--params-file", str(parameters)], stdout=subprocess.DEVNULL
    )
    context = multiprocessing.get_context("spawn")
    sent = context.Queue()
    publisher = context.Process(target=publish, args=(names, rate, seconds, sent))
    try:
        publisher.start()
        result = sent.get(timeout=_SETTLE_S + seconds + _LIMIT_S)
        publisher.join()
        if "error" in result:
            raise SystemExit(f"bench_recorder: {result['error']}")
        ender = context.Process(target=deactivate)
        ender.start()
        ender.join()
        cpu_s = cpu_seconds(recorder.pid)
    finally:
        recorder.terminate()
        recorder.wait(timeout=_LIMIT_S)
        publisher.kill()
    recorded = count(bag, names)
    total = sum(result["counts"])
    size = sum(path.stat().st_size for path in bag.iterdir())
    return {
        "rate_hz": total / result["seconds"],
        "topics": n_topics,
        "sent": total,
        "recorded": sum(recorded.values()),
        "lost": total - sum(recorded.values()),
        "acknowledged": result["acknowledged"],
        "recorder_cpu": cpu_s / result["seconds"],
        "size_mb": size / 1e6,
        "storage": storage,
        "compression": compression,
    }


def main() -> int:
    """Run the benchmark; exit code 1 if a message was lost."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "--rate", type=float, default=5000.0, help="messages per second, all topics"
    )
    parser.add_argument("--topics", type=int, default=10)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--storage", choices=("mcap", "sqlite3"), default="mcap")
    parser.add_argument("--compression", choices=("none", "zstd"), default="none")
    parser.add_argument("--json", action="store_true", help="print JSON")
    asked = parser.parse_args()
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    folder = Path(tempfile.mkdtemp(prefix="heli_bench_"))
    try:
        found = bench(
            asked.rate, asked.topics, asked.seconds, asked.storage, asked.compression, folder
        )
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    if asked.json:
        print(json.dumps(found))
    else:
        print(
            f"{found['sent']} messages at {found['rate_hz']:.0f}/s on {found['topics']} topics: "
            f"{found['recorded']} recorded, {found['lost']} lost; recorder "
            f"{found['recorder_cpu']:.0%} of a core; {found['size_mb']:.2f} MB "
            f"({found['storage']}, {found['compression']})"
        )
    return int(bool(found["lost"]))


if __name__ == "__main__":
    sys.exit(main())
