# SPDX-License-Identifier: Apache-2.0
"""Node `live_view`: shows a flight to browsers and to Foxglove, on this machine.

It listens like a bystander (best effort, shallow queues), decodes only what is newest 30 times a
second, and runs behind the flight's nodes: whoever looks must not hold up what flies.
"""

import contextlib
import os
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from heli_live_view.access import TOKEN_VARIABLE, Access, new_token
from heli_live_view.live_state import COUNTED, SHOWN
from heli_live_view.page_server import PageServer
from heli_live_view.parameter_table import NODE_NAME, SHOWN_TO_THE_END, TABLE
from heli_live_view.plan import Limits
from heli_live_view.ros_commands import Commander
from heli_live_view.scene_sender import SceneSender
from heli_live_view.screen import STATE_HZ, Screen, compact
from heli_live_view.web_folder import web_folder
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.managed_node import ManagedNode
from heli_msgs_bridge.messages import Decoder, MessageError, has_fix
from heli_msgs_bridge.node_process import run
from heli_msgs_bridge.node_spec import NodeSpec, StartError
from heli_msgs_bridge.reference_message import decode_reference
from heli_parameters.locate import MissingFileError

_DEPTH = 10
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
            screen.commander = Commander(self, screen.live, Limits.from_parameters(values))
            self.at_end(screen.commander.close)
        core = View(screen, page, foxglove, scene, full, {"page": page.url, "viewers": 0})
        if foxglove is not None:
            core.facts["foxglove"] = foxglove.url
        for topic in topics.TABLE:
            self._subscribe(core, topic)
        self.repeat(1.0 / STATE_HZ, self._show)
        self.repeat(_SLOW_PERIOD_S, self._look_around)
        page.start()
        _be_nice(values["nice"])
        self._say_addresses(core, token if printed else "")
        return core

    # --- servers -----------------------------------------------------------------------------

    def _make_token(self) -> tuple[str, bool]:
        """The token, and whether this node must print it."""
        if not self.values["allow_commands"]:
            return "", False
        given = os.environ.pop(TOKEN_VARIABLE, "")
        return given or new_token(), not given

    def _open_page(self, screen: Screen, token: str) -> PageServer:
        try:
            folder = web_folder()
        except MissingFileError as error:
            raise StartError(str(error)) from error
        page = PageServer(folder, self.values["port"], Access(token), screen.hello, screen.obey)
        self.at_end(page.stop)
        return page

    def _open_foxglove(self, full: Mapping[str, str]) -> Any:
        if not self.values["foxglove"]:
            return None
        try:
            from heli_live_view.foxglove_server import FoxgloveServer
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
        self.hear(name, receive, None if reliable else best_effort, raw=True)

    def _deserialize(self, name: str, raw: bytes) -> Any:
        return deserialize_message(raw, topics.message_class(topics.BY_NAME[name].type))

    def _on_diagnostics(self, raw: bytes) -> None:
        own, live = self.get_namespace().strip("/"), self.core.screen.live
        for status in self._deserialize(topics.DIAGNOSTICS, raw).status:
            namespace, _, name = status.name.rpartition("/")
            if namespace.strip("/") == own:
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
        if core.screen.live.end and self.health.message != SHOWN_TO_THE_END:
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
        core, own = self.core, self.get_namespace()
        live, commander = core.screen.live, core.screen.commander
        nodes = self.get_node_names_and_namespaces()
        present = (name for name, namespace in nodes if namespace == own)
        truth_is_sent = self.count_publishers(topics.TRUTH_ODOM) > 0
        live.take_presence(present, truth_is_sent, time.monotonic())
        self.tick = max(0, live.now_ns - self.start_ns) // self.rate.tick_ns
        if commander is not None:
            core.facts["commands"] = commander.obeyed
        self._say_what_is_shown()
        if core.foxglove is not None and core.last_reference:
            # Sent once per change: a client that comes later would never see it.
            core.foxglove.log(core.full[topics.REFERENCE], core.last_reference)

    def _say_what_is_shown(self) -> None:
        message = SHOWN_TO_THE_END if self.core.screen.live.end else "showing the flight"
        self.report(Level.OK, message, self.core.facts)

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
