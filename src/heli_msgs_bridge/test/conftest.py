# SPDX-License-Identifier: Apache-2.0
"""Searches for counter-examples, short and at night; ROS nodes in this process."""

import pytest
import rclpy
from hypothesis import HealthCheck, settings
from rclpy.executors import SingleThreadedExecutor


def _search(examples: int, steps: int, repeatable: bool) -> settings:
    return settings(
        max_examples=examples,
        stateful_step_count=steps,
        derandomize=repeatable,
        database=None,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.function_scoped_fixture],
    )


@pytest.fixture(
    params=[
        pytest.param((60, 50, True), id="short"),
        pytest.param((3000, 120, False), id="long", marks=pytest.mark.nightly),
    ]
)
def search(request):
    """Settings of hypothesis: the same examples in every run, or many new ones."""
    return _search(*request.param)


@pytest.fixture
def two_nodes(ros_context):
    """Two nodes, and what spins the second for a time (s) or until something has come."""
    nodes = [rclpy.create_node(name, context=ros_context) for name in ("sender", "listener")]
    executor = SingleThreadedExecutor(context=ros_context)
    executor.add_node(nodes[1])
    yield *nodes, executor.spin_once
    executor.shutdown()
    for node in nodes:
        node.destroy_node()


@pytest.fixture
def fast_decoder():
    """Make a Decoder that reads messages of the usual layout and refuses all others."""
    from heli_msgs_bridge.messages import Decoder

    def slowly(raw):
        raise AssertionError("not the usual layout: it takes the ordinary decoder")

    return lambda topic, datum=None: Decoder(topic, datum, slowly)
