# SPDX-License-Identifier: Apache-2.0
"""Base of the graph's nodes: the stages of their life, inputs and outputs."""

import contextlib
import threading
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, ClassVar, Generic, Protocol, TypeVar, cast

import numpy as np
from lifecycle_msgs.msg import Transition
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import (
    InvalidQosOverridesError,
    QosCallbackResult,
    QoSOverridingOptions,
)
from rclpy.serialization import deserialize_message

from heli_core import command_line
from heli_core.parameters import Parameter, load, stated, with_common
from heli_core.parameters import why_refused as why_refused
from heli_core.rcl_yaml import ParameterError
from heli_core.ticks import Rate, stamp_at
from heli_msgs_bridge import topics
from heli_msgs_bridge.agreement import NODES, Agreement
from heli_msgs_bridge.diagnostics import (
    FACT_DISAGREE,
    FACT_FLOOD,
    FACT_MISSING,
    REPEAT_S,
    Level,
    NodeState,
    Reporter,
    hardware_of,
    status_array,
)
from heli_msgs_bridge.handover import respawns
from heli_msgs_bridge.parameter_updates import Decision, ParameterUpdates
from heli_msgs_bridge.peers import (
    LOOK_S,
    PeerWait,
    begun_without,
    disagreeing,
    in_order,
    still_missing,
)
from heli_msgs_bridge.services import (
    ALWAYS_ANSWERED,
    Later,
    RequestLimit,
    chosen,
    descriptor,
    guard,
    not_flooded,
    ros_value,
    trigger_of,
)
from heli_msgs_bridge.signatures import signature_of, signing
from heli_msgs_bridge.sources import (
    DuplicateFilter,
    Info,
    PublisherLock,
    locked,
    taking_info,
    with_info,
)

# -------------------------------------------------------------------------------------------------
# The way of a message out of a node, which is taken some hundred times a second.
# -------------------------------------------------------------------------------------------------


class Sender(Protocol):
    """A node that keeps the last messages of each topic, where somebody wants to know."""

    sent: dict[str, deque[bytes]] | None


def publishing(node: Sender, publisher: Any, topic: str) -> Callable[[Any], None]:
    """Publish function (bytes or message) of a lifecycle publisher; bytes are signed."""
    publish_raw = publisher.handle.publish_raw
    signature = signature_of(publisher.topic_name)

    def publish(message: Any) -> None:
        # Bytes, nearly always: rclpy's own way goes through four functions, each message.
        if type(message) is bytes:
            if publisher.is_activated:
                if signature is not None:
                    message = signature.sign(message)
                publish_raw(message)
                if node.sent is not None:
                    node.sent[topic].append(message)
        else:
            publisher.publish(message)

    return publish


# -------------------------------------------------------------------------------------------------
# What a node is called, and where its parameters come from.
# -------------------------------------------------------------------------------------------------

_FILES = "heli_core"


class NodeStartError(Exception):
    """A node cannot start; the message is one line for the user."""


@dataclass(frozen=True)
class NodeSpec:
    """What a node is.

    Attributes
    ----------
    name : str
        Node name.
    package : str
        Package whose `config/` holds the default values.
    table : tuple of Parameter
        Its own parameters.
    config : str
        File name of the defaults.
    """

    name: str
    package: str
    table: tuple[Parameter, ...]
    config: str

    def full_table(self) -> tuple[Parameter, ...]:
        """Own and common parameters."""
        return with_common(self.table)

    def default_files(self) -> list[Path]:
        """Packaged YAML files, weakest first; `NodeStartError` if the installation lacks them."""
        try:
            node_file = command_line.config_folder(self.package) / self.config
            return [command_line.config_folder(_FILES) / "common.yaml", node_file]
        except command_line.MissingFileError as error:
            raise NodeStartError(str(error)) from error

    def resolve(
        self, params_files: Sequence[str] = (), rules: Sequence[str] = (), name: str = ""
    ) -> dict[str, Any]:
        """Values of all parameters; raises `ParameterError` or `NodeStartError`.

        Packaged files speak of the node by its own name, the user's by the one that it was given.
        """
        table = self.full_table()
        values = load(table, self.default_files(), self.name)
        entries = stated(table, params_files, name or self.name, rules)
        return values | {key: entry.value for key, entry in entries.items()}


