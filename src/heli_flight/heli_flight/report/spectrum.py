# SPDX-License-Identifier: Apache-2.0
"""Power spectral densities of recorded signals, by Welch's method.

One-sided, in the signal's unit squared per Hz: the area below a density is the signal's variance.
Windows of Hann that overlap by half, each without its mean (Welch, IEEE Transactions on Audio and
Electroacoustics 15(2), 1967; `scipy.signal.welch`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_PARTS = 6
"""A window is so much of the record: 11 windows, each with half of the next one."""
_LONGEST_S = 40.0
LEAST_SAMPLES = 240


@dataclass(frozen=True)
class Spectrum:
    """Density of one signal.

    Attributes
    ----------
    hertz : (m,) array
        Frequencies above 0, up to half of the sampling rate.
    density : (m,) array
        Unit squared per Hz.
    step_hz : float
        Between lines.
    rms : float
        Of the samples about their mean.
    """

    hertz: Array
    density: Array
    step_hz: float
    rms: float

    @property
    def area_rms(self) -> float:
        """Root of the area below the density: the rms by the other way (Parseval)."""
        return float(np.sqrt(self.density.sum() * self.step_hz))

    @property
    def median_hz(self) -> float:
        """Half of the power is below."""
        share = np.cumsum(self.density)
        return float(self.hertz[np.searchsorted(share, 0.5 * share[-1])])

    def below(self, hertz: float) -> float:
        """Share of the power below a frequency."""
        whole = float(self.density.sum())
        return float(self.density[self.hertz <= hertz].sum()) / whole if whole > 0.0 else 0.0


def even(time_s: Array, values: Array) -> tuple[float, Array, int] | None:
    """Samples (n, k) at even times, how many per second, and how many of them were not recorded.

    Those are put between their neighbours. None for what is too short, or not finite.

    Parameters
    ----------
    time_s : (N,) array
    values : (N, k) array
    """
    if time_s.size < LEAST_SAMPLES or not np.isfinite(values).all():
        return None
    step_s = float(np.median(np.diff(time_s)))
    if step_s <= 0.0:
        return None
    count = round(float(time_s[-1] - time_s[0]) / step_s) + 1
    at = time_s[0] + step_s * np.arange(count)
    filled = [np.interp(at, time_s, column) for column in values.T]
    return 1.0 / step_s, np.column_stack(filled), count - time_s.size


def spectrum(values: Array, rate_hz: float) -> Spectrum:
    """Density of (n,) samples, `LEAST_SAMPLES` or more, so many per second."""
    from scipy import signal  # takes a third of a second to import

    size = min(values.size, max(LEAST_SAMPLES, values.size // _PARTS), round(_LONGEST_S * rate_hz))
    hertz, density = signal.welch(
        values, fs=rate_hz, window="hann", nperseg=size, noverlap=size // 2, detrend="constant",
        scaling="density",
    )  # fmt: skip
    return Spectrum(hertz[1:], density[1:], float(hertz[1]), float(np.std(values)))


def folded(hertz: float, rate_hz: float) -> float:
    """Where a sine shows up in samples, so many per second."""
    return abs(hertz - rate_hz * round(hertz / rate_hz))
