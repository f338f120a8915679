# SPDX-License-Identifier: Apache-2.0
"""The map of a log's columns: a YAML file that says which is which, its unit, frame and sign."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from heli_core.foreign_files import read_yaml
from heli_core.rcl_yaml import printable
from heli_studies.logs.signals import SIGNALS, LogCause, LogError, SignalSource

UNITS: dict[str, dict[str, float]] = {
    "rad/s": {"rad/s": 1.0, "deg/s": np.pi / 180.0, "rpm": np.pi / 30.0},
    "rad": {"rad": 1.0, "deg": np.pi / 180.0},
    "m/s2": {"m/s2": 1.0, "g": 9.80665, "ft/s2": 0.3048},
    "m/s": {"m/s": 1.0, "km/h": 1.0 / 3.6, "kn": 1852.0 / 3600.0, "ft/s": 0.3048},
    "1": {"1": 1.0, "%": 0.01},
    "us": {"us": 1.0},
    "s": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
}
"""Units that a column may have, by that of its signal."""
_FLU = {"q", "r", "ay", "az", "v", "w", "theta", "q_ref", "r_ref"}
BODY = {"frd": frozenset[str](), "flu": frozenset(_FLU)}
"""Body axes to the signals whose sign turns: front right down, or REP-103's front left up."""
_KEYS = ("time", "body", "signals")
_SIGNAL_KEYS = ("topic", "column", "unit", "sign", "scale")


class Clock(NamedTuple):
    """Where the time stands: factor to s; without a column, s from row to row, 0: not said."""

    column: str
    factor: float


class LogMap(NamedTuple):
    """What a map says."""

    time: Clock
    sources: tuple[SignalSource, ...]


def read_map(path: Path) -> LogMap:
    """Read a map.

    Parameters
    ----------
    path : Path
        YAML: `time: {column, unit}` or `time: {rate_hz}`; `body: frd` (default) or `flu`;
        `signals:` by name of `SIGNALS`, each `{column, unit, sign, scale, topic}`; unit by default
        the signal's own, sign 1 or -1, scale a further factor, topic for bags alone.

    Raises
    ------
    LogError, FileError
    """
    content = read_yaml(path)
    _mapping(content, _KEYS, str(path))
    signals = content.get("signals")
    if not isinstance(signals, dict) or not signals:
        raise _bad(path, "signals: a mapping of names to columns is needed")
    body = content.get("body", "frd")
    if body not in BODY:
        raise _bad(path, f"body: {printable(str(body))} is not allowed; allowed: frd, flu")
    sources = []
    for name, said in signals.items():
        if name not in SIGNALS:
            known = ", ".join(SIGNALS)
            raise _bad(path, f"signals: {printable(str(name))} is no signal; known: {known}")
        where = f"{path}: signals: {name}"
        _mapping(said, _SIGNAL_KEYS, where)
        factor = _unit(said.get("unit", SIGNALS[name].unit), SIGNALS[name].unit, where)
        sign = said.get("sign", 1)
        if sign not in (1, -1):
            raise _bad(where, f"sign: {printable(str(sign))} is not allowed; allowed: 1, -1")
        turned = -1.0 if name in BODY[body] else 1.0
        scale = _number(said.get("scale", 1.0), f"{where}: scale")
        column = _text(said, "column", where)
        sources.append(
            SignalSource(
                name,
                _text(said, "topic", where, "").lstrip("/"),
                column,
                factor * sign * turned * scale,
            )
        )
    return LogMap(_clock(content.get("time", {}), path), tuple(sources))


def _clock(said: Any, path: Path) -> Clock:
    where = f"{path}: time"
    _mapping(said, ("column", "unit", "rate_hz"), where)
    if "rate_hz" in said:
        rate = _number(said["rate_hz"], f"{where}: rate_hz")
        if rate <= 0.0 or "column" in said:
            raise _bad(where, "give a column, or a rate_hz above 0")
        return Clock("", 1.0 / rate)
    if "column" not in said:
        return Clock("", 0.0)
    return Clock(_text(said, "column", where), _unit(said.get("unit", "s"), "s", where))


def _bad(where: object, problem: str) -> LogError:
    return LogError(LogCause.BAD_MAP, f"{where}: {problem}")


def _mapping(content: Any, keys: tuple[str, ...], where: str) -> None:
    if not isinstance(content, dict):
        raise _bad(where, f"a mapping of {', '.join(keys)} is needed")
    for key in content:
        if key not in keys:
            raise _bad(where, f"unknown key {printable(str(key))}; known: {', '.join(keys)}")


def _text(said: dict[str, Any], key: str, where: str, default: str | None = None) -> str:
    value = said.get(key, default)
    if not isinstance(value, (str, int)) or isinstance(value, bool):
        raise _bad(where, f"{key}: a name is needed")
    return str(value)


def _number(value: Any, where: str) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not np.isfinite(value):
        raise _bad(where, f"{printable(str(value))} is no number")
    return float(value)


def _unit(unit: Any, of: str, where: str) -> float:
    if unit not in UNITS[of]:
        allowed = ", ".join(UNITS[of])
        raise _bad(where, f"unit: {printable(str(unit))} is not allowed; allowed: {allowed}")
    return UNITS[of][unit]
