# SPDX-License-Identifier: Apache-2.0
"""What a log can tell of its helicopter: what moves, what answers what, what can be identified."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from scipy import signal as filters
from scipy.integrate import cumulative_trapezoid

from heli_analysis.identification.aperiodic import JointResponse, joint_response
from heli_core.errors import IdentificationCause, IdentificationError
from heli_studies.logs.signals import (
    GAP,
    SIGNALS,
    Array,
    FlightLog,
    LogCause,
    LogError,
    LoggedSignal,
)

SCHEMA = 1
"""Number of the layout of `LogInfo.as_dict`; grows when a key changes or goes."""

LEAST_RATE_HZ = 8.0
"""Below, a signal tells nothing of a helicopter's attitude."""
_MOST_RATE_HZ = 400.0
_MOVES = 1e-3  # of an input's full travel of 1, standard deviation
_TOGETHER = 0.9
_ALL, _SOME = 4.0, 2.0  # highest over lowest usable frequency
_OSCILLATES_HZ, _PEAKS = 10.0, 3
_AROUND_HZ, _APART_HZ = 8.0, 1.0
_PEAK, _PIECES = 8.0, 8  # dB over what is around it; pieces that are averaged, so no chance peak
_KINEMATIC_HZ = (0.15, 4.0)
_LONGEST_LAG_S = 0.3


class LogVerdict(Enum):
    """Whether a response, or a part of the model, can be identified from the log."""

    YES = "identifies"
    PARTLY = "partly"
    NO = "not"


class Cause(Enum):
    """Why not, or only partly."""

    NO_INPUT = "no input is in the log"
    NO_OUTPUT = "the answer is not in the log"
    LOW_RATE = "logged too seldom"
    NOT_EXCITED = "the input does not move"
    TOO_SHORT = "the pieces without a gap are too short"
    TOGETHER = "the input moves only together with another"
    LOW_COHERENCE = "the answer is lost in noise"
    NARROW = "only within less than two octaves"
    NO_AIR = "no log of a helicopter says what the air does"


class Part(Enum):
    """Parts of a model."""

    KINEMATICS = "kinematics: attitude beside rates"
    ROLL = "roll: p from the lateral input"
    PITCH = "pitch: q from the longitudinal input"
    YAW = "yaw: r from the pedal"
    HEAVE = "heave: az from the collective"
    CROSS = "cross-couplings of roll and pitch"
    VIBRATION = "vibration: frequencies for notch filters"
    GUSTS = "E: effect of gusts"


class Pair(NamedTuple):
    """An output, an input, and the part of the model that it is."""

    output: str
    input: str
    part: Part


PAIRS = (
    Pair("p", "lat", Part.ROLL), Pair("q", "lon", Part.PITCH), Pair("r", "ped", Part.YAW),
    Pair("az", "col", Part.HEAVE), Pair("p", "lon", Part.CROSS), Pair("q", "lat", Part.CROSS),
)  # fmt: skip
_AXES = ("lat", "lon", "ped", "col")
_SWEPT = {1: "lat", 2: "lon", 3: "ped", 4: "lat", 5: "lon", 6: "ped", 7: "lat", 8: "lon",
          9: "ped", 10: "lat", 11: "lon", 12: "ped", 13: "col"}  # fmt: skip
"""ArduPilot's SID_AXIS to what it sweeps (ArduCopter's mode_systemid)."""


@dataclass(frozen=True)
class Excitation:
    """How an input moves.

    Attributes
    ----------
    name : str
    rate_hz : float
    std : float
        Of full travel 1.
    band_hz : (float, float) or None
        That holds all but a twentieth of its power at either end.
    moves : bool
    swept : bool
        The log itself says that it was excited from outside.
    """

    name: str
    rate_hz: float
    std: float
    band_hz: tuple[float, float] | None
    moves: bool
    swept: bool


@dataclass(frozen=True)
class InputAnswer:
    """An output's answer to an input.

    Attributes
    ----------
    output, input : str
    part : Part
    verdict : LogVerdict
    cause : Cause or None
    usable_hz : (float, float) or None
        Longest stretch with a partial coherence of 0.6 and a random error of at most 0.2.
    coherence : float or None
        Largest partial coherence.
    """

    output: str
    input: str
    part: Part
    verdict: LogVerdict
    cause: Cause | None
    usable_hz: tuple[float, float] | None = None
    coherence: float | None = None


