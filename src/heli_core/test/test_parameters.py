# SPDX-License-Identifier: Apache-2.0
"""Parameter tables and files: what is accepted, what is refused, and why."""

import math
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from heli_core import rcl_yaml
from heli_core import rcl_yaml as rcl_dump
from heli_core.parameters import Parameter, load, refusal, stated, why_refused
from heli_core.rcl_yaml import ParameterCause as Cause
from heli_core.rcl_yaml import ParameterError, check_node_names, dump_all, opened

TABLE = (
    Parameter("mass_kg", "double", "mass", unit="kg", lower=0.0, lower_open=True, upper=100.0),
    Parameter("wind.speed_mps", "double", "speed", unit="m/s", lower=0.0, upper=30.0),
    Parameter("wind.profile", "string", "profile", choices=("constant", "power_law")),
    Parameter("seed", "int", "seed", lower=0, read_only=True),
    Parameter("gust", "bool", "gust"),
    Parameter("c11", "double[]", "weight", shape=(2, 2)),
    Parameter("table", "double[]", "rows of three", shape=(None, 3)),
    Parameter("topics", "string[]", "topics", was="subjects"),
)
DEFAULTS = """
/**/plant:
  ros__parameters:
    mass_kg: 9.75
    wind:
      speed_mps: 3.0
      profile: power_law
    seed: 1
    gust: no
    c11: [1.0, 2.0,
          3.0, 4.0]
    table: [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]
    topics: [odom, imu/mag]
"""


@pytest.fixture
def defaults(tmp_path):
    path = tmp_path / "plant.yaml"
    path.write_text(DEFAULTS)
    return path


def override(tmp_path, text, name="extra.yaml"):
    path = tmp_path / name
    path.write_text(text)
    return path


def section(body, node="plant"):
    return f"{node}:\n  ros__parameters:\n    {body}\n"


def test_defaults_come_typed_and_shaped(defaults):
    values = load(TABLE, [defaults], "plant")
    assert list(values) == [row.name for row in TABLE]
    assert values["mass_kg"] == 9.75
    assert values["gust"] is False
    assert values["topics"] == ("odom", "imu/mag")
    np.testing.assert_array_equal(values["c11"], [[1.0, 2.0], [3.0, 4.0]])
    assert values["table"].shape == (2, 3)
    assert values["table"].dtype == np.float64


@pytest.mark.parametrize("node", ["/**", "/**/plant", "/plant", "plant", "/*"])
def test_every_node_pattern_of_rcl_reaches_the_node(defaults, tmp_path, node):
    extra = override(tmp_path, section("mass_kg: 8.0", node))
    assert load(TABLE, [defaults, extra], "plant")["mass_kg"] == 8.0


def test_namespaces(defaults, tmp_path):
    extra = override(
        tmp_path,
        "heli1:\n  plant:\n    ros__parameters:\n      mass_kg: 7.0\n"
        "/heli2/plant:\n  ros__parameters:\n    mass_kg: 6.0\n",
    )
    assert load(TABLE, [defaults, extra], "/heli1/plant")["mass_kg"] == 7.0
    assert load(TABLE, [defaults, extra], "/heli2/plant")["mass_kg"] == 6.0
    assert load(TABLE, [defaults, extra], "/plant")["mass_kg"] == 9.75


def test_more_specific_pattern_wins_whatever_the_order(defaults, tmp_path):
    text = section("mass_kg: 5.0", "plant") + section("mass_kg: 4.0", "/**")
    assert load(TABLE, [defaults, override(tmp_path, text)], "plant")["mass_kg"] == 5.0


def test_sections_of_other_nodes_do_not_matter(defaults, tmp_path):
    extra = override(tmp_path, section("anything: 1", "observer"))
    assert load(TABLE, [defaults, extra], "plant")["mass_kg"] == 9.75


def test_command_line_rules_are_strongest(defaults, tmp_path):
    extra = override(tmp_path, section("mass_kg: 8.0"))
    rules = ["mass_kg:=7.5", "observer:mass_kg:=1.0", "plant:gust:=true", "wind.profile:=constant"]
    values = load(TABLE, [defaults, extra], "plant", rules=rules)
    assert (values["mass_kg"], values["gust"], values["wind.profile"]) == (7.5, True, "constant")


