# SPDX-License-Identifier: Apache-2.0
"""package.xml, setup.py, pyproject.toml and the requirement files say the same."""

import ast
import os
import re
import runpy
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions
from pathlib import Path
from xml.etree import ElementTree

import pytest
from catkin_pkg.changelog import get_changelog_from_path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = sorted(path.parent.name for path in (ROOT / "src").glob("*/setup.py"))
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())
COMPILED = "heli_interfaces"
"""The one package that is no Python: its types are generated and compiled."""
VERSION = PROJECT["project"]["version"]
# Python import -> rosdep key, where the two differ from python3-<import>.
ROSDEP_KEYS = {"yaml": "python3-yaml", "markupsafe": "python3-jinja2"}
# Keys that rosdep resolves to a package of Ubuntu noble: rosdep/python.yaml of ros/rosdistro,
# commit 8468e88ccd, looked up on 2026-11-22.
KNOWN_TO_ROSDEP = {
    "python3-aiohttp",
    "python3-jinja2",
    "python3-matplotlib",
    "python3-numba",
    "python3-numpy",
    "python3-pygame",
    "python3-pytest",
    "python3-rich",
    "python3-scipy",
    "python3-typer",
    "python3-yaml",
}
# Python import -> key that rosdep resolves to pip (same commit), by name or, of mcap, by what
# brings it; of typer to noble's package, which is too old.
PIP_KEYS = {
    "control": "python-control-pip",
    "mcap": "mcap-ros2-support",
    "rosbags": "python3-rosbags-pip",
    "typer": "python3-typer",
}
# Released packages of jazzy/distribution.yaml, same commit and day.
KNOWN_IN_JAZZY = {
    "action_msgs",
    "ament_index_python",
    "diagnostic_msgs",
    "geometry_msgs",
    "launch",
    "launch_ros",
    "lifecycle_msgs",
    "nav_msgs",
    "rcl_interfaces",
    "rclpy",
    "rosgraph_msgs",
    "rosidl_adapter",
    "rosidl_parser",
    "sensor_msgs",
    "std_msgs",
    "std_srvs",
    "test_msgs",
    "tf2_msgs",
    "trajectory_msgs",
    "visualization_msgs",
}
DISTRIBUTIONS = {"yaml": "pyyaml", "foxglove": "foxglove-sdk", "pygame": "pygame-ce"}
# By pip, into an environment that sees the system's packages (CONTRIBUTING.md): noble has no such
# package, or, of typer, one that is too old; apsw, lz4 and zstandard come with rosbags.
BY_PIP = {
    "apsw", "cma", "control", "distributed", "foxglove", "lz4", "mcap", "pyarrow", "rosbags",
    "ruckig", "typer", "zstandard",
}  # fmt: skip

# Of an extra: who asks for what needs it, and has it not, is told so in a sentence.
OPTIONAL = {"gymnasium", "pymavlink"}


def manifest(package):
    return ElementTree.parse(ROOT / "src" / package / "package.xml").getroot()


def imports(package):
    """Top-level names that a package's modules and launch files import."""
    names = set()
    sources = [*(ROOT / "src" / package / package).rglob("*.py")]
    for path in [*sources, *(ROOT / "src" / package / "launch").glob("*.py")]:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                names.add(node.module.split(".")[0])
    return names - set(sys.stdlib_module_names) - {package}


def of_ros(name):
    return name.endswith(("_msgs", "_interfaces")) or name in (
        "rclpy",
        "rcl_interfaces",
        "rosidl_adapter",
        "rosidl_parser",
        "std_srvs",
        "launch",
        "launch_ros",
        "ament_index_python",
    )


def pins(name):
    """Requirement names of one file, lower case."""
    lines = (ROOT / "requirements" / name).read_text().splitlines()
    matches = (re.match(r"[A-Za-z0-9._-]+", line) for line in lines)
    return {match.group().lower().replace("_", "-") for match in matches if match}


def test_every_package_has_a_manifest():
    folders = {path.name for path in (ROOT / "src").iterdir() if (path / path.name).is_dir()}
    assert set(PACKAGES) == folders


def test_what_is_compiled_is_built_by_ament_cmake():
    root = manifest(COMPILED)
    assert root.findtext("export/build_type") == "ament_cmake"
    assert (root.findtext("version"), root.findtext("license")) == (VERSION, "Apache-2.0")
    maintainer = manifest(PACKAGES[0]).find("maintainer")
    assert root.find("maintainer").items() == maintainer.items()
    keys = {node.text for node in root if node.tag.endswith("depend")}
    generators = {"ament_cmake", "rosidl_default_generators", "rosidl_default_runtime"}
    assert generators < keys and keys - generators <= KNOWN_IN_JAZZY
    assert root.findtext("member_of_group") == "rosidl_interface_packages"
    manifests = {path.parent.name for path in (ROOT / "src").glob("*/package.xml")}
    assert manifests == {*PACKAGES, COMPILED}


