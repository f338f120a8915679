# SPDX-License-Identifier: Apache-2.0
"""H-infinity norm between samples: continuous disturbance to error, controller sampled.

The lifted system (Bamieh, Pearson, *IEEE Trans. Autom. Control* 37, 1992) takes a whole tick of
wind and gives a whole tick of error. For one level gamma its test is that of a discrete system of
finite order, whose input and output come from the Hamiltonian of a tick (Chen, Francis, *Optimal
Sampled-Data Control Systems*, 1995, ch. 13). N(gamma), gamma times that system's norm, falls with
gamma and equals it at the norm, so N of an upper bound is a lower bound and the other way round.
"""

from typing import NamedTuple

import numpy as np
from scipy.linalg import expm

from heli_core.errors import RobustCause, RobustError
from heli_inner_hinf.mu import Matrix, discrete_norm, root

REL_TOL = 1e-7
_MOST_STEPS = 60
_ROUNDING = 1e-9  # relative accuracy of the discrete norm, and more
_SHORTEST_S = 1e-9  # a part of a tick that is shorter than this is rounding


class HeldPlant(NamedTuple):
    """x' = A x + B u + E w, error z = C x, read at the tick: y = C_y x.

    Attributes
    ----------
    A, B, E, C, C_y : (n, n), (n, n_u), (n, n_w), (n_z, n), (n_y, n) arrays
    tick_s, delay_s : float
        u(k) is held over a tick and acts delay_s after it was worked out, s.
    """

    A: Matrix
    B: Matrix
    E: Matrix
    C: Matrix
    C_y: Matrix
    tick_s: float
    delay_s: float


class SampledLaw(NamedTuple):
    """x+ = A x + B y, u = C x + D y, once a tick."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix


class SampledNorm(NamedTuple):
    """lower <= norm <= upper; frequency (rad/s) below Nyquist's at which it is reached."""

    lower: float
    upper: float
    frequency_radps: float


class _Stretch(NamedTuple):
    """A stretch of time at one level: end and start costate from start state and end costate.

    x(end) = Phi x(0) + G p(end), p(0) = Q x(0) + Phi' p(end).
    """

    Phi: Matrix
    G: Matrix
    Q: Matrix


def sampled_norm(plant: HeldPlant, law: SampledLaw, rel_tol: float = REL_TOL) -> SampledNorm:
    """The norm from w to z of the closed loop, between samples, enclosed to `rel_tol`.

    Raises
    ------
    RobustError
        NOT_FINITE or UNSTABLE.
    """
    parts = (plant.A, plant.B, plant.E, plant.C, plant.C_y)
    for owner, matrices in (("plant", parts), ("law", law)):
        for at, matrix in enumerate(matrices):
            if not np.all(np.isfinite(matrix)):
                raise RobustError(
                    RobustCause.NOT_FINITE,
                    f"matrix {at + 1} of the {owner} holds a value not finite",
                )
    loop = _Lifted(plant, law)
    radius = float(np.max(np.abs(np.linalg.eigvals(loop.lifted(np.inf)[0]))))
    if radius >= 1.0:
        raise RobustError(RobustCause.UNSTABLE, f"a pole has the modulus {radius:.6g}, not below 1")
    low, high = 0.0, 2.0 * loop.direct_bound(plant.tick_s)
    if high == 0.0:
        return SampledNorm(0.0, 0.0, 0.0)
    while (reached := loop.step(high))[0] > high:
        high *= 4.0
    after, angle = reached
    for _ in range(_MOST_STEPS):
        low = max(low, after)
        if high - low <= rel_tol * high:
            break
        upper = loop.step(low)[0]
        if upper < high:
            high = upper
        else:
            middle = 0.5 * (low + high)
            upper = loop.step(middle)[0]
            low, high = (low, middle) if upper < middle else (middle, min(high, upper))
        after, angle = loop.step(high)
    return SampledNorm(low * (1.0 - _ROUNDING), high * (1.0 + _ROUNDING), angle / plant.tick_s)


class _LevelReachedError(Exception):
    """A stretch of time alone has at least the gain of the level."""