@dataclass(frozen=True)
class Kinematics:
    """An angle beside what the rates make of it, from 0.15 to 4 Hz.

    Attributes
    ----------
    angle : str
    scale : float
        Measured over integrated; 1 where units and signs are right.
    lag_s : float
        How much later the angle is.
    unexplained : float
        Share of the angle's power that the rates do not make, scale and lag aside.
    """

    angle: str
    scale: float
    lag_s: float
    unexplained: float


@dataclass(frozen=True)
class Vibration:
    """What a signal holds above 10 Hz.

    Attributes
    ----------
    name : str
    rms : float
        In the signal's unit.
    upto_hz : float
        Half of the logging rate.
    peaks_hz : tuple of float
        Narrow lines, the strongest first.
    """

    name: str
    rms: float
    upto_hz: float
    peaks_hz: tuple[float, ...]


@dataclass(frozen=True)
class PartVerdict:
    """Whether a part of the model can be identified."""

    part: Part
    verdict: LogVerdict
    cause: Cause | None


@dataclass(frozen=True)
class LogInfo:
    """All that is said of a log.

    Attributes
    ----------
    log : FlightLog
    length_s : float
    inputs : tuple of Excitation
    answers : tuple of InputAnswer
    parts : tuple of PartVerdict
    kinematics : tuple of Kinematics
    vibration : tuple of Vibration
    response : JointResponse or None
        Of `outputs` to `columns`, where there is one.
    outputs, columns : tuple of str
    """

    log: FlightLog
    length_s: float
    inputs: tuple[Excitation, ...]
    answers: tuple[InputAnswer, ...]
    parts: tuple[PartVerdict, ...]
    kinematics: tuple[Kinematics, ...]
    vibration: tuple[Vibration, ...]
    response: JointResponse | None
    outputs: tuple[str, ...]
    columns: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        log = self.log
        return {
            "schema": SCHEMA, "path": log.path, "format": log.format,
            "size_bytes": log.size_bytes, "length_s": self.length_s,
            "skipped_bytes": log.skipped_bytes, "dropped_s": log.dropped_s, "cut": log.cut,
            "left_out": dict(log.left_out),
            "messages": [asdict(m) for m in log.messages],
            "signals": [
                {"name": s.name, "unit": SIGNALS[s.name].unit, "group": SIGNALS[s.name].group.value,
                 "source": s.source, "samples": int(s.value.size), "rate_hz": s.rate_hz}
                for s in log.signals.values()
            ],
            "sweeps": [asdict(s) for s in log.sweeps],
            "inputs": [asdict(i) for i in self.inputs],
            "referenced": self.response is not None and self.response.instrumented,
            "answers": [_plain(a) for a in self.answers],
            "parts": [_plain(p) for p in self.parts],
            "kinematics": [asdict(k) for k in self.kinematics],
            "vibration": [asdict(v) for v in self.vibration],
        }  # fmt: skip


def _plain(row: Any) -> dict[str, Any]:
    return {k: v.name if isinstance(v, Enum) else v for k, v in asdict(row).items()}


# -------------------------------------------------------------------------------------------------
# Onto one grid of times.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Grid:
    """Some signals at the same times.

    Attributes
    ----------
    time_s : (N,) array
    dt_s : float
    runs : list of (int, int)
        First sample and the one behind the last of each piece without a gap.
    columns : dict of str to (N,) array
    """

    time_s: Array
    dt_s: float
    runs: list[tuple[int, int]]
    columns: dict[str, Array]


