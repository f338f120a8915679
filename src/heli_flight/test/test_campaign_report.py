# SPDX-License-Identifier: Apache-2.0
"""A campaign's report: what explains the spread, which flights came worst, the page itself."""

import errno
import html
import json
import math
import os
import re
import shutil

import numpy as np
import pytest
from scipy import stats

from heli_core.metrics import METRICS
from heli_core.rcl_yaml import ParameterError
from heli_flight.cli import app as cli
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_studies.campaign.report import distribution_charts, margin_chart, read_campaign
from heli_studies.campaign.run import Store, cases, explained_variance, sensitivities, worst_flights
from heli_studies.campaign.spec import fly_rows, spec_of
from support.fuzzing import Target, damaged_bytes, tally

FLIGHTS = 24
TEXT = f"""flights: {FLIGHTS}
world: paper
gps: rtk
duration_s: 6.0
flight_seeds: 3
set: {{scenario.score.windows_s: [2.0, -1.0]}}
disperse:
  plant.scale.mass: {{uniform: [0.9, 1.1]}}
  inner_loop.controller: {{choice: [hinf_output, pid]}}
"""


# --- what explains the spread --------------------------------------------------------------------


def made(count=400):
    """A figure that one input moves monotonically, one not at all, and names by steps."""
    rng = np.random.default_rng(5)
    a, b = rng.random(count), rng.random(count)
    name = rng.choice(["x", "y", "z"], count)
    step = np.array([{"x": 0.0, "y": 0.3, "z": 0.3}[n] for n in name])
    return {"a": a, "b": b, "name": list(map(str, name))}, np.exp(a) + step


def test_influences_are_the_rank_correlations_strongest_first():
    inputs, figure = made()
    influences = sensitivities(inputs, figure)
    assert [one.name for one in influences] == ["a", "name", "b"]
    ranks = stats.rankdata(inputs["a"]), stats.rankdata(figure)
    assert influences[0].rank_correlation == pytest.approx(np.corrcoef(*ranks)[0, 1], abs=1e-12)
    assert influences[0].p_value < 1e-10 and abs(influences[2].rank_correlation) < 0.15
    # Of names: the F test's own ratio, eta squared, over ranks.
    groups = [ranks[1][np.array(inputs["name"]) == n] for n in "xyz"]
    f = stats.f_oneway(*groups).statistic
    eta = f * 2.0 / (f * 2.0 + len(figure) - 3.0)
    assert influences[1].rank_correlation == pytest.approx(math.sqrt(eta), rel=1e-9)


def test_all_inputs_together_explain_what_they_make():
    inputs, figure = made()
    assert explained_variance({"a": inputs["a"]}, np.exp(inputs["a"])) == pytest.approx(1.0)
    assert explained_variance({"b": inputs["b"]}, figure) < 0.03
    both = explained_variance(inputs, figure)
    assert explained_variance({"a": inputs["a"]}, figure) < both and both > 0.9
    alone = explained_variance({"a": inputs["a"]}, figure)
    rho = np.corrcoef(stats.rankdata(inputs["a"]), stats.rankdata(figure))[0, 1]
    count = len(figure)
    assert alone == pytest.approx(1.0 - (1.0 - rho**2) * (count - 1) / (count - 2), rel=1e-9)


def test_flights_without_a_figure_and_inputs_that_stand_still_say_nothing():
    inputs, figure = made(40)
    figure[::2] = math.nan
    whole = sensitivities({"a": inputs["a"]}, figure)[0]
    part = sensitivities({"a": inputs["a"][1::2]}, figure[1::2])[0]
    assert whole == part
    still = sensitivities({"still": np.ones(40)}, figure)[0]
    assert math.isnan(still.rank_correlation)
    assert math.isnan(explained_variance({"still": np.ones(40)}, figure))
    assert sensitivities(inputs, np.full(40, math.nan)) == []


# --- a campaign's folder -------------------------------------------------------------------------


