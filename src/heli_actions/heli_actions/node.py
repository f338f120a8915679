# SPDX-License-Identifier: Apache-2.0
"""Node `actions`: a goal's way into the graph and back, by what pilots have without it.

It only listens, so no flight waits for it: services `takeoff`, `land` and `hold`, topics `goto` and
`reference` are how it commands, `odom`, `reference` and /diagnostics what it sees.
"""

import sys
import time
from collections.abc import Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from typing import Any

import numpy as np
from rclpy.qos import HistoryPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from heli_actions.desk import Desk, Limits
from heli_actions.messages import Interfaces, interface_types
from heli_actions.parameter_table import NODE_NAME, TABLE
from heli_actions.seen import Seen, Way
from heli_actions.servers import DeferredServer
from heli_actions.table import HOLD, LAND, RULES, Code, Kind, Outcome
from heli_math.rows import NAV, REFERENCE
from heli_math.ticks import NS_PER_S
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_MODE, Level
from heli_msgs_bridge.managed_node import INACTIVE, ManagedNode
from heli_msgs_bridge.messages import Decoder, MessageError
from heli_msgs_bridge.node_process import run
from heli_msgs_bridge.node_spec import NodeSpec, StartError
from heli_msgs_bridge.reference_message import decode_reference

PREFIX = "actions"
"""Of the actions' names: a service `takeoff` and a topic `goto` are there already."""
_LOOK_S, _SLOW_PERIOD_S = 0.05, 1.0
_SERVICES = (RULES[Kind.TAKEOFF].service, LAND, HOLD)


@dataclass
class Serving:
    """What the node has while it is configured.

    Attributes
    ----------
    desk : Desk
    seen : Seen
    interfaces : Interfaces
    clients : dict
        Per service its client.
    servers : dict
        Per kind of goals its server.
    publishers : dict
        Per topic its publisher, from the first message on: in lockstep the outer loop would wait
        for whoever might send a reference.
    handles : dict
        Goals that have not ended, with their kind.
    unasked : list
        Calls to services that are not there yet.
    odom : Decoder
    newest : bytes
        The newest navigation that was not looked at; empty for none.
    told_s : float
        When feedback was sent last, wall time.
    """

    desk: Desk
    seen: Seen
    interfaces: Interfaces
    clients: dict[str, Any]
    servers: dict[Kind, DeferredServer] = field(default_factory=dict)
    publishers: dict[str, Any] = field(default_factory=dict)
    handles: dict[Hashable, tuple[Kind, Any]] = field(default_factory=dict)
    unasked: list[tuple[Hashable, str]] = field(default_factory=list)
    odom: Decoder = field(default_factory=lambda: Decoder(topics.ODOM))
    newest: bytes = b""
    told_s: float = 0.0


