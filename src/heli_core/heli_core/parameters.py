# SPDX-License-Identifier: Apache-2.0
"""Parameter tables: from one row per parameter, files are checked and ROS parameters declared.

A node package has `parameters.py` with `TABLE: tuple[Parameter, ...]`. The table holds no
values: these stand in the packaged YAML of the node (`config/<node>.yaml`); later files override.
Nothing here imports ROS.
"""

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from heli_core.foreign_files import FileError, compose_yaml
from heli_core.rcl_yaml import (
    Entry,
    ParameterCause,
    ParameterError,
    ParameterFile,
    applicable,
    check_node_names,
    dump_all,
    opened,
    scalar,
    value_of,
)
from heli_core.ticks import LATITUDE_DEG, LONGITUDE_DEG, RATES_HZ

# -------------------------------------------------------------------------------------------------
# Parameters.
# -------------------------------------------------------------------------------------------------

__all__ = [
    "KINDS",
    "Entry",
    "Parameter",
    "ParameterCause",
    "ParameterError",
    "ParameterFile",
    "check_node_names",
    "dump_all",
    "refusal",
    "why_refused",
    "load",
    "opened",
    "stated",
]

KINDS = ("bool", "int", "double", "string", "double[]", "string[]")
_SCALAR_TYPES = {"bool": bool, "int": int, "double": float, "string": str}
_OF_ROS = ("use_sim_time", "start_type_description_service")
_OF_ROS_PREFIX = ("qos_overrides.",)