# -------------------------------------------------------------------------------------------------
# Nodes that have the parameters of a table, judged when they change, and say how they are.
# -------------------------------------------------------------------------------------------------


@dataclass
class Health:
    """What a node says of itself in /diagnostics."""

    level: Level = Level.OK
    message: str = NodeState.UNCONFIGURED.value
    state: NodeState = NodeState.UNCONFIGURED
    facts: dict[str, Any] = field(default_factory=dict)


class TableNode(LifecycleNode):
    """Declares the table of its `SPEC`, and reports its health in /diagnostics.

    Attributes
    ----------
    values : dict
        Present parameter values, in the cores' form.
    start_ns : int
        Message stamp of tick 0.
    rate : Rate
        Of its ticks.
    tick : int
        Present tick, for the stamps of /diagnostics.
    health : Health
        What was reported last.
    urgent : bool
        Set where the next report is to be sent at once, whether or not its sentence changes.
    changed : dict
        Parameters that were changed since the node was built.
    decision : Decision or None
        What the change that is being set was judged to be beforehand.
    revision : int
        Counts changes of values and stages: what was judged before one must be judged again.
    """

    SPEC: ClassVar[NodeSpec]

    def __init__(self, values: Mapping[str, Any], **options: Any) -> None:
        super().__init__(self.SPEC.name, **options)
        self.values = dict(values)
        self.start_ns = stamp_at(self.values["start_time_s"])
        self.rate = Rate.of_parameters(self.values)
        self.tick = 0
        self.health = Health()
        self.urgent = False
        self.changed: dict[str, Any] = {}
        self.decision: Decision | None = None
        self.revision = 0
        self._judged: Any = None
        self._table = {row.name: row for row in self.SPEC.full_table()}
        rows: list[Any] = [
            (n, ros_value(values[n]), descriptor(row)) for n, row in self._table.items()
        ]
        self.declare_parameters("", rows, ignore_override=True)
        self.add_on_set_parameters_callback(self._validate_set)
        self.add_post_set_parameters_callback(self.apply_set)
        self._reporter = Reporter(
            signing(
                self.create_publisher(
                    topics.message_class(topics.BY_NAME[topics.DIAGNOSTICS].type),
                    topics.DIAGNOSTICS,
                    topics.qos(topics.DIAGNOSTICS),
                )
            ),
            self.get_fully_qualified_name().lstrip("/"),
            hardware_of(self.get_namespace()),
            self.rate.hz,
        )
        self.updates = ParameterUpdates(self)
        callbacks: dict[Any, Any] = {
            SetParameters: self.updates.one_by_one,
            SetParametersAtomically: self.updates.together,
        }
        for service in self.services:
            service.callback = callbacks.get(service.srv_type, service.callback)

    def prepared(self, name: str, value: Any) -> Any:
        """A value that is asked for, in words that hold at any time; called between two ticks.

        Raises
        ------
        ValueError
            With a sentence, if it cannot be understood.
        """
        return value

    def change(self, name: str, value: Any) -> SetParametersResult:
        """Set a parameter of its own, judged as any."""
        return self.set_parameters_atomically([RosParameter(name, value=value)])

    def validate(self, values: Mapping[str, Any], changed: Collection[str]) -> Any:
        """What changed parameters would make of the node; nothing may change here.

        Parameters
        ----------
        values : mapping
            All values, the changed ones put in.
        changed : collection of str
            Names of the changed ones.

        Returns
        -------
        object
            Handed to `apply` if the change comes about.

        Raises
        ------
        ValueError
            With a sentence, if the values do not fit together.
        """
        return None

    def apply(self, judged: Any, changed: Collection[str]) -> None:
        """Take over what `validate` made; `values` are the new ones. Called between two ticks."""

    # --- health ----------------------------------------------------------------------------------

    def report(
        self,
        level: Level,
        message: str,
        facts: Mapping[str, Any] | None = None,
        state: NodeState = NodeState.RUNNING,
    ) -> None:
        """Say how the node is; sent at once if it changed, else once per simulated second."""
        changed = (level, message) != (self.health.level, self.health.message)
        self.health.level, self.health.message, self.health.state = level, message, state
        if facts is not None:
            self.health.facts = dict(facts)
        if changed:
            # rclpy ties a severity to the calling line: two lines are needed.
            if level == Level.OK:
                self.get_logger().info(message)
            else:
                self.get_logger().warning(message)
        self.send_report()

    def send_report(self, repeated: bool = False) -> None:
        """Publish the status if it is due."""
        health = self.health
        if (
            repeated
            or self.urgent
            or self._reporter.is_due(self.tick, health.level, health.message, health.state)
        ):
            self.urgent = False
            facts, now_ns = {**health.facts, **self.standing_facts()}, self.now_ns()
            self._reporter.publish(
                now_ns, self.tick, health.level, health.message, facts, health.state, repeated
            )

    def standing_facts(self) -> dict[str, str]:
        """What is told besides, whatever the node says of its work."""
        return {}

    @property
    def in_transition(self) -> bool:
        """Whether it is on its way to another state: its parameters stay as they are meanwhile."""
        return False

    def now_ns(self) -> int:
        """The node's time, for the stamp of what it says of itself: that of its last tick."""
        return self.start_ns + self.tick * self.rate.tick_ns

    def repeat_report(self) -> None:
        """Say it again, if no tick has done so meanwhile."""
        if self._reporter.was_silent():
            self.send_report(repeated=True)

    # --- parameters at run time ------------------------------------------------------------------

    def changes(self, parameters: Iterable[Any]) -> dict[str, Any]:
        """Values of the table's parameters that would be others, in the cores' form."""
        known = [p for p in parameters if p.name in self._table]
        asked = {p.name: self._table[p.name].check(p.value) for p in known}
        return {n: v for n, v in asked.items() if not np.array_equal(v, self.values[n])}

    def is_settled(self, parameter: Any) -> bool:
        """Whether a parameter needs no judgement: its table refuses it, or it is in no table."""
        name, value = parameter.name, parameter.value
        return name not in self._table or bool(why_refused(self._table.values(), name, value))

    def _validate_set(self, parameters: list[Any]) -> SetParametersResult:
        """Answer of the node to a change that is asked for; the change itself is `apply_set`."""
        for parameter in parameters:
            reason = why_refused(self._table.values(), parameter.name, parameter.value)
            if reason:
                return SetParametersResult(successful=False, reason=reason)
        changes = self.changes(parameters)
        if not changes:
            return SetParametersResult(successful=True)
        try:
            # Kept for `apply_set`, which rclpy calls next, if at all: the node is as it was.
            if self.decision is None:
                self._judged = self.validate({**self.values, **changes}, changes.keys())
            elif self.decision.refusal is not None:
                raise self.decision.refusal
            else:
                self._judged = self.decision.judged
        except ValueError as error:
            return SetParametersResult(successful=False, reason=" ".join(str(error).split()))
        return SetParametersResult(successful=True)

    def apply_set(self, parameters: list[Any]) -> None:
        """Take over a change that was judged."""
        changes = self.changes(parameters)
        if changes:
            self.values.update(changes)
            self.changed.update(changes)
            self.revision += 1
            self.apply(self._judged, changes.keys())


