# SPDX-License-Identifier: Apache-2.0
"""Controllers of a given structure: goals of the closed loop with gradients, and descent.

A plant takes disturbances w and commands u to goals' outputs z and measurements y; a controller
`u = K y` with or without memory closes it. The controller's matrices `K = [[A_k, B_k], [C_k, D_k]]`
depend affinely on free parameters: static gains, a PID, output feedback of a given order, F and G
of eq. (17), or blocks of these side by side (a cascade). With the controller's states joined to the
plant's the closed loop is affine in K, so every goal has one gradient rule (Apkarian, Noll,
"Nonsmooth H-infinity synthesis", IEEE TAC 51(1), 2006; Burke, Henrion, Lewis, Overton, "HIFOO",
ROCOND 2006):

    A = A_0 + B_2 K C_2,  B = B_1 + B_2 K D_21,  C = C_1 + D_12 K C_2,  D = D_11 + D_12 K D_21.

Soft goals are made small, the worst of them first; hard goals are kept below their bounds:
`minimise` of `heli_inner_hinf.nonsmooth`. Continuous (`dt_s` = 0) and sampled plants alike.
"""

from __future__ import annotations

import enum
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag, eig, solve_continuous_lyapunov, solve_discrete_lyapunov

from heli_core.central_controller import System, to_continuous
from heli_core.errors import SynthesisError
from heli_inner_hinf.mu import scaled_mu
from heli_inner_hinf.nonsmooth import Evaluation, minimise
from heli_inner_hinf.synthesis import Matrix, checked, hinf_norm

Vector = NDArray[np.float64]

# -------------------------------------------------------------------------------------------------
# Plants and structures.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class StructuredPlant:
    """x' = A x + B1 w + B2 u, z = C1 x + D11 w + D12 u, y = C2 x + D21 w; no path from u to y.

    Attributes
    ----------
    A, B1, B2, C1, C2, D11, D12, D21 : arrays
        (n, n), (n, n_w), (n, n_u), (n_z, n), (n_y, n), (n_z, n_w), (n_z, n_u), (n_y, n_w).
    dt_s : float
        Between two samples; 0: continuous.
    """

    A: Matrix
    B1: Matrix
    B2: Matrix
    C1: Matrix
    C2: Matrix
    D11: Matrix
    D12: Matrix
    D21: Matrix
    dt_s: float = 0.0

    def joined(self, order: int) -> StructuredPlant:
        """The plant with the states of a controller of that order, which its matrices then feed."""
        if order == 0:
            return self
        n, eye = self.A.shape[0], np.eye(order)
        return replace(
            self,
            A=block_diag(self.A, np.zeros((order, order))),
            B1=np.vstack([self.B1, np.zeros((order, self.B1.shape[1]))]),
            B2=block_diag(eye, self.B2)[np.r_[order : order + n, :order]],
            C1=np.hstack([self.C1, np.zeros((self.C1.shape[0], order))]),
            C2=block_diag(eye, self.C2)[:, np.r_[order : order + n, :order]],
            D12=np.hstack([np.zeros((self.D12.shape[0], order)), self.D12]),
            D21=np.vstack([np.zeros((order, self.D21.shape[1])), self.D21]),
        )


def plant_of(
    A: ArrayLike,
    B1: ArrayLike,
    B2: ArrayLike,
    C1: ArrayLike,
    C2: ArrayLike,
    D11: ArrayLike | None = None,
    D12: ArrayLike | None = None,
    D21: ArrayLike | None = None,
    dt_s: float = 0.0,
) -> StructuredPlant:
    """A plant with checked shapes; direct paths that are not given are zero.

    Raises
    ------
    ShapeError
        Names the matrix.
    """
    a = checked("A", A, (None, None))
    n = a.shape[0]
    b1, b2 = checked("B1", B1, (n, None)), checked("B2", B2, (n, None))
    c1, c2 = checked("C1", C1, (None, n)), checked("C2", C2, (None, n))
    shapes = {
        "D11": (D11, (c1.shape[0], b1.shape[1])),
        "D12": (D12, (c1.shape[0], b2.shape[1])),
        "D21": (D21, (c2.shape[0], b1.shape[1])),
    }
    direct = {
        name: np.zeros(shape) if given is None else checked(name, given, shape)
        for name, (given, shape) in shapes.items()
    }
    return StructuredPlant(checked("A", a, (n, n)), b1, b2, c1, c2, **direct, dt_s=dt_s)


