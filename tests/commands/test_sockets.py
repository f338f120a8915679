# SPDX-License-Identifier: Apache-2.0
"""Every command, and each address on which it or a process that it starts can be reached.

SECURITY.md has the list, which this holds: whoever adds a command says here how it is run. Each
call of `bind` is written down as it happens (`support/sockets.c`), so that none is overlooked.
"""

import contextlib
import os
import pty
import re
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import pytest
import yaml
from typer.main import get_command

from heli_flight.cli import app as cli

ROOT = Path(__file__).resolve().parents[2]
HELI = [sys.executable, "-m", "heli_flight.start", "heli"]
_LIMIT_S = 280.0
SHORT = ["--duration", "4", "--world", "paper"]
LIVE = ["hover", "--live", "--live-port", "0", *SHORT, "--no-report"]
SPEC = {
    "flights": 2, "world": "paper", "gps": "rtk", "duration_s": 3.0, "chunk": 1,
    "set": {"scenario.score.windows_s": [1.0, -1.0]},
    "disperse": {"plant.scale.mass": {"uniform": [0.9, 1.1]}},
}  # fmt: skip
# Few aircraft are soon proved.
NARROW = {
    name: [0.999, 1.0, 1.001]
    for name in ("mass", "inertia_xx", "inertia_yy", "inertia_zz", "rotor_stiffness", "flapping",
                 "thrust", "servo_speed")
} | {"flap_back": [0.00029, 0.0003, 0.00031], "delay_ticks": [0.0, 0.0], "gap": 0.5}  # fmt: skip
PAGE = ["--live", "--live-port", "0"]
ONE = ["--seeds", "1", "--duration", "3", "--world", "paper"]
NAMED = "altitude (truth)"

