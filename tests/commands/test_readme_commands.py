# SPDX-License-Identifier: Apache-2.0
"""Every code block of every README is run: from a bare shell, in a folder that looks like a clone.

Nothing is activated: PATH has no environment of ours. Long commands get an option that makes them
short (`SHORTER`); none is left out. The commands `ros2` and `rviz2` are no wheels, so their lines
are checked by what they would look up (`check_ros2`), and a form that is not known there fails. Not
to be shown here: `rosdep`, which needs its list of keys from a server.
"""

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import pytest
import yaml
from rosidl_adapter.parser import parse_action_file

from heli_actions.node import PREFIX, Kind
from heli_core.command_line import executable
from heli_core.rcl_yaml import ParameterError
from heli_flight.cli import app as cli
from heli_flight.graph.manager import SystemCommand
from heli_flight.layers import NODES
from heli_msgs_bridge import topics

ROOT = Path(__file__).resolve().parents[2]
READMES = ["README.md", "CONTRIBUTING.md"]
READMES += sorted(str(path.relative_to(ROOT)) for path in ROOT.glob("src/*/README.md"))
READMES += sorted(str(path.relative_to(ROOT)) for path in ROOT.glob("docs/**/*.md"))

SLOW = pytest.mark.slow
# Begin of a command -> what is appended to make it short; the last of two equal options counts.
SHORTER = {
    "./hover_test.sh": "--duration 4 --no-report",
    "./hover_test.sh --live": "--duration 2 --no-report --live-port 0 --foxglove-port 0",
    "./hover_test.sh --live --live-wait": "--live-port 0",
    "./heli replay": "--port 0",
    "./heli ardupilot --live": "--live-port 0",
    "./heli hover": "--duration 4",
    "./heli hover --one-process --scenario waypoints": "--no-report",  # as long as its path
    "./heli campaign --seeds": "--seeds 1 --duration 6",
    "./heli compare attitude": "--seeds 1 --duration 6",
    "./heli compare robustness": "--n 1 --duration 6",
    "./heli identify": "--one-process",
    "./run_tests.sh": "--collect-only -q tests/flight",
    "./run_tests.sh -m slow": "--collect-only -q tests/graph",
    "./heli python -m evidence.sweep_cpu_types": "--only native -k atmosphere",
    "./heli python -m evidence.experiments.cpu_types": "--seeds 1 --only Nehalem",
}
# Commands that look at a running graph: one flies in real time beside them.
NEED_A_GRAPH = ("./heli topics", "./heli echo", "./heli fault", "./heli python examples/",
                "./heli goto")  # fmt: skip
# Commands that run until they are interrupted: their first words are waited for.
ENDLESS = ("./heli run", "./heli replay", "./hover_test.sh --live --live-wait",
           "./heli ardupilot --live")  # fmt: skip
PROGRAMS = ("./", "heli ", "ros2 ", "rosdep ", "python ", "colcon ")
# `py`: parts of a pilot's script; `test_pilot_client_flown.py` flies such.
NOT_SHELL = ("mermaid", "yaml", "json", "text", "py")
# How long a failure takes at most; on loaded cores an identification takes minutes.
LIMIT_S = 900


@dataclass(frozen=True)
class Block:
    """A code block: its language, if named, and its text."""

    language: str
    text: str


def blocks(text):
    """Fenced and indented code blocks of a Markdown text, in order."""
    parsed, fenced, kept = [], None, []

    def flush(language):
        if kept:
            parsed.append(Block(language, "\n".join(kept).rstrip()))
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
    return [block for block in parsed if block.language not in NOT_SHELL]


