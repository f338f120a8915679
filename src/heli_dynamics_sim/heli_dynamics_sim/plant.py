# SPDX-License-Identifier: Apache-2.0
"""The plant by ticks: what the node and the one-process loop share.

At tick n: `measure` brings the wind to n and reads the sensors, the controllers act, `advance`
carries the aircraft to n + 1 with the command of n - delay_ticks. Wind and command are held during
a tick; at the step from one tick's wind to the next sensors read what is between the two, so that
the mean of two samples is the mean over the tick. `measure` is called once per tick, in order, and
does not depend on the command of its tick.
"""

import math
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from heli_core.errors import PlantConfigError
from heli_core.jit import by_reference, copy, njit, scratch
from heli_core.rows import ACTUATOR, AIR, MEAS, PLANT
from heli_dynamics_sim.airframe import attitude_of
from heli_dynamics_sim.config import PlantConfig, PlantParams
from heli_dynamics_sim.faults import (
    PAST_S,
    FaultState,
    add_gusts,
    initial_faults,
    spoil_command,
    spoil_sensors,
)
from heli_dynamics_sim.ground import ground_contact
from heli_dynamics_sim.helicopter import WORK_ROWS, rk4_step, same_air
from heli_dynamics_sim.noise import NoiseStreams
from heli_dynamics_sim.sensors import ONCE, SensorState, fix_slots, initial_sensors, read_sensors
from heli_dynamics_sim.trim import GroundTrim, TrimPoint, ground_trim, trim
from heli_dynamics_sim.wind import (
    FILTER,
    AirState,
    air_at,
    initial_air,
    run_in_ticks,
    step_air,
    wind_at,
)

__all__ = [
    "PlantConfig",
    "PlantConfigError",
    "PlantParams",
    "PlantState",
    "PlantStatus",
    "advance",
    "command_in_force",
    "initial_state",
    "judge",
    "measure",
    "meet_air",
    "read",
    "status",
]


class PlantStatus(IntEnum):
    """Whether the flight goes on, and if not, why."""

    OK = 0
    HIT_GROUND = 1
    ROLLED_OVER = 2
    FLEW_AWAY = 3
    NOT_FINITE = 4

    @property
    def sentence(self) -> str:
        """The status for people."""
        return _SENTENCES[self]


_SENTENCES = {
    PlantStatus.OK: "The aircraft flies or stands on its skids.",
    PlantStatus.HIT_GROUND: "The aircraft hit the ground: too fast, or with its tail or rotor.",
    PlantStatus.ROLLED_OVER: "The aircraft rolled over: its tilt exceeded the limit.",
    PlantStatus.FLEW_AWAY: "The aircraft flew away: it left the allowed distance from its start.",
    PlantStatus.NOT_FINITE: "The aircraft's state is not finite: a command or parameter broke it.",
}
_N_ACTUATOR, _N_AIR = ACTUATOR.size, AIR.size
_GAINS = ONCE.gains.stop - ONCE.gains.start
_OK, _HIT_GROUND, _ROLLED_OVER, _FLEW_AWAY, _NOT_FINITE = (int(s) for s in PlantStatus)


@by_reference
class PlantState(NamedTuple):
    """State of the plant; the arrays are changed in place."""

    x: np.ndarray  # (42,) aircraft, places of `rows.PLANT`
    turbulence: AirState  # and the random gusts of the flight
    air: np.ndarray  # (12,) what the air does at the aircraft, places of `rows.AIR`
    air_before: np.ndarray  # (12,) the same during the tick before
    sensors: SensorState
    commands: np.ndarray  # (delay_ticks, 4) commands under way, oldest first
    work: np.ndarray  # (5, 42) scratch
    flags: np.ndarray  # (1,) int64, first PlantStatus that was not OK
    pilot: np.ndarray  # (5,) ticks until a pilot hands over, and the trim that is held until then
    spool: np.ndarray  # (1,) ticks until the rotor has its speed
    faults: FaultState


