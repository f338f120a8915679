# SPDX-License-Identifier: Apache-2.0
"""LQR with the weights of (11), (12): the yardstick beside H-infinity, and its limit gamma ->
inf."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from heli_inner_hinf.regular_form import Matrix, checked_plant, regular_form
from heli_inner_hinf.riccati import lqr_solution
from heli_inner_hinf.system_norm import hinf_norm
from heli_inner_hinf.weights import checked


@dataclass(frozen=True)
class Lqr:
    """LQR gains: F (n_u, n), G (n_u, n_u) as in eq. (15), and the norm wind -> h they achieve."""

    F: Matrix
    G: Matrix
    P: Matrix
    norm: float


def lqr(
    A: ArrayLike, B: ArrayLike, E: ArrayLike, C: ArrayLike, D: ArrayLike, C_out: ArrayLike
) -> Lqr:
    """State feedback that minimises the integral of |C x + D u|^2; arguments as in `synthesize`.

    Raises
    ------
    ShapeError, NotStabilizableError, InvariantZeroError, FeedforwardError
        As in `synthesize`.
    """
    from heli_inner_hinf.synthesis import feedforward, state_feedback

    a, b, e, c, d = checked_plant(A, B, E, C, D)
    c_out = checked("C_out", C_out, (b.shape[1], a.shape[0]))
    form = regular_form(a, b, e, c, d)
    P = form.P_given(lqr_solution(form))
    F = state_feedback(b, c, d, P)
    norm, _ = hinf_norm(a + b @ F, e, c + d @ F)
    return Lqr(F, feedforward(a, b, F, c_out), np.asarray(P, dtype=np.float64), norm)