class ActionsNode(ManagedNode[Serving, None]):
    """Active means: goals are taken. What is flown goes on when it is deactivated."""

    SPEC = NodeSpec(NODE_NAME, "heli_actions", TABLE, f"{NODE_NAME}.yaml")

    def __init__(self, values: Mapping[str, Any], **options: Any) -> None:
        # Before there is anything in the graph: without types there is no such node.
        self._interfaces = self.interfaces()
        super().__init__(values, **options)

    def interfaces(self) -> Interfaces:
        """The types that are served; `StartError` if they are not there."""
        try:
            return Interfaces(interface_types())
        except LookupError as error:
            raise StartError(str(error)) from error

    def configure(self) -> Serving:
        """Begin to listen; serve the actions."""
        interfaces, seen, wall_s = self._interfaces, Seen(), time.monotonic()
        seen.odom_wall_s = seen.told_wall_s = wall_s
        clients = {name: self.create_client(Trigger, name) for name in _SERVICES}
        for client in clients.values():
            self.at_end(partial(self.destroy_client, client))
        core = Serving(Desk(self, seen, self._limits(self.values)), seen, interfaces, clients)
        self.at_end(partial(self._close_publishers, core))
        self._publisher(core, topics.GOTO)
        best_effort = QoSProfile(
            history=HistoryPolicy.KEEP_LAST, depth=1, reliability=ReliabilityPolicy.BEST_EFFORT
        )
        self.hear(topics.ODOM, self._on_odom, best_effort, raw=True)
        self.hear(topics.DIAGNOSTICS, self._on_diagnostics)
        self.hear(topics.REFERENCE, self._on_reference)
        for kind, action_type in interfaces.types.items():
            core.servers[kind] = DeferredServer(
                self, kind, action_type, f"{PREFIX}/{kind}", lambda: self.active,
                self.guarded(self._on_goal), self.guarded(self._on_cancel),
            )  # fmt: skip
            self.at_end(core.servers[kind].destroy)
        self.repeat(_LOOK_S, self._look)
        self.repeat(_SLOW_PERIOD_S, self._say_how_it_is)
        return core

    def disengage(self) -> None:
        """Let go of the goals; the flight goes on."""
        self.core.desk.close()

    def _limits(self, values: Mapping[str, Any]) -> Limits:
        return Limits(**{row.name: values[row.name] for row in fields(Limits)})

    def _publisher(self, core: Serving, topic: str) -> Any:
        if topic not in core.publishers:
            cls = topics.message_class(topics.BY_NAME[topic].type)
            core.publishers[topic] = self.create_publisher(cls, topic, topics.qos(topic))
        return core.publishers[topic]

    def _close_publishers(self, core: Serving) -> None:
        for publisher in core.publishers.values():
            self.destroy_publisher(publisher)

    # --- what the desk has done ------------------------------------------------------------------

    def ask(self, key: Hashable, service: str) -> None:
        """Call a service for a goal, as soon as it is there."""
        client = self.core.clients[service]
        if not client.service_is_ready():
            self.core.unasked.append((key, service))
            return
        answered = self.guarded(partial(self._on_answer, key))
        client.call_async(Trigger.Request()).add_done_callback(answered)

    def send(self, topic: str, message: Any) -> None:
        """Publish a goal's message."""
        self._publisher(self.core, topic).publish(message)

    def finish(self, key: Hashable, outcome: Outcome, code: Code, sentence: str) -> None:
        """End a goal, aloud."""
        core = self.core
        kind, handle = core.handles.pop(key)
        result = core.interfaces.result(kind, outcome, code, sentence)
        core.servers[kind].finish(handle, outcome, result)
        said = f"{kind} {outcome} ({code.name}): {sentence}"
        # rclpy ties a severity to the calling line: two lines are needed.
        if outcome == Outcome.ABORTED:
            self.get_logger().warning(said)
        else:
            self.get_logger().info(said)

    # --- from clients ----------------------------------------------------------------------------

    def _on_goal(self, kind: Kind, handle: Any) -> None:
        core, key = self.core, bytes(handle.goal_id.uuid)
        core.handles[key] = kind, handle
        self._take_newest()
        try:
            order = core.interfaces.order(kind, handle.request, core.seen.now_ns)
        except MessageError as error:
            self.finish(key, Outcome.ABORTED, Code.REFUSED, str(error))
            return
        core.desk.take(key, order)

    def _on_cancel(self, handle: Any) -> None:
        self.core.desk.cancel(bytes(handle.goal_id.uuid))

    # --- from the flight -------------------------------------------------------------------------

    def _on_answer(self, key: Hashable, future: Any) -> None:
        answer = future.result()
        self._take_newest()  # it is granted at the time that is flown now
        if answer is not None:
            self.core.desk.answered(key, answer.success, answer.message)

    def _on_odom(self, raw: bytes) -> None:
        self.core.newest = raw

    def _on_diagnostics(self, message: Any) -> None:
        core, own = self.core, self.get_namespace().strip("/")
        for status in message.status:
            facts = {pair.key: pair.value for pair in status.values}
            if status.name.rpartition("/")[0].strip("/") != own or FACT_MODE not in facts:
                continue
            if status.message == INACTIVE:
                facts[FACT_MODE] = INACTIVE
            stamp = message.header.stamp
            stamp_ns = stamp.sec * NS_PER_S + stamp.nanosec
            core.seen.told(stamp_ns, status.message, facts, time.monotonic())

    def _on_reference(self, message: Any) -> None:
        try:
            way = decode_reference(message)
        except MessageError:
            return  # the outer loop refuses it aloud
        end_ns = way.start_ns + int(way.times_ns[-1])
        self.core.desk.hear(Way(way.start_ns, end_ns, way.points[-1, REFERENCE.pos].copy()))

    def _take_newest(self) -> None:
        core, raw = self.core, self.core.newest
        core.newest = b""
        if not raw:
            return
        try:
            nav = core.odom.decode(raw)
        except MessageError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=5.0)
            return
        if np.isfinite(nav[NAV.pos]).all() and np.isfinite(nav[NAV.quat]).all():
            now = core.odom.stamp_ns, nav[NAV.pos], nav[NAV.quat], time.monotonic()
            core.desk.odom(*now)

    # --- twenty times a second -------------------------------------------------------------------

    def _look(self) -> None:
        core, wall_s = self.core, time.monotonic()
        self._take_newest()
        core.desk.look(wall_s)
        waiting, core.unasked = core.unasked, []
        for key, service in waiting:
            if key in core.handles:
                self.ask(key, service)
        if wall_s - core.told_s >= self.values["feedback_period_s"]:
            core.told_s = wall_s
            self._send_feedback()

    def _send_feedback(self) -> None:
        told = self.core.desk.feedback()
        if told is not None:
            key, kind, feedback = told
            handle = self.core.handles[key][1]
            handle.publish_feedback(self.core.interfaces.feedback(kind, feedback))

    def _say_how_it_is(self) -> None:
        """Once a second."""
        core = self.core
        self.tick = max(0, core.seen.now_ns - self.start_ns) // self.rate.tick_ns
        goals = {goal.order.kind.value: goal.stage.value for goal in core.desk.goals}
        if self.active:
            self.report(Level.OK, "takes goals", goals)

    def judge(self, values: Mapping[str, Any], changed: Collection[str]) -> Limits:
        """Other limits."""
        return self._limits(values)

    def adopt(self, judged: Limits, changed: Collection[str]) -> None:
        """They hold for the goals that are under way, too."""
        if self.configured:
            self.core.desk.limits = judged


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_actions actions`."""
    return run(ActionsNode, args)


if __name__ == "__main__":
    sys.exit(main())
