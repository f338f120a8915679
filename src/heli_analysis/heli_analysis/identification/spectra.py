# SPDX-License-Identifier: Apache-2.0
"""Spectra of a periodic experiment: excited lines, and the noise measured between them.

The whole record of P periods is transformed at once under a Hann window. A line of the excitation
falls on every P-th bin, so the window leaks nothing from one line into another, while slow drift
(turbulence, position loop) leaks far less than with the rectangular window of plain synchronous
averaging. The bins between the lines hold noise only: they give its covariance in the same units.
Source: Pintelon and Schoukens, System Identification: A Frequency Domain Approach, 2nd ed. (Wiley
2012), ch. 2 (windows, periodic signals) and 4 (noise from non-excited lines).
"""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray
from scipy.special import erf

from heli_core.errors import IdentificationCause, IdentificationError
from heli_core.ticks import TICK_S, ticks_in

# -------------------------------------------------------------------------------------------------
# The record of an identification experiment: one array per signal, one row per tick, checked.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

RATES = ("p", "q", "r")
ACTUATORS = ("lat", "lon", "ped", "col")
WIND = ("u", "v", "w")
CHANNELS = (*ACTUATORS, *WIND)
"""What can be excited: actuators as sent, gusts in body axes (m/s)."""
LEAST_PERIODS = 4
_WIDTH = {
    "time_s": 0,
    "u": 4,
    "excitation_u": 4,
    "attitude_rad": 3,
    "rate_body_radps": 3,
    "vel_body_mps": 3,
    "accel_body_mps2": 3,
    "gust_body_mps": 3,
}


@dataclass(frozen=True)
class Experiment:
    """One flight with a periodic excitation, sampled at 100 Hz; body axes FRD, SI, rad.

    Row n is what was known at tick n: rates and attitude before the command u of that tick acts.

    Attributes
    ----------
    time_s : (N,) array
        Flight time.
    u : (N, 4) array
        Actuators d_lat, d_lon, d_ped, d_col as sent, excitation included.
    excitation_u : (N, 4) array
        The excitation in u; zero where there is none.
    attitude_rad : (N, 3) array
        phi, theta, psi of the navigation.
    rate_body_radps : (N, 3) array
        p, q, r as measured by the gyros; a constant bias does no harm.
    vel_body_mps : (N, 3) array
        Velocity over ground, body axes, of the navigation.
    accel_body_mps2 : (N, 3) array
        Specific force.
    gust_body_mps : (N, 3) array
        Injected gust, velocity of the air, held over the tick; without the unknown turbulence.
    period_s : float
        Period of the excitation.
    start_s : float
        Beginning of the first period that is evaluated; transients have died out there.
    periods : int
        Number of whole periods from start_s on that are evaluated.
    """

    time_s: Array
    u: Array
    excitation_u: Array
    attitude_rad: Array
    rate_body_radps: Array
    vel_body_mps: Array
    accel_body_mps2: Array
    gust_body_mps: Array
    period_s: float
    start_s: float
    periods: int

    def __post_init__(self) -> None:
        size = np.asarray(self.time_s).size
        for field in fields(self):
            if field.name not in _WIDTH:
                continue
            array = np.asarray(getattr(self, field.name), dtype=np.float64)
            width = _WIDTH[field.name]
            shape = (size, width) if width else (size,)
            if array.shape != shape:
                raise IdentificationError(
                    IdentificationCause.SHAPE,
                    f"{field.name} has shape {array.shape}, {shape} is needed",
                )
            object.__setattr__(self, field.name, array)

    @property
    def period_ticks(self) -> int:
        """Ticks of one period."""
        return ticks_in(self.period_s)

    def steady(self) -> "Experiment":
        """The evaluated periods alone, checked.

        Raises
        ------
        IdentificationError
            TOO_SHORT, GAP, NOT_FINITE or SHAPE, naming the signal and where.
        """
        if abs(self.period_ticks * TICK_S - self.period_s) > 1e-9 or self.period_ticks < 2:
            raise IdentificationError(
                IdentificationCause.SHAPE,
                f"period_s = {self.period_s:g} is not a multiple of {TICK_S:g} s",
            )
        if self.periods < LEAST_PERIODS:
            raise IdentificationError(
                IdentificationCause.TOO_SHORT,
                f"periods = {self.periods}, at least {LEAST_PERIODS} are needed",
            )
        first = int(np.searchsorted(self.time_s, self.start_s - 0.5 * TICK_S))
        count = self.periods * self.period_ticks
        if self.time_s.size - first < count or (
            first == 0 and self.time_s.size and self.time_s[0] > self.start_s + 0.5 * TICK_S
        ):
            raise IdentificationError(
                IdentificationCause.TOO_SHORT,
                f"{self.periods} periods of {self.period_s:g} s from {self.start_s:g} s on are "
                f"needed, but the record covers {_span(self.time_s)}",
            )
        cut = slice(first, first + count)
        steps = np.diff(self.time_s[cut])
        if not np.all(np.isfinite(steps)) or np.max(np.abs(steps - TICK_S)) > 0.01 * TICK_S:
            bad = int(np.argmax(~(np.abs(steps - TICK_S) <= 0.01 * TICK_S)))
            raise IdentificationError(
                IdentificationCause.GAP,
                f"time_s: {steps[bad]:g} s between two samples at {self.time_s[first + bad]:.2f} s,"
                f" {TICK_S:g} s is needed",
            )
        parts = {name: getattr(self, name)[cut] for name in _WIDTH}
        for name, array in parts.items():
            finite = np.isfinite(array).reshape(array.shape[0], -1).all(axis=1)
            if not finite.all():
                raise IdentificationError(
                    IdentificationCause.NOT_FINITE,
                    f"{name} is not finite at {parts['time_s'][int(np.argmin(finite))]:.2f} s",
                )
        return Experiment(
            **parts,
            period_s=self.period_s,
            start_s=float(parts["time_s"][0]),
            periods=self.periods,
        )


