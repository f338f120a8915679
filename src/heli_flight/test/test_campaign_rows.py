# SPDX-License-Identifier: Apache-2.0
"""A campaign's rows: each flight has one, whatever it does; nothing is flown twice or lost."""

import errno
import json
import os
import re

import pyarrow.parquet as pq
import pytest

from heli_core.rcl_yaml import ParameterError
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_studies.campaign import spec as rows
from heli_studies.campaign.run import (
    ABOUT_NAME,
    ROWS,
    SPEC_NAME,
    Store,
    summary_of,
)
from heli_studies.campaign.spec import FlightEnding, fly_rows, spec_of, write_rerun_files
from heli_studies.campaign.workers import fly_here, tasks

TEXT = """flights: 7
world: paper
gps: rtk
duration_s: 6.0
chunk: 3
set: {scenario.score.windows_s: [2.0, -1.0]}
disperse:
  plant.scale.mass: {uniform: [0.9, 1.1]}
  aircraft.main_rotor.hub_stiffness_nmprad: {uniform: [100.0, 130.0]}
"""


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "spec.yaml"
    path.write_text(TEXT)
    return path


@pytest.fixture
def spec(file):
    return spec_of(file)


def test_a_row_is_the_flight_that_its_inputs_say(spec):
    (row,) = fly_rows(spec, [4])
    assert row["cause"] == "flown" and row["flight"] == 4 and row["seed"] == 5
    values = {key: row[f"in.{key}"] for key in spec.names}
    assert list(values.values()) == spec.inputs[4]
    alone = fly_rows(spec, [4])
    assert alone == [row]
    other = resolve(None, "rtk", 5, 6.0, world="paper",
                    overrides={"plant": {"scale.mass": values["plant.scale.mass"]}})  # fmt: skip
    truth = simulate(other).record.truth_pos_ned_m
    assert row["max.altitude (truth)"] > 0.0 and len(truth) == 600


@pytest.mark.parametrize(
    ("error", "cause"),
    [
        (ParameterError("said"), FlightEnding.REFUSED),
        (ZeroDivisionError("said"), FlightEnding.THREW),
        (MemoryError("said"), FlightEnding.THREW),
    ],
)
def test_a_flight_that_throws_is_a_row_and_the_next_one_flies(spec, monkeypatch, error, cause):
    def fly(settings):
        if settings.seed == 2:
            raise error
        return simulate(settings)

    monkeypatch.setattr(rows, "simulate", fly)
    first, second, third = fly_rows(spec, [0, 1, 2])
    assert (first["cause"], third["cause"]) == ("flown", "flown")
    assert second["cause"] == cause and "said" in second["sentence"] and second["exit_code"] == 1
    assert second["in.plant.scale.mass"] == spec.inputs[1][0]


def test_what_cannot_hover_or_falls_is_a_row(tmp_path):
    file = tmp_path / "spec.yaml"
    file.write_text(
        "sampling: grid\nlevels: 2\nworld: paper\nduration_s: 20.0\nflight_seeds: 1\ndisperse:\n"
        "  plant.scale.mass: {uniform: [1.0, 4.9]}\n  plant.delay_ticks: {choice: [1, 50]}\n"
    )
    flown = fly_rows(spec_of(file), range(4))
    assert [row["cause"] for row in flown] == [
        FlightEnding.FLOWN, FlightEnding.LOST, FlightEnding.NO_TRIM, FlightEnding.NO_TRIM,
    ]  # fmt: skip
    assert all(row["sentence"] for row in flown[1:])
    assert "max.altitude (truth)" not in flown[1]


def test_rows_are_the_same_however_they_are_cut(spec, file, tmp_path):
    tables = []
    for name, cut in (("a", tasks(spec, set())), ("b", [[0, 1], [2, 3, 4, 5, 6]])):
        store = Store.begin(tmp_path / name, spec, file)
        for flown in fly_here(spec, cut):
            store.put(flown)
        tables.append(store.table())
    assert tables[0].equals(tables[1]) and tables[0].num_rows == 7


def test_only_what_is_missing_is_flown_again(spec, file, tmp_path):
    store = Store.begin(tmp_path / "out", spec, file)
    assert tasks(spec, set()) == [[0, 1, 2], [3, 4, 5], [6]]
    for flown in fly_here(spec, [[0, 1, 2], [6]]):
        store.put(flown)
    parts = sorted((tmp_path / "out" / ROWS).iterdir())
    parts[1].write_bytes(parts[1].read_bytes()[:50])
    again = Store.resume(tmp_path / "out", spec)
    assert tasks(spec, again.done()) == [[3, 4, 5], [6]], "the broken file's flight, too"
    for flown in fly_here(spec, tasks(spec, again.done())):
        again.put(flown)
    assert again.table()["flight"].to_pylist() == list(range(7))


