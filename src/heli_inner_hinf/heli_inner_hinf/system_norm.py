# SPDX-License-Identifier: Apache-2.0
"""H-infinity norm of a stable, strictly proper system, with its frequency."""

import numpy as np

from heli_inner_hinf.regular_form import Matrix
from heli_inner_hinf.riccati import balanced_hamiltonian

REL_TOL = 1e-11


def transfer(A: Matrix, B: Matrix, C: Matrix, omega: float) -> np.ndarray:
    """C (jw I - A)^-1 B (n_y, n_u), complex, at omega rad/s."""
    return C @ np.linalg.solve(1j * omega * np.eye(A.shape[0]) - A, B.astype(np.complex128))


def hinf_norm(A: Matrix, B: Matrix, C: Matrix) -> tuple[float, float]:
    """max over w of the largest singular value of C (jw I - A)^-1 B.

    Parameters
    ----------
    A, B, C : (n, n), (n, n_u), (n_y, n) arrays
        Stable system.

    Returns
    -------
    norm, frequency : float
        Relative accuracy 1e-11 (Bruinsma, Steinbuch 1990); rad/s.
    """
    if A.shape[0] == 0 or not np.any(B) or not np.any(C):
        return 0.0, 0.0

    def gain(omega: float) -> float:
        return float(np.linalg.svd(transfer(A, B, C, omega), compute_uv=False)[0])

    poles = np.linalg.eigvals(A)
    best, where = max((gain(w), w) for w in np.concatenate([[0.0], np.abs(poles)]))
    BBt, CtC = B @ B.T, C.T @ C
    for _ in range(60):
        level = best * (1.0 + REL_TOL)
        if level == 0.0:
            return 0.0, 0.0
        H = np.block([[A, BBt / level], [-CtC / level, -A.T]])
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
