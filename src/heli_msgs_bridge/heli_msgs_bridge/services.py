# SPDX-License-Identifier: Apache-2.0
"""Services of a node that never end it: what cannot be answered is refused, in words.

An exception in a service's callback comes out of rclpy's executor and would end the process; any
client could raise one, by a transition that is not possible or a parameter of no known type.
"""

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rcl_interfaces.srv import SetParameters, SetParametersAtomically

from heli_core.parameters import Parameter

# -------------------------------------------------------------------------------------------------
# Services.
# -------------------------------------------------------------------------------------------------

Transitions = Mapping[str, int]
"""Label to id of the transitions that may be asked for in the present state."""
ALWAYS_ANSWERED = (ChangeState, GetState)
"""Answered however often they come: that takes no longer than a refusal, and who ends the flight
must be heard in a flood, too."""


class Later:
    """What a service's callback returns if its answer comes later, in the same thread."""

    def __init__(self) -> None:
        self._response: Any = None
        self._send: Callable[[Any], None] | None = None

    def answer(self, response: Any) -> None:
        """Send the answer; at once, or as soon as it is known where to."""
        self._response = response
        self._send_if_ready()

    def send_by(self, send: Callable[[Any], None]) -> None:
        """Told by `guard` how to send."""
        self._send = send
        self._send_if_ready()

    def _send_if_ready(self) -> None:
        if self._send is not None and self._response is not None:
            self._send(self._response)


def error_line(error: BaseException) -> str:
    """An exception in one line."""
    text = " ".join(str(error).split())
    return text if isinstance(error, ValueError) and text else f"{type(error).__name__}: {text}"


def _refusal(kind: Any, request: Any, reason: str) -> Any:
    """Answer of a service that says no, where its type has a place for that; else an empty one."""
    response = kind.Response()
    no = SetParametersResult(successful=False, reason=reason)
    if kind is SetParameters:
        response.results = [no for _ in request.parameters]
    elif kind is SetParametersAtomically:
        response.result = no
    elif kind is ChangeState:
        response.success = False
    return response


def not_flooded() -> str:
    """Says of a service that it may always be asked."""
    return ""


def guard(
    service: Any,
    say: Callable[[str], None],
    flooded: Callable[[], str] = not_flooded,
) -> None:
    """Have a service answer whatever it is asked.

    Parameters
    ----------
    service : rclpy Service
        Its callback and the sending of its answers are wrapped.
    say : callable
        Takes the sentence for people: why a request was refused, or an answer not sent.
    flooded : callable
        Asked before anything else: why no more may be answered now; empty if it may. It has told
        people itself.
    """
    answer, send, name = service.callback, service.send_response, service.service_name

    def call(request: Any, response: Any) -> Any:
        if why := flooded():
            return _refusal(service.srv_type, request, why)
        try:
            return answer(request, response)
        except Exception as error:
            reason = error_line(error)
            say(f"{name}: refused: {reason}")
            return _refusal(service.srv_type, request, reason)

    def respond(response: Any, header: Any) -> None:
        if isinstance(response, Later):
            response.send_by(lambda ready: respond(ready, header))
            return
        try:
            send(response, header)
        except Exception as error:
            say(f"{name}: no answer could be sent: {error_line(error)}")

    service.callback, service.send_response = call, respond


def chosen(asked: Any, possible: Transitions, state: str) -> int:
    """Id of the transition that is asked for.

    Parameters
    ----------
    asked : lifecycle_msgs/Transition
        A label decides; without one, the id.
    possible : mapping of str to int
        Transitions of the present state.
    state : str
        Its label.

    Raises
    ------
    ValueError
        It is not possible now: says so and what is.
    """
    if asked.label:
        if asked.label in possible:
            return possible[asked.label]
    elif asked.id in possible.values():
        return int(asked.id)
    name = f"'{asked.label}'" if asked.label else f"transition {asked.id}"
    others = ", ".join(f"{label} ({number})" for label, number in possible.items()) or "nothing"
    raise ValueError(f"{name} is not possible in state '{state}'; possible is {others}")


