# SPDX-License-Identifier: Apache-2.0
"""Which entries of eq. (10) the data tell from zero.

Small entries resemble larger ones (A(p,p) and the flapping rate, A(q,b_s) and B(a_s,d_lat)): left
free all at once, they drag each other far from zero together. So the fit begins with the entries
that the physics of eq. (6) to (8) demands and takes in another one only if the data ask for it, the
most urgent first, as long as the Bayesian information criterion falls: if it lowers the cost by
more than ln(number of real residuals) (Schwarz, Annals of Statistics 6, 1978). Those that have
become superfluous by later ones are dropped by the same rule. It is Efroymson's stepwise
regression on the linearised residual, with a fit in between.
"""

from collections.abc import Callable

import numpy as np

from heli_identification.estimator import Estimate, Problem, estimate
from heli_identification.experiment import Array
from heli_identification.response import FastModel
from heli_identification.spectra import Spectra
from heli_identification.structure import ESSENTIAL, EXPECTED, values_of

_ROUNDS = 6


def urgent(
    problem: Problem, values: Array, names: tuple[str, ...], limit: float
) -> tuple[tuple[str, ...], Array]:
    """Names to take in beside the problem's own, and start values for all of them together.

    Greedy on the residual linearised at `values` with the weights there.
    """
    live = [*problem.names, *(name for name in names if name not in problem.names)]
    n = len(problem.names)
    wide = Problem(problem.spectra, live, problem.base, problem.distortion)
    at = np.concatenate([values, np.zeros(len(live) - n)])
    whiteners = wide.whiteners(at)
    J, r = wide.jacobian(at, whiteners), wide.residual(at, whiteners)
    taken = list(range(n))
    while True:
        Q = np.linalg.qr(J[:, taken])[0]
        left = r - Q @ (Q.T @ r)
        others = [i for i in range(len(live)) if i not in taken]
        if not others:
            break
        free = J[:, others] - Q @ (Q.T @ J[:, others])
        length = np.maximum(np.sum(free**2, axis=0), 1e-12 * np.sum(J[:, others] ** 2, axis=0))
        gain = (free.T @ left) ** 2 / np.maximum(length, 1e-300)
        best = int(np.argmax(gain))
        if gain[best] <= limit:
            break
        taken.append(others[best])
    step = np.linalg.lstsq(J[:, taken], -r, rcond=1e-10)[0] if len(taken) > n else np.zeros(n)
    return tuple(live[i] for i in taken), at[taken] + step


def superfluous(found: Estimate, limit: float) -> tuple[str, ...]:
    """Names whose loss raises the cost by less than `limit`, one by one, the least needed first."""
    values, covariance = found.values.copy(), found.covariance.copy()
    live = [i for i, name in enumerate(found.names) if name not in ESSENTIAL | EXPECTED]
    dropped = []
    while live:
        ratios = [values[i] ** 2 / max(covariance[i, i], 1e-300) for i in live]
        worst = int(np.argmin(ratios))
        if ratios[worst] >= limit:
            break
        i = live.pop(worst)
        gain = covariance[:, i] / max(covariance[i, i], 1e-300)
        values = values - gain * values[i]
        covariance = covariance - np.outer(gain, covariance[i])
        dropped.append(found.names[i])
    return tuple(dropped)


def select(
    spectra: Spectra,
    names: tuple[str, ...],
    first: FastModel,
    progress: Callable[[str], None] | None = None,
) -> Estimate:
    """A loosely converged fit of the entries that the data ask for.

    Parameters
    ----------
    spectra : Spectra
    names : tuple of str
        All that may be free.
    first : FastModel
        Start.
    """
    limit = float(np.log(6 * spectra.omega_radps.size))
    kept = tuple(name for name in names if name in ESSENTIAL | EXPECTED)
    start = values_of(kept, first)
    distortion = 0.0
    seen = set()
    for _ in range(_ROUNDS):
        problem = Problem([spectra], kept, None, distortion)
        found = estimate(problem, start, fine=False, joint=False, progress=progress)
        distortion = found.distortion
        seen.add(frozenset(kept))
        drop = superfluous(found, limit)
        if drop:
            kept = tuple(name for name in kept if name not in drop)
            start = found.values[[found.names.index(name) for name in kept]]
        else:
            kept, start = urgent(problem, found.values, names, limit)
        if frozenset(kept) in seen:
            break
    return found
