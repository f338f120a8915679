# SPDX-License-Identifier: Apache-2.0
"""An upper bound of the (skewed) structured singular value that holds at every frequency.

Scalings found at one frequency hold about it as far as Psi stays negative definite. How far that
is tells a Hamiltonian matrix: Psi is singular at omega exactly if j omega is an eigenvalue of it
(Roos, Biannic, Int. J. Robust Nonlinear Control 20, 2010; Ferreres, Biannic 2001). The intervals
are laid side by side until they cover 0 to infinity: there is no grid to slip through.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh, matrix_balance, solve_discrete_lyapunov

from heli_core.errors import RobustCause, RobustError
from heli_inner_hinf.robust.uncertain import uncertain_Matrix

# -------------------------------------------------------------------------------------------------
# A linear matrix inequality of small Hermitian matrices in many unknowns, by a barrier method.
#
# maximise t subject to sum x_i T_i - t I >= 0, sum x_i E_i >= 0, trace of the latter fixed:
# Newton's
# method along the central path (Boyd, Vandenberghe, *Convex Optimization*, 2004, ch. 11). An
# iteration costs k^2 n^2 for k unknowns and matrices of size n, where a general solver, which has
# the
# entries of the matrices for unknowns, pays n^6. No answer is trusted: `Scalings.slack` is worked
# out
# anew from x.
# -------------------------------------------------------------------------------------------------

_FASTER = 8.0  # tau grows by this factor
_FIRST_GAP, _LAST_GAP = 1.0, 1e-10
_SHARE = 0.05  # a gap of this share of t is near enough where t > 0
_PLENTY = 2.0  # real blocks alone may leave t without a bound
_CENTRED, _MOST_STEPS = 0.3, 200


def largest_slack(
    T: NDArray[np.complex128], E: NDArray[np.complex128]
) -> tuple[NDArray[np.float64], float]:
    """The unknowns x (k,) with which t is largest, or near it once its sign is sure, and t.

    Parameters
    ----------
    T : (k, n, n) array
        Hermitian.
    E : (k_d, m, m) array
        Hermitian, of the first k_d unknowns; some real combination of them is the identity. The
        trace of sum x_i E_i is that of the identity.
    """
    k, n, m = len(T), T.shape[1], E.shape[1]
    flat = E.reshape(len(E), -1)
    flat = np.hstack([flat.real, flat.imag])
    one = np.append(np.eye(m).ravel(), np.zeros(m * m))
    x = np.zeros(k + 1)
    x[: len(E)] = np.linalg.lstsq(flat.T, one, rcond=None)[0]
    x[k] = float(np.linalg.eigvalsh(np.tensordot(x[:k], T, 1))[0]) - 1.0
    terms = np.concatenate([T, -np.eye(n)[None]])
    trace = np.zeros(k + 1)
    trace[: len(E)] = np.trace(E, axis1=1, axis2=2).real
    tau, steps = (n + m) / _FIRST_GAP, 0
    roots = _roots(x, terms, E)
    while steps < _MOST_STEPS and roots is not None:
        steps += 1
        step, decrement = _newton(terms, E, roots, trace, tau)
        along, value = 1.0, _value(x, roots, tau)
        while True:
            trial = x + along * step
            trial_roots = _roots(trial, terms, E)
            if trial_roots is not None and _value(trial, trial_roots, tau) <= value:
                break
            along *= 0.5
            if along < 1e-6:
                return x[:k], float(x[k])
        x, roots = trial, trial_roots
        if x[k] > _PLENTY:
            break
        if decrement < _CENTRED:
            gap = (n + m) / tau
            if gap < _LAST_GAP or x[k] + gap < 0.0 or gap < _SHARE * x[k]:
                break
            tau *= _FASTER
    return x[:k], float(x[k])


_Roots = tuple[NDArray[Any], NDArray[Any]]


def _roots(x: NDArray[np.float64], terms: NDArray[Any], E: NDArray[Any]) -> _Roots | None:
    """Cholesky factors of both matrices; None where one is not positive definite."""
    try:
        slack = np.linalg.cholesky(np.tensordot(x, terms, 1))
        return slack, np.linalg.cholesky(np.tensordot(x[: len(E)], E, 1))
    except np.linalg.LinAlgError:
        return None


def _value(x: NDArray[np.float64], roots: _Roots, tau: float) -> float:
    """The barrier function -tau t - log det - log det."""
    slack, positive = (float(np.sum(np.log(np.diag(root).real))) for root in roots)
    return -tau * float(x[-1]) - 2.0 * (slack + positive)


def _newton(
    terms: NDArray[Any], E: NDArray[Any], roots: _Roots, trace: NDArray[np.float64], tau: float
) -> tuple[NDArray[np.float64], float]:
    """Newton's step that keeps the trace, and its decrement."""
    H = np.zeros((len(terms), len(terms)))
    g = np.zeros(len(terms))
    g[-1] = -tau
    for matrices, root in zip((terms, E), roots, strict=True):
        inverse = np.linalg.inv(root)
        whitened = inverse @ matrices @ inverse.conj().T
        rows = whitened.reshape(len(whitened), -1)
        rows = np.hstack([rows.real, rows.imag])
        H[: len(rows), : len(rows)] += rows @ rows.T
        g[: len(rows)] -= np.trace(whitened, axis1=1, axis2=2).real
    H[np.diag_indices_from(H)] *= 1.0 + 1e-14
    solved = np.linalg.solve(H, np.column_stack([-g, trace]))
    step = solved[:, 0] - solved[:, 1] * (trace @ solved[:, 0]) / (trace @ solved[:, 1])
    return step, max(-float(g @ step), 0.0) ** 0.5