@dataclass(frozen=True)
class LawStructure:
    """K (order + n_u, order + n_y) = base + sum of parameter times its matrix of `basis`.

    Attributes
    ----------
    order : int
        Number of the controller's states.
    base : (k + n_u, k + n_y) array
    basis : (m, k + n_u, k + n_y) array
    """

    order: int
    base: Matrix
    basis: NDArray[np.float64]

    @property
    def size(self) -> int:
        """Number of free parameters."""
        return self.basis.shape[0]

    def matrix(self, parameters: Vector) -> Matrix:
        """K of the parameters (m,)."""
        return self.base + np.tensordot(parameters, self.basis, 1)

    def slope(self, of_K: Matrix) -> Vector:
        """The gradient (m,) in the parameters of the gradient in K."""
        return np.tensordot(self.basis, of_K, 2)

    def law(self, parameters: Vector) -> System:
        """A_k, B_k, C_k, D_k."""
        K, k = self.matrix(parameters), self.order
        return System(K[:k, :k], K[:k, k:], K[k:, :k], K[k:, k:])


def affine(law: Callable[[Vector], System], size: int) -> LawStructure:
    """Structure of controllers that are affine in `size` numbers, from a function of them."""

    def stacked(numbers: Vector) -> Matrix:
        A, B, C, D = law(numbers)
        return np.block([[A, B], [C, D]])

    base = stacked(np.zeros(size))
    basis = np.array([stacked(one) - base for one in np.eye(size)]).reshape(size, *base.shape)
    return LawStructure(law(np.zeros(size)).A.shape[0], base, basis)


def output_feedback(order: int, n_u: int, n_y: int) -> LawStructure:
    """All matrices free: static output feedback for order 0."""
    rows, columns = order + n_u, order + n_y
    return LawStructure(
        order,
        np.zeros((rows, columns)),
        np.eye(rows * columns).reshape(rows * columns, rows, columns),
    )


def side_by_side(*structures: LawStructure) -> LawStructure:
    """Blocks of a cascade or decentralised controller: each with its own y, u and parameters."""
    orders = [one.order for one in structures]
    total = sum(orders)

    def placed(matrices: Sequence[Matrix]) -> Matrix:
        """States of all first, then the commands or measurements of all."""
        whole = block_diag(*matrices)

        def moved(sizes: Sequence[int]) -> NDArray[np.int64]:
            ends = np.cumsum([0, *sizes])
            states = [np.arange(ends[i], ends[i] + orders[i]) for i in range(len(orders))]
            rest = [np.arange(ends[i] + orders[i], ends[i + 1]) for i in range(len(orders))]
            return np.concatenate([*states, *rest]).astype(np.int64)

        return whole[np.ix_(
            moved([m.shape[0] for m in matrices]), moved([m.shape[1] for m in matrices])
        )]  # fmt: skip

    zeros = [np.zeros_like(one.base) for one in structures]
    basis = [
        placed([*zeros[:i], matrix, *zeros[i + 1 :]])
        for i, one in enumerate(structures)
        for matrix in one.basis
    ]
    return LawStructure(total, placed([one.base for one in structures]), np.array(basis))


# -------------------------------------------------------------------------------------------------
# Functions of a closed loop with their gradients in its matrices.
# -------------------------------------------------------------------------------------------------


class Slope(NamedTuple):
    """A value and its gradients in A, B, C, D of the closed loop."""

    value: float
    A: Matrix
    B: Matrix
    C: Matrix
    D: Matrix


def _nothing(loop: System, value: float) -> Slope:
    return Slope(value, *(np.zeros_like(one) for one in loop))


def _rates(poles: NDArray[np.complex128], dt_s: float) -> NDArray[np.complex128]:
    """Poles of a continuous system, rad/s, or the logarithms of sampled ones over the tick."""
    if dt_s == 0.0:
        return poles
    floor = np.where(np.abs(poles) > 1e-12, poles, 1e-12)
    return np.asarray(np.log(floor.astype(complex)) / dt_s)


