# SPDX-License-Identifier: Apache-2.0
"""What a node's command line says about its name and parameters, read before ROS starts. No ROS."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from heli_parameters.parameters import ParameterError


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
            raise ParameterError(f"unknown argument '{word}'; parameters follow --ros-args")
        elif word in ("--params-file", "-p", "--param", "-r", "--remap"):
            value = next(words, None)
            if value is None:
                raise ParameterError(f"{word} needs a value")
            if word == "--params-file":
                line.params_files.append(value)
            elif word in ("-p", "--param"):
                line.rules.append(value)
            else:
                _remap(line, value, node_name)
    return line
