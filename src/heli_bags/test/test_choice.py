# SPDX-License-Identifier: Apache-2.0
"""What a recorder leaves out is what it does not subscribe to."""

import pytest

from heli_bags.node import RecorderNode
from heli_bags.parameters import unrecorded
from heli_msgs_bridge import topics


@pytest.mark.parametrize(
    ("wanted", "exclude"),
    [
        (["all"], ["none"]),
        (["all"], ["imu/mag", "/clock"]),
        (["odom", "/clock"], ["none"]),
        (["odom", "imu/mag"], ["odom"]),
        (["/camera:sensor_msgs/msg/CameraInfo"], ["none"]),
        (["/camera:sensor_msgs/msg/CameraInfo", "all"], ["baro"]),
    ],
)
def test_what_is_left_out_is_what_is_not_heard(ros_context, tmp_path, wanted, exclude):
    values = RecorderNode.SPEC.resolve() | {"autostart": False, "bag": str(tmp_path / "bag")}
    node = RecorderNode(values | {"topics": wanted, "exclude": exclude}, context=ros_context)
    node.trigger_configure()
    heard = set(node.core.subscriptions)
    node.end()
    node.destroy_node()
    left = set(unrecorded(wanted, exclude))
    assert left == ({t.name for t in topics.TABLE} - heard or {"none"})
