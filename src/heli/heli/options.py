# SPDX-License-Identifier: Apache-2.0
"""What a caller says of parameters, in the form in which the stack reads them."""

import difflib
import json
import os
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from heli_dynamics_sim.config_error import PlantConfigError
from heli_dynamics_sim.fault_table import NONE, faults_of
from heli_flight.loop.fault_file import fault_overrides
from heli_flight.loop.layers import TABLES
from heli_parameters.parameters import Parameter, ParameterError, suggestion

Over = dict[str, dict[str, Any]]


def split(params: Any) -> tuple[list[Path], Over]:
    """Files and changes of an argument `params`.

    Parameters
    ----------
    params : None, path, mapping, object with `parameters`, or a sequence of these
        A mapping says per node (plant, observer, inner_loop, outer_loop, scenario, world) which
        parameters have which values: by dotted name, or nested. Files are weaker than mappings, and
        later ones are stronger.

    Raises
    ------
    ParameterError
        Names node, parameter, value and what is allowed.
    """
    files: list[Path] = []
    over: Over = {}
    for part in _parts(params):
        if isinstance(part, (str, os.PathLike)):
            files.append(Path(part))
            continue
        for node, values in _mapping(part).items():
            over.setdefault(node, {}).update(_of_node(node, values))
    return files, over


def _parts(params: Any) -> list[Any]:
    if params is None:
        return []
    return list(params) if isinstance(params, (list, tuple)) else [params]


def _mapping(part: Any) -> Mapping[str, Any]:
    """A mapping of nodes; of a design that which it decides."""
    found = getattr(part, "parameters", part)
    if isinstance(found, Mapping):
        return found
    raise ParameterError(
        f"params: {type(part).__name__} is not allowed; allowed: a file, "
        "{node: {parameter: value}}, a design, or a list of these"
    )


def _of_node(node: str, values: Any) -> dict[str, Any]:
    if node not in TABLES:
        near = difflib.get_close_matches(str(node), TABLES, n=1)
        hint = f"did you mean {near[0]!r}?" if near else f"known: {', '.join(TABLES)}"
        raise ParameterError(f"params: {node!r} is no node; {hint}")
    if not isinstance(values, Mapping):
        raise ParameterError(
            f"params: {node}: {values!r} is not allowed; allowed: {{parameter: value}}"
        )
    rows = {row.name: row for row in TABLES[node]}
    found = {}
    for name, value in _flat(values):
        if name not in rows:
            raise ParameterError(f"params: {node}: {name}: {suggestion(rows, name)}")
        try:
            found[name] = rows[name].check(_as_kind(rows[name], value))
        except ParameterError as error:
            raise ParameterError(f"params: {node}: {name}: {error}") from None
    return found


def _flat(values: Mapping[str, Any], before: str = "") -> Iterable[tuple[str, Any]]:
    for name, value in values.items():
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{name}.")
        else:
            yield f"{before}{name}", value


def _as_kind(row: Parameter, value: Any) -> Any:
    """A number as Python and numpy write it, where a parameter file would want 1.0."""
    if isinstance(value, np.generic):
        value = value.item()
    whole = isinstance(value, int) and not isinstance(value, bool)
    if row.kind == "double" and whole:
        return float(value)
    if row.kind == "double[]" and isinstance(value, (list, tuple, np.ndarray)):
        try:
            return np.asarray(value, dtype=np.float64).ravel()
        except (TypeError, ValueError):
            return value
    return value


def faults_over(faults: Any) -> Over:
    """What faults set, by node: of a file, or of mappings as its entries are (of the plant alone).

    Raises
    ------
    ParameterError
        One sentence.
    """
    if faults is None:
        return {}
    if isinstance(faults, (str, os.PathLike)):
        return fault_overrides(Path(faults)) or {}
    try:
        # JSON is YAML: a mapping is judged as an entry of a file.
        told = tuple(fault.text for fault in faults_of([json.dumps(dict(f)) for f in faults]))
    except PlantConfigError as error:
        raise ParameterError(str(error)) from None
    except (TypeError, ValueError):
        raise ParameterError(
            f"faults: {faults!r} is not allowed; allowed: a file, or a list of mappings"
        ) from None
    return {"plant": {"faults": told or (NONE,)}}


def merged(*parts: Over) -> Over:
    """Changes one over the other, the later stronger."""
    found: Over = {}
    for part in parts:
        for node, values in part.items():
            found.setdefault(node, {}).update(values)
    return found
