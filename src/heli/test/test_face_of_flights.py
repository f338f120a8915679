# SPDX-License-Identifier: Apache-2.0
"""`heli.fly`, `heli.load` and what a flight offers, against the stack below."""

import subprocess
import sys
import urllib.error
import urllib.request
from importlib.util import find_spec

import numpy as np
import pytest

import heli
from heli_core.rotations import quat_from_euler
from heli_flight.cli.app import main
from heli_flight.loop import simulate
from heli_flight.scoring import score
from heli_flight.settings import resolve


@pytest.fixture(scope="module")
def flight():
    return heli.fly(seed=3, gps="rtk", duration_s=8, quiet=True)


@pytest.fixture(scope="module")
def settings():
    return resolve("hover", "rtk", 3, 8.0, world="honest")


def test_it_is_the_flight_of_the_loop_with_its_figures(flight, settings):
    record = simulate(settings).record
    assert np.array_equal(flight.time_s, record.time_s)
    assert np.array_equal(flight.truth.pos_ned_m, record.truth_pos_ned_m)
    assert np.array_equal(flight.u.delta_col, record.u[:, 3])
    assert np.array_equal(flight.wind.ned_mps, record.wind_ned_mps)
    assert np.array_equal(flight.setpoint.theta_rad, record.setpoint[:, 1])
    altitude = score(record, settings.scenario).find("windows", "altitude", "truth")
    metric = flight.metrics.of("truth")["altitude"]
    assert (metric.value, metric.unit, metric.paper) == (altitude.max, "m", altitude.metric.paper)
    assert metric.inside == altitude.inside


def test_angles_are_those_of_the_quaternion(flight):
    truth = flight.truth
    for i in range(0, len(flight), 97):
        q = quat_from_euler(truth.phi_rad[i], truth.theta_rad[i], truth.psi_rad[i])
        assert abs(q @ truth.q_nb[i]) == pytest.approx(1.0, abs=1e-12)


def test_signals_have_names_units_and_cannot_be_written(flight):
    assert flight.truth.unit("phi_rad") == "rad"
    assert "truth.phi_rad" in repr(flight.truth) and "rad/s" in flight.nav._repr_html_()
    with pytest.raises(ValueError):
        flight.truth.pos_ned_m[0, 0] = 1.0
    with pytest.raises(AttributeError, match="did you mean phi_rad"):
        flight.truth.phi  # noqa: B018
    assert {"altitude_m", "phi_rad"} <= set(dir(flight.truth))


def test_tables_hold_every_signal_with_its_name(flight):
    table = flight.to_arrow()
    assert table.num_rows == len(flight)
    assert table.column_names[0] == "time_s"
    assert np.array_equal(table["u_delta_lat"].to_numpy(), flight.u.delta_lat)


@pytest.mark.skipif(find_spec("pandas") is not None, reason="pandas is here")
def test_without_pandas_a_sentence_says_how_to_get_it(flight):
    with pytest.raises(ImportError, match="pip install pandas"):
        flight.to_dataframe()


def test_a_picture_has_four_axes_with_units(flight):
    labels = [axis.get_ylabel() for axis in flight.plot().axes]
    assert labels == ["altitude (m)", "north (m)", "angle (deg)", "actuator (-1 to 1)"]


def test_a_saved_flight_is_read_back_and_reported(flight, tmp_path):
    folder = flight.save(tmp_path / "flown")
    again = heli.load(folder)
    for name, column in flight.columns().items():
        assert np.array_equal(again.columns()[name], column, equal_nan=True), name
    assert {n: m.value for n, m in again.metrics.items()} == {
        n: m.value for n, m in flight.metrics.items()
    }
    assert again.settings.seed == 3 and again.folder == folder
    assert again.verdict == flight.verdict and "hover" in repr(again)
    assert again.report().read_text(encoding="utf-8").startswith("<!")
    with pytest.raises(heli.ParameterError, match="exists already"):
        flight.save(folder)


def test_a_flight_is_served_to_a_browser_until_it_is_stopped(flight, tmp_path):
    flight.save(tmp_path / "flown")
    server = heli.load(tmp_path / "flown").replay()
    try:
        with urllib.request.urlopen(server.url) as page:
            assert b"heli-hover" in page.read()
    finally:
        server.stop()
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(server.url)