@dataclass(frozen=True)
class Parameter:
    """One row of a parameter table.

    Attributes
    ----------
    name : str
        Dotted name, such as `wind.speed_mps`.
    kind : str
        One of `KINDS`.
    description : str
        What it means, one sentence.
    unit : str
        Unit, empty for none.
    lower, upper : float or None
        Bounds of a number or of every element of an array, inclusive.
    lower_open, upper_open : bool
        True where the bound itself is not allowed.
    shape : tuple of (int or None), or None
        Shape of an array, stored flat row by row; None as a dimension means any length.
    choices : tuple or None
        Allowed values (of every element of a string array).
    read_only : bool
        True if it cannot be changed while the node runs.
    was : str
        The name that it had before; who still uses that is told the new one.
    """

    name: str
    kind: str
    description: str
    unit: str = ""
    lower: float | None = None
    upper: float | None = None
    shape: tuple[int | None, ...] | None = None
    choices: tuple[Any, ...] | None = None
    read_only: bool = False
    lower_open: bool = False
    upper_open: bool = False
    was: str = ""

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(f"parameter {self.name}: kind {self.kind!r} is not one of {KINDS}")
        if self.shape is not None and not self.kind.endswith("[]"):
            raise ValueError(f"parameter {self.name}: only an array has a shape")
        if self.shape is not None and sum(size is None for size in self.shape) > 1:
            raise ValueError(f"parameter {self.name}: at most one dimension may be open")

    def allowed(self) -> str:
        """What is allowed, in words: kind, length, bounds, choices, unit."""
        if self.choices is not None:
            return "one of " + ", ".join(str(choice) for choice in self.choices)
        text = {"double": "a double", "int": "an integer", "bool": "true or false"}.get(self.kind)
        if text is None:
            element = {"string": "a text", "double[]": "doubles", "string[]": "texts"}[self.kind]
            text = element if self.kind == "string" else f"{self._length()}{element}"
        bounds = self._bounds()
        text = f"{text} in {bounds}" if bounds else text
        return f"{text} {self.unit}".rstrip() if self.unit not in ("", "-", "1") else text

    def _length(self) -> str:
        if self.shape is None:
            return "any number of "
        sizes = ["any number" if size is None else str(size) for size in self.shape]
        if len(sizes) == 1:
            return "any number of " if self.shape[0] is None else f"{sizes[0]} "
        fixed = [size for size in self.shape if size is not None]
        product = math.prod(fixed)
        many = f"{product}" if None not in self.shape else f"a multiple of {product}"
        return f"{many} ({' x '.join(sizes)}, row by row) "

    def _bounds(self) -> str:
        if self.lower is None and self.upper is None:
            return ""
        left = "(" if self.lower_open or self.lower is None else "["
        right = ")" if self.upper_open or self.upper is None else "]"
        low = "-inf" if self.lower is None else f"{self.lower:g}"
        high = "inf" if self.upper is None else f"{self.upper:g}"
        return f"{left}{low}, {high}{right}"

    def check(self, value: Any) -> Any:
        """The value in the form the cores use, if it is allowed.

        Parameters
        ----------
        value : bool, int, float, str, list, tuple, array.array or ndarray
            As rcl or a ROS parameter gives it.

        Returns
        -------
        bool, int, float, str, ndarray of float64 (reshaped to `shape`) or tuple of str

        Raises
        ------
        ParameterError
            With value and what is allowed (the caller adds file and key).
        """
        if self.kind.endswith("[]"):
            return self._check_array(value)
        self._check_type(value, _SCALAR_TYPES[self.kind])
        self._check_element(value)
        return value

    def _refuse(self, value: Any, cause: ParameterCause, reason: str = "") -> ParameterError:
        shown = _plain(repr(value) if isinstance(value, str) else value)
        because = f": {reason}" if reason else ""
        return ParameterError(
            f"{shown} is not allowed{because}", cause, value=value, allowed=self.allowed()
        )

    def _check_type(self, value: Any, expected: type) -> None:
        if type(value) is expected:
            return
        if expected is float and type(value) is int:
            reason = f"it is an integer, write {float(value)!r}"
        else:
            reason = f"it is a {_KIND_NAMES.get(type(value), type(value).__name__)}"
        raise self._refuse(value, ParameterCause.TYPE, reason)

    def _check_element(self, value: Any) -> None:
        if isinstance(value, float) and not math.isfinite(value):
            raise self._refuse(value, ParameterCause.NOT_FINITE, "it is not finite")
        if self.choices is not None and value not in self.choices:
            near = difflib.get_close_matches(str(value), [str(c) for c in self.choices], n=1)
            reason = f"did you mean {near[0]}?" if near else ""
            raise self._refuse(value, ParameterCause.CHOICE, reason)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            low = self.lower is not None and (
                value <= self.lower if self.lower_open else value < self.lower
            )
            high = self.upper is not None and (
                value >= self.upper if self.upper_open else value > self.upper
            )
            if low or high:
                raise self._refuse(value, ParameterCause.BOUNDS, "out of bounds")

    def _check_array(self, value: Any) -> Any:
        if isinstance(value, (bool, int, float, str, bytes)) or not hasattr(value, "__len__"):
            raise self._refuse(value, ParameterCause.TYPE, "it is not an array")
        items = np.asarray(value).ravel().tolist() if isinstance(value, np.ndarray) else list(value)
        element = float if self.kind == "double[]" else str
        for item in items:
            self._check_type(item, element)
            self._check_element(item)
        if self.shape is not None:
            fixed = math.prod(size for size in self.shape if size is not None)
            count = len(items)
            fits = count % max(fixed, 1) == 0 if None in self.shape else count == fixed
            if not fits:
                raise self._refuse(items, ParameterCause.LENGTH, f"it has {count} elements")
        if element is str:
            return tuple(items)
        flat = np.array(items, dtype=np.float64)
        if self.shape is None:
            return flat
        return flat.reshape([-1 if size is None else size for size in self.shape])


_KIND_NAMES = {bool: "boolean", int: "integer", float: "double", str: "text", list: "array"}


def _plain(value: Any) -> str:
    text = str(value.tolist() if isinstance(value, np.ndarray) else value)
    return text if len(text) <= 80 else f"{text[:77]}..."


def suggestion(table: Mapping[str, Parameter], key: str) -> str:
    """Words about a name that a table does not have: what it may have been meant for."""
    return unknown(table, key).problem


