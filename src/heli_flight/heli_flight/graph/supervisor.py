# SPDX-License-Identifier: Apache-2.0
"""The supervisor: publishes the reference, brings the nodes up in order, watches the flight.

It waits for events (a service that appears, a transition that is confirmed, the plant's final
word), never for time; limits are only there to name who is silent.
"""

import contextlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import Transition
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from trajectory_msgs.msg import MultiDOFJointTrajectory

from heli_core.ticks import NS_PER_S, TICK_NS
from heli_flight.graph.lifecycle import (
    TRANSITIONS,
    BringUpError,
    Lifecycle,
    NodeReports,
    NodeStatus,
)
from heli_flight.scenario import NODE_NAME, Scenario
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.command_messages import encode_reference
from heli_msgs_bridge.diagnostics import FACT_MISSING, Level, NodeState, Reporter, hardware_of
from heli_msgs_bridge.node_process import outlasts_set_clock, wait_for_dds_shutdown
from heli_msgs_bridge.signatures import signature_of, signing
from heli_msgs_bridge.sources import (
    NOT_YET_NAMED,
    SENDER_FIELDS,
    Info,
    TopicSenders,
    full_name,
    senders_of,
    with_info,
)

# A node's name comes by a topic of its own, which DDS may have to repeat (heartbeats of 3 s).
_NAME_LIMIT_S = 5.0
# How long a node that refused may need to say why.
_REASON_LIMIT_S = 10.0
DEAF = "deaf"
"""Key of the sentence that the recorder did not answer at the end."""
_LOOP = ("observer", "inner_loop", "outer_loop")
# States in which a node that was activated does not take part yet; None: it has not spoken.
_BEFORE = (None, NodeState.CONFIGURED, NodeState.INACTIVE, NodeState.WAITING)