# -------------------------------------------------------------------------------------------------
# Blocks of the structured uncertainty Delta in w = Delta z, z = M w.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Block:
    """One block of Delta.

    Attributes
    ----------
    name : str
    kind : {"real", "complex", "full"}
        A real number times identity, a complex number times identity, or a full complex matrix.
    n_z, n_w : int
        Its inputs (outputs of M) and outputs (inputs of M); equal but for a full block.
    fixed : bool
        True: bounded by one, as it is. False: bounded by 1/level, which is what a bound is for.
    """

    name: str
    kind: Literal["real", "complex", "full"]
    n_z: int
    n_w: int
    fixed: bool = False


def real(name: str, times: int = 1, fixed: bool = False) -> Block:
    """A real parameter that enters `times` times."""
    return Block(name, "real", times, times, fixed)


def places(blocks: Sequence[Block]) -> list[tuple[Block, slice, slice]]:
    """Each block with its places in z and in w."""
    z = np.cumsum([0, *(block.n_z for block in blocks)])
    w = np.cumsum([0, *(block.n_w for block in blocks)])
    return [
        (block, slice(int(z[i]), int(z[i + 1])), slice(int(w[i]), int(w[i + 1])))
        for i, block in enumerate(blocks)
    ]


# -------------------------------------------------------------------------------------------------
# Upper bounds of the structured singular value by D and G scalings, as a linear matrix inequality.
#
# M(j omega) in the loop with every Delta of the structure is well posed if there are D > 0 and
# G = G*, both commuting with Delta, with
#
#     Psi = M* D_z M + j (G M - M* G) - W < 0,   W = level^2 D_w in scaled blocks, D_w in fixed
#     ones
#
# (Fan, Tits, Doyle, IEEE TAC 36, 1991; skewed: Fan and Tits, 1992): then no Delta with scaled
# blocks
# up to 1 / level and fixed blocks up to 1 makes I - M Delta singular. D is Hermitian for a
# repeated
# block and a multiple of identity for a full one; G is for real blocks only.
# -------------------------------------------------------------------------------------------------

Complex = NDArray[Any]
Real = NDArray[np.floating[Any]]
_BALANCING = 20
_CLEAR = 0.05  # slack of which a bound by D alone has enough
_LARGEST_LEVEL = 1e6


class Scalings(NamedTuple):
    """What certifies a level at one frequency, and at others where Psi stays negative.

    Attributes
    ----------
    D_z : (n_z, n_z) array
    W : (n_w, n_w) array
        Of the level that they were found for.
    G : (n_w, n_z) array
    slack : float
        -Psi >= slack in the balanced coordinates; above 0 the level is certified.
    """

    D_z: Complex
    W: Complex
    G: Complex
    slack: float

    def largest(self, M: Complex) -> float:
        """Largest eigenvalue of Psi relative to W; below 0 the level holds at this response."""
        return float(eigh(self.psi(M), self.W, eigvals_only=True)[-1])

    def psi(self, M: Complex) -> Complex:
        """Psi (n_w, n_w) of a response M (n_z, n_w): negative definite where the level holds."""
        cross = 1j * self.G @ M
        return M.conj().T @ self.D_z @ M + cross + cross.conj().T - self.W


