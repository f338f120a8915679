# SPDX-License-Identifier: Apache-2.0
"""A and B of eq. (10), servos and transport delay, from a flight with excited actuators."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from heli_analysis.identification.aperiodic import AperiodicRecord, spectra_of_record
from heli_analysis.identification.estimator import (
    LONGEST_DELAY_S,
    Estimate,
    Problem,
    StartSearch,
    estimate,
    select,
    summary,
)
from heli_analysis.identification.model import (
    FAST,
    FAST_STATES,
    SERVOS,
    FastModel,
    empty_model,
    full_matrices,
    gust_parameters,
    place_of,
    transfer,
    values_of,
)
from heli_analysis.identification.model import RATE_PLACES as RATE_STATES
from heli_analysis.identification.spectra import (
    ACTUATORS,
    CHANNELS,
    GUST,
    INPUTS,
    RATES,
    VEL,
    WIND,
    Array,
    Experiment,
    Spectra,
    U,
    Y,
    hann_amplitudes,
    spectra_of,
)
from heli_analysis.identification.structure import (
    AIR,
    DAMPING,
    DELAY,
    FLAPPING,
    FULL,
    ROTOR,
    SERVO,
    STATE,
    ModelStructure,
)
from heli_core.errors import IdentificationCause, IdentificationError
from heli_core.linear import WIND as WIND_INPUTS
from heli_core.linear import held, held_late, hover_system, with_delay_line, with_servos
from heli_core.rows import ACTUATOR, NINE
from heli_core.ticks import TICK_S

if TYPE_CHECKING:
    import control

# -------------------------------------------------------------------------------------------------
# Actuators.
# -------------------------------------------------------------------------------------------------

LEAST_COHERENCE = 0.6
SIGNIFICANT_SHARE = 0.01
_LEAST_LINES = 5
_FASTEST_GROWTH_1PS = 10.0
"""Helicopters without augmentation are unstable in the open loop; none departs as fast as this."""


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
    structure : ModelStructure
        What it has of them.
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
    structure: ModelStructure = FULL


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
        lines = spectra.channel_lines(i, _LEAST_LINES)
        power = np.abs(spectra.z[lines, i]) ** 2
        scatter = noise[lines, i, i].real * spectra.periods
        result[f"{rate}/{actuator}"] = median = float(np.median(power / (power + scatter)))
        if median < LEAST_COHERENCE:
            raise IdentificationError(
                IdentificationCause.LOW_COHERENCE,
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
    structure: ModelStructure = FULL,
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
    structure : ModelStructure
        Which states the model has.

    Raises
    ------
    IdentificationError
        Its cause and sentence say why.
    """
    attitude = experiment.steady().attitude_rad[:, :2].mean(axis=0)
    return _fit(spectra_of(experiment), attitude, start, round_delay, prune, progress, structure)


def fit_record(
    record: AperiodicRecord,
    start: FastModel | None = None,
    round_delay: bool = True,
    progress: Callable[[str], None] | None = None,
    structure: ModelStructure = FULL,
) -> IdentifiedAB:
    """Fit A, B, servos and delay to chirps, doublets or sweeps, as `fit_actuators` does to lines.

    Parameters
    ----------
    record : AperiodicRecord
        d_lat, d_lon, d_ped excited from outside; d_col may be.
    start, round_delay, progress, structure
        As in `fit_actuators`.

    Raises
    ------
    IdentificationError
        Its cause and sentence say why.
    """
    attitude = np.asarray(record.attitude_rad, np.float64)[:, :2].mean(axis=0)
    return _fit(spectra_of_record(record), attitude, start, round_delay, True, progress, structure)