def trigger_of(node: Any, number: int) -> Callable[[], Any]:
    """What of a lifecycle node begins the transition of a number; all others shut it down."""
    return {
        Transition.TRANSITION_CONFIGURE: node.trigger_configure,
        Transition.TRANSITION_CLEANUP: node.trigger_cleanup,
        Transition.TRANSITION_ACTIVATE: node.trigger_activate,
        Transition.TRANSITION_DEACTIVATE: node.trigger_deactivate,
    }.get(number, node.trigger_shutdown)


# -------------------------------------------------------------------------------------------------
# Rows of a parameter table as ROS parameter descriptors.
# -------------------------------------------------------------------------------------------------


def descriptor(row: Parameter) -> ParameterDescriptor:
    """ROS descriptor of a table row."""
    descriptor = ParameterDescriptor(
        description=row.description + (f" [{row.unit}]" if row.unit else ""),
        additional_constraints=row.allowed(),
        read_only=row.read_only,
    )
    if row.lower is None or row.upper is None:
        return descriptor
    if row.kind == "double":
        reals = FloatingPointRange(from_value=float(row.lower), to_value=float(row.upper))
        descriptor.floating_point_range = [reals]
    elif row.kind == "int":
        wholes = IntegerRange(from_value=int(row.lower), to_value=int(row.upper), step=1)
        descriptor.integer_range = [wholes]
    return descriptor


def ros_value(value: Any) -> Any:
    """A checked value in the form that rclpy takes."""
    if isinstance(value, np.ndarray):
        return value.ravel().tolist()
    return list(value) if isinstance(value, tuple) else value


# -------------------------------------------------------------------------------------------------
# How often and how much may be asked of a node, so that a flood costs it next to nothing. No ROS.
#
# What is judged takes time that a tick then lacks: a controller that is synthesised, a long message
# that becomes objects. What is refused here has cost none of that.
# -------------------------------------------------------------------------------------------------

REQUESTS_PER_S, REQUESTS_AT_ONCE = 50.0, 100.0
"""Of service calls, per node, while it flies; a panel of sliders asks ten times a second."""
COMMANDS_PER_S, COMMANDS_AT_ONCE = 100.0, 200.0
"""Of messages on a topic of commands, which are planned and judged one by one."""
MOST_ORDERS = 16
"""Changes of parameters that may wait for their judgement."""

_TELL_AGAIN_S = 1.0


class RateLimit:
    """Lets so many through per second of wall time, and so many at once after a quiet time.

    Parameters
    ----------
    per_s, at_once : float
    what : str
        For the sentence: "requests to this node".
    now_s : callable, optional
        Wall time, s.

    Attributes
    ----------
    per_s : float
    what : str
    refused : int
        So far.
    """

    def __init__(
        self, per_s: float, at_once: float, what: str, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self.per_s, self.what, self._at_once, self._now_s = per_s, what, at_once, now_s
        self._left, self._looked_s = at_once, now_s()
        self.refused = 0

    @property
    def sentence(self) -> str:
        """Why no more may pass now."""
        return f"more than {self.per_s:g} {self.what} a second; ask less often"

    def admits(self) -> bool:
        """Whether one more may pass now."""
        now_s = self._now_s()
        grown = self._left + (now_s - self._looked_s) * self.per_s
        self._left, self._looked_s = min(grown, self._at_once), now_s
        if self._left < 1.0:
            self.refused += 1
            return False
        self._left -= 1.0
        return True


class RequestLimit:
    """Service calls of a node: while it flies, those that come too often are refused unheard.

    Parameters
    ----------
    flies : callable
        Whether it does.
    warn : callable
        Takes a line for the log.
    """

    def __init__(self, flies: Callable[[], bool], warn: Callable[[str], Any]) -> None:
        self.warn, self._flies, self._told_s = warn, flies, -math.inf
        self._limit = RateLimit(REQUESTS_PER_S, REQUESTS_AT_ONCE, "requests to this node")

    def flooded(self) -> str:
        """Why a call is refused; empty for one that is answered."""
        if not self._flies() or self._limit.admits():
            return ""
        now_s = time.monotonic()
        if now_s - self._told_s > _TELL_AGAIN_S:
            self._told_s = now_s
            self.warn(f"request refused: {self._limit.sentence}")
        return self._limit.sentence

    def summary(self) -> str:
        """How many came too often, and why that is too often; empty if none did."""
        return f"{self._limit.refused}; {self._limit.sentence}" if self._limit.refused else ""
