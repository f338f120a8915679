# SPDX-License-Identifier: Apache-2.0
"""`heli compare worlds`: what its numbers are, and the tables that a README makes of them."""

import json
import statistics

import pytest

from evidence.experiments.worlds import worlds
from heli_core.rcl_yaml import ParameterError
from heli_flight.cli.app import main
from heli_flight.settings import resolve
from heli_studies import compare_flights as study
from heli_studies.campaign.run import fly_seeds, parse_seeds

SEEDS = (1, 2, 4)


@pytest.fixture(scope="module")
def content():
    where = study.world_places(["paper", "hard"], ["standalone", "rtk"], duration_s=14.0)
    return where, study.worlds_as_dict(where, study.compare_worlds(where, SEEDS))


def test_the_numbers_are_those_of_a_campaign(content):
    _, study_json = content
    assert [(p["name"], p["gps"]) for p in study_json["places"]] == [
        ("paper", "standalone"), ("paper", "rtk"), ("hard", "standalone"), ("hard", "rtk"),
    ]  # fmt: skip
    flown = fly_seeds(resolve(gps="rtk", duration_s=14.0, world="hard"), SEEDS)
    values = [f.figures.find("windows", "lateral", "truth").max for f in flown]
    (row,) = [
        row for row in study_json["places"][3]["metrics"]
        if (row["key"], row["stretch"], row["measured_from"]) == ("lateral", "windows", "truth")
    ]  # fmt: skip
    assert row["median"] == statistics.median(values) and row["worst"] == max(values)
    assert row["inside"] == sum(value <= row["paper"] for value in values)
    assert study_json["places"][3]["exit_code_0"] == sum(f.exit_code("rtk") == 0 for f in flown)


def test_a_lost_helicopter_is_counted_with_its_status(monkeypatch):
    (place,) = study.world_places(["paper"], ["rtk"], duration_s=8.0)
    heavy = {**place.settings.nodes["plant"], "scale.mass": 3.0}
    nodes = {**place.settings.nodes, "plant": heavy}
    object.__setattr__(place.settings, "nodes", nodes)
    worlds_json = study.worlds_as_dict([place], study.compare_worlds([place], [1]))["places"][0]
    (lost,) = worlds_json["lost"]
    assert lost["seed"] == 1 and lost["status"] in ("NO_TRIM", "HIT_GROUND")
    assert worlds_json["metrics"] == [] and worlds_json["exit_code_0"] == 0


def test_winds_are_flown_one_by_one():
    where = study.world_places(["honest"], ["rtk"], [2.0, 8.0])
    assert [place.name for place in where] == ["honest, W20 2 m/s", "honest, W20 8 m/s"]
    assert [p.settings.nodes["plant"]["wind.w20_mps"] for p in where] == [2.0, 8.0]


def test_the_command_prints_it(capsys):
    words = ["--seeds", "1", "--worlds", "paper,honest", "--gps", "rtk", "--duration", "8"]
    assert main(["compare", "worlds", *words, "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["seeds"] == [1] and len(printed["places"]) == 2
    assert main(["compare", "worlds", *words]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert out.partition("paper, rtk:")[2].startswith(" 1 of 1 ")
    assert " of 1 " in out.partition("honest, rtk:")[2]
    assert main(["compare", "worlds", "--w20", "fast"]) == 2


def test_seeds_may_be_several_runs():
    assert parse_seeds("1..3,2001..2002,7") == [1, 2, 3, 2001, 2002, 7]
    with pytest.raises(ParameterError, match="1..20,31..40"):
        parse_seeds("3..1")


def test_the_table_says_median_worst_and_how_many_are_inside(content):
    _, study_json = content

    class Results(dict):
        read = {"worlds": {"command": "x --seeds 1..2,4 --json"}}

    text = worlds(Results(worlds=study_json))
    rows = [line for line in text.splitlines() if line.startswith("| lateral position error")]
    assert len(rows) == 2 and "whole flight" in rows[0]
    (row,) = [
        row for row in study_json["places"][1]["metrics"]
        if (row["key"], row["stretch"], row["measured_from"]) == ("lateral", "whole", "truth")
    ]  # fmt: skip
    assert f"{row['median']:.2f} / {row['worst']:.2f}; {row['inside']}" in rows[0]
    assert "1 to 2 and 4 (3 " in text
    assert "| lost |  | 0 | 0 | 0 | 0 |" in text
