# SPDX-License-Identifier: Apache-2.0
"""A manoeuvre in a flight against the table of its bounds."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from heli_analysis.handling.definitions import (
    FULL_SCALE,
    Criterion,
    EntryCondition,
    Manoeuvre,
    Scale,
    manoeuvre,
)
from heli_analysis.handling.manoeuvres import (
    Array,
    FlownManoeuvre,
    MotionTrack,
    depart_abort,
    hover,
    lateral_reposition,
    pirouette,
    runs,
    slalom,
    vertical,
)
from heli_core.coverage import Coverage, Span, coverage_of, period_of
from heli_core.errors import HandlingCause, HandlingError

# -------------------------------------------------------------------------------------------------
# Scoring.
# -------------------------------------------------------------------------------------------------

SCHEMA = 1
"""Number of the layout of `ManoeuvreScore.as_dict`; grows when a key changes or goes."""

_FINDERS: dict[str, Callable[[MotionTrack, Manoeuvre, Array | None, float], FlownManoeuvre]] = {
    "hover": hover,
    "vertical": vertical,
    "pirouette": pirouette,
    "slalom": slalom,
    "lateral-reposition": lateral_reposition,
    "depart-abort": depart_abort,
}


class HandlingLevel(Enum):
    """How well: in this order."""

    DESIRED = "desired"
    ADEQUATE = "adequate"
    NEITHER = "neither"


_ORDER = list(HandlingLevel)


@dataclass(frozen=True)
class CriterionResult:
    """A criterion as it was flown; value None: its phase was not flown.

    Attributes
    ----------
    criterion : Criterion
    value : float or None
        Of the worst moment, SI; angles in degrees.
    at_s : float or None
        The worst moment.
    """

    criterion: Criterion
    value: float | None
    at_s: float | None

    def margin(self, bound: float) -> float | None:
        """How far inside of a bound, in its unit; negative outside."""
        if self.value is None:
            return None
        return self.value - bound if self.criterion.at_least else bound - self.value

    @property
    def level(self) -> HandlingLevel | None:
        """On a bound is inside."""
        if self.value is None:
            return None
        bounds = {
            HandlingLevel.DESIRED: self.criterion.desired,
            HandlingLevel.ADEQUATE: self.criterion.adequate,
        }
        for level, bound in bounds.items():
            margin = self.margin(bound)
            if margin is not None and margin >= 0.0:
                return level
        return HandlingLevel.NEITHER

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        c, level = self.criterion, self.level
        return {
            "name": c.name,
            "text": c.text,
            "unit": c.quantity.value,
            "bound": "at least" if c.at_least else "at most",
            "desired": c.desired,
            "adequate": c.adequate,
            "value": self.value,
            "level": None if level is None else level.value,
            "margin_desired": self.margin(c.desired),
            "margin_adequate": self.margin(c.adequate),
            "worst_at_s": self.at_s,
        }


@dataclass(frozen=True)
class ConditionResult:
    """A condition as it was flown; value None: it was not."""

    condition: EntryCondition
    value: float | None

    @property
    def met(self) -> bool:
        """Whether the value is inside of the range."""
        return self.value is not None and self.condition.low <= self.value <= self.condition.high


@dataclass(frozen=True)
class ManoeuvreScore:
    """A manoeuvre, scored.

    Attributes
    ----------
    table : Manoeuvre
        At the scale.
    scale : Scale
    manoeuvre : FlownManoeuvre
    results : tuple of CriterionResult
        In the table's order.
    conditions : tuple of ConditionResult
    coverage : Coverage
        What of the stretch that was searched is in the track.
    """

    table: Manoeuvre
    scale: Scale
    manoeuvre: FlownManoeuvre
    results: tuple[CriterionResult, ...]
    conditions: tuple[ConditionResult, ...]
    coverage: Coverage = Coverage()

    @property
    def level(self) -> HandlingLevel:
        """The worst of what was flown."""
        return max((r.level for r in self.results if r.level is not None), key=_ORDER.index)

    @property
    def complete(self) -> bool:
        """Whether every criterion was flown and every condition met."""
        flown = all(r.value is not None for r in self.results)
        return flown and all(c.met for c in self.conditions)

    @property
    def passed(self) -> bool:
        """Whether it is desired or adequate, flown as defined, and all of it is in the track."""
        return self.level is not HandlingLevel.NEITHER and self.complete and self.coverage.is_whole

    def as_dict(self) -> dict[str, Any]:
        """For JSON; the layout is `SCHEMA`."""
        return {
            "schema": SCHEMA,
            "manoeuvre": self.table.name,
            "source": f"ADS-33E-PRF {self.table.paragraph} {self.table.title}",
            "scale": {"name": self.scale.name, "length_ratio": self.scale.ratio},
            "level": self.level.value,
            "complete": self.complete,
            "coverage": self.coverage.as_dict(),
            "partial": self.coverage.sentence,
            "phases": [vars(phase) for phase in self.manoeuvre.phases],
            "criteria": [result.as_dict() for result in self.results],
            "conditions": [
                {
                    "name": c.condition.name,
                    "text": c.condition.text,
                    "unit": c.condition.quantity.value,
                    "low": c.condition.low,
                    "high": c.condition.high,
                    "value": c.value,
                    "met": c.met,
                }
                for c in self.conditions
            ],
            "remarks": list(self.manoeuvre.remarks),
        }


def score(
    track: MotionTrack,
    name: str,
    scale: Scale = FULL_SCALE,
    target_ned_m: Array | None = None,
    ground_m: float = 0.0,
    asked_s: Span | None = None,
) -> ManoeuvreScore:
    """Score a manoeuvre.

    Parameters
    ----------
    track : MotionTrack
    name : str
        Of `MANOEUVRES`.
    scale : Scale
        `FULL_SCALE` or `froude(...)`.
    target_ned_m : (3,) array, optional
        Hover point, end of the course or centre of the circle; default: from the flight itself.
    ground_m : float
        Height of the ground in the track's frame, m.
    asked_s : (float, float), optional
        Begin and end, s, of what should be in the track; default: from its first sample to its
        last.

    Raises
    ------
    HandlingError
        UNKNOWN, TOO_SHORT, NO_PHASES.
    """
    table = manoeuvre(name, scale)
    flown_manoeuvre = _FINDERS[name](track, table, target_ned_m, ground_m)
    results = []
    for criterion in table.criteria:
        value: tuple[float | None, float | None] = (None, None)
        if criterion.name in flown_manoeuvre.traces:
            value = flown_manoeuvre.traces[criterion.name].worst(criterion.at_least)
        elif criterion.name in flown_manoeuvre.numbers:
            value = flown_manoeuvre.numbers[criterion.name]
        results.append(CriterionResult(criterion, *value))
    conditions = tuple(
        ConditionResult(c, flown_manoeuvre.conditions.get(c.name)) for c in table.conditions
    )
    held = _held(track.time_s, asked_s)
    return ManoeuvreScore(table, scale, flown_manoeuvre, tuple(results), conditions, held)


def _held(time_s: Array, asked_s: Span | None) -> Coverage:
    """What of a stretch is in samples (N,), s; of None: of that from the first to the last."""
    span = (float(time_s[0]), float(time_s[-1])) if asked_s is None else asked_s
    return coverage_of(time_s, [span], period_of(time_s))


# -------------------------------------------------------------------------------------------------
# Frequency response of a flight, bandwidth and phase delay, rejection of disturbances.
#
# Sources: ADS-33E-PRF 3.3.2.1 (bandwidth and phase delay); Blanken, Tischler et al. (disturbance
# rejection); Tischler, Remple, Aircraft and Rotorcraft System Identification, 2nd ed. (AIAA 2012):
# windows, and 0.6 as the least coherence.
# -------------------------------------------------------------------------------------------------

LEAST_COHERENCE = 0.6
_WINDOWS = 5  # in a record
_OVERLAP = 0.75
_LEAST_SAMPLES = 200
_EXCITED = 1e-4  # of the input's largest spectral density: below, nothing was put in
_LEAST_LINES = 4


@dataclass(frozen=True)
class FrequencyResponse:
    """A response where it is known: coherent lines only.

    Attributes
    ----------
    omega_radps : (L,) array
    response : (L,) complex array
    coherence : (L,) array
    coverage : Coverage
        What of the stretch that it was worked out from is recorded.
    """

    omega_radps: Array
    response: NDArray[np.complex128]
    coherence: Array
    coverage: Coverage = Coverage()

    @property
    def gain_db(self) -> Array:
        """Gain (L,), dB."""
        return np.asarray(20.0 * np.log10(np.abs(self.response)))

    @property
    def phase_deg(self) -> Array:
        """Phase (L,), without jumps, within half a turn of zero at the lowest line."""
        return np.degrees(np.unwrap(np.angle(self.response)))


@dataclass(frozen=True)
class Bandwidth:
    """Bandwidth of an attitude's response to its command; None where the data do not reach.

    Attributes
    ----------
    phase_radps : float or None
        45 deg before -180 deg.
    gain_radps : float or None
        6 dB before the gain at -180 deg.
    neutral_radps : float or None
        Where the phase is -180 deg.
    phase_delay_s : float or None
        Slope of the phase from there to twice this frequency.
    """

    phase_radps: float | None
    gain_radps: float | None
    neutral_radps: float | None
    phase_delay_s: float | None


@dataclass(frozen=True)
class Rejection:
    """Disturbance rejection: bandwidth at -3 dB (None: not reached), peak and where it is."""

    bandwidth_radps: float | None
    peak_db: float
    peak_radps: float


def resampled(time_s: Array, values: Array, at_s: Array) -> Array:
    """Values of a signal at other times, by straight lines."""
    order = np.argsort(time_s, kind="stable")
    return np.interp(at_s, time_s[order], values[order])


def frequency_response(
    time_s: Array,
    excitation: Array,
    answer: Array,
    window_s: float | None = None,
    asked_s: Span | None = None,
) -> FrequencyResponse:
    """Response of `answer` to `excitation`, by Welch's spectra with Hann windows.

    Parameters
    ----------
    time_s : (N,) array
        Equally far apart.
    excitation, answer : (N,) array
    window_s : float, optional
        Default: a fifth of the record. Longer ones reach lower frequencies with more scatter.
    asked_s : (float, float), optional
        As of `score`.

    Raises
    ------
    HandlingError
        NOT_FINITE, TOO_SHORT, NO_EXCITATION, LOW_COHERENCE.
    """
    n = time_s.size
    if n < _LEAST_SAMPLES:
        raise HandlingError(
            HandlingCause.TOO_SHORT,
            f"{n} samples of the response, at least {_LEAST_SAMPLES} are needed",
        )
    if not (np.isfinite(excitation).all() and np.isfinite(answer).all()):
        raise HandlingError(HandlingCause.NOT_FINITE, "a signal holds a value that is not finite")
    if np.ptp(excitation) <= 1e-9:
        raise HandlingError(
            HandlingCause.NO_EXCITATION, "the input does not move, so nothing answers it"
        )
    rate = (n - 1) / float(time_s[-1] - time_s[0])
    size = n // _WINDOWS if window_s is None else min(round(window_s * rate), n)
    if size < _LEAST_SAMPLES // _WINDOWS:
        raise HandlingError(
            HandlingCause.TOO_SHORT,
            f"a window of {size} samples, {_LEAST_SAMPLES // _WINDOWS} are needed",
        )
    options = {"fs": rate, "nperseg": size, "noverlap": int(_OVERLAP * size), "detrend": "linear"}
    hertz, power = signal.welch(excitation, **options)
    _, answered = signal.welch(answer, **options)
    _, cross = signal.csd(excitation, answer, **options)
    asked = power > _EXCITED * power.max()
    asked[:2] = False  # what the window makes of the mean
    with np.errstate(divide="ignore", invalid="ignore"):
        coherence = np.abs(cross) ** 2 / (power * answered)
    known = asked & (coherence >= LEAST_COHERENCE)
    # One piece: the phase is unwrapped along it.
    pieces = np.split(np.flatnonzero(known), np.flatnonzero(np.diff(np.flatnonzero(known)) > 2) + 1)
    longest = max(pieces, key=len)
    if longest.size < _LEAST_LINES:
        best = float(np.nanmax(np.where(asked, coherence, 0.0)))
        raise HandlingError(
            HandlingCause.LOW_COHERENCE,
            f"{longest.size} lines in a row with a coherence of {LEAST_COHERENCE:g}, at least "
            f"{_LEAST_LINES} are needed; the largest is {best:.2f}",
        )
    return FrequencyResponse(
        2.0 * np.pi * hertz[longest],
        cross[longest] / power[longest],
        coherence[longest],
        _held(time_s, asked_s),
    )


def bandwidth(response: FrequencyResponse) -> Bandwidth:
    """Bandwidths and phase delay of an attitude's response."""
    omega, phase = response.omega_radps, response.phase_deg
    by_phase, neutral = _falls_to(omega, phase, -135.0), _falls_to(omega, phase, -180.0)
    if neutral is None:
        return Bandwidth(by_phase, None, None, None)
    below = omega <= neutral
    level_db = float(np.interp(neutral, omega, response.gain_db)) + 6.0
    by_gain = _falls_to(omega[below][::-1], -response.gain_db[below][::-1], -level_db)
    twice = 2.0 * neutral
    delay = None
    if twice <= omega[-1]:
        beyond = -180.0 - float(np.interp(twice, omega, phase))
        delay = float(np.radians(beyond) / twice)
    return Bandwidth(by_phase, by_gain, neutral, delay)