BAD = [
    ("mass_kg: 10", Cause.TYPE, "mass_kg", 10),
    ("mass_kg: .nan", Cause.NOT_FINITE, "mass_kg", math.nan),
    ("mass_kg: -.inf", Cause.NOT_FINITE, "mass_kg", -math.inf),
    ("mass_kg: 0.0", Cause.BOUNDS, "mass_kg", 0.0),
    ("mass_kg: heavy", Cause.TYPE, "mass_kg", "heavy"),
    ("mass_kg: '9.0'", Cause.TYPE, "mass_kg", "9.0"),
    ("mass_kg: y", Cause.TYPE, "mass_kg", True),
    ("mass_kg: [9.0]", Cause.TYPE, "mass_kg", [9.0]),
    ("mass_kg:", Cause.MISSING, "mass_kg", None),
    ("wind.speed_mps: 31.0", Cause.BOUNDS, "wind.speed_mps", 31.0),
    ("wind.profile: powerlaw", Cause.CHOICE, "wind.profile", "powerlaw"),
    ("seed: 1.0", Cause.TYPE, "seed", 1.0),
    ("seed: -1", Cause.BOUNDS, "seed", -1),
    ("gust: 1", Cause.TYPE, "gust", 1),
    ("c11: [1, 2, 3, 4]", Cause.TYPE, "c11", 1),
    ("c11: [1.0, 2, 3.0, 4.0]", Cause.TYPE, "c11", [1.0, 2, 3.0, 4.0]),
    ("c11: [1.0, 2.0, 3.0]", Cause.LENGTH, "c11", [1.0, 2.0, 3.0]),
    ("c11: [1.0, .nan, 3.0, 4.0]", Cause.NOT_FINITE, "c11", math.nan),
    ("c11: [[1.0, 2.0], [3.0, 4.0]]", Cause.TYPE, "c11", None),
    ("c11: 1.0", Cause.TYPE, "c11", 1.0),
    ("table: [1.0, 2.0]", Cause.LENGTH, "table", [1.0, 2.0]),
    ("topics: [1.0]", Cause.TYPE, "topics", 1.0),
    ("mass_kg: 9.0\n    mass_kg: 8.0", Cause.TWICE, "mass_kg", None),
    ('"ma\u00adss\\e[2J\\n": 1.0', Cause.UNKNOWN_KEY, "ma\\xadss\\x1b[2J\\n", None),
    ("a" * 300 + ": 1.0", Cause.UNKNOWN_KEY, "a" * 200 + "...", None),
]


@pytest.mark.parametrize(("body", "cause", "key", "value"), BAD, ids=[row[0] for row in BAD])
def test_bad_values_are_refused_by_file_line_key_and_allowed(
    defaults, tmp_path, body, cause, key, value
):
    extra = override(tmp_path, section(body))
    with pytest.raises(ParameterError) as caught:
        load(TABLE, [defaults, extra], "plant")
    error = caught.value
    assert (error.cause, error.key) == (cause, key)
    assert error.where == f"{extra}:{4 if cause == Cause.TWICE else 3}"
    assert type(error.value) is type(value) and repr(error.value) == repr(value)
    line = str(error)
    assert "\n" not in line and line.startswith(f"{error.where}: {key}: {error.problem}")
    row = next((row for row in TABLE if row.name == key), None)
    # Of what cannot be an array or a value at all the reader of the file tells.
    if row is not None and error.allowed:
        assert error.allowed == row.allowed() and line.endswith(f"; allowed: {row.allowed()}")
    else:
        assert cause in (Cause.MISSING, Cause.TYPE, Cause.TWICE, Cause.UNKNOWN_KEY)


