# SPDX-License-Identifier: Apache-2.0
"""Paths against what defines them: limits, closed forms, and a second way to each number."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import gamma

from heli_core.rows import REFERENCE
from heli_outer_pd.guidance import (
    Circle,
    FlightPath,
    Lemniscate,
    Motion,
    MotionLimits,
    PathCause,
    PathError,
    Slalom,
    Transfer,
)

LIMITS = MotionLimits(5.0, 2.0, 3.0, 4.0, 1.0, 2.0, 4.0)
HERE = np.array([3.0, -2.0, -10.0])


def differences(curve, n=4000):
    """Positions (n + 1, 3) and courses (n + 1,) along a lap, and the arc lengths."""
    along = np.linspace(0.0, curve.lap_m, n + 1)
    places = [curve.at(s) for s in along]
    return along, np.array([pos for pos, _ in places]), np.array([c for _, c in places])


def apart(one, other):
    """Largest angle between two rows of angles, rad."""
    return np.abs(np.angle(np.exp(1j * (one - other)))).max()


@pytest.mark.parametrize(
    "curve",
    [
        Circle(HERE, 0.7, 4.0),
        Circle(HERE, -2.0, 4.0, clockwise=False),
        Lemniscate(HERE, 0.4, 20.0),
        Lemniscate(HERE, 3.0, 6.0),
    ],
    ids=["right", "left", "eight", "small eight"],
)
class TestCurves:
    def test_arc_length_course_and_curvature_belong_to_the_positions(self, curve):
        along, pos, course = differences(curve)
        step, way = np.diff(along), np.diff(pos, axis=0)
        np.testing.assert_allclose(np.linalg.norm(way, axis=1) / step, 1.0, atol=1e-5)
        middle = 0.5 * (course[1:] + course[:-1])
        assert apart(np.arctan2(way[:, 1], way[:, 0]), middle) < 1e-4
        bend = np.abs(np.diff(course) / step).max()
        assert bend == pytest.approx(curve.curvature_1pm, rel=1e-3)

    def test_it_closes(self, curve):
        _, pos, _ = differences(curve, 10)
        np.testing.assert_allclose(pos[-1], pos[0], atol=1e-9)
        assert np.ptp(pos[:, 2]) == 0.0


def test_a_slalom_turns_as_often_and_as_far_as_it_says():
    """In its own axes: turns, their spacing, the bend of a sine; straight at both ends."""
    slalom = Slalom(HERE, 0.7, 12.0, 1.5, 4, 8.0)
    along, pos, course = differences(slalom)
    c, s = math.cos(0.7), math.sin(0.7)
    way = (pos - HERE)[:, :2] @ np.array([[c, -s], [s, c]])
    turns = np.flatnonzero(np.diff(np.sign(np.diff(way[:, 1]))) != 0) + 1
    turns = turns[np.abs(way[turns, 1]) > 0.1]
    np.testing.assert_allclose(way[turns, 1], [1.5, -1.5, 1.5, -1.5], atol=1e-4)
    np.testing.assert_allclose(np.diff(way[turns, 0]), 12.0, atol=0.05)
    step, moved = np.diff(along), np.diff(pos, axis=0)
    np.testing.assert_allclose(np.linalg.norm(moved, axis=1) / step, 1.0, atol=1e-4)
    middle = 0.5 * (course[1:] + course[:-1])
    assert apart(np.arctan2(moved[:, 1], moved[:, 0]), middle) < 1e-3
    assert slalom.curvature_1pm == pytest.approx(1.5 * (math.pi / 12.0) ** 2, rel=1e-3)
    assert way[along < 7.9][:, 1] == pytest.approx(0.0)
    assert course[-1] == pytest.approx(0.7) and way[-1, 1] == pytest.approx(0.0)
    # The same length by quadrature of the sine between its outer turns, the joints by the table.
    wave, _ = quad(lambda x: math.hypot(1.0, 1.5 * math.pi / 12.0 * math.sin(x)), 0.0, 3 * math.pi)
    outer = np.diff(along[turns[[0, -1]]])[0]
    assert outer == pytest.approx(wave * 12.0 / math.pi, abs=0.05)


@pytest.mark.parametrize(
    ("change", "words"),
    [({"turns": 1}, "turns are 1; allowed: at least 2"), ({"aside_m": 0.0}, "aside is 0 m")],
)
def test_a_slalom_that_is_none_is_refused(change, words):
    numbers = {"interval_m": 12.0, "aside_m": 1.5, "turns": 4, "run_m": 8.0} | change
    with pytest.raises(PathError, match=words) as refused:
        Slalom(HERE, 0.0, **numbers)
    assert refused.value.cause is PathCause.BAD_SIZE


def test_the_lemniscate_is_bernoullis():
    """(x^2 + y^2)^2 = a^2 (x^2 - y^2); its length by quadrature and by Gauss's constant."""
    a, axis = 10.0, 0.4
    eight = Lemniscate(HERE, axis, 2.0 * a)
    _, pos, _ = differences(eight, 400)
    north, east, _ = (pos - HERE).T
    x = np.cos(axis) * north + np.sin(axis) * east
    y = -np.sin(axis) * north + np.cos(axis) * east
    r2 = x * x + y * y
    np.testing.assert_allclose(r2 * r2, a * a * (x * x - y * y), atol=1e-8)
    assert x.max() == pytest.approx(a, abs=1e-3) and x.min() == pytest.approx(-a, abs=1e-3)
    quarter, _ = quad(lambda r: 1.0 / math.sqrt(1.0 - r**4), 0.0, 1.0)
    assert eight.lap_m == pytest.approx(4.0 * a * quarter)
    assert eight.lap_m == pytest.approx(a * gamma(0.25) ** 2 / math.sqrt(2.0 * math.pi))


