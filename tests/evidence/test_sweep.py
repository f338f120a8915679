# SPDX-License-Identifier: Apache-2.0
"""The one loop of the experiments: order, workers, what is kept; with flights that cost nothing."""

import ast
import json
import os
import pickle
import re
import zlib
from dataclasses import replace
from itertools import product
from statistics import median

import pytest

from evidence import files, sweep
from evidence.experiments import (
    actuator_faults,
    blind_landing,
    engine_out,
    failsafes,
    into_wind,
    sequence,
    takeoff,
)
from evidence.sweep import Options, over
from heli_core.errors import FlightError
from heli_core.rcl_yaml import ParameterError
from support import fake_sweep

SEEDS = [7, 3]
LOST = "seed 5: lost"
EXPERIMENTS = files.checkout() / "evidence" / "experiments"


def loop():
    """The loop as an experiment would write it by hand."""
    worlds, gps, variants = fake_sweep.flown.axes.values()
    for place in product(worlds, gps, variants):
        yield (
            dict(zip(("world", "gps", "variant"), place, strict=True)),
            [fake_sweep.flown.flight(*place, seed) for seed in SEEDS],
        )


def shortened(places):
    return [(dict(place.point), [one[:2] for one in place.flights]) for place in places]


BY_HAND = [(point, [one[:2] for one in flights]) for point, flights in loop()]


def test_the_last_axis_runs_fastest_and_seeds_come_as_they_are_given():
    assert shortened(fake_sweep.flown.places(Options(SEEDS))) == BY_HAND
    assert list(BY_HAND[1][0].values()) == ["paper", "rtk", 0.3]
    assert BY_HAND[1][1][0][0] == "paper rtk 0.3 7"


def test_some_of_the_places_may_be_flown():
    points = fake_sweep.flown.points[5:2:-1]
    assert shortened(fake_sweep.flown.places(Options(SEEDS), points)) == BY_HAND[5:2:-1]


def test_without_axes_there_is_one_place():
    (place,) = over()(lambda seed: 2 * seed).places(Options(SEEDS))
    assert (place.point, place.flights) == ({}, [14, 6])


def test_a_batch_is_found_again_by_name():
    """What a worker gets holds no code: its module and name."""
    batch = sweep.FlightsOfSweep(fake_sweep.flown, tuple(fake_sweep.flown.points), tuple(SEEDS))
    sent = pickle.dumps(batch)
    assert pickle.loads(sent).sweep is fake_sweep.flown and b"fake_sweep" in sent
    flown = [pickle.loads(row[sweep.FIGURES]) for row in pickle.loads(sent).fly(range(16))]
    assert [one[:2] for one in flown] == [one for _, flights in BY_HAND for one in flights]


@pytest.mark.slow
def test_workers_fly_the_same(tmp_path):
    places = list(fake_sweep.flown.places(Options(SEEDS, 2, tmp_path)))
    assert shortened(places) == BY_HAND
    assert os.getpid() not in {one.process for place in places for one in place.flights}
    again = fake_sweep.flown.places(Options(SEEDS, 1, tmp_path))
    assert shortened(again) == BY_HAND


class Broken(Exception):
    """What ends a sweep on the way."""


def test_a_sweep_that_was_broken_off_goes_on(tmp_path):
    flown = []

    def flight(world, seed):
        flown.append((world, seed))
        if len(flown) == 6:
            raise Broken
        return f"{world} {seed}"

    sweeping = over(world=("a", "b", "c"))(flight)
    options = Options([1, 2, 3], rows=tmp_path)
    with pytest.raises(Broken):
        list(sweeping.places(options))
    first = list(flown)
    places = list(sweeping.places(options))
    assert [place.flights for place in places] == [[f"{w} {s}" for s in (1, 2, 3)] for w in "abc"]
    assert first[:4] == [("a", 1), ("a", 2), ("a", 3), ("b", 1)]
    assert flown[6:] == [("b", 2), ("b", 3), ("c", 1), ("c", 2), ("c", 3)], "a task is kept whole"
    assert list(sweeping.places(options)) == places and len(flown) == 11


