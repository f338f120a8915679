# SPDX-License-Identifier: Apache-2.0
"""Numbers that the READMEs publish are those of the result files, and these are true (nightly)."""

import json
import re
import shutil

import pytest

from evidence import files
from evidence.markdown import markdown_files, rendered
from evidence.registry import Producer, chosen, load
from heli_core.errors import FlightError, InfeasibleGammaError, UnstableLoopError
from heli_flight.cli import app as cli

ROOT = files.checkout()
MARKDOWN = {str(path.relative_to(ROOT)): path for path in markdown_files(ROOT)}
NOT_MADE = re.search(
    r"(?m)^\*\*Not made yet\*\*.*$", (ROOT / files.FOLDER / "README.md").read_text(encoding="utf-8")
)
load()
PRODUCERS = chosen([])
MADE = [p for p in PRODUCERS if files.path_of(ROOT, p.name).is_file()]
NAMES = [producer.name for producer in MADE]
# First lines of tables that hold no measurement: what exists, how often, what is allowed.
DESCRIPTIVE = {
    "| what | who has it | here |",
    "| topic | type | direction | rate |",
    "| command | what it does | exit code |",
    "| module | what it holds |",
    "| file | what | quality of the data |",
    "| name | action | task |",
    "| name | args | what happens |",
    "| call | gives |",
    "| package | what lives there |",
    "| I want to | |",
    # docs/site/README.md: files of others
    "| file | package | source | licence | SHA-256 starts with |",
    "| what | the paper's figure | from |",
    "| step | what happens | where |",
    "| it is about | it belongs to |",
    # docs/ros.md, out of the code's tables
    "| topic | type | rate | frame | from | to |",
    "| node | package | what active means |",
    "| name | allowed | default | set | meaning |",
    # docs/failsafes.md, likewise; the times are bounds that its tests fly
    "| condition | detected by | within | action | recovery | what a user sees |",
    # docs/howto/ardupilot.md: of a protocol
    "| what | how |",
    "| what comes | what is done |",
    # docs/doors.md: what was run against what, and in which version
    "| door | other side | version | what was done | how often |",
    # docs/howto/mavlink.md: of a protocol, and of its peers
    "| message | what becomes of it |",
    "| peer | version | what was flown | how often |",
    # docs/field_reports.md: of whom, not measured
    "| reported at | what | tried | what happened | what is right |",
    # definitions, not measured
    "| `--mte` | paragraph | time, s | position or track, ft | altitude or height, ft "
    "| heading, deg | besides |",
    "| measure | definition | Level 1, Level 2 |",
    "| sensor | error | model | parameters `sensors.*` |",
    "| name | aircraft | published | what is ours |",
}


@pytest.mark.parametrize("name", MARKDOWN)
def test_what_stands_between_markers_is_what_the_files_give(name):
    """If not: ./heli results render"""
    text = MARKDOWN[name].read_text(encoding="utf-8")
    assert text == rendered(text, MARKDOWN[name], ROOT)


@pytest.mark.parametrize("name", MARKDOWN)
def test_no_line_begins_with_a_marker_of_a_number(name):
    """In Markdown a line that begins with a comment ends the paragraph before it."""
    text = MARKDOWN[name].read_text(encoding="utf-8")
    assert re.findall(r"(?m)^\s*<!-- value: .*$", re.sub(r"(?s)```.*?```", "", text)) == []


@pytest.mark.parametrize("name", MARKDOWN)
def test_every_table_with_numbers_is_rendered(name):
    text = MARKDOWN[name].read_text(encoding="utf-8")
    by_hand = re.sub(r"(?s)<!-- results: .*?<!-- end -->", "", text)
    tables = re.findall(r"(?m)^\|.*(?:\n\|.*)+", by_hand)
    heads = [table.splitlines()[0] for table in tables if re.search(r"\d", table)]
    assert set(heads) - DESCRIPTIVE == set()


def test_what_has_no_file_is_said():
    listed = set(re.findall(r"`(\w+)`", NOT_MADE[0] if NOT_MADE else ""))
    assert listed == {producer.name for producer in PRODUCERS} - set(NAMES)


def test_every_file_is_published():
    read = set()
    for path in MARKDOWN.values():
        text = path.read_text(encoding="utf-8")
        read |= set(re.findall(r"<!-- value: (\S+) ", text))
        read |= set(re.findall(r"\(\S*results/(\w+)\.json\)", text))
    assert read - {"FILE"} == set(NAMES)


