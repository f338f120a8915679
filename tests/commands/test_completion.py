# SPDX-License-Identifier: Apache-2.0
"""Shell completion, as a shell asks for it; and what commands say where there is no terminal."""

import json
import os
import pty
import re
import subprocess
import sys

import pytest

from heli_flight.cli import app as cli
from heli_flight.fly import COMPILES
from heli_flight.layers import GPS_PRESETS, scenario_names
from heli_inner_hinf.controller_state import CONTROLLERS

HELI = (sys.executable, "-m", "heli_flight.cli.app")
ESCAPE = re.compile(r"\x1b")


def complete(line):
    """What the shell would offer at the end of a line (a blank at its end: a new word)."""
    words = line.split()
    number = len(words) - (not line.endswith(" "))
    env = {**os.environ, "_HELI_COMPLETE": "complete_bash"}
    env |= {"COMP_WORDS": line, "COMP_CWORD": str(number)}
    done = subprocess.run(HELI, env=env, capture_output=True, text=True, timeout=150, check=True)
    return done.stdout.split()


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("heli ca", ["campaign"]),
        ("heli campaign re", ["report"]),
        ("heli compare ", ["attitude", "robustness", "controller", "aircraft", "worlds", "laws"]),
        ("heli hover --scenario ", scenario_names()),
        ("heli hover --gps ", list(GPS_PRESETS)),
        ("heli hover --control-preset pap", ["paper"]),
        ("heli hover --seed 3 --attitude-controller ", list(CONTROLLERS)),
        (
            "heli campaign --scenario att",
            [
                "attitude",
                "attitude_disturbance",
                "attitude_gusts",
                "attitude_steps",
                "attitude_sweep",
            ],
        ),
        ("heli compare attitude --attitude-controller hinf,p", ["hinf,pid"]),
        ("heli design --aircraft ", ["helion.yaml", "logo600.yaml", "xcell60.yaml"]),
        ("heli tune --structure p", ["pid"]),
        ("heli tune --structure s", ["state"]),
        ("heli report bag --gps r", ["rtk"]),
        ("heli run heli_o", ["heli_observer", "heli_outer_pd"]),
        ("heli run heli_observer ", ["observer"]),
    ],
)
def test_names_are_completed(line, offered):
    assert complete(line) == offered


@pytest.mark.parametrize("line", ["heli hover --params ", "heli design --aircraft ./m"])
def test_files_are_left_to_the_shell(line):
    """Nothing is offered, and the shell then offers files (complete -o default)."""
    assert complete(line) == []


def help_of(*words):
    """What a command says under --help, without line breaks."""
    done = subprocess.run([*words, "--help"], capture_output=True, text=True, timeout=150)
    assert done.returncode == 0
    return done.stdout


def test_every_option_of_hover_is_completed():
    """And ./hover_test.sh has the same ones with the same words."""
    help_text = help_of(*HELI, "hover")
    wanted = re.findall(r"^ +(--[a-z-]+)", help_text, re.M)
    assert len(wanted) > 10
    assert set(complete("heli hover --")) == set(wanted)
    alone = help_of(HELI[0], "-m", "heli_flight.cli.hover_test")
    assert alone.startswith("Usage: hover_test.sh [OPTIONS]")
    plain = [text.partition("Options:")[2].partition("examples:") for text in (help_text, alone)]
    assert plain[0][0] == plain[1][0]
    assert plain[0][2].replace("heli hover", "./hover_test.sh").split() == plain[1][2].split()


def test_help_names_every_choice():
    help_text = help_of(*HELI, "hover")
    for name in (*scenario_names(), *GPS_PRESETS, *CONTROLLERS):
        assert re.search(rf"\b{name}\b", help_text), name


def test_the_script_for_bash_is_one():
    """--show-completion, run by bash, prints a script that bash can read."""
    ask = f"{HELI[0]} -m heli_flight.cli.app --show-completion; :"
    shown = subprocess.run(["bash", "-c", ask], capture_output=True, text=True, timeout=150)
    script = shown.stdout
    assert "_HELI_COMPLETE=complete_bash" in script and "complete -o default" in script
    subprocess.run(["bash", "-n"], input=script, text=True, check=True, timeout=120)


class TestWithoutATerminal:
    def test_campaign_json(self, capsys):
        words = "campaign --world paper --seeds 1,2 --gps rtk --duration 12 --json"
        assert cli.main(words.split()) == 0
        out, err = capsys.readouterr()
        campaign = json.loads(out)
        rtk = campaign["receivers"]["rtk"]
        assert campaign["exit_code"] == 0 and campaign["seeds"] == [1, 2]
        assert [f["seed"] for f in rtk["flights"]] == [1, 2]
        worst = {(m["key"], m["measured_from"]): m["max"] for m in rtk["metrics"]}
        for (key, source), largest in worst.items():
            assert largest == max(f["max"][f"{key} ({source})"] for f in rtk["flights"])
        # Who flies first on a machine is told that it compiles; that is judged where it is tested.
        progress = [line for line in err.splitlines() if line != COMPILES]
        assert progress == ["flights: 1 of 2", "flights: 2 of 2"]

    def test_campaign_names_what_is_outside(self, capsys, tmp_path):
        file = tmp_path / "wild.yaml"
        file.write_text("/**/plant:\n  ros__parameters:\n    wind.w20_mps: 30.0\n")
        words = ["campaign", "--seeds", "1", "--gps", "rtk", "--params", str(file)]
        assert cli.main(words) == 1
        out, _ = capsys.readouterr()
        assert re.search(r"whole .*rtk: 0 of 1\b", out)
        assert re.search(r": rtk, seed 1: ", out)

    def test_hover_json_is_the_flights_result(self, capsys, tmp_path):
        out = tmp_path / "flight"
        words = ["hover", "--one-process", "--no-report", "--duration", "4", "--out", str(out)]
        assert cli.main([*words, "--json"]) == 0
        printed, stderr = capsys.readouterr()
        assert json.loads(printed) == json.loads((out / "result.json").read_text())
        assert "Hover test" in stderr

    @pytest.mark.parametrize(
        "words", ["campaign --seeds 1 --world paper", "compare attitude --seeds 1"]
    )
    def test_a_pipe_gets_plain_text(self, words):
        done = subprocess.run(
            [*HELI, *words.split(), "--duration", "6"],
            capture_output=True, text=True, timeout=150,
        )  # fmt: skip
        assert done.returncode == 0
        assert not ESCAPE.search(done.stdout + done.stderr)


def test_a_terminal_gets_a_progress_bar():
    """More than a few seconds of work show a bar on the terminal's own device."""
    master, slave = pty.openpty()
    words = ("campaign", "--seeds", "1..3", "--duration", "6", "--world", "paper", "--gps", "rtk")
    env = {**os.environ, "TERM": "xterm-256color", "COLUMNS": "100"}
    child = subprocess.Popen([*HELI, *words], stdout=slave, stderr=slave, stdin=slave, env=env)
    os.close(slave)
    text = b""
    while True:
        try:
            part = os.read(master, 4096)
        except OSError:  # the other end is closed
            break
        if not part:
            break
        text += part
    os.close(master)
    assert child.wait(timeout=150) == 0
    assert b"3/3" in text and "\u2501".encode() in text
