# SPDX-License-Identifier: Apache-2.0
"""Entries of a list that are mappings of YAML, each of a line: read and judged.

What is wrong is a ParameterError of one sentence that begins with `where`.
"""

import difflib
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

import yaml

from heli_parameters.parameters import ParameterError
from heli_parameters.printable import printable
from heli_parameters.rcl_yaml import scalar

NONE = "none"
"""What a parameter of such entries says where there is none: rcl does not take an empty array."""
_MOST = 64
T = TypeVar("T")


def entries(
    texts: Iterable[str],
    name: str,
    keys: Sequence[str],
    read: Callable[[yaml.Node | None, str], T],
) -> tuple[T, ...]:
    """What `read(node, where)` makes of each text, a mapping of `keys`, that is not `NONE`."""
    found: list[T] = []
    for i, text in enumerate(texts):
        if text == NONE:
            continue
        where = f"{name}: entry {i + 1}"
        try:
            node = yaml.compose(text, Loader=yaml.SafeLoader)
        except yaml.YAMLError:
            raise ParameterError(
                f"{where}: {text!r} is not valid YAML; allowed: a mapping of {', '.join(keys)}"
            ) from None
        found.append(read(node, where))
    if len(found) > _MOST:
        raise ParameterError(f"{name}: {len(found)} entries; allowed: at most {_MOST}")
    return tuple(found)


def mapping(node: yaml.Node | None, keys: Sequence[str], where: str) -> dict[str, Any]:
    """Values by key, each key one of `keys`."""
    if not isinstance(node, yaml.MappingNode):
        raise ParameterError(f"{where}: expected a mapping of {', '.join(keys)}")
    said: dict[str, Any] = {}
    for key_node, value_node in node.value:
        key = key_node.value if isinstance(key_node, yaml.ScalarNode) else "?"
        if key not in keys:
            near = difflib.get_close_matches(key, keys, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(keys)}"
            raise ParameterError(f"{where}: {printable(key)}: unknown key; {hint}")
        if key in said:
            raise ParameterError(f"{where}: {key}: the key stands here twice")
        if not isinstance(value_node, yaml.ScalarNode):
            raise ParameterError(f"{where}: {key}: expected one value, no list and no mapping")
        said[key] = scalar(value_node.value, bool(value_node.style))
    return said


def one_of(said: Mapping[str, Any], key: str, allowed: Sequence[str], where: str) -> str:
    """The value of a key that is one of some words."""
    if key not in said:
        raise ParameterError(f"{where}: {key}: missing; allowed: one of {', '.join(allowed)}")
    value = said[key]
    if value in allowed:
        return str(value)
    near = difflib.get_close_matches(str(value), allowed, n=1)
    hint = f": did you mean {near[0]}?" if near else ""
    raise ParameterError(
        f"{where}: {key}: {value} is not allowed{hint}; allowed: one of {', '.join(allowed)}"
    )


def number_of(said: Mapping[str, Any], key: str, most: float, where: str) -> float:
    """The value of a key that is a number from 0 to `most`."""
    value = said.get(key)
    right = isinstance(value, int | float) and not isinstance(value, bool)
    if value is None or not right or not 0.0 <= value <= most:
        shown = "missing" if value is None else f"{value} is not allowed"
        raise ParameterError(f"{where}: {key}: {shown}; allowed: a number in [0, {most:g}]")
    return float(value)
