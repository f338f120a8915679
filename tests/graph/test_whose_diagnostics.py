# SPDX-License-Identifier: Apache-2.0
"""/diagnostics is shared by all aircraft of a ROS domain: whose message it is decides."""

import time

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import serialize_message

from heli_bags.reader import read_bag
from heli_bags.writer import BagRecorder
from heli_flight.graph.supervisor import Supervisor
from heli_msgs_bridge import topics
from heli_msgs_bridge.messages import Encoder

LIMIT_S = 120.0
OTHERS = ("heli2/plant", "/heli2/plant", "a/b/plant", "plant/plant", "heli2/")
OVER = "The aircraft hit the ground"


def diagnostics(name, message=OVER, stamp_s=1):
    """What a plant says at the end of its flight."""
    status = DiagnosticStatus(name=name, hardware_id=name, message=message, level=b"\2")
    status.values = [KeyValue(key="over", value="true")]
    array = DiagnosticArray(status=[status])
    array.header.stamp.sec = stamp_s
    return array


@pytest.fixture
def supervisor(ros_context):
    made = Supervisor(["plant"], context=ros_context)
    yield made
    made.close()


@pytest.fixture
def voice(ros_context):
    """Make a publisher to /diagnostics of a node of another aircraft."""
    import rclpy

    node = rclpy.create_node("stranger", namespace="/heli2", context=ros_context)
    executor = SingleThreadedExecutor(context=ros_context)
    executor.add_node(node)

    def make():
        publisher = node.create_publisher(
            DiagnosticArray, topics.DIAGNOSTICS, topics.qos(topics.DIAGNOSTICS)
        )
        deadline = time.monotonic() + LIMIT_S
        while not publisher.get_subscription_count():
            assert time.monotonic() < deadline
            executor.spin_once(timeout_sec=0.05)
        return publisher.publish

    yield make
    executor.shutdown()
    node.destroy_node()


@pytest.fixture
def say(voice):
    """Publish to /diagnostics from a node of another aircraft."""
    return voice()


def test_the_supervisor_hears_its_own_aircraft_only(supervisor, say):
    """The plant of another one crashes: its status is nobody's here, the own plant's counts."""
    for name in OTHERS:
        say(diagnostics(name))
    say(diagnostics("plant", "flying"))
    heard = lambda: "plant" in supervisor.statuses  # noqa: E731
    assert supervisor.wait_until(heard, LIMIT_S, lambda: None)
    assert {name: s.message for name, s in supervisor.statuses.items()} == {"plant": "flying"}
    say(diagnostics("/plant", "landed"))
    landed = lambda: supervisor.statuses["plant"].message == "landed"  # noqa: E731
    assert supervisor.wait_until(landed, LIMIT_S, lambda: None)


@pytest.mark.parametrize(("silence_s", "believed"), [(60.0, "flying"), (0.0, OVER)])
def test_somebody_else_is_no_plant_before_it_is_silent(
    supervisor, voice, monkeypatch, silence_s, believed
):
    """One false "over" would end the flight."""
    monkeypatch.setattr("heli_flight.graph.lifecycle._SILENT_S", silence_s)
    plant, stranger = voice(), voice()

    def until(name, message):
        says = lambda: getattr(supervisor.statuses.get(name), "message", "") == message  # noqa: E731
        assert supervisor.wait_until(says, LIMIT_S, lambda: None), supervisor.statuses

    for state in ("configured", "active", "flying"):
        plant(diagnostics("plant", state))
    until("plant", "flying")
    stranger(diagnostics("plant"))
    # By the same way: what was sent before it has come.
    stranger(diagnostics("camera", "seen"))
    until("camera", "seen")
    assert supervisor.statuses["plant"].message == believed
    plant(diagnostics("plant", "landed"))
    until("plant", "landed")


@pytest.mark.parametrize("namespace", ["", "heli1", "fleet/heli1"])
def test_a_bag_tells_what_its_own_aircraft_said(tmp_path, namespace):
    """The recorder writes all of /diagnostics; the report is about the aircraft that was flown."""
    recorder = BagRecorder(tmp_path / "bag", [topics.IMU, topics.DIAGNOSTICS], f"/{namespace}")
    recorder.write(topics.IMU, Encoder(topics.IMU).encode(np.zeros(6), 1_000_000_000))
    plant_name = f"{namespace}/plant".lstrip("/")
    for name in (*OTHERS, plant_name):
        message = "own" if name == plant_name else OVER
        recorder.write(topics.DIAGNOSTICS, serialize_message(diagnostics(name, message)))
    recorder.close()
    remarks = read_bag(tmp_path / "bag").remarks
    assert [(remark.node, remark.message) for remark in remarks] == [("plant", "own")]