def initial_state(config: PlantConfig, seed: int) -> PlantState:
    """State before tick 0: in trim at the start, in the air or on the skids, in the mean wind or as
    in still air.

    Parameters
    ----------
    config : PlantConfig
    seed : int
        Draws turbulence, biases, drifts and the fixes under way from their stationary
        distributions, with streams of their own.

    Returns
    -------
    PlantState

    Raises
    ------
    TrimError
        If the aircraft cannot hover, or stand, in that wind.
    """
    k = config.params
    slots = fix_slots(k.sensors.gps)
    altitude_m = -float(config.pos_ned_m[2])
    streams = NoiseStreams(seed)
    rows = streams.initial_rows(slots + run_in_ticks(k.wind, altitude_m, k.tick_s))
    calm = k.wind._replace(
        turbulence=False,
        gust_amplitude_mps=0.0 * k.wind.gust_amplitude_mps,
        sines=k.wind.sines._replace(on=False),
    )
    at_start = np.zeros(PLANT.size)
    at_start[PLANT.pos] = config.pos_ned_m
    mean_wind = np.zeros(3)
    wind_at(np.zeros(FILTER.size), at_start, 0.0, calm, mean_wind)
    start = _at_start(config, mean_wind if config.trimmed_in_wind else np.zeros(3))
    x = start.x.copy()
    wind_rows = np.concatenate([rows[:1], rows[slots:]])
    sensors = initial_sensors(
        k.sensors, rows[:slots], streams.once(ONCE.size), streams.once_imu2(_GAINS), x
    )
    return PlantState(
        x,
        initial_air(k.wind, altitude_m, wind_rows, seed, k.tick_s),
        same_air(mean_wind),
        np.zeros(AIR.size),
        sensors,
        np.tile(start.u, (k.delay_ticks, 1)).reshape(k.delay_ticks, ACTUATOR.size),
        np.zeros((WORK_ROWS, PLANT.size)),
        np.zeros(1, dtype=np.int64),
        np.append(float(k.pilot_ticks), start.u),
        np.array([float(k.spool_ticks)]),
        initial_faults(start.u, config.rate.ticks_in(PAST_S) + 1),
    )


def _at_start(config: PlantConfig, wind: np.ndarray) -> TrimPoint:
    """The equilibrium in which the flight begins, at its place."""
    place, psi = config.pos_ned_m, config.psi
    if config.on_ground:
        stand = GroundTrim(place, psi, wind, config.idle_collective, config.spool_ticks == 0)
        return ground_trim(config.helicopter, config.params.aircraft, stand)
    hover = trim(config.helicopter, wind, psi)
    hover.x[PLANT.pos] = place
    return hover


@njit
def _aircraft_now(state, k):
    """The HelicopterParams of this tick: on the ground the rotor may still be spooling up."""
    if state.spool[0] > 0.0:
        return k.spooling
    return k.aircraft


@njit
def _begin_to_move(share, air):
    """Air (12,) that is a share (0 to 1) into its onset: the first half of a 1-cosine gust."""
    moving = 0.5 * (1.0 - math.cos(math.pi * share))
    for i in range(air.shape[0]):
        air[i] *= moving


@njit
def meet_air(state, tick, noise_row, k):
    """Bring the wind to a tick, into `state.air`; arguments as of `measure`."""
    copy(state.air_before, state.air)
    if tick > 0 and k.wind.turbulence:
        altitude_m = -state.x[PLANT.down]
        step_air(state.turbulence, altitude_m, k.tick_s, noise_row, k.wind)
    if 0 <= k.fail_tick <= tick or k.faults.engine_out <= tick:
        state.x[PLANT.engine_out] = 1.0
    air_at(state.turbulence, state.x, tick * k.tick_s, k.wind, state.air)
    if tick * k.tick_s < k.onset_s:
        _begin_to_move(tick * k.tick_s / k.onset_s, state.air)
    add_gusts(tick, k.faults, state.air)
    if tick == 0:
        copy(state.air_before, state.air)


