# SPDX-License-Identifier: Apache-2.0
"""The life of other nodes, for who brings them up: what they are asked, and what they say.

The supervisor of a flight and the lifecycle manager of a launch are built on this.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from lifecycle_msgs.msg import State, Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from heli_core.errors import FlightError
from heli_core.ticks import TICK_NS
from heli_msgs_bridge.diagnostics import NodeState, state_of
from heli_msgs_bridge.sources import Info, PublisherLock

# -------------------------------------------------------------------------------------------------
# Which nodes have made a transition: by their answers, or by their state where one is lost.
#
# A service's answer is not sent when the asker's reader is not known yet (rmw waits 0.1 s), and
# many participants that start together on loaded cores take longer to know each other.
# -------------------------------------------------------------------------------------------------

ASK_AGAIN_S = 2.0
TRANSITIONS: Mapping[int, tuple[str, int]] = {
    Transition.TRANSITION_CONFIGURE: ("configure", State.PRIMARY_STATE_INACTIVE),
    Transition.TRANSITION_ACTIVATE: ("activate", State.PRIMARY_STATE_ACTIVE),
    Transition.TRANSITION_DEACTIVATE: ("deactivate", State.PRIMARY_STATE_INACTIVE),
    Transition.TRANSITION_CLEANUP: ("cleanup", State.PRIMARY_STATE_UNCONFIGURED),
    Transition.TRANSITION_UNCONFIGURED_SHUTDOWN: ("shutdown", State.PRIMARY_STATE_FINALIZED),
}
"""Label of a transition, and the state to which it leads."""


class BringUpError(FlightError):
    """A node did not come up or fell silent.

    Parameters
    ----------
    message : str
        A sentence that names it.
    node : str, optional
        Its name, where it may have said the reason itself.
    """

    def __init__(self, message: str, node: str = "") -> None:
        super().__init__(message)
        self.node = node


class Answers:
    """Of nodes that were asked for the same transition.

    Parameters
    ----------
    changes : mapping
        Name to the future of ChangeState.
    ask : callable
        From a name to a future of GetState.
    target : int
        Id of the state to which the transition leads; the nodes were in another one.
    now_s : callable, optional
        Wall time, s.
    """

    def __init__(
        self,
        changes: Mapping[str, Any],
        ask: Callable[[str], Any],
        target: int,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._changes, self._ask, self._target, self._now_s = changes, ask, target, now_s
        self._asked: dict[str, Any] = {}
        self._arrived: set[str] = set()
        self._due_s = now_s() + ASK_AGAIN_S

    def silent(self) -> list[str]:
        """Nodes of which nothing says yet how it went."""
        return [
            name
            for name, change in self._changes.items()
            if not change.done() and name not in self._arrived
        ]

    def complete(self) -> bool:
        """Whether all are through; asks for the state of those that are silent for long."""
        for name, state in self._asked.items():
            # Another state says nothing: the transition may not have begun.
            if state.done() and state.result().current_state.id == self._target:
                self._arrived.add(name)
        silent = self.silent()
        if silent and self._now_s() >= self._due_s:
            self._due_s = self._now_s() + ASK_AGAIN_S
            self._asked = {name: self._ask(name) for name in silent}
        return not silent

    def refused(self) -> list[str]:
        """Nodes that have answered that they did not."""
        return [
            name
            for name, change in self._changes.items()
            if change.done() and not change.result().success
        ]


class States:
    """In which states nodes are, by their answers; who is silent for long is asked again.

    Parameters
    ----------
    names : sequence of str
    ask : callable
        From a name to a future of GetState.
    now_s : callable, optional
        Wall time, s.

    Attributes
    ----------
    ids : dict of int
        Name to the id of its state, of those that have answered.
    """

    def __init__(
        self,
        names: Sequence[str],
        ask: Callable[[str], Any],
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._ask, self._now_s, self._due_s = ask, now_s, now_s() + ASK_AGAIN_S
        self._asked = {name: ask(name) for name in names}
        self.ids: dict[str, int] = {}

    def silent(self) -> list[str]:
        """Nodes that have not answered."""
        return [name for name in self._asked if name not in self.ids]

    def complete(self) -> bool:
        """Whether all have answered."""
        for name in self.silent():
            if self._asked[name].done():
                self.ids[name] = self._asked[name].result().current_state.id
        silent = self.silent()
        if silent and self._now_s() >= self._due_s:
            self._due_s = self._now_s() + ASK_AGAIN_S
            self._asked |= {name: self._ask(name) for name in silent}
        return not silent


class Lifecycle:
    """Clients of the life-cycle services of nodes.

    Parameters
    ----------
    node : Node
        Who asks; names are relative to its namespace.
    names : sequence of str
    came : callable, optional
        Called when an answer has come.
    """

    def __init__(
        self, node: Node, names: Sequence[str], came: Callable[[], None] = lambda: None
    ) -> None:
        self._node, self._came = node, came
        self._change = {n: node.create_client(ChangeState, f"{n}/change_state") for n in names}
        self._state = {n: node.create_client(GetState, f"{n}/get_state") for n in names}

    @property
    def names(self) -> list[str]:
        """Of the nodes."""
        return list(self._change)

    def missing(self) -> list[str]:
        """Nodes that cannot be told anything yet."""
        return [name for name, client in self._change.items() if not client.service_is_ready()]

    def _call(self, client: Any, request: Any) -> Any:
        future = client.call_async(request)
        future.add_done_callback(lambda _: self._came())
        return future

    def ask_state(self, name: str) -> Any:
        """Future of a node's state (GetState.Response)."""
        return self._call(self._state[name], GetState.Request())

    def begin(self, names: Sequence[str], transition_id: int) -> Answers:
        """Ask nodes for a transition of `TRANSITIONS`, all at once."""
        request = ChangeState.Request()
        request.transition.id = transition_id
        changes = {name: self._call(self._change[name], request) for name in names}
        return Answers(changes, self.ask_state, TRANSITIONS[transition_id][1])

    def close(self) -> None:
        """Take the clients out of the graph."""
        for client in (*self._change.values(), *self._state.values()):
            self._node.destroy_client(client)