def on_grid(signals: Sequence[LoggedSignal], rate_hz: float = 0.0) -> Grid:
    """Signals at one rate, 0: that of the slowest, filtered before they are thinned."""
    rate = rate_hz or min(_MOST_RATE_HZ, *(s.rate_hz for s in signals))
    start = max(float(s.time_s[0]) for s in signals)
    stop = min(float(s.time_s[-1]) for s in signals)
    time_s = np.arange(start, max(stop, start) + 1e-9, 1.0 / rate)
    columns, whole = {}, np.ones(time_s.size, bool)
    for s in signals:
        value = s.value
        if s.rate_hz > 1.5 * rate and value.size > 60:
            sos = filters.butter(4, 0.4 * rate, fs=s.rate_hz, output="sos")
            value = filters.sosfiltfilt(sos, value)
        columns[s.name] = np.interp(time_s, s.time_s, value)
        late = np.flatnonzero(np.diff(s.time_s) > GAP / s.rate_hz)
        for k in late:
            whole[
                np.searchsorted(time_s, s.time_s[k]) : np.searchsorted(time_s, s.time_s[k + 1])
            ] = 0
    edges = np.flatnonzero(np.diff(np.concatenate([[0], whole.astype(np.int8), [0]])))
    runs = [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return Grid(time_s, 1.0 / rate, runs, columns)


# -------------------------------------------------------------------------------------------------
# What is said.
# -------------------------------------------------------------------------------------------------


def cropped(log: FlightLog, start_s: float | None, end_s: float | None) -> FlightLog:
    """The log from one time to another, s since its first row; raises LogError if none is left."""
    first = -np.inf if start_s is None else start_s
    last = np.inf if end_s is None else end_s
    kept = {}
    for name, s in log.signals.items():
        inside = (s.time_s >= first) & (s.time_s <= last)
        if inside.sum() > 1:
            kept[name] = replace(s, time_s=s.time_s[inside], value=s.value[inside])
    if not kept:
        raise LogError(LogCause.EMPTY, f"{log.path}: holds nothing from {first:g} to {last:g} s")
    return replace(log, signals=kept)


def info_of(log: FlightLog) -> LogInfo:
    """Judge a log."""
    signals = log.signals
    prefix = "d_" if any(f"d_{axis}" in signals for axis in _AXES) else "stick_"
    swept = {f"{prefix}{_SWEPT[s.axis]}" for s in log.sweeps if s.axis in _SWEPT}
    named = [f"{prefix}{axis}" for axis in _AXES]
    inputs = tuple(excitation(signals[name], name in swept) for name in named if name in signals)
    used = [i.name for i in inputs if i.moves and i.rate_hz >= LEAST_RATE_HZ]
    outputs = [n for n in ("p", "q", "r", "az") if n in signals
               and signals[n].rate_hz >= LEAST_RATE_HZ]  # fmt: skip
    response, refused = _response(log, used, outputs, swept)
    answers = tuple(
        _answer(pair, prefix, signals, inputs, response, refused, outputs, used) for pair in PAIRS
    )
    ends = [s.time_s[[0, -1]] for s in signals.values()]
    turning, shaking = kinematics_of(signals), vibration_of(signals)
    return LogInfo(
        log=log,
        length_s=float(max(e[1] for e in ends) - min(e[0] for e in ends)),
        inputs=inputs,
        answers=answers,
        parts=_parts(answers, signals, turning, shaking),
        kinematics=turning,
        vibration=shaking,
        response=response,
        outputs=tuple(outputs),
        columns=tuple(used),
    )


def excitation(signal: LoggedSignal, swept: bool = False) -> Excitation:
    """How an input moves."""
    grid = on_grid([signal])
    x = grid.columns[signal.name]
    std = float(x.std()) if x.size else 0.0
    band = None
    if std > _MOVES and x.size >= 64:
        hertz, power = filters.welch(
            x, 1.0 / grid.dt_s, nperseg=min(x.size, 4096), detrend="linear"
        )
        share = np.cumsum(power[1:]) / max(power[1:].sum(), 1e-300)
        ends = [float(hertz[1:][min(int(np.searchsorted(share, at)), share.size - 1)])
                for at in (0.05, 0.95)]  # fmt: skip
        band = ends[0], ends[1]
    return Excitation(signal.name, signal.rate_hz, std, band, std > _MOVES, swept)


def references_of(log: FlightLog, used: Sequence[str], grid: Grid) -> Array | None:
    """The chirp that was added to each input (N, m), if the log has one for each."""
    if "chirp" not in grid.columns:
        return None
    starts = np.array([s.time_s for s in log.sweeps])
    last = np.searchsorted(starts, grid.time_s, side="right") - 1
    names = [_SWEPT.get(s.axis, "") for s in log.sweeps]
    columns = [
        np.where([k >= 0 and names[k] == name.rpartition("_")[2] for k in last],
                 grid.columns["chirp"], 0.0)
        for name in used
    ]  # fmt: skip
    return np.column_stack(columns) if all(np.ptp(c) > 0.0 for c in columns) else None


def _response(
    log: FlightLog, used: Sequence[str], outputs: Sequence[str], swept: set[str]
) -> tuple[JointResponse | None, Cause | None]:
    if not used or not outputs:
        return None, None
    names = [*used, *outputs]
    if set(used) <= swept and "chirp" in log.signals:
        names.append("chirp")
    grid = on_grid([log.signals[name] for name in names])
    u, y = (np.column_stack([grid.columns[n] for n in part]) for part in (used, outputs))
    try:
        return (
            joint_response(u, y, grid.dt_s, references_of(log, used, grid), grid.runs),
            None,
        )
    except IdentificationError as error:
        still = error.cause is IdentificationCause.NO_EXCITATION
        return None, Cause.NOT_EXCITED if still else Cause.TOO_SHORT


def _answer(
    pair: Pair,
    prefix: str,
    signals: Any,
    inputs: Sequence[Excitation],
    response: JointResponse | None,
    refused: Cause | None,
    outputs: Sequence[str],
    used: Sequence[str],
) -> InputAnswer:
    name = f"{prefix}{pair.input}"
    moved = next((i for i in inputs if i.name == name), None)
    cause = None
    if moved is None:
        cause = Cause.NO_INPUT
    elif pair.output not in signals:
        cause = Cause.NO_OUTPUT
    elif pair.output not in outputs or moved.rate_hz < LEAST_RATE_HZ:
        cause = Cause.LOW_RATE
    elif not moved.moves:
        cause = Cause.NOT_EXCITED
    elif response is None:
        cause = refused or Cause.TOO_SHORT
    if cause is not None or response is None:
        return InputAnswer(pair.output, name, pair.part, LogVerdict.NO, cause)
    k, m = outputs.index(pair.output), used.index(name)
    hertz = response.omega_radps / (2.0 * np.pi)
    band = _longest(response.usable(k, m), hertz)
    best = float(response.partial_coherence[:, k, m].max())
    width = band[1] / band[0] if band else 0.0
    if width >= _ALL:
        verdict, cause = LogVerdict.YES, None
    elif width >= _SOME:
        verdict, cause = LogVerdict.PARTLY, Cause.NARROW
    else:
        together = float(np.median(response.input_coherence[:, m])) > _TOGETHER
        verdict, cause = LogVerdict.NO, Cause.TOGETHER if together else Cause.LOW_COHERENCE
    return InputAnswer(pair.output, name, pair.part, verdict, cause, band, best)


def _longest(mask: np.ndarray, hertz: Array) -> tuple[float, float] | None:
    """Ends of the widest stretch of lines, single misses within it allowed."""
    at = np.flatnonzero(mask)
    if not at.size:
        return None
    pieces = np.split(at, np.flatnonzero(np.diff(at) > 2) + 1)
    widest = max(pieces, key=lambda p: hertz[p[-1]] / hertz[p[0]])
    return float(hertz[widest[0]]), float(hertz[widest[-1]])


def kinematics_of(signals: Any) -> tuple[Kinematics, ...]:
    """Each angle beside the integral of what the rates make of it."""
    if not {"p", "q", "r", "phi", "theta"} <= set(signals):
        return ()
    angles = [name for name in ("phi", "theta", "psi") if name in signals]
    grid = on_grid([signals[name] for name in ("p", "q", "r", *angles)])
    rate = 1.0 / grid.dt_s
    if rate < LEAST_RATE_HZ or grid.time_s.size * grid.dt_s < 2.0 / _KINEMATIC_HZ[0]:
        return ()
    p, q, r, phi, theta = (grid.columns[n] for n in ("p", "q", "r", "phi", "theta"))
    sideways = q * np.sin(phi) + r * np.cos(phi)
    made = {"phi": p + sideways * np.tan(theta), "theta": q * np.cos(phi) - r * np.sin(phi),
            "psi": sideways / np.cos(theta)}  # fmt: skip
    band = filters.butter(2, (_KINEMATIC_HZ[0], min(_KINEMATIC_HZ[1], 0.4 * rate)), "bandpass",
                          fs=rate, output="sos")  # fmt: skip
    found = []
    for angle in angles:
        measured = filters.sosfiltfilt(band, grid.columns[angle])
        rate_radps = filters.detrend(made[angle], type="constant")
        integral = cumulative_trapezoid(rate_radps, dx=grid.dt_s, initial=0.0)
        integral = filters.sosfiltfilt(band, integral)
        found.append(_beside(angle, grid.time_s, measured, integral))
    return tuple(found)


def _beside(angle: str, time_s: Array, measured: Array, made: Array) -> Kinematics:
    """Scale and lag of one with the other, lag by the best of a millisecond's steps."""
    best = (np.inf, 0.0, 0.0)
    power = max(float(measured @ measured), 1e-300)
    for lag_s in np.arange(-_LONGEST_LAG_S, _LONGEST_LAG_S + 1e-9, 2e-3):
        late = np.interp(time_s - lag_s, time_s, made)
        scale = float(late @ measured) / max(float(late @ late), 1e-300)
        left = float(np.sum((measured - scale * late) ** 2)) / power
        best = min(best, (left, scale, float(lag_s)))
    return Kinematics(angle, best[1], best[2], best[0])


def vibration_of(signals: Any) -> tuple[Vibration, ...]:
    """What rates and specific forces hold above 10 Hz, where they are logged often enough."""
    found = []
    for name in ("p", "q", "r", "ax", "ay", "az"):
        if name not in signals or signals[name].rate_hz < 4.0 * _OSCILLATES_HZ:
            continue
        grid = on_grid([signals[name]])
        rate, x = 1.0 / grid.dt_s, grid.columns[name]
        if x.size < 1024:
            continue
        size = min(x.size // _PIECES, 2048)
        hertz, power = filters.welch(x, rate, nperseg=size, detrend="linear")
        high = hertz >= _OSCILLATES_HZ
        rms = float(np.sqrt(np.sum(power[high]) * (hertz[1] - hertz[0])))
        level = 10.0 * np.log10(np.maximum(power, 1e-300))
        step = float(hertz[1])
        around = filters.medfilt(level, 2 * round(0.5 * _AROUND_HZ / step) + 1)
        apart = max(1, round(_APART_HZ / step))
        tops, _ = filters.find_peaks(level - around, height=_PEAK, distance=apart)
        tops = tops[high[tops]]
        strongest = tops[np.argsort(-power[tops], kind="stable")][:_PEAKS]
        found.append(Vibration(name, rms, 0.5 * rate, tuple(float(h) for h in hertz[strongest])))
    return tuple(found)


def _parts(
    answers: Sequence[InputAnswer],
    signals: Any,
    turning: Sequence[Kinematics],
    shaking: Sequence[Vibration],
) -> tuple[PartVerdict, ...]:
    order = list(LogVerdict)
    found = []
    for part in Part:
        own = [a for a in answers if a.part is part]
        if own:
            worst = max(own, key=lambda a: order.index(a.verdict))
            found.append(PartVerdict(part, worst.verdict, worst.cause))
    has_all = {"p", "q", "r", "phi", "theta"} <= set(signals)
    kinematic = LogVerdict.YES if turning else LogVerdict.NO
    why = None if turning else Cause.TOO_SHORT if has_all else Cause.NO_OUTPUT
    found.insert(0, PartVerdict(Part.KINEMATICS, kinematic, why))
    measured = {"p", "q", "r", "ax", "ay", "az"} & set(signals)
    often = [name for name in measured if signals[name].rate_hz >= 4.0 * _OSCILLATES_HZ]
    cause = None
    if not shaking:
        cause = Cause.TOO_SHORT if often else Cause.LOW_RATE if measured else Cause.NO_OUTPUT
    found.append(PartVerdict(Part.VIBRATION, LogVerdict.YES if shaking else LogVerdict.NO, cause))
    found.append(PartVerdict(Part.GUSTS, LogVerdict.NO, Cause.NO_AIR))
    return tuple(found)
