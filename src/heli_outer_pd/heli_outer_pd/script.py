# SPDX-License-Identifier: Apache-2.0
"""Commands at given times of a flight: what a scenario does instead of a pilot. No ROS."""

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from heli_core.parameters import Parameter
from heli_core.rcl_yaml import ParameterCause, ParameterError
from heli_core.rotations import euler_from_quat, wrap_pi
from heli_core.rows import NAV, REFERENCE, SETPOINT, STICKS
from heli_core.ticks import NS_PER_S
from heli_core.trajectory import Trajectory
from heli_outer_pd.goto import PhaseNumbers
from heli_outer_pd.manual import StickFlight, StickNumbers
from heli_outer_pd.modes import STEERED as BY_STICKS
from heli_outer_pd.modes import Command, Phase, Refusal
from heli_outer_pd.reference import ReferenceRefused
from heli_outer_pd.state import OuterParams

# -------------------------------------------------------------------------------------------------
# Script.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

_WIDTHS = {"sticks": STICKS.size, "attitude_deg": 3}
_COMMANDS = tuple(command for command in Command if command != Command.FOLLOW)


def _times(name: str, what: str) -> Parameter:
    return Parameter(f"commands.{name}", "double[]", f"{what}, rising; a negative one is never",
                     "s", lower=-1.0, upper=86400.0, read_only=True)  # fmt: skip


SCRIPT_ROWS: tuple[Parameter, ...] = (
    _times("at_s", "Flight times of commands"),
    Parameter("commands.what", "string[]", "What is commanded at each of them",
              choices=_COMMANDS, read_only=True),
    Parameter("commands.goto_ned_m", "double[]", "Where each goto goes, NED", "m",
              shape=(None, 3), upper=1e5, read_only=True),
    Parameter("commands.velocity_ned_mps", "double[]", "Velocity of each velocity, NED", "m/s",
              shape=(None, 3), upper=1e3, read_only=True),
    _times("sticks_at_s", "Flight times from which the sticks are held"),
    Parameter("commands.sticks", "double[]", "Roll, pitch, yaw and climb at each of them",
              shape=(None, STICKS.size), lower=-1.0, upper=1.0, read_only=True),
    _times("attitude_at_s", "Flight times from which an attitude is commanded"),
    Parameter("commands.attitude_deg", "double[]", "Roll, pitch and heading at each of them, nose "
              "up and to the right positive", "deg", shape=(None, 3), lower=-360.0, upper=360.0,
              read_only=True),
    Parameter("commands.climb_mps", "double[]", "Climb at each of them", "m/s", lower=-1e3,
              upper=1e3, read_only=True),
    _times("pilot_at_s", "Flight times from which a pilot flies the sticks"),
    Parameter("commands.pilot_height_m", "double[]", "To what height above where it stood, at each "
              "of them; 0 sets it down", "m", lower=0.0, upper=1e3, read_only=True),
)  # fmt: skip
"""Rows of the outer loop; a scenario's file sets them."""


@dataclass(frozen=True)
class ScriptCommand:
    """A command of the script.

    Attributes
    ----------
    at_ns : int
        Flight time.
    command : Command
    goal_ned_m, velocity_ned_mps : (3,) array, optional
        Of a goto, of a velocity.
    """

    at_ns: int
    command: Command
    goal_ned_m: Array | None = None
    velocity_ned_mps: Array | None = None


@dataclass(frozen=True)
class HeldSticks:
    """Sticks (4,) that are held from a flight time on, ns."""

    at_ns: int
    sticks: Array


@dataclass(frozen=True)
class HeldAttitude:
    """Roll, pitch, heading (3,), rad, and a climb that are commanded from a flight time on, ns."""

    at_ns: int
    attitude_rad: Array
    climb_mps: float


@dataclass(frozen=True)
class PilotHeight:
    """A height, m, to which the scripted pilot flies from a flight time on, ns; 0: the ground."""

    at_ns: int
    height_m: float


Scripted = ScriptCommand | HeldSticks | HeldAttitude | PilotHeight


