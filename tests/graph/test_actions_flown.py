# SPDX-License-Identifier: Apache-2.0
"""Take-off, goto, cancel and landing as actions, through the graph.

heli_interfaces needs a compiler, which the wheels come without. So whole numbers stand in for its
messages: a Fibonacci goal says where it is to in the digits of `order` (east, north and up, two
digits each, m), feedback and result are sequences. All else is the node as it is.
"""

import signal
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
import rclpy
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped
from nav_msgs.msg import Odometry
from rclpy.action import ActionClient
from rclpy.executors import SingleThreadedExecutor
from test_msgs.action import Fibonacci

from heli_actions.goals import Code, Kind
from heli_actions.interfaces import Interfaces
from heli_actions.node import ActionsNode
from heli_msgs_bridge import topics
from heli_msgs_bridge.node_process import run

FLIGHT = [
    sys.executable, "-m", "heli_flight.cli.app", "hover", "--scenario", "by_hand", "--world",
    "paper", "--gps", "rtk", "--seed", "5", "--no-report", "--duration", "3000",
]  # fmt: skip
# A loaded machine must not meet them.
TIMES = ("answer_s", "silence_s", "wall_silence_s", "patience_s")
PATIENT = [word for name in TIMES for word in ("-p", f"{name}:=600.0")]
ACTIONS = [sys.executable, __file__, "--ros-args", *PATIENT, "-p", "feedback_period_s:=0.02"]
LIMIT_S = 280.0
# Low and short, and a goal may be as old as a loaded machine makes it.
LOW = """
/**/outer_loop:
  ros__parameters:
    takeoff.height_m: 4.0
    land.slow_below_m: 1.5
    goto.max_age_s: 60.0
"""
MODES = ["standing", "takeoff", "hover", "trajectory", "land"]