def rejection(response: FrequencyResponse) -> Rejection:
    """Of the response of attitude with its disturbance to the disturbance (sensitivity)."""
    gain = response.gain_db
    peak = int(np.argmax(gain))
    risen = np.flatnonzero(gain > -3.0)
    bandwidth_radps = None
    if risen.size and risen[0] > 0:
        at = slice(risen[0] - 1, risen[0] + 1)
        bandwidth_radps = float(np.interp(-3.0, gain[at], response.omega_radps[at]))
    return Rejection(bandwidth_radps, float(gain[peak]), float(response.omega_radps[peak]))


def _falls_to(x: Array, y: Array, level: float) -> float | None:
    """First x at which y, coming from above, is at the level; None if it is never."""
    under = np.flatnonzero(y <= level)
    if not under.size or under[0] == 0:
        return None
    k = int(under[0])
    return float(x[k - 1] + (x[k] - x[k - 1]) * (y[k - 1] - level) / (y[k - 1] - y[k]))


# -------------------------------------------------------------------------------------------------
# Attitude quickness: peak rate over peak change, of each change from a steady attitude.
#
# Source: ADS-33E-PRF 3.3.3 (pitch, roll), 3.3.6 (yaw). Its boundaries are curves over the smallest
# change after the peak; they are not in here, so no level is given.
# -------------------------------------------------------------------------------------------------

