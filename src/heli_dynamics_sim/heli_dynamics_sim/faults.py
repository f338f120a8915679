# SPDX-License-Identifier: Apache-2.0
"""Faults of sensors and actuators, and gusts, at given times: what the plant makes of them.

Sensors are spoilt after they are read, commands behind the transport delay: nobody else knows. A
fault acts on the samples that arrive while it lasts. What a listener would not take from a message
is missing here: all of an IMU's sample with a number that is not finite, of a fix without position
the velocity, too. So a flight in one process is that of the graph.
"""

import difflib
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import yaml

from heli_core.errors import PlantConfigError
from heli_core.jit import by_reference, copy, fill, njit, scratch
from heli_core.rcl_yaml import number, printable, scalar
from heli_core.rows import ACTUATOR, AIR, MEAS
from heli_core.ticks import Rate
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.sensors import SensorParams

# -------------------------------------------------------------------------------------------------
# Faults.
# -------------------------------------------------------------------------------------------------

KINDS = (
    "loss", "freeze", "zero", "nan", "bias", "drift", "jump", "noise", "delay", "duplicate",
    "reorder", "stuck", "offset", "slow", "dead_zone", "runaway", "gust", "stop",
)  # fmt: skip
"""What goes wrong; a kernel takes the place of its name."""
(
    _LOSS, _FREEZE, _ZERO, _NAN, _BIAS, _DRIFT, _JUMP, _NOISE, _DELAY, _DUPLICATE, _REORDER, _STUCK,
    _OFFSET, _SLOW, _DEAD_ZONE, _RUNAWAY, _GUST, _STOP,
) = range(len(KINDS))  # fmt: skip


class FaultRow(NamedTuple):
    """A fault as its kernel takes it (15,)."""

    kind: int = 0
    begin: int = 1  # tick from which it acts
    end: int = 2  # and from which it does not
    first: int = 3  # place in the measurement row or in the command
    numbers: int = 4  # how many from there on
    period: int = 5  # ticks from sample to sample
    flag: int = 6  # place of the sensor's valid flag; negative: it has none of its own
    lost: int = 7  # place in the row of normals of the one that decides what is lost
    normals: int = 8  # and of the first of those for its numbers
    value: slice = slice(9, 15)
    size: int = 15


FAULT = FaultRow()
_VALUE = FAULT.value.start
_N_SENSED = MEAS.sensed


@by_reference
class FaultParams(NamedTuple):
    """The faults of a flight, and what is to be known of its sensors."""

    sensors: np.ndarray  # (n, 15), a FaultRow each
    actuators: np.ndarray  # (n, 15)
    gusts: np.ndarray  # (n, 15)
    engine_out: float  # tick from which on the engine has stopped
    latency: int  # of a fix, ticks
    tick_s: float


@by_reference
class FaultState(NamedTuple):
    """What is remembered of a flight with faults or without: they may come while it flies."""

    tick: np.ndarray  # (1,) int64, that was measured last
    held: np.ndarray  # (28,) what each sensor said last, places of `rows.MEAS`
    past: np.ndarray  # (slots, 28) what the sensors read at each of the last ticks
    u: np.ndarray  # (4,) the last command that reached the servos


def initial_faults(u: np.ndarray, slots: int) -> FaultState:
    """Memory before tick 0, for the command (4,) of the start and this many ticks of the past."""
    return FaultState(
        np.zeros(1, dtype=np.int64),
        np.zeros(MEAS.sensed),
        np.zeros((slots, MEAS.sensed)),
        np.array(u, dtype=np.float64),
    )


@njit
def acts(row, tick):
    """Whether a fault acts at a tick."""
    return row[FAULT.begin] <= tick < row[FAULT.end]