def script_of(p: Mapping[str, Any]) -> Sequence[Scripted]:
    """What checked parameters (`SCRIPT_ROWS`) order, in time; hands before commands.

    Raises
    ------
    ParameterError
        Numbers of times, commands and goals do not agree, or the times do not rise.
    """
    sticks = _paired(p, "sticks_at_s", "sticks", "rows")
    heights = _paired(p, "pilot_at_s", "pilot_height_m", "heights")
    script: list[Scripted] = [HeldSticks(at_ns, np.array(row)) for at_ns, row in sticks]
    attitudes = _paired(p, "attitude_at_s", "attitude_deg", "attitudes")
    climbs = _paired(p, "attitude_at_s", "climb_mps", "climbs")
    script += [
        HeldAttitude(at_ns, np.radians(row), float(climb))
        for (at_ns, row), (_, climb) in zip(attitudes, climbs, strict=True)
    ]
    script += [PilotHeight(at_ns, float(height)) for at_ns, height in heights]
    script += _orders(p)
    return sorted(script, key=lambda order: order.at_ns)


def _paired(p: Mapping[str, Any], times: str, name: str, what: str) -> list[tuple[int, Any]]:
    """Times, ns, with their rows, without those that are never."""
    at_s, rows = np.asarray(p[f"commands.{times}"], float), p[f"commands.{name}"]
    if name in _WIDTHS:
        rows = np.reshape(rows, (-1, _WIDTHS[name]))
    if len(at_s) != len(rows):
        raise ParameterError(
            f"commands.{times} has {len(at_s)} times, commands.{name} {len(rows)} {what}",
            ParameterCause.LENGTH,
            allowed="as many",
        )
    ordered_s = at_s[at_s >= 0.0]
    if (np.diff(ordered_s) <= 0.0).any():
        raise ParameterError(
            f"commands.{times} is {at_s.tolist()}",
            ParameterCause.CONFLICT,
            value=at_s,
            allowed="rising times",
        )
    return [(round(at * NS_PER_S), row) for at, row in zip(at_s, rows, strict=True) if at >= 0.0]


def _orders(p: Mapping[str, Any]) -> list[ScriptCommand]:
    places = {
        Command.GOTO: ("goto_ned_m", "places"),
        Command.VELOCITY: ("velocity_ned_mps", "velocities"),
    }
    goals = {c: np.reshape(p[f"commands.{key}"], (-1, 3)) for c, (key, _) in places.items()}
    left = {command: iter(rows) for command, rows in goals.items()}
    orders = []
    for at_ns, name in _paired(p, "at_s", "what", "commands"):
        command = Command(name)
        where = next(left[command], None) if command in left else None
        if command in left and where is None:
            key, what = places[command]
            raise ParameterError(
                f"commands.what has {list(p['commands.what']).count(name)} times {name}, "
                f"commands.{key} {len(goals[command])} {what}",
                ParameterCause.LENGTH,
                allowed="one for each",
            )
        goal, velocity = (where, None) if command == Command.GOTO else (None, where)
        orders.append(ScriptCommand(at_ns, command, goal, velocity))
    return orders


# -------------------------------------------------------------------------------------------------
# A scripted pilot: flies the sticks by what a human sees, as late as a human does. No ROS.
#
# Roll, pitch and heading, height, and how it drifts and climbs, 0.2 s ago; that is the effective
# delay of a pilot of McRuer's crossover model (McRuer, Krendel, "Mathematical models of human
# pilot
# behavior", AGARDograph 188, 1974: 0.1 to 0.4 s). Each loop's crossover leaves it a phase margin.
# -------------------------------------------------------------------------------------------------

