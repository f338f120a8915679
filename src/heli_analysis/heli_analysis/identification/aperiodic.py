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

from heli_analysis.identification.spectra import (
    INPUTS,
    VEL,
    Array,
    ComplexArray,
    Spectra,
    Y,
)
from heli_analysis.identification.spectra import U as INPUTS_U
from heli_core.errors import IdentificationCause, IdentificationError
from heli_core.ticks import TICK_S

LEAST_COHERENCE = 0.6
"""Below, a response is not used: Tischler and Remple, ch. 7."""
LEAST_WINDOWS = 8
_CYCLES = 10  # of the lowest line of an octave in its window
_SLOWEST_CYCLES = 3  # in the longest window, which also has what lies below its octave
_SPACING = 2  # bins from line to line: under a Hann taper the next but one has 1/6 of a line
_HOP = 4  # to a window: then the squared tapers add up to a constant, and what a window cuts off
# from the memory of what was before leaves no bias of first order
_HIGHEST = 0.4  # of the sampling rate
_FLAT = 1e-9  # of a signal's largest value: rounding
_RIDGE = 1e-12
SHORTEST_S = 10.0
"""Windows are halved down to it: a resonance that fades with 0.6 s is 5 % lower in one of 10 s."""
_LEAST_S, _LEAST_SAMPLES = 4.0, 64
_RATIO = 1.06  # of neighbouring lines, at the least


class Cut(NamedTuple):
    """Windows of one length, and the lines that are read from them."""

    size: int  # samples
    starts: np.ndarray  # (K,) first sample of each window
    correlation: np.ndarray  # (K, K) of white noise, from window to window
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
            lines.append((at, *_solve(U[:, i], Y[:, i], R[:, i], cut.correlation)))
    lines.sort(key=lambda line: line[0])
    omega, value, sigma, partial, multiple, of_inputs, dof = (
        np.array([line[i] for line in lines]) for i in range(len(lines[0]))
    )
    return JointResponse(omega, value, sigma, partial, multiple, of_inputs, dof, r is not None)


# -------------------------------------------------------------------------------------------------
# The same for the fit of eq. (10): at each frequency one line for each reference.
#
# A reference's part of the windows, made orthogonal to the others', gives the amplitudes of all
# signals that go with it: a line as a multisine has them. What all references leave over in the
# windows is noise, in inputs as in outputs, and its covariance weighs a line's error.
# So the estimator and its confidence are those of the periodic experiment.
# -------------------------------------------------------------------------------------------------

_WEAKEST = 0.02  # of a reference's largest line: below, it is not excited
_NEAR = 1  # lines of a window's length to either side whose noise is taken together
_LEAST_DOF = 8.0


@dataclass(frozen=True)
class AperiodicRecord:
    """A flight with an excitation of any shape, 100 Hz; body axes FRD, SI, rad.

    Attributes
    ----------
    u : (N, 4) array
        Actuators d_lat, d_lon, d_ped, d_col as sent, excitation included.
    excitation_u : (N, 4) array
        What was added from outside: chirp, doublets, sticks; a column of zeros where nothing was.
    rate_body_radps : (N, 3) array
    vel_body_mps : (N, 3) array
        Velocity over ground; zero where it is not known.
    attitude_rad : (N, 2) array
        phi, theta.
    runs : tuple of (int, int)
        First sample and the one behind the last of each piece without a gap; none: all is one.
    """

    u: Array
    excitation_u: Array
    rate_body_radps: Array
    vel_body_mps: Array
    attitude_rad: Array
    runs: tuple[tuple[int, int], ...] = ()