def test_a_refusal_is_a_sentence_of_its_facts():
    row = next(row for row in TABLE if row.name == "mass_kg")
    with pytest.raises(ParameterError) as caught:
        row.check(10)
    error = caught.value.placed("extra.yaml:3", "mass_kg")
    assert (error.cause, error.where, error.key) == (Cause.TYPE, "extra.yaml:3", "mass_kg")
    assert error.value == 10 and error.problem.endswith(" 10.0")
    assert error.allowed == row.allowed()
    assert str(error) == f"extra.yaml:3: mass_kg: {error.problem}; allowed: {row.allowed()}"
    assert str(pickle.loads(pickle.dumps(error))) == str(error)


@pytest.mark.parametrize(
    ("kind", "shape", "words"),
    [
        ("double[]", (2, 2), "4 (2 x 2, row by row) doubles"),
        ("double[]", (None, 3), "a multiple of 3 (any number x 3, row by row) doubles"),
        ("string[]", None, "any number of texts"),
        ("bool", None, "true or false"),
        ("int", None, "an integer"),
    ],
)
def test_what_is_allowed_in_words(kind, shape, words):
    assert Parameter("x", kind, "", shape=shape).allowed() == words


@pytest.mark.parametrize(
    ("key", "cause", "meant"),
    [
        ("mas_kg", Cause.UNKNOWN_KEY, "mass_kg"),
        ("wind.sped_mps", Cause.UNKNOWN_KEY, "wind.speed_mps"),
        ("speed_mps", Cause.UNKNOWN_KEY, "wind.speed_mps"),
        ("xyz", Cause.UNKNOWN_KEY, ""),
        ("subjects", Cause.RENAMED_KEY, "topics"),
    ],
)
def test_what_an_unknown_name_may_have_meant(defaults, tmp_path, key, cause, meant):
    extra = override(tmp_path, section(f"{key}: 1.0"))
    with pytest.raises(ParameterError) as caught:
        load(TABLE, [defaults, extra], "plant")
    error = caught.value
    assert (error.cause, error.key, error.meant) == (cause, key, meant)
    assert (meant or ", ".join(sorted(row.name for row in TABLE))) in error.problem


FILES = [
    ("plant: [}\n", 1),
    ("- 1\n", None),
    ("", None),
    ("plant:\n  mass_kg: 1.0\n", 2),
    ("ros__parameters:\n  mass_kg: 1.0\n", 1),
    ("plant:\n  ros__parameters: 3\n", 2),
    ("plant: &a\n  ros__parameters: {mass_kg: 9.0}\nb: *a\n", 3),
]


@pytest.mark.parametrize(("text", "line"), FILES)
def test_malformed_files(defaults, tmp_path, text, line):
    extra = override(tmp_path, text)
    with pytest.raises(ParameterError) as caught:
        load(TABLE, [defaults, extra], "plant")
    error = caught.value
    assert error.cause == Cause.SYNTAX
    assert error.where == (str(extra) if line is None else f"{extra}:{line}")
    assert "\n" not in str(error)


def test_missing_and_unreadable_files(defaults, tmp_path):
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00plant")
    for file in (tmp_path / "absent.yaml", tmp_path, binary):
        with pytest.raises(ParameterError) as caught:
            load(TABLE, [defaults, file], "plant")
        assert (caught.value.cause, caught.value.where) == (Cause.UNREADABLE, str(file))


def test_a_value_that_nobody_gives_is_named(tmp_path):
    with pytest.raises(ParameterError) as caught:
        load(TABLE, [override(tmp_path, section("seed: 1"))], "plant")
    assert (caught.value.cause, caught.value.key) == (Cause.MISSING, "mass_kg")


def test_names_of_others_can_be_passed_over(defaults, tmp_path):
    extra = override(tmp_path, section("autostart: false\n    use_sim_time: true"))
    values = load(TABLE, [defaults, extra], "plant", ignore=["autostart"])
    assert "autostart" not in values
    assert "use_sim_time" not in values


def test_unknown_node_names(defaults, tmp_path):
    known = ["plant", "observer"]
    check_node_names([defaults, override(tmp_path, section("seed: 1", "/**"))], known)
    with pytest.raises(ParameterError) as caught:
        check_node_names([defaults, override(tmp_path, section("seed: 1", "/**/plnt"))], known)
    error = caught.value
    assert (error.cause, error.value, error.meant) == (Cause.UNKNOWN_NODE, "plnt", "plant")


