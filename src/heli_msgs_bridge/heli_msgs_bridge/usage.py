# SPDX-License-Identifier: Apache-2.0
"""What a node answers to `--help`: usage and its parameters, from its table and packaged files."""

import textwrap
from collections.abc import Sequence
from typing import Any

from heli_msgs_bridge.node_spec import NodeSpec
from heli_parameters.parameters import Parameter

_WIDTH = 100
_ROS_ARGUMENTS = (
    ("-r __node:=NAME", "another name; parameter files then speak of it by that name"),
    ("-r __ns:=/NAMESPACE", "prefix of node and topics"),
    ("-r FROM:=TO", "another name of a topic or service"),
    ("--params-file FILE", "parameter file over the packaged values; repeatable"),
    ("-p NAME:=VALUE", "one parameter, over all files; repeatable"),
    ("--log-level LEVEL", "debug, info, warn, error or fatal"),
)


def asks_for_help(arguments: Sequence[str]) -> bool:
    """Whether a command line asks for help rather than for a node (before `--ros-args`)."""
    own = list(arguments)
    if "--ros-args" in own:
        own = own[: own.index("--ros-args")]
    return "--help" in own or "-h" in own


def _shown(value: Any) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, str):
        return f'"{value}"' if value == "" or " " in value else value
    if hasattr(value, "tolist"):
        value = value.ravel().tolist()
    if isinstance(value, (list, tuple)):
        return textwrap.shorten(f"[{', '.join(_shown(v) for v in value)}]", 60, placeholder=" ...]")
    return str(value)


def _row(row: Parameter, value: Any) -> str:
    fixed = "; fixed while the node runs" if row.read_only else ""
    said = f"{row.description}: {row.allowed()}{fixed}"
    body = textwrap.fill(said, _WIDTH, initial_indent="      ", subsequent_indent="      ")
    return f"  {row.name} = {_shown(value)}\n{body}"


def usage(spec: NodeSpec, summary: str) -> str:
    """Help of a node.

    Parameters
    ----------
    spec : NodeSpec
    summary : str
        What the node does, in a sentence.

    Returns
    -------
    str
        With a line break at its end.

    Raises
    ------
    StartError
        The installation lacks the packaged values.
    """
    values = spec.resolve()
    width = max(len(left) for left, _ in _ROS_ARGUMENTS)
    options = "\n".join(f"  {left:<{width}}  {right}" for left, right in _ROS_ARGUMENTS)
    rows = "\n".join(_row(row, values[row.name]) for row in spec.full_table())
    return (
        f"usage: ros2 run {spec.package} {spec.name} [--help] [--ros-args ...]\n\n"
        f"{textwrap.fill(' '.join(summary.split()), _WIDTH)}\n\n"
        f"after --ros-args:\n{options}\n\n"
        f"parameters with their packaged values:\n{rows}\n\n"
        "exit code: 0 asked to end or flight over, 1 failed in flight, 2 could not start\n"
    )
