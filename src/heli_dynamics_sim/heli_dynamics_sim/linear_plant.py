# SPDX-License-Identifier: Apache-2.0
"""A published linear helicopter as a plant: kernels, trim, and the object that flies.

Flown is the quasi-nonlinear form of the linear model, the one-point case of the stitched model of
Tobias and Tischler (A Model Stitching Architecture for Continuous Full Flight-Envelope Simulation,
US Army RDMR-AF-16-01, 2016; Tischler and Remple, Aircraft and Rotorcraft System Identification, 2nd
ed., AIAA 2012): forces and moments are linear in the departures from trim; kinematics, gravity and
Coriolis terms are those of a rigid body:

    z  = (v_a, omega, a_s, b_s, d_int) - trim,     v_a = v_b - R_nb' w_ned
    v' = f_trim + A_v z + B_v du + R_nb' g - omega x v
    omega' = A_omega z + B_omega du,     rotor' = A_r z + B_r du

So A's columns of u, v, w are those of the air speed, and E, the effect of the air's velocity, is
their negative. Body axes FRD, SI units, rad. Sensors, wind, faults and delay line are those of the
simulated helicopter. There is no ground to stand on, and no term of `terms.*`: the air over the
fuselage is what the whole aircraft feels, and rotating gusts do nothing.
"""

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.errors import ParameterCause, PlantConfigError
from heli_core.jit import by_reference, copy, direct, fill, njit, scratch
from heli_core.rotations import quat_to_R_nb
from heli_core.rows import ACTUATOR_NAMES, AIR, MEAS, PLANT, TRUTH
from heli_core.ticks import Rate
from heli_dynamics_sim.aircraft import PREFIX, SCALED, HelicopterParameters
from heli_dynamics_sim.airframe import (
    BodyParams,
    add_lever_acceleration,
    make_state,
    rates_of,
    rigid_body_rates,
)
from heli_dynamics_sim.config import PlantConfig, PlantParams, sensor_params, wind_params
from heli_dynamics_sim.faults import PAST_S, initial_faults, spoil_sensors
from heli_dynamics_sim.helicopter import WORK_ROWS, airspeed, same_air
from heli_dynamics_sim.linear_aircraft import LINEAR, PARAMETER, STATES, LinearAircraft
from heli_dynamics_sim.noise import NOISE, NoiseStreams
from heli_dynamics_sim.plant import (
    PlantState,
    PlantStatus,
    command_in_force,
    initial_state,
    judge,
    meet_air,
)
from heli_dynamics_sim.sensors import (
    read_baro,
    read_gps,
    read_mag,
    read_plain,
    spoil_imu,
    spoil_imu2,
)
from heli_dynamics_sim.servo import Imperfections, ServoParams, apply_stops, servo_derivatives
from heli_dynamics_sim.trim import TrimError

Array = NDArray[np.float64]

CARRIER = "helion.yaml"
"""What is not published (landing gear, places of the parts in the air) is this aircraft's."""
_N, _M = len(STATES), len(ACTUATOR_NAMES)

# -------------------------------------------------------------------------------------------------
# Kernels.
# -------------------------------------------------------------------------------------------------

_WIND, _N_AIR = AIR.fuselage, AIR.size
_STAGES = WORK_ROWS - 1


@by_reference
class LinearParams(NamedTuple):
    """What the kernels read."""

    A: np.ndarray  # (9, 9)
    B: np.ndarray  # (9, 4)
    force: np.ndarray  # (3,) specific force of the trim
    rotor: np.ndarray  # (3,) a_s, b_s, d_int of the trim
    u: np.ndarray  # (4,) of the trim
    gravity: float
    lags: bool  # whether there are separate servos
    servo: ServoParams


def linear_params(aircraft: LinearAircraft) -> LinearParams:
    """The values as the kernels take them."""
    omega, zeta, rate = aircraft.servo or (1.0, 1.0, 1.0)
    servo = ServoParams(
        omega**2, 2.0 * zeta * omega, rate, 1.0,
        Imperfections(False, 0.0, 0.0, 0.0, 0.0, False, 1.0),
    )  # fmt: skip
    return LinearParams(
        np.ascontiguousarray(aircraft.A),
        np.ascontiguousarray(aircraft.B),
        aircraft.force_trim,
        aircraft.rotor.copy(),
        aircraft.u_trim.copy(),
        aircraft.gravity_mps2,
        aircraft.servo is not None,
        servo,
    )