def test_the_packages_that_were_asked_for_are_here():
    asked = {"heli_dynamics_sim", "heli_inner_hinf", "heli_outer_pd", "heli_observer"}
    assert {*asked, "heli_msgs_bridge"} <= set(PACKAGES)


def test_maintainers_are_those_who_commit():
    """package.xml wants a name and an address: those of the history, no invented ones."""
    maintainers = {
        (tag.text, tag.get("email"))
        for package in PACKAGES
        for tag in manifest(package).findall("maintainer")
    }
    authors = PROJECT["project"]["authors"]
    assert maintainers == {(author["name"], author["email"]) for author in authors}
    log = ["git", "log", "--format=%an%x00%ae"]
    history = subprocess.run(log, cwd=ROOT, capture_output=True, text=True)
    if history.returncode or not history.stdout:
        pytest.skip("the sources came without their history")
    assert maintainers <= {tuple(line.split("\0")) for line in history.stdout.splitlines()}


@pytest.mark.parametrize("package", PACKAGES)
class TestManifest:
    def test_identity(self, package):
        root = manifest(package)
        assert root.get("format") == "3"
        assert root.findtext("name") == package
        assert root.findtext("version") == VERSION
        assert root.findtext("license") == "Apache-2.0"
        assert root.findtext("export/build_type") == "ament_python"
        assert len(root.findtext("description")) > 20

    def test_maintainer_address_is_one_that_catkin_accepts(self, package):
        # With an invalid address colcon takes the package for plain Python, not in the index.
        address = manifest(package).find("maintainer").get("email")
        assert re.fullmatch(r"[-a-zA-Z0-9_%+]+(\.[-a-zA-Z0-9_%+]+)*@[-a-zA-Z0-9%.]+", address)

    def test_what_is_written_is_up_to_date(self, package):
        written = runpy.run_path(str(ROOT / "scripts/ros_package.py"))["files"]
        for name, text in written(package).items():
            there = (ROOT / "src" / package / name).read_text(encoding="utf-8")
            assert there == text, f"{package}/{name}: run scripts/ros_package.py"

    def test_marker(self, package):
        assert (ROOT / "src" / package / "resource" / package).is_file()

    def test_imports_are_declared(self, package):
        declared = {node.text for node in manifest(package).findall("exec_depend")}
        needed = {
            name
            if name.startswith("heli_") or of_ros(name)
            else ROSDEP_KEYS.get(name, f"python3-{name}")
            for name in imports(package) - BY_PIP - OPTIONAL
        }
        needed |= {PIP_KEYS[name] for name in imports(package) & set(PIP_KEYS)}
        assert needed - declared == set()

    def test_rosdep_knows_every_key(self, package):
        keys = {node.text for node in manifest(package) if node.tag.endswith("depend")}
        known = KNOWN_TO_ROSDEP | KNOWN_IN_JAZZY | set(PIP_KEYS.values())
        assert keys - known - {*PACKAGES, COMPILED} == set()

    def test_executables_call_an_existing_main(self, package):
        for script in (ROOT / "src" / package / "scripts").glob("*"):
            assert os.access(script, os.X_OK), script
            text = script.read_text()
            assert text.startswith("#!/usr/bin/env python3\n")
            module = re.search(rf"from {package}\.([\w.]+) import main", text).group(1)
            file = (ROOT / "src" / package / package / module.replace(".", "/")).with_suffix(".py")
            tree = ast.parse(file.read_text())
            functions = [n.name for n in tree.body if isinstance(n, ast.FunctionDef)]
            assert "main" in functions


def test_every_third_party_import_is_required():
    """What src/ imports is in requirements, and nothing there is dead weight."""
    needed = set()
    for package in PACKAGES:
        needed |= {n for n in imports(package) if not n.startswith("heli_") and not of_ros(n)}
    needed = {DISTRIBUTIONS.get(name, name) for name in needed}
    assert needed - pins("python.txt") == pins("gym.txt") | pins("mavlink.txt") == OPTIONAL
    assert OPTIONAL <= pins("test.txt")
    assert pins("python.txt") - needed == set()


@pytest.mark.parametrize("package", [*PACKAGES, COMPILED])
def test_the_changelog_is_one_that_bloom_reads(package):
    """REP 132; its newest version is that of package.xml."""
    changelog = get_changelog_from_path(ROOT / "src" / package)
    version, _, content = next(changelog.foreach_version(reverse=True))
    assert version == VERSION
    assert [item for entries in content for item in entries]
    first = (ROOT / "src" / package / "CHANGELOG.rst").read_text(encoding="utf-8")
    assert f"Changelog for package {package}\n" in first


def test_what_pip_brings_is_named_where_rosdep_is():
    text = " ".join((ROOT / "CONTRIBUTING.md").read_text().split())
    for key in set(PIP_KEYS.values()) - KNOWN_TO_ROSDEP:
        assert key in text
    assert BY_PIP <= {n for package in PACKAGES for n in imports(package)}
    for name in BY_PIP:
        assert DISTRIBUTIONS.get(name, name) in text
    assert BY_PIP <= {n.replace("-sdk", "") for n in pins("python.txt")}


