# SPDX-License-Identifier: Apache-2.0
"""Periodic multisines: their kernel, and how to choose lines, amplitudes and phases.

All lines lie on the grid 1/period, so that every period is the same. Different channels use
different lines ("zippered"): what a channel does at its own lines no other channel's excitation
does, and the frequency responses of all channels come from one flight. Phases are chosen so that
the sum has small peaks (low crest factor): the iterative clipping of Van der Ouderaa, Schoukens and
Renneboog (IEEE Trans. Instrum. Meas. 37(1), 1988), from several random starts with a fixed seed.
Source of the method: Pintelon, Schoukens, System Identification (2nd ed., IEEE, 2012), ch. 2 and 5.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_core.jit import by_reference, njit

# -------------------------------------------------------------------------------------------------
# Multisine.
# -------------------------------------------------------------------------------------------------

_STARTS = 20
_ROUNDS = 200
_CLIP = (0.75, 0.98)  # of the peak, first and last round
_SAMPLES_PER_CYCLE = 8


@njit
def sines_at(time_s, frequency_hz, amplitude, phase_rad, out):
    """Sum of sines at a time: fills out (c,).

    Parameters
    ----------
    time_s : float
    frequency_hz : (n,) array
    amplitude, phase_rad : (n, c) array
        Of each line in each channel; a line of amplitude 0 costs nothing.
    out : (c,) array
        sum over i of amplitude[i, j] sin(2 pi frequency_hz[i] time_s + phase_rad[i, j]).
    """
    for j in range(out.shape[0]):
        out[j] = 0.0
    for i in range(frequency_hz.shape[0]):
        angle = 2.0 * math.pi * frequency_hz[i] * time_s
        for j in range(out.shape[0]):
            if amplitude[i, j] != 0.0:
                out[j] += amplitude[i, j] * math.sin(angle + phase_rad[i, j])


@njit
def fade_in_and_out(time_s, duration_s, fade_s):
    """Share (0 to 1) at a time since the start: rises and falls by half a cosine of fade_s."""
    if time_s < 0.0 or time_s > duration_s:
        return 0.0
    edge = min(time_s, duration_s - time_s)
    if edge >= fade_s:
        return 1.0
    return 0.5 - 0.5 * math.cos(math.pi * edge / fade_s)


@dataclass(frozen=True)
class Multisine:
    """A periodic excitation of c channels.

    Attributes
    ----------
    period_s : float
    frequency_hz : (n,) array
        Rising; whole multiples of 1/period_s.
    amplitude, phase_rad : (n, c) array
        Each line belongs to one channel; its amplitude is 0 in the others.
    """

    period_s: float
    frequency_hz: NDArray[np.float64]
    amplitude: NDArray[np.float64]
    phase_rad: NDArray[np.float64]

    def at(self, time_s: ArrayLike) -> NDArray[np.float64]:
        """Values (N, c) at times (N,), s."""
        times = np.atleast_1d(np.asarray(time_s, float))
        out = np.zeros((times.size, self.amplitude.shape[1]))
        for row, time in zip(out, times.tolist(), strict=True):
            sines_at(time, self.frequency_hz, self.amplitude, self.phase_rad, row)
        return out

    @property
    def rms(self) -> NDArray[np.float64]:
        """Root mean square (c,) of each channel."""
        return np.sqrt(0.5 * np.sum(self.amplitude**2, axis=0))

    @property
    def crest(self) -> NDArray[np.float64]:
        """Crest factor (c,): peak over rms of each channel; 1.41 for one sine."""
        count = _samples(self.period_s, self.frequency_hz)
        peak = np.abs(self.at(np.arange(count) * self.period_s / count)).max(axis=0)
        return peak / self.rms


def _samples(period_s: float, frequency_hz: NDArray[np.float64]) -> int:
    return int(math.ceil(_SAMPLES_PER_CYCLE * period_s * float(frequency_hz.max())))


def zippered_lines(
    period_s: float, bands_hz: ArrayLike, lines: ArrayLike, odd: bool = False
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Lines of several channels, spread evenly on a logarithmic scale, none used twice.

    Parameters
    ----------
    period_s : float
        The grid is 1/period_s.
    bands_hz : (c, 2) array
        Lowest and highest frequency of each channel.
    lines : (c,) array of int
        How many lines each channel gets.
    odd : bool
        Odd multiples of 1/period only: whatever is even in the excitation (squares, products of
        two channels, magnitudes) then falls between the lines.

    Returns
    -------
    frequency_hz : (n,) array
        Rising.
    channel : (n,) int array
        Whose line it is.

    Raises
    ------
    ValueError
        The grid has too few lines in a band; names the channel.
    """
    bands = np.asarray(bands_hz, float).reshape(-1, 2)
    counts = np.asarray(lines, int).ravel()
    slots = [
        [
            slot
            for slot in range(1, math.floor(high * period_s + 1e-9) + 1)
            if slot >= low * period_s - 1e-9 and (slot % 2 or not odd)
        ]
        for low, high in bands
    ]
    wanted = []
    for j, ((low, high), count) in enumerate(zip(bands, counts.tolist(), strict=True)):
        # Each channel's row is shifted by its share of a step, so that rows interleave.
        place = (np.arange(count) + (j + 0.5) / len(counts)) / max(count, 1)
        # The most crowded band first: the others can still step aside.
        room = len(slots[j]) / max(count, 1)
        wanted += [(room, low * (high / low) ** share * period_s, j) for share in place.tolist()]
    taken: dict[int, int] = {}
    for _, cycles, j in sorted(wanted):
        free = np.array([slot for slot in slots[j] if slot not in taken])
        if not free.size:
            raise ValueError(
                f"channel {j}: fewer than {counts[j]} free lines between {bands[j, 0]:g} and "
                f"{bands[j, 1]:g} Hz at a period of {period_s:g} s"
            )
        taken[int(free[np.argmin(np.abs(free - cycles))])] = j
    slots_taken = sorted(taken)
    return np.array(slots_taken) / period_s, np.array([taken[slot] for slot in slots_taken])


