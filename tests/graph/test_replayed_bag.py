# SPDX-License-Identifier: Apache-2.0
"""The sensors of a recorded flight, played into an observer, give the recorded odometry.

Nobody waits for the recorder: on busy cores it hears each topic's messages in turns, some of them
seconds of the flight late. A bag has them where they were sent all the same.
"""

import contextlib
import itertools
import subprocess
import sys

import numpy as np
import pytest
from mcap.reader import make_reader
from rosbags.rosbag2 import Reader

from heli_bags.reader import read_bag
from heli_core.rows import NAV
from heli_flight.settings import resolve
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_observer.node import ObserverNode

LENGTH_S, BUSY = 20.0, 3


@contextlib.contextmanager
def busy_cores(env):
    """Processes that take all the time that they get."""
    command = [sys.executable, "-c", "while True: pass"]
    busy = [subprocess.Popen(command, env=env) for _ in range(BUSY)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


def by_rosbags(bag):
    with Reader(bag) as reader:
        for connection, log_ns, raw in reader.messages():
            yield connection.topic[1:], log_ns, bytes(raw)


def by_mcap(bag):
    (path,) = bag.glob("*.mcap")
    with open(path, "rb") as file:
        for _, channel, message in make_reader(file).iter_messages():
            yield channel.topic[1:], message.log_time, message.data


@pytest.fixture
def flight(hover_test, ros_env, tmp_path):
    """A folder with a flight that was recorded on busy cores."""
    folder = tmp_path / "flight"
    with busy_cores({name: value for name, value in ros_env.items() if name != "HELI_TEST_RUN"}):
        done = hover_test("--seed", 7, "--duration", LENGTH_S, "--out", folder)
    assert done.returncode in (0, 1), done.stdout + done.stderr
    return folder


def test_played_sensors_give_the_recorded_odometry(flight, bench):
    """As they come, and tick by tick; read by two libraries."""
    values = resolve(params=[flight / "params.yaml"]).nodes["observer"]
    changed = {name.replace(".", "__"): value for name, value in values.items()}
    recorded = read_bag(flight / "bag").streams[topics.ODOM].rows[:, NAV.pos]
    latency_ns = {}
    for lockstep, read in itertools.product((False, True), (by_rosbags, by_mcap)):
        observer = bench(ObserverNode, **changed | {"lockstep": lockstep, "peers": []})
        observer.fly()
        for name, log_ns, raw in read(flight / "bag"):
            if name in topics.BY_NAME and "observer" in topics.BY_NAME[name].sinks:
                latency_ns.setdefault(name, set()).add((log_ns - stamp_of(raw)) // 1000 * 1000)
                if name != topics.IMU2:
                    observer.receive(name, raw)
        played = np.array(observer.sent[topics.ODOM])[:, NAV.pos]
        assert len(played) == len(recorded) > 0.9 * LENGTH_S * 100
        assert np.linalg.norm(played - recorded, axis=1).max() < 1e-3
    fixes = (topics.GPS_FIX, topics.GPS_VELOCITY)
    assert [latency_ns.pop(name) for name in fixes] == [{150_000_000}] * len(fixes)
    assert all(after_ns == {0} for after_ns in latency_ns.values())
