# SPDX-License-Identifier: Apache-2.0
"""Node `recorder`: every topic of the graph, as it comes, into a bag; others where named."""

import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message

from heli_bags.bag_clock import LATE
from heli_bags.parameters import NODE_NAME, TABLE
from heli_bags.writer import BagError, BagRecorder, Format, custom_data, row_of
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import Level, NodeState, gps_latency_of
from heli_msgs_bridge.handover import Restarts
from heli_msgs_bridge.lifecycle_node import ManagedNode, NodeSpec, NodeStartError
from heli_msgs_bridge.node_process import run
from heli_msgs_bridge.signatures import unsigned
from heli_msgs_bridge.sources import (
    NOT_YET_NAMED,
    SENDERS,
    DiagnosticSenders,
    DuplicateFilter,
    Info,
    PublisherLock,
    TopicSenders,
    lock_of,
    senders_of,
    several,
    with_info,
)

# Deep enough for a pause of seconds at ten times real time.
_DEPTH = 10_000
# Wall time without a message after which a stream counts as ended.
_QUIET_S = 0.1
_REPEAT_S, _DRAIN_S, _POLL_S = 4.0, 8.0, 0.002
# Wall time for a sender that we know after it knows us: it repeats what it has sent, and that it is
# there, with its heartbeat.
_UNHEARD_S = 6.0
# Wall time after which whatever was sent before has come, while a flight goes on.
_SETTLED_S = 0.5
_FIX, _LATENCY = topics.BY_NAME[topics.GPS_FIX], "schedule.gps_latency_ticks"
_DIAGNOSTIC_SENDERS, _NAMELESS = f"{SENDERS}{topics.DIAGNOSTICS}", "a sender without a name"


@dataclass
class ConfiguredRecorder:
    """What the recorder has while it is configured.

    Attributes
    ----------
    bag : BagRecorder
    subscriptions : dict
        Per topic of the bag.
    plain : list
        Subscriptions to latched topics for senders that are not.
    once : dict of DuplicateFilter
        Per latched topic, what has two subscriptions.
    owners : dict of PublisherLock
        Per stream whose messages are recorded.
    diagnostic_senders : DiagnosticSenders
        Who speaks in /diagnostics.
    restarts : Restarts
        Which nodes were started again.
    senders : dict of TopicSenders
        Per stream that has several senders.
    nameless : bool
        Whether somebody without a name speaks in /diagnostics as one of this aircraft's nodes.
    trouble : str
        Why the recording ended or has gaps; empty if it did not.
    """

    bag: BagRecorder
    diagnostic_senders: DiagnosticSenders
    subscriptions: dict[str, Any] = field(default_factory=dict)
    plain: list[Any] = field(default_factory=list)
    once: dict[str, DuplicateFilter] = field(default_factory=dict)
    owners: dict[str, PublisherLock] = field(default_factory=dict)
    restarts: Restarts = field(default_factory=Restarts)
    senders: dict[str, TopicSenders] = field(default_factory=dict)
    nameless: bool = False
    trouble: str = ""


