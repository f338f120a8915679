# SPDX-License-Identifier: Apache-2.0
"""Node `recorder`: every topic of the graph, as it comes, into a bag."""

import sys
import time
from collections.abc import Callable, Sequence

from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.managed_node import ManagedNode, NodeSpec, StartError, run
from heli_msgs_bridge.recorder import BagError, BagRecorder
from heli_msgs_bridge.recorder_table import NODE_NAME, TABLE

# Deep enough for a pause of seconds at ten times real time.
_DEPTH = 10_000
# Wall time without a message after which a stream counts as ended.
_QUIET_S = 0.1
_REPEAT_S = 4.0


class RecorderNode(ManagedNode):
    """Records from configuration on; deactivation drains what has arrived."""

    SPEC = NodeSpec(NODE_NAME, "heli_msgs_bridge", TABLE, f"{NODE_NAME}.yaml")

    def _chosen(self) -> list[str]:
        wanted, left_out = self.values["topics"], set(self.values["exclude"]) - {"none"}
        names = [t.name for t in topics.TABLE] if "all" in wanted else list(wanted)
        for name in [*names, *left_out]:
            if name not in topics.BY_NAME:
                known = ", ".join(topics.BY_NAME)
                raise StartError(f"topics: unknown topic '{name}'; known: {known}")
        return [name for name in names if name not in left_out]

    def setup(self) -> None:
        """Make the bag and subscribe."""
        names = self._chosen()
        folder = self.values["bag"] or f"bags/{time.strftime('%Y%m%d-%H%M%S')}"
        try:
            zstd = self.values["compression"] == "zstd"
            self.bag: BagRecorder | None = BagRecorder(folder, names, self.get_namespace(), zstd)
        except BagError as error:
            raise StartError(str(error)) from error
        self._subscriptions_raw = {}
        for name in names:
            cls = topics.message_class(topics.BY_NAME[name].type)
            self._subscriptions_raw[name] = self.create_subscription(
                cls, name, self._writer(name), topics.qos(name, _DEPTH), raw=True
            )
        self.get_logger().info(f"recording {len(names)} topics to {folder}")

    def _write(self, name: str, raw: bytes) -> None:
        if self.bag is None:
            return
        try:
            self.bag.write(name, raw)
        except BagError as error:
            self.report(Level.ERROR, str(error))

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
            self.report(Level.WARN, f"messages lost on {', '.join(missing)}")

    def teardown(self) -> None:
        """Close the bag."""
        bag, self.bag = getattr(self, "bag", None), None
        if bag is None:
            return
        try:
            bag.close()
        except BagError as error:
            self.report(Level.ERROR, str(error))
            return
        self.get_logger().info(f"{sum(bag.counts.values())} messages in {bag.folder}")

    def _drop_entities(self) -> None:
        super()._drop_entities()
        for subscription in getattr(self, "_subscriptions_raw", {}).values():
            self.destroy_subscription(subscription)
        self._subscriptions_raw = {}


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_msgs_bridge recorder`."""
    return run(RecorderNode, args)


if __name__ == "__main__":
    sys.exit(main())
