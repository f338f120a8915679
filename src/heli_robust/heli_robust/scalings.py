# SPDX-License-Identifier: Apache-2.0
"""Upper bounds of the structured singular value by D and G scalings, as a linear matrix inequality.

M(j omega) in the loop with every Delta of the structure is well posed if there are D > 0 and
G = G*, both commuting with Delta, with

    Psi = M* D_z M + j (G M - M* G) - W < 0,   W = level^2 D_w in scaled blocks, D_w in fixed ones

(Fan, Tits, Doyle, IEEE TAC 36, 1991; skewed: Fan and Tits, 1992): then no Delta with scaled blocks
up to 1 / level and fixed blocks up to 1 makes I - M Delta singular. D is Hermitian for a repeated
block and a multiple of identity for a full one; G is for real blocks only.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import eigh

from heli_robust.barrier import largest_slack
from heli_robust.blocks import Block, places

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
