# SPDX-License-Identifier: Apache-2.0
"""A recorder that comes to know a sender late: what was sent before is waited for at the end."""

import numpy as np
import pytest
from sensor_msgs.msg import Imu

from heli_bags.node import RecorderNode
from heli_bags.writer import BagError
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import Level, NodeState
from heli_msgs_bridge.messages import Encoder


@pytest.mark.parametrize("known", ["sender", "name", ""])
def test_the_end_waits_for_a_node_it_has_not_heard(bench, tmp_path, monkeypatch, known):
    """The message comes when the queues have been silent for so long that it would be over.

    The recorder may know of the sender before it knows whose it is, and of the plant before its
    senders.
    """
    recorder = bench(RecorderNode, bag=str(tmp_path / "bag"), topics=(topics.IMU,))
    recorder.fly()
    node, sent = recorder.node, []
    publisher = node.create_publisher(Imu, topics.IMU, topics.qos(topics.IMU))
    monkeypatch.setattr(node, "count_publishers", lambda name: known == "sender")
    names = [("plant" if known == "name" else "gps", "/"), ("plant", "/other")]
    monkeypatch.setattr(node, "get_node_names_and_namespaces", lambda: names)
    ask = node._none_came

    def asked():
        none_came = ask()
        if none_came and not sent:
            sent.append(none_came)
            publisher.publish(Encoder(topics.IMU).encode(np.zeros(6), 2 * 10**9))
        return none_came

    monkeypatch.setattr(node, "_none_came", asked)
    node.disengage()
    assert sent == [True] * bool(known)
    assert node.core.bag.counts[topics.IMU] == bool(known)


@pytest.mark.parametrize(("there", "awaited"), [("observer", True), ("plant", False)])
def test_whoever_sends_with_every_tick_is_waited_for(bench, tmp_path, monkeypatch, there, awaited):
    """A composed flight may be over before its recorder knows all of its senders."""
    recorder = bench(RecorderNode, bag=str(tmp_path / "bag"), topics=(topics.ODOM,))
    recorder.fly()
    monkeypatch.setattr(recorder.node, "get_node_names_and_namespaces", lambda: [(there, "/")])
    assert recorder.node._none_came() is awaited


def test_a_recording_that_has_ended_stays_the_last_word(bench, tmp_path):
    recorder = bench(RecorderNode, bag=str(tmp_path / "bag"), topics=(topics.IMU,))
    recorder.fly()
    node = recorder.node
    node._complain(BagError("full"))
    node.report(Level.OK, "records")
    status = node.health.level, node.health.message, node.health.state
    assert status == (Level.ERROR, "full", NodeState.FAILED)
