# SPDX-License-Identifier: Apache-2.0
"""Trim: hover over a point of the ground in steady wind, in equilibrium."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_dynamics_sim.helicopter import derivative_kernel, same_air
from heli_dynamics_sim.parameters import HelicopterKernel, HelicopterParameters
from heli_dynamics_sim.state import make_state
from heli_dynamics_sim.terms import states_of
from heli_math.rows import ACTUATOR, PLANT

ALTITUDE_M = 1000.0
"""A height at which the ground is out of reach, of the skids and of the wake."""
_RESIDUAL_LIMIT = 1e-9
_MAX_NEWTON = 40

# Rows of the state derivative that must vanish (the others vanish by construction).
_ROWS = {
    PLANT.u: "u_dot (m/s2)",
    PLANT.v: "v_dot (m/s2)",
    PLANT.w: "w_dot (m/s2)",
    PLANT.p: "p_dot (rad/s2)",
    PLANT.q: "q_dot (rad/s2)",
    PLANT.r: "r_dot (rad/s2)",
    PLANT.a_s: "a_s_dot (rad/s)",
    PLANT.b_s: "b_s_dot (rad/s)",
}


class _Unknowns(NamedTuple):
    """What is solved for (8,); states of the terms that are on follow."""

    phi: int = 0
    theta: int = 1
    a_s: int = 2
    b_s: int = 3
    d_lat: int = 4
    d_lon: int = 5
    d_col: int = 6
    d_int: int = 7


_Z = _Unknowns()


class TrimError(RuntimeError):
    """No trim: the message names the residual and how far it stayed from zero, or the actuator."""


@dataclass(frozen=True)
class Trim:
    """An equilibrium.

    Attributes
    ----------
    x : (42,) array
        Plant state at the origin, places of `heli_math.rows.PLANT`, with rotor speed and states of
        terms.
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


class _Problem:
    """Residuals of the trim equations in one wind."""

    def __init__(
        self, k: HelicopterKernel, wind: NDArray[np.float64], psi: float, altitude_m: float
    ) -> None:
        # The actuators' stops are judged at the end, not inside the iteration.
        self.k = k._replace(servo=k.servo._replace(travel=1e3))
        self.wind, self.air = wind, same_air(wind)
        self.psi = psi
        self.altitude_m = altitude_m
        self.out = np.empty(PLANT.size)
        states = states_of(k.terms)
        self.places = [state.place for state in states]
        self.rows = _ROWS | {state.row: state.meaning for state in states}

    def expand(self, z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """State and command for the unknowns."""
        x = make_state((0.0, 0.0, -self.altitude_m), z[_Z.phi], z[_Z.theta], self.psi)
        x[PLANT.rotor] = z[_Z.a_s], z[_Z.b_s], z[_Z.d_int]
        u = np.zeros(ACTUATOR.size)
        u[ACTUATOR.lat], u[ACTUATOR.lon], u[ACTUATOR.col] = z[_Z.d_lat], z[_Z.d_lon], z[_Z.d_col]
        x[PLANT.servo] = u
        x[PLANT.omega] = self.k.main.speed
        x[self.places] = z[len(_Z) :]
        return x, u

    def residual(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        x, u = self.expand(z)
        derivative_kernel(x, u, self.air, self.k, self.out)
        return self.out[list(self.rows)]

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

    def refusal(self, f: NDArray[np.float64]) -> TrimError:
        worst = int(np.abs(f).argmax())
        return TrimError(
            f"no trim in wind {np.round(self.wind, 3).tolist()} m/s (NED) at heading "
            f"{np.degrees(self.psi):.1f} deg: {list(self.rows.values())[worst]} stays at "
            f"{f[worst]:.3g}, allowed: {_RESIDUAL_LIMIT:g}"
        )


def trim(
    params: HelicopterParameters,
    wind_ned_mps: ArrayLike = (0.0, 0.0, 0.0),
    psi: float = 0.0,
    altitude_m: float = ALTITUDE_M,
) -> Trim:
    """Find the equilibrium of a hover over a fixed point in steady wind.

    Solves for phi, theta, a_s, b_s, d_lat, d_lon, d_col and d_int (d_ped is 0 in trim: the gyro's
    integrator carries the tail), and for the states that the aircraft's terms add. The wind is
    raised from zero in steps, each solved by a damped Newton iteration from the one before.

    Parameters
    ----------
    params : HelicopterParameters
    wind_ned_mps : (3,) array
        Velocity of the air, NED, m/s.
    psi : float
        Heading, rad.
    altitude_m : float
        Of the c.g., above the reach of the skids; matters to the term ground_effect alone.

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
        problem = _Problem(k, wind * (i / steps), psi, altitude_m)
        z, f = problem.newton(z)
    if not np.abs(f).max() <= _RESIDUAL_LIMIT:
        raise problem.refusal(f)
    for i in (_Z.d_lat, _Z.d_lon, _Z.d_col):
        if abs(z[i]) >= params.servo_travel:
            raise TrimError(
                f"no trim in wind {np.round(wind, 3).tolist()} m/s (NED) at heading "
                f"{np.degrees(psi):.1f} deg: {_Z._fields[i]} would have to be {z[i]:.3f}, "
                f"allowed: inside +-{params.servo_travel:g}"
            )
    x, u = problem.expand(z)
    x[PLANT.down] = 0.0
    return Trim(x, u, float(np.abs(f).max()), wind)


def _first_guess(params: HelicopterParameters) -> NDArray[np.float64]:
    """Collective and tail for hover without wind by momentum theory; all else zero."""
    k = params.kernel
    weight = k.body.mass * k.body.gravity
    v_i = np.sqrt(weight / k.rotor.disc)
    pitch = (weight / k.rotor.thrust_slope + v_i) / k.rotor.blade_speed
    power = weight * v_i + k.main.profile_power * k.main.tip_speed**2
    tail = power / k.main.speed / k.tail_arm
    tail_pitch = (tail / k.tail.thrust_slope + np.sqrt(tail / k.tail.disc)) / k.tail.blade_speed
    states = states_of(params.terms)
    z = np.zeros(len(_Z) + len(states))
    z[_Z.d_col] = (pitch - k.main.pitch_offset) / k.main.pitch_gain
    z[_Z.d_int] = (tail_pitch - k.gyro.pitch_offset) / (k.gyro.pitch_gain * k.gyro.integral)
    share = power / k.engine.power
    guess = {
        PLANT.inflow_mean: v_i,
        PLANT.engine: share,
        PLANT.governor: (share - k.engine.feed_forward * pitch) / k.engine.integral,
    }
    z[len(_Z) :] = [guess.get(state.place, 0.0) for state in states]
    return z
