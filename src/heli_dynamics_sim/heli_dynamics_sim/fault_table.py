# SPDX-License-Identifier: Apache-2.0
"""Faults as users write them, a mapping of YAML each: read, judged, made numbers for the kernel."""

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import yaml

from heli_dynamics_sim.config_error import PlantConfigError
from heli_dynamics_sim.fault_places import ACTUATORS, IMU, IMU2, SECOND, SENSORS
from heli_dynamics_sim.faults import FAULT, KINDS, FaultKernel
from heli_dynamics_sim.sensors import SensorKernel
from heli_math.rows import MEAS
from heli_math.ticks import Rate
from heli_parameters.printable import printable
from heli_parameters.rcl_dump import number
from heli_parameters.rcl_yaml import scalar

NONE = "none"
"""What the parameter `faults` says where there is none: rcl does not take an empty array."""
NOW = "now"
"""As `start_s`, in flight: when the plant has heard of it."""
PAST_S = 1.0
"""So much of the past is remembered: the longest delay."""
_KEYS = ("what", "kind", "start_s", "duration_s", "value")
_LONGEST_S = 86400.0
_LARGEST = 1e6
_NEVER = 2.0**52
_MOST = 64


_WIND, _ENGINE = "wind", "engine"
_OF_SENSORS = ("loss", "freeze", "zero", "nan", "bias", "drift", "jump", "noise", "delay",
               "duplicate", "reorder")  # fmt: skip
_OF_ACTUATORS = ("stuck", "offset", "slow", "dead_zone", "runaway")
WHAT = (*SENSORS, *ACTUATORS, _WIND, _ENGINE)
"""What may have a fault."""
_PER_AXIS = ("bias", "drift", "jump")
_ALONE = ("freeze", "zero", "nan", "duplicate", "reorder", "stop")


class _Bounds(NamedTuple):
    """A kind's single value: bounds, the lower one open, and whether it may be left out."""

    lower: float
    upper: float
    meaning: str
    optional: bool = False


_SINGLE = {
    "loss": _Bounds(0.0, 1.0, "the share that is lost", True),
    "noise": _Bounds(1.0, 1e4, "how many times the noise of a sample is larger"),
    "delay": _Bounds(0.0, PAST_S, "s"),
    "stuck": _Bounds(-1.0, 1.0, "the command; without it the last one", True),
    "offset": _Bounds(-2.0, 2.0, "added to the command"),
    "slow": _Bounds(0.0, 1e3, "largest change of the command, 1/s"),
    "dead_zone": _Bounds(0.0, 2.0, "smaller changes of the command do nothing"),
    "runaway": _Bounds(-1e3, 1e3, "speed of the command, 1/s"),
}
_BOTH_ENDS = ("stuck", "offset", "runaway")


