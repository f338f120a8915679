# SPDX-License-Identifier: Apache-2.0
"""What a node's command line says about its name and parameters, read before ROS starts. No ROS."""

import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.util import find_spec
from pathlib import Path

from heli_core.rcl_yaml import ParameterCause, ParameterError

# -------------------------------------------------------------------------------------------------
# Command line.
# -------------------------------------------------------------------------------------------------


@dataclass
class CommandLine:
    """ROS arguments that matter before the node exists.

    Attributes
    ----------
    params_files : list of str
        From `--params-file`, in order.
    rules : list of str
        From `-p name:=value`, in order.
    node_name : str
        After `-r __node:=...`.
    namespace : str
        After `-r __ns:=...`, with a leading slash.
    """

    node_name: str
    namespace: str = "/"
    params_files: list[str] = field(default_factory=list)
    rules: list[str] = field(default_factory=list)

    @property
    def full_name(self) -> str:
        """Fully qualified node name."""
        return f"{self.namespace.rstrip('/')}/{self.node_name}"


def _remap(line: CommandLine, rule: str, default_name: str) -> None:
    left, _, right = rule.partition(":=")
    node, _, key = left.rpartition(":")
    if node and node != default_name:
        return
    if key in ("__node", "__name"):
        line.node_name = right
    elif key == "__ns":
        line.namespace = "/" + right.strip("/")


def parse(argv: Sequence[str], node_name: str) -> CommandLine:
    """Read the ROS arguments (between `--ros-args` and `--`).

    Raises
    ------
    ParameterError
        If an option lacks its value, or a word stands outside of the ROS arguments.
    """
    line = CommandLine(node_name)
    in_ros = False
    words = iter(argv)
    for word in words:
        if word == "--ros-args":
            in_ros = True
        elif word == "--":
            in_ros = False
        elif not in_ros:
            raise ParameterError(
                f"unknown argument '{word}'; parameters follow --ros-args", ParameterCause.SYNTAX
            )
        elif word in ("--params-file", "-p", "--param", "-r", "--remap"):
            value = next(words, None)
            if value is None:
                raise ParameterError(f"{word} needs a value", ParameterCause.MISSING)
            if word == "--params-file":
                line.params_files.append(value)
            elif word in ("-p", "--param"):
                line.rules.append(value)
            else:
                _remap(line, value, node_name)
    return line


# -------------------------------------------------------------------------------------------------
# Where a package has its files: source tree, pip environment or colcon install space.
# -------------------------------------------------------------------------------------------------


class MissingFileError(FileNotFoundError):
    """A packaged file or executable is missing; the message says what was sought where."""


def _package_folder(package: str) -> Path:
    spec = find_spec(package)
    if spec is None or spec.origin is None:
        raise MissingFileError(f"package {package} is not installed in {sys.executable}")
    return Path(spec.origin).parent


def share_folder(package: str) -> Path:
    """Folder with the package's config/ and launch/.

    Raises
    ------
    MissingFileError
        If the package is installed without its data files.
    """
    folder = _package_folder(package)
    if (folder.parent / "package.xml").is_file():
        return folder.parent
    for parent in folder.parents:
        share = parent / "share" / package
        if (share / "package.xml").is_file():
            return share
    raise MissingFileError(f"{package}: no share/{package}/package.xml above {folder}")


def config_folder(package: str) -> Path:
    """Folder of the package's YAML files; raises MissingFileError."""
    folder = share_folder(package) / "config"
    if not folder.is_dir():
        raise MissingFileError(f"{package}: no folder {folder}")
    return folder


def _prefixes() -> list[Path]:
    """Where programs may be installed: as `ros2 run` looks, then this environment."""
    named = os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)
    return list(dict.fromkeys([*(Path(p) for p in named if p), Path(sys.prefix)]))


def executable(package: str, name: str) -> Path:
    """Executable of the package, sought as `ros2 run` seeks it: <prefix>/lib/<package>/<name>.

    Raises
    ------
    MissingFileError
        Names every prefix that was looked into.
    """
    for prefix in _prefixes():
        path = prefix / "lib" / package / name
        if path.is_file() and os.access(path, os.X_OK):
            return path
    sought = ", ".join(str(prefix) for prefix in _prefixes())
    raise MissingFileError(f"no executable lib/{package}/{name} in {sought}")


def executables(beginning: str) -> list[tuple[str, str]]:
    """Package and name of every executable of the packages whose names begin so."""
    folders = [prefix / "lib" for prefix in _prefixes()]
    names = {
        (path.parent.name, path.name)
        for folder in folders
        for path in folder.glob(f"{beginning}*/*")
        if path.is_file() and os.access(path, os.X_OK)
    }
    return sorted(names)
