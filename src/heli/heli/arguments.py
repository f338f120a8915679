# SPDX-License-Identifier: Apache-2.0
"""What a caller in Python gives and is told: arguments by their names here, not by options.

An argument's name decides what is allowed for it, in every public function alike.
"""

from __future__ import annotations

import functools
import inspect
import math
import os
import re
from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple, ParamSpec, TypeVar

import numpy as np

from heli_core.errors import ParameterError, ParameterRefusal
from heli_dynamics_sim.aircraft import AircraftError

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
_TWICE = re.compile(r"^(\w+): \1: ")
MOST_SEED = 2**31 - 1
MOST_SPEED_MPS = 200.0
"""Beyond every helicopter: a trim is sought for in steps of the wind, which would not end."""

# -------------------------------------------------------------------------------------------------
# What is allowed, by the argument's name.
# -------------------------------------------------------------------------------------------------


class ArgumentKind(NamedTuple):
    """What an argument may be.

    Attributes
    ----------
    allowed : str
        In words.
    taken : callable
        Gives the value as it is used; TypeError, ValueError or OverflowError for another.
    """

    allowed: str
    taken: Callable[[Any], Any]


def _whole_number(value: Any) -> int:
    is_whole = isinstance(value, int | np.integer) and not isinstance(value, bool)
    if not is_whole and not (isinstance(value, float) and value.is_integer()):
        raise ValueError
    return int(value)


def _finite(value: Any) -> float:
    is_number = isinstance(value, int | float | np.integer | np.floating)
    if not is_number or isinstance(value, bool) or not math.isfinite(value):
        raise ValueError
    return float(value)


def whole_from(least: int, most: int | None = None) -> ArgumentKind:
    """A whole number within bounds, both allowed."""

    def taken(value: Any) -> int:
        given = _whole_number(value)
        if given < least or (most is not None and given > most):
            raise ValueError
        return given

    end = "" if most is None else f" to {most}"
    return ArgumentKind(f"a whole number from {least}{end}", taken)


def _above(least: float) -> ArgumentKind:
    def taken(value: Any) -> float:
        given = _finite(value)
        if given <= least:
            raise ValueError
        return given

    return ArgumentKind(f"a finite number above {least:g}", taken)


def _speed(value: Any) -> float:
    given = _finite(value)
    if abs(given) > MOST_SPEED_MPS:
        raise ValueError
    return given


def _wind(values: Any) -> np.ndarray:
    wind = np.array(values, dtype=np.float64)
    if wind.shape != (3,) or not np.isfinite(wind).all() or np.abs(wind).max() > MOST_SPEED_MPS:
        raise ValueError
    return wind


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError
    return value


def _text_or_path(value: Any) -> Any:
    if not isinstance(value, str | os.PathLike):
        raise TypeError
    return value


def _file_there(value: Any) -> Any:
    if not os.path.isfile(_text_or_path(value)):
        raise ValueError
    return value


def _yes_or_no(value: Any) -> bool:
    if not isinstance(value, bool | np.bool_):
        raise TypeError
    return bool(value)


def _objects(values: Any) -> tuple[Any, ...]:
    if isinstance(values, str):
        raise TypeError
    return tuple(values)


