# SPDX-License-Identifier: Apache-2.0
"""A path put together from stays, turns, legs and curves, as the trajectory that is flown."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from heli_core.errors import PathCause, PathError
from heli_core.rotations import wrap_pi
from heli_core.rows import REFERENCE
from heli_core.ticks import NS_PER_S
from heli_core.trajectory import MAX_POINTS, Trajectory
from heli_outer_pd.guidance.transfer import Motion, MotionLimits, Transfer

# -------------------------------------------------------------------------------------------------
# Flight path.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]
Where = Callable[[float], tuple[Array, float]]

STEP_S = 0.04
"""Way points of a motion are so far apart."""
_SHORTEST_S = 1e-9
"""A piece shorter than the stamps' unit is none."""


@dataclass(frozen=True)
class _Piece:
    """A piece of a path: its length, s, and where it is then: position (3,) NED, m; heading, rad.

    `where` is None where nothing moves.
    """

    duration_s: float
    where: Where | None = None


class FlightPath:
    """A path from a standstill, piece by piece; between pieces the aircraft stands still.

    Parameters
    ----------
    pos_ned_m : (3,) array
        Where it begins.
    psi_rad : float
        Heading there, 0 is north.
    limits : MotionLimits
    vel_ned_mps, acc_ned_mps2 : (3,) arrays, optional
        Motion at the beginning, which the first `go_to` takes over; at rest by default.
    psi_rate_radps, psi_acc_radps2 : float, optional
        The same of the heading.

    Raises
    ------
    PathError
        A number is not finite.
    """

    def __init__(
        self,
        pos_ned_m: Array,
        psi_rad: float,
        limits: MotionLimits,
        vel_ned_mps: Array | None = None,
        acc_ned_mps2: Array | None = None,
        psi_rate_radps: float = 0.0,
        psi_acc_radps2: float = 0.0,
    ) -> None:
        self.limits = limits
        rest = np.zeros(3)
        vel = rest if vel_ned_mps is None else vel_ned_mps
        acc = rest if acc_ned_mps2 is None else acc_ned_mps2
        self._motion = Motion(*(np.asarray(part, float) for part in (pos_ned_m, vel, acc)))
        turn = (psi_rad, psi_rate_radps, psi_acc_radps2)
        if not all(map(math.isfinite, turn)):
            raise PathError(PathCause.NOT_FINITE, f"heading {psi_rad}: not finite")
        self._turning = Motion(*(np.array([float(part)]) for part in turn))
        self._start = self._motion.pos, self.psi_rad
        self._pieces: list[_Piece] = []

    @property
    def duration_s(self) -> float:
        """How long the path takes so far, s."""
        return sum(piece.duration_s for piece in self._pieces)

    @property
    def pos_ned_m(self) -> Array:
        """Where it ends so far (3,)."""
        return self._motion.pos

    @property
    def psi_rad(self) -> float:
        """Heading at its end so far; not wrapped."""
        return float(self._turning.pos[0])

    def stay(self, duration_s: float) -> "FlightPath":
        """Stand still for a time, s."""
        if not (math.isfinite(duration_s) and duration_s >= 0.0):
            raise PathError(
                PathCause.NOT_FINITE, f"a stay of {duration_s:g} s; allowed: not negative, finite"
            )
        if duration_s > 0.0:
            self._pieces.append(_Piece(duration_s))
        return self

    def turn_to(self, psi_rad: float) -> "FlightPath":
        """Turn on the spot, the short way."""
        return self.go_to(self._motion.pos, psi_rad)

    def go_to(self, pos_ned_m: Array, psi_rad: float | None = None) -> "FlightPath":
        """Fly straight to a position (3,) and turn meanwhile, the short way; then stand still.

        From a motion that does not point there the way is as straight as the limits allow.

        Raises
        ------
        PathError
            A number is not finite, or the motion at the start is beyond the limits.
        """
        start, goal = self._motion, np.asarray(pos_ned_m, float)
        displacement = goal - start.pos
        away = float(np.linalg.norm(displacement))
        if not math.isfinite(away):
            raise PathError(PathCause.NOT_FINITE, f"goal {goal.tolist()}: not finite")
        psi = 0.0 if psi_rad is None else float(wrap_pi(psi_rad - self.psi_rad))
        self._add(*self._moved(displacement, away, self.psi_rad + psi), goal, self.psi_rad + psi)
        return self

    def stop(self) -> "FlightPath":
        """Brake as soon as the limits allow, along the way, and cease to turn."""
        velocity = self._motion.vel
        where, duration_s = self._moved(velocity, float(np.linalg.norm(velocity)), None)
        self._add(where, duration_s, *where(duration_s))
        return self

    def cruise(self, vel_ned_mps: Array, psi_rate_radps: float, duration_s: float) -> "FlightPath":
        """Change to a velocity (3,) and a rate of turn, and go on so until a time has gone.

        Raises
        ------
        PathError
            A number is not finite.
        """
        start, most = self._motion, self.limits
        if not (np.isfinite(vel_ned_mps).all() and math.isfinite(psi_rate_radps)):
            raise PathError(
                PathCause.NOT_FINITE,
                f"velocity {vel_ned_mps} m/s, {psi_rate_radps} rad/s: not finite",
            )
        change = np.asarray(vel_ned_mps, float) - start.vel
        length = float(np.linalg.norm(change))
        frame = _frame_along(change / length if length > 0.0 else np.array([1.0, 0.0, 0.0]))
        leg = Transfer(
            Motion(np.zeros(3), frame @ start.vel, frame @ start.acc), None, [math.inf] * 3,
            [most.acceleration_mps2] * 3, [most.jerk_mps3] * 3, frame @ vel_ned_mps,
        )  # fmt: skip
        turn = Transfer(
            self._turning, None, [math.inf], [most.yaw_acceleration_radps2],
            [most.yaw_jerk_radps3], np.array([psi_rate_radps]),
        )  # fmt: skip

        def where(time_s: float) -> tuple[Array, float]:
            return start.pos + frame.T @ leg.at(time_s)[0], float(turn.at(time_s)[0][0])

        pos, vel, acc = leg.at(duration_s)
        self._pieces.append(_Piece(duration_s, where))
        self._motion = Motion(start.pos + frame.T @ pos, frame.T @ vel, frame.T @ acc)
        self._turning = Motion(*turn.at(duration_s))
        return self

    def _moved(
        self, displacement: Array, length: float, psi_rad: float | None
    ) -> tuple[Where, float]:
        """Motion by a displacement (3,) and to a heading, its duration; or a halt along it."""
        start, most = self._motion, self.limits
        frame = _frame_along(displacement / length if length > 0.0 else np.array([1.0, 0.0, 0.0]))
        leg = Transfer(
            Motion(np.zeros(3), frame @ start.vel, frame @ start.acc),
            None if psi_rad is None else frame @ displacement,
            [most.speed_along(axis) for axis in frame],
            [most.acceleration_mps2] * 3,
            [most.jerk_mps3] * 3,
        )
        turn = Transfer(
            self._turning,
            None if psi_rad is None else np.array([psi_rad]),
            [most.yaw_rate_radps],
            [most.yaw_acceleration_radps2],
            [most.yaw_jerk_radps3],
        )

        def where(time_s: float) -> tuple[Array, float]:
            return start.pos + frame.T @ leg.at(time_s)[0], float(turn.at(time_s)[0][0])

        return where, max(leg.duration_s, turn.duration_s)

    def along(self, curve: "Curve", speed_mps: float, laps: float, heading: str) -> "FlightPath":
        """Fly a curve that begins here, from rest to rest.

        Parameters
        ----------
        curve : Curve
        speed_mps : float
            Reached if the way is long enough.
        laps : float
        heading : str
            "fixed"; "along": in the direction of flight; "centre": to the curve's centre. Where it
            is not so yet, the aircraft first turns on the spot.

        Raises
        ------
        PathError
            The curve's bends are too tight for the speed, or a number is not positive.
        """
        if not (math.isfinite(laps) and laps > 0.0):
            raise PathError(PathCause.BAD_SIZE, f"{laps:g} laps; allowed: a positive number")
        most, way_m = self.limits, laps * curve.lap_m
        speed = min(speed_mps, most.speed_mps)
        _check_bend(curve, speed, most, heading)
        of = {"fixed": lambda s: self.psi_rad, "along": lambda s: curve.at(s)[1],
              "centre": lambda s: _towards(curve, s)}[heading]  # fmt: skip
        self.turn_to(of(0.0))
        run = Transfer(
            Motion.at_rest(np.zeros(1)), np.array([way_m]), [speed], [most.acceleration_mps2],
            [most.jerk_mps3],
        )  # fmt: skip

        def where(time_s: float) -> tuple[Array, float]:
            along_m = float(run.at(time_s)[0][0])
            return curve.at(along_m)[0], of(along_m)

        end = where(run.duration_s)
        self._add(where, run.duration_s, *end)
        return self

    def _add(self, where: Where, duration_s: float, pos: Array, psi: float) -> None:
        if duration_s >= _SHORTEST_S:
            self._pieces.append(_Piece(duration_s, where))
        self._motion, self._turning = Motion.at_rest(pos), Motion.at_rest(np.array([psi]))

    def trajectory(self, start_ns: int = 0) -> Trajectory:
        """The path as way points, `STEP_S` apart where something moves.

        Raises
        ------
        PathError
            More points than a trajectory may have.
        """
        times, places = [0.0], [self._start]
        now = 0.0
        for piece in self._pieces:
            end = now + piece.duration_s
            if piece.where is not None:
                # The last one is the next piece's first.
                inner = np.arange(1, math.ceil(piece.duration_s / STEP_S - 1e-6)) * STEP_S
                times += (now + inner).tolist()
                places += [piece.where(time) for time in inner.tolist()]
                last = piece.where(piece.duration_s)
            else:
                last = places[-1]
            times.append(end)
            places.append(last)
            now = end
        if len(times) > MAX_POINTS:
            raise PathError(
                PathCause.TOO_LONG,
                f"{len(times)} way points for {now:.0f} s; allowed: {MAX_POINTS}, which is "
                f"{MAX_POINTS * STEP_S:.0f} s of motion",
            )
        return _as_trajectory(np.array(times), places, start_ns)