# -------------------------------------------------------------------------------------------------
# Managed node.
# -------------------------------------------------------------------------------------------------

_REPEATED_TICKS = 400
"""Real time: of so many ticks a sender repeats its messages to who is started again."""
_SUCCESS, _FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
_ERROR = TransitionCallbackReturn.ERROR
_REFUSALS = (
    NodeStartError, ParameterError, ValueError, LookupError, OSError, InvalidQosOverridesError,
)  # fmt: skip
_ONE_BUILDS = threading.Lock()
"""Of several nodes in one process: numba compiles one kernel at a time."""


def _judge_overrides(profile: QoSProfile, lockstep: bool) -> QosCallbackResult:
    """Refuse a QoS of the user's under which lockstep would wait for what is lost."""
    lossy = profile.reliability == ReliabilityPolicy.BEST_EFFORT
    judged = QosCallbackResult()
    judged.successful = not (lockstep and lossy)
    judged.reason = "" if judged.successful else "lockstep needs reliability: reliable"
    return judged


def _nothing() -> None:
    """What is left of a stage that has not begun."""


Core = TypeVar("Core")
"""Data of a node while it is configured."""
Run = TypeVar("Run")
"""Data of a node while it is active."""


class ManagedNode(TableNode, ABC, Generic[Core, Run]):
    """A lifecycle node with the parameters of its table, which reports failures in sentences.

    Its life has three stages, each with data of its own:

    - built: `values`, until the process ends;
    - configured: `core`, made by `configure`, given back by `release`;
    - active: `run`, made by `engage` when its peers listen, gone after `disengage`.

    It answers in all of them, and between them: `configure` runs in a thread of its own where the
    executor runs, so it subscribes by `subscribe` alone, or in `once_configured`; and who waits for
    its peers looks for them now and then.

    Sub-classes set `SPEC`, implement `configure`, and of the other hooks what they need.
    Publishers, subscriptions and timers made by `create_topic_publisher`, `subscribe` and
    `create_wall_timer` end with the stage in which they were made, as does whatever is handed to
    `at_end`.

    Attributes
    ----------
    failure : str
        Why the last transition failed; empty if it did not.
    not_started : bool
        Whether it could not configure or activate itself; the process then ends with code 2.
    missing : frozenset of str
        Peers without which it has begun, and that do not listen yet.
    finished : bool
        Set by a node whose work is done; the process then ends with `exit_code`.
    exit_code : int
        0, or 1 if what the node did came to a bad end.
    crash : Exception or None
        What a callback raised; the process then ends with code 1.
    requests : RequestLimit
        The service calls that are answered while it is active.
    respawns : bool
        Whether nodes that die are started again.
    sent : dict or None
        Per topic the last messages that were sent, where somebody wants to know.
    agreement : Agreement
        What peers say of what all must agree on.
    asked_to_end : callable
        Whether the process has been sent a signal.
    notify_end : callable
        Called when the node has finished or crashed.
    """

    PATIENCE_S: ClassVar[float] = 0.0
    """Wall time for which what comes may wait: a node for which nobody waits lets the others go
    first, and takes many messages at once."""

    def __init__(self, values: Mapping[str, Any], **options: Any) -> None:
        super().__init__(values, **options)
        self.failure, self.finished, self.exit_code, self.respawns = "", False, 0, respawns()
        self.sent: dict[str, deque[bytes]] | None = None
        self.crash: Exception | None = None
        self.asked_to_end: Callable[[], bool] = lambda: False
        self.notify_end: Callable[[], None] = lambda: None
        self.outputs: dict[str, Any] = {}
        self.not_started, self.missing = False, frozenset[str]()
        self._core: Core | None = None
        self._run: Run | None = None
        self._active = False
        self._wait: PeerWait | None = None
        self._looks: Any = None
        self._building: threading.Thread | None = None
        self._ends: list[ExitStack] = []
        self._waiting: list[Callable[[], None]] = []
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(REPEAT_S, self.guarded(self.repeat_report), clock=steady)
        self._service_change_state.callback = self._change_state
        self.requests = RequestLimit(lambda: self.active, self.get_logger().warning)
        for service in self.services:
            limited = service.srv_type not in ALWAYS_ANSWERED
            guard(service, self.requests.warn, self.requests.flooded if limited else not_flooded)
        self.agreement = Agreement(self.SPEC.name, self.values)
        self._terms: dict[str, str] = {}
        self._tell_terms: Callable[[], None] = _nothing
        if self.SPEC.name in NODES:
            self._agree()

    # --- for sub-classes to implement ----------------------------------------------------------

    @abstractmethod
    def configure(self) -> Core:
        """Build the core, publishers and subscriptions from `values`; may raise."""

    def engage(self) -> Run:
        """Make the data of the active stage, when the peers are connected; may raise."""
        return cast(Run, None)

    def begin(self) -> None:
        """First action of the active stage, whose data are there now; may raise."""

    def disengage(self) -> None:
        """Last action of the active stage."""

    def release(self) -> None:
        """Last action of the configured stage, also when the process ends in it."""

    def expected_listeners(self, topic: str) -> set[str]:
        """Nodes that must listen to a topic before the flight starts."""
        if topic not in topics.BY_NAME:
            return set()
        peers = set(self.values["peers"]) - {self.SPEC.name}
        expected = peers.intersection(topics.BY_NAME[topic].sinks)
        recorded = topic not in self.values["unrecorded"]
        return expected | (peers & {"recorder"} if recorded else set())

    def awaited_links(self) -> Mapping[str, Collection[str]]:
        """Topics of others whose listeners must be ready, too, before the flight starts."""
        return {}

    # --- what all must agree on ------------------------------------------------------------------

    def _agree(self) -> None:
        """Tell what others must agree on, to those who come later, too; hear what they tell."""
        kind, qos = topics.message_class(topics.BY_NAME[topics.AGREEMENT].type), topics.AGREEMENT
        publisher = signing(self.create_publisher(kind, topics.AGREEMENT, topics.qos(qos)))
        name = self.get_fully_qualified_name().lstrip("/")

        def tell() -> None:
            if (terms := self.agreement.own) != self._terms:
                self._terms = terms
                array = status_array(
                    self.now_ns(), name, hardware_of(self.get_namespace()), self.SPEC.name, terms
                )
                publisher.publish(array)

        self._tell_terms = tell
        tell()
        signature = signature_of(self.resolve_topic_name(topics.AGREEMENT))

        def hear(raw: bytes) -> None:
            if signature is None or signature.is_genuine(raw):
                self._hear_terms(deserialize_message(raw, kind))

        self.create_subscription(
            kind, topics.AGREEMENT, self.guarded(hear), topics.qos(qos), raw=True
        )

    def _hear_terms(self, message: Any) -> None:
        before = disagreeing(self.agreement.broken)
        for status in message.status:
            told = {pair.key: pair.value for pair in status.values}
            name = status.name.rpartition("/")[2]
            if name != self.get_name():
                self.agreement.hear(name, status.message, told)
        self.judge_peers()
        now = disagreeing(self.agreement.broken)
        if now and now != before:
            self.get_logger().warning(f"not flown with {now}")

    def judge_peers(self) -> None:
        """Look whose messages are used: peers have told what must be agreed on, or have left."""

    def apply_set(self, parameters: list[Any]) -> None:
        """Take over a change that was judged, and tell it to those who must agree on it."""
        super().apply_set(parameters)
        self._tell_terms()
        self.agreement.judge()
        self.judge_peers()

    # --- the process ---------------------------------------------------------------------------

    def leaving(self) -> bool:
        """Whether the process was asked to end: who waits gives up."""
        return self.asked_to_end() or not self.context.ok()

    # --- stages --------------------------------------------------------------------------------

    @property
    def configured(self) -> bool:
        """True from configuration to clean-up."""
        return self._core is not None

    @property
    def active(self) -> bool:
        """True while it takes part: from activation, or the end of its wait for peers, to
        deactivation."""
        return self._active

    @property
    def in_transition(self) -> bool:
        """Whether it is being configured in a thread of its own."""
        return self._building is not None

    @property
    def core(self) -> Core:
        """Data of the configured stage; RuntimeError outside of it."""
        if self._core is None:
            raise RuntimeError(f"{self.SPEC.name} is not configured")
        return self._core

    @property
    def run(self) -> Run:
        """Data of the active stage; RuntimeError outside of it."""
        if not self._active:
            raise RuntimeError(f"{self.SPEC.name} is not active")
        return cast(Run, self._run)

    def at_end(self, action: Callable[[], Any]) -> None:
        """Call this when the present stage ends, in the reverse order; also if it fails to begin.

        It is also called at the end of the process, when ROS may have ended.
        """
        self._ends[-1].callback(action)

    # --- publishers, subscriptions, timers, peers ----------------------------------------------

    def create_topic_publisher(self, topic: str) -> Callable[[Any], None]:
        """Lifecycle publisher of a graph topic; returns its publish function (bytes or message)."""
        row = topics.KNOWN[topic]
        cls = topics.message_class(row.type)
        again = self.respawns and bool(row.every_ticks or row.replaces)
        kept = topics.qos(topic, self._history(), again)
        publisher = self.create_lifecycle_publisher(cls, topic, kept)
        self.outputs[topic] = publisher

        def end() -> None:
            del self.outputs[topic]
            self.destroy_lifecycle_publisher(publisher)

        self.at_end(end)
        return publishing(self, publisher, topic)

    def _history(self) -> int:
        """How many messages of a stream are kept; where they are repeated, what is soon flown."""
        paced = self.respawns and not self.values["lockstep"]
        depth = topics.DEPTH if self.respawns else topics.UNHEARD
        return self.rate.of(_REPEATED_TICKS) if paced else depth

    def subscribe(
        self,
        topic: str,
        callback: Callable[[Any], Any],
        qos: Any = None,
        raw: bool = False,
        owner: PublisherLock | None = None,
        ignored: Callable[[], None] | None = None,
    ) -> None:
        """Subscribe to a graph topic; `raw` for the serialised messages.

        What `configure` asks for is done when it has succeeded: who listens is ready. Without a QoS
        of its own, senders of default QoS are heard and the last message of latched ones; of a
        stream the user's `qos_overrides.<topic>.subscription.*` count then. With an owner (for
        `raw`) only its messages are; `ignored` is called for those of others.
        """
        cls = topics.message_class(topics.BY_NAME[topic].type)
        lockstep = self.values["lockstep"]
        profiles = topics.qos_to_hear(topic, lockstep=lockstep) if qos is None else (qos,)
        overriding = self.qos_overriding(topic) if qos is None else None
        once = DuplicateFilter()

        def listen() -> None:
            call = self.guarded(callback)

            def hear_once(message: Any, info: Info | None) -> None:
                if once.is_new(info):
                    call(message)

            heard = with_info(hear_once) if len(profiles) > 1 else call
            if owner is not None:
                heard = taking_info(self.guarded(locked(owner, callback, ignored)))
            for profile in profiles:
                subscription = self.create_subscription(
                    cls, topic, heard, profile, raw=raw, qos_overriding_options=overriding
                )
                self.at_end(partial(self.destroy_subscription, subscription))

        self.once_configured(listen)

    def once_configured(self, action: Callable[[], None]) -> None:
        """Do this when `configure` has succeeded, in the executor's thread; now, if it has."""
        if self.configured:
            action()
        else:
            self._waiting.append(action)

    def qos_overriding(self, topic: str) -> QoSOverridingOptions | None:
        """That a user's `qos_overrides.<topic>.subscription.*` count, of a stream of the graph."""
        if topic not in topics.BY_NAME or not topics.BY_NAME[topic].every_ticks:
            return None
        judge = partial(_judge_overrides, lockstep=self.values["lockstep"])
        return QoSOverridingOptions.with_default_policies(callback=judge)

    def create_guarded_service(
        self, kind: Any, name: str, answer: Callable[[Any, Any], Any]
    ) -> None:
        """Answer a service; an exception is a refusal and ends no node (`services.guard`)."""
        service = self.create_service(kind, name, answer)
        guard(service, self.requests.warn, self.requests.flooded)
        self.at_end(partial(self.destroy_service, service))

    def standing_facts(self) -> dict[str, str]:
        """How many requests came too often, if any did; who is waited for or missed."""
        flood = self.requests.summary()
        missing = in_order(self.missing if self._wait is None else self._wait.missing)
        broken = disagreeing(self.agreement.broken)
        facts = {FACT_FLOOD: flood, FACT_MISSING: missing, FACT_DISAGREE: broken}
        return {key: text for key, text in facts.items() if text}

    def create_wall_timer(self, period_s: float, callback: Callable[[], None]) -> Any:
        """Call this every so many seconds of wall time; returns the timer."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        timer = self.create_timer(period_s, self.guarded(callback), clock=steady)
        self.at_end(lambda: self.destroy_timer(timer))
        return timer

    def guarded(self, callback: Callable[..., None]) -> Callable[..., None]:
        """The callback, whose exception ends the process in one line instead of a trace.

        It is called as long as the present stage lasts, if any: what comes late is nobody's, and
        before all of it has been built there is nothing to do.
        """
        stage = self._ends[-1] if self._ends else None

        def call(*args: Any) -> None:
            lasts = stage is None or (stage in self._ends and not self.in_transition)
            if self.crash is None and lasts:
                try:
                    callback(*args)
                except Exception as error:
                    self.crash = error
                if self.finished or self.crash is not None:
                    self.notify_end()

        return call

    # --- lifecycle ---------------------------------------------------------------------------

    def _transition(self, action: Callable[[], None], to: NodeState) -> TransitionCallbackReturn:
        """Run a transition's work; a refusal becomes a sentence and FAILURE."""
        self.failure = ""
        self.revision += 1
        try:
            action()
        except _REFUSALS as error:
            self.failure = " ".join(str(error).split())
            self.report(Level.ERROR, self.failure, state=NodeState.FAILED)
            return _FAILURE
        except ExternalShutdownException:
            self.failure = "asked to end while starting"
            return _FAILURE
        except Exception as error:
            self.failure = f"{type(error).__name__}: {error}"
            self.report(Level.ERROR, self.failure, state=NodeState.FAILED)
            return _FAILURE
        if self._wait is not None:
            self.report(Level.OK, self._wait.sentence, state=NodeState.WAITING)
        elif self.missing and to == NodeState.ACTIVE:
            self.report(Level.WARN, begun_without(self.missing), state=to)
        else:
            self.report(Level.OK, to.value, state=to)
        return _SUCCESS

    def _change_state(self, request: Any, response: Any) -> Any:
        """Service callback: a transition that is not possible is refused, with the reason."""
        machine = self._state_machine
        between = self.in_transition
        transitions = () if between else machine.available_transitions
        possible = {label: number for number, label, *_ in transitions}
        self.failure = ""
        try:
            number = chosen(request.transition, possible, machine.current_state[1])
        except ValueError as error:
            self.failure = str(error)
            self.get_logger().warning(f"refused: {error}")
            response.success = False
            return response
        if number != Transition.TRANSITION_CONFIGURE:
            response.success = trigger_of(self, number)() == _SUCCESS
            return response
        later = Later()

        def answer(result: TransitionCallbackReturn) -> None:
            response.success = result == _SUCCESS
            later.answer(response)

        self._configure_beside(answer)
        return later

    def start_itself(self) -> None:
        """Configure, then activate; called once the executor serves this node."""

        def activate(configured: TransitionCallbackReturn) -> None:
            done = configured == _SUCCESS and not self.leaving()
            if not done or self.trigger_activate() != _SUCCESS:
                self.not_started = True
                self.notify_end()

        self._configure_beside(activate)

    def _build(self) -> Core:
        """Build everything from the present parameters."""
        self._ends.append(ExitStack())
        self._waiting.clear()
        return self.configure()

    def _built(self, core: Core) -> None:
        """Be configured: listen to what comes."""
        self._core = core
        for action in self._waiting:
            action()

    def _configure_beside(self, then: Callable[[TransitionCallbackReturn], None]) -> None:
        """Configure in a thread of its own; `then` is called in the executor's.

        Meanwhile the state is `configuring`, and everything but a transition is answered.
        """
        machine, made = self._state_machine, list[Core]()
        failed: list[Exception] = []
        machine.trigger_transition_by_id(Transition.TRANSITION_CONFIGURE, True)

        def build() -> None:
            with _ONE_BUILDS:
                try:
                    made.append(self._build())
                except Exception as error:
                    failed.append(error)
            # While the process ends nobody waits for it.
            if (executor := self.executor) is not None:
                with contextlib.suppress(Exception):
                    executor.create_task(finish)

        def take() -> None:
            if failed:
                raise failed[0]
            self._built(made[0])

        def finish() -> None:
            self._building = None
            result = self._take_configured(take)
            machine.trigger_transition_by_label(result.to_label(), True)
            then(result)
            self.updates.go_on()

        self._building = threading.Thread(target=build, name="configure", daemon=True)
        self._building.start()

    def _take_configured(self, take: Callable[[], None]) -> TransitionCallbackReturn:
        result = self._transition(take, NodeState.CONFIGURED)
        if result != _SUCCESS:
            self._leave_configured()
        return result

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: build everything from the present parameters."""
        return self._take_configured(lambda: self._built(self._build()))

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: take part, at once or when the peers listen."""

        def action() -> None:
            self._ends.append(ExitStack())
            self._wait = PeerWait(self)
            if self._wait.over():
                self._take_part()
            else:
                self._looks = self.create_wall_timer(LOOK_S, self._look_for_peers)

        result = self._transition(action, NodeState.ACTIVE)
        if result != _SUCCESS:
            self._let_go(state)
        return result

    def _look_for_peers(self) -> None:
        """Take part if the wait is over; if that fails, be inactive, and say why."""
        wait = self._wait
        if wait is None or self.leaving():
            return
        if wait.over():
            self.destroy_timer(self._looks)
            if self._transition(self._take_part, NodeState.ACTIVE) != _SUCCESS:
                failure = self.failure
                self.trigger_deactivate()
                self.failure, self.not_started = failure, bool(self.values["autostart"])
                self.report(Level.ERROR, failure, state=NodeState.FAILED)
                self.notify_end()
        elif wait.sentence:
            self.report(Level.OK, wait.sentence, state=NodeState.WAITING)

    def _take_part(self) -> None:
        """The wait is over: send, and begin."""
        assert self._wait is not None
        self.missing, self._wait = self._wait.missing, None
        if self.missing:
            self.create_wall_timer(REPEAT_S, self._look_for_missing)
        LifecycleNode.on_activate(self, self._lifecycle_state())
        self._run = self.engage()
        self._active = True
        self.begin()

    def _look_for_missing(self) -> None:
        """Of the peers without which it has begun, note who has come."""
        if self.missing and not self.leaving():
            self.missing = still_missing(self, self.missing)

    def _lifecycle_state(self) -> LifecycleState:
        number, label = self._state_machine.current_state
        return LifecycleState(label=label, state_id=number)

    def _let_go(self, state: LifecycleState) -> None:
        """Leave the active stage, whose beginning has failed."""
        if self._active:
            self.disengage()
        self._leave_active()
        LifecycleNode.on_deactivate(self, state)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: stop sending. It cannot fail: an error ends in `on_error`."""
        engaged, self._wait = self._active, None
        result = self._transition(self.disengage if engaged else _nothing, NodeState.INACTIVE)
        self._leave_active()
        LifecycleNode.on_deactivate(self, state)
        return _SUCCESS if result == _SUCCESS else _ERROR

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: forget what was built. An error ends in `on_error`."""
        result = self._transition(self.release, NodeState.UNCONFIGURED)
        self._leave_configured()
        return _SUCCESS if result == _SUCCESS else _ERROR

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: everything is given back, then the process ends."""
        self.finished = True
        self.notify_end()
        if self._active or self._wait is not None:
            self.on_deactivate(state)
        if self.configured:
            self.on_cleanup(state)
        return _SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: a transition has failed half-way; the node is unconfigured again."""
        failure = self.failure
        if self._active:
            self._leave_active()
        if self.configured:
            self._transition(self.release, NodeState.UNCONFIGURED)
            self._leave_configured()
        self.failure = failure
        self.report(Level.ERROR, failure, state=NodeState.FAILED)
        return _SUCCESS

    def _leave_active(self) -> None:
        self._active, self._run, self._wait = False, None, None
        self.missing = frozenset()
        self._ends.pop().close()

    def _leave_configured(self) -> None:
        self._core = None
        self._ends.pop().close()

    def end(self) -> None:
        """The process ends, in whatever stage: last words, and everything is given back."""
        if self._building is not None:
            self._building.join()
        try:
            if self.configured:
                self.release()
        finally:
            self._active, self._run, self._wait = False, None, None
            while self._ends:
                self._ends.pop().close()
            # rclpy forgets it, and it holds the node: Fast DDS would leave its shared memory.
            self._state_machine.destroy_when_not_in_use()
            self._core = None
