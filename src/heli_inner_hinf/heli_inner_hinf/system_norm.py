# SPDX-License-Identifier: Apache-2.0
"""H-infinity norm of a stable system, with its frequency."""

import numpy as np

from heli_inner_hinf.regular_form import Matrix
from heli_inner_hinf.riccati import balanced_hamiltonian

REL_TOL = 1e-11


def transfer(A: Matrix, B: Matrix, C: Matrix, omega: float) -> np.ndarray:
    """C (jw I - A)^-1 B (n_y, n_u), complex, at omega rad/s."""
    return C @ np.linalg.solve(1j * omega * np.eye(A.shape[0]) - A, B.astype(np.complex128))


def hinf_norm(A: Matrix, B: Matrix, C: Matrix, D: Matrix | None = None) -> tuple[float, float]:
    """max over w of the largest singular value of C (jw I - A)^-1 B + D.

    Parameters
    ----------
    A, B, C : (n, n), (n, n_u), (n_y, n) arrays
        Stable system.
    D : (n_y, n_u) array, optional
        Default: zero.

    Returns
    -------
    norm, frequency : float
        Relative accuracy 1e-11 (Bruinsma, Steinbuch 1990); rad/s; inf where the direct path has the
        largest gain.
    """
    D = np.zeros((C.shape[0], B.shape[1])) if D is None else D
    direct = float(np.linalg.norm(D, 2))
    if A.shape[0] == 0 or not np.any(B) or not np.any(C):
        return direct, 0.0

    def gain(omega: float) -> float:
        return float(np.linalg.svd(transfer(A, B, C, omega) + D, compute_uv=False)[0])

    poles = np.linalg.eigvals(A)
    best, where = max((gain(w), w) for w in np.concatenate([[0.0], np.abs(poles)]))
    if direct > best:
        best, where = direct, np.inf
    for _ in range(60):
        level = best * (1.0 + REL_TOL)
        if level == 0.0:
            return 0.0, 0.0
        H = _hamiltonian(A, B, C, D, level)
        eigenvalues = np.linalg.eigvals(balanced_hamiltonian(H)[0])
        size = np.abs(eigenvalues)
        near = np.abs(eigenvalues.real) <= 1e-3 * size + 1e-8 * np.max(size)
        crossing = np.unique(np.abs(eigenvalues[near].imag))
        trial = np.concatenate([crossing, 0.5 * (crossing[1:] + crossing[:-1])])
        if trial.size:
            found, at = max((gain(w), w) for w in trial)
            if found > best:
                best, where = found, at
        if best <= level:
            break
    return float(best), float(where)


def _hamiltonian(A: Matrix, B: Matrix, C: Matrix, D: Matrix, level: float) -> Matrix:
    """Its eigenvalues on the axis are where a singular value equals `level`."""
    inside = np.linalg.inv(np.eye(B.shape[1]) - D.T @ D / level**2)
    a = A + B @ inside @ D.T @ C / level**2
    through = C.T @ (np.eye(C.shape[0]) + D @ inside @ D.T / level**2) @ C
    return np.block([[a, B @ inside @ B.T / level], [-through / level, -a.T]])
