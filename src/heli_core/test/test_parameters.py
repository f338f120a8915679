# SPDX-License-Identifier: Apache-2.0
"""Parameter tables and files: what is accepted, what is refused, and in which words."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from heli_core import rcl_yaml
from heli_core import rcl_yaml as rcl_dump
from heli_core.parameters import Parameter, load, stated, why_refused
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
    ("mass_kg: 10", ["mass_kg", "10", "write 10.0", "(0, 100]", "kg"]),
    ("mas_kg: 10.0", ["mas_kg", "unknown parameter", "did you mean 'mass_kg'"]),
    ("wind: {sped_mps: 1.0}", ["wind.sped_mps", "did you mean 'wind.speed_mps'"]),
    ("speed_mps: 1.0", ["speed_mps", "did you mean 'wind.speed_mps'"]),
    ("subjects: [odom]", ["subjects: is called 'topics' now; change the name"]),
    ("mass_kg: .nan", ["mass_kg", "nan", "not finite"]),
    ("mass_kg: -.inf", ["mass_kg", "inf", "not finite"]),
    ("mass_kg: 0.0", ["mass_kg", "0.0", "out of bounds", "(0, 100]"]),
    ("mass_kg: heavy", ["mass_kg", "'heavy'", "text", "a double"]),
    ("mass_kg: '9.0'", ["mass_kg", "'9.0'", "text"]),
    ("mass_kg: y", ["mass_kg", "True", "boolean"]),
    ("mass_kg: [9.0]", ["mass_kg", "[9.0]", "array"]),
    ("mass_kg:", ["mass_kg", "no value"]),
    ("wind.speed_mps: 31.0", ["wind.speed_mps", "31.0", "[0, 30]", "m/s"]),
    ("wind.profile: powerlaw", ["wind.profile", "'powerlaw'", "power_law", "constant"]),
    ("seed: 1.0", ["seed", "1.0", "double", "an integer"]),
    ("seed: -1", ["seed", "-1", "out of bounds"]),
    ("gust: 1", ["gust", "1", "true or false"]),
    ("c11: [1, 2, 3, 4]", ["c11", "write 1.0", "4 (2 x 2, row by row) doubles"]),
    ("c11: [1.0, 2, 3.0, 4.0]", ["c11", "mixes", "write 2.0"]),
    ("c11: [1.0, 2.0, 3.0]", ["c11", "3 elements", "4 (2 x 2"]),
    ("c11: [1.0, .nan, 3.0, 4.0]", ["c11", "nan", "not finite"]),
    ("c11: [[1.0, 2.0], [3.0, 4.0]]", ["c11", "flat"]),
    ("c11: 1.0", ["c11", "not an array"]),
    ("table: [1.0, 2.0]", ["table", "2 elements", "multiple of 3"]),
    ("topics: [1.0]", ["topics", "1.0", "texts"]),
    ("mass_kg: 9.0\n    mass_kg: 8.0", ["mass_kg", "twice"]),
    ('"ma\u00adss\\e[2J\\n": 1.0', ["ma\\xadss\\x1b[2J\\n: unknown parameter"]),
    ("a" * 300 + ": 1.0", ["a" * 200 + "...: unknown parameter"]),
]


@pytest.mark.parametrize(("body", "words"), BAD, ids=[body for body, _ in BAD])
def test_bad_values_are_refused_by_file_line_key_and_allowed(defaults, tmp_path, body, words):
    extra = override(tmp_path, section(body))
    with pytest.raises(ParameterError) as caught:
        load(TABLE, [defaults, extra], "plant")
    message = str(caught.value)
    assert "\n" not in message
    assert "extra.yaml:" in message
    for word in words:
        assert word in message


FILES = [
    ("plant: [", "not valid YAML"),
    ("- 1\n", "not a ROS parameter file"),
    ("", "not a ROS parameter file"),
    ("plant:\n  mass_kg: 1.0\n", "outside of"),
    ("ros__parameters:\n  mass_kg: 1.0\n", "below a node name"),
    ("plant:\n  ros__parameters: 3\n", "expected 'key: value'"),
    ("plant: &a\n  ros__parameters: {mass_kg: 9.0}\nb: *a\n", "aliases"),
]


@pytest.mark.parametrize(("text", "words"), FILES)
def test_malformed_files(defaults, tmp_path, text, words):
    with pytest.raises(ParameterError, match="extra.yaml") as caught:
        load(TABLE, [defaults, override(tmp_path, text)], "plant")
    assert words in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_and_unreadable_files(defaults, tmp_path):
    with pytest.raises(ParameterError, match=r"absent\.yaml: parameter file does not exist"):
        load(TABLE, [defaults, tmp_path / "absent.yaml"], "plant")
    with pytest.raises(ParameterError, match="cannot read"):
        load(TABLE, [defaults, tmp_path], "plant")
    binary = tmp_path / "binary.yaml"
    binary.write_bytes(b"\xff\xfe\x00plant")
    with pytest.raises(ParameterError, match=r"binary\.yaml: cannot read"):
        load(TABLE, [binary], "plant")


def test_a_value_that_nobody_gives_is_named(tmp_path):
    with pytest.raises(ParameterError, match="mass_kg: no value for node 'plant'"):
        load(TABLE, [override(tmp_path, section("seed: 1"))], "plant")


def test_names_of_others_can_be_passed_over(defaults, tmp_path):
    extra = override(tmp_path, section("autostart: false\n    use_sim_time: true"))
    values = load(TABLE, [defaults, extra], "plant", ignore=["autostart"])
    assert "autostart" not in values
    assert "use_sim_time" not in values


def test_unknown_node_names(defaults, tmp_path):
    known = ["plant", "observer"]
    check_node_names([defaults, override(tmp_path, section("seed: 1", "/**"))], known)
    with pytest.raises(ParameterError, match=r"unknown node 'plnt'; did you mean 'plant'\?"):
        check_node_names([defaults, override(tmp_path, section("seed: 1", "/**/plnt"))], known)


def test_judge_gives_a_reason_or_nothing():
    assert why_refused(TABLE, "mass_kg", 9.0) == ""
    assert why_refused(TABLE, "c11", [1.0, 2.0, 3.0, 4.0]) == ""
    assert why_refused(TABLE, "use_sim_time", True) == ""
    assert "write 9.0" in why_refused(TABLE, "mass_kg", 9)
    assert "out of bounds" in why_refused(TABLE, "mass_kg", -1.0)
    assert "fixed while the node runs" in why_refused(TABLE, "seed", 2)
    assert "did you mean" in why_refused(TABLE, "mass_kgs", 2.0)
    assert (
        why_refused(TABLE, "subjects", ["odom"])
        == "subjects: is called 'topics' now; change the name"
    )
    assert "not finite" in why_refused(TABLE, "c11", np.array([1.0, math.nan, 3.0, 4.0]))


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
    with pytest.raises(ParameterError, match="cannot write"):
        dump_all({"plant": values}, tmp_path / "absent" / "x.yaml")


@given(st.floats(allow_nan=False, allow_infinity=False))
def test_every_double_survives_a_dump(value):
    again = rcl_yaml.scalar(rcl_dump.number(value), quoted=False)
    assert type(again) is float
    assert np.float64(again).tobytes() == np.float64(value).tobytes()


def test_what_is_stated_is_known_with_its_place_and_nothing_else(defaults, tmp_path):
    extra = override(tmp_path, section("mass_kg: 8.0"))
    found = stated(TABLE, [extra], "plant")
    assert {name: entry.value for name, entry in found.items()} == {"mass_kg": 8.0}
    assert found["mass_kg"].where.startswith(f"{extra}:")
    with pytest.raises(ParameterError, match="unknown parameter"):
        stated(TABLE, [override(tmp_path, section("mas_kg: 8.0"))], "plant")


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
    found = rcl_yaml.scalar(text, quoted=False)
    assert found == value
    assert type(found) is type(value)
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