class Structure:
    """The linear matrix inequality of one structure, made once and solved for many M."""

    def __init__(self, blocks: Sequence[Block]) -> None:
        self.blocks = tuple(blocks)
        self.n_z, self.n_w = sum(b.n_z for b in blocks), sum(b.n_w for b in blocks)

    @cached_property
    def _basis(self) -> tuple[Complex, Complex, Complex, NDArray[np.bool_]]:
        """Basis of D_z, D_w (k, n, n), then G; and which D belong to scaled blocks (k,)."""
        D_z, D_w, G, scaled = [], [], [], []
        for block, z, w in places(self.blocks):
            units = [np.eye(block.n_z)] if block.kind == "full" else _hermitian(block.n_z)
            for unit in units:
                at_z, at_w = np.zeros((self.n_z,) * 2, complex), np.zeros((self.n_w,) * 2, complex)
                at_z[z, z] = unit
                at_w[w, w] = np.eye(block.n_w) if block.kind == "full" else unit
                D_z.append(at_z)
                D_w.append(at_w)
                scaled.append(not block.fixed)
            for unit in _hermitian(block.n_z) if block.kind == "real" else []:
                at = np.zeros((self.n_w, self.n_z), complex)
                at[w, z] = unit
                G.append(at)
        return (
            np.array(D_z),
            np.array(D_w),
            np.array(G).reshape(-1, self.n_w, self.n_z),
            np.array(scaled),
        )

    def scalings(self, M: Complex, level: float) -> Scalings:
        """The scalings of largest slack for one response M (n_z, n_w) and a level > 0.

        Parameters
        ----------
        M : (n_z, n_w) array
        level : float

        Returns
        -------
        Scalings
            With slack <= 0 where this level cannot be certified, or the solver fails.
        """
        E_z, E_w, E_g, scaled = self._basis
        bound = np.concatenate([np.full(b.n_w, 1.0 if b.fixed else level) for b in self.blocks])
        M = M / bound  # so that every block is bounded by one
        t_z, t_w = self._balance(M)
        M = t_z[:, None] * M / t_w
        cross = 1j * E_g @ M
        terms = np.concatenate(
            [E_w - M.conj().T @ E_z @ M, -cross - cross.conj().transpose(0, 2, 1)]
        )
        k_d, k = len(E_z), len(terms)
        # Without G first: that is quicker, and what needs none holds over wider frequencies.
        x, t = largest_slack(terms[:k_d], E_w)
        x = np.append(x, np.zeros(k - k_d)) if t > _CLEAR else largest_slack(terms, E_w)[0]
        D_z, D_w = np.tensordot(x[:k_d], E_z, 1), np.tensordot(x[:k_d], E_w, 1)
        G = np.tensordot(x[k_d:k], E_g, 1)
        slack = -float(np.linalg.eigvalsh(Scalings(D_z, D_w, G, 0.0).psi(M))[-1])
        if not np.isfinite(slack) or np.linalg.eigvalsh(D_z)[0] <= 0.0:
            slack = -np.inf
        back = bound * t_w
        return Scalings(
            t_z[:, None] * D_z * t_z, back[:, None] * D_w * back, back[:, None] * G * t_z, slack
        )

    def upper(self, M: Complex, tolerance: float = 1e-4, low: float = 0.0) -> float:
        """Smallest level that scalings certify for one response, within `tolerance` of it.

        At least `low` is returned; inf where none up to 1e6 is certified.
        """
        good = max(low, float(np.linalg.norm(M, 2)), 1e-9)
        if low > 0.0 and self.scalings(M, low).slack > 0.0:
            return low
        while self.scalings(M, good).slack <= 0.0:
            low, good = good, 4.0 * good
            if good > _LARGEST_LEVEL:
                return np.inf
        while good - low > tolerance * good:
            middle = np.sqrt(low * good) if low > 0.0 else 0.3 * good
            if self.scalings(M, middle).slack > 0.0:
                good = middle
            else:
                low = middle
        return float(good)

    def _balance(self, M: Complex) -> tuple[Real, Real]:
        """Diagonal of a scaling that commutes with Delta and evens M out, after Osborne."""
        group = np.concatenate(
            [
                np.full(b.n_z, i) if b.kind == "full" else i + (np.arange(b.n_z) + 1) / (b.n_z + 1)
                for i, b in enumerate(self.blocks)
            ]
        )
        group_w = np.concatenate(
            [
                np.full(b.n_w, i) if b.kind == "full" else i + (np.arange(b.n_w) + 1) / (b.n_w + 1)
                for i, b in enumerate(self.blocks)
            ]
        )
        keys = np.unique(group)
        size = np.abs(M) ** 2
        off = np.array([[size[np.ix_(group == a, group_w == b)].sum() for b in keys] for a in keys])
        np.fill_diagonal(off, 0.0)
        floor = 1e-12 * max(off.max(initial=0.0), np.finfo(float).tiny)
        t = np.ones(len(keys))
        for _ in range(_BALANCING):
            for i in range(len(keys)):
                row = np.sum(off[i] * t[i] ** 2 / t**2) + floor
                column = np.sum(off[:, i] * t**2 / t[i] ** 2) + floor
                t[i] *= (column / row) ** 0.25
        t /= np.exp(np.mean(np.log(t)))
        return t[np.searchsorted(keys, group)], t[np.searchsorted(keys, group_w)]