def _span(time_s: Array) -> str:
    return f"{time_s[0]:g} to {time_s[-1]:g} s" if time_s.size else "nothing"


# -------------------------------------------------------------------------------------------------
# Spectra.
# -------------------------------------------------------------------------------------------------

ComplexArray = NDArray[np.complex128]
IntArray = NDArray[np.int64]

Y, U, GUST, KINK, VEL = slice(0, 3), slice(3, 7), slice(7, 10), slice(10, 11), slice(11, 14)
INPUTS = slice(3, 14)
"""All signals behind the rates."""
KINK_LINE = len(CHANNELS)
_KINK = 0.1  # of the largest line of |w|: the kink's lines that are used
_NOISE_BINS = 24  # per line
_LEAST_BINS = 12
_LEAK = 1  # a Hann window spreads a line over the next bin on either side
_SMALLEST = 0.02  # of a channel's largest line: below, a line is rounding or rotation of axes
_DRIFT = 0.05  # of the largest line: the excitation changes from period to period


_DRIVES = tuple(f"excitation_u.{n}" for n in ACTUATORS) + tuple(f"gust_body_mps.{n}" for n in WIND)


@dataclass(frozen=True)
class Spectra:
    """Complex amplitudes at excited lines and at noise bins.

    Signals are p, q, r (rad/s); actuators as sent; injected gust u, v, w; |w| of gust minus
    velocity; velocity over ground u, v, w (m/s).

    Attributes
    ----------
    bins : (L,) array of int
        Number of cycles in the record.
    omega_radps : (L,) array
    channel : (L,) array of int
        Which channel drives the line: 0..3 actuators, 4..6 gust, KINK_LINE the |w| of the gust.
    z : (L, 14) complex array
        Amplitudes at the lines.
    noise_bins : (M,) array of int
    noise_omega_radps : (M,) array
    noise_z : (M, 14) complex array
        Amplitudes at the noise bins.
    neighbours : (L, K) array of int
        Noise bins next to each line.
    periods : int
    dof : float
        Independent noise samples behind each covariance, mean over the lines.
    """

    bins: IntArray
    omega_radps: Array
    channel: IntArray
    z: ComplexArray
    noise_bins: IntArray
    noise_omega_radps: Array
    noise_z: ComplexArray
    neighbours: IntArray
    periods: int
    dof: float

    def channel_lines(self, channel: int, least: int) -> NDArray[np.bool_]:
        """Mask (L,) of a channel's lines; raises NO_EXCITATION or TOO_FEW_LINES below `least`."""
        mask: NDArray[np.bool_] = self.channel == channel
        count = int(mask.sum())
        if count == 0:
            raise IdentificationError(
                IdentificationCause.NO_EXCITATION,
                f"{_DRIVES[channel]} holds no periodic excitation",
            )
        if count < least:
            raise IdentificationError(
                IdentificationCause.TOO_FEW_LINES,
                f"{_DRIVES[channel]} has {count} lines, at least {least} are needed",
            )
        return mask

    def noise_covariance(self) -> ComplexArray:
        """Covariance (L, 14, 14) of z, from the neighbouring noise bins."""
        near = self.noise_z[self.neighbours]
        return np.einsum("lki,lkj->lij", near, near.conj()) / near.shape[1]