def test_the_command_leaves_a_flight_that_can_be_read(tmp_path, flight):
    words = ["hover", "--one-process", "--no-report", "--gps", "rtk", "--seed", "3"]
    assert main([*words, "--duration", "8", "--out", str(tmp_path / "f")]) == 0
    again = heli.load(tmp_path / "f")
    assert np.array_equal(again.truth.pos_ned_m, flight.truth.pos_ned_m)


def test_parameters_may_be_nested_dotted_and_of_integers():
    options = {"seed": 3, "duration_s": 4, "quiet": True}
    one = heli.fly(params={"outer_loop": {"goto": {"speed_mps": 4}, "K_P": [1, 1, 4]}}, **options)
    assert one.parameters["outer_loop"]["goto.speed_mps"] == 4.0
    assert one.parameters["outer_loop"]["K_P"].tolist() == [1.0, 1.0, 4.0]
    two = heli.fly(params={"outer_loop": {"goto.speed_mps": 4.0, "K_P": (1.0, 1, 4)}}, **options)
    assert np.array_equal(one.truth.pos_ned_m, two.truth.pos_ned_m)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"params": {"iner_loop": {}}}, "did you mean 'inner_loop'"),
        ({"params": {"inner_loop": {"gama": 1.0}}}, "did you mean 'gamma'"),
        ({"params": {"inner_loop": {"gamma": float("nan")}}}, "gamma: nan .* not finite"),
        ({"params": 3}, "params 3: not allowed"),
        ({"params": {"plant": 3}}, "allowed: {parameter: value}"),
        ({"gps": "x"}, "known: standalone, rtk"),
        ({"seed": -1}, "seed -1: not allowed"),
        ({"duration_s": -4}, "duration_s: -4.0 is not allowed"),
        ({"faults": [{"what": "gpx", "kind": "loss", "start_s": 1.0}]}, "did you mean gps"),
        ({"faults": 3}, "allowed: a file, or a list"),
        ({"scenario": "hovr"}, "unknown scenario"),
    ],
)
def test_what_cannot_be_is_one_sentence(options, words):
    with pytest.raises(heli.ParameterError, match=words) as refusal:
        heli.fly(**options)
    assert "\n" not in str(refusal.value)


def test_faults_are_flown():
    fault = {"what": "delta_lat", "kind": "stuck", "start_s": 2.0}
    flown = heli.fly(seed=3, duration_s=30, faults=[fault], quiet=True)
    assert flown.lost and flown.exit_code == 1 and "LOST" in repr(flown)


def test_what_is_no_flight_is_one_sentence(tmp_path):
    with pytest.raises(heli.FlightError, match="there is no such flight"):
        heli.load(tmp_path / "nowhere")
    (tmp_path / "record.npz").write_bytes(b"PK no archive")
    with pytest.raises(heli.FlightError, match=r"record.npz: holds no record") as refusal:
        heli.load(tmp_path)
    assert "\n" not in str(refusal.value)
    with pytest.raises(heli.FlightError):
        (tmp_path / "empty").mkdir()
        heli.load(tmp_path / "empty")


def test_importing_loads_nothing_heavy():
    """And is quick by it: no module of a distribution but our own."""
    heavy = ("aiohttp", "numba", "numpy", "plotly", "rclpy", "rosbags", "scipy", "typer", "yaml")
    code = f"import sys, heli; print([m for m in {heavy} if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_the_command_of_the_same_name_is_not_in_the_way(tmp_path):
    """From a folder in which an executable is called heli."""
    (tmp_path / "heli").write_text("#!/bin/sh\nexit 1\n")
    code = "import heli; print(heli.fly.__module__)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "heli.flying"


def test_help_is_readable():
    """Every call with its arguments, and nothing of how it is made."""
    import pydoc

    text = pydoc.plain(pydoc.render_doc(heli))
    for call in ("fly(scenario", "load(path", "design(params", "trim(aircraft", "campaign(spec"):
        assert call in text
    assert "heli.fly(seed=3" in text