def test_rows_of_other_flights_are_refused(tmp_path):
    list(fake_sweep.flown.places(Options(SEEDS, rows=tmp_path)))
    folder = tmp_path / "fake_sweep_flown"
    for seeds, points in ((SEEDS[:1], None), (SEEDS, fake_sweep.flown.points[:2])):
        with pytest.raises(ParameterError, match=f"^--rows: {re.escape(str(folder))}: ") as caught:
            list(fake_sweep.flown.places(Options(seeds, rows=tmp_path), points))
        assert caught.value.__context__ is None, "read, and of another sweep"
    about = folder / sweep.ABOUT
    about.write_text(json.dumps(json.loads(about.read_text()) | {"commit": "another"}))
    with pytest.raises(ParameterError) as caught:
        list(fake_sweep.flown.places(Options(SEEDS, rows=tmp_path)))
    assert caught.value.__context__ is None
    about.unlink()
    with pytest.raises(ParameterError) as caught:
        list(fake_sweep.flown.places(Options(SEEDS, rows=tmp_path)))
    assert isinstance(caught.value.__context__, FileNotFoundError)


def test_a_flight_that_ends_its_process_is_named():
    batch = sweep.FlightsOfSweep(fake_sweep.flown, tuple(fake_sweep.flown.points), (7, 3))
    with pytest.raises(FlightError) as caught:
        batch.killed(3)
    place = dict(fake_sweep.flown.points[1])
    assert str(caught.value).startswith(f"{batch.name}: {place}, seed 3: ")


class TestPrintFound:
    @pytest.fixture(autouse=True)
    def no_variable(self, monkeypatch):
        monkeypatch.delenv("HELI_ROWS", raising=False)

    def printed(self, monkeypatch, capsys, *words, **options):
        monkeypatch.setattr("sys.argv", ["experiment.py", *words])
        code = sweep.print_result("What.", self.produced, "1..2", **options)
        return code, *capsys.readouterr()

    def produced(self, options, worlds=()):
        if 5 in options.seeds:
            raise FlightError(LOST)
        return {"seeds": options.seeds, "workers": options.workers, "worlds": worlds,
                "rows": str(options.rows)}  # fmt: skip

    def test_options_reach_what_finds(self, monkeypatch, capsys):
        words = ("--seeds", "3,7..8", "--workers", "1", "--rows", "r", "--worlds", "a,b")
        code, out, _ = self.printed(monkeypatch, capsys, *words, worlds="paper")
        options = {"seeds": [3, 7, 8], "workers": 1, "worlds": ["a", "b"], "rows": "r"}
        assert (code, json.loads(out)) == (0, options)

    def test_defaults(self, monkeypatch, capsys):
        monkeypatch.setenv("HELI_ROWS", "/tmp/kept")
        _, out, _ = self.printed(monkeypatch, capsys, worlds="paper")
        cores = len(os.sched_getaffinity(0))
        options = {"seeds": [1, 2], "workers": cores, "worlds": ["paper"], "rows": "/tmp/kept"}
        assert json.loads(out) == options

    def test_what_is_found_is_printed_as_tables_or_as_json(self, monkeypatch, capsys):
        def tables(content):
            return f"| {content['seeds']} |"

        assert self.printed(monkeypatch, capsys, tables=tables)[1] == "| [1, 2] |\n"
        out = self.printed(monkeypatch, capsys, "--json", tables=tables)[1]
        assert json.loads(out)["seeds"] == [1, 2]

    def test_a_failure_is_one_sentence(self, monkeypatch, capsys):
        printed = self.printed(monkeypatch, capsys, "--seeds", "5")
        assert printed == (2, "", f"error: {LOST}\n")


# Experiments whose flights are faked by figures: module, its sweep, figures that are numbers,
# that say whether; how the row of a place names its largest values and its counts.
FAKED = {
    "blind_landing": (
        blind_landing, "flown",
        ("tilt_deg", "sink_mps", "skid_m", "drift_m", "lost_after_s", "attitude_deg", "collective",
         "sideways_mps"), ("stands",),
    ),
    "engine_out": (
        engine_out, "touch_down", ("down_mps", "along_mps", "tilt_deg", "after_s"), ("stands",),
    ),
    "failsafes": (
        failsafes, "flown", ("landing_s", "down_s", "sink_mps", "away_m", "off_m"), ("lost",),
    ),
}  # fmt: skip


def number(key, values):
    """A number that follows from the name of a figure and the flight."""
    return zlib.crc32(repr((key, sorted(values.items()))).encode()) / 2.0**32


def keys(content):
    """Names in their order, through all levels."""
    if isinstance(content, dict):
        return [(key, keys(value)) for key, value in content.items()]
    return keys(content[0]) if isinstance(content, list) and content else None


