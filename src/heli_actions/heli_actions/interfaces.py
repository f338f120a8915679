# SPDX-License-Identifier: Apache-2.0
"""Between the actions' messages and the goals, for who serves them and for who asks; clients.

The types are given: nothing of heli_interfaces is imported before somebody wants it.
"""

import time
from collections.abc import Callable, Mapping
from importlib import import_module
from typing import Any, Self

import numpy as np
from action_msgs.msg import GoalStatus as RosStatus
from rclpy.action import ActionClient
from rclpy.node import Node

from heli_actions.goals import NOT_KNOWN, Code, GoalFeedback, GoalRequest, GoalStatus, Kind
from heli_core.rows import REFERENCE
from heli_core.ticks import NS_PER_S
from heli_msgs_bridge import frames, topics
from heli_msgs_bridge.command_messages import decode_goto, decode_reference
from heli_msgs_bridge.layouts import MessageError
from heli_msgs_bridge.status import AircraftStatus, encode_status
from heli_msgs_bridge.topics import MAP

# -------------------------------------------------------------------------------------------------
# Messages.
# -------------------------------------------------------------------------------------------------

PREFIX = "actions"
"""Of the actions' names: a service `takeoff` and a topic `goto` are there already."""
PACKAGE = "heli_interfaces"
NOT_BUILT = (
    f"{PACKAGE} is not built: on the wheels ./heli setup --interfaces builds it, where ROS 2 is "
    "sourced set-up does; without it command by the services takeoff, land and hold and by goto"
)


def interface_types() -> dict[Kind, Any]:
    """The actions of heli_interfaces.

    Raises
    ------
    LookupError
        They are not built; with a sentence.
    """
    try:
        module = import_module(f"{PACKAGE}.action")
        return {kind: getattr(module, kind.capitalize()) for kind in Kind}
    except (ImportError, AttributeError) as error:
        raise LookupError(NOT_BUILT) from error


class Interfaces:
    """Orders out of goals, feedback and results into messages.

    Parameters
    ----------
    types : mapping
        Per kind its action: `ActiveGoal`, `GoalFeedback` and `Result` as heli_interfaces has them.
    status_type : type, optional
        Message `Status` of heli_interfaces.
    """

    @classmethod
    def installed(cls) -> Self:
        """Those of heli_interfaces; LookupError, with a sentence, if they are not built."""
        types = interface_types()
        return cls(types, topics.message_class(topics.STATUS_TYPE))

    def __init__(self, types: Mapping[Kind, Any], status_type: Any = None) -> None:
        self.types, self.status_type = types, status_type

    def order(self, kind: Kind, goal: Any, now_ns: int) -> GoalRequest:
        """What a goal asks for; a stamp of zero stands for now.

        Raises
        ------
        MessageError
            A frame, a number or an orientation that is not allowed.
        """
        if kind == Kind.GOTO:
            _stamp(goal.pose.header, now_ns)
            return GoalRequest(kind, decode_goto(goal.pose).pos_ned_m, message=goal.pose)
        if kind == Kind.FOLLOW:
            if goal.trajectory.header.frame_id != MAP:
                frame = goal.trajectory.header.frame_id
                raise MessageError(f"{kind}: frame '{frame}'; allowed: '{MAP}' (east, north, up)")
            _stamp(goal.trajectory.header, now_ns)
            way = decode_reference(goal.trajectory)
            return GoalRequest(kind, way.points[-1, REFERENCE.pos], goal.trajectory)
        if kind == Kind.TAKEOFF and goal.height_m != 0.0:
            return GoalRequest(kind, message=goal.height_m)
        return GoalRequest(kind)

    def status(self, status: AircraftStatus) -> Any:
        """Status message of an aircraft."""
        return encode_status(self.status_type(), status)

    def goal(self, request: GoalRequest) -> Any:
        """Goal message of what a pilot asks for."""
        message = self.types[request.kind].Goal()
        if request.message is None:
            return message
        if request.kind == Kind.TAKEOFF:
            message.height_m = float(request.message)
        elif request.kind == Kind.GOTO:
            message.pose = request.message
        else:
            message.trajectory = request.message
        return message

    def read_feedback(self, kind: Kind, message: Any) -> GoalFeedback:
        """What a feedback message says."""
        header, pose = message.pose.header, message.pose.pose
        p, r = pose.position, pose.orientation
        ned, q = np.empty(3), np.empty(4)
        frames.enu_to_ned(np.array([p.x, p.y, p.z]), ned)
        frames.quat_enu_flu_to_ned_frd(np.array([r.x, r.y, r.z, r.w]), q)
        high = kind in (Kind.TAKEOFF, Kind.LAND)
        return GoalFeedback(
            header.stamp.sec * NS_PER_S + header.stamp.nanosec,
            message.mode,
            ned,
            q,
            message.height_left_m if high else message.distance_left_m,
            NOT_KNOWN if kind == Kind.LAND else message.time_left_s,
        )

    def read_result(self, kind: Kind, message: Any) -> tuple[Code, str, str]:
        """Code, sentence and cause of a result message."""
        return Code(message.code), message.message, message.cause

    def feedback(self, kind: Kind, feedback: GoalFeedback) -> Any:
        """Feedback message of a goal."""
        message = self.types[kind].Feedback()
        message.mode = feedback.mode
        header, pose = message.pose.header, message.pose.pose
        header.frame_id = MAP
        header.stamp.sec, header.stamp.nanosec = divmod(feedback.stamp_ns, NS_PER_S)
        enu, q = np.empty(3), np.empty(4)
        frames.ned_to_enu(feedback.pos_ned_m, enu)
        frames.quat_ned_frd_to_enu_flu(feedback.quat, q)
        pose.position.x, pose.position.y, pose.position.z = enu.tolist()
        r = pose.orientation
        r.x, r.y, r.z, r.w = q.tolist()
        if kind in (Kind.TAKEOFF, Kind.LAND):
            message.height_left_m = feedback.left_m
        else:
            message.distance_left_m = feedback.left_m
        if kind != Kind.LAND:
            message.time_left_s = feedback.left_s
        return message

    def result(self, kind: Kind, outcome: GoalStatus, code: Code, sentence: str, cause: str) -> Any:
        """Result message of a goal."""
        message = self.types[kind].Result()
        message.success = outcome == GoalStatus.SUCCEEDED
        message.code, message.message, message.cause = int(code), sentence, cause
        return message


