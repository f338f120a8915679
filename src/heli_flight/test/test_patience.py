# SPDX-License-Identifier: Apache-2.0
"""A command that takes long says what it is at, to people at a terminal alone."""

from functools import partial

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


def test_each_step_is_said_once_it_is_long(monkeypatch, capsys):
    begin = []

    class Kept:
        def __init__(self, after_s, call):
            self.start, self.cancel = partial(begin.append, call), lambda: None

    monkeypatch.setattr(terminal.threading, "Timer", Kept)
    with terminal.told_when_long("heli score") as tell:
        tell("reads")
        assert capsys.readouterr().err == ""
        begin[0]()
        assert "reads" in capsys.readouterr().err
        tell("draws")
        assert "draws" in capsys.readouterr().err