def _fit(
    spectra: Spectra,
    attitude: Array,
    start: FastModel | None,
    round_delay: bool,
    prune: bool,
    progress: Callable[[str], None] | None,
    structure: ModelStructure,
) -> IdentifiedAB:
    coherence = channel_coherence(spectra)
    names = _names(spectra, structure)
    if 2 * spectra.omega_radps.size * 3 < 2 * len(names):
        raise IdentificationError(
            IdentificationCause.TOO_FEW_LINES,
            f"{spectra.omega_radps.size} lines are excited, {len(names)} parameters need "
            f"at least {-(-len(names) // 3)}",
        )
    first = start if start is not None else StartSearch(spectra, structure).best()
    if progress is not None:
        progress("start found")
    if prune:
        selected = select(spectra, names, first, structure, progress)
    else:
        problem = Problem([spectra], names, empty_model(structure))
        selected = estimate(problem, values_of(names, first), fine=False, joint=False)
    kept = selected.names
    dropped = tuple(name for name in names if name not in kept)
    problem = Problem([spectra], kept, empty_model(structure), selected.distortion)
    start_values = selected.values
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
    _check_physical(model, structure)
    share, sigma = _share_and_sigma(model, spectra, fitted.distortion, (DELAY,), structure)
    return _identified(
        model, fitted, sigma | {DELAY: delay_sigma}, share,
        (float(attitude[0]), float(attitude[1])), (delay_s, delay_sigma, ticks), dropped, coherence,
        structure,
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
    _check_physical(model, identified.structure)
    share, sigma = _share_and_sigma(model, spectra, fitted.distortion, known, identified.structure)
    delay = (identified.delay_s, identified.delay_s_sigma, identified.delay_ticks)
    return _identified(
        model, fitted, sigma, share, (identified.phi_rad, identified.theta_rad), delay,
        identified.taken_for_zero, identified.coherence, identified.structure,
    )  # fmt: skip


def _names(spectra: Spectra, structure: ModelStructure) -> tuple[str, ...]:
    """Parameters that this excitation can tell."""
    collective = bool(np.any(spectra.channel == ACTUATORS.index("col")))
    return structure.actuator_parameters(collective)


def _share_and_sigma(
    model: FastModel,
    spectra: Spectra,
    distortion: float,
    known: tuple[str, ...],
    structure: ModelStructure,
) -> tuple[dict[str, float], dict[str, float]]:
    """Share of every entry in its row; standard deviations with all entries free but the known.

    known: how the names begin whose values are not this fit's. A small entry lies anywhere within
    +- `SIGNIFICANT_SHARE` of its row; equal chance everywhere there has a standard deviation of
    that over sqrt(3).
    """
    names = _names(spectra, structure)
    share = effect_shares(model, spectra, names)
    free = tuple(name for name in names if not name.startswith(known))
    of_one = effect_shares(model, spectra, free, dict.fromkeys(free, 1.0))
    small = {n for n in free if n not in structure.essential and share[n] < SIGNIFICANT_SHARE}
    width = SIGNIFICANT_SHARE / np.sqrt(3.0)
    prior = np.array([width / max(of_one[n], 1e-12) if n in small else np.inf for n in free])
    problem = Problem([spectra], free, model, distortion, prior)
    spread = summary(problem, values_of(free, model)).sigma
    return share, dict(zip(free, spread.tolist(), strict=True))


def _check_physical(model: FastModel, structure: ModelStructure = FULL) -> None:
    poles = np.linalg.eigvals(model.A)
    fastest = float(np.max(poles.real))
    if fastest > _FASTEST_GROWTH_1PS:
        raise IdentificationError(
            IdentificationCause.UNSTABLE,
            f"the fitted model with the states {', '.join(structure.states)} grows with "
            f"{fastest:.2f} 1/s, at most {_FASTEST_GROWTH_1PS:g} 1/s is believable: another "
            "structure may be",
        )
    if model.servo_radps > 240.0 or model.delay_s > 0.99 * LONGEST_DELAY_S:
        raise IdentificationError(
            IdentificationCause.UNSTABLE,
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
    structure: ModelStructure,
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
        structure=structure,
    )


def refitted(
    before: IdentifiedAB, model: FastModel, fitted: Estimate, sigma: dict[str, float]
) -> IdentifiedAB:
    """The same with another fit's model, estimate and standard deviations of its parameters."""
    return _identified(
        model, fitted, before.sigma | sigma, before.share, (before.phi_rad, before.theta_rad),
        (before.delay_s, before.delay_s_sigma, before.delay_ticks), before.taken_for_zero,
        before.coherence, before.structure,
    )  # fmt: skip


# -------------------------------------------------------------------------------------------------
# E of eq. (10) from a flight with injected gusts (the paper's way to E).
# -------------------------------------------------------------------------------------------------

_GUSTS_LEAST_LINES = 4
_MOST_TURBULENCE_MPS, _MOST_MEAN_MPS = 1.5, 0.5
SIDES = {"descent": -1.0, "mean": 0.0, "climb": 1.0}


@dataclass(frozen=True)
class IdentifiedE:
    """E of eq. (10).

    Attributes
    ----------
    E : (9, 3) array
        Effect of the velocity of the air u, v, w (body axes, m/s) on the nine states, on `side`.
    E_sigma : (9, 3) array
    side : str
        Which slope of the yaw response to vertical air E(r,w) is: "descent" (air that rises),
        "climb" (air that sinks) or "mean".
    E_rw : dict of str to float
        E(r,w) on each side.
    turbulence_w_mps : float
        Standard deviation of the unknown vertical air velocity, from how it rounds the kink.
    share : dict of str to float
        Effect of each entry over the largest effect in its row of E, RMS over the gust's lines.
    estimate : Estimate
    coherence : dict of str to float
        Per wind axis: median share of its lines' power, after the actuators' part is taken off,
        in the rate that shows the axis best.
    """

    E: Array
    E_sigma: Array
    side: str
    E_rw: dict[str, float]
    turbulence_w_mps: float
    share: dict[str, float]
    estimate: Estimate
    coherence: dict[str, float]


def _check_gusts(spectra: Spectra, identified: IdentifiedAB) -> dict[str, float]:
    """Coherence per wind axis.

    Raises
    ------
    IdentificationError
        NO_EXCITATION, TOO_FEW_LINES, LOW_COHERENCE.
    """
    G_u = transfer(identified.fast, spectra.omega_radps)[:, :, U.start - 3 : U.stop - 3]
    G_n = transfer(identified.fast, spectra.noise_omega_radps)[:, :, U.start - 3 : U.stop - 3]
    left = spectra.z[:, Y] - (G_u @ spectra.z[:, U, None])[:, :, 0]
    noise = spectra.noise_z[:, Y] - (G_n @ spectra.noise_z[:, U, None])[:, :, 0]
    scatter = np.mean(np.abs(noise[spectra.neighbours]) ** 2, axis=1) * spectra.periods
    result = {}
    for i, axis in enumerate(WIND):
        lines = spectra.channel_lines(4 + i, _GUSTS_LEAST_LINES)
        power = np.abs(left[lines]) ** 2
        result[axis] = float(np.max(np.median(power / (power + scatter[lines]), axis=0)))
    best = max(result.values())
    if best < LEAST_COHERENCE:
        raise IdentificationError(
            IdentificationCause.LOW_COHERENCE,
            f"no rate answers gust_body_mps with a median coherence above {best:.2f}, "
            f"at least {LEAST_COHERENCE:.2f} is needed: stronger gusts or more periods",
        )
    return result


def fit_gusts(
    experiment: Experiment,
    identified: IdentifiedAB,
    side: str = "descent",
    progress: Callable[[str], None] | None = None,
    air_w_mps: Array | None = None,
) -> IdentifiedE:
    """Fit E, with A, B, servos and delay as identified.

    The power of climb acts only when the aircraft climbs relative to the air, so the yaw response
    to vertical air has a kink at w_a = 0, where hover is. |w| of the relative air velocity is
    therefore an input of its own of the row of r: E(r,w) is e - k for air that rises (descent) and
    e + k for air that sinks. Unknown turbulence rounds the kink; its standard deviation is fitted
    with it (the cost as a function of it is minimised), unless air_w_mps tells it tick by tick.

    Parameters
    ----------
    experiment : Experiment
        u, v, w of gust_body_mps excited.
    identified : IdentifiedAB
        From `fit_actuators`.
    side : {"descent", "climb", "mean"}
        Which E(r,w) the matrix holds.
    progress : callable, optional
    air_w_mps : (N,) array, optional
        From `actuators.relative_air_w`; its mean, which that does not know, is fitted.

    Raises
    ------
    IdentificationError
        Its cause and sentence say why.
    ValueError
        If side is none of the three.
    """
    if side not in SIDES:
        raise ValueError(f"side {side!r} is not allowed; allowed: {', '.join(SIDES)}")
    spectra = spectra_of(experiment, air_w_mps=air_w_mps)
    coherence = _check_gusts(spectra, identified)
    names = gust_parameters()
    problem = Problem([spectra], names, identified.fast)
    start = values_of(names, identified.fast)
    first = estimate(problem, start, fine=False, joint=False, progress=progress)
    if air_w_mps is None:
        turbulence = _turbulence(experiment, problem, first.values)
        spectra = spectra_of(experiment, turbulence_w_mps=turbulence)
    else:
        air_w_mps = air_w_mps + _mean_air(experiment, problem, first.values, air_w_mps)
        spectra = spectra_of(experiment, air_w_mps=air_w_mps)
        steady = experiment.steady()
        known = steady.gust_body_mps[:, 2] - steady.vel_body_mps[:, 2]
        turbulence = float(np.std(air_w_mps - known))
    problem = Problem([spectra], names, identified.fast, first.distortion)
    fitted = estimate(problem, first.values, joint=False, progress=progress)
    model = problem.model(fitted.values)
    E, sigma = np.zeros((9, 3)), np.zeros((9, 3))
    E[FAST] = model.E[:, AIR.velocity]
    for name, value in zip(names, fitted.sigma, strict=True):
        place = place_of(name)
        assert place is not None
        if place.column != AIR.kink:
            sigma[FAST][place.row, place.column] = value
    kink = float(model.E[STATE.r, AIR.kink])
    E_rw = {name: float(E[NINE.r, AIR.w] + sign * kink) for name, sign in SIDES.items()}
    E[NINE.r, AIR.w] = E_rw[side]
    i, j = names.index("E(r,w)"), names.index("E(r,|w|)")
    mix = np.zeros(len(names))
    mix[i], mix[j] = 1.0, SIDES[side]
    sigma[NINE.r, AIR.w] = float(np.sqrt(mix @ fitted.covariance @ mix))
    return IdentifiedE(
        E=E,
        E_sigma=sigma,
        side=side,
        E_rw=E_rw,
        turbulence_w_mps=turbulence,
        share=_shares(E, spectra),
        estimate=fitted,
        coherence=coherence,
    )


def _turbulence(experiment: Experiment, problem: Problem, values: Array) -> float:
    """Standard deviation of the vertical turbulence, m/s, with which the kink fits best."""
    return _best(
        problem,
        values,
        lambda sigma: spectra_of(experiment, turbulence_w_mps=sigma),
        (0.0, _MOST_TURBULENCE_MPS),
    )


def _mean_air(experiment: Experiment, problem: Problem, values: Array, air_w_mps: Array) -> float:
    """Mean of the vertical air velocity, m/s, with which the kink fits best: where it lies."""
    return _best(
        problem,
        values,
        lambda mean: spectra_of(experiment, air_w_mps=air_w_mps + mean),
        (-_MOST_MEAN_MPS, _MOST_MEAN_MPS),
    )


def _best(
    problem: Problem,
    values: Array,
    spectra_with: Callable[[float], Spectra],
    bounds: tuple[float, float],
) -> float:
    """Where in the bounds the cost of the fit is least.

    The model is linear in E, so each trial is one linear least-squares problem; the weights stay.
    """
    whiteners = problem.whiteners(values)

    def cost(x: float) -> float:
        spectra = spectra_with(x)
        trial = Problem([spectra], problem.names, problem.base, problem.distortion)
        residual = trial.residual(values, whiteners)
        J = trial.jacobian(values, whiteners)
        step = np.linalg.lstsq(J, -residual, rcond=None)[0]
        return float(np.sum((residual + J @ step) ** 2))

    result = minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 0.01})
    return float(result.x)