def _frame_along(direction: Array) -> Array:
    """Rotation (3, 3) whose first row is a direction (3,), a unit vector."""
    helper = np.eye(3)[int(np.argmin(np.abs(direction)))]
    second = np.cross(direction, helper)
    second /= np.linalg.norm(second)
    return np.array([direction, second, np.cross(direction, second)])


def _towards(curve: "Curve", along_m: float) -> float:
    """Heading to the curve's centre, continuous with its course."""
    pos, course = curve.at(along_m)
    north, east, _ = curve.centre_ned_m - pos
    return course + wrap_pi(math.atan2(east, north) - course)


def _check_bend(curve: "Curve", speed_mps: float, most: MotionLimits, heading: str) -> None:
    if not (math.isfinite(speed_mps) and speed_mps > 0.0):
        raise PathError(PathCause.BAD_SIZE, f"speed {speed_mps:g} m/s; allowed: a positive number")
    radius_m = 1.0 / curve.curvature_1pm
    sideways = speed_mps**2 / radius_m
    if sideways > most.acceleration_mps2:
        raise PathError(
            PathCause.TOO_TIGHT,
            f"{speed_mps:g} m/s in a bend of {radius_m:.3g} m take {sideways:.2f} m/s2; allowed: "
            f"{most.acceleration_mps2:g} m/s2 (slower, or a larger curve)",
        )
    rate = speed_mps / radius_m
    if heading != "fixed" and rate > most.yaw_rate_radps:
        raise PathError(
            PathCause.TOO_TIGHT,
            f"{speed_mps:g} m/s in a bend of {radius_m:.3g} m turn the nose at "
            f"{math.degrees(rate):.0f} deg/s; allowed: "
            f"{math.degrees(most.yaw_rate_radps):.0f} deg/s (slower, a larger curve, or a fixed "
            "heading)",
        )


