# SPDX-License-Identifier: Apache-2.0
"""Faults of sensors through the graph: each is found, told in /diagnostics, and flown as in one
process, number for number.

How soon, and what becomes of the aircraft: `tests/flight/test_failsafes.py`, in one process.
"""

import json

import numpy as np
import pytest

from heli_bags.reader import read_bag
from heli_flight.flight_file import fault_overrides
from heli_flight.graph.bag_record import flight_from_bag
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_observer.layout import ObserverStatus
from heli_outer_pd.failsafes import Condition, of

SEED = 2
# Several to a flight, one after the other: condition, what is told, when, fault, how long.
SILENT = [
    (Condition.MAG_LOST, ObserverStatus.MAG_TIMEOUT, 5.0, "what: mag, kind: loss", 2.0),
    (Condition.BARO_LOST, ObserverStatus.BARO_TIMEOUT, 8.0, "what: baro, kind: loss", 3.0),
    (Condition.GPS_SILENT, ObserverStatus.GPS_TIMEOUT, 12.0, "what: gps, kind: loss", 3.0),
]
WRONG = [
    (Condition.MAG_LOST, ObserverStatus.MAG_REJECTED, 5.0, "what: mag, kind: zero", 2.0),
    (Condition.BARO_LOST, ObserverStatus.BARO_REJECTED, 8.0,
     "what: baro, kind: bias, value: [500]", 3.0),
    (Condition.GPS_STUCK, ObserverStatus.GPS_STUCK, 12.0, "what: gps, kind: freeze", 2.0),
]  # fmt: skip
STOPS = [
    (Condition.IMU_STOPS, ObserverStatus.IMU_FROZEN, 5.0, "what: imu, kind: freeze", 0.2),
    (Condition.IMU_STOPS, ObserverStatus.IMU_TIMEOUT, 7.0, "what: imu, kind: nan", 0.2),
    (Condition.GPS_JUMPS, ObserverStatus.GPS_REJECTED, 9.0,
     "what: gps, kind: bias, value: [30, 0, 0]", 5.5),
]  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("cases", [SILENT, WRONG, STOPS], ids=["silent", "wrong", "stops"])
def test_each_is_told_and_flown_as_in_one_process(hover_test, tmp_path, cases):
    file, folder = tmp_path / "faults.yaml", tmp_path / "flight"
    listed = (
        f"{{{fault}, start_s: {at_s}, duration_s: {for_s}}}" for *_, at_s, fault, for_s in cases
    )
    file.write_text("faults:\n" + "".join(f"  - {fault}\n" for fault in listed))
    seconds = cases[-1][2] + cases[-1][4]
    done = hover_test("--composed", "--seed", SEED, "--duration", seconds, "--faults", file,
                      "--out", folder)  # fmt: skip
    assert done.returncode in (0, 1), done.stdout + done.stderr
    result = json.loads((folder / "result.json").read_text())
    assert not result["lost"] and len(result["faults"]) == len(cases)

    settings = resolve("hover", seed=SEED, duration_s=seconds, world="paper",
                       overrides=fault_overrides(file))  # fmt: skip
    alone, flown = simulate(settings).record, flight_from_bag(folder / "bag", settings).record
    np.testing.assert_allclose(flown.truth_pos_ned_m, alone.truth_pos_ned_m, atol=1e-6)
    np.testing.assert_allclose(flown.u, alone.u, atol=1e-6)

    start_s, remarks = settings.nodes["plant"]["start_time_s"], read_bag(folder / "bag").remarks
    for condition, status, at_s, *_ in cases:
        reports = [r for r in remarks if r.facts.get("status") == status.name]
        assert {remark.node for remark in reports} == {"observer"}, status
        first_s = min(remark.stamp_ns for remark in reports) * 1e-9 - start_s - at_s
        assert 0.0 <= first_s <= of(condition).within_s, status


@pytest.mark.slow
def test_a_slow_servo_is_told_by_the_outer_loop_and_flown_as_in_one_process(hover_test, tmp_path):
    file, folder = tmp_path / "faults.yaml", tmp_path / "flight"
    file.write_text("faults:\n  - {what: delta_lat, kind: slow, start_s: 12.0, value: 0.5}\n")
    params = tmp_path / "params.yaml"
    params.write_text(
        "/**/outer_loop:\n  ros__parameters:\n    failsafe.unfollowed_deg: [8.0, 5.5]\n"
    )
    done = hover_test("--composed", "--seed", SEED, "--duration", 20.0, "--world", "honest",
                      "--params", params, "--faults", file, "--out", folder)  # fmt: skip
    assert done.returncode in (0, 1), done.stdout + done.stderr
    assert not json.loads((folder / "result.json").read_text())["lost"]
    over = fault_overrides(file) | {"outer_loop": {"failsafe.unfollowed_deg": [8.0, 5.5]}}
    settings = resolve("hover", seed=SEED, duration_s=20.0, world="honest", overrides=over)
    alone, flown = simulate(settings).record, flight_from_bag(folder / "bag", settings).record
    np.testing.assert_allclose(flown.u, alone.u, atol=1e-6)
    remarks, row = read_bag(folder / "bag").remarks, of(Condition.SERVO_SLOW)
    reports = [remark for remark in remarks if remark.facts.get("failsafe") == row.action.name]
    assert {remark.node for remark in reports} == {"outer_loop"}
    assert all(remark.message.startswith(row.status) for remark in reports)
    start_s = settings.nodes["plant"]["start_time_s"]
    first_s = min(remark.stamp_ns for remark in reports) * 1e-9 - start_s - 12.0
    assert 0.0 < first_s <= row.within_s