def _shares(E: Array, spectra: Spectra) -> dict[str, float]:
    """Effect of each entry of E per row for gusts as strong as those flown."""
    rms = np.sqrt(np.mean(np.abs(spectra.z[:, GUST]) ** 2, axis=0))
    shares = {}
    for name, row in (("p", NINE.p), ("q", NINE.q), ("r", NINE.r)):
        effect = np.abs(E[row]) * rms
        for axis, value in zip(WIND, effect, strict=True):
            shares[f"E({name},{axis})"] = float(value / max(effect.max(), 1e-300))
    return shares


# -------------------------------------------------------------------------------------------------
# Identified models as systems of python-control with named signals.
#
# For analysis and pictures: python-control takes seconds to import, so the fits do not use this
# module. What they use (`response.transfer`) is compared with it in the tests.
# -------------------------------------------------------------------------------------------------

COMMANDS = tuple(f"d_{name}" for name in ACTUATORS)


def identified_system(actuators: IdentifiedAB, gusts: IdentifiedE) -> control.StateSpace:
    """A, B, E of eq. (10), as `heli_core.linear.hover_system`."""
    return hover_system(actuators.A, actuators.B, gusts.E, "identified")


def sampled_rates(model: FastModel) -> control.StateSpace:
    """p, q, r at the ticks after commands and gusts that are held over a tick, exactly.

    Parameters
    ----------
    model : FastModel

    Returns
    -------
    control.StateSpace
        Inputs `COMMANDS` as sent, then `WIND` (m/s); outputs p, q, r (rad/s); sampled.
    """
    F, G = with_servos(model.A, model.B, model.servo_radps, model.servo_damping)
    A, B = with_delay_line(held_late(F, G, TICK_S, model.delay_s))
    E = np.zeros((F.shape[0], len(WIND_INPUTS)))
    E[: model.E.shape[0]] = model.E[:, AIR.velocity]
    B_wind = np.zeros((A.shape[0], len(WIND_INPUTS)))
    B_wind[: F.shape[0]] = held(F, E, TICK_S)[1]
    import control

    return control.ss(
        A,
        np.hstack([B, B_wind]),
        np.eye(A.shape[0])[RATE_STATES],
        np.zeros((len(RATES), len(COMMANDS) + len(WIND_INPUTS))),
        TICK_S,
        inputs=[*COMMANDS, *WIND_INPUTS],
        outputs=list(RATES),
    )


