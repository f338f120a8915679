# SPDX-License-Identifier: Apache-2.0
"""Packages' files are found in each layout, and what is missing is named."""

import sys

import pytest

from heli_core import command_line


def make_package(folder, name):
    (folder / name).mkdir(parents=True)
    (folder / name / "__init__.py").write_text("")


@pytest.mark.parametrize("site", ["lib/python3.11/site-packages", "local/lib/python3.12/dist"])
def test_installed_layout(tmp_path, monkeypatch, site):
    make_package(tmp_path / site, "some_pkg_installed")
    share = tmp_path / "share" / "some_pkg_installed"
    (share / "config").mkdir(parents=True)
    (share / "package.xml").write_text("<package/>")
    monkeypatch.syspath_prepend(str(tmp_path / site))
    assert command_line.config_folder("some_pkg_installed") == share / "config"
    sys.modules.pop("some_pkg_installed", None)


def test_source_layout_is_this_tree():
    folder = command_line.config_folder("heli_outer_pd")
    assert (folder / "outer_loop.yaml").is_file()


def test_missing_things_are_named(tmp_path, monkeypatch):
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    with pytest.raises(command_line.MissingFileError, match="lib/heli_outer_pd/no_such_node"):
        command_line.executable("heli_outer_pd", "no_such_node")
    with pytest.raises(command_line.MissingFileError, match="no_such_package"):
        command_line.share_folder("no_such_package")


def test_executable_is_found_on_the_ament_prefix_path(tmp_path, monkeypatch):
    path = tmp_path / "lib" / "heli_outer_pd" / "outer_loop"
    path.parent.mkdir(parents=True)
    path.write_text("#!/bin/sh\n")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    with pytest.raises(command_line.MissingFileError):
        command_line.executable("heli_outer_pd", "outer_loop_")
    path.chmod(0o755)
    assert command_line.executable("heli_outer_pd", "outer_loop") == path