@njit
def read(state, tick, noise_row, k, y):
    """Read the sensors between the air of the tick before and `state.air`; arguments as of
    `measure`."""
    aircraft, air = _aircraft_now(state, k), scratch(_N_AIR)
    for i in range(AIR.size):
        air[i] = 0.5 * (state.air_before[i] + state.air[i])
    read_sensors(state.sensors, tick, state.x, air, noise_row, aircraft, k.sensors, y)
    spoil_sensors(state.faults, tick, noise_row, k.faults, y)
    wind, around = y[MEAS.wind], state.air[AIR.fuselage]
    for i in range(3):
        wind[i] = around[i]


@njit
def measure(state, tick, noise_row, k, y):
    """Bring the wind to a tick and read the sensors.

    Parameters
    ----------
    state : PlantState
        Changed in place.
    tick : int
        0, 1, 2, ... without gaps.
    noise_row : (NOISE.size,) array
        Standard normals of this tick, places of `noise.NOISE`.
    k : PlantParams
    y : (31,) array
        Filled; places of `rows.MEAS`. What does not arrive at this tick is 0, its valid flag too.
    """
    meet_air(state, tick, noise_row, k)
    read(state, tick, noise_row, k, y)


@njit
def judge(x, k):
    """PlantStatus (int) of a state."""
    for i in range(x.shape[0]):
        if not math.isfinite(x[i]):
            return _NOT_FINITE
    sinking, _, structure = ground_contact(x, k.aircraft.ground)
    if structure or sinking > k.aircraft.ground.hard_impact:
        return _HIT_GROUND
    _, qx, qy, _ = attitude_of(x)
    if 1.0 - 2.0 * (qx * qx + qy * qy) < k.limits.cos_tilt:
        return _ROLLED_OVER
    away, pos = 0.0, x[PLANT.pos]
    for i in range(3):
        away += (pos[i] - k.limits.start_ned_m[i]) ** 2
    if away > k.limits.distance_m**2:
        return _FLEW_AWAY
    return _OK


@njit
def command_in_force(state, u_cmd, k, u):
    """Put a tick's command (4,) into the delay line; what is flown now into u (4,).

    Arguments as of `advance`.
    """
    for i in range(ACTUATOR.size):
        u[i] = state.commands[0, i] if k.delay_ticks > 0 else u_cmd[i]
    for j in range(k.delay_ticks):
        for i in range(ACTUATOR.size):
            last = j == k.delay_ticks - 1
            state.commands[j, i] = u_cmd[i] if last else state.commands[j + 1, i]
    if state.pilot[0] > 0.0:
        state.pilot[0] -= 1.0
        for i in range(ACTUATOR.size):
            u[i] = state.pilot[1 + i]
    spoil_command(state.faults, k.faults, u)


@njit
def advance(state, u_cmd, k):
    """Carry the aircraft over one tick; the command enters the delay line.

    Parameters
    ----------
    state : PlantState
        Changed in place; a state that is not finite stays as it is.
    u_cmd : (4,) array
        Command of this tick; flown `delay_ticks` later, unless a pilot still holds the controls.
    k : PlantParams
    """
    if state.flags[0] == _NOT_FINITE:
        return
    u = scratch(_N_ACTUATOR)
    command_in_force(state, u_cmd, k, u)
    aircraft = _aircraft_now(state, k)
    for _ in range(k.substeps):
        rk4_step(state.x, u, state.air, aircraft, k.step_s, state.work)
        if state.flags[0] == _OK:
            state.flags[0] = judge(state.x, k)
    if state.spool[0] > 0.0:
        state.spool[0] -= 1.0
        if state.spool[0] == 0.0:
            state.x[PLANT.omega] = k.aircraft.engine.speed


@njit
def status(state, k):
    """First PlantStatus (int) that was not OK so far, else OK."""
    return state.flags[0]