class Supervisor(Node):
    """Node `scenario`: latched reference, life cycle of the others, last diagnostics of each.

    Parameters
    ----------
    managed : sequence of str
        Names of the managed nodes, relative to this node's namespace.
    namespace : str
        Of this node, empty for none.
    key : Path, optional
        File with the key that the nodes sign their messages with.
    """

    def __init__(
        self,
        managed: Sequence[str],
        namespace: str = "",
        context: rclpy.Context | None = None,
        key: Path | None = None,
    ):
        self._key = key
        super().__init__(NODE_NAME, namespace=namespace, context=context)
        self._executor = SingleThreadedExecutor(context=context)
        self._executor.add_node(self)
        self._ends = contextlib.ExitStack()
        self._ends.enter_context(outlasts_set_clock(self._executor))
        self._lifecycle = Lifecycle(self, managed)
        self._reference = self.create_publisher(
            MultiDOFJointTrajectory, topics.REFERENCE, topics.qos(topics.REFERENCE)
        )
        signature = signature_of(self.resolve_topic_name(topics.DIAGNOSTICS), key)
        genuine = None if signature is None else signature.is_genuine
        self._reports = NodeReports(self.get_namespace(), NODE_NAME, genuine)
        self.statuses = self._reports.statuses
        self._start_ns = self._now_ns = 0
        self._reporter: Reporter | None = None
        self.create_subscription(
            DiagnosticArray,
            topics.DIAGNOSTICS,
            with_info(self._on_diagnostics),
            topics.qos(topics.DIAGNOSTICS),
            raw=True,
        )

    def watch_time(self, start_ns: int) -> None:
        """Hear the flight's clock, for `flight_s`, and be ready to `announce`.

        Parameters
        ----------
        start_ns : int
            Stamp of flight time 0.
        """
        self._start_ns = self._now_ns = start_ns
        clock = topics.message_class(topics.BY_NAME[topics.CLOCK].type)
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.create_subscription(clock, topics.CLOCK, self._on_clock, newest, raw=True)
        sender = self.create_publisher(
            DiagnosticArray, topics.DIAGNOSTICS, topics.qos(topics.DIAGNOSTICS)
        )
        name = self.get_fully_qualified_name().lstrip("/")
        self._reporter = Reporter(
            signing(sender, self._key), name, hardware_of(self.get_namespace())
        )

    def _on_clock(self, raw: bytes) -> None:
        self._now_ns = stamp_of(raw)

    def flight_s(self) -> float:
        """Flight time, s, as far as it was heard."""
        return (self._now_ns - self._start_ns) / NS_PER_S

    def announce(self, level: Level, message: str, facts: Mapping[str, str]) -> None:
        """Say something in /diagnostics."""
        assert self._reporter is not None, "watch_time comes first"
        tick = (self._now_ns - self._start_ns) // TICK_NS
        self._reporter.publish(self._now_ns, tick, level, message, facts)

    def forget(self, name: str) -> None:
        """A node is started again: what it has said, and by which publisher, is past."""
        self._reports.forget(name)

    def _on_diagnostics(self, raw: bytes, info: Info | None) -> None:
        """Keep what nodes of this aircraft say; /diagnostics is shared by all of a ROS domain.

        Who else speaks under a node's name is not believed: one word "over" would end the flight.
        """
        self._reports.hear(raw, info, self._is_past)

    def _is_past(self, name: str) -> bool:
        """Whether the flight is over for a node: that the plant is silent then is no news."""
        plant = self.statuses.get("plant")
        return name in _LOOP and plant is not None and plant.facts.get("over") == "true"

    def wait_until(
        self, event: Callable[[], bool], limit_s: float, check: Callable[[], None]
    ) -> bool:
        """Spin until event() holds; False when limit_s of wall time has gone. check() may raise."""
        deadline = time.monotonic() + limit_s
        while not event():
            check()
            left = deadline - time.monotonic()
            if left <= 0.0:
                return False
            self._executor.spin_once(timeout_sec=min(left, 0.05))
        return True

    def wait_for_services(self, limit_s: float, check: Callable[[], None]) -> None:
        """Wait until every managed node can be told to change its state.

        Raises
        ------
        BringUpError
            Names the nodes that did not appear.
        """

        missing = self._lifecycle.missing
        if not self.wait_until(lambda: not missing(), limit_s, check):
            raise BringUpError(f"no life-cycle service of {', '.join(missing())} in {limit_s:g} s")

    def refuse_doubles(self) -> None:
        """Raise BringUpError if another graph with the same names flies in this ROS domain."""
        names = [f"{ns.rstrip('/')}/{n}" for n, ns in self.get_node_names_and_namespaces()]
        full_names = {
            f"{self.get_namespace().rstrip('/')}/{name}" for name in self._lifecycle.names
        }
        for name in sorted(full_names):
            if names.count(name) > 1:
                raise BringUpError(
                    f"another node {name} is in this ROS domain; set ROS_DOMAIN_ID to a free one"
                )

    def _stranger(self) -> tuple[str, str] | None:
        """Name of a node that sends on a stream of this aircraft but is none of it; the stream."""
        space = self.get_namespace()
        for topic in topics.TABLE:
            if not topic.every_ticks or topic.name.startswith("/"):
                continue
            sources = {(space, name) for name in topic.source}
            for sender in senders_of(self, topic.name):
                if sender not in sources:
                    return full_name(sender), topic.name
        return None

    def refuse_strangers(self, check: Callable[[], None]) -> None:
        """Raise BringUpError if somebody else sends on a stream of this aircraft.

        Who sends first is flown, so a flight must not begin with a stranger. A node's name comes
        after its publishers: it is waited for, and one of our own is no stranger then.
        """

        def named() -> bool:
            stranger = self._stranger()
            return stranger is None or stranger[0] != NOT_YET_NAMED

        self.wait_until(named, _NAME_LIMIT_S, check)
        if (stranger := self._stranger()) is not None:
            raise BringUpError(
                f"{stranger[0]} sends on '{stranger[1]}' of this flight; "
                "end it or set ROS_DOMAIN_ID to a free one"
            )

    def name_senders(self, check: Callable[[], None]) -> None:
        """In what nodes have said of a topic's senders, put the names that are known only now."""

        def unnamed() -> list[tuple[str, TopicSenders]]:
            reports = []
            for node, status in self.statuses.items():
                for key, text in status.facts.items():
                    # Without a key it may be a stranger's: what is no such fields names nobody.
                    with contextlib.suppress(ValueError):
                        if key.startswith(SENDER_FIELDS):
                            reports.append((node, TopicSenders.read(text)))
            return [(node, senders) for node, senders in reports if NOT_YET_NAMED in senders.names]

        def known(topic: str) -> list[tuple[str, str]]:
            return senders_of(self, topic)

        def named() -> bool:
            topics_of = (senders.topic for _, senders in unnamed())
            return all(NOT_YET_NAMED not in map(full_name, known(topic)) for topic in topics_of)

        self.wait_until(named, _NAME_LIMIT_S, check)
        for node, report in unnamed():
            # Not the node itself, and of one that was started again not its predecessor too.
            itself = (self.get_namespace(), node)
            status, senders = self.statuses[node], sorted(set(known(report.topic)) - {itself})
            if len(senders) < 2:
                # Whom it was about has left without a name.
                continue
            facts = replace(report, names=tuple(map(full_name, senders))).facts()
            self.statuses[node] = replace(status, facts={**status.facts, **facts})

    def publish_reference(self, scenario: Scenario, start_ns: int) -> None:
        """Publish the scenario's reference, latched; start_ns is the stamp of flight time 0."""
        trajectory = replace(scenario.reference, start_ns=start_ns)
        self._reference.publish(encode_reference(trajectory, self.get_namespace()))

    def transition(
        self, names: Sequence[str], transition_id: int, limit_s: float, check: Callable[[], None]
    ) -> None:
        """Change the state of nodes together and wait for every confirmation.

        Raises
        ------
        BringUpError
            Names the node that refused or did not answer.
        """
        label, _ = TRANSITIONS[transition_id]
        answers = self._lifecycle.begin(names, transition_id)
        if not self.wait_until(answers.complete, limit_s, check):
            silent = answers.silent()
            sentence = f"{', '.join(silent)}: no answer to '{label}' in {limit_s:g} s"
            raise BringUpError(sentence, next(iter(silent), ""))
        if refused := answers.refused():
            # One refuses for a reason of its own, which it logs; several were not ours to ask.
            hint = "; another flight may be in this ROS domain: end it or set ROS_DOMAIN_ID to a "
            more = f"{hint}free one" if len(refused) > 1 else ""
            if not more:
                # Why comes by /diagnostics, later than the answer at times; it is repeated.
                self.wait_until(lambda: self._has_failed(refused[0]), _REASON_LIMIT_S, check)
            raise BringUpError(f"{', '.join(refused)}: refused to {label}{more}", refused[0])

    def wait_for_peers(
        self, names: Sequence[str], limit_s: float, check: Callable[[], None]
    ) -> None:
        """Wait until nodes that are active take part: all who must hear them listen.

        Raises
        ------
        BringUpError
            Names the node that waits, has begun without a peer, or has failed, and says why.
        """

        def waits() -> list[str]:
            return [name for name in names if self._state_of(name) in _BEFORE]

        def decided() -> bool:
            return not waits() or any(map(self._has_failed, names))

        if not self.wait_until(decided, limit_s, check):
            name = waits()[0]
            said = self.statuses[name].message if name in self.statuses else "silent"
            raise BringUpError(f"{name}: {said}, after {limit_s:g} s")
        for name in names:
            status = self.statuses.get(name)
            if self._has_failed(name) or (status and FACT_MISSING in status.facts):
                raise BringUpError(f"{name}: did not begin as it should", name)

    def _state_of(self, name: str) -> NodeState | None:
        status = self.statuses.get(name)
        return None if status is None else status.state

    def close_bag(self, limit_s: float) -> None:
        """Deactivate the recorder: what has reached it is in the bag once it has confirmed.

        For one that does not answer, whom its signal ends like all others, `DEAF` is told.
        """
        try:
            self.transition(["recorder"], Transition.TRANSITION_DEACTIVATE, limit_s, lambda: None)
        except BringUpError as error:
            sentence = f"{error}; what it did not hear is not in the bag"
            self.statuses["recorder"] = NodeStatus(Level.OK, "", math.nan, {DEAF: sentence})
            return
        # Its last word, of gaps perhaps, comes by another way than the confirmation.
        self.wait_until(self._has_last_word, limit_s, lambda: None)

    def _has_failed(self, name: str) -> bool:
        return self._state_of(name) == NodeState.FAILED

    def _has_last_word(self) -> bool:
        status = self.statuses.get("recorder")
        ends = (NodeState.INACTIVE, NodeState.FAILED)
        return status is not None and (status.level > 0 or status.state in ends)

    def close(self) -> None:
        """Take the node out of the graph."""
        wait_for_dds_shutdown(self)
        self._ends.close()
        self._executor.remove_node(self)
        self._executor.shutdown(timeout_sec=0.5)
        self.destroy_node()
