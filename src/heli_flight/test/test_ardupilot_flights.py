# SPDX-License-Identifier: Apache-2.0
"""A flight over the protocol: what its folder holds, and that a pilot on the other side can fly."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from rich.console import Console

from heli_core.rcl_yaml import ParameterError
from heli_core.ticks import Rate
from heli_dynamics_sim.plant import PlantStatus
from heli_dynamics_sim.trim import trim
from heli_flight import interrupts
from heli_flight.ardupilot import server
from heli_flight.ardupilot.physics import Physics
from heli_flight.ardupilot.recording import FlightFolder
from heli_flight.ardupilot.server import ArduPilotOrder, helicopter_of
from heli_flight.ardupilot.servos import pulses
from heli_flight.ardupilot.session import Meter, Vehicle
from heli_flight.layers import ARDUPILOT
from heli_flight.report.diff import diff
from heli_flight.report.write import recorded
from support.sitl_client import SitlClient, SmallPilot, angles, h3_120, packet

CALM = {"wind.turbulence": False, "wind.profile_speed_mps": [0.0, 0.0, 0.0]}


def in_calm_air(settings, **more):
    nodes = {**settings.nodes, "plant": {**settings.nodes["plant"], **CALM, **more}}
    return replace(settings, nodes=nodes)


def pilot_of(settings, order):
    hover = trim(helicopter_of(settings))
    swash = pulses(hover.u, order.servos(settings))[:3]
    roll, pitch, _ = angles(hover.x[6:10])
    return SmallPilot((swash.mean() - 1000.0) / 1000.0, roll, pitch)


@pytest.mark.parametrize("rate_hz", [400, 1200])
def test_a_pilot_with_ardupilots_signs_takes_off_hovers_and_lands(rate_hz):
    order = ArduPilotOrder(seed=1)
    settings = in_calm_air(order.resolved())
    servos = order.servos(settings)
    vehicle = Vehicle(lambda rate: (Physics(settings, rate, servos), None), lambda line: None)
    client = SitlClient(lambda data: vehicle.answer(data, ("127.0.0.1", 1), 1), rate_hz)
    pilot = pilot_of(settings, order)
    state = client.frame(h3_120(0.0, 0.0, 0.3, 0.0))
    heights = []
    for i in range(18 * rate_hz):
        height = 3.0 if i < 8 * rate_hz else max(3.0 - 0.6 * (i / rate_hz - 8.0), -1.0)
        state = client.frame(pilot.pulses(state, height))
        heights.append(-state["position"][2])
    assert vehicle.flights[-1].physics.status == PlantStatus.OK
    up = np.array(heights[7 * rate_hz : 8 * rate_hz])
    np.testing.assert_allclose(up, 3.0, atol=0.3)
    assert heights[-1] < 0.1 and np.hypot(*state["position"][:2]) < 2.0


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A folder of two seconds at 1200 Hz, with a line of the terminal."""
    folder = tmp_path_factory.mktemp("flights") / "flight"
    order = ArduPilotOrder(seed=3, out=folder)
    settings, said = order.resolved(), []
    servos = order.servos(settings)
    vehicle = Vehicle(server._flights(settings, servos, False, folder), said.append)
    client = SitlClient(lambda data: vehicle.answer(data, ("127.0.0.1", 1), client.count), 1200)
    states = [client.frame(h3_120(0.05, 0.0, 0.3, 0.1)) for _ in range(2400)]
    line = Meter(vehicle).line(10**9)
    vehicle.close()
    (flight,) = vehicle.flights
    (done,) = server._written(order, settings, flight, Console(quiet=True))
    return folder, states, line, done


def test_the_bag_has_the_truth_at_100_hz_whatever_the_steps(flown):
    folder, states, _, _ = flown
    flight = recorded(folder)
    record = flight.record
    assert len(record) == 200 and flight.how == "by ArduPilot"
    np.testing.assert_allclose(record.time_s, np.arange(200) / 100.0)
    # The step of tick n ends at frame n; a tick of 10 ms is twelve of them.
    moved = record.truth_pos_ned_m - record.truth_pos_ned_m[0]
    told = np.array([state["position"] for state in states])
    np.testing.assert_allclose(moved[1:], told[11:-1:12][: len(moved) - 1], atol=1e-9)
    assert np.isnan(record.nav_pos_ned_m).all() and np.isfinite(record.imu).all()


