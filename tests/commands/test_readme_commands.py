# SPDX-License-Identifier: Apache-2.0
"""Every command of the READMEs is run, in a short form, or by another test that is named here.

Code blocks are followed from top to bottom in a folder of their own, as a reader would. A command
in running text is checked against the program's own help.
"""

import importlib.util
import os
import re
import shlex
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from heli_flight.cli import app as cli
from heli_parameters.locate import executable, share_folder

ROOT = Path(__file__).resolve().parents[2]
READMES = ["README.md", "CONTRIBUTING.md"]
READMES += sorted(str(path.relative_to(ROOT)) for path in ROOT.glob("src/*/README.md"))

# What is appended to a command to make it short; the last of two equal options counts.
_FLIGHT = "--one-process --no-report --duration 6"
SHORT = {
    "./hover_test.sh": _FLIGHT,
    "./heli hover": _FLIGHT,
    "./heli campaign": "--seeds 1 --duration 6",
    "./heli compare attitude": "--seeds 1 --duration 6",
    "./heli compare robustness": "--n 1 --duration 6",
    "./heli design": "",
    "./heli identify": "--one-process",
}
# Commands that take long or need ROS: begin of the command -> the test that runs them.
COVERED = {
    "./hover_test.sh --live": "tests/browser/test_browser_live_flight.py::"
    "test_flight_is_shown_above_its_shadow_in_real_time",
    "./heli report": "tests/commands/test_report_command.py::test_a_bag_gives_the_record_back",
    "./heli bag play": "tests/graph/test_bag_tools.py::test_play_and_listen",
    "./heli bag": "tests/commands/test_bag_command.py::"
    "test_repair_says_what_was_restored_and_what_was_lost",
    "./heli echo": "tests/graph/test_bag_tools.py::test_recorder_killed_in_flight",
    "./heli topics": "tests/graph/test_bag_tools.py::test_recorder_killed_in_flight",
    "./run_tests.sh": "tests/packaging/test_packaging_setup.py::test_tests_add_their_tools_once",
    "./heli run": "tests/graph/test_single_nodes.py::"
    "test_nodes_started_alone_find_each_other_and_fly",
}
ROS_TOOLS = ("ros2 topic", "ros2 bag", "ros2 param", "ros2 service", "ros2 lifecycle", "rosdep")
PROGRAMS = ("./", "heli ", "ros2 ", "rosdep ", "python ", "colcon ")
_NOT_OURS = ("mermaid", "yaml", "json", "text")


@dataclass(frozen=True)
class Block:
    """A code block: its language, if named, and its text."""

    language: str
    text: str


def blocks(text):
    """Fenced and indented code blocks of a Markdown text, in order."""
    found, fenced, kept = [], None, []

    def flush(language):
        if kept:
            found.append(Block(language, "\n".join(kept).rstrip()))
        kept.clear()

    for line in [*text.splitlines(), "."]:
        fence = re.match(r"```(\w*)", line)
        if fence:
            flush(fenced or "")
            fenced = fence[1] if fenced is None else None
        elif fenced is not None:
            kept.append(line)
        elif line.startswith("    ") or (kept and not line):
            kept.append(line[4:])
        else:
            flush("")
    return [block for block in found if block.language not in _NOT_OURS]


def commands(block):
    """Commands of a block, comments off; a here-document belongs to its command."""
    if re.match(r"(from|import) \w", block.text):
        return [f"python - <<'END'\n{block.text}\nEND"]
    found, lines = [], iter(block.text.splitlines())
    for line in lines:
        document = re.search(r"<<'?(\w+)'?", line)
        if document:
            body = [line]
            for inner in lines:
                body.append(inner)
                if inner == document[1]:
                    break
            found.append("\n".join(body))
            continue
        # two commands in two columns
        for part in re.split(r" {3,}(?=\S)", re.sub(r"(^|\s+)#.*", "", line)):
            if part.strip():
                found.append(part.strip().removeprefix("$ "))
    return found


def inline(text):
    """Commands between back-quotes."""
    plain = re.sub(r"(?ms)^```.*?^```", "", text)
    return [c for c in re.findall(r"`([^`\n]+)`", plain) if c.startswith(PROGRAMS)]


def beginning(command, table):
    """The longest key that a command begins with, or None."""
    keys = [key for key in table if command == key or command.startswith(key + " ")]
    return max(keys, key=len, default=None)


@pytest.fixture
def folder(tmp_path):
    """A reader's folder: the checkout's programs, and an aircraft file made as the README says."""
    for name in ("hover_test.sh", "run_tests.sh", "heli", "src", "scripts"):
        (tmp_path / name).symlink_to(ROOT / name)
    packaged = ROOT / "src/heli_dynamics_sim/config/aircraft/helion.yaml"
    (tmp_path / "my_aircraft.yaml").write_text(packaged.read_text())
    return tmp_path


