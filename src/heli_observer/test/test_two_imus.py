# SPDX-License-Identifier: Apache-2.0
"""Two IMUs as one: their mean, who is left and why, and that nothing jumps."""

import numpy as np
import pytest

from heli_core.rows import IMU, MEAS, NAV
from heli_observer import layout as L
from heli_observer.dual_imu import PAIR, WHY_COMPASS, WHY_FIXES, WHY_NOTHING, WHY_STOPPED
from heli_observer.layout import ObserverStatus
from support.synthetic_sensors import hover_path, synthesize

AT = 1000
PLACES = {1: MEAS.imu, 2: MEAS.imu2}


@pytest.fixture
def two(parameters, run_observer):
    """two(seed): a flight whose second IMU has errors of its own, and an observer of both."""

    def make(seed=1, seconds=20.0, apart=0.0):
        parameters["imu2.enabled"] = True
        flight = synthesize(hover_path(), parameters, seconds, seed=seed)
        other = synthesize(hover_path(), parameters, seconds, seed=seed + 100)
        flight.y[:, MEAS.imu2] = other.y[:, MEAS.imu] + apart
        return flight, run_observer(parameters)

    return make


def errors(flight, run, since):
    """Largest errors of velocity (m/s) and attitude (rad) from a tick on."""
    ticks = np.arange(since, len(run.out))
    return (
        np.abs(run.out[since:, NAV.vel] - flight.vel[since : len(run.out)]).max(),
        np.abs(flight.attitude_error(run.out, ticks)).max(),
    )


def test_the_mean_is_flown_while_they_agree(two):
    apart = np.array([0.2, -0.1, 0.0, 0.003, 0.0, -0.002])
    flight, run = two(apart=apart)
    run.fly(flight.y)
    pair, tick = run.state.pair, len(flight.y) - 1
    mean = 0.5 * (flight.y[tick, MEAS.imu] + flight.y[tick, MEAS.imu2])
    np.testing.assert_allclose(run.state.imu[tick % len(run.state.imu), : IMU.size], mean)
    learnt = np.mean(flight.y[:, MEAS.imu2] - flight.y[:, MEAS.imu], axis=0)
    np.testing.assert_allclose(pair.offset[:3], learnt[:3], atol=0.01)
    np.testing.assert_allclose(pair.offset[3:], learnt[3:], atol=0.001)
    assert pair.count[PAIR.compared] == len(flight.y)
    assert pair.count[PAIR.switches] == 0 and run.health is ObserverStatus.OK


@pytest.mark.parametrize("number", [1, 2])
@pytest.mark.parametrize("kind", ["nan", "zero", "frozen", "out of range"])
def test_one_that_stops_is_left_at_once_and_leaves_no_step(two, number, kind):
    flight, sound = two(apart=np.array([0.2, -0.1, 0.1, 0.003, -0.002, 0.002]))
    sound.fly(flight.y)
    rows, place = flight.y.copy(), PLACES[number]
    rows[AT:, place] = {
        "nan": np.nan, "zero": 0.0, "frozen": rows[AT, place], "out of range": 1e3
    }[kind]  # fmt: skip
    _, run = two()
    run.fly(rows[: AT + 4])
    assert run.state.pair.count[PAIR.left] == number
    assert run.state.pair.count[PAIR.why] == WHY_STOPPED
    assert run.health is ObserverStatus.IMU_LEFT
    run.fly(rows[AT + 4 :])
    assert run.state.count[L.COUNT.imu_replaced] == 0
    steps = np.abs(run.out - sound.out)[AT:]
    assert steps[:50, NAV.vel].max() < 0.01 and steps[:50, NAV.quat].max() < 1e-3
    assert errors(flight, run, AT)[0] < 0.2


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("number", [1, 2])
@pytest.mark.parametrize(
    ("axis", "jump"), [(0, 1.0), (2, -1.0), (3, 0.1), (4, -0.1), (5, 0.1)],
    ids=["force forward", "force down", "roll", "pitch", "yaw"],
)  # fmt: skip
def test_who_contradicts_fixes_and_compass_is_left(two, number, axis, jump, seed):
    flight, run = two(seed)
    rows = flight.y.copy()
    rows[AT:, PLACES[number].start + axis] += jump
    run.fly(rows[: AT + 200])
    pair = run.state.pair
    assert pair.count[PAIR.left] == number and pair.count[PAIR.switches] == 1
    by = {WHY_COMPASS} if axis == 5 else {WHY_FIXES} if axis < 3 else {WHY_COMPASS, WHY_FIXES}
    assert pair.count[PAIR.why] in by
    run.fly(rows[AT + 200 :])
    velocity, attitude = errors(flight, run, AT + 200)
    assert velocity < 0.25 and attitude < 0.03
    assert run.state.count[L.COUNT.imu_doubts] == 0


@pytest.mark.parametrize("number", [1, 2])
def test_without_fixes_and_compass_nobody_is_left(two, number):
    """Nothing tells who is wrong: the mean goes on, and the status says that they disagree."""
    flight, run = two()
    rows = flight.y.copy()
    rows[AT - 100 :, [MEAS.gps_valid, MEAS.mag_valid]] = 0.0
    rows[AT:, PLACES[number].start + 3] += 0.1
    run.fly(rows[: AT + 150])
    assert run.state.pair.count[PAIR.left] == 0 and run.state.pair.count[PAIR.trial] == 1
    assert run.health is ObserverStatus.IMUS_DISAGREE


def test_who_agrees_again_is_believed_again(two):
    flight, run = two()
    rows = flight.y.copy()
    rows[AT : AT + 100, MEAS.imu2.start + 3] += 0.1
    run.fly(rows[: AT + 290])
    assert run.state.pair.count[PAIR.left] == 2
    run.fly(rows[AT + 290 : AT + 360])
    assert run.state.pair.count[PAIR.left] == 0 and run.state.pair.count[PAIR.why] == WHY_NOTHING
    assert run.health is ObserverStatus.OK
    assert np.abs(np.diff(run.out[AT + 200 :, NAV.vel], axis=0)).max() < 0.05


def test_both_that_stop_are_as_one_that_stops(two):
    flight, run = two()
    rows = flight.y.copy()
    rows[AT : AT + 20, MEAS.imu] = rows[AT : AT + 20, MEAS.imu2] = np.nan
    run.fly(rows)
    assert run.state.count[L.COUNT.imu_replaced] == 20
    assert run.health is ObserverStatus.OK
    assert errors(flight, run, AT)[0] < 0.5


def test_ticks_that_never_come_or_come_twice_do_not_matter(two):
    """A gap within what is allowed, in the midst of a comparison; the tick before it twice."""
    flight, run = two()
    rows = flight.y.copy()
    rows[AT:, MEAS.imu2.start + 3] += 0.1
    for tick, row in enumerate(rows):
        if not AT + 10 <= tick < AT + 30:
            run.step(tick, row)
        if tick == AT + 9:
            run.step(tick, row)
    assert run.state.pair.count[PAIR.left] == 2 and run.state.count[L.COUNT.tick_repeated] == 1
    assert run.state.count[L.COUNT.tick_gaps] == 1