def _hermitian(n: int) -> Complex:
    """Basis (n^2, n, n) of the Hermitian matrices."""
    basis = []
    for i in range(n):
        for j in range(i, n):
            unit = np.zeros((n, n), complex)
            unit[i, j] = unit[j, i] = 1.0
            basis.append(unit)
            if j > i:
                unit = np.zeros((n, n), complex)
                unit[i, j], unit[j, i] = 1j, -1j
                basis.append(unit)
    return np.array(basis)


# -------------------------------------------------------------------------------------------------
# Certificate.
# -------------------------------------------------------------------------------------------------

_LOWEST = 1e-9
_STATIC = 1e-3  # rad/s; a gap that ends below is looked at from 0
_SHARES = np.array([0.05, 0.35, 0.65, 0.95])
"""Where in a cell, by ratio of its ends, Psi is looked at besides the end itself."""
_STEP_UP = 1.003
_MOST_INTERVALS = 2000
_NARROW = 1e-9


class UncertainSystem(NamedTuple):
    """M(s) = D + C (s I - A)^-1 B, continuous and stable; w to z of the structure."""

    A: uncertain_Matrix
    B: uncertain_Matrix
    C: uncertain_Matrix
    D: uncertain_Matrix

    def balanced(self) -> UncertainSystem:
        """The same system in states scaled such that eigenvalues can be trusted."""
        n, m = self.B.shape
        full = np.block([[self.A, self.B], [self.C, np.zeros((len(self.C), m))]])
        square = np.zeros((max(full.shape),) * 2)
        square[: full.shape[0], : full.shape[1]] = full
        scale = np.asarray(matrix_balance(square, permute=False, separate=True)[1][0])[:n]
        return UncertainSystem(
            self.A * scale / scale[:, None], self.B / scale[:, None], self.C * scale, self.D
        )

    def response(self, omega: float) -> Complex:
        """M(j omega); omega in rad/s, may be inf."""
        if np.isinf(omega):
            return self.D.astype(complex)
        n = len(self.A)
        return self.C @ np.linalg.solve(1j * omega * np.eye(n) - self.A, self.B) + self.D


class Piece(NamedTuple):
    """Scalings that hold from low to high, rad/s."""

    low_radps: float
    high_radps: float
    scalings: Scalings


@dataclass(frozen=True)
class RobustCertificate:
    """A level that holds at every frequency, with what proves it.

    Attributes
    ----------
    level : float
        No Delta with scaled blocks below 1 / level and fixed blocks up to 1 makes I - M Delta
        singular on the imaginary axis.
    pieces : tuple of Piece
        From 0 to infinity without a gap.
    """

    level: float
    pieces: tuple[Piece, ...]

    def largest_psi(self, system: UncertainSystem, per_piece: int = 7) -> float:
        """Largest eigenvalue of Psi, relative to W, at points inside every piece; below 0 it holds.

        A second look that uses no Hamiltonian matrix.
        """
        worst = -np.inf
        for piece in self.pieces:
            low = max(piece.low_radps, 1e-3 * min(1.0, piece.high_radps))
            high = min(piece.high_radps, 1e3 * max(1.0, low))
            cells = np.geomspace(low, high, per_piece + 1)
            for omega in np.sqrt(cells[:-1] * cells[1:]):
                worst = max(worst, piece.scalings.largest(system.response(omega)))
        return worst


