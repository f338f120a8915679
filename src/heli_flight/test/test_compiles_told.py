# SPDX-License-Identifier: Apache-2.0
"""Who flies in one process is told if the loop has to be compiled first, and only then."""

import threading
from types import SimpleNamespace

import pytest

import heli
from heli_flight import fly as compiles
from heli_flight.cli import app as cli
from heli_flight.loop import fly_ticks

COMPILES = "heli: compiles the loop for this machine"


class Uncompiled:
    """Stands for the loop before this process has called it."""

    signatures = ()
    __call__ = staticmethod(fly_ticks)


@pytest.fixture
def cold(monkeypatch):
    """As in a process that begins, on a machine that has never flown in one process."""

    def begin():
        monkeypatch.setattr("heli_flight.loop.fly_ticks", Uncompiled())
        monkeypatch.setattr(compiles, "is_compiled", lambda kernel: False)

    return begin


def words(tmp_path):
    flight = ["--duration", "2"]
    return {
        "hover": ["hover", "--one-process", "--no-report", "--out", str(tmp_path / "f"), *flight],
        "campaign": ["campaign", "--seeds", "1", "--gps", "rtk", *flight],
        "attitude": [
            "compare",
            "attitude",
            "--seeds",
            "1",
            "--attitude-controller",
            "hinf",
            *flight,
        ],
        "worlds": ["compare", "worlds", "--seeds", "1", "--worlds", "paper", *flight],
    }


@pytest.mark.parametrize("name", ["hover", "campaign", "attitude", "worlds"])
def test_a_command_says_it_once_before_it_flies(name, tmp_path, cold, capsys):
    cli.main(words(tmp_path)[name])
    assert COMPILES not in "".join(capsys.readouterr())
    cold()
    cli.main(words(tmp_path / "again")[name])
    assert "".join(capsys.readouterr()).count(COMPILES) == 1


def test_python_says_it_unless_it_is_quiet(cold, capsys):
    cold()
    for call in (heli.fly, lambda **options: heli.campaign(seeds=[1], **options)):
        call(duration_s=2)
        assert capsys.readouterr().err.count(COMPILES) >= 1
        call(duration_s=2, quiet=True)
        assert COMPILES not in capsys.readouterr().err


def test_a_flight_through_the_graph_says_that_its_nodes_are_compiled(cold):
    lines = []
    out = SimpleNamespace(print=lambda line, **how: lines.append(line))
    compiles.tell_what_slows_nodes(out)
    assert lines == []
    cold()
    compiles.tell_what_slows_nodes(out)
    assert lines == [compiles.NODES_COMPILE]


def test_it_is_said_again_until_the_flight_has_begun(monkeypatch):
    """Without a cache that can be written it takes minutes; nobody is left without a word."""
    monkeypatch.setattr(compiles, "STILL_S", 1e-3)
    lines, thrice = [], threading.Event()

    def heard(line, **how):
        lines.append(line)
        if len(lines) == 3:
            thrice.set()

    out = SimpleNamespace(print=heard)
    with compiles.still_compiling(out, True) as flies:
        assert thrice.wait(60.0)
        flies()
    count = len(lines)
    assert all(line.startswith("heli: still compiling, ") for line in lines)
    with compiles.still_compiling(out, False):
        assert len(lines) == count
