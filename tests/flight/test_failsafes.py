# SPDX-License-Identifier: Apache-2.0
"""Each row of the table of failsafes, flown in one process: found in time, acted on, survived.

Hover at 10 m in the paper's wind; the fault begins at 12 s.
"""

import math

import numpy as np
import pytest

from evidence.experiments import gps_lost
from heli_core.rotations import euler_angles
from heli_flight import loop as closed_loop
from heli_flight.settings import resolve
from heli_observer import layout as L
from heli_observer.dual_imu import PAIR, WHY_COMPASS, WHY_FIXES, WHY_STOPPED
from heli_observer.layout import ObserverStatus
from heli_observer.observer import status
from heli_outer_pd.failsafes import Condition, of

BEGIN_S = 12.0
AT = int(BEGIN_S * 100)
STAYS = {"climb.start_s": 200.0, "climb.end_s": 202.0}
DOUBTS = (L.COUNT.imu_doubts, L.COUNT.imu_replaced, L.COUNT.gps_repeated, L.COUNT.gps_offset)


class Flown:
    """A hover with faults: its record, the observer at its end, and what is said of both."""

    def __init__(
        self, faults, seed, seconds, gps="standalone", world="paper", scenario=STAYS, two=False,
        **outer,
    ):  # fmt: skip
        over = {"plant": {"faults": tuple(faults) or ("none",)}, "scenario": scenario}
        over["plant"]["sensors.imu2.enabled"] = two
        over |= {"observer": {"imu2.enabled": two}, "outer_loop": outer}
        settings = resolve("hover", gps, seed, seconds, world=world, overrides=over)
        loop = closed_loop.build(settings)
        flight = closed_loop.fly_loop(loop, settings)
        self.record, self.count = flight.record, loop.observer_s.count
        self.pair = loop.observer_s.pair.count
        self.observer_status = ObserverStatus(status(loop.observer_s, loop.observer_k))
        assert flight.status == 0, flight.sentence

    def off_m(self, since=AT):
        """Largest horizontal distance from where it held before the fault."""
        pos = self.record.truth_pos_ned_m
        return np.linalg.norm((pos[since:] - pos[AT])[:, :2], axis=1).max()

    def began_s(self):
        """From the fault to the landing."""
        return 0.01 * (np.flatnonzero(self.record.mode == "land")[0] - AT)

    def down(self):
        """When it stands, from the fault on, s, and its speed in the second before, m/s."""
        assert self.record.mode[-1] == "standing"
        last = np.flatnonzero(self.record.mode == "land")[-1]
        return 0.01 * (last - AT), np.abs(self.record.truth_vel_ned_mps[last - 100 : last, 2]).max()


def fault(what, kind, duration_s=None, value=None):
    words = f"what: {what}, kind: {kind}, start_s: {BEGIN_S}"
    words += "" if duration_s is None else f", duration_s: {duration_s}"
    return f"{{{words}{'' if value is None else f', value: {value}'}}}"


def seeds(first, *others):
    """Seeds of a test: the first is flown in every run, the others with the slow tests."""
    return [first, *(pytest.param(seed, marks=pytest.mark.slow) for seed in others)]


DRIFT = [fault("gps", "drift", None, [2.0, 0.0, 0.0]),
         fault("gps_velocity", "bias", None, [2.0, 0.0, 0.0])]  # fmt: skip