# -------------------------------------------------------------------------------------------------
# What the nodes of an aircraft say in /diagnostics, which all of a ROS domain share.
# -------------------------------------------------------------------------------------------------

# Wall time after which somebody else is believed who speaks as a node; nodes repeat themselves.
_SILENT_S = 3.0


@dataclass(frozen=True)
class NodeStatus:
    """What a node last said in /diagnostics: level (0 OK to 2 ERROR), sentence, stamp, facts."""

    level: int
    message: str
    time_s: float
    facts: Mapping[str, str]

    @property
    def state(self) -> NodeState:
        """Where the node is in its life, and in the flight."""
        return state_of(self.facts, self.message)


class NodeReports:
    """What the nodes of one namespace say; who else speaks under a node's name is not believed.

    Parameters
    ----------
    namespace : str
    own_name : str
        Who listens: what is said under that name is not heard.
    is_genuine : callable, optional
        Whether serialised diagnostics are signed by a node of this graph.

    Attributes
    ----------
    statuses : dict of NodeStatus
        What each has said last.
    """

    def __init__(
        self, namespace: str, own_name: str, is_genuine: Callable[[bytes], bool] | None = None
    ) -> None:
        self._space, self._own_name, self._is_genuine = namespace.strip("/"), own_name, is_genuine
        self._locks: dict[str, PublisherLock] = {}
        self.statuses: dict[str, NodeStatus] = {}

    def forget(self, name: str) -> None:
        """A node is started again: what it has said, and by which publisher, is past."""
        self.statuses.pop(name, None)
        self._locks.pop(name, None)

    def hear(
        self, raw: bytes, info: Info | None, is_past: Callable[[str], bool] = lambda name: False
    ) -> list[str]:
        """Take a serialised DiagnosticArray; the names of those who spoke.

        Parameters
        ----------
        raw : bytes
        info : Info, optional
            Of the middleware.
        is_past : callable, optional
            Whether what a node says counts no more.
        """
        try:
            message = deserialize_message(raw, DiagnosticArray)
        except Exception:  # rclpy raises what it likes; a stranger's bytes end no flight
            return []
        stamp = message.header.stamp
        time_s = stamp.sec + 1e-9 * stamp.nanosec
        spoke = []
        for status in message.status:
            namespace, _, name = status.name.rpartition("/")
            if namespace.strip("/") != self._space or name == self._own_name or is_past(name):
                continue
            # How many speak on a topic of all says nothing of one name: it never counts as alone.
            lock = self._locks.setdefault(name, self._lock())
            if not lock.admits(raw, info):
                continue
            level = int.from_bytes(status.level, "little")
            facts = {pair.key: pair.value for pair in status.values}
            self.statuses[name] = NodeStatus(level, status.message, time_s, facts)
            spoke.append(name)
        return spoke

    def _lock(self) -> PublisherLock:
        return PublisherLock(lambda: 2, _SILENT_S, TICK_NS, is_genuine=self._is_genuine)