@njit
def _lag(row, tick):
    """Ticks by which the sample of a tick is old; 0: it is the tick's own."""
    kind, period = int(row[FAULT.kind]), int(row[FAULT.period])
    if kind == _DELAY:
        return int(row[_VALUE])
    odd = (tick // period) % 2
    if kind == _DUPLICATE:
        return period * odd
    # Pairs are exchanged: what would come second comes first, one sample late.
    return period * (1 + 2 * odd)


@njit
def _take(row, source, y):
    """The sensor's places of the row y, its flag, too, as they are in another row."""
    first = int(row[FAULT.first])
    for i in range(first, first + int(row[FAULT.numbers])):
        y[i] = source[i]
    flag = int(row[FAULT.flag])
    if flag >= 0:
        y[flag] = source[flag]


@njit
def _spoil(row, tick, state, noise, k, y):
    """One sensor's fault at a tick at which it has a sample."""
    kind, first, count = int(row[FAULT.kind]), int(row[FAULT.first]), int(row[FAULT.numbers])
    normals = int(row[FAULT.normals])
    if kind == _FREEZE:
        _take(row, state.held, y)
        return
    if kind == _DELAY or kind == _DUPLICATE or kind == _REORDER:
        lag = min(_lag(row, tick), tick)
        _take(row, state.past[(tick - lag) % state.past.shape[0]], y)
        return
    chance = 0.5 * math.erfc(-noise[int(row[FAULT.lost])] / math.sqrt(2.0))
    for i in range(count):
        value, at = row[_VALUE + i], first + i
        if kind == _NAN or (kind == _LOSS and chance < row[_VALUE]):
            y[at] = math.nan
        elif kind == _ZERO:
            y[at] = 0.0
        elif kind == _BIAS:
            y[at] += value
        elif kind == _DRIFT:
            y[at] += value * (tick - row[FAULT.begin]) * k.tick_s
        elif kind == _JUMP:
            y[at] += math.copysign(value, noise[normals + i])
        elif kind == _NOISE:
            y[at] += value * noise[normals + i]


@njit
def _finite(values):
    for value in values:
        if not math.isfinite(value):
            return False
    return True


@njit
def _settle(tick, k, y):
    """What a listener takes of the messages: nothing of one with a number that is not finite."""
    imu, imu2, mag = y[MEAS.imu], y[MEAS.imu2], y[MEAS.mag]
    if not _finite(imu):
        fill(imu, math.nan)
    if not _finite(imu2):
        fill(imu2, math.nan)
    if not _finite(mag):
        y[MEAS.mag_valid] = 0.0
    if y[MEAS.mag_valid] == 0.0:
        fill(mag, 0.0)
    if not math.isfinite(y[MEAS.baro]):
        y[MEAS.baro_valid] = 0.0
    if y[MEAS.baro_valid] == 0.0:
        y[MEAS.baro] = 0.0
    if not math.isfinite(y[MEAS.rotor]):
        y[MEAS.rotor_valid] = 0.0
    if y[MEAS.rotor_valid] == 0.0:
        y[MEAS.rotor] = 0.0
    pos, vel = y[MEAS.gps_pos], y[MEAS.gps_vel]
    if not _finite(pos):
        y[MEAS.gps_valid] = 0.0
    if y[MEAS.gps_valid] == 0.0:
        fill(pos, 0.0)
        fill(vel, 0.0)
        y[MEAS.gps_tick] = 0.0
        return
    y[MEAS.gps_tick] = tick - k.latency
    if not _finite(vel):
        fill(vel, math.nan)


@njit
def _hold(y, place, numbers, flag, stuck, held):
    """Remember a sensor's sample, if there is one; not of numbers that are stuck, nor of NaN."""
    if flag >= 0:
        if y[flag] == 0.0:
            return
        held[flag] = 1.0
    for i in range(place, place + numbers):
        if stuck[i] == 0.0 and math.isfinite(y[i]):
            held[i] = y[i]


@njit
def spoil_sensors(state, tick, noise, k, y):
    """Put the faults of a tick on what the sensors read, in place.

    Parameters
    ----------
    state : FaultState
        In place.
    tick : int
    noise : (NOISE.size,) array
        Standard normals of the tick.
    k : FaultParams
    y : (>= 28,) array
        Places of `rows.MEAS`.
    """
    state.tick[0] = tick
    copy(state.past[tick % state.past.shape[0]], y)
    stuck, held = scratch(_N_SENSED), state.held
    fill(stuck, 0.0)
    for n in range(k.sensors.shape[0]):
        row = k.sensors[n]
        if acts(row, tick) and tick % int(row[FAULT.period]) == 0:
            _spoil(row, tick, state, noise, k, y)
            if int(row[FAULT.kind]) == _FREEZE:
                for i in range(int(row[FAULT.numbers])):
                    stuck[int(row[FAULT.first]) + i] = 1.0
    if k.sensors.shape[0] > 0:
        _settle(tick, k, y)
    _hold(y, MEAS.imu.start, 6, -1, stuck, held)
    _hold(y, MEAS.imu2.start, 6, -1, stuck, held)
    _hold(y, MEAS.mag.start, 3, MEAS.mag_valid, stuck, held)
    _hold(y, MEAS.baro, 1, MEAS.baro_valid, stuck, held)
    _hold(y, MEAS.gps_pos.start, 6, MEAS.gps_valid, stuck, held)
    _hold(y, MEAS.rotor, 1, MEAS.rotor_valid, stuck, held)


@njit
def spoil_command(state, k, u):
    """Put the faults of the tick that was measured last on the command (4,), in place."""
    tick = state.tick[0]
    for n in range(k.actuators.shape[0]):
        row = k.actuators[n]
        if not acts(row, tick):
            continue
        kind, at, value = int(row[FAULT.kind]), int(row[FAULT.first]), row[_VALUE]
        before = state.u[at]
        if kind == _STUCK:
            u[at] = before if math.isnan(value) else value
        elif kind == _OFFSET:
            u[at] += value
        elif kind == _SLOW:
            step = value * k.tick_s
            u[at] = before + min(max(u[at] - before, -step), step)
        elif kind == _DEAD_ZONE:
            u[at] = before if abs(u[at] - before) < value else u[at]
        elif kind == _RUNAWAY:
            u[at] = min(max(before + value * k.tick_s, -1.0), 1.0)
    copy(state.u, u)


@njit
def add_gusts(tick, k, air):
    """Add the gusts of a tick, each 1-cosine over its duration, to the air (12,) at all parts."""
    velocity = air[AIR.velocity]
    for n in range(k.gusts.shape[0]):
        row = k.gusts[n]
        if not acts(row, tick):
            continue
        part = (tick - row[FAULT.begin]) / (row[FAULT.end] - row[FAULT.begin])
        share = 0.5 * (1.0 - math.cos(2.0 * math.pi * part))
        for i in range(velocity.shape[0]):
            velocity[i] += share * row[_VALUE + i % 3]


# -------------------------------------------------------------------------------------------------
# Where the numbers are that a fault changes: of sensors and of actuators.
# -------------------------------------------------------------------------------------------------


class Sensor(NamedTuple):
    """Where a sensor's numbers are."""

    first: int  # place in the measurement row
    axes: int  # numbers that a value has
    numbers: int  # of a sample
    flag: int  # place of its flag, negative: none
    lost: int  # place in the row of normals of the one that decides what is lost
    normals: int  # and of the first of those for its numbers


_GPS, IMU, IMU2 = MEAS.gps_pos.start, MEAS.imu.start, MEAS.imu2.start
_LOST = NOISE.fault_lost.start


def _sensor(first: int, axes: int, numbers: int, flag: int, lost: int) -> Sensor:
    return Sensor(first, axes, numbers, flag, _LOST + lost, NOISE.fault.start + first)


def _second(first: int, axes: int) -> Sensor:
    normals = NOISE.fault_imu2.start + first - IMU2
    return Sensor(first, axes, axes, -1, NOISE.fault_imu2_lost, normals)


SECOND = {
    "imu2": _second(IMU2, 6),
    "accel2": _second(MEAS.force2.start, 3),
    "gyro2": _second(MEAS.rate2.start, 3),
}
SENSORS = {
    "gps": _sensor(_GPS, 3, 6, MEAS.gps_valid, 0),
    "gps_velocity": _sensor(MEAS.gps_vel.start, 3, 3, -1, 1),
    "imu": _sensor(IMU, 6, 6, -1, 2),
    "accel": _sensor(MEAS.force.start, 3, 3, -1, 2),
    "gyro": _sensor(MEAS.rate.start, 3, 3, -1, 2),
    "mag": _sensor(MEAS.mag.start, 3, 3, MEAS.mag_valid, 3),
    "baro": _sensor(MEAS.baro, 1, 1, MEAS.baro_valid, 4),
    "rotor_speed": Sensor(
        MEAS.rotor, 1, 1, MEAS.rotor_valid, NOISE.fault_rotor_lost, NOISE.fault_rotor
    ),
    **SECOND,
}
ACTUATORS = {
    "delta_lat": ACTUATOR.lat,
    "delta_lon": ACTUATOR.lon,
    "delta_ped": ACTUATOR.ped,
    "delta_col": ACTUATOR.col,
}


# -------------------------------------------------------------------------------------------------
# Faults as users write them, a mapping of YAML each: read, judged, made numbers for the kernel.
# -------------------------------------------------------------------------------------------------

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


def fault_params(faults: Iterable[Fault], sensors: SensorParams, rate: Rate) -> FaultParams:
    """The kernel's numbers of a flight's faults.

    Parameters
    ----------
    faults : iterable of Fault
    sensors : SensorParams
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
    return FaultParams(**rows, engine_out=stops, latency=sensors.gps.latency, tick_s=rate.tick_s)


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


def _sensor_row(fault: Fault, sensors: SensorParams, rate: Rate, where: str) -> np.ndarray:
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


def _white(sensors: SensorParams) -> np.ndarray:
    """White noise of each number of a measurement row, up to the GPS's velocity (16,)."""
    imu, gps = sensors.imu, sensors.gps
    parts = [np.repeat([imu.accel_white, imu.gyro_white, sensors.mag.white], 3)]
    parts += [np.array([sensors.baro.white]), gps.white_m, np.full(3, gps.velocity_mps)]
    return np.concatenate(parts)


# -------------------------------------------------------------------------------------------------
# What is told of faults that come and go in flight. No ROS.
# -------------------------------------------------------------------------------------------------

FAULTS = "faults"
"""The plant's parameter."""
CLEAR_FAULTS = "clear_faults"
"""Its service: all faults end."""
_FAULT_LOG_MOST = 200


def _lasting(faults: Iterable[Fault], now_s: float) -> str:
    return "; ".join(fault.words for fault in faults if fault.end_s > now_s)


@dataclass
class FaultLog:
    """The faults that were given or taken back while the aircraft flew.

    Attributes
    ----------
    lines : list of str
        In their order, a few words each; the last says so where there were more.
    """

    lines: list[str] = field(default_factory=list)

    def change(self, before: Iterable[Fault], after: Iterable[Fault], now_s: float) -> None:
        """Note what has come, and what was taken back before its end.

        Parameters
        ----------
        before, after : iterable of Fault
            Of the plant.
        now_s : float
            Flight time.
        """
        old, new = list(before), list(after)
        gone = [fault for fault in old if fault not in new and fault.end_s > now_s]
        self.lines += [f"{fault.words}, cleared at {now_s:g} s" for fault in gone]
        self.lines += [fault.words for fault in new if fault not in old]
        if len(self.lines) > _FAULT_LOG_MOST:
            self.lines[_FAULT_LOG_MOST - 1 :] = ["and more"]

    @staticmethod
    def cleared(faults: Iterable[Fault], now_s: float) -> str:
        """What ends when all faults do at a flight time, in a sentence."""
        ended = _lasting(faults, now_s)
        return f"cleared: {ended}" if ended else "there was no fault"

    def facts(self, faults: Iterable[Fault], now_s: float) -> dict[str, str]:
        """For /diagnostics: the faults that act or are to come, and those given in flight."""
        said = {
            "faults": _lasting(faults, now_s),
            "faults_in_flight": "; ".join(self.lines),
        }
        return {name: words for name, words in said.items() if words}