def test_test_tools_are_required():
    """What tests import is in requirements, too."""
    files = [*(ROOT / "tests").rglob("*.py"), *(ROOT / "src").glob("*/test/*.py")]
    local = {path.stem for path in files} | {*PACKAGES, "evidence", "support"}
    names = set()
    for path in files:
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.split(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.level == 0:
                names.add(node.module.split(".")[0])
    names = {n for n in names - set(sys.stdlib_module_names) - local if not of_ros(n)}
    known = pins("python.txt") | pins("test.txt") | pins("ros_test.txt")
    known |= pins("hashes/jsbsim.txt")  # its tests are nightly, and skipped without it
    owners = packages_distributions()
    for name in names:
        owned = {owner.lower().replace("_", "-") for owner in owners.get(name, [name])}
        # mcap comes with rosbags, catkin-pkg with colcon-ros.
        assert owned & (known | {"mcap", "catkin-pkg"}), (
            f"{name} is imported by a test but not required"
        )


def test_every_requirement_is_pinned_exactly():
    lines = (ROOT / "requirements/constraints.txt").read_text().splitlines()
    entries = [line for line in lines if line and not line.startswith("#")]
    assert all(re.fullmatch(r"[a-z0-9._-]+==[A-Za-z0-9.]+", line) for line in entries)
    for name in ("ros.txt", "python.txt", "ros_test.txt", "test.txt"):
        assert pins(name) <= pins("constraints.txt")


def hashed(name):
    """Packages of a list of requirements/hashes: name to version and hashes."""
    text = (ROOT / f"requirements/hashes/{name}.txt").read_text()
    packages = {}
    for block in re.split(r"^(?=\w)", text, flags=re.MULTILINE)[1:]:
        package, version = re.match(r"([\w.-]+)==([^\s;]+)", block).groups()
        packages[package] = version, re.findall(r"--hash=sha256:([0-9a-f]{64})\b", block)
    return packages


def test_every_file_that_is_installed_has_its_hash():
    """The lists are those of the pins: who renews these writes them anew (write_hashes.py)."""
    lines = (ROOT / "requirements/constraints.txt").read_text().splitlines()
    pinned = dict(line.split("==") for line in lines if "==" in line and line[0] != "#")
    pinned = {name.replace(".", "-"): version for name, version in pinned.items()}
    lists = {name: hashed(name) for name in ("flight", "test", "uv")}
    together = {package for packages in lists.values() for package in packages}
    # Of these nothing is installed on Linux, so they have no pin.
    elsewhere = {"colorama", "coloredlogs", "humanfriendly", "pyreadline3"}
    assert together - elsewhere <= set(pinned)
    # What flies wants colorama elsewhere alone, the tools of the documents' site everywhere.
    assert set(lists["flight"]) & set(lists["test"]) <= elsewhere
    # The guided fuzz has a pin of its own: set-up does not install it.
    (fuzzer,) = hashed("fuzz").items()
    assert f'"{fuzzer[0]}=={fuzzer[1][0]}"' in (ROOT / "scripts/write_hashes.py").read_text()
    assert fuzzer[1][1] and fuzzer[0] not in pinned
    # What compiles types has pins of its own, too, where set-up does not install it.
    generators = hashed("interfaces")
    asked = (ROOT / "requirements/interfaces.txt").read_text().splitlines()
    wanted = dict(line.partition("==")[::2] for line in asked if not line.startswith("#"))
    assert all(hashes for _, hashes in generators.values())
    for package, version in wanted.items():
        known = generators.get(package, (pinned.get(package), ()))[0]
        assert known and version in ("", known), package
    for packages in lists.values():
        for package, (version, hashes) in packages.items():
            assert hashes, package
            assert package in elsewhere or version == pinned[package], package
    for name, kind in (("ros", "flight"), ("python", "flight"), ("test", "test")):
        wanted = {pin.split("==")[0].lower() for pin in pins(f"{name}.txt")}
        assert wanted <= set(lists[kind]) | set(lists["flight"]), name


@pytest.mark.skipif("ROS_DISTRO" in os.environ, reason="the system's packages come first there")
def test_running_environment_is_the_pinned_one():
    """Catches a test run in an environment that set-up did not make."""
    from importlib.metadata import version

    lines = (ROOT / "requirements/constraints.txt").read_text().splitlines()
    pinned = dict(line.split("==") for line in lines if "==" in line and line[0] != "#")
    for name in ("numpy", "scipy", "numba", "pytest"):
        assert version(name) == pinned[name]


def test_pyproject_names_every_package():
    settings = PROJECT["tool"]["setuptools"]
    assert settings["package-dir"] == {name: f"src/{name}/{name}" for name in PACKAGES}
    assert settings["packages"]["find"]["where"] == [f"src/{name}" for name in PACKAGES]