# -------------------------------------------------------------------------------------------------
# Trim of hover from the mean of a flight, and the collective's gain.
# -------------------------------------------------------------------------------------------------

_ATTITUDE = slice(NINE.phi, NINE.p)  # roll and pitch
_CYCLIC = slice(ACTUATOR.lat, ACTUATOR.ped)
_FLAPPING = slice(NINE.a_s, NINE.r)


@dataclass(frozen=True)
class IdentifiedTrim:
    """Trim of eq. (10).

    Attributes
    ----------
    x : (9,) array
        phi theta p q a_s b_s r d_int psi, rad and rad/s. psi is 0 by choice; so is d_int, as an
        integrator's zero is a convention that observer and controller share.
    u : (4,) array
        d_lat, d_lon, d_ped, d_col.
    x_sigma, u_sigma : arrays of the same shapes
        Scatter of the means over periods, over the square root of their number, with the price of
        their correlation: wind that lasts longer than a period does not average out.
    """

    x: Array
    u: Array
    x_sigma: Array
    u_sigma: Array


def trim_of(experiments: Experiment | Sequence[Experiment], model: IdentifiedAB) -> IdentifiedTrim:
    """Trim from the evaluated periods of one or more hovering flights.

    Attitude and actuators are means over whole periods, so the excitation drops out. The flapping
    angles follow from the rotor's own equilibrium: 0 = M [a_s b_s] + N [d_lat d_lon], as the disc
    is level when the cyclic is zero. Steady wind during the flights is in the result.

    Raises
    ------
    IdentificationError
        As `Experiment.steady`.
    """
    flights = [experiments] if isinstance(experiments, Experiment) else list(experiments)
    attitude: list[Array] = []
    command: list[Array] = []
    for flight in flights:
        steady = flight.steady()
        shape = (steady.periods, steady.period_ticks, -1)
        attitude.append(steady.attitude_rad[:, _ATTITUDE].reshape(shape).mean(axis=1))
        command.append(steady.u.reshape(shape).mean(axis=1))
    angles, u = np.vstack(attitude), np.vstack(command)
    x, x_sigma = np.zeros(len(NINE)), np.zeros(len(NINE))
    x[_ATTITUDE] = angles.mean(axis=0)
    x_sigma[_ATTITUDE] = _sigma_of_mean(attitude)
    gain = -np.linalg.solve(model.fast.A[ROTOR, ROTOR], model.fast.B[ROTOR, _CYCLIC])
    u_mean, u_sigma = u.mean(axis=0), _sigma_of_mean(command)
    x[_FLAPPING] = gain @ u_mean[_CYCLIC]
    x_sigma[_FLAPPING] = np.sqrt(gain**2 @ u_sigma[_CYCLIC] ** 2)
    return IdentifiedTrim(x, u_mean, x_sigma, u_sigma)


