# SPDX-License-Identifier: Apache-2.0
"""Node `live_view`: shows a flight to browsers and to Foxglove, on this machine.

It listens like a bystander (best effort, shallow queues), decodes only what is newest 30 times a
second, and runs behind the flight's nodes: whoever looks must not hold up what flies.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

from heli_live_view.access import TOKEN_VARIABLE, VIEW_ONLY, Access, new_token
from heli_live_view.history import History
from heli_live_view.live_state import SHOWN, LiveState
from heli_live_view.page_server import Command, PageServer
from heli_live_view.parameter_table import (
    BOUNDS,
    COMMAND_LIMITS,
    NODE_NAME,
    SHOWN_TO_THE_END,
    TABLE,
)
from heli_live_view.plan import Limits
from heli_live_view.ros_commands import Commander
from heli_live_view.scene_message import TF, TF_TYPE
from heli_live_view.scene_sender import SceneSender
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.managed_node import ManagedNode, NodeSpec, StartError, run
from heli_msgs_bridge.messages import Decoder, MessageError
from heli_msgs_bridge.reference_message import decode_reference
from heli_parameters import locate

STATE_HZ = 30
_DEPTH = 10
_EVENTS_KEPT = 200
_SLOW_PERIOD_S = 1.0


def _be_nice(nice: int) -> None:
    """Lower the priority of all threads of this process (Linux), those of the DDS too."""
    if nice and sys.platform.startswith("linux"):
        for thread in os.listdir("/proc/self/task"):
            os.setpriority(os.PRIO_PROCESS, int(thread), nice)


def _text(content: Any) -> str:
    return json.dumps(content, separators=(",", ":"), allow_nan=False)


class LiveViewNode(ManagedNode):
    """Serves from configuration on, until it is cleaned up or ended."""

    SPEC = NodeSpec(NODE_NAME, "heli_live_view", TABLE, f"{NODE_NAME}.yaml")

    def setup(self) -> None:
        """Bind both ports, subscribe, begin to serve."""
        self.live = LiveState(self.start_ns, self.values["stale_s"])
        self.history = History()
        self._past_events: list[dict[str, Any]] = []
        self._token, printed = self._make_token()
        self._full = {topic.name: self.resolve_topic_name(topic.name) for topic in topics.TABLE}
        self.page = self._open_page()
        self.foxglove = self._open_foxglove()
        radius_m = self.values["aircraft.rotor_radius_m"]
        self.scene: SceneSender | None = SceneSender(self, self.foxglove, radius_m)
        self.commander: Commander | None = None
        if self._token:
            self.commander = Commander(self, self.live, Limits.from_parameters(self.values))
        self._newest: dict[str, bytes] = {}
        self._last_reference = b""
        self._decoders = {name: Decoder(name) for name in SHOWN}
        self._raw_subscriptions = [self._subscribe(topic) for topic in topics.TABLE]
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._steady_timers = [
            self.create_timer(1.0 / STATE_HZ, self._show, clock=steady),
            self.create_timer(_SLOW_PERIOD_S, self._look_around, clock=steady),
        ]
        self.page.start()
        _be_nice(self.values["nice"])
        self._say_addresses(printed)

    # --- servers -----------------------------------------------------------------------------

    def _make_token(self) -> tuple[str, bool]:
        """The token, and whether this node must print it."""
        if not self.values["allow_commands"]:
            return "", False
        given = os.environ.pop(TOKEN_VARIABLE, "")
        return given or new_token(), not given

    def _open_page(self) -> PageServer:
        try:
            folder = locate.share_folder("heli_live_view") / "web"
        except locate.MissingFileError as error:
            raise StartError(str(error)) from error
        if not (folder / "index.html").is_file():
            raise StartError(f"the page is not installed: no {folder}/index.html")
        access = Access(self._token)
        return PageServer(Path(folder), self.values["port"], access, self._hello, self._on_command)

    def _open_foxglove(self) -> Any:
        if not self.values["foxglove"]:
            return None
        try:
            from heli_live_view.foxglove_server import FoxgloveServer
        except ImportError:
            self.get_logger().warning("foxglove-sdk is not installed: the page only")
            return None
        types = {self._full[topic.name]: topic.type for topic in topics.TABLE}
        types |= {self.resolve_topic_name(topics.SCENE): topics.SCENE_TYPE, TF: TF_TYPE}
        return FoxgloveServer(self.values["foxglove_port"], types)

    def _say_addresses(self, print_token: bool) -> None:
        self._facts = {"page": self.page.url}
        lines = [f"live view: {self.page.url}"]
        if self.foxglove is not None:
            self._facts["foxglove"] = self.foxglove.url
            lines.append(f"Foxglove: {self.foxglove.url}")
        if print_token:
            # To the terminal only: what is logged by ROS goes over a topic.
            lines.append(f"command token: {self._token}")
        print("\n".join(lines), flush=True)

    def _hello(self) -> str:
        """First message of a connection; called by the page server's thread."""
        v = self.values
        head = {
            "type": "hello",
            "commands": bool(self._token),
            "flight": {
                "scenario": v["flight.scenario"],
                "seed": v["flight.seed"] if v["flight.seed"] >= 0 else None,
                "duration_s": v["flight.duration_s"] or None,
                "realtime": not v["lockstep"],
            },
            "aircraft": {
                "name": v["aircraft.name"],
                "rotor_radius_m": v["aircraft.rotor_radius_m"],
            },
            "bounds": {name.partition(".")[2]: v[name] for name in BOUNDS},
            "limits": {name.partition(".")[2]: v[name] for name in COMMAND_LIMITS},
            "foxglove_url": self.foxglove.url if self.foxglove is not None else None,
            "state_hz": STATE_HZ,
            "events": list(self._past_events),
        }
        return f'{_text(head)[:-1]},"history":[{",".join(list(self.history.rows))}]}}'

    def _on_command(self, command: Command) -> None:
        """Called by the page server's thread, for commands of the token's owner only."""
        if self.commander is None:
            command.reply(False, VIEW_ONLY)
        else:
            self.commander.put(command)

    # --- messages ----------------------------------------------------------------------------

    def _subscribe(self, topic: topics.Topic) -> Any:
        reliable = topic.latched or topic.every_ticks == 0
        best_effort = QoSProfile(
            history=HistoryPolicy.KEEP_LAST,
            depth=_DEPTH,
            reliability=ReliabilityPolicy.BEST_EFFORT,
        )
        return self.create_subscription(
            topics.message_class(topic.type),
            topic.name,
            self._receiver(topic.name),
            topics.qos(topic.name) if reliable else best_effort,
            raw=True,
        )

    def _receiver(self, name: str) -> Callable[[bytes], None]:
        """Callback of a topic: pass it on, keep the newest; what is rare is read at once."""
        full, newest, foxglove = self._full[name], self._newest, self.foxglove
        read = {topics.DIAGNOSTICS: self._on_diagnostics, topics.REFERENCE: self._on_reference}.get(
            name
        )

        def receive(raw: bytes) -> None:
            if foxglove is not None:
                foxglove.log(full, raw)
            if read is None:
                newest[name] = raw
            else:
                read(raw)

        return receive

    def _deserialize(self, name: str, raw: bytes) -> Any:
        return deserialize_message(raw, topics.message_class(topics.BY_NAME[name].type))

    def _on_diagnostics(self, raw: bytes) -> None:
        own = self.get_namespace().strip("/")
        for status in self._deserialize(topics.DIAGNOSTICS, raw).status:
            namespace, _, name = status.name.rpartition("/")
            if namespace.strip("/") == own:
                level = int.from_bytes(status.level, "little")
                facts = {pair.key: pair.value for pair in status.values}
                self.live.take_status(name, level, status.message, facts)

    def _on_reference(self, raw: bytes) -> None:
        self._last_reference = raw
        try:
            self.live.take_reference(decode_reference(self._deserialize(topics.REFERENCE, raw)))
        except MessageError as error:
            self.live.tell(1, topics.REFERENCE, str(error))

    def _take_newest(self, wall_s: float) -> None:
        for name, raw in list(self._newest.items()):
            stamp_ns = stamp_of(raw)
            if name == topics.CLOCK and self.live.take_clock(stamp_ns, wall_s):
                self._begin_anew()
            decoder = self._decoders.get(name)
            if decoder is None:
                self.live.take_arrival(name, stamp_ns, wall_s)
                continue
            try:
                self.live.take(name, decoder.decode(raw), wall_s)
            except MessageError as error:
                self.get_logger().warning(str(error), throttle_duration_sec=5.0)
        self._newest.clear()

    # --- thirty times a second ---------------------------------------------------------------

    def _show(self) -> None:
        wall_s = time.monotonic()
        self._take_newest(wall_s)
        if self.commander is not None:
            self.commander.poll()
        row = self._send_row(wall_s)
        if self.live.end and self._message != SHOWN_TO_THE_END:
            self._say_what_is_shown()
        if self.scene is not None:
            self.scene.show(row, self.live.now_ns)

    def _send_row(self, wall_s: float) -> dict[str, Any]:
        """Give the present state to the browsers and to Foxglove; returns it."""
        row = self.live.row(wall_s)
        self._send_events()
        time_s = row["t"]
        if time_s is not None and self.history.wants(time_s):
            self.history.add(time_s, _text({**row, "nodes": {}, "alarms": []}))
        text = _text(row)
        self.page.send_state(text)
        if self.foxglove is not None and time_s is not None:
            self.foxglove.set_time(self.live.now_ns)
            self.foxglove.log_state(text)
        return row

    def _send_events(self) -> None:
        for event in self.live.take_events():
            message = event.message()
            self._past_events.append(message)
            del self._past_events[:-_EVENTS_KEPT]
            self.page.send(_text(message))

    def _look_around(self) -> None:
        """Once a second: who is in the graph; own health."""
        own = self.get_namespace()
        nodes = self.get_node_names_and_namespaces()
        present = (name for name, namespace in nodes if namespace == own)
        self.live.take_presence(present, time.monotonic())
        self.tick = max(0, self.live.now_ns - self.start_ns) // topics.TICK_NS
        if self.commander is not None:
            self._facts["commands"] = self.commander.obeyed
        self._say_what_is_shown()
        if self.foxglove is not None and self._last_reference:
            # Sent once per change: a client that comes later would never see it.
            self.foxglove.log(self._full[topics.REFERENCE], self._last_reference)

    def _say_what_is_shown(self) -> None:
        self.report(Level.OK, SHOWN_TO_THE_END if self.live.end else "showing the flight")

    def _begin_anew(self) -> None:
        """Another flight: forget the past one, here and in the browsers."""
        self.history.clear()
        self._past_events.clear()
        self.page.send(self._hello())

    # --- ends --------------------------------------------------------------------------------

    def teardown(self) -> None:
        """Send what is left (how the flight has ended), then close the ports."""
        if getattr(self, "page", None) is None:
            return
        # ROS may have ended already; the browsers are still to hear the end.
        wall_s = time.monotonic()
        self._take_newest(wall_s)
        self.live.interrupt()
        self._send_row(wall_s)
        self._close_ports()

    def _close_ports(self) -> None:
        for name in ("page", "foxglove"):
            server = getattr(self, name, None)
            if server is not None:
                server.stop()
            setattr(self, name, None)

    def _drop_entities(self) -> None:
        super()._drop_entities()
        for subscription in getattr(self, "_raw_subscriptions", []):
            self.destroy_subscription(subscription)
        for timer in getattr(self, "_steady_timers", []):
            self.destroy_timer(timer)
        self._raw_subscriptions, self._steady_timers = [], []
        for helper in (getattr(self, "scene", None), getattr(self, "commander", None)):
            if helper is not None:
                helper.close()
        self.scene = self.commander = None
        # A set-up that failed half-way has bound them already.
        self._close_ports()


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_msgs_bridge live_view`."""
    return run(LiveViewNode, args)


if __name__ == "__main__":
    sys.exit(main())
