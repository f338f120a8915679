# SPDX-License-Identifier: Apache-2.0
"""Output error: the second method, in the time domain.

The model of the fast states is simulated from the recorded inputs, and the entries that the fit in
the frequency domain kept are moved until the simulated rates lie on the measured ones, weighed by
the covariance of what is left; that covariance and the entries are found in turn (maximum
likelihood by relaxation: Jategaonkar, Flight Vehicle System Identification, 2nd ed., AIAA 2015, ch.
4; for rotorcraft Tischler and Remple, Aircraft and Rotorcraft System Identification, 2nd ed., AIAA
2012, ch. 14). Inputs and rates go through the same band-pass filter first: offsets, initial states
and slow drift are no parameters then.

Turbulence makes the residuals coloured, and the Cramer-Rao bound too small. Its correction by their
autocorrelation: Morelli and Klein, "Accuracy of aerodynamic model parameters estimated from flight
test data", J. Guidance, Control, and Dynamics 20(1), 1997.

In a loop the noise comes back through the inputs, and least squares is biased by many sigmas. So
where the excitation is known the fit ends with instruments: what is left is made orthogonal to the
derivatives of the rates that follow from the excitation alone, not to those of the measured inputs
(instrumental variables in closed loop: Gilson and Van den Hof, Automatica 41(2), 2005; Ljung,
System Identification, 2nd ed., 1999, ch. 7 and 13). The covariance is that of this estimator, with
the coloured residuals in its middle. What no sigma holds: wind that the attitude turns, a delay or
a servo's lag that is taken wrong, an aircraft that is not linear.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import least_squares
from scipy.signal import bilinear, butter, lfilter, sosfilt

from heli_analysis.identification.actuators import IdentifiedAB, refitted
from heli_analysis.identification.aperiodic import AperiodicRecord, spectra_of_record
from heli_analysis.identification.estimator import BOUNDS, Problem, summary
from heli_analysis.identification.model import (
    FAST_STATES,
    RATE_PLACES,
    FastModel,
    assemble,
    place_of,
    values_of,
)
from heli_analysis.identification.spectra import Array, Experiment, spectra_of
from heli_analysis.identification.structure import AIR, DELAY, N_FAST
from heli_core.errors import IdentificationCause, IdentificationError
from heli_core.linear import held_and_linear, held_late, with_servos
from heli_core.rows import ACTUATOR
from heli_core.ticks import TICK_S, TICKS_PER_S

BAND_HZ = (0.1, 12.0)
_SETTLED_S = 10.0  # of the filter and of the model's initial state
_ROUNDS, _EVALUATIONS = 4, 12
_STILL = 0.1  # of a parameter's sigma, RMS
_MEMORY_S = 5.0  # autocorrelation of the residuals
_SINGULAR = 1e8
_LAGS_RADPS, _LAGS, _LAG_DAMPING = (0.3, 60.0), 3, 0.5
"""Second-order lags of the excitation, of which a loop's answer to it is made up: few, as each
takes a part of the noise along."""
_MOST_GROWTH = 30.0  # log of what a simulation may grow by


@dataclass(frozen=True)
class RecordPiece:
    """A stretch of a record without a gap, filtered; the first `settled` samples are not judged.

    Attributes
    ----------
    u : (N, 4) array
    gust_body_mps, vel_body_mps, rate_body_radps : (N, 3) arrays
    settled : int
    answer : RecordPiece or None
        What of it follows from the excitation; None: no excitation is known.
    """

    u: Array
    gust_body_mps: Array
    vel_body_mps: Array
    rate_body_radps: Array
    settled: int
    answer: "RecordPiece | None" = None


@dataclass(frozen=True)
class OutputError:
    """Result of the fit.

    Attributes
    ----------
    names : tuple of str
    values : (n,) array
    covariance : (n, n) array
        Cramer-Rao bound, corrected for coloured residuals.
    white_sigma : (n,) array
        Standard deviations by the bound as it would be if residuals were white.
    model : FastModel
    fit : (3,) array
        Theil's inequality coefficient of p, q, r: 0 perfect, below 0.25 good (Jategaonkar).
    instrumented : bool
        False: noise that a loop feeds back into the inputs leaves a bias that is in no sigma.
    """

    names: tuple[str, ...]
    values: Array
    covariance: Array
    white_sigma: Array
    model: FastModel
    fit: Array
    instrumented: bool

    @property
    def sigma(self) -> Array:
        """Standard deviations (n,) of the values."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0.0))


