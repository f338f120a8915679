# SPDX-License-Identifier: Apache-2.0
"""What steers: attitude, climb and turn in mode `attitude`, actuators in `manual`. No ROS.

In mode `attitude` a pilot's sticks lead, or an attitude that is commanded (`asked_attitude`).

What they command is put into the law's state between two of its steps.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_guidance.limits import MotionLimits
from heli_guidance.transfer import Motion, Transfer
from heli_math.rotations import wrap_pi
from heli_math.rows import SETPOINT, STICKS
from heli_math.ticks import NS_PER_S
from heli_outer_pd.asked_attitude import NOTHING, Asked, judged
from heli_outer_pd.hand_law import collective_limits
from heli_outer_pd.outer_state import MEMORY, OuterKernel
from heli_outer_pd.reference_limits import ReferenceLimits, ReferenceRefused
from heli_parameters.parameters import Parameter

Array = NDArray[np.float64]

STICK_ROWS: tuple[Parameter, ...] = (
    Parameter("command.timeout_s", "double", "A velocity, sticks or an attitude that are not "
              "renewed for so long are followed no more: the aircraft halts and holds", "s",
              lower=0.1, upper=5.0),
    Parameter("sticks.tilt_max_deg", "double", "Roll and pitch off hover's at full stick, in mode "
              "attitude; a commanded attitude may have as much", "deg", lower=1.0, upper=40.0),
    Parameter("sticks.tilt_radps", "double", "Roll and pitch follow what is commanded as two "
              "lags of this bandwidth, in mode attitude: a jerk of the hand is no step", "rad/s",
              lower=1.0, upper=100.0),
    Parameter("sticks.yaw_rate_degps", "double", "Rate of the heading at full stick, in mode "
              "attitude, and towards a commanded one", "deg/s", lower=1.0, upper=180.0),
    Parameter("sticks.climb_mps", "double", "Speed of the climb at full stick, in mode attitude, "
              "and the largest that is commanded", "m/s", lower=0.1, upper=5.0),
    Parameter("sticks.manual", "double[]", "In mode manual: d_lat, d_lon, d_ped about trim at full "
              "stick to the right, nose up, nose to the right", shape=(3,), lower=-1.0, upper=1.0),
)  # fmt: skip
"""Rows of the outer loop."""

_LET_GO = np.array([0.0, 0.0, 0.0, -1.0])


@dataclass(frozen=True)
class StickNumbers:
    """What full sticks mean, as `STICK_ROWS` describe it; rad."""

    timeout_ns: int
    tilt_max_rad: float
    tilt_radps: float
    yaw_rate_radps: float
    climb_mps: float
    hand: Array
    limits: MotionLimits

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> "StickNumbers":
        """From the parameters of the outer loop."""
        return cls(
            timeout_ns=round(values["command.timeout_s"] * NS_PER_S),
            tilt_max_rad=math.radians(values["sticks.tilt_max_deg"]),
            tilt_radps=values["sticks.tilt_radps"],
            yaw_rate_radps=math.radians(values["sticks.yaw_rate_degps"]),
            climb_mps=values["sticks.climb_mps"],
            hand=np.asarray(values["sticks.manual"], float),
            limits=MotionLimits.from_parameters(values, "goto"),
        )


@dataclass
class Steering:
    """The newest sticks and what they have made of altitude and heading.

    Attributes
    ----------
    sticks : (4,) array
        A `StickRow`.
    heard_ns : int or None
        Stamp of them.
    asked : Asked
        What messages command, and whether they lead.
    down, psi : Motion
        Of one axis each: reference of the altitude, NED, and of the heading.
    lean, lean_rate : (2,) arrays
        Roll and pitch off hover's, rad, and how they change; None before the first.
    """

    sticks: Array = field(default_factory=lambda: np.zeros(STICKS.size))
    heard_ns: int | None = None
    asked: Asked = NOTHING
    down: Motion = field(default_factory=lambda: Motion.at_rest(np.zeros(1)))
    psi: Motion = field(default_factory=lambda: Motion.at_rest(np.zeros(1)))
    lean: Array | None = None
    lean_rate: Array = field(default_factory=lambda: np.zeros(2))

    def hear(self, sticks: Array, now_ns: int) -> None:
        """Take sticks (4,), cut to -1..1; ReferenceRefused if one is not a number."""
        given = np.asarray(sticks, float)
        if given.shape != (STICKS.size,) or not np.isfinite(given).all():
            raise ReferenceRefused(f"sticks are {given.tolist()}; allowed: four numbers in -1..1")
        self.sticks, self.heard_ns = np.clip(given, -1.0, 1.0), now_ns
        if self.asked.leads:
            self.asked = self.asked.beside(self.sticks)

    def ask(self, attitude_rad: Array, now_ns: int, n: StickNumbers, k: OuterKernel) -> None:
        """Follow an attitude (3,) from now on; ReferenceRefused if it is tilted too much."""
        most = min(n.tilt_max_rad, k.tilt_limit)
        wanted = judged(np.asarray(attitude_rad, float), k.trim[: SETPOINT.psi], most)
        self.asked = self.asked._replace(attitude=wanted, heard_ns=now_ns)
        self.lead_by_messages()
        if not self.is_silent(now_ns, n):
            self.asked = self.asked.beside(self.sticks)

    def climb(self, climb_mps: float, now_ns: int) -> None:
        """Climb so from now on, m/s."""
        self.asked = self.asked._replace(climb_mps=climb_mps, climb_ns=now_ns)

    def lead_by_messages(self) -> None:
        """What is asked leads, until the sticks are moved."""
        if not self.asked.leads:
            self.asked = self.asked._replace(leads=True, rest=None, climb_ns=None)

    def lead_by_sticks(self) -> None:
        """The sticks lead; what is asked now waits."""
        self.asked = self.asked._replace(leads=False)

    def is_silent(self, now_ns: int, n: StickNumbers) -> bool:
        """Whether nothing has been heard for too long."""
        return self.heard_ns is None or now_ns - self.heard_ns > n.timeout_ns

    def start(self, motion_down: Array, motion_psi: Array) -> None:
        """Begin from altitude and heading and how they move: (3,) each, with two derivatives."""
        self.down = Motion(*(motion_down[i : i + 1].copy() for i in range(3)))
        self.psi = Motion(*(motion_psi[i : i + 1].copy() for i in range(3)))
        self.lean = None

    def steer(
        self, n: StickNumbers, k: OuterKernel, fence: ReferenceLimits, now_ns: int, state: Array
    ) -> None:
        """Mode attitude: what the law's next step commands, into its state."""
        most, s, asked = n.limits, self.sticks, self.asked
        if asked.leads:
            down_mps = -asked.climb_at(now_ns, n.timeout_ns, n.climb_mps)
            lean = asked.attitude[: SETPOINT.psi] - k.trim[: SETPOINT.psi]
            self.psi = _turned(self.psi, asked.attitude[SETPOINT.psi], n, k.dt_s)
        else:
            down_mps = -s[STICKS.climb] * n.climb_mps
            lean = n.tilt_max_rad * s[[STICKS.roll, STICKS.pitch]]
            turn = s[STICKS.yaw] * n.yaw_rate_radps
            self.psi = _changed(
                self.psi, turn, most.yaw_acceleration_radps2, most.yaw_jerk_radps3, k.dt_s
            )
        climb = self._fenced(down_mps, fence, most)
        self.down = _changed(self.down, climb, most.acceleration_mps2, most.jerk_mps3, k.dt_s)
        heading = wrap_pi(float(self.psi.pos[0] + k.heading_lead_s * self.psi.vel[0]))
        roll, pitch = self._leaned(lean, n, k.dt_s)
        state[MEMORY.steer] = (
            k.trim[SETPOINT.phi] + roll,
            k.trim[SETPOINT.theta] + pitch,
            heading,
            self.down.pos[0],
            self.down.vel[0],
            self.down.acc[0],
        )

    def _leaned(self, goal: Array, n: StickNumbers, dt_s: float) -> Array:
        """Roll and pitch (2,), rad, one period later: two equal lags, sampled exactly."""
        if self.lean is None:
            self.lean, self.lean_rate = goal, np.zeros(2)
        w, off = n.tilt_radps, self.lean - goal
        c, fades = self.lean_rate + w * off, math.exp(-w * dt_s)
        self.lean = goal + fades * (off + c * dt_s)
        self.lean_rate = fades * (self.lean_rate - w * c * dt_s)
        return self.lean

    def _fenced(self, down_mps: float, fence: ReferenceLimits, most: MotionLimits) -> float:
        """The speed of the descent, none if it could not be ended inside the fence."""
        ends = Transfer(
            self.down, None, [math.inf], [most.acceleration_mps2], [most.jerk_mps3]
        )  # fmt: skip
        up = -float(ends.at(ends.duration_s)[0][0])
        low, high = fence.altitude_min_m, fence.altitude_max_m
        if (down_mps > 0.0 and up <= low) or (down_mps < 0.0 and up >= high):
            return 0.0
        return down_mps

    def by_hand(
        self,
        n: StickNumbers,
        k: OuterKernel,
        idle_collective: float,
        aground: bool,
        let_go: bool,
        state: Array,
    ) -> None:
        """Mode manual: what is flown from the law's next step on, into its state.

        The collective is that of hover in the stick's middle and idle at its lower end; in the air
        it stays within the limits of the thrust. Sticks that are let go on the ground are as if in
        the middle, with the collective at its lower end.
        """
        s = _LET_GO if let_go else self.sticks
        state[MEMORY.hand] = n.hand * s[[STICKS.roll, STICKS.pitch, STICKS.yaw]]
        trim = k.trim[SETPOINT.col]
        col = trim + s[STICKS.climb] * (trim - idle_collective)
        low, high = collective_limits(k)
        if aground:
            low, high = min(low, idle_collective), max(high, idle_collective)
        state[MEMORY.hand_col] = min(max(col, low), high)


def _changed(motion: Motion, to_vel: float, acc: float, jerk: float, dt_s: float) -> Motion:
    """One period later, on its way to a velocity within the limits."""
    way = Transfer(motion, None, [math.inf], [acc], [jerk], np.array([to_vel]))
    return Motion(*way.at(dt_s))


def _turned(psi: Motion, to_rad: float, n: StickNumbers, dt_s: float) -> Motion:
    """One period later, on its way to a heading by the shorter side, within the limits."""
    goal, most = psi.pos + wrap_pi(float(to_rad - psi.pos[0])), n.limits
    way = Transfer(
        psi, goal, [n.yaw_rate_radps], [most.yaw_acceleration_radps2], [most.yaw_jerk_radps3]
    )
    return Motion(*way.at(dt_s))