class TestLegs:
    def test_a_long_leg_takes_the_time_of_its_seven_phases(self):
        """v / a + a / j for speeding up and slowing down, the rest at full speed."""
        path = FlightPath(HERE, 0.0, LIMITS).go_to(HERE + [40.0, 30.0, 0.0])
        ramp = 5.0 / 3.0 + 3.0 / 4.0
        assert path.duration_s == pytest.approx(50.0 / 5.0 + ramp, rel=1e-9)

    def test_a_leg_is_straight_and_within_its_limits(self):
        goal = HERE + [8.0, -5.0, -6.0]
        path = FlightPath(HERE, 0.2, LIMITS).go_to(goal, 1.2)
        way = path.trajectory()
        pos, vel = way.points[:, REFERENCE.pos], way.points[:, REFERENCE.vel]
        np.testing.assert_allclose(pos[[0, -1]], [HERE, goal], atol=1e-9)
        direction = (goal - HERE) / np.linalg.norm(goal - HERE)
        np.testing.assert_allclose(np.cross(pos - HERE, direction), 0.0, atol=1e-9)
        assert np.hypot(*vel[:, :2].T).max() <= 5.0 + 1e-9
        assert np.abs(vel[:, 2]).max() == pytest.approx(2.0, abs=1e-6)
        psi = way.points[:, REFERENCE.psi]
        assert psi[0] == pytest.approx(0.2) and psi[-1] == pytest.approx(1.2)

    def test_from_a_motion_it_goes_on_without_a_jump(self):
        velocity = np.array([2.0, 1.0, 0.5])
        path = FlightPath(HERE, 0.0, LIMITS, vel_ned_mps=velocity).go_to(HERE + [5.0, 0.0, 0.0])
        points = path.trajectory().points
        np.testing.assert_allclose(points[0, REFERENCE.vel], velocity, atol=0.1)
        acceleration = np.diff(points[:-1, REFERENCE.vel], axis=0) / 0.04
        assert np.abs(acceleration).max() < math.sqrt(3.0) * 3.0

    def test_it_stops_as_soon_as_the_limits_allow(self):
        """From a steady v: in v / a + a / j, on half of v times that, straight on (v > a^2 / j)."""
        velocity, rate = np.array([3.0, 4.0, 0.0]), 0.5
        path = FlightPath(HERE, 3.0, LIMITS, vel_ned_mps=velocity, psi_rate_radps=rate).stop()
        time_s = 5.0 / 3.0 + 3.0 / 4.0
        assert path.duration_s == pytest.approx(time_s)
        np.testing.assert_allclose(path.pos_ned_m, HERE + 0.5 * velocity * time_s, atol=1e-9)
        # The turn is slow: its acceleration peaks at sqrt(rate j), after sqrt(rate / j).
        assert path.psi_rad == pytest.approx(3.0 + rate * math.sqrt(rate / 4.0))
        points = path.trajectory().points
        assert np.diff(np.linalg.norm(points[:, REFERENCE.vel], axis=1)).max() <= 1e-9

    @pytest.mark.parametrize(
        ("begin", "end", "turned"), [(3.0, -3.0, 2 * math.pi - 6.0), (0.0, 1.0, 1.0)]
    )
    def test_it_turns_the_short_way(self, begin, end, turned):
        path = FlightPath(HERE, begin, LIMITS).turn_to(end)
        assert path.psi_rad == pytest.approx(begin + turned)
        assert np.abs(path.trajectory().points[:, REFERENCE.psi]).max() <= math.pi

    def test_times_never_repeat_and_stays_cost_one_point(self):
        path = FlightPath(HERE, 0.0, LIMITS).stay(100.0).go_to(HERE).go_to(HERE + [1.0, 0.0, 0.0])
        way = path.stay(50.0).trajectory(start_ns=7)
        assert way.start_ns == 7 and way.times_ns[-1] * 1e-9 == pytest.approx(path.duration_s)
        assert way.times_ns.size < 100

    def test_velocity_is_the_slope_of_the_positions(self):
        way = FlightPath(HERE, 0.0, LIMITS).along(Lemniscate(HERE, 0.0, 20.0), 3.0, 1.0, "fixed")
        points, times = way.trajectory().points, way.trajectory().times_ns * 1e-9
        slope = np.diff(points[:, REFERENCE.pos], axis=0) / np.diff(times)[:, None]
        np.testing.assert_allclose(points[:-1, REFERENCE.vel], slope)
        assert np.linalg.norm(slope, axis=1).max() <= 3.0 + 1e-9


