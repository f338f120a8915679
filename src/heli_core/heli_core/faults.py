# SPDX-License-Identifier: Apache-2.0
"""Faults as users write them: one schema for plant, links, processes and page, read once. No ROS.

A fault is a mapping of YAML: `{what: gps, kind: drift, value: [2, 0, 0], start_s: 12}`. What fails
and how stands in `PLACES` and `KINDS`; a link and a process add the keys that say which one. Who
makes a fault act adds what only it knows: rows of a kernel, links of the graph, a process.
"""

import difflib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeGuard, TypeVar

import yaml

from heli_core.errors import ParameterCause, ParameterError
from heli_core.foreign_files import FileError, compose_yaml
from heli_core.rcl_yaml import number, printable, scalar
from heli_core.sensors import SENSORS

NONE = "none"
"""What a parameter of faults says where there is none: rcl does not take an empty array."""
NOW = "now"
"""As `start_s`, in flight: when the plant has heard of it."""
LONGEST_S = 86400.0
MOST = 64
"""Entries of one parameter."""
LARGEST = 1e6
PAST_S = 1.0
"""So much of the past is remembered: the longest delay."""

# -------------------------------------------------------------------------------------------------
# What may fail, and how.
# -------------------------------------------------------------------------------------------------


class FaultKind(NamedTuple):
    """How something fails, and the numbers that this takes.

    `per_axis`: one number for each axis of what fails, else a single one. `upper` below `lower`:
    no number at all. `open_lower`: the lower bound itself is not allowed. `optional`: the numbers
    may be left out. `meaning`: in a few words; `example`: a single number that a form begins with.
    """

    lower: float = 0.0
    upper: float = -1.0
    meaning: str = ""
    optional: bool = False
    open_lower: bool = True
    per_axis: bool = False
    example: float = 0.0

    @property
    def takes_numbers(self) -> bool:
        """Whether it has a value."""
        return self.upper >= self.lower

    @property
    def allowed(self) -> str:
        """Which numbers, in words."""
        left = "(" if self.open_lower else "["
        meaning = f" ({self.meaning})" if self.meaning else ""
        return f"a number in {left}{self.lower:g}, {self.upper:g}]{meaning}"


_ALONE = FaultKind()


def _per_axis(meaning: str = "") -> FaultKind:
    return FaultKind(-LARGEST, LARGEST, meaning, open_lower=False, per_axis=True)


KINDS: dict[str, FaultKind] = {
    "loss": FaultKind(0.0, 1.0, "share that is lost", optional=True, example=1.0),
    "freeze": _ALONE,
    "zero": _ALONE,
    "nan": _ALONE,
    "bias": _per_axis(),
    "drift": _per_axis("per second"),
    "jump": _per_axis("with a sign that each sample draws anew"),
    "noise": FaultKind(1.0, 1e4, "times the noise", example=5.0),
    "delay": FaultKind(0.0, PAST_S, "s", example=0.2),
    "duplicate": _ALONE,
    "reorder": _ALONE,
    "stuck": FaultKind(-1.0, 1.0, "command; none: the last one", optional=True, open_lower=False),
    "offset": FaultKind(-2.0, 2.0, "added to the command", open_lower=False, example=0.1),
    "slow": FaultKind(0.0, 1e3, "largest change per second", example=0.5),
    "dead_zone": FaultKind(0.0, 2.0, "smaller changes do nothing", example=0.05),
    "runaway": FaultKind(-1e3, 1e3, "per second, to the end stop", open_lower=False, example=0.1),
    "gust": _per_axis(),
    "stop": _ALONE,
}
"""Kinds of the plant's faults, in the order in which its kernels number them."""


class Place(NamedTuple):
    """What may fail: its axes, their unit and names, a number to begin a form with, its kinds."""

    axes: int
    unit: str
    names: str
    example: float
    kinds: tuple[str, ...]


WIND, ENGINE = "wind", "engine"
OF_SENSORS = ("loss", "freeze", "zero", "nan", "bias", "drift", "jump", "noise", "delay",
              "duplicate", "reorder")  # fmt: skip
OF_ACTUATORS = ("stuck", "offset", "slow", "dead_zone", "runaway")
_NED, _BODY = "north, east, down", "forward, right, down"
_AXES = {"body": _BODY, "ned": _NED, "each": ""}
_ACTUATOR = Place(1, "", "", 0.0, OF_ACTUATORS)

