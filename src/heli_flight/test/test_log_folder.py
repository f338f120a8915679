# SPDX-License-Identifier: Apache-2.0
"""Where ROS keeps its log, for each state of the variables that say it."""

import os

import pytest

from heli_flight.graph import log_folder as places

STATES = ("unset", "empty", "relative", "missing", "file", "below a file", "folder", "newline")


@pytest.fixture
def environment(tmp_path):
    """Call it for an environment with a variable in a state, and the path that it names."""

    def made(name, state):
        path = tmp_path / {"newline": "a\nb", "below a file": "file/log"}.get(state, state)
        if "file" in state:
            (tmp_path / "file").touch()
        elif state in ("folder", "newline"):
            path.mkdir(exist_ok=True)
        value = {"empty": "", "relative": "relative"}.get(state, str(path))
        return ({} if state == "unset" else {name: value}), path

    return made


@pytest.mark.parametrize("state", STATES)
def test_a_named_folder_is_taken_as_ros_takes_it(environment, state):
    for name, below in (("ROS_LOG_DIR", ""), ("ROS_HOME", "log")):
        environ, path = environment(name, state)
        said, folder = places.log_folder(environ)
        if state in ("unset", "empty"):
            assert (said, folder) == ("HOME", None)
        elif state != "relative":
            assert (said, folder) == (name, path / below)


@pytest.mark.parametrize("state", STATES)
def test_a_home_that_is_not_there_is_not_made(environment, state):
    environ, home = environment("HOME", state)
    there = state in ("folder", "newline")
    assert places.log_folder(environ) == ("HOME", home / ".ros/log" if there else None)


def test_the_log_folder_goes_before_home(tmp_path):
    environ = {"ROS_LOG_DIR": "/a", "ROS_HOME": "/b", "HOME": str(tmp_path)}
    assert str(places.log_folder(environ)[1]) == "/a"
    del environ["ROS_LOG_DIR"]
    assert str(places.log_folder(environ)[1]) == "/b/log"


@pytest.mark.parametrize("name", ["ROS_LOG_DIR", "ROS_HOME", "HOME"])
@pytest.mark.parametrize("state", STATES[3:])
def test_ros_always_has_a_folder_that_can_be_written_to(
    environment, tmp_path, monkeypatch, capsys, name, state
):
    environ, _ = environment(name, state)
    for variable in ("ROS_LOG_DIR", "ROS_HOME", "HOME"):
        monkeypatch.delenv(variable, raising=False)
    for variable, value in environ.items():
        monkeypatch.setenv(variable, value)
    monkeypatch.setattr(places, "temporary_folder", lambda name: tmp_path / "instead")
    places.keep_log()
    _, folder = places.log_folder(os.environ)
    assert places.why_not_writable(folder) is None
    is_other = folder == tmp_path / "instead"
    assert is_other == ("file" in state or (name == "HOME" and state == "missing"))
    told = capsys.readouterr().err
    assert len(told.splitlines()) == (is_other and name != "HOME")