CALLS = {
    "hover": ["hover", "--duration", "8", "--world", "paper", "--out", "{own}"],
    "hover --one-process": ["hover", "--one-process", *SHORT, "--out", "{own}"],
    "hover --composed": ["hover", "--composed", *SHORT, "--no-report", "--out", "{own}"],
    "hover --live": [*LIVE, "--out", "{own}"],
    "hover --live --foxglove-port": [*LIVE, "--foxglove-port", "0", "--out", "{own}"],
    "replay": ["replay", "{flight}", "--port", "0"],
    "ardupilot": ["ardupilot", "--port", "19002", "--out", "{own}"],
    "ardupilot --live": ["ardupilot", "--port", "19003", "--out", "{own}", *PAGE],
    "px4": ["px4", "--port", "14560", "--out", "{own}"],
    "px4 --live": ["px4", "--port", "14561", "--out", "{own}", *PAGE],
    "mavlink": [
        "mavlink", "--local-port", "19551", "--port", "19550", "--duration", "1",
        "--world", "paper",
    ],
    "joy": ["joy", "--keyboard"],
    "diff": ["diff", "{flight}", "{another}", "--out", "{own}.html"],
    "list": ["list", "scenarios"],
    "new aircraft": [
        "new", "aircraft", "--mass", "5", "--rotor-diameter", "1.4", "--out", "{own}.yaml",
    ],
    "report": ["report", "{flight}", "--out", "{own}"],
    "design": ["design", "--out", "{own}"],
    "identify": ["identify", "--out", "{own}"],
    "robust": ["robust", "--params", "{ranges}", "--out", "{own}"],
    "tune": ["tune", "--iterations", "1", "--out", "{own}"],
    "score": ["score", "{long}", "--mte", "hover"],
    "bag info": ["bag", "info", "{flight}"],
    "log info": ["log", "info", "{flight}"],
    "log identify": ["log", "identify", "{flight}"],
    "bag echo": ["bag", "echo", "{flight}", "odom", "--count", "1"],
    "bag play": ["bag", "play", "{flight}", "--rate", "1000"],
    "bag csv": ["bag", "csv", "{flight}", "--out", "{own}"],
    "bag ulog": ["bag", "ulog", "{flight}", "--out", "{own}"],
    "bag repair": ["bag", "repair", "{flight}", "--out", "{own}"],
    "fault": ["fault", "--list", "--timeout", "0.1"],
    "takeoff": ["takeoff", "--wait", "0.1"],
    "goto": ["goto", "1", "2", "3", "--wait", "0.1"],
    "land": ["land", "--wait", "0.1"],
    "mode": ["mode", "hover", "--wait", "0.1"],
    "echo": ["echo", "odom", "--timeout", "0.1", "--settle", "0"],
    "topics": ["topics", "--settle", "0"],
    "run": ["run", "heli_observer", "observer"],
    "python": ["python", "-c", ""],
    "setup": ["setup"],
    "compare attitude": ["compare", "attitude", *ONE],
    "compare robustness": ["compare", "robustness", "--n", "1", "--duration", "3"],
    "compare controller": ["compare", "controller", "{law}", *ONE],
    "compare aircraft": [
        "compare", "aircraft", "--aircraft", "blade360", "--worlds", "paper", "--seeds", "1..1",
    ],
    "compare worlds": ["compare", "worlds", "--worlds", "paper", *ONE[:4]],
    "compare laws": [
        "compare", "laws", "--worlds", "paper", "--control-preset", "packaged", "--n", "0",
        "--jobs", "2", *ONE[:4], "--out", "{own}",
    ],
    "campaign": ["campaign", "{spec}", "--out", "{own}", "--workers", "2"],
    "campaign --via graph": [
        "campaign", "{spec}", "--out", "{own}", "--workers", "0", "--via", "graph", "--sample", "1",
    ],
    "campaign report": ["campaign", "report", "{campaign}", "--out", "{own}"],
    "campaign rare": [
        "campaign", "rare", "{spec}", "--of", NAMED, "--per-level", "20", "--most-flights", "20",
        "--out", "{own}", "--workers", "2",
    ],
    "campaign worst": [
        "campaign", "worst", "{spec}", "--of", NAMED, "--flights", "10", "--out", "{own}",
        "--workers", "2",
    ],
    "results list": ["results", "list"],
}  # fmt: skip
MAKES_DOCUMENTS = {"results make", "results check", "results render"}
"""They run the others, as the documents' numbers were made, or write these."""
TO_SEND = "udp of a free port"
"""Of Fast DDS: nobody reads what comes there."""
_WITHOUT_A_GRAPH = {"echo", "fault", "takeoff", "goto", "land", "mode"}
_ENDED_BY_A_KEY = {
    "ardupilot", "ardupilot --live", "px4", "px4 --live", "replay", "run", "joy",
}  # fmt: skip
SETS_REACH = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE", "ROS_STATIC_PEERS",
    "FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE",
}  # fmt: skip
"""A user has not set them; a flight in this process, of another test, has."""
_MARKS = [pytest.mark.slow, pytest.mark.timeout(900)]


def commands(command, words=()):
    """Every command that can be run."""
    below = getattr(command, "commands", {})
    if not below or command.invoke_without_command:
        yield " ".join(words)
    for name, one in below.items():
        yield from commands(one, (*words, name))


def listed():
    """By command the addresses that SECURITY.md names."""
    text = (ROOT / "SECURITY.md").read_text(encoding="utf-8").partition("## Every socket")[2]
    found = {}
    for line in text.partition("\n## ")[0].splitlines():
        cells = [re.findall(r"`([^`]+)`", cell) for cell in line.split("|")]
        for name in cells[2] if len(cells) > 2 else ():
            found.setdefault(name.removeprefix("heli "), set()).update(cells[1])
    return found


def test_every_command_is_walked():
    known = set(commands(get_command(cli.app)))
    assert known == {name.partition(" --")[0] for name in CALLS} | MAKES_DOCUMENTS
    assert set(listed()) <= set(CALLS)


def test_only_a_node_by_itself_can_be_reached_from_another_machine():
    """`heli run` starts it as `ros2 run` does, in whatever range of discovery the user has set."""
    here = re.compile(r"tcp 127\.0\.0\.1|udp 127\.0\.0\.1|unix @heli_hover-domain-N|unix in 700")
    beyond = {
        (name, one) for name, addresses in listed().items() for one in addresses
        if not here.fullmatch(one) and one != TO_SEND
    }  # fmt: skip
    assert {name for name, _ in beyond} == {"run"}