def _as_trajectory(times_s: Array, places: list[tuple[Array, float]], start_ns: int) -> Trajectory:
    """Way points with the mean velocity to the next one, as a trajectory is interpolated."""
    points = np.zeros((len(places), REFERENCE.size))
    points[:, REFERENCE.pos] = [pos for pos, _ in places]
    points[:, REFERENCE.psi] = [wrap_pi(psi) for _, psi in places]
    displacement = np.diff(points[:, REFERENCE.pos], axis=0)
    points[:-1, REFERENCE.vel] = displacement / np.diff(times_s)[:, None]
    return Trajectory(start_ns, np.round(times_s * NS_PER_S).astype(np.int64), points)


# -------------------------------------------------------------------------------------------------
# Level curves by their arc length.
# -------------------------------------------------------------------------------------------------

_STEP_M = 0.01  # of a table over a curve's length
_LEAST_TURNS = 2


class Curve(Protocol):
    """A curve in a horizontal plane; the closed ones can be flown several times."""

    @property
    def lap_m(self) -> float:
        """Its length, m."""
        ...

    @property
    def curvature_1pm(self) -> float:
        """Its largest curvature, 1/m."""
        ...

    @property
    def centre_ned_m(self) -> Array:
        """What it goes around (3,), NED, m."""
        ...

    def at(self, along_m: float) -> tuple[Array, float]:
        """Position (3,), NED, m, and course (rad, 0 is north) at an arc length from its start."""
        ...