def _sigma_of_mean(flights: list[Array]) -> Array:
    """Standard deviation of the mean of period means (n, c) per flight.

    Within a flight a first-order autoregression, its coefficient a from neighbouring periods, makes
    n periods worth n (1 - a) / (1 + a) independent ones, at least one.
    """
    everything = np.vstack(flights)
    centred = [flight - everything.mean(axis=0) for flight in flights]
    power = sum(np.sum(x**2, axis=0) for x in centred)
    product = sum(np.sum(x[1:] * x[:-1], axis=0) for x in centred)
    a = np.clip(product / np.maximum(power, 1e-300), 0.0, 0.95)
    independent = np.maximum(everything.shape[0] * (1.0 - a) / (1.0 + a), 1.0)
    return np.asarray(everything.std(axis=0, ddof=1) / np.sqrt(independent))


# -------------------------------------------------------------------------------------------------
# The collective's gain K_col for the altitude controller's thrust map, from the specific
# force in z.
# -------------------------------------------------------------------------------------------------

_COL, _GUST_W = CHANNELS.index("col"), CHANNELS.index("w")
_COLLECTIVE_LEAST_LINES = 4
_LARGEST_ERROR = 0.2


@dataclass(frozen=True)
class RotorGeometry:
    """Main rotor as ruler, scale and tachometer give it, SI; lift slope of the blade in 1/rad."""

    rho: float
    omega: float
    radius: float
    lift_slope: float
    blades: float
    chord: float

    def thrust_per_pitch(self, thrust_n: float) -> float:
        """dT/dtheta, N/rad, in hover: blade element with momentum theory's inflow.

        T = s (2/3 Omega R theta - v_i), v_i^2 = T / (2 rho pi R^2), s = rho Omega R^2 C_la b c / 4
        (Cai, Chen, Lee, Unmanned Rotorcraft Systems, 2011, ch. 6).
        """
        slope = self.rho * self.omega * self.lift_slope * self.radius**2
        slope *= self.blades * self.chord / 4.0
        disk = 2.0 * self.rho * np.pi * self.radius**2
        inflow = np.sqrt(thrust_n / disk)
        return float(slope * self.omega * self.radius / 1.5 / (1.0 + slope / (2.0 * disk * inflow)))