@dataclass(frozen=True)
class MethodAgreement:
    """An entry by both methods.

    Attributes
    ----------
    name : str
    frequency, frequency_sigma : float
    time, time_sigma : float
    time_white_sigma : float
        As it would be if the residuals were white.
    """

    name: str
    frequency: float
    frequency_sigma: float
    time: float
    time_sigma: float
    time_white_sigma: float

    @property
    def deviation(self) -> float:
        """Of the time domain's value from the other, relative to that; nan where that is 0."""
        apart = self.time - self.frequency
        return apart / abs(self.frequency) if self.frequency else float("nan")

    @property
    def agrees(self) -> bool:
        """Whether they differ by no more than two standard deviations of both."""
        both = float(np.hypot(self.frequency_sigma, self.time_sigma))
        return abs(self.time - self.frequency) <= 2.0 * both


# -------------------------------------------------------------------------------------------------
# Simulation: by the modes of the exactly discretised model, so that a record takes milliseconds.
# -------------------------------------------------------------------------------------------------


def simulate(model: FastModel, piece: RecordPiece) -> Array:
    """Rates p, q, r (N, 3), rad/s, from zero.

    Raises
    ------
    IdentificationError
        UNSTABLE: the model grows beyond all numbers within the piece.
    """
    F, G = with_servos(model.A, model.B, model.servo_radps, model.servo_damping)
    E = np.vstack([model.E[:, AIR.velocity], np.zeros((2 * ACTUATOR.size, 3))])
    Phi, air, _, rise = held_and_linear(F, E, E, TICK_S)
    late = held_late(F, G, TICK_S, model.delay_s)
    fast, n = FAST_STATES, ACTUATOR.size
    command = _later(piece.u, late.ticks) @ late.newer.T
    command += _later(piece.u, late.ticks + 1) @ late.older.T
    servos = np.zeros((piece.u.shape[0], 2 * n))
    for i in range(n):
        own = [i, n + i]
        at = [N_FAST + i, N_FAST + n + i]
        servos[:, own] = _march(Phi[np.ix_(at, at)], command[:, at])
    relative = piece.gust_body_mps - piece.vel_body_mps
    moved = np.diff(piece.vel_body_mps, axis=0, append=piece.vel_body_mps[-1:])
    drive = command[:, fast] + servos @ Phi[fast, N_FAST:].T
    drive += relative @ air[fast].T - moved @ rise[fast].T
    return _march(Phi[fast, fast], drive)[:, RATE_PLACES]


def _later(x: Array, ticks: int) -> Array:
    return np.vstack([np.zeros((ticks, x.shape[1])), x])[: x.shape[0]]


def _march(Phi: Array, drive: Array) -> Array:
    """x (N, n) of x(k+1) = Phi x(k) + drive(k) from zero."""
    poles, V = np.linalg.eig(Phi)
    if np.linalg.cond(V) > _SINGULAR:
        # poles that coincide: a hair apart
        poles, V = np.linalg.eig(Phi + 1e-9 * np.diag(np.arange(Phi.shape[0])))
    growth = float(np.log(np.abs(poles).max() + 1e-300))
    if growth * drive.shape[0] > _MOST_GROWTH:
        raise IdentificationError(
            IdentificationCause.UNSTABLE,
            f"simulated over {drive.shape[0] * TICK_S:.0f} s the model grows with "
            f"{growth / TICK_S:.2f} 1/s, which output error follows for "
            f"{_MOST_GROWTH * TICK_S / growth:.0f} s at most: shorter runs of the record, or the "
            "frequency domain alone",
        )
    modes = drive @ np.linalg.inv(V).T
    for i, pole in enumerate(poles):
        modes[:, i] = lfilter([0.0, 1.0], [1.0, -pole], modes[:, i])
    return np.ascontiguousarray((modes @ V.T).real)


