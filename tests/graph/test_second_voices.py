# SPDX-License-Identifier: Apache-2.0
"""A second sender where several may send: of references, and of what nodes say of themselves."""

import json
import subprocess
import sys
import time

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.executors import SingleThreadedExecutor

from heli_bags.reader import read_bag
from heli_flight.settings import resolve
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import encode_reference


@pytest.fixture
def pilot(ros_env, monkeypatch):
    """Make a publisher of default QoS of a node `pilot`, and wait for so many listeners."""
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=int(ros_env["ROS_DOMAIN_ID"]))
    node = rclpy.create_node("pilot", context=context)
    executor = SingleThreadedExecutor(context=context)

    def publisher(topic, listeners):
        made = node.create_publisher(topics.message_class(topics.BY_NAME[topic].type), topic, 10)
        deadline = time.monotonic() + 120.0
        while made.get_subscription_count() < listeners:
            assert time.monotonic() < deadline, topic
            rclpy.spin_once(node, executor=executor, timeout_sec=0.05)
        return made

    yield publisher
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


@pytest.mark.nightly  # a client has to keep up with the flight
def test_a_second_sender_of_references_and_of_health_is_named(pilot, ros_env, tmp_path):
    """`topic pub` of a reference commands, as it may; a false plant's end is not believed."""
    folder = tmp_path / "flight"
    command = [sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report", "--realtime"]
    flying = subprocess.Popen(
        [*command, "--duration", "30", "--out", str(folder)],
        env=ros_env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    assert "flown" in flying.stdout.readline()
    # Outer loop and recorder, which has two subscriptions to a latched topic; of health the
    # supervisor and the recorder.
    references, healths = pilot(topics.REFERENCE, 2), pilot(topics.DIAGNOSTICS, 2)
    references.publish(encode_reference(resolve().scenario.reference))
    false = DiagnosticStatus(name="plant", hardware_id="helicopter", message="hit the ground")
    false.level, false.values = b"\2", [KeyValue(key="over", value="true")]
    healths.publish(DiagnosticArray(status=[false]))
    out, err = flying.communicate(timeout=120)
    assert flying.returncode in (0, 1), out + err
    sent = "reference: sent by /pilot, /scenario; each reference is followed as it comes"
    spoken = "/diagnostics: somebody else speaks as plant: /pilot"
    result = json.loads((folder / "result.json").read_text())
    notes = result["notes"]
    assert result["lost"] == "" and result["flown_s"] == pytest.approx(30.0), result
    assert f"outer_loop: {sent}" in notes and f"recorder: {spoken}" in notes, notes
    facts = {}
    for remark in read_bag(folder / "bag").remarks:
        facts.setdefault(remark.node, {}).update(remark.facts)
    assert facts["outer_loop"]["senders.reference"] == sent
    assert facts["recorder"]["senders./diagnostics"] == spoken
