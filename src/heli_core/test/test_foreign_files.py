# SPDX-License-Identifier: Apache-2.0
"""The door of foreign files: causes, places, and what is let through unchanged.

What they take of memory is measured in heli_flight/test/test_bombs.py.
"""

import os
import socket

import numpy as np
import pytest
import yaml

from heli_core.command_line import config_folder
from heli_core.foreign_files import (
    BUDGET_MB,
    BUDGET_VARIABLE,
    MOST_YAML_DEPTH,
    MOST_YAML_NODES,
    FileCause,
    FileError,
    budget_bytes,
    load_json,
    load_yaml,
    open_regular,
    read_arrays,
    read_bytes,
    read_text,
    read_yaml,
    within_budget,
)


def refused(call, *arguments):
    with pytest.raises(FileError) as caught:
        call(*arguments)
    assert len(str(caught.value).splitlines()) == 1
    return caught.value


def test_the_budget_is_stated_and_the_environment_raises_it(monkeypatch):
    monkeypatch.delenv(BUDGET_VARIABLE, raising=False)
    assert budget_bytes() == BUDGET_MB << 20
    within_budget(BUDGET_MB << 20, "a chunk")
    assert refused(within_budget, (BUDGET_MB << 20) + 1, "a chunk").cause == FileCause.TOO_LARGE
    monkeypatch.setenv(BUDGET_VARIABLE, "1000")
    within_budget(1000 << 20, "a chunk")


@pytest.mark.parametrize("text", ["0", "-1", "much", "1e3", "9" * 30, " 5"])
def test_a_budget_that_is_none_is_refused(monkeypatch, text):
    monkeypatch.setenv(BUDGET_VARIABLE, text)
    assert refused(budget_bytes).cause == FileCause.BUDGET


def test_what_is_no_file_is_not_opened(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    with socket.socket(socket.AF_UNIX) as listening:
        listening.bind(str(tmp_path / "socket"))
        for name in ("fifo", "", "/dev/zero"):
            assert refused(open_regular, tmp_path / name).cause == FileCause.NOT_REGULAR
        # A socket cannot be opened at all.
        assert refused(open_regular, tmp_path / "socket").cause == FileCause.UNREADABLE
    assert refused(open_regular, tmp_path / "none").cause == FileCause.UNREADABLE
    assert refused(open_regular, "a\0b").cause == FileCause.UNREADABLE


def test_holes_are_refused_above_the_budget_only(tmp_path):
    path = tmp_path / "sparse"
    path.write_bytes(b"")
    os.truncate(path, 1 << 20)
    assert read_bytes(path) == bytes(1 << 20)
    os.truncate(path, budget_bytes() + 1)
    assert refused(open_regular, path).cause == FileCause.SPARSE


def test_a_file_of_proc_has_no_size_and_still_an_end():
    assert b"Vm" in read_bytes("/proc/self/status")
    assert refused(read_bytes, "/proc/self/status", 10).cause == FileCause.TOO_LARGE


def test_text_is_utf_8_with_ends_of_lines_of_any_kind(tmp_path):
    path = tmp_path / "text"
    path.write_bytes(b"a\r\nb\rc\n")
    assert read_text(path) == "a\nb\nc\n"
    path.write_bytes(b"\xff")
    assert refused(read_text, path).cause == FileCause.NOT_TEXT


def test_packaged_files_say_what_yaml_says_of_them():
    files = sorted(config_folder("heli_dynamics_sim").rglob("*.yaml"))
    assert files
    for path in files:
        assert read_yaml(path) == yaml.safe_load(path.read_text(encoding="utf-8"))


@pytest.mark.parametrize(
    ("text", "cause", "line"),
    [
        ("a: &x 1\nb: *x\n", FileCause.ALIAS, 2),
        ("a:\n " + "[" * (MOST_YAML_DEPTH + 1), FileCause.TOO_DEEP, 2),
        (f"[{'1,' * MOST_YAML_NODES}]", FileCause.TOO_MANY, 1),
        (f"a: 1\nb: {'1' * 201}", FileCause.LONG_NUMBER, 2),
        (f"a: !!int '1{':59' * 100}'", FileCause.LONG_NUMBER, 1),
        ("a: [\n", FileCause.SYNTAX, 2),
        ("a: !!python/object:os.system x", FileCause.SYNTAX, 0),
        ("a: 2026-13-41", FileCause.SYNTAX, 0),
        ("? {a: 1}\n: 2", FileCause.SYNTAX, 0),
        ("x" * (1 << 23), FileCause.TOO_LARGE, 0),
    ],
)
def test_yaml_is_refused_by_cause_and_line(text, cause, line):
    error = refused(load_yaml, text, "spec.yaml")
    assert (error.cause, error.line) == (cause, line)
    assert str(error).startswith("spec.yaml")


def test_an_anchor_that_nobody_names_and_long_texts_are_allowed():
    assert load_yaml(f"a: &x 1\nb: '{'1' * 1000}'") == {"a": 1, "b": "1" * 1000}
    assert load_yaml("") is None
    deep = "[" * MOST_YAML_DEPTH + "]" * MOST_YAML_DEPTH
    assert load_yaml(deep) == yaml.safe_load(deep)


@pytest.mark.parametrize(
    ("text", "cause"),
    [
        ("[" * 100_000, FileCause.TOO_DEEP),
        ("9" * 5000, FileCause.LONG_NUMBER),
        ("{", FileCause.SYNTAX),
        (" " * (1 << 23), FileCause.TOO_LARGE),
    ],
)
def test_json_is_refused_by_cause(text, cause):
    assert refused(load_json, text).cause == cause


def test_arrays_come_back_also_compressed_ones_and_those_above_the_budget(tmp_path, monkeypatch):
    path, arrays = tmp_path / "a.npz", {"a": np.arange(6.0).reshape(2, 3), "b": np.array(["x"])}
    for save in (np.savez, np.savez_compressed):
        save(path, **arrays)
        read = read_arrays(path)
        assert set(read) == set(arrays)
        for name, array in arrays.items():
            np.testing.assert_array_equal(read[name], array)
    # What is not compressed is as large as its file; what is may be anything.
    monkeypatch.setenv(BUDGET_VARIABLE, "1")
    ones = np.ones(1 << 18)
    np.savez(path, ones=ones)
    assert read_arrays(path)["ones"].size == ones.size
    np.savez_compressed(path, ones=ones)
    assert refused(read_arrays, path).cause == FileCause.TOO_LARGE


def test_pickled_objects_are_no_arrays(tmp_path):
    np.savez(tmp_path / "a.npz", a=np.array([{}], dtype=object))
    assert refused(read_arrays, tmp_path / "a.npz").cause == FileCause.SYNTAX
