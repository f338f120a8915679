# SPDX-License-Identifier: Apache-2.0
"""A path put together from stays, turns, legs and curves, as the trajectory that is flown."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from heli_guidance.errors import Cause, PathError
from heli_guidance.limits import MotionLimits
from heli_guidance.transfer import Motion, Transfer
from heli_math.rotations import wrap_pi
from heli_math.rows import REFERENCE
from heli_math.ticks import NS_PER_S
from heli_math.trajectory import MAX_POINTS, Trajectory

if TYPE_CHECKING:
    from heli_guidance.curves import Curve

Array = NDArray[np.float64]
Where = Callable[[float], tuple[Array, float]]

STEP_S = 0.04
"""Way points of a motion are so far apart: the position loop's period."""


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
            raise PathError(Cause.NOT_FINITE, f"heading {psi_rad}: not finite")
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
                Cause.NOT_FINITE, f"a stay of {duration_s:g} s; allowed: not negative, finite"
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
        way = goal - start.pos
        away = float(np.linalg.norm(way))
        if not math.isfinite(away):
            raise PathError(Cause.NOT_FINITE, f"goal {goal.tolist()}: not finite")
        psi = 0.0 if psi_rad is None else float(wrap_pi(psi_rad - self.psi_rad))
        self._add(*self._moved(way, away, self.psi_rad + psi), goal, self.psi_rad + psi)
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
                Cause.NOT_FINITE, f"velocity {vel_ned_mps} m/s, {psi_rate_radps} rad/s: not finite"
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

    def _moved(self, way: Array, length: float, psi_rad: float | None) -> tuple[Where, float]:
        """Motion by a way (3,) and to a heading, and its duration; without one a halt along it."""
        start, most = self._motion, self.limits
        frame = _frame_along(way / length if length > 0.0 else np.array([1.0, 0.0, 0.0]))
        leg = Transfer(
            Motion(np.zeros(3), frame @ start.vel, frame @ start.acc),
            None if psi_rad is None else frame @ way,
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
            raise PathError(Cause.BAD_SIZE, f"{laps:g} laps; allowed: a positive number")
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
        if duration_s > 0.0:
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
                inner = np.arange(1, math.ceil(piece.duration_s / STEP_S - 1e-9)) * STEP_S
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
                Cause.TOO_LONG,
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
        raise PathError(Cause.BAD_SIZE, f"speed {speed_mps:g} m/s; allowed: a positive number")
    radius_m = 1.0 / curve.curvature_1pm
    sideways = speed_mps**2 / radius_m
    if sideways > most.acceleration_mps2:
        raise PathError(
            Cause.TOO_TIGHT,
            f"{speed_mps:g} m/s in a bend of {radius_m:.3g} m take {sideways:.2f} m/s2; allowed: "
            f"{most.acceleration_mps2:g} m/s2 (slower, or a larger curve)",
        )
    rate = speed_mps / radius_m
    if heading != "fixed" and rate > most.yaw_rate_radps:
        raise PathError(
            Cause.TOO_TIGHT,
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
    way = np.diff(points[:, REFERENCE.pos], axis=0)
    points[:-1, REFERENCE.vel] = way / np.diff(times_s)[:, None]
    return Trajectory(start_ns, np.round(times_s * NS_PER_S).astype(np.int64), points)