@dataclass(frozen=True)
class IdentifiedCollective:
    """The collective's effect.

    Attributes
    ----------
    force_per_collective, force_per_collective_sigma : float
        Specific force along body z per unit of d_col, m/s2; negative thrust is up.
    force_per_w, force_per_w_sigma : float
        Specific force along body z per m/s of vertical air velocity relative to the aircraft, 1/s.
    K_col, K_col_sigma : float
        Blade pitch per unit of d_col, rad, that makes the thrust map give that force.
    """

    force_per_collective: float
    force_per_collective_sigma: float
    force_per_w: float
    force_per_w_sigma: float
    K_col: float
    K_col_sigma: float


def fit_collective(
    experiment: Experiment,
    identified: IdentifiedAB,
    mass_kg: float,
    gravity_mps2: float,
    rotor: RotorGeometry,
) -> IdentifiedCollective:
    """Fit the thrust's answer to the collective on its own lines.

    `f_z = c (servo of d_col) + k (gust - velocity)_w`, weighed by the noise beside each line; servo
    and delay as identified. Mass comes from a scale.

    Raises
    ------
    IdentificationError
        NO_EXCITATION or TOO_FEW_LINES of d_col, LOW_COHERENCE if the gain's sigma exceeds 20 %.
    """
    spectra = spectra_of(experiment)
    lines = spectra.channel == _COL
    count = int(lines.sum())
    if count < _COLLECTIVE_LEAST_LINES:
        cause = (
            IdentificationCause.NO_EXCITATION if count == 0 else IdentificationCause.TOO_FEW_LINES
        )
        raise IdentificationError(
            cause,
            f"excitation_u.col has {count} lines, at least {_COLLECTIVE_LEAST_LINES} are needed",
        )
    force = hann_amplitudes(experiment.steady().accel_body_mps2[:, 2:])[:, 0]
    servo = transfer(identified.fast, spectra.omega_radps, states=True)[:, SERVOS][:, ACTUATOR.col]
    command = U.start + ACTUATOR.col
    position = servo[:, command - INPUTS.start] * spectra.z[:, command]
    wind = (spectra.z[:, GUST] - spectra.z[:, VEL])[:, AIR.w]
    scatter = np.mean(np.abs(force[spectra.noise_bins][spectra.neighbours]) ** 2, axis=1)
    weight = 1.0 / np.sqrt(scatter[lines])
    M = np.column_stack([position[lines], wind[lines]]) * weight[:, None]
    b = force[spectra.bins[lines]] * weight
    M, b = np.vstack([M.real, M.imag]), np.concatenate([b.real, b.imag])
    values = np.linalg.lstsq(M, b, rcond=None)[0]
    spread = max(1.0, 2.0 * float(np.sum((b - M @ values) ** 2)) / (b.size - 2))
    sigma = np.sqrt(np.diag(np.linalg.inv(M.T @ M)) * 0.5 * spread)
    if not sigma[0] < _LARGEST_ERROR * abs(values[0]):
        raise IdentificationError(
            IdentificationCause.LOW_COHERENCE,
            f"accel_body_mps2.z answers excitation_u.col with {values[0]:.3g} +- {sigma[0]:.2g} "
            f"m/s2 per unit, at most {100.0 * _LARGEST_ERROR:.0f} % of uncertainty is allowed",
        )
    per_pitch = rotor.thrust_per_pitch(mass_kg * gravity_mps2) / mass_kg
    return IdentifiedCollective(
        force_per_collective=float(values[0]),
        force_per_collective_sigma=float(sigma[0]),
        force_per_w=float(values[1]),
        force_per_w_sigma=float(sigma[1]),
        K_col=float(-values[0] / per_pitch),
        K_col_sigma=float(sigma[0] / per_pitch),
    )