PLACES: dict[str, Place] = {
    "gps": Place(3, "m", _NED, 2.0, OF_SENSORS),
    "gps_velocity": Place(3, "m/s", _NED, 1.0, OF_SENSORS),
    "imu": Place(6, "m/s² and rad/s", _BODY, 0.5, OF_SENSORS),
    "accel": Place(3, "m/s²", _BODY, 0.5, OF_SENSORS),
    "gyro": Place(3, "rad/s", _BODY, 0.05, OF_SENSORS),
    **{
        row.name: Place(row.numbers, row.unit, _AXES[row.axes], row.fault, OF_SENSORS)
        for row in SENSORS
    },
    "imu2": Place(6, "m/s² and rad/s", _BODY, 0.5, OF_SENSORS),
    "accel2": Place(3, "m/s²", _BODY, 0.5, OF_SENSORS),
    "gyro2": Place(3, "rad/s", _BODY, 0.05, OF_SENSORS),
    "delta_lat": _ACTUATOR,
    "delta_lon": _ACTUATOR,
    "delta_ped": _ACTUATOR,
    "delta_col": _ACTUATOR,
    WIND: Place(3, "m/s", _NED, 3.0, ("gust",)),
    ENGINE: Place(0, "", "", 0.0, ("stop",)),
}
"""What of the plant may have a fault."""


def forms() -> dict[str, dict[str, dict[str, Any]]]:
    """For a page: per place and kind an example of the numbers, a unit, may they be left out."""
    return {
        what: {kind: _form(place, KINDS[kind]) for kind in place.kinds}
        for what, place in PLACES.items()
    }


def _form(place: Place, kind: FaultKind) -> dict[str, Any]:
    example, unit = [kind.example] if kind.takes_numbers else [], kind.meaning
    if kind.per_axis:
        example = [place.example] + [0.0] * (place.axes - 1)
        unit = ", ".join(filter(None, (place.unit, place.names, kind.meaning)))
    return {"example": example, "unit": unit, "optional": kind.optional}


# -------------------------------------------------------------------------------------------------
# A fault.
# -------------------------------------------------------------------------------------------------


Value = str | float | Sequence[float]


def flow_mapping(pairs: Mapping[str, Value]) -> str:
    """The mapping of YAML, in one line, that reads back as these pairs; none for an infinite one.

    What is not a number stays, so that whoever reads it refuses it.
    """
    parts = []
    for key, value in pairs.items():
        if isinstance(value, str):
            parts.append(f"{key}: {value}")
        elif isinstance(value, Sequence):
            numbers = ", ".join(number(float(one)) for one in value)
            parts.append(f"{key}: {numbers}" if len(value) == 1 else f"{key}: [{numbers}]")
        elif value != math.inf:
            parts.append(f"{key}: {value if isinstance(value, int) else number(value)}")
    return "{" + ", ".join(parts) + "}"


@dataclass(frozen=True)
class Fault:
    """A fault of a flight.

    Attributes
    ----------
    what : str
        One of `PLACES`; of other faults the word that says which sort they are.
    kind : str
        One of the place's kinds.
    start_s, duration_s : float
        Flight time; an infinite duration: to the end.
    value : tuple of float
        SI, NED or body FRD; empty where the kind needs none.
    """

    what: str
    kind: str
    start_s: float
    duration_s: float = math.inf
    value: tuple[float, ...] = ()

    @property
    def which(self) -> dict[str, str]:
        """Keys that say which one of what it is about; none of the plant's."""
        return {}

    @property
    def name(self) -> str:
        """What has the fault, in words."""
        return self.what

    @property
    def end_s(self) -> float:
        """Flight time from which on it does not act."""
        return self.start_s + self.duration_s

    def acts(self, time_s: float) -> bool:
        """Whether it acts at a flight time."""
        return self.start_s <= time_s < self.end_s

    @property
    def text(self) -> str:
        """The mapping that reads back as this fault."""
        pairs: dict[str, Value] = {"what": self.what, **self.which, "kind": self.kind}
        pairs |= {"start_s": self.start_s, "duration_s": self.duration_s}
        return flow_mapping(pairs | ({"value": self.value} if self.value else {}))

    def as_dict(self) -> dict[str, Any]:
        """As JSON has it; a duration of null goes on to the end."""
        lasts = self.duration_s if math.isfinite(self.duration_s) else None
        return {"what": self.what, **self.which, "kind": self.kind, "start_s": self.start_s,
                "duration_s": lasts, "value": list(self.value)}  # fmt: skip

    @property
    def words(self) -> str:
        """For people: gps drift 2, 0, 0 from 20 to 30 s."""
        value = ", ".join(f"{v:g}" for v in self.value)
        until = f" to {self.end_s:g} s" if math.isfinite(self.duration_s) else " s on"
        return f"{f'{self.name} {self.kind} {value}'.rstrip()} from {self.start_s:g}{until}"


