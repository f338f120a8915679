# SPDX-License-Identifier: Apache-2.0
"""Base of the graph's nodes: parameters from tables, lifecycle, peers, diagnostics, clean endings.

Exit codes of a node: 0 it was asked to end or its flight is over, 1 it failed while running, 2 it
could not start (bad parameter, missing peer, no DDS). Every failure is one line on stderr.
"""

import gc
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import rclpy
from rcl_interfaces.msg import SetParametersResult
from rclpy.executors import ExternalShutdownException
from rclpy.experimental.events_executor import EventsExecutor
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

from heli_msgs_bridge import topics
from heli_msgs_bridge.descriptors import descriptor, ros_value
from heli_msgs_bridge.diagnostics import Level, Reporter
from heli_parameters import command_line, locate
from heli_parameters.common_table import with_common
from heli_parameters.parameters import Parameter, ParameterError, judge, load

_POLL_S = 0.002
_SUCCESS, _FAILURE = TransitionCallbackReturn.SUCCESS, TransitionCallbackReturn.FAILURE
_FILES = "heli_parameters"


class StartError(Exception):
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
        """Packaged YAML files, weakest first; `StartError` if the installation lacks them."""
        try:
            own = locate.config_folder(self.package) / self.config
            return [locate.config_folder(_FILES) / "common.yaml", own]
        except locate.MissingFileError as error:
            raise StartError(str(error)) from error

    def resolve(
        self, params_files: Sequence[str] = (), rules: Sequence[str] = (), name: str = ""
    ) -> dict[str, Any]:
        """Values of all parameters; raises `ParameterError` or `StartError`."""
        files = [*self.default_files(), *params_files]
        # An override file may also speak of common parameters that the defaults do not repeat.
        return load(self.full_table(), files, name or self.name, rules)