LEAST_CHANGE_DEG = 5.0
_STEADY = 0.1  # of the peak rate
_STEADY_FOR_S = 0.2
_STEADY_SHARE = 0.2  # of the change's own duration: a sine is never steady for so long


@dataclass(frozen=True)
class AttitudeChange:
    """One change of attitude.

    Attributes
    ----------
    start_s, peak_s : float
        When it begins, and when the attitude is furthest.
    peak_deg, least_deg : float
        Largest change, and the smallest after it (before the attitude goes on).
    rate_radps : float
        Peak rate.
    """

    start_s: float
    peak_s: float
    peak_deg: float
    least_deg: float
    rate_radps: float

    @property
    def quickness_per_s(self) -> float:
        """Peak rate over peak change."""
        return float(self.rate_radps / np.radians(self.peak_deg))

    def as_dict(self) -> dict[str, float]:
        """For JSON."""
        return {
            "start_s": self.start_s,
            "peak_s": self.peak_s,
            "peak_deg": self.peak_deg,
            "least_deg": self.least_deg,
            "rate_radps": self.rate_radps,
            "quickness_per_s": self.quickness_per_s,
        }


def changes(time_s: Array, angle_rad: Array) -> list[AttitudeChange]:
    """Changes of at least 5 deg from a steady attitude; sizes are magnitudes."""
    rate = np.gradient(angle_rad, time_s)
    attitude_changes = []
    for sign in (1.0, -1.0):
        for a, b in runs(sign * rate > 0.0):
            top = float(sign * (angle_rad[b] - angle_rad[a]))
            peak_rate = float((sign * rate[a : b + 1]).max())
            if np.degrees(top) < LEAST_CHANGE_DEG or b == time_s.size - 1:
                continue
            moving = np.flatnonzero(sign * rate[a : b + 1] > _STEADY * peak_rate)
            begin = a + int(moving[0])
            steady_s = max(_STEADY_FOR_S, _STEADY_SHARE * float(time_s[b] - time_s[begin]))
            since = float(time_s[begin]) - steady_s
            before = (time_s < time_s[begin]) & (time_s >= since)
            # What is not recorded was not steady.
            if since < time_s[0] or not before.any():
                continue
            if np.abs(rate[before]).max() > _STEADY * peak_rate:
                continue
            back = np.flatnonzero(sign * rate[b + 1 :] > 0.0)
            end = b + 1 + int(back[0]) if back.size else time_s.size
            first = float(angle_rad[a])
            peak = float(np.degrees((sign * (angle_rad[a : b + 2] - first)).max()))
            least = float(np.degrees((sign * (angle_rad[b:end] - first)).min()))
            attitude_changes.append(
                AttitudeChange(float(time_s[begin]), float(time_s[b]), peak, least, peak_rate)
            )
    return sorted(attitude_changes, key=lambda change: change.start_s)