def unknown(table: Mapping[str, Parameter], key: str, where: str = "") -> ParameterError:
    """The refusal of a name that a table does not have; it names what may have been meant."""
    renamed = next((row.name for row in table.values() if row.was == key), None)
    if renamed is not None:
        problem = f"is called '{renamed}' now; change the name"
        return ParameterError(
            problem, ParameterCause.RENAMED_KEY, where=where, key=key, meant=renamed
        )
    near = difflib.get_close_matches(key, table, n=1, cutoff=0.5)
    if not near:
        leaf = key.rsplit(".", 1)[-1]
        near = [name for name in table if name.rsplit(".", 1)[-1] == leaf][:1]
    hint = f"did you mean '{near[0]}'?" if near else f"known: {', '.join(sorted(table))}"
    return ParameterError(
        f"unknown parameter; {hint}",
        ParameterCause.UNKNOWN_KEY,
        where=where,
        key=key,
        meant="".join(near),
    )


def _index(table: Iterable[Parameter]) -> dict[str, Parameter]:
    rows: dict[str, Parameter] = {}
    for row in table:
        if row.name in rows:
            raise ValueError(f"parameter table names {row.name} twice")
        rows[row.name] = row
    return rows


def is_of_ros(key: str) -> bool:
    """Whether every ROS node has such a parameter (`use_sim_time`, `qos_overrides`)."""
    return key in _OF_ROS or key.startswith(_OF_ROS_PREFIX)


def _assignments(rules: Sequence[str], node_name: str) -> list[Entry]:
    """Entries of `-p [node:]name:=value` rules that concern the node."""

    assigned = []
    for rule in rules:
        left, separator, text = rule.partition(":=")
        where = f"-p {rule}"
        if not separator:
            raise ParameterError("expected name:=value", ParameterCause.SYNTAX, where=where)
        node, _, key = left.rpartition(":")
        if node and node.strip("/") not in (node_name.strip("/"), node_name.rsplit("/", 1)[-1]):
            continue
        try:
            tree = compose_yaml(text)
        except FileError as error:
            raise ParameterError(
                "value is not valid YAML", ParameterCause.SYNTAX, where=where, key=key
            ) from error
        value = scalar("", True) if tree is None else value_of(tree, where, key)
        assigned.append(Entry("", key, value, where))
    return assigned


def stated(
    table: Iterable[Parameter],
    files: Iterable[str | Path | ParameterFile],
    node_name: str,
    rules: Sequence[str] = (),
    ignore: Iterable[str] = (),
) -> dict[str, Entry]:
    """What files and command line say of a node, checked; what they do not say is left out.

    Parameters
    ----------
    table, files, node_name, rules, ignore
        As for `load`.

    Returns
    -------
    dict
        Per parameter name the strongest assignment; its value is as `Parameter.check` returns it.

    Raises
    ------
    ParameterError
        One line with file and line, key, value and what is allowed.
    """
    rows, passed_over = _index(table), frozenset(ignore)
    from_files = [entry for file in files for entry in applicable(file, node_name)]
    strongest: dict[str, Entry] = {}
    for entry in [*from_files, *_assignments(rules, node_name)]:
        if is_of_ros(entry.key) or entry.key in passed_over:
            continue
        row = rows.get(entry.key)
        if row is None:
            raise unknown(rows, entry.key, entry.where)
        try:
            value = row.check(entry.value)
        except ParameterError as error:
            raise error.placed(entry.where, entry.key) from None
        strongest[entry.key] = Entry(entry.pattern, entry.key, value, entry.where)
    return strongest


def load(
    table: Iterable[Parameter],
    files: Iterable[str | Path | ParameterFile],
    node_name: str,
    rules: Sequence[str] = (),
    ignore: Iterable[str] = (),
) -> dict[str, Any]:
    """Read and check the parameters of a node.

    Parameters
    ----------
    table : iterable of Parameter
        What the node knows.
    files : iterable of path or ParameterFile
        rcl parameter files, or what has been read of them already; a later one overrides an
        earlier one. Within a file the more specific node key wins (`/plant` over `/**/plant` over
        `/**`).
    node_name : str
        `plant`, or fully qualified `/heli1/plant`.
    rules : sequence of str
        Command-line assignments, `name:=value` or `node:name:=value`; the strongest.
    ignore : iterable of str
        Names that belong to somebody else and are passed over without a check.

    Returns
    -------
    dict
        Value per name in the table's order, see `Parameter.check`.

    Raises
    ------
    ParameterError
        One line with file and line, key, value and what is allowed.
    """
    rows, layers = _index(table), [opened(file) for file in files]
    assigned = stated(rows.values(), layers, node_name, rules, ignore)
    for name, row in rows.items():
        if name not in assigned:
            sought = ", ".join(str(layer.path) for layer in layers) or "no file given"
            raise ParameterError(
                f"no value for node '{node_name}'",
                ParameterCause.MISSING,
                where=sought,
                key=name,
                allowed=row.allowed(),
            )
    return {name: assigned[name].value for name in rows}


