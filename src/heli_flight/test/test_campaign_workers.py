# SPDX-License-Identifier: Apache-2.0
"""Who flies a campaign: processes that are killed, that cannot start, that others cannot reach."""

import contextlib
import multiprocessing
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest
from distributed import KilledWorker, LocalCluster, Security

from heli_core.errors import FlightError
from heli_core.rcl_yaml import ParameterError
from heli_studies.campaign.spec import FlightEnding, fly_rows, spec_of
from heli_studies.campaign.workers import Processes, flier, tasks
from support.deadly_flights import DeadlyFlights

dask = pytest.importorskip("dask")  # comes with distributed
TEXT = """flights: 7
world: paper
gps: rtk
duration_s: 2.0
chunk: 3
set: {scenario.score.windows_s: [0.0, -1.0]}
disperse:
  plant.scale.mass: {uniform: [0.9, 1.1]}
"""


@pytest.fixture
def spec(tmp_path):
    path = tmp_path / "spec.yaml"
    path.write_text(TEXT)
    return spec_of(path)


def flown(batch, todo, workers=0, scheduler=None):
    """Rows by number."""
    with flier(workers, scheduler) as fly:
        rows = [row for part in fly(batch, todo) for row in part]
    return sorted(rows, key=lambda row: row["flight"])


def test_processes_fly_the_same_rows_as_this_one(spec):
    todo = tasks(spec, set())
    assert flown(spec, todo, workers=2) == flown(spec, todo) == fly_rows(spec, range(7))


def test_processes_that_are_killed_lose_nothing(tmp_path):
    """What was in one task with a deadly flight flies on without it."""
    batch = DeadlyFlights(tmp_path, deadly=frozenset({1}), once=frozenset({4}))
    rows = flown(batch, tasks(batch, set()), workers=2)
    assert [row["flight"] for row in rows] == list(range(7))
    causes = [row["cause"] for row in rows]
    assert causes.pop(1) == FlightEnding.KILLED and set(causes) == {FlightEnding.FLOWN}
    assert batch.times(1) == 3, "with others, then twice alone"
    assert [batch.times(number) for number in (0, 2, 3, 4, 5, 6)] == [2, 1, 2, 2, 1, 1]


def test_processes_stay_for_all_batches(tmp_path):
    first, second = (DeadlyFlights(tmp_path / name, chunk=1) for name in "ab")
    for batch in (first, second):
        batch.folder.mkdir()
    with Processes(1) as processes:
        flew = {
            row["process"]
            for batch in (first, second, first)
            for rows in processes.fly(batch, tasks(batch, set()))
            for row in rows
        }
        assert flew == {process.pid for process in multiprocessing.active_children()}
    assert [second.times(number) for number in range(7)] == [1] * 7


def test_the_error_of_a_flight_comes_as_it_is_or_named(tmp_path):
    batch = DeadlyFlights(tmp_path, refused=frozenset({2}), unsendable=frozenset({3}))
    with pytest.raises(ParameterError, match="flight 2"):
        flown(batch, [[0, 2]], workers=1)
    with pytest.raises(FlightError, match="Unsendable: flight 3"):
        flown(batch, [[3]], workers=1)


UNGUARDED = """
from pathlib import Path

from heli_core.errors import StartError
from heli_studies.campaign.spec import spec_of
from heli_studies.campaign.workers import flier

try:
    with flier(1) as fly:
        list(fly(spec_of(Path("spec.yaml")), [[0]]))
except StartError:
    print("does not start")
"""


@pytest.mark.slow
def test_a_script_that_runs_itself_again_in_its_workers_ends(spec, tmp_path):
    """Not for ever: spawn runs a script that has no guard once more in each process."""
    (tmp_path / "script.py").write_text(UNGUARDED)
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout == "does not start\n"


FLYING = """
import sys
from pathlib import Path

from support.deadly_flights import DeadlyFlights

from heli_flight import interrupts
from heli_studies.campaign.workers import Processes, tasks

def main():
    batch = DeadlyFlights(Path("flights"), waits=True)
    with Processes(2) as processes:
        list(processes.fly(batch, tasks(batch, set())))

if __name__ == "__main__":
    sys.exit(interrupts.run(lambda: main))
"""
TESTS = Path(__file__).resolve().parents[3] / "tests"