# -------------------------------------------------------------------------------------------------
# Levels of responses: the published boundaries, as far as they are numbers.
#
# ADS-33E-PRF 3.3.2.1 and 3.3.5.1, all other mission task elements, UCE = 1 and fully attended: the
# upright part of the boundaries only, which holds for small phase delays. Disturbance rejection:
# Blanken, Tischler et al., proposed revisions to ADS-33E-PRF (2008 on), Level 1 only.
# **As recalled, as the bounds of the manoeuvres are** (`definitions`).
# -------------------------------------------------------------------------------------------------

AXES = ("roll", "pitch", "yaw")
_BANDWIDTH = {"roll": (1.0, 0.5), "pitch": (1.0, 0.5), "yaw": (2.0, 0.5)}
_REJECTION = {"roll": 0.9, "pitch": 0.5, "yaw": 0.7}
_PEAK_DB = 5.0
_UPRIGHT_S = 0.15
"""Up to this phase delay the boundaries of the bandwidth are upright, as far as is recalled."""


@dataclass(frozen=True)
class Measure:
    """A number of a response against its boundary.

    Attributes
    ----------
    name, text, unit : str
    value : float or None
        None: the data do not reach.
    level1, level2 : float or None
        Bounds; None where none is published as a number, or none applies.
    at_least : bool
        The bounds are the smallest values.
    """

    name: str
    text: str
    unit: str
    value: float | None
    level1: float | None = None
    level2: float | None = None
    at_least: bool = True

    @property
    def level(self) -> str | None:
        """`Level 1`, `Level 2` or `below`; None without value or bound. On a bound is inside."""
        if self.value is None or self.level1 is None:
            return None
        sign = 1.0 if self.at_least else -1.0
        for name, bound in (("Level 1", self.level1), ("Level 2", self.level2)):
            if bound is not None and sign * self.value >= sign * bound:
                return name
        return "below"

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {
            "name": self.name,
            "text": self.text,
            "unit": self.unit,
            "bound": "at least" if self.at_least else "at most",
            "value": self.value,
            "level_1": self.level1,
            "level_2": self.level2,
            "level": self.level,
        }


