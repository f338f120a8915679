# SPDX-License-Identifier: Apache-2.0
"""Changes of parameters are judged beside the flight, and adopted between two ticks.

A judgement may take seconds (the synthesis of a control law); meanwhile the node steps as before.
It is made in a thread of its own, one after the other in the order in which they were asked for;
the answer of the parameter service comes after it.
"""

import contextlib
import queue
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.parameter import Parameter

from heli_msgs_bridge.floods import MOST_ORDERS
from heli_msgs_bridge.services import Later, in_words

if TYPE_CHECKING:
    from heli_msgs_bridge.table_node import TableNode


@dataclass
class Verdict:
    """What `judge` made of changed values, or the ValueError that refuses them."""

    changes: dict[str, Any]
    judged: Any = None
    refusal: ValueError | None = None


@dataclass
class Order:
    """A service call: groups of parameters that are set together, one group after the other.

    Attributes
    ----------
    groups : sequence of list
        As in the request.
    later : Later
        The answer.
    response : callable
        Makes it from the results.
    results : list
        Of the groups that are done.
    """

    groups: Sequence[list[Any]]
    later: Later
    response: Callable[[list[SetParametersResult]], Any]
    results: list[SetParametersResult] = field(default_factory=list)


class Judging:
    """Orders to change parameters, in a queue; everything but `judge` runs between two ticks.

    Parameters
    ----------
    node : TableNode
        Its `judge` is called in another thread, and changes nothing.
    """

    def __init__(self, node: "TableNode") -> None:
        self._node = node
        self._orders: deque[Order] = deque()
        self._work: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self._thread: threading.Thread | None = None
        self._busy = False

    def one_by_one(self, request: Any, response: Any) -> Later:
        """Callback of `set_parameters`."""

        def answer(results: list[SetParametersResult]) -> Any:
            response.results = results
            return response

        return self._take([[message] for message in request.parameters], answer)

    def together(self, request: Any, response: Any) -> Later:
        """Callback of `set_parameters_atomically`."""

        def answer(results: list[SetParametersResult]) -> Any:
            (response.result,) = results
            return response

        return self._take([list(request.parameters)], answer)

    def _take(self, groups: Sequence[list[Any]], response: Callable[..., Any]) -> Later:
        if len(self._orders) >= MOST_ORDERS:
            raise ValueError(f"{MOST_ORDERS} changes wait for their judgement: ask again later")
        order = Order(groups, Later(), response)
        self._orders.append(order)
        self._go_on()
        return order.later

    def _go_on(self) -> None:
        """Carry orders out, as far as no judgement is under way."""
        while self._orders and not self._busy:
            order = self._orders[0]
            if len(order.results) == len(order.groups):
                self._orders.popleft()
                order.later.answer(order.response(order.results))
                continue
            try:
                asked = order.groups[len(order.results)]
                group = [self._prepared(Parameter.from_parameter_msg(m)) for m in asked]
                changes = self._node.judgeable(group)
            except Exception as error:
                reason = in_words(error)
                order.results.append(SetParametersResult(successful=False, reason=reason))
                continue
            if changes:
                self._begin(group, changes)
            else:
                order.results.append(self._set(group, None))

    def _prepared(self, parameter: Parameter) -> Parameter:
        value = self._node.prepared(parameter.name, parameter.value)
        return parameter if value is parameter.value else Parameter(parameter.name, value=value)

    def _set(self, group: list[Parameter], verdict: Verdict | None) -> SetParametersResult:
        self._node.verdict = verdict
        try:
            return self._node.set_parameters_atomically(group)
        except ParameterNotDeclaredException as error:
            return SetParametersResult(successful=False, reason=str(error))
        finally:
            self._node.verdict = None

    def _begin(self, group: list[Parameter], changes: dict[str, Any]) -> None:
        """Have a group judged, on the values and the stage of now."""
        node, self._busy = self._node, True
        values, seen = {**node.values, **changes}, node.revision

        def work() -> None:
            verdict = Verdict(changes)
            try:
                verdict.judged = node.judge(values, changes.keys())
            except ValueError as error:
                verdict.refusal = error
            except Exception as error:
                verdict.refusal = ValueError(in_words(error))
            # While the process ends nobody waits for a verdict, nor takes one.
            if (executor := node.executor) is not None:
                with contextlib.suppress(Exception):
                    executor.create_task(self._judged, group, verdict, seen)

        if self._thread is None:
            self._thread = threading.Thread(target=self._judge_all, daemon=True)
            self._thread.start()
        self._work.put(work)

    def _judge_all(self) -> None:
        while True:
            self._work.get()()

    def _judged(self, group: list[Parameter], verdict: Verdict, seen: int) -> None:
        """Back between two ticks: adopt, or judge again if the node has changed meanwhile."""
        if seen != self._node.revision:
            self._begin(group, verdict.changes)
            return
        self._busy = False
        self._orders[0].results.append(self._set(group, verdict))
        self._go_on()
