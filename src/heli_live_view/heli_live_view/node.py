# SPDX-License-Identifier: Apache-2.0
"""Node `live_view`: shows a flight to browsers and to Foxglove, on this machine.

It listens like a bystander (best effort, shallow queues), decodes only what is newest 30 times a
second, and runs behind the flight's nodes: whoever looks must not hold up what flies.
"""

import contextlib
import os
import sys
import time
from collections import deque
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import Parameter
from rcl_interfaces.srv import GetParameters, SetParametersAtomically
from rclpy.parameter import Parameter as RosParameter
from rclpy.parameter import parameter_value_to_python
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from std_srvs.srv import Trigger
from trajectory_msgs.msg import MultiDOFJointTrajectory

from heli_core.command_line import MissingFileError
from heli_core.rotations import euler_from_quat
from heli_core.rows import NAV, REFERENCE
from heli_core.trajectory import Trajectory
from heli_live_view import commands
from heli_live_view.access import TOKEN_VARIABLE, Access, BrowserCommand, new_token
from heli_live_view.commands import CommandError, CommandLimits
from heli_live_view.parameters import NODE_NAME, SHOWN_TO_THE_END, TABLE
from heli_live_view.scene import SceneSender
from heli_live_view.server import PageServer, web_folder
from heli_live_view.state import COUNTED, SHOWN, STATE_HZ, LiveState, Screen, compact
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.command_messages import decode_reference, encode_reference
from heli_msgs_bridge.diagnostics import Level, NodeState
from heli_msgs_bridge.layouts import MessageError
from heli_msgs_bridge.lifecycle_node import ManagedNode, NodeSpec, NodeStartError
from heli_msgs_bridge.messages import Decoder, has_fix
from heli_msgs_bridge.node_process import run
from heli_msgs_bridge.signatures import Signature, signature_of
from heli_msgs_bridge.sources import PublisherLock, lock_of

