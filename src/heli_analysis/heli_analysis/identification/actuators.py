# SPDX-License-Identifier: Apache-2.0
"""A and B of eq. (10), servos and transport delay, from a flight with excited actuators."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from heli_identification.errors import Cause, IdentificationError
from heli_identification.estimator import (
    LONGEST_DELAY_S,
    Estimate,
    Problem,
    estimate,
    summary,
)
from heli_identification.experiment import ACTUATORS, RATES, Array, Experiment
from heli_identification.places import AIR, FAST, STATE
from heli_identification.places import RATES as RATE_STATES
from heli_identification.response import FAST_STATES, SERVOS, FastModel, transfer
from heli_identification.selection import select
from heli_identification.spectra import GUST, INPUTS, VEL, Spectra, Y, spectra_of
from heli_identification.start import StartSearch
from heli_identification.structure import (
    DAMPING,
    DELAY,
    ESSENTIAL,
    FLAPPING,
    SERVO,
    actuator_parameters,
    full_matrices,
    place_of,
    values_of,
)
from heli_math.rows import ACTUATOR, NINE
from heli_math.ticks import TICK_S

LEAST_COHERENCE = 0.6
SIGNIFICANT_SHARE = 0.01
_LEAST_LINES = 5
_FASTEST_GROWTH_1PS = 1.0


@dataclass(frozen=True)
class IdentifiedAB:
    """A and B of eq. (10) with what acts before them.

    Attributes
    ----------
    A : (9, 9) array
    B : (9, 3) array
        States phi theta p q a_s b_s r d_int psi, inputs d_lat d_lon d_ped; SI and rad.
    A_sigma, B_sigma : arrays of the same shapes
        Standard deviations with all entries free, those below 1 % of their row known to be so: they
        hold what taking entries for zero may cost. 0 where known by structure.
    B_col : (9,) array
        Effect of the collective on the nine states (0 if it was not excited).
    servo_radps, servo_damping : float
    servo_radps_sigma, servo_damping_sigma : float
    delay_s, delay_s_sigma : float
        Transport delay as fitted.
    delay_ticks : int
        Rounded; A and B belong to it.
    share : dict of str to float
        Effect of each entry over the largest effect in its row, RMS over the excited lines.
    estimate : Estimate
        Values, covariance, cost and residuals of the parameters of the final fit.
    sigma : dict of str to float
        Standard deviation of every parameter, as in A_sigma and B_sigma.
    taken_for_zero : tuple of str
        Entries that the data do not tell from zero (see `fit_actuators`).
    coherence : dict of str to float
        Median over a channel's lines of the coherence of its own response.
    phi_rad, theta_rad : float
        Trim attitude of the kinematic rows.
    fast : FastModel
        The fitted model of the fast states.
    """

    A: Array
    B: Array
    A_sigma: Array
    B_sigma: Array
    B_col: Array
    servo_radps: float
    servo_damping: float
    servo_radps_sigma: float
    servo_damping_sigma: float
    delay_s: float
    delay_s_sigma: float
    delay_ticks: int
    share: dict[str, float]
    estimate: Estimate
    sigma: dict[str, float]
    taken_for_zero: tuple[str, ...]
    coherence: dict[str, float]
    phi_rad: float
    theta_rad: float
    fast: FastModel


def channel_coherence(spectra: Spectra) -> dict[str, float]:
    """Median coherence of p to lat, q to lon, r to ped over the channel's own lines.

    Coherence is the share of the periodic part in the response's power over one period.

    Raises
    ------
    IdentificationError
        NO_EXCITATION, TOO_FEW_LINES or LOW_COHERENCE, with channel and number.
    """
    noise = spectra.noise_covariance()
    result = {}
    for i, (actuator, rate) in enumerate(zip(ACTUATORS[ACTUATOR.attitude], RATES, strict=True)):
        own = spectra.own(i, _LEAST_LINES)
        power = np.abs(spectra.z[own, i]) ** 2
        scatter = noise[own, i, i].real * spectra.periods
        result[f"{rate}/{actuator}"] = median = float(np.median(power / (power + scatter)))
        if median < LEAST_COHERENCE:
            raise IdentificationError(
                Cause.LOW_COHERENCE,
                f"{rate} answers excitation_u.{actuator} with a median coherence of {median:.2f}, "
                f"at least {LEAST_COHERENCE:.2f} is needed: excite more strongly or longer",
            )
    return result


def fit_actuators(
    experiment: Experiment,
    start: FastModel | None = None,
    round_delay: bool = True,
    prune: bool = True,
    progress: Callable[[str], None] | None = None,
) -> IdentifiedAB:
    """Fit A, B, servos and delay.

    Entries that the data do not tell from zero are taken for zero (see `selection`).

    Parameters
    ----------
    experiment : Experiment
        d_lat, d_lon, d_ped excited; d_col may be.
    start : FastModel, optional
        Rough start; default: from the spectra alone.
    round_delay : bool
        Round the delay to whole ticks and fit the rest again.
    prune : bool
        Take for zero what is not told from zero.
    progress : callable, optional
        Told in a few words how far it is.

    Raises
    ------
    IdentificationError
        Its cause and sentence say why.
    """
    spectra = spectra_of(experiment)
    coherence = channel_coherence(spectra)
    names = _names(spectra)
    if 2 * spectra.omega_radps.size * 3 < 2 * len(names):
        raise IdentificationError(
            Cause.TOO_FEW_LINES,
            f"{spectra.omega_radps.size} lines are excited, {len(names)} parameters need "
            f"at least {-(-len(names) // 3)}",
        )
    first = start if start is not None else StartSearch(spectra).best()
    if progress is not None:
        progress("start found")
    if prune:
        found = select(spectra, names, first, progress)
    else:
        problem = Problem([spectra], names, None)
        found = estimate(problem, values_of(names, first), fine=False, joint=False)
    kept = found.names
    dropped = tuple(name for name in names if name not in kept)
    problem = Problem([spectra], kept, None, found.distortion)
    start_values = found.values
    fitted = estimate(problem, start_values, joint=not round_delay, progress=progress)
    delay_s = float(fitted.values[kept.index(DELAY)])
    delay_sigma = float(fitted.sigma[kept.index(DELAY)])
    ticks = round(delay_s / TICK_S)
    model = problem.model(fitted.values)
    if round_delay:
        base = replace(model, delay_s=ticks * TICK_S)
        kept = tuple(name for name in kept if name != DELAY)
        problem = Problem([spectra], kept, base, fitted.distortion)
        fitted = estimate(problem, values_of(kept, base), progress=progress)
        model = problem.model(fitted.values)
    _check_physical(model)
    attitude = experiment.steady().attitude_rad[:, :2].mean(axis=0)
    share, sigma = _share_and_sigma(model, spectra, fitted.distortion, (DELAY,))
    return _identified(
        model, fitted, sigma | {DELAY: delay_sigma}, share,
        (float(attitude[0]), float(attitude[1])), (delay_s, delay_sigma, ticks), dropped, coherence,
    )  # fmt: skip


def refit_actuators(experiment: Experiment, identified: IdentifiedAB, E: Array) -> IdentifiedAB:
    """Fit A, B and servos once more, with E as the flight with gusts shows it.

    The flight with excited actuators hardly tells E, whose error then goes into entries that
    resemble it, such as A(r,p): a roll is a side velocity soon after.

    Parameters
    ----------
    experiment : Experiment
    identified : IdentifiedAB
        From `fit_actuators` on the same experiment: which entries are free, delay, start.
    E : (9, 3) array
        E(r,w) as the mean of both sides of its kink.

    Raises
    ------
    IdentificationError
        As `fit_actuators`.
    """
    spectra = spectra_of(experiment)
    wind = np.zeros_like(identified.fast.E)
    wind[:, AIR.velocity] = E[FAST]
    base = replace(identified.fast, E=wind, delay_s=identified.delay_ticks * TICK_S)
    known = ("E(", DELAY)
    kept = tuple(n for n in identified.estimate.names if not n.startswith(known))
    problem = Problem([spectra], kept, base, identified.estimate.distortion)
    fitted = estimate(problem, values_of(kept, base))
    model = problem.model(fitted.values)
    _check_physical(model)
    share, sigma = _share_and_sigma(model, spectra, fitted.distortion, known)
    delay = (identified.delay_s, identified.delay_s_sigma, identified.delay_ticks)
    return _identified(
        model, fitted, sigma, share, (identified.phi_rad, identified.theta_rad), delay,
        identified.taken_for_zero, identified.coherence,
    )  # fmt: skip


def _names(spectra: Spectra) -> tuple[str, ...]:
    """Parameters that this excitation can tell."""
    return actuator_parameters(collective=bool(np.any(spectra.channel == ACTUATORS.index("col"))))


def _share_and_sigma(
    model: FastModel, spectra: Spectra, distortion: float, known: tuple[str, ...]
) -> tuple[dict[str, float], dict[str, float]]:
    """Share of every entry in its row; standard deviations with all entries free but the known.

    known: how the names begin whose values are not this fit's. A small entry lies anywhere within
    +- `SIGNIFICANT_SHARE` of its row; equal chance everywhere there has a standard deviation of
    that over sqrt(3).
    """
    names = _names(spectra)
    share = effect_shares(model, spectra, names)
    free = tuple(name for name in names if not name.startswith(known))
    of_one = effect_shares(model, spectra, free, dict.fromkeys(free, 1.0))
    small = {n for n in free if n not in ESSENTIAL and share[n] < SIGNIFICANT_SHARE}
    width = SIGNIFICANT_SHARE / np.sqrt(3.0)
    prior = np.array([width / max(of_one[n], 1e-12) if n in small else np.inf for n in free])
    problem = Problem([spectra], free, model, distortion, prior)
    spread = summary(problem, values_of(free, model)).sigma
    return share, dict(zip(free, spread.tolist(), strict=True))


def _check_physical(model: FastModel) -> None:
    poles = np.linalg.eigvals(model.A)
    fastest = float(np.max(poles.real))
    if fastest > _FASTEST_GROWTH_1PS:
        raise IdentificationError(
            Cause.UNSTABLE,
            f"the fitted rotor and body grow with {fastest:.2f} 1/s, at most "
            f"{_FASTEST_GROWTH_1PS:g} 1/s is believable",
        )
    if model.servo_radps > 240.0 or model.delay_s > 0.99 * LONGEST_DELAY_S:
        raise IdentificationError(
            Cause.UNSTABLE,
            f"the fitted servo frequency of {model.servo_radps:.0f} rad/s and delay of "
            f"{model.delay_s:.3f} s are at the bounds of what is believable",
        )


def effect_shares(
    model: FastModel,
    spectra: Spectra,
    names: tuple[str, ...],
    values: dict[str, float] | None = None,
) -> dict[str, float]:
    """RMS effect of each entry over the excited lines, over the largest in its row.

    values: entries to take in place of the model's, the largest in the row still being the model's.
    """
    response = transfer(model, spectra.omega_radps, states=True)
    states = (response @ spectra.z[:, INPUTS, None])[:, :, 0]
    states[:, RATE_STATES] = spectra.z[:, Y]
    wind = spectra.z[:, GUST] - spectra.z[:, VEL]
    columns = {"A": states[:, FAST_STATES], "B": states[:, SERVOS], "E": wind}
    rms = {key: np.sqrt(np.mean(np.abs(c) ** 2, axis=0)) for key, c in columns.items()}
    matrix = {"A": model.A, "B": model.B, "E": model.E[:, AIR.velocity]}
    largest = np.max(np.hstack([np.abs(matrix[key]) * rms[key] for key in rms]), axis=1)
    shares = {}
    for i, name in ((STATE.a_s, "A(a_s,a_s)"), (STATE.b_s, "A(b_s,b_s)")):
        shares[name] = float(abs(model.A[i, i]) * rms["A"][i] / max(largest[i], 1e-300))
    for name in names:
        place = place_of(name)
        if place is None or place.column >= rms[place.matrix].size:
            continue
        value = matrix[place.matrix][place.row, place.column] if values is None else values[name]
        effect = abs(value) * rms[place.matrix][place.column]
        shares[name] = float(effect / max(largest[place.row], 1e-300))
    return shares


def _identified(
    model: FastModel,
    fitted: Estimate,
    sigma: dict[str, float],
    share: dict[str, float],
    attitude: tuple[float, float],
    delay: tuple[float, float, int],
    dropped: tuple[str, ...],
    coherence: dict[str, float],
) -> IdentifiedAB:
    A, B, _ = full_matrices(model, *attitude)
    A_sigma, B_sigma = np.zeros((9, 9)), np.zeros((9, 3))
    for name, value in sigma.items():
        place = place_of(name)
        if name == FLAPPING:
            A_sigma[NINE.a_s, NINE.a_s] = A_sigma[NINE.b_s, NINE.b_s] = value
        if place is not None and place.matrix == "A":
            A_sigma[FAST, FAST][place.row, place.column] = value
        if place is not None and place.matrix == "B" and place.column < ACTUATOR.col:
            B_sigma[FAST][place.row, place.column] = value
    B_col = np.zeros(len(NINE))
    B_col[FAST] = model.B[:, ACTUATOR.col]
    return IdentifiedAB(
        A=A,
        B=B,
        A_sigma=A_sigma,
        B_sigma=B_sigma,
        B_col=B_col,
        servo_radps=model.servo_radps,
        servo_damping=model.servo_damping,
        servo_radps_sigma=sigma[SERVO],
        servo_damping_sigma=sigma[DAMPING],
        delay_s=delay[0],
        delay_s_sigma=delay[1],
        delay_ticks=delay[2],
        share=share,
        estimate=fitted,
        sigma=sigma,
        taken_for_zero=dropped,
        coherence=coherence,
        phi_rad=attitude[0],
        theta_rad=attitude[1],
        fast=model,
    )
