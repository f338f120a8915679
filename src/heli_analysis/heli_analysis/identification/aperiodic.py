# SPDX-License-Identifier: Apache-2.0
"""Frequency responses from aperiodic records: chirps, doublets, a pilot's sweeps.

A record is cut into overlapping windows, each with a Hann taper. All inputs are taken at once: at
each frequency the windows' amplitudes of an output are a linear combination of those of the inputs,
solved by least squares, so what two inputs do together is told apart as far as they differ. Windows
hold the same number of cycles in each octave: long ones for what is slow, short ones (and so many
of them) for what is fast.

Sources: Bendat and Piersol, Random Data, 4th ed. (Wiley 2010), ch. 7 (several inputs, partial and
multiple coherence), 9 (random errors, their F distribution), 11 (windows that overlap); Tischler,
Remple, Aircraft and Rotorcraft System Identification, 2nd ed. (AIAA 2012), ch. 7 to 10 (windows,
random error from coherence, several inputs, windows of several lengths). In a loop the noise comes
back through the inputs, and least squares on them is biased; with a reference that the noise does
not reach, such as the chirp that was added, it is not (instrumental variables: Ljung, System
Identification, 2nd ed., 1999, ch. 7 and 13).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy import stats
from scipy.signal import detrend

from heli_analysis.identification.spectra import Array, ComplexArray
from heli_core.errors import IdentificationCause, IdentificationError

LEAST_COHERENCE = 0.6
"""Below, a response is not used: Tischler and Remple, ch. 7."""
LEAST_WINDOWS = 8
_CYCLES = 10  # of the lowest line of an octave in its window
_SLOWEST_CYCLES = 3  # in the longest window, which also has what lies below its octave
_SPACING = 2  # bins from line to line: under a Hann taper the next but one has 1/6 of a line
_OVERLAP = 1.0 / 6.0  # correlation of white noise in two Hann windows that share a half
_HIGHEST = 0.4  # of the sampling rate
_FLAT = 1e-9  # of a signal's largest value: rounding
_RIDGE = 1e-12
_SHORTEST = 8  # samples for each cycle that the shortest window could hold, at the least


class Cut(NamedTuple):
    """Windows of one length, and the lines that are read from them."""

    size: int  # samples
    starts: np.ndarray  # (K,) first sample of each window
    apart: np.ndarray  # (K - 1,) bool: the next window shares half of this one
    bins: np.ndarray  # (L,) cycles in a window


@dataclass(frozen=True)
class JointResponse:
    """Responses of k outputs to m inputs, found together.

    Attributes
    ----------
    omega_radps : (L,) array
    value : (L, k, m) complex array
    sigma : (L, k, m) array
        Standard deviation of the real and of the imaginary part, each.
    partial_coherence : (L, k, m) array
        Of an output with an input, once what the other inputs do is taken off both.
    coherence : (L, k) array
        Of an output with all inputs (multiple coherence).
    input_coherence : (L, m) array
        Of an input with the other inputs: near 1 they moved together and cannot be told apart.
    dof : (L,) array
        Independent windows less the inputs.
    instrumented : bool
        References were given, so noise that comes back through a loop leaves no bias.
    """

    omega_radps: Array
    value: ComplexArray
    sigma: Array
    partial_coherence: Array
    coherence: Array
    input_coherence: Array
    dof: Array
    instrumented: bool

    @property
    def random_error(self) -> Array:
        """Sigma over the gain (L, k, m): also the phase's, rad.

        For one input it is sqrt(1 - c) / (sqrt(c) sqrt(2 n)) with coherence c and n windows.
        """
        return self.sigma / np.maximum(np.abs(self.value), 1e-300)

    def radius(self, level: float = 0.95) -> Array:
        """Radius (L, k, m) of the circle around each value that holds the true one in `level`."""
        return self.sigma * np.sqrt(2.0 * stats.f.ppf(level, 2, 2.0 * self.dof))[:, None, None]

    def usable(self, output: int, inp: int, worst_error: float = 0.2) -> np.ndarray:
        """Mask (L,) of lines with a partial coherence of 0.6 and a random error of at most 0.2."""
        good = self.partial_coherence[:, output, inp] >= LEAST_COHERENCE
        return np.asarray(good & (self.random_error[:, output, inp] <= worst_error))


def joint_response(
    inputs: Array,
    outputs: Array,
    dt_s: float,
    references: Array | None = None,
    runs: Sequence[tuple[int, int]] = (),
    highest_hz: float | None = None,
) -> JointResponse:
    """Responses of all outputs to all inputs of a record.

    Parameters
    ----------
    inputs : (N, m) array
    outputs : (N, k) array
    dt_s : float
        From sample to sample.
    references : (N, m) array, optional
        What was added from outside, one for each input: a chirp, a pilot's sticks. Default: none,
        and the inputs are taken as they are.
    runs : sequence of (int, int), optional
        First sample and the one behind the last of each piece without a gap. Default: all is one.
    highest_hz : float, optional
        Default: 0.4 of the sampling rate.

    Raises
    ------
    IdentificationError
        SHAPE, NOT_FINITE, NO_EXCITATION (an input, or reference, does not move) or TOO_SHORT.
        Inputs that are the same are no error: their `input_coherence` is 1.
    """
    u, y = _columns(inputs, "inputs"), _columns(outputs, "outputs")
    r = None if references is None else _columns(references, "references")
    size, wanted = u.shape
    if y.shape[0] != size or (r is not None and r.shape != u.shape):
        raise IdentificationError(
            IdentificationCause.SHAPE,
            f"inputs {u.shape}, outputs {y.shape} and references "
            f"{None if r is None else r.shape} are not of one record",
        )
    for name, columns in (("input", u), ("reference", u if r is None else r)):
        still = np.ptp(columns, axis=0) <= _FLAT * np.maximum(np.abs(columns).max(axis=0), _FLAT)
        if still.any():
            raise IdentificationError(
                IdentificationCause.NO_EXCITATION,
                f"{name} {int(np.argmax(still))} does not move",
            )
    lines = []
    for cut in cuts(runs or ((0, size),), dt_s, wanted, highest_hz):
        U, Y = amplitudes(u, cut), amplitudes(y, cut)
        R = U if r is None else amplitudes(r, cut)
        omega = 2.0 * np.pi * cut.bins / (cut.size * dt_s)
        for i, at in enumerate(omega):
            lines.append((at, *_solve(U[:, i], Y[:, i], R[:, i], cut.apart)))
    lines.sort(key=lambda line: line[0])
    omega, value, sigma, partial, multiple, of_inputs, dof = (
        np.array([line[i] for line in lines]) for i in range(len(lines[0]))
    )
    return JointResponse(omega, value, sigma, partial, multiple, of_inputs, dof, r is not None)


def _columns(x: Array, name: str) -> Array:
    columns = np.asarray(x, dtype=np.float64)
    if columns.ndim != 2 or not columns.size:
        raise IdentificationError(
            IdentificationCause.SHAPE, f"{name} has shape {columns.shape}, (N, m) is needed"
        )
    if not np.isfinite(columns).all():
        at = int(np.argmax(~np.isfinite(columns).all(axis=1)))
        raise IdentificationError(
            IdentificationCause.NOT_FINITE, f"{name} is not finite at sample {at}"
        )
    return columns


def cuts(
    runs: Sequence[tuple[int, int]], dt_s: float, inputs: int, highest_hz: float | None = None
) -> list[Cut]:
    """Windows of each length, the longest first, with their lines; raises TOO_SHORT."""
    highest = min(highest_hz or np.inf, _HIGHEST / dt_s)
    least = LEAST_WINDOWS + 2 * inputs
    length = sum(stop - start for start, stop in runs)
    # so many windows that share halves
    size = 2 * (length // (least + 1))
    while size >= _SHORTEST * _CYCLES and _windows(runs, size)[0].size < least:
        size = 2 * int(0.45 * size)
    if size < _SHORTEST * _CYCLES:
        raise IdentificationError(
            IdentificationCause.TOO_SHORT,
            f"{length * dt_s:g} s in {len(runs)} piece(s) of {dt_s:g} s samples hold no {least} "
            f"windows of {_SHORTEST * _CYCLES} samples",
        )
    found = []
    first = _SLOWEST_CYCLES
    while size >= _SHORTEST * _CYCLES // 2:
        bins = np.arange(first, 2 * _CYCLES, _SPACING)
        bins = bins[bins / (size * dt_s) <= highest]
        if not bins.size:
            break
        starts, apart = _windows(runs, size)
        found.append(Cut(size, starts, apart, bins))
        first = _CYCLES
        size = 2 * (size // 4)
    return found


def _windows(runs: Sequence[tuple[int, int]], size: int) -> tuple[np.ndarray, np.ndarray]:
    starts = [np.arange(begin, end - size + 1, size // 2) for begin, end in runs]
    every = np.concatenate([*starts, np.zeros(0, dtype=np.int64)]).astype(np.int64)
    return every, np.diff(every) == size // 2


def amplitudes(x: Array, cut: Cut) -> ComplexArray:
    """Amplitudes (K, L, c) of x (N, c) in the windows, their phases counted from sample 0."""
    taper = 0.5 - 0.5 * np.cos(2.0 * np.pi * np.arange(cut.size) / cut.size)
    turn = np.exp(-2j * np.pi * np.outer(np.arange(cut.size), cut.bins) / cut.size)
    kernel = turn * (taper * 2.0 / taper.sum())[:, None]
    result = np.empty((cut.starts.size, cut.bins.size, x.shape[1]), dtype=np.complex128)
    for k, start in enumerate(cut.starts):
        piece = detrend(x[start : start + cut.size], axis=0, type="linear")
        since = np.exp(-2j * np.pi * cut.bins * start / cut.size)
        result[k] = since[:, None] * (kernel.T @ piece)
    return result


def overlapped(columns: ComplexArray, apart: np.ndarray) -> ComplexArray:
    """`columns`^H C columns, C the correlation of white noise from window to window."""
    nearby = columns[:-1].conj().T @ (columns[1:] * apart[:, None])
    return np.asarray(columns.conj().T @ columns + _OVERLAP * (nearby + nearby.conj().T))


def independent(cut: Cut) -> float:
    """How many windows that share nothing tell as much."""
    return float(cut.starts.size**2 / (cut.starts.size + 2.0 * _OVERLAP**2 * cut.apart.sum()))


def _solve(
    U: ComplexArray, Y: ComplexArray, R: ComplexArray, apart: np.ndarray
) -> tuple[ComplexArray, Array, Array, Array, Array, float]:
    """One frequency: windows' amplitudes (K, m), (K, k), (K, m)."""
    windows, inputs = U.shape
    scale = np.maximum(np.linalg.norm(U, axis=0), 1e-300)
    gauge = np.maximum(np.linalg.norm(R, axis=0), 1e-300)
    X, Z = U / scale, R / gauge
    # inputs that are the same leave a spread without bound
    inverse = np.linalg.inv(X.conj().T @ X + _RIDGE * np.eye(inputs))
    left = inverse if R is U else np.linalg.pinv(Z.conj().T @ X, rcond=_RIDGE)
    H = left @ (Z.conj().T @ Y)
    rest = Y - X @ H
    free = windows**2 / (windows + 2.0 * _OVERLAP**2 * float(apart.sum())) - inputs
    noise = np.sum(np.abs(rest) ** 2, axis=0) / windows * (free + inputs) / free
    spread = np.diag(left @ overlapped(Z, apart) @ left.conj().T).real
    sigma = np.sqrt(0.5 * noise[:, None] * spread[None, :]) / scale
    # coherences belong to the inputs as they are
    power = np.maximum(np.sum(np.abs(Y) ** 2, axis=0), 1e-300)
    plain = inverse @ (X.conj().T @ Y)
    residual = np.sum(np.abs(Y - X @ plain) ** 2, axis=0)
    unique = 1.0 / np.maximum(np.diag(inverse).real, 1.0)  # of an input's power, beyond the others
    own = np.abs(plain.T) ** 2 * unique[None, :]
    return (
        (H / scale[:, None]).T,
        sigma,
        own / np.maximum(own + residual[:, None], 1e-300),
        np.clip(1.0 - residual / power, 0.0, 1.0),
        1.0 - unique,
        free,
    )
