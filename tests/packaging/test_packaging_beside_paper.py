# SPDX-License-Identifier: Apache-2.0
"""The table beside the paper out of result files: of today's fields, and of older files without."""

import copy

import pytest

from evidence import files
from evidence.experiments.paper import paper
from heli_flight.settings import resolve
from heli_studies.campaign.run import fly_seeds, seeds_as_dict

SEEDS = [1, 2]


@pytest.fixture(scope="module")
def campaigns():
    """What `heli campaign --json` says of both tests with both receivers."""
    tests = {}
    for test in ("hover", "attitude"):
        settings = {gps: resolve(test, gps=gps, duration_s=33.0) for gps in ("standalone", "rtk")}
        columns = {gps: fly_seeds(settings[gps], SEEDS) for gps in settings}
        tests[test] = {"receivers": seeds_as_dict(columns, settings)}
    return tests


def rendered(tmp_path, campaigns):
    (tmp_path / files.FOLDER).mkdir(parents=True, exist_ok=True)
    for name, content in campaigns.items():
        files.write(tmp_path, name, {"seeds": SEEDS, "found": content})
    return paper(files.Results(tmp_path))


def largest(campaigns, gps, place, key):
    return max(f[place][key] for f in campaigns["hover"]["receivers"][gps]["flights"])


def rows(text, head):
    """Rows by first cell of the table whose head line has some words."""
    table = next(t for t in text.split("\n\n") if t.startswith("| ") and head in t.splitlines()[0])
    cells = [[c.strip() for c in line.strip("|").split("|")] for line in table.splitlines()]
    return {row[0]: dict(zip(cells[0], row, strict=True)) for row in cells[2:]}


def test_the_whole_flight_stands_first_then_the_windows_then_the_climb(tmp_path, campaigns):
    text = rendered(tmp_path, campaigns)
    whole, windows, climb = (
        text.index(f"**{name}**") for name in ("Whole flight", "Scored windows", "Climb")
    )
    assert whole < windows < climb
    assert "hover test, standalone GPS 0 of 2; hover test, RTK 2 of 2" in text[whole:windows]
    assert "hover test, standalone GPS 2 of 2; hover test, RTK 2 of 2" in text[windows:climb]
    for part, place in ((text[whole:windows], "max_whole"), (text[windows:climb], "max")):
        row = rows(part, "paper (flight)")["altitude error"]
        for gps, words in (("standalone", "standalone GPS"), ("rtk", "RTK")):
            value = largest(campaigns, gps, place, "altitude (navigation)")
            assert row[f"{words}, state estimate"].startswith(f"{value:.2f}")
        value = largest(campaigns, "standalone", place, "altitude (truth_less_drift)")
        assert row["standalone GPS, drift-corrected"].startswith(f"{value:.2f}")
        assert "RTK, drift-corrected" not in row
        speeds = rows(part, "paper (flight)")["forward speed"]
        assert speeds["standalone GPS, drift-corrected"] == "–"
    lags = [
        f["climb"]["climb_lag (navigation)"]
        for f in campaigns["hover"]["receivers"]["rtk"]["flights"]
    ]
    row = rows(text[climb:], "climb")["lag at half the climb, s"]
    assert row["RTK, state estimate"] == f"{min(lags):.2f} to {max(lags):.2f}"


def test_a_height_that_was_not_reached_and_a_lost_flight_are_said(tmp_path, campaigns):
    changed = copy.deepcopy(campaigns)
    first, second = changed["hover"]["receivers"]["rtk"]["flights"]
    first["climb"]["climb_time (navigation)"] = None
    second |= {"lost": "it hit the ground", "max": {}, "max_whole": {}, "climb": {}}
    text = rendered(tmp_path, changed)
    assert rows(text, "climb")["time to the new height, s"]["RTK, state estimate"] == (
        "not reached on 1"
    )
    assert rows(text, "paper (flight)")["lateral speed"]["RTK, truth"].endswith("; lost on 1")


def test_a_file_without_the_whole_flight_gives_its_windows(tmp_path, campaigns):
    """Files that were made before hold the windows alone: one table, no word of another."""
    old = copy.deepcopy(campaigns)
    for test in old.values():
        for receiver in test["receivers"].values():
            del receiver["inside"]
            receiver["metrics"] = [m for m in receiver["metrics"] if m["stretch"] == "windows"]
            for metric in receiver["metrics"]:
                del metric["stretch"]
            for flight in receiver["flights"]:
                del flight["max_whole"], flight["climb"]
    text = rendered(tmp_path, old)
    assert text.count("\n| --- |") == 1 and "**" not in text
    assert len(rows(text, "paper (flight)")) == 8
