# SPDX-License-Identifier: Apache-2.0
"""Builds the types of actions and of transforms for an environment of wheels.

The wheels of ROS 2 hold neither heli_interfaces nor tf2_msgs. rosidl's generators are on PyPI; with
a C++ compiler and CMake they make what apt's ROS 2 would have. They are brought into a folder that
is removed afterwards: of the environment only the types that were built are part. No ROS is
imported here.
"""

import hashlib
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from heli_core.errors import FlightError

PACKAGES = ("tf2_msgs", "heli_interfaces")
STAMP = Path("share/heli_interfaces/heli_stamp")
"""Below the environment; written last of all, with the digest of what was built."""
TF2_MSGS = {
    "msg/TFMessage.msg": "geometry_msgs/TransformStamped[] transforms\n",
    "package.xml": """\
<package format="3">
  <name>tf2_msgs</name>
  <version>0.36.0</version>
  <description>TFMessage of tf2_msgs</description>
  <maintainer email="ros@ros.org">ROS</maintainer>
  <license>BSD-3-Clause</license>
  <buildtool_depend>ament_cmake</buildtool_depend>
  <buildtool_depend>rosidl_default_generators</buildtool_depend>
  <depend>geometry_msgs</depend>
  <exec_depend>rosidl_default_runtime</exec_depend>
  <member_of_group>rosidl_interface_packages</member_of_group>
</package>
""",
    "CMakeLists.txt": """\
cmake_minimum_required(VERSION 3.20)
project(tf2_msgs)
find_package(ament_cmake REQUIRED)
find_package(geometry_msgs REQUIRED)
find_package(rosidl_default_generators REQUIRED)
rosidl_generate_interfaces(tf2_msgs "msg/TFMessage.msg" DEPENDENCIES geometry_msgs)
ament_package()
""",
}
"""The one message of tf2_msgs that a graph of this stack has on its topics (ros2/geometry2)."""
_LONGEST = 400
_STEP = re.compile(r"\[(\d+)/(\d+)\]")
# Where the wheels were built.
_FOREIGN_INCLUDES = re.compile(r'/opt/python/[^";]*/include/python[\d.]+;/opt/[^";]*/numpy/[^";]*')
Say = Callable[[str], None]


class InterfaceBuildError(FlightError):
    """The types cannot be built here; the message is one line."""


def wanted_stamp(root: Path) -> str:
    """Digest of the definitions, the generators and the interpreter."""
    folder, digest = root / "src/heli_interfaces", hashlib.sha256(sys.version.encode())
    files = [*sorted(folder.rglob("*.*")), root / "requirements/hashes/interfaces.txt"]
    for content in (*(path.read_bytes() for path in files), repr(TF2_MSGS).encode()):
        digest.update(hashlib.sha256(content).digest())
    return digest.hexdigest()


def are_built(root: Path, prefix: Path) -> bool:
    """Whether the environment at a prefix has the types of a checkout's definitions."""
    stamp = prefix / STAMP
    return stamp.is_file() and stamp.read_text() == wanted_stamp(root)


def can_build(root: Path) -> None:
    """Raise InterfaceBuildError where there is nothing to build, or no need to."""
    if not (root / "src/heli_interfaces/package.xml").is_file():
        raise InterfaceBuildError("the definitions are not here: do it in a checkout, by ./heli")
    if os.environ.get("ROS_DISTRO"):
        raise InterfaceBuildError(
            "ROS 2 is sourced: there set-up builds heli_interfaces by colcon, and tf2_msgs is apt's"
        )


def build(root: Path, prefix: Path, say: Say) -> bool:
    """Build the types and put them into an environment; False if they are there already.

    Parameters
    ----------
    root : Path
        Checkout with the definitions.
    prefix : Path
        Environment of wheels (`sys.prefix`).
    say : callable
        Takes a line on how far it is.

    Raises
    ------
    InterfaceBuildError
        In one sentence: what is missing, or what failed.
    """
    if are_built(root, prefix):
        return False
    _check_tools()
    with tempfile.TemporaryDirectory(prefix="heli_interfaces_") as place:
        work = Path(place)
        log = work / "log"
        say("fetching rosidl's generators")
        view = _bring_generators(root, prefix, work, log)
        _mirror(prefix, view)
        staged = work / "staged"
        for name in PACKAGES:
            source = root / "src" / name
            if name == "tf2_msgs":
                source = work / name
                _write_tf2_msgs(source)
            _compile(name, source, (view, prefix, staged), work, log, say)
            # What is built of one is there for the next.
            _mirror(staged, view)
        shutil.copytree(staged, prefix, dirs_exist_ok=True, symlinks=True)
    (prefix / STAMP).write_text(wanted_stamp(root))
    return True


def _check_tools() -> None:
    header = Path(sysconfig.get_paths()["include"]) / "Python.h"
    missing = [
        what
        for what, there in (
            ("a C++ compiler (c++)", shutil.which("c++")),
            ("CMake (cmake)", shutil.which("cmake")),
            (f"Python's headers ({header})", header.is_file()),
        )
        if not there
    ]
    if missing:
        raise InterfaceBuildError(
            f"the types are compiled: {', '.join(missing)} not found; install them (Debian, "
            "Ubuntu: apt install g++ cmake python3-dev), or fly without: services and topics do it"
        )