def abscissa(loop: System, dt_s: float) -> Slope:
    """Largest real part of the modes, rad/s, by right and left eigenvectors."""
    return _of_modes(loop, dt_s, lambda s: (s.real, np.ones(s.shape, complex)))


def least_damping(loop: System, dt_s: float, damping: float) -> Slope:
    """Largest of Re s + cot Im s over the modes, rad/s: below 0 all are damped by `damping`."""
    lean = damping / np.sqrt(1.0 - damping**2)

    def leaning(s: NDArray[np.complex128]) -> tuple[Vector, NDArray[np.complex128]]:
        # d value = Re(w ds), Re s and |Im s|
        return s.real + lean * np.abs(s.imag), np.asarray(1.0 - 1j * lean * np.sign(s.imag))

    return _of_modes(loop, dt_s, leaning)


def fastest(loop: System, dt_s: float) -> Slope:
    """Largest modulus of the modes, rad/s; of a sampled loop those of poles above 1e-3 alone."""

    def modulus(s: NDArray[np.complex128]) -> tuple[Vector, NDArray[np.complex128]]:
        size = np.abs(s)
        known = size if dt_s == 0.0 else np.where(s.real * dt_s > np.log(1e-3), size, 0.0)
        return known, np.asarray(np.conj(s) / np.maximum(size, 1e-300))

    return _of_modes(loop, dt_s, modulus)


def _of_modes(
    loop: System,
    dt_s: float,
    measure: Callable[[NDArray[np.complex128]], tuple[Vector, NDArray[np.complex128]]],
) -> Slope:
    """Largest `measure` of the modes; it gives values and w with d value = Re(w ds)."""
    poles, left, right = eig(loop.A, left=True, right=True)
    values, weights = measure(_rates(poles, dt_s))
    worst = int(np.argmax(values))
    y, x = left[:, worst], right[:, worst]
    share = np.vdot(y, x)
    if abs(share) < 1e-300:
        return _nothing(loop, float(values[worst]))
    ds = weights[worst] / share
    if dt_s:
        ds = ds / (poles[worst] * dt_s)
    slope = np.real(ds * np.outer(np.conj(y), x))
    return _nothing(loop, float(values[worst]))._replace(A=slope)


def hinf(loop: System, dt_s: float) -> Slope:
    """H-infinity norm of a stable loop, by the singular vectors at its peak (`hinf_norm`)."""
    if dt_s == 0.0:
        _, at = hinf_norm(*loop)
        point = complex(0.0, at)
    else:
        _, at = hinf_norm(*to_continuous(loop))
        half = 0.5j * at
        point = complex(-1.0) if np.isinf(at) else complex((1.0 + half) / (1.0 - half))
    n = loop.A.shape[0]
    right, left = loop.B.astype(complex), loop.C.astype(complex)
    if np.isinf(point.imag):
        right, left = 0.0 * right, 0.0 * left
    else:
        inside = point * np.eye(n) - loop.A
        right, left = np.linalg.solve(inside, right), np.linalg.solve(inside.T, left.T).T
    response = loop.D + loop.C @ right
    u, sigma, vh = np.linalg.svd(response)
    u, v = np.conj(u[:, 0]), np.conj(vh[0])
    to_left, to_right = u @ left, right @ v
    return Slope(
        float(sigma[0]),
        np.real(np.outer(to_left, to_right)),
        np.real(np.outer(to_left, v)),
        np.real(np.outer(u, to_right)),
        np.real(np.outer(u, v)),
    )


def h2(loop: System, dt_s: float) -> Slope:
    """H2 norm of a stable loop, by its two Lyapunov equations; inf with a direct path (dt_s 0)."""
    A, B, C, D = loop
    if dt_s == 0.0:
        if np.any(np.abs(D) > 1e-14):
            return _nothing(loop, np.inf)
        P = solve_continuous_lyapunov(A, -B @ B.T)
        Q = solve_continuous_lyapunov(A.T, -C.T @ C)
        of_A = 2.0 * Q @ P
    else:
        P = solve_discrete_lyapunov(A, B @ B.T)
        Q = solve_discrete_lyapunov(A.T, C.T @ C)
        of_A = 2.0 * Q @ A @ P
    square = float(np.trace(C @ P @ C.T) + np.sum(D**2))
    if not square > 0.0:
        return _nothing(loop, 0.0)
    value = float(np.sqrt(square))
    half = 0.5 / value
    return Slope(value, half * of_A, half * 2.0 * Q @ B, half * 2.0 * C @ P, half * 2.0 * D)