def low_crest_phases(
    period_s: float, frequency_hz: ArrayLike, amplitude: ArrayLike, seed: int = 0
) -> NDArray[np.float64]:
    """Phases (n,), rad, of one channel's lines for which the sum has a small peak.

    Parameters
    ----------
    period_s : float
    frequency_hz, amplitude : (n,) array
        On the grid 1/period_s.
    seed : int
        Of the random starts; the same seed gives the same phases.
    """
    lines, size = np.asarray(frequency_hz, float), np.asarray(amplitude, float)
    if lines.size == 0:
        return np.zeros(0)
    slots = np.rint(lines * period_s).astype(int)
    count = 2 * _samples(period_s, lines)
    rng = np.random.default_rng(seed)

    def signal(phase: NDArray[np.float64]) -> NDArray[np.float64]:
        spectrum = np.zeros(count // 2 + 1, complex)
        spectrum[slots] = 0.5 * size * np.exp(1j * (phase - 0.5 * math.pi))
        return np.fft.irfft(spectrum * count, count)

    best, lowest = np.zeros(lines.size), math.inf
    for _ in range(_STARTS):
        phase = rng.uniform(-math.pi, math.pi, lines.size)
        for clip in np.linspace(*_CLIP, _ROUNDS):
            x = signal(phase)
            peak = float(np.abs(x).max())
            if peak < lowest:
                best, lowest = phase, peak
            clipped = np.clip(x, -clip * peak, clip * peak)
            phase = np.angle(np.fft.rfft(clipped)[slots]) + 0.5 * math.pi
    return np.angle(np.exp(1j * best))


def design_multisine(
    period_s: float,
    frequency_hz: ArrayLike,
    channel: ArrayLike,
    weight: ArrayLike,
    rms: ArrayLike,
    seed: int = 0,
) -> Multisine:
    """A multisine of given lines, shape of spectrum and strength.

    Parameters
    ----------
    period_s : float
    frequency_hz : (n,) array
        On the grid 1/period_s.
    channel : (n,) int array
        Whose line it is, 0 to c - 1.
    weight : (n,) array
        Relative amplitude of each line within its channel.
    rms : (c,) array
        Of each channel, in the channel's unit.
    seed : int
        Of the phases.

    Raises
    ------
    ValueError
        A line does not lie on the grid.
    """
    lines, owner = np.asarray(frequency_hz, float), np.asarray(channel, int)
    strength = np.asarray(rms, float)
    cycles = lines * period_s
    off = np.abs(cycles - np.rint(cycles)) > 1e-9 * np.maximum(cycles, 1.0)
    if off.any():
        raise ValueError(
            f"line {lines[off][0]:g} Hz is not a whole multiple of 1/{period_s:g} s: "
            "periods would differ"
        )
    amplitude = np.zeros((lines.size, strength.size))
    phase = np.zeros_like(amplitude)
    for j, wanted in enumerate(strength):
        of_channel = owner == j
        raw = np.asarray(weight, float)[of_channel]
        if raw.size == 0:
            continue
        amplitude[of_channel, j] = raw * wanted / math.sqrt(0.5 * float(np.sum(raw**2)))
        phase[of_channel, j] = low_crest_phases(
            period_s, lines[of_channel], amplitude[of_channel, j], seed + j
        )
    return Multisine(float(period_s), lines, amplitude, phase)


# -------------------------------------------------------------------------------------------------
# Sweeps and steps of an angle over time.
#
# A sweep is a sine whose frequency grows by the same factor in equal times (Tischler, Remple,
# Aircraft and Rotorcraft System Identification, 2nd ed., AIAA 2012, ch. 5); steps go up, back,
# down
# and back, then the same at half the size.
# -------------------------------------------------------------------------------------------------

NOTHING, SWEEP, STEPS = range(3)
"""Shapes."""
PARTS = 8
"""Of steps: up, back, down, back, twice."""
_UP, _DOWN, _HALF = 0, 2, 4


@by_reference
class SweepParams(NamedTuple):
    """Numbers of what is added; `shape` 0: nothing, 1: a sweep, 2: steps."""

    shape: int
    place: int  # of the angle in the array that it is added to
    amplitude: float  # rad
    from_radps: float
    growth: float  # natural logarithm of last over first frequency
    start_s: float
    duration_s: float


@njit
def swept_angle(time_s, k):
    """What is added at a time, rad."""
    since = time_s - k.start_s
    if k.shape == NOTHING or since < 0.0 or since >= k.duration_s:
        return 0.0
    share = since / k.duration_s
    if k.shape == SWEEP:
        turns = share if k.growth == 0.0 else math.expm1(k.growth * share) / k.growth
        fade = fade_in_and_out(since, k.duration_s, 0.5 * math.pi / k.from_radps)
        return fade * k.amplitude * math.sin(k.from_radps * k.duration_s * turns)
    part = int(PARTS * share)
    size = k.amplitude if part < _HALF else 0.5 * k.amplitude
    if part % _HALF == _UP:
        return size
    return -size if part % _HALF == _DOWN else 0.0


@njit
def add_sweep(time_s, k, out):
    """Add to the array in which `k.place` is the place of the angle, in place."""
    out[k.place] += swept_angle(time_s, k)
