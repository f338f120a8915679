# SPDX-License-Identifier: Apache-2.0
"""A flight of the graph as a ULog has what its inertial sensors told, without any excitation."""

import json

import numpy as np
import pytest
from pyulog import ULog

from heli_bags.reader import read_bag
from heli_core.rows import IMU
from heli_flight.cli import app as cli


@pytest.mark.slow
@pytest.mark.parametrize(("rate_hz", "world"), [(100, "honest"), (400, "paper")])
def test_the_inertial_sensors_are_those_of_the_bag(hover_test, tmp_path, rate_hz, world):
    folder = tmp_path / "flight"
    words = ("--seed", 3, "--duration", 6, "--rate", rate_hz, "--world", world)
    hover_test("--out", folder, *words)
    assert json.loads((folder / "result.json").read_text())["lost"] == ""
    assert cli.main(["bag", "ulog", str(folder)]) == 0
    log = ULog(str(folder / "flight.ulg"))
    data = log.get_dataset("sensor_combined").data
    read = {
        name: np.column_stack([data[f"{name}[{i}]"] for i in range(3)])
        for name in ("gyro_rad", "accelerometer_m_s2")
    }
    sent = read_bag(folder / "bag").streams["imu/data_raw"].rows
    n = len(read["gyro_rad"])
    assert n >= 6 * rate_hz - 2
    np.testing.assert_array_equal(read["gyro_rad"], sent[:n, IMU.rate].astype(np.float32))
    force = sent[:n, IMU.force].astype(np.float32)
    np.testing.assert_array_equal(read["accelerometer_m_s2"], force)
    # As PX4 has it: FRD, so gravity shows as -g on z.
    assert read["accelerometer_m_s2"][:, 2].mean() == pytest.approx(-9.8, abs=0.5)
    assert set(data["accelerometer_integral_dt"]) == {1_000_000 // rate_hz}
    assert set(np.diff(data["timestamp"]).tolist()) == {1_000_000 // rate_hz}
    if world == "honest":
        # What Flight Review draws as the power spectral density of the acceleration: the rotor.
        window = np.hanning(n)[:, None]
        power = np.abs(np.fft.rfft(force * window, axis=0)).sum(axis=1)
        hz = np.fft.rfftfreq(n, 1.0 / rate_hz)
        peak = hz[5:][power[5:].argmax()]
        assert peak == pytest.approx(193.73 / (2.0 * np.pi), abs=0.5)
