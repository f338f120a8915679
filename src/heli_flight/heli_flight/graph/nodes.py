# SPDX-License-Identifier: Apache-2.0
"""Faults set and cleared in a running graph, through the services of its plant."""

import time
from collections.abc import Sequence
from typing import Any

import rclpy
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from heli_dynamics_sim.fault_table import NONE

_FAULTS = "faults"
_LOOK_S = 0.1


class FaultSetter:
    """Speaks to the plant of one aircraft.

    Parameters
    ----------
    node : Node
    aircraft : str
        Namespace of the aircraft; empty for none.
    limit_s : float
        So long an answer is waited for.
    """

    def __init__(self, node: Node, aircraft: str, limit_s: float) -> None:
        self._node, self._limit_s = node, limit_s
        self._at = f"/{aircraft.strip('/')}" if aircraft.strip("/") else ""

    def present(self) -> list[str]:
        """The plant's parameter `faults`, a text each; ValueError if nobody answers."""
        request = GetParameters.Request(names=[_FAULTS])
        answer = self._ask(GetParameters, "plant/get_parameters", request)
        return [text for value in answer.values for text in value.string_array_value]

    def add(self, text: str) -> None:
        """Have one more fault; ValueError with the plant's sentence if it refuses."""
        values = [*(one for one in self.present() if one != NONE), text]
        request = SetParametersAtomically.Request(
            parameters=[Parameter(_FAULTS, value=values).to_parameter_msg()]
        )
        answer = self._ask(SetParametersAtomically, "plant/set_parameters_atomically", request)
        if not answer.result.successful:
            raise ValueError(answer.result.reason)

    def clear(self) -> str:
        """End all faults; what they were."""
        answer = self._ask(Trigger, "clear_faults", Trigger.Request())
        if not answer.success:
            raise ValueError(answer.message)
        return str(answer.message)

    def _ask(self, kind: Any, name: str, request: Any) -> Any:
        client = self._node.create_client(kind, f"{self._at}/{name}")
        deadline = time.monotonic() + self._limit_s
        try:
            while not client.wait_for_service(_LOOK_S):
                if time.monotonic() > deadline:
                    raise ValueError(
                        f"no {self._at}/plant in the graph after {self._limit_s:g} s: does a "
                        "flight run in this ROS_DOMAIN_ID?"
                    )
            future = client.call_async(request)
            rclpy.spin_until_future_complete(self._node, future, timeout_sec=self._limit_s)
            if not future.done():
                raise ValueError(f"{self._at}/{name} does not answer within {self._limit_s:g} s")
            return future.result()
        finally:
            self._node.destroy_client(client)


def fault_text(what: str, kind: str, values: Sequence[str], duration_s: float | None) -> str:
    """The parameter's text of a fault that begins when the plant hears of it.

    Raises
    ------
    ValueError
        A value is no number.
    """
    parts = [f"what: {what}", f"kind: {kind}"]
    if duration_s is not None:
        parts.append(f"duration_s: {duration_s!r}")
    numbers = [_number(value) for value in values]
    if numbers:
        parts.append(f"value: [{', '.join(map(repr, numbers))}]")
    return f"{{{', '.join(parts)}}}"


def _number(value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ValueError(f"value: {value!r} is not a number") from None
