# SPDX-License-Identifier: Apache-2.0
"""What the building of types needs is looked for first, and named in one sentence."""

import shutil
import sys
from pathlib import Path

import pytest

from heli_flight import interface_build
from heli_flight.interface_build import STAMP, InterfaceBuildError, are_built, build, can_build

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.parametrize("missing", ["c++", "cmake"])
def test_a_tool_that_lacks_is_named_before_anything_is_fetched(monkeypatch, tmp_path, missing):
    there = shutil.which
    monkeypatch.setattr(shutil, "which", lambda name: None if name == missing else there(name))
    monkeypatch.setattr(interface_build, "_lines", lambda *words: pytest.fail("nothing is run"))
    with pytest.raises(InterfaceBuildError, match=rf"\({missing.replace('+', '.')}\)"):
        build(ROOT, tmp_path, print)
    assert not are_built(ROOT, tmp_path)


def test_without_a_checkout_or_under_ros_there_is_nothing_to_build(monkeypatch, tmp_path):
    can_build(ROOT)
    with pytest.raises(InterfaceBuildError, match="checkout"):
        can_build(tmp_path)
    monkeypatch.setenv("ROS_DISTRO", "jazzy")
    with pytest.raises(InterfaceBuildError, match="colcon"):
        can_build(ROOT)


def test_what_was_built_is_not_built_again_unless_a_definition_changes(monkeypatch, tmp_path):
    made = []

    def compile_it(name, source, places, work, log, say):
        made.append(name)
        module = places[2] / "share" / name / "package.xml"
        module.parent.mkdir(parents=True)
        module.write_text("")

    monkeypatch.setattr(interface_build, "_bring_generators", lambda *places: places[2] / "view")
    monkeypatch.setattr(interface_build, "_compile", compile_it)
    monkeypatch.setattr(interface_build, "_check_tools", lambda: None)
    root, prefix = tmp_path / "root", tmp_path / "prefix"
    shutil.copytree(ROOT / "src/heli_interfaces", root / "src/heli_interfaces")
    lists = root / "requirements/hashes"
    lists.mkdir(parents=True)
    shutil.copy(ROOT / "requirements/hashes/interfaces.txt", lists)
    assert build(root, prefix, print) and made == ["tf2_msgs", "heli_interfaces"]
    assert not build(root, prefix, print) and (prefix / STAMP).is_file()
    with (root / "src/heli_interfaces/action/Land.action").open("a") as definition:
        definition.write("# another comment\n")
    assert build(root, prefix, print) and len(made) == 4


def test_a_command_that_fails_is_told_by_the_line_that_says_why(tmp_path):
    words = [sys.executable, "-c", "print('so far'); raise SystemExit('fatal error: no Python.h')"]
    with pytest.raises(InterfaceBuildError, match="^it failed: fatal error: no Python.h$"):
        interface_build._run(words, tmp_path / "log", "it")
