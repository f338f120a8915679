# SPDX-License-Identifier: Apache-2.0
"""A campaign's rows: each flight has one, whatever it does; nothing is flown twice or lost."""

import errno
import json
import os
import re
from pathlib import Path

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from heli_core.errors import ParameterCause
from heli_core.rcl_yaml import ParameterError
from heli_flight.cli import app as cli
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_studies.campaign import run
from heli_studies.campaign import spec as rows
from heli_studies.campaign.run import (
    ABOUT_NAME,
    ROWS,
    SPEC_NAME,
    FolderInUseError,
    Store,
    about_of,
    fly_seeds,
    summary_of,
)
from heli_studies.campaign.spec import FlightEnding, fly_rows, spec_of, write_rerun_files
from heli_studies.campaign.workers import fly_here, tasks
from support.record_bag import rows_of

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


def cut_after(time_s):
    """Flights whose record ends there."""

    def fly(settings):
        flight = simulate(settings)
        return flight._replace(record=rows_of(flight.record, flight.record.time_s < time_s))

    return fly


def test_of_a_flight_that_was_recorded_in_part_the_row_says_how_much(spec, monkeypatch):
    (whole,) = fly_rows(spec, [0])
    assert (whole["coverage"], whole["exit_code"]) == (1.0, 0)
    monkeypatch.setattr(rows, "simulate", cut_after(5.0))
    (row,) = fly_rows(spec, [0])
    assert (row["cause"], row["exit_code"]) == (FlightEnding.PARTIAL, 1)
    assert row["coverage"] == pytest.approx(0.75) and row["sentence"]
    assert not [name for name in row if name.startswith("max")]


def test_so_does_a_flight_of_a_seed(monkeypatch):
    settings = resolve(None, "rtk", 1, 6.0, world="paper")
    monkeypatch.setattr(run, "simulate", cut_after(5.5))
    (flown,) = fly_seeds(settings, [1])
    assert flown.exit_code("rtk") == 1
    assert flown.figures.covered("rtk").share == pytest.approx(0.5)
    assert [run.inside_of([flown], "rtk", stretch) for stretch in run.STRETCHES] == [0, 0]
    (place,) = run.seeds_as_dict({"rtk": [flown]}, {"rtk": settings}).values()
    assert place["flights"][0]["coverage"] == pytest.approx(0.5)
    assert any(flown.figures.covered("rtk").sentence in line
               for line in run.remarks({"rtk": [flown]}, "hover"))  # fmt: skip


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


def test_two_campaigns_do_not_fly_into_one_folder(spec, file, tmp_path, capsys):
    store = Store.begin(tmp_path / "out", spec, file)
    words = ["campaign", str(file), "--out", str(store.folder), "--resume", "--workers", "0"]
    with store.held():
        with pytest.raises(FolderInUseError), Store.resume(store.folder, spec).held():
            pytest.fail("two hold it")
        before = sorted(store.folder.rglob("*"))
        assert cli.main(words) == 2
        assert len(capsys.readouterr().err.splitlines()) == 1
        assert sorted(store.folder.rglob("*")) == before
    assert cli.main(words) in (0, 1)
    assert store.table().num_rows == 7


@pytest.mark.parametrize("kind", ["fifo", "link", "folder"])
def test_what_is_no_file_in_the_place_of_the_lock_is_refused(spec, file, tmp_path, kind):
    store = Store.begin(tmp_path / "out", spec, file)
    lock, elsewhere = store.folder / "lock", tmp_path / "elsewhere"
    {"fifo": os.mkfifo, "link": lambda p: p.symlink_to(elsewhere), "folder": Path.mkdir}[kind](lock)
    with pytest.raises(ParameterError) as refused, store.held():
        pytest.fail("held")
    assert refused.value.cause == ParameterCause.UNREADABLE and not elsewhere.exists()


def changed(part, change):
    """A file's rows with a column changed."""
    table = pq.read_table(part)
    rows = table.to_pylist()
    pq.write_table(pa.Table.from_pylist(change(rows)), part)


def columns(**values):
    return lambda rows: [row | values for row in rows]


