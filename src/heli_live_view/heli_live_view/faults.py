# SPDX-License-Identifier: Apache-2.0
"""Faults that a browser may send: what the page offers, a command made a text. No ROS.

The plant judges a fault; here is only what keeps its text a mapping of words and numbers, and gusts
within the limits of commands. A test holds `WHAT` against the plant's own table.
"""

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

from heli_live_view.plan import CommandError, Limits

Form = dict[str, Any]
NONE = "none"
"""As the plant's parameter says that there is no fault."""
_LONGEST_S = 86400.0
_MOST_NUMBERS = 6
_WORD = re.compile(r"[a-z][a-z0-9_]{0,30}")


def _kind(example: Iterable[float] = (), unit: str = "", optional: bool = False) -> Form:
    """Numbers that a kind needs: an example of them, what they are, may they be left out."""
    return {"example": list(example), "unit": unit, "optional": optional}


def _of_sensor(axes: int, unit: str, bias: float, names: str = "") -> dict[str, Form]:
    first = [bias] + [0.0] * (axes - 1)
    said = f"{unit}{', ' + names if names else ''}"
    return {
        "loss": _kind([1.0], "share that is lost", True),
        "freeze": _kind(), "zero": _kind(), "nan": _kind(),
        "bias": _kind(first, said), "drift": _kind(first, f"{said}, per second"),
        "jump": _kind(first, f"{said}, with a sign that each sample draws anew"),
        "noise": _kind([5.0], "times the noise"), "delay": _kind([0.2], "s"),
        "duplicate": _kind(), "reorder": _kind(),
    }  # fmt: skip


_NED, _BODY = "north, east, down", "forward, right, down"
_ACTUATOR = {
    "stuck": _kind([0.0], "command; none: the last one", True),
    "offset": _kind([0.1], "added to the command"),
    "slow": _kind([0.5], "largest change per second"),
    "dead_zone": _kind([0.05], "smaller changes do nothing"),
    "runaway": _kind([0.1], "per second, to the end stop"),
}
_WIND = "wind"
WHAT: dict[str, dict[str, Form]] = {
    "gps": _of_sensor(3, "m", 2.0, _NED),
    "gps_velocity": _of_sensor(3, "m/s", 1.0, _NED),
    "imu": _of_sensor(6, "m/s² and rad/s", 0.5, _BODY),
    "accel": _of_sensor(3, "m/s²", 0.5, _BODY),
    "gyro": _of_sensor(3, "rad/s", 0.05, _BODY),
    "mag": _of_sensor(3, "T", 1e-5, _BODY),
    "baro": _of_sensor(1, "Pa", 50.0),
    "rotor_speed": _of_sensor(1, "rad/s", -20.0),
    "imu2": _of_sensor(6, "m/s² and rad/s", 0.5, _BODY),
    "accel2": _of_sensor(3, "m/s²", 0.5, _BODY),
    "gyro2": _of_sensor(3, "rad/s", 0.05, _BODY),
    "delta_lat": _ACTUATOR,
    "delta_lon": _ACTUATOR,
    "delta_ped": _ACTUATOR,
    "delta_col": _ACTUATOR,
    _WIND: {"gust": _kind([3.0, 0.0, 0.0], f"m/s, {_NED}")},
    "engine": {"stop": _kind()},
}
"""What may fail and how."""


def _finite(value: Any, name: str, least: float, most: float) -> float:
    known = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not known or not least <= value <= most:
        raise CommandError(f"{name}: {value!r} is not allowed; allowed: {least:g} to {most:g}")
    return float(value)


def judge_fault(args: Mapping[str, Any], limits: Limits) -> str:
    """The plant's text of the fault that a browser asks for, beginning when the plant hears of it.

    Parameters
    ----------
    args : mapping
        what, kind; value: a list of numbers, may be absent; duration_s: absent, to the end.
    limits : Limits

    Raises
    ------
    CommandError
    """
    what, kind = args.get("what"), args.get("kind")
    for name, word in (("what", what), ("kind", kind)):
        if not isinstance(word, str) or not _WORD.fullmatch(word):
            raise CommandError(f"{name}: {word!r} is not allowed; allowed: a word of the table")
    given = args.get("value") or []
    if not isinstance(given, list) or len(given) > _MOST_NUMBERS:
        raise CommandError(f"value: allowed: a list of at most {_MOST_NUMBERS} numbers")
    values = [_finite(v, "value", -1e6, 1e6) for v in given]
    parts = [f"what: {what}", f"kind: {kind}"]
    longest_s = _LONGEST_S
    if what == _WIND:
        longest_s = limits.gust_s
        if math.hypot(*values) > limits.gust_mps:
            raise CommandError(
                f"value: a gust of {math.hypot(*values):.3g} m/s is not allowed; allowed: at most "
                f"{limits.gust_mps:g} m/s"
            )
    if args.get("duration_s") is not None:
        parts.append(f"duration_s: {_finite(args['duration_s'], 'duration_s', 0.01, longest_s)!r}")
    if values:
        parts.append(f"value: [{', '.join(map(repr, values))}]")
    return f"{{{', '.join(parts)}}}"


def with_fault(present: Iterable[str], text: str) -> list[str]:
    """The plant's parameter with one more fault."""
    return [*(one for one in present if one != NONE), text]


def listed(facts: Mapping[str, str]) -> list[str]:
    """The faults that act or are to come, of what the plant says in /diagnostics."""
    return facts["faults"].split("; ") if facts.get("faults") else []
