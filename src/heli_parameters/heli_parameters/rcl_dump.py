# SPDX-License-Identifier: Apache-2.0
"""Writes ROS 2 parameter files that rcl, and the reader here, read back bit for bit."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from heli_parameters.rcl_yaml import ParameterError


def number(value: float) -> str:
    """Shortest text that reads back as the same double, in YAML 1.1 and in rcl alike."""
    text = repr(float(value))
    if "e" in text and "." not in text:
        mantissa, exponent = text.split("e")
        text = f"{mantissa}.0e{exponent}"
    if "e" in text and text.split("e")[1][0] not in "+-":
        text = text.replace("e", "e+")
    return text


def _yaml_value(value: Any) -> str:
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    if isinstance(value, (int, np.integer)):
        return str(int(value))
    if isinstance(value, (float, np.floating)):
        return number(float(value))
    if isinstance(value, str):
        return "'" + value.replace("'", "''") + "'"
    items = value.ravel().tolist() if isinstance(value, np.ndarray) else list(value)
    return "[" + ", ".join(_yaml_value(item) for item in items) + "]"


def dump_all(
    values_by_node: Mapping[str, Mapping[str, Any]], path: str | Path, head: Sequence[str] = ()
) -> None:
    """Write resolved parameters as one rcl parameter file that reads back bit for bit.

    Parameters
    ----------
    values_by_node : mapping of node name to mapping of parameter name to value
        As `load` returns them.
    path : path
        File to write.
    head : sequence of str
        Lines of a comment to begin with.

    Raises
    ------
    ParameterError
        If the file cannot be written.
    """
    lines = [f"# {line}".rstrip() for line in head]
    for node_name, values in values_by_node.items():
        lines += [f"/**/{node_name.strip('/')}:", "  ros__parameters:"]
        lines += [f"    {name}: {_yaml_value(value)}" for name, value in values.items()]
    try:
        Path(path).write_text("\n".join(lines) + "\n", encoding="utf-8")
    except OSError as error:
        raise ParameterError(f"{path}: cannot write parameters: {error.strerror}") from error