@njit
def _slopes(x, air, k, out):
    """A z + B du (9,) for a plant state (42,) in the air (12,)."""
    z = scratch(_N)
    vel, rate, rotor = z[LINEAR.vel], z[LINEAR.rate], z[LINEAR.rotor]
    vel[0], vel[1], vel[2] = airspeed(x, air[_WIND])
    for i in range(3):
        rate[i] = x[PLANT.rate.start + i]
        rotor[i] = x[PLANT.rotor.start + i] - k.rotor[i]
    for i in range(_N):
        total = 0.0
        for j in range(_N):
            total += k.A[i, j] * z[j]
        for j in range(_M):
            total += k.B[i, j] * (x[PLANT.servo.start + j] - k.u[j])
        out[i] = total


@njit
def linear_force(x, air, k, out):
    """Specific force (3,), body, m/s2: what ideal accelerometers at the c.g. read."""
    slopes = scratch(_N)
    _slopes(x, air, k, slopes)
    for i in range(3):
        out[i] = k.force[i] + slopes[i]


@njit
def linear_derivative(x, u, air, k, out):
    """State derivative (42,) for state x (42,), servo commands u (4,) and air (12,)."""
    slopes = scratch(_N)
    _slopes(x, air, k, slopes)
    fill(out, 0.0)
    force = k.force[0] + slopes[0], k.force[1] + slopes[1], k.force[2] + slopes[2]
    turning = slopes[LINEAR.p], slopes[LINEAR.q], slopes[LINEAR.r]
    # Of a unit mass and a unit inertia: these are accelerations.
    rigid_body_rates(x, force, turning, BodyParams(1.0, 1.0, 1.0, 1.0, k.gravity), out)
    flapping, rotor = out[PLANT.rotor], slopes[LINEAR.rotor]
    for i in range(3):
        flapping[i] = rotor[i]
    if k.lags:
        servo_derivatives(x, u, k.servo, out)


@njit
def linear_step(x, u, air, k, dt_s, work):
    """Advance x (42,) by dt_s with command u (4,) and air (12,) held; Runge-Kutta of order 4."""
    if not k.lags:
        for i in range(_M):
            x[PLANT.servo.start + i] = min(max(u[i], -1.0), 1.0)
    n, stage = x.shape[0], work[_STAGES]
    copy(stage, x)
    for j in range(_STAGES):
        linear_derivative(stage, u, air, k, work[j])
        ahead_s = 0.5 * dt_s if j < _STAGES - 2 else dt_s
        for i in range(n):
            stage[i] = x[i] + ahead_s * work[j, i]
    norm = 0.0
    for i in range(n):
        middle = work[1, i] + work[2, i]
        x[i] += dt_s / 6.0 * (work[0, i] + 2.0 * middle + work[_STAGES - 1, i])
    for i in range(PLANT.quat.start, PLANT.quat.stop):
        norm += x[i] * x[i]
    for i in range(PLANT.quat.start, PLANT.quat.stop):
        x[i] /= math.sqrt(norm)
    if k.lags:
        apply_stops(x, k.servo)


@njit
def _measure(state, tick, noise_row, k, linear, y):
    """As `plant.measure`."""
    meet_air(state, tick, noise_row, k)
    x, sensors, aircraft, air = state.x, state.sensors, k.aircraft, scratch(_N_AIR)
    for i in range(AIR.size):
        air[i] = 0.5 * (state.air_before[i] + state.air[i])
    omega = aircraft.main.speed
    linear_force(x, air, linear, y[MEAS.force])
    arm = k.sensors.imu.arm
    if arm.on:
        slopes = scratch(_N)
        _slopes(x, air, linear, slopes)
        turning = slopes[LINEAR.p], slopes[LINEAR.q], slopes[LINEAR.r]
        add_lever_acceleration(rates_of(x), turning, arm, y[MEAS.force])
    if k.sensors.imu2:
        copy(y[MEAS.force2], y[MEAS.force])
        spoil_imu2(sensors, tick, x, omega, noise_row, k.sensors, y)
    else:
        fill(y[MEAS.imu2], 0.0)
    spoil_imu(sensors, tick, x, omega, noise_row, k.sensors.imu, y)
    read_mag(sensors, tick, x, air, noise_row, aircraft, k.sensors.mag, y)
    read_baro(sensors, tick, x, air, noise_row, aircraft, k.sensors.baro, y)
    read_gps(sensors, tick, x, noise_row, k.sensors.gps, y)
    read_plain(tick, x, air, noise_row, aircraft, k.sensors.plain, y)
    spoil_sensors(state.faults, tick, noise_row, k.faults, y)
    wind, around = y[MEAS.wind], state.air[_WIND]
    for i in range(3):
        wind[i] = around[i]