def refusal(table: Iterable[Parameter], name: str, value: Any) -> ParameterError | None:
    """Why a run-time change is refused; None if it is allowed.

    Parameters
    ----------
    table : iterable of Parameter
        What the node knows.
    name : str
        Parameter to be set.
    value : object
        New value, as a ROS parameter gives it.
    """
    rows = _index(table)
    row = rows.get(name)
    if row is None:
        return None if is_of_ros(name) else unknown(rows, name)
    if row.read_only:
        problem = "is fixed while the node runs; restart the node to change it"
        return ParameterError(problem, ParameterCause.READ_ONLY, key=name, value=value)
    try:
        row.check(value)
    except ParameterError as error:
        return error.placed("", name)
    return None


def why_refused(table: Iterable[Parameter], name: str, value: Any) -> str:
    """`refusal` as one sentence; empty if the change is allowed."""
    refused = refusal(table, name, value)
    return "" if refused is None else str(refused)


# -------------------------------------------------------------------------------------------------
# Parameters that every managed node of the graph has; values in `config/common.yaml`. No ROS.
# -------------------------------------------------------------------------------------------------


def _origin(name: str, description: str, unit: str, lower: float, upper: float) -> Parameter:
    return Parameter(
        f"origin.{name}", "double", description, unit, lower=lower, upper=upper, read_only=True
    )


COMMON_TABLE: tuple[Parameter, ...] = (
    Parameter("autostart", "bool", "Configure and activate itself when started", read_only=True),
    Parameter(
        "lockstep",
        "bool",
        "Act on the set of messages of a tick instead of on arrival",
        read_only=True,
    ),
    Parameter(
        "start_time_s",
        "double",
        "Message stamp of tick 0",
        unit="s",
        lower=1.0,
        upper=1e9,
        read_only=True,
    ),
    Parameter(
        "rate_hz",
        "int",
        "Ticks a second: IMU, observer and inner loop; what is counted in ticks stays of 10 ms",
        unit="Hz",
        choices=RATES_HZ,
        read_only=True,
    ),
    Parameter("peers", "string[]", "Nodes that take part in the flight", read_only=True),
    Parameter("unrecorded", "string[]", "Topics for which no recorder is awaited", read_only=True),
    Parameter(
        "connect_timeout_s",
        "double",
        "Wall time to wait for peers that are not in the graph",
        unit="s",
        lower=0.1,
        upper=3600.0,
        read_only=True,
    ),
    Parameter(
        "peer_timeout_s",
        "double",
        "Wall time that lockstep waits for a silent peer",
        unit="s",
        lower=0.01,
        upper=3600.0,
        read_only=True,
    ),
    Parameter(
        "link_faults",
        "string[]",
        "Messages to this node that are lost, late, exchanged or repeated, a mapping each; or none",
        read_only=True,
    ),
    Parameter(
        "link_seed",
        "int",
        "Seed of what happens on links; of a flight that of the plant",
        lower=0,
        upper=2**63 - 1,
        read_only=True,
    ),
    _origin("latitude_deg", "Latitude of the NED origin", "deg", -LATITUDE_DEG, LATITUDE_DEG),
    _origin("longitude_deg", "Longitude of the NED origin", "deg", -LONGITUDE_DEG, LONGITUDE_DEG),
    _origin("altitude_m", "Altitude of the NED origin", "m", -500.0, 9000.0),
)


def with_common(table: Iterable[Parameter]) -> tuple[Parameter, ...]:
    """A node's table with the common rows in front; the node's own row wins where both have one."""
    of_node = tuple(table)
    names = {row.name for row in of_node}
    return tuple(row for row in COMMON_TABLE if row.name not in names) + of_node
