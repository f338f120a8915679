# SPDX-License-Identifier: Apache-2.0
"""What `ros2 run` and ament_index look for is there after linking and after `pip install .`."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(path.parent.name for path in (ROOT / "src").glob("*/setup.py"))
EXECUTABLES = {
    "heli_actions": ["actions"],
    "heli_dynamics_sim": ["plant"],
    "heli_observer": ["observer"],
    "heli_inner_hinf": ["inner_loop"],
    "heli_outer_pd": ["outer_loop"],
    "heli_bags": ["recorder"],
    "heli_live_view": ["live_view"],
    "heli_flight": [
        "composed",
        "heli",
        "hover_test",
        "lifecycle_manager",
        "scenario",
        "warm_up",
        "world_clock",
    ],
}
PYTHON_FOLDER = f"lib/python{sys.version_info.major}.{sys.version_info.minor}/site-packages"


def run(*command, **options):
    done = subprocess.run(
        [str(word) for word in command], capture_output=True, text=True, timeout=120, **options
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def link(prefix: Path) -> None:
    site = prefix / PYTHON_FOLDER
    site.mkdir(parents=True, exist_ok=True)
    script = ROOT / "scripts/link_ros_layout.py"
    run(sys.executable, script, "--prefix", prefix, "--site-packages", site)


@pytest.fixture(scope="module")
def linked(tmp_path_factory):
    prefix = tmp_path_factory.mktemp("linked")
    link(prefix)
    return prefix


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """`pip install .` from a copy of the sources (a build writes beside them), without network."""
    top = tmp_path_factory.mktemp("sources")
    for name in ("pyproject.toml", "LICENSE", "README.md"):
        shutil.copy2(ROOT / name, top / name)
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info", "test", ".*")
    for name in ("src", "requirements"):
        shutil.copytree(ROOT / name, top / name, ignore=ignored)
    prefix = tmp_path_factory.mktemp("installed")
    options = [
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
        "--no-compile",
        "--prefix",
        prefix,
    ]
    run(sys.executable, "-m", "pip", "install", *options, top)
    return prefix


@pytest.fixture(params=["linked", "installed"])
def prefix(request):
    return request.getfixturevalue(request.param)


@pytest.mark.parametrize("package", PACKAGES)
def test_ros2_launch_finds_every_launch_file(prefix, package):
    """As ros2launch does: by the file's name, links to folders not followed."""
    wanted = {path.name for path in (ROOT / "src" / package / "launch").glob("*.launch.py")}
    assert wanted or package != "heli_flight"
    installed_names = [
        name for _, _, names in os.walk(prefix / "share" / package) for name in names
    ]
    assert wanted <= set(installed_names)


def files_below(folder: Path) -> set[str]:
    """Files under folder, links followed, without byte code and the tools' hidden files."""
    relative = set()
    for path, folders, names in os.walk(folder, followlinks=True):
        folders[:] = [name for name in folders if name[0] != "." and name != "__pycache__"]
        relative |= {str((Path(path) / name).relative_to(folder)) for name in names}
    return relative


@pytest.mark.parametrize("package", PACKAGES)
def test_share_is_complete(prefix, package):
    source = ROOT / "src" / package
    expected = {"package.xml"} | {
        f"{top}/{name}" for top in ("config", "launch", "web") for name in files_below(source / top)
    }
    assert files_below(prefix / "share" / package) == expected


@pytest.mark.parametrize("package", PACKAGES)
def test_package_is_in_the_index(prefix, package):
    """Looked up by the library that `ros2 run` uses, in a process that knows only this prefix."""
    code = (
        "from ament_index_python.packages import *\n"
        f"print(get_package_prefix('{package}'), get_package_share_directory('{package}'))"
    )
    output = run(sys.executable, "-c", code, env={**os.environ, "AMENT_PREFIX_PATH": str(prefix)})
    assert output.split() == [str(prefix), str(prefix / "share" / package)]


@pytest.mark.parametrize("package", PACKAGES)
def test_executables_as_ros2_run_finds_them(prefix, package):
    """ros2pkg walks <prefix>/lib/<package> and takes the files that are executable."""
    folder = prefix / "lib" / package
    executables = [
        path.name for path in folder.glob("*") if os.access(path, os.X_OK) and path.is_file()
    ]
    assert sorted(executables) == EXECUTABLES.get(package, [])


@pytest.mark.parametrize("name", ["hover_test", "heli"])
def test_commands_run_as_executables_of_the_package(prefix, name):
    """`ros2 run heli_flight hover_test` starts <prefix>/lib/heli_flight/hover_test."""
    env = {**os.environ, "PYTHONPATH": str(prefix / PYTHON_FOLDER)}
    help_text = run(sys.executable, prefix / "lib/heli_flight" / name, "--help", env=env)
    assert "fly" in help_text.lower() and "exit code" in help_text


def test_command_runs(prefix):
    """`heli` of [project.scripts] is where an environment has its commands."""
    env = {**os.environ, "PYTHONPATH": str(prefix / PYTHON_FOLDER)}
    help_text = run(prefix / "bin/heli", "--help", env=env)
    assert all(command in help_text for command in ("hover", "design", "compare"))


def test_modules_are_complete(installed):
    for package in PACKAGES:
        source = {f for f in files_below(ROOT / "src" / package / package) if f.endswith(".py")}
        assert source <= files_below(installed / PYTHON_FOLDER / package)


def test_installed_package_finds_its_parameters(installed):
    code = "from heli_core.command_line import config_folder as f; print(f('heli_observer'))"
    env = {**os.environ, "PYTHONPATH": str(installed / PYTHON_FOLDER)}
    output = run(sys.executable, "-c", code, env=env, cwd=installed)
    assert Path(output.strip()) == installed / "share/heli_observer/config"


def test_linked_packages_are_on_the_path(linked):
    lines = (linked / PYTHON_FOLDER / "heli_hover.pth").read_text().splitlines()
    assert lines == [str(ROOT / "src" / package) for package in PACKAGES]


def test_linking_again_repairs_and_forgets(tmp_path):
    link(tmp_path)
    markers = tmp_path / "share/ament_index/resource_index/packages"
    (markers / "heli_gone").symlink_to(ROOT / "src/heli_gone/resource/heli_gone")
    (tmp_path / "lib/heli_observer/renamed").symlink_to(ROOT / "src/heli_observer/scripts/gone")
    (tmp_path / "share/heli_observer/config").unlink()
    before = files_below(tmp_path)
    link(tmp_path)
    assert files_below(tmp_path) - before == {
        f"share/heli_observer/config/{name}"
        for name in files_below(ROOT / "src/heli_observer/config")
    }
    assert sorted(path.name for path in markers.iterdir()) == PACKAGES
    assert [path.name for path in (tmp_path / "lib/heli_observer").iterdir()] == ["observer"]