def certify(
    system: UncertainSystem, blocks: Sequence[Block], low: float, most: float = np.inf
) -> RobustCertificate:
    """The smallest level, from `low` on, that scalings certify at every frequency.

    Parameters
    ----------
    system : UncertainSystem
    blocks : sequence of Block
    low : float
        A level from which to look, such as a lower bound times 1.01.
    most : float
        Give up above.

    Raises
    ------
    RobustError
        UNSTABLE: M is not stable. NO_CERTIFICATE: no scalings hold up to the level `most`.
    """
    pole = float(np.max(np.linalg.eigvals(system.A).real))
    if pole >= 0.0:
        raise RobustError(
            RobustCause.UNSTABLE,
            f"the nominal loop has a pole with real part {pole:.4g}, not below 0",
        )
    system = system.balanced()
    structure = Structure(blocks)
    level, pieces = low, list[Piece]()
    gaps = [(0.0, np.inf)]
    while gaps:
        a, b = gaps.pop()
        if b - a <= _NARROW * max(a, 1.0) or len(pieces) > _MOST_INTERVALS:
            raise RobustError(
                RobustCause.NO_CERTIFICATE,
                f"near {a:.6g} rad/s scalings hold at one frequency only",
            )
        omega = _inside(a, b)
        M = system.response(omega)
        scalings = structure.scalings(M, level)
        while scalings.slack <= 0.0:
            # All pieces so far hold for a higher level, too: W grows, Psi falls.
            level = _STEP_UP * structure.upper(M, low=_STEP_UP * level)
            if not (level <= most and np.isfinite(level)):
                raise RobustError(
                    RobustCause.NO_CERTIFICATE,
                    f"at {omega:.6g} rad/s no scalings hold up to the level {most:.6g}",
                )
            scalings = structure.scalings(M, level)
        below, above = valid_about(system, scalings, omega)
        pieces.append(Piece(below, above, scalings))
        gaps = [
            (low_gap, high_gap)
            for gap_a, gap_b in [*gaps, (a, b)]
            for low_gap, high_gap in ((gap_a, min(gap_b, below)), (max(gap_a, above), gap_b))
            if low_gap < high_gap
        ]
    return RobustCertificate(level, tuple(sorted(pieces, key=lambda piece: piece.low_radps)))


def valid_about(system: UncertainSystem, scalings: Scalings, omega: float) -> tuple[float, float]:
    """The frequencies about omega up to which Psi is negative definite; 0 and inf if everywhere.

    Psi can change its sign only where an eigenvalue of the Hamiltonian is imaginary. Rounding moves
    eigenvalues off the axis, so the imaginary parts of all of them, not only of those on it, divide
    the axis into cells; each is entered only after a look at Psi at several points of it.
    """
    places = np.abs(np.linalg.eigvals(_hamiltonian(system, scalings)).imag)
    near = places[places > _LOWEST * max(omega, 1.0)]
    above = np.unique(np.append(near[near > omega], [omega, 2.0 * max(near.max(initial=0), omega)]))
    below = np.unique(np.append(near[near < omega], omega))[::-1]
    high = _negative_until(system, scalings, above, np.inf)
    low = _negative_until(system, scalings, below, 0.0)
    return low, high


def _negative_until(
    system: UncertainSystem, scalings: Scalings, edges: NDArray[np.float64], end: float
) -> float:
    """Where Psi stops to be negative definite on the way along edges, then to the end."""
    looks = [
        (a, np.concatenate([a * (b / a) ** _SHARES, [b]]))
        for a, b in zip(edges[:-1], edges[1:], strict=True)
    ]
    last = edges[-1]
    looks.append(
        (
            last,
            np.array([2.0, 10.0, 100.0, np.inf]) * last
            if np.isinf(end)
            else np.array([0.5, 0.1, 0.01, 0.0]) * last,
        )
    )
    reached = edges[0]
    for _, points in looks:
        for point in points:
            if scalings.largest(system.response(point)) >= 0.0:
                return _between(system, scalings, reached, point)
            reached = point
    return end


def _between(system: UncertainSystem, scalings: Scalings, good: float, bad: float) -> float:
    """A frequency between good and bad near the sign change of Psi, on the good side."""
    bad = min(bad, 1e6 * max(good, 1.0))
    for _ in range(40):
        middle = 0.5 * (good + bad)
        if scalings.largest(system.response(middle)) < 0.0:
            good = middle
        else:
            bad = middle
    return good