FOUND = [
    (Condition.GPS_SILENT, [fault("gps", "loss")], ObserverStatus.GPS_TIMEOUT),
    (Condition.GPS_STUCK, [fault("gps", "freeze")], ObserverStatus.GPS_STUCK),
    (Condition.GPS_DRIFTS, DRIFT, ObserverStatus.GPS_REJECTED),
    (Condition.GPS_JUMPS, [fault("gps", "bias", None, [30.0, 0.0, 0.0])],
     ObserverStatus.GPS_REJECTED),
    (Condition.IMU_STOPS, [fault("imu", "zero", 0.2)], ObserverStatus.IMU_FROZEN),
    (Condition.IMU_STOPS, [fault("imu", "freeze", 0.2)], ObserverStatus.IMU_FROZEN),
    (Condition.IMU_STOPS, [fault("imu", "nan", 0.2)], ObserverStatus.IMU_TIMEOUT),
    (Condition.MAG_LOST, [fault("mag", "loss")], ObserverStatus.MAG_TIMEOUT),
    (Condition.MAG_LOST, [fault("mag", "zero")], ObserverStatus.MAG_REJECTED),
    (Condition.BARO_LOST, [fault("baro", "loss")], ObserverStatus.BARO_TIMEOUT),
    (Condition.BARO_LOST, [fault("baro", "bias", None, [500.0])], ObserverStatus.BARO_REJECTED),
]  # fmt: skip


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize(("condition", "faults", "observer_status"), FOUND)
def test_it_is_found_in_time_and_named(condition, faults, observer_status, seed):
    """At the end of the time that the table gives; nothing has happened to the aircraft by then."""
    flown = Flown(faults, seed, BEGIN_S + of(condition).within_s)
    assert flown.observer_status is observer_status
    assert observer_status.name in of(condition).status
    assert flown.off_m() < 5.0


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_a_compass_wrong_from_the_start_is_told_by_motion(seed):
    """Built in wrong by 30 deg: the figure of eight tells the heading, and is flown with it."""
    c, s = math.cos(math.pi / 6.0), math.sin(math.pi / 6.0)
    over = {"plant": {"sensors.mag.soft_iron": [c, -s, 0.0, s, c, 0.0, 0.0, 0.0, 1.0]}}
    settings = resolve("figure_eight", "rtk", seed, 45.0, world="honest", overrides=over)
    loop = closed_loop.build(settings)
    flight = closed_loop.fly_loop(loop, settings)
    row, said = of(Condition.MAG_ASKEW), ObserverStatus(status(loop.observer_s, loop.observer_k))
    assert said is ObserverStatus.MAG_LEFT and said.name in row.status
    flown, true = euler_angles(flight.record.nav_q_nb), euler_angles(flight.record.truth_q_nb)
    off_deg = np.abs((np.degrees(flown - true)[:, 2] + 180.0) % 360.0 - 180.0)
    assert off_deg[20:100].min() > 15.0 and off_deg[round(100 * row.within_s) :].max() < 10.0


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize("kind", ["zero", "freeze", "nan"])
def test_an_imu_that_stops_for_02_s_costs_less_than_1_m(kind, seed):
    sound, hurt = Flown([], seed, 30.0), Flown([fault("imu", kind, 0.2)], seed, 30.0)
    apart = sound.record.truth_pos_ned_m - hurt.record.truth_pos_ned_m
    assert np.linalg.norm(apart[AT:], axis=1).max() < 1.0
    assert hurt.observer_status is ObserverStatus.OK


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize(
    ("what", "value"), [("gyro", [0.1, 0.0, 0.0]), ("gyro", [0.0, 0.1, 0.0]),
                        ("accel", [1.0, 0.0, 0.0]), ("accel", [0.0, 1.0, 0.0])]
)  # fmt: skip
def test_a_bias_that_jumps_is_learnt_in_flight(what, value, seed):
    """The filter used to refuse the fixes until the aircraft was lost."""
    within_s = of(Condition.IMU_BIASED).within_s
    soon = Flown([fault(what, "bias", None, value)], seed, BEGIN_S + within_s)
    assert soon.count[L.COUNT.imu_doubts] >= 1
    flown = Flown([fault(what, "bias", None, value)], seed, 45.0)
    assert flown.off_m(3500) < 2.0 and flown.off_m() < 8.0


ONE_STOPS = [("imu", "nan"), ("imu", "zero"), ("imu", "freeze"), ("imu", "loss"),
             ("imu2", "nan"), ("imu2", "zero"), ("imu2", "freeze"), ("imu2", "loss")]  # fmt: skip
ONE_WRONG = [("gyro", "bias", [0.1, 0.0, 0.0]), ("gyro2", "bias", [0.0, -0.1, 0.0]),
             ("gyro", "bias", [0.0, 0.0, 0.1]), ("accel", "bias", [1.0, 0.0, 0.0]),
             ("accel2", "bias", [0.0, 0.0, -1.0])]  # fmt: skip


def number_of(what):
    return 2 if what.endswith("2") else 1


