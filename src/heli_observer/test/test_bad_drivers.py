# SPDX-License-Identifier: Apache-2.0
"""A driver of an IMU in the place of the simulated one: what it does wrong is named and counted."""

import numpy as np
import pytest
from sensor_msgs.msg import Imu

from heli_core.ticks import NS_PER_S
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_REFUSED, FACT_UNUSABLE, refusal_of
from heli_observer.node import ObserverNode

BEFORE = 20
REFUSED, UNUSABLE = f"{FACT_REFUSED}{topics.IMU}", f"{FACT_UNUSABLE}{topics.IMU}"
TICK_NS, BAD_MPS2 = 10_000_000, 50.0


def sample(node, tick, late_ns=0):
    """An Imu at rest, as a driver sends it."""
    message = Imu()
    stamp_ns = node.stamp_ns(tick) + late_ns
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
    message.header.frame_id = "imu_link"
    message.orientation_covariance[0] = -1.0
    message.linear_acceleration.z = 9.81
    message.angular_velocity_covariance[:] = 1e-6 * np.eye(3).ravel()
    message.linear_acceleration_covariance[:] = 1e-4 * np.eye(3).ravel()
    return message


@pytest.fixture
def driver(bench):
    """An observer in real time that has heard good samples, and what hands it another one."""
    made = bench(ObserverNode, lockstep=False)
    made.fly()
    node = made.node

    def hand_over(message):
        made.receive(topics.IMU, message)
        return node.core.stepped

    for tick in range(BEFORE):
        assert hand_over(sample(node, tick)) == tick
    return node, hand_over


def wrong_frame(node):
    message = sample(node, BEFORE)
    message.header.frame_id = "camera"
    return message


def no_frame(node):
    message = sample(node, BEFORE)
    message.header.frame_id = ""
    return message


def not_finite(node):
    message = sample(node, BEFORE)
    message.linear_acceleration.x = float("nan")
    return message


def of_the_epoch(node):
    message = sample(node, BEFORE)
    message.header.stamp.sec = message.header.stamp.nanosec = 0
    return message


def of_the_future(node):
    return sample(node, BEFORE + 500)


def between_ticks(node):
    return sample(node, BEFORE, late_ns=TICK_NS // 3)


@pytest.mark.parametrize(
    ("message", "key", "word"),
    [
        (wrong_frame, REFUSED, "'camera'"),
        (no_frame, REFUSED, "imu_link"),
        (not_finite, UNUSABLE, "not finite"),
        (of_the_epoch, REFUSED, "zero"),
        (of_the_future, REFUSED, "ahead"),
        (between_ticks, REFUSED, "tick"),
    ],
)
def test_what_is_wrong_is_named_counted_and_not_flown(driver, message, key, word):
    node, hand_over = driver
    for _ in range(3):
        bad = message(node)
        bad.linear_acceleration.y = BAD_MPS2
        hand_over(bad)
    facts = node._refused_facts()
    counted = refusal_of(facts[key])[0] if key == REFUSED else int(facts[key])
    assert counted >= 1 and word in node.core.refused[topics.IMU]
    # The filter goes on with the next good one, and has nothing of the others in its memory.
    assert hand_over(sample(node, BEFORE + 1)) == BEFORE + 1
    held = node.core.state.imu
    assert np.isfinite(held).all() and not (np.abs(held) == BAD_MPS2).any()


def test_the_same_stamp_twice_counts_once(driver):
    node, hand_over = driver
    first = sample(node, BEFORE)
    assert hand_over(first) == BEFORE
    again = sample(node, BEFORE)
    again.linear_acceleration.x = 50.0
    for count in (1, 2):
        hand_over(again)
        assert node.core.pace.counters.duplicate == count and node.core.stepped == BEFORE


def test_a_covariance_of_zeros_is_one_that_is_not_known(driver):
    """As sensor_msgs/Imu has it: the filter flies by its own parameters, whatever is sent."""
    node, hand_over = driver
    message = sample(node, BEFORE)
    message.angular_velocity_covariance[:] = np.zeros(9)
    message.linear_acceleration_covariance[:] = np.zeros(9)
    assert hand_over(message) == BEFORE
    assert REFUSED not in node._refused_facts() and UNUSABLE not in node._refused_facts()
