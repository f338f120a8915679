# SPDX-License-Identifier: Apache-2.0
"""Reads ROS 2 parameter files the way rcl reads them, without ROS.

rcl's scalars follow YAML 1.1 and the C library: `y` is a
boolean, `1` an integer, `1e5` a double (a plain YAML 1.1 reader takes it for a string), `0x10` an
integer. Aliases and mixed arrays are refused, as rcl does. Source: ros2/rcl, rcl_yaml_param_parser
(parse.c, `get_value` and `parse_value`).
"""

import math
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from heli_core.errors import ParameterCause as ParameterCause
from heli_core.errors import ParameterError as ParameterError
from heli_core.folders import write_whole
from heli_core.foreign_files import FileCause, FileError, compose_yaml, read_text

# -------------------------------------------------------------------------------------------------
# A text out of a file or a message, fit for a sentence.
# -------------------------------------------------------------------------------------------------

LONGEST = 200
"""Characters: what is damaged or hostile may hold a text of any length."""


def printable(text: str, longest: int = LONGEST) -> str:
    """The beginning of a text, without what would end the line or steer a terminal."""
    if len(text) <= longest and text.isprintable():
        return text
    short = text if len(text) <= longest else f"{text[:longest]}..."
    return "".join(c if c.isprintable() else repr(c).strip("'") for c in short)


# -------------------------------------------------------------------------------------------------
# Rcl yaml.
# -------------------------------------------------------------------------------------------------

_TRUE = frozenset("Y y yes Yes YES true True TRUE on On ON".split())
_FALSE = frozenset("N n no No NO false False FALSE off Off OFF".split())
_NAN = frozenset((".nan", ".NaN", ".NAN"))
_INF = frozenset((".inf", ".Inf", ".INF", "+.inf", "+.Inf", "+.INF"))
_MINUS_INF = frozenset(("-.inf", "-.Inf", "-.INF"))
_INT = re.compile(r"[-+]?(0[xX][0-9a-fA-F]+|0[0-7]*|[1-9][0-9]*)\Z")
_FLOAT = re.compile(r"[-+]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][-+]?[0-9]+)?\Z")
_SECTION = "ros__parameters"
# More are no double either.
_MOST_DIGITS, _BEYOND_INT64 = 200, 2**63


@dataclass(frozen=True)
class Entry:
    """One parameter assignment of a file.

    Attributes
    ----------
    pattern : str
        Node pattern it stands under, with a leading slash (`/**/plant`).
    key : str
        Dotted parameter name.
    value : bool, int, float, str or list of one of them
        As rcl would read it.
    where : str
        `file:line`, for messages.
    """

    pattern: str
    key: str
    value: Any
    where: str


def scalar(text: str, quoted: bool) -> bool | int | float | str:
    """Value of one YAML scalar with rcl's rules.

    Parameters
    ----------
    text : str
        The scalar's text.
    quoted : bool
        True for quoted or block scalars, which are always strings.
    """
    if quoted:
        return text
    if text in _TRUE:
        return True
    if text in _FALSE:
        return False
    if _INT.match(text):
        return _whole(text)
    if _FLOAT.match(text):
        return float(text)
    if text in _NAN:
        return float("nan")
    if text in _INF or text in _MINUS_INF:
        return float("-inf") if text in _MINUS_INF else float("inf")
    return text


def _whole(text: str) -> int | float:
    """An integer's text; beyond 64 bits it is a double, as for the C library."""
    digits = text.lstrip("+-")
    base = 16 if digits[:2].lower() == "0x" else 8 if len(digits) > 1 and digits[0] == "0" else 10
    number: int | float = math.inf if len(digits) > _MOST_DIGITS else int(digits, base)
    number = number if number < _BEYOND_INT64 else float(number)
    return -number if text.startswith("-") else number