def relative_air_w(
    experiment: Experiment, identified: IdentifiedAB, collective: IdentifiedCollective
) -> Array:
    """Vertical air velocity relative to the aircraft (N,), m/s down, over the evaluated periods.

    The rotor is an anemometer: what the accelerometer shows beyond the collective's part is thrust
    by vertical air, turbulence included. The thrust per air velocity is found anew on the lines of
    the gust; the mean is taken for zero.

    Raises
    ------
    IdentificationError
        NO_EXCITATION or TOO_FEW_LINES of the gust's w.
    """
    spectra = spectra_of(experiment)
    lines = spectra.channel == _GUST_W
    if int(lines.sum()) < _COLLECTIVE_LEAST_LINES:
        raise IdentificationError(
            IdentificationCause.NO_EXCITATION
            if not lines.any()
            else IdentificationCause.TOO_FEW_LINES,
            f"gust_body_mps.w has {int(lines.sum())} lines, at least "
            f"{_COLLECTIVE_LEAST_LINES} are needed",
        )
    steady = experiment.steady()
    position = _servo(steady.u[:, ACTUATOR.col], identified)
    rest = steady.accel_body_mps2[:, 2] - collective.force_per_collective * position
    force = hann_amplitudes(rest[:, None])[:, 0][spectra.bins[lines]]
    wind = (spectra.z[lines, GUST] - spectra.z[lines, VEL])[:, AIR.w]
    per_w = float(np.real(np.vdot(wind, force)) / np.real(np.vdot(wind, wind)))
    return (rest - rest.mean()) / per_w


def _servo(command: Array, identified: IdentifiedAB) -> Array:
    """Servo positions (N,) of commands held over a tick after the delay; starts at rest."""
    servo = (identified.servo_radps, identified.servo_damping)
    Phi, column = held(*with_servos(np.zeros((0, 0)), np.zeros((0, 1)), *servo), TICK_S)
    # x(n + 1) = Phi x(n) + Gamma u(n), position = x_0, as a difference equation of second order
    Gamma = column[:, 0]
    denominator = np.array([1.0, -np.trace(Phi), np.linalg.det(Phi)])
    numerator = np.array([0.0, Gamma[0], Phi[0, 1] * Gamma[1] - Phi[1, 1] * Gamma[0]])
    moved = command - command[0]
    late = np.concatenate([np.zeros(identified.delay_ticks), moved])[: command.size]
    return np.asarray(lfilter(numerator, denominator, late) + command[0])
