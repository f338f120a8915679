# SPDX-License-Identifier: Apache-2.0
"""What steers: attitude, climb and turn in mode `attitude`, actuators in `manual`. No ROS.

In mode `attitude` a pilot's sticks lead, or an attitude that is commanded (`asked_attitude`).

What they command is put into the controller's state between two of its steps.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from heli_core.parameters import Parameter
from heli_core.rotations import euler_from_quat, wrap_pi
from heli_core.rows import NAV, SETPOINT, STICKS
from heli_core.ticks import NS_PER_S
from heli_core.trajectory import Trajectory
from heli_outer_pd.disturbance import flyable, hover_share
from heli_outer_pd.guidance.transfer import Motion, MotionLimits, Transfer
from heli_outer_pd.manual_controller import collective_limits
from heli_outer_pd.modes import Command, Fact, Guard, Phase, Refusal, RefusalCause
from heli_outer_pd.reference import (
    GLIMPSE_NS,
    MotionState,
    ReferenceLimits,
    ReferenceRefused,
    anchored,
    flown_now,
    preview,
    reference_state,
    window_of,
)
from heli_outer_pd.state import (
    BY_HAND,
    LOW_BY_HAND,
    MACHINE,
    MEMORY,
    POSITION_LOST,
    STEERED,
    OuterParams,
    OuterState,
)

# -------------------------------------------------------------------------------------------------
# An attitude that messages command, and who leads: they or a pilot's sticks. No ROS.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

_MOVED = 0.1
"""A stick that is so far from where it was when messages began to lead takes over, of 1."""
_ROUNDING_RAD = 1e-6
"""What a quaternion may lose of an angle."""


class _Patience(Protocol):
    """How long silence may last."""

    @property
    def timeout_ns(self) -> int:
        """Without a message."""


class CommandedAttitude(NamedTuple):
    """What messages command.

    Attributes
    ----------
    attitude : (3,) array
        Roll, pitch, heading, NED, rad.
    heard_ns : int or None
        Stamp at which it was heard.
    climb_mps : float
    climb_ns : int or None
        Stamp at which that was heard.
    leads : bool
        Whether this is flown in mode attitude, and not the sticks.
    rest : (4,) array or None
        The sticks as they were when this began to lead, once they are heard.
    """

    attitude: Array
    heard_ns: int | None = None
    climb_mps: float = 0.0
    climb_ns: int | None = None
    leads: bool = False
    rest: Array | None = None

    def is_silent(self, now_ns: int, n: _Patience) -> bool:
        """Whether no attitude has been heard for too long."""
        return self.heard_ns is None or now_ns - self.heard_ns > n.timeout_ns

    def climb_at(self, now_ns: int, timeout_ns: int, most_mps: float) -> float:
        """Speed of the climb, m/s, cut to the largest; none once it is not renewed."""
        if self.climb_ns is None or now_ns - self.climb_ns > timeout_ns:
            return 0.0
        return min(max(self.climb_mps, -most_mps), most_mps)

    def beside(self, sticks: Array) -> "CommandedAttitude":
        """With sticks (4,) heard meanwhile: one that has been moved takes over."""
        if self.rest is None:
            return self._replace(rest=sticks)
        moved = float(np.abs(sticks - self.rest).max()) > _MOVED
        return self._replace(leads=not moved)


NOTHING = CommandedAttitude(np.zeros(3))
"""Never heard."""


def checked_attitude(attitude_rad: Array, hover_rad: Array, most_rad: float) -> Array:
    """An attitude (3,) that may be commanded.

    Parameters
    ----------
    attitude_rad : (3,) array
        Roll, pitch, heading.
    hover_rad : (2,) array
        Roll and pitch of hover.
    most_rad : float
        How far off these the first two may be.

    Raises
    ------
    ReferenceRefused
        A number is not finite, or it is tilted more.
    """
    if attitude_rad.shape != (3,) or not np.isfinite(attitude_rad).all():
        raise ReferenceRefused(
            RefusalCause.NOT_NUMBERS,
            f"attitude {attitude_rad.tolist()} rad; allowed: three numbers",
        )
    tilt = attitude_rad[: SETPOINT.psi]
    if (np.abs(tilt - hover_rad) > most_rad + _ROUNDING_RAD).any():
        tilt_deg = np.degrees(tilt)
        low, high = np.degrees(hover_rad - most_rad), np.degrees(hover_rad + most_rad)
        raise ReferenceRefused(
            RefusalCause.TILT,
            f"roll {tilt_deg[0]:z.1f} deg, pitch {tilt_deg[1]:z.1f} deg nose up; allowed: roll "
            f"{low[0]:.1f} to {high[0]:.1f} deg, pitch {low[1]:.1f} to {high[1]:.1f} deg, which "
            f"are {math.degrees(most_rad):g} deg off hover's",
        )
    return attitude_rad


# -------------------------------------------------------------------------------------------------
# Steering.
# -------------------------------------------------------------------------------------------------

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
    manual: Array
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
            manual=np.asarray(values["sticks.manual"], float),
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
    asked : CommandedAttitude
        What messages command, and whether they lead.
    down, psi : Motion
        Of one axis each: reference of the altitude, NED, and of the heading.
    lean, lean_rate : (2,) arrays
        Roll and pitch off hover's, rad, and how they change; None before the first.
    """

    sticks: Array = field(default_factory=lambda: np.zeros(STICKS.size))
    heard_ns: int | None = None
    asked: CommandedAttitude = NOTHING
    down: Motion = field(default_factory=lambda: Motion.at_rest(np.zeros(1)))
    psi: Motion = field(default_factory=lambda: Motion.at_rest(np.zeros(1)))
    lean: Array | None = None
    lean_rate: Array = field(default_factory=lambda: np.zeros(2))

    def hear(self, sticks: Array, now_ns: int) -> None:
        """Take sticks (4,), cut to -1..1; ReferenceRefused if one is not a number."""
        newest = np.asarray(sticks, float)
        if newest.shape != (STICKS.size,) or not np.isfinite(newest).all():
            raise ReferenceRefused(
                RefusalCause.NOT_NUMBERS,
                f"sticks are {newest.tolist()}; allowed: four numbers in -1..1",
            )
        self.sticks, self.heard_ns = np.clip(newest, -1.0, 1.0), now_ns
        if self.asked.leads:
            self.asked = self.asked.beside(self.sticks)

    def ask(self, attitude_rad: Array, now_ns: int, n: StickNumbers, k: OuterParams) -> None:
        """Follow an attitude (3,) from now on; ReferenceRefused if it is tilted too much."""
        most = min(n.tilt_max_rad, k.tilt_limit)
        wanted = checked_attitude(np.asarray(attitude_rad, float), k.trim[: SETPOINT.psi], most)
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
        self,
        n: StickNumbers,
        k: OuterParams,
        fence: ReferenceLimits,
        now_ns: int,
        state: OuterState,
    ) -> None:
        """Mode attitude: what the controller's next step commands, into its state."""
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
        state.x[MEMORY.steer] = (
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

    def manual(
        self,
        n: StickNumbers,
        k: OuterParams,
        idle_collective: float,
        aground: bool,
        let_go: bool,
        state: OuterState,
    ) -> None:
        """Mode manual: what is flown from the controller's next step on, into its state.

        The collective is that of hover in the stick's middle and idle at its lower end; in the air
        it stays within the limits of the thrust. Sticks that are let go on the ground are as if in
        the middle, with the collective at its lower end.
        """
        s = _LET_GO if let_go else self.sticks
        state.x[MEMORY.manual] = n.manual * s[[STICKS.roll, STICKS.pitch, STICKS.yaw]]
        trim = k.trim[SETPOINT.col]
        col = trim + s[STICKS.climb] * (trim - idle_collective)
        low, high = collective_limits(k)
        if aground:
            low, high = min(low, idle_collective), max(high, idle_collective)
        state.x[MEMORY.manual_col] = min(max(col, low), high)


def _changed(motion: Motion, to_vel: float, acc: float, jerk: float, dt_s: float) -> Motion:
    """One period later, on its way to a velocity within the limits."""
    trajectory = Transfer(motion, None, [math.inf], [acc], [jerk], np.array([to_vel]))
    return Motion(*trajectory.at(dt_s))


def _turned(psi: Motion, to_rad: float, n: StickNumbers, dt_s: float) -> Motion:
    """One period later, on its way to a heading by the shorter side, within the limits."""
    goal, most = psi.pos + wrap_pi(float(to_rad - psi.pos[0])), n.limits
    trajectory = Transfer(
        psi, goal, [n.yaw_rate_radps], [most.yaw_acceleration_radps2], [most.yaw_jerk_radps3]
    )
    return Motion(*trajectory.at(dt_s))


# -------------------------------------------------------------------------------------------------
# How an aircraft stands, and whether it does: it leans, or it does not fall though it should.
#
# By what is measured on any aircraft. No ROS.
# -------------------------------------------------------------------------------------------------

_UNLOADED = 0.75
"""Of the thrust that carried it: with less it would fall, unless something else carries it."""
_MISSING_MPS, _FALLEN = 2.0, 0.3
"""Thrust that is missing would have made it fall by so much; it has fallen by less than so much of
it: touched down. Differences of the speed alone, so that an error of the navigation's is none."""
_USUAL_S = 1.0
"""Time constant of the thrust that carries it."""
_AT_LIMIT_S = 0.5
"""The collective is saturated after so long at its limit; shorter it was a gust."""


def lean(nav: Array, k: OuterParams) -> Array:
    """Roll and pitch (2,), rad, off those of hover."""
    phi, theta, _ = euler_from_quat(nav[NAV.quat])
    return np.array([phi, theta]) - k.trim[: SETPOINT.psi]


def leans_beyond(nav: Array, k: OuterParams, stance: Array) -> float:
    """How much further than it stood (2,) it leans off hover's attitude, either way, rad."""
    return float((np.abs(lean(nav, k)) - np.abs(stance)).max())


def lifts_more(d_col: float, than: float, idle: float, k: OuterParams) -> float:
    """How far a collective is above another in the direction that lifts; negative below."""
    up = k.trim[SETPOINT.col] - idle
    return float(np.copysign(d_col - than, up * (d_col - than)))


class TouchDown:
    """What carries the aircraft: its rotor, or by now the ground.

    Parameters
    ----------
    share : float
        Thrust that carries it now, a share of hover's.
    v_down_mps : float
    """

    def __init__(self, share: float = 1.0, v_down_mps: float = 0.0) -> None:
        self._usual, self._missing_mps, self._began_mps = share, 0.0, v_down_mps

    def detects(self, share: float, v_down_mps: float, g: float, dt_s: float) -> bool:
        """Look at a step of the controller: its thrust, a share of hover's, and the sink speed."""
        if share > _UNLOADED * self._usual:
            self._usual += (share - self._usual) * dt_s / _USUAL_S
            self._missing_mps, self._began_mps = 0.0, v_down_mps
            return False
        self._missing_mps += (self._usual - share) * g * dt_s
        fallen = v_down_mps - self._began_mps
        return self._missing_mps > _MISSING_MPS and fallen < _FALLEN * self._missing_mps


def not_flown(nav: Array, at_limit_s: float, lean_max_rad: float, k: OuterParams) -> set[Guard]:
    """Guards of tilt and thrust that do not hold.

    Parameters
    ----------
    nav : array
        Navigation row.
    at_limit_s : float
        For so long the collective has been at its limit.
    lean_max_rad : float
        Off hover's attitude, for a take-off.
    k : OuterParams
    """
    fails: set[Guard] = set()
    tilt = float(np.abs(lean(nav, k)).max())
    if tilt > lean_max_rad:
        fails.add(Guard.UPRIGHT)
    if tilt > k.tilt_limit:
        fails.add(Guard.ENVELOPE)
    if at_limit_s > _AT_LIMIT_S:
        fails.add(Guard.UNSATURATED)
    return fails


# -------------------------------------------------------------------------------------------------
# Flight by sticks or an attitude, from one controller to the next: who leads, what is seen and
# follows.
#
# `phases` asks it in the modes `attitude` and `manual`. No ROS.
# -------------------------------------------------------------------------------------------------

RISES_MPS = 0.3
"""Climbing so fast the skids have left the ground."""
SINKS_MPS = 0.6
"""Faster than a landing ends. What sinks so is not on the ground, if its height is measured."""
_LIFTS = 0.5
"""With more of hover's thrust it is about to lift, or has flown."""
_NEARLY = 1e-3
_LOWERED = -0.9
"""The collective stick is at its lower end below this."""
_ONCE = ("once another mode is flown, or no sticks are heard",)
_CODES = {Phase.ATTITUDE: STEERED, Phase.MANUAL: LOW_BY_HAND}


@dataclass(frozen=True)
class FlightMoment:
    """A moment of the flight: stamps of it and of flight time 0, ns; navigation row, controller."""

    ns: int
    start_ns: int
    nav: Array
    k: OuterParams


class StickFlight:
    """What is known while the sticks fly, or might.

    Parameters
    ----------
    state : array
        State of the controller, changed in place.

    Attributes
    ----------
    steering : Steering
    aground : bool
        By hand: it stands, as far as is known.
    """

    def __init__(self, state: OuterState) -> None:
        self.steering, self.aground = Steering(), False
        self._state, self._lifted, self._contact = state, False, TouchDown()
        self._told_ns: int | None = None
        self._steered_ns: int | None = None

    def fails(self, now_ns: int, n: StickNumbers) -> set[Guard]:
        """Guards of the sticks that do not hold now."""
        fails = set()
        if self.steering.is_silent(now_ns, n):
            fails.add(Guard.STICKS)
            if self.steering.asked.is_silent(now_ns, n):
                fails.add(Guard.HEARD)
        if self.steering.sticks[STICKS.climb] > _LOWERED:
            fails.add(Guard.LOWERED)
        return fails

    def ask(
        self, phase: Phase, attitude_rad: Array, now: FlightMoment, n: StickNumbers
    ) -> Refusal | None:
        """Take an attitude (3,) that is commanded; ReferenceRefused if it is tilted too much."""
        steering = self.steering
        sticks_lead = phase == Phase.ATTITUDE and not steering.asked.leads
        if sticks_lead and not steering.is_silent(now.ns, n):
            cause = RefusalCause.PILOT_STEERS
            return Refusal(Command.ATTITUDE.value, cause, cause.value, _ONCE)
        steering.ask(attitude_rad, now.ns, n, now.k)
        return None

    def climb(self, phase: Phase, climb_mps: float, now_ns: int) -> Refusal | None:
        """Take the climb of it."""
        if phase != Phase.ATTITUDE or not self.steering.asked.leads:
            cause = RefusalCause.NO_ATTITUDE
            return Refusal("climb", cause, cause.value, ("beside command_attitude",))
        self.steering.climb(climb_mps, now_ns)
        return None

    def fact(
        self, phase: Phase, now: FlightMoment, n: StickNumbers, idle_collective: float, col: float
    ) -> Fact | None:
        """Whether nobody is at the sticks, or the pilot has put it back and let go.

        Parameters
        ----------
        phase : Phase
            ATTITUDE or MANUAL.
        now : Now
            Its navigation row is finite.
        n : StickNumbers
        idle_collective, col : float
            Collective on the ground, and as flown.
        """
        silent = self.steering.is_silent(now.ns, n)
        if phase == Phase.ATTITUDE:
            asked = self.steering.asked
            silent = asked.is_silent(now.ns, n) if asked.leads else silent
            return Fact.SILENT if silent else None
        share, v_down = float(hover_share(col, now.k)), float(now.nav[NAV.down_vel])
        touched = self._contact.detects(share, v_down, now.k.g, now.k.dt_s)
        if not self.aground:
            self.aground = touched
            return Fact.SILENT if silent and not touched else None
        self._lifted |= share > _LIFTS
        if self._lifted and -v_down > RISES_MPS:
            self.aground, self._contact = False, TouchDown(share, v_down)
        idle = abs(col - idle_collective) <= _NEARLY
        return Fact.IDLE if idle and (self._lifted or silent) else None

    def take(
        self,
        before: Phase,
        phase: Phase,
        trajectory: Trajectory | None,
        now: FlightMoment,
        n: StickNumbers,
    ) -> bool:
        """The sticks take over in a phase, from how the aircraft, or its reference, moves.

        False if they have it already. Without sticks an attitude that is heard leads.
        """
        if phase == before:
            return False
        if phase == Phase.ATTITUDE:
            assert trajectory is not None  # a guard has seen to it
            if self.steering.is_silent(now.ns, n):
                self.steering.lead_by_messages()
            by_hand = before == Phase.MANUAL
            window_ns = window_of(now.k, self._state)
            moves = (
                self.flown(before, now)
                if by_hand
                else reference_state(trajectory, now.ns, window_ns)
            )
            self.steering.start(moves.ned[:, 2], moves.psi)
        else:
            share = float(hover_share(self._state.x[MEMORY.command][SETPOINT.col], now.k))
            self._contact = TouchDown(share, float(now.nav[NAV.down_vel]))
            self.aground = before == Phase.STANDING
            self._lifted = not self.aground
        self._told_ns = self._steered_ns = None
        self.hand_over(_CODES[phase])
        return True

    def hand_over(self, code: float) -> None:
        """Another controller flies from its next step on, and goes on from the last command."""
        if code != STEERED:
            self.steering.lead_by_sticks()
        self._state.machine[MACHINE.guidance], self._state.x[MEMORY.takes_over] = code, 1.0

    def flown(self, phase: Phase, now: FlightMoment) -> MotionState:
        """How it moves: vertical and heading as steered in mode attitude, else as measured.

        While the position is lost it counts as at rest: what is not known is not braked.
        """
        flown = flown_now(now.nav, now.k, self._state)
        if self._state.machine[MACHINE.position] == POSITION_LOST:
            flown.ned[1:, :2] = 0.0
        if phase == Phase.ATTITUDE:
            down, psi = self.steering.down, self.steering.psi
            flown.ned[:, 2] = down.pos[0], down.vel[0], down.acc[0]
            flown.psi = np.array([psi.pos[0], psi.vel[0], psi.acc[0]])
        return flown

    def leave(self, phase: Phase, now: FlightMoment) -> Trajectory:
        """A reference that moves as it is flown, to go on from."""
        return anchored(self.flown(phase, now), now.ns, now.start_ns, now.k)

    def tells(self, now_ns: int) -> bool:
        """Whether it is time to tell where it goes: at first, and once a second."""
        due = self._told_ns is None or now_ns - self._told_ns >= GLIMPSE_NS
        if due:
            self._told_ns = now_ns
        return due

    def preview(self, phase: Phase, now: FlightMoment) -> Trajectory:
        """Where it seems to go."""
        return preview(self.flown(phase, now), now.ns, now.start_ns)

    def steer(
        self,
        phase: Phase,
        now: FlightMoment,
        n: StickNumbers,
        idle_collective: float,
        fence: ReferenceLimits,
        low: bool,
    ) -> None:
        """The sticks for the controller's next step, once; `low`: the ground may carry a part."""
        if now.ns == self._steered_ns:
            return
        self._steered_ns = now.ns
        if phase == Phase.ATTITUDE:
            self.steering.steer(n, now.k, fence, now.ns, self._state)
            return
        if flyable(now.nav):
            self._state.machine[MACHINE.guidance] = LOW_BY_HAND if low else BY_HAND
        let_go = self.aground and self.steering.is_silent(now.ns, n)
        self.steering.manual(n, now.k, idle_collective, self.aground, let_go, self._state)