class RecorderNode(ManagedNode[ConfiguredRecorder, None]):
    """Records from configuration to clean-up; deactivation confirms what was sent before it."""

    SPEC = NodeSpec(NODE_NAME, "heli_bags", TABLE, f"{NODE_NAME}.yaml")
    PATIENCE_S = 0.005

    def _chosen(self) -> list[str]:
        """What to record, as the parameters name it."""
        wanted, left_out = self.values["topics"], set(self.values["exclude"]) - {"none"}
        names = list(wanted)
        if "all" in names:
            at = names.index("all")
            pictures = [t.name for t in topics.TOOLS if topics.installed(t.name)]
            names[at : at + 1] = [*(t.name for t in topics.TABLE), *pictures]
        rows = {row_of(name).name: name for name in names}
        for name in left_out - set(rows):
            row_of(name)
        return [name for short, name in rows.items() if short not in left_out]

    def __init__(self, values: Mapping[str, Any], **options: Any) -> None:
        super().__init__(values, **options)
        self._folders: list[str] = []

    @property
    def _gps_latency_ns(self) -> int:
        """From a fix's stamp to its sending, by the parameters."""
        return self.rate.of(self.values[_LATENCY]) * self.rate.tick_ns

    def _next_folder(self) -> str:
        """Where to write; a bag of its own each time that this node is configured."""
        named = self.values["bag"]
        wanted = named or f"bags/{time.strftime('%Y%m%d-%H%M%S')}"
        folder, number = wanted, 1
        # The clock may have been set back, or be that of the hour that is gone through twice.
        while folder in self._folders or (not named and Path(folder).exists()):
            number += 1
            folder = f"{wanted}_{number}"
        return folder

    def configure(self) -> ConfiguredRecorder:
        """Make the bag and subscribe."""
        values, folder = self.values, self._next_folder()
        try:
            form = Format(
                values["storage"],
                values["compression"] == "zstd",
                round(values["split.size_mb"] * 1e6),
                round(values["split.duration_s"] * 1e9),
                custom_data(values["custom_data"]),
            )
            names, space = self._chosen(), self.get_namespace()
            latency_ns = dict.fromkeys(LATE, self._gps_latency_ns)
            bag = BagRecorder(folder, names, space, form, self.start_ns, self.rate, latency_ns)
        except BagError as error:
            raise NodeStartError(str(error)) from error
        self._folders.append(folder)
        node_names = topics.BY_NAME[topics.DIAGNOSTICS].source
        core = ConfiguredRecorder(bag, DiagnosticSenders(self.get_namespace(), node_names))
        # Also when a signal comes while this node is configured: the bag opens.
        self.at_end(bag.close)
        self.at_end(lambda: self._unsubscribe(core))
        self.once_configured(partial(self._subscribe_to_all, core))
        self.create_wall_timer(values["flush_s"], self._flush)
        self.get_logger().info(f"recording {len(bag.rows)} topics to {folder}")
        return core

    def _subscribe_to_all(self, core: ConfiguredRecorder) -> None:
        for name in core.bag.rows:
            self._subscribe(core, name, topics.qos(name, _DEPTH), self.qos_overriding(name))

    def _subscribe(
        self,
        core: ConfiguredRecorder,
        name: str,
        qos: QoSProfile,
        overriding: QoSOverridingOptions | None = None,
        heard: Any = None,
    ) -> None:
        cls = topics.message_class(core.bag.rows[name].type)
        row = topics.BY_NAME.get(name)
        if row is not None and row.every_ticks and name not in core.owners:
            core.owners[name] = self._owner(row)

        def write(raw: bytes, info: Info | None) -> None:
            # One call of the executor empties the queue.
            self._write(name, raw, info)
            self._write_arrived(name)

        call = heard or with_info(self.guarded(write))
        core.subscriptions[name] = self.create_subscription(
            cls, name, call, qos, raw=True, qos_overriding_options=overriding
        )
        for profile in topics.qos_to_hear(name)[1:]:
            core.once[name] = DuplicateFilter()
            core.plain.append(self.create_subscription(cls, name, call, profile, raw=True))

    def _owner(self, row: topics.Topic) -> PublisherLock:
        """Who decides whose messages of a stream are recorded: a second sender's are not."""
        silence_s, period_ns = self.values["peer_timeout_s"], row.period_ns(self.rate)
        return lock_of(self, row.name, silence_s, period_ns)

    def _unsubscribe(self, core: ConfiguredRecorder) -> None:
        for subscription in (*core.subscriptions.values(), *core.plain):
            self.destroy_subscription(subscription)

    def _adapt(self, name: str) -> None:
        """Hear a topic whose publisher is best effort: reliable listeners hear nothing of it."""
        subscription = self.core.subscriptions[name]
        if subscription.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT:
            return
        infos = self.get_publishers_info_by_topic(subscription.topic_name)
        if any(i.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT for i in infos):
            self._write_arrived(name)
            self.destroy_subscription(subscription)
            best_effort = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._subscribe(self.core, name, best_effort, heard=subscription.callback)

    def _flush(self) -> None:
        self._name_those_known_since()
        for name in self.core.subscriptions:
            # In lockstep each message of the graph is waited for: none may be lost.
            if name not in topics.BY_NAME or (
                name in topics.SENSORS and not self.values["lockstep"]
            ):
                self._adapt(name)
        try:
            self.core.bag.flush()
        except BagError as error:
            self._complain(error)

    def _complain(self, error: BagError) -> None:
        """Say that the recording has ended; the flight goes on without it."""
        self.core.trouble = str(error)
        self.report(Level.ERROR, self.core.trouble, state=NodeState.FAILED)

    def now_ns(self) -> int:
        """Time of the flight that is recorded."""
        return self.core.bag.newest_ns if self.configured else super().now_ns()

    def report(
        self,
        level: Level,
        message: str,
        facts: Mapping[str, Any] | None = None,
        state: NodeState = NodeState.RUNNING,
    ) -> None:
        """Say how the node is; what is wrong with the bag stays the last word."""
        if self.configured and self.core.trouble and level < Level.ERROR:
            level, message, state = Level.ERROR, self.core.trouble, NodeState.FAILED
        super().report(level, message, facts, state)

    def _write(self, name: str, raw: bytes, info: Info | None) -> None:
        core = self.core
        once, owner = core.once.get(name), core.owners.get(name)
        if once is not None and not once.is_new(info):
            return
        if owner is not None and not owner.admits(raw, info):
            self._name_senders(name, owner)
            return
        if name == topics.DIAGNOSTICS and info is not None:
            diagnostics = deserialize_message(raw, core.subscriptions[name].msg_type)
            number = info["publication_sequence_number"]
            for node, times in core.restarts.news().items():
                core.diagnostic_senders.forget(node, times)
            if not core.diagnostic_senders.admits(
                [status.name for status in diagnostics.status], number
            ):
                self._name_strangers()
            self._compare_latency(diagnostics.status)
        try:
            core.bag.write(name, unsigned(raw) if name in topics.BY_NAME else raw)
        except BagError as error:
            self._complain(error)

    def _compare_latency(self, statuses: Sequence[Any]) -> None:
        """Say if the plant sends its fixes at another time after their stamps than we are told."""
        plants = {f"{self.get_namespace()}/{name}".strip("/") for name in _FIX.source}
        for status in statuses:
            if status.name.strip("/") not in plants:
                continue
            told_ns = gps_latency_of({pair.key: pair.value for pair in status.values})
            if told_ns is None or told_ns == self._gps_latency_ns or _LATENCY in self.health.facts:
                continue
            told_s, has_s = told_ns / NS_PER_S, self._gps_latency_ns / NS_PER_S
            sentence = (
                f"{status.name} sends {_FIX.name} {told_s:g} s after its stamp, the bag has it "
                f"{has_s:g} s after: set {_LATENCY} to {told_ns // TICK_NS}"
            )
            self.get_logger().warning(sentence)
            self.health.facts[_LATENCY] = sentence

    def _name_senders(self, name: str, owner: PublisherLock) -> None:
        """Say whose messages of a topic are not recorded."""
        known = self.core.senders.get(name)
        if known is None or NOT_YET_NAMED in known.names:
            known = several(name, senders_of(self, name))
            self.get_logger().warning(known.sentence)
        known = self.core.senders[name] = replace(known, not_recorded=owner.ignored)
        self.health.facts.update(known.facts())

    def _name_strangers(self) -> None:
        """Say who speaks in /diagnostics as if it were one of this aircraft's nodes."""
        diagnostic_senders = self.core.diagnostic_senders
        senders = senders_of(self, topics.DIAGNOSTICS)
        named = diagnostic_senders.strangers(
            sender for sender in senders if sender[1] != NOT_YET_NAMED
        )
        nameless = any(name == NOT_YET_NAMED for _, name in senders)
        strangers = named or ([_NAMELESS] if nameless else [])
        if not strangers:
            return
        self.core.nameless = not named
        names = ", ".join(sorted(diagnostic_senders.foreign))
        sentence = f"{topics.DIAGNOSTICS}: somebody else speaks as {names}: {', '.join(strangers)}"
        if self.health.facts.get(_DIAGNOSTIC_SENDERS) != sentence:
            self.get_logger().warning(sentence)
        self.health.facts[_DIAGNOSTIC_SENDERS] = sentence

    def _name_those_known_since(self) -> None:
        """A sender's name may come after the last of its messages."""
        for name, owner in self.core.owners.items():
            known = self.core.senders.get(name)
            if known is not None and NOT_YET_NAMED in known.names:
                self._name_senders(name, owner)
        if self.core.nameless:
            self._name_strangers()

    def _drain(self) -> list[str]:
        """Write what is still under way; returns the topics that have a gap.

        Ends when nothing has come for a while and no periodic topic has a gap; a gap is waited for
        as long as the sender may need to repeat a message (a heartbeat of Fast DDS is 3 s). Of
        senders that do not cease, because the flight goes on, what they have sent before the call
        is waited for.
        """
        core, until_ns = self.core, self.core.bag.newest_ns
        begun = quiet_since = time.monotonic()
        while (now := time.monotonic()) - begun < _DRAIN_S:
            if sum(self._write_arrived(name) for name in core.subscriptions):
                quiet_since = now
                if now - begun > _SETTLED_S and not core.bag.missing(until_ns):
                    return []
            elif (
                now - quiet_since > _QUIET_S
                and (now - begun > _REPEAT_S or not core.bag.missing())
                and (now - begun > _UNHEARD_S or not self._none_came())
            ):
                return core.bag.missing()
            else:
                time.sleep(_POLL_S)
        return core.bag.missing(until_ns)

    def _none_came(self) -> bool:
        """Whether a node is there and none of something has come that it sends with every tick.

        A node and its senders are made known by ways of their own, either of which may be late.
        """
        bag, space = self.core.bag, self.get_namespace()
        told = {name for row in topics.TABLE if bag.counts.get(row.name) for name in row.replaces}
        there = {
            name for name, namespace in self.get_node_names_and_namespaces() if namespace == space
        }
        return any(
            not there.isdisjoint(bag.rows[name].source)
            or self.count_publishers(self.resolve_topic_name(name))
            for name in self.core.subscriptions
            if bag.rows[name].every_ticks == 1
            and not bag.rows[name].optional
            and not bag.counts[name]
            and name not in told
        )

    def _write_arrived(self, name: str) -> int:
        """Write all messages of a topic that wait in its queue; returns how many."""
        subscription, count = self.core.subscriptions[name], 0
        with subscription.handle:
            # No more than the queue holds: a sender may be as fast as we are.
            while count < _DEPTH:
                taken = subscription.handle.take_message(subscription.msg_type, True)
                if taken is None:
                    break
                self._write(name, *taken)
                count += 1
        return count

    def disengage(self) -> None:
        """Everything that was sent before is in the bag afterwards; what is not is said."""
        missing = self._drain()
        self._name_those_known_since()
        if missing:
            self.core.trouble = self.core.trouble or (
                f"gaps on {', '.join(missing)}: messages were lost, or their node paused"
            )

    def release(self) -> None:
        """Close the bag."""
        bag = self.core.bag
        try:
            bag.close()
        except BagError as error:
            self._complain(error)
            return
        self.get_logger().info(f"{sum(bag.counts.values())} messages in {bag.folder}")


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_bags recorder`."""
    return run(RecorderNode, args)


if __name__ == "__main__":
    sys.exit(main())
