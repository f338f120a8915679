# SPDX-License-Identifier: Apache-2.0
"""Gotos, the last one in the middle of another, through the graph; the example of the README."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor

from heli_bags.reader import read_bag
from heli_core.rows import REFERENCE
from heli_core.trajectory import Trajectory
from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_msgs_bridge import topics

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "goto.py"
HOVER_TEST = [
    sys.executable, "-m", "heli_flight.cli.hover_test", "--no-report", "--world", "paper",
    "--gps", "rtk", "--seed", "5",
]  # fmt: skip
FIRST, AT_ONCE, LATER = (2.0, 12.0, 9.0), (12.0, 3.0, 14.0), (4.0, 9.0, 11.0)  # east, north, up

# On loaded cores a pilot is seconds late, at ten times the wall clock's pace.
SECONDS = 150.0


def goal(stamp, enu):
    message = PoseStamped()
    message.header.frame_id, message.header.stamp = "map", stamp
    p, q = message.pose.position, message.pose.orientation
    p.x, p.y, p.z = enu
    q.z = q.w = 0.5**0.5
    return message


def flying(env, folder, duration_s):
    hover_test = [*HOVER_TEST, "--out", str(folder), "--duration", str(duration_s)]
    return subprocess.Popen(
        hover_test, env=env, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def ended(process):
    out, err = process.communicate(timeout=200)
    # The scenario's climb is not flown: its verdict is nobody's matter here.
    assert process.returncode in (0, 1), out + err


def command(env, process):
    """Two goals after 7 s, one upon the other; the last one at more than 1.5 m/s."""
    context = rclpy.Context()
    rclpy.init(args=[], context=context, domain_id=int(env["ROS_DOMAIN_ID"]))
    node = rclpy.create_node("pilot", context=context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    publisher = node.create_publisher(PoseStamped, topics.GOTO, 10)
    left = [FIRST, AT_ONCE, LATER]

    def look(odom):
        speed = np.hypot(odom.twist.twist.linear.x, odom.twist.twist.linear.y)
        late = (
            odom.header.stamp.sec >= 7 and publisher.get_subscription_count() > 1
        )  # the recorder hears, too
        if late and (len(left) > 1 or (left and speed > 1.5)):
            publisher.publish(goal(odom.header.stamp, left.pop(0)))

    node.create_subscription(Odometry, topics.ODOM, look, topics.qos(topics.ODOM))
    while left:
        assert process.poll() is None
        executor.spin_once(1.0)
    publisher.wait_for_all_acked()
    executor.shutdown()
    node.destroy_node()
    context.try_shutdown()


def as_one(ways):
    """Trajectories, each of which goes on from the one before, as one that was known at first."""
    times, points = ways[0].times_ns, ways[0].points
    for way in ways[1:]:
        assert way.start_ns == ways[0].start_ns
        kept = times < way.times_ns[0]
        times = np.concatenate([times[kept], way.times_ns])
        points = np.concatenate([points[kept], way.points])
    return Trajectory(0, times, points)


@pytest.mark.nightly  # a client has to keep up with the flight
def test_a_goto_in_the_middle_of_another_is_flown_as_in_one_process(ros_env, tmp_path):
    folder = tmp_path / "f"
    process = flying(ros_env, folder, SECONDS)
    command(ros_env, process)
    ended(process)
    settings = resolve(world="paper", gps="rtk", seed=5, duration_s=SECONDS)
    flown = flight_from_bag(folder / "bag", settings).record
    away = np.linalg.norm(flown.truth_pos_ned_m - flown.reference[:, REFERENCE.pos], axis=1)
    assert away.max() < 0.6
    np.testing.assert_allclose(flown.reference[-1, REFERENCE.pos], [9.0, 4.0, -11.0], atol=1e-9)
    # The reference never jumps: what the pilot sends later goes on from what is flown.
    steps = np.diff(flown.reference[:, REFERENCE.pos], axis=0)
    assert np.linalg.norm(steps, axis=1).max() < 0.01 * np.hypot(3.0, 1.5)
    second = np.diff(steps, axis=0)
    assert np.linalg.norm(second, axis=1).max() < 0.01 * 0.04 * 1.5 * np.sqrt(3.0)

    bag = read_bag(folder / "bag")
    ways = [way for _, way in bag.references]
    assert len(ways) == 4, "the scenario's and one for each goto"
    scenario = replace(settings.scenario, reference=as_one(ways))
    alone = simulate(replace(settings, scenario=scenario)).record
    np.testing.assert_allclose(flown.truth_pos_ned_m, alone.truth_pos_ned_m, atol=1e-6)
    np.testing.assert_allclose(flown.u, alone.u, atol=1e-6)
    assert "/pilot" not in str([remark.facts.get("senders.reference") for remark in bag.remarks])


@pytest.mark.nightly  # a client has to keep up with the flight
def test_the_example_sends_it_there(ros_env, tmp_path):
    folder = tmp_path / "f"
    process = flying(ros_env, folder, SECONDS)
    assert "flown" in process.stdout.readline()
    example = [sys.executable, EXAMPLE, "6", "-4", "13"]
    subprocess.run(example, env=ros_env, timeout=120, check=True)
    ended(process)
    record = flight_from_bag(folder / "bag", resolve(gps="rtk")).record
    assert np.abs(record.truth_pos_ned_m[-200:] - [-4.0, 6.0, -13.0]).max() < 0.5
