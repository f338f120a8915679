# SPDX-License-Identifier: Apache-2.0
"""Faults of sensors and actuators, and gusts, at given times: what the plant makes of them.

Sensors are spoilt after they are read, commands behind the transport delay: nobody else knows. A
fault acts on the samples that arrive while it lasts. What a listener would not take from a message
is missing here: all of an IMU's sample with a number that is not finite, of a fix without position
the velocity, too. So a flight in one process is that of the graph.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from heli_core.errors import PlantConfigError
from heli_core.faults import KINDS, PAST_S, WIND, Fault
from heli_core.jit import by_reference, copy, fill, njit, scratch
from heli_core.rows import ACTUATOR, AIR, MEAS
from heli_core.sensors import PLACES
from heli_core.sensors import SENSORS as SAMPLED
from heli_core.ticks import Rate
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.sensors import SensorParams, periods, white_noise

# -------------------------------------------------------------------------------------------------
# Faults.
# -------------------------------------------------------------------------------------------------

(
    _LOSS, _FREEZE, _ZERO, _NAN, _BIAS, _DRIFT, _JUMP, _NOISE, _DELAY, _DUPLICATE, _REORDER, _STUCK,
    _OFFSET, _SLOW, _DEAD_ZONE, _RUNAWAY, _GUST, _STOP,
) = range(len(KINDS))  # fmt: skip
"""What goes wrong: the place of a kind's name in `heli_core.faults.KINDS`."""


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
_SAMPLES = tuple(PLACES[row.name] for row in SAMPLED)


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
    imu, imu2 = y[MEAS.imu], y[MEAS.imu2]
    if not _finite(imu):
        fill(imu, math.nan)
    if not _finite(imu2):
        fill(imu2, math.nan)
    for which in range(len(_SAMPLES)):
        at = _SAMPLES[which]
        sample = y[at.first : at.first + at.numbers]
        if not _finite(sample):
            y[at.valid] = 0.0
        if y[at.valid] == 0.0:
            fill(sample, 0.0)
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
    for which in range(len(_SAMPLES)):
        at = _SAMPLES[which]
        _hold(y, at.first, at.numbers, at.valid, stuck, held)
    _hold(y, MEAS.gps_pos.start, 6, MEAS.gps_valid, stuck, held)


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


class FaultyPlaces(NamedTuple):
    """Where a sensor's numbers are."""

    first: int  # place in the measurement row
    axes: int  # numbers that a value has
    numbers: int  # of a sample
    flag: int  # place of its flag, negative: none
    lost: int  # place in the row of normals of the one that decides what is lost
    normals: int  # and of the first of those for its numbers


_GPS, IMU, IMU2 = MEAS.gps_pos.start, MEAS.imu.start, MEAS.imu2.start
_LOST = NOISE.fault_lost.start


def _sensor(first: int, axes: int, numbers: int, flag: int, lost: int) -> FaultyPlaces:
    return FaultyPlaces(first, axes, numbers, flag, _LOST + lost, NOISE.fault.start + first)


def _second(first: int, axes: int) -> FaultyPlaces:
    normals = NOISE.fault_imu2.start + first - IMU2
    return FaultyPlaces(first, axes, axes, -1, NOISE.fault_imu2_lost, normals)


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
    **{
        name: FaultyPlaces(at.first, at.numbers, at.numbers, at.valid, at.lost, at.fault)
        for name, at in PLACES.items()
    },
    **SECOND,
}
ACTUATORS = {
    "delta_lat": ACTUATOR.lat,
    "delta_lon": ACTUATOR.lon,
    "delta_ped": ACTUATOR.ped,
    "delta_col": ACTUATOR.col,
}


# -------------------------------------------------------------------------------------------------
# Numbers for the kernel.
# -------------------------------------------------------------------------------------------------

_NEVER = 2.0**52


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
        elif fault.what == WIND:
            groups["gusts"].append(_row(fault, rate, 0, 3))
        else:
            stops = min(stops, float(rate.ticks_in(fault.start_s)))
    rows = {name: np.array(group, float).reshape(-1, FAULT.size) for name, group in groups.items()}
    return FaultParams(**rows, engine_out=stops, latency=sensors.gps.latency, tick_s=rate.tick_s)


def _row(fault: Fault, rate: Rate, first: int, count: int) -> np.ndarray:
    row = np.zeros(FAULT.size)
    row[FAULT.kind] = list(KINDS).index(fault.kind)
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
        fault,
        rate,
        of.first,
        of.axes if KINDS[fault.kind].per_axis or fault.kind == "noise" else of.numbers,
    )
    sampled = dict(zip((row.name for row in SAMPLED), periods(sensors), strict=True))
    of_fixes = dict.fromkeys(("gps", "gps_velocity"), sensors.gps.period)
    period = (sampled | of_fixes).get(fault.what, 1)
    row[FAULT.period], row[FAULT.flag], row[FAULT.lost] = period, of.flag, of.lost
    row[FAULT.normals] = of.normals
    values = row[FAULT.value]
    if fault.kind == "loss" and not fault.value:
        values[0] = 1.0
    if fault.kind == "noise":
        more = math.sqrt(fault.value[0] ** 2 - 1.0)
        like = of.first - IMU2 + IMU if fault.what in SECOND else of.first
        values[: of.axes] = more * _white(sensors)[like : like + of.axes]
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
    """White noise of each number of a measurement row (28,); of a second IMU none stands here."""
    white, imu, gps = np.zeros(MEAS.sensed), sensors.imu, sensors.gps
    white[MEAS.force], white[MEAS.rate] = imu.accel_white, imu.gyro_white
    white[MEAS.gps_pos], white[MEAS.gps_vel] = gps.white_m, gps.velocity_mps
    for at, level in zip(_SAMPLES, white_noise(sensors), strict=True):
        white[at.first : at.first + at.numbers] = level
    return white


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
        sentences = {
            "faults": _lasting(faults, now_s),
            "faults_in_flight": "; ".join(self.lines),
        }
        return {name: words for name, words in sentences.items() if words}