def commands(block):
    """Commands of a block, comments off; a here-document belongs to its command."""
    if block.language == "python" or re.match(r"(from|import) \w", block.text):
        return [f"./heli python - <<'END'\n{block.text}\nEND"]
    shell, lines = [], iter(block.text.splitlines())
    for line in lines:
        document = re.search(r"<<'?(\w+)'?", line)
        if document:
            body = [line]
            for inner in lines:
                body.append(inner)
                if inner == document[1]:
                    break
            shell.append("\n".join(body))
            continue
        # two commands in two columns
        for part in re.split(r" {3,}(?=\S)", re.sub(r"(^|\s+)#.*", "", line)):
            if part.strip():
                shell.append(part.strip().removeprefix("$ "))
    return shell


def inline(text):
    """Commands between back-quotes."""
    plain = re.sub(r"(?ms)^```.*?^```", "", text)
    return [c for c in re.findall(r"`([^`\n]+)`", plain) if c.startswith(PROGRAMS)]


def shortened(command):
    """The command with what makes it short."""
    keys = [key for key in SHORTER if command == key or command.startswith(key + " ")]
    return f"{command} {SHORTER[max(keys, key=len)]}" if keys else command


# --- where and how commands run ------------------------------------------------------------------


@pytest.fixture
def clone(tmp_path):
    """A folder with everything of the checkout, by links, in which a reader's files may be made."""
    for path in ROOT.iterdir():
        if path.name not in ("flights", ".git"):
            (tmp_path / path.name).symlink_to(path)
    packaged = ROOT / "src/heli_dynamics_sim/config/aircraft/helion.yaml"
    shutil.copy(packaged, tmp_path / "my_aircraft.yaml")
    return tmp_path


@pytest.fixture
def bare_env(own_domain):
    """What a new terminal has: no environment of ours on the PATH, no ROS variables.

    But the test's own domain, which no other test run on this machine has meanwhile.
    """
    kept = {"HOME", "USER", "LANG", "TMPDIR", "HELI_VENV", "PYTHON"}
    kept |= {"XDG_CACHE_HOME", "PIP_CACHE_DIR", "UV_CACHE_DIR"}
    env = {key: value for key, value in os.environ.items() if key in kept}
    ours = str(Path(sys.executable).parent)
    paths = [p for p in os.environ["PATH"].split(os.pathsep) if p != ours]
    return {**env, "PATH": os.pathsep.join(paths), "ROS_DOMAIN_ID": str(own_domain)}


def run(command, folder, env):
    """Run a command in bash; exit code 0 is expected."""
    done = subprocess.run(
        ["bash", "-c", command], cwd=folder, env=env, capture_output=True, text=True,
        timeout=LIMIT_S,
    )  # fmt: skip
    assert done.returncode == 0, f"{command}\n{done.stdout}{done.stderr}"


@pytest.fixture
def beside_a_flight(clone, bare_env):
    """Run a command while a graph flies; the flight is interrupted afterwards."""

    def beside(command):
        flight = subprocess.Popen(
            ["./hover_test.sh", "--realtime", "--no-report", "--duration", "600"], cwd=clone,
            env=bare_env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
            start_new_session=True,
        )  # fmt: skip
        try:
            flying = "until ./heli topics | grep -q odom; do :; done"
            run(f"timeout 120 bash -c {shlex.quote(flying)}", clone, bare_env)
            run(f"timeout 120 {command}", clone, bare_env)
        finally:
            os.killpg(flight.pid, signal.SIGINT)
            flight.communicate(timeout=120)

    return beside


def run_until_it_speaks(command, folder, env):
    """Start a command, wait for its first line, press Ctrl-C; it ends as asked."""
    process = subprocess.Popen(
        shlex.split(command), cwd=folder, env=env, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT, text=True, start_new_session=True,
    )  # fmt: skip
    try:
        first = process.stdout.readline()
        os.killpg(process.pid, signal.SIGINT)
        rest, _ = process.communicate(timeout=120)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
    assert process.returncode in (0, 130), f"{command}\n{first}{rest}"
    assert "Traceback" not in first + rest


# --- the ros2 command, by what it looks up -------------------------------------------------------


