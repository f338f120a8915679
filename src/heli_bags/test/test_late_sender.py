# SPDX-License-Identifier: Apache-2.0
"""A recorder that comes to know a sender late: what was sent before is waited for at the end."""

import numpy as np
import pytest
from sensor_msgs.msg import Imu

from heli_bags.node import RecorderNode
from heli_msgs_bridge import topics
from heli_msgs_bridge.messages import Encoder


@pytest.mark.parametrize("sender_is_there", [True, False])
def test_the_end_waits_for_the_plant_it_has_not_heard(
    bench, tmp_path, monkeypatch, sender_is_there
):
    """The message comes when the queues have been silent for so long that it would be over."""
    recorder = bench(RecorderNode, bag=str(tmp_path / "bag"), topics=(topics.IMU,))
    recorder.fly()
    node, sent = recorder.node, []
    if sender_is_there:
        publisher = node.create_publisher(Imu, topics.IMU, topics.qos(topics.IMU))
    ask = node._none_came

    def asked():
        none_came = ask()
        if sender_is_there and not sent:
            sent.append(none_came)
            publisher.publish(Encoder(topics.IMU).encode(np.zeros(6), 2 * 10**9))
        return none_came

    monkeypatch.setattr(node, "_none_came", asked)
    node.disengage()
    assert sent == [True] * sender_is_there
    assert node.core.bag.counts[topics.IMU] == sender_is_there