def spectra_of_record(record: AperiodicRecord, highest_hz: float = 12.0) -> Spectra:
    """Lines and noise of a record, for `estimator.Problem`.

    Raises
    ------
    IdentificationError
        SHAPE, NOT_FINITE, NO_EXCITATION or TOO_SHORT.
    """
    u, y = _columns(record.u, "u"), _columns(record.rate_body_radps, "rate_body_radps")
    added = _columns(record.excitation_u, "excitation_u")
    velocity = _columns(record.vel_body_mps, "vel_body_mps")
    size = u.shape[0]
    widths = (("u", u, 4), ("excitation_u", added, 4), ("rate_body_radps", y, 3),
              ("vel_body_mps", velocity, 3))  # fmt: skip
    for name, array, width in widths:
        if array.shape != (size, width):
            raise IdentificationError(
                IdentificationCause.SHAPE,
                f"{name} has shape {array.shape}, {(size, width)} is needed",
            )
    channels = np.flatnonzero(np.ptp(added, axis=0) > _FLAT)
    if not channels.size:
        raise IdentificationError(
            IdentificationCause.NO_EXCITATION, "excitation_u holds no excitation"
        )
    signals = np.zeros((size, INPUTS.stop))
    signals[:, Y], signals[:, INPUTS_U], signals[:, VEL] = y, u, velocity
    runs = record.runs or ((0, size),)
    found: list[_Line] = []
    # the longest windows alone: what a short one blurs would go into the model
    for cut in cuts(runs, TICK_S, channels.size, highest_hz, shortest_s=np.inf):
        Z, R = amplitudes(signals, cut), amplitudes(added[:, channels], cut)
        found += _lines(Z, R, cut, channels)
    strongest = np.zeros(len(channels))
    for line in found:
        strongest[line.place] = max(strongest[line.place], line.drive)
    kept = [line for line in found if line.drive > _WEAKEST * strongest[line.place]]
    kept.sort(key=lambda line: line.omega_radps)
    each = kept[0].noise.shape[0]
    omega = np.array([line.omega_radps for line in kept])
    return Spectra(
        bins=np.arange(len(kept)),
        omega_radps=omega,
        channel=np.array([channels[line.place] for line in kept]),
        z=np.array([line.z for line in kept]),
        noise_bins=np.arange(len(kept) * each),
        noise_omega_radps=np.repeat(omega, each),
        noise_z=np.concatenate([line.noise for line in kept]),
        neighbours=np.arange(len(kept) * each).reshape(len(kept), each),
        periods=1,
        dof=float(np.mean([line.dof for line in kept])),
    )


class _Line(NamedTuple):
    omega_radps: float
    place: int  # among the references
    drive: float  # amplitude of the reference
    z: ComplexArray  # (14,) in units of the noise of one window
    noise: ComplexArray  # (k, 14) rows whose mean product is the noise's covariance
    dof: float


