# SPDX-License-Identifier: Apache-2.0
"""A mode flown from outside: a class of yours that says, many times a second, what to fly.

As `px4_ros2::ModeBase`: what it requires is checked before it takes over and at each step, and the
aircraft hovers when it is done, fails, is cancelled or falls silent. It flies velocities or
attitudes, on `command_velocity`, `command_attitude` and `command_climb`.
"""

import math
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, fields
from enum import Enum
from typing import Any

import numpy as np
from geometry_msgs.msg import QuaternionStamped, TwistStamped
from numpy.typing import NDArray
from rclpy.node import Node

from heli_actions.goals import Code
from heli_core.rotations import euler_from_quat, quat_from_euler
from heli_core.rows import NAV
from heli_core.ticks import NS_PER_S
from heli_msgs_bridge import frames, topics
from heli_msgs_bridge.diagnostics import FACT_REFUSED, refusal_of
from heli_msgs_bridge.status import NO_FAILSAFE, AircraftStatus

Array = NDArray[np.float64]

# -------------------------------------------------------------------------------------------------
# What a mode sees, requires and says.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Moment:
    """What a mode knows at a step.

    Attributes
    ----------
    flown_s : float
        Flight time by its stamps, s.
    pos_enu_m, vel_enu_mps : (3,) arrays
        Navigated, in `map`: east, north, up.
    roll_deg, pitch_deg, heading_deg : float
        Right down, nose up, 0 is north and 90 east.
    status : AircraftStatus
    """

    flown_s: float
    pos_enu_m: Array
    vel_enu_mps: Array
    roll_deg: float
    pitch_deg: float
    heading_deg: float
    status: AircraftStatus

    @classmethod
    def of(cls, nav: Array, stamp_ns: int, status: AircraftStatus) -> "Moment":
        """Out of a navigation row (31,), NED, FRD."""
        pos, vel = np.empty(3), np.empty(3)
        frames.ned_to_enu(nav[NAV.pos], pos)
        frames.ned_to_enu(nav[NAV.vel], vel)
        roll, pitch, heading = (math.degrees(angle) for angle in euler_from_quat(nav[NAV.quat]))
        return cls(stamp_ns / NS_PER_S, pos, vel, roll, pitch, heading % 360.0, status)


class Requirement(Enum):
    """What a mode may require; the value says what fails."""

    POSITION = "the outer loop holds no position"
    AIRBORNE = "the aircraft stands on the ground"
    ARMED = "the aircraft is disarmed"
    NO_FAILSAFE = "a failsafe acts"

    def holds(self, status: AircraftStatus) -> bool:
        """Whether it is met."""
        match self:
            case Requirement.POSITION:
                return status.ready
            case Requirement.AIRBORNE:
                return not status.landed
            case Requirement.ARMED:
                return status.armed
            case Requirement.NO_FAILSAFE:
                return status.failsafe == NO_FAILSAFE


@dataclass(frozen=True)
class Velocity:
    """What to fly: m/s in `map`; rate of turn, deg/s, to the right positive."""

    east_mps: float
    north_mps: float
    up_mps: float = 0.0
    yaw_rate_degps: float = 0.0


@dataclass(frozen=True)
class Attitude:
    """What to fly: deg, right down, nose up, 0 is north; and how to climb, m/s."""

    roll_deg: float
    pitch_deg: float
    heading_deg: float
    climb_mps: float = 0.0


class ForeignMode(ABC):
    """A mode of yours: derive from it and write `update`.

    Attributes
    ----------
    name : str
        For people.
    requires : frozenset of Requirement
        Checked before it takes over and at each step.
    """

    name = "foreign mode"
    requires = frozenset(Requirement)

    @abstractmethod
    def update(self, now: Moment) -> Velocity | Attitude | None:
        """What to fly now; None when it is done. Called with each navigation that comes."""

    def refuses(self, now: Moment) -> str:
        """Why it cannot be flown now, by requirements of your own; empty if it can."""
        return ""


# -------------------------------------------------------------------------------------------------
# Its flight: before, while, and how it ends.
# -------------------------------------------------------------------------------------------------

FLOWN_AS = {Velocity: "velocity", Attitude: "attitude"}
"""Mode of the outer loop in which each is flown."""
_SENT_ON = {
    Velocity: (topics.COMMAND_VELOCITY,),
    Attitude: (topics.COMMAND_ATTITUDE, topics.COMMAND_CLIMB),
}
OTHER_NODE = "OTHER_NODE"
"""Cause: another node sends on the topic of the mode."""
NOT_FINITE = "NOT_FINITE"
"""Cause: a mode says what is no number; it is not sent."""
UNMET = "UNMET"
"""Cause: a requirement of the mode's own is not met."""
FAILED = "FAILED"
"""Cause: the mode's own code has raised."""


