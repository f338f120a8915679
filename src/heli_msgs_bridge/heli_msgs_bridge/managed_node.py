# SPDX-License-Identifier: Apache-2.0
"""Base of the graph's nodes: the stages of their life, parameters, peers, diagnostics."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterable, Mapping
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar, Generic, TypeVar, cast

from lifecycle_msgs.msg import Transition
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from heli_math.ticks import TICK_NS, stamp_at
from heli_msgs_bridge import topics
from heli_msgs_bridge.arrivals import Info, Once, Owner, with_info
from heli_msgs_bridge.descriptors import descriptor, ros_value
from heli_msgs_bridge.diagnostics import REPEAT_S, Level, Reporter, hardware_of
from heli_msgs_bridge.judging import Judging, Verdict
from heli_msgs_bridge.node_spec import NodeSpec, StartError
from heli_msgs_bridge.peers import wait_for_peers
from heli_msgs_bridge.services import chosen, guard
from heli_parameters.parameters import ParameterError
from heli_parameters.parameters import judge as why_refused

INACTIVE = "inactive"
"""What a node says when it has been deactivated."""
_SUCCESS, _FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
_ERROR = TransitionCallbackReturn.ERROR

Core = TypeVar("Core")
"""Data of a node while it is configured."""
Run = TypeVar("Run")
"""Data of a node while it is active."""


@dataclass
class Health:
    """What a node says of itself in /diagnostics."""

    level: Level = Level.OK
    message: str = "unconfigured"
    facts: dict[str, Any] = field(default_factory=dict)


class ManagedNode(LifecycleNode, ABC, Generic[Core, Run]):
    """A lifecycle node that declares its table and reports failures in sentences.

    Its life has three stages, each with data of its own:

    - built: `values`, until the process ends;
    - configured: `core`, made by `configure`, given back by `release`;
    - active: `run`, made by `engage`, gone after `disengage`.

    Sub-classes set `SPEC`, implement `configure`, and of the other hooks what they need.
    Publishers, subscriptions and timers made by `create_output`, `hear` and `repeat` end with the
    stage in which they were made, as does whatever is handed to `at_end`.

    Attributes
    ----------
    values : dict
        Present parameter values, in the cores' form.
    start_ns : int
        Message stamp of tick 0.
    tick : int
        Present tick, for the stamps of /diagnostics.
    health : Health
        What was reported last.
    failure : str
        Why the last transition failed; empty if it did not.
    finished : bool
        Set by a node whose work is done; the process then ends with `exit_code`.
    exit_code : int
        0, or 1 if what the node did came to a bad end.
    crash : Exception or None
        What a callback raised; the process then ends with code 1.
    verdict : Verdict or None
        What the change that is being set was judged to be beforehand.
    revision : int
        Counts changes of values and stages: what was judged before one must be judged again.
    """

    SPEC: ClassVar[NodeSpec]

    def __init__(self, values: Mapping[str, Any], **options: Any) -> None:
        super().__init__(self.SPEC.name, **options)
        self.values = dict(values)
        self.start_ns = stamp_at(self.values["start_time_s"])
        self.tick = 0
        self.health = Health()
        self.failure, self.finished, self.exit_code = "", False, 0
        self.crash: Exception | None = None
        self.outputs: dict[str, Any] = {}
        self._core: Core | None = None
        self._run: Run | None = None
        self._active = False
        self._ends: list[ExitStack] = []
        self._unheard: list[Callable[[], None]] = []
        self._judged: Any = None
        self.verdict: Verdict | None = None
        self.revision = 0
        self._table = {row.name: row for row in self.SPEC.full_table()}
        rows: list[Any] = [
            (n, ros_value(values[n]), descriptor(row)) for n, row in self._table.items()
        ]
        self.declare_parameters("", rows, ignore_override=True)
        self.add_on_set_parameters_callback(self._judge_set)
        self.add_post_set_parameters_callback(self._adopt_set)
        self._reporter = Reporter(
            self.create_publisher(
                topics.message_class(topics.BY_NAME[topics.DIAGNOSTICS].type),
                topics.DIAGNOSTICS,
                topics.qos(topics.DIAGNOSTICS),
            ),
            self.get_fully_qualified_name().lstrip("/"),
            hardware_of(self.get_namespace()),
        )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(REPEAT_S, self.guarded(self._repeat_report), clock=steady)
        self._service_change_state.callback = self._change_state
        judging = Judging(self)
        own: dict[Any, Any] = {
            SetParameters: judging.one_by_one,
            SetParametersAtomically: judging.together,
        }
        for service in self.services:
            service.callback = own.get(service.srv_type, service.callback)
            guard(service, self.get_logger().warning)

    # --- for sub-classes to implement ----------------------------------------------------------

    @abstractmethod
    def configure(self) -> Core:
        """Build the core, publishers and subscriptions from `values`; may raise."""

    def engage(self) -> Run:
        """Make the data of the active stage, when all peers are connected; may raise."""
        return cast(Run, None)

    def begin(self) -> None:
        """First action of the active stage, whose data are there now; may raise."""

    def disengage(self) -> None:
        """Last action of the active stage."""

    def release(self) -> None:
        """Last action of the configured stage, also when the process ends in it."""

    def judge(self, values: Mapping[str, Any], changed: Collection[str]) -> Any:
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
            Handed to `adopt` if the change comes about.

        Raises
        ------
        ValueError
            With a sentence, if the values do not fit together.
        """
        return None

    def adopt(self, judged: Any, changed: Collection[str]) -> None:
        """Take over what `judge` made; `values` are the new ones. Called between two ticks."""

    def expected_listeners(self, topic: str) -> set[str]:
        """Nodes that must listen to a topic before the flight starts."""
        if topic not in topics.BY_NAME:
            return set()
        peers = set(self.values["peers"]) - {self.SPEC.name}
        expected = peers.intersection(topics.BY_NAME[topic].sinks)
        return expected | (peers & {"recorder"})

    def awaited_links(self) -> Mapping[str, Collection[str]]:
        """Topics of others whose listeners must be ready, too, before the flight starts."""
        return {}

    # --- stages --------------------------------------------------------------------------------

    @property
    def configured(self) -> bool:
        """True from configuration to clean-up."""
        return self._core is not None

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

    def create_output(self, topic: str) -> Callable[[bytes], None]:
        """Lifecycle publisher of a graph topic; returns its publish function (bytes or message)."""
        cls = topics.message_class(topics.KNOWN[topic].type)
        publisher = self.create_lifecycle_publisher(cls, topic, topics.qos(topic))
        self.outputs[topic] = publisher

        def end() -> None:
            del self.outputs[topic]
            self.destroy_lifecycle_publisher(publisher)

        self.at_end(end)
        return publisher.publish

    def hear(
        self,
        topic: str,
        callback: Callable[[Any], None],
        qos: Any = None,
        raw: bool = False,
        owner: Owner | None = None,
        ignored: Callable[[], None] | None = None,
    ) -> None:
        """Subscribe to a graph topic; `raw` for the serialised messages.

        What `configure` asks for is done when it has succeeded: who listens is ready. Without a QoS
        of its own, senders of default QoS are heard and the last message of latched ones. With an
        owner (for `raw`) only its messages are; `ignored` is called for those of others.
        """
        cls = topics.message_class(topics.BY_NAME[topic].type)
        profiles = topics.qos_to_hear(topic) if qos is None else (qos,)
        once = Once()

        def listen() -> None:
            call = self.guarded(callback)

            def hear_once(message: Any, info: Info | None) -> None:
                if once.is_new(info):
                    call(message)

            def hear_owner(message: Any, info: Info | None) -> None:
                if owner is None or owner.admits(message, info):
                    call(message)
                elif ignored is not None:
                    ignored()

            heard = with_info(hear_once) if len(profiles) > 1 else call
            heard = heard if owner is None else with_info(hear_owner)
            for profile in profiles:
                given = self.create_subscription(cls, topic, heard, profile, raw=raw)
                self.at_end(partial(self.destroy_subscription, given))

        if self.configured:
            listen()
        else:
            self._unheard.append(listen)

    def repeat(self, period_s: float, callback: Callable[[], None]) -> None:
        """Call this every so many seconds of wall time."""
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        timer = self.create_timer(period_s, self.guarded(callback), clock=steady)
        self.at_end(lambda: self.destroy_timer(timer))

    def guarded(self, callback: Callable[..., None]) -> Callable[..., None]:
        """The callback, whose exception ends the process in one line instead of a trace.

        It is called as long as the present stage lasts, if any: what comes late is nobody's.
        """
        stage = self._ends[-1] if self._ends else None

        def call(*args: Any) -> None:
            if self.crash is None and (stage is None or stage in self._ends):
                try:
                    callback(*args)
                except Exception as error:
                    self.crash = error

        return call

    # --- health ------------------------------------------------------------------------------

    def report(self, level: Level, message: str, facts: Mapping[str, Any] | None = None) -> None:
        """Say how the node is; sent at once if it changed, else once per simulated second."""
        changed = (level, message) != (self.health.level, self.health.message)
        self.health.level, self.health.message = level, message
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
        level, message = self.health.level, self.health.message
        if repeated or self._reporter.is_due(self.tick, level, message):
            facts, now_ns = self.health.facts, self.now_ns()
            self._reporter.publish(now_ns, self.tick, level, message, facts, repeated)

    def now_ns(self) -> int:
        """The node's time, for the stamp of what it says of itself: that of its last tick."""
        return self.start_ns + self.tick * TICK_NS

    def _repeat_report(self) -> None:
        """Say it again, if no tick has done so meanwhile."""
        if self._reporter.was_silent():
            self.send_report(repeated=True)

    # --- lifecycle ---------------------------------------------------------------------------

    def _transition(self, action: Callable[[], None], message: str) -> TransitionCallbackReturn:
        """Run a transition's work; a refusal becomes a sentence and FAILURE."""
        self.failure = ""
        self.revision += 1
        try:
            action()
        except (StartError, ParameterError, ValueError, LookupError, OSError) as error:
            self.failure = " ".join(str(error).split())
            self.report(Level.ERROR, self.failure)
            return _FAILURE
        except ExternalShutdownException:
            self.failure = "asked to end while starting"
            return _FAILURE
        except Exception as error:
            self.failure = f"{type(error).__name__}: {error}"
            self.report(Level.ERROR, self.failure)
            return _FAILURE
        self.report(Level.OK, message)
        return _SUCCESS

    def _change_state(self, request: Any, response: Any) -> Any:
        """Service callback: a transition that is not possible is refused, with the reason."""
        machine = self._state_machine
        possible = {label: number for number, label, *_ in machine.available_transitions}
        self.failure = ""
        try:
            number = chosen(request.transition, possible, machine.current_state[1])
        except ValueError as error:
            self.failure = str(error)
            self.get_logger().warning(f"refused: {error}")
            response.success = False
            return response
        trigger = {
            Transition.TRANSITION_CONFIGURE: self.trigger_configure,
            Transition.TRANSITION_CLEANUP: self.trigger_cleanup,
            Transition.TRANSITION_ACTIVATE: self.trigger_activate,
            Transition.TRANSITION_DEACTIVATE: self.trigger_deactivate,
        }.get(number, self.trigger_shutdown)
        response.success = trigger() == _SUCCESS
        return response

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: build everything from the present parameters."""

        def action() -> None:
            self._ends.append(ExitStack())
            self._unheard.clear()
            self._core = self.configure()
            for listen in self._unheard:
                listen()

        result = self._transition(action, "configured")
        if result != _SUCCESS:
            self._leave_configured()
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: wait for peers, then take part."""

        def action() -> None:
            self._ends.append(ExitStack())
            wait_for_peers(self)
            LifecycleNode.on_activate(self, state)
            self._run = self.engage()
            self._active = True
            self.begin()

        result = self._transition(action, "active")
        if result != _SUCCESS:
            if self._active:
                self.disengage()
            self._leave_active()
            LifecycleNode.on_deactivate(self, state)
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: stop sending. It cannot fail: an error ends in `on_error`."""
        result = self._transition(self.disengage, INACTIVE)
        self._leave_active()
        LifecycleNode.on_deactivate(self, state)
        return _SUCCESS if result == _SUCCESS else _ERROR

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: forget what was built. An error ends in `on_error`."""
        result = self._transition(self.release, "unconfigured")
        self._leave_configured()
        return _SUCCESS if result == _SUCCESS else _ERROR

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: everything is given back, then the process ends."""
        self.finished = True
        if self._active:
            self.on_deactivate(state)
        if self.configured:
            self.on_cleanup(state)
        return _SUCCESS

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: a transition has failed half-way; the node is unconfigured again."""
        said = self.failure
        if self._active:
            self._leave_active()
        if self.configured:
            self._transition(self.release, "unconfigured")
            self._leave_configured()
        self.failure = said
        self.report(Level.ERROR, said)
        return _SUCCESS

    def _leave_active(self) -> None:
        self._active, self._run = False, None
        self._ends.pop().close()

    def _leave_configured(self) -> None:
        self._core = None
        self._ends.pop().close()

    def end(self) -> None:
        """The process ends, in whatever stage: last words, and everything is given back."""
        try:
            if self.configured:
                self.release()
        finally:
            self._active, self._run = False, None
            while self._ends:
                self._ends.pop().close()
            # rclpy forgets it, and it holds the node: Fast DDS would leave its shared memory.
            self._state_machine.destroy_when_not_in_use()
            self._core = None

    # --- parameters at run time --------------------------------------------------------------

    def _changes(self, parameters: Iterable[Any]) -> dict[str, Any]:
        """Values of the table's parameters, in the cores' form."""
        known = [p for p in parameters if p.name in self._table]
        return {p.name: self._table[p.name].check(p.value) for p in known}

    def judgeable(self, parameters: Iterable[Any]) -> dict[str, Any]:
        """Changes of these parameters if they need a judgement; none if their table refuses one."""
        known = [p for p in parameters if p.name in self._table]
        if any(why_refused(self._table.values(), p.name, p.value) for p in known):
            return {}
        return self._changes(known)

    def _judge_set(self, parameters: list[Any]) -> SetParametersResult:
        """Answer of the node to a change that is asked for; the change itself is `_adopt_set`."""
        for parameter in parameters:
            reason = why_refused(self._table.values(), parameter.name, parameter.value)
            if reason:
                return SetParametersResult(successful=False, reason=reason)
        changes = self._changes(parameters)
        if not changes:
            return SetParametersResult(successful=True)
        try:
            # Kept for `_adopt_set`, which rclpy calls next, if at all: the node is as it was.
            if self.verdict is None:
                self._judged = self.judge({**self.values, **changes}, changes.keys())
            elif self.verdict.refusal is not None:
                raise self.verdict.refusal
            else:
                self._judged = self.verdict.judged
        except ValueError as error:
            return SetParametersResult(successful=False, reason=" ".join(str(error).split()))
        return SetParametersResult(successful=True)

    def _adopt_set(self, parameters: list[Any]) -> None:
        changes = self._changes(parameters)
        if changes:
            self.values.update(changes)
            self.revision += 1
            self.adopt(self._judged, changes.keys())