def test_a_folder_of_another_campaign_is_refused(spec, file, tmp_path):
    Store.begin(tmp_path / "out", spec, file)
    with pytest.raises(ParameterError, match="exists already; --resume"):
        Store.begin(tmp_path / "out", spec, file)
    file.write_text(TEXT.replace("1.1", "1.2"))
    with pytest.raises(ParameterError, match=re.escape(str(tmp_path / "out" / SPEC_NAME))):
        Store.resume(tmp_path / "out", spec_of(file))
    with pytest.raises(ParameterError, match=ABOUT_NAME):
        Store.resume(tmp_path / "nowhere", spec)
    about = tmp_path / "out" / ABOUT_NAME
    about.write_text(json.dumps({**json.loads(about.read_text()), "commit": "0" * 40}))
    with pytest.raises(ParameterError, match="0" * 40):
        Store.resume(tmp_path / "out", spec)


def test_a_full_disk_leaves_what_was_kept(spec, file, tmp_path, monkeypatch):
    store = Store.begin(tmp_path / "out", spec, file)
    (flown,) = fly_here(spec, [[0]])
    store.put(flown)

    def full(fd):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr("os.fsync", full)
    with pytest.raises(ParameterError, match=f"{os.strerror(errno.ENOSPC)}.*--resume"):
        store.put([{**flown[0], "flight": 1}])
    assert store.table()["flight"].to_pylist() == [0]
    assert len(list((tmp_path / "out" / ROWS).iterdir())) == 1


def test_a_summary_names_the_lost_first_and_how_sure_it_is(spec, file, tmp_path):
    store = Store.begin(tmp_path / "out", spec, file)
    (good, other) = fly_rows(spec, [0, 1])
    lost = {k: v for k, v in other.items() if not k.startswith("max")}
    lost |= {"cause": "lost", "sentence": "It fell.", "exit_code": 1}
    store.put([{**good, "exit_code": 1}, lost])
    summary = summary_of(store.table(), "rtk")
    assert summary.causes == {"flown": 1, "lost": 1} and summary.worst == [1, 0]
    assert summary.interval[0] == pytest.approx(0.1581, abs=1e-3), "2 of 2: 0.025 ** (1/2)"
    worst = summary.quantiles["altitude (truth)"]
    assert worst == [good["max.altitude (truth)"]] * 4


def test_a_flight_of_a_campaign_is_flown_again_alone(spec, tmp_path):
    (row,) = fly_rows(spec, [2])
    (path,) = write_rerun_files(spec, [2], tmp_path / "worst")
    settings = resolve(params=[path])
    assert settings.seed == row["seed"]
    flight = simulate(settings)
    scores = {s.name: s.max for s in rows.score(flight.record, settings.scenario).windows}
    assert scores == {k[4:]: v for k, v in row.items() if k.startswith("max.")}


def test_an_aircraft_that_is_refused_is_a_row(tmp_path):
    file = tmp_path / "spec.yaml"
    file.write_text("flights: 1\ndisperse: {aircraft.body.mass_kg: {choice: [-1.0]}}\n")
    (row,) = fly_rows(spec_of(file), [0])
    assert row["cause"] == "parameters refused" and "mass_kg" in row["sentence"]


def test_parameters_that_are_refused_leave_no_folder(spec, tmp_path, monkeypatch):
    settings_of = rows.settings_of

    def refuse(spec, number, folder):
        settings_of(spec, number, folder)
        raise ParameterError("no")

    monkeypatch.setattr("heli_studies.campaign.spec.settings_of", refuse)
    assert write_rerun_files(spec, [0], tmp_path / "worst") == []
    assert list((tmp_path / "worst").iterdir()) == []


def test_rows_can_be_read_by_anybody(spec, file, tmp_path):
    store = Store.begin(tmp_path / "out", spec, file)
    store.put(fly_rows(spec, [0]))
    (part,) = (tmp_path / "out" / ROWS).iterdir()
    kinds = {field.name: str(field.type) for field in pq.read_schema(part)}
    assert kinds["flight"] == "int64" and kinds["in.plant.scale.mass"] == "double"
    assert kinds["cause"] == "string" and kinds["max.altitude (truth)"] == "double"