def _dof(bins: IntArray) -> float:
    """Independent ones of neighbouring bins (L, K), mean over the lines.

    Under a Hann window neighbouring bins are correlated with 2/3, the next but one with 1/6.
    """
    apart = np.abs(bins[:, :, None] - bins[:, None, :])
    squares = np.select([apart == 0, apart == 1, apart == 2], [1.0, 4.0 / 9.0, 1.0 / 36.0])
    return float(np.mean(bins.shape[1] ** 2 / squares.sum(axis=(1, 2))))


def hann_amplitudes(x: Array) -> ComplexArray:
    """Complex amplitudes (n // 2 + 1, c) of x (n, c): a sine of amplitude a gives |a|."""
    n = x.shape[0]
    window = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(n) / n)
    centred = x - x.mean(axis=0)
    return np.asarray(np.fft.rfft(centred * window[:, None], axis=0) * (2.0 / window.sum()))


def excited_lines(steady: Experiment, highest_hz: float) -> tuple[IntArray, IntArray]:
    """Harmonics of the period that are excited, and the channel (0..6) that drives each.

    Raises
    ------
    IdentificationError
        NO_EXCITATION if nothing is excited, NOT_PERIODIC if the excitation changes.
    """
    drive = np.hstack([steady.excitation_u, steady.gust_body_mps])
    per_period = drive.reshape(steady.periods, steady.period_ticks, drive.shape[1])
    spectra = np.fft.rfft(per_period, axis=1) * (2.0 / steady.period_ticks)
    spectra[:, 0] = 0.0
    mean = np.abs(spectra.mean(axis=0))
    largest = mean.max(axis=0)
    if not np.any(largest > 0.0):
        raise IdentificationError(
            IdentificationCause.NO_EXCITATION,
            "excitation_u and gust_body_mps hold no periodic excitation",
        )
    change = np.abs(spectra - spectra.mean(axis=0)).max(axis=(0, 1))
    for name, moved, peak in zip(_DRIVES, change, largest, strict=True):
        if peak > _SMALLEST * largest.max() and moved > _DRIFT * peak:
            raise IdentificationError(
                IdentificationCause.NOT_PERIODIC,
                f"{name} changes by {100.0 * moved / peak:.0f} % of its largest line between "
                "periods: it was faded out, or period_s or start_s is wrong",
            )
    scaled = np.where(largest > 0.0, mean / np.maximum(largest, 1e-300), 0.0)
    k = np.flatnonzero((scaled > _SMALLEST).any(axis=1))
    k = k[k / steady.period_s <= highest_hz]
    channel = np.argmax(scaled[k], axis=1)
    kinks = np.setdiff1d(_kink_lines(steady), k)
    kinks = kinks[kinks <= k.max(initial=0)]
    lines = np.concatenate([k, kinks])
    order = np.argsort(lines)
    return lines[order], np.append(channel, np.full(kinks.size, KINK_LINE))[order]


