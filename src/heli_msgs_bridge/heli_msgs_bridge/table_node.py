# SPDX-License-Identifier: Apache-2.0
"""Nodes that have the parameters of a table, judged when they change, and say how they are."""

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.lifecycle import LifecycleNode
from rclpy.parameter import Parameter as RosParameter

from heli_math.ticks import Rate, stamp_at
from heli_msgs_bridge import topics
from heli_msgs_bridge.descriptors import descriptor, ros_value
from heli_msgs_bridge.diagnostics import Level, Reporter, hardware_of
from heli_msgs_bridge.judging import Judging, Verdict
from heli_msgs_bridge.node_spec import NodeSpec
from heli_parameters.parameters import judge as why_refused


@dataclass
class Health:
    """What a node says of itself in /diagnostics."""

    level: Level = Level.OK
    message: str = "unconfigured"
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
    changed : dict
        Parameters that were changed since the node was built.
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
        self.rate = Rate.of_parameters(self.values)
        self.tick = 0
        self.health = Health()
        self.changed: dict[str, Any] = {}
        self.verdict: Verdict | None = None
        self.revision = 0
        self._judged: Any = None
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
            self.rate.hz,
        )
        judging = Judging(self)
        own: dict[Any, Any] = {
            SetParameters: judging.one_by_one,
            SetParametersAtomically: judging.together,
        }
        for service in self.services:
            service.callback = own.get(service.srv_type, service.callback)

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

    # --- health ----------------------------------------------------------------------------------

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
            facts, now_ns = {**self.health.facts, **self.flood_facts()}, self.now_ns()
            self._reporter.publish(now_ns, self.tick, level, message, facts, repeated)

    def flood_facts(self) -> dict[str, str]:
        """What was refused because it came too often."""
        return {}

    def now_ns(self) -> int:
        """The node's time, for the stamp of what it says of itself: that of its last tick."""
        return self.start_ns + self.tick * self.rate.tick_ns

    def repeat_report(self) -> None:
        """Say it again, if no tick has done so meanwhile."""
        if self._reporter.was_silent():
            self.send_report(repeated=True)

    # --- parameters at run time ------------------------------------------------------------------

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
            self.changed.update(changes)
            self.revision += 1
            self.adopt(self._judged, changes.keys())