# -------------------------------------------------------------------------------------------------
# Goals.
# -------------------------------------------------------------------------------------------------


class GoalKind(enum.Enum):
    """What a goal measures."""

    HINF = "hinf"
    H2 = "h2"
    DECAY = "decay"
    DAMPING = "damping"
    FASTEST = "fastest"
    DISK_MARGIN = "disk_margin"


@dataclass(frozen=True)
class Goal:
    """One wish.

    Attributes
    ----------
    name : str
    kind : GoalKind
    plant : StructuredPlant
        Whose w -> z is measured; of `DISK_MARGIN` the one whose w -> z is S - I/2.
    bound : float
        Norms, `FASTEST`: at most this; `DECAY` (rad/s), `DAMPING`, `DISK_MARGIN` (alpha of
        `mu.DiskMargin`): at least this.
    hard : bool
        Kept; else made small.
    where : str
        Which aircraft, say.
    """

    name: str
    kind: GoalKind
    plant: StructuredPlant
    bound: float
    hard: bool = False
    where: str = ""

    @property
    def scalings(self) -> int:
        """How many logarithms of scalings the goal brings along, which are free, too."""
        return self.plant.D11.shape[0] - 1 if self.kind is GoalKind.DISK_MARGIN else 0


KEPT = 1e-3
"""A share so much above 1 still counts as kept."""


@dataclass(frozen=True)
class Reached:
    """What a goal came to.

    Attributes
    ----------
    goal : Goal
    value : float
        In the sense of its bound; nan of a norm or margin where the loop is not stable.
    share : float
        1 at the bound, more beyond it; inf where the loop is not stable.
    """

    goal: Goal
    value: float
    share: float

    @property
    def met(self) -> bool:
        """Whether the bound is kept, to `KEPT`."""
        return self.share <= 1.0 + KEPT


_AT_REST_RADPS = -1e-6
"""A loop whose slowest mode is above this is not stable."""