def _kink_lines(steady: Experiment) -> IntArray:
    """Harmonics on which |w| of the injected gust has power: other ones than those of w."""
    folded = np.abs(steady.gust_body_mps[:, 2]).reshape(steady.periods, -1).mean(axis=0)
    spectrum = np.abs(np.fft.rfft(folded - folded.mean()))
    if not spectrum.max() > 0.0:
        return np.zeros(0, dtype=np.int64)
    return np.flatnonzero(spectrum > _KINK * spectrum.max())


def folded(w: Array, spread: float) -> Array:
    """Mean of |w + n| for normal n of this standard deviation: |w| with a rounded kink."""
    if spread <= 0.0:
        return np.abs(w)
    scaled = w / spread
    round_off = spread * np.sqrt(2.0 / np.pi) * np.exp(-0.5 * scaled**2)
    return np.asarray(w * erf(scaled / np.sqrt(2.0)) + round_off)


def spectra_of(
    experiment: Experiment,
    highest_hz: float = 12.0,
    turbulence_w_mps: float = 0.0,
    air_w_mps: Array | None = None,
) -> Spectra:
    """Spectra of an experiment up to highest_hz.

    turbulence_w_mps: standard deviation of the unknown vertical air velocity, which rounds the kink
    of |w|. air_w_mps (N,): vertical air velocity relative to the aircraft over the evaluated
    periods, turbulence included, if it is known; default: gust minus velocity.

    Raises
    ------
    IdentificationError
        As `Experiment.steady` and `excited_lines`, and TOO_FEW_LINES.
    """
    steady = experiment.steady()
    lines, channel = excited_lines(steady, highest_hz)
    relative_w = steady.gust_body_mps[:, 2:] - steady.vel_body_mps[:, 2:]
    if air_w_mps is not None:
        relative_w = air_w_mps.reshape(-1, 1)
    kink = folded(relative_w, turbulence_w_mps)
    signals = np.hstack(
        [steady.rate_body_radps, steady.u, steady.gust_body_mps, kink,
         steady.vel_body_mps]
    )  # fmt: skip
    amplitudes = hann_amplitudes(signals)
    bins = lines * steady.periods
    noise = _noise_bins(bins, amplitudes.shape[0], steady.periods)
    width = min(_NOISE_BINS, noise.size)
    if width < _LEAST_BINS:
        raise IdentificationError(
            IdentificationCause.TOO_FEW_LINES,
            f"{noise.size} bins between the {lines.size} excited lines are left for the noise, "
            f"{_LEAST_BINS} are needed: more periods or fewer lines",
        )
    near = np.argsort(np.abs(noise[None, :] - bins[:, None]), axis=1, kind="stable")[:, :width]
    used, inverse = np.unique(near, return_inverse=True)
    step = 2.0 * np.pi / (steady.periods * steady.period_ticks * TICK_S)
    return Spectra(
        bins=bins,
        omega_radps=np.asarray(bins * step, dtype=np.float64),
        channel=channel,
        z=amplitudes[bins],
        noise_bins=noise[used],
        noise_omega_radps=np.asarray(noise[used] * step, dtype=np.float64),
        noise_z=amplitudes[noise[used]],
        neighbours=inverse.reshape(near.shape),
        periods=steady.periods,
        dof=_dof(noise[near]),
    )


def _noise_bins(bins: IntArray, count: int, periods: int) -> IntArray:
    """Bins free of the lines, from half a line's distance below the lowest one on."""
    free = np.ones(count, dtype=bool)
    free[: max(2, int(bins[0]) - max(periods, 2 * _LEAK))] = False
    for offset in range(-_LEAK, _LEAK + 1):
        hit = bins + offset
        free[hit[(hit >= 0) & (hit < count)]] = False
    return np.flatnonzero(free)
