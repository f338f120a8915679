# SPDX-License-Identifier: Apache-2.0
"""The first reference begins where the aircraft is, if it is told to; later ones are as given."""

from dataclasses import replace

import numpy as np
import pytest

from heli_core.rows import NAV, REFERENCE
from heli_core.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import encode_reference
from heli_msgs_bridge.layouts import CHANNELS
from heli_outer_pd.node import OuterLoopNode
from heli_outer_pd.reference import fill_offset, moved
from support.step_climb import step_climb

HERE = np.array([1.5, -0.7, -10.9])
CLIMB = step_climb(np.array([0.0, 0.0, -10.0]), 0.3, 0.02, 4.0, 2.5)


def nav_at(position):
    nav = np.zeros(CHANNELS[topics.ODOM].size)
    nav[NAV.pos], nav[NAV.quat] = position, [1.0, 0.0, 0.0, 0.0]
    return nav


@pytest.fixture
def fly(bench):
    """fly(anchor): the node with a reference under way, engaged at tick 8, where it cannot be."""

    def run(anchor):
        outer = bench(OuterLoopNode, reference_anchor=anchor)
        outer.fly()
        trajectory = replace(CLIMB, start_ns=outer.node.stamp_ns(0))
        outer.receive(topics.REFERENCE, encode_reference(trajectory))
        for tick in range(8):
            outer.send(topics.ODOM, tick, np.full(CHANNELS[topics.ODOM].size, np.nan))
        for tick in range(8, 13):
            outer.send(topics.ODOM, tick, nav_at(HERE))
        return outer

    return run


def test_the_reference_begins_where_the_aircraft_is_when_the_law_engages(fly):
    node = fly("engagement").node
    core, at_engagement = node.core, node.core.trajectory.at(node.stamp_ns(8))
    np.testing.assert_allclose(at_engagement[REFERENCE.pos], HERE, atol=1e-12)
    # Heading, speed and times are those that were given; so is every distance of the way.
    np.testing.assert_allclose(core.trajectory.points[:, 3:], CLIMB.points[:, 3:], atol=1e-12)
    np.testing.assert_array_equal(core.trajectory.times_ns, CLIMB.times_ns)
    np.testing.assert_allclose(
        np.diff(core.trajectory.points[:, :3], axis=0),
        np.diff(CLIMB.points[:, :3], axis=0),
        atol=1e-12,
    )


def test_as_packaged_it_is_flown_where_it_says(fly):
    core = fly("given").node.core
    assert core.trajectory is core.reference
    np.testing.assert_array_equal(core.offset_ned_m, np.zeros(3))


def test_a_reference_that_comes_in_flight_is_flown_where_it_says(fly):
    outer = fly("engagement")
    later = Trajectory.hover(np.array([3.0, 4.0, -12.0]), 0.0)
    outer.receive(topics.REFERENCE, encode_reference(later))
    outer.send(topics.ODOM, 13, nav_at(HERE))
    np.testing.assert_array_equal(outer.node.core.trajectory.points, later.points)
    np.testing.assert_array_equal(outer.node.core.offset_ned_m, np.zeros(3))


def test_offset_and_move_are_inverse():
    offset = np.empty(3)
    fill_offset(HERE, 2_000_000_000, CLIMB.times_ns, CLIMB.points, offset)
    np.testing.assert_allclose(moved(CLIMB, offset).at(2_000_000_000)[:3], HERE, atol=1e-12)
    assert CLIMB.points[0, 2] == -10.0, "the given one is not touched"
