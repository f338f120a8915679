# SPDX-License-Identifier: Apache-2.0
"""Each package alone, and `colcon build` of all, as with a ROS installation, by PyPI's colcon.

heli_interfaces is left out: its types are compiled, and generators are no wheels of set-up's. What
this cannot show: that, a build against apt's ROS 2 Jazzy, whose Python packages take the place of
the wheels, and `ros2 run` itself. What `ros2 run` looks up is looked up here.
"""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(path.parent.name for path in (ROOT / "src").glob("*/setup.py"))
COMPILED = "heli_interfaces"
EXECUTABLES = sorted(
    (path.parents[1].name, path.name) for path in (ROOT / "src").glob("*/scripts/*")
)
LAUNCH_FILES = sorted(
    (path.parents[1].name, path.name) for path in (ROOT / "src").glob("*/launch/*.launch.py")
)


@pytest.fixture(
    scope="module",
    params=[
        pytest.param("--symlink-install", id="linked", marks=pytest.mark.slow),
        pytest.param("", id="copied"),
    ],
)
def workspace(request, tmp_path_factory):
    """A copy of the sources, built in place; its log is shown when the build fails."""
    top = tmp_path_factory.mktemp("workspace")
    ignored = shutil.ignore_patterns(
        "__pycache__", "*.egg-info", "test", "build", "install", COMPILED
    )
    shutil.copytree(ROOT / "src", top / "src", ignore=ignored)
    command = [sys.executable, "-m", "colcon", "build", "--base-paths", "src"]
    command += ["--event-handlers", "console_direct+"]
    command += [request.param] if request.param else []
    env = {key: value for key, value in os.environ.items() if key != "AMENT_PREFIX_PATH"}
    done = subprocess.run(command, cwd=top, env=env, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stdout + done.stderr
    return top


BUILD = """
import os, tarfile
from pathlib import Path
from setuptools import build_meta

sources = build_meta.build_sdist(".")
tarfile.open(sources).extractall("unpacked", filter="data")
(top,) = Path("unpacked").iterdir()
os.chdir(top)
print(build_meta.build_wheel("."))
"""


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_copied_alone_builds(package, tmp_path):
    """Its archive of sources, and of that its wheel, with all that `ros2 run` looks up."""
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info", "build")
    top, source = tmp_path / package, ROOT / "src" / package
    shutil.copytree(source, top, ignore=ignored)
    command = [sys.executable, "-c", BUILD]
    done = subprocess.run(command, cwd=top, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stdout + done.stderr
    (wheel,) = top.glob("unpacked/*/*.whl")
    names = set(zipfile.ZipFile(wheel).namelist())
    (data,) = {name.split("/")[0] for name in names if ".data/" in name}
    assert f"{data}/data/share/ament_index/resource_index/packages/{package}" in names
    wanted = {f"{package}/{path.relative_to(source / package)}"
              for path in (source / package).rglob("*.py")}  # fmt: skip
    wanted |= {f"{data}/data/lib/{package}/{path.name}" for path in source.glob("scripts/*")}
    share = [source / "package.xml", *source.glob("launch/*.py"), *source.glob("config/**/*.*")]
    wanted |= {f"{data}/data/share/{package}/{path.relative_to(source)}" for path in share}
    assert wanted <= names


def in_workspace(workspace, command):
    """Run bash with the workspace sourced and nothing of this checkout on the paths."""
    env = {key: value for key, value in os.environ.items() if key != "PYTHONPATH"}
    env.pop("AMENT_PREFIX_PATH", None)
    text = f"source install/local_setup.bash && {command}"
    return subprocess.run(
        ["bash", "-c", text], cwd=workspace, env=env, capture_output=True, text=True, timeout=120
    )


def prefix_of(workspace, package):
    """Install prefix that the ament index gives for the package in the sourced workspace."""
    code = f"from ament_index_python import get_package_prefix as p; print(p('{package}'))"
    done = in_workspace(workspace, f'"{sys.executable}" -c "{code}"')
    assert done.returncode == 0, done.stderr
    return Path(done.stdout.strip())


def test_every_package_is_in_the_index(workspace):
    """`ros2 pkg list` and launch's look-ups read these markers."""
    code = "from ament_index_python import get_packages_with_prefixes as p; print(sorted(p()))"
    done = in_workspace(workspace, f'"{sys.executable}" -c "{code}"')
    assert done.returncode == 0, done.stderr
    assert set(PACKAGES) <= set(eval(done.stdout))


def test_executables_run_from_the_install_space(workspace):
    """A wrong parameter is refused by each node: its imports and packaged YAML are found."""
    commands = {("heli_flight", name) for name in ("heli", "hover_test", "warm_up")}
    assert commands < set(EXECUTABLES)
    for package, name in commands:
        assert os.access(workspace / "install" / package / "lib" / package / name, os.X_OK)
    for package, name in set(EXECUTABLES) - commands:
        path = workspace / "install" / package / "lib" / package / name
        assert os.access(path, os.X_OK), path
        node = f'"{sys.executable}" "{path}" --ros-args -p no_such_parameter:=1'
        done = in_workspace(workspace, node)
        assert done.returncode == 2, done.stdout + done.stderr
        assert "no_such_parameter" in done.stderr
        assert "Traceback" not in done.stderr


def test_launch_and_config_files_are_shared(workspace):
    for package, name in LAUNCH_FILES:
        share = prefix_of(workspace, package) / "share" / package
        assert (share / "launch" / name).is_file()
    for package in PACKAGES:
        share = workspace / "install" / package / "share" / package
        for folder in ("config", "web"):
            wanted = [p for p in (ROOT / "src" / package / folder).rglob("*.*") if p.is_file()]
            for path in wanted:
                assert (share / path.relative_to(ROOT / "src" / package)).is_file(), path