# -------------------------------------------------------------------------------------------------
# Read and judged. What is wrong is a ParameterError of one sentence that begins with `where`.
# -------------------------------------------------------------------------------------------------

T = TypeVar("T")
_KEYS = ("what", "kind", "start_s", "duration_s", "value")


def composed(text: str, keys: Sequence[str], where: str) -> yaml.Node | None:
    """The YAML node of a parameter's entry; ParameterError where it is no YAML."""
    try:
        return compose_yaml(text)
    except FileError:
        raise ParameterError(
            f"{text!r} is not valid YAML",
            ParameterCause.SYNTAX,
            where=where,
            allowed=f"a mapping of {', '.join(keys)}",
        ) from None


def entries(
    texts: Iterable[str],
    name: str,
    keys: Sequence[str],
    read: Callable[[yaml.Node | None, str], T],
) -> tuple[T, ...]:
    """What `read(node, where)` makes of each text, a mapping of `keys`, that is not `NONE`."""
    places = [(f"{name}: entry {i}", text) for i, text in enumerate(texts, 1) if text != NONE]
    faults = tuple(read(composed(text, keys, where), where) for where, text in places)
    check_count(name, len(faults))
    return faults


def check_count(name: str, count: int) -> None:
    """Raise ParameterError where a parameter has too many entries."""
    if count > MOST:
        cause, allowed = ParameterCause.LENGTH, f"at most {MOST}"
        raise ParameterError(f"{count} entries", cause, key=name, value=count, allowed=allowed)


class FaultEntry:
    """The mapping of one fault: its keys known, each once; values are judged as they are read.

    Parameters
    ----------
    node : yaml.Node or None
    keys : sequence of str
        Allowed ones. Only `value` may be a list.
    where : str
        Begins the sentence of a ParameterError.
    """

    def __init__(self, node: yaml.Node | None, keys: Sequence[str], where: str) -> None:
        self.where = where
        if not isinstance(node, yaml.MappingNode):
            problem = f"expected a mapping of {', '.join(keys)}"
            raise ParameterError(problem, ParameterCause.TYPE, where=where)
        self.values: dict[str, Any] = {}
        for key_node, value_node in node.value:
            key = key_node.value if isinstance(key_node, yaml.ScalarNode) else "?"
            if key not in keys:
                near = difflib.get_close_matches(key, keys, n=1)
                hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(keys)}"
                raise ParameterError(
                    f"unknown key; {hint}",
                    ParameterCause.UNKNOWN_KEY,
                    where=where,
                    key=printable(key),
                    meant="".join(near),
                )
            if key in self.values:
                raise self.refusal(key, ParameterCause.TWICE, "the key stands here twice")
            self.values[key] = self._plain(key, value_node)

    def refusal(
        self, key: str, cause: ParameterCause, problem: str = "", allowed: str = "", of: str = ""
    ) -> ParameterError:
        """The error that names the entry and its key; without a problem the value is it.

        `of`: of what the key is, in front of it.
        """
        value = self.values.get(key)
        shown = problem or f"{value} is not allowed"
        where = f"{self.where}: of {of}" if of else self.where
        return ParameterError(shown, cause, where=where, key=key, value=value, allowed=allowed)

    def _plain(self, key: str, node: yaml.Node) -> Any:
        if isinstance(node, yaml.ScalarNode):
            return scalar(node.value, bool(node.style))
        if key != "value":
            expected = "expected one value, no list and no mapping"
            raise self.refusal(key, ParameterCause.TYPE, expected)
        items = node.value if isinstance(node, yaml.SequenceNode) else [node]
        flat = [item for item in items if isinstance(item, yaml.ScalarNode)]
        if len(flat) < len(items):
            expected = "expected a value or a flat list of numbers"
            raise self.refusal(key, ParameterCause.TYPE, expected)
        return [scalar(item.value, bool(item.style)) for item in flat]

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def word(self, key: str, choices: Sequence[str], of: str = "", default: str = "") -> str:
        """The value of a key that is one of some words; `of`: whose words, for the sentence."""
        allowed = f"one of {', '.join(choices)}"
        if key not in self and not default:
            raise self.refusal(key, ParameterCause.MISSING, "missing", allowed, of)
        value = self.values.get(key, default)
        if value in choices:
            return str(value)
        near = difflib.get_close_matches(str(value), choices, n=1)
        problem = f"{value} is not allowed{f': did you mean {near[0]}?' if near else ''}"
        raise self.refusal(key, ParameterCause.CHOICE, problem, allowed, of)

    def number(self, key: str, most: float) -> float:
        """The value of a key that is a number from 0 to `most`."""
        value, allowed = self.values.get(key), f"a number in [0, {most:g}]"
        if key not in self:
            raise self.refusal(key, ParameterCause.MISSING, "missing", allowed)
        if not _is_number(value):
            raise self.refusal(key, ParameterCause.TYPE, allowed=allowed)
        if not 0.0 <= value <= most:
            raise self.refusal(key, ParameterCause.BOUNDS, allowed=allowed)
        return float(value)

    def duration_s(self) -> float:
        """How long it lasts, s; infinite where nothing is said."""
        return self.number("duration_s", LONGEST_S) if "duration_s" in self else math.inf

    def numbers(self, axes: int, kind: FaultKind, name: str) -> tuple[float, ...]:
        """The numbers of a fault, as many as its kind and place want; `name` names both."""
        if not kind.takes_numbers:
            if "value" in self:
                problem = f"{name.split()[-1]} has none; leave it out"
                raise self.refusal("value", ParameterCause.CONFLICT, problem)
            return ()
        axes = axes if kind.per_axis else 1
        if "value" not in self:
            if kind.optional:
                return ()
            wanted = f"{axes} numbers" if axes > 1 else kind.allowed
            raise self.refusal("value", ParameterCause.MISSING, "missing", wanted)
        value = self.values["value"]
        listed = value if isinstance(value, list) else [value]
        if len(listed) != axes:
            problem = f"{value} has {len(listed)} numbers"
            raise self.refusal("value", ParameterCause.LENGTH, problem, f"{axes} of {name}")
        for one in listed:
            problem = f"{one} is not allowed"
            if not _is_number(one):
                raise self.refusal("value", ParameterCause.TYPE, problem, kind.allowed)
            inside = kind.lower <= one <= kind.upper
            if not inside or (kind.open_lower and one == kind.lower):
                raise self.refusal("value", ParameterCause.BOUNDS, problem, kind.allowed)
        return tuple(map(float, listed))


