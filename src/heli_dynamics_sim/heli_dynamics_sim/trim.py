# SPDX-License-Identifier: Apache-2.0
"""Trim: hover over a point of the ground in steady wind, in equilibrium."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_core.rotations import euler_from_quat, quat_from_euler, quat_to_R_nb
from heli_core.rows import ACTUATOR, INPUT_NAMES, NINE, PLANT, STATE_NAMES, WIND_NAMES
from heli_dynamics_sim.aircraft import (
    CLIMB_POWER_OFF,
    CLIMB_POWER_ON,
    HelicopterParameters,
    HelicopterParams,
    states_of,
)
from heli_dynamics_sim.airframe import STEP_S, make_state
from heli_dynamics_sim.helicopter import WORK_ROWS, airspeed, derivative_kernel, rk4_step, same_air
from heli_dynamics_sim.main_rotor import bar_per_mps, blade_tilts, rotor_flow

if TYPE_CHECKING:
    import control


# -------------------------------------------------------------------------------------------------
# Trim.
# -------------------------------------------------------------------------------------------------

ALTITUDE_M = 1000.0
"""A height at which the ground is out of reach, of the skids and of the wake."""
_RESIDUAL_LIMIT = 1e-9
_MAX_NEWTON = 40
_TAIL_OFFSETS = tuple(sign * 0.01 * n for n in range(1, 21) for sign in (-1.0, 1.0))
"""How far from a start that fails the tail's setting (d_int) is tried, the nearest first."""

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


class NoStandError(TrimError):
    """The aircraft does not come to rest on its skids."""


@dataclass(frozen=True)
class TrimPoint:
    """An equilibrium.

    Attributes
    ----------
    x : (42,) array
        Plant state at the origin, places of `heli_core.rows.PLANT`, with rotor speed and states of
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
        self, k: HelicopterParams, wind: NDArray[np.float64], psi: float, altitude_m: float
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

    def solve(self, z: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Newton from z; where it stalls, from other tail settings, the nearest first.

        In its vortex ring state the tail has up to three settings of the same thrust: followed in
        the wind, the equilibrium ends at a fold, and the next one stands at another setting.
        """
        z, f = self.newton(z)
        for offset in _TAIL_OFFSETS:
            if np.abs(f).max() <= _RESIDUAL_LIMIT:
                break
            start = z.copy()
            start[_Z.d_int] += offset
            beyond, f_beyond = self.newton(start)
            if np.abs(f_beyond).max() <= _RESIDUAL_LIMIT:
                z, f = beyond, f_beyond
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
) -> TrimPoint:
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
    TrimPoint

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
    k = params.params
    z = _first_guess(params)
    steps = 1 + int(np.linalg.norm(wind) / 1.5)
    for i in range(steps + 1):
        problem = _Problem(k, wind * (i / steps), psi, altitude_m)
        z, f = problem.solve(z)
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
    return TrimPoint(x, u, float(np.abs(f).max()), wind)


def flap_back_in_hover(aircraft: HelicopterParameters) -> float:
    """Settled tilt of the disc per air speed across it in still-air hover, rad s/m: da_s/du.

    The constant of the aircraft's file, else what blades and stabiliser bar have together by the
    term `flap_back`.
    """
    if aircraft.flap_back_radpmps > 0.0:
        return aircraft.flap_back_radpmps
    k, x = aircraft.params, trim(aircraft).x
    _, v_i, w_r, pitch = rotor_flow(x, (0.0, 0.0, 0.0), k)
    blades, _ = blade_tilts(1.0, 0.0, pitch, v_i - w_r, k.main.tip_speed, k.flap_back.coning)
    return float(blades - bar_per_mps(v_i, w_r, k.main.speed, k.flap_back))


def _first_guess(params: HelicopterParameters) -> NDArray[np.float64]:
    """Collective and tail for hover without wind by momentum theory; all else zero."""
    k = params.params
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


# -------------------------------------------------------------------------------------------------
# Linearisation about a trim: the nine-state model of eq. (9) and (10).
#
# States phi theta p q a_s b_s r d_int psi, inputs d_lat d_lon d_ped (after the servos), wind in
# body
# axes u v w (velocity of the air, m/s, on top of the trim's wind), all as deviations from trim.
# The
# inertial velocity stays that of the trim.
#
# The power of climb makes a kink at w_a = 0, where hover without wind is: E(r, w) has a value for
# air
# that rises (descent, no climb power) and another for air that sinks. `side` chooses; the
# published E has that of the descent.
# -------------------------------------------------------------------------------------------------

_ALTITUDE_M = 1000.0  # out of the ground's reach
_AT_KINK_MPS = 1e-6
_STEP = 1e-5


