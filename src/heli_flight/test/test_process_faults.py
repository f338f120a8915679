# SPDX-License-Identifier: Apache-2.0
"""Faults of processes: read, refused, told, flown again; done and undone."""

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from heli_core.rcl_yaml import ParameterError
from heli_flight.cli.app import main
from heli_flight.flight_file import fault_overrides, flown_faults, read_faults, write_parameters
from heli_flight.graph.flight import ProcessFaults
from heli_flight.graph.respawn import MOST, WITHIN_S, DiesAgainError, Respawn
from heli_flight.process_faults import ProcessFault, process_faults_of
from heli_flight.settings import resolve
from heli_msgs_bridge.handover import FOLDER, Restarts

FILE = """\
faults:
  - {what: process, node: observer, kind: kill, start_s: 8.0}
  - {what: gps, kind: loss, start_s: 2.0}
  - {what: process, node: inner_loop, kind: pause, start_s: 12, duration_s: 0.5}
  - {what: process, kind: hog, start_s: 14.0, duration_s: 1.0, value: 2}
"""
KILL, PAUSE, HOG = (
    ProcessFault("process", "kill", 8.0, 0.0, node="observer"),
    ProcessFault("process", "pause", 12.0, 0.5, node="inner_loop"),
    ProcessFault("process", "hog", 14.0, 1.0, (2.0,)),
)


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "faults.yaml"
    path.write_text(FILE)
    return path


def test_one_file_has_faults_of_sensors_and_of_processes(file, tmp_path):
    read = read_faults(file)
    assert process_faults_of(read.process) == (KILL, PAUSE, HOG)
    assert len(read.nodes["plant"]["faults"]) == 1
    over = read.nodes
    settings = resolve(overrides=over, process_faults=read.process)
    assert [fault.words.split()[:2] for fault in flown_faults(settings)] == [
        ["gps", "loss"], ["observer", "kill"], ["inner_loop", "pause"], ["hog", "by"]
    ]  # fmt: skip
    write_parameters(settings, tmp_path / "params.yaml")
    again = resolve(params=[tmp_path / "params.yaml"])
    assert again.process_faults == read.process
    assert again.nodes["plant"]["faults"] == read.nodes["plant"]["faults"]


@pytest.mark.parametrize(
    ("entry", "expected"),
    [
        ("node: observer, kind: kill", "start_s: missing"),
        ("node: observer, kind: kil, start_s: 1", "kil is not allowed: did you mean kill?"),
        ("node: observers, kind: kill, start_s: 1", "did you mean observer?"),
        ("kind: kill, start_s: 1", "node: missing"),
        ("node: plant, kind: pause, start_s: 1", "duration_s: missing"),
        ("node: plant, kind: kill, start_s: 1, duration_s: 2", "duration_s: kill has none"),
        ("kind: hog, node: plant, start_s: 1, duration_s: 2, value: 1", "node: hog has none"),
        ("kind: hog, start_s: 1, duration_s: 2, value: 1.5", "1.5 is not allowed"),
        ("kind: hog, start_s: 1, duration_s: 2, value: 17", "allowed: a number in [1, 16]"),
        ("kind: hog, start_s: .nan, duration_s: 2, value: 1", "start_s: nan is not allowed"),
        ("nodes: observer, kind: kill, start_s: 1", "nodes: unknown key"),
        ("kind: [kill], start_s: 1", "kind: expected one value"),
    ],
)
def test_what_is_wrong_is_one_line_and_exit_code_2(tmp_path, capsys, entry, expected):
    path = tmp_path / "wrong.yaml"
    path.write_text(f"faults:\n  - {{what: process, {entry}}}\n")
    assert main(["hover", "--faults", str(path)]) == 2
    captured = capsys.readouterr().err
    assert f"{path}:2: " in captured and expected in captured and captured.count("\n") == 1


@pytest.mark.parametrize("words", [["--one-process"], ["--composed"], ["--vehicles", "2"]])
def test_where_nodes_have_no_process_of_their_own_they_are_refused(file, capsys, words):
    assert main(["hover", "--faults", str(file), *words]) == 2
    assert "process: " in capsys.readouterr().err
    assert main(["hover", "--respawn", *words]) == 2
    assert words[0] in capsys.readouterr().err
    with pytest.raises(ParameterError, match="process: "):
        fault_overrides(file)


class Stopped:
    """A process that does nothing, as the graph has them."""

    def __init__(self):
        self._process = subprocess.Popen([sys.executable, "-c", "import signal; signal.pause()"])
        self.pid = self._process.pid

    def exit_code(self):
        return self._process.poll()

    def state(self):
        return Path(f"/proc/{self.pid}/stat").read_text().rpartition(")")[2].split()[0]

    def becomes(self, *states):
        while self.state() not in states:
            os.sched_yield()

    def end(self):
        self._process.kill()
        self._process.wait()


