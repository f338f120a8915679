# SPDX-License-Identifier: Apache-2.0
"""A linear model of the aircraft about any state of a flight, trimmed or not.

    x' = f + A (x - x0) + B (u - u0) + E w

with f the derivative at the point itself, u the commands to the servos and w what the air moves
more than it does now, NED. A predictive controller makes it anew at every step (successive
linearisation: Rawlings, Mayne, Diehl, Model Predictive Control, 2nd ed., 2017, ch. 8).
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.errors import ParameterError
from heli_core.linear import held
from heli_core.rotations import euler_from_quat, quat_from_euler, quat_to_R_nb
from heli_core.rows import ACTUATOR, AIR, PLANT
from heli_dynamics_sim.aircraft import HelicopterParams, states_of
from heli_dynamics_sim.helicopter import derivative_kernel

_STEP = 1e-5


class LocalRow(NamedTuple):
    """States of a local model (23,)."""

    pos: slice = slice(0, 3)  # north, east, down, m
    vel: slice = slice(3, 6)  # north, east, down, m/s
    attitude: slice = slice(6, 9)  # phi, theta, psi, rad
    phi: int = 6
    theta: int = 7
    psi: int = 8
    rate: slice = slice(9, 12)  # p, q, r, body, rad/s
    rotor: slice = slice(12, 15)  # a_s, b_s, d_int, rad
    servo: slice = slice(15, 19)  # an ActuatorRow
    servo_rate: slice = slice(19, 23)  # 1/s
    size: int = 23


LOCAL = LocalRow()
_N_U, _N_W = ACTUATOR.size, 3


@dataclass(frozen=True)
class LocalModel:
    """A linear model about a state; SI, rad, NED and FRD.

    Attributes
    ----------
    A, B, E : (23, 23), (23, 4), (23, 3) arrays
        By states (places of `LOCAL`), commands d_lat, d_lon, d_ped, d_col, and wind: velocity of
        the air, north, east, down, m/s.
    f : (23,) array
        Derivative at x, u.
    x : (23,) array
        The state; heading in -pi to pi.
    u : (4,) array
        The command, -1 to 1.
    delay_s : float
        A command comes to its servo so much later; the model does not hold it.
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    E: NDArray[np.float64]
    f: NDArray[np.float64]
    x: NDArray[np.float64]
    u: NDArray[np.float64]
    delay_s: float

    def held(self, dt_s: float) -> tuple[NDArray[np.float64], ...]:
        """Phi (23, 23), Gamma (23, 4), c (23,): x(n+1) - x = Phi (x(n) - x) + Gamma (u(n) - u) + c.

        u is held over dt_s; exact.

        Raises
        ------
        ParameterError
            dt_s is no finite number above 0.
        """
        is_number = isinstance(dt_s, int | float | np.number) and not isinstance(dt_s, bool)
        if not (is_number and 0.0 < dt_s < np.inf):
            raise ParameterError.of_argument("dt_s", dt_s, "a finite number above 0")
        Phi, both = held(self.A, np.column_stack([self.B, self.f]), dt_s)
        return Phi, both[:, :_N_U], both[:, _N_U]


def local_state(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """The states (23,), places of `LOCAL`, of a plant's (42,)."""
    out = np.empty(LOCAL.size)
    out[LOCAL.pos] = x[PLANT.pos]
    out[LOCAL.vel] = quat_to_R_nb(x[PLANT.quat]) @ x[PLANT.vel]
    out[LOCAL.attitude] = euler_from_quat(x[PLANT.quat])
    out[LOCAL.rate], out[LOCAL.rotor] = x[PLANT.rate], x[PLANT.rotor]
    out[LOCAL.servo], out[LOCAL.servo_rate] = x[PLANT.servo], x[PLANT.servo_rate]
    return out


class _Derivative:
    """f(z), z: states, commands, wind, states of the aircraft's terms; theirs behind the others."""

    def __init__(
        self, x: NDArray[np.float64], u: NDArray[np.float64], air: NDArray[np.float64],
        k: HelicopterParams,
    ) -> None:  # fmt: skip
        self.k, self._x, self._air, self._out = k, x.copy(), air.copy(), np.empty(PLANT.size)
        states = states_of(k.terms)
        self.places, self.rows = [s.place for s in states], [s.row for s in states]
        self.z0 = np.concatenate([local_state(x), u, np.zeros(_N_W), x[self.places]])

    def __call__(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        n = LOCAL.size
        u, wind = z[n : n + _N_U], z[n + _N_U : n + _N_U + _N_W]
        phi, theta, psi = z[LOCAL.attitude]
        p, q, r = z[LOCAL.rate]
        x, air, out = self._x, self._air.copy(), self._out
        x[PLANT.pos], x[PLANT.quat] = z[LOCAL.pos], quat_from_euler(phi, theta, psi)
        R_nb = quat_to_R_nb(x[PLANT.quat])
        x[PLANT.vel], x[PLANT.rate] = R_nb.T @ z[LOCAL.vel], z[LOCAL.rate]
        x[PLANT.rotor], x[PLANT.servo] = z[LOCAL.rotor], z[LOCAL.servo]
        x[PLANT.servo_rate], x[self.places] = z[LOCAL.servo_rate], z[n + _N_U + _N_W :]
        air[AIR.velocity] += np.tile(wind, 3)
        derivative_kernel(x, u.copy(), air, self.k, out)
        slope = np.empty(n)
        slope[LOCAL.pos] = z[LOCAL.vel]
        slope[LOCAL.vel] = R_nb @ (out[PLANT.vel] + np.cross(z[LOCAL.rate], x[PLANT.vel]))
        turn = q * np.sin(phi) + r * np.cos(phi)
        slope[LOCAL.phi] = p + turn * np.tan(theta)
        slope[LOCAL.theta] = q * np.cos(phi) - r * np.sin(phi)
        slope[LOCAL.psi] = turn / np.cos(theta)
        slope[LOCAL.rate], slope[LOCAL.rotor] = out[PLANT.rate], out[PLANT.rotor]
        slope[LOCAL.servo], slope[LOCAL.servo_rate] = out[PLANT.servo], out[PLANT.servo_rate]
        return np.concatenate([slope, out[self.rows]])


def linearize_at(
    x: NDArray[np.float64],
    u: NDArray[np.float64],
    air: NDArray[np.float64],
    k: HelicopterParams,
    delay_s: float = 0.0,
) -> LocalModel:
    """Linearise about a state; central differences.

    States that the aircraft's terms add (inflow, engine) count as settled: they are faster than
    the others. f is taken as they are.

    Parameters
    ----------
    x : (42,) array
        Places of `rows.PLANT`; a pitch of 90 deg has no model.
    u : (4,) array
        Command, -1 to 1.
    air : (12,) array
        Places of `rows.AIR`.
    k : HelicopterParams
    delay_s : float
        Of the commands; told on.
    """
    f = _Derivative(x, u, air, k)
    n, m = LOCAL.size, LOCAL.size + _N_U + _N_W
    columns = []
    for i in range(f.z0.size):
        plus, minus = f.z0.copy(), f.z0.copy()
        plus[i] += _STEP
        minus[i] -= _STEP
        columns.append((f(plus) - f(minus)) / (plus[i] - minus[i]))
    full = np.column_stack(columns)
    settled = np.linalg.lstsq(full[n:, m:], full[n:, :m], rcond=None)[0]
    A, B, E = np.split(full[:n, :m] - full[:n, m:] @ settled, [n, n + _N_U], axis=1)
    return LocalModel(A, B, E, f(f.z0)[:n], f.z0[:n], np.array(u, np.float64), delay_s)