# -------------------------------------------------------------------------------------------------
# Pieces of records.
# -------------------------------------------------------------------------------------------------


def pieces_of_experiment(experiment: Experiment, band_hz: tuple[float, float]) -> list[RecordPiece]:
    """The mean period of an experiment, twice: the model settles in the first."""
    steady = experiment.steady()
    shape = (steady.periods, steady.period_ticks)
    signals = [
        np.tile(x.reshape(*shape, -1).mean(axis=0), (2, 1))
        for x in (steady.u, steady.gust_body_mps, steady.vel_body_mps, steady.rate_body_radps)
    ]
    added = np.tile(steady.excitation_u.reshape(*shape, -1).mean(axis=0), (2, 1))
    return [_instructed(_filtered(signals, band_hz, steady.period_ticks), added, band_hz)]


def pieces_of_record(record: AperiodicRecord, band_hz: tuple[float, float]) -> list[RecordPiece]:
    """The pieces of a record that are longer than twice what the filter needs to settle."""
    settled = round(_SETTLED_S * TICKS_PER_S)
    still = np.zeros_like(record.vel_body_mps)
    signals = (record.u, still, record.vel_body_mps, record.rate_body_radps)
    added = record.excitation_u
    runs = record.runs or ((0, record.u.shape[0]),)
    long = [run for run in runs if run[1] - run[0] > 2 * settled]
    if not long:
        raise IdentificationError(
            IdentificationCause.TOO_SHORT,
            f"no piece without a gap is longer than {2.0 * _SETTLED_S:g} s",
        )
    return [
        _instructed(_filtered([x[a:b] for x in signals], band_hz, settled), added[a:b], band_hz)
        for a, b in long
    ]


def _filtered(signals: Sequence[Array], band_hz: tuple[float, float], settled: int) -> RecordPiece:
    u, gust, vel, rate = (_banded(x, band_hz) for x in signals)
    return RecordPiece(u, gust, vel, rate, settled)


def _banded(x: Array, band_hz: tuple[float, float]) -> Array:
    sections = butter(2, band_hz, "bandpass", fs=TICKS_PER_S, output="sos")
    return np.asarray(sosfilt(sections, x - x[:1], axis=0))


def _instructed(piece: RecordPiece, added: Array, band_hz: tuple[float, float]) -> RecordPiece:
    """A piece with its answer to the excitation (N, 4), if there is one.

    What of actuators and velocity is a linear combination of the excitation and of what lags behind
    it.
    """
    moved = _banded(added[:, np.ptp(added, axis=0) > 0.0], band_hz)
    if not moved.size:
        return piece
    columns = [moved]
    for omega in np.geomspace(*_LAGS_RADPS, _LAGS):
        lag = [1.0, 2.0 * _LAG_DAMPING * omega, omega**2]
        for above in ([omega**2], [omega, 0.0]):
            columns.append(lfilter(*bilinear(above, lag, TICKS_PER_S), moved, axis=0))
    X = np.hstack(columns)
    scale = np.maximum(np.linalg.norm(X, axis=0), 1e-300)
    Q, triangle = np.linalg.qr(X / scale)
    Q = Q[:, np.abs(np.diag(triangle)) > 1e-8]
    u, vel = (Q @ (Q.T @ x) for x in (piece.u, piece.vel_body_mps))
    return replace(piece, answer=replace(piece, u=u, vel_body_mps=vel))


# -------------------------------------------------------------------------------------------------
# Fit.
# -------------------------------------------------------------------------------------------------


