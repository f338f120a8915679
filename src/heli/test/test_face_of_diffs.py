# SPDX-License-Identifier: Apache-2.0
"""`heli.diff`, `heli.identify`, and what long calls say."""

import re

import numpy as np
import pytest

import heli
from heli.designing import Identified
from heli.flying import told_when_long
from heli_flight.report.diff import diff as diff_of_folders


@pytest.fixture(scope="module")
def flights():
    options = {"seed": 3, "duration_s": 8, "gps": "rtk", "quiet": True}
    return heli.fly(**options), heli.fly(laws="hinf", **options)


@pytest.mark.slow
def test_it_says_what_the_command_says(flights, tmp_path):
    folders = [flight.save(tmp_path / name) for flight, name in zip(flights, "ab", strict=True)]
    told, found = diff_of_folders(folders), heli.diff(*folders)
    assert found.names == ("a", "b")
    assert {d.name: tuple(d.values) for d in told.parameters} == found.parameters
    for row in told.metrics:
        metric = found.metrics.of(row.source, row.stretch)[row.metric.key]
        assert metric.values == tuple(s.max for s in row.scores)
        assert metric.rms == tuple(s.rms for s in row.scores)
        assert metric.change == row.change and metric.unit == row.metric.unit
    assert found.parameters["flight.controller"] == ("hinf_output", "hinf")
    # A flight that has been saved is called as its folder is.
    assert heli.diff(flights[0], folders[1]).names == ("a", "b")


def test_flights_in_memory_are_compared_by_number_or_by_given_names(flights):
    options = {"seed": 3, "duration_s": 8, "gps": "rtk", "quiet": True}
    one, two = heli.fly(**options), heli.fly(laws="hinf", **options)
    found = heli.diff(one, two)
    assert found.names == ("flight 1", "flight 2")
    assert "flight.commit" not in found.parameters and "flight.seed" not in found.parameters
    for name, metric in found.metrics.items():
        assert metric.values == (one.metrics[name].value, two.metrics[name].value)
    text = repr(heli.diff(one, two, names=("mine", "yours")))
    assert "mine" in text and "flight.laws" in text and re.search(r"altitude, m .* %", text)
    assert "<table>" in found._repr_html_()
    same = heli.diff(one, heli.fly(**options))
    assert same.parameters == {} and "what differs: nothing" in repr(same)
    assert all(metric.change == 0.0 for metric in same.metrics.values())


def test_a_page_and_a_table_hold_both(flights, tmp_path):
    found = heli.diff(*flights, names=("one & only", "two"))
    page = found.page(tmp_path / "made" / "d.html")
    text = page.read_text(encoding="utf-8")
    assert "one &amp; only" in text and "one process" in text
    table = found.to_arrow()
    assert set(table["flight"].to_pylist()) == {"one & only", "two"}
    assert table.num_rows == 2 * len(found._flight_diff.metrics)


def test_three_flights_have_no_change(flights):
    third = heli.fly(seed=4, duration_s=8, gps="rtk", quiet=True)
    found = heli.diff(*flights, third, names="abc")
    assert all(m.change is None and len(m.values) == 3 for m in found.metrics.values())
    assert "change" not in repr(found)
    assert found.parameters["flight.seed"] == ("3", "3", "4")


def test_what_cannot_be_compared_is_one_sentence(flights, tmp_path):
    one, two = flights
    with pytest.raises(heli.ParameterError, match="two to 6 flights, not 1"):
        heli.diff(one)
    with pytest.raises(heli.ParameterError, match="2 names that differ"):
        heli.diff(one, two, names=("a", "a"))
    with pytest.raises(heli.ParameterError, match="int is not allowed"):
        heli.diff(one, 3)
    with pytest.raises(heli.FlightError, match="there is no such flight"):
        heli.diff(one, tmp_path / "nowhere")
    found = heli.diff(one, two, names="ab")
    with pytest.raises(heli.ParameterError, match=r"must end in \.html"):
        found.page(tmp_path / "x.txt")
    (tmp_path / "file").write_text("")
    with pytest.raises(heli.ParameterError, match="cannot be written"):
        found.page(tmp_path / "file" / "x.html")
    with pytest.raises(KeyError, match="known: "):
        found.metrics["altitud"]
    with pytest.raises(heli.ParameterError, match="allowed: navigation"):
        found.metrics.of("sky")


def test_an_identification_has_matrices_responses_and_a_design(identified_once):
    outcome, _ = identified_once
    found = Identified(outcome)
    assert found.A.shape == (9, 9) and found.B.shape == (9, 3) and found.E.shape == (9, 3)
    assert found.system.ninputs == 6 and found.missed == []
    answer = found.response("p", "d_lat")
    np.testing.assert_allclose(np.abs(answer.fit), np.abs(answer.measured), rtol=0.05)
    np.testing.assert_allclose(np.abs(answer.fit), np.abs(answer.truth), rtol=0.02)
    assert (answer.coherence > 0.9).all() and answer.hz[0] < answer.hz[-1]
    assert found.to_arrow().num_rows == len(found.rows)
    assert "A(q,a_s)" in repr(found) and "<table>" in found._repr_html_()
    assert found.design.gamma_star < found.design.gamma
    flown = heli.fly(params=found, seed=3, duration_s=8, gps="rtk", quiet=True)
    assert np.array_equal(flown.parameters["inner_loop"]["model.A"], found.A)
    with pytest.raises(heli.ParameterError, match="allowed: p, q, r"):
        found.response("phi", "d_lat")


@pytest.mark.slow
def test_the_numbers_are_those_of_the_command(identified_once):
    outcome, _ = identified_once
    found = heli.identify(seed=1, quiet=True)
    assert np.array_equal(found.A, Identified(outcome).A)
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

    monkeypatch.setattr("heli.flying.threading.Timer", AtOnce)
    heli.design(aircraft="xcell60", gamma_factor=1.2)
    lines = capsys.readouterr().err.splitlines()
    assert "heli.design: trim and linear model ..." in lines
    assert lines[-1] == "heli.design: margins of the loop as flown ..."
    heli.design(aircraft="xcell60.yaml", gamma_factor=1.2, quiet=True)
    assert capsys.readouterr().err == ""
