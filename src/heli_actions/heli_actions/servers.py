# SPDX-License-Identifier: Apache-2.0
"""Action servers whose goals are ended from outside, in one thread.

rclpy would have a goal's callback wait for its end: in a thread of its own, or by polling at full
speed. Here a goal is kept, and its callback runs when there is something to return.
"""

from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.node import Node

from heli_actions.table import Kind, Outcome


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

    def finish(self, goal_handle: Any, outcome: Outcome, result: Any) -> None:
        """End a goal."""
        self.notify_execute(goal_handle, partial(_end, outcome, result))


def _nothing(goal_handle: Any) -> None:
    """rclpy wants a callback; goals are never run by it."""


def _end(outcome: Outcome, result: Any, goal_handle: Any) -> Any:
    if goal_handle.is_active:
        {
            Outcome.SUCCEEDED: goal_handle.succeed,
            Outcome.CANCELED: goal_handle.canceled,
            Outcome.ABORTED: goal_handle.abort,
        }[outcome]()
    return result
