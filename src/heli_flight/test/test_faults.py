# SPDX-License-Identifier: Apache-2.0
"""`--faults FILE`: what it says is flown, told, and flown again; what is wrong is one line."""

import json
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from heli_core.errors import ParameterCause as Cause
from heli_core.rcl_yaml import ParameterError
from heli_flight import loop as closed_loop
from heli_flight.cli.app import main
from heli_flight.flight_file import fault_overrides, flown_faults
from heli_flight.report.charts import timeline_charts
from heli_flight.report.data import Report
from heli_flight.result import Result, fault_words
from heli_flight.scoring import score
from heli_flight.settings import resolve
from heli_studies.campaign.run import Share
from heli_studies.campaign.spec import spec_of

EXAMPLES = Path(__file__).resolve().parents[3] / "examples"

FILE = """\
faults:
  - {what: gps, kind: loss, start_s: 2.0, duration_s: 1.5}
  - what: imu
    kind: bias
    start_s: 3
    value: [0, 0, 0.5, 0, 0, 0.01]
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "faults.yaml"
    path.write_text(FILE)
    return path


def test_a_file_is_flown_told_and_flown_again(fly, file, tmp_path, capsys):
    words = ("--one-process", "--duration", 4, "--seed", 3)
    _, result = fly(tmp_path / "a", *words, "--faults", file)
    descriptions = fault_words(resolve(params=[tmp_path / "a" / "params.yaml"]))
    assert f"faults: {descriptions}" in " ".join(capsys.readouterr().out.split())
    assert result["faults"] == [
        {"what": "gps", "kind": "loss", "start_s": 2.0, "duration_s": 1.5, "value": []},
        {"what": "imu", "kind": "bias", "start_s": 3.0, "duration_s": None,
         "value": [0.0, 0.0, 0.5, 0.0, 0.0, 0.01]},
    ]  # fmt: skip
    _, again = fly(tmp_path / "b", "--params", tmp_path / "a" / "params.yaml")
    assert again["faults"] == result["faults"]
    assert again["metrics"] == result["metrics"]
    _, sound = fly(tmp_path / "c", *words)
    assert sound["faults"] == []
    assert sound["metrics"] != result["metrics"]


def test_the_report_shows_when_they_were(file):
    settings = resolve("hover", "rtk", 3, 4.0, overrides=fault_overrides(file))
    flight = closed_loop.simulate(settings)
    result = Result(score(flight.record, settings.scenario), "", 4.0, 1.0)
    (panel,) = timeline_charts(Report(flight.record, settings, result, "one process"))[0].panels
    shown = {
        panel.y_ticks[int(trace.y[0])]: trace.x[:2].tolist()
        for trace in panel.traces
        if trace.role == "rival"
    }
    assert shown["fault: gps"] == [2.0, 3.5]
    assert shown["fault: imu"] == pytest.approx([3.0, 3.99])
    descriptions = fault_words(settings).split("; ")
    assert [words.split()[:2] for words in descriptions] == [["gps", "loss"], ["imu", "bias"]]


def test_before_its_faults_a_flight_is_the_sound_one(file):
    over = fault_overrides(file)
    sound, hurt = (
        closed_loop.simulate(resolve("hover", "rtk", 3, 4.0, overrides=o)).record
        for o in (None, over)
    )
    for name in ("truth_pos_ned_m", "nav_pos_ned_m", "u"):
        a, b = getattr(sound, name), getattr(hurt, name)
        np.testing.assert_array_equal(a[:200], b[:200])
        assert (a[-1] != b[-1]).any()


def test_an_empty_list_takes_the_faults_of_a_parameter_file_away(tmp_path):
    path = tmp_path / "none.yaml"
    path.write_text("faults: []\n")
    assert fault_overrides(path)["plant"]["faults"] == ("none",)
    assert flown_faults(resolve(overrides=fault_overrides(path))) == ()


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        ("", "expected 'faults:' and a list of mappings"),
        ("faults: 3", "expected 'faults:' and a list of mappings"),
        ("fault: []", "expected 'faults:' and a list of mappings"),
        ("faults: [", "not valid YAML"),
        ("faults:\n  - gps\n", ":2: expected a mapping of what"),
        ("faults:\n  - {what: gsp, kind: loss, start_s: 1}\n", ":2: what: gsp is not allowed"),
        ("faults:\n\n  - {what: gps, kind: bias, start_s: 1}\n", ":3: value: missing"),
        (
            "faults:\n  - {what: link, from: observer, to: plant, kind: loss, start_s: 1}\n",
            ":2: from observer to plant goes no topic; known: plant to observer: imu/data_raw",
        ),
        (b"\xff\xfe\x00", "it is not UTF-8"),
    ],
)
def test_bad_files_are_one_line_and_exit_code_2(tmp_path, capsys, content, expected):
    path = tmp_path / "wrong.yaml"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    assert main(["hover", "--one-process", "--faults", str(path)]) == 2
    captured = capsys.readouterr().err
    assert str(path) in captured
    assert expected in captured
    assert captured.count("\n") == 1


LINKS = """\
faults:
  - {what: link, from: any, to: any, kind: loss, value: 0.3, start_s: 1.0}
  - {what: link, from: observer, to: inner_loop, topic: odom, kind: delay, value: 0.05, start_s: 2}
  - {what: gps, kind: loss, start_s: 2.0}
