# SPDX-License-Identifier: Apache-2.0
"""Start values from the measured spectra alone: equation error with separated parameters.

Given servos, delay and the flapping matrix, every row of p', q', r' in eq. (10) is linear in the
rest: the unmeasured states follow from measured rates and commands, b_s = (s - M)^-1 (-p + ...) and
d_int = (K_a d_ped - r)/s. So only the few numbers of servos, delay and flapping are searched for,
from several places, and the others are solved for at each step (variable projection: Golub and
Pereyra, SIAM J. Numer. Anal. 10, 1973). Equation error is biased by noise; it is a start. Moments
act through the disc, so p and q themselves are left out of their rows: A(p,p) and A(q,q) could
hardly be told from the flapping rate here.
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from heli_identification.experiment import Array
from heli_identification.response import FastModel
from heli_identification.spectra import GUST, VEL, ComplexArray, Spectra, U, Y
from heli_math.ticks import TICK_S

_SERVOS_RADPS = (20.0, 45.0, 90.0)
_FLAPPING_1PS = (2.0, 6.0, 20.0)
_LOWEST_RADPS = 1.0  # below, turbulence and drift weigh more than they tell


@dataclass(frozen=True)
class _Row:
    """One solved row: regressors' coefficients and what is left."""

    coefficients: Array
    left: Array


def _solve(rhs: ComplexArray, columns: list[ComplexArray], weight: Array) -> _Row:
    M = np.column_stack(columns) * weight[:, None]
    b = rhs * weight
    M, b = np.vstack([M.real, M.imag]), np.concatenate([b.real, b.imag])
    scale = np.linalg.norm(M, axis=0)
    scale[scale == 0.0] = 1.0
    x = np.linalg.lstsq(M / scale, b, rcond=1e-8)[0]
    return _Row(x / scale, M / scale @ x - b)


class StartSearch:
    """Equation error on the excited lines as a function of servos, delay and flapping."""

    def __init__(self, spectra: Spectra) -> None:
        keep = spectra.omega_radps > _LOWEST_RADPS
        self.s = 1j * spectra.omega_radps[keep]
        z = spectra.z[keep]
        self.y, self.u = z[:, Y], z[:, U]
        self.wind = z[:, GUST] - z[:, VEL]
        noise = np.sqrt(spectra.noise_covariance()[keep][:, range(3), range(3)].real)
        self.weight = 1.0 / np.abs(self.s)[:, None] / np.maximum(noise, 1e-3 * np.abs(self.y).max())

    def inputs(self, servo: float, damping: float, delay_s: float) -> ComplexArray:
        """Servo positions (L, 4)."""
        s = self.s
        hold = -np.expm1(-s * TICK_S) / (s * TICK_S)
        lag = servo**2 / (s**2 + 2.0 * damping * servo * s + servo**2)
        return np.asarray(self.u * (np.exp(-s * delay_s) * hold * lag)[:, None])

    def rows(self, x: Array) -> tuple[_Row, _Row, _Row]:
        """Solved rows p, q, r for x = log servo, log damping, delay, flapping (3)."""
        u = self.inputs(np.exp(x[0]), np.exp(x[1]), x[2])
        p, q, r = self.y.T
        s = self.s
        a, b, c, d = x[3], x[4], x[5], x[3]
        determinant = (s - a) * (s - d) - b * c
        # (s - M)^-1 by rows
        aa, ab, ba, bb = (s - d), b, c, (s - a)
        known_a = (-aa * q - ab * p) / determinant
        known_b = (-ba * q - bb * p) / determinant
        lat, lon, ped, col = u.T
        gyro = [-r / s, ped / s, ped, col, *self.wind.T]
        by_a = [aa * lat, aa * lon, ab * lat, ab * lon]
        by_b = [ba * lat, ba * lon, bb * lat, bb * lon]
        w = self.weight.T
        return (
            _solve(s * p, [known_b, *(m / determinant for m in by_b), r, *gyro], w[0]),
            _solve(s * q, [known_a, *(m / determinant for m in by_a), r, *gyro], w[1]),
            _solve(s * r, [r, *gyro], w[2]),
        )

    def residual(self, x: Array) -> Array:
        """What the linear rows leave."""
        return np.concatenate([row.left for row in self.rows(x)])

    def best(self) -> FastModel:
        """Best model over all places to start from."""
        lower = np.array([np.log(3.0), np.log(0.05), 0.0, -200.0, -50.0, -50.0])
        upper = np.array([np.log(250.0), np.log(3.0), 0.15, 0.0, 50.0, 50.0])
        found = []
        for servo in _SERVOS_RADPS:
            for flapping in _FLAPPING_1PS:
                at = np.array([np.log(servo), np.log(0.7), 0.02, -flapping, 0.1, 0.1])
                found.append(
                    least_squares(
                        self.residual, at, bounds=(lower, upper), x_scale="jac", max_nfev=40
                    )
                )
        return self.model(min(found, key=lambda result: result.cost).x)

    def model(self, x: Array) -> FastModel:
        """The fast model of the solved rows."""
        p, q, r = (row.coefficients for row in self.rows(x))
        A, B, E = np.zeros((6, 6)), np.zeros((6, 4)), np.zeros((6, 4))
        A[2, 1] = A[3, 0] = A[5, 4] = -1.0
        A[2, 2], A[2, 3], A[3, 2], A[3, 3] = x[3], x[4], x[5], x[3]
        A[0, 3], A[1, 2] = p[0], q[0]
        B[2, :2] = q[1:3] / q[0]
        B[3, :2] = p[3:5] / p[0]
        for row, c in ((0, p), (1, q)):
            A[row, 4], A[row, 5] = c[5], c[6]
            B[row, 2:4], E[row, :3] = c[8:10], c[10:13]
        A[4, 4], A[4, 5], B[4, 2:4], E[4, :3] = r[0], r[1], r[3:5], r[5:8]
        B[5, 2] = r[2] / r[1]
        return FastModel(A, B, E, float(np.exp(x[0])), float(np.exp(x[1])), float(x[2]))
