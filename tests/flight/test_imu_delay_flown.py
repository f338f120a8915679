# SPDX-License-Identifier: Apache-2.0
"""An IMU whose low-pass delays the motion: what the observer is told of it, what that is worth."""

import functools

import pytest

from heli_core.errors import ParameterCause, PlantConfigError
from heli_core.rotations import rotation_between
from heli_dynamics_sim.config import PlantConfig, imu_delay_s
from heli_flight import loop as closed_loop
from heli_flight.settings import resolve

CUT_OFF_HZ = 44.8
LATE = {"sensors.imu.lowpass_motion": True, "sensors.imu.lowpass_hz": CUT_OFF_HZ}
KNOWN, MOTION = "ekf.imu.delay_s", "sensors.imu.lowpass_motion"


def settings(plant, observer, params=(), seed=101):
    over = {"plant": plant, "observer": observer}
    return resolve("hover", "rtk", seed, 20.0, world="honest", params=params, overrides=over)


def told(*args):
    return settings(*args).nodes["observer"][KNOWN]


def test_the_observer_is_told_the_delay_of_the_low_pass():
    assert told({}, {}) == told({"sensors.imu.lowpass_hz": CUT_OFF_HZ}, {}) == 0.0
    assert told(LATE, {}) == imu_delay_s(True, CUT_OFF_HZ)


def test_its_own_value_may_be_another(tmp_path):
    """By an override and by a file; of a file that gives both the same, an override moves both."""
    assert told(LATE, {KNOWN: 0.0}) == 0.0
    file, own = tmp_path / "own.yaml", imu_delay_s(True, CUT_OFF_HZ)
    for of_plant, flown in ((20.0, own), (CUT_OFF_HZ, imu_delay_s(True, 10.0))):
        file.write_text(
            f"observer:\n  ros__parameters:\n    {KNOWN}: {own!r}\n"
            f"plant:\n  ros__parameters:\n    {MOTION}: true\n"
            f"    sensors.imu.lowpass_hz: {of_plant}\n"
        )
        assert told({"sensors.imu.lowpass_hz": 10.0}, {}, [file]) == flown


@pytest.mark.parametrize("cut_off_hz", [0.0, 4.5])
def test_a_low_pass_that_is_none_or_too_slow_is_refused_by_name(cut_off_hz):
    plant = settings({MOTION: True, "sensors.imu.lowpass_hz": cut_off_hz}, {}).nodes["plant"]
    with pytest.raises(PlantConfigError) as refused:
        PlantConfig.from_parameters(plant)
    assert refused.value.cause is ParameterCause.CONFLICT
    assert refused.value.key == "sensors.imu.lowpass_hz"


@functools.cache
def late_s(filtered, known):
    """How far the estimate's attitude is behind the turning aircraft's: errors over rates, s."""
    flown = settings(LATE if filtered else {}, {} if known else {KNOWN: 0.0})
    flight = closed_loop.fly_loop(closed_loop.build(flown), flown)
    assert flight.status == 0, flight.sentence
    r = flight.record
    off = rotation_between(r.nav_q_nb, r.truth_q_nb)[500:, :2]
    rates = r.truth_rate_body_radps[500:, :2]
    off = off - off.mean(axis=0)
    return float((off * rates).sum() / (rates**2).sum())


@pytest.mark.slow
def test_in_flight_the_attitude_is_late_by_the_delay_unless_it_is_known():
    """The heading of the test is north, so body rates are those of the NED axes to first order."""
    without, known, unknown = late_s(False, True), late_s(True, True), late_s(True, False)
    assert unknown - without == pytest.approx(imu_delay_s(True, CUT_OFF_HZ), rel=0.15)
    assert known - without == pytest.approx(0.0, abs=0.15 * imu_delay_s(True, CUT_OFF_HZ))