def apart_m(faults, seed, world="paper", gps="standalone"):
    """How far a flight with two IMUs comes from the same without the fault, m; and that flight."""
    sound = Flown([], seed, 40.0, gps, world, two=True)
    hurt = Flown(faults, seed, 40.0, gps, world, two=True)
    apart = sound.record.truth_pos_ned_m - hurt.record.truth_pos_ned_m
    return np.linalg.norm(apart, axis=1).max(), hurt


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize(("what", "kind"), ONE_STOPS)
def test_of_two_imus_one_that_stops_is_left_at_once(what, kind, seed):
    soon = Flown(
        [fault(what, kind)], seed, BEGIN_S + of(Condition.ONE_IMU_STOPS).within_s, two=True
    )
    assert soon.observer_status is ObserverStatus.IMU_LEFT
    assert soon.observer_status.name in of(Condition.ONE_IMU_STOPS).status
    far_m, flown = apart_m([fault(what, kind)], seed)
    assert far_m < 0.3
    assert flown.pair[PAIR.left] == number_of(what) and flown.pair[PAIR.why] == WHY_STOPPED
    assert flown.pair[PAIR.switches] == 1 and not flown.count[L.COUNT.imu_replaced]


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize(("what", "kind", "value"), ONE_WRONG)
def test_of_two_imus_one_that_is_wrong_is_found_by_fixes_and_compass(what, kind, value, seed):
    faults = [fault(what, kind, None, value)]
    within_s = of(Condition.ONE_IMU_WRONG).within_s
    soon = Flown(faults, seed, BEGIN_S + within_s, two=True)
    assert soon.observer_status is ObserverStatus.IMU_LEFT
    assert soon.observer_status.name in of(Condition.ONE_IMU_WRONG).status
    far_m, flown = apart_m(faults, seed)
    assert far_m < 1.0
    assert flown.pair[PAIR.left] == number_of(what)
    assert flown.pair[PAIR.why] in (WHY_FIXES, WHY_COMPASS) and flown.pair[PAIR.switches] == 1


@pytest.mark.parametrize("gps", ["standalone", "rtk"])
@pytest.mark.parametrize("seed", seeds(1, 2, 3))
def test_of_two_imus_one_may_drift_in_the_honest_world(seed, gps):
    """Slowly, so that what is known has been spoilt a little when they are found to disagree."""
    far_m, flown = apart_m([fault("gyro2", "drift", None, [0.0, 0.01, 0.0])], seed, "honest", gps)
    assert far_m < 2.0 and flown.pair[PAIR.left] == 2


def test_of_two_imus_one_that_is_sound_again_is_believed_again():
    far_m, flown = apart_m([fault("imu", "nan", 0.3)], 3)
    assert far_m < 0.3 and flown.observer_status is ObserverStatus.OK
    assert flown.pair[PAIR.left] == 0 and flown.pair[PAIR.switches] == 1


def test_who_was_left_is_flown_where_the_other_one_stops():
    """Less what he was off by."""
    stops = "{what: imu2, kind: nan, start_s: 20.0, duration_s: 0.5}"
    far_m, flown = apart_m([fault("gyro", "bias", None, [0.1, 0.0, 0.0]), stops], 2)
    assert far_m < 0.5 and flown.pair[PAIR.left] == 1
    assert not flown.count[L.COUNT.imu_replaced]


@pytest.mark.parametrize("seed", seeds(1, 2))
@pytest.mark.parametrize("faults", [[fault("gps", "loss")], [fault("gps", "freeze")], DRIFT])
def test_what_is_lost_for_long_lands_by_itself(faults, seed):
    flown = Flown(faults, seed, 95.0, **{"failsafe.land_astray_m": 1e4})
    record = flown.record
    landing = np.flatnonzero(record.mode == "land")
    lost = np.flatnonzero(record.nav_sigma_vel_mps[:, :2].max(axis=1) > 0.5)[0]
    assert 0.01 * (lost - AT) < of(Condition.POSITION_LOST).within_s
    assert 0.01 * (landing[0] - AT) < of(Condition.POSITION_LOST_LONG).within_s
    assert landing[0] > lost + 1100
    assert flown.down()[1] < 1.0


@pytest.mark.parametrize("seed", seeds(1, 3, 6))
@pytest.mark.parametrize("gps", ["standalone", "rtk"])
@pytest.mark.parametrize("faults", [[fault("gps", "loss")], [fault("gps", "freeze")], DRIFT])
def test_what_leads_astray_is_landed_within_a_minute(faults, gps, seed):
    """Begun before it is 10 m away: three of the ten seeds of the published table, with the worst
    of either receiver."""
    flown = Flown(faults, seed, 75.0, gps, "honest")
    assert flown.began_s() < of(Condition.POSITION_ASTRAY).within_s
    assert flown.off_m(AT) > 0.0
    before = flown.record.truth_pos_ned_m[AT : AT + int(100 * flown.began_s())]
    assert np.linalg.norm((before - before[0])[:, :2], axis=1).max() < 10.0
    down_s, speed = flown.down()
    assert down_s < 60.0 and speed < 1.0


