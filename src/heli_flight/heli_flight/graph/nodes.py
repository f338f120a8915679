# SPDX-License-Identifier: Apache-2.0
"""Faults set and cleared in a running graph, through the services of its plant."""

import contextlib
import os
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import rclpy
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions
from std_srvs.srv import Trigger

from heli_core.command_line import config_folder
from heli_core.errors import BrokenFlightError, StartError
from heli_core.faults import NONE, flow_mapping
from heli_core.folders import temporary_folder, write_whole
from heli_flight import interrupts
from heli_flight.graph.log_folder import keep_log
from heli_flight.graph.processes import DISCOVERY, check_middleware, end_tracer, has_shared_memory
from heli_msgs_bridge.node_process import outlasts_set_clock, wait_for_dds_shutdown
from heli_outer_pd.joystick import Device, DeviceError, Reading

# -------------------------------------------------------------------------------------------------
# Fault setter.
# -------------------------------------------------------------------------------------------------

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
            with outlasts_set_clock(rclpy.get_global_executor()):
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
    pairs: dict[str, str | float | list[float]] = {"what": what, "kind": kind}
    if duration_s is not None:
        pairs["duration_s"] = duration_s
    return flow_mapping(pairs | ({"value": [_number(v) for v in values]} if values else {}))


def _number(value: str) -> float:
    try:
        return float(value)
    except ValueError:
        raise ValueError(f"value: {value!r} is not a number") from None


# -------------------------------------------------------------------------------------------------
# Sends what a joystick or a keyboard does, at a steady rate, until the pilot ends or it goes.
# -------------------------------------------------------------------------------------------------


def send(
    device: Device,
    publish: Callable[[Reading], None],
    period_s: float,
    show: Callable[[Reading], None],
    now_s: Callable[[], float] = time.monotonic,
    pause: Callable[[float], None] = time.sleep,
) -> None:
    """Read and publish in turn, until the pilot ends.

    Parameters
    ----------
    device : Device
    publish : callable
        Sends a reading.
    period_s : float
        Steady time from one reading to the next; what is missed is left out.
    show : callable
        Shows it to people.
    now_s, pause : callable, optional
        The steady clock, s, and what waits so many seconds.

    Raises
    ------
    BrokenFlightError
        The device has gone.
    """
    due_s = now_s()
    while True:
        try:
            reading = device.read(now_s())
        except DeviceError as error:
            raise BrokenFlightError(f"{error}; nothing is sent any more") from None
        if reading is None:
            return
        publish(reading)
        show(reading)
        due_s = max(due_s + period_s, now_s())
        pause(max(due_s - now_s(), 0.0))


def in_words(reading: Reading) -> str:
    """One line: axes by number, numbers of the buttons that are down."""
    axes = " ".join(f"{i}:{value:+.2f}" for i, value in enumerate(reading.axes))
    down = " ".join(str(i) for i, pressed in enumerate(reading.buttons) if pressed)
    return f"axes {axes}  buttons {down or '-'}"


# -------------------------------------------------------------------------------------------------
# A short-lived ROS node for the commands that look at a graph or play into it.
# -------------------------------------------------------------------------------------------------

PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")


def prepare_environment() -> None:
    """Stay on this machine and announce participants often, unless the user chose otherwise.

    In the range LOCALHOST ROS announces itself to this machine alone, and listens on every address
    all the same; the profile has it listen on this machine, too.
    """
    keep_log()
    os.environ.setdefault(DISCOVERY, "LOCALHOST")
    if not any(name in os.environ for name in PROFILES):
        alone = os.environ[DISCOVERY].strip() == "LOCALHOST"
        # Peers that the user names may be on other machines.
        alone = alone and not os.environ.get("ROS_STATIC_PEERS", "").strip()
        name = "fastdds_this_machine.xml" if alone else "fastdds.xml"
        profiles = config_folder("heli_flight") / name
        if not has_shared_memory():
            profiles = _without_log(profiles)
        os.environ.update(dict.fromkeys(PROFILES, str(profiles)))


def _without_log(profiles: Path) -> Path:
    """A copy with which Fast DDS does not complain that it has no shared memory, and uses UDP."""
    silent = "<log><use_default>FALSE</use_default></log>\n  <profiles>"
    quiet = temporary_folder("fastdds") / profiles.name
    write_whole(quiet, profiles.read_text().replace("<profiles>", silent, 1))
    return quiet


@contextlib.contextmanager
def ros_node(name: str) -> Iterator[Node]:
    """A node without parameters, services and log topic; Ctrl-C stays a KeyboardInterrupt.

    Raises
    ------
    StartError
        ROS cannot start: one line with the reason.
    """
    prepare_environment()
    check_middleware()
    end_tracer()
    try:
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        node = Node(f"{name}_{os.getpid()}", enable_rosout=False, start_parameter_services=False)
    except Exception as error:
        first = (str(error).strip().splitlines() or [type(error).__name__])[0]
        raise StartError(f"ROS 2 cannot start: {first}") from error
    try:
        # rclpy's C++ may drop a Ctrl-C that comes while it calls Python, and fail for it.
        with interrupts.interrupts_reported():
            yield node
    finally:
        wait_for_dds_shutdown(node)
        node.destroy_node()
        rclpy.try_shutdown()
