# SPDX-License-Identifier: Apache-2.0
"""Node `actions`: a goal's way into the graph and back.

It sends each goal with an id on the topic `goal`; the outer loop answers by that id in
/diagnostics. No flight waits for it.
"""

import sys
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

import numpy as np
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy

from heli_actions.goals import (
    Code,
    FlightStatus,
    GoalLimits,
    GoalManager,
    GoalStatus,
    Kind,
)
from heli_actions.interfaces import PREFIX, Interfaces
from heli_actions.parameters import NODE_NAME, TABLE
from heli_core.rows import NAV
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import encode_goal
from heli_msgs_bridge.diagnostics import Level, outer_loop_of
from heli_msgs_bridge.layouts import MessageError
from heli_msgs_bridge.lifecycle_node import ManagedNode, NodeSpec, NodeStartError
from heli_msgs_bridge.messages import Decoder
from heli_msgs_bridge.node_process import run
from heli_msgs_bridge.status import AircraftStatus

# -------------------------------------------------------------------------------------------------
# Action servers whose goals are ended from outside, in one thread.
#
# rclpy would have a goal's callback wait for its end: in a thread of its own, or by polling at
# full
# speed. Here a goal is kept, and its callback runs when there is something to return.
# -------------------------------------------------------------------------------------------------


class DeferredServer(ActionServer):
    """Server of one action.

    Parameters
    ----------
    node : Node
    kind : Kind
    action_type : type
    name : str
    admits : callable
        Whether goals are taken now.
    taken, cancelled : callable
        Called with the kind (not of a cancelled one) and the handle of a goal that is executing,
        or is to be cancelled.
    """

    def __init__(
        self,
        node: Node,
        kind: Kind,
        action_type: Any,
        name: str,
        admits: Callable[[], bool],
        taken: Callable[[Kind, Any], None],
        cancelled: Callable[[Any], None],
    ) -> None:
        self._kind, self._taken = kind, taken

        def admit(goal: Any) -> GoalResponse:
            return GoalResponse.ACCEPT if admits() else GoalResponse.REJECT

        def cancel(handle: Any) -> CancelResponse:
            cancelled(handle)
            return CancelResponse.ACCEPT

        super().__init__(
            node, action_type, name, _nothing, goal_callback=admit, cancel_callback=cancel
        )

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """rclpy's hook: a goal is executing. It is told, not run."""
        if execute_callback is None:
            self._taken(self._kind, goal_handle)
        else:
            super().notify_execute(goal_handle, execute_callback)

    def finish(self, goal_handle: Any, outcome: GoalStatus, result: Any) -> None:
        """End a goal."""
        self.notify_execute(goal_handle, partial(_end, outcome, result))


def _nothing(goal_handle: Any) -> None:
    """rclpy wants a callback; goals are never run by it."""


def _end(outcome: GoalStatus, result: Any, goal_handle: Any) -> Any:
    if goal_handle.is_active:
        {
            GoalStatus.SUCCEEDED: goal_handle.succeed,
            GoalStatus.CANCELED: goal_handle.canceled,
            GoalStatus.ABORTED: goal_handle.abort,
        }[outcome]()
    return result


# -------------------------------------------------------------------------------------------------
# Node.
# -------------------------------------------------------------------------------------------------

_LOOK_S, _SLOW_PERIOD_S = 0.05, 1.0
_LATCHED = QoSProfile(
    history=HistoryPolicy.KEEP_LAST, depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL
)


@dataclass
class Serving:
    """What the node has while it is configured.

    Attributes
    ----------
    desk : GoalManager
    flight : FlightStatus
    interfaces : Interfaces
    publish : callable
        Sends a message on the topic `goal`.
    servers : dict
        Per kind of goals its server.
    handles : dict
        Goals that have not ended, with their kind.
    odom : Decoder
    newest : bytes
        The newest navigation that was not looked at; empty for none.
    feedback_wall_s : float
        When feedback was sent last, wall time.
    send_status : callable or None
        Sends the aircraft's state, where its type is installed.
    """

    manager: GoalManager
    flight: FlightStatus
    interfaces: Interfaces
    publish: Callable[[Any], None]
    servers: dict[Kind, DeferredServer] = field(default_factory=dict)
    handles: dict[str, tuple[Kind, Any]] = field(default_factory=dict)
    odom: Decoder = field(default_factory=lambda: Decoder(topics.ODOM))
    newest: bytes = b""
    feedback_wall_s: float = 0.0
    send_status: Callable[[Any], None] | None = None


