# SPDX-License-Identifier: Apache-2.0
"""Beside ROS 2 Jazzy from apt: pytest starts, and Dockerfile, devcontainer and workflow agree.

No image is built here: what their steps call is there, and is called as CONTRIBUTING.md says.
"""

import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[2]
DOCKERFILE = (ROOT / "Dockerfile").read_text(encoding="utf-8")
# Entry points of pytest11 in launch_testing 3.4 and launch_testing_ros 0.26, and hooks as theirs:
# with an argument that pytest 9 has no longer, and one that only the first declares.
PLUGINS = {
    "launch_testing": "def pytest_pycollect_makemodule(path, parent):\n    return None\n",
    "launch_ros": "def pytest_launch_collect_makemodule(path, parent):\n    return None\n",
}


@pytest.fixture
def collect(tmp_path):
    """Collect a test where the named plugins of ROS are installed; the finished process."""
    (tmp_path / "test_one.py").write_text("def test_one():\n    pass\n")

    def run(config, *names):
        for name in names:
            (tmp_path / f"ros_{name}.py").write_text(PLUGINS[name])
            info = tmp_path / f"ros_{name}-3.4.dist-info"
            info.mkdir()
            (info / "METADATA").write_text(f"Name: ros-{name}\nVersion: 3.4\n")
            (info / "entry_points.txt").write_text(f"[pytest11]\n{name} = ros_{name}\n")
        # Where ROS is sourced its packages stand there.
        paths = [str(tmp_path), *filter(None, [os.environ.get("PYTHONPATH")])]
        command = [sys.executable, "-m", "pytest", "-p", "no:cacheprovider", "--collect-only"]
        return subprocess.run(
            [*command, "-q", "-c", config, tmp_path / "test_one.py"],
            cwd=tmp_path, env={**os.environ, "PYTHONPATH": os.pathsep.join(paths)},
            capture_output=True, text=True, timeout=120,
        )  # fmt: skip

    return run


@pytest.mark.parametrize(
    "installed", [(), ("launch_testing",), ("launch_testing", "launch_ros")], ids=len
)
def test_pytest_starts_beside_launch_testing(collect, installed):
    done = collect(ROOT / "pyproject.toml", *installed)
    assert done.returncode == 0 and "1 test collected" in done.stdout, done.stdout + done.stderr


@pytest.mark.parametrize("installed", [("launch_testing",), ("launch_ros",)])
def test_without_our_options_it_would_not_start(collect, installed):
    done = collect(os.devnull, *installed)
    assert done.returncode and "PluginValidationError" in done.stdout + done.stderr


def skipped_keys(text):
    return set(re.findall(r'--skip-keys "([^"]*)"', text))


def test_all_skip_the_same_keys_of_rosdep():
    (keys,) = skipped_keys(DOCKERFILE)
    assert skipped_keys((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")) == {keys}
    named = {
        key
        for manifest in ROOT.glob("src/*/package.xml")
        for key in re.findall(r"<exec_depend>(.*?)</exec_depend>", manifest.read_text())
    }
    assert set(keys.split()) <= named


def test_what_the_image_copies_and_runs_is_there():
    for source in re.findall(r"^COPY (\S+) ", DOCKERFILE, flags=re.MULTILINE):
        assert (ROOT / source).exists()
    for command in re.findall(r"/ros_entrypoint.sh (\S+)", DOCKERFILE):
        assert os.access(ROOT / command, os.X_OK)


def test_the_devcontainer_is_a_stage_of_the_image():
    container = json.loads((ROOT / ".devcontainer/devcontainer.json").read_text())
    build = container["build"]
    folder = ROOT / ".devcontainer"
    assert (folder / build["dockerfile"]).resolve() == ROOT / "Dockerfile"
    assert (folder / build["context"]).resolve() == ROOT
    assert f"AS {build['target']}\n" in DOCKERFILE
    entry, command, *_ = container["postCreateCommand"].split()
    assert entry in DOCKERFILE and os.access(ROOT / command, os.X_OK)


def test_the_workflow_builds_the_image_and_flies_in_it():
    """What a fork's run tells: whether apt's Jazzy flies the hover test, and passes the tests."""
    jobs = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text())["jobs"]
    commands = [step["run"] for step in jobs["jazzy"]["steps"] if "run" in step]
    (built,) = [c for c in commands if c.startswith("docker build ")]
    tag = built.split()[built.split().index("--tag") + 1]
    started = [c.partition(f" {tag} ")[2].split() for c in commands if c.startswith("docker run ")]
    scripts = {words[0] for words in started if words[0].startswith("./")}
    assert scripts == {"./hover_test.sh", "./run_tests.sh"}
    assert all(os.access(ROOT / script, os.X_OK) for script in scripts)
    assert not jobs["jazzy"].get("continue-on-error")
