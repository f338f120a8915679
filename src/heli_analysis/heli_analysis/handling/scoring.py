# SPDX-License-Identifier: Apache-2.0
"""Frequency response of a flight, bandwidth and phase delay, rejection of disturbances.

Sources: ADS-33E-PRF 3.3.2.1 (bandwidth and phase delay); Blanken, Tischler et al. (disturbance
rejection); Tischler, Remple, Aircraft and Rotorcraft System Identification, 2nd ed. (AIAA 2012):
windows, and 0.6 as the least coherence.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from heli_handling.errors import Cause, HandlingError
from heli_handling.tracks import Array

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
    """

    omega_radps: Array
    response: NDArray[np.complex128]
    coherence: Array

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
    time_s: Array, given: Array, answer: Array, window_s: float | None = None
) -> FrequencyResponse:
    """Response of `answer` to `given`, by Welch's spectra with Hann windows.

    Parameters
    ----------
    time_s : (N,) array
        Equally far apart.
    given, answer : (N,) array
    window_s : float, optional
        Default: a fifth of the record. Longer ones reach lower frequencies with more scatter.

    Raises
    ------
    HandlingError
        NOT_FINITE, TOO_SHORT, NO_EXCITATION, LOW_COHERENCE.
    """
    n = time_s.size
    if n < _LEAST_SAMPLES:
        raise HandlingError(
            Cause.TOO_SHORT, f"{n} samples of the response, at least {_LEAST_SAMPLES} are needed"
        )
    if not (np.isfinite(given).all() and np.isfinite(answer).all()):
        raise HandlingError(Cause.NOT_FINITE, "a signal holds a value that is not finite")
    if np.ptp(given) <= 1e-9:
        raise HandlingError(Cause.NO_EXCITATION, "the input does not move, so nothing answers it")
    rate = (n - 1) / float(time_s[-1] - time_s[0])
    size = n // _WINDOWS if window_s is None else min(round(window_s * rate), n)
    if size < _LEAST_SAMPLES // _WINDOWS:
        raise HandlingError(
            Cause.TOO_SHORT, f"a window of {size} samples, {_LEAST_SAMPLES // _WINDOWS} are needed"
        )
    options = {"fs": rate, "nperseg": size, "noverlap": int(_OVERLAP * size), "detrend": "linear"}
    hertz, power = signal.welch(given, **options)
    _, answered = signal.welch(answer, **options)
    _, cross = signal.csd(given, answer, **options)
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
            Cause.LOW_COHERENCE,
            f"{longest.size} lines in a row with a coherence of {LEAST_COHERENCE:g}, at least "
            f"{_LEAST_LINES} are needed; the largest is {best:.2f}",
        )
    return FrequencyResponse(
        2.0 * np.pi * hertz[longest], cross[longest] / power[longest], coherence[longest]
    )


def bandwidth(found: FrequencyResponse) -> Bandwidth:
    """Bandwidths and phase delay of an attitude's response."""
    omega, phase = found.omega_radps, found.phase_deg
    by_phase, neutral = _falls_to(omega, phase, -135.0), _falls_to(omega, phase, -180.0)
    if neutral is None:
        return Bandwidth(by_phase, None, None, None)
    below = omega <= neutral
    level_db = float(np.interp(neutral, omega, found.gain_db)) + 6.0
    by_gain = _falls_to(omega[below][::-1], -found.gain_db[below][::-1], -level_db)
    twice = 2.0 * neutral
    delay = None
    if twice <= omega[-1]:
        beyond = -180.0 - float(np.interp(twice, omega, phase))
        delay = float(np.radians(beyond) / twice)
    return Bandwidth(by_phase, by_gain, neutral, delay)


def rejection(found: FrequencyResponse) -> Rejection:
    """Of the response of attitude with its disturbance to the disturbance (sensitivity)."""
    gain = found.gain_db
    peak = int(np.argmax(gain))
    risen = np.flatnonzero(gain > -3.0)
    bandwidth_radps = None
    if risen.size and risen[0] > 0:
        at = slice(risen[0] - 1, risen[0] + 1)
        bandwidth_radps = float(np.interp(-3.0, gain[at], found.omega_radps[at]))
    return Rejection(bandwidth_radps, float(gain[peak]), float(found.omega_radps[peak]))


def _falls_to(x: Array, y: Array, level: float) -> float | None:
    """First x at which y, coming from above, is at the level; None if it is never."""
    under = np.flatnonzero(y <= level)
    if not under.size or under[0] == 0:
        return None
    k = int(under[0])
    return float(x[k - 1] + (x[k] - x[k - 1]) * (y[k - 1] - level) / (y[k - 1] - y[k]))
