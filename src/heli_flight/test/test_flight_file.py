# SPDX-License-Identifier: Apache-2.0
"""params.yaml: flies the same flight again; where command line or another file contradict it."""

import json
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
import yaml

from heli_core.parameters import load
from heli_core.rcl_yaml import ParameterError
from heli_flight import settings as commit
from heli_flight.cli import app
from heli_flight.flight_file import write_parameters
from heli_flight.layers import NODES
from heli_flight.settings import resolve

# What two runs of one flight may differ in: the machine's doing, and where its file lay.
_OF_THE_RUN = ("wall_s", "real_time_factor", "parameter_files")


def section(node, *lines):
    body = "".join(f"    {line}\n" for line in lines)
    return f"/**/{node}:\n  ros__parameters:\n{body}"


@pytest.fixture
def written(tmp_path):
    """Write a parameter file."""

    def write(text, name="mine.yaml"):
        path = tmp_path / name
        path.write_text(text)
        return path

    return write


def without_run(result):
    return {key: value for key, value in result.items() if key not in _OF_THE_RUN}


class TestTheSameFlightAgain:
    @pytest.mark.parametrize(
        "words",
        [
            ("--seed", 3, "--duration", 12),
            ("--gps", "rtk", "--seed", 7, "--duration", 12),
            (
                "--scenario",
                "attitude",
                "--attitude-controller",
                "pid",
                "--duration",
                9,
                "--gps",
                "rtk",
            ),
            (
                "--scenario",
                "attitude_gusts",
                "--attitude-controller",
                "lqr",
                "--seed",
                2,
                "--duration",
                9,
            ),
        ],
        ids=["standalone", "rtk", "attitude pid rtk", "gusts lqr"],
    )
    def test_options(self, fly, tmp_path, words):
        code, first = fly(tmp_path / "a", "--one-process", *words)
        again, second = fly(tmp_path / "b", "--params", tmp_path / "a" / "params.yaml")
        assert again == code
        assert without_run(second) == without_run(first)
        files = [(tmp_path / name / "params.yaml").read_bytes() for name in "ab"]
        assert files[0] == files[1]

    def test_a_flight_that_only_truth_calls_outside(self, fly, tmp_path, written):
        """With RTK the truth is judged: the receiver, not the name of an option, decides the code.

        A receiver that drifts by 2 m: the navigation record follows it and stays inside.
        """
        mine = written(section("plant", "sensors.gps.drift_m: 2.0"))
        code, first = fly(
            tmp_path / "a",
            "--one-process",
            "--gps",
            "rtk",
            "--world",
            "paper",
            "--params",
            mine,
            "--duration",
            18,
        )
        assert code == 1
        assert first["outside"] and all("(truth)" in name for name in first["outside"])
        again, second = fly(tmp_path / "b", "--params", tmp_path / "a" / "params.yaml")
        assert (again, without_run(second)) == (code, without_run(first))
        assert "plant.sensors.gps.drift_m" in second["changed"]

    def test_changed_weights(self, fly, tmp_path, written):
        mine = written(
            section("inner_loop", "gamma: 0.07")
            + section("plant", "wind.w20_mps: 6.0")
            + section("scenario", "climb.speed_mps: 1.0")
            + section("recorder", "storage: sqlite3")
        )
        code, first = fly(tmp_path / "a", "--one-process", "--duration", 8, "--params", mine)
        again, second = fly(tmp_path / "b", "--params", tmp_path / "a" / "params.yaml")
        assert (again, without_run(second)) == (code, without_run(first))
        assert sorted(first["changed"]) == [
            "inner_loop.gamma", "plant.wind.w20_mps", "recorder.storage",
            "scenario.climb.speed_mps",
        ]  # fmt: skip
        text = (tmp_path / "a" / "params.yaml").read_text()
        gamma = resolve().nodes["inner_loop"]["gamma"]
        assert f"#   inner_loop: gamma: 0.07 (packaged: {gamma})\n" in text

    def test_the_file_says_what_was_flown(self, fly, tmp_path):
        fly(tmp_path / "a", "--one-process", "--gps", "rtk", "--world", "paper", "--seed", 7,
            "--duration", 2)  # fmt: skip
        text = (tmp_path / "a" / "params.yaml").read_text()
        values = yaml.safe_load(text)["/**/flight"]["ros__parameters"]
        assert values == {
            "scenario": "hover", "gps": "rtk", "world": "paper", "laws": "packaged",
            "mode": "one process", "seed": 7, "controller": "hinf_output", "duration_s": 2.0,
            "commit": commit.sources_commit(), "changed": ["none"],
        }  # fmt: skip
        # Changes would be listed in the head, indented.
        assert not re.search(r"(?m)^#  ", text.split("/**/flight")[0])

    def test_real_time(self, tmp_path):
        path = tmp_path / "params.yaml"
        write_parameters(resolve(mode="real time"), path)
        again = resolve(params=[path])
        assert again.mode == "real time"
        assert not any(again.nodes[node.name]["lockstep"] for node in NODES)
        assert resolve(params=[path], mode="lockstep").nodes["plant"]["lockstep"]