@pytest.fixture(scope="module")
def flown(tmp_path_factory):
    """A campaign of 24 flights; some rows are made worse than they were."""
    folder = tmp_path_factory.mktemp("campaign")
    file = folder / "spec.yaml"
    file.write_text(TEXT)
    spec = spec_of(file)
    rows = fly_rows(spec, range(FLIGHTS))
    figures = [key for key in rows[0] if key.startswith("max")]
    for number, cause, sentence in ((4, "lost", "It fell <b>down</b>."), (9, "threw", "Odd.")):
        rows[number] |= {"cause": cause, "sentence": sentence, "exit_code": 1}
        rows[number] |= dict.fromkeys(figures)
    rows[7] |= {"max.v_x (truth)": 0.9, "exit_code": 1}
    rows[2] |= {"max.altitude (navigation)": 0.8, "exit_code": 1}
    store = Store.begin(folder / "out", spec, file)
    store.put(rows[:20])
    store.put(rows[20:])
    return store


def test_the_worst_come_first(flown):
    every = cases(flown.table(), {"kind": "hover", "gps": "rtk"})
    assert len(every) == FLIGHTS and sum(case.failed for case in every) == 4
    first = worst_flights(every, 4)
    assert [case.number for case in first] == [4, 9, 7, 2]
    assert (first[2].figure, first[2].value) == ("v_x (truth)", 0.9)
    assert first[2].share == pytest.approx(0.9 / 0.3)
    others = [case.share for case in worst_flights(every, FLIGHTS)[4:]]
    assert others == sorted(others, reverse=True) and others[0] < 1.0
    # With a standalone receiver ground truth is not judged.
    assert [
        case.number
        for case in worst_flights(cases(flown.table(), {"kind": "hover", "gps": "standalone"}), 3)
    ] == [
        4,
        9,
        2,
    ]


def test_the_page_tells_what_the_rows_hold(flown, capsys, tmp_path):
    assert cli.main(["campaign", "report", str(flown.folder), "--json"]) == 0
    content = json.loads(capsys.readouterr().out)
    assert (content["flights"], content["failed"], content["missing"]) == (FLIGHTS, 4, 0)
    low, high = content["interval"]
    # Clopper and Pearson by the beta distribution.
    assert low == pytest.approx(stats.beta.ppf(0.025, 4, FLIGHTS - 3), rel=1e-6)
    assert high == pytest.approx(stats.beta.ppf(0.975, 5, FLIGHTS - 4), rel=1e-6)
    text = (flown.folder / "report.html").read_text()
    body = text[: text.index('<script type="application/json"')]
    for words in (
        "4 of 24 flights outside", "16.7 %", "It fell &lt;b&gt;down&lt;/b&gt;.", "Odd.",
        "plant.scale.mass", "hinf_output, pid", "uniform 0.9, 1.1", "300 % of its bound",
    ):  # fmt: skip
        assert words in body, words
    assert "http" not in re.sub(r"<[^>]*>", "", body)
    for number in (4, 9, 7, 2):
        assert f"worst/flight_{number}/params.yaml</code>" in body
    assert {"margin.png", "dist_v_z.svg", "failures.png"} <= {
        path.rpartition("/")[2] for path in content["figures"]
    }


def test_a_worst_case_flies_the_same_again(flown):
    campaign = read_campaign(flown.folder)
    row = next(row for row in flown.table().to_pylist() if row["flight"] == 7)
    settings = resolve(params=[campaign.again[7]])
    assert settings.nodes["plant"]["scale.mass"] == row["in.plant.scale.mass"]
    assert settings.nodes["inner_loop"]["controller"] == row["in.inner_loop.controller"]
    assert len(simulate(settings).record) == 600


def test_curves_hold_every_flight(flown):
    table = flown.table()
    chart = next(c for c in distribution_charts(table, METRICS["hover"]) if c.key == "dist_v_x")
    histogram, cumulative = chart.panels
    values = np.array([v for v in table["max.v_x (truth)"].to_pylist() if v is not None])
    truth = next(t for t in histogram.traces if t.label == "ground truth")
    assert truth.y[1::2][:-1].sum() == len(values) == FLIGHTS - 2
    curve = next(t for t in cumulative.traces if t.label == "ground truth")
    assert curve.y[-1] == (FLIGHTS - 2) / FLIGHTS, "what has no figure is never below"
    for value in values:
        at = curve.y[np.flatnonzero(curve.x <= value)[-1]]
        assert at == pytest.approx((values <= value).sum() / FLIGHTS)
    (margin,) = margin_chart(cases(table, {"kind": "hover", "gps": "rtk"}), "bounds").panels
    inside = margin.traces[0]
    assert inside.y[np.flatnonzero(inside.x <= 1.0)[-1]] == pytest.approx((FLIGHTS - 4) / FLIGHTS)