def _hamiltonian(system: UncertainSystem, scalings: Scalings) -> Complex:
    """Psi(omega) is singular exactly if j omega is an eigenvalue of this."""
    A, B, C, D = system
    Q, S = scalings.D_z, -1j * scalings.G.conj().T
    R_inverse = np.linalg.inv(scalings.psi(D.astype(complex)))
    right = C.T @ (Q @ D + S)
    F = A - B @ R_inverse @ right.conj().T
    corner = right @ R_inverse @ right.conj().T - C.T @ Q @ C
    return np.block([[F, -B @ R_inverse @ B.T], [corner, -F.conj().T]])


def _inside(a: float, b: float) -> float:
    """A frequency inside the gap a .. b: by ratios, from 1 rad/s where it is open."""
    if a == 0.0:
        return min(1.0, 0.5 * b) if b > _STATIC else 0.0
    return float(np.sqrt(a * b)) if np.isfinite(b) else 2.0 * a


# -------------------------------------------------------------------------------------------------
# One quadratic bound for a family of loops: stable however quickly one becomes another.
#
# If x' P x shrinks at every step under each A of a family, it shrinks under every A of their
# convex
# hull, in any order (Boyd, El Ghaoui, Feron, Balakrishnan, *Linear Matrix Inequalities in System
# and
# Control Theory*, 1994, section 5.1).
# -------------------------------------------------------------------------------------------------

shared_bound_Matrix = NDArray[np.float64]

_TRIALS = 8


class CommonBound(NamedTuple):
    """What all members share.

    Attributes
    ----------
    P : (n, n) array
        Positive definite.
    contraction : float
        Largest factor, below one, by which a step changes sqrt(x' P x).
    """

    P: shared_bound_Matrix
    contraction: float


def contraction_of(A: shared_bound_Matrix, P: shared_bound_Matrix) -> float:
    """Largest factor by which x+ = A x, (n, n), changes sqrt(x' P x), P (n, n) positive definite.

    Raises
    ------
    numpy.linalg.LinAlgError
        P is not positive definite.
    """
    L = np.linalg.cholesky(P)
    return float(np.linalg.norm(np.linalg.solve(L, A.T @ L), 2))


def common_bound(family: Sequence[shared_bound_Matrix]) -> CommonBound:
    """A quadratic bound that all members of a family share.

    Tried are sums of what the members' own Lyapunov equations give, each asked to decay at a rate
    between the slowest member's and none. It is found by them, and proved by `contraction_of`.

    Parameters
    ----------
    family : sequence of (n, n) arrays
        x+ = A x.

    Returns
    -------
    CommonBound

    Raises
    ------
    RobustError
        NOT_FINITE; UNSTABLE: a member is; NO_CERTIFICATE: none was found, which does not say that
        there is none.
    """
    radius = 0.0
    for place, A in enumerate(family):
        if not np.all(np.isfinite(A)):
            raise RobustError(
                RobustCause.NOT_FINITE, f"member {place} holds a value that is not finite"
            )
        radius = max(radius, float(np.max(np.abs(np.linalg.eigvals(A)))))
        if radius >= 1.0:
            raise RobustError(
                RobustCause.UNSTABLE,
                f"member {place} has an eigenvalue of modulus {radius:.6g}, not below 1",
            )
    _, (scale, _) = matrix_balance(np.mean(family, axis=0), permute=False, separate=True)
    balanced = [A * scale / scale[:, None] for A in family]
    bounds = [_bound(balanced, radius + (1.0 - radius) * k / _TRIALS) for k in range(1, _TRIALS)]
    best = min(bounds, key=lambda bound: bound.contraction)
    P = best.P / np.outer(scale, scale)
    worst = max(contraction_of(A, P) for A in family)
    if worst >= 1.0:
        raise RobustError(
            RobustCause.NO_CERTIFICATE,
            f"no quadratic bound was found that all {len(family)} members share: with the best, "
            f"a step of one may still grow by the factor {worst:.6g}",
        )
    return CommonBound(P, worst)


def _bound(family: Sequence[shared_bound_Matrix], rate: float) -> CommonBound:
    """The sum of the members' solutions at a rate of decay, and what it is worth."""
    n = family[0].shape[0]
    P = sum(solve_discrete_lyapunov((A / rate).T, np.eye(n)) for A in family)
    P = 0.5 * (P + P.T) / np.linalg.norm(P, 2)
    return CommonBound(P, max(contraction_of(A, P) for A in family))