@dataclass(frozen=True)
class Fault:
    """A fault of a flight.

    Attributes
    ----------
    what : str
        One of `WHAT`.
    kind : str
        One of `faults.KINDS`.
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
    def end_s(self) -> float:
        """Flight time from which on it does not act."""
        return self.start_s + self.duration_s

    def acts(self, time_s: float) -> bool:
        """Whether it acts at a flight time."""
        return self.start_s <= time_s < self.end_s

    @property
    def text(self) -> str:
        """The mapping that reads back as this fault."""
        parts = [f"what: {self.what}", f"kind: {self.kind}", f"start_s: {number(self.start_s)}"]
        if math.isfinite(self.duration_s):
            parts.append(f"duration_s: {number(self.duration_s)}")
        if self.value:
            one = len(self.value) == 1
            shown = ", ".join(map(number, self.value))
            parts.append(f"value: {shown}" if one else f"value: [{shown}]")
        return "{" + ", ".join(parts) + "}"

    def as_dict(self) -> dict[str, Any]:
        """As JSON has it; a duration of null goes on to the end."""
        lasts = self.duration_s if math.isfinite(self.duration_s) else None
        return {"what": self.what, "kind": self.kind, "start_s": self.start_s,
                "duration_s": lasts, "value": list(self.value)}  # fmt: skip

    @property
    def words(self) -> str:
        """For people: gps drift 2, 0, 0 from 20 s to 30 s."""
        value = ", ".join(f"{v:g}" for v in self.value)
        until = f" to {self.end_s:g} s" if math.isfinite(self.duration_s) else " s on"
        name = f"{self.what} {self.kind} {value}".rstrip()
        return f"{name} from {self.start_s:g}{until}"


def faults_of(texts: Iterable[str]) -> tuple[Fault, ...]:
    """The faults of the parameter `faults`.

    Raises
    ------
    PlantConfigError
        One sentence: which of them, key, value, and what is allowed.
    """
    found: list[Fault] = []
    for i, text in enumerate(texts):
        if text == NONE:
            continue
        where = f"faults: entry {i + 1}"
        found.append(fault_of(_composed(text, where), where))
    if len(found) > _MOST:
        raise PlantConfigError(f"faults: {len(found)} entries; allowed: at most {_MOST}")
    return tuple(found)


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
    PlantConfigError
        As `faults_of`.
    """
    found: list[str] = []
    for i, text in enumerate(texts):
        where = f"faults: entry {i + 1}"
        node = None if text == NONE else _composed(text, where)
        starts = not isinstance(node, yaml.MappingNode) or any(
            key.value == "start_s" and value.value != NOW for key, value in node.value
        )
        found.append(text if starts else fault_of(node, where, now_s).text)
    return tuple(found)


def _composed(text: str, where: str) -> yaml.Node | None:
    try:
        return yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError:
        raise PlantConfigError(
            f"{where}: {text!r} is not valid YAML; allowed: a mapping of {', '.join(_KEYS)}"
        ) from None


def fault_of(node: yaml.Node | None, where: str, now_s: float | None = None) -> Fault:
    """A fault of a YAML mapping; `where` begins the sentence of a PlantConfigError.

    In flight `now_s` is the flight time, for one that says no other.
    """
    said = _mapping(node, where)
    if now_s is not None and said.get("start_s", NOW) == NOW:
        said["start_s"] = now_s
    for key in ("what", "kind", "start_s"):
        if key not in said:
            raise PlantConfigError(f"{where}: {key}: missing")
    what, kind = _one_of(said, "what", WHAT, where), _kind(said, where)
    start_s = _number(said["start_s"], "start_s", (0.0, _LONGEST_S), where)
    duration_s = math.inf
    if "duration_s" in said:
        duration_s = _number(said["duration_s"], "duration_s", (0.0, _LONGEST_S), where)
    if kind == "gust" and not math.isfinite(duration_s):
        raise PlantConfigError(f"{where}: duration_s: missing; a gust needs it")
    if kind == "stop" and "duration_s" in said:
        raise PlantConfigError(f"{where}: duration_s: an engine that stops stays off; leave it out")
    return Fault(what, kind, start_s, duration_s, _values(said, what, kind, where))


def _mapping(node: yaml.Node | None, where: str) -> dict[str, Any]:
    if not isinstance(node, yaml.MappingNode):
        raise PlantConfigError(f"{where}: expected a mapping of {', '.join(_KEYS)}")
    said: dict[str, Any] = {}
    for key_node, value_node in node.value:
        key = key_node.value if isinstance(key_node, yaml.ScalarNode) else "?"
        if key not in _KEYS:
            near = difflib.get_close_matches(key, _KEYS, n=1)
            hint = f"did you mean {near[0]}?" if near else f"known: {', '.join(_KEYS)}"
            raise PlantConfigError(f"{where}: {printable(key)}: unknown key; {hint}")
        if key in said:
            raise PlantConfigError(f"{where}: {key}: the key stands here twice")
        said[key] = _plain(value_node, key, where)
    return said


