# SPDX-License-Identifier: Apache-2.0
"""What the launch files of all packages share: arguments, nodes, and how a launch ends."""

import atexit
import os
import tempfile
from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch_ros.actions import Node

from heli_parameters.parameters import dump_all


class Argument(NamedTuple):
    """A launch argument; empty means that it was not given."""

    name: str
    default: str
    choices: list[str] | None
    text: str


LOG_LEVELS = ["debug", "info", "warn", "error", "fatal"]
COMMON = (
    Argument("namespace", "", None, "Prefix of all names"),
    Argument("params_file", "", None, "Parameter file over the packaged values"),
    Argument("log_level", "info", LOG_LEVELS, "Least severe of what nodes say"),
)


def declare(arguments: Sequence[Argument]) -> list[DeclareLaunchArgument]:
    """The actions that declare them."""
    return [
        DeclareLaunchArgument(
            a.name, default_value=a.default, choices=a.choices, description=a.text
        )
        for a in arguments
    ]


def users_files(given: Mapping[str, str]) -> list[str]:
    """The user's parameter file, if given; ValueError if there is none: launch would go on."""
    path = given["params_file"]
    if path and not Path(path).is_file():
        raise ValueError(f"params_file:={path}: is not a file")
    return [path] if path else []


def _when_one_ends(needed: bool, event: Any, context: Any) -> list[Shutdown]:
    """End the others, too. A failure is launch's own: what is raised makes its exit code 1."""
    if context.is_shutdown:
        return []
    if event.returncode:
        raise RuntimeError(f"{event.process_name} ended with exit code {event.returncode}")
    return [Shutdown(reason=f"{event.process_name} is done")] if needed else []


def node(
    package: str,
    name: str,
    given: Mapping[str, str],
    layers: Sequence[Any],
    needed: bool = True,
) -> Node:
    """A node with its parameter layers, the weakest first.

    Its end ends the launch, unless it is not needed to the end and has not failed.
    """
    return Node(
        package=package,
        executable=name,
        name=name,
        namespace=given["namespace"],
        parameters=[layer for layer in layers if layer],
        ros_arguments=["--log-level", given["log_level"]],
        output="screen",
        on_exit=partial(_when_one_ends, needed),
    )


def together(
    package: str,
    executable: str,
    given: Mapping[str, str],
    layers: Mapping[str, Sequence[Sequence[Any]]],
    needed: bool = True,
) -> Node:
    """Nodes in one process, an executable of `node_process.run_together`.

    Of each node its parameter layers in as many groups, the weakest group first. A file speaks to
    all by their names; values for one node are written into such a file, removed at launch's end.
    """
    files: dict[str, None] = {}
    for groups in zip(*layers.values(), strict=True):
        for name, group in zip(layers, groups, strict=True):
            files |= dict.fromkeys(_file(name, layer) for layer in group if layer)
    return Node(
        package=package,
        executable=executable,
        namespace=given["namespace"],
        parameters=list(files),
        ros_arguments=["--log-level", given["log_level"]],
        output="screen",
        on_exit=partial(_when_one_ends, needed),
    )


def _file(name: str, layer: Any) -> str:
    """A parameter file as it is; values of a node in one."""
    if isinstance(layer, str):
        return layer
    number, path = tempfile.mkstemp(prefix="heli_launch_", suffix=".yaml")
    os.close(number)
    atexit.register(Path(path).unlink, missing_ok=True)
    dump_all({name: layer}, path)
    return path


def _only(package: str, name: str, context: Any) -> list[Node]:
    given = context.launch_configurations
    return [node(package, name, given, users_files(given))]


def single_node(package: str, name: str) -> LaunchDescription:
    """Arguments as in COMMON, and the node of this name.

    The node configures and activates itself unless its parameter autostart is false.
    """
    function = OpaqueFunction(function=partial(_only, package, name))
    return LaunchDescription([*declare(COMMON), function])