@dataclass(frozen=True)
class TuningProblem:
    """Goals for one controller.

    Attributes
    ----------
    structure : LawStructure
    goals : tuple of Goal
    """

    structure: LawStructure
    goals: tuple[Goal, ...]

    @cached_property
    def _plants(self) -> tuple[StructuredPlant, ...]:
        return tuple(goal.plant.joined(self.structure.order) for goal in self.goals)

    @cached_property
    def _scalings(self) -> tuple[slice, ...]:
        ends = np.cumsum([self.structure.size, *(goal.scalings for goal in self.goals)])
        return tuple(slice(int(ends[i]), int(ends[i + 1])) for i in range(len(self.goals)))

    @property
    def size(self) -> int:
        """Number of free numbers: the structure's, then logarithms of scalings."""
        return self._scalings[-1].stop

    @cached_property
    def _loops(self) -> tuple[int, ...]:
        """Of each goal the first whose state matrix is the same: stability is asked once."""
        keys = [(id(g.plant.A), g.plant.A.tobytes(), g.plant.B2.tobytes(), g.plant.C2.tobytes())[1:]
                for g in self.goals]  # fmt: skip
        return tuple(keys.index(key) for key in keys)

    def closed(self, place: int, K: Matrix) -> System:
        """The closed loop of a goal with the controller's matrices K."""
        p = self._plants[place]
        forward, back = p.B2 @ K, p.D12 @ K
        return System(
            p.A + forward @ p.C2,
            p.B1 + forward @ p.D21,
            p.C1 + back @ p.C2,
            p.D11 + back @ p.D21,
        )

    def _chained(self, place: int, slope: Slope) -> Vector:
        p = self._plants[place]
        of_K = (p.B2.T @ slope.A + p.D12.T @ slope.C) @ p.C2.T
        of_K += (p.B2.T @ slope.B + p.D12.T @ slope.D) @ p.D21.T
        gradient = np.zeros(self.size)
        gradient[: self.structure.size] = self.structure.slope(of_K)
        return gradient

    def growth(self, x: Vector) -> tuple[float, Vector]:
        """Largest abscissa of all loops, rad/s, and its gradient."""
        K = self.structure.matrix(x[: self.structure.size])
        places = sorted(set(self._loops))
        slopes = [abscissa(self.closed(i, K), self.goals[i].plant.dt_s) for i in places]
        worst = int(np.argmax([slope.value for slope in slopes]))
        return slopes[worst].value, self._chained(places[worst], slopes[worst])

    def share(self, place: int, x: Vector) -> tuple[float, Vector]:
        """A goal's share of its bound, and its gradient; the loop has to be stable for a norm."""
        goal = self.goals[place]
        loop = self.closed(place, self.structure.matrix(x[: self.structure.size]))
        dt_s, bound = goal.plant.dt_s, goal.bound
        if goal.kind is GoalKind.DECAY:
            slope = abscissa(loop, dt_s)
            return 2.0 + slope.value / bound, self._chained(place, slope) / bound
        if goal.kind is GoalKind.DAMPING:
            slope = least_damping(loop, dt_s, bound)
            # in rad/s: a mode at 1 rad/s that lacks all of the damping is one too much
            return 1.0 + slope.value, self._chained(place, slope)
        if goal.kind is GoalKind.FASTEST:
            slope = fastest(loop, dt_s)
            return slope.value / bound, self._chained(place, slope) / bound
        if goal.kind is GoalKind.DISK_MARGIN:
            return self._margin(place, x, loop)
        slope = hinf(loop, dt_s) if goal.kind is GoalKind.HINF else h2(loop, dt_s)
        return slope.value / bound, self._chained(place, slope) / bound

    def _margin(self, place: int, x: Vector, loop: System) -> tuple[float, Vector]:
        """alpha times the norm of D (S - I/2) 1/D: the upper bound of mu with a fixed D."""
        goal = self.goals[place]
        d = np.exp(np.append(x[self._scalings[place]], 0.0))
        scaled = System(loop.A, loop.B / d, d[:, None] * loop.C, d[:, None] * loop.D / d)
        slope = hinf(scaled, goal.plant.dt_s)
        of_B, of_C, of_D = slope.B / d, d[:, None] * slope.C, d[:, None] * slope.D / d
        gradient = self._chained(place, Slope(slope.value, slope.A, of_B, of_C, of_D))
        by_d = np.sum(slope.C * scaled.C, axis=1) + np.sum(slope.D * scaled.D, axis=1)
        by_d -= np.sum(slope.B * scaled.B, axis=0) + np.sum(slope.D * scaled.D, axis=0)
        gradient[self._scalings[place]] = by_d[:-1]
        return goal.bound * slope.value, goal.bound * gradient

    def point(self, x: Vector) -> Evaluation:
        """Worst soft share, hard shares less 1, and gradients; inf where a loop is not stable."""
        hard = [i for i, goal in enumerate(self.goals) if goal.hard]
        nowhere = Evaluation(
            np.inf,
            np.zeros(self.size),
            np.full(len(hard), np.inf),
            np.zeros((len(hard), self.size)),
        )
        try:
            if self.growth(x)[0] >= _AT_REST_RADPS:
                return nowhere
            shares = [self.share(i, x) for i in range(len(self.goals))]
        except np.linalg.LinAlgError:
            return nowhere
        if not np.all(np.isfinite([value for value, _ in shares])):
            return nowhere
        soft = [i for i, goal in enumerate(self.goals) if not goal.hard]
        value, gradient = 0.0, np.zeros(self.size)
        if soft:
            value, gradient = max((shares[i] for i in soft), key=lambda one: one[0])
        return Evaluation(
            value,
            gradient,
            np.array([shares[i][0] - 1.0 for i in hard]),
            np.array([shares[i][1] for i in hard]).reshape(len(hard), self.size),
        )

    def reached(self, x: Vector) -> tuple[Reached, ...]:
        """Every goal's value with the parameters x; disk margins with the best constant scaling."""
        K = self.structure.matrix(x[: self.structure.size])
        found = []
        for i, goal in enumerate(self.goals):
            loop, dt_s = self.closed(i, K), goal.plant.dt_s
            growth = abscissa(loop, dt_s).value
            if growth >= _AT_REST_RADPS and goal.kind is not GoalKind.DECAY:
                found.append(Reached(goal, np.nan, np.inf))
                continue
            share = self.share(i, x)[0]
            value = share * goal.bound
            if goal.kind is GoalKind.DECAY:
                value = -growth
            elif goal.kind is GoalKind.DAMPING:
                s = _rates(np.linalg.eigvals(loop.A).astype(complex), dt_s)
                value = float(np.min(-s.real / np.maximum(np.abs(s), 1e-300)))
            elif goal.kind is GoalKind.DISK_MARGIN:
                value = goal.bound / share
            found.append(Reached(goal, float(value), float(share)))
        return tuple(found)

    def scaled_start(self, parameters: Vector) -> Vector:
        """The parameters with scalings that suit the loops' responses at their peaks."""
        x = np.zeros(self.size)
        x[: self.structure.size] = parameters
        K = self.structure.matrix(parameters)
        for i, goal in enumerate(self.goals):
            if not goal.scalings:
                continue
            loop = self.closed(i, K)
            peak = _peak_response(loop, goal.plant.dt_s)
            if peak is not None:
                d = np.log(scaled_mu(peak[None], peak.shape[0])[1][0])
                x[self._scalings[i]] = d[:-1] - d[-1]
        return x