@njit
def _advance(state, u_cmd, k, linear):
    """As `plant.advance`."""
    if state.flags[0] != 0:
        return
    u = scratch(_M)
    command_in_force(state, u_cmd, k, u)
    for _ in range(k.substeps):
        linear_step(state.x, u, state.air, linear, k.step_s, state.work)
        if state.flags[0] == 0:
            state.flags[0] = judge(state.x, k)


# -------------------------------------------------------------------------------------------------
# Trim.
# -------------------------------------------------------------------------------------------------

_TRIM_TOL, _TRIM_STEPS = 1e-9, 50


class TrimRow(NamedTuple):
    """What a trim is sought over (9,)."""

    attitude: slice = slice(0, 2)  # phi, theta, rad
    rotor: slice = slice(2, 5)  # a RotorRow
    u: slice = slice(5, 9)  # an ActuatorRow
    size: int = 9


TRIM = TrimRow()


def linear_trim(aircraft: LinearAircraft, wind_ned_mps: Any, psi: float) -> tuple[Array, Array]:
    """Plant state (42,) at the origin and commands (4,) of the hover in steady wind.

    Raises
    ------
    TrimError
        No deflection within the actuators' range holds it.
    """
    k, air, free = linear_params(aircraft), same_air(wind_ned_mps), _free(aircraft)

    def state(z: Array) -> Array:
        phi, theta = z[TRIM.attitude]
        x = make_state((0.0, 0.0, 0.0), float(phi), float(theta), psi)
        x[PLANT.rotor], x[PLANT.servo] = z[TRIM.rotor], z[TRIM.u]
        return x

    def residual(z: Array) -> Array:
        x, out = state(z), np.empty(PLANT.size)
        linear_derivative(x, x[PLANT.servo].copy(), air, k, out)
        return np.concatenate([out[PLANT.vel], out[PLANT.rate], out[PLANT.rotor]])

    z = np.concatenate([[aircraft.phi, aircraft.theta], aircraft.rotor, aircraft.u_trim])
    for _ in range(_TRIM_STEPS):
        now = residual(z)
        if np.abs(now).max() < _TRIM_TOL:
            break
        step = 1e-6 * np.eye(len(z))[free]
        slopes = np.column_stack([(residual(z + d) - residual(z - d)) / 2e-6 for d in step])
        z[free] -= np.linalg.lstsq(slopes, now, rcond=None)[0]
    u = z[TRIM.u].copy()
    if np.abs(residual(z)).max() > 1e3 * _TRIM_TOL or np.abs(u).max() >= 1.0:
        raise TrimError(
            f"{aircraft.name}: no deflection within -1 to 1 holds it in a wind of "
            f"{np.linalg.norm(wind_ned_mps):.3g} m/s"
        )
    return state(z), u


def _free(aircraft: LinearAircraft) -> list[int]:
    """Places, of a TrimRow, that a trim may move."""
    fixed = [i for i in range(_N)[LINEAR.rotor] if STATES[i] not in aircraft.states]
    rotor = range(TRIM.size)[TRIM.rotor]
    held = {rotor[i - LINEAR.a_s] for i in fixed}
    return [i for i in range(TRIM.size) if i not in held]


# -------------------------------------------------------------------------------------------------
# The plant.
# -------------------------------------------------------------------------------------------------

_DRAWN = 256