def fit_output_error(
    pieces: Sequence[RecordPiece], start: FastModel, names: Sequence[str]
) -> OutputError:
    """Move the named entries until the simulated rates lie on the measured ones.

    Parameters
    ----------
    pieces : sequence of RecordPiece
    start : FastModel
        From the fit in the frequency domain; what is not named stays as it is there.
    names : sequence of str
        As of `model.place_of`.

    Raises
    ------
    IdentificationError
        UNSTABLE, NOT_CONVERGED.
    """
    names = tuple(names)
    values = values_of(names, start)
    low, high = (np.array([BOUNDS.get(n, (-np.inf, np.inf))[i] for n in names]) for i in range(2))

    def left(x: Array) -> Array:
        model = assemble(names, x, start)
        return np.vstack([(p.rate_body_radps - simulate(model, p))[p.settled :] for p in pieces])

    def sensitivity(x: Array, of: Callable[[Array], Array] = left) -> Array:
        at, columns = of(x), []
        for i, name in enumerate(names):
            step = 1e-6 * max(abs(x[i]), 1e-2 if place_of(name) is None else 1e-3)
            moved = x.copy()
            moved[i] += step
            columns.append((of(moved) - at) / step)
        return np.stack(columns, axis=-1)

    def answered(x: Array) -> Array:
        model = assemble(names, x, start)
        return np.vstack([-simulate(model, p.answer or p)[p.settled :] for p in pieces])

    for _ in range(_ROUNDS):
        e = left(values)
        W = np.linalg.inv(np.linalg.cholesky(e.T @ e / e.shape[0] + 1e-18 * np.eye(3)))

        def weighed(x: Array, W: Array = W, size: int = e.size) -> Array:
            try:
                return (left(x) @ W.T).ravel()
            except IdentificationError:
                # a step too far, which SciPy then takes again, shorter
                return np.full(size, np.inf)

        def jacobian(x: Array, W: Array = W) -> Array:
            return np.einsum("ij,njk->nik", W, sensitivity(x)).reshape(-1, x.size)

        found = least_squares(
            weighed, np.clip(values, low, high), jac=jacobian, bounds=(low, high), x_scale="jac",
            max_nfev=_EVALUATIONS, ftol=1e-7, xtol=1e-9,
        )  # fmt: skip
        if not np.all(np.isfinite(found.x)):
            break
        moved = np.linalg.norm(found.jac @ (found.x - values)) / np.sqrt(values.size)
        values = found.x
        if moved < _STILL:
            break
    if not np.all(np.isfinite(values)) or found.status <= 0:
        raise IdentificationError(
            IdentificationCause.NOT_CONVERGED,
            f"output error of {len(names)} parameters did not settle in the time domain",
        )
    told = None
    if any(p.answer is not None for p in pieces):
        told = _instrumented(values, (low, high), left, sensitivity, answered)
    instrumented = told is not None
    if told is None:
        S = found.jac.reshape(e.shape[0], 3, values.size)
        told = values, S, S, left(values) @ W.T
    values, S, Z, w = told
    bound, covariance = _cramer_rao(S, Z, w)
    e = left(values)
    measured = np.vstack([p.rate_body_radps[p.settled :] for p in pieces])
    rms = np.sqrt(np.mean(e**2, axis=0))
    size = np.sqrt(np.mean(measured**2, axis=0)) + np.sqrt(np.mean((measured - e) ** 2, axis=0))
    return OutputError(
        names, values, covariance, np.sqrt(np.maximum(np.diag(bound), 0.0)),
        assemble(names, values, start), rms / np.maximum(size, 1e-300), instrumented,
    )  # fmt: skip


def _instrumented(
    values: Array,
    bounds: tuple[Array, Array],
    left: Callable[[Array], Array],
    sensitivity: Callable[..., Array],
    answered: Callable[[Array], Array],
) -> tuple[Array, Array, Array, Array] | None:
    """Values at which what is left is orthogonal to what the excitation alone would move.

    Returns
    -------
    (values, S, Z, w)
        Derivatives of what is left and of the instruments (N, 3, n), and what is left (N, 3), all
        whitened at lag 0. None: it does not settle, as where the excitation is weak.
    """
    for _ in range(_EVALUATIONS):
        try:
            e = left(values)
        except IdentificationError:
            return None
        W = np.linalg.inv(np.linalg.cholesky(e.T @ e / e.shape[0] + 1e-18 * np.eye(3)))
        S, Z = (np.einsum("ij,njk->nik", W, sensitivity(values, of)) for of in (left, answered))
        w = e @ W.T
        flat, instruments = (x.reshape(-1, values.size) for x in (S, Z))
        gauge = np.sqrt(np.maximum(np.sum(flat**2, axis=0), 1e-300))
        M = instruments.T @ (flat / gauge)
        step = np.linalg.lstsq(M, instruments.T @ w.ravel(), rcond=1e-13)[0] / gauge
        moved = np.linalg.norm(flat @ step) / np.sqrt(values.size)
        if moved < _STILL:
            return values, S, Z, w
        values = np.clip(values - step, *bounds)
    return None