class TestContradictions:
    @pytest.fixture
    def flown(self, tmp_path, written):
        """params.yaml of an RTK attitude flight with a weight of its own."""
        mine = written(section("inner_loop", "gamma: 0.07"))
        settings = resolve("attitude", "rtk", 7, 9.0, params=[mine], controller="pid")
        write_parameters(settings, tmp_path / "params.yaml")
        return tmp_path / "params.yaml"

    def test_the_command_line_wins_in_full_and_says_so_in_one_line(self, flown):
        """Not the label alone: scenario and receiver are those asked for; the change stays."""
        settings = resolve("hover", "standalone", 8, 10.0, params=[flown], controller="hinf")
        gamma = {"inner_loop": {"gamma": 0.07}}
        wanted = resolve("hover", "standalone", 8, 10.0, overrides=gamma, controller="hinf")
        for node, values in wanted.nodes.items():
            for key, value in values.items():
                np.testing.assert_array_equal(settings.nodes[node][key], value, f"{node}: {key}")
        assert settings.scenario_parameters.keys() == wanted.scenario_parameters.keys()
        for key, value in wanted.scenario_parameters.items():
            np.testing.assert_array_equal(settings.scenario_parameters[key], value, key)
        assert [(o.option, o.value, o.entry.value) for o in settings.overridden] == [
            ("scenario", "hover", "attitude"),
            ("gps", "standalone", "rtk"),
            ("laws", "hinf", "pid"),
            ("duration", 10.0, 9.0),
            ("seed", 8, 7),
        ]
        (line,) = settings.remarks
        assert all(f"({o.entry.where})" in line for o in settings.overridden)
        assert line.count(f"({flown}:") == 5

    def test_the_same_said_twice_is_no_contradiction(self, flown):
        same = resolve("attitude", "rtk", 7, 9.0, params=[flown], controller="pid")
        assert same.overridden == resolve(params=[flown]).overridden == ()

    def test_an_option_over_a_plain_parameter_is_told_too(self, written):
        mine = written(section("plant", "seed: 4"))
        assert resolve(params=[mine]).seed == 4
        settings = resolve(params=[mine], seed=5)
        (over,), (line,) = settings.overridden, settings.remarks
        assert (over.option, over.value, over.entry.value) == ("seed", 5, 4)
        assert over.entry.where == f"{mine}:3" and line.endswith(f": {over.words}")

    def test_it_is_printed_by_the_command(self, fly, flown, tmp_path, capsys):
        fly(tmp_path / "b", "--params", flown, "--one-process", "--seed", 8)
        lines = [ln for ln in capsys.readouterr().out.splitlines() if "command line wins" in ln]
        assert len(lines) == 1 and "seed 8, not 7" in lines[0]

    def test_a_later_file_wins_over_an_earlier_one(self, flown, written):
        over = written(section("flight", "gps: standalone", "seed: 9"), "over.yaml")
        settings = resolve(params=[flown, over])
        assert (settings.scenario_name, settings.gps, settings.seed) == (
            "attitude",
            "standalone",
            9,
        )
        packaged = resolve("attitude", "standalone").nodes
        for node in ("plant", "observer"):
            for key, value in packaged[node].items():
                if "gps" in key:
                    assert np.array_equal(settings.nodes[node][key], value)
        assert settings.nodes["inner_loop"]["gamma"] == 0.07

    def test_the_section_alone_is_a_flight(self, written):
        mine = written(
            section("flight", "scenario: attitude", "gps: rtk", "seed: 5", "controller: lqr",
                    "duration_s: 7.0", "mode: one process")
        )  # fmt: skip
        settings, wanted = (
            resolve(params=[mine]),
            resolve("attitude", "rtk", 5, 7.0, controller="lqr"),
        )
        assert (settings.gps, settings.mode, settings.scenario.n_ticks) == (
            "rtk",
            "one process",
            700,
        )
        for node, values in wanted.nodes.items():
            for key, value in values.items():
                np.testing.assert_array_equal(settings.nodes[node][key], value)

    @pytest.mark.parametrize(
        ("lines", "words"),
        [
            (["gps: galileo"], ["gps", "galileo", "standalone, rtk"]),
            (["scenario: moon"], ["scenario: moon", "unknown scenario", "attitude"]),
            (["mode: slow"], ["mode", "slow", "real time"]),
            (["seed: -1"], ["seed", "-1"]),
            (["duration_s: 5"], ["duration_s", "write 5.0"]),
            (["recever: rtk"], ["recever", "unknown parameter"]),
        ],
    )
    def test_bad_values_are_one_line_with_their_place(self, written, lines, words):
        mine = written(section("flight", *lines))
        with pytest.raises(ParameterError) as error:
            resolve(params=[mine])
        sentence = str(error.value)
        assert sentence.startswith(f"{mine}:3: ") and "\n" not in sentence
        assert all(word in sentence for word in words)

    def test_a_file_must_agree_with_itself(self, written):
        mine = written(section("flight", "seed: 8") + section("plant", "seed: 7"))
        with pytest.raises(ParameterError) as error:
            resolve(params=[mine])
        assert str(error.value).startswith(f"{mine}:3: flight: seed: 8 ")
        assert re.search(rf"\bplant: seed: 7 \w+ {re.escape(str(mine))}:6\b", str(error.value))