def check_axis(axis: str) -> None:
    """Refuse an unknown axis (HandlingError, UNKNOWN)."""
    if axis not in AXES:
        raise HandlingError(HandlingCause.UNKNOWN, f"axis {axis!r} is none of {', '.join(AXES)}")


def of_bandwidth(bandwidths: Bandwidth, axis: str, scale: Scale = FULL_SCALE) -> list[Measure]:
    """Bandwidth by phase (attitude command), by gain, and phase delay.

    Frequencies grow with the inverse root of the scale's ratio.
    """
    check_axis(axis)
    root = scale.ratio**0.5
    upright = bandwidths.phase_delay_s is not None and bandwidths.phase_delay_s <= _UPRIGHT_S * root
    level1, level2 = (b / root if upright else None for b in _BANDWIDTH[axis])
    text = "bandwidth, attitude command (45 deg of phase margin)"
    return [
        Measure("bandwidth", text, "rad/s", bandwidths.phase_radps, level1, level2),
        Measure(
            "gain_bandwidth", "frequency of 6 dB of gain margin", "rad/s", bandwidths.gain_radps
        ),
        Measure("neutral", "frequency of -180 deg", "rad/s", bandwidths.neutral_radps),
        Measure("phase_delay", "phase delay", "s", bandwidths.phase_delay_s, at_least=False),
    ]


def of_rejection(
    disturbance_rejection: Rejection, axis: str, scale: Scale = FULL_SCALE
) -> list[Measure]:
    """Disturbance-rejection bandwidth and peak."""
    check_axis(axis)
    least = _REJECTION[axis] / scale.ratio**0.5
    text = "disturbance-rejection bandwidth (-3 dB)"
    return [
        Measure("drb", text, "rad/s", disturbance_rejection.bandwidth_radps, least),
        Measure(
            "drp",
            "disturbance-rejection peak",
            "dB",
            disturbance_rejection.peak_db,
            _PEAK_DB,
            at_least=False,
        ),
        Measure("peak", "frequency of this peak", "rad/s", disturbance_rejection.peak_radps),
    ]
