# SPDX-License-Identifier: Apache-2.0
"""The command `heli`: help with examples, JSON, pictures, and one line for bad input."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer

from heli_core.errors import InfeasibleGammaError
from heli_flight.cli import app as cli
from heli_flight.cli import sections
from heli_flight.loop import simulate
from heli_flight.scoring import score
from heli_flight.settings import resolve
from heli_inner_hinf.design import AttitudeConfig
from heli_studies import compare as compare_robustness
from heli_studies import compare as laws

ROOT = Path(__file__).resolve().parents[2]


def commands_of(group, words=()):
    """Words of every command below a group."""
    for name, command in group.commands.items():
        if hasattr(command, "commands"):
            yield from commands_of(command, (*words, name))
        else:
            yield [*words, name]


COMMANDS = list(commands_of(typer.main.get_command(cli.app)))


def heli(capsys, *words):
    """Exit code, stdout, stderr of a command."""
    code = cli.main([str(word) for word in words])
    out, err = capsys.readouterr()
    return code, out, err


def refused(capsys, *words):
    """The one line of a refusal."""
    code, out, err = heli(capsys, *words)
    assert code == 2
    assert out == ""
    lines = err.splitlines()
    assert len(lines) == 1, err
    return lines[0]


@pytest.fixture(scope="module")
def designed(tmp_path_factory):
    """Folder of one design, made by the command."""
    folder = tmp_path_factory.mktemp("design") / "out"
    assert cli.main(["design", "--gamma-factor", "1.2", "--out", str(folder)]) == 0
    return folder


def test_the_commands_are_known():
    assert {"hover", "campaign", "design", "report", "compare"} <= {words[0] for words in COMMANDS}


def test_help_says_what_exit_code_0_means(capsys):
    """Exactly: of which record, of which stretches, and what is not judged."""
    for command in ("hover", "campaign"):
        help_text = " ".join(heli(capsys, command, "--help")[1].split())
        for part in (
            "Judged are the scored windows alone", "the state estimate",
            "with an RTK receiver ground truth, too", "ends before the first of them is not judged",
            "whole flight, climb included, are given first and decide nothing",
        ):  # fmt: skip
            assert part in help_text


@pytest.mark.parametrize(
    ("words", "judged"),
    [
        (("--duration", "30"), "judged: state estimate, 5 to 18 s and 25 to 30 s"),
        (("--duration", "6", "--gps", "rtk"),
         "judged: state estimate and ground truth, 5 to 6 s"),
    ],
)  # fmt: skip
def test_a_flight_says_what_is_judged(capsys, tmp_path, words, judged):
    flight = ("hover", "--one-process", "--no-report", "--out", tmp_path / "f", *words)
    _, out, _ = heli(capsys, *flight)
    assert judged in out
    result = json.loads((tmp_path / "f" / "result.json").read_text())
    assert f"judged: {result['judged']}" == judged


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_help_has_an_example(capsys, command):
    code, out, _ = heli(capsys, *command, "--help")
    assert code == 0
    assert "example" in out
    assert " ".join(["heli", *command]) in out


def test_help_does_not_import_what_flies(tmp_path):
    """Import lazily: help must not wait for numba, matplotlib or ROS."""
    code = (
        "import sys\n"
        "from heli_flight.cli import app as cli\n"
        "from heli_flight.cli import hover_test\n"
        "for words in (['design', '--help'], ['hover', '--help'], ['python', '--help']):\n"
        "    cli.main(words)\n"
        "hover_test.main(['--help'])\n"
        "print('LOADED', [m for m in ('numpy', 'numba', 'matplotlib', 'scipy', 'rclpy')"
        " if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, timeout=150, check=True
    )
    assert done.stdout.endswith("LOADED []\n")


def test_wrapper_is_a_program():
    wrapper = ROOT / "heli"
    assert os.access(wrapper, os.X_OK)
    assert "heli_start heli " in wrapper.read_text()


@pytest.mark.parametrize("name", ["heli", "hover_test"])
@pytest.mark.parametrize("content", [None, "__version__ = '0.9.0'"])
def test_ubuntus_typer_is_refused_in_a_sentence(tmp_path, name, content):
    """Noble has 0.9: no exceptions module, no `Path | None`."""
    code = (
        "sys.path.insert(0, sys.argv.pop(1)); from heli_flight.start import main; sys.exit(main())"
    )
    if content is None:
        code = f"sys.modules['typer'] = None; {code}"
    else:
        (tmp_path / "typer").mkdir()
        (tmp_path / "typer/__init__.py").write_text(content)
    command = [sys.executable, "-c", f"import sys; {code}", str(tmp_path), name, "--help"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr.startswith(f"{name}: ") and " typer 0.29 " in done.stderr
    assert len(done.stderr.splitlines()) == 1


class TestPrograms:
    """heli run and heli python, as another program sees them."""

    def run(self, *words, text=""):
        command = [sys.executable, "-m", "heli_flight.cli.app", *words]
        return subprocess.run(command, input=text, capture_output=True, text=True, timeout=120)

    def test_python_is_this_environments_and_gets_every_word(self):
        """Options, too, and --help; the exit code is the program's."""
        code = "import sys, heli_flight; print(sys.executable, sys.argv[1:]); sys.exit(7)"
        done = self.run("python", "-c", code, "--help", "-x", "a b")
        assert done.returncode == 7
        assert done.stdout == f"{sys.executable} ['--help', '-x', 'a b']\n"
        assert self.run("python", "-", text="print(1 + 1)").stdout == "2\n"

    def test_a_node_gets_every_word(self):
        done = self.run("run", "heli_observer", "observer", "--quickly")
        assert done.returncode == 2
        assert done.stderr.startswith("observer: ") and "'--quickly'" in done.stderr

    def test_a_nodes_help_is_its_own(self):
        done = self.run("run", "heli_observer", "observer", "--help")
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.split()[:5] == ["usage:", "ros2", "run", "heli_observer", "observer"]

    def test_a_node_that_is_not_there_is_bad_input(self):
        done = self.run("run", "heli_observer", "obsever")
        assert done.returncode == 2
        assert done.stderr.startswith("heli: ") and " lib/heli_observer/obsever " in done.stderr
        assert len(done.stderr.splitlines()) == 1


