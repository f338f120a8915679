# SPDX-License-Identifier: Apache-2.0
"""Rows of the plant's parameter table, built by kind."""

from typing import Any

from heli_parameters.parameters import Parameter


def row(name: str, kind: str, description: str, unit: str = "", **rest: Any) -> Parameter:
    """Row that is read when the plant is configured; only gusts and faults may come in flight."""
    fixed = not name.startswith("wind.gust.") and name != "faults"
    return Parameter(name, kind, description, unit, read_only=fixed, **rest)


def ticks(name: str, description: str, lower: int, upper: int) -> Parameter:
    """Row of a number of ticks."""
    return row(name, "int", description, "ticks", lower=lower, upper=upper)


def real(
    name: str,
    description: str,
    unit: str,
    lower: float,
    upper: float,
    shape: tuple[int | None, ...] | None = None,
    **rest: Any,
) -> Parameter:
    """Row of a real number, or of an array of them if it has a shape."""
    kind = "double" if shape is None else "double[]"
    return row(name, kind, description, unit, lower=lower, upper=upper, shape=shape, **rest)
