# SPDX-License-Identifier: Apache-2.0
"""`heli.diff`, `heli.identify`, and what long calls say."""

import re

import numpy as np
import pytest

import heli
from heli.designing import Identified
from heli_flight.report.diff import diff as diff_of_folders
from heli_flight.terminal import told_when_long


@pytest.fixture(scope="module")
def flights():
    options = {"seed": 3, "duration_s": 8, "gps": "rtk", "quiet": True}
    return heli.fly(**options), heli.fly(laws="hinf", **options)


@pytest.mark.slow
def test_it_says_what_the_command_says(flights, tmp_path):
    folders = [flight.save(tmp_path / name) for flight, name in zip(flights, "ab", strict=True)]
    of_command, of_face = diff_of_folders(folders), heli.diff(*folders)
    assert of_face.names == ("a", "b")
    assert {d.name: tuple(d.values) for d in of_command.parameters} == of_face.parameters
    for row in of_command.metrics:
        metric = of_face.metrics.of(row.source, row.stretch)[row.metric.key]
        assert metric.values == tuple(s.max for s in row.scores)
        assert metric.rms == tuple(s.rms for s in row.scores)
        assert metric.change == row.change and metric.unit == row.metric.unit
    assert of_face.parameters["flight.controller"] == ("hinf_output", "hinf")
    # A flight that has been saved is called as its folder is.
    assert heli.diff(flights[0], folders[1]).names == ("a", "b")


def test_flights_in_memory_are_compared_by_number_or_by_given_names(flights):
    options = {"seed": 3, "duration_s": 8, "gps": "rtk", "quiet": True}
    one, two = heli.fly(**options), heli.fly(laws="hinf", **options)
    diff = heli.diff(one, two)
    assert diff.names == ("flight 1", "flight 2")
    assert "flight.commit" not in diff.parameters and "flight.seed" not in diff.parameters
    for name, metric in diff.metrics.items():
        assert metric.values == (one.metrics[name].value, two.metrics[name].value)
    text = repr(heli.diff(one, two, names=("mine", "yours")))
    assert "mine" in text and "flight.laws" in text and re.search(r"altitude, m .* %", text)
    assert "<table>" in diff._repr_html_()
    same = heli.diff(one, heli.fly(**options))
    assert same.parameters == {} and "what differs: nothing" in repr(same)
    assert all(metric.change == 0.0 for metric in same.metrics.values())


def test_a_page_and_a_table_hold_both(flights, tmp_path):
    diff = heli.diff(*flights, names=("one & only", "two"))
    page = diff.page(tmp_path / "made" / "d.html")
    text = page.read_text(encoding="utf-8")
    assert "one &amp; only" in text and "one process" in text
    table = diff.to_arrow()
    assert set(table["flight"].to_pylist()) == {"one & only", "two"}
    assert table.num_rows == 2 * len(diff._flight_diff.metrics)


def test_three_flights_have_no_change(flights):
    third = heli.fly(seed=4, duration_s=8, gps="rtk", quiet=True)
    diff = heli.diff(*flights, third, names=["a", "b", "c"])
    assert all(m.change is None and len(m.values) == 3 for m in diff.metrics.values())
    assert "change" not in repr(diff)
    assert diff.parameters["flight.seed"] == ("3", "3", "4")


def test_what_cannot_be_compared_is_one_sentence(flights, tmp_path):
    one, two = flights
    with pytest.raises(heli.ParameterError, match="two to 6 flights"):
        heli.diff(one)
    with pytest.raises(heli.ParameterError, match="2 names that differ"):
        heli.diff(one, two, names=("a", "a"))
    with pytest.raises(heli.ParameterError, match="flights 3"):
        heli.diff(one, 3)
    with pytest.raises(heli.FlightError, match=str(tmp_path / "nowhere")):
        heli.diff(one, tmp_path / "nowhere")
    diff = heli.diff(one, two, names=["a", "b"])
    with pytest.raises(heli.ParameterError, match=r"must end in \.html"):
        diff.page(tmp_path / "x.txt")
    (tmp_path / "file").write_text("")
    with pytest.raises(heli.ParameterError, match="cannot be written"):
        diff.page(tmp_path / "file" / "x.html")
    with pytest.raises(KeyError, match="known: "):
        diff.metrics["altitud"]
    with pytest.raises(heli.ParameterError, match="allowed: navigation"):
        diff.metrics.of("sky")


@pytest.mark.slow
def test_an_identification_has_matrices_responses_and_a_design(identified_once):
    outcome, _ = identified_once
    identified = Identified(outcome)
    assert (
        identified.A.shape == (9, 9)
        and identified.B.shape == (9, 3)
        and identified.E.shape == (9, 3)
    )
    assert identified.system.ninputs == 6 and identified.missed == []
    answer = identified.response("p", "d_lat")
    np.testing.assert_allclose(np.abs(answer.fit), np.abs(answer.measured), rtol=0.05)
    np.testing.assert_allclose(np.abs(answer.fit), np.abs(answer.truth), rtol=0.02)
    assert (answer.coherence > 0.9).all() and answer.hz[0] < answer.hz[-1]
    assert identified.to_arrow().num_rows == len(identified.rows)
    assert "A(q,a_s)" in repr(identified) and "<table>" in identified._repr_html_()
    assert identified.design.gamma_star < identified.design.gamma
    flown = heli.fly(params=identified, seed=3, duration_s=8, gps="rtk", quiet=True)
    assert np.array_equal(flown.parameters["inner_loop"]["model.A"], identified.A)
    with pytest.raises(heli.ParameterError, match="allowed: p, q, r"):
        identified.response("phi", "d_lat")


@pytest.mark.slow
def test_the_numbers_are_those_of_the_command(identified_once):
    outcome, _ = identified_once
    identified = heli.identify(seed=1, quiet=True)
    assert np.array_equal(identified.A, Identified(outcome).A)
    with pytest.raises(heli.ParameterError, match="allowed: files"):
        heli.identify(params={"plant": {}})


def test_a_long_call_says_what_it_does_and_a_short_one_nothing(capsys):
    with told_when_long("heli.design", after_s=3600.0) as tell:
        tell("one")
    assert capsys.readouterr().err == ""
    with told_when_long("heli.design", quiet=True, after_s=0.0) as tell:
        tell("one")
    assert capsys.readouterr().err == ""


@pytest.mark.slow
def test_what_comes_after_the_patience_is_said_at_once(monkeypatch, capsys):
    class AtOnce:
        def __init__(self, after_s, begin):
            self.start, self.cancel = begin, lambda: None

    monkeypatch.setattr("heli_flight.terminal.threading.Timer", AtOnce)
    heli.design(aircraft="xcell60", gamma_factor=1.2)
    lines = capsys.readouterr().err.splitlines()
    assert "heli.design: trim and linear model ..." in lines
    assert lines[-1] == "heli.design: margins of the loop as flown ..."
    heli.design(aircraft="xcell60.yaml", gamma_factor=1.2, quiet=True)
    assert capsys.readouterr().err == ""
