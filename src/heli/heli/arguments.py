# SPDX-License-Identifier: Apache-2.0
"""What a caller in Python gives and is told: arguments by their names here, not by options."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numpy as np

from heli_core.rcl_yaml import ParameterError

_P = ParamSpec("_P")
_R = TypeVar("_R")
_ARGUMENTS = {
    "attitude-controller": "controller",
    "control-preset": "laws",
    "custom-law": "law",
    "duration": "duration_s",
    "rate": "rate_hz",
    "gamma-factor": "gamma_factor",
    **{name: name for name in ("scenario", "world", "gps", "seed", "params", "faults", "out",
                               "aircraft", "gamma", "seeds")},
}  # fmt: skip
"""Option of the command line to argument."""
_OPTION = re.compile(rf"--({'|'.join(sorted(_ARGUMENTS, key=len, reverse=True))})\b(?![-=])")


def in_python(call: Callable[_P, _R]) -> Callable[_P, _R]:
    """A function whose refusals name its arguments where a command's would name options."""

    @functools.wraps(call)
    def named(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        try:
            return call(*args, **kwargs)
        except ParameterError as error:
            error.problem, error.where = map(_renamed, (error.problem, error.where))
            raise

    return named


def _renamed(text: str) -> str:
    return _OPTION.sub(lambda found: _ARGUMENTS[found[1]], text)


def whole(name: str, value: Any) -> int | None:
    """An argument that is a whole number from 0, or None.

    Raises
    ------
    ParameterError
        It is neither.
    """
    if value is None:
        return None
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if isinstance(value, float) and value.is_integer():
        is_whole = True
    if not is_whole or value < 0:
        raise ParameterError(f"{name} {value!r}: not allowed; allowed: a whole number from 0")
    return int(value)


def number(name: str, value: Any) -> float | None:
    """An argument that is a finite number, or None.

    Raises
    ------
    ParameterError
        It is neither.
    """
    if value is None:
        return None
    is_number = isinstance(value, int | float | np.integer | np.floating)
    if not is_number or isinstance(value, bool) or not math.isfinite(value):
        raise ParameterError(f"{name} {value!r}: not allowed; allowed: a finite number")
    return float(value)