def _checked(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise PathError(PathCause.BAD_SIZE, f"{name} is {value:g} m; allowed: a positive number")


@dataclass(frozen=True)
class Circle:
    """A circle.

    Attributes
    ----------
    start_ned_m : (3,) array
        A point on it.
    course_rad : float
        Course there, 0 is north.
    radius_m : float
    clockwise : bool
        Seen from above: turning to the right.
    """

    start_ned_m: Array
    course_rad: float
    radius_m: float
    clockwise: bool = True

    def __post_init__(self) -> None:
        _checked("radius", self.radius_m)

    @property
    def lap_m(self) -> float:
        """Its length, m."""
        return 2.0 * math.pi * self.radius_m

    @property
    def curvature_1pm(self) -> float:
        """Its curvature, 1/m."""
        return 1.0 / self.radius_m

    @property
    def _turn(self) -> float:
        return 1.0 if self.clockwise else -1.0

    @property
    def centre_ned_m(self) -> Array:
        """Its centre (3,), NED, m."""
        to_centre = self.course_rad + self._turn * math.pi / 2.0
        away = np.array([math.cos(to_centre), math.sin(to_centre), 0.0])
        return np.asarray(self.start_ned_m, float) + self.radius_m * away

    def at(self, along_m: float) -> tuple[Array, float]:
        """Position (3,), NED, m, and course (rad, 0 is north) at an arc length from its start."""
        course = self.course_rad + self._turn * along_m / self.radius_m
        outwards = course - self._turn * math.pi / 2.0
        away = np.array([math.cos(outwards), math.sin(outwards), 0.0])
        return self.centre_ned_m + self.radius_m * away, course


@dataclass(frozen=True)
class Lemniscate:
    """A figure eight: Bernoulli's lemniscate, begun at its crossing, where it is straight.

    With half its length a, r^2 = a^2 cos 2 theta, its arc length is an elliptic integral and
    r = a sl(s / a) with Gauss's lemniscate sine sl(u) = sd(sqrt(2) u | 1/2) / sqrt(2) (DLMF 22.12,
    22.18.1): position at an arc length is exact. The curvature 3 r / a^2 is largest at the tips.

    Attributes
    ----------
    centre_ned_m : (3,) array
        The crossing.
    axis_rad : float
        Direction from tip to tip, 0 is north.
    length_m : float
        From tip to tip.
    """

    centre_ned_m: Array
    axis_rad: float
    length_m: float

    def __post_init__(self) -> None:
        _checked("length", self.length_m)

    @property
    def _half_m(self) -> float:
        return 0.5 * self.length_m

    @property
    def lap_m(self) -> float:
        """Its length, m: four quarters of K(1/2) / sqrt(2) each."""
        from scipy.special import ellipk

        return float(4.0 * self._half_m * ellipk(0.5) / math.sqrt(2.0))

    @property
    def curvature_1pm(self) -> float:
        """Its curvature at the tips, 1/m."""
        return 3.0 / self._half_m

    def at(self, along_m: float) -> tuple[Array, float]:
        """Position (3,), NED, m, and course (rad, 0 is north) at an arc length from its start."""
        from scipy.special import ellipj

        u = along_m / self._half_m
        sn, cn, dn, _ = ellipj(math.sqrt(2.0) * u, 0.5)
        # r / a, negative on the half behind, and its derivative: 1, then -1 at crossings.
        r, slope = sn / (math.sqrt(2.0) * dn), cn / dn**2
        ahead = r * math.sqrt(0.5 * (1.0 + r * r))
        aside = r * slope / math.sqrt(2.0 * (1.0 + r * r))
        theta = math.atan2(slope, 1.0 + r * r)
        # The tangent stands at 2 theta + 90 degrees to the radius; theta falls on the way out.
        course = self.axis_rad + 3.0 * theta - math.pi / 2.0
        c, s = math.cos(self.axis_rad), math.sin(self.axis_rad)
        a = self._half_m
        level = a * np.array([c * ahead - s * aside, s * ahead + c * aside, 0.0])
        return np.asarray(self.centre_ned_m, float) + level, course


def _rise(share: Array) -> Array:
    """From 0, straight, to 1 with the slope and curvature of a cosine, over half its wave.

    The quintic of these six conditions.
    """
    level = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    return level - 0.5 * math.pi**2 * share**3 * (1.0 - share) ** 2


@dataclass(frozen=True)
class Slalom:
    """Turns to alternate sides of a line, straight before and after them.

    A sine from the first turn to the last, joined to the line by polynomials as long as half its
    wave, so that curvature is continuous. Its arc length is summed up over `_STEP_M`.

    Attributes
    ----------
    start_ned_m : (3,) array
        On the line.
    course_rad : float
        Of the line, 0 is north; the first turn is to its right.
    interval_m : float
        From turn to turn, along the line.
    aside_m : float
        Of the turns from the line.
    turns : int
        At least 2.
    run_m : float
        Straight, before the first turn and after the last.
    """

    start_ned_m: Array
    course_rad: float
    interval_m: float
    aside_m: float
    turns: int
    run_m: float

    def __post_init__(self) -> None:
        for name in ("interval", "aside", "run"):
            _checked(name, getattr(self, f"{name}_m"))
        if self.turns < _LEAST_TURNS:
            raise PathError(
                PathCause.BAD_SIZE, f"turns are {self.turns}; allowed: at least {_LEAST_TURNS}"
            )

    @cached_property
    def _table(self) -> tuple[Array, Array, Array, Array]:
        """Along the line, aside of it, arc length and direction off it, at close points."""
        whole = (self.turns + 1) * self.interval_m + 2.0 * self.run_m
        x = np.linspace(0.0, whole, math.ceil(whole / _STEP_M) + 1)
        u = (x - self.run_m) / self.interval_m
        last = -1.0 if self.turns % 2 == 0 else 1.0
        y = self.aside_m * np.where(
            u < 1.0,
            _rise(np.clip(u, 0.0, 1.0)),
            np.where(
                u < self.turns,
                np.cos(math.pi * (u - 1.0)),
                last * _rise(np.clip(self.turns + 1.0 - u, 0.0, 1.0)),
            ),
        )
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
        return x, y, arc, np.arctan(np.gradient(y, x))

    @property
    def lap_m(self) -> float:
        """Its length, m."""
        return float(self._table[2][-1])

    @property
    def curvature_1pm(self) -> float:
        """Its largest curvature, 1/m."""
        _, _, arc, off = self._table
        return float(np.abs(np.gradient(off, arc)).max())

    @property
    def centre_ned_m(self) -> Array:
        """The middle of its line (3,), NED, m."""
        return self._placed(0.5 * float(self._table[0][-1]), 0.0)

    def at(self, along_m: float) -> tuple[Array, float]:
        """Position (3,), NED, m, and course (rad, 0 is north) at an arc length from its start."""
        x, y, arc, off = self._table
        ahead, aside, turned = (float(np.interp(along_m, arc, of)) for of in (x, y, off))
        return self._placed(ahead, aside), self.course_rad + turned

    def _placed(self, ahead_m: float, right_m: float) -> Array:
        c, s = math.cos(self.course_rad), math.sin(self.course_rad)
        level = np.array([c * ahead_m - s * right_m, s * ahead_m + c * right_m, 0.0])
        return np.asarray(self.start_ned_m, float) + level


# -------------------------------------------------------------------------------------------------
# A turn of the nose put into a trajectory: the same places, another heading from then on.
# -------------------------------------------------------------------------------------------------

_STEP_NS = round(STEP_S * NS_PER_S)


def turn_duration_s(angle_rad: float, limits: MotionLimits) -> float:
    """How long `turned` takes: the cubic's largest rate is 3/2 angle/T, its acceleration 6 a/T^2.

    Parameters
    ----------
    angle_rad : float
    limits : MotionLimits
        Rate and acceleration of the heading.
    """
    size = abs(angle_rad)
    by_rate = 1.5 * size / limits.yaw_rate_radps
    return max(by_rate, math.sqrt(6.0 * size / limits.yaw_acceleration_radps2))


def turned(
    trajectory: Trajectory, leave_ns: int, past_ns: int, angle_rad: float, limits: MotionLimits
) -> Trajectory:
    """A trajectory with the heading turned by an angle from a moment on, smoothly (3 s^2 - 2 s^3).

    Parameters
    ----------
    trajectory : Trajectory
    leave_ns : int
        Stamp at which the turn begins.
    past_ns : int
        What is older than so much before that is dropped.
    angle_rad : float
        To the right.
    limits : MotionLimits

    Returns
    -------
    Trajectory
        Stamped as `trajectory`.

    Raises
    ------
    PathError
        The angle is not finite, or it takes too many way points.
    """
    if not math.isfinite(angle_rad):
        raise PathError(PathCause.NOT_FINITE, f"a turn by {angle_rad}: not finite")
    begins_ns = leave_ns - trajectory.start_ns
    lasts_ns = max(round(turn_duration_s(angle_rad, limits) * NS_PER_S), 1)
    steps = begins_ns + np.arange(-(-lasts_ns // _STEP_NS) + 1, dtype=np.int64) * _STEP_NS
    first = max(int(np.searchsorted(trajectory.times_ns, begins_ns - past_ns, side="right")) - 1, 0)
    times_ns = np.union1d(trajectory.times_ns[first:], steps)
    if times_ns.size > MAX_POINTS:
        raise PathError(PathCause.TOO_LONG, f"{times_ns.size} way points; allowed: {MAX_POINTS}")
    points = np.array([trajectory.at(trajectory.start_ns + int(time_ns)) for time_ns in times_ns])
    share = np.clip((times_ns - begins_ns) / lasts_ns, 0.0, 1.0)
    points[:, REFERENCE.psi] += angle_rad * share**2 * (3.0 - 2.0 * share)
    return Trajectory(trajectory.start_ns, times_ns, points)


# -------------------------------------------------------------------------------------------------
# Another goal in mid-way: a trajectory is left without a jump, and ends elsewhere.
# -------------------------------------------------------------------------------------------------

_NEAR_M = 1.0
"""Closer than this no direction to the goal is taken."""


@dataclass(frozen=True)
class DiversionGoal:
    """Where to go.

    Attributes
    ----------
    pos_ned_m : (3,) array
    psi_rad : float or None
        Heading there, 0 is north; None: the one at which the old way is left.
    facing : bool
        The nose turns to the goal on the way, and to `psi_rad` there; else on the way.
    """

    pos_ned_m: Array
    psi_rad: float | None = None
    facing: bool = False


@dataclass(frozen=True)
class Cruise:
    """How to go on for a time, s; then it halts.

    Attributes
    ----------
    vel_ned_mps : (3,) array
    psi_rate_radps : float
    duration_s : float
        The change to it included.
    """

    vel_ned_mps: Array
    psi_rate_radps: float
    duration_s: float


def divert(
    before: Trajectory,
    leave_ns: int,
    past_ns: int,
    goal: DiversionGoal | Cruise | None,
    limits: MotionLimits,
) -> Trajectory:
    """A trajectory up to a moment, from there to a goal, at a velocity, or to a halt.

    It is left with the position, velocity and acceleration that it has then (differences over
    `STEP_S`, exact at way points so far apart), and so is its heading. An acceleration beyond the
    limits, as at a corner, is brought down to them.

    Parameters
    ----------
    before : Trajectory
    leave_ns : int
        Stamp from which on it changes; up to `STEP_S` later if there it has a way point.
    past_ns : int
        What is older than so much before that is dropped.
    goal : DiversionGoal or Cruise or None
        None: stop as soon as the limits allow.
    limits : MotionLimits

    Returns
    -------
    Trajectory
        Stamped as `before`, so times count from the same moment.

    Raises
    ------
    PathError
        A number is not finite, the motion cannot be brought within the limits, or it takes too
        many way points.
    """
    times_ns = before.times_ns
    at_ns = _way_point_near(times_ns, leave_ns - before.start_ns)
    path = _path_from(before, before.start_ns + at_ns, limits)
    if goal is None:
        path.stop()
    elif isinstance(goal, Cruise):
        path.cruise(goal.vel_ned_mps, goal.psi_rate_radps, goal.duration_s).stop()
    else:
        _fly_to(path, goal)
    leg = path.trajectory()
    first = max(int(np.searchsorted(times_ns, at_ns - past_ns, side="right")) - 1, 0)
    kept = slice(first, int(np.searchsorted(times_ns, at_ns)))
    points = np.concatenate([before.points[kept], leg.points])
    if len(points) > MAX_POINTS:
        raise PathError(
            PathCause.TOO_LONG,
            f"{len(points)} way points for {path.duration_s:.0f} s and what went before; allowed: "
            f"{MAX_POINTS}",
        )
    return Trajectory(
        before.start_ns, np.concatenate([times_ns[kept], at_ns + leg.times_ns]), points
    )


def _fly_to(path: FlightPath, goal: DiversionGoal) -> None:
    north, east = (np.asarray(goal.pos_ned_m, float) - path.pos_ned_m)[:2]
    last_psi = path.psi_rad if goal.psi_rad is None else goal.psi_rad
    if goal.facing and np.hypot(north, east) > _NEAR_M:
        path.go_to(goal.pos_ned_m, math.atan2(east, north)).turn_to(last_psi)
    else:
        path.go_to(goal.pos_ned_m, last_psi)


def _way_point_near(times_ns: NDArray[np.int64], leave_ns: int) -> int:
    """Time of the next way point if it comes soon, where differences are exact; else as given."""
    following = times_ns[np.searchsorted(times_ns, leave_ns) :]
    soon = following.size > 0 and following[0] - leave_ns < _STEP_NS
    return int(following[0]) if soon else leave_ns


def _path_from(before: Trajectory, at_ns: int, limits: MotionLimits) -> FlightPath:
    """A path that goes on as a trajectory moves at a stamp, ns."""
    rows = np.array([before.at(at_ns + step * _STEP_NS) for step in (-1, 0, 1)])
    pos, psi = rows[:, REFERENCE.pos], rows[:, REFERENCE.psi]
    behind, ahead = np.diff(pos, axis=0) / STEP_S
    acc = (ahead - behind) / STEP_S
    size = float(np.linalg.norm(acc))
    if size > limits.acceleration_mps2:
        acc *= limits.acceleration_mps2 / size
    turn_behind, turn_ahead = (wrap_pi(step) / STEP_S for step in np.diff(psi))
    # A step of the heading is on one side only: no rate.
    turns = turn_behind * turn_ahead > 0.0
    rate = 0.5 * (turn_behind + turn_ahead) if turns else 0.0
    turn_acc = (turn_ahead - turn_behind) / STEP_S if turns else 0.0
    most, most_acc = limits.yaw_rate_radps, limits.yaw_acceleration_radps2
    return FlightPath(
        pos[1],
        float(psi[1]),
        limits,
        0.5 * (behind + ahead),
        acc,
        min(max(rate, -most), most),
        min(max(turn_acc, -most_acc), most_acc),
    )