@dataclass(frozen=True)
class LinearModel:
    """`x' = A x + B u + E w`, deviations from trim, SI units and rad.

    States, inputs and wind have the names and units of `heli_core.rows`.

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
        """As a system of python-control with named signals, see `heli_core.linear`."""
        from heli_core.linear import hover_system  # takes seconds to import

        return hover_system(self.A, self.B, self.E, "linearised")

    def __repr__(self) -> str:
        """As python-control prints the system, with the trim above it."""
        names = (*STATE_NAMES, *INPUT_NAMES)
        values = (*self.x_trim, *self.u_trim)
        trim = ", ".join(f"{n} {v:.5g}" for n, v in zip(names, values, strict=True))
        return f"x' = A x + B u + E w about trim: {trim}\n{self.system}"


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

    def __init__(self, kernel: HelicopterParams, trim: TrimPoint) -> None:
        self.params = kernel
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
        derivative_kernel(x, self.trim.u, same_air(wind), self.params, self.out)
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


def smooth_params(
    params: HelicopterParameters, trim: TrimPoint, side: Literal["descent", "climb"]
) -> HelicopterParams:
    """The aircraft's kernel, with one branch of P_climb where the trim sits on its kink."""
    kernel = params.params
    if abs(airspeed(trim.x, trim.wind_ned_mps)[2]) > _AT_KINK_MPS:
        return kernel
    return kernel._replace(climb_power=CLIMB_POWER_OFF if side == "descent" else CLIMB_POWER_ON)


def linearize(
    params: HelicopterParameters, trim: TrimPoint, side: Literal["descent", "climb"] = "descent"
) -> LinearModel:
    """Linearise about a trim.

    Parameters
    ----------
    params : HelicopterParameters
    trim : TrimPoint
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
    model = ReducedModel(smooth_params(params, trim, side), trim)
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


def linearize_moving(params: HelicopterParameters, trim: TrimPoint) -> MovingModel:
    """`linearize` with the collective and with what becomes of the velocity."""
    model = _MovingModel(smooth_params(params, trim, "descent"), trim)
    return MovingModel(*np.split(_jacobian(model, _STEP), model.parts[:2], axis=1))


# -------------------------------------------------------------------------------------------------
# The aircraft on its skids at the start: rotor turning at idle collective, or still to spool up.
#
# The equilibrium of weight, rotor, gear springs and friction is found by letting the aircraft
# settle
# from just above it: with the bristles' friction many states are at rest, and this is the one that
# an aircraft comes to that was put there. The c.g. is then moved along the ground to its place.
#
# While the rotor spools up its speed rises in proportion to time, whatever its torques: a soft
# start
# or a clutch does that, not the governor in flight. The fuselage feels the rotor's drag and the
# torque that accelerates it. Couplings of flapping, flap-back and dynamic inflow are left out
# until
# the rotor has its speed: they are numbers of full speed, which grow as it falls (`present`).
# -------------------------------------------------------------------------------------------------

_SETTLING_S = 10.0
_SPEED_LIMIT_MPS = 1e-4
_TURN_LIMIT_RADPS = 1e-3


@dataclass(frozen=True)
class GroundTrim:
    """Where and how the aircraft stands.

    Attributes
    ----------
    pos_ned_m : (3,) array
        Of the c.g.; down is not used, it follows from the gear.
    psi : float
        Heading, rad.
    wind_ned_mps : (3,) array
    idle_collective : float
    rotor_turns : bool
        At the governed speed, or not at all.
    """

    pos_ned_m: NDArray[np.float64]
    psi: float
    wind_ned_mps: NDArray[np.float64]
    idle_collective: float
    rotor_turns: bool


def spooling(k: HelicopterParams, acceleration_radps2: float) -> HelicopterParams:
    """The aircraft while its rotor's speed rises by `acceleration_radps2`, prescribed."""
    return k._replace(
        terms=k.terms._replace(rotor_speed=True, flap_back=False, inflow=False),
        engine=k.engine._replace(spool=acceleration_radps2),
        flapping=k.flapping._replace(a_bs=0.0, b_as=0.0, flap_back=0.0),
    )


