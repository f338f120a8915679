# SPDX-License-Identifier: Apache-2.0
"""Node `scenario`: publishes a scenario's reference, latched, for a graph that starts itself.

`./hover_test.sh` does this in its supervisor; this node is for `ros2 run` and `ros2 launch`, where
every node configures and activates itself.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from rclpy.qos import QoSProfile, ReliabilityPolicy

from heli_flight.scenario import NODE_NAME, TABLE, Scenario
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.command_messages import encode_reference
from heli_msgs_bridge.lifecycle_node import ManagedNode, NodeSpec
from heli_msgs_bridge.node_process import run

_FIXED = tuple(replace(row, read_only=True) for row in TABLE)


@dataclass
class Script:
    """What the node has while it is configured: the scenario, and what sends its reference."""

    scenario: Scenario
    send: Callable[[Any], None]


class ScenarioNode(ManagedNode[Script, None]):
    """Active means: the reference has been published; late listeners get it, too."""

    SPEC = NodeSpec(NODE_NAME, "heli_flight", _FIXED, "scenario.yaml")

    def configure(self) -> Script:
        """Make the reference and its publisher; hear what time it is, to say when all is well."""
        newest = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
        self.subscribe(topics.CLOCK, self._take_clock, newest, raw=True)
        return Script(
            Scenario.from_parameters(self.values), self.create_topic_publisher(topics.REFERENCE)
        )

    def _take_clock(self, raw: bytes) -> None:
        self.tick = (stamp_of(raw) - self.start_ns) // self.rate.tick_ns

    def expected_listeners(self, topic: str) -> set[str]:
        """Nobody is waited for: the reference is latched."""
        return set()

    def begin(self) -> None:
        """Publish the reference."""
        trajectory = replace(self.core.scenario.reference, start_ns=self.start_ns)
        self.core.send(encode_reference(trajectory, self.get_namespace()))
        self.get_logger().info(f"reference published: {self.core.scenario.kind}")


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_flight scenario`; returns the exit code."""
    return run(ScenarioNode, args)


if __name__ == "__main__":
    sys.exit(main())
