# SPDX-License-Identifier: Apache-2.0
"""Carries admitted commands out through the graph's services and topics, one after the other.

A command is a generator that yields the future of a service call and gets its result; `poll`, which
the node calls between messages, drives it. So nothing here ever blocks.
"""

import time
from collections import deque
from collections.abc import Generator, Mapping
from typing import Any

import numpy as np
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory

from heli_live_view import faults, plan
from heli_live_view.live_state import LiveState
from heli_live_view.page_server import Command
from heli_live_view.plan import CommandError
from heli_math.rotations import euler_from_quat
from heli_math.rows import NAV, REFERENCE
from heli_math.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.managed_node import ManagedNode
from heli_msgs_bridge.reference_message import encode_reference

_ANSWER_S = 5.0
_LOCKSTEP = (
    "this flight is in lockstep, not at the pace of the clock: commands need one in real time"
)
_GIVEN_UP = "attitude is held; nothing holds position and altitude until hover is commanded"
_FAULTS, _CLEAR = "faults", "clear_faults"
_GUST = tuple(f"wind.gust.{name}" for name in ("start_s", "duration_s", "amplitude_mps", "frame"))
Steps = Generator[Any, Any, str]


class Commander:
    """Judges and carries out commands.

    Parameters
    ----------
    node : ManagedNode
        Gets the clients and the publisher of `reference`.
    state : LiveState
        What is flown.
    limits : Limits

    Attributes
    ----------
    obeyed : int
        Commands that were carried out.
    """

    def __init__(self, node: ManagedNode, state: LiveState, limits: plan.Limits) -> None:
        self._node, self._state, self._limits = node, state, limits
        self._waiting: deque[Command] = deque()
        self._running: tuple[Command, Steps] | None = None
        self._future: Any = None
        self._deadline_s = 0.0
        self._asked = ""
        self.obeyed = 0
        self._clients = {
            (name, kind): node.create_client(service, f"{name}/{kind}".removeprefix("/"))
            for name, kind, service in (
                ("", _CLEAR, Trigger),
                ("plant", "get_parameters", GetParameters),
                ("plant", "set_parameters_atomically", SetParametersAtomically),
                ("outer_loop", "get_parameters", GetParameters),
                ("outer_loop", "change_state", ChangeState),
            )
        }
        # In lockstep the outer loop would wait for whoever might send a reference.
        self._reference: Any = None if node.values["lockstep"] else self._create_reference()
        self._handlers = {
            "gust": self._gust, "mode": self._mode, "reference": self._move, "fault": self._fault,
            _CLEAR: self._clear,
        }  # fmt: skip

    def put(self, command: Command) -> None:
        """Take a command, from any thread."""
        self._waiting.append(command)

    def close(self) -> None:
        """Take clients and publisher out of the graph."""
        for client in self._clients.values():
            self._node.destroy_client(client)
        if self._reference is not None:
            self._node.destroy_publisher(self._reference)

    def poll(self) -> None:
        """Go on with the present command, or begin the next one."""
        if self._running is None and self._waiting:
            command = self._waiting.popleft()
            handler = self._handlers.get(command.name)
            if handler is None:
                known = ", ".join(self._handlers)
                command.reply(False, f"unknown command '{command.name}'; known: {known}")
                return
            self._running = command, handler(command.args)
            self._advance(None)
        elif self._future is not None and self._future.done():
            result, self._future = self._future.result(), None
            self._advance(result)
        elif self._future is not None and time.monotonic() > self._deadline_s:
            self._future = None
            self._end(False, f"{self._asked} does not answer")

    def _advance(self, result: Any) -> None:
        assert self._running is not None
        steps = self._running[1]
        try:
            self._future = steps.send(result)
        except StopIteration as done:
            self._end(True, done.value)
        except CommandError as error:
            self._end(False, str(error))

    def _end(self, ok: bool, sentence: str) -> None:
        assert self._running is not None
        command, self._running = self._running[0], None
        self.obeyed += ok
        level = 0 if ok and sentence != _GIVEN_UP else 1
        self._state.tell(level, "command", f"{command.name}: {sentence}")
        command.reply(ok, sentence)

    # --- the graph's services ----------------------------------------------------------------

    def _call(self, name: str, kind: str, request: Any) -> Any:
        client = self._clients[name, kind]
        if not client.service_is_ready():
            raise CommandError(f"no {name or 'plant'} in the graph")
        self._asked, self._deadline_s = name or kind, time.monotonic() + _ANSWER_S
        return client.call_async(request)

    def _get(self, name: str, keys: tuple[str, ...]) -> Generator[Any, Any, dict[str, Any]]:
        """Parameters of a node; refuses flights in lockstep."""
        request = GetParameters.Request(names=["lockstep", *keys])
        response = yield self._call(name, "get_parameters", request)
        values = [parameter_value_to_python(value) for value in response.values]
        if len(values) != len(keys) + 1:
            raise CommandError(f"{name} does not know {', '.join(keys)}")
        if values[0]:
            raise CommandError(_LOCKSTEP)
        return dict(zip(keys, values[1:], strict=True))

    def _refuse_when_over(self) -> None:
        if self._state.end or self._state.time_s is None:
            raise CommandError("no flight is under way")

    # --- commands ----------------------------------------------------------------------------

    def _gust(self, args: Mapping[str, Any]) -> Steps:
        self._refuse_when_over()
        gust = plan.judge_gust(args, self._limits)
        present = yield from self._get("plant", _GUST)
        values, start_s = plan.with_gust(present, gust, self._state.time_s or 0.0)
        request = SetParametersAtomically.Request(parameters=_messages(values))
        response = yield self._call("plant", "set_parameters_atomically", request)
        if not response.result.successful:
            raise CommandError(response.result.reason)
        return (
            f"gust of {gust.amplitude_mps:g} m/s from {gust.from_deg % 360.0:g} deg, "
            f"{start_s:.1f} s to {start_s + gust.duration_s:.1f} s"
        )

    def _fault(self, args: Mapping[str, Any]) -> Steps:
        self._refuse_when_over()
        text = faults.judge_fault(args, self._limits)
        present = yield from self._get("plant", (_FAULTS,))
        values = {_FAULTS: faults.with_fault(present[_FAULTS], text)}
        request = SetParametersAtomically.Request(parameters=_messages(values))
        response = yield self._call("plant", "set_parameters_atomically", request)
        if not response.result.successful:
            raise CommandError(response.result.reason)
        duration_s = args.get("duration_s")
        lasts = "until it is cleared" if duration_s is None else f"for {duration_s:g} s"
        return f"{args['what']} {args['kind']} from now on, {lasts}"

    def _clear(self, args: Mapping[str, Any]) -> Steps:
        self._refuse_when_over()
        yield from self._get("plant", ())
        response = yield self._call("", _CLEAR, Trigger.Request())
        if not response.success:
            raise CommandError(response.message)
        return str(response.message)

    def _mode(self, args: Mapping[str, Any]) -> Steps:
        self._refuse_when_over()
        wanted, present = plan.judge_mode(args), self._state.mode(time.monotonic())
        if present == wanted:
            raise CommandError(f"the mode is {wanted} already")
        if present not in plan.MODES:
            raise CommandError(f"the mode is {present}: nothing to switch")
        yield from self._get("outer_loop", ())
        request = ChangeState.Request()
        if wanted == "attitude":
            request.transition.id = Transition.TRANSITION_DEACTIVATE
        else:
            request.transition.id = Transition.TRANSITION_ACTIVATE
            self._return_gently()
        response = yield self._call("outer_loop", "change_state", request)
        if not response.success:
            raise CommandError(f"outer_loop refused to switch to {wanted}")
        if wanted == "attitude":
            self._state.forget(topics.ATTITUDE_SETPOINT)
            return _GIVEN_UP
        return "hover: the reference returns from where the helicopter is"

    def _return_gently(self) -> None:
        """Reference from where the helicopter has drifted to, back to where it was to go."""
        here, now_ns = self._here(), self._state.now_ns
        reference = self._state.reference
        if reference is None:
            self._publish(plan.hold(here, now_ns))
        else:
            self._publish(plan.move(None, here, reference.points[-1], now_ns, self._limits)[0])

    def _move(self, args: Mapping[str, Any]) -> Steps:
        self._refuse_when_over()
        home = self._state.home_ned_m
        target = plan.judge_reference(args, self._limits, self._here() if home is None else home)
        yield from self._get("outer_loop", ())
        if self._state.mode(time.monotonic()) != "hover":
            raise CommandError("the position is not being held: switch to hover first")
        before, now_ns = self._state.reference, self._state.now_ns
        start = self._here() if before is None else before.at(now_ns)
        points, length_s = plan.move(before, start, target, now_ns, self._limits)
        self._publish(points)
        return f"moving to {plan.in_words(target)}, in {length_s:.0f} s"

    def _here(self) -> np.ndarray:
        """Navigated position and heading as a reference row at rest."""
        nav = self._state.value(topics.ODOM, time.monotonic())
        if nav is None:
            raise CommandError("no navigation: where the helicopter is, is not known")
        row = np.zeros(REFERENCE.size)
        row[REFERENCE.pos] = nav[NAV.pos]
        _, _, row[REFERENCE.psi] = euler_from_quat(nav[NAV.quat])
        return row

    def _create_reference(self) -> Any:
        return self._node.create_publisher(
            MultiDOFJointTrajectory, topics.REFERENCE, topics.qos(topics.REFERENCE)
        )

    def _publish(self, points: Trajectory) -> None:
        if self._reference is None:
            self._reference = self._create_reference()
        self._reference.publish(encode_reference(points, self._node.get_namespace()))


def _messages(values: Mapping[str, Any]) -> list[Parameter]:
    """Parameter messages; lists are of texts or of doubles."""
    plain = {
        name: [v if isinstance(v, str) else float(v) for v in value]
        if isinstance(value, list)
        else value
        for name, value in values.items()
    }
    return [RosParameter(name, value=value).to_parameter_msg() for name, value in plain.items()]
