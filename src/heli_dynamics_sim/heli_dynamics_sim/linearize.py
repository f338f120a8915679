# SPDX-License-Identifier: Apache-2.0
"""Linearisation about a trim: the nine-state model of eq. (9) and (10).

States phi theta p q a_s b_s r d_int psi, inputs d_lat d_lon d_ped (after the servos), wind in body
axes u v w (velocity of the air, m/s, on top of the trim's wind), all as deviations from trim. The
inertial velocity stays that of the trim.

The power of climb makes a kink at w_a = 0, where hover without wind is: E(r, w) has a value for air
that rises (descent, no climb power) and another for air that sinks. `side` chooses; the
published E has that of the descent.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from heli_dynamics_sim.aircraft_kernel import CLIMB_POWER_OFF, CLIMB_POWER_ON
from heli_dynamics_sim.helicopter import airspeed, derivative_kernel, same_air
from heli_dynamics_sim.parameters import HelicopterKernel, HelicopterParameters
from heli_dynamics_sim.terms import states_of
from heli_dynamics_sim.trim import Trim
from heli_math.rotations import euler_from_quat, quat_from_euler, quat_to_R_nb
from heli_math.rows import ACTUATOR, NINE, PLANT
from heli_math.state_names import STATE_NAMES, WIND_NAMES

if TYPE_CHECKING:
    import control

_ALTITUDE_M = 1000.0  # out of the ground's reach
_AT_KINK_MPS = 1e-6
_STEP = 1e-5


@dataclass(frozen=True)
class LinearModel:
    """`x' = A x + B u + E w`, deviations from trim, SI units and rad.

    States, inputs and wind have the names and units of `heli_math.state_names`.

    Attributes
    ----------
    A : (9, 9) array
    B : (9, 3) array
    E : (9, 3) array
    x_trim : (9,) array
        Trim values of the nine states.
    u_trim : (3,) array
        Trim values of the three inputs.
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    E: NDArray[np.float64]
    x_trim: NDArray[np.float64]
    u_trim: NDArray[np.float64]

    @property
    def system(self) -> control.StateSpace:
        """As a system of python-control with named signals, see `heli_math.state_space`."""
        from heli_math.state_space import hover_system  # takes seconds to import

        return hover_system(self.A, self.B, self.E, "linearised")


def reduced_state(x: NDArray[np.float64]) -> NDArray[np.float64]:
    """The nine states of eq. (10) of a plant state (42,)."""
    nine = np.empty(len(NINE))
    nine[NINE.phi], nine[NINE.theta], nine[NINE.psi] = euler_from_quat(x[PLANT.quat])
    nine[NINE.p], nine[NINE.q], nine[NINE.r] = x[PLANT.rate]
    nine[NINE.a_s], nine[NINE.b_s], nine[NINE.d_int] = x[PLANT.rotor]
    return nine