class ForeignFlight:
    """One flight of a mode: stepped with each navigation, in the pilot's thread.

    Parameters
    ----------
    mode : ForeignMode
    node : Node
        What sends.
    answer_s : float
        Wall time in which the outer loop has to take the mode over.
    finish : callable
        Called once, with code, sentence, cause, and whether the aircraft is to hold.
    """

    def __init__(
        self,
        mode: ForeignMode,
        node: Node,
        answer_s: float,
        finish: Callable[[Code, str, str, bool], None],
    ) -> None:
        self._mode, self._node, self._answer_s, self._finish = mode, node, answer_s, finish
        self._publishers: dict[str, Any] = {}
        self._refused_before: dict[str, int] = {}
        self._kind: type[Velocity] | type[Attitude] | None = None
        self._entered, self._begun_s, self._over = False, -1.0, False

    def end(self, code: Code, sentence: str, cause: str = "", holds: bool = True) -> None:
        """It is over: nothing is sent any more."""
        if self._over:
            return
        self._over = True
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        self._finish(code, f"{self._mode.name}: {sentence}", cause, holds and self._entered)

    def step(
        self, nav: Array, stamp_ns: int, status: AircraftStatus, facts: Any, wall_s: float
    ) -> None:
        """See whether it may go on; have the mode say what to fly, and send it."""
        begins = self._begun_s < 0.0
        self._begun_s = wall_s if begins else self._begun_s
        now = Moment.of(nav, stamp_ns, status)
        if self._is_left(status, facts, wall_s) or not self._may_go_on(now, begins):
            return
        try:
            asked = self._mode.update(now)
        except Exception as error:
            self.end(Code.MODE_LEFT, f"{type(error).__name__}: {error}", FAILED)
            return
        if asked is None:
            self.end(Code.DONE, "done")
            return
        numbers = [getattr(asked, field.name) for field in fields(asked)]
        if not np.isfinite(numbers).all():
            self.end(Code.MODE_LEFT, f"{asked} is not finite; it was not sent", NOT_FINITE)
        elif self._opened(type(asked), facts):
            self._send(asked, stamp_ns)

    def _may_go_on(self, now: Moment, begins: bool) -> bool:
        """Whether all requirements are met; it ends if they are not."""
        code = Code.REFUSED if begins else Code.MODE_LEFT
        for requirement in self._mode.requires:
            if not requirement.holds(now.status):
                self.end(code, requirement.value, requirement.name)
                return False
        if why := self._mode.refuses(now):
            self.end(code, why, UNMET)
            return False
        return True

    def _is_left(self, status: AircraftStatus, facts: Any, wall_s: float) -> bool:
        """Whether the outer loop flies something else, or has not begun to fly it in time."""
        if self._kind is None:
            return False
        if status.mode == FLOWN_AS[self._kind]:
            self._entered = True
            return False
        why = self._refusal(facts)
        if self._entered:
            self.end(Code.MODE_LEFT, f"left for mode {status.mode}{why}", holds=False)
        elif wall_s - self._begun_s > self._answer_s:
            # One that was refused as late may be followed by one that is not.
            late = f"not taken over in {self._answer_s:g} s{why}"
            cause = self._refusal_cause() if why else ""
            self.end(Code.REFUSED if why else Code.NO_ANSWER, late, cause)
        return self._over

    def _counts(self, facts: Any) -> dict[str, tuple[int, str]]:
        kind = self._kind
        names = () if kind is None else _SENT_ON[kind]
        return {name: refusal_of(facts.get(FACT_REFUSED + name, "")) for name in names}

    def _refusal(self, facts: Any) -> str:
        """What the outer loop has refused of it, with a semicolon in front; empty for nothing."""
        for name, (count, why) in self._counts(facts).items():
            if count > self._refused_before.get(name, 0):
                return f"; {why}"
        return ""

    def _refusal_cause(self) -> str:
        return OTHER_NODE if self._others() else "REFUSED"

    def _others(self) -> list[str]:
        """Names of the other nodes that send what it sends."""
        own, names = self._node.get_fully_qualified_name(), set()
        for topic in () if self._kind is None else _SENT_ON[self._kind]:
            for info in self._node.get_publishers_info_by_topic(topic):
                names.add(f"{info.node_namespace.rstrip('/')}/{info.node_name}")
        return sorted(names - {own})

    def _opened(self, kind: type[Velocity] | type[Attitude], facts: Any) -> bool:
        """Whether there is somebody to send by; it is refused where another node sends already."""
        if self._kind is kind:
            return True
        if self._kind is not None:
            self.end(Code.MODE_LEFT, "it changes between velocity and attitude", FAILED)
            return False
        self._kind = kind
        self._refused_before = {name: count for name, (count, _) in self._counts(facts).items()}
        if others := self._others():
            self.end(Code.REFUSED, f"{', '.join(others)} sends {_SENT_ON[kind][0]}", OTHER_NODE)
            return False
        for topic in _SENT_ON[kind]:
            cls = topics.message_class(topics.BY_NAME[topic].type)
            self._publishers[topic] = self._node.create_publisher(cls, topic, topics.qos(topic, 10))
        return True

    def _send(self, asked: Velocity | Attitude, stamp_ns: int) -> None:
        if isinstance(asked, Velocity):
            linear, turn = (asked.east_mps, asked.north_mps, asked.up_mps), asked.yaw_rate_degps
            self._twist(topics.COMMAND_VELOCITY, stamp_ns, linear, -math.radians(turn))
            return
        message, q = QuaternionStamped(), np.empty(4)
        _stamp(message.header, stamp_ns)
        angles = map(math.radians, (asked.roll_deg, asked.pitch_deg, asked.heading_deg))
        frames.quat_ned_frd_to_enu_flu(quat_from_euler(*angles), q)
        r = message.quaternion
        r.x, r.y, r.z, r.w = q.tolist()
        self._publishers[topics.COMMAND_ATTITUDE].publish(message)
        self._twist(topics.COMMAND_CLIMB, stamp_ns, (0.0, 0.0, asked.climb_mps))

    def _twist(
        self, topic: str, stamp_ns: int, linear: tuple[float, float, float], turn: float = 0.0
    ) -> None:
        message = TwistStamped()
        _stamp(message.header, stamp_ns)
        v = message.twist.linear
        v.x, v.y, v.z = map(float, linear)
        message.twist.angular.z = float(turn)
        self._publishers[topic].publish(message)


def _stamp(header: Any, stamp_ns: int) -> None:
    header.frame_id = topics.MAP
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
