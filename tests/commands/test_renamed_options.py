# SPDX-License-Identifier: Apache-2.0
"""Options are taken under their old names, with one warning; help and completion have the new."""

import ast
import re
from pathlib import Path

import pytest
import typer

from heli_flight.cli import app as cli
from heli_flight.cli import hover_test
from heli_flight.cli.common import RENAMED, CommandWithRenamed, CommandWithWords, with_new_names

OLD = {old for old, _ in RENAMED}
NEW = {new for _, new in RENAMED}
SOURCES = Path(__file__).resolve().parents[2] / "src"
OF_OTHERS = {"--model", "--sim-port-out", "--shm-size", "--ros-args", "--params-file"}
"""Options of ArduPilot, Docker and ROS that sentences of ours name."""
# What follows an option of a made-up command.
VALUES_OF = {"--control-preset": 1, "--custom-law": 1, "--vehicles": 1, "--json": 0, "--at": 3}


def renamed(words):
    """Words with new names of such a command."""
    return " ".join(with_new_names(words.split(), VALUES_OF, "heli"))


def commands(group=None, path=("heli",)):
    """Every command of `heli` with the words that call it."""
    group = group or typer.main.get_command(cli.app)
    yield path, group
    for name, command in getattr(group, "commands", {}).items():
        yield from commands(command, (*path, name))


ALL = list(commands())


def options(command):
    """Names of a command's options."""
    return {name for param in command.params for name in param.opts if name.startswith("--")}


@pytest.mark.parametrize(
    ("words", "meant"),
    [
        ("--laws paper --json", "--control-preset paper --json"),
        ("--laws=paper", "--control-preset=paper"),
        ("--law a.py:A --law b.py:B", "--custom-law a.py:A --custom-law b.py:B"),
        ("--json --aircraft 3", "--json --vehicles 3"),
        ("--aircraft=3", "--vehicles=3"),
        ("--at 1 2 3 --laws pid", "--at 1 2 3 --control-preset pid"),
    ],
)
def test_an_old_name_means_the_new_option(capsys, words, meant):
    assert renamed(words) == meant
    out, err = capsys.readouterr()
    assert out == "" and err.count("\n") == 1 and err.startswith("heli: ")
    assert renamed(meant) == meant
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize(
    "words",
    [
        "--aircraft helion.yaml",  # no count
        "--aircraft",
        "--controller pid",  # the command has none
        "--custom-law --laws",  # a value
        "--at 1 2 --law",
        "-- --laws paper",
        "laws",
    ],
)
def test_what_is_no_old_name_is_left_alone(capsys, words):
    assert renamed(words) == words
    assert capsys.readouterr() == ("", "")


def test_an_option_of_the_old_name_stays_the_commands_own(capsys):
    assert with_new_names(["--aircraft", "2"], {"--aircraft": 1, "--vehicles": 1}, "heli") == [
        "--aircraft", "2",
    ]  # fmt: skip
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("hover --laws nobody", "hover --control-preset nobody"),
        ("hover --law nobody", "hover --custom-law nobody"),
        ("hover --controller nobody", "hover --attitude-controller nobody"),
        ("hover --aircraft 99", "hover --vehicles 99"),
        ("campaign --laws nobody", "campaign --control-preset nobody"),
        ("compare attitude --controllers nobody", "compare attitude --attitude-controller nobody"),
        ("compare robustness --controllers no", "compare robustness --attitude-controller no"),
        ("compare worlds --laws nobody", "compare worlds --control-preset nobody"),
        ("compare laws --laws nobody", "compare laws --control-preset nobody"),
        ("robust --laws nobody", "robust --control-preset nobody"),
        ("fault --aircraft heli2", "fault --namespace heli2"),
    ],
)
def test_a_command_does_the_same_by_both_names(capsys, old, new):
    """Bad values show where they arrive: the refusal is that of the new option."""
    words = [word for word in old.split() if word.startswith("--")]
    present = [word for word in new.split() if word.startswith("--")]
    assert cli.main(new.split()) == 2
    out, refused = capsys.readouterr()
    assert out == "" and refused.count("\n") == 1
    assert cli.main(old.split()) == 2
    out, err = capsys.readouterr()
    warning, rest = err.split("\n", 1)
    assert (out, rest) == ("", refused) and warning.startswith("heli: ")
    assert re.findall(r"--[\w-]+", warning) == [words[0], present[0]]


def test_several_old_names_are_one_line(capsys):
    words = "--laws paper --law nobody --controller pid --aircraft 2 --law nobody"
    assert hover_test.main(words.split()) == 2
    first, *rest = capsys.readouterr().err.splitlines()
    assert len(rest) == 1
    assert first.startswith("hover_test: ")
    assert re.findall(r"(--[\w-]+)[^-]*(--[\w-]+)", first) == [
        ("--laws", "--control-preset"), ("--law", "--custom-law"),
        ("--controller", "--attitude-controller"), ("--aircraft", "--vehicles"),
    ]  # fmt: skip


def test_every_command_with_a_new_name_takes_the_old_one():
    having = {path: command for path, command in ALL if options(command) & NEW}
    del having["heli", "ardupilot"]  # which never had another
    assert len(having) == 13
    classes = (CommandWithRenamed, CommandWithWords)
    assert [path for path, command in having.items() if not isinstance(command, classes)] == []


def test_help_shows_the_new_names_alone(capsys):
    for path, command in ALL:
        assert cli.main([*path[1:], "--help"]) == 0
        words = set(capsys.readouterr().out.split())
        assert not words & (OLD - options(command)), path
        assert options(command) & NEW <= words, path


def test_aircraft_means_an_aircraft():
    """By name or file, wherever a command has the option."""
    having = {" ".join(path) for path, command in ALL if "--aircraft" in options(command)}
    assert having == {
        "heli ardupilot", "heli compare aircraft", "heli design", "heli identify", "heli mavlink",
        "heli px4", "heli robust", "heli tune",
    }  # fmt: skip


def refusals():
    """Texts in what is raised, with their places."""
    for path in sorted(SOURCES.glob("heli_*/heli_*/**/*.py")):
        for statement in ast.walk(ast.parse(path.read_text())):
            if isinstance(statement, ast.Raise):
                for node in ast.walk(statement):
                    if isinstance(node, ast.Constant) and isinstance(node.value, str):
                        yield f"{path.relative_to(SOURCES)}:{node.lineno}", node.value


def test_a_refusal_names_options_that_there_are():
    known = {"--help"}.union(*(options(command) for _, command in ALL))
    unknown = {
        (place, name)
        for place, text in refusals()
        for name in re.findall(r"(?<![\w-])--[a-z][a-z0-9-]*", text)
        if name not in known | OF_OTHERS
    }
    assert not unknown
