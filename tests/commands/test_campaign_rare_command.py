# SPDX-License-Identifier: Apache-2.0
"""`heli campaign rare` and `heli campaign worst`: a few short flights, and what is told of them."""

import json
import re
from contextlib import contextmanager
from functools import partial
from types import SimpleNamespace

import pytest

from heli_flight.cli import app as cli
from heli_flight.loop import simulate
from heli_flight.scoring import score
from heli_flight.settings import resolve
from heli_studies.campaign import spec as rows
from heli_studies.campaign.rare import Ended
from heli_studies.campaign.run import Store
from heli_studies.campaign.workers import fly_on

NAME = "altitude (truth)"
TEXT = """flights: 1
flight_seeds: 3
world: paper
gps: rtk
duration_s: 3.0
chunk: 5
set: {scenario.score.windows_s: [1.0, -1.0]}
disperse:
  plant.scale.mass: {uniform: [0.8, 1.2]}
  plant.scale.inertia: {uniform: [0.8, 1.2]}
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "spec.yaml"
    path.write_text(TEXT)
    return path


def run(capsys, *words):
    code = cli.main(["campaign", *map(str, words)])
    return code, *capsys.readouterr()


@pytest.mark.slow
def test_rare_tells_a_probability_and_keeps_every_flight(file, tmp_path, capsys):
    out = tmp_path / "out"
    words = ["rare", file, "--of", NAME, "--out", out, "--per-level", 20, "--workers", 0]
    code, printed, stderr = run(capsys, *words, "--most-flights", 38, "--beyond", 9.0, "--json")
    assert code == 0, stderr
    result = json.loads(printed)
    assert json.loads((out / "result.json").read_text()) == result
    assert result["ended"] == Ended.BUDGET and result["probability"] is None
    assert [level["flights"] for level in result["levels"]] == [20, 38] and result["flights"] == 38
    table = Store(out).table()
    values = table[f"max.{NAME}"].to_pylist()
    assert table["level"].to_pylist() == [0] * 20 + [1] * 18
    first = sorted(values[:20])
    assert result["levels"][0]["threshold"] == pytest.approx((first[-2] + first[-3]) / 2.0)
    number = result["again"][0]
    assert values[number] == max(values)
    settings = resolve(params=[out / "worst" / f"flight_{number}" / "params.yaml"])
    figures = score(simulate(settings).record, settings.scenario).windows
    assert {s.name: s.max for s in figures}[NAME] == values[number]


def without_flying(spec, numbers):
    """Rows as of `fly_rows`; the metric is the product of the two inputs."""
    flights = []
    for number in numbers:
        row = rows._begun(spec, number) | rows._end(rows.FlightEnding.FLOWN, "", 0)
        mass, inertia = spec.inputs[number]
        flights.append(row | {f"max.{NAME}": mass * inertia})
    return flights


@contextmanager
def threads(workers):
    """A cluster in this process, which is quickly there, in the place of processes."""
    from distributed import Client

    how = {"processes": False, "threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}
    with Client(n_workers=workers, set_as_default=False, **how) as client:
        yield SimpleNamespace(fly=partial(fly_on, client))


def test_worst_is_the_same_whoever_flies(file, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("heli_studies.campaign.workers.Processes", threads)
    monkeypatch.setattr(rows, "fly_rows", without_flying)
    results = []
    for workers in (0, 1):
        out = tmp_path / f"out{workers}"
        words = ["worst", file, "--of", NAME, "--out", out, "--flights", 30, "--workers", workers]
        code, printed, stderr = run(capsys, *words)
        assert code == 0, stderr
        assert re.search("CMA-ES .* random", printed)
        assert f"hover --params {out}" in printed
        results.append(((out / "result.json").read_text(), Store(out).table()))
    assert results[0][0] == results[1][0] and results[0][1].equals(results[1][1])
    result, table = json.loads(results[0][0]), results[0][1]
    for name, ours in (("CMA-ES", slice(0, 30)), ("random", slice(30, 60))):
        search, values = result["searches"][name], table[f"max.{NAME}"].to_pylist()
        assert set(table["search"].to_pylist()[ours]) == {name}
        assert search["value"] == max(values[ours]) == values[search["flight"]]
        mass = table["in.plant.scale.mass"].to_pylist()[search["flight"]]
        assert search["inputs"]["plant.scale.mass"] == mass


def test_after_an_interrupt_what_stands_is_told(file, tmp_path, capsys, monkeypatch):
    def fly(spec, numbers):
        if len(list((tmp_path / "out" / "rows").iterdir())) > 10:
            raise KeyboardInterrupt
        return without_flying(spec, numbers)

    monkeypatch.setattr(rows, "fly_rows", fly)
    words = ["rare", file, "--of", NAME, "--out", tmp_path / "out", "--per-level", 20]
    code, printed, stderr = run(capsys, *words, "--workers", 0, "--beyond", 9.0)
    assert (code, printed) == (130, "")
    assert f"interrupted: P({NAME} > " in stderr and stderr.strip().endswith("interrupted")
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["ended"] == "interrupted" and len(result["levels"]) == 1


@pytest.mark.parametrize(
    ("words", "fragment"),
    [
        (["rare", "--of", "altitude"], "--of 'altitude': unknown; did you mean altitude (truth)?"),
        (["rare", "--of", NAME, "--per-level", "25"], "--per-level: 25; allowed: a multiple of 10"),
        (["rare", "--of", NAME, "--most-flights", "9"], "--most-flights: 9; allowed: from 2500 on"),
        (["rare", "--of", NAME, "--beyond", "-1"], "--beyond: -1.0; allowed: a number above 0"),
        (["worst", "--of", NAME, "--flights", "3"], "--flights: 3; allowed: an integer from 10 on"),
        (["worst", "--of", NAME, "--sigma", "9"], "--sigma: 9.0; allowed: a number above 0"),
        (["worst", "--of", NAME, "--workers", "1", "--scheduler", "tcp://x:1"], "one of the two"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_no_folder(file, tmp_path, capsys, words, fragment):
    out = tmp_path / "out"
    code, _, stderr = run(capsys, words[0], file, *words[1:], "--out", out)
    assert code == 2 and len(stderr.strip().splitlines()) == 1 and fragment in stderr
    assert not out.exists()