def test_what_was_flown_says_by_whom_and_has_no_laws_of_ours(flown):
    folder, _, _, _ = flown
    result = json.loads((folder / "result.json").read_text())
    assert result["mode"] == ARDUPILOT and result["verdict"] == "not scored"
    counted = {"steps_per_s": 1200, "frames": 2400, "lost": 0, "repeated": 0, "refused": {}}
    assert result[ARDUPILOT] == counted
    page = (folder / "report.html").read_text()
    assert "ArduPilot&#39;s" in page or "ArduPilot's" in page
    assert "The design that flew" not in page
    assert recorded(folder).settings.scenario_parameters["duration_s"] == 2.0


def test_it_is_laid_beside_another(flown, tmp_path):
    folder, _, _, _ = flown
    other = shutil.copytree(folder, tmp_path / "other")
    assert diff([folder, other], lambda *_: None).exit_code == 0


def test_the_terminals_line_names_what_there_is(flown):
    _, _, line, _ = flown
    for words in ("2.0 s", "mode unknown", "height", "tilt", "us", "frames 2400", "lost 0",
                  "2.00 times real time"):  # fmt: skip
        assert words in line


def test_each_return_of_ardupilot_has_a_folder_of_its_own(tmp_path):
    order = ArduPilotOrder(seed=3)
    settings = order.resolved()
    begin = server._flights(settings, order.servos(settings), False, tmp_path / "a")
    folders = [begin(Rate(4))[1] for _ in range(3)]
    for folder in folders:
        folder.close()
    assert [folder.path.name for folder in folders] == ["a", "a-2", "a-3"]


def test_an_interrupt_that_was_dropped_ends_it_within_a_second(monkeypatch):
    sock = server.bound(0)
    vehicle = Vehicle(lambda rate: pytest.fail("nobody has come"), lambda line: None)
    monkeypatch.setattr(interrupts, "_interrupted", True)
    with sock, pytest.raises(KeyboardInterrupt):
        server.serve([server.Door("heli1", sock, vehicle)], lambda line: None)


def test_a_disk_that_is_full_ends_the_record_and_not_the_flight(tmp_path, monkeypatch):
    from heli_bags.writer import BagCause, BagError

    order = ArduPilotOrder(seed=3)
    settings, said = order.resolved(), []
    begin = server._flights(settings, order.servos(settings), False, tmp_path / "a")
    vehicle = Vehicle(begin, said.append)

    def full(self, *_):
        raise BagError("a: recording stopped: no space", BagCause.STOPPED)

    monkeypatch.setattr(FlightFolder, "write", full)
    for count in range(1, 10):
        assert vehicle.answer(packet([1500] * 8, count), ("127.0.0.1", 1), count)
    assert [line for line in said if "no space" in line] == ["a: recording stopped: no space"]


@pytest.mark.parametrize("measured", [False, True])
def test_a_fault_that_ardupilot_cannot_feel_is_refused(tmp_path, measured):
    path = tmp_path / "faults.yaml"
    for what, allowed in (("gps", False), ("gyro", measured), ("delta_ped", True)):
        kind = "offset, value: 0.1" if what == "delta_ped" else "freeze"
        path.write_text(f"faults:\n- {{what: {what}, kind: {kind}, start_s: 1.0}}\n")
        order = ArduPilotOrder(faults=path, measured=measured)
        if allowed:
            order.resolved()
        else:
            with pytest.raises(ParameterError, match=what):
                order.resolved()


def test_a_fault_of_an_actuator_acts_at_its_time_at_any_rate(tmp_path):
    path = tmp_path / "faults.yaml"
    path.write_text("faults:\n- {what: delta_ped, kind: stuck, value: 0.5, start_s: 0.5}\n")
    order = ArduPilotOrder(faults=path)
    settings = in_calm_air(order.resolved())
    for fold in (4, 12):
        physics = Physics(settings, Rate(fold), order.servos(settings))
        while physics.tick < 50 * fold:
            physics.step(np.array([1300.0, 1300.0, 1300.0, 1500.0]), True)
        assert abs(physics.row[18]) < 1e-6  # the pedal's servo
        while physics.tick < 90 * fold:
            physics.step(np.array([1300.0, 1300.0, 1300.0, 1500.0]), True)
        assert physics.row[18] == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("name", ["helion", "logo600", "xcell60"])
@pytest.mark.parametrize("world", ["paper", "honest", "hard"])
def test_every_aircraft_stands_in_every_world(name, world):
    order = ArduPilotOrder(aircraft=name, world=world)
    settings = order.resolved()
    physics = Physics(settings, Rate(4), order.servos(settings))
    for _ in range(200):
        physics.step(np.array([1300.0, 1300.0, 1300.0, 1500.0]), True)
    assert physics.status == PlantStatus.OK and np.isfinite(physics.told).all()
