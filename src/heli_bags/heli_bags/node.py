# SPDX-License-Identifier: Apache-2.0
"""Node `recorder`: every topic of the graph, as it comes, into a bag; others where named."""

import sys
import time
from collections.abc import Callable, Sequence
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile, ReliabilityPolicy

from heli_bags.parameter_table import NODE_NAME, TABLE
from heli_bags.recorder import BagError, BagRecorder, Format, row_of
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.managed_node import ManagedNode, NodeSpec, StartError, run

# Deep enough for a pause of seconds at ten times real time.
_DEPTH = 10_000
# Wall time without a message after which a stream counts as ended.
_QUIET_S = 0.1
_REPEAT_S = 4.0


class RecorderNode(ManagedNode):
    """Records from configuration on; deactivation drains what has arrived."""

    SPEC = NodeSpec(NODE_NAME, "heli_bags", TABLE, f"{NODE_NAME}.yaml")

    def _chosen(self) -> list[str]:
        """What to record, as the parameters name it."""
        wanted, left_out = self.values["topics"], set(self.values["exclude"]) - {"none"}
        names = list(wanted)
        if "all" in names:
            at = names.index("all")
            names[at : at + 1] = [t.name for t in topics.TABLE]
        rows = {row_of(name).name: name for name in names}
        for name in left_out - set(rows):
            row_of(name)
        return [name for short, name in rows.items() if short not in left_out]

    def setup(self) -> None:
        """Make the bag and subscribe."""
        values = self.values
        folder = values["bag"] or f"bags/{time.strftime('%Y%m%d-%H%M%S')}"
        self._subscriptions_raw: dict[str, Any] = {}
        self._trouble = ""
        try:
            names = self._chosen()
            form = Format(
                values["storage"],
                values["compression"] == "zstd",
                round(values["split.size_mb"] * 1e6),
                round(values["split.duration_s"] * 1e9),
            )
            self.bag: BagRecorder | None = BagRecorder(
                folder, names, self.get_namespace(), form, self.start_ns
            )
        except BagError as error:
            raise StartError(str(error)) from error
        for name in self.bag.rows:
            self._subscribe(name, topics.qos(name, _DEPTH))
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        self._flusher = self.create_timer(values["flush_s"], self._flush, clock=clock)
        self.get_logger().info(f"recording {len(self.bag.rows)} topics to {folder}")

    def _subscribe(self, name: str, qos: QoSProfile) -> None:
        cls = topics.message_class(self.bag.rows[name].type)
        self._subscriptions_raw[name] = self.create_subscription(
            cls, name, self._writer(name), qos, raw=True
        )

    def _adapt(self, name: str) -> None:
        """Hear a foreign topic whose publisher is best effort; reliable listeners hear nothing."""
        subscription = self._subscriptions_raw[name]
        if subscription.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT:
            return
        infos = self.get_publishers_info_by_topic(subscription.topic_name)
        if any(i.qos_profile.reliability == ReliabilityPolicy.BEST_EFFORT for i in infos):
            self._write_arrived(name)
            self.destroy_subscription(subscription)
            best_effort = QoSProfile(depth=_DEPTH, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._subscribe(name, best_effort)

    def _flush(self) -> None:
        if self.bag is None:
            return
        for name in self._subscriptions_raw:
            if name not in topics.BY_NAME:
                self._adapt(name)
        try:
            self.bag.flush()
        except BagError as error:
            self._complain(error)

    def _complain(self, error: BagError) -> None:
        """Say that the recording has ended; the flight goes on without it."""
        self._trouble = str(error)
        self.report(Level.ERROR, self._trouble)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lifecycle callback: drain; what is wrong with the bag stays the last word."""
        result = super().on_deactivate(state)
        if self._trouble:
            self.report(Level.ERROR, self._trouble)
        return result

    def _write(self, name: str, raw: bytes) -> None:
        if self.bag is None:
            return
        try:
            self.bag.write(name, raw)
        except BagError as error:
            self._complain(error)

    def _writer(self, name: str) -> Callable[[bytes], None]:
        """Callback of a topic: one call of the executor empties the queue."""

        def write(raw: bytes) -> None:
            self._write(name, raw)
            self._write_arrived(name)

        return write

    def _drain(self) -> None:
        """Write what is still under way.

        Ends when nothing has come for a while and no periodic topic has a gap; a gap is waited for
        as long as the sender may need to repeat a message (a heartbeat of Fast DDS is 3 s).
        """
        begun = quiet_since = time.monotonic()
        while True:
            if sum(self._write_arrived(name) for name in self._subscriptions_raw):
                quiet_since = time.monotonic()
            now = time.monotonic()
            quiet = now - quiet_since > _QUIET_S
            if quiet and (now - begun > _REPEAT_S or not self.bag or not self.bag.missing()):
                return

    def _write_arrived(self, name: str) -> int:
        """Write all messages of a topic that wait in its queue; returns how many."""
        subscription, count = self._subscriptions_raw[name], 0
        with subscription.handle:
            while True:
                taken = subscription.handle.take_message(subscription.msg_type, True)
                if taken is None:
                    return count
                self._write(name, taken[0])
                count += 1

    def disengage(self) -> None:
        """Everything that was sent before is in the bag afterwards; what is not is said."""
        self._drain()
        missing = self.bag.missing() if self.bag else []
        if missing:
            self._trouble = self._trouble or (
                f"gaps on {', '.join(missing)}: messages were lost, or their node paused"
            )

    def teardown(self) -> None:
        """Close the bag."""
        bag, self.bag = getattr(self, "bag", None), None
        if bag is None:
            return
        try:
            bag.close()
        except BagError as error:
            self._complain(error)
            return
        self.get_logger().info(f"{sum(bag.counts.values())} messages in {bag.folder}")

    def _drop_entities(self) -> None:
        super()._drop_entities()
        flusher = self.__dict__.pop("_flusher", None)
        if flusher is not None:
            self.destroy_timer(flusher)
        for subscription in getattr(self, "_subscriptions_raw", {}).values():
            self.destroy_subscription(subscription)
        self._subscriptions_raw = {}


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_msgs_bridge recorder`."""
    return run(RecorderNode, args)


if __name__ == "__main__":
    sys.exit(main())