@pytest.mark.parametrize("seed", seeds(6, 2, 8))
@pytest.mark.parametrize("gps", ["standalone", "rtk"])
def test_without_gps_and_barometer_it_comes_down_and_never_climbs_away(gps, seed):
    """Seeds that used to climb, to 105 m, or to stay where they were."""
    flown = Flown([fault("gps", "loss"), fault("baro", "loss")], seed, 110.0, gps, "honest")
    height = -flown.record.truth_pos_ned_m[:, 2]
    assert flown.began_s() < of(Condition.POSITION_ASTRAY).within_s
    assert height[AT:].max() < height[AT] + 4.0
    down_s, speed = flown.down()
    assert down_s < 90.0 and speed < 1.0


@pytest.mark.parametrize("seed", seeds(1, 2, 3))
@pytest.mark.parametrize("baro", [False, True])
def test_a_fix_that_comes_back_is_no_step_of_the_set_point(baro, seed):
    """What the navigation is moved by is flown back, not jumped at."""
    faults = [fault("gps", "loss", 10.0)] + ([fault("baro", "loss", 10.0)] if baro else [])
    flown = Flown(faults, seed, 30.0, "standalone", "honest", **{"failsafe.land_astray_m": 1e4})
    back = AT + 1000
    step = np.degrees(np.abs(np.diff(flown.record.setpoint[back : back + 300, :2], axis=0)))
    jump = np.diff(flown.record.nav_vel_ned_mps[back : back + 300, :2], axis=0)
    assert np.abs(jump).max() > 0.1
    assert step.max() < 6.0


@pytest.mark.parametrize("seed", seeds(1, 2))
def test_an_outage_that_ends_is_flown_through(seed):
    """Of a receiver that had the time to teach the filter its tilt and biases."""
    lost = "{what: gps, kind: loss, start_s: 60.0, duration_s: 10.0}"
    flown = Flown([lost], seed, 88.0)
    assert flown.observer_status is ObserverStatus.OK and flown.record.mode is None
    assert flown.off_m(8300) < 6.0


@pytest.mark.parametrize(("gps", "seed"), [("standalone", 15), ("standalone", 5019), ("rtk", 6)])
def test_a_receiver_that_is_lost_is_landed_from_where_dead_reckoning_leads(gps, seed):
    """A receiver whose height was 9 m off; skids that stop a speed that the navigation knows
    nothing of, which rolled it over; and a gust upwards in which the quick descent was taken for
    the ground that carries it."""
    flown = Flown([fault("gps", "loss")], seed, BEGIN_S + 30.0, gps, "honest")
    down_s, speed = flown.down()
    assert down_s < (14.0 if gps == "standalone" else 24.0) and speed < 1.2
    pos = flown.record.truth_pos_ned_m
    assert np.linalg.norm(pos[-1, :2]) < 10.0
    # It is on the ground where it stands.
    assert pos[AT + round(100 * down_s), 2] > -0.5


@pytest.mark.nightly
@pytest.mark.parametrize("gps", ["standalone", "rtk"])
@pytest.mark.parametrize("world", ["paper", "honest"])
def test_of_forty_that_lose_their_receiver_the_worst_stays_within_reach(world, gps):
    """Seeds that neither were tuned on nor are published."""
    off_m = [gps_lost.landing(world, gps, seed)[1][-1] for seed in range(7001, 7041)]
    assert np.linalg.norm(off_m, axis=1).max() < 1.2 * gps_lost.GOAL_M


@pytest.mark.parametrize("two", [False, True])
@pytest.mark.parametrize("world", ["paper", "honest"])
@pytest.mark.parametrize("gps", ["standalone", "rtk"])
@pytest.mark.parametrize("seed", seeds(1, 2, 3, 4, 5))
def test_a_sound_flight_raises_no_alarm(seed, gps, world, two):
    flown = Flown([], seed, 60.0, gps, world, scenario={}, two=two)
    assert not flown.pair[PAIR.switches] and flown.pair[PAIR.compared] == 6000 * two
    assert not flown.count[list(DOUBTS)].any()
    assert flown.observer_status is ObserverStatus.OK and flown.record.mode is None


@pytest.mark.parametrize("seed", [15, 2007])
def test_a_gust_does_not_end_a_landing_in_the_air(seed):
    """Position is astray; in the descent 8 m/s from ahead carry the aircraft for two seconds."""
    flight = closed_loop.simulate(resolve("attitude_gusts", "standalone", seed, world="honest"))
    assert flight.status == 0, flight.sentence
