# SPDX-License-Identifier: Apache-2.0
"""Trim: hover over a point of the ground in steady wind, in equilibrium."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_dynamics_sim.helicopter import derivative_kernel
from heli_dynamics_sim.parameters import HelicopterKernel, HelicopterParameters
from heli_dynamics_sim.state import N_STATE, make_state

# A height at which the ground is out of reach; trim does not depend on it.
_ALTITUDE_M = 1000.0
_RESIDUAL_LIMIT = 1e-9
_MAX_NEWTON = 40
_UNKNOWNS = ("phi", "theta", "a_s", "b_s", "d_lat", "d_lon", "d_col", "d_int")
# Rows of the state derivative that must vanish (the others vanish by construction).
_ROWS = (3, 4, 5, 10, 11, 12, 13, 14)
_ROW_NAMES = (
    "u_dot (m/s2)",
    "v_dot (m/s2)",
    "w_dot (m/s2)",
    "p_dot (rad/s2)",
    "q_dot (rad/s2)",
    "r_dot (rad/s2)",
    "a_s_dot (rad/s)",
    "b_s_dot (rad/s)",
)


class TrimError(RuntimeError):
    """No trim: the message names the residual and how far it stayed from zero, or the actuator."""


@dataclass(frozen=True)
class Trim:
    """An equilibrium.

    Attributes
    ----------
    x : (24,) array
        Plant state at the origin, layout of `heli_dynamics_sim.state`.
    u : (4,) array
        Commands that hold it.
    residual : float
        Largest derivative that should vanish, SI units.
    wind_ned_mps : (3,) array
        Wind it belongs to.
    """

    x: NDArray[np.float64]
    u: NDArray[np.float64]
    residual: float
    wind_ned_mps: NDArray[np.float64]


def _expand(z: NDArray[np.float64], psi: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """State and command for the eight unknowns."""
    x = make_state((0.0, 0.0, -_ALTITUDE_M), z[0], z[1], psi)
    x[13], x[14], x[15] = z[2], z[3], z[7]
    u = np.array([z[4], z[5], 0.0, z[6]])
    x[16:20] = u
    return x, u


class _Problem:
    """Residuals of the trim equations in one wind."""

    def __init__(self, k: HelicopterKernel, wind: NDArray[np.float64], psi: float) -> None:
        # The actuators' stops are judged at the end, not inside the iteration.
        self.k = k._replace(servo=k.servo._replace(travel=1e3))
        self.wind = wind
        self.psi = psi
        self.out = np.empty(N_STATE)

    def residual(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        x, u = _expand(z, self.psi)
        derivative_kernel(x, u, self.wind, self.k, self.out)
        return self.out[list(_ROWS)]

    def jacobian(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        step = 1e-6
        columns = []
        for i in range(z.size):
            plus, minus = z.copy(), z.copy()
            plus[i] += step
            minus[i] -= step
            columns.append((self.residual(plus) - self.residual(minus)) / (2.0 * step))
        return np.column_stack(columns)

    def newton(self, z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Damped Newton from z; the best point and its residual."""
        f = self.residual(z)
        for _ in range(_MAX_NEWTON):
            worst = np.abs(f).max()
            if worst < 1e-13:
                break
            step = np.linalg.lstsq(self.jacobian(z), -f, rcond=None)[0]
            scale = 1.0
            for _ in range(12):
                trial = z + scale * step
                f_trial = self.residual(trial)
                if np.abs(f_trial).max() < worst:
                    break
                scale *= 0.5
            else:
                break
            z, f = trial, f_trial
        return z, f


def _refusal(f: NDArray[np.float64], wind: NDArray[np.float64], psi: float) -> TrimError:
    worst = int(np.abs(f).argmax())
    return TrimError(
        f"no trim in wind {np.round(wind, 3).tolist()} m/s (NED) at heading "
        f"{np.degrees(psi):.1f} deg: "
        f"{_ROW_NAMES[worst]} stays at {f[worst]:.3g}, allowed: {_RESIDUAL_LIMIT:g}"
    )


def trim(
    params: HelicopterParameters, wind_ned_mps: ArrayLike = (0.0, 0.0, 0.0), psi: float = 0.0
) -> Trim:
    """Find the equilibrium of a hover over a fixed point in steady wind.

    Solves for phi, theta, a_s, b_s, d_lat, d_lon, d_col and d_int (d_ped is 0 in trim: the gyro's
    integrator carries the tail). The wind is raised from zero in steps, each solved by a damped
    Newton iteration from the one before.

    Parameters
    ----------
    params : HelicopterParameters
    wind_ned_mps : (3,) array
        Velocity of the air, NED, m/s.
    psi : float
        Heading, rad.

    Returns
    -------
    Trim

    Raises
    ------
    ValueError
        If the wind or the heading is not finite or has the wrong length.
    TrimError
        If a residual above 1e-9 remains, or an actuator would have to leave its travel.
    """
    wind = np.array(wind_ned_mps, dtype=np.float64)
    if wind.shape != (3,) or not np.isfinite(wind).all() or not np.isfinite(psi):
        raise ValueError(
            f"wind_ned_mps {wind.tolist()} and psi {psi}: expected 3 + 1 finite numbers"
        )
    k = params.kernel
    z = _first_guess(params)
    steps = 1 + int(np.linalg.norm(wind) / 1.5)
    for i in range(steps + 1):
        problem = _Problem(k, wind * (i / steps), psi)
        z, f = problem.newton(z)
    if not np.abs(f).max() <= _RESIDUAL_LIMIT:
        raise _refusal(f, wind, psi)
    for i in (4, 5, 6):
        if abs(z[i]) >= params.servo_travel:
            raise TrimError(
                f"no trim in wind {np.round(wind, 3).tolist()} m/s (NED) at heading "
                f"{np.degrees(psi):.1f} deg: {_UNKNOWNS[i]} would have to be {z[i]:.3f}, "
                f"allowed: inside +-{params.servo_travel:g}"
            )
    x, u = _expand(z, psi)
    x[2] = 0.0
    return Trim(x, u, float(np.abs(f).max()), wind)


def _first_guess(params: HelicopterParameters) -> NDArray[np.float64]:
    """Collective and tail for hover without wind by momentum theory; all angles zero."""
    k = params.kernel
    weight = k.body.mass * k.body.gravity
    v_i = np.sqrt(weight / k.rotor.disc)
    pitch = (weight / k.rotor.thrust_slope + v_i) / k.rotor.blade_speed
    power = weight * v_i + k.main.profile_power * k.main.tip_speed**2
    tail = power / k.main.speed / k.tail_arm
    tail_pitch = (tail / k.tail.thrust_slope + np.sqrt(tail / k.tail.disc)) / k.tail.blade_speed
    z = np.zeros(8)
    z[6] = (pitch - k.main.pitch_offset) / k.main.pitch_gain
    z[7] = (tail_pitch - k.gyro.pitch_offset) / (k.gyro.pitch_gain * k.gyro.integral)
    return z