_SEES_S = 0.2
_ROLL_RADPS = 2.59
"""Steady rate of roll or pitch, rad/s, per cyclic; per pedal 3.85 (`inner_loop.yaml`, model.B)."""
_YAW_RADPS = 3.85
_ATTITUDE, _HEADING = 1.8, 1.2
"""Crossovers of the attitude and of the heading, rad/s."""
_DRIFT, _PLACE = 0.6, 0.12
"""Acceleration against a drift, 1/s, and back to the place, 1/s2."""
_LEAN_RAD = 0.15
_CLIMB, _TRIM = 0.2, 0.08
"""Collective stick per speed of the climb that is missing, s/m, and per metre of it."""
_HEIGHT, _FAST_MPS, _SETS_DOWN_MPS = 0.5, 1.0, 0.3
_RAISES, _LOWERS, _LIGHT = 0.5, 1.0, -0.3
"""The collective stick is raised, and lowered, on the ground by so much a second; cyclic is moved
above the third."""
_NEAR_M, _TOUCHES_M = 3.0, 0.6
"""Slowly below the first; where it stood, less the receiver's error, below the second."""
_STILL_MPS, _STILL_S, _SURE_S = 0.12, 0.4, 1.6
"""It is down when it sinks no more for so long, the longer the higher it seems."""


class HumanPilotModel:
    """A pilot at the sticks.

    Parameters
    ----------
    k : OuterParams
        Trim attitude; period of the looks.
    n : StickNumbers
        What the sticks do.
    standing : bool
        Begin with the collective stick at its lower end.
    """

    def __init__(self, k: OuterParams, n: StickNumbers, standing: bool) -> None:
        self._k, self._n = k, n
        self._recent_navs: deque[Array] = deque(maxlen=1 + round(_SEES_S / k.dt_s))
        self._stands = standing
        self._trim, self._stick, self._still_s = 0.0, -1.0 if standing else 0.0, 0.0
        self._place: Array | None = None
        self._psi = 0.0

    def fly(self, nav: Array, height_m: float, ground_down_m: float, phase: Phase) -> Array:
        """The sticks (4,) at a look; to a height above the ground, m, 0: set down.

        Parameters
        ----------
        nav : array
            Navigation row.
        height_m, ground_down_m : float
        phase : Phase
            MANUAL or ATTITUDE: what the sticks mean.
        """
        self._recent_navs.append(nav.copy())
        delayed_nav = self._recent_navs[0]
        phi, theta, psi = euler_from_quat(delayed_nav[NAV.quat])
        if self._place is None:
            self._place, self._psi = delayed_nav[NAV.pos].copy(), psi
        sticks = np.zeros(STICKS.size)
        sticks[STICKS.climb] = self._collective(delayed_nav, height_m, ground_down_m, phase)
        if self._stands and sticks[STICKS.climb] < _LIGHT:
            self._place, self._psi = delayed_nav[NAV.pos].copy(), psi
            return sticks
        lean = self._lean(delayed_nav, psi)
        if phase == Phase.ATTITUDE:
            sticks[:2] = lean / self._n.tilt_max_rad
            return np.clip(sticks, -1.0, 1.0)
        trim, manual = self._k.trim, self._n.manual
        off = lean + trim[: SETPOINT.psi] - (phi, theta)
        sticks[:2] = _ATTITUDE * off / (_ROLL_RADPS * np.abs(manual[:2]))
        turn = _HEADING * wrap_pi(self._psi - psi)
        sticks[STICKS.yaw] = turn / (_YAW_RADPS * abs(manual[2]))
        return np.clip(sticks, -1.0, 1.0)

    def _lean(self, delayed_nav: Array, psi: float) -> Array:
        """Roll and pitch (2,), rad off trim, against the drift and back to the place."""
        assert self._place is not None
        back = (
            -_DRIFT * delayed_nav[NAV.vel][:2] + _PLACE * (self._place - delayed_nav[NAV.pos])[:2]
        )
        c, s = math.cos(psi), math.sin(psi)
        forward, right = c * back[0] + s * back[1], -s * back[0] + c * back[1]
        return np.clip(np.array([right, -forward]) / self._k.g, -_LEAN_RAD, _LEAN_RAD)

    def _collective(
        self, delayed_nav: Array, height_m: float, ground_m: float, phase: Phase
    ) -> float:
        """The collective stick."""
        up, climbs, dt = (
            ground_m - delayed_nav[NAV.pos][2],
            -delayed_nav[NAV.down_vel],
            self._k.dt_s,
        )
        if self._stands:
            goal = 0.0 if height_m > 0.0 else -1.0
            self._stick += min(max(goal - self._stick, -_LOWERS * dt), _RAISES * dt)
            if climbs > 0.2 or self._stick == goal == 0.0:
                self._stands, self._trim = False, self._stick
            return self._stick
        wanted = min(max(_HEIGHT * (height_m - up), -_FAST_MPS), _FAST_MPS)
        if height_m == 0.0:
            wanted = -_SETS_DOWN_MPS if up < _NEAR_M else min(wanted, -_SETS_DOWN_MPS)
        if phase == Phase.ATTITUDE:
            return wanted / self._n.climb_mps
        missing = wanted - climbs
        self._trim = min(max(self._trim + _TRIM * missing * dt, -0.5), 0.5)
        self._stick = min(max(self._trim + _CLIMB * missing, -0.6), 0.6)
        near = height_m == 0.0 and up < _NEAR_M and abs(climbs) < _STILL_MPS
        self._still_s = self._still_s + dt if near else 0.0
        self._stands = self._still_s > (_STILL_S if up < _TOUCHES_M else _SURE_S)
        return self._stick