class ManagedNode(LifecycleNode):
    """A lifecycle node that declares its table and reports failures in sentences.

    Sub-classes set `SPEC` and override the hooks `setup`, `engage`, `disengage`, `teardown`,
    `judge_change` and `apply_change`.

    Attributes
    ----------
    values : dict
        Present parameter values, in the cores' form.
    failure : str
        Why the last transition failed; empty if it did not.
    active : bool
        True between activation and deactivation.
    finished : bool
        Set by a node whose work is done; the process then ends with code 0.
    """

    SPEC: ClassVar[NodeSpec]

    def __init__(self, values: Mapping[str, Any], **options: Any) -> None:
        super().__init__(self.SPEC.name, **options)
        self.values = dict(values)
        self.failure, self.active, self.finished = "", False, False
        self._table = self.SPEC.full_table()
        rows = [(row.name, ros_value(values[row.name]), descriptor(row)) for row in self._table]
        self.declare_parameters("", rows, ignore_override=True)
        self.add_on_set_parameters_callback(self._judge_set)
        self.add_post_set_parameters_callback(self._apply_set)
        self.start_ns = round(self.values["start_time_s"] * 1e9) // topics.TICK_NS * topics.TICK_NS
        self.tick = 0
        self._reporter = Reporter(
            self.create_publisher(
                topics.message_class(topics.BY_NAME[topics.DIAGNOSTICS].type),
                topics.DIAGNOSTICS,
                topics.qos(topics.DIAGNOSTICS),
            ),
            self.get_fully_qualified_name().lstrip("/"),
        )
        self._level, self._message, self._facts = Level.OK, "unconfigured", dict[str, Any]()
        self.outputs: dict[str, Any] = {}

    # --- hooks -------------------------------------------------------------------------------

    def setup(self) -> None:
        """Build the core and the publishers and subscriptions from `values`; may raise."""

    def engage(self) -> None:
        """Called on activation, when all peers are connected; may raise."""

    def disengage(self) -> None:
        """Called on deactivation."""

    def teardown(self) -> None:
        """Called on clean-up: forget what `setup` built."""

    def judge_change(self, changes: Mapping[str, Any]) -> None:
        """Raise ValueError, with a sentence, if the core refuses these values."""

    def apply_change(self, changes: Mapping[str, Any]) -> None:
        """Take over judged values; called between two ticks."""

    # --- publishers and peers ----------------------------------------------------------------

    def create_output(self, topic: str) -> Callable[[bytes], None]:
        """Lifecycle publisher of a graph topic; returns its publish function (bytes or message)."""
        cls = topics.message_class(topics.BY_NAME[topic].type)
        publisher = self.create_lifecycle_publisher(cls, topic, topics.qos(topic))
        self.outputs[topic] = publisher
        return publisher.publish

    def expected_listeners(self, topic: str) -> set[str]:
        """Nodes that must listen to a topic before the flight starts."""
        peers = set(self.values["peers"]) - {self.SPEC.name}
        expected = peers.intersection(topics.BY_NAME[topic].sinks)
        return expected | (peers & {"recorder"})

    def _absent(self) -> tuple[str, set[str]] | None:
        """First output that lacks listeners, and their names; None if all are connected."""
        for topic, publisher in self.outputs.items():
            expected = self.expected_listeners(topic)
            if not expected:
                continue
            infos = self.get_subscriptions_info_by_topic(publisher.topic_name)
            missing = expected - {info.node_name for info in infos}
            if missing or publisher.get_subscription_count() < len(expected):
                return topic, missing or expected
        return None

    def wait_for_peers(self) -> None:
        """Block until every expected listener is connected.

        Raises
        ------
        StartError
            Naming topic and missing nodes, after `connect_timeout_s` of wall time.
        """
        limit_s = self.values["connect_timeout_s"]
        deadline = time.monotonic() + limit_s
        while (absent := self._absent()) is not None:
            if not self.context.ok():
                raise ExternalShutdownException
            if time.monotonic() > deadline:
                names = ", ".join(sorted(absent[1]))
                raise StartError(
                    f"nobody listens to '{absent[0]}' after {limit_s:g} s: missing {names}"
                )
            time.sleep(_POLL_S)

    # --- health ------------------------------------------------------------------------------

    def report(self, level: Level, message: str, facts: Mapping[str, Any] | None = None) -> None:
        """Say how the node is; sent at once if it changed, else once per simulated second."""
        changed = (level, message) != (self._level, self._message)
        self._level, self._message = level, message
        if facts is not None:
            self._facts = dict(facts)
        if changed:
            # rclpy ties a severity to the calling line: two lines are needed.
            if level == Level.OK:
                self.get_logger().info(message)
            else:
                self.get_logger().warning(message)
        self.send_report()

    def send_report(self, force: bool = False) -> None:
        """Publish the status if it is due."""
        if force or self._reporter.is_due(self.tick, self._level, self._message):
            stamp_ns = self.start_ns + self.tick * topics.TICK_NS
            self._reporter.publish(stamp_ns, self.tick, self._level, self._message, self._facts)

    # --- lifecycle ---------------------------------------------------------------------------

    def _transition(self, action: Callable[[], None], message: str) -> TransitionCallbackReturn:
        """Run a transition's work; a refusal becomes a sentence and FAILURE."""
        self.failure = ""
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

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: build everything from the present parameters."""
        result = self._transition(self.setup, "configured")
        if result != _SUCCESS:
            self._drop_entities()
        return result

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: wait for peers, then take part."""

        def action() -> None:
            self.wait_for_peers()
            LifecycleNode.on_activate(self, state)
            self.active = True
            self.engage()

        result = self._transition(action, "active")
        self.active = result == _SUCCESS
        return result

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: stop sending."""
        self.active = False
        result = self._transition(self.disengage, "inactive")
        LifecycleNode.on_deactivate(self, state)
        return result

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: forget what was built."""
        result = self._transition(self.teardown, "unconfigured")
        self._drop_entities()
        return result

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: the process ends."""
        self.active = False
        self.finished = True
        return _SUCCESS

    def _drop_entities(self) -> None:
        for publisher in self.outputs.values():
            self.destroy_publisher(publisher)
        self.outputs.clear()

    # --- parameters at run time --------------------------------------------------------------

    def _judge_set(self, parameters: list[Any]) -> SetParametersResult:
        rows = {row.name: row for row in self._table}
        changes: dict[str, Any] = {}
        for parameter in parameters:
            reason = judge(self._table, parameter.name, parameter.value)
            if reason:
                return SetParametersResult(successful=False, reason=reason)
            if parameter.name in rows:
                changes[parameter.name] = rows[parameter.name].check(parameter.value)
        try:
            self.judge_change(changes)
        except ValueError as error:
            return SetParametersResult(successful=False, reason=" ".join(str(error).split()))
        return SetParametersResult(successful=True)

    def _apply_set(self, parameters: list[Any]) -> None:
        rows = {row.name: row for row in self._table}
        changes = {p.name: rows[p.name].check(p.value) for p in parameters if p.name in rows}
        self.values.update(changes)
        self.apply_change(changes)


def complain(name: str, sentence: str) -> None:
    """One line on stderr."""
    sys.stderr.write(f"{name}: {' '.join(sentence.split())}\n")
    sys.stderr.flush()


def _start(cls: type[ManagedNode], argv: Sequence[str], args: Sequence[str]) -> ManagedNode:
    """Check parameters, start ROS, make the node; raises StartError or ParameterError."""
    line = command_line.parse(argv, cls.SPEC.name)
    values = cls.SPEC.resolve(line.params_files, line.rules, line.full_name)
    try:
        rclpy.init(args=list(args))
        return cls(values)
    except (StartError, ParameterError):
        raise
    except Exception as error:
        first = str(error).strip().splitlines()[0] if str(error).strip() else type(error).__name__
        raise StartError(f"ROS 2 cannot start: {first}") from error


def _spin(node: ManagedNode) -> int:
    executor = EventsExecutor()
    executor.add_node(node)
    if node.values["autostart"]:
        for transition in (node.trigger_configure, node.trigger_activate):
            if transition() != _SUCCESS:
                if not rclpy.ok():
                    return 0
                complain(node.SPEC.name, node.failure)
                return 2
    gc.collect()
    gc.freeze()
    while rclpy.ok() and not node.finished:
        executor.spin_once(timeout_sec=0.5)
    return 0


def run(cls: type[ManagedNode], args: Sequence[str] | None = None) -> int:
    """Run a node until it is asked to end.

    Parameters
    ----------
    cls : ManagedNode sub-class
    args : sequence of str, optional
        Command line without the program name; by default the process's.

    Returns
    -------
    int
        Exit code: 0 ended cleanly (also by SIGINT or SIGTERM), 1 failed in flight, 2 could not
        start.
    """
    argv = list(sys.argv[1:] if args is None else args)
    name = cls.SPEC.name
    node = None
    try:
        node = _start(cls, argv, [name, *argv])
        return _spin(node)
    except (StartError, ParameterError) as error:
        complain(name, str(error))
        return 2
    except (KeyboardInterrupt, ExternalShutdownException):
        return 0
    except Exception as error:
        if node is not None and not rclpy.ok():
            # A signal ended ROS inside a callback: what it would have sent next failed.
            return 0
        complain(name, f"failed in flight: {type(error).__name__}: {error}")
        return 1
    finally:
        _end(node)


def _end(node: ManagedNode | None) -> None:
    """Last words and clean-up, whatever the state is in."""
    try:
        if node is not None:
            node.teardown()
            if rclpy.ok():
                node.destroy_node()
        rclpy.try_shutdown()
    except (KeyboardInterrupt, Exception) as error:
        complain("shutdown", f"{type(error).__name__}: {error}")
