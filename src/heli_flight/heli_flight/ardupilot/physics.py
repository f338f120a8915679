# SPDX-License-Identifier: Apache-2.0
"""The plant of the one-process loop as physics for somebody else's controllers, in steps of their
length: `advance` and `measure` in one compiled call.

Ticks may be any whole part of 10 ms (`Rate.at_least`). What counts 10 ms stays in 10 ms: delay of
the commands, periods and latencies of the sensors, and the record. What is drawn per tick, noise
and turbulence, is another path of the same statistics at another rate.
"""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.jit import copy, direct, njit
from heli_core.rows import AIR, MEAS, PLANT
from heli_core.ticks import Rate
from heli_dynamics_sim import plant
from heli_dynamics_sim.airframe import attitude_of, to_body, to_ned, velocity_of
from heli_dynamics_sim.helicopter import airspeed, specific_force
from heli_dynamics_sim.noise import NoiseStreams
from heli_flight.ardupilot.protocol import REPLY
from heli_flight.ardupilot.servos import ServoNumbers, deflections
from heli_flight.settings import Settings

_DRAWN = 256


class StepRow(NamedTuple):
    """What was at a tick at which a command came (37,)."""

    plant: slice = slice(0, 24)  # rigid body, rotor, servos: the first places of a PlantRow
    wind: slice = slice(24, 27)  # at the fuselage, NED, m/s
    imu: slice = slice(27, 33)  # as measured, an ImuRow
    u: slice = slice(33, 37)  # commanded, an ActuatorRow
    size: int = 37


STEP = StepRow()


@njit
def _tell(state, k, y, measured, home, out):
    """Fill a `ReplyRow` of what is now; of an aircraft that is lost, that it lies there."""
    x, wind = state.x, state.air[AIR.fuselage]
    quat, pos = out[REPLY.quat], out[REPLY.pos]
    copy(quat, x[PLANT.quat])
    for i in range(3):
        pos[i] = x[PLANT.pos.start + i] - home[i]
    gyro, force, vel = out[REPLY.gyro], out[REPLY.force], out[REPLY.vel]
    if state.flags[0] != 0:
        fx, fy, fz = to_body(attitude_of(x), 0.0, 0.0, -k.aircraft.body.gravity)
        for i in range(3):
            gyro[i], vel[i] = 0.0, 0.0
        force[0], force[1], force[2] = fx, fy, fz
        out[REPLY.airspeed] = 0.0
        return
    u, v, w = velocity_of(x)
    vel[0], vel[1], vel[2] = to_ned(attitude_of(x), u, v, w)
    out[REPLY.airspeed] = max(airspeed(x, wind)[0], 0.0)
    if not measured:
        copy(gyro, x[PLANT.rate])
        specific_force(x, state.air, k.aircraft, force)
        return
    for i in range(3):  # a sample that is lost leaves the last one
        if math.isfinite(y[MEAS.rate.start + i]):
            gyro[i] = y[MEAS.rate.start + i]
        if math.isfinite(y[MEAS.force.start + i]):
            force[i] = y[MEAS.force.start + i]


@njit
def begin(state, noise_row, k, y, measured, home, out):
    """Measure at tick 0."""
    plant.measure(state, 0, noise_row, k, y)
    _tell(state, k, y, measured, home, out)


@njit
def step(state, tick, noise_row, k, pulse_us, servos, driven, stand, measured, home, y, row, out):
    """From tick to tick + 1 with the pulses (4,) of swashplate and tail.

    Parameters
    ----------
    state : PlantState
        Measured at `tick`; in place.
    tick : int
    noise_row : (NOISE.size,) array
        Of the next tick.
    k : PlantParams
    pulse_us : (4,) array
    servos : ServoNumbers
    driven : bool
        Whether the pulses are followed, else the command `stand` (4,).
    stand : (4,) array
    measured : bool
        Whether rates and specific force are told as the IMU measures them, else as they are.
    home : (3,) array
        Where it started, NED, m.
    y : (31,) array
        Measurement row, in place.
    row : (37,) array
        Filled with what was at `tick`, places of `STEP`.
    out : (17,) array
        Filled with what is to be told then, places of `REPLY`.

    Returns
    -------
    int
        PlantStatus.
    """
    u = row[STEP.u]
    if driven:
        deflections(pulse_us, servos, u)
    else:
        copy(u, stand)
    copy(row[STEP.plant], state.x)
    copy(row[STEP.wind], y[MEAS.wind])
    copy(row[STEP.imu], y[MEAS.imu])
    if state.flags[0] == 0:
        plant.advance(state, u, k)
        plant.measure(state, tick + 1, noise_row, k, y)
    _tell(state, k, y, measured, home, out)
    return state.flags[0]


class Physics:
    """One flight of the plant, step by step.

    Parameters
    ----------
    settings : Settings
        Its parameters of the plant, its seed.
    rate : Rate
        Of the steps.
    servos : ServoNumbers
    measured : bool
        Whether rates and specific force are told as the IMU measures them.

    Raises
    ------
    PlantConfigError, AircraftError, TrimError
        The parameters describe no flight.

    Attributes
    ----------
    tick : int
        Steps made.
    row : (37,) array
        What was when the last step began, places of `STEP`.
    told : (17,) array
        What is now, places of `REPLY`.
    y : (31,) array
        What the sensors say now, places of `MEAS`.
    status : PlantStatus
    home_ned_m : (3,) array
        Where it started.
    stand : (4,) array
        Command that it begins with: of the aircraft that stands, or hovers.
    """

    def __init__(
        self, settings: Settings, rate: Rate, servos: ServoNumbers, measured: bool = False
    ) -> None:
        config = plant.PlantConfig.from_parameters(settings.nodes["plant"], rate)
        self.rate, self.tick, self.status = rate, 0, plant.PlantStatus.OK
        self.row, self.told = np.zeros(STEP.size), np.zeros(REPLY.size)
        self._k, self._servos, self._measured = config.params, servos, measured
        self._state = plant.initial_state(config, settings.seed)
        self._streams = NoiseStreams(settings.seed)
        self._rows, self._used = self._streams.rows(_DRAWN), 1
        self.home_ned_m = self._state.x[PLANT.pos].copy()
        self.stand, self.y = self._state.pilot[1:].copy(), np.zeros(MEAS.size)
        if measured:
            self.told[REPLY.force.stop - 1] = -config.helicopter.gravity_mps2
        begin(self._state, self._rows[0], self._k, self.y, measured, self.home_ned_m, self.told)
        self._step: Callable[..., int] = direct(step, *self._arguments(np.zeros(4), True))

    def _arguments(self, pulse_us: NDArray[np.float64], driven: bool) -> tuple[Any, ...]:
        return (
            self._state, self.tick, self._rows[self._used], self._k, pulse_us, self._servos, driven,
            self.stand, self._measured, self.home_ned_m, self.y, self.row, self.told,
        )  # fmt: skip

    def step(self, pulse_us: NDArray[np.float64], driven: bool) -> None:
        """Make a step with pulses (4,), us; where not `driven`, with the stand's command."""
        if self._used == _DRAWN:
            self._rows, self._used = self._streams.rows(_DRAWN), 0
        status = self._step(*self._arguments(pulse_us, driven))
        self.tick, self._used = self.tick + 1, self._used + 1
        if status:
            self.status = plant.PlantStatus(status)
