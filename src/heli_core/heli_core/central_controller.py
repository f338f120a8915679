# SPDX-License-Identifier: Apache-2.0
"""H-infinity output feedback: the central controller of a sampled generalised plant.

    x+ = A x + B1 w + B2 u,   z = C1 x + D11 w + D12 u,   y = C2 x + D21 w + D22 u

For a bound gamma on ||w -> z||_inf the plant is turned into a continuous one by the bilinear map,
which keeps norms and stability, and solved there by the two Riccati equations of Glover and Doyle
(Zhou, Doyle, Glover, Robust and Optimal Control, 1996, theorem 17.1): X of the control problem, Y
of the filter problem, and rho(X Y) < gamma^2. The controller is mapped back.

The last `n_known` states may be integrals of y: they are known without error, whatever noise y has,
so that Y has zeros there; the filter equation is solved for the others (for an integral alone it
has no stabilising solution, as an unstable mode that y does not see).
"""

import enum
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_continuous_are

Matrix = NDArray[np.float64]

_INDEFINITE = 1e-9
"""A solution whose least eigenvalue is below minus this share of its largest is not P >= 0."""
_BISECTION = 1e-4
"""Relative width to which gamma* is bracketed."""
_LARGEST_GAMMA = 1e9
_STRIDE = 4.0


class Obstacle(enum.Enum):
    """Why there is no controller below a gamma."""

    DIRECT = "the direct path from disturbance to output is as large as gamma"
    CONTROL = "the control Riccati equation has no stabilising solution X >= 0"
    FILTER = "the filter Riccati equation has no stabilising solution Y >= 0"
    COUPLING = "the spectral radius of X Y reaches gamma squared"


class NoControllerError(ValueError):
    """No controller reaches the gamma that was asked for.

    Attributes
    ----------
    obstacle : Obstacle
    """

    def __init__(self, obstacle: Obstacle) -> None:
        super().__init__(obstacle.value)
        self.obstacle = obstacle


class System(NamedTuple):
    """x+ = A x + B u, y = C x + D u, or x' = A x + B u."""

    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix


@dataclass(frozen=True)
class GeneralisedPlant:
    """A sampled plant with its disturbances and weighted outputs.

    Attributes
    ----------
    system : System
        From (w, u) to (z, y); one step a period. D12 has full column, D21 full row rank.
    n_u, n_y : int
        How many of the last inputs are u, and of the last outputs y.
    n_known : int
        How many of the last states are integrals of y.
    """

    system: System
    n_u: int
    n_y: int
    n_known: int = 0


@dataclass(frozen=True)
class CentralController:
    """The central controller for a gamma.

    Attributes
    ----------
    gamma : float
    system : System
        From y to u, one step a period.
    input_of_u : (n, n_u) array
        What a difference between the flown u and that of the controller does to the state: the
        observer inside then hears what was flown.
    radius : float
        rho(X Y) / gamma^2, below one.
    residual : float
        Larger relative residual of the two Riccati equations, for all states.
    """

    gamma: float
    system: System
    input_of_u: Matrix
    radius: float
    residual: float


@dataclass(frozen=True)
class GammaInfimum:
    """Infimum of the norm over stabilising controllers.

    Attributes
    ----------
    lower, value : float
        Bracket, relative width 1e-4: nothing at `lower`, a controller at `value`.
    mechanism : Obstacle
        What ends feasibility.
    """

    lower: float
    value: float
    mechanism: Obstacle


def to_continuous(sampled: System) -> System:
    """The bilinear image z = (1 + s/2) / (1 - s/2): same norm, same stability; time in periods."""
    A, B, C, D = sampled
    M = np.linalg.inv(A + np.eye(A.shape[0]))
    return System(2.0 * (A - np.eye(A.shape[0])) @ M, 2.0 * M @ B, 2.0 * C @ M, D - C @ M @ B)


def to_sampled(continuous: System) -> System:
    """Inverse of `to_continuous`."""
    A, B, C, D = continuous
    M = np.linalg.inv(np.eye(A.shape[0]) - 0.5 * A)
    return System((np.eye(A.shape[0]) + 0.5 * A) @ M, M @ B, C @ M, D + 0.5 * C @ M @ B)