def run(command, folder):
    """Run a command in bash with this environment's Python; exit code 0 is expected."""
    python = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done = subprocess.run(
        ["bash", "-c", command], cwd=folder, env={**os.environ, "PATH": python},
        capture_output=True, text=True, timeout=240,
    )  # fmt: skip
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"


def check_ros_command(command):
    """`ros2 run` and `ros2 launch` name what is there."""
    words = command.split()
    if words[1] == "run":
        assert executable(words[2], words[3]).is_file()
    if words[1] == "launch":
        file = share_folder(words[2]) / "launch" / words[3]
        compile(file.read_text(), str(file), "exec")


def follow(command, folder):
    """Run a command or see that another test does; False if neither."""
    if command.startswith("heli "):
        command = f"./{command}"
    if command.startswith("ros2 launch "):
        check_ros_command(command)
        return True
    other = beginning(command, COVERED)
    if other is not None:
        if command.startswith("ros2 "):
            check_ros_command(command)
        path, name = COVERED[other].split("::")
        return f"def {name}(" in (ROOT / path).read_text()
    if command.startswith(("cat ", "python ")):
        run(command, folder)
        return True
    short = beginning(command, SHORT)
    if short is None:
        return command.startswith(ROS_TOOLS)
    run(f"{command} {SHORT[short]}", folder)
    return True


@pytest.mark.parametrize("readme", READMES)
def test_commands_of_the_code_blocks(readme, folder):
    text = (ROOT / readme).read_text(encoding="utf-8")
    for block in blocks(text):
        for command in commands(block):
            assert follow(command, folder), (
                f"{readme}: '{command}' is neither run nor mapped; "
                f"add it to SHORT or COVERED in {Path(__file__).name}"
            )


def help_of(capsys, words):
    """Help of a command of heli; sub-commands are taken as long as they are known."""
    known = []
    for word in words:
        try:
            code = cli.main([*known, word, "--help"]) if re.match(r"[a-z]+$", word) else 2
        except SystemExit as stop:  # of argparse
            code = stop.code
        capsys.readouterr()
        if code:
            break
        known.append(word)
    try:
        assert cli.main([*known, "--help"]) == 0
    except SystemExit as stop:
        assert stop.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("readme", READMES)
def test_commands_in_running_text(readme, capsys):
    """Options, modules, scripts and executables that are named exist."""
    for command in inline((ROOT / readme).read_text(encoding="utf-8")):
        words = shlex.split(command.replace("[", " ").replace("]", " "))
        if words[0] in ("./heli", "heli", "./hover_test.sh"):
            said = help_of(capsys, ["hover"] if words[0] == "./hover_test.sh" else words[1:])
            for option in (word.split("=")[0] for word in words if word.startswith("--")):
                assert re.search(rf"{option}\b", said), f"{readme}: {command}: {option}"
        elif words[0] == "python" and words[1] == "-m":
            assert importlib.util.find_spec(words[2]) is not None, f"{readme}: {command}"
        elif words[0] == "python":
            assert (ROOT / words[1]).is_file(), f"{readme}: {command}"
        elif words[0] == "ros2" and len(words) > 3:
            check_ros_command(command)
        elif words[0].startswith("./"):
            assert os.access(ROOT / words[0], os.X_OK), f"{readme}: {command}"


class TestItself:
    """The extraction sees what is written; a command nobody runs is refused."""

    TEXT = (
        "a\n\n    ./heli design --gamma 1   # why\n    ros2 run a b            ros2 run c d\n\n"
        "```mermaid\nx --> y\n```\n\n```bash\ncat > f <<'END'\n# kept\nEND\n```\n"
    )

    def test_commands_are_found(self):
        found = [command for block in blocks(self.TEXT) for command in commands(block)]
        assert found == [
            "./heli design --gamma 1", "ros2 run a b", "ros2 run c d",
            "cat > f <<'END'\n# kept\nEND",
        ]  # fmt: skip
        assert inline("use `./heli design` and\n\n    ./heli report x\n") == ["./heli design"]

    def test_an_unknown_command_is_not_followed(self, tmp_path):
        assert not follow("./heli juggle", tmp_path)
        assert not follow("make install", tmp_path)

    @pytest.mark.parametrize("target", COVERED.values())
    def test_the_tests_that_are_named_exist(self, target):
        path, name = target.split("::")
        assert f"def {name}(" in (ROOT / path).read_text()
