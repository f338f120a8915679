# SPDX-License-Identifier: Apache-2.0
"""The hover test with each grade of sensors, in one process: it flies to the end."""

import numpy as np
import pytest

from heli_core.command_line import config_folder
from heli_dynamics_sim.config import jump_share
from heli_dynamics_sim.plant import PlantStatus
from heli_flight.loop import simulate
from heli_flight.settings import resolve

GRADES = {"consumer": "standalone", "industrial": "standalone", "rtk": "rtk"}
# Its first sample is tipped by 7 deg. A filter that counts on its tilt having moved it before that
# sample is made sure of a wrong attitude by the first fix, and refuses all others.
TIPPED = ("rtk", 3)


def flights():
    """Grades and seeds: two of each and the tipped one in CI, ten nightly."""
    for grade in GRADES:
        for seed in range(1, 11):
            always = seed <= 2 or (grade, seed) == TIPPED
            yield pytest.param(grade, seed, marks=[] if always else [pytest.mark.nightly])


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


@pytest.mark.parametrize("world", ["paper", "honest"])
def test_precise_fixes_put_a_tipped_alignment_right(world):
    """By one sample in the world `paper`, by the mean of the first in `honest`, as it gives it."""
    receiver, seed = TIPPED
    file = config_folder("heli_dynamics_sim") / f"sensors_{receiver}.yaml"
    record = simulate(resolve("hover", seed=seed, world=world, params=[file])).record
    error = np.abs(record.nav_pos_ned_m - record.truth_pos_ned_m)
    assert np.isfinite(error[100:]).all()
    assert np.nanmax(error) < 1.0


@pytest.mark.parametrize("grade", GRADES)
def test_the_filter_is_told_the_noise_that_flies(grade):
    """Plant and observer of a grade's file agree: white errors, slow errors together, biases.

    The inertial sensors are told at least what their clock's jitter makes of the vibration, which
    is its slope times the jitter, and what scale and misalignment make of gravity.
    """
    file = config_folder("heli_dynamics_sim") / f"sensors_{grade}.yaml"
    nodes = resolve("hover", params=[file]).nodes
    plant, ekf = nodes["plant"], nodes["observer"]

    def assumed(key):
        return ekf[f"ekf.{key}"]

    def flown(key):
        return plant[f"sensors.{key}"]

    turns_hz = 193.73 / (2.0 * np.pi)
    for sensor, unit in (("gyro", "radps"), ("accel", "mps2")):
        slopes = [
            times * turns_hz * 2.0 * np.pi * left * flown(f"imu.vibration.{part}_{unit}")[0]
            for times, part, left in ((1, "rev", 0.9), (2, "blade", 0.47))
        ]
        shaken = np.linalg.norm(slopes) / np.sqrt(2.0) * flown("imu.clock_jitter_s")
        density = np.hypot(flown(f"imu.{sensor}_noise_density"), shaken / np.sqrt(100.0))
        assert 0.97 * density < assumed(f"imu.{sensor}_noise_density") < 2.1 * density
        assert assumed(f"imu.{sensor}_bias_walk") >= flown(f"imu.{sensor}_bias_walk")
    assert assumed("initial.gyro_bias_radps") == flown("imu.gyro_bias_sigma_radps")
    of_gravity = 9.781 * flown("imu.accel_misalignment_rad")
    bias = np.hypot(flown("imu.accel_bias_sigma_mps2"), of_gravity)
    assert assumed("initial.accel_bias_mps2") == pytest.approx(bias, rel=0.1)
    assert assumed("baro.noise_pa") == flown("baro.white_pa")
    assert assumed("mag.noise_t") == flown("mag.white_t")
    up = flown("gps.vertical_factor")
    for axis, factor in (("horizontal", 1.0), ("vertical", up)):
        assert assumed(f"gps.position_{axis}_m") == pytest.approx(factor * flown("gps.white_m"))
        for seconds in (10.0, 30.0, 60.0):
            told = 1.0 - np.exp(-2.0 * seconds / assumed("gps.drift_time_constant_s"))
            told *= assumed(f"gps.drift_{axis}_m") ** 2
            assert told == pytest.approx(factor**2 * moved_sq(flown, seconds), rel=0.15)
        assert assumed(f"gps.velocity_{axis}_mps") == flown("gps.velocity_mps")
    # what the vibration tips a single sample of the accelerometers by, at most
    tip = np.linalg.norm([*flown("imu.vibration.rev_mps2"), *flown("imu.vibration.blade_mps2")])
    assert tip / 9.781 / 4.0 < assumed("initial.level_rad") < tip / 9.781


def moved_sq(flown, seconds):
    """Mean square, m2, horizontal, of what the receiver's slow errors have moved since a fix.

    2 sigma^2 (1 - exp(-t / tau)) of a stationary error: drift; multipath, larger by the satellites
    that are blocked; jumps, while there is one.
    """
    satellites = flown("gps.satellites.open")
    larger = satellites / (satellites - flown("gps.satellites.blocked"))
    lasting = flown("gps.jump.duration_s")
    share = jump_share(flown("gps.jump.interval_s"), lasting)
    parts = (
        (flown("gps.drift_m") ** 2, flown("gps.drift_tau_s")),
        (larger * flown("gps.multipath.sigma_m") ** 2, flown("gps.multipath.tau_s")),
        (share * flown("gps.jump.sigma_m") ** 2, lasting or flown("gps.jump.interval_s")),
    )
    return sum(2.0 * square * -np.expm1(-seconds / tau) for square, tau in parts)


@pytest.mark.parametrize("grade", GRADES)
def test_a_world_gives_a_grade_to_plant_and_observer(grade, tmp_path):
    """Named in a world or given as --params: the same sensors, and the same told to the filter."""
    receiver = GRADES[grade]
    world = tmp_path / "mine.yaml"
    text = f"/**/world:\n  ros__parameters:\n    sensors:\n      {receiver}: {grade}\n"
    world.write_text(text)
    file = config_folder("heli_dynamics_sim") / f"sensors_{grade}.yaml"
    named = resolve("hover", receiver, seed=1, world=str(world)).nodes
    by_file = resolve("hover", seed=1, params=[file]).nodes
    for node in ("plant", "observer"):
        assert named[node].keys() == by_file[node].keys()
        for key, value in by_file[node].items():
            assert np.array_equal(named[node][key], value), key
