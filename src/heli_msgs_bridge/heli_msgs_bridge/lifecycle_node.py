# SPDX-License-Identifier: Apache-2.0
"""Base of the graph's nodes: the stages of their life, inputs and outputs, peers."""

from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable, Collection, Mapping
from contextlib import ExitStack
from functools import partial
from typing import Any, ClassVar, Generic, TypeVar, cast

from rclpy.clock import Clock, ClockType
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from heli_msgs_bridge import topics
from heli_msgs_bridge.arrivals import Info, Once, Owner, owned, telling, with_info
from heli_msgs_bridge.diagnostics import FACT_FLOOD, REPEAT_S, Level
from heli_msgs_bridge.floods import Requests
from heli_msgs_bridge.memory import respawns
from heli_msgs_bridge.node_spec import StartError
from heli_msgs_bridge.peers import wait_for_peers
from heli_msgs_bridge.publishing import publishing
from heli_msgs_bridge.services import (
    ALWAYS_ANSWERED,
    chosen,
    guard,
    not_flooded,
    trigger_of,
)
from heli_msgs_bridge.table_node import TableNode
from heli_parameters.parameters import ParameterError

INACTIVE = "inactive"
"""What a node says when it has been deactivated."""
BEFORE_STEPS = ("unconfigured", "configured", "active")
"""What a node says before it has made a step."""
_REPEATED_TICKS = 400
"""Real time: of so many ticks a sender repeats its messages to who is started again."""
_SUCCESS, _FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
_ERROR = TransitionCallbackReturn.ERROR

Core = TypeVar("Core")
"""Data of a node while it is configured."""
Run = TypeVar("Run")
"""Data of a node while it is active."""


class ManagedNode(TableNode, ABC, Generic[Core, Run]):
    """A lifecycle node with the parameters of its table, which reports failures in sentences.

    Its life has three stages, each with data of its own:

    - built: `values`, until the process ends;
    - configured: `core`, made by `configure`, given back by `release`;
    - active: `run`, made by `engage`, gone after `disengage`.

    Sub-classes set `SPEC`, implement `configure`, and of the other hooks what they need.
    Publishers, subscriptions and timers made by `create_output`, `hear` and `repeat` end with the
    stage in which they were made, as does whatever is handed to `at_end`.

    Attributes
    ----------
    failure : str
        Why the last transition failed; empty if it did not.
    finished : bool
        Set by a node whose work is done; the process then ends with `exit_code`.
    exit_code : int
        0, or 1 if what the node did came to a bad end.
    crash : Exception or None
        What a callback raised; the process then ends with code 1.
    requests : Requests
        The service calls that are answered while it is active.
    respawns : bool
        Whether nodes that die are started again.
    sent : dict or None
        Per topic the last messages that were sent, where somebody wants to know.
    asked_to_end : callable
        Whether the process has been sent a signal.
    told_end : callable
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
        self.told_end: Callable[[], None] = lambda: None
        self.outputs: dict[str, Any] = {}
        self._core: Core | None = None
        self._run: Run | None = None
        self._active = False
        self._ends: list[ExitStack] = []
        self._unheard: list[Callable[[], None]] = []
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self.create_timer(REPEAT_S, self.guarded(self.repeat_report), clock=steady)
        self._service_change_state.callback = self._change_state
        self.requests = Requests(lambda: self.active, self.get_logger().warning)
        for service in self.services:
            limited = service.srv_type not in ALWAYS_ANSWERED
            guard(service, self.requests.warn, self.requests.flooded if limited else not_flooded)

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
        """True from activation to deactivation."""
        return self._active

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

    def create_output(self, topic: str) -> Callable[[Any], None]:
        """Lifecycle publisher of a graph topic; returns its publish function (bytes or message)."""
        cls = topics.message_class(topics.KNOWN[topic].type)
        again = self.respawns and bool(topics.KNOWN[topic].every_ticks)
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
        own = topics.DEPTH if self.respawns else topics.UNHEARD
        return self.rate.of(_REPEATED_TICKS) if paced else own

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

            heard = with_info(hear_once) if len(profiles) > 1 else call
            if owner is not None:
                heard = telling(self.guarded(owned(owner, callback, ignored)))
            for profile in profiles:
                given = self.create_subscription(cls, topic, heard, profile, raw=raw)
                self.at_end(partial(self.destroy_subscription, given))

        if self.configured:
            listen()
        else:
            self._unheard.append(listen)

    def serve(self, kind: Any, name: str, answer: Callable[[Any, Any], Any]) -> None:
        """Answer a service; an exception is a refusal and ends no node (`services.guard`)."""
        service = self.create_service(kind, name, answer)
        guard(service, self.requests.warn, self.requests.flooded)
        self.at_end(partial(self.destroy_service, service))

    def flood_facts(self) -> dict[str, str]:
        """How many requests came too often, if any did."""
        told = self.requests.told()
        return {FACT_FLOOD: told} if told else {}

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
                if self.finished or self.crash is not None:
                    self.told_end()

        return call

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
        response.success = trigger_of(self, number)() == _SUCCESS
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
        self.told_end()
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
