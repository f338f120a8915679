# SPDX-License-Identifier: Apache-2.0
"""`heli bag ulog`: read back by pyulog, which PX4's own tools read with."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from pyulog import ULog

from heli_bags.tools import LogTopic, ulog
from heli_core.rotations import euler_angles
from heli_flight.cli import app as cli
from heli_flight.record import NAME, read_record
from heli_flight.report.write import recorded, ulog_of


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A short flight in one process: its record and its log."""
    folder = tmp_path_factory.mktemp("ulog") / "f"
    words = ["hover", "--one-process", "--duration", "3", "--seed", "3", "--no-report"]
    cli.main([*words, "--out", str(folder)])
    assert cli.main(["bag", "ulog", str(folder)]) == 0
    record = read_record(folder / NAME)
    return SimpleNamespace(folder=folder, record=record, log=ULog(str(folder / "flight.ulg")))


def _columns(log, name, *fields):
    data = log.get_dataset(name).data
    return np.column_stack([data[field] for field in fields])


def _array(name, size):
    return [f"{name}[{i}]" for i in range(size)]


@pytest.mark.parametrize(
    ("topic", "fields", "of_record"),
    [
        ("vehicle_local_position", ["x", "y", "z"], "nav_pos_ned_m"),
        ("vehicle_local_position", ["vx", "vy", "vz"], "nav_vel_ned_mps"),
        ("vehicle_attitude", _array("q", 4), "nav_q_nb"),
        ("vehicle_angular_velocity", _array("xyz", 3), "nav_rate_body_radps"),
        ("vehicle_local_position_groundtruth", ["x", "y", "z"], "truth_pos_ned_m"),
        ("vehicle_attitude_groundtruth", _array("q", 4), "truth_q_nb"),
        (
            "vehicle_local_position_setpoint",
            ["x", "y", "z", "vx", "vy", "vz", "yaw"],
            "reference",
        ),
        ("vehicle_attitude_setpoint", ["roll_body", "pitch_body", "yaw_body"], "setpoint"),
        ("actuator_servos", _array("control", 4), "u"),
    ],
)
def test_a_topic_has_the_numbers_of_the_flight(flown, topic, fields, of_record):
    rows = getattr(flown.record, of_record)
    known = np.isfinite(rows).all(axis=1)
    assert known.sum() > 200
    read = _columns(flown.log, topic, *fields)
    np.testing.assert_array_equal(read, rows[known].astype(np.float32))
    stamps = flown.log.get_dataset(topic).data["timestamp"]
    np.testing.assert_allclose(stamps, flown.record.time_s[known] * 1e6, atol=0.5)


def test_the_imu_is_there_where_it_was_recorded(flown, tmp_path):
    names = _array("accelerometer_m_s2", 3) + _array("gyro_rad", 3)
    read = _columns(flown.log, "sensor_combined", *names)
    np.testing.assert_array_equal(read, flown.record.imu.astype(np.float32))
    flight = recorded(flown.folder)
    file = tmp_path / "x.ulg"
    file.write_bytes(ulog_of(replace(flight, record=replace(flight.record, imu=None))))
    assert "sensor_combined" not in {data.name for data in ULog(str(file)).data_list}


def test_angles_of_the_setpoint_and_its_quaternion_agree(flown):
    quat = _columns(flown.log, "vehicle_attitude_setpoint", *_array("q_d", 4))
    angles = ["roll_body", "pitch_body", "yaw_body"]
    logged = _columns(flown.log, "vehicle_attitude_setpoint", *angles)
    np.testing.assert_allclose(euler_angles(quat.astype(float)), logged, atol=1e-6)


def test_heading_is_the_yaw_of_the_attitude(flown):
    quat = _columns(flown.log, "vehicle_attitude", *_array("q", 4)).astype(float)
    heading = flown.log.get_dataset("vehicle_local_position").data["heading"]
    np.testing.assert_allclose(heading, euler_angles(quat)[:, 2], atol=1e-6)


def test_parameters_are_those_that_were_flown(flown):
    nodes = recorded(flown.folder).settings.nodes
    logged = flown.log.initial_parameters
    numbers = {
        f"{node}.{name}": value
        for node, values in nodes.items()
        for name, value in values.items()
        if isinstance(value, (int, float))
    }
    assert len(numbers) > 50
    assert logged.keys() == {"MAV_TYPE", *numbers}
    for name, value in numbers.items():
        assert logged[name] == pytest.approx(float(value), rel=1e-6), name
    assert flown.log.msg_info_dict["sys_name"] == "heli-hover"


def test_messages_are_in_the_order_of_their_times_and_unknown_rows_are_left_out(tmp_path):
    time_us = np.arange(4, dtype=np.uint64) * np.uint64(10_000)
    some = np.array([True, False, True, True])
    tables = [
        LogTopic("a", {"v": np.arange(4, dtype=np.float32)}, some),
        LogTopic("b", {"w": np.arange(8, dtype=np.float32).reshape(4, 2)}, ~some),
    ]
    file = tmp_path / "x.ulg"
    file.write_bytes(ulog(time_us, tables, {}, {"small": 3, "large": 2**40}))
    log = ULog(str(file))
    assert log.get_dataset("a").data["timestamp"].tolist() == [0, 20_000, 30_000]
    assert log.get_dataset("a").data["v"].tolist() == [0.0, 2.0, 3.0]
    assert log.get_dataset("b").data["w[1]"].tolist() == [3.0]
    assert log.initial_parameters == {"small": 3, "large": float(2**40)}
    raw, at, order = file.read_bytes(), 16, []
    while at < len(raw):
        if raw[at + 2 : at + 3] == b"D":
            order.append(raw[at + 3])
        at += 3 + int.from_bytes(raw[at : at + 2], "little")
    assert order == [0, 1, 0, 0]
    assert not log.file_corruption


def test_a_file_that_exists_is_kept(flown, capsys):
    there = flown.folder / "flight.ulg"
    before = there.read_bytes()
    assert cli.main(["bag", "ulog", str(flown.folder), "--out", str(there)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert there.read_bytes() == before == ulog_of(recorded(flown.folder))


def test_it_tells_what_it_wrote(flown, tmp_path, capsys):
    out = tmp_path / "made" / "x.ulg"
    assert cli.main(["bag", "ulog", str(flown.folder), "--out", str(out), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == {"ulog": str(out), "bytes": out.stat().st_size}