def table_of(node_name):
    """Parameter table of the node, by name without namespace."""
    packages = {node.name: node.package for node in NODES}
    packages |= {"recorder": "heli_bags", "live_view": "heli_live_view", "actions": "heli_actions"}
    node = node_name.strip("/").split("/")[-1]
    assert node in packages, f"no node {node_name}"
    return {row.name: row for row in import_module(f"{packages[node]}.parameters").TABLE}


def check_run(words, launch):
    assert executable(words[0], words[1]).is_file()
    commands = ("heli", "hover_test")
    assert not words[2:] or words[2] == "--ros-args" or words[1] in commands


def check_launch(words, launch):
    assert launch(words[0], words[1], *words[2:])


def check_param(words, launch):
    verb, node, name, *value = words
    assert verb in ("get", "set", "describe")
    row = table_of(node)[name]
    if verb == "set":
        assert not row.read_only
        row.check(yaml.safe_load(value[0]))


def check_topic(words, launch):
    verb, name, *rest = (word for word in words if word != "-s")  # of simulated time
    assert verb in ("echo", "hz", "info", "pub", "delay")
    known = {topic.strip("/"): row for topic, row in topics.BY_NAME.items()}
    assert name.strip("/") in known
    if verb == "pub":
        assert rest[0] == known[name.strip("/")].type


def check_bag(words, launch):
    assert words[0] == "record"
    known = {topic.strip("/") for topic in topics.BY_NAME}
    for name in (word for word in words[1:] if not word.startswith("-")):
        assert name.strip("/") in known


def check_action(words, launch):
    verb, name, type_name, goal, *rest = words
    assert (verb, rest) == ("send_goal", ["--feedback"])
    prefix, kind = name.strip("/").split("/")
    package, _, definition = type_name.split("/")
    assert (prefix, definition) == (PREFIX, Kind(kind).capitalize())
    path = ROOT / "src" / package / "action" / f"{definition}.action"
    fields = {field.name for field in parse_action_file(package, str(path)).goal.fields}
    assert set(yaml.safe_load(goal)) <= fields


def check_service(words, launch):
    verb, name, type_name = words
    assert (verb, type_name) == ("call", "std_srvs/srv/Trigger")
    node, command = name.strip("/").split("/")
    assert node == "lifecycle_manager" and command in set(SystemCommand)


ROS2 = {
    "action": check_action,
    "run": check_run,
    "launch": check_launch,
    "param": check_param,
    "service": check_service,
    "topic": check_topic,
    "bag": check_bag,
}


def check_ros2(command, launch):
    """Fail unless the `ros2` command would find all that it names."""
    words = shlex.split(command)[1:]
    assert words[0] in ROS2, f"{command}: nobody knows what this looks up"
    ROS2[words[0]](words[1:], launch)


def check_rviz2(command):
    """Fail unless `rviz2`, which is no wheel either, would find its configuration."""
    _, option, file, *rest = shlex.split(command)
    assert option == "-d" and (ROOT / file).is_file()
    assert rest in ([], ["--ros-args", "-p", "use_sim_time:=true"])


@pytest.mark.timeout(3600)
@pytest.mark.parametrize(
    "readme",
    [name if name == "README.md" else pytest.param(name, marks=SLOW) for name in READMES],
)
def test_commands_of_the_code_blocks(readme, clone, bare_env, beside_a_flight, launch):
    """From top to bottom, as a reader would."""
    text = (ROOT / readme).read_text(encoding="utf-8")
    if "--out my_aircraft.yaml" in text:  # the reader makes it
        (clone / "my_aircraft.yaml").unlink()
    for block in blocks(text):
        for command in commands(block):
            if command.startswith("ros2 "):
                check_ros2(command, launch)
            elif command.startswith("rviz2 "):
                check_rviz2(command)
            elif command.startswith(NEED_A_GRAPH):
                beside_a_flight(command)
            elif command.startswith(ENDLESS):
                run_until_it_speaks(shortened(command), clone, bare_env)
            else:
                run(shortened(command), clone, bare_env)