_NAME, _SWITCH = ArgumentKind("text", _text), ArgumentKind("True or False", _yes_or_no)
_FILE, _TARGET = (
    ArgumentKind("text, or the path of a file", _text_or_path),
    ArgumentKind("a path", _text_or_path),
)
_NUMBER = ArgumentKind("a finite number", _finite)
SEED = whole_from(0, MOST_SEED)
KINDS: dict[str, ArgumentKind] = {
    "seed": SEED, "flight": whole_from(1), "workers": whole_from(0), "port": whole_from(0, 65535),
    "num_envs": whole_from(1, 10**6), "max_episode_steps": whole_from(1),
    "duration_s": _NUMBER, "psi_rad": _NUMBER, "climb_mps": _NUMBER,
    "speed_mps": ArgumentKind(f"a number from {-MOST_SPEED_MPS:g} to {MOST_SPEED_MPS:g}", _speed),
    "wind_ned_mps": ArgumentKind(
        f"3 numbers from {-MOST_SPEED_MPS:g} to {MOST_SPEED_MPS:g}", _wind
    ),
    "gamma": _above(0.0), "gamma_factor": _above(1.0), "thrust_n": _above(0.0),
    "scenario": _NAME, "gps": _NAME, "controller": _NAME,
    "world": _FILE, "laws": _FILE, "aircraft": _FILE,
    "spec": ArgumentKind("a file that is there", _file_there),
    "path": _TARGET, "folder": _TARGET, "out": _TARGET,
    "graph": _SWITCH, "quiet": _SWITCH, "figures": _SWITCH,
    "sensors": ArgumentKind("a list of objects", _objects),
}  # fmt: skip
"""Arguments that are not here are judged where they are used."""


def refused(name: str, value: Any, allowed: str) -> ParameterError:
    """The refusal of an argument."""
    return ParameterError.of_argument(name, value, allowed)


def taken(name: str, value: Any, kind: ArgumentKind) -> Any:
    """A value as it is used.

    Raises
    ------
    ParameterError
        It is not of the kind.
    """
    try:
        return kind.taken(value)
    except (TypeError, ValueError, OverflowError):
        raise refused(name, value, kind.allowed) from None


def whole(name: str, value: Any) -> int | None:
    """An argument that is a seed, a whole number from 0 to 2147483647, or None.

    Raises
    ------
    ParameterError
        It is neither.
    """
    return None if value is None else int(taken(name, value, SEED))


def number(name: str, value: Any) -> float | None:
    """An argument that is a finite number, or None.

    Raises
    ------
    ParameterError
        It is neither.
    """
    return None if value is None else float(taken(name, value, _NUMBER))


# -------------------------------------------------------------------------------------------------
# A function that is called from Python.
# -------------------------------------------------------------------------------------------------


def in_python(call: Callable[_P, _R]) -> Callable[_P, _R]:
    """A function whose arguments are judged as `KINDS` says, and whose refusals name them.

    None is allowed where it is the default. A refusal that comes from deeper names the argument
    where a command's would name the option, and has it in `argument`.
    """
    signature = inspect.signature(call)

    @functools.wraps(call)
    def named(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        bound = signature.bind(*args, **kwargs)
        for holder, name, default in list(_places(bound)):
            if name in KINDS and not (holder[name] is None and default is None):
                holder[name] = taken(name, holder[name], KINDS[name])
        given = {name: holder[name] for holder, name, _ in _places(bound)}
        try:
            return call(*bound.args, **bound.kwargs)
        except ParameterRefusal as error:
            _in_its_words(error, given, signature.parameters)
            raise

    return named


def _places(bound: inspect.BoundArguments) -> Iterator[tuple[dict[str, Any], str, Any]]:
    """Of each argument that is given: what holds it, its name, and its default."""
    for name, parameter in bound.signature.parameters.items():
        if name not in bound.arguments:
            continue
        if parameter.kind is parameter.VAR_KEYWORD:
            held: dict[str, Any] = bound.arguments[name]
            yield from ((held, option, None) for option in held)
        elif parameter.kind is not parameter.VAR_POSITIONAL:
            yield bound.arguments, name, parameter.default


def _in_its_words(
    error: ParameterRefusal, given: dict[str, Any], parameters: Iterable[str]
) -> None:
    """Let a refusal name the argument that it is of."""
    error.problem, error.where = (
        _TWICE.sub(r"\1: ", _OPTION.sub(lambda found: _ARGUMENTS[found[1]], text))
        for text in (error.problem, error.where)
    )
    if isinstance(error, AircraftError) and given.get("aircraft") is not None:
        error.argument = "aircraft"
    word = re.match(r"\w*", str(error))
    if not error.argument and word is not None and word[0] in {*given, *parameters}:
        error.argument = word[0]
    if error.argument in given and error.value is None:
        error.value = given[error.argument]
