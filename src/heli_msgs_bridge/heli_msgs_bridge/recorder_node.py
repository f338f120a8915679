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

    def _writer(self, name: str) -> Callable[[bytes], None]:
        def write(raw: bytes) -> None:
            if self.bag is None:
                return
            try:
                self.bag.write(name, raw)
            except BagError as error:
                self.report(Level.ERROR, str(error))

        return write

    def _drain(self) -> None:
        """Write what has arrived but not been served yet, until nothing has come for a while."""
        quiet_since = time.monotonic()
        while time.monotonic() - quiet_since < _QUIET_S:
            if self._write_arrived():
                quiet_since = time.monotonic()

    def _write_arrived(self) -> int:
        count = 0
        for name, subscription in self._subscriptions_raw.items():
            write = self._writer(name)
            with subscription.handle:
                while True:
                    taken = subscription.handle.take_message(subscription.msg_type, True)
                    if taken is None:
                        break
                    write(taken[0])
                    count += 1
        return count

    def disengage(self) -> None:
        """Everything that was sent before is in the bag afterwards."""
        self._drain()

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