"""


def test_faults_of_links_are_flown_told_and_flown_again(fly, tmp_path, capsys):
    path = tmp_path / "links.yaml"
    path.write_text(LINKS)
    words = ("--one-process", "--duration", 4, "--seed", 3)
    _, result = fly(tmp_path / "a", *words, "--faults", path)
    description = (
        "link any to any loss 0.3 from 1 s on; link odom observer to inner_loop delay 0.05 from 2"
    )
    assert description in capsys.readouterr().out
    assert [fault["what"] for fault in result["faults"]] == ["gps", "link", "link"]
    assert result["faults"][2] == {
        "what": "link", "from": "observer", "to": "inner_loop", "topic": "odom", "kind": "delay",
        "start_s": 2.0, "duration_s": None, "value": [0.05],
    }  # fmt: skip
    assert not any("link_seed" in name for name in result["changed"])
    _, again = fly(tmp_path / "b", "--params", tmp_path / "a" / "params.yaml")
    assert again["faults"] == result["faults"] and again["metrics"] == result["metrics"]
    _, other = fly(tmp_path / "c", *words)
    assert other["metrics"] != result["metrics"]


def test_what_is_lost_hangs_on_the_seed_of_the_flight(tmp_path):
    path = tmp_path / "links.yaml"
    path.write_text(LINKS)
    settings = resolve("hover", "rtk", 3, 3.0, overrides=fault_overrides(path))
    assert {values["link_seed"] for values in settings.nodes.values()} == {3}
    other = settings.with_seed(4)
    assert {values["link_seed"] for values in other.nodes.values()} == {4}
    lost = []
    for flown in (settings, settings, other):
        loop = closed_loop.build(flown)
        closed_loop.fly_loop(loop, flown)
        lost.append(loop.links.s.counts.tolist())
    assert lost[0] == lost[1] != lost[2]


def test_a_campaign_flies_faults_of_links(tmp_path):
    (tmp_path / "links.yaml").write_text(LINKS)
    path = tmp_path / "spec.yaml"
    path.write_text("flights: 2\nfaults: links.yaml\n")
    spec = spec_of(path)
    for number in range(2):
        settings = spec.settings(number)
        assert len(flown_faults(settings)) == 3
        assert settings.nodes["observer"]["link_seed"] == settings.seed


def test_a_missing_file(tmp_path, capsys):
    assert main(["hover", "--faults", str(tmp_path / "no.yaml")]) == 2
    assert "no.yaml" in capsys.readouterr().err


def test_a_bad_entry_of_a_parameter_file_is_refused_before_anything_starts():
    with pytest.raises(ParameterError) as caught:
        resolve(overrides={"plant": {"faults": ("{what: gps, kind: los, start_s: 1.0}",)}})
    refusal = caught.value
    assert refusal.where.split(": ") == ["plant", "faults", "entry 1", "of gps"]
    assert (refusal.cause, refusal.key, refusal.value) == (Cause.CHOICE, "kind", "los")


LOST = """\
faults:
  - {what: delta_lat, kind: stuck, start_s: 1.0, value: [0.3]}
"""


def test_of_many_seeds_the_survivors_are_counted_and_the_lost_can_be_flown_again(tmp_path, capsys):
    file = tmp_path / "stuck.yaml"
    file.write_text(LOST)
    words = ["--seeds", "1..2", "--gps", "rtk", "--duration", "6", "--faults", str(file)]
    assert main(["campaign", *words]) == 1
    printed = capsys.readouterr().out
    assert "rtk: 0 of 2 " in printed
    assert all(f"{100.0 * share:.1f}%" in printed for share in Share(0, 2).interval)
    assert "faults: delta_lat stuck" in printed
    again = next(line for line in printed.splitlines() if line.startswith("again: "))
    assert again.endswith(f"--gps rtk --duration 6.0 --seed 1 --faults {file}")
    assert main(["campaign", *words, "--json"]) == 1
    content = json.loads(capsys.readouterr().out)
    share = content["receivers"]["rtk"]["survived"]
    assert (share["flights"], share["of"]) == (0, 2) and content["faults"][0]["what"] == "delta_lat"
    assert main([*again.split()[2:], "--no-report", "--out", str(tmp_path / "again")]) == 1
    assert "LOST" in capsys.readouterr().out


def test_a_spec_has_faults_in_each_flight(tmp_path, capsys):
    (tmp_path / "stuck.yaml").write_text(LOST)
    spec = tmp_path / "spec.yaml"
    spec.write_text("flights: 2\nduration_s: 6.0\ngps: rtk\nfaults: stuck.yaml\n")
    out = tmp_path / "out"
    assert main(["campaign", str(spec), "--out", str(out), "--workers", "0"]) == 1
    assert "stuck.yaml: 0 of 2 " in capsys.readouterr().out
    other = spec_of(spec).identity
    (tmp_path / "stuck.yaml").write_text(LOST.replace("0.3", "0.2"))
    assert spec_of(spec).identity != other
    spec.write_text(spec.read_text() + "set: {plant.faults: []}\n")
    with pytest.raises(ParameterError, match="faults.*plant.faults"):
        spec_of(spec)


def test_a_campaign_without_faults_tells_no_survivors(tmp_path, capsys):
    assert main(["campaign", "--seeds", "1", "--gps", "rtk", "--duration", "4"]) == 0
    assert "survived" not in capsys.readouterr().out
    assert main(["campaign", "--faults", str(tmp_path / "none.yaml")]) == 2
    assert "none.yaml" in capsys.readouterr().err


@pytest.mark.parametrize("hits", [0, 1, 18, 20])
def test_the_interval_of_a_share_is_scipys(hits):
    interval = stats.binomtest(hits, 20).proportion_ci(0.95, "exact")
    assert Share(hits, 20).interval == pytest.approx((interval.low, interval.high), abs=1e-12)


def test_the_example_is_read():
    assert len(fault_overrides(EXAMPLES / "faults.yaml")["plant"]["faults"]) == 3