class TestDesign:
    def test_writes_pictures_and_yaml(self, designed):
        names = {path.name for path in designed.iterdir()}
        pictures = {"singular_values.png", "margins.png", "step.png"}
        assert names == pictures | {"design.yaml", "design.json"}
        for name in pictures:
            assert (designed / name).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"

    def test_certificate_and_margins(self, designed):
        design = json.loads((designed / "design.json").read_text())
        # As closely as the infimum is found.
        assert design["gamma"] == pytest.approx(1.2 * design["gamma_star"]["value"], rel=1e-4)
        assert design["norm"] < design["gamma"]
        certificate = design["state_feedback"]["certificate"]
        assert len(certificate) == 6 and all(c["holds"] for c in certificate)
        # Output feedback is no state feedback behind an observer: there is no loop without them.
        (flown,) = design["loops"]
        assert flown["name"] == "as flown"
        assert min(flown["disk_input"], flown["disk_output"]) >= 0.5
        assert design["further_delay_s"] >= 0.02

    def test_nodes_load_it(self, designed):
        """Every node takes the file, and the inner loop's own synthesis gives the same F."""
        design = json.loads((designed / "design.json").read_text())
        settings = resolve(params=[designed / "design.yaml"])
        config = AttitudeConfig.from_parameters(settings.nodes["inner_loop"])
        assert np.allclose(config.synthesis.F, design["state_feedback"]["F"], rtol=1e-9, atol=1e-12)
        assert np.array_equal(settings.nodes["observer"]["K"], design["K"])
        assert np.array_equal(settings.nodes["observer"]["model.A"], config.A)
        assert settings.nodes["outer_loop"]["trim.phi"] == config.x_trim[0]

    def test_it_flies_inside_the_paper(self, designed):
        settings = resolve(gps="rtk", seed=101, params=[designed / "design.yaml"])
        flight = simulate(settings)
        assert flight.sentence == ""
        assert all(s.inside for s in score(flight.record, settings.scenario).windows)

    def test_default_design_is_the_packaged_one(self, capsys):
        """The packaged YAMLs hold what the command finds for the packaged aircraft."""
        code, out, _ = heli(capsys, "design", "--json")
        assert code == 0
        design, packaged = json.loads(out), resolve().nodes
        assert np.allclose(design["K"], packaged["observer"]["K"], atol=1e-6)
        inner = AttitudeConfig.from_parameters(packaged["inner_loop"])
        assert np.allclose(design["state_feedback"]["F"], inner.synthesis.F, atol=1e-5)
        unknown = resolve("identify_actuators").nodes["inner_loop"]
        for i, axis in enumerate(("roll", "pitch", "yaw")):
            assert design["pid"][axis]["K_P"] == pytest.approx(unknown["pid.K_P"][i], rel=1e-5)

    @pytest.mark.slow
    def test_another_aircraft(self, tmp_path, capsys):
        """A heavier one with slower servos: the YAML names it and tells every node of it."""
        packaged = ROOT / "src/heli_dynamics_sim/config/aircraft/helion.yaml"
        text = packaged.read_text()
        text = text.replace("mass_kg: 9.750", "mass_kg: 10.5")
        mine = tmp_path / "mine.yaml"
        mine.write_text(text.replace("bandwidth_radps: 38.0", "bandwidth_radps: 30.0"))
        out = tmp_path / "design"
        code, _, _ = heli(
            capsys, "design", "--aircraft", mine, "--gamma-factor", "1.25", "--out", out
        )
        assert code == 0
        nodes = resolve("attitude", params=[out / "design.yaml"]).nodes
        assert nodes["plant"]["aircraft_file"] == str(mine)
        assert nodes["outer_loop"]["mass"] == 10.5
        assert nodes["observer"]["servo.frequency_radps"] == 30.0
        assert nodes["inner_loop"]["prediction_s"] == pytest.approx(0.015 + 2 * 0.51 / 30, abs=5e-4)
        assert nodes["outer_loop"]["trim.d_col"] < resolve().nodes["outer_loop"]["trim.d_col"]

    def test_infeasible_gamma_is_the_same_sentence_everywhere(self, capsys, tmp_path):
        """Command, YAML through hover, and the library say the same."""
        sentence = refused(capsys, "design", "--gamma", "0.03").removeprefix("heli: ")
        file = tmp_path / "gamma.yaml"
        file.write_text("/**/inner_loop:\n  ros__parameters:\n    output: {gamma: 0.03}\n")
        with pytest.raises(InfeasibleGammaError) as error:
            simulate(resolve(params=[file]))
        assert sentence.startswith("output.gamma = 0.03 ")
        star = error.value.gamma_star
        assert f"{star:.8g}"[:8] in sentence
        through_yaml = refused(capsys, "design", "--params", file).removeprefix("heli: ")
        assert through_yaml == sentence

    @pytest.mark.parametrize(
        ("words", "part"),
        [
            (["--gamma", "nan"], "gamma = nan is infeasible"),
            (["--gamma-factor", "1.0", "--attitude-controller", "hinf"], "is infeasible"),
            (["--gamma-factor", "0.99"], "output.gamma"),
            (["--gamma", "0.06", "--attitude-controller", "lqg"], "hinf_output and hinf"),
            (["--gamma", "0.06", "--gamma-factor", "1.2"], "one of them, not both"),
            (["--aircraft", "nope.yaml"], "no such aircraft file"),
            (["--params", "nope.yaml"], "nope.yaml"),
            (["--gamma", "much"], "--gamma"),
            (["--weights", "3"], "--weights"),
        ],
    )
    def test_bad_input_is_one_line(self, capsys, words, part):
        assert part in refused(capsys, "design", *words)

    def test_weight_matrix_is_named(self, capsys, tmp_path):
        file = tmp_path / "weights.yaml"
        values = ", ".join(["0.0"] * 9)
        file.write_text(f"/**/inner_loop:\n  ros__parameters:\n    D11: [{values}]\n")
        assert re.search("D11 .*invertible", refused(capsys, "design", "--params", file))

    def test_existing_folder_is_refused(self, capsys, tmp_path):
        for command in (["design"], ["compare", "attitude"]):
            sentence = refused(capsys, *command, "--out", tmp_path)
            assert sentence.startswith(f"heli: --out {tmp_path}: exists ")