@pytest.mark.parametrize("producer", MADE, ids=NAMES)
def test_a_file_says_what_made_it(producer):
    content = files.read(ROOT, producer.name)
    assert content["command"] == producer.command
    assert content["seeds"] == list(producer.seeds)
    assert re.fullmatch(r"[0-9a-f]{40}", content["commit"])
    assert {"python", "numpy", "scipy", "numba"} <= set(content["versions"])
    assert content["processor"]["name"] and content["processor"]["compiled_for"]


def test_what_the_readmes_say_of_the_laws_is_so():
    """The sentences below the tables: who is better in what, on how many of twenty seeds."""

    def wins(file, source, law="hinf"):
        rows = files.read(ROOT, file)["found"]["summary"]
        row = next(row for row in rows if (row["law"], row["source"]) == (law, source))
        return row["roll_wins_over_pid"], row["pitch_wins_over_pid"]

    for file, source in (("laws", "truth"), ("laws_gusts", "truth"), ("laws_gusts", "ideal")):
        assert wins(file, source)[0] >= 13  # better in roll on most seeds
    assert max(wins("laws", "ideal")) <= 8  # the PID on most seeds
    assert wins("laws_gusts", "ideal")[1] == 0  # the PID in pitch, on every seed
    assert 6 <= wins("laws_gusts", "truth")[1] <= 14  # on about half
    assert max(wins("laws_flap_back", "truth")) <= 2  # the PID in both

    assert min(wins("laws_gusts", "truth", "hinf_output")) >= 16  # most
    assert wins("laws_gusts", "ideal", "hinf_output") == (20, 20)
    assert wins("laws_flap_back", "truth", "hinf_output") == (0, 20)  # the PID in roll

    rows = files.read(ROOT, "laws_flap_back")["found"]["summary"]
    worst = {r["law"]: r["pitch_max_deg"] for r in rows if r["source"] == "truth"}
    gap = worst["hinf"] - worst["pid"]
    assert 0.4 < (worst["hinf"] - worst["hinf_offset_free"]) / gap < 0.5  # nearly half of that
    assert abs(worst["hinf"] - worst["lqr"]) < 0.1 * gap  # hardly differ


def test_what_the_readmes_say_of_the_default_is_so():
    """Ahead of the PID in other worlds than its own on most flights, behind INDI and LQG, stable
    further out than LQG; what flew before it is the worst of eight there, but stable further."""
    laws = files.read(ROOT, "laws_everywhere")["found"]
    assert laws["default"] == "hinf_output"
    other = [row for row in laws["rows"] if row["place"].startswith(("honest", "hard"))]
    assert len({row["law"] for row in other}) == 8
    for place, axis in {(row["place"], row["axis"]) for row in other}:
        here = {r["law"]: r for r in other if (r["place"], r["axis"]) == (place, axis)}
        assert max(here, key=lambda law, here=here: here[law]["median_deg"]) == "hinf"
        packaged = here["hinf_output"]
        assert here["hinf"]["won_over_pid"] < 0.3 * packaged["flown"]
        assert packaged["won_over_pid"] > 0.6 * packaged["flown"]
        assert all(here[law]["median_deg"] < packaged["median_deg"] for law in ("indi", "lqg"))

    robust = files.read(ROOT, "robust")["found"]
    sizes = {law["laws"]: law["at_most"] for law in robust["others"]}
    packaged = [case["exact_onset"] for case in robust["packaged"]["cases"]]
    for least, ours, most in zip(sizes["lqg"], packaged, sizes["hinf"], strict=True):
        assert least < ours < most


def test_what_the_readmes_say_of_paths_is_so():
    """With RTK all are inside the goals, in the hover test's own wind and in honest."""
    inside = {
        (row["scenario"], row["world"]): row["inside"]
        for row in files.read(ROOT, "paths")["found"]["rows"]
        if row["gps"] == "rtk"
    }
    assert {n for (_, world), n in inside.items() if world in ("paper", "honest")} == {20}