def _peak_response(loop: System, dt_s: float) -> NDArray[np.complex128] | None:
    """The loop's response at the angle of its largest gain; None of one that is not stable."""
    if abscissa(loop, dt_s).value >= _AT_REST_RADPS:
        return None
    at = hinf_norm(*(to_continuous(loop) if dt_s else loop))[1]
    if np.isinf(at):
        return None
    half = 0.5j * at
    point = (1.0 + half) / (1.0 - half) if dt_s else 1j * at
    inside = point * np.eye(loop.A.shape[0]) - loop.A
    return np.asarray(loop.D + loop.C @ np.linalg.solve(inside, loop.B.astype(complex)))


# -------------------------------------------------------------------------------------------------
# Tuning: stabilise, then descend, from several starts.
# -------------------------------------------------------------------------------------------------


TOLD_EVERY = 10
"""So many iterations lie between two words about a descent."""


class NotStabilizedError(SynthesisError):
    """No start led to parameters with which every loop is stable."""


class NoGoalsError(SynthesisError):
    """There is nothing to tune for."""


@dataclass(frozen=True)
class Start:
    """Where one start ended.

    Attributes
    ----------
    soft, hard : float
        Worst share of the soft and of the hard goals; -inf if there are none.
    iterations, evaluations : int
    stationarity : float
        Norm of the shortest vector among the convex combinations of gradients nearby.
    x : array
        As of `Tuned`.
    """

    soft: float
    hard: float
    iterations: int
    evaluations: int
    stationarity: float
    x: Vector


@dataclass(frozen=True)
class Tuned:
    """The best of all starts.

    Attributes
    ----------
    problem : TuningProblem
    x : array
        The structure's parameters, then logarithms of scalings.
    reached : tuple of Reached
    starts : tuple of Start
        In their order; those that found no stable loop are left out.
    """

    problem: TuningProblem
    x: Vector
    reached: tuple[Reached, ...]
    starts: tuple[Start, ...] = field(default=())

    @property
    def parameters(self) -> Vector:
        """Of the structure."""
        return self.x[: self.problem.structure.size]

    @property
    def law(self) -> System:
        """A_k, B_k, C_k, D_k."""
        return self.problem.structure.law(self.parameters)

    @property
    def soft(self) -> float:
        """Worst share of the soft goals."""
        return max((one.share for one in self.reached if not one.goal.hard), default=-np.inf)

    @property
    def hard(self) -> float:
        """Worst share of the hard goals; at most 1 where all are kept."""
        return max((one.share for one in self.reached if one.goal.hard), default=-np.inf)