def _uv(prefix: Path) -> str:
    own = prefix / "heli_uv/bin/uv"
    found = str(own) if own.is_file() else shutil.which("uv")
    if not found:
        raise InterfaceBuildError("uv is not found, by which the generators are fetched")
    return found


def _run(command: list[str], log: Path, what: str, env: dict[str, str] | None = None) -> None:
    for _ in _lines(command, log, what, env):
        continue


def _lines(
    command: list[str], log: Path, what: str, env: dict[str, str] | None = None
) -> Iterator[str]:
    """Lines that a command prints; they are kept in the log, whose last ones say why it failed."""
    with (
        log.open("a") as kept,
        subprocess.Popen(
            command, env=env, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True,
        ) as running,
    ):  # fmt: skip
        assert running.stdout is not None
        for line in running.stdout:
            kept.write(line)
            yield line
    if running.returncode:
        raise InterfaceBuildError(f"{what} failed: {_why(log)}")


def _why(log: Path) -> str:
    """What of a log says most of a failure: CMake's error, a compiler's, or the last line."""
    text = log.read_text()
    if told := text.rpartition("CMake Error")[2] if "CMake Error" in text else "":
        return " ".join(told.split("Call Stack")[0].split())[:_LONGEST]
    lines = [" ".join(line.split()) for line in text.splitlines() if line.strip()]
    errors = [line for line in lines if "error:" in line]
    return (errors or lines or ["it said nothing"])[-1][:_LONGEST]


def _bring_generators(root: Path, prefix: Path, work: Path, log: Path) -> Path:
    """An environment with the generators alone."""
    view = work / "view"
    _run([sys.executable, "-m", "venv", "--without-pip", str(view)], log, "python -m venv")
    install = [sys.executable, str(root / "scripts/uv_install.py"), _uv(prefix)]
    install += ["--python", str(view / "bin/python"), "--no-deps", "--require-hashes"]
    install += ["-r", str(root / "requirements/hashes/interfaces.txt")]
    _run(install, log, "fetching the generators (is there a network?)")
    return view


def _mirror(prefix: Path, view: Path) -> None:
    """Have an environment's packages in the view, where CMake's files name this machine's headers.

    Those of the wheels name the headers of the machine on which these were built.
    """
    import numpy

    includes = f"{sysconfig.get_paths()['include']};{numpy.get_include()}"
    for folder in prefix.glob("share/*/cmake"):
        copy = view / "share" / folder.parent.name
        if (copy / "cmake").exists():
            continue
        shutil.copytree(folder.parent, copy, ignore_dangling_symlinks=True, dirs_exist_ok=True)
        for file in (copy / "cmake").glob("*.cmake"):
            text = file.read_text()
            file.write_text(_FOREIGN_INCLUDES.sub(lambda _: includes, text))
    site = Path(sysconfig.get_path("purelib", vars={"base": "", "platbase": ""}).lstrip("/"))
    for folder in (Path("lib"), Path("include"), site):
        (view / folder).mkdir(parents=True, exist_ok=True)
        for path in (prefix / folder).glob("*"):
            link = view / folder / path.name
            if not (path.name.startswith("python") or link.exists() or link.is_symlink()):
                link.symlink_to(path.resolve())


def _write_tf2_msgs(folder: Path) -> None:
    for name, text in TF2_MSGS.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)


def _compile(
    name: str, source: Path, places: tuple[Path, Path, Path], work: Path, log: Path, say: Say
) -> None:
    """Generate and compile a package, and install it into the staged environment."""
    view, prefix, staged = places
    site = view / Path(sysconfig.get_path("purelib", vars={"base": "", "platbase": ""}).lstrip("/"))
    env = dict(os.environ) | {
        "AMENT_PREFIX_PATH": os.pathsep.join(map(str, (view, prefix, staged))),
        "PYTHONPATH": str(site),
    }
    folder = work / f"build_{name}"
    configure = ["cmake", "-S", str(source), "-B", str(folder), f"-DCMAKE_PREFIX_PATH={view}"]
    configure += [f"-DCMAKE_INSTALL_PREFIX={staged}", f"-DPython3_EXECUTABLE={sys.executable}"]
    # They copy fields: optimised they take no less time to fly with, and longer to compile.
    configure += ["-DCMAKE_CXX_FLAGS=-O0", "-DCMAKE_C_FLAGS=-O1"]
    if shutil.which("ninja"):
        configure += ["-G", "Ninja"]
    say(f"{name}: reading the definitions")
    _run(configure, log, f"{name}: cmake", env)
    cores = str(len(os.sched_getaffinity(0)))
    command = ["cmake", "--build", str(folder), "--target", "install", "--parallel", cores]
    told = 0
    for line in _lines(command, log, f"{name}: the compiler", env):
        if step := _STEP.match(line):
            tenth = 10 * int(step[1]) // int(step[2])
            if tenth > told:
                told = tenth
                say(f"{name}: {10 * tenth} % compiled")