@pytest.fixture
def campaign(tmp_path):
    """A campaign under way in a process group of its own, and the processes that it has started."""
    (tmp_path / "script.py").write_text(FLYING)
    for name in ("flights", "temporary"):
        (tmp_path / name).mkdir()
    env = os.environ | {"PYTHONPATH": str(TESTS), "TMPDIR": str(tmp_path / "temporary")}
    with subprocess.Popen(
        [sys.executable, "script.py"], cwd=tmp_path, env=env, text=True, stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:  # fmt: skip
        end = time.monotonic() + 280.0
        while len(list((tmp_path / "flights").glob("waits_*"))) < 2:
            assert process.poll() is None and time.monotonic() < end
            time.sleep(0.02)
        started = psutil.Process(process.pid).children(recursive=True)
        yield process, started
        for one in started:
            with contextlib.suppress(psutil.NoSuchProcess):
                one.kill()
        process.kill()


@pytest.mark.parametrize(
    "number",
    [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.slow), signal.SIGKILL],
)
def test_its_processes_are_out_of_reach_and_end_with_it_however_that_ends(
    campaign, tmp_path, number
):
    """Whoever can reach one runs code as its owner: no socket of any kind has an address."""
    process, started = campaign
    assert len(started) >= 2
    for one in (psutil.Process(process.pid), *started):
        addresses = [(s.family, s.laddr) for s in one.net_connections(kind="all") if s.laddr]
        assert not addresses, one.cmdline()
    # Ctrl-C goes to all of a terminal.
    (os.killpg if number == signal.SIGINT else os.kill)(process.pid, number)
    _, stderr = process.communicate(timeout=280.0)
    _, alive = psutil.wait_procs(started, timeout=280.0)
    assert not alive
    if number == signal.SIGINT:
        assert (process.returncode, stderr) == (130, "interrupted\n")
        assert list((tmp_path / "temporary").iterdir()) == []
    else:
        assert (process.returncode, stderr) == (-number, ""), "nothing of theirs has leaked"


def test_other_versions_are_refused_and_a_task_that_kills_is_a_row(spec, tmp_path, monkeypatch):
    """In this process: a scheduler and a worker in threads of it."""

    def sources():
        return "ours" if threading.current_thread() is threading.main_thread() else "theirs"

    monkeypatch.setattr("heli_studies.campaign.workers.sources_commit", sources)
    with LocalCluster(n_workers=1, processes=False, dashboard_address="127.0.0.1:0") as local:
        with pytest.raises(ParameterError, match=r"\btheirs\b.*\bours\b"):
            flown(spec, [[0]], scheduler=local.scheduler_address)
        monkeypatch.setattr("heli_studies.campaign.workers.sources_commit", lambda: "one")
        died = tmp_path / "died"

        def fly(_, numbers):
            if 1 in numbers:
                with died.open("a") as file:
                    print(numbers, file=file)
                raise KilledWorker("task", SimpleNamespace(address="here"), 3)
            return "one", [{"flight": number} for number in numbers]

        monkeypatch.setattr("heli_studies.campaign.workers._fly", fly)
        rows = flown(spec, [[0, 1, 2], [3]], scheduler=local.scheduler_address)
    assert [row["flight"] for row in rows] == [0, 1, 2, 3]
    assert died.read_text().splitlines() == ["[0, 1, 2]", "[1]"], "alone, then given up"
    assert rows[1]["cause"] == FlightEnding.KILLED and rows[1]["exit_code"] == 1
    assert rows[1]["in.plant.scale.mass"] == spec.inputs[1][0]


@pytest.fixture
def certificate(tmp_path):
    """A key and its certificate, which is its own authority, as Dask's configuration names them."""
    key, own = tmp_path / "key.pem", tmp_path / "own.pem"
    words = ["openssl", "req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256"]
    words += ["-nodes", "-days", "2", "-subj", "/CN=campaign", "-keyout", key, "-out", own]
    subprocess.run(words, check=True, capture_output=True)
    return {f"distributed.comm.tls.{who}.{what}": str(path)
            for who in ("client", "scheduler", "worker")
            for what, path in (("key", key), ("cert", own))} | {
        "distributed.comm.tls.ca-file": str(own)}  # fmt: skip


@pytest.mark.skipif(shutil.which("openssl") is None, reason="makes the certificate")
def test_a_scheduler_on_tls_takes_who_has_a_certificate(certificate, tmp_path):
    batch = DeadlyFlights(tmp_path)
    with dask.config.set(certificate):
        security = Security()
        how = {"processes": False, "dashboard_address": "127.0.0.1:0", "protocol": "tls://"}
        with LocalCluster(n_workers=1, security=security, **how) as local:
            assert local.scheduler_address.startswith("tls://127.0.0.1:")
            rows = flown(batch, [[0, 1], [2]], scheduler=local.scheduler_address)
            assert [row["flight"] for row in rows] == [0, 1, 2]
            with dask.config.set(dict.fromkeys(certificate)), pytest.raises(ParameterError):
                flown(batch, [[3]], scheduler=local.scheduler_address)
    assert batch.times(3) == 0