def _plain(node: yaml.Node, key: str, where: str) -> Any:
    if isinstance(node, yaml.ScalarNode):
        return scalar(node.value, bool(node.style))
    items = node.value if isinstance(node, yaml.SequenceNode) else [node]
    flat = [item for item in items if isinstance(item, yaml.ScalarNode)]
    if len(flat) < len(items):
        raise PlantConfigError(f"{where}: {key}: expected a value or a flat list of numbers")
    return [scalar(item.value, bool(item.style)) for item in flat]


def _one_of(said: Mapping[str, Any], key: str, allowed: Sequence[str], where: str) -> str:
    value = said[key]
    if value in allowed:
        return str(value)
    near = difflib.get_close_matches(str(value), allowed, n=1)
    hint = f": did you mean {near[0]}?" if near else ""
    raise PlantConfigError(
        f"{where}: {key}: {value} is not allowed{hint}; allowed: one of {', '.join(allowed)}"
    )


def _kind(said: Mapping[str, Any], where: str) -> str:
    what = said["what"]
    others = {_WIND: ("gust",), _ENGINE: ("stop",)}
    of = _OF_SENSORS if what in SENSORS else others.get(what, _OF_ACTUATORS)
    return _one_of(said, "kind", of, f"{where}: of {what}")


def _number(value: Any, key: str, bounds: tuple[float, float], where: str) -> float:
    lower, upper = bounds
    right = not isinstance(value, bool) and isinstance(value, int | float)
    if not right or not lower <= value <= upper:
        raise PlantConfigError(
            f"{where}: {key}: {value} is not allowed; allowed: a number in [{lower:g}, {upper:g}]"
        )
    return float(value)


def _values(said: Mapping[str, Any], what: str, kind: str, where: str) -> tuple[float, ...]:
    """The numbers of a fault, as many as its kind and sensor want."""
    given = said.get("value")
    if kind in _ALONE:
        if given is not None:
            raise PlantConfigError(f"{where}: value: {kind} has none; leave it out")
        return ()
    axes = SENSORS[what].axes if what in SENSORS else 3 if what == _WIND else 1
    axes = axes if kind in _PER_AXIS or kind == "gust" else 1
    single = _SINGLE.get(kind)
    meaning = f" ({single.meaning})" if single else ""
    if given is None:
        if single and single.optional:
            return ()
        raise PlantConfigError(f"{where}: value: missing; allowed: {axes} numbers{meaning}")
    numbers = given if isinstance(given, list) else [given]
    if len(numbers) != axes:
        raise PlantConfigError(
            f"{where}: value: {given} has {len(numbers)} numbers; allowed: {axes} of {what} "
            f"{kind}{meaning}"
        )
    bounds = (single.lower, single.upper) if single else (-_LARGEST, _LARGEST)
    found = tuple(_number(v, "value", bounds, where) for v in numbers)
    if single and kind not in _BOTH_ENDS and found[0] <= single.lower:
        raise PlantConfigError(
            f"{where}: value: {given} is not allowed; allowed: a number in ({single.lower:g}, "
            f"{single.upper:g}]{meaning}"
        )
    return found


def acting(faults: Iterable[Fault], time_s: float) -> str:
    """What acts at a flight time, in words: fault: gps loss, imu bias; empty for nothing."""
    now = [f"{fault.what} {fault.kind}" for fault in faults if fault.acts(time_s)]
    return f"fault: {', '.join(dict.fromkeys(now))}" if now else ""