class ActionsNode(ManagedNode[Serving, None]):
    """Active means: goals are taken. What is flown goes on when it is deactivated."""

    SPEC = NodeSpec(NODE_NAME, "heli_actions", TABLE, f"{NODE_NAME}.yaml")

    def __init__(self, values: Mapping[str, Any], **options: Any) -> None:
        # Before there is anything in the graph: without types there is no such node.
        self._interfaces = self.interfaces()
        super().__init__(values, **options)

    def interfaces(self) -> Interfaces:
        """The types that are served; `NodeStartError` if they are not there."""
        try:
            return Interfaces.installed()
        except LookupError as error:
            raise NodeStartError(str(error)) from error

    def configure(self) -> Serving:
        """Begin to listen; serve the actions."""
        interfaces, flight, wall_s = self._interfaces, FlightStatus(), time.monotonic()
        flight.odom_wall_s = flight.outer_loop_wall_s = wall_s
        cls = topics.message_class(topics.BY_NAME[topics.GOAL].type)
        publisher = self.create_publisher(cls, topics.GOAL, topics.qos(topics.GOAL))
        self.at_end(partial(self.destroy_publisher, publisher))
        manager = GoalManager(self, flight, self._limits(self.values))
        core = Serving(manager, flight, interfaces, publisher.publish)
        best_effort = QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.BEST_EFFORT
        )
        self.subscribe(topics.ODOM, self._on_odom, best_effort, raw=True)
        self.subscribe(topics.DIAGNOSTICS, self._on_diagnostics)
        for kind, action_type in interfaces.types.items():
            core.servers[kind] = DeferredServer(
                self, kind, action_type, f"{PREFIX}/{kind}", lambda: self.active,
                self.guarded(self._on_goal), self.guarded(self._on_cancel),
            )  # fmt: skip
            self.at_end(core.servers[kind].destroy)
        if interfaces.status_type is not None:
            teller = self.create_publisher(interfaces.status_type, topics.STATUS, _LATCHED)
            self.at_end(partial(self.destroy_publisher, teller))
            core.send_status = teller.publish
        self.create_wall_timer(_LOOK_S, self._look)
        self.create_wall_timer(_SLOW_PERIOD_S, self._say_how_it_is)
        return core

    def disengage(self) -> None:
        """Let go of the goals; the flight goes on."""
        self.core.manager.close()

    def _limits(self, values: Mapping[str, Any]) -> GoalLimits:
        return GoalLimits(**{row.name: values[row.name] for row in fields(GoalLimits)})

    # --- what the goal manager has done ----------------------------------------------------------

    def send(self, command: str, goal_id: str, argument: Any) -> None:
        """Send a command with an id to the outer loop."""
        self.core.publish(encode_goal(command, goal_id, argument))

    def finish(self, key: str, outcome: GoalStatus, code: Code, sentence: str) -> None:
        """End a goal, aloud."""
        answer = self.core.flight.answers.get(key)
        cause = answer.cause if code == Code.REFUSED and answer is not None else ""
        self._finish(key, outcome, code, sentence, cause)

    def _finish(self, key: str, outcome: GoalStatus, code: Code, sentence: str, cause: str) -> None:
        core = self.core
        kind, handle = core.handles.pop(key)
        result = core.interfaces.result(kind, outcome, code, sentence, cause)
        core.servers[kind].finish(handle, outcome, result)
        line = f"{kind} {outcome} ({code.name}): {sentence}"
        # rclpy ties a severity to the calling line: two lines are needed.
        if outcome == GoalStatus.ABORTED:
            self.get_logger().warning(line)
        else:
            self.get_logger().info(line)

    # --- from clients ----------------------------------------------------------------------------

    def _on_goal(self, kind: Kind, handle: Any) -> None:
        core, key = self.core, _id_of(handle)
        core.handles[key] = kind, handle
        self._take_newest()
        try:
            order = core.interfaces.order(kind, handle.request, core.flight.now_ns)
        except MessageError as error:
            cause = "" if error.cause is None else error.cause.name
            self._finish(key, GoalStatus.ABORTED, Code.REFUSED, str(error), cause)
            return
        core.manager.accept(key, order)

    def _on_cancel(self, handle: Any) -> None:
        self.core.manager.cancel(_id_of(handle))

    # --- from the flight -------------------------------------------------------------------------

    def _on_odom(self, raw: bytes) -> None:
        self.core.newest = raw

    def _on_diagnostics(self, message: Any) -> None:
        for told in outer_loop_of(message, self.get_namespace()):
            core = self.core
            core.flight.diagnostics(told.stamp_ns, told.sentence, told.facts, time.monotonic())
            if core.send_status is not None:
                core.send_status(core.interfaces.status(AircraftStatus.of_facts(*told)))

    def _take_newest(self) -> None:
        core, raw = self.core, self.core.newest
        core.newest = b""
        if not raw:
            return
        try:
            nav = core.odom.decode(raw)
        except MessageError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=5.0)
            return
        if np.isfinite(nav[NAV.pos]).all() and np.isfinite(nav[NAV.quat]).all():
            now = core.odom.stamp_ns, nav[NAV.pos], nav[NAV.quat], time.monotonic()
            core.manager.odom(*now)

    # --- twenty times a second -------------------------------------------------------------------

    def _look(self) -> None:
        core, wall_s = self.core, time.monotonic()
        self._take_newest()
        core.manager.update(wall_s)
        if wall_s - core.feedback_wall_s >= self.values["feedback_period_s"]:
            core.feedback_wall_s = wall_s
            self._send_feedback()

    def _send_feedback(self) -> None:
        latest = self.core.manager.feedback()
        if latest is not None:
            key, kind, feedback = latest
            handle = self.core.handles[key][1]
            handle.publish_feedback(self.core.interfaces.feedback(kind, feedback))

    def _say_how_it_is(self) -> None:
        """Once a second."""
        core = self.core
        self.tick = max(0, core.flight.now_ns - self.start_ns) // self.rate.tick_ns
        goals = {goal.order.kind.value: goal.stage.value for goal in core.manager.goals}
        if self.active:
            self.report(Level.OK, "takes goals", goals)

    def validate(self, values: Mapping[str, Any], changed: Collection[str]) -> GoalLimits:
        """Other limits."""
        return self._limits(values)

    def apply(self, judged: GoalLimits, changed: Collection[str]) -> None:
        """They hold for the goals that are under way, too."""
        if self.configured:
            self.core.manager.limits = judged


def _id_of(handle: Any) -> str:
    """The id of a goal in hexadecimal digits."""
    return bytes(handle.goal_id.uuid).hex()


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_actions actions`."""
    return run(ActionsNode, args)


if __name__ == "__main__":
    sys.exit(main())
