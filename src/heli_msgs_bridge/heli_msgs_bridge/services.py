# SPDX-License-Identifier: Apache-2.0
"""Services of a node that never end it: what cannot be answered is refused, in words.

An exception in a service's callback comes out of rclpy's executor and would end the process; any
client could raise one, by a transition that is not possible or a parameter of no known type.
"""

from collections.abc import Callable, Mapping
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically

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


def in_words(error: BaseException) -> str:
    """An exception in one line."""
    said = " ".join(str(error).split())
    return said if isinstance(error, ValueError) and said else f"{type(error).__name__}: {said}"


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
            reason = in_words(error)
            say(f"{name}: refused: {reason}")
            return _refusal(service.srv_type, request, reason)

    def respond(response: Any, header: Any) -> None:
        if isinstance(response, Later):
            response.send_by(lambda ready: respond(ready, header))
            return
        try:
            send(response, header)
        except Exception as error:
            say(f"{name}: no answer could be sent: {in_words(error)}")

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
