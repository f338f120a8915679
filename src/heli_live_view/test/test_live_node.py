# SPDX-License-Identifier: Apache-2.0
"""What the node shows of a flight whose nodes sign their messages."""

import secrets

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rclpy.serialization import serialize_message

from heli_live_view.node import LiveViewNode
from heli_msgs_bridge import topics
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.messages import Encoder
from heli_msgs_bridge.signatures import KEY_BYTES, KEY_VARIABLE, signature_of


@pytest.fixture
def view(ros_context, tmp_path, monkeypatch):
    key = tmp_path / "key"
    key.write_bytes(secrets.token_bytes(KEY_BYTES))
    key.chmod(0o600)
    monkeypatch.setenv(KEY_VARIABLE, str(key))
    values = LiveViewNode.SPEC.resolve() | {"autostart": False, "port": 0, "nice": 0}
    node = LiveViewNode(values | {"foxglove": False}, context=ros_context)
    node.trigger_configure()
    assert not node.failure
    yield node
    node.end()
    node.destroy_node()


def test_a_stream_is_shown_only_if_it_is_signed(view):
    raw = Encoder(topics.ODOM).encode(np.zeros(CHANNELS[topics.ODOM].size), 10_000_000)
    signed = signature_of("/odom").sign(raw)
    owner = view.core.owners[topics.ODOM]
    assert set(view.core.owners) > {topics.ODOM, topics.TRUTH_ODOM, topics.ACTUATORS}
    assert not owner.admits(raw, {"publication_sequence_number": 1})
    assert owner.admits(signed, {"publication_sequence_number": 7}) and owner.ignored == 1


def test_words_of_the_flights_nodes_are_believed_only_if_they_are_signed(view):
    def said(name, message):
        status = DiagnosticStatus(name=name, message=message, level=DiagnosticStatus.ERROR)
        return serialize_message(DiagnosticArray(status=[status]))

    forged, other = said("plant", "it burns"), said("somebody", "hello")
    view._on_diagnostics(forged)
    assert view.core.forged == 1
    view._on_diagnostics(other)
    view._on_diagnostics(signature_of("/diagnostics").sign(said("plant", "flying")))
    texts = [event.text for event in view.core.screen.live.take_events()]
    assert view.core.forged == 1 and "it burns" not in texts and "flying" in texts