def value_of(node: yaml.Node, where: str, key: str) -> Any:
    """Scalar or homogeneous array of a YAML node; `ParameterError` for anything else."""
    if isinstance(node, yaml.ScalarNode):
        if node.value == "" and not node.style:
            raise ParameterError("no value given", ParameterCause.MISSING, where=where, key=key)
        return scalar(node.value, bool(node.style))
    if not isinstance(node, yaml.SequenceNode):
        raise ParameterError(
            "expected a value or an array", ParameterCause.TYPE, where=where, key=key
        )
    items: list[Any] = []
    for item in node.value:
        if not isinstance(item, yaml.ScalarNode):
            raise ParameterError(
                "arrays must be flat; write a matrix row by row in one array",
                ParameterCause.TYPE,
                where=where,
                key=key,
            )
        items.append(scalar(item.value, bool(item.style)))
    kinds = {type(item) for item in items}
    if kinds == {int, float}:
        whole = next(item for item in items if type(item) is int)
        raise ParameterError(
            f"mixes integers and doubles; write {float(whole)!r} instead of {whole}",
            ParameterCause.TYPE,
            where=where,
            key=key,
            value=items,
        )
    if len(kinds) > 1:
        names = ", ".join(sorted(kind.__name__ for kind in kinds))
        raise ParameterError(
            f"one array holds different types ({names})",
            ParameterCause.TYPE,
            where=where,
            key=key,
            value=items,
        )
    return items


_FILE_CAUSES = (
    FileCause.UNREADABLE, FileCause.NOT_REGULAR, FileCause.TOO_LARGE, FileCause.SPARSE,
    FileCause.NOT_TEXT, FileCause.BUDGET,
)  # fmt: skip


def file_refusal(error: FileError, path: object, what: str = "parameter file") -> ParameterError:
    """The refusal of a file, or of its YAML, as one of parameters."""
    cause = ParameterCause.UNREADABLE if error.cause in _FILE_CAUSES else ParameterCause.SYNTAX
    unread = cause == ParameterCause.UNREADABLE
    problem = f"cannot read {what}: {error.problem}" if unread else error.problem
    return ParameterError(problem, cause, where=f"{path}:{error.line}" if error.line else str(path))


def _text(path: Path) -> str:
    if not path.exists():
        raise ParameterError(
            "parameter file does not exist", ParameterCause.UNREADABLE, where=str(path)
        )
    try:
        return read_text(path)
    except FileError as error:
        raise file_refusal(error, path) from error


def _malformed(problem: str, where: str, key: str = "") -> ParameterError:
    return ParameterError(problem, ParameterCause.SYNTAX, where=where, key=key)


def _root(path: Path, text: str) -> yaml.MappingNode:
    try:
        root = compose_yaml(text, path)
    except FileError as error:
        raise file_refusal(error, path) from error
    if not isinstance(root, yaml.MappingNode):
        raise _malformed(f"not a ROS parameter file: expected 'node: {_SECTION}: ...'", str(path))
    return root


def _pairs(node: yaml.MappingNode, path: Path) -> Iterator[tuple[str, yaml.Node, str]]:
    """(printable key, value node, place) of a mapping; a repeated key is an error."""
    earlier: set[str] = set()
    for key_node, value_node in node.value:
        where = f"{path}:{key_node.start_mark.line + 1}"
        if not isinstance(key_node, yaml.ScalarNode):
            raise _malformed("a key must be a word", where)
        key = printable(key_node.value)
        if key in earlier:
            raise ParameterError(
                "the key stands here twice", ParameterCause.TWICE, where=where, key=key
            )
        earlier.add(key)
        yield key, value_node, where


def _parameters(node: yaml.Node, path: Path, pattern: str, prefix: str) -> Iterator[Entry]:
    if not isinstance(node, yaml.MappingNode):
        line = node.start_mark.line + 1
        raise _malformed(f"{_SECTION}: expected 'key: value'", f"{path}:{line}")
    for key, value_node, where in _pairs(node, path):
        name = f"{prefix}{key}"
        if isinstance(value_node, yaml.MappingNode):
            yield from _parameters(value_node, path, pattern, f"{name}.")
        else:
            yield Entry(pattern, name, value_of(value_node, where, name), where)


def _sections(
    node: yaml.MappingNode, path: Path, pattern: str
) -> Iterator[tuple[str, yaml.Node, str]]:
    for key, value_node, where in _pairs(node, path):
        if key == _SECTION:
            if not pattern:
                raise _malformed(f"{_SECTION} must stand below a node name", where)
            yield pattern, value_node, where
        elif isinstance(value_node, yaml.MappingNode):
            yield from _sections(value_node, path, f"{pattern}/{key.strip('/')}")
        else:
            raise _malformed(
                f"stands outside of '{_SECTION}'; expected 'node: {_SECTION}: {key}: ...'",
                where,
                key,
            )