def fault_kernel(faults: Iterable[Fault], sensors: SensorKernel, rate: Rate) -> FaultKernel:
    """The kernel's numbers of a flight's faults.

    Parameters
    ----------
    faults : iterable of Fault
    sensors : SensorKernel
        Of the plant: its periods and the noise of its samples.
    rate : Rate

    Raises
    ------
    PlantConfigError
    """
    groups: dict[str, list[np.ndarray]] = {"sensors": [], "actuators": [], "gusts": []}
    stops = _NEVER
    for i, fault in enumerate(faults):
        if fault.what in SENSORS:
            groups["sensors"].append(_sensor_row(fault, sensors, rate, f"faults: entry {i + 1}"))
        elif fault.what in ACTUATORS:
            groups["actuators"].append(_row(fault, rate, ACTUATORS[fault.what], 1))
        elif fault.what == _WIND:
            groups["gusts"].append(_row(fault, rate, 0, 3))
        else:
            stops = min(stops, float(rate.ticks_in(fault.start_s)))
    rows = {name: np.array(group, float).reshape(-1, FAULT.size) for name, group in groups.items()}
    return FaultKernel(**rows, engine_out=stops, latency=sensors.gps.latency, tick_s=rate.tick_s)


def _row(fault: Fault, rate: Rate, first: int, count: int) -> np.ndarray:
    row = np.zeros(FAULT.size)
    row[FAULT.kind] = KINDS.index(fault.kind)
    row[FAULT.begin] = rate.ticks_in(fault.start_s)
    row[FAULT.end] = rate.ticks_in(fault.end_s) if math.isfinite(fault.end_s) else _NEVER
    row[FAULT.first], row[FAULT.numbers] = first, count
    row[FAULT.period], row[FAULT.flag] = 1, -1
    values = row[FAULT.value]
    values[: len(fault.value)] = fault.value
    if fault.kind == "stuck" and not fault.value:
        values[0] = math.nan
    return row


def _sensor_row(fault: Fault, sensors: SensorKernel, rate: Rate, where: str) -> np.ndarray:
    of = SENSORS[fault.what]
    if fault.what in SECOND and not sensors.imu2:
        raise PlantConfigError(
            f"{where}: what: {fault.what}: there is no second IMU; set sensors.imu2.enabled"
        )
    row = _row(
        fault, rate, of.first, of.axes if fault.kind in (*_PER_AXIS, "noise") else of.numbers
    )
    period = {
        "mag": sensors.mag.period, "baro": sensors.baro.period,
        "gps": sensors.gps.period, "gps_velocity": sensors.gps.period,
        "rotor_speed": sensors.rotor.period,
    }.get(fault.what, 1)  # fmt: skip
    row[FAULT.period], row[FAULT.flag], row[FAULT.lost] = period, of.flag, of.lost
    row[FAULT.normals] = of.normals
    values = row[FAULT.value]
    if fault.kind == "loss" and not fault.value:
        values[0] = 1.0
    if fault.kind == "noise":
        more = math.sqrt(fault.value[0] ** 2 - 1.0)
        like = of.first - IMU2 + IMU if fault.what in SECOND else of.first
        white = _white(sensors)[like : like + of.axes]
        values[: of.axes] = more * (sensors.rotor.white if of.first == MEAS.rotor else white)
    if fault.kind == "delay":
        values[0] = max(1, round(rate.ticks_in(fault.value[0]) / period)) * period
    slowest = {"delay": values[0], "duplicate": period, "reorder": 3 * period}
    if slowest.get(fault.kind, 0) > rate.ticks_in(PAST_S):
        raise PlantConfigError(
            f"{where}: {fault.what} {fault.kind}: its samples are {period * rate.tick_s:g} s "
            f"apart; allowed: what is at most {PAST_S:g} s old"
        )
    return row


def _white(sensors: SensorKernel) -> np.ndarray:
    """White noise of each number of a measurement row, up to the GPS's velocity (16,)."""
    imu, gps = sensors.imu, sensors.gps
    parts = [np.repeat([imu.accel_white, imu.gyro_white, sensors.mag.white], 3)]
    parts += [np.array([sensors.baro.white]), gps.white_m, np.full(3, gps.velocity_mps)]
    return np.concatenate(parts)