class ReducedModel:
    """`f(z)`, z = nine states, inputs, three wind components (body, on top of the trim's).

    Behind these z and f have the states that the aircraft's terms add and their derivatives.

    Attributes
    ----------
    parts : tuple of int
        Where inputs, wind and the terms' states begin in z.
    """

    inputs = ACTUATOR.attitude

    def __init__(self, kernel: HelicopterKernel, trim: Trim) -> None:
        self.kernel = kernel
        self.trim = trim
        self.out = np.empty(PLANT.size)
        u = trim.u[self.inputs]
        states = states_of(kernel.terms)
        self.places, self.rows = [s.place for s in states], [s.row for s in states]
        calm = np.zeros(len(WIND_NAMES))
        self.z0 = np.concatenate([reduced_state(trim.x), u, calm, trim.x[self.places]])
        self.parts = tuple(np.cumsum([len(STATE_NAMES), len(u), len(WIND_NAMES)]))
        self.velocity_ned = quat_to_R_nb(trim.x[PLANT.quat]) @ trim.x[PLANT.vel]

    def __call__(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        """Derivative (9,) of the nine states at z (15,), and those of the terms' states."""
        nine, inputs, air, added = np.split(z, self.parts)
        phi, theta, p, q, a_s, b_s, r, d_int, psi = nine
        x = self.trim.x.copy()
        x[PLANT.down] = -_ALTITUDE_M
        x[PLANT.quat] = quat_from_euler(phi, theta, psi)
        R_nb = quat_to_R_nb(x[PLANT.quat])
        x[PLANT.vel] = R_nb.T @ self.velocity_ned
        x[PLANT.rate] = p, q, r
        x[PLANT.rotor] = a_s, b_s, d_int
        x[PLANT.servo][self.inputs] = inputs
        x[self.places] = added
        wind = self.trim.wind_ned_mps + R_nb @ air
        derivative_kernel(x, self.trim.u, same_air(wind), self.kernel, self.out)
        turn = q * np.sin(phi) + r * np.cos(phi)
        slope = np.empty(len(NINE))
        slope[NINE.phi] = p + turn * np.tan(theta)
        slope[NINE.theta] = q * np.cos(phi) - r * np.sin(phi)
        slope[NINE.psi] = turn / np.cos(theta)
        slope[NINE.p], slope[NINE.q], slope[NINE.r] = self.out[PLANT.rate]
        slope[NINE.a_s], slope[NINE.b_s], slope[NINE.d_int] = self.out[PLANT.rotor]
        return np.concatenate([slope, self.out[self.rows]])


def _jacobian(f: ReducedModel, step: float) -> NDArray[np.float64]:
    """Central differences at `step` and half of it, extrapolated (Richardson): (n, z.size).

    States that terms add are taken as settled: they are faster than the nine.
    """

    def central(i: int, h: float) -> NDArray[np.float64]:
        plus, minus = f.z0.copy(), f.z0.copy()
        plus[i] += h
        minus[i] -= h
        return (f(plus) - f(minus)) / (plus[i] - minus[i])

    columns = [(4.0 * central(i, 0.5 * step) - central(i, step)) / 3.0 for i in range(f.z0.size)]
    full = np.column_stack(columns)
    n, of_terms = full.shape[0] - len(f.rows), f.parts[-1]
    settled = np.linalg.lstsq(full[n:, of_terms:], full[n:, :of_terms], rcond=None)[0]
    return full[:n, :of_terms] - full[:n, of_terms:] @ settled


def smooth_kernel(
    params: HelicopterParameters, trim: Trim, side: Literal["descent", "climb"]
) -> HelicopterKernel:
    """The aircraft's kernel, with one branch of P_climb where the trim sits on its kink."""
    kernel = params.kernel
    if abs(airspeed(trim.x, trim.wind_ned_mps)[2]) > _AT_KINK_MPS:
        return kernel
    return kernel._replace(climb_power=CLIMB_POWER_OFF if side == "descent" else CLIMB_POWER_ON)


def linearize(
    params: HelicopterParameters, trim: Trim, side: Literal["descent", "climb"] = "descent"
) -> LinearModel:
    """Linearise about a trim.

    Parameters
    ----------
    params : HelicopterParameters
    trim : Trim
    side : {"descent", "climb"}
        Which branch of the climb power to take if the trim has w_a = 0.

    Returns
    -------
    LinearModel

    Raises
    ------
    ValueError
        If `side` is neither.
    """
    if side not in ("descent", "climb"):
        raise ValueError(f"side {side!r} is not allowed; allowed: 'descent', 'climb'")
    model = ReducedModel(smooth_kernel(params, trim, side), trim)
    A, B, E = np.split(_jacobian(model, _STEP), model.parts[:2], axis=1)
    x_trim, u_trim, _, _ = np.split(model.z0, model.parts)
    return LinearModel(A=A, B=B, E=E, x_trim=x_trim, u_trim=u_trim)


class _MovingModel(ReducedModel):
    """With all four inputs, and the mass centre's acceleration (3,) behind the nine derivatives."""

    inputs = slice(ACTUATOR.size)

    def __call__(self, z: NDArray[np.float64]) -> NDArray[np.float64]:
        slopes = super().__call__(z)
        nine = z[: len(NINE)]
        R_nb = quat_to_R_nb(quat_from_euler(nine[NINE.phi], nine[NINE.theta], nine[NINE.psi]))
        turning = np.cross(nine[[NINE.p, NINE.q, NINE.r]], R_nb.T @ self.velocity_ned)
        to_heading = quat_to_R_nb(quat_from_euler(0.0, 0.0, self.z0[NINE.psi])).T
        acceleration = to_heading @ R_nb @ (self.out[PLANT.vel] + turning)
        return np.insert(slopes, len(NINE), acceleration)


@dataclass(frozen=True)
class MovingModel:
    """The nine derivatives, then the acceleration of the mass centre about trim: A x + B u + E w.

    x and w as of `LinearModel`, u = d_lat, d_lon, d_ped, d_col. The acceleration is forward, right,
    down, m/s2. What moves through the air meets w less its own velocity.

    Attributes
    ----------
    A : (12, 9) array
    B : (12, 4) array
    E : (12, 3) array
    """

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    E: NDArray[np.float64]


def linearize_moving(params: HelicopterParameters, trim: Trim) -> MovingModel:
    """`linearize` with the collective and with what becomes of the velocity."""
    model = _MovingModel(smooth_kernel(params, trim, "descent"), trim)
    return MovingModel(*np.split(_jacobian(model, _STEP), model.parts[:2], axis=1))
