# SPDX-License-Identifier: Apache-2.0
"""`heli diff`: what differs between flights, their figures in one table, their charts overlaid."""

import json
import math
import re
import shutil

import pytest

from heli_flight.cli.app import main

CHANGED = """/**/inner_loop:
  ros__parameters:
    gamma: 0.2
    C11: [39.0, 0.0, 0.0, 0.0,  0.0, 33.0, 0.0, 0.0,  0.0, 0.0, 1.0, 0.0,  0.0, 0.0, 0.0, 1.0]
"""
GUSTS = ("hover", "--one-process", "--no-report", "--control-preset", "hinf", "--scenario",
         "attitude_gusts", "--world", "honest", "--duration", "12")  # fmt: skip


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """Two flights that differ in weights, and a third in seed and scenario."""
    folder = tmp_path_factory.mktemp("flights")
    weights = folder / "weights.yaml"
    weights.write_text(CHANGED, encoding="utf-8")
    main([*GUSTS, "--out", str(folder / "before")])
    main([*GUSTS, "--params", str(weights), "--out", str(folder / "after")])
    main(["hover", "--one-process", "--no-report", "--duration", "12", "--seed", "7", "--out",
          str(folder / "other")])  # fmt: skip
    return folder


def diff_json(capsys, page, *paths):
    """What --json prints."""
    capsys.readouterr()
    assert main(["diff", *map(str, paths), "--out", str(page), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_only_what_was_changed_differs(flights, tmp_path, capsys):
    diff = diff_json(capsys, tmp_path / "d.html", flights / "before", flights / "after")
    assert diff["parameters"] == [
        {"name": "inner_loop.gamma", "packaged": "0.0632", "flights": ["0.0632", "0.2"]},
        {"name": "inner_loop.C11[0, 0]", "packaged": "13", "flights": ["13", "39"]},
        {"name": "inner_loop.C11[1, 1]", "packaged": "11", "flights": ["11", "33"]},
    ]


def test_figures_are_those_of_result_json(flights, tmp_path, capsys):
    diff = diff_json(capsys, tmp_path / "d.html", flights / "before", flights / "after")
    compared = 0
    for i, name in enumerate(("before", "after")):
        result = json.loads((flights / name / "result.json").read_text(encoding="utf-8"))
        metrics = {(m["stretch"], m["key"], m["measured_from"]): m for m in result["metrics"]}
        for row in diff["metrics"]:
            mine, metric = (
                row["flights"][i],
                metrics[row["stretch"], row["key"], row["measured_from"]],
            )
            assert math.isclose(mine["max"], metric["max"], rel_tol=1e-9)
            assert math.isclose(mine["rms"], metric["rms"], rel_tol=1e-9)
            assert (mine["inside"], row["paper"]) == (metric["inside"], metric["paper"])
            compared += 1
    assert {row["stretch"] for row in diff["metrics"]} == {"whole", "windows"}
    assert {row["measured_from"] for row in diff["metrics"]} == {"navigation", "truth"}
    assert compared == 16


def test_the_weight_shows(flights, tmp_path, capsys):
    diff = diff_json(capsys, tmp_path / "d.html", flights / "before", flights / "after")
    rolls = [row for row in diff["metrics"] if row["key"] == "roll" and row["stretch"] == "whole"]
    for row in rolls:
        before, after = (flight["rms"] for flight in row["flights"])
        assert after < 0.85 * before
        first, second = (flight["max"] for flight in row["flights"])
        assert math.isclose(row["change"], second / first - 1.0)


def test_page_overlays_the_flights_and_loads_nothing(flights, tmp_path, capsys):
    page = tmp_path / "d.html"
    diff_json(capsys, page, flights / "before", flights / "after")
    text = page.read_text(encoding="utf-8")
    data = re.search(r'id="charts">(.*?)</script>', text, re.DOTALL)
    drawn = json.loads(data[1])["figures"]
    keys = [chart["key"] for chart in drawn]
    # What the flights are about comes first.
    assert keys == ["attitude_error", "attitude", "actuators", "altitude",
                    "position_navigation", "position_truth"]  # fmt: skip
    for chart in drawn:
        names = [trace["name"] for trace in chart["data"] if trace.get("showlegend", True)]
        assert names[:2] == ["before", "after"], chart["key"]
    assert "connect-src 'none'" in text
    assert not re.findall(r'<(?:script|link|img)[^>]*(?:src|href)="http', text)


def test_three_flights_of_different_scenarios(flights, tmp_path, capsys):
    paths = [flights / name for name in ("before", "after", "other")]
    diff = diff_json(capsys, tmp_path / "d.html", *paths)
    rows = {row["name"]: row["flights"] for row in diff["parameters"]}
    assert rows["flight.scenario"] == ["attitude_gusts", "attitude_gusts", "hover"]
    assert rows["flight.seed"][2] == "7"
    keys = {row["key"]: row["flights"] for row in diff["metrics"]}
    assert keys["roll"][2] is None
    assert keys["v_z"][:2] == [None, None]
    assert main(["diff", *map(str, paths), "--out", str(tmp_path / "t.html")]) == 0
    out = capsys.readouterr().out
    assert "other: " in out
    assert "flight.scenario" in out


def test_two_folders_of_one_name_are_told_apart(flights, tmp_path, capsys):
    shutil.copytree(flights / "before", tmp_path / "moved/before")
    diff = diff_json(capsys, tmp_path / "d.html", flights / "before", tmp_path / "moved/before")
    assert diff["parameters"] == []
    names = [flight["name"] for flight in diff["flights"]]
    assert names[1] == "moved/before"
    assert names[0].endswith("/before")
    assert names[0] != names[1]
    assert all(row["change"] == 0.0 for row in diff["metrics"])


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("before",), "name two to 6 flights, not 1"),
        (("before", "before"), "named twice"),
        (("before", "nowhere"), "nowhere"),
        (("before", "after", "--out", "page.txt"), "must end in .html"),
        (("before", "after", "--out", "no/such/page.html"), "cannot be written"),
        ((*["before"] * 7,), "not 7"),
    ],
)
def test_bad_input_is_one_line(flights, monkeypatch, capsys, words, expected):
    monkeypatch.chdir(flights)
    capsys.readouterr()
    assert main(["diff", *words]) == 2
    error = capsys.readouterr().err
    assert expected in error
    # a slow machine is told how far it is
    lines = [line for line in error.splitlines() if not line.startswith("flights read")]
    assert len(lines) == 1
    assert not (flights / "diff.html").exists()