def test_what_is_said_of_the_laws_in_the_hover_is_so():
    """Of 40 seeds in honest: how often the others are closer, and how far the servo moves."""
    rows = files.read(ROOT, "laws_hover")["found"]["rows"]
    honest = {row["law"]: row for row in rows if row["world"] == "honest"}
    for law in ("pid", "indi", "lqg"):
        assert max(honest[law]["attitude"]["below_default"]) <= 13  # on at least two of three
        assert max(honest[law]["behind"]["below_default"]) <= 5  # on at least 35
        assert (
            honest["hinf_output"]["travel_per_s"]["d_lat"]
            > 2 * honest[law]["travel_per_s"]["d_lat"]
        )
    assert honest["mu"]["attitude"]["below_default"][1] > 20
    assert 15 <= honest["hinf_output"]["attitude"]["inside"] <= 25
    for row in rows:
        if row["world"] != "hard" and row["law"] != "paper":
            assert row["inside"]["paper"] == 40
        if row["world"] == "hard" and row["law"] != "paper":
            assert 15 <= row["inside"]["paper"] <= 25  # about half


DEARER = "angles three times as dear", "commands four times as dear"
"""Variants of the tutorial's weights."""


def test_what_the_tutorial_says_of_gamma_and_the_weights_is_so():
    """Gamma alone hardly moves the errors; dear angles nearly halve them; dear commands double."""
    rows = {row["variant"]: row for row in files.read(ROOT, "gamma")["found"]["rows"]}
    soft, close = rows["gamma 0.2"], rows["gamma 0.056"]
    assert 3.5 < soft["gamma"] / soft["gamma_star"] < 4.5
    assert close["angles_deg_per_mps"] < soft["angles_deg_per_mps"]
    assert close["commands_per_mps"] > soft["commands_per_mps"]
    for axis in ("roll", "pitch"):
        errors = {name: row["errors_deg"] for name, row in rows.items() if not row["refused"]}
        before = errors["gamma 0.2"]["honest"][axis]
        assert abs(errors["gamma 0.056"]["honest"][axis] / before - 1.0) < 0.07
        angles, commands = (errors[name]["honest"][axis] for name in DEARER)
        assert 0.5 < angles / before < 0.6 and commands / before > 2.0
        spread = [row["paper"][axis] for row in errors.values()]
        assert max(spread) - min(spread) < 0.2
    refused = rows["commands a quarter as dear"]["refused"]
    radius = float(refused.split("; ")[0].split()[-1])
    assert radius > 1.0 and refused == str(UnstableLoopError("hinf", radius))
    least = rows["gamma 0.2"]["gamma_star"]
    assert 0.05 < least and rows["gamma 0.05"]["refused"] == str(InfeasibleGammaError(0.05, least))


def test_what_the_first_page_says_of_the_whole_flight_is_so():
    """Of the climb, too: its reference can be flown, so vertical speed errs by less than the 1.25
    m/s of a step, on the median flight of each world."""
    for place in files.read(ROOT, "worlds")["found"]["places"]:
        rows = [r for r in place["metrics"] if (r["stretch"], r["key"]) == ("whole", "v_z")]
        assert len(rows) >= 2 and max(row["median"] for row in rows) < 1.25


@pytest.mark.nightly
@pytest.mark.timeout(7200)
@pytest.mark.parametrize("producer", MADE, ids=NAMES)
def test_a_command_says_again_what_its_file_says(producer):
    if producer.needs:
        pytest.importorskip(producer.needs)
    stored, made = files.read(ROOT, producer.name), files.make(ROOT, producer)
    assert files.differences(stored, made, producer) == []


def test_the_command_checks_a_file(capsys):
    assert cli.main(["results", "check", "deviations"]) == 0
    (line,) = capsys.readouterr().out.splitlines()
    assert line.startswith("deviations: ")
    assert cli.main(["results", "check", "weather"]) == 2
    error = capsys.readouterr().err
    assert "'weather'" in error and all(producer.name in error for producer in PRODUCERS)


@pytest.fixture
def copy(tmp_path):
    """A checkout with a README and the result files of the deviations."""
    (tmp_path / files.FOLDER).mkdir(parents=True)
    shutil.copy(files.path_of(ROOT, "deviations"), files.path_of(tmp_path, "deviations"))
    file = tmp_path / "README.md"
    text = "a\n<!-- results: deviations -->\n<!-- end -->\n"
    text += "<!-- value: deviations rows.0.ours .3f -->?<!-- end --> b\n"
    file.write_text(rendered(text, file, tmp_path))
    return file


def says(file):
    """Whether a file says what its results give."""
    text = file.read_text()
    return text == rendered(text, file, file.parent)


def test_a_cell_changed_by_hand_is_found(copy):
    text = copy.read_text()
    assert says(copy) and text.startswith("a\n") and text.endswith("b\n")
    number = re.search(r"\| (-?\d+\.\d{4}) \|", text)[1]
    copy.write_text(text.replace(number, number[:-1] + ("1" if number[-1] != "1" else "2")))
    assert not says(copy)
    copy.write_text(re.sub(r"(rows.0.ours .3f -->)[^<]*", r"\g<1>7", text))
    assert not says(copy)


