# SPDX-License-Identifier: Apache-2.0
"""The hover test with each grade of sensors, in one process: it flies to the end."""

import numpy as np
import pytest

from heli_dynamics_sim.plant import PlantStatus
from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.settings import resolve
from heli_parameters.locate import config_folder

GRADES = {"consumer": "standalone", "industrial": "standalone", "rtk": "rtk"}
# The observer levels itself by one sample, which vibration tips (here by 7 deg), and integrates it
# over its first 0.17 s: the tilt cannot show in the velocity there, but the covariance
# counts on it. The first precise fix makes it sure of a wrong attitude; its gates refuse the rest.
LOST_AT_ALIGNMENT = ("rtk", 3)


def flights():
    """Grades and seeds: two of each in CI, ten nightly."""
    for grade in GRADES:
        for seed in range(1, 11):
            marks = [pytest.mark.nightly] if seed > 2 else []
            if (grade, seed) == LOST_AT_ALIGNMENT:
                marks.append(pytest.mark.xfail(strict=True, reason="alignment under vibration"))
            yield pytest.param(grade, seed, marks=marks)


@pytest.mark.parametrize(("grade", "seed"), list(flights()))
def test_hover_with_a_grade_flies_to_the_end(grade, seed):
    """Not lost, and it knows where it is within 8 m, five sigma of the worst receiver's errors; how
    far it stays within the paper's figures is its result.
    """
    file = config_folder("heli_dynamics_sim") / f"sensors_{grade}.yaml"
    settings = resolve("hover", seed=seed, params=[file])
    assert settings.gps == GRADES[grade]
    flight = simulate(settings)
    assert flight.status == PlantStatus.OK
    record = flight.record
    assert record.time_s.size == settings.scenario.n_ticks
    assert np.abs(record.nav_pos_ned_m - record.truth_pos_ned_m).max() < 8.0


def test_alignment_on_the_mean_keeps_the_flight_that_one_sample_loses():
    """The world `honest` gives the grade and aligns on the mean of the first samples."""
    receiver, seed = LOST_AT_ALIGNMENT
    record = simulate(resolve("hover", receiver, seed=seed, world="honest")).record
    error = np.abs(record.nav_pos_ned_m - record.truth_pos_ned_m)
    assert np.isfinite(error[100:]).all()
    assert np.nanmax(error) < 1.0


@pytest.mark.parametrize("grade", GRADES)
def test_the_filter_is_told_the_noise_that_flies(grade):
    """Plant and observer of a grade's file agree: white errors, slow errors together, biases."""
    file = config_folder("heli_dynamics_sim") / f"sensors_{grade}.yaml"
    nodes = resolve("hover", params=[file]).nodes
    plant, ekf = nodes["plant"], nodes["observer"]

    def told(key):
        return ekf[f"ekf.{key}"]

    def flown(key):
        return plant[f"sensors.{key}"]

    for key in ("gyro_noise_density", "accel_noise_density", "gyro_bias_walk", "accel_bias_walk"):
        assert told(f"imu.{key}") == flown(f"imu.{key}"), key
    assert told("initial.gyro_bias_radps") == flown("imu.gyro_bias_sigma_radps")
    assert told("initial.accel_bias_mps2") == flown("imu.accel_bias_sigma_mps2")
    assert told("baro.noise_pa") == flown("baro.white_pa")
    assert told("mag.noise_t") == flown("mag.white_t")
    up = flown("gps.vertical_factor")
    jumps = 0.0 if grade == "rtk" else flown("gps.jump.sigma_m")
    slow = np.linalg.norm([flown("gps.drift_m"), flown("gps.multipath.sigma_m"), jumps])
    for axis, factor in (("horizontal", 1.0), ("vertical", up)):
        assert told(f"gps.position_{axis}_m") == pytest.approx(factor * flown("gps.white_m"))
        assert told(f"gps.drift_{axis}_m") == pytest.approx(factor * slow, rel=0.03)
        assert told(f"gps.velocity_{axis}_mps") == flown("gps.velocity_mps")
    # what the vibration tips a single sample of the accelerometers by, at most
    tip = np.linalg.norm([*flown("imu.vibration.rev_mps2"), *flown("imu.vibration.blade_mps2")])
    assert tip / 9.781 / 4.0 < told("initial.level_rad") < tip / 9.781


@pytest.mark.parametrize("grade", GRADES)
def test_a_world_gives_a_grade_to_plant_and_observer(grade, tmp_path):
    """Named in a world or given as --params: the same sensors, and the same told to the filter."""
    receiver = GRADES[grade]
    world = tmp_path / "mine.yaml"
    text = f"/**/world:\n  ros__parameters:\n    sensors:\n      {receiver}: {grade}\n"
    world.write_text(text)
    file = config_folder("heli_dynamics_sim") / f"sensors_{grade}.yaml"
    named = resolve("hover", receiver, seed=1, world=str(world)).nodes
    given = resolve("hover", seed=1, params=[file]).nodes
    for node in ("plant", "observer"):
        assert named[node].keys() == given[node].keys()
        for key, value in given[node].items():
            assert np.array_equal(named[node][key], value), key