@pytest.mark.parametrize("name", FAKED)
def test_an_experiment_makes_the_rows_of_its_file(name, monkeypatch):
    """Places and keys in the order of the published file; largest, median, count of the flights."""
    module, attribute, numbers, counted = FAKED[name]

    def fake(**values):
        flags = {key: number(key, values) > 0.5 for key in counted}
        return {key: number(key, values) for key in numbers} | flags

    sweeping = getattr(module, attribute)
    monkeypatch.setattr(module, attribute, replace(sweeping, flight=fake))
    made, stored = module.experiment(Options(SEEDS)), files.read(files.checkout(), name)["found"]
    assert list(made) == list(stored) and len(made["rows"]) == len(stored["rows"])
    for point, row, published in zip(sweeping.points, made["rows"], stored["rows"], strict=True):
        assert keys(row) == keys(published)
        assert {axis: row[axis] for axis in point} == {axis: published[axis] for axis in point}
        flights = [fake(**point, seed=seed) for seed in SEEDS]
        for key, value in row["max"].items():
            assert value == max(flight[key] for flight in flights)
        for key, value in row["median"].items():
            assert value == median(flight[key] for flight in flights)
        for key in counted:
            assert row[key] == sum(flight[key] for flight in flights)


@pytest.mark.parametrize("module", [takeoff, sequence], ids=["takeoff", "sequence"])
def test_of_optional_figures_the_largest_is_told(module, monkeypatch):
    """A flight may lack a figure; what is counted is so of the flights."""
    asked = []

    def fake(**values):
        asked.append(values["seed"])
        lacks = values["seed"] == SEEDS[0]
        return {"lost": lacks, "inside": not lacks, "broken_off": lacks, "changes": [],
                "max": {"a": 0.25} | ({} if lacks else {"b": 2.0})}  # fmt: skip

    monkeypatch.setattr(module, "flown", replace(module.flown, flight=fake))
    rows = module.experiment(Options(SEEDS))["rows"]
    assert asked == SEEDS * len(rows)
    stored = files.read(files.checkout(), module.__name__.rpartition(".")[2])["found"]["rows"]
    assert [list(row) for row in rows] == [list(row) for row in stored]
    for row in rows:
        assert row["max"] == {"a": 0.25, "b": 2.0} and row["lost"] == row["inside"] == 1


def test_what_turned_in_time_is_counted(monkeypatch):
    """Angles of 10 and 30 deg, one of them within the bound."""

    def fake(world, wind_mps, seed):
        return (30.0, None) if seed == SEEDS[0] else (10.0, 4.0)

    monkeypatch.setattr(into_wind, "flown", replace(into_wind.flown, flight=fake))
    for row in into_wind.experiment(Options(SEEDS))["rows"]:
        figures = row["median_deg"], row["max_deg"], row["within"], row["median_took_s"]
        assert figures == (20.0, 30.0, 1, 4.0)


def test_a_fault_of_an_actuator_is_flown_as_its_row_says(monkeypatch):
    """What is told of those that were kept is not mixed with those that were lost."""

    def fake(what, fault, gps, seed):
        lost = seed == SEEDS[0]
        return {"lost": lost, "cause": "fell" if lost else "", "lost_s": 2.0 if lost else None,
                "off_m": 100.0 if lost else 1.0, "turned_deg": 90.0 if lost else 3.0}  # fmt: skip

    monkeypatch.setattr(actuator_faults, "flown", replace(actuator_faults.flown, flight=fake))
    rows = actuator_faults.experiment(Options(SEEDS))["rows"]
    stored = files.read(files.checkout(), "actuator_faults")["found"]["rows"]
    heads = ("what", "fault", "gps", "text")
    assert [[r[key] for key in heads] for r in rows] == [[r[key] for key in heads] for r in stored]
    for row in rows:
        assert (row["lost"], row["causes"], row["min"]) == (1, ["fell"], {"lost_s": 2.0})
        assert row["max"] == {"off_m": 1.0, "turned_deg": 3.0} and row["median"] == {"off_m": 1.0}


@pytest.mark.parametrize("path", sorted(EXPERIMENTS.glob("*.py")), ids=lambda path: path.stem)
def test_no_experiment_that_flies_has_a_loop_over_seeds_of_its_own(path):
    """But that which flies in a process that imitates another processor."""
    text = path.read_text(encoding="utf-8")
    loops = [
        node
        for node in ast.walk(ast.parse(text))
        if isinstance(node, (ast.For, ast.comprehension))
        and "seed" in {name.id for name in ast.walk(node.target) if isinstance(name, ast.Name)}
    ]
    flies = any(f"{word}(" in text for word in ("simulate", "fly_loop", "fly_seeds", "run"))
    assert len(loops) * flies == (path.stem == "cpu_types")
