# SPDX-License-Identifier: Apache-2.0
"""A command that has sub-commands beside arguments of its own."""

from pathlib import Path
from typing import Annotated

import pytest
import typer

from heli_flight.cli.common import SETTINGS, CommandWithWords, run

calls = []


def made():
    """`top fly [SPEC] [--seeds S]`, `top fly report DIR`."""
    top = typer.Typer(rich_markup_mode=None)
    fly = typer.Typer(cls=CommandWithWords, rich_markup_mode=None, **SETTINGS)

    @fly.callback()
    def fly_itself(context: typer.Context, spec: Annotated[Path | None, typer.Argument()] = None,
            seeds: str = "1..20") -> int:  # fmt: skip
        """Fly."""
        if context.invoked_subcommand:
            return 0
        calls.append(("own", spec and str(spec), seeds))
        return 1

    @fly.command()
    def report(folder: Path, seeds: str = "") -> int:
        """Tell."""
        calls.append(("report", str(folder), seeds))
        return 3

    top.command("other")(lambda: 0)
    top.add_typer(fly, name="fly")
    return top


def asked(words):
    calls.clear()
    return run(made(), words.split(), "top")


@pytest.mark.parametrize(
    ("words", "code", "called"),
    [
        ("fly", 1, ("own", None, "1..20")),
        ("fly a.yaml", 1, ("own", "a.yaml", "1..20")),
        ("fly --seeds 3 a.yaml", 1, ("own", "a.yaml", "3")),
        ("fly a.yaml --seeds 3", 1, ("own", "a.yaml", "3")),
        ("fly report out", 3, ("report", "out", "")),
        ("fly report out --seeds 3", 3, ("report", "out", "3")),
        ("fly -- report", 1, ("own", "report", "1..20")),
        ("fly --seeds report report", 1, ("own", "report", "report")),
    ],
)
def test_the_first_word_decides_who_is_called(words, code, called):
    assert asked(words) == code
    assert calls == [called]


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        ("fly reprot out", "'reprot'. Did you mean 'report'?"),
        ("fly a.yaml b.yaml", "unexpected extra argument"),
        ("fly --sead 3", "--sead"),
        ("fly report", "FOLDER"),
        ("fly report out --sead 3", "--sead"),
    ],
)
def test_what_nobody_knows_is_one_line(words, sentence, capsys):
    assert asked(words) == 2
    lines = capsys.readouterr().err.strip().splitlines()
    assert len(lines) == 1 and sentence.lower() in lines[0].lower() and not calls


def test_help_shows_options_and_commands(capsys):
    assert asked("fly --help") == 0
    shown = capsys.readouterr().out
    usage = next(line for line in shown.splitlines() if "[OPTIONS]" in line)
    assert usage.split()[-4:] == ["top", "fly", "[OPTIONS]", "[spec]"]
    assert "--seeds" in shown and "  report  Tell." in shown
    assert asked("fly report --help") == 0
    assert "[OPTIONS] {folder}" in capsys.readouterr().out


def test_a_file_with_nearly_the_name_of_a_command_is_a_file(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("reports").write_text("")
    assert asked("fly reports") == 1
    assert calls == [("own", "reports", "1..20")]