class _Lifted:
    """The closed loop over one tick; its state is (x, the controller's, u(k-1), u(k-2), ...)."""

    def __init__(self, plant: HeldPlant, law: SampledLaw) -> None:
        n, m = plant.B.shape
        ticks = int((plant.delay_s + _SHORTEST_S) / plant.tick_s)
        late_s = plant.delay_s - ticks * plant.tick_s
        self._late_s = late_s if late_s > _SHORTEST_S else 0.0
        depth = ticks + (1 if self._late_s else 0)
        k = law.A.shape[0]
        size = n + k + m * depth
        command = np.zeros((m * (depth + 1), size))
        command[:m, :n], command[:m, n : n + k] = law.D @ plant.C_y, law.C
        command[m:, n + k :] = np.eye(m * depth)
        older = command[m * depth :]
        newer = command[m * ticks : m * (ticks + 1)]
        # Within the tick: x, and the two commands that act one after the other.
        self._start = np.vstack([np.eye(n, size), older, newer])
        self._A_of_law = np.zeros((size, size))
        self._A_of_law[n : n + k, :n], self._A_of_law[n : n + k, n : n + k] = (
            law.B @ plant.C_y,
            law.A,
        )
        self._A_of_law[n + k :] = command[: m * depth]
        self._n = n
        none = np.zeros((2 * m, n + 2 * m))
        first = np.vstack([np.hstack([plant.A, plant.B, np.zeros((n, m))]), none])
        then = np.vstack([np.hstack([plant.A, np.zeros((n, m)), plant.B]), none])
        self._parts = ((first, self._late_s), (then, plant.tick_s - self._late_s))
        wind = np.vstack([plant.E, np.zeros((2 * m, plant.E.shape[1]))])
        self._EE = wind @ wind.T
        error = np.hstack([plant.C, np.zeros((plant.C.shape[0], 2 * m))])
        self._CC = error.T @ error
        self._plant = plant

    def step(self, level: float) -> tuple[float, float]:
        """N(level) and the angle at which it is reached; inf if the level is too low for one."""
        try:
            A, B, C = self.lifted(level)
            norm, angle = discrete_norm(A, B, C, np.zeros((C.shape[0], B.shape[1])))
        except (_LevelReachedError, RobustError):
            return np.inf, 0.0
        return level * norm, angle

    def lifted(self, level: float) -> tuple[Matrix, Matrix, Matrix]:
        """A, B, C of the discrete system whose norm is below 1 if the loop's is below the level."""
        parts = [self._stretch(A, time_s, level) for A, time_s in self._parts if time_s]
        whole = parts[0] if len(parts) == 1 else _joined(*parts)
        n = self._n
        A = self._A_of_law.copy()
        A[:n] = whole.Phi[:n] @ self._start
        B = np.zeros((A.shape[0], n))
        B[:n] = root(whole.G[:n, :n])
        return A, B, root(whole.Q).T @ self._start

    def direct_bound(self, time_s: float) -> float:
        """Hilbert-Schmidt norm of wind to error within a time: no gain within it is larger.

        Its square is the integral of (time - s) |C e^(A s) E|^2 over s, here by Gauss's rule.
        """
        A, E, C = self._plant.A, self._plant.E, self._plant.C
        at, weight = np.polynomial.legendre.leggauss(12)
        times = 0.5 * time_s * (1.0 + at)
        size = [np.sum(np.square(C @ expm(A * s) @ E)) for s in times]
        return float(np.sqrt(0.5 * time_s * np.sum(weight * (time_s - times) * size)))

    def _stretch(self, A: Matrix, time_s: float, level: float) -> _Stretch:
        if self.direct_bound(time_s) >= level:
            half = self._stretch(A, 0.5 * time_s, level)
            return _joined(half, half)
        n = A.shape[0]
        H = np.block([[A, self._EE / level], [-self._CC / level, -A.T]])
        e = expm(H * time_s)
        back = np.linalg.inv(e[n:, n:])
        G, Q = e[:n, n:] @ back, -back @ e[n:, :n]
        return _Stretch(back.T, 0.5 * (G + G.T), 0.5 * (Q + Q.T))


def _joined(first: _Stretch, then: _Stretch) -> _Stretch:
    """The first stretch and then the other."""
    n = first.Phi.shape[0]
    if np.max(np.linalg.eigvals(first.G @ then.Q).real) >= 1.0:
        raise _LevelReachedError
    forward = np.linalg.solve((np.eye(n) - first.G @ then.Q).T, then.Phi.T).T
    backward = np.linalg.solve((np.eye(n) - then.Q @ first.G).T, first.Phi).T
    return _Stretch(
        forward @ first.Phi,
        then.G + forward @ first.G @ then.Phi.T,
        first.Q + backward @ then.Q @ first.Phi,
    )