def test_a_table_without_its_file_says_how_to_make_it(copy):
    copy.write_text("a\n<!-- results: cpu_types -->\n1 2\n<!-- end -->\nb\n")
    hint = "Not measured yet: `./heli results make cpu_types` does it."
    new = rendered(copy.read_text(), copy, copy.parent)
    assert new == f"a\n<!-- results: cpu_types -->\n\n{hint}\n\n<!-- end -->\nb\n"
    copy.write_text(new)
    assert says(copy)


def test_a_file_changed_without_rendering_is_found(copy):
    path = files.path_of(copy.parent, "deviations")
    content = json.loads(path.read_text())
    content["found"]["rows"][0]["ours"] += 0.01
    files.write(copy.parent, "deviations", content)
    assert json.loads(path.read_text()) == content
    assert not says(copy)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<!-- results: weather -->\n<!-- end -->", "no such table"),
        ("<!-- value: weather a .3f --><!-- end -->", "weather.json is missing"),
        ("<!-- value: deviations rows.0.theirs .3f --><!-- end -->", "KeyError('theirs')"),
        ("<!-- value: deviations rows.9999.ours .3f --><!-- end -->", "IndexError"),
        ("<!-- value: deviations rows.0.entry .3f --><!-- end -->", "ValueError"),
    ],
)
def test_a_marker_of_nothing_is_named(copy, text, words):
    with pytest.raises(FlightError, match=re.escape(words)):
        rendered(text, copy, copy.parent)


class TestDifferences:
    PRODUCER = Producer("a", "./heli b", "c", relative=1e-6, loose={"s": float("inf"), "n": 0.1})
    HERE = {"processor": {"name": "x"}, "versions": {"numpy": "2"}}
    FOUND = {"rows": [{"v": 1.0, "k": 3, "t": "x", "s": 9.0, "n": 100}]}

    def differing(self, machine, **changes):
        row = {**self.FOUND["rows"][0], **changes}
        made = {**self.HERE, **machine, "found": {"rows": [row]}}
        return files.differences({**self.HERE, "found": self.FOUND}, made, self.PRODUCER)

    def test_the_same_machine_must_give_the_same_bits(self):
        assert self.differing({}) == []
        (line,) = self.differing({}, v=1.0 + 2e-16)
        place, numbers = line.split(": ")
        assert place == "rows[0].v"
        assert re.findall(r"\d\.\d+", numbers) == ["1.0", "1.0000000000000002"]

    @pytest.mark.parametrize("machine", [{"processor": {"name": "y"}}, {"versions": {}}])
    def test_another_machine_has_its_tolerance(self, machine):
        assert self.differing(machine, v=1.0 + 5e-7) == []
        assert len(self.differing(machine, v=1.0 + 5e-6)) == 1
        assert len(self.differing(machine, k=4)) == 1
        assert len(self.differing(machine, t="y")) == 1
        assert len(self.differing(machine, v=None)) == 1

    def test_blas_for_another_processor_is_another_machine(self, monkeypatch):
        """OPENBLAS_CORETYPE chooses among sums of another order."""
        monkeypatch.setenv("OPENBLAS_CORETYPE", "Haswell")
        machine = {"processor": files.processor()}
        monkeypatch.delenv("OPENBLAS_CORETYPE")
        assert machine != {"processor": files.processor()}
        assert machine["processor"]["blas"] == "Haswell"

    def test_what_depends_on_the_load_is_not_held_to_bits(self):
        assert self.differing({}, s=4.0, n=105) == []
        assert len(self.differing({}, n=120)) == 1
        assert len(self.differing({}, more=1)) == 1


class TestMake:
    def test_a_command_that_fails_is_named(self, capfd):
        with pytest.raises(FlightError, match="exit code 2"):
            files.make(ROOT, Producer("a", "./heli compare attitude --seeds x --json", "b"))
        assert "write 1..20" in capfd.readouterr().err

    def test_output_that_is_no_json_is_named(self):
        with pytest.raises(FlightError) as caught:
            files.make(ROOT, Producer("a", "./heli results list", "b"))
        assert isinstance(caught.value.__context__, json.JSONDecodeError)
        assert str(caught.value).startswith("a: ./heli results list: ")
