# SPDX-License-Identifier: Apache-2.0
"""Exit codes of a node: what fails because a signal has ended ROS is no failure of the node."""

from types import SimpleNamespace

import pytest

from heli_msgs_bridge import managed_node

SAID = "publisher's context is invalid"


@pytest.mark.parametrize(("ros_lives", "code"), [(True, 1), (False, 0)])
def test_a_send_after_the_signal_is_no_failure(monkeypatch, capsys, ros_lives, code):
    ended = []
    node = SimpleNamespace(teardown=lambda: ended.append("torn down"), destroy_node=ended.clear)

    def spin(_):
        raise RuntimeError(SAID)

    monkeypatch.setattr(managed_node, "_start", lambda *_: node)
    monkeypatch.setattr(managed_node, "_spin", spin)
    monkeypatch.setattr(managed_node.rclpy, "ok", lambda: ros_lives)
    monkeypatch.setattr(managed_node.rclpy, "try_shutdown", lambda: None)
    cls = SimpleNamespace(SPEC=SimpleNamespace(name="plant"))
    assert managed_node.run(cls, []) == code
    said = capsys.readouterr().err
    assert said == ("" if code == 0 else f"plant: failed in flight: RuntimeError: {SAID}\n")
    assert ended == ([] if ros_lives else ["torn down"])
