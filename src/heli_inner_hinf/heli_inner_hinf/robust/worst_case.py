# SPDX-License-Identifier: Apache-2.0
"""The worst member of a family of loops: parameters that destabilise it, or make its gain large.

Lower bounds of what `certificate` bounds from above, each with the parameters that prove it. The
search is the power iteration of real parameters, made with eigenvalues: with y, x the left and
right eigenvectors of the mode that is nearest to instability, every parameter goes to the end to
which Re(y* dA x / y* x) points, until no sign changes. Then every corner of the box, where there
are not too many: the iteration is local and may end at another one. Then a descent of the smallest
damping ratio from starts all over a slightly smaller box: the worst member may lie inside of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from heli_inner_hinf.mu import scaled_mu
from heli_inner_hinf.robust.certificate import (
    Block,
    RobustCertificate,
    UncertainSystem,
    certify,
    real,
)
from heli_inner_hinf.robust.uncertain import Uncertain, uncertain_Matrix

# -------------------------------------------------------------------------------------------------
# Worst case.
# -------------------------------------------------------------------------------------------------

Complex = NDArray[np.complex128]
_ROUNDS = 12
_FIRST_CROSSING = 60
_TO_ONSET = 1e-10
_STARTS = 24
_INSIDE, _CLIMBS, _SHRUNK = 40, 25, 0.98
_MOST_CORNERS = 12
"""With more parameters than these the corners are too many to look at."""


@dataclass(frozen=True)
class InstabilityOnset:
    """The smallest deviations found at which a loop loses its stability.

    Attributes
    ----------
    size : float
        Largest deviation, in units of the ranges; the stability margin is not above it. inf if
        nothing up to the largest size looked at destabilises.
    deltas : dict of str to float
        The deviations there; empty if there are none.
    frequency_radps : float
        Of the mode on the imaginary axis.
    """

    size: float
    deltas: Mapping[str, float]
    frequency_radps: float


class UncertainFamily:
    """A state matrix A(delta) that depends rationally on named real parameters."""

    def __init__(self, A: Uncertain) -> None:
        self.A = A
        self.names = tuple(dict.fromkeys(A.channels))
        self._of = np.array([self.names.index(name) for name in A.channels], dtype=int)

    def matrix(self, delta: NDArray[np.float64]) -> uncertain_Matrix:
        """The state matrix at deviations (k,) in the order of `names`."""
        return self.A.at(dict(zip(self.names, delta, strict=True)))

    def abscissa(self, delta: NDArray[np.float64]) -> float:
        """Largest real part of the modes."""
        return float(np.max(np.linalg.eigvals(self.matrix(delta)).real))

    def slopes(self, delta: NDArray[np.float64]) -> tuple[Complex, Complex]:
        """All modes (n,) and their slopes (n, k), complex."""
        F, n = self.A, len(self.A.channels)
        d = delta[self._of]
        modes, right = np.linalg.eig(self.matrix(delta))
        left = np.linalg.inv(right)
        into = np.linalg.solve(np.eye(n) - F.A * d, F.B @ right)
        out = np.linalg.solve((np.eye(n) - d[:, None] * F.A).T, F.C.T).T
        each = (left @ out) * into.T
        slopes = np.zeros((len(modes), len(self.names)), complex)
        np.add.at(slopes.T, self._of, each.T)
        return modes, slopes

    def onset(self, most: float) -> InstabilityOnset:
        """The smallest destabilising deviations that the search finds, none above `most`."""
        modes, slopes = self.slopes(np.zeros(len(self.names)))
        # Modes by how far the box can push them: the share of their distance to the axis.
        reach = np.sum(np.abs(slopes.real), axis=1) / np.maximum(-modes.real, 1e-9)
        likely = np.argsort(-reach)[: 2 * _STARTS : 2]
        best = InstabilityOnset(np.inf, {}, 0.0)
        tried: set[tuple[float, ...]] = set()
        for mode in likely:
            pattern = _signs(slopes[mode].real)
            for _ in range(_ROUNDS):
                if tuple(pattern) in tried:
                    break
                tried.add(tuple(pattern))
                size = self._along(pattern, min(most, best.size))
                reached = size if np.isfinite(size) else 0.9 * min(most, best.size)
                now, now_slopes = self.slopes(reached * pattern)
                critical = int(np.argmax(now.real))
                if size < best.size:
                    named = dict(zip(self.names, (size * pattern).tolist(), strict=True))
                    best = InstabilityOnset(size, named, abs(float(now[critical].imag)))
                pattern = _signs(now_slopes[critical].real)
        return self._smaller(self._corner(best, most), most)

    def _corner(self, best: InstabilityOnset, most: float) -> InstabilityOnset:
        """The best so far, or the corner of a box, unstable at its size, that is first unstable."""
        k = len(self.names)
        if k > _MOST_CORNERS:
            return best
        for number in range(2**k):
            pattern = np.where((number >> np.arange(k)) & 1, 1.0, -1.0)
            size = min(best.size, most)
            if self.abscissa(size * pattern) >= 0.0:
                best = self._first(pattern, size, best)
        return best

    def _first(
        self, pattern: NDArray[np.float64], most: float, best: InstabilityOnset
    ) -> InstabilityOnset:
        """The onset along a pattern, up to `most`, if it is smaller than the best."""
        size = self._along(pattern, most)
        if size >= best.size:
            return best
        modes = np.linalg.eigvals(self.matrix(size * pattern))
        named = dict(zip(self.names, (size * pattern).tolist(), strict=True))
        frequency = abs(float(modes[int(np.argmax(modes.real))].imag))
        return InstabilityOnset(size, named, frequency)

    def _smaller(self, best: InstabilityOnset, most: float) -> InstabilityOnset:
        """Smaller deviations than the best so far, from starts all over a box that is smaller.

        The worst member need not lie at a corner: a local search for the largest real part inside.
        """
        starts = np.random.default_rng(1).uniform(-1.0, 1.0, (_INSIDE, len(self.names)))
        for start in starts:
            size = _SHRUNK * min(best.size, most)
            optimum = minimize(
                self._downhill,
                size * start,
                jac=True,
                bounds=[(-size, size)] * len(start),
                method="L-BFGS-B",
                options={"maxiter": _CLIMBS},
            )
            if optimum.fun >= 0.0:
                continue
            best = self._first(optimum.x / np.max(np.abs(optimum.x)), size, best)
        return best

    def _downhill(self, delta: uncertain_Matrix) -> tuple[float, uncertain_Matrix]:
        """The smallest damping ratio of the modes, negative if one grows, and its slopes."""
        modes, slopes = self.slopes(delta)
        size = np.abs(modes)
        worst = int(np.argmax(modes.real / size))
        mode, slope, length = modes[worst], slopes[worst], size[worst]
        turn = mode.real * (mode.conjugate() * slope).real / length**3 - slope.real / length
        return -float(mode.real / length), turn

    def _along(self, pattern: NDArray[np.float64], most: float) -> float:
        """First size up to `most` at which a mode along a pattern reaches the axis; inf if none."""
        sizes = np.linspace(0.0, most, _FIRST_CROSSING + 1)[1:]
        good = 0.0
        for size in sizes:
            if self.abscissa(size * pattern) >= 0.0:
                bad = size
                break
            good = size
        else:
            return np.inf
        while bad - good > _TO_ONSET * bad:
            middle = 0.5 * (good + bad)
            good, bad = (good, middle) if self.abscissa(middle * pattern) >= 0.0 else (middle, bad)
        return float(bad)


def _signs(slopes: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.where(slopes >= 0.0, 1.0, -1.0)


# -------------------------------------------------------------------------------------------------
# The largest gain that a family of loops has, enclosed: a member that has it, and a proof.
#
# The gain is that of a full block, or the structured singular value for complex numbers (the
# inverse
# of a disk margin, where the numbers are its disks). Below: the gain of a member of the box,
# sought
# by the signs of its slopes, then by ascent from starts inside. Above: the skewed structured
# singular
# value, the parameters as they are, the performance's block as large as holds (`certificate`).
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]
_GRID = np.geomspace(0.02, 300.0, 90)
_AROUND, _WIDTHS = np.linspace(-1.0, 1.0, 9), (0.04, 0.008, 0.0015)
_HOPELESS = 100.0  # times the lower bound
_WORST_GAIN_ROUNDS, _WORST_GAIN_STARTS, _WORST_GAIN_CLIMBS = 8, 4, 20


@dataclass(frozen=True)
class WorstGain:
    """lower <= largest gain of the family <= upper.

    Attributes
    ----------
    nominal, lower, upper : float
        With more than three complex numbers nominal and lower, too, are bounds by scalings: of the
        structured singular value of one member, not below it, and mostly equal to it.
    deltas : dict of str to float
        The member whose gain is `lower`.
    frequency_radps : float
        Where it has it.
    certificate : RobustCertificate
        Of `upper`.
    """

    nominal: float
    lower: float
    upper: float
    deltas: Mapping[str, float]
    frequency_radps: float
    certificate: RobustCertificate


class GainFamily:
    """x' = A x + B w, z = C x + D w, all four in one matrix that depends on named parameters.

    Attributes
    ----------
    F : Uncertain
        [[A, B], [C, D]].
    n : int
        Number of states.
    scalars : int
        0: z, w belong to a full block. Otherwise all of them to so many complex numbers.
    """

    def __init__(self, F: Uncertain, n: int, scalars: int = 0) -> None:
        self.F, self.n, self.scalars = F, n, scalars
        self.names = tuple(dict.fromkeys(F.channels))
        self._of = np.array([self.names.index(name) for name in F.channels], dtype=int)

    @property
    def system(self) -> UncertainSystem:
        """M(s) of the parameters' channels, then the performance's."""
        F, n = self.F, self.n
        return UncertainSystem(
            F.D[:n, :n],
            np.hstack([F.C[:n], F.D[:n, n:]]),
            np.vstack([F.B[:, :n], F.D[n:, :n]]),
            np.block([[F.A, F.B[:, n:]], [F.C[n:], F.D[n:, n:]]]),
        )

    @property
    def blocks(self) -> list[Block]:
        """The parameters, as large as they are, then the performance."""
        parameters = [real(name, self.F.channels.count(name), fixed=True) for name in self.names]
        n_z, n_w = (size - self.n for size in self.F.D.shape)
        if not self.scalars:
            return [*parameters, Block("gain", "full", n_z, n_w)]
        return [*parameters, *(Block(f"gain {i}", "complex", 1, 1) for i in range(self.scalars))]

    def gain(self, delta: Array) -> tuple[float, float, Array]:
        """The largest gain on a grid of frequencies and about its best, where, and its slopes."""
        F, n = self.F, self.n
        d = delta[self._of]
        into = np.linalg.solve(np.eye(len(d)) - F.A * d, F.B)
        out = np.linalg.solve((np.eye(len(d)) - d[:, None] * F.A).T, F.C.T).T
        whole = F.D + F.C * d @ into
        A, B, C, D = whole[:n, :n], whole[:n, n:], whole[n:, :n], whole[n:, n:]
        modes, right = np.linalg.eig(A)
        left_B, C_right = np.linalg.solve(right, B.astype(complex)), C @ right

        def response(omega: Array) -> NDArray[np.complex128]:
            return (C_right / (1j * omega[:, None, None] - modes)) @ left_B + D

        omega = np.union1d(_GRID, np.abs(modes.imag))
        # Where it is largest, roughly; then, about there, well.
        at = omega[int(np.argmax(self._sizes(response(omega), 0)[0]))]
        for width in _WIDTHS:
            near = at * (1.0 + width * _AROUND)
            sizes, scales = self._sizes(response(near))
            at = near[int(np.argmax(sizes))]
        best = int(np.argmax(sizes))
        M, scale = response(near[best : best + 1])[0], scales[best]
        weight_z, weight_w = np.ones(len(C)), np.ones(B.shape[1])
        weight_z[: self.scalars], weight_w[: self.scalars] = scale, 1.0 / scale
        u, _, vh = np.linalg.svd(weight_z[:, None] * M * weight_w)
        to_z, from_w = u[:, 0].conj() * weight_z, weight_w * vh[0].conj()
        inverse = np.linalg.inv(1j * near[best] * np.eye(n) - A)
        before = np.concatenate([to_z @ C @ inverse, to_z])
        after = np.concatenate([inverse @ B @ from_w, from_w])
        slopes = np.zeros(len(self.names))
        np.add.at(slopes, self._of, ((before @ out) * (into @ after)).real)
        return float(sizes[best]), float(near[best]), slopes

    def _sizes(self, M: NDArray[np.complex128], descent: int = 60) -> tuple[Array, Array]:
        if not self.scalars:
            return np.linalg.norm(M, 2, axis=(1, 2)), np.zeros((len(M), 0))
        return scaled_mu(M, self.scalars, descent)

    def worst(self) -> tuple[Array, float, float]:
        """The member of the box with the largest gain found: deviations, gain, frequency."""
        rng = np.random.default_rng(1)
        k = len(self.names)
        best = (np.zeros(k), *self.gain(np.zeros(k))[:2])
        starts = [np.zeros(k), *rng.choice([-1.0, 1.0], (_WORST_GAIN_STARTS, k))]
        tried: set[tuple[float, ...]] = set()
        for start in starts:
            pattern = start
            for _ in range(_WORST_GAIN_ROUNDS):
                size, omega, slopes = self.gain(pattern)
                if size > best[1]:
                    best = (pattern, size, omega)
                pattern = np.where(slopes >= 0.0, 1.0, -1.0)
                if tuple(pattern) in tried:
                    break
                tried.add(tuple(pattern))
        for start in [best[0], *rng.uniform(-1.0, 1.0, (_WORST_GAIN_STARTS, k))]:
            optimum = minimize(
                self._downhill, start, jac=True, bounds=[(-1.0, 1.0)] * k, method="L-BFGS-B",
                options={"maxiter": _WORST_GAIN_CLIMBS},
            )  # fmt: skip
            size, omega, _ = self.gain(optimum.x)
            if size > best[1]:
                best = (optimum.x, size, omega)
        return best

    def _downhill(self, delta: Array) -> tuple[float, Array]:
        size, _, slopes = self.gain(delta)
        return -np.log(size), -slopes / size


def worst_gain(family: GainFamily, gap: float) -> WorstGain:
    """The largest gain of a family that is stable everywhere, in bounds about `gap` apart.

    Raises
    ------
    RobustError
        UNSTABLE: the nominal member. NO_CERTIFICATE: no bound is found, as where a member of the
        box is not stable.
    """
    delta, size, omega = family.worst()
    proof = certify(family.system, family.blocks, (1.0 + gap) * size, _HOPELESS * size)
    return WorstGain(
        family.gain(np.zeros(len(delta)))[0],
        size,
        proof.level,
        dict(zip(family.names, delta.tolist(), strict=True)),
        omega,
        proof,
    )