def test_a_campaign_that_was_broken_off_is_told_as_far_as_it_came(flown, tmp_path, capsys):
    """One file of rows is cut off; the spec that was flown has changed since."""
    folder = tmp_path / "out"
    store = Store.begin(folder, spec_of(flown.folder / "spec.yaml"), flown.folder / "spec.yaml")
    store.put(flown.table().to_pylist()[:9])
    (folder / "rows" / "part-00000020.parquet").write_bytes(b"PAR1 and no more")
    about = json.loads((folder / "campaign.json").read_text())
    about["file"] = str(tmp_path / "gone.yaml")
    (folder / "campaign.json").write_text(json.dumps(about))
    (folder / "spec.yaml").write_text(TEXT.replace("1.1", "1.2"))
    assert cli.main(["campaign", "report", str(folder), "--out", str(tmp_path / "page")]) == 0
    capsys.readouterr()
    body = (tmp_path / "page" / "report.html").read_text()
    campaign = read_campaign(folder)
    assert campaign.missing == 15 and f"15 of {FLIGHTS} flights" in body
    assert campaign.again == {} and "gone.yaml" in campaign.why_not
    assert html.escape(campaign.why_not) in body
    assert not (folder / "worst").exists()


def test_what_is_no_campaign_is_one_line(flown, tmp_path, capsys):
    empty = tmp_path / "empty"
    Store.begin(empty, spec_of(flown.folder / "spec.yaml"), flown.folder / "spec.yaml")
    foreign = tmp_path / "foreign"
    foreign.mkdir()
    (foreign / "campaign.json").write_text("[1]")
    for folder, reason in (
        (tmp_path / "nowhere", "holds no campaign"), (foreign, "holds no campaign"),
        (empty, "no flight has ended yet"), (flown.folder / "spec.yaml", "holds no campaign"),
    ):  # fmt: skip
        assert cli.main(["campaign", "report", str(folder)]) == 2
        (line,) = capsys.readouterr().err.strip().splitlines()
        assert str(folder) in line and reason in line
    file = tmp_path / "file"
    file.write_text("")
    assert cli.main(["campaign", "report", str(flown.folder), "--out", str(file)]) == 2
    (*_, line) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"heli: {file}: ") and line.endswith(os.strerror(errno.EEXIST))


def test_a_damaged_folder_is_read_or_refused_in_a_sentence(flown, tmp_path):
    """Bytes of rows, description and spec changed at random, always the same ones."""

    def attempt(numbers, folder):
        damaged = folder / "damaged"
        shutil.rmtree(damaged, ignore_errors=True)
        shutil.copytree(flown.folder, damaged)
        files = [damaged / "campaign.json", damaged / "spec.yaml", *damaged.glob("rows/*")]
        for path in numbers.sample(files, numbers.randint(1, 2)):
            path.write_bytes(damaged_bytes(numbers, path.read_bytes()))
        try:
            campaign = read_campaign(damaged)
            assert campaign.missing >= 0 and campaign.figures and campaign.inputs
        except ParameterError as error:
            return str(error)
        return ""

    counts = tally(Target("campaign folder", attempt), range(30), tmp_path)
    assert not counts.failed, counts.failures
    assert counts.taken > 4 and counts.refused > 4


def test_a_fifo_in_the_place_of_the_spec_holds_nobody_up(flown, tmp_path):
    folder = tmp_path / "out"
    shutil.copytree(flown.folder, folder)
    about = json.loads((folder / "campaign.json").read_text())
    for path in (folder / "spec.yaml", folder / "elsewhere.yaml"):
        path.unlink(missing_ok=True)
        os.mkfifo(path)
    about["file"] = str(folder / "elsewhere.yaml")
    (folder / "campaign.json").write_text(json.dumps(about))
    assert read_campaign(folder).again == {}


def test_a_spec_that_reads_is_asked_only_for_files(flown, monkeypatch):
    """What a worst case needs may be refused by now; the page is written all the same."""

    def refuse(*_):
        raise ParameterError("no")

    monkeypatch.setattr("heli_studies.campaign.report.write_rerun_files", refuse)
    campaign = read_campaign(flown.folder)
    assert campaign.again == {} and "no." in campaign.why_not