def _cramer_rao(S: Array, Z: Array, w: Array) -> tuple[Array, Array]:
    """Bound with white residuals, and corrected; S, Z (N, 3, n) and w (N, 3) whitened at lag 0.

    M^-1 (sum_ij Z_i' C(i - j) Z_j) M'^-1, M = Z'S, where C is the residuals' autocorrelation. The
    double sum is made by Fourier transforms; a triangular lag window keeps the spectrum of C
    positive.
    """
    count, n = S.shape[0], S.shape[2]
    flat, instruments = S.reshape(-1, n), Z.reshape(-1, n)
    gauge = np.sqrt(np.maximum(np.sum(flat**2, axis=0), 1e-300))
    M = instruments.T @ flat / np.outer(gauge, gauge)
    inverse = np.linalg.pinv(M, rcond=1e-13) / np.outer(gauge, gauge)
    lags = min(round(_MEMORY_S * TICKS_PER_S), count // 4)
    size = 1 << int(np.ceil(np.log2(count + lags)))
    spectrum = np.fft.rfft(w, size, axis=0)
    cross = np.fft.irfft(spectrum[:, :, None] * spectrum[:, None].conj(), size, axis=0) / count
    taper = np.zeros(size)
    taper[:lags] = 1.0 - np.arange(lags) / lags
    taper[1 - lags :] = taper[1:lags][::-1]
    density = np.fft.rfft(cross * taper[:, None, None], axis=0)
    s = np.fft.rfft(Z, size, axis=0)
    twice = np.full(s.shape[0], 2.0)
    twice[[0, -1]] = 1.0
    right = np.einsum("fij,fjn->fin", density, s)
    middle = np.einsum("f,fim,fin->mn", twice, s.conj(), right, optimize=True).real / size
    white = inverse @ instruments.T @ instruments @ inverse.T
    return white, inverse @ middle @ inverse.T


# -------------------------------------------------------------------------------------------------
# As `fit_actuators` and `fit_record` give it.
# -------------------------------------------------------------------------------------------------


def refine(
    measured: Experiment | AperiodicRecord,
    identified: IdentifiedAB,
    band_hz: tuple[float, float] = BAND_HZ,
) -> tuple[IdentifiedAB, OutputError, tuple[MethodAgreement, ...]]:
    """A, B, servos by output error from what the frequency domain gave, and how both agree.

    Parameters
    ----------
    measured : Experiment or AperiodicRecord
        That `identified` is of.
    identified : IdentifiedAB
        Start; its delay, its entries that are taken for zero, and its E, where that is not of the
        same fit, are kept.
    band_hz : (float, float)
        What of the rates is fitted.

    Returns
    -------
    (IdentifiedAB, OutputError, tuple of MethodAgreement)

    Raises
    ------
    IdentificationError
    """
    if isinstance(measured, Experiment):
        pieces, spectra = pieces_of_experiment(measured, band_hz), spectra_of(measured)
    else:
        pieces, spectra = pieces_of_record(measured, band_hz), spectra_of_record(measured)
    before = identified.estimate
    names = tuple(name for name in before.names if name != DELAY)
    found = fit_output_error(pieces, identified.fast, names)
    rows = tuple(
        MethodAgreement(name, *map(float, numbers))
        for name, *numbers in zip(
            names, values_of(names, identified.fast),
            [identified.sigma.get(n, float("nan")) for n in names], found.values, found.sigma,
            found.white_sigma, strict=True,
        )
    )  # fmt: skip
    problem = Problem([spectra], names, identified.fast, before.distortion)
    estimate = replace(summary(problem, found.values), covariance=found.covariance)
    sigma = dict(zip(names, found.sigma.tolist(), strict=True))
    return refitted(identified, found.model, estimate, sigma), found, rows