class LinearPlant:
    """A linear aircraft in place of the simulated one: `heli.fly(plant=LinearPlant(name))`.

    Wind, sensors, faults, `scale.*`, `delay_ticks` and the start are those of the node `plant`; the
    aircraft's own delay comes on top. The same seed has the same air and the same noise as the
    simulated helicopter's.

    Parameters
    ----------
    aircraft : LinearAircraft, str or path
        A packaged name (`linear_models()`), or a file.

    Raises
    ------
    AircraftError

    Attributes
    ----------
    status : PlantStatus
        Why the flight is over, if it is.
    """

    def __init__(self, aircraft: LinearAircraft | str | Path) -> None:
        if not isinstance(aircraft, LinearAircraft):
            aircraft = LinearAircraft.from_yaml(aircraft)
        self.aircraft: LinearAircraft = aircraft
        self._rows, self._used = np.zeros((0, NOISE.size)), 0

    @classmethod
    def of_parameters(cls, values: Mapping[str, Any]) -> "LinearPlant | None":
        """That which the node's parameters name, None for none.

        Raises
        ------
        AircraftError, PlantConfigError
        """
        if not values[PARAMETER]:
            return None
        if values["start.on_ground"]:
            raise PlantConfigError(
                f"not allowed with {PARAMETER}: a linear aircraft has no ground to stand on",
                ParameterCause.CONFLICT, key="start.on_ground",
            )  # fmt: skip
        return cls(values[PARAMETER])

    @property
    def status(self) -> PlantStatus:
        """OK while it flies."""
        return PlantStatus(int(self._state.flags[0]))

    @property
    def state(self) -> Array:
        """The state (42,), places of `rows.PLANT`; in place."""
        return np.asarray(self._state.x)

    def reset(self, rng: np.random.Generator, tick_s: float, nodes: Mapping[str, Any]) -> None:
        """Begin a flight; raises PlantConfigError, TrimError."""
        self._k, self._linear, self._state = flight_of(self.aircraft, nodes["plant"])
        self._streams = NoiseStreams(int(nodes["plant"]["seed"]))
        self._rows, self._used = self._streams.rows(_DRAWN), 0
        k, state, y = self._k, self._state, np.zeros(MEAS.size)
        self._read = direct(_measure, state, 0, self._rows[0], k, self._linear, y)
        self._fly = direct(_advance, state, np.zeros(_M), k, self._linear)

    def measure(self, tick: int, y: Array, truth: Array) -> None:
        """Fill measurement row y (31,) and truth (19,)."""
        if self._used == _DRAWN:
            self._rows, self._used = self._streams.rows(_DRAWN), 0
        row, self._used = self._rows[self._used], self._used + 1
        self._read(self._state, tick, row, self._k, self._linear, y)
        x = self._state.x
        truth[TRUTH.pos], truth[TRUTH.quat] = x[PLANT.pos], x[PLANT.quat]
        truth[TRUTH.vel] = quat_to_R_nb(x[PLANT.quat]) @ x[PLANT.vel]
        truth[TRUTH.rate], truth[TRUTH.rotor] = x[PLANT.rate], x[PLANT.rotor]
        truth[TRUTH.wind] = y[MEAS.wind]

    def step(self, tick: int, u: Array) -> None:
        """Go on to the next tick with the actuators u (4,)."""
        self._fly(self._state, u, self._k, self._linear)


def flight_of(
    aircraft: LinearAircraft, values: Mapping[str, Any]
) -> tuple[PlantParams, LinearParams, PlantState]:
    """Numbers and fresh state of a flight, by the parameters of the node `plant`.

    Raises
    ------
    PlantConfigError, TrimError
    """
    rate = Rate.of_parameters(values)
    flown = aircraft.scaled(values)
    plain = {key: False for key in values if key.startswith("terms.")}
    unscaled = {PREFIX + name: 1.0 for name in SCALED}
    # A linear model knows neither its wash nor its power.
    no_power = {"sensors.baro.wash_coefficient": 0.0, "sensors.mag.power_field_t_per_w": [0.0] * 3}
    own = {**values, **plain, **unscaled, **no_power, PARAMETER: "", "aircraft_file": CARRIER}
    config = PlantConfig.from_parameters(own)
    sized: HelicopterParameters = replace(
        config.helicopter,
        main_radius_m=aircraft.rotor_radius_m,
        main_speed_radps=aircraft.rotor_speed_radps,
        main_blades=aircraft.rotor_blades,
    )
    config = replace(
        config,
        wind=wind_params(own, sized),
        sensors=sensor_params(own, sized, rate),
        delay_ticks=config.delay_ticks + rate.ticks_in(aircraft.delay_s),
        trimmed_in_wind=False,
    )
    state = initial_state(config, int(values["seed"]))
    wind = state.air[_WIND] if values["initial.trim"] == "mean_wind" else np.zeros(3)
    x, u = linear_trim(flown, wind, config.psi)
    x[PLANT.pos] = config.pos_ned_m
    state.x[:] = x
    state.commands[:] = u
    state.pilot[1:] = u
    faults = initial_faults(u, rate.ticks_in(PAST_S) + 1)
    k = config.params
    k = k._replace(aircraft=k.aircraft._replace(main=k.aircraft.main._replace(
        speed=aircraft.rotor_speed_radps)))  # fmt: skip
    return k, linear_params(flown), state._replace(faults=faults)
