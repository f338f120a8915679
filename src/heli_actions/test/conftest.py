# SPDX-License-Identifier: Apache-2.0
"""An outer loop in a few lines: it hears goals, and answers what a test tells it to."""

import queue
import threading

import pytest
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from geometry_msgs.msg import TwistStamped
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from std_srvs.srv import SetBool

from heli_core.ticks import NS_PER_S
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import decode_goal, encode_origin
from heli_msgs_bridge.diagnostics import (
    FACT_ARMED,
    FACT_FAILSAFE,
    FACT_GOALS,
    FACT_HOME,
    FACT_LANDED,
    FACT_MODE,
    FACT_OFFSET,
    GoalAnswer,
    GoalState,
    goals_text,
)
from heli_msgs_bridge.frames import datum

LIMIT_S = 120.0
PERIOD_S = 0.02


class OuterLoopDouble:
    """Says fifty times a second where the aircraft is and what it does; a thread of its own.

    Attributes
    ----------
    goals : Queue of GoalCommand
        Each once, however often it was sent.
    enu_m, mode, ready
        What it says, as a test sets it.
    """

    def __init__(self, context, name="outer_loop"):
        self.goals, self.answers, self.heard = queue.Queue(), {}, set()
        self.enu_m, self.mode, self.ready, self.now_ns = (0.0, 0.0, 0.0), "standing", True, NS_PER_S
        self.name, self.armed = name, None
        self.node = rclpy.create_node(name, context=context)
        self._odom = self.node.create_publisher(Odometry, topics.ODOM, topics.qos(topics.ODOM))
        self._told = self.node.create_publisher(
            DiagnosticArray, topics.DIAGNOSTICS, topics.qos(topics.DIAGNOSTICS)
        )
        origin = topics.KNOWN[topics.ORIGIN]
        self._origin = self.node.create_publisher(
            topics.message_class(origin.type), origin.name, topics.qos(origin.name)
        )
        self._origin.publish(encode_origin(datum(28.17, 112.93, 50.0)))
        cls = topics.message_class(topics.BY_NAME[topics.GOAL].type)
        self.node.create_subscription(cls, topics.GOAL, self.hear, topics.qos(topics.GOAL))
        self.velocities, self.takes_over, self.facts = queue.Queue(), True, {}
        self.node.create_subscription(TwistStamped, topics.COMMAND_VELOCITY, self.hear_velocity, 10)
        self.node.create_service(SetBool, "arm", self.arm)
        self.node.create_timer(PERIOD_S, self.tell)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self.node)
        self._thread = threading.Thread(target=self._executor.spin, daemon=True)
        self._thread.start()

    def hear(self, message):
        goal = decode_goal(message)
        if goal.goal_id not in self.heard:
            self.heard.add(goal.goal_id)
            self.goals.put(goal)

    def hear_velocity(self, message):
        self.velocities.put(message)
        if self.takes_over:
            self.takes_over, self.mode = False, "velocity"

    def arm(self, request, response):
        self.armed, response.success = request.data, self.mode == "standing"
        response.message = "arm: as asked" if response.success else "disarm: not in hover"
        return response

    def tell(self):
        self.now_ns += round(PERIOD_S * NS_PER_S)
        odom = Odometry()
        odom.header.frame_id, odom.child_frame_id = "map", "base_link"
        odom.header.stamp.sec, odom.header.stamp.nanosec = divmod(self.now_ns, NS_PER_S)
        at = odom.pose.pose.position
        at.x, at.y, at.z = self.enu_m
        odom.pose.pose.orientation.z = odom.pose.pose.orientation.w = 0.5**0.5
        self._odom.publish(odom)
        facts = {FACT_MODE: self.mode, FACT_OFFSET: "[0.0, 0.0, 0.0]" if self.ready else "[]"}
        facts |= {FACT_ARMED: "True", FACT_LANDED: str(self.mode == "standing")}
        facts |= {FACT_FAILSAFE: "NONE", FACT_HOME: "[1.0, 2.0, 0.0]"}
        facts |= self.facts
        facts[FACT_GOALS] = goals_text(list(self.answers.values()))
        values = [KeyValue(key=key, value=value) for key, value in facts.items()]
        status = DiagnosticStatus(name=self.name, message="as told", values=values)
        array = DiagnosticArray(status=[status])
        array.header.stamp = odom.header.stamp
        self._told.publish(array)

    def answer(self, goal, state, sentence="", cause="", end=None, lasts_s=0.0):
        """Answer a goal, or say what has become of it."""
        end_ns = None if end is None else self.now_ns + round(lasts_s * NS_PER_S)
        self.answers[goal.goal_id] = GoalAnswer(
            goal.goal_id, goal.command, state, sentence, end, end_ns, cause
        )

    def next_goal(self):
        return self.goals.get(timeout=LIMIT_S)

    def fly(self, command, mode, enu_m=None):
        """Obey the next goal, a command by this name, and be there at once."""
        goal = self.next_goal()
        assert goal.command == command
        east, north, up = enu_m or self.enu_m
        self.mode, self.enu_m = mode, (east, north, up)
        state = GoalState.ACTIVE if command in ("goto", "follow") else GoalState.SUCCEEDED
        self.answer(goal, state, f"{command}: done", end=[north, east, -up])
        return goal

    def close(self):
        self._executor.shutdown()
        self._thread.join()
        self.node.destroy_node()


@pytest.fixture
def outer_loop(ros_context):
    """An outer loop of which a test says what it answers."""
    double = OuterLoopDouble(ros_context)
    yield double
    double.close()