class StandIns(Interfaces):
    """Numbers for the messages; what stands in them is worked out as for the real ones."""

    def __init__(self):
        words = SimpleNamespace(
            Feedback=lambda: SimpleNamespace(pose=PoseStamped()), Result=SimpleNamespace
        )
        self._real = Interfaces(dict.fromkeys(Kind, words))
        super().__init__(dict.fromkeys(Kind, Fibonacci))

    def order(self, kind, goal, now_ns):
        pose = PoseStamped()
        pose.header.frame_id = "map"
        at = pose.pose.position
        at.x, at.y, at.z = (float(goal.order // n % 100) for n in (10000, 100, 1))
        pose.pose.orientation.z = pose.pose.orientation.w = 0.5**0.5
        return self._real.order(kind, SimpleNamespace(pose=pose, height_m=0.0), now_ns)

    def feedback(self, kind, fields):
        words = self._real.feedback(kind, fields)
        at = words.pose.pose.position
        left = vars(words).get("height_left_m", vars(words).get("distance_left_m"))
        metres = [round(number * 100.0) for number in (at.x, at.y, at.z, left)]
        return Fibonacci.Feedback(sequence=[MODES.index(words.mode), *metres])

    def result(self, kind, outcome, code, sentence, cause):
        words = self._real.result(kind, outcome, code, sentence, cause)
        numbers = [int(words.success), words.code, *words.message.encode()]
        return Fibonacci.Result(sequence=numbers)


class StandInActions(ActionsNode):
    """Active means: goals are taken."""

    def interfaces(self):
        return StandIns()


class Pilot:
    """A client of all four actions."""

    def __init__(self, domain):
        self.context = rclpy.Context()
        rclpy.init(args=[], context=self.context, domain_id=domain)
        self.node = rclpy.create_node("pilot", context=self.context)
        self.executor = SingleThreadedExecutor(context=self.context)
        self.executor.add_node(self.node)
        self.clients = {k: ActionClient(self.node, Fibonacci, f"actions/{k}") for k in Kind}
        self.feedback, self.flown_s, self.at_enu_m = [], 0.0, np.zeros(3)
        self.node.create_subscription(
            Odometry, topics.ODOM, self.hear, topics.qos(topics.ODOM, depth=1)
        )

    def hear(self, odom):
        self.flown_s, p = odom.header.stamp.sec - 1.0, odom.pose.pose.position
        self.at_enu_m = np.array([p.x, p.y, p.z])

    def spin_until(self, condition, flight):
        while not condition():
            assert flight.poll() is None
            self.executor.spin_once(timeout_sec=1.0)

    def wait(self, future):
        self.executor.spin_until_future_complete(future, LIMIT_S)
        return future.result()

    def send(self, kind, east_m=0, north_m=0, up_m=0):
        self.feedback.clear()
        goal = Fibonacci.Goal(order=east_m * 10000 + north_m * 100 + up_m)
        sent = self.clients[kind].send_goal_async(goal, feedback_callback=self.take_feedback)
        handle = self.wait(sent)
        assert handle.accepted
        return handle

    def take_feedback(self, message):
        mode, *centimetres = message.feedback.sequence
        self.feedback.append((MODES[mode], *(number / 100.0 for number in centimetres)))

    def result(self, handle):
        """Status, code and sentence."""
        ended = self.wait(handle.get_result_async())
        success, code, *text = ended.result.sequence
        assert bool(success) == (ended.status == GoalStatus.STATUS_SUCCEEDED)
        return ended.status, Code(code), bytes(text).decode()

    def close(self):
        self.executor.shutdown()
        self.node.destroy_node()
        self.context.try_shutdown()


@pytest.fixture
def pilot(ros_env):
    """A pilot beside the node that serves, which is there before any flight is."""
    served = subprocess.Popen(ACTIONS, env=ros_env, stderr=subprocess.PIPE, text=True)
    one = Pilot(int(ros_env["ROS_DOMAIN_ID"]))
    for client in one.clients.values():
        assert client.wait_for_server(LIMIT_S)
    yield one
    one.close()
    served.terminate()
    served.communicate(timeout=LIMIT_S)
    assert served.returncode == 0


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_from_the_ground_to_the_ground_by_actions(ros_env, tmp_path, pilot):
    params = tmp_path / "low.yaml"
    params.write_text(LOW)
    command = [*FLIGHT, "--out", str(tmp_path / "f"), "--params", str(params)]
    flight = subprocess.Popen(command, env=ros_env, stdout=subprocess.DEVNULL)
    try:
        pilot.spin_until(lambda: pilot.flown_s > 3.0, flight)
        ABORTED, CANCELED = GoalStatus.STATUS_ABORTED, GoalStatus.STATUS_CANCELED
        SUCCEEDED = GoalStatus.STATUS_SUCCEEDED

        status, code, sentence = pilot.result(pilot.send(Kind.GOTO, 6, 4, 6))
        assert (status, code) == (ABORTED, Code.REFUSED), sentence
        assert "takeoff" in sentence

        status, code, sentence = pilot.result(pilot.send(Kind.TAKEOFF))
        assert (status, code) == (SUCCEEDED, Code.DONE), sentence
        left_m = [left for mode, *_, left in pilot.feedback if mode == "takeoff" and left >= 0.0]
        assert left_m and left_m[0] > left_m[-1] - 0.1 and max(left_m) < 4.5
        pilot.spin_until(lambda: abs(pilot.at_enu_m[2] - 4.0) < 1.0, flight)

        far = pilot.send(Kind.GOTO, 90, 40, 6)
        pilot.spin_until(lambda: pilot.feedback and pilot.feedback[-1][-1] < 96.0, flight)
        assert pilot.feedback[-1][0] in ("trajectory", "hover")
        assert pilot.wait(far.cancel_goal_async()).goals_canceling
        status, code, sentence = pilot.result(far)
        assert (status, code) == (CANCELED, Code.CANCELED)
        assert sentence.startswith("hold: to ")

        first = pilot.send(Kind.GOTO, 90, 40, 6)
        second = pilot.send(Kind.GOTO, 8, 6, 6)
        status, code, sentence = pilot.result(first)
        assert (status, code) == (ABORTED, Code.PREEMPTED) and sentence.startswith("goto: goto ")
        status, code, sentence = pilot.result(second)
        assert (status, code) == (SUCCEEDED, Code.DONE) and sentence.startswith("goto: there, ")
        pilot.spin_until(lambda: np.linalg.norm(pilot.at_enu_m - [8.0, 6.0, 6.0]) < 1.0, flight)

        status, code, sentence = pilot.result(pilot.send(Kind.LAND))
        assert (status, code) == (SUCCEEDED, Code.DONE), sentence
        assert "land" in [words[0] for words in pilot.feedback]
        pilot.spin_until(lambda: abs(pilot.at_enu_m[2]) < 0.5, flight)
    finally:
        flight.send_signal(signal.SIGINT)
        flight.communicate(timeout=LIMIT_S)


if __name__ == "__main__":
    sys.exit(run(StandInActions))
