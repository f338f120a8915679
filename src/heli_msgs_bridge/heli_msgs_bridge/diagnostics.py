# SPDX-License-Identifier: Apache-2.0
"""A node's health as `/diagnostics`: once per simulated second and at once when it changes."""

from collections.abc import Mapping
from enum import IntEnum
from typing import Any

from heli_math.ticks import NS_PER_S, TICKS_PER_S


class Level(IntEnum):
    """Levels of diagnostic_msgs/DiagnosticStatus."""

    OK = 0
    WARN = 1
    ERROR = 2
    STALE = 3


class Reporter:
    """Publishes one status of a node.

    Parameters
    ----------
    publisher : rclpy publisher of diagnostic_msgs/DiagnosticArray
    name : str
        Status name, the node's full name.
    """

    def __init__(self, publisher: Any, name: str) -> None:
        from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

        self._publisher, self._key_value = publisher, KeyValue
        self._array, self._status = DiagnosticArray(), DiagnosticStatus()
        self._status.name = self._status.hardware_id = name
        self._array.status = [self._status]
        self._said: tuple[Level, str] | None = None
        self._due_tick = 0

    def is_due(self, tick: int, level: Level, message: str) -> bool:
        """True if the status changed or a simulated second has passed."""
        # A due tick of another second than the next: time was set back.
        due = not self._due_tick - TICKS_PER_S <= tick < self._due_tick
        return due or (level, message) != self._said

    def publish(
        self, stamp_ns: int, tick: int, level: Level, message: str, values: Mapping[str, Any]
    ) -> None:
        """Send a status, stamped in simulation time."""
        self._said = (level, message)
        self._due_tick = (tick // TICKS_PER_S + 1) * TICKS_PER_S
        stamp = self._array.header.stamp
        stamp.sec, stamp.nanosec = divmod(stamp_ns, NS_PER_S)
        self._status.level = bytes([int(level)])
        self._status.message = message
        self._status.values = [
            self._key_value(key=key, value=str(value)) for key, value in values.items()
        ]
        self._publisher.publish(self._array)
