# SPDX-License-Identifier: Apache-2.0
"""One ROS domain, one `/clock`: a plant does not begin beside another sender of it."""

import rclpy

from heli_msgs_bridge import topics


def test_a_plant_refuses_to_begin_beside_another_clock(crew, ros_context):
    """Two launches by hand under two namespaces: the second one says what to do."""
    one = crew("plant")
    assert one.change("plant", 1)
    other = rclpy.create_node("plant", namespace="red", context=ros_context)
    kind = topics.message_class(topics.BY_NAME[topics.CLOCK].type)
    clock = other.create_publisher(kind, topics.CLOCK, 10)
    plant = one.nodes["plant"]
    one.spin_until(lambda: plant.count_publishers(topics.CLOCK) == 2)
    assert not one.change("plant", 3)
    for named in ("/red/plant", "/clock", "'clock: world'", "world_clock", "ROS_DOMAIN_ID"):
        assert named in plant.failure
    other.destroy_publisher(clock)
    one.spin_until(lambda: plant.count_publishers(topics.CLOCK) == 1)
    assert one.change("plant", 3)
    # In a pause it is too late to refuse.
    assert one.change("plant", 4)
    clock = other.create_publisher(kind, topics.CLOCK, 10)
    one.spin_until(lambda: plant.count_publishers(topics.CLOCK) == 2)
    assert one.change("plant", 3)
    other.destroy_node()