# -------------------------------------------------------------------------------------------------
# Carries admitted commands out through the graph's services and topics, one after the other.
#
# A command is a generator that yields the future of a service call and gets its result; `poll`,
# which
# the node calls between messages, drives it. So nothing here ever blocks.
# -------------------------------------------------------------------------------------------------

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
    limits : CommandLimits

    Attributes
    ----------
    obeyed : int
        Commands that were carried out.
    """

    def __init__(self, node: ManagedNode, state: LiveState, limits: commands.CommandLimits) -> None:
        self._node, self._state, self._limits = node, state, limits
        self._waiting: deque[BrowserCommand] = deque()
        self._running: tuple[BrowserCommand, Steps] | None = None
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

    def put(self, command: BrowserCommand) -> None:
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
        gust = commands.judge_gust(args, self._limits)
        present = yield from self._get("plant", _GUST)
        values, start_s = commands.with_gust(present, gust, self._state.time_s or 0.0)
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
        text = commands.judge_fault(args, self._limits)
        present = yield from self._get("plant", (_FAULTS,))
        values = {_FAULTS: commands.with_fault(present[_FAULTS], text)}
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
        wanted, present = commands.judge_mode(args), self._state.mode(time.monotonic())
        if present == wanted:
            raise CommandError(f"the mode is {wanted} already")
        if present not in commands.MODES:
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
            self._publish(commands.hold(here, now_ns))
        else:
            self._publish(commands.move(None, here, reference.points[-1], now_ns, self._limits)[0])

    def _move(self, args: Mapping[str, Any]) -> Steps:
        self._refuse_when_over()
        home = self._state.home_ned_m
        target = commands.judge_reference(
            args, self._limits, self._here() if home is None else home
        )
        yield from self._get("outer_loop", ())
        if self._state.mode(time.monotonic()) != "hover":
            raise CommandError("the position is not being held: switch to hover first")
        before, now_ns = self._state.reference, self._state.now_ns
        start = self._here() if before is None else before.at(now_ns)
        points, length_s = commands.move(before, start, target, now_ns, self._limits)
        self._publish(points)
        return f"moving to {commands.in_words(target)}, in {length_s:.0f} s"

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


# -------------------------------------------------------------------------------------------------
# Node.
# -------------------------------------------------------------------------------------------------

_DEPTH = 10
# Wall time after which a silent sender of a stream is succeeded by another one.
_SILENT_S = 2.0
_SLOW_PERIOD_S = 1.0


def _be_nice(nice: int) -> None:
    """Lower the priority of all threads of this process (Linux), those of the DDS too."""
    if nice and sys.platform.startswith("linux"):
        for thread in os.listdir("/proc/self/task"):
            os.setpriority(os.PRIO_PROCESS, int(thread), nice)


@dataclass
class View:
    """What the live view has while it is configured.

    Attributes
    ----------
    screen : Screen
    page : PageServer
    foxglove : FoxgloveServer or None
    scene : SceneSender
    full : dict
        Resolved name of each topic.
    newest : dict
        Per topic the newest message that has not been shown.
    last_reference : bytes
        The newest reference; empty: none has come.
    every : dict
        Per topic in `COUNTED` the messages that have not been counted.
    facts : dict
        For /diagnostics.
    owners : dict of PublisherLock
        Per stream whose messages are shown.
    signature : Signature or None
        Of what the flight's nodes say in /diagnostics, where they sign.
    forged : int
        Messages under the flight's nodes' names that they have not signed.
    """

    screen: Screen
    page: PageServer
    foxglove: Any
    scene: SceneSender
    full: dict[str, str]
    facts: dict[str, Any]
    newest: dict[str, bytes] = field(default_factory=dict)
    last_reference: bytes = b""
    every: dict[str, list[bytes]] = field(default_factory=lambda: {name: [] for name in COUNTED})
    decoders: dict[str, Decoder] = field(
        default_factory=lambda: {name: Decoder(name) for name in SHOWN}
    )
    owners: dict[str, PublisherLock] = field(default_factory=dict)
    signature: Signature | None = None
    forged: int = 0


class LiveViewNode(ManagedNode[View, None]):
    """Serves from configuration on, until it is cleaned up or ended."""

    SPEC = NodeSpec(NODE_NAME, "heli_live_view", TABLE, f"{NODE_NAME}.yaml")

    def configure(self) -> View:
        """Bind both ports, subscribe, begin to serve."""
        values = self.values
        token, printed = self._make_token()
        screen = Screen(values, self.start_ns, bool(token))
        full = {topic.name: self.resolve_topic_name(topic.name) for topic in topics.TABLE}
        page = self._open_page(screen, token)
        foxglove = self._open_foxglove(full)
        if foxglove is not None:
            screen.foxglove_url = foxglove.url
        scene = SceneSender(self, foxglove, values["aircraft.rotor_radius_m"])
        self.at_end(scene.close)
        if token:
            commander = Commander(self, screen.live, CommandLimits.from_parameters(values))
            self.at_end(commander.close)
            screen.commander = commander
        core = View(screen, page, foxglove, scene, full, {"page": page.url, "viewers": 0})
        if foxglove is not None:
            core.facts["foxglove"] = foxglove.url
        core.signature = signature_of(full[topics.DIAGNOSTICS])
        for topic in topics.TABLE:
            self._subscribe(core, topic)
        self.create_wall_timer(1.0 / STATE_HZ, self._show)
        self.create_wall_timer(_SLOW_PERIOD_S, self._look_around)
        page.start()
        _be_nice(values["nice"])
        self._say_addresses(core, token if printed else "")
        return core

    # --- servers -----------------------------------------------------------------------------

    def _make_token(self) -> tuple[str, bool]:
        """The token, and whether this node must print it."""
        if not self.values["allow_commands"]:
            return "", False
        token = os.environ.pop(TOKEN_VARIABLE, "")
        return token or new_token(), not token

    def _open_page(self, screen: Screen, token: str) -> PageServer:
        try:
            folder = web_folder()
        except MissingFileError as error:
            raise NodeStartError(str(error)) from error
        page = PageServer(folder, self.values["port"], Access(token), screen.hello, screen.obey)
        self.at_end(page.stop)
        return page

    def _open_foxglove(self, full: Mapping[str, str]) -> Any:
        if not self.values["foxglove"]:
            return None
        try:
            from heli_live_view.scene import FoxgloveServer
        except ImportError:
            self.get_logger().warning("foxglove-sdk is not installed: the page only")
            return None
        types = {full[topic.name]: topic.type for topic in topics.TABLE}
        types |= {self.resolve_topic_name(topics.SCENE): topics.SCENE_TYPE}
        types[topics.TF] = topics.KNOWN[topics.TF].type
        server = FoxgloveServer(self.values["foxglove_port"], types)
        self.at_end(server.stop)
        return server

    def _say_addresses(self, core: View, token: str) -> None:
        lines = [f"live view: {core.page.url}"]
        if core.foxglove is not None:
            lines.append(f"Foxglove: {core.foxglove.url}")
        if token:
            # To the terminal only: what is logged by ROS goes over a topic.
            lines.append(f"command token: {token}")
        print("\n".join(lines), flush=True)

    # --- messages ----------------------------------------------------------------------------

    def _subscribe(self, core: View, topic: topics.Topic) -> None:
        """Hear a topic: pass it on, keep the newest; what is rare is read at once."""
        name, full, newest, foxglove = topic.name, core.full[topic.name], core.newest, core.foxglove
        every = core.every.get(name)
        read = {topics.DIAGNOSTICS: self._on_diagnostics, topics.REFERENCE: self._on_reference}.get(
            name
        )

        def receive(raw: bytes) -> None:
            if foxglove is not None:
                foxglove.log(full, raw)
            if read is None:
                newest[name] = raw
                if every is not None:
                    every.append(raw)
            else:
                read(raw)

        reliable = topic.latched or topic.every_ticks == 0
        best_effort = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=_DEPTH,
            reliability=ReliabilityPolicy.BEST_EFFORT,
        )
        if reliable:
            self.subscribe(name, receive, raw=True)
            return
        owner = core.owners[name] = lock_of(self, name, _SILENT_S, topic.period_ns(self.rate))
        self.subscribe(name, receive, best_effort, raw=True, owner=owner)

    def _deserialize(self, name: str, raw: bytes) -> Any:
        return deserialize_message(raw, topics.message_class(topics.BY_NAME[name].type))

    def _on_diagnostics(self, raw: bytes) -> None:
        own_namespace, live = self.get_namespace().strip("/"), self.core.screen.live
        signature = self.core.signature
        genuine = signature is None or signature.is_genuine(raw)
        for status in self._deserialize(topics.DIAGNOSTICS, raw).status:
            namespace, _, name = status.name.rpartition("/")
            if namespace.strip("/") == own_namespace:
                if not genuine and name in topics.BY_NAME[topics.DIAGNOSTICS].source:
                    self.core.forged += 1
                    continue
                level = int.from_bytes(status.level, "little")
                facts = {pair.key: pair.value for pair in status.values}
                live.take_status(name, level, status.message, facts)

    def _on_reference(self, raw: bytes) -> None:
        self.core.last_reference = raw
        live = self.core.screen.live
        try:
            live.take_reference(decode_reference(self._deserialize(topics.REFERENCE, raw)))
        except MessageError as error:
            live.tell(1, topics.REFERENCE, str(error))

    def _take_newest(self, wall_s: float) -> None:
        core, live = self.core, self.core.screen.live
        for name, raw in list(core.newest.items()):
            stamp_ns = stamp_of(raw)
            if name == topics.CLOCK and live.take_clock(stamp_ns, wall_s):
                core.screen.begin_anew()
                core.page.send(core.screen.hello())
            decoder = core.decoders.get(name)
            if decoder is None:
                if name != topics.GPS_FIX or has_fix(self._deserialize(name, raw)):
                    live.take_arrival(name, stamp_ns, wall_s)
                continue
            try:
                live.take(name, decoder.decode(raw), wall_s)
            except MessageError as error:
                self.get_logger().warning(str(error), throttle_duration_sec=5.0)
        core.newest.clear()
        self._count_every()

    def _count_every(self) -> None:
        """Hold every sample against the reference, not only the ones that are drawn."""
        for name, samples in self.core.every.items():
            decoder = self.core.decoders[name]
            for raw in samples:
                with contextlib.suppress(MessageError):
                    self.core.screen.live.take_sample(name, stamp_of(raw), decoder.decode(raw))
            samples.clear()

    # --- thirty times a second ---------------------------------------------------------------

    def _show(self) -> None:
        core, wall_s = self.core, time.monotonic()
        self._take_newest(wall_s)
        if core.facts["viewers"] != core.page.viewers:
            # At once: a flight may wait for the first one.
            core.facts["viewers"] = core.page.viewers
            self._say_what_is_shown()
        if core.screen.commander is not None:
            core.screen.commander.poll()
        row = self._send_row(wall_s)
        if core.screen.live.end and self.health.state != NodeState.FINISHED:
            self._say_what_is_shown()
        core.scene.show(row, core.screen.live.now_ns)

    def _send_row(self, wall_s: float) -> dict[str, Any]:
        """Give the present state to the browsers and to Foxglove; returns it."""
        core = self.core
        row = core.screen.row(wall_s)
        for event in core.screen.events():
            core.page.send(compact(event))
        text = compact(row)
        core.page.send_state(text)
        if core.foxglove is not None and row["t"] is not None:
            core.foxglove.set_time(core.screen.live.now_ns)
            core.foxglove.log_state(text)
        return row

    def _look_around(self) -> None:
        """Once a second: who is in the graph; own health."""
        core, own_namespace = self.core, self.get_namespace()
        live, commander = core.screen.live, core.screen.commander
        nodes = self.get_node_names_and_namespaces()
        present = (name for name, namespace in nodes if namespace == own_namespace)
        truth_is_sent = self.count_publishers(topics.TRUTH_ODOM) > 0
        live.take_presence(present, truth_is_sent, time.monotonic())
        self.tick = max(0, live.now_ns - self.start_ns) // self.rate.tick_ns
        if commander is not None:
            core.facts["commands"] = commander.obeyed
        for refusal, count in list(core.page.refused.items()):
            key = f"refused.{refusal}"
            if key not in core.facts:
                live.tell(1, NODE_NAME, f"refused: {refusal}")
                self.get_logger().warning(f"refused: {refusal}")
            core.facts[key] = count
        if ignored := core.forged + sum(owner.ignored for owner in core.owners.values()):
            core.facts["ignored"] = ignored
        self._say_what_is_shown()
        if core.foxglove is not None and core.last_reference:
            # Sent once per change: a client that comes later would never see it.
            core.foxglove.log(core.full[topics.REFERENCE], core.last_reference)

    def _say_what_is_shown(self) -> None:
        if self.core.screen.live.end:
            self.report(Level.OK, SHOWN_TO_THE_END, self.core.facts, NodeState.FINISHED)
        else:
            self.report(Level.OK, "showing the flight", self.core.facts)

    def release(self) -> None:
        """Send what is left (how the flight has ended); ROS may have ended already."""
        wall_s = time.monotonic()
        self._take_newest(wall_s)
        self.core.screen.live.interrupt()
        self._send_row(wall_s)


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_live_view live_view`."""
    return run(LiveViewNode, args)


if __name__ == "__main__":
    sys.exit(main())