class TestCompareAttitude:
    def test_json_is_what_the_scoring_says(self, capsys):
        """Two seeds: the numbers of the comparison against those of the hover test's scoring."""
        words = ("compare", "attitude", "--seeds", "101,102", "--attitude-controller", "hinf,pid")
        code, out, _ = heli(capsys, *words, "--duration", "8", "--json")
        assert code == 0
        comparison = json.loads(out)
        assert len(comparison["flights"]) == 2 * 2 * 2
        for law in ("hinf", "pid"):
            settings = resolve(
                "attitude", seed=102, duration_s=8.0, overrides={"inner_loop": {"controller": law}}
            )
            expected = {
                (s.metric.key, s.source): s.max
                for s in score(simulate(settings).record, settings.scenario).windows
            }
            for flight in comparison["flights"]:
                if (flight["law"], flight["seed"]) == (law, 102):
                    wanted = [expected[axis, flight["source"]] for axis in laws.AXES]
                    assert flight["max_deg"] == pytest.approx(wanted, rel=1e-9)

    @pytest.mark.slow
    def test_h_infinity_beats_the_pid_in_roll_gusts(self, capsys, tmp_path):
        out = tmp_path / "gusts"
        words = ("compare", "attitude", "--gusts", "--seeds", "101..103", "--ideal-navigation")
        code, text, _ = heli(capsys, *words, "--out", out)
        assert code == 0
        assert re.search(r"\b8 discrete gusts .*\b8 m/s", text) and "| H-infinity " in text
        comparison = json.loads((out / "attitude.json").read_text())
        rows = {(row["law"], row["source"]): row for row in comparison["summary"]}
        # By truth the navigation's own error is in it: on seed 103 the PID is .01 deg closer.
        for source, wins in (("navigation", 3), ("truth", 2), ("ideal", 3)):
            assert rows["hinf", source]["roll_wins_over_pid"] == wins
            assert rows["hinf", source]["roll_max_deg"] < rows["pid", source]["roll_max_deg"]
            assert rows["hinf", source]["roll_max_deg"] < 1.0
            assert rows["hinf", source]["pitch_max_deg"] < 1.0
            assert rows["pid", source]["roll_wins_over_pid"] is None
        assert (out / "attitude.png").read_bytes()[:4] == b"\x89PNG"

    def test_a_rotor_that_flaps_back_flies_as_in_the_study_of_robustness(self, capsys):
        words = ("compare", "attitude", "--gusts", "--flap-back", "--seeds", "101")
        code, out, _ = heli(
            capsys, *words, "--attitude-controller", "pid", "--duration", "10", "--json"
        )
        comparison = json.loads(out)
        assert (code, comparison["flap_back_radpmps"]) == (0, pytest.approx(0.00031, rel=0.016))
        row = next(f for f in comparison["flights"] if f["source"] == "truth")
        settings = resolve("attitude_gusts", duration_s=10.0)
        campaign = compare_robustness.RobustnessSetup(settings, laws.parse_laws("pid"))
        assert max(row["max_deg"]) == campaign.fly(("flap_back",), 101)["pid"]

    @pytest.mark.parametrize(
        ("words", "part"),
        [
            (["--seeds", "20..x"], "--seeds 20..x"),
            (["--attitude-controller", "hinf,mpc"], "'mpc' is none of hinf"),
            (["--gps", "gallileo"], "unknown preset"),
            (["--duration", "-1"], "--duration"),
        ],
    )
    def test_bad_input_is_one_line(self, capsys, words, part):
        assert part in refused(capsys, "compare", "attitude", *words)

    def test_lost_helicopter_is_told(self, capsys, tmp_path):
        file = tmp_path / "tilt.yaml"
        file.write_text("/**/plant:\n  ros__parameters:\n    limits.distance_m: 1.0\n")
        words = ("--seeds", "101", "--attitude-controller", "pid", "--params", file)
        code, out, _ = heli(capsys, "compare", "attitude", *words, "--json")
        assert code == 0
        comparison = json.loads(out)
        assert (
            comparison["summary"][0]["lost"] == 1
            and comparison["summary"][0]["roll_max_deg"] is None
        )
        assert "flew away" in comparison["flights"][0]["lost"]