# -------------------------------------------------------------------------------------------------
# A scripted hand: holds sticks, flies them to a height, keeps a velocity or an attitude commanded.
#
# No ROS.
# -------------------------------------------------------------------------------------------------

_RENEWED_NS = NS_PER_S // 5


@dataclass
class ScriptedSticks:
    """What the script has a hand do.

    Attributes
    ----------
    sticks : (4,) array or None
        Held.
    height_m : float or None
        To where the pilot flies.
    cruise : (3,) array or None
        Velocity that is renewed, NED, m/s.
    attitude : HeldAttitude or None
        The same of an attitude.
    """

    sticks: Array | None = None
    height_m: float | None = None
    cruise: Array | None = None
    attitude: HeldAttitude | None = None
    numbers: StickNumbers | None = None
    _pilot: HumanPilotModel | None = None
    _standing: bool = False

    @property
    def holds_sticks(self) -> bool:
        """Whether there is a hand at the sticks."""
        return self.sticks is not None or self.height_m is not None

    def take(self, order: Scripted, numbers: StickNumbers, standing: bool) -> ScriptCommand | None:
        """Take what is ordered for the hand; a command is given back."""
        self.numbers, self._standing = numbers, standing
        match order:
            case HeldSticks():
                self.sticks, self.height_m, self.attitude = order.sticks, None, None
            case PilotHeight():
                self.sticks, self.height_m, self.attitude = None, order.height_m, None
            case HeldAttitude():
                self.attitude = order
            case ScriptCommand():
                self.cruise, self.attitude = order.velocity_ned_mps, None
                return order
        return None

    def begins(self) -> None:
        """The sticks are taken: a pilot begins to look."""
        self._pilot = None

    def rest(self, standing: bool) -> Array:
        """The sticks as the hand takes hold of them."""
        if self.sticks is not None:
            return self.sticks
        rest = np.zeros(STICKS.size)
        rest[STICKS.climb] = -1.0 if standing else 0.0
        return rest

    def moves(self, nav: Array, ground_down_m: float, phase: Phase, k: OuterParams) -> Array | None:
        """The sticks (4,) now; None without a hand."""
        if self.height_m is None:
            return self.sticks
        if self._pilot is None:
            assert self.numbers is not None  # came with the order
            self._pilot = HumanPilotModel(k, self.numbers, self._standing)
        return self._pilot.fly(nav, self.height_m, ground_down_m, phase)

    def is_due(self, since_ns: int) -> bool:
        """Whether the velocity is to be renewed."""
        return self.cruise is not None and since_ns >= _RENEWED_NS


# -------------------------------------------------------------------------------------------------
# What is ordered before a flight, done when it is due; what is refused is remarked. No ROS.
# -------------------------------------------------------------------------------------------------

CommandGoal = tuple[Array, float]


