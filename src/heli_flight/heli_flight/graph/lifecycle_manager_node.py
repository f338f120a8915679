# SPDX-License-Identifier: Apache-2.0
"""Node `lifecycle_manager`: brings the nodes of an aircraft up and down together (`manager`).

What nav2_lifecycle_manager offers as one service of nav2_msgs is a std_srvs/Trigger for each
command here, and the heartbeats of its bond are what every node says in /diagnostics, once per
second of wall time at least: neither nav2_msgs nor bond is among the wheels.
"""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from heli_flight.graph.lifecycle import Lifecycle, NodeReports
from heli_flight.graph.manager import TABLE, Manager, Order, SystemCommand, SystemState
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.diagnostics import Level, NodeState
from heli_msgs_bridge.handover import Restarts
from heli_msgs_bridge.lifecycle_node import ManagedNode, NodeSpec
from heli_msgs_bridge.node_process import run
from heli_msgs_bridge.services import Later
from heli_msgs_bridge.signatures import signature_of
from heli_msgs_bridge.sources import Info, taking_info, with_info

FACT_SYSTEM = "system"
"""Key of the state of all nodes together, a name of `SystemState`."""
_LOOK_S = 0.2
_STATES = {
    SystemState.CHANGING: NodeState.WAITING,
    SystemState.RECONNECTING: NodeState.WAITING,
    SystemState.FAILED: NodeState.FAILED,
}


@dataclass
class Crew:
    """What the node has while it is configured.

    Attributes
    ----------
    lifecycle : Lifecycle
    reports : NodeReports
    manager : Manager
    restarts : Restarts
    """

    lifecycle: Lifecycle
    reports: NodeReports
    manager: Manager
    restarts: Restarts


class LifecycleManagerNode(ManagedNode[Crew, None]):
    """Active means: it takes commands for all nodes; with `autostart` the first is `startup`."""

    SPEC = NodeSpec("lifecycle_manager", "heli_flight", TABLE, "lifecycle_manager.yaml")

    def __init__(self, values: Mapping[str, Any], **options: Any) -> None:
        super().__init__(values, **options)
        # Nobody starts the manager itself: as in Nav2 the parameter speaks of its nodes.
        self._begins = self.values["autostart"]
        self.values["autostart"] = True

    def configure(self) -> Crew:
        """Make the clients, listen to what the nodes say, and what time it is for them."""
        lifecycle = Lifecycle(self, self.values["node_names"], self.guarded(self._advance))
        self.at_end(lifecycle.close)
        signature = signature_of(self.resolve_topic_name(topics.DIAGNOSTICS))
        genuine = None if signature is None else signature.is_genuine
        reports = NodeReports(self.get_namespace(), self.get_name(), genuine)
        manager = Manager(self.values, lifecycle, self._tell, partial(_reason, reports))
        self.once_configured(self._listen)
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.subscribe(topics.CLOCK, self._take_clock, newest, raw=True)
        return Crew(lifecycle, reports, manager, Restarts())

    def _listen(self) -> None:
        """Hear /diagnostics with each message's number, by which `NodeReports` knows its sender."""
        kind = topics.message_class(topics.BY_NAME[topics.DIAGNOSTICS].type)
        heard = taking_info(self.guarded(with_info(self._hear)))
        subscription = self.create_subscription(
            kind, topics.DIAGNOSTICS, heard, topics.qos(topics.DIAGNOSTICS), raw=True
        )
        self.at_end(partial(self.destroy_subscription, subscription))

    def begin(self) -> None:
        """Take commands, and begin with the first if that is wanted."""
        for command in SystemCommand:
            name = f"~/{command.value}"
            self.create_guarded_service(Trigger, name, partial(self._take_command, command))
        self.create_guarded_service(Trigger, "~/is_active", self._is_active)
        self.create_wall_timer(_LOOK_S, self._look)
        if self._begins:
            self.core.manager.give(Order(SystemCommand.STARTUP, lambda success, sentence: None))

    def _take_clock(self, raw: bytes) -> None:
        self.tick = (stamp_of(raw) - self.start_ns) // self.rate.tick_ns

    def _hear(self, raw: bytes, info: Info | None) -> None:
        if not self.configured:
            return
        core = self.core
        for name in core.reports.hear(raw, info):
            core.manager.heard(name, core.reports.statuses[name].state)

    def _advance(self) -> None:
        if self.configured:
            self.core.manager.advance()

    def _look(self) -> None:
        core = self.core
        for name in core.restarts.news():
            core.reports.forget(name)
            core.manager.restarted(name)
        core.manager.advance()

    def _take_command(self, command: SystemCommand, request: Any, response: Any) -> Any:
        later = Later()

        def answer(success: bool, sentence: str) -> None:
            response.success, response.message = success, sentence
            later.answer(response)

        try:
            self.core.manager.give(Order(command, answer))
        except ValueError as error:
            answer(False, str(error))
        return later

    def _is_active(self, request: Any, response: Any) -> Any:
        state = self.core.manager.state
        response.success, response.message = state == SystemState.ACTIVE, state.value
        return response

    def _tell(self, level: Level, sentence: str, state: SystemState) -> None:
        facts = {FACT_SYSTEM: state.value}
        self.report(level, sentence, facts, _STATES.get(state, NodeState.RUNNING))


def _reason(reports: NodeReports, name: str) -> str:
    """What a node has said of its failure."""
    status = reports.statuses.get(name)
    return status.message if status is not None and status.level > 0 else ""


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_flight lifecycle_manager`; returns the exit code."""
    return run(LifecycleManagerNode, args)


if __name__ == "__main__":
    sys.exit(main())