@pytest.fixture
def process():
    stopped = Stopped()
    yield stopped
    stopped.end()


def test_a_pause_ends_by_itself_and_with_the_flight(process, tmp_path):
    lines = []
    faults = ProcessFaults([PAUSE], {"inner_loop": process}, tmp_path / "log", lines.append)
    faults.look(11.9)
    assert faults.done == [] and process.state() != "T"
    faults.look(12.01)
    process.becomes("T")
    faults.look(12.4)
    assert process.state() == "T"
    faults.look(12.52)
    process.becomes("S", "R")
    again = ProcessFaults([PAUSE], {"inner_loop": process}, tmp_path / "log", lines.append)
    again.look(13.0)
    process.becomes("T")
    again.undo()
    process.becomes("S", "R")
    assert lines == [f"fault: {PAUSE.words}"] * 2
    assert again.as_dicts()[0]["begun_s"] == 13.0


def test_a_paused_recorder_that_the_flight_waits_for_is_let_out_of_its_lock(process, tmp_path):
    """Nobody waits for a recorder, but who wants what it holds; an inner loop is waited for."""
    now, ran = [0.0], []

    def run(for_s):
        process.becomes("S", "R")
        ran.append(for_s)

    for node in ("recorder", "inner_loop"):
        there, pause = {node: process}, replace(PAUSE, node=node)
        faults = ProcessFaults(
            [pause], there, tmp_path / "log", print, now_s=lambda: now[0], wait=run
        )
        for flight_s, after_s in [(12.0, 0.0), (12.1, 5.0), (12.1, 0.9), (12.1, 0.2), (12.1, 0.9)]:
            now[0] += after_s
            faults.look(flight_s)
            process.becomes("T")
        faults.undo()
        process.becomes("S", "R")
    assert ran == [0.02]


def test_a_kill_kills(process, tmp_path):
    faults = ProcessFaults([KILL], {"observer": process}, tmp_path / "log", print)
    faults.look(8.0)
    assert process._process.wait() == -signal.SIGKILL


def test_a_second_kill_waits_for_the_successor_of_the_first(process, tmp_path):
    """In lockstep half a second of flight may pass between two looks."""
    kills = [replace(KILL, start_s=start_s) for start_s in (8.0, 8.5)]
    there = {"observer": process}
    faults = ProcessFaults(kills, there, tmp_path / "log", print)
    faults.look(9.0)
    assert len(faults.done) == 1
    process._process.wait()
    faults.look(9.1)
    assert len(faults.done) == 1
    there["observer"] = successor = Stopped()
    faults.look(9.2)
    assert successor._process.wait() == -signal.SIGKILL
    assert [at_s for _, at_s in faults.done] == [9.0, 9.2]


class Up:
    """What is asked of the supervisor."""

    def __init__(self):
        self.statuses, self.announced, self.forgotten = {}, [], []
        self.forget, self.now_s = self.forgotten.append, 7.5

    def flight_s(self):
        return self.now_s

    def announce(self, level, message, facts):
        self.announced.append((message, facts))


class Spare:
    process = None

    def become(self, name, log):
        return name, log.name


def test_a_node_that_dies_again_and_again_ends_the_flight(tmp_path, monkeypatch):
    up = Up()
    respawn = Respawn(tmp_path, lambda line: None)
    monkeypatch.setenv(FOLDER, respawn.environment()[FOLDER])
    known, respawn._make = [], Spare
    # Before the successor exists it is known to all nodes that one comes.
    restarts, become = Restarts(), Spare.become
    monkeypatch.setattr(
        Spare, "become", lambda *it: known.append(dict(restarts.news())) or become(*it)
    )
    respawn._standby = Spare()
    for _ in range(MOST):
        # Spread out it may die as often as it likes.
        assert respawn.again("observer", "observer: killed", up) == ("observer", "observer.log")
        up.now_s += WITHIN_S
    for _ in range(MOST - 1):
        respawn.again("inner_loop", "inner_loop: killed", up)
    with pytest.raises(DiesAgainError) as error:
        respawn.again("inner_loop", "inner_loop: killed", up)
    assert (error.value.node, error.value.why) == ("inner_loop", "inner_loop: killed")
    first = respawn.restarts[0]
    assert (first.node, first.why, first.noticed_s) == ("observer", "observer: killed", 7.5)
    assert first.why in up.announced[0][0] and up.announced[0][1] == {}
    assert known[:MOST] == [{"observer": times + 1} for times in range(MOST)]
    assert known[-1] == {"observer": MOST, "inner_loop": MOST - 1}
