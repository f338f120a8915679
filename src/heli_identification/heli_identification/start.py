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
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from heli_identification.experiment import Array
from heli_identification.places import AIR, STATE
from heli_identification.response import FastModel
from heli_identification.spectra import GUST, VEL, ComplexArray, Spectra, U, Y
from heli_identification.structure import empty_matrices
from heli_math.rows import ACTUATOR
from heli_math.ticks import TICK_S

_SERVOS_RADPS = (20.0, 45.0, 90.0)
_FLAPPING_1PS = (2.0, 6.0, 20.0)
_CYCLIC, _DIRECT = slice(ACTUATOR.lat, ACTUATOR.ped), slice(ACTUATOR.ped, ACTUATOR.size)
_LOWEST_RADPS = 1.0  # below, turbulence and drift weigh more than they tell


class _Search(NamedTuple):
    """What is searched for (6,)."""

    servo: int = 0  # log of rad/s
    damping: int = 1  # log
    delay: int = 2  # s
    flapping: int = 3  # A(a_s,a_s) and A(b_s,b_s)
    a_by_b: int = 4  # A(a_s,b_s)
    b_by_a: int = 5  # A(b_s,a_s)


class _TiltRow(NamedTuple):
    """Coefficients of the rows of p and of q (13,)."""

    disc: int = 0  # the disc as it follows from measured rates
    by_a: slice = slice(1, 3)  # d_lat, d_lon through a_s
    by_b: slice = slice(3, 5)  # and through b_s
    r: int = 5
    d_int: int = 6
    pedal: int = 7  # through d_int
    direct: slice = slice(8, 10)  # d_ped, d_col
    air: slice = slice(10, 13)  # u, v, w


class _YawRow(NamedTuple):
    """Coefficients of the row of r (8,): those of `_TiltRow` from r on."""

    r: int = 0
    d_int: int = 1
    pedal: int = 2
    direct: slice = slice(3, 5)
    air: slice = slice(5, 8)


_X, _TILT, _YAW = _Search(), _TiltRow(), _YawRow()


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
        """Solved rows p, q, r for x, places of `_Search`."""
        u = self.inputs(np.exp(x[_X.servo]), np.exp(x[_X.damping]), x[_X.delay])
        p, q, r = self.y.T
        s = self.s
        a, b, c, d = x[_X.flapping], x[_X.a_by_b], x[_X.b_by_a], x[_X.flapping]
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
        A, B, E = empty_matrices()
        a_s, b_s = STATE.a_s, STATE.b_s
        A[a_s, a_s] = A[b_s, b_s] = x[_X.flapping]
        A[a_s, b_s], A[b_s, a_s] = x[_X.a_by_b], x[_X.b_by_a]
        A[STATE.p, b_s], A[STATE.q, a_s] = p[_TILT.disc], q[_TILT.disc]
        B[a_s, _CYCLIC] = q[_TILT.by_a] / q[_TILT.disc]
        B[b_s, _CYCLIC] = p[_TILT.by_b] / p[_TILT.disc]
        for row, c, at in ((STATE.p, p, _TILT), (STATE.q, q, _TILT), (STATE.r, r, _YAW)):
            A[row, STATE.r], A[row, STATE.d_int] = c[at.r], c[at.d_int]
            B[row, _DIRECT], E[row, AIR.velocity] = c[at.direct], c[at.air]
        B[STATE.d_int, ACTUATOR.ped] = r[_YAW.pedal] / r[_YAW.d_int]
        servo, damping = np.exp(x[_X.servo]), np.exp(x[_X.damping])
        return FastModel(A, B, E, float(servo), float(damping), float(x[_X.delay]))
