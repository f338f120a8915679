# SPDX-License-Identifier: Apache-2.0
"""Changes of parameters are judged beside the flight, and adopted between two ticks.

A judgement may take seconds (the synthesis of a control law); meanwhile the node steps as before.
It is made in a thread of its own, one request after the other; the answer of the parameter service
comes after it. What has its value already is no change, and a request is judged once: only where
all of it together is refused is each of its parameters judged alone, to say which one it was.
"""

import contextlib
import queue
import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.parameter import Parameter as RosParameter

from heli_msgs_bridge.services import MOST_ORDERS, Later, error_line


@dataclass
class Decision:
    """What `validate` made of changed values, or the ValueError that refuses them."""

    changes: dict[str, Any]
    judged: Any = None
    refusal: ValueError | None = None


@dataclass
class ParameterRequest:
    """A service call.

    Attributes
    ----------
    messages : sequence
        As in the request.
    later : Later
        The answer.
    response : callable
        Makes it from the results.
    together : bool
        Whether all are set or none.
    groups : deque of list of int
        Places of those that are yet to be set, together.
    results : dict
        By place.
    """

    messages: list[Any]
    later: Later
    response: Callable[[list[SetParametersResult]], Any]
    together: bool = False
    groups: deque[list[int]] = field(default_factory=deque)
    results: dict[int, SetParametersResult] = field(default_factory=dict)

    def settle(self, result: SetParametersResult) -> None:
        """The first group has this result; one that is refused is set one by one if it may be."""
        places = self.groups.popleft()
        if not (result.successful or self.together or len(places) == 1):
            self.groups.extendleft([place] for place in reversed(places))
            return
        self.results.update(dict.fromkeys(places, result))


class ParameterUpdates:
    """Orders to change parameters, in a queue; everything but `validate` runs between two ticks.

    Parameters
    ----------
    node : TableNode
        Its `validate` is called in another thread, and changes nothing.
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._orders: deque[ParameterRequest] = deque()
        self._work: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._busy = False

    def one_by_one(self, request: Any, response: Any) -> Later:
        """Callback of `set_parameters`: each has its own result."""

        def answer(results: list[SetParametersResult]) -> Any:
            response.results = results
            return response

        order = ParameterRequest(list(request.parameters), Later(), answer)
        settled = [self._is_settled(message) for message in order.messages]
        order.groups.extend([place] for place, alone in enumerate(settled) if alone)
        if joint := [place for place, alone in enumerate(settled) if not alone]:
            order.groups.append(joint)
        return self._take(order)

    def together(self, request: Any, response: Any) -> Later:
        """Callback of `set_parameters_atomically`."""

        def answer(results: list[SetParametersResult]) -> Any:
            response.result = results[0] if results else SetParametersResult(successful=True)
            return response

        order = ParameterRequest(list(request.parameters), Later(), answer, together=True)
        order.groups.append(list(range(len(order.messages))))
        return self._take(order)

    def _is_settled(self, message: Any) -> bool:
        try:
            return bool(self._node.is_settled(RosParameter.from_parameter_msg(message)))
        except Exception:  # of a type that is none: refused, with the reason, when it is set
            return True

    def _take(self, order: ParameterRequest) -> Later:
        if len(self._orders) >= MOST_ORDERS:
            raise ValueError(f"{MOST_ORDERS} changes wait for their judgement: ask again later")
        self._orders.append(order)
        self.go_on()
        return order.later

    def go_on(self) -> None:
        """Carry orders out, as far as no judgement or transition is under way."""
        while self._orders and not self._busy and not self._node.in_transition:
            order = self._orders[0]
            if not order.groups:
                self._orders.popleft()
                results = [order.results[place] for place in sorted(order.results)]
                order.later.answer(order.response(results))
                continue
            try:
                asked = [order.messages[place] for place in order.groups[0]]
                group = [self._prepared(RosParameter.from_parameter_msg(m)) for m in asked]
                settled = any(self._node.is_settled(parameter) for parameter in group)
                changes = {} if settled else self._node.changes(group)
            except Exception as error:
                reason = error_line(error)
                order.settle(SetParametersResult(successful=False, reason=reason))
                continue
            if changes:
                self._begin(group, changes)
            else:
                order.settle(self._set(group, None))

    def _prepared(self, parameter: RosParameter) -> RosParameter:
        value = self._node.prepared(parameter.name, parameter.value)
        return parameter if value is parameter.value else RosParameter(parameter.name, value=value)

    def _set(self, group: list[RosParameter], verdict: Decision | None) -> SetParametersResult:
        self._node.decision = verdict
        try:
            return self._node.set_parameters_atomically(group)
        except ParameterNotDeclaredException as error:
            return SetParametersResult(successful=False, reason=str(error))
        finally:
            self._node.decision = None

    def _begin(self, group: list[RosParameter], changes: dict[str, Any]) -> None:
        """Have a group judged, on the values and the stage of now."""
        node, self._busy = self._node, True
        values, revision = {**node.values, **changes}, node.revision

        def work() -> None:
            verdict = Decision(changes)
            try:
                verdict.judged = node.validate(values, changes.keys())
            except ValueError as error:
                verdict.refusal = error
            except Exception as error:
                verdict.refusal = ValueError(error_line(error))
            # While the process ends nobody waits for a verdict, nor takes one.
            if (executor := node.executor) is not None:
                with contextlib.suppress(Exception):
                    executor.create_task(self._judged, group, verdict, revision)

        if self._thread is None:
            self._thread = threading.Thread(target=self._judge_all, daemon=True)
            self._thread.start()
        self._work.put(work)

    def _judge_all(self) -> None:
        while True:
            self._work.get()()

    def _judged(self, group: list[RosParameter], verdict: Decision, revision: int) -> None:
        """Back between two ticks: adopt, or judge again if the node has changed meanwhile."""
        self._busy = False
        if revision == self._node.revision and not self._node.in_transition:
            self._orders[0].settle(self._set(group, verdict))
        # Else the same group is taken up again.
        self.go_on()
