# SPDX-License-Identifier: Apache-2.0
"""Between the actions' messages and the desk. The types are given, so no ROS is imported here."""

from collections.abc import Mapping
from importlib import import_module
from typing import Any

import numpy as np

from heli_actions.desk import Feedback, Order
from heli_actions.table import Code, Kind, Outcome
from heli_math.rows import REFERENCE
from heli_math.ticks import NS_PER_S
from heli_msgs_bridge import frames
from heli_msgs_bridge.frame_ids import MAP
from heli_msgs_bridge.goto_message import decode_goto
from heli_msgs_bridge.messages import MessageError
from heli_msgs_bridge.reference_message import decode_reference

PACKAGE = "heli_interfaces"
NOT_BUILT = (
    f"{PACKAGE} is not built: its types need ROS 2 from apt (colcon build, see the README of "
    "heli_actions); without it command by the services takeoff, land and hold and the topic goto"
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
        Per kind its action: `Goal`, `Feedback` and `Result` as heli_interfaces has them.
    """

    def __init__(self, types: Mapping[Kind, Any]) -> None:
        self.types = types

    def order(self, kind: Kind, goal: Any, now_ns: int) -> Order:
        """What a goal asks for; a stamp of zero stands for now.

        Raises
        ------
        MessageError
            A frame, a number or an orientation that is not allowed.
        """
        if kind == Kind.GOTO:
            _stamp(goal.pose.header, now_ns)
            return Order(kind, decode_goto(goal.pose).pos_ned_m, message=goal.pose)
        if kind == Kind.FOLLOW:
            if goal.trajectory.header.frame_id != MAP:
                frame = goal.trajectory.header.frame_id
                raise MessageError(f"{kind}: frame '{frame}'; allowed: '{MAP}' (east, north, up)")
            _stamp(goal.trajectory.header, now_ns)
            way = decode_reference(goal.trajectory)
            end_ned_m, end_ns = way.points[-1, REFERENCE.pos], way.start_ns + int(way.times_ns[-1])
            return Order(kind, end_ned_m, end_ns, goal.trajectory)
        return Order(kind)

    def feedback(self, kind: Kind, told: Feedback) -> Any:
        """Feedback message of a goal."""
        message = self.types[kind].Feedback()
        message.mode = told.mode
        header, pose = message.pose.header, message.pose.pose
        header.frame_id = MAP
        header.stamp.sec, header.stamp.nanosec = divmod(told.stamp_ns, NS_PER_S)
        enu, q = np.empty(3), np.empty(4)
        frames.ned_to_enu(told.pos_ned_m, enu)
        frames.quat_ned_frd_to_enu_flu(told.quat, q)
        pose.position.x, pose.position.y, pose.position.z = enu.tolist()
        r = pose.orientation
        r.x, r.y, r.z, r.w = q.tolist()
        if kind in (Kind.TAKEOFF, Kind.LAND):
            message.height_left_m = told.left_m
        else:
            message.distance_left_m = told.left_m
        if kind != Kind.LAND:
            message.time_left_s = told.left_s
        return message

    def result(self, kind: Kind, outcome: Outcome, code: Code, sentence: str) -> Any:
        """Result message of a goal."""
        message = self.types[kind].Result()
        message.success = outcome == Outcome.SUCCEEDED
        message.code, message.message = int(code), sentence
        return message


def _stamp(header: Any, now_ns: int) -> None:
    if not header.stamp.sec and not header.stamp.nanosec:
        header.stamp.sec, header.stamp.nanosec = divmod(now_ns, NS_PER_S)