def _is_number(value: Any) -> TypeGuard[float]:
    return isinstance(value, int | float) and not isinstance(value, bool)


def fault_of(node: yaml.Node | None, where: str, now_s: float | None = None) -> Fault:
    """The plant's fault of a YAML mapping; `where` begins the sentence of a ParameterError.

    In flight `now_s` is the flight time, for one that says no other.
    """
    entry = FaultEntry(node, _KEYS, where)
    if now_s is not None and entry.values.get("start_s", NOW) == NOW:
        entry.values["start_s"] = now_s
    what = entry.word("what", tuple(PLACES))
    kind = entry.word("kind", PLACES[what].kinds, what)
    start_s, duration_s = entry.number("start_s", LONGEST_S), entry.duration_s()
    if kind == "gust" and not math.isfinite(duration_s):
        problem = "missing; a gust needs it"
        raise entry.refusal("duration_s", ParameterCause.MISSING, problem)
    if kind == "stop" and "duration_s" in entry:
        problem = "an engine that stops stays off; leave it out"
        raise entry.refusal("duration_s", ParameterCause.CONFLICT, problem)
    value = entry.numbers(PLACES[what].axes, KINDS[kind], f"{what} {kind}")
    return Fault(what, kind, start_s, duration_s, value)


def faults_of(texts: Iterable[str]) -> tuple[Fault, ...]:
    """The faults of the plant's parameter `faults`.

    Raises
    ------
    ParameterError
        One sentence: which of them, key, value, and what is allowed.
    """
    return entries(texts, "faults", _KEYS, fault_of)


def begun(texts: Iterable[str], now_s: float) -> tuple[str, ...]:
    """The texts of the parameter `faults`, where those without a beginning begin now.

    Parameters
    ----------
    texts : iterable of str
        A mapping without `start_s`, or with `start_s: now`, gets the flight time; others stay.
    now_s : float
        Flight time.

    Raises
    ------
    ParameterError
        As `faults_of`.
    """
    started: list[str] = []
    for i, text in enumerate(texts, 1):
        where = f"faults: entry {i}"
        node = None if text == NONE else composed(text, _KEYS, where)
        starts = not isinstance(node, yaml.MappingNode) or any(
            key.value == "start_s" and value.value != NOW for key, value in node.value
        )
        started.append(text if starts else fault_of(node, where, now_s).text)
    return tuple(started)
