# SPDX-License-Identifier: Apache-2.0
"""E of eq. (10) from a flight with injected gusts (the paper's way to E)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import minimize_scalar

from heli_identification.actuators import LEAST_COHERENCE, IdentifiedAB
from heli_identification.errors import Cause, IdentificationError
from heli_identification.estimator import Estimate, Problem, estimate
from heli_identification.experiment import WIND, Array, Experiment
from heli_identification.places import AIR, FAST, STATE
from heli_identification.response import transfer
from heli_identification.spectra import GUST, Spectra, U, Y, spectra_of
from heli_identification.structure import gust_parameters, place_of, values_of
from heli_math.rows import NINE

_LEAST_LINES = 4
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
        own = spectra.own(4 + i, _LEAST_LINES)
        power = np.abs(left[own]) ** 2
        result[axis] = float(np.max(np.median(power / (power + scatter[own]), axis=0)))
    best = max(result.values())
    if best < LEAST_COHERENCE:
        raise IdentificationError(
            Cause.LOW_COHERENCE,
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
        From `collective.relative_air_w`; its mean, which that does not know, is fitted.

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