DAMAGE = {
    "cut off": lambda part: part.write_bytes(part.read_bytes()[:-9]),
    "no parquet": lambda part: part.write_bytes(b"PAR1 and no more"),
    "a folder": lambda part: (part.unlink(), part.mkdir()),
    "a fifo": lambda part: (part.unlink(), os.mkfifo(part)),
    "a link": lambda part: (part.rename(part.with_name("x")), part.symlink_to("x")),
    "no number": lambda part: changed(part, lambda rows: [{"cause": "flown"}]),
    "words for a number": lambda part: changed(part, columns(flight="3")),
    "no number in one": lambda part: changed(part, lambda rows: [rows[0] | {"flight": None}]),
    "beyond all": lambda part: changed(part, columns(flight=7)),
    "below all": lambda part: changed(part, columns(flight=-1)),
    "of another file": lambda part: changed(part, columns(flight=1)),
    "one twice": lambda part: changed(part, lambda rows: rows[:1] * 2),
    "an unknown cause": lambda part: changed(part, columns(cause="\x1b[2J")),
    "a code in words": lambda part: changed(part, columns(exit_code="no")),
    "words for a figure": lambda part: changed(part, columns(**{"max.v_x (truth)": "x"})),
    "words for an input": lambda part: changed(part, columns(**{"in.plant.scale.mass": "x"})),
    "no input": lambda part: changed(part, columns(**{"in.plant.scale.mass": None})),
    "another input": lambda part: changed(part, columns(**{"in.plant.scale.inertia": 1.0})),
    "a list": lambda part: changed(part, columns(**{"in.plant.scale.mass": [1.0]})),
}


@pytest.fixture(scope="module")
def all_rows(tmp_path_factory):
    path = tmp_path_factory.mktemp("rows") / "spec.yaml"
    path.write_text(TEXT)
    return fly_rows(spec_of(path), range(7))


@pytest.mark.parametrize("kind", DAMAGE)
def test_a_damaged_file_of_rows_is_named_and_flown_again(spec, file, all_rows, tmp_path, kind):
    store = Store.begin(tmp_path / "out", spec, file)
    for first in (0, 3, 6):
        store.put(all_rows[first : first + 3])
    whole, part = store.table(), store.folder / ROWS / "part-00000003.parquet"
    DAMAGE[kind](part)
    again = Store.resume(store.folder, spec)
    assert again.damaged() == [part]
    assert again.table()["flight"].to_pylist() == [0, 1, 2, 6]
    assert tasks(spec, again.done()) == [[3, 4, 5]]
    if kind == "a folder":
        with pytest.raises(ParameterError):
            again.put(all_rows[3:6])
        return
    assert again.damaged() == []
    again.put(all_rows[3:6])
    assert again.table().equals(whole)


def test_a_damaged_description_is_named(spec, file, tmp_path):
    """Key by key, and what is no JSON or no file; nothing is read for ever."""
    store = Store.begin(tmp_path / "out", spec, file)
    path = store.folder / ABOUT_NAME
    about = json.loads(path.read_text())
    broken = [{k: v for k, v in about.items() if k != key} for key in about]
    broken += [about | {key: 1.5} for key in about] + [about | {"flights": -3}]
    broken += [about | {"flown": {**about["flown"], key: [1]}} for key in about["flown"]]
    broken += [about | {"flown": {**about["flown"], key: "x"}} for key in ("kind", "gps")]
    broken += [about | {"disperse": {"plant.scale.mass": 1}}, [about], None]
    for content in broken:
        path.write_text(json.dumps(content))
        with pytest.raises(ParameterError) as refused:
            about_of(store.folder)
        assert refused.value.cause == ParameterCause.TYPE, content
    for raw in (b"", b"{", b"\xff", b"[" * 100_000, b"{}" * 10):
        path.write_bytes(raw)
        with pytest.raises(ParameterError) as refused:
            about_of(store.folder)
        assert refused.value.cause == ParameterCause.SYNTAX
    for make in (os.mkfifo, Path.mkdir, lambda path: path.symlink_to("/dev/zero")):
        path.unlink() if path.exists() and not path.is_dir() else None
        path.rmdir() if path.is_dir() else None
        make(path)
        with pytest.raises(ParameterError) as refused:
            about_of(store.folder)
        assert refused.value.cause == ParameterCause.UNREADABLE


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
    summary = summary_of(store.table(), {"kind": "hover", "gps": "rtk"})
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