_ONCE_OPEN = {*listed(), "campaign"} - {
    "identify", "hover --live", "campaign worst", "campaign --via graph", "hover --composed",
}  # fmt: skip
"""They open something, or did once; the others are slow together, and not run each time. So are
the graph's flights of an identification, which fits for a minute, and a page without Foxglove."""


@pytest.fixture(scope="session")
def shim(tmp_path_factory):
    if shutil.which("cc") is None:
        pytest.skip("needs a C compiler")
    library = tmp_path_factory.mktemp("shim") / "sockets.so"
    source = ROOT / "tests" / "support" / "sockets.c"
    words = ["cc", "-shared", "-fPIC", "-Wall", "-Werror", "-o", library, source, "-ldl"]
    subprocess.run(words, check=True)
    return library


def addresses_in(log):
    """Kinds of addresses."""
    lines = log.read_text().splitlines() if log.exists() else []
    return {re.sub(r"(?<=^unix @heli_hover-domain-)\d+$", "N", line) for line in lines}


def run(shim, log, words):
    """Run a command to its end, with the key or signal that ends it where it has none."""
    own = {name: value for name, value in os.environ.items() if name not in SETS_REACH}
    env = own | {"LD_PRELOAD": str(shim), "SOCKETS_FILE": str(log)}
    master, slave = pty.openpty()
    with subprocess.Popen(
        [*HELI, *map(str, words)], env=env, text=True, cwd=log.parent, stdin=slave,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    ) as process:  # fmt: skip
        os.close(slave)
        try:
            if words[0] in _ENDED_BY_A_KEY:
                name = f"{words[0]} --live" if "--live" in words else words[0]
                while not listed()[name] <= addresses_in(log):
                    with contextlib.suppress(subprocess.TimeoutExpired):
                        process.wait(0.02)
                        break
                os.write(master, b"q") if words[0] == "joy" else process.send_signal(signal.SIGINT)
            said, _ = process.communicate(timeout=_LIMIT_S)
        finally:
            process.kill()
            os.close(master)
    return process.returncode, said


@pytest.fixture(scope="module")
def made(shim, tmp_path_factory):
    """What other commands read: a flight, and a campaign's folder, with what they bound."""
    folder = tmp_path_factory.mktemp("made")
    places = {"spec": folder / "spec.yaml", "flight": folder / "flight", "campaign": folder / "c"}
    places["law"] = f"{ROOT / 'examples' / 'my_law.py'}:MyLaw"
    places["spec"].write_text(yaml.safe_dump(SPEC))
    places["ranges"] = folder / "ranges.yaml"
    places["ranges"].write_text(yaml.safe_dump({"/**/robust": {"ros__parameters": NARROW}}))
    for name, own in (("hover", "flight"), ("campaign", "campaign")):
        words = [word.format(own=places[own], **places) for word in CALLS[name]]
        code, said = run(shim, folder / name, words)
        assert code in (0, 1), said
    # A manoeuvre is scored over 30 s and more.
    places["long"] = folder / "long"
    places["another"] = shutil.copytree(places["flight"], folder / "another")
    return places


@pytest.fixture(scope="module")
def long_flight(shim, made):
    words = ["hover", "--duration", "45", "--world", "paper", "--no-report", "--out", made["long"]]
    code, said = run(shim, made["spec"].parent / "hover 45 s", words)
    assert code in (0, 1), said


@pytest.mark.parametrize(
    "name",
    [pytest.param(name, marks=() if name in _ONCE_OPEN else _MARKS) for name in CALLS],
)
def test_a_command_opens_what_is_listed(name, made, shim, tmp_path, request):
    log = made["spec"].parent / name if name in ("hover", "campaign") else tmp_path / "log"
    if name not in ("hover", "campaign"):
        if "{long}" in CALLS[name]:
            request.getfixturevalue("long_flight")
        words = [word.format(own=tmp_path / "own", **made) for word in CALLS[name]]
        code, said = run(shim, log, words)
        if name not in _WITHOUT_A_GRAPH | _ENDED_BY_A_KEY:
            assert code in (0, 1), said
        assert "Traceback" not in said, said
    assert addresses_in(log) == listed().get(name, set())
