# SPDX-License-Identifier: Apache-2.0
"""Node `world_clock`: one `/clock` of one world, in which several aircraft fly.

Each aircraft's plant has `clock: world`: it sends no clock, and in lockstep makes its next tick
when the clock has reached the present one. The clock shows the tick that every aircraft has
reached: it is ahead of none, and no aircraft is more than a tick ahead of it.
"""

import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.duration import Duration
from rclpy.qos import QoSCompatibility, qos_check_compatible

from heli_core.parameters import Parameter
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.lifecycle_node import ManagedNode, NodeSpec
from heli_msgs_bridge.messages import ClockEncoder
from heli_msgs_bridge.node_process import run

TABLE = (Parameter("aircraft", "string[]", "Namespaces of the aircraft", read_only=True),)
_LOOK_S = 0.05
# An acknowledgement may take a heartbeat (3 s).
_ACKNOWLEDGE_S = 3.5
_ENCODE = ClockEncoder().encode


@dataclass
class World:
    """What the node has while it is configured.

    Attributes
    ----------
    send : callable
        Sends the bytes of a clock message.
    stamps_ns : dict
        Per aircraft that flies the stamp that it has reached; -1 before the first.
    shown_ns : int
        What the clock shows; -1 before it has begun.
    heard : bool
        Whether all aircraft are ready, and listened to.
    """

    send: Callable[[bytes], None]
    stamps_ns: dict[str, int]
    shown_ns: int = -1
    heard: bool = False


class WorldClockNode(ManagedNode[World, None]):
    """Active means: time runs for several aircraft. Ends when all of their flights are over."""

    SPEC = NodeSpec("world_clock", "heli_flight", TABLE, "world_clock.yaml")

    def configure(self) -> World:
        """Make the clock; the aircraft are listened to when all of them are ready."""
        names = [name.strip("/") for name in self.values["aircraft"]]
        if len(set(names)) < len(names) or not all(names):
            raise ValueError(f"aircraft: {names}: name each namespace once")
        self.subscribe(topics.DIAGNOSTICS, self._on_diagnostics)
        return World(self.create_topic_publisher(topics.CLOCK), dict.fromkeys(names, -1))

    def expected_listeners(self, topic: str) -> set[str]:
        """Nobody: the aircraft wait for the clock."""
        return set()

    def engage(self) -> None:
        """Nobody is listened to yet."""
        self.core.heard = False
        self.create_wall_timer(_LOOK_S, self._look)

    def _ready(self, aircraft: str) -> bool:
        """Whether every link within an aircraft's graph has its listeners."""
        rows = [r for r in topics.TABLE if r.sinks and not (r.latched or r.optional)]
        return all(
            self.count_subscribers(f"/{aircraft}/{row.name}") >= len(row.sinks) for row in rows
        )

    def _is_heard(self) -> bool:
        """Whether the clock is connected with all who listen to it.

        A reader that is in the graph, and not connected yet, would never get the first clock, and
        its aircraft would wait for it until `peer_timeout_s`. A plant subscribes to the clock
        before it subscribes to `actuators`, so after `_ready` its reader is in the graph.
        """
        clock = self.outputs[topics.CLOCK]
        readers = self.get_subscriptions_info_by_topic(topics.CLOCK)
        fits = [qos_check_compatible(clock.qos_profile, r.qos_profile)[0] for r in readers]
        strangers = fits.count(QoSCompatibility.ERROR)  # whose QoS never connects
        return bool(clock.get_subscription_count() >= len(readers) - strangers)

    def _look(self) -> None:
        """Listen once all are ready: each plant waits until it is listened to."""
        core = self.core
        if core.heard or not all(map(self._ready, core.stamps_ns)) or not self._is_heard():
            return
        core.heard = True
        kind = topics.message_class(topics.BY_NAME[topics.TRUTH_ODOM].type)
        for name in core.stamps_ns:
            subscription = self.create_subscription(
                kind, f"/{name}/{topics.TRUTH_ODOM}", self.guarded(partial(self._on_truth, name)),
                topics.qos(topics.TRUTH_ODOM), raw=True,
            )  # fmt: skip
            self.at_end(partial(self.destroy_subscription, subscription))

    def _on_truth(self, aircraft: str, raw: bytes) -> None:
        stamps = self.core.stamps_ns
        if aircraft in stamps:
            stamps[aircraft] = max(stamps[aircraft], stamp_of(raw))
            self._show()

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        """An aircraft whose flight is over holds the others up no longer."""
        core = self.core
        for status in message.status:
            aircraft, _, node = status.name.strip("/").rpartition("/")
            over = any(pair.key == "over" and pair.value == "true" for pair in status.values)
            if node == "plant" and over and core.stamps_ns.pop(aircraft, None) is not None:
                self.get_logger().info(f"{aircraft}: {status.message}")
                self._show()
        if core.heard and not core.stamps_ns:
            # What has been sent is kept in this process until it has been taken.
            for publisher in self.outputs.values():
                publisher.wait_for_all_acked(Duration(seconds=_ACKNOWLEDGE_S))
            self.finished = True

    def _show(self) -> None:
        """Bring the clock to what all have reached, tick by tick."""
        core = self.core
        reached_ns = min(core.stamps_ns.values(), default=-1)
        if reached_ns < 0:
            return
        tick_ns = self.rate.tick_ns
        first_ns = self.start_ns if core.shown_ns < 0 else core.shown_ns + tick_ns
        for stamp_ns in range(first_ns, reached_ns + 1, tick_ns):
            core.send(_ENCODE(stamp_ns))
            core.shown_ns = stamp_ns
        self.tick = (core.shown_ns - self.start_ns) // tick_ns


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_flight world_clock`; returns the exit code."""
    return run(WorldClockNode, args)


if __name__ == "__main__":
    sys.exit(main())