def ground_trim(
    helicopter: HelicopterParameters, k: HelicopterParams, stand: GroundTrim
) -> TrimPoint:
    """State and command of the aircraft at rest on its skids.

    Parameters
    ----------
    helicopter : HelicopterParameters
        For the trim of hover in still air, whose cyclic and pedal are held.
    k : HelicopterParams
        The same aircraft, over the ground that it stands on.
    stand : GroundTrim

    Returns
    -------
    TrimPoint
        At its place; `residual` is the largest derivative of its velocity and rates, SI.

    Raises
    ------
    TrimError
        If it slides or tips over there.
    """
    hover = trim(helicopter, psi=stand.psi)
    u = hover.u.copy()
    u[ACTUATOR.col] = stand.idle_collective
    x = hover.x.copy()
    x[PLANT.servo] = u
    into = k.ground.plane[0]
    sag = k.body.mass * k.body.gravity / (4.0 * k.ground.stiffness)
    x[PLANT.pos] = stand.pos_ned_m
    x[PLANT.down] = _down(x, (sag - k.ground.points[0, 2]), k)
    x[PLANT.quat] = _flat_on(into, stand.psi)
    x = _settled(x, u, stand.wind_ned_mps, k)
    if not stand.rotor_turns:
        # States that rest while it spools up stay as full speed wants them.
        x[PLANT.rotor], x[PLANT.omega] = 0.0, 0.0
        k = spooling(k, 0.0)
        x = _settled(x, u, stand.wind_ned_mps, k)
    depth = float(into @ (x[PLANT.pos] - np.append(k.ground.origin, 0.0)))
    x[PLANT.pos] = stand.pos_ned_m
    x[PLANT.down] = _down(x, depth, k)
    rates = np.empty(PLANT.size)
    derivative_kernel(x, u, same_air(stand.wind_ned_mps), k, rates)
    moving = rates[PLANT.u : PLANT.w + 1].tolist() + rates[PLANT.rate].tolist()
    return TrimPoint(x, u, float(np.abs(moving).max()), stand.wind_ned_mps)


def _down(x: NDArray[np.float64], depth: float, k: HelicopterParams) -> float:
    """Down (m) of a c.g. over the north and east of x at a depth (m) in the ground."""
    into = k.ground.plane[0]
    along = into[:2] @ (x[PLANT.pos][:2] - k.ground.origin)
    return float((depth - along) / into[2])


def _flat_on(into: NDArray[np.float64], psi: float) -> NDArray[np.float64]:
    """Quaternion of an aircraft whose skids lie on the plane, with heading psi."""
    level = np.array([math.cos(psi), math.sin(psi)])
    nose = np.append(level, -(into[:2] @ level) / into[2])
    nose /= np.linalg.norm(nose)
    right = np.cross(into, nose)
    return quat_from_euler(math.atan2(right[2], into[2]), -math.asin(nose[2]), psi)


def _settled(
    x: NDArray[np.float64], u: NDArray[np.float64], wind: NDArray[np.float64], k: HelicopterParams
) -> NDArray[np.float64]:
    """The state after `_SETTLING_S` with the command held, with the tank as it was."""
    x, work, air = x.copy(), np.zeros((WORK_ROWS, PLANT.size)), same_air(wind)
    fuel = x[PLANT.fuel]
    for _ in range(round(_SETTLING_S / STEP_S)):
        rk4_step(x, u, air, k, STEP_S, work)
    x[PLANT.fuel] = fuel
    speed, turn = np.linalg.norm(x[PLANT.vel]), np.linalg.norm(x[PLANT.rate])
    if not (speed < _SPEED_LIMIT_MPS and turn < _TURN_LIMIT_RADPS):
        raise NoStandError(
            f"no stand on the ground in wind {np.round(wind, 3).tolist()} m/s (NED): after "
            f"{_SETTLING_S:g} s it moves at {speed:.2g} m/s and {turn:.2g} rad/s; slope, wind or "
            "ground.idle_collective are too much for the skids"
        )
    return x


# -------------------------------------------------------------------------------------------------
# Critical bank of an aircraft that pivots about one skid: static and dynamic rollover.
#
# Without lift the aircraft falls back until its mass centre stands over the skid: the static
# rollover
# angle, atan(half width / height). Lift and what moves the disc to the side turn it about the skid
# too, so that the angle at which no righting moment is left falls to nothing as the lift nears the
# weight (FAA-H-8083-21B, Helicopter Flying Handbook, 2019, ch. 11, "Dynamic Rollover").
# -------------------------------------------------------------------------------------------------


def critical_bank(
    aircraft: HelicopterParameters, lift_n: float, moment_nm: float = 0.0, side_n: float = 0.0
) -> float:
    """Bank at which nothing rights an aircraft at rest on its right skid.

    The moment about the skid, `M + h Y - b (W cos phi - T) + h W sin phi`, is zero there; b is half
    the width of the gear, h the height of the mass centre.

    Parameters
    ----------
    aircraft : HelicopterParameters
    lift_n : float
        T: force of the air against body z, N.
    moment_nm, side_n : float
        M and Y: its moment about body x through the mass centre, N m, and its force along body y,
        N.

    Returns
    -------
    float
        rad; negative: it tips at rest on level ground. NaN if it stands at no bank.
    """
    width, height = aircraft.gear_half_width_m, aircraft.gear_height_m
    weight = aircraft.mass_kg * aircraft.gravity_mps2
    arm = math.hypot(width, height)
    share = (moment_nm + height * side_n + width * lift_n) / (weight * arm)
    return math.acos(share) - math.atan2(height, width) if abs(share) <= 1.0 else math.nan