def _lines(Z: ComplexArray, R: ComplexArray, cut: Cut, channels: np.ndarray) -> list[_Line]:
    """Lines of one length of windows, of amplitudes (K, L, 14) and (K, L, m)."""
    count, width, rests = cut.bins.size, Z.shape[2], []
    moves = np.any(np.abs(Z) > 0.0, axis=(0, 1))
    alone = independent(cut)
    parts: list[tuple[ComplexArray, Array, Array]] = []
    for i in range(count):
        gauge = np.maximum(np.linalg.norm(R[:, i], axis=0), 1e-300)
        Q, triangle = np.linalg.qr(R[:, i] / gauge)
        z = Q.conj().T @ Z[:, i]
        rests.append(Z[:, i] - Q @ z)
        spread = np.diag(Q.conj().T @ cut.correlation @ Q).real
        parts.append((z, spread, np.abs(np.diag(triangle)) * gauge))
    found = []
    for i, (z, spread, drive) in enumerate(parts):
        near = range(max(0, i - _NEAR), min(count, i + _NEAR + 1))
        free = (alone - channels.size) * len(near)
        if free < _LEAST_DOF:
            raise IdentificationError(
                IdentificationCause.TOO_SHORT,
                f"{free:.0f} independent windows are left for the noise, {_LEAST_DOF:.0f} are "
                "needed: a longer record",
            )
        rest = np.concatenate([rests[k] for k in near])
        # as many rows as there are signals hold the same covariance
        noise = np.zeros((moves.sum(), width), np.complex128)
        noise[:, moves] = np.linalg.qr(rest[:, moves], mode="r")
        left_over = sum(cut.starts.size - float(parts[k][1].sum()) for k in near)
        noise *= np.sqrt(moves.sum() / left_over)
        omega = float(2.0 * np.pi * cut.bins[i] / (cut.size * TICK_S))
        for k in range(channels.size):
            scale = np.sqrt(max(spread[k], 1e-12))
            found.append(_Line(omega, k, float(drive[k]) / cut.starts.size**0.5, z[k] / scale,
                               noise, free))  # fmt: skip
    return found


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
    runs: Sequence[tuple[int, int]],
    dt_s: float,
    inputs: int,
    highest_hz: float | None = None,
    shortest_s: float = SHORTEST_S,
) -> list[Cut]:
    """Windows of each length, the longest first, with their lines; raises TOO_SHORT."""
    highest = min(highest_hz or np.inf, _HIGHEST / dt_s)
    least = LEAST_WINDOWS + 2 * inputs
    length = sum(stop - start for start, stop in runs)
    # so many windows that share halves
    size = 2 * _HOP * (length // ((least + 1) * _HOP))
    while size * dt_s >= _LEAST_S and _halves(runs, size) < least:
        size = _HOP * int(0.9 * size / _HOP)
    if size * dt_s < _LEAST_S or size < _LEAST_SAMPLES:
        raise IdentificationError(
            IdentificationCause.TOO_SHORT,
            f"{length * dt_s:g} s in {len(runs)} piece(s) hold no {least} windows of {_LEAST_S:g} s"
            f" and {_LEAST_SAMPLES} samples",
        )
    found = []
    first = _SLOWEST_CYCLES
    while first / (size * dt_s) <= highest:
        last = 0.5 * size * dt_s < shortest_s
        bins = np.arange(first, size // 2 if last else 2 * _CYCLES, _SPACING)
        bins = _thinned(bins[bins / (size * dt_s) <= highest])
        starts = _starts(runs, size)
        found.append(Cut(size, starts, _correlation(starts, size), bins))
        if last:
            break
        first, size = _CYCLES, _HOP * (size // (2 * _HOP))
    return found


def _halves(runs: Sequence[tuple[int, int]], size: int) -> int:
    return sum(max(0, 2 * (end - begin) // size - 1) for begin, end in runs)


def _thinned(bins: np.ndarray) -> np.ndarray:
    """Those of rising bins that are `_RATIO` apart."""
    kept: list[int] = []
    for one in bins:
        if not kept or one >= _RATIO * kept[-1]:
            kept.append(int(one))
    return np.array(kept, dtype=np.int64)


def _starts(runs: Sequence[tuple[int, int]], size: int) -> np.ndarray:
    starts = [np.arange(begin, end - size + 1, max(size // _HOP, 1)) for begin, end in runs]
    return np.concatenate([*starts, np.zeros(0, dtype=np.int64)]).astype(np.int64)


def _correlation(starts: np.ndarray, size: int) -> Array:
    """Correlation (K, K) of white noise's amplitudes in two Hann windows, by what they share."""
    apart = np.minimum(np.abs(starts[:, None] - starts[None, :]) / size, 1.0)
    turn = 2.0 * np.pi * apart
    # the integral of the product of two tapers over that of a squared one
    shared = (1.0 - apart) * (2.0 + np.cos(turn)) / 3.0 + np.sin(turn) / (2.0 * np.pi)
    return np.asarray(shared)


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


def independent(cut: Cut) -> float:
    """How many windows that share nothing tell as much."""
    return float(cut.starts.size**2 / np.sum(cut.correlation**2))


def _solve(
    U: ComplexArray, Y: ComplexArray, R: ComplexArray, correlation: Array
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
    free = windows**2 / float(np.sum(correlation**2)) - inputs
    Q = np.linalg.qr(X)[0]
    taken = float(np.trace(Q.conj().T @ correlation @ Q).real)  # by the inputs, of all windows
    noise = np.sum(np.abs(rest) ** 2, axis=0) / (windows - taken)
    spread = np.diag(left @ (Z.conj().T @ correlation @ Z) @ left.conj().T).real
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