class TestOtherReaders:
    def test_nodes_pass_the_section_over(self, tmp_path):
        """By the nodes' own reader, and by rcl itself."""
        from rclpy.context import Context

        path = tmp_path / "params.yaml"
        write_parameters(resolve("attitude", "rtk", 7, 9.0), path)
        for node in NODES:
            assert load(node.table, [path], node.name)["lockstep"] is True
        context = Context()
        context.init(args=["--ros-args", "--params-file", str(path)])
        context.try_shutdown()

    def test_a_campaign_takes_scenario_and_receiver_from_it(self, tmp_path, capsys):
        path = tmp_path / "params.yaml"
        write_parameters(resolve("attitude", "rtk", 7, 6.0), path)
        assert app.main(["campaign", "--seeds", "1", "--params", str(path), "--json"]) == 0
        content = json.loads(capsys.readouterr().out)
        assert content["scenario"] == "attitude" and list(content["receivers"]) == ["rtk"]


class TestCommit:
    def test_of_these_sources(self):
        root = Path(__file__).resolve().parents[3]
        done = subprocess.run(
            ["git", "-C", str(root), "rev-parse", "HEAD"], capture_output=True, text=True
        )
        if done.returncode:
            assert commit.sources_commit() == "unknown"
        else:
            assert commit.sources_commit().startswith(done.stdout.strip())

    def test_without_git(self, monkeypatch, tmp_path):
        monkeypatch.setenv("PATH", str(tmp_path))
        assert commit.sources_commit.__wrapped__() == "unknown"

    def test_in_somebody_elses_repository(self, monkeypatch, tmp_path):
        """An environment inside another project: its commit is not that of these sources."""
        subprocess.run(["git", "init", "-q", str(tmp_path)], check=True)
        copy = tmp_path / "commit.py"
        copy.write_text("")
        monkeypatch.setattr(commit, "__file__", str(copy))
        assert commit.sources_commit.__wrapped__() == "unknown"

    def test_another_one_is_told(self, tmp_path):
        path = tmp_path / "params.yaml"
        write_parameters(resolve(), path)
        text = path.read_text()
        path.write_text(text.replace(commit.sources_commit(), 40 * "f"))
        settings = resolve(params=[path])
        if commit.sources_commit() == "unknown":
            assert settings.remarks == ()
        else:
            (line,) = settings.remarks
            assert line.startswith(f"{path} ") and f" {12 * 'f'}, " in line


class TestWhatIsNotRead:
    @staticmethod
    def names(*args, **kwargs):
        return {one.parameter: one.instead for one in resolve(*args, **kwargs).unread}

    def test_a_parameter_of_another_controller_is_named_with_what_is_read(self, written):
        file = written(section("inner_loop", "gamma: 0.056", "pid: {K_P: [1.0, 1.0, 1.0]}"))
        assert self.names(params=[file]) == {"gamma": "output.gamma", "pid.K_P": ""}
        assert self.names(params=[file], controller="hinf") == {"pid.K_P": ""}
        assert self.names(params=[file], controller="pid") == {"gamma": ""}
        assert self.names(overrides={"inner_loop": {"gamma": 0.3}}) == {"gamma": "output.gamma"}
        assert len(resolve(params=[file]).remarks) == 1

    def test_what_is_as_packaged_changes_nothing_anyway(self, written):
        file = written(section("inner_loop", "gamma: 0.0632", "margin_floor: 0.1"))
        assert self.names(params=[file]) == {}

    def test_a_flight_s_own_file_names_nothing(self, tmp_path):
        write_parameters(resolve(), tmp_path / "params.yaml")
        assert self.names(params=[tmp_path / "params.yaml"]) == {}