def central_controller(plant: GeneralisedPlant, gamma: float) -> CentralController:
    """The central controller with ||w -> z||_inf < gamma.

    Raises
    ------
    NoControllerError
        gamma is not above gamma*.
    """
    normal = _normalised(plant, to_continuous(plant.system), gamma)
    solution = _solved(normal)
    continuous, input_of_u = _central(normal, solution)
    heard = continuous._replace(
        B=np.hstack([continuous.B, input_of_u]), D=np.pad(continuous.D, ((0, 0), (0, plant.n_u)))
    )
    A, B, C, D = to_sampled(heard)
    from_y = System(A, B[:, : plant.n_y], C, D[:, : plant.n_y])
    return CentralController(gamma, from_y, B[:, plant.n_y :], solution.radius, solution.residual)


def optimal_gamma(plant: GeneralisedPlant, start: float = 1.0) -> GammaInfimum:
    """gamma* by bisection from `start`; every bound is a Riccati solution or an obstacle.

    Raises
    ------
    NoControllerError
        At any gamma: no controller stabilises the plant, or z and y do not see what they must.
    """
    continuous = to_continuous(plant.system)

    def obstacle(gamma: float) -> Obstacle | None:
        try:
            _solved(_normalised(plant, continuous, gamma))
        except NoControllerError as exc:
            return exc.obstacle
        return None

    high = start
    while (ends := obstacle(high)) is not None:
        high *= _STRIDE
        if high > _LARGEST_GAMMA:
            raise NoControllerError(ends)
    low = high / _STRIDE
    while (ends := obstacle(low)) is None:
        high, low = low, low / _STRIDE
        if low < 1.0 / _LARGEST_GAMMA:
            return GammaInfimum(0.0, high, Obstacle.DIRECT)
    while high > low * (1.0 + _BISECTION):
        middle = float(np.sqrt(low * high))
        obstacle_here = obstacle(middle)
        if obstacle_here is None:
            high = middle
        else:
            low, ends = middle, obstacle_here
    return GammaInfimum(low, high, ends)


class _Normal(NamedTuple):
    """The plant in continuous time with gamma = 1, D12 = [0; I], D21 = [0 I]; D22 is left out.

    unit_u, unit_y: u = unit_u u_n, y_n = unit_y y. D22: that of the plant, from u to y.
    """

    A: Matrix
    B1: Matrix
    B2: Matrix
    C1: Matrix
    C2: Matrix
    D11: Matrix
    D22: Matrix
    unit_u: Matrix
    unit_y: Matrix
    n_estimated: int


class _Solution(NamedTuple):
    """F and L of theorem 17.1, Z = (I - Y X)^-1, rho(X Y), relative residual."""

    F: Matrix
    L: Matrix
    Z: Matrix
    radius: float
    residual: float


def _normalised(plant: GeneralisedPlant, continuous: System, gamma: float) -> _Normal:
    A, B, C, D = continuous
    m2, p2 = plant.n_u, plant.n_y
    m1, p1 = B.shape[1] - m2, C.shape[0] - p2
    rotate_z, upper_u = np.linalg.qr(D[:p1, m1:] / gamma, mode="complete")
    rotate_w, upper_y = np.linalg.qr(D[p1:, :m1].T, mode="complete")
    rotate_z, rotate_w = np.roll(rotate_z, -m2, axis=1), np.roll(rotate_w, -p2, axis=1)
    unit_u, unit_y = np.linalg.inv(upper_u[:m2]), np.linalg.inv(upper_y[:p2].T)
    return _Normal(
        A,
        B[:, :m1] @ rotate_w,
        B[:, m1:] @ unit_u,
        rotate_z.T @ C[:p1] / gamma,
        unit_y @ C[p1:],
        rotate_z.T @ D[:p1, :m1] @ rotate_w / gamma,
        D[p1:, m1:],
        unit_u,
        unit_y,
        A.shape[0] - plant.n_known,
    )


