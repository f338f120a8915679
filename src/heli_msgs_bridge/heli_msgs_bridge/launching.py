# SPDX-License-Identifier: Apache-2.0
"""What the launch files of all packages share: arguments, nodes, and how a launch ends."""

import atexit
import os
import shutil
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, Shutdown
from launch_ros.actions import Node

from heli_core.rcl_yaml import dump_all
from heli_msgs_bridge.handover import FOLDER, note_restart


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


def users_files(configurations: Mapping[str, str]) -> list[str]:
    """The user's parameter file, if given; ValueError if there is none: launch would go on."""
    path = configurations["params_file"]
    if path and not Path(path).is_file():
        raise ValueError(f"params_file:={path}: is not a file")
    return [path] if path else []


class NodeRestarter:
    """Starts nodes again that die, up to a number of times; the others are told.

    Parameters
    ----------
    names : sequence of str
        Which; a node that is not one of them ends the launch.
    most, within_s
        A node that dies so often within so many seconds of wall time ends the launch, too.
    now_s : callable, optional
        Wall time, s.

    Attributes
    ----------
    folder : Path
        Of what nodes leave to their successors; removed at launch's end.
    """

    DELAY_S = 0.05
    """Wall time until the next one starts: so long launch has to hear that all is to end."""

    def __init__(
        self,
        names: Sequence[str],
        most: int,
        within_s: float,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._most, self._within_s, self._now_s = most, within_s, now_s
        self._died_s: dict[str, list[float]] = {name: [] for name in names}
        self.folder = Path(tempfile.mkdtemp(prefix="heli_launch_"))
        atexit.register(shutil.rmtree, self.folder, ignore_errors=True)

    def options(self, name: str) -> dict[str, Any]:
        """What launch is to know of a node beyond the usual."""
        options: dict[str, Any] = {"additional_env": {FOLDER: str(self.folder)}}
        if name in self._died_s:
            options |= {"respawn": True, "respawn_delay": self.DELAY_S}
        return options

    def takes(self, name: str, returncode: int) -> bool:
        """Whether a node that has ended is started again: one that has died, not too often.

        With 0 it is done, with 2 it could not start.
        """
        died = self._died_s.get(name)
        if died is None or returncode in (0, 2):
            return False
        now_s = self._now_s()
        died[:] = [*(s for s in died if now_s - s < self._within_s), now_s]
        if len(died) >= self._most:
            return False
        note_restart(self.folder, name)
        return True


def _when_one_ends(
    needed: bool, name: str, again: NodeRestarter | None, event: Any, context: Any
) -> list[Shutdown]:
    """End the others, too. A failure is launch's own: what is raised makes its exit code 1."""
    if context.is_shutdown or (again is not None and again.takes(name, event.returncode)):
        return []
    if event.returncode:
        raise RuntimeError(f"{event.process_name} ended with exit code {event.returncode}")
    return [Shutdown(reason=f"{event.process_name} is done")] if needed else []


def node(
    package: str,
    name: str,
    configurations: Mapping[str, str],
    layers: Sequence[Any],
    needed: bool = True,
    again: NodeRestarter | None = None,
) -> Node:
    """A node with its parameter layers, the weakest first.

    Its end ends the launch, unless it is not needed to the end and has not failed, or is started
    again.
    """
    return Node(
        package=package,
        executable=name,
        name=name,
        namespace=configurations["namespace"],
        parameters=[layer for layer in layers if layer],
        ros_arguments=["--log-level", configurations["log_level"]],
        output="screen",
        on_exit=partial(_when_one_ends, needed, name, again),
        **(again.options(name) if again is not None else {}),
    )


def together(
    package: str,
    executable: str,
    configurations: Mapping[str, str],
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
        namespace=configurations["namespace"],
        parameters=list(files),
        ros_arguments=["--log-level", configurations["log_level"]],
        output="screen",
        on_exit=partial(_when_one_ends, needed, executable, None),
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
    configurations = context.launch_configurations
    return [node(package, name, configurations, users_files(configurations))]


def single_node(package: str, name: str) -> LaunchDescription:
    """Arguments as in COMMON, and the node of this name.

    The node configures and activates itself unless its parameter autostart is false.
    """
    function = OpaqueFunction(function=partial(_only, package, name))
    return LaunchDescription([*declare(COMMON), function])
