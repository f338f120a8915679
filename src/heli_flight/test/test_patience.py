# SPDX-License-Identifier: Apache-2.0
"""A command that takes long says what it is at, to people at a terminal alone."""

import time

import pytest

from heli_flight import terminal


@pytest.mark.parametrize("at_terminal", [True, False])
def test_only_a_terminal_is_told(monkeypatch, at_terminal):
    told = []
    monkeypatch.setattr(terminal, "told_when_long", lambda what, quiet: told.append((what, quiet)))
    seen = terminal.Console(force_terminal=at_terminal)
    monkeypatch.setattr(terminal, "console", lambda stderr: seen)
    terminal.told_at_terminal("heli score")
    assert told == [("heli score", not at_terminal)]


def test_each_step_is_said_once_it_is_long(capsys):
    with terminal.told_when_long("heli score", after_s=0.0) as tell:
        tell("reads")
        while "reads" not in capsys.readouterr().err:
            time.sleep(0.01)
        tell("draws")
        assert "draws" in capsys.readouterr().err