def _solved(normal: _Normal) -> _Solution:
    """Both Riccati equations, or a NoControllerError."""
    A, B1, B2, C1, C2, D11, *_ = normal
    n, m1, m2 = A.shape[0], B1.shape[1], B2.shape[1]
    p1, p2 = C1.shape[0], C2.shape[0]
    for part in (D11[: p1 - m2], D11[:, : m1 - p2]):
        if np.linalg.norm(part, 2) >= 1.0:
            raise NoControllerError(Obstacle.DIRECT)
    D12, D21 = np.eye(p1, m2, m2 - p1), np.eye(p2, m1, m1 - p2)
    X, F, at_control = _riccati(
        A, np.hstack([B1, B2]), C1, np.hstack([D11, D12]), m1, n, Obstacle.CONTROL
    )
    Y, L, at_filter = _riccati(
        A.T, np.vstack([C1, C2]).T, B1.T, np.vstack([D11, D21]).T, p1, normal.n_estimated,
        Obstacle.FILTER,
    )  # fmt: skip
    radius = float(np.max(np.abs(np.linalg.eigvals(X @ Y))))
    if radius >= 1.0:
        raise NoControllerError(Obstacle.COUPLING)
    Z = np.asarray(np.linalg.inv(np.eye(n) - Y @ X), np.float64)
    return _Solution(F, L.T, Z, radius, max(at_control, at_filter))


def _riccati(
    A: Matrix, B: Matrix, C: Matrix, D: Matrix, m1: int, n: int, obstacle: Obstacle
) -> tuple[Matrix, Matrix, float]:
    """X >= 0, F = -R^-1 (D'C + B'X) and the relative residual of the game of (A, B, C, D).

        A'X + X A + C'C - (X B + C'D) R^-1 (B'X + D'C) = 0,   R = D'D - diag(I_m1, 0)

    It is solved for the first n states; X has zeros for the rest, which its residual judges, too.
    """
    R = D.T @ D
    R[range(m1), range(m1)] -= 1.0
    X = np.zeros_like(A)
    try:
        X[:n, :n] = solve_continuous_are(
            A[:n, :n], B[:n], C[:, :n].T @ C[:, :n], R, s=C[:, :n].T @ D
        )
    except (np.linalg.LinAlgError, ValueError) as exc:
        raise NoControllerError(obstacle) from exc
    X = 0.5 * (X + X.T)
    values = np.linalg.eigvalsh(X)
    if values[0] < -_INDEFINITE * values[-1]:
        raise NoControllerError(obstacle)
    F = np.asarray(-np.linalg.solve(R, D.T @ C + B.T @ X), np.float64)
    terms = A.T @ X, C.T @ C, F.T @ R @ F
    left = terms[0] + terms[0].T + terms[1] - terms[2]
    return X, F, float(np.linalg.norm(left) / sum(np.linalg.norm(term) for term in terms))


def _central(normal: _Normal, solution: _Solution) -> tuple[System, Matrix]:
    """Controller in continuous time, from y to u, and what u does to its state (n, n_u)."""
    A, B1, B2, C1, C2, D11, D22, unit_u, unit_y, _ = normal
    F, L, Z = solution.F, solution.L, solution.Z
    m1, m2, p1, p2 = B1.shape[1], B2.shape[1], C1.shape[0], C2.shape[0]
    q, k = p1 - m2, m1 - p2
    D_1, D_2 = D11[:q], D11[q:]
    inner = np.linalg.inv(np.eye(q) - D_1[:, :k] @ D_1[:, :k].T)
    D_y = -D_2[:, :k] @ D_1[:, :k].T @ inner @ D_1[:, k:] - D_2[:, k:]
    observed = Z @ (B2 + L[:, q:p1])
    C = F[m1:] - D_y @ (C2 + F[k:m1])
    from_y = observed @ D_y - Z @ L[:, p1:]
    A_k = A + np.hstack([B1, B2]) @ F - from_y @ (C2 + F[k:m1])
    # y of the normal plant is unit_y (y - D22 u)
    without_d22 = System(A_k, from_y @ unit_y, unit_u @ C, unit_u @ D_y @ unit_y)
    turn = np.linalg.inv(np.eye(m2) + without_d22.D @ D22)
    C_u, D_u = turn @ without_d22.C, turn @ without_d22.D
    B_u = observed @ np.linalg.inv(unit_u) - without_d22.B @ D22
    return System(
        without_d22.A - without_d22.B @ D22 @ C_u,
        without_d22.B - without_d22.B @ D22 @ D_u,
        C_u,
        D_u,
    ), B_u