def tune(
    problem: TuningProblem,
    start: ArrayLike | None = None,
    scale: ArrayLike | None = None,
    starts: int = 1,
    seed: int = 0,
    iterations: int = 300,
    tell: Callable[[str], None] = lambda _: None,
) -> Tuned:
    """The parameters that make the worst soft goal smallest while the hard ones are kept.

    Parameters
    ----------
    problem : TuningProblem
    start : (m,) array, optional
        The structure's parameters at the first start; default: zero.
    scale : (m,) array, optional
        Their sizes; default: those of `start`, 1 where it is zero.
    starts : int
        The further ones are spread about the first by `scale`.
    seed : int
        Of the further starts.
    iterations : int
        At most, of each start.
    tell : callable
        Told a few words at each start, every `TOLD_EVERY` iterations, and at its end.

    Raises
    ------
    NoGoalsError, NotStabilizedError
    """
    if not problem.goals:
        raise NoGoalsError("there is no goal to tune for")
    m = problem.structure.size
    first = np.zeros(m) if start is None else np.asarray(start, float)
    sizes = np.abs(first) if scale is None else np.asarray(scale, float)
    sizes = np.where(sizes > 0.0, sizes, 1.0)
    ends: list[Start] = []
    for number, one in enumerate(np.random.SeedSequence(seed).spawn(starts)):
        draw = np.random.default_rng(one).standard_normal(m)
        name = f"start {number + 1} of {starts}"
        tell(name)
        # what cannot be stabilised runs away: numbers there may overflow
        with np.errstate(over="ignore", invalid="ignore"):
            where = first + (number > 0) * sizes * draw
            end = _from(problem, where, sizes, iterations, partial(_tell_of, tell, name))
        if end is None:
            tell(f"{name}: no stable loop found")
            continue
        tell(
            f"{name}: ended after {end.iterations} iterations: soft {end.soft:.4f}, hard "
            f"{end.hard:.4f} of the bound"
        )
        ends.append(end)
    if not ends:
        raise NotStabilizedError(
            f"none of {starts} starts leads to a controller of this structure with every "
            "loop stable"
        )
    x = min(ends, key=lambda end: (max(end.hard, 1.0 + KEPT), end.soft)).x
    return Tuned(problem, x, problem.reached(x), tuple(ends))


def _tell_of(tell: Callable[[str], None], name: str, text: str) -> None:
    tell(f"{name}: {text}")


def _from(
    problem: TuningProblem,
    parameters: Vector,
    sizes: Vector,
    iterations: int,
    tell: Callable[[str], None],
) -> Start | None:
    """Stabilised, then descended, in units of `sizes`."""
    m = problem.structure.size
    units = np.append(sizes, np.ones(problem.size - m))

    def growth(scaled: Vector) -> Evaluation:
        value, gradient = problem.growth(scaled * units)
        return Evaluation(value, gradient * units, np.zeros(0), np.zeros((0, problem.size)))

    x = np.zeros(problem.size)
    x[:m] = parameters
    if problem.growth(x)[0] >= _AT_REST_RADPS:
        tell("looks for a stable loop")
        steady = minimise(growth, x / units, 200, enough=-1e-2)
        x = steady.x * units
        if problem.growth(x)[0] >= _AT_REST_RADPS:
            return None
    x = problem.scaled_start(x[:m])

    def point(scaled: Vector) -> Evaluation:
        found = problem.point(scaled * units)
        return Evaluation(
            found.value, found.gradient * units, found.violations, found.slopes * units
        )

    def progress(done: int, now: Evaluation) -> None:
        if done % TOLD_EVERY == 0:
            hard = 1.0 + float(np.max(now.violations, initial=-1.0))
            tell(
                f"iteration {done} of at most {iterations}: soft {now.value:.4f}, hard {hard:.4f} "
                "of the bound"
            )

    end = minimise(point, x / units, iterations, progress=progress)
    x = end.x * units
    reached = problem.reached(x)
    soft = max((one.share for one in reached if not one.goal.hard), default=-np.inf)
    hard = max((one.share for one in reached if one.goal.hard), default=-np.inf)
    return Start(soft, hard, end.iterations, end.evaluations, end.stationarity, x)
