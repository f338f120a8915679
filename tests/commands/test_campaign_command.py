# SPDX-License-Identifier: Apache-2.0
"""`heli campaign SPEC.yaml`: on a scheduler and workers started by hand, killed on the way."""

import contextlib
import errno
import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from heli_flight.cli import app as cli
from heli_studies.campaign.run import ROWS, Store
from heli_studies.campaign.spec import fly_rows, spec_of

FLIGHTS = 24
TEXT = f"""flights: {FLIGHTS}
world: paper
gps: rtk
duration_s: 5.0
chunk: 1
set: {{scenario.score.windows_s: [2.0, -1.0]}}
disperse: {{plant.scale.mass: {{uniform: [0.9, 1.1]}}}}
"""
HELI = [sys.executable, "-m", "heli_flight.start", "heli"]
# How long a failure takes at most; start-up on loaded cores takes a minute.
_LIMIT_S = 280.0


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("spec") / "spec.yaml"
    path.write_text(TEXT)
    return path


@pytest.fixture(scope="module")
def expected(file):
    spec = spec_of(file)
    return fly_rows(spec, range(FLIGHTS))


@pytest.fixture
def started():
    """Processes that end with the test."""
    running = []

    def start(*words, **options):
        running.append(subprocess.Popen([*map(str, words)], **options))
        return running[-1]

    yield start
    for process in running:
        process.kill()
        process.communicate()


@pytest.fixture
def cluster(started, tmp_path):
    """A scheduler, its address, and workers, as `dask scheduler` and `dask worker` start them."""
    scheduler_file, quiet = tmp_path / "scheduler.json", {"stderr": subprocess.DEVNULL}
    dask = [sys.executable, "-m", "distributed.cli.dask_"]
    head = [*dask[:2], f"{dask[2]}scheduler", "--port", 0, "--dashboard-address", "127.0.0.1:0"]
    scheduler = started(*head, "--host", "127.0.0.1", "--scheduler-file", scheduler_file, **quiet)
    until(lambda: scheduler_file.exists() and scheduler_file.stat().st_size, scheduler)
    hand = [
        *dask[:2],
        f"{dask[2]}worker",
        "--scheduler-file",
        scheduler_file,
        "--nthreads",
        1,
        "--no-nanny",
    ]
    workers = [started(*hand, "--no-dashboard", **quiet) for _ in range(2)]
    return scheduler, json.loads(scheduler_file.read_text())["address"], workers


def until(true, process):
    """Wait until something is so; fails at once when the process that brings it about has ended."""
    end = time.monotonic() + _LIMIT_S
    while not true():
        assert time.monotonic() < end
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(0.02)
            raise AssertionError(process.communicate())


def rows_in(folder):
    return list((folder / ROWS).glob("part-*"))


def as_rows(table):
    return [{k: v for k, v in row.items() if v is not None} for row in table.to_pylist()]


def begun(started, file, out, *words):
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "text": True}
    pipes["start_new_session"] = True
    return started(*HELI, "campaign", file, "--out", out, *words, **pipes)


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_whatever_is_killed_nothing_is_lost_or_flown_twice(
    cluster, started, file, expected, tmp_path, capsys
):
    """A worker, then the scheduler, then the campaign itself; the rows are as without all that."""
    scheduler, address, workers = cluster
    out = tmp_path / "out"
    process = begun(started, file, out, "--scheduler", address)
    until(lambda: rows_in(out), process)
    workers[0].kill()
    kept = len(rows_in(out)) + 2
    until(lambda: len(rows_in(out)) > kept, process)
    scheduler.kill()
    _, stderr = process.communicate(timeout=_LIMIT_S)
    assert process.returncode == 2 and "scheduler" in stderr and "--resume" in stderr, stderr
    assert "Traceback" not in stderr
    first = len(rows_in(out))
    process = begun(started, file, out, "--resume", "--workers", 1)
    until(lambda: len(rows_in(out)) > first, process)
    os.killpg(process.pid, signal.SIGINT)  # as Ctrl-C: to the workers, too
    _, stderr = process.communicate(timeout=_LIMIT_S)
    assert process.returncode == 130 and stderr.strip().endswith("interrupted"), stderr
    assert "Traceback" not in stderr
    assert first < len(rows_in(out)) < FLIGHTS
    words = ["campaign", str(file), "--out", str(out), "--resume", "--workers", "0", "--json"]
    assert cli.main(words) in (0, 1)
    printed = json.loads(capsys.readouterr().out)
    assert printed["flights"] == FLIGHTS == len(rows_in(out)), "each flight once"
    assert as_rows(Store(out).table()) == expected


@pytest.mark.parametrize(
    ("words", "fragment"),
    [
        (["--scheduler", "tcp://127.0.0.1:1"], "--scheduler tcp://127.0.0.1:1"),
        (["--scheduler", "nowhere"], "--scheduler nowhere"),
        (["--via", "gazebo"], "--via gazebo; allowed: graph"),
        (["--sample", "3"], "--sample: belongs to --via graph"),
        (["--seeds", "1..3"], "--seeds: belongs to a spec's own keys"),
        (["--workers", "2", "--scheduler", "tcp://127.0.0.1:1"], "one of the two"),
    ],
)
def test_what_cannot_be_done_is_one_line(file, tmp_path, capsys, monkeypatch, words, fragment):
    monkeypatch.setattr("heli_studies.campaign.workers._REACH_S", 1.0)
    assert cli.main(["campaign", str(file), "--out", str(tmp_path / "out"), *words]) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and fragment in lines[0]
    assert not (tmp_path / "out").exists(), "nothing was flown, nothing stays"


def test_a_full_disk_is_one_line_and_what_was_flown_stays(file, tmp_path, capsys, monkeypatch):
    out, put = tmp_path / "out", Store.put

    def full(store, rows):
        if rows[0]["flight"] == 2:
            monkeypatch.setattr("os.fsync", lambda fd: os.write(-1, b""))
        put(store, rows)

    monkeypatch.setattr(Store, "put", full)
    monkeypatch.setattr("os.write", no_space)
    assert cli.main(["campaign", str(file), "--out", str(out), "--workers", "0"]) == 2
    (line,) = [text for text in capsys.readouterr().err.splitlines() if "No space" in text]
    assert "--resume" in line
    assert [row["flight"] for row in as_rows(Store(out).table())] == [0, 1]


def no_space(*_):
    raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))


def test_options_of_a_spec_need_one(tmp_path, capsys):
    assert cli.main(["campaign", "--out", str(tmp_path / "out")]) == 2
    assert "--out: " in capsys.readouterr().err
    assert cli.main(["campaign", str(Path("nowhere.yaml")), "--out", str(tmp_path / "o")]) == 2
    assert "nowhere.yaml" in capsys.readouterr().err


def test_without_a_folder_nothing_flies(file, capsys):
    assert cli.main(["campaign", str(file)]) == 2
    assert "--out: missing" in capsys.readouterr().err