# --- commands in running text --------------------------------------------------------------------


def asked(words):
    """Exit code of heli, however it ends."""
    try:
        return cli.main(words)
    except SystemExit as stop:
        return stop.code


def help_of(capsys, words):
    """Help of a command of heli; sub-commands are taken as long as they are known.

    What follows the script, or the module, of `heli python` belongs to it.
    """
    if words[0] == "python" and len(words) > 1 and words[1].endswith(".py"):
        assert (ROOT / words[1]).is_file()
        begin = [words[1]]
    elif words[:2] == ["python", "-m"]:
        begin = words[1:3]
    else:
        begin = []
    if begin:
        if not any(word.startswith("--") for word in words):
            return ""
        command = [sys.executable, *begin, "--help"]
        done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
        return done.stdout
    known = []
    for word in words:
        code = asked([*known, word, "--help"]) if re.match(r"[a-z]+$", word) else 2
        capsys.readouterr()
        if code:
            break
        known.append(word)
    assert asked([*known, "--help"]) == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("readme", READMES)
def test_commands_in_running_text(readme, capsys, launch):
    """Options, scripts and executables that are named exist; nothing needs an activated shell."""
    for command in inline((ROOT / readme).read_text(encoding="utf-8")):
        words = shlex.split(command.replace("[", " ").replace("]", " "))
        if words[0] in ("./heli", "./hover_test.sh"):
            help_text = help_of(capsys, ["hover"] if words[0] == "./hover_test.sh" else words[1:])
            for option in (word.split("=")[0] for word in words if word.startswith("--")):
                assert re.search(rf"{option}\b", help_text), f"{readme}: {command}: {option}"
        elif words[0] == "ros2":
            if len(words) > 3:
                check_ros2(command, launch)
        elif words[0].startswith("./"):
            assert os.access(ROOT / words[0], os.X_OK), f"{readme}: {command}"
        else:
            assert words[0] in ("colcon", "rosdep", "heli"), f"{readme}: {command}: from where?"


class TestItself:
    """The extraction sees what is written; a command that cannot be is refused."""

    TEXT = (
        "a\n\n    ./heli design --gamma 1   # why\n    ros2 run a b            ros2 run c d\n\n"
        "```mermaid\nx --> y\n```\n\n```bash\ncat > f <<'END'\n# kept\nEND\n```\n"
    )

    def test_commands_are_found(self):
        parsed = [command for block in blocks(self.TEXT) for command in commands(block)]
        assert parsed == [
            "./heli design --gamma 1", "ros2 run a b", "ros2 run c d",
            "cat > f <<'END'\n# kept\nEND",
        ]  # fmt: skip
        assert inline("use `./heli design` and\n\n    ./heli report x\n") == ["./heli design"]

    @pytest.mark.parametrize("command", ["./heli juggle", "make install", "heli hover"])
    def test_a_command_that_fails_is_seen(self, clone, bare_env, command):
        with pytest.raises(AssertionError, match=command):
            run(command, clone, bare_env)

    @pytest.mark.parametrize(
        "command",
        [
            "ros2 run heli_flight juggle",
            "ros2 launch heli_flight hover.launch.py gps:=none",
            "ros2 launch heli_flight hover.launch.py sead:=1",
            "ros2 param set /inner_loop gama 0.056",
            "ros2 param set /inner_loop gamma -1.0",
            "ros2 param set /juggler gamma 0.056",
            "ros2 topic echo /no/such/topic",
            "ros2 topic pub /odom std_msgs/msg/String hello",
            "ros2 bag record /no/such/topic",
            "ros2 juggle",
        ],
    )
    def test_a_ros2_command_that_finds_nothing_is_refused(self, command, launch):
        with pytest.raises((AssertionError, KeyError, OSError, ParameterError, RuntimeError)):
            check_ros2(command, launch)