def _stamp(header: Any, now_ns: int) -> None:
    if not header.stamp.sec and not header.stamp.nanosec:
        header.stamp.sec, header.stamp.nanosec = divmod(now_ns, NS_PER_S)


# -------------------------------------------------------------------------------------------------
# Clients.
# -------------------------------------------------------------------------------------------------

_OUTCOMES = {
    RosStatus.STATUS_SUCCEEDED: GoalStatus.SUCCEEDED,
    RosStatus.STATUS_CANCELED: GoalStatus.CANCELED,
    RosStatus.STATUS_ABORTED: GoalStatus.ABORTED,
}
Finish = Callable[[GoalStatus, Code, str, str], None]
"""Takes how a goal ended: outcome, code, sentence, cause."""


class ActionClients:
    """Clients of all four actions. All but `served` is for the node's executor.

    Parameters
    ----------
    node : Node
    interfaces : Interfaces
    """

    def __init__(self, node: Node, interfaces: Interfaces) -> None:
        self._interfaces = interfaces
        self._clients = {
            kind: ActionClient(node, action_type, f"{PREFIX}/{kind}")
            for kind, action_type in interfaces.types.items()
        }
        self._under_way: dict[str, tuple[Kind, Finish]] = {}
        self._handles: dict[str, Any] = {}
        self._cancelled: set[str] = set()

    def served(self, wait_s: float) -> bool:
        """Whether somebody serves all of them, within so much wall time."""
        deadline_s = time.monotonic() + wait_s
        return all(
            client.wait_for_server(max(deadline_s - time.monotonic(), 0.0))
            for client in self._clients.values()
        )

    def send(
        self,
        key: str,
        request: GoalRequest,
        told: Callable[[GoalFeedback], None],
        finish: Finish,
    ) -> None:
        """Send a goal; both callables are called of it, by whose key it may be cancelled."""
        kind, words = request.kind, self._interfaces
        self._under_way[key] = kind, finish
        self._clients[kind].send_goal_async(
            words.goal(request),
            lambda message: told(words.read_feedback(kind, message.feedback)),
        ).add_done_callback(lambda future: self._answered(key, future.result()))

    def cancel(self, key: str) -> None:
        """Have a goal cancelled."""
        self._cancelled.add(key)
        if key in self._handles:
            self._handles[key].cancel_goal_async()

    def watch(self) -> None:
        """End the goals that nobody serves any more."""
        for key, (kind, _) in list(self._under_way.items()):
            if not self._clients[kind].server_is_ready():
                sentence = f"{kind}: nobody serves {PREFIX}/{kind} any more; the flight goes on"
                self._end(key, GoalStatus.ABORTED, Code.SILENT, sentence, "")

    def destroy(self) -> None:
        """End the clients."""
        for client in self._clients.values():
            client.destroy()

    def _answered(self, key: str, handle: Any) -> None:
        if not handle.accepted:
            sentence = f"{self._under_way[key][0]}: the node {PREFIX} is not active"
            self._end(key, GoalStatus.ABORTED, Code.CLOSED, sentence, "")
            return
        self._handles[key] = handle
        if key in self._cancelled:
            handle.cancel_goal_async()
        handle.get_result_async().add_done_callback(
            lambda future: self._ended(key, future.result())
        )

    def _ended(self, key: str, response: Any) -> None:
        if key not in self._under_way:
            return
        code, sentence, cause = self._interfaces.read_result(
            self._under_way[key][0], response.result
        )
        self._end(key, _OUTCOMES[response.status], code, sentence, cause)

    def _end(self, key: str, outcome: GoalStatus, code: Code, sentence: str, cause: str) -> None:
        _, finish = self._under_way.pop(key)
        self._handles.pop(key, None)
        self._cancelled.discard(key)
        finish(outcome, code, sentence, cause)