class TestHeadings:
    CIRCLE = Circle(HERE, 0.0, 10.0)

    def test_along(self):
        path = FlightPath(HERE, 1.0, LIMITS).along(self.CIRCLE, 3.0, 0.5, "along")
        points = path.trajectory().points
        moving = np.hypot(*points[:, REFERENCE.vel][:, :2].T) > 0.5
        course = np.arctan2(points[moving, 4], points[moving, 3])
        assert apart(course, points[moving, REFERENCE.psi]) < 0.01

    def test_centre(self):
        path = FlightPath(HERE, 1.0, LIMITS).along(self.CIRCLE, 3.0, 1.0, "centre")
        points = path.trajectory().points
        moving = np.hypot(*points[:, REFERENCE.vel][:, :2].T) > 0.1
        away = self.CIRCLE.centre_ned_m - points[moving, REFERENCE.pos]
        towards = np.arctan2(away[:, 1], away[:, 0])
        assert apart(towards, points[moving, REFERENCE.psi]) < 1e-6


def refused(call):
    with pytest.raises(PathError) as error:
        call()
    assert len(str(error.value).splitlines()) == 1
    return error.value.cause, str(error.value)


class TestRefused:
    def test_limits(self):
        for bad in (0.0, -1.0, math.nan, math.inf):
            cause, sentence = refused(
                lambda bad=bad: MotionLimits(5.0, bad, 3.0, 4.0, 1.0, 2.0, 4.0)
            )
            assert cause is PathCause.BAD_LIMIT and "climb_mps" in sentence

    def test_not_finite(self):
        path = FlightPath(HERE, 0.0, LIMITS)
        assert refused(lambda: path.go_to([math.nan, 0.0, 0.0]))[0] is PathCause.NOT_FINITE
        assert refused(lambda: path.stay(-1.0))[0] is PathCause.NOT_FINITE
        assert refused(lambda: FlightPath(HERE, math.inf, LIMITS))[0] is PathCause.NOT_FINITE
        assert refused(lambda: FlightPath(HERE * math.nan, 0.0, LIMITS))[0] is PathCause.NOT_FINITE
        assert refused(lambda: path.turn_to(math.nan))[0] is PathCause.NOT_FINITE

    def test_bends(self):
        path = FlightPath(HERE, 0.0, LIMITS)
        cause, sentence = refused(lambda: path.along(Circle(HERE, 0.0, 2.0), 3.0, 1.0, "fixed"))
        assert cause is PathCause.TOO_TIGHT and "4.50 m/s2" in sentence and "3 m/s2" in sentence
        cause, sentence = refused(lambda: path.along(Circle(HERE, 0.0, 1.0), 1.5, 1.0, "along"))
        assert cause is PathCause.TOO_TIGHT and "86 deg/s" in sentence and "57 deg/s" in sentence

    def test_sizes(self):
        path = FlightPath(HERE, 0.0, LIMITS)
        assert refused(lambda: Circle(HERE, 0.0, 0.0))[0] is PathCause.BAD_SIZE
        assert refused(lambda: Lemniscate(HERE, 0.0, -1.0))[0] is PathCause.BAD_SIZE
        circle = Circle(HERE, 0.0, 9.0)
        assert refused(lambda: path.along(circle, 3.0, 0.0, "fixed"))[0] is PathCause.BAD_SIZE
        assert refused(lambda: path.along(circle, 0.0, 1.0, "fixed"))[0] is PathCause.BAD_SIZE

    def test_too_long(self):
        path = FlightPath(HERE, 0.0, LIMITS).along(Circle(HERE, 0.0, 100.0), 1.0, 1.0, "fixed")
        cause, sentence = refused(path.trajectory)
        assert cause is PathCause.TOO_LONG and "4096" in sentence

    def test_a_start_that_no_motion_within_the_limits_continues(self):
        start = Motion(np.zeros(1), np.array([3.0]), np.array([1e9]))
        cause, sentence = refused(lambda: Transfer(start, np.array([1.0]), [0.0], [1.0], [1.0]))
        assert cause is PathCause.TOO_FAST and "1.e+09" in sentence