@pytest.mark.parametrize(
    ("name", "value", "cause"),
    [
        ("mass_kg", 9.0, None),
        ("c11", [1.0, 2.0, 3.0, 4.0], None),
        ("use_sim_time", True, None),
        ("mass_kg", 9, Cause.TYPE),
        ("mass_kg", -1.0, Cause.BOUNDS),
        ("seed", 2, Cause.READ_ONLY),
        ("mass_kgs", 2.0, Cause.UNKNOWN_KEY),
        ("subjects", ["odom"], Cause.RENAMED_KEY),
        ("c11", np.array([1.0, math.nan, 3.0, 4.0]), Cause.NOT_FINITE),
    ],
)
def test_a_change_is_refused_for_a_cause_or_not_at_all(name, value, cause):
    refused = refusal(TABLE, name, value)
    if cause is None:
        assert refused is None and why_refused(TABLE, name, value) == ""
    else:
        assert (refused.cause, refused.key, refused.where) == (cause, name, "")
        assert why_refused(TABLE, name, value) == str(refused)
        assert str(refused).startswith(f"{name}: ")


def test_dump_reads_back(defaults, tmp_path):
    values = load(TABLE, [defaults], "plant")
    values["mass_kg"] = 1e-05
    values["table"] = np.array([[1e22, -1e-300, 1.0 / 3.0]])
    values["topics"] = ("it's", "y", "1.0", "")
    path = tmp_path / "resolved.yaml"
    dump_all({"plant": values}, path)
    again = load(TABLE, [path], "plant")
    for name, value in values.items():
        np.testing.assert_array_equal(again[name], value)
    with pytest.raises(ParameterError) as caught:
        dump_all({"plant": values}, tmp_path / "absent" / "x.yaml")
    assert caught.value.cause == Cause.UNREADABLE


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_double_survives_a_dump(value):
    again = rcl_yaml.scalar(rcl_dump.number(value), quoted=False)
    assert type(again) is float
    assert np.float64(again).tobytes() == np.float64(value).tobytes()


def test_what_is_stated_is_known_with_its_place_and_nothing_else(defaults, tmp_path):
    extra = override(tmp_path, section("mass_kg: 8.0"))
    assigned = stated(TABLE, [extra], "plant")
    assert {name: entry.value for name, entry in assigned.items()} == {"mass_kg": 8.0}
    assert assigned["mass_kg"].where.startswith(f"{extra}:")
    with pytest.raises(ParameterError) as caught:
        stated(TABLE, [override(tmp_path, section("mas_kg: 8.0"))], "plant")
    assert caught.value.cause == Cause.UNKNOWN_KEY


def test_a_file_that_is_read_already_is_not_read_again(defaults):
    file = opened(defaults)
    defaults.unlink()
    assert load(TABLE, [file], "plant")["mass_kg"] == 9.75


SCALARS = [
    ("y", True),
    ("Off", False),
    ("1e5", 1e5),
    ("1.", 1.0),
    (".5", 0.5),
    ("-3", -3),
    ("0x10", 16),
    ("010", 8),
    ("1_000", "1_000"),
    ("nan", "nan"),
    ("~", "~"),
]


@pytest.mark.parametrize(("text", "value"), SCALARS)
def test_scalars_as_rcl_reads_them(text, value):
    read = rcl_yaml.scalar(text, quoted=False)
    assert read == value
    assert type(read) is type(value)
    assert rcl_yaml.scalar(text, quoted=True) == text


@pytest.mark.parametrize("wrong", [{"kind": "float"}, {"kind": "double", "shape": (3,)}])
def test_a_wrong_table_row_is_a_programming_error(wrong):
    with pytest.raises(ValueError, match="parameter x"):
        Parameter("x", description="", **wrong)


def test_a_file_written_anew_is_read_anew(tmp_path):
    """At once, with the same length: no time stamp tells them apart."""
    path = tmp_path / "p.yaml"
    for value in (1.5, 2.5, 1.5):
        path.write_text(f"node:\n  ros__parameters:\n    x: {value}\n")
        assert [entry.value for entry in rcl_yaml.read(path).entries] == [value]
