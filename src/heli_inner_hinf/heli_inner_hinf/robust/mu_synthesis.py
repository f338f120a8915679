# SPDX-License-Identifier: Apache-2.0
"""mu-synthesis by D-K iteration: one controller for every plant of a set.

In turn, until the peak of mu falls no more: the scalings D(omega) that bound mu of the closed loop,
a fit of their moduli by systems of fixed order, and the central H-infinity controller of the plant
so scaled (Doyle, 1985; Balas, Doyle, Glover, Packard, Smith, *mu-Analysis and Synthesis Toolbox*,
1993). The blocks are complex numbers; a real parameter is taken for one, which is on the safe side.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag
from scipy.optimize import least_squares

from heli_core.central_controller import (
    CentralController,
    GeneralisedPlant,
    NoControllerError,
    System,
    central_controller,
    optimal_gamma,
    to_sampled,
)
from heli_core.errors import RobustCause, RobustError
from heli_inner_hinf.mu import Matrix, scaled_mu

_MOST_ROUNDS = 8
_WORTH = 0.01
"""A round that lowers the peak by less than this share is the last."""
_ABOVE_STAR = 1.05
"""The central controller is taken at this multiple of gamma*, where it is well conditioned."""


@dataclass(frozen=True)
class MuLaw:
    """What the iteration found.

    Attributes
    ----------
    controller : CentralController
        Of the best round, of the order of the plant and twice that of the scalings.
    peaks : tuple of float
        Largest upper bound of mu over the frequencies, round by round.
    """

    controller: CentralController
    peaks: tuple[float, ...]

    @property
    def peak(self) -> float:
        """That of `controller`."""
        return min(self.peaks)


def dk_iteration(plant: GeneralisedPlant, orders: Sequence[int], angles: Matrix) -> MuLaw:
    """The controller of the least peak of mu that alternating finds.

    Parameters
    ----------
    plant : GeneralisedPlant
        The first outputs z and inputs w belong, one each, to blocks that are complex numbers of
        modulus up to one; the other z and w are the performance, one full block.
    orders : sequence of int
        For each of those numbers the order of the fit of its scaling; 0: a constant.
    angles : (m,) array
        Where on the unit circle mu is looked at, rad, inside (0, pi).

    Raises
    ------
    RobustError
        NOT_CONVERGED: there is no controller for the nominal plant, or mu of the best one is not
        finite.
    """
    scalings = [_constant(1.0)] * len(orders)
    best: CentralController | None = None
    peaks: list[float] = []
    gamma = 1.0
    for _ in range(_MOST_ROUNDS):
        scaled = _scaled(plant, scalings)
        try:
            gamma = optimal_gamma(scaled, gamma).value
            controller = central_controller(scaled, _ABOVE_STAR * gamma)
        except NoControllerError as exc:
            if best is not None:
                break
            raise RobustError(
                RobustCause.NOT_CONVERGED,
                f"D-K iteration: no controller for the nominal plant: {exc}",
            ) from exc
        mu, moduli = scaled_mu(response(closed_loop(plant, controller.system), angles), len(orders))
        peak = float(np.max(mu))
        if not np.isfinite(peak):
            break
        worth = not peaks or peak < (1.0 - _WORTH) * min(peaks)
        if not peaks or peak < min(peaks):
            best = controller
        peaks.append(peak)
        if not worth:
            break
        scalings = [_fitted(moduli[:, i], angles, n) for i, n in enumerate(orders)]
    if best is None:
        raise RobustError(
            RobustCause.NOT_CONVERGED, "D-K iteration: mu of the first controller is not finite"
        )
    return MuLaw(best, tuple(peaks))


def closed_loop(plant: GeneralisedPlant, law: System) -> System:
    """w -> z with the controller; states of plant, then controller. The plant's D22 must be 0."""
    A, B, C, D = plant.system
    w, z = B.shape[1] - plant.n_u, C.shape[0] - plant.n_y
    B2, C2, D12, D21 = B[:, w:], C[z:], D[:z, w:], D[z:, :w]
    return System(
        np.block([[A + B2 @ law.D @ C2, B2 @ law.C], [law.B @ C2, law.A]]),
        np.vstack([B[:, :w] + B2 @ law.D @ D21, law.B @ D21]),
        np.hstack([C[:z] + D12 @ law.D @ C2, D12 @ law.C]),
        D[:z, :w] + D12 @ law.D @ D21,
    )


def response(system: System, angles: Matrix) -> np.ndarray:
    """Response (m, n_y, n_u), complex, of a sampled system at angles (m,) of the circle, rad."""
    A, B, C, D = system
    inside = np.exp(1j * angles)[:, None, None] * np.eye(A.shape[0]) - A
    right = np.broadcast_to(B.astype(complex), (angles.size, *B.shape))
    return C @ np.linalg.solve(inside, right) + D


def series(first: System, then: System) -> System:
    """`then` behind `first`."""
    none = np.zeros((first.A.shape[0], then.A.shape[0]))
    return System(
        np.block([[first.A, none], [then.B @ first.C, then.A]]),
        np.vstack([first.B, then.B @ first.D]),
        np.hstack([then.D @ first.C, then.C]),
        then.D @ first.D,
    )


def _constant(gain: float) -> System:
    return System(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.full((1, 1), gain))


def _scaled(plant: GeneralisedPlant, scalings: Sequence[System]) -> GeneralisedPlant:
    """D plant D^-1, with ones for performance, u and y."""
    rows, columns = plant.system.D.shape
    left = _side_by_side(scalings, rows - len(scalings))
    right = _side_by_side([_inverse(d) for d in scalings], columns - len(scalings))
    system = series(series(right, plant.system), left)
    return GeneralisedPlant(system, plant.n_u, plant.n_y)


def _side_by_side(systems: Sequence[System], plain: int) -> System:
    rest = System(np.zeros((0, 0)), np.zeros((0, plain)), np.zeros((plain, 0)), np.eye(plain))
    return System(*(block_diag(*parts) for parts in zip(*systems, rest, strict=True)))


def _inverse(system: System) -> System:
    back = np.asarray(np.linalg.inv(system.D), np.float64)
    A, B, C, _ = system
    return System(A - B @ back @ C, B @ back, -back @ C, back)


def _fitted(moduli: Matrix, angles: Matrix, order: int) -> System:
    """A stable system with a stable inverse whose modulus on the circle is nearly that given.

    Least squares of the logarithm over k prod (s + a) / (s + b) in the bilinear map's s.
    """
    at = 2.0 * np.tan(0.5 * angles)
    wanted = np.log(moduli)

    def misfit(p: Matrix) -> Matrix:
        sizes = 0.5 * np.log(at[:, None] ** 2 + np.exp(2.0 * p[1:]))
        return p[0] + sizes[:, :order].sum(axis=1) - sizes[:, order:].sum(axis=1) - wanted

    low, high = np.log(at[0]), np.log(4.0 * at[-1])
    middle = np.quantile(np.log(at), np.linspace(0.3, 0.8, order)) if order else np.zeros(0)
    start = np.concatenate([wanted[-1:], middle - 0.1, middle + 0.1])
    bounds = np.array([[-np.inf] + [low] * 2 * order, [np.inf] + [high] * 2 * order])
    p = least_squares(misfit, start, bounds=bounds).x
    system = _constant(float(np.exp(p[0])))
    for zero, pole in zip(np.exp(p[1 : 1 + order]), np.exp(p[1 + order :]), strict=True):
        factor = System(*(np.array([[v]]) for v in (-pole, 1.0, zero - pole, 1.0)))
        system = series(system, factor)
    return to_sampled(system)