class TestCompareRobustness:
    def test_json(self, capsys):
        words = ("compare", "robustness", "--n", "2", "--seed", "101", "--duration", "10", "--json")
        code, out, _ = heli(capsys, *words, "--attitude-controller", "hinf,pid")
        assert code == 0
        comparison = json.loads(out)
        rows = {(row["perturbation"], row["law"]): row for row in comparison["outcomes"]}
        assert len(rows) == 2 * len(compare_robustness.PERTURBATIONS)
        assert rows["all", "hinf"]["flown"] == 2 and rows["delay", "pid"]["flown"] == 1
        assert all(0.0 <= row["fraction"] <= 1.0 for row in comparison["outcomes"])
        assert rows["flap_back", "hinf"]["median_deg"] > rows["nominal", "hinf"]["median_deg"]

    def test_bad_input_is_one_line(self, capsys):
        assert "--n" in refused(capsys, "compare", "robustness", "--n", "0")

    def test_unknown_command(self, capsys):
        assert "'fly'" in refused(capsys, "fly")


def test_identify_refuses_bad_input_in_one_line(capsys, tmp_path):
    out = tmp_path / "a"
    code, _, err = heli(capsys, "identify", "--out", out, "--actuators", tmp_path / "no")
    assert code == 2
    assert err.startswith("heli: --actuators and --gusts: ") and err.count("\n") == 1
    bags = ("--actuators", tmp_path / "no", "--gusts", tmp_path / "no")
    code, _, err = heli(capsys, "identify", "--out", out, *bags)
    assert code == 2
    assert err.startswith(f"heli: {tmp_path / 'no'}: ") and err.count("\n") == 1
    assert not out.exists()


