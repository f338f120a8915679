# SPDX-License-Identifier: Apache-2.0
"""Nodes started one by one by `heli run`: they configure and activate themselves and fly."""

import re
import subprocess
import sys
import time

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State
from lifecycle_msgs.srv import GetState
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import Imu

from heli_flight.flight_file import write_parameters
from heli_flight.layers import NODES
from heli_flight.settings import resolve
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_MISSING, FACT_STATE, NodeState
from heli_outer_pd.state import OuterStatus

RUN = [sys.executable, "-m", "heli_flight.cli.app", "run"]
LIMIT_S = 240.0


@pytest.mark.parametrize(
    "navigation", [pytest.param("observer", marks=pytest.mark.slow), "navigator"]
)
def test_nodes_started_alone_find_each_other_and_fly(tmp_path, ros_env, living, navigation):
    """A namespace moves the whole graph; the plant ends by itself when the flight is over.

    They are given a flight's params.yaml: each takes its section, and passes the others over. One
    may have another name, by which the file speaks of it then.
    """
    params = tmp_path / "params.yaml"
    write_parameters(resolve(duration_s=3.0), params)
    text = params.read_text()
    assert text.count("/observer:\n") == 1
    params.write_text(text.replace("/observer:\n", f"/{navigation}:\n"))
    arguments = ["--ros-args", "-r", "__ns:=/heli1", "--params-file", str(params)]
    arguments += ["-r", f"observer:__node:={navigation}"]
    others = [("heli_flight", "scenario")]
    others += [(n.package, n.executable) for n in NODES if n.name != "plant"]
    started = []
    for package, name in others:
        with open(tmp_path / f"{name}.log", "wb") as log:
            command = [*RUN, package, name, *arguments]
            started.append(
                subprocess.Popen(command, env=ros_env, stdout=log, stderr=subprocess.STDOUT)
            )
    plant = subprocess.run(
        [*RUN, "heli_dynamics_sim", "plant", *arguments],
        env=ros_env, capture_output=True, text=True, timeout=240,
    )  # fmt: skip
    for process in started:
        process.terminate()
    codes = [process.wait(timeout=120) for process in started]
    logs = "".join(path.read_text() for path in tmp_path.glob("*.log"))
    assert plant.returncode == 0, plant.stdout + plant.stderr + logs
    assert re.search(r"\bover\b.* 3 s\b", plant.stdout + plant.stderr)
    assert "no message" not in plant.stdout + plant.stderr
    assert OuterStatus.OK.sentence in (tmp_path / "outer_loop.log").read_text()
    assert f"[heli1.{navigation}]" in (tmp_path / "observer.log").read_text()
    assert codes == [0] * len(codes), logs
    assert living() == []


@pytest.fixture
def alone(ros_env):
    """Start one node by `heli run`, and a node in this process that asks it, spun by `until`."""
    processes, context = [], rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=int(ros_env["ROS_DOMAIN_ID"]))
    asker = rclpy.create_node("asker", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(asker)

    def start(package, name, *arguments):
        command = [*RUN, package, name, "--ros-args", *arguments]
        processes.append(
            subprocess.Popen(
                command, env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
            )
        )
        return processes[-1]

    def until(condition):
        deadline_s = time.monotonic() + LIMIT_S
        while not condition():
            assert time.monotonic() < deadline_s
            executor.spin_once(timeout_sec=0.2)

    yield start, asker, until
    executor.shutdown()
    asker.destroy_node()
    context.shutdown()
    for process in processes:
        process.kill()
        process.communicate()


@pytest.mark.parametrize("lockstep", ["true", "false"])
def test_a_plant_alone_runs_answers_and_publishes(alone, lockstep):
    """What it waits for is in /diagnostics, before it flies and when it does; SIGTERM ends it."""
    start, asker, until = alone
    said, heard = [], []
    asker.create_subscription(
        DiagnosticArray, topics.DIAGNOSTICS,
        lambda m: said.append({pair.key: pair.value for s in m.status for pair in s.values}),
        topics.qos(topics.DIAGNOSTICS),
    )  # fmt: skip
    asker.create_subscription(Imu, topics.IMU, heard.append, qos_profile_sensor_data)
    client = asker.create_client(GetState, "/plant/get_state")
    plant = start("heli_dynamics_sim", "plant", "-p", f"lockstep:={lockstep}")
    until(client.service_is_ready)
    answered = []

    def asked():
        request = client.call_async(GetState.Request())
        until(request.done)
        answered.append((request.result().current_state.id, bool(heard)))
        return len(heard) > 20

    until(asked)
    # While it is configured, while it waits, while it flies.
    active = State.PRIMARY_STATE_ACTIVE
    assert {(active, False), (active, True)} <= set(answered)
    missing = "inner_loop, observer, outer_loop"
    states = [facts.get(FACT_STATE) for facts in said if facts.get(FACT_MISSING) == missing]
    assert {NodeState.WAITING, NodeState.WITHOUT_INPUT} <= set(states)
    plant.terminate()
    log, _ = plant.communicate(timeout=LIMIT_S)
    assert plant.returncode == 0, log


def test_one_that_waits_ends_when_it_is_asked(alone):
    """No peer ever comes; the way out is the same as in flight."""
    start, asker, until = alone
    client = asker.create_client(GetState, "/observer/get_state")
    other = rclpy.create_node("recorder", context=asker.context)
    observer = start("heli_observer", "observer", "-p", "connect_timeout_s:=3600.0")
    until(client.service_is_ready)

    def active():
        request = client.call_async(GetState.Request())
        until(request.done)
        return request.result().current_state.id == State.PRIMARY_STATE_ACTIVE

    until(active)
    observer.terminate()
    log, _ = observer.communicate(timeout=LIMIT_S)
    other.destroy_node()
    assert observer.returncode == 0, log
