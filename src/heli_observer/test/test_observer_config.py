# SPDX-License-Identifier: Apache-2.0
"""Packaged YAML and table of the observer: complete, refused when wrong, in step with the plant."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from heli_core.parameters import load
from heli_core.rcl_yaml import ParameterError
from heli_observer.ekf import start_covariance
from heli_observer.layout import ERROR
from heli_observer.observer import ObserverConfig, ObserverConfigError
from heli_observer.parameters import NODE_NAME, TABLE


def test_every_key_of_the_yaml_carries_a_comment(config_folder):
    lines = (config_folder / "observer.yaml").read_text().splitlines()
    names = {row.name.split(".")[-1] for row in TABLE}
    keys = set()
    for number, line in enumerate(lines):
        key = line.strip().split(":")[0]
        if key not in names or line.strip().startswith("#"):
            continue
        keys.add(key)
        above = number - 1
        while lines[above].strip() and not lines[above].strip().startswith("#"):
            above -= 1
        assert lines[above].strip().startswith("#") and number - above <= 15, key
    assert keys == names


@pytest.mark.parametrize("overlay", ["gps_standalone.yaml", "gps_rtk.yaml"])
def test_overlays_load_and_change_only_the_gps(config_folder, overlay):
    base = load(TABLE, [config_folder / "observer.yaml"], NODE_NAME)
    values = load(TABLE, [config_folder / "observer.yaml", config_folder / overlay], NODE_NAME)
    changed = {n for n in base if not np.array_equal(base[n], values[n])}
    assert all(name.startswith("ekf.gps.") for name in changed)
    assert bool(changed) == (overlay == "gps_rtk.yaml")
    ObserverConfig(values)


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("ekf.gate_probabillity: 0.9", ["gate_probabillity", "gate_probability"]),
        ("ekf.gravity_mps2: 10", ["ekf.gravity_mps2", "10"]),
        ("ekf.gravity_mps2: 12.0", ["ekf.gravity_mps2", "12"]),
        ("K: [1.0, 2.0]", ["K", "18"]),
        ("ekf.mag.field_ned_t: [.nan, 0.0, 0.0]", ["ekf.mag.field_ned_t", "nan"]),
        ("u_delay_ticks: 3", ["u_delay_ticks", "3"]),
        ("lockstep: 1", ["lockstep", "1"]),
        (
            "ekf.initial.gps_drift_fraction: 0.0",
            ["gps_drift_fraction: is called 'ekf.initial.drift_at_alignment_fraction' now"],
        ),
    ],
)
def test_wrong_values_are_refused_by_name(config_folder, tmp_path, line, words):
    path = tmp_path / "wrong.yaml"
    path.write_text(f"/**/observer:\n  ros__parameters:\n    {line}\n")
    with pytest.raises(ParameterError) as error:
        load(TABLE, [config_folder / "observer.yaml", path], NODE_NAME)
    for word in ["wrong.yaml", *words]:
        assert word in str(error.value)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"ekf.horizon_ticks": 10}, "ekf.horizon_ticks = 10"),
        ({"ekf.mag.field_ned_t": np.array([1e-6, 0.0, 5e-5])}, "horizontal part"),
        ({"K": np.full((3, 6), -1.0)}, "unstable"),
    ],
)
def test_values_that_do_not_fit_together_are_refused(parameters, change, words):
    with pytest.raises(ObserverConfigError, match=words):
        ObserverConfig(parameters | change)


def test_defaults_agree_with_the_plants_sensors(parameters):
    """The observer's picture of sensors, schedule and servos is that of the packaged plant."""
    packages = Path(__file__).resolve().parents[2]
    plant_yaml = packages / "heli_dynamics_sim/config/plant.yaml"
    common_yaml = packages / "heli_core/config/common.yaml"
    common = yaml.safe_load(common_yaml.read_text())["/**"]["ros__parameters"]
    plant = yaml.safe_load(plant_yaml.read_text())["/**/plant"]["ros__parameters"]
    sensors, v = plant["sensors"], parameters
    imu, gps, baro = sensors["imu"], sensors["gps"], sensors["baro"]
    for key in ("gyro_noise_density", "gyro_bias_walk", "accel_noise_density", "accel_bias_walk"):
        assert v["ekf.imu." + key] == imu[key]
    assert v["ekf.initial.gyro_bias_radps"] == imu["gyro_bias_sigma_radps"]
    assert v["ekf.initial.accel_bias_mps2"] == imu["accel_bias_sigma_mps2"]
    assert v["ekf.gps.position_horizontal_m"] == gps["white_m"]
    assert v["ekf.gps.drift_horizontal_m"] == gps["drift_m"]
    for kind in ("position", "drift"):
        ratio = v[f"ekf.gps.{kind}_vertical_m"] / v[f"ekf.gps.{kind}_horizontal_m"]
        assert ratio == pytest.approx(gps["vertical_factor"])
    assert v["ekf.gps.velocity_horizontal_mps"] == gps["velocity_mps"]
    assert v["ekf.gps.drift_time_constant_s"] == gps["drift_tau_s"]
    assert v["ekf.baro.noise_pa"] == baro["white_pa"]
    walk = baro["drift_pa"] * np.sqrt(2.0 / baro["drift_tau_s"])
    assert v["ekf.baro.bias_walk"] == pytest.approx(walk, rel=0.01)
    assert v["ekf.mag.noise_t"] == sensors["mag"]["white_t"]
    np.testing.assert_array_equal(v["ekf.mag.field_ned_t"], sensors["mag"]["field_ned_t"])
    for sensor in ("mag", "baro", "gps"):
        assert v[f"schedule.{sensor}_period_ticks"] == sensors[sensor]["period_ticks"]
    assert v["schedule.gps_latency_ticks"] == gps["latency_ticks"]
    assert v["ekf.origin_altitude_m"] == common["origin"]["altitude_m"]
    assert v["u_delay_ticks"] == plant["delay_ticks"]


@pytest.mark.parametrize("fraction", [0.0, 0.5, 1.0])
def test_sigma_counts_from_the_alignment_unless_it_is_told_to_be_absolute(parameters, fraction):
    """At alignment sigma holds the fix's white error, and of the drift the part that is asked."""
    v = parameters | {"ekf.initial.drift_at_alignment_fraction": fraction}
    kernel = ObserverConfig(v).params.ekf
    P = np.zeros((ERROR.size, ERROR.size))
    start_covariance(P, np.array([1.0, 0.0, 0.0, 0.0]), 0.0, kernel)
    for i, axis in enumerate(("horizontal", "horizontal", "vertical")):
        white, drift = v[f"ekf.gps.position_{axis}_m"], v[f"ekf.gps.drift_{axis}_m"]
        assert P[ERROR.pos + i, ERROR.pos + i] == pytest.approx(white**2 + (fraction * drift) ** 2)