@pytest.mark.parametrize("words", [
    ["hover", "--duration", "1", "--one-process", "--out", "PATH"], ["report", "PATH"],
    ["bag", "info", "PATH"], ["bag", "csv", "nowhere", "--out", "PATH"], ["diff", "PATH", "PATH"],
])  # fmt: skip
def test_a_path_that_is_no_utf8_is_named_before_anything_is_done(tmp_path, capsys, words):
    """As the system hands it over: its bytes as surrogates (PEP 383)."""
    path = os.fsdecode(os.fsencode(tmp_path) + b"/\xffout")
    assert cli.main([word.replace("PATH", path) for word in words]) == 2
    out, err = capsys.readouterr()
    assert out == "" and len(err.splitlines()) == 1
    assert str(tmp_path) in err and "UTF-8" in err and err.isascii()
    assert list(tmp_path.iterdir()) == []


def test_help_shows_every_command_in_one_section(capsys):
    """What maintainers run stands apart, at the end."""
    named = [name for names in sections.SECTIONS.values() for name in names]
    assert sorted(named) == sorted({words[0] for words in COMMANDS})
    out = heli(capsys, "--help")[1]
    titles = [f"{title}:" for title in sections.SECTIONS]
    assert [line for line in out.splitlines() if line in titles] == titles
    assert "\n  results " in out[out.index("For maintainers:") :]
    assert f"{sections.OTHER}:" not in out


def test_a_command_that_no_section_names_is_shown_last():
    assert list(sections.in_sections({"hover", "juggle"})) == [
        ("Fly, and read what was flown", ["hover"]),
        (sections.OTHER, ["juggle"]),
    ]