class CommandedFlight(Protocol):
    """What is asked of the phases of a flight; `Phases` says what each is."""

    phase: Phase
    trajectory: Trajectory | None
    params: OuterParams
    numbers: PhaseNumbers
    cruise_ns: int
    sticks: StickFlight

    @property
    def stands(self) -> bool:
        """On the ground."""

    @property
    def ground_down_m(self) -> float:
        """Where that is, NED."""

    def steer(self, sticks: Array, now_ns: int) -> None:
        """Take sticks."""

    def attitude(self, attitude_rad: Array, now_ns: int, nav: Array) -> Refusal | None:
        """Fly an attitude, or not."""

    def command(
        self, command: Command, now_ns: int, nav: Array, goal: CommandGoal | None
    ) -> Refusal | None:
        """Do what is commanded, or not."""


class ScriptRunner:
    """The script of a flight.

    Parameters
    ----------
    script : sequence of Scripted
    start_ns : int
        Stamp of flight time 0.

    Attributes
    ----------
    sticks : ScriptedSticks
    remarks : list of str
        Orders that were refused.
    """

    def __init__(self, script: Sequence[Scripted], start_ns: int) -> None:
        self.sticks, self.remarks = ScriptedSticks(), list[str]()
        self._script, self._start_ns = deque(script), start_ns

    def next_ns(self) -> int | None:
        """Stamp at which the next one is due; None for nothing."""
        return self._start_ns + self._script[0].at_ns if self._script else None

    def renew(self, flight: CommandedFlight, now_ns: int, nav: Array) -> None:
        """What the hand does not let go."""
        if flight.phase in BY_STICKS:
            sticks = self.sticks.moves(nav, flight.ground_down_m, flight.phase, flight.params)
            if sticks is not None:
                flight.steer(sticks, now_ns)
            if self.sticks.attitude is not None and flight.sticks.steering.asked.leads:
                self._ask(flight, self.sticks.attitude, now_ns, nav)
        elif flight.phase == Phase.VELOCITY and self.sticks.is_due(now_ns - flight.cruise_ns):
            self._try(flight, Command.VELOCITY, now_ns, nav, (np.asarray(self.sticks.cruise), 0.0))

    def obey(self, flight: CommandedFlight, now_ns: int, nav: Array) -> None:
        """Do what is due."""
        while self._script and self._start_ns + self._script[0].at_ns <= now_ns:
            due = self._script.popleft()
            order = self.sticks.take(due, flight.numbers.sticks, flight.stands)
            if isinstance(due, HeldAttitude):
                self._ask(flight, due, now_ns, nav)
            if order is None:
                continue
            if self.sticks.holds_sticks:
                flight.steer(self.sticks.rest(flight.stands), now_ns)
            goal: CommandGoal | None = None
            if order.goal_ned_m is not None and flight.trajectory is not None:
                goal = order.goal_ned_m, float(flight.trajectory.points[-1, REFERENCE.psi])
            elif self.sticks.cruise is not None:
                goal = self.sticks.cruise, 0.0
            self._try(flight, order.command, now_ns, nav, goal)

    def _ask(self, flight: CommandedFlight, asked: HeldAttitude, now_ns: int, nav: Array) -> None:
        """As messages do: an attitude, and a climb beside it."""
        done = partial(flight.attitude, asked.attitude_rad, now_ns, nav)
        if self._remarked(Command.ATTITUDE, done):
            flight.sticks.climb(flight.phase, asked.climb_mps, now_ns)

    def _try(
        self,
        flight: CommandedFlight,
        command: Command,
        now_ns: int,
        nav: Array,
        goal: CommandGoal | None,
    ) -> None:
        self._remarked(command, partial(flight.command, command, now_ns, nav, goal))

    def _remarked(self, command: Command, do: Callable[[], Refusal | None]) -> bool:
        """True if it is done; else it is remarked why not."""
        try:
            refused = do()
        except ReferenceRefused as error:
            self.remarks.append(f"{command}: {error}")
        else:
            if refused is None:
                return True
            self.remarks.append(refused.sentence)
        return False
