# SPDX-License-Identifier: Apache-2.0
"""Shared memory of processes that were killed is removed; that of the living never is."""

import fcntl

import pytest

from heli_flight.graph.respawn import remove_left

LONG_AFTER_S = 1e12
DEAD, ALIVE = "fastrtps_00000000000000aa", "fastrtps_00000000000000bb"


@pytest.fixture
def folder(tmp_path):
    """Segments with their lock files, a port, and somebody else's file."""
    for name in (DEAD, ALIVE):
        (tmp_path / name).write_bytes(b"segment")
        (tmp_path / f"{name}_el").touch()
    for name in ("fastrtps_port7413", "fastrtps_port7413_el", "another_el"):
        (tmp_path / name).touch()
    return tmp_path


def test_what_nobody_holds_is_removed_and_nothing_else(folder):
    before = {path.name for path in folder.iterdir()}
    with open(folder / f"{ALIVE}_el") as held:
        fcntl.flock(held, fcntl.LOCK_EX)
        assert remove_left(folder, lambda: LONG_AFTER_S) == [DEAD]
    assert before - {path.name for path in folder.iterdir()} == {DEAD, f"{DEAD}_el"}


def test_who_is_about_to_begin_keeps_its_own(folder):
    begun_s = (folder / f"{DEAD}_el").stat().st_mtime
    assert remove_left(folder, lambda: begun_s + 1.0) == []


def test_what_was_left_before_the_clock_was_set_back_is_removed_too(folder):
    begun_s = (folder / f"{DEAD}_el").stat().st_mtime
    assert DEAD in remove_left(folder, lambda: begun_s - 3600.0)


def test_others_are_left_alone(folder, monkeypatch):
    monkeypatch.setattr("os.getuid", lambda: 12345)
    assert remove_left(folder, lambda: LONG_AFTER_S) == []


def test_without_the_folder_there_is_nothing(tmp_path):
    assert remove_left(tmp_path / "none") == []