def _once(entries: Iterable[Entry]) -> Iterator[Entry]:
    """Refuse a name that a section says twice: nested, and with dots."""
    before: dict[str, str] = {}
    for entry in entries:
        if entry.key in before:
            raise ParameterError(
                f"stands here twice, nested and with dots, at {before[entry.key]}, too",
                ParameterCause.TWICE,
                where=entry.where,
                key=entry.key,
            )
        before[entry.key] = entry.where
        yield entry


@dataclass(frozen=True)
class ParameterFile:
    """What a parameter file says, read once.

    Attributes
    ----------
    path : Path
    sections : tuple of (pattern, where)
        Node patterns with a leading slash, and their places, `file:line`.
    entries : tuple of Entry
        All assignments in the file's order.
    """

    path: Path
    sections: tuple[tuple[str, str], ...]
    entries: tuple[Entry, ...]


def read(path: str | Path) -> ParameterFile:
    """Read a parameter file.

    Raises
    ------
    ParameterError
        File missing, unreadable, malformed, or with a construct that rcl refuses.
    """
    path = Path(path)
    return _content(path, _text(path))


@lru_cache(maxsize=64)
def _content(path: Path, text: str) -> ParameterFile:
    """What a text says; who resolves a flight again and again has most files in hand already."""
    sections: list[tuple[str, str]] = []
    entries: list[Entry] = []
    for pattern, node, where in _sections(_root(path, text), path, ""):
        sections.append((pattern, where))
        entries.extend(_once(_parameters(node, path, pattern, "")))
    return ParameterFile(path, tuple(sections), tuple(entries))


def opened(file: str | Path | ParameterFile) -> ParameterFile:
    """The file's content: what has been read already, or now."""
    return file if isinstance(file, ParameterFile) else read(file)


def matches(pattern: str, node_name: str) -> bool:
    """True if a file's node pattern means this node (`/*`: one name, `/**`: any number of them).

    Parameters
    ----------
    pattern : str
        `/**`, `/**/plant`, `/plant`, `plant`, `/heli1/plant`.
    node_name : str
        `plant` or fully qualified `/heli1/plant`.
    """
    expression = ""
    for part in pattern.strip("/").split("/"):
        expression += {"**": r"(/\w+)*", "*": r"/\w+"}.get(part, "/" + re.escape(part))
    return re.fullmatch(expression, "/" + node_name.strip("/")) is not None


def specificity(pattern: str) -> tuple[int, int]:
    """Sorting key of a pattern: the more names and the fewer wildcards, the stronger."""
    parts = pattern.strip("/").split("/")
    wild = sum(part in ("*", "**") for part in parts)
    return len(parts) - wild, -wild


def applicable(file: str | Path | ParameterFile, node_name: str) -> list[Entry]:
    """Assignments of a file that concern a node; the last one of a key is the strongest."""
    content = opened(file)
    mean = {pattern for pattern, _ in content.sections if matches(pattern, node_name)}
    mine = [entry for entry in content.entries if entry.pattern in mean]
    return sorted(mine, key=lambda entry: specificity(entry.pattern))


def check_node_names(
    files: Iterable[str | Path | ParameterFile], known_nodes: Iterable[str]
) -> None:
    """Refuse a parameter file that names a node which does not exist in the graph.

    rcl ignores such a section silently: a misspelt node name would leave every default in place.

    Parameters
    ----------
    files : iterable of path or ParameterFile
    known_nodes : iterable of str
        Names of the graph's nodes, without namespace.

    Raises
    ------
    ParameterError
        Naming file, line, the unknown node and the known ones.
    """
    import difflib

    known = sorted(known_nodes)
    for file in files:
        for pattern, where in opened(file).sections:
            name = pattern.rsplit("/", 1)[-1]
            if name in known or name in ("*", "**"):
                continue
            near = difflib.get_close_matches(name, known, n=1)
            hint = f"did you mean '{near[0]}'? " if near else ""
            raise ParameterError(
                f"{pattern}: unknown node '{name}'; {hint}allowed: {', '.join(known)}",
                ParameterCause.UNKNOWN_NODE,
                where=where,
                value=name,
                meant="".join(near),
            )


# -------------------------------------------------------------------------------------------------
# Writes ROS 2 parameter files that rcl, and the reader here, read back bit for bit.
# -------------------------------------------------------------------------------------------------


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
        write_whole(Path(path), "\n".join(lines) + "\n")
    except OSError as error:
        raise ParameterError(
            f"cannot write parameters: {error.strerror}",
            ParameterCause.UNREADABLE,
            where=str(path),
        ) from error
