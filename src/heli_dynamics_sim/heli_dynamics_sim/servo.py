# SPDX-License-Identifier: Apache-2.0
"""Servos: second order, with limited rate and end stops.

The derivative is that of a linear servo whose speed is cut at the rate limit; `apply_stops`, called
after every integration step, holds position and rate inside their limits.

What real servos add is off unless the aircraft's terms ask for it (`Imperfections`):

- resolution: the command is rounded to the steps of the pulse's length;
- dead band: the motor rests while the error is inside the band;
- load: a DC motor's speed falls linearly with its torque (Hughes and Drury, Electric Motors and
  Drives, ch. 3), here the propeller moment of the blades, `b I_f Omega^2 theta` towards flat pitch
  (Johnson, Helicopter Theory, 1980, ch. 9), at the governed speed. It loads the collective: the
  moments of a cyclic pitch cancel its inertia at 1/rev;
- swash: three servos at 120 deg carry the swash plate, and the first, behind or before the mast,
  may be slower than the others, so that every motion leaks into the others. The state keeps the
  channels lat, lon, col; the servos' positions are their mix.
"""

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.jit import by_reference, copy, njit, scratch
from heli_core.rows import ACTUATOR, PLANT
from heli_core.ticks import Rate

# -------------------------------------------------------------------------------------------------
# Servo.
# -------------------------------------------------------------------------------------------------

_SIN_120 = math.sqrt(0.75)


@by_reference
class Imperfections(NamedTuple):
    """What real servos add; a number of 0 and False leave it out."""

    present: bool  # whether there is any of them
    resolution: float  # step of the command
    half_band: float  # half of the dead band
    load_slope: float  # share of the stall torque against a collective servo, per unit of d_col
    load_offset: float  # the same at d_col = 0
    swash: bool  # three swash servos instead of one per channel
    slow: float  # speed of the first of them over that of the others


@by_reference
class ServoParams(NamedTuple):
    """One kind of servo for all four channels."""

    omega_sq: float  # square of the natural frequency, 1/s2
    two_zeta_omega: float  # 1/s
    rate_limit: float  # 1/s
    travel: float  # end stops at +- this
    real: Imperfections


@njit
def to_motors(lat, lon, col, swash):
    """Positions of the motors behind three channels: the three swash servos, or one each."""
    if not swash:
        return lat, lon, col
    side = _SIN_120 * lat
    return col + lon, col - 0.5 * lon + side, col - 0.5 * lon - side


@njit
def to_channels(first, second, third, swash):
    """Channels (lat, lon, col) of three motors: the inverse of `to_motors`."""
    if not swash:
        return first, second, third
    lat = (second - third) / (2.0 * _SIN_120)
    return lat, (2.0 * first - second - third) / 3.0, (first + second + third) / 3.0


@njit
def loads(col, real):
    """Torque against a positive speed of the three motors, over their stall torque, in [-1, 1]."""
    load = min(max(real.load_offset + real.load_slope * col, -1.0), 1.0)
    if real.swash:
        return load / 3.0, load / 3.0, load / 3.0
    return 0.0, 0.0, load


@njit
def servo_rates(position, rate, command, k):
    """(d position/dt, d rate/dt) of a servo that follows a command, in 1/s and 1/s2."""
    target = min(max(command, -k.travel), k.travel)
    speed = min(max(rate, -k.rate_limit), k.rate_limit)
    return speed, k.omega_sq * (target - position) - k.two_zeta_omega * rate


@njit
def limited(rate, load, pace, k):
    """A rate (1/s) inside the limits that the load leaves, see `real_servo_rates`."""
    limit = pace * k.rate_limit
    return min(max(rate, -limit * (1.0 + load)), limit * (1.0 - load))


@njit
def real_servo_rates(position, rate, target, load, pace, k):
    """The same of a servo with imperfections.

    Parameters
    ----------
    position, rate, target : float
        The target is inside the travel.
    load : float
        Torque against a positive speed, over the stall torque, in [-1, 1].
    pace : float
        Speed of this servo over that of its kind.
    k : ServoParams
    """
    real = k.real
    if real.resolution > 0.0:
        target = np.rint(target / real.resolution) * real.resolution
    error = target - position
    error = math.copysign(max(abs(error) - real.half_band, 0.0), error)
    return limited(
        rate, load, pace, k
    ), pace * pace * k.omega_sq * error - pace * k.two_zeta_omega * rate


@njit
def _real_derivatives(x, u, k, out):
    """Fill the servos' places of a plant derivative, with all imperfections."""
    at, rate = x[PLANT.servo], x[PLANT.servo_rate]
    speed, push = out[PLANT.servo], out[PLANT.servo_rate]
    swash, travel = k.real.swash, k.travel
    lat, lon = ACTUATOR.lat, ACTUATOR.lon
    ped, col = ACTUATOR.ped, ACTUATOR.col
    t_lat, t_lon = min(max(u[lat], -travel), travel), min(max(u[lon], -travel), travel)
    t_ped, t_col = min(max(u[ped], -travel), travel), min(max(u[col], -travel), travel)
    speed[ped], push[ped] = real_servo_rates(at[ped], rate[ped], t_ped, 0.0, 1.0, k)
    load0, load1, load2 = loads(at[col], k.real)
    at0, at1, at2 = to_motors(at[lat], at[lon], at[col], swash)
    rate0, rate1, rate2 = to_motors(rate[lat], rate[lon], rate[col], swash)
    t0, t1, t2 = to_motors(t_lat, t_lon, t_col, swash)
    speed0, push0 = real_servo_rates(at0, rate0, t0, load0, k.real.slow, k)
    speed1, push1 = real_servo_rates(at1, rate1, t1, load1, 1.0, k)
    speed2, push2 = real_servo_rates(at2, rate2, t2, load2, 1.0, k)
    speed[lat], speed[lon], speed[col] = to_channels(speed0, speed1, speed2, swash)
    push[lat], push[lon], push[col] = to_channels(push0, push1, push2, swash)


@njit
def servo_derivatives(x, u, k, out):
    """Fill the servos' places of a plant derivative for state x and command u (4,)."""
    if k.real.present:
        _real_derivatives(x, u, k, out)
        return
    for i in range(ACTUATOR.size):
        at, rate = PLANT.servo.start + i, PLANT.servo_rate.start + i
        out[at], out[rate] = servo_rates(x[at], x[rate], u[i], k)


@njit
def _limit_real_rates(x, k):
    """Hold the motors' rates of a plant state inside their limits, in place."""
    rate, swash = x[PLANT.servo_rate], k.real.swash
    lat, lon, col = ACTUATOR.lat, ACTUATOR.lon, ACTUATOR.col
    rate[ACTUATOR.ped] = limited(rate[ACTUATOR.ped], 0.0, 1.0, k)
    load0, load1, load2 = loads(x[PLANT.servo_col], k.real)
    rate0, rate1, rate2 = to_motors(rate[lat], rate[lon], rate[col], swash)
    rate[lat], rate[lon], rate[col] = to_channels(
        limited(rate0, load0, k.real.slow, k),
        limited(rate1, load1, 1.0, k),
        limited(rate2, load2, 1.0, k),
        swash,
    )


@njit
def apply_stops(x, k):
    """Hold the servos' positions and rates of a plant state inside their limits, in place."""
    if k.real.present:
        _limit_real_rates(x, k)
    for i in range(ACTUATOR.size):
        at, rate = PLANT.servo.start + i, PLANT.servo_rate.start + i
        if not k.real.present:
            x[rate] = min(max(x[rate], -k.rate_limit), k.rate_limit)
        if x[at] >= k.travel:
            x[at] = k.travel
            x[rate] = min(x[rate], 0.0)
        elif x[at] <= -k.travel:
            x[at] = -k.travel
            x[rate] = max(x[rate], 0.0)


# -------------------------------------------------------------------------------------------------
# What the actuator side flies while nobody commands it. No ROS.
#
# It knows the commands so far and a gyro, as a receiver or a servo board with failsafe positions
# does. While commands come it averages them: that is the trim. It also keeps by how much the
# attitude
# is off its own slow mean: the body rates, integrated and forgotten over the same time. Without a
# command for too long it flies
#
#     u = mean - rate * (p, q, r) - angle * (turned about x, y, z)
#
# on lateral, longitudinal and pedal, from then on without forgetting, and the mean collective.
# Where
# one takes over from the other the difference fades away, so that no command jumps.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]

_MOST = 0.98
_TURNED_RAD = 0.6
"""Turned further it is no small angle any more."""
_LATE_TICKS = 2
"""Ticks that are made up for at once count as so many: nobody could answer between them."""
_N = ACTUATOR.size
_AGE, _FADING, _ACTING, _TIMES, _TICKS = range(5)


@by_reference
class FallbackNumbers(NamedTuple):
    """Numbers of the fallback, as `parameters.TABLE` describes them.

    Attributes
    ----------
    timeout_ticks, blend_ticks : int
    kept : float
        Share of the mean that is left after a tick.
    tick_s : float
    rate, angle : (3,) arrays
        s/rad and 1/rad, lateral, longitudinal, pedal.
    """

    timeout_ticks: int
    blend_ticks: int
    kept: float
    tick_s: float
    rate: Array
    angle: Array

    @classmethod
    def from_parameters(cls, values: Mapping[str, Any]) -> "FallbackNumbers":
        """From the parameters of the plant."""
        rate = Rate.of_parameters(values)
        return cls(
            max(1, rate.ticks_in(values["actuator_timeout_s"])),
            max(1, rate.ticks_in(values["fallback.blend_s"])),
            float(np.exp(-rate.tick_s / values["fallback.mean_s"])),
            rate.tick_s,
            np.array(values["fallback.rate"], float),
            np.array(values["fallback.angle"], float),
        )


@by_reference
class FallbackState(NamedTuple):
    """What is remembered; changed in place."""

    mean: Array  # (4,) of the commands
    command: Array  # (4,) the last one
    turned: Array  # (3,) angles off the slow mean attitude, rad
    left: Array  # (4,) difference that fades away
    out: Array  # (4,) what is flown
    counts: NDArray[np.int64]  # (5,) age of the command, ticks left to fade, acting, times, ticks


def initial_fallback(trim: Array) -> FallbackState:
    """Before any command (4,) has come, the trim is flown."""
    return FallbackState(
        trim.copy(), trim.copy(), np.zeros(3), np.zeros(_N), trim.copy(), np.zeros(5, np.int64)
    )


@njit
def _fallback(state, n, gyro, out):
    """The command without commands, into out (4,)."""
    copy(out, state.mean)
    for i in range(gyro.shape[0]):
        out[i] -= n.rate[i] * gyro[i] + n.angle[i] * state.turned[i]
    for i in range(out.shape[0]):
        out[i] = min(max(out[i], -_MOST), _MOST)


@njit
def _fade_from(state, n, goal):
    """Go on from what is flown towards a goal (4,)."""
    for i in range(goal.shape[0]):
        state.left[i] = state.out[i] - goal[i]
    state.counts[_FADING] = n.blend_ticks


@njit
def hear(state, n, command):
    """A command (4,) has come."""
    copy(state.command, command)
    state.counts[_AGE] = 0
    if state.counts[_ACTING]:
        state.counts[_ACTING] = 0
        _fade_from(state, n, state.command)


@njit
def step(state, n, gyro_radps, made_up):
    """What is flown for a tick, into state.out; as `Fallback.step`."""
    count, goal, gyro = state.counts, scratch(_N), scratch(3)
    for i in range(gyro_radps.shape[0]):
        gyro[i] = gyro_radps[i] if np.isfinite(gyro_radps[i]) else 0.0
    count[_AGE] += made_up < _LATE_TICKS
    for i in range(gyro.shape[0]):
        state.turned[i] += n.tick_s * gyro[i]
    if not count[_ACTING] and count[_AGE] > n.timeout_ticks:
        count[_ACTING], count[_TIMES] = 1, count[_TIMES] + 1
        _fallback(state, n, gyro, goal)
        _fade_from(state, n, goal)
    if count[_ACTING]:
        count[_TICKS] += 1
        _fallback(state, n, gyro, goal)
    else:
        copy(goal, state.command)
        for i in range(goal.shape[0]):
            state.mean[i] += (1.0 - n.kept) * (state.command[i] - state.mean[i])
        for i in range(gyro.shape[0]):
            state.turned[i] *= n.kept
    for i in range(gyro.shape[0]):
        state.turned[i] = min(max(state.turned[i], -_TURNED_RAD), _TURNED_RAD)
    if count[_FADING]:
        count[_FADING] -= 1
        share = count[_FADING] / n.blend_ticks
        for i in range(goal.shape[0]):
            goal[i] = min(max(goal[i] + state.left[i] * share, -_MOST), _MOST)
    copy(state.out, goal)


@njit
def after(state, n, came, command, gyro_radps):
    """What is flown for a tick at which a command (4,) has come, or none, into state.out."""
    if came:
        hear(state, n, command)
    step(state, n, gyro_radps, 0)


class Fallback:
    """The command in force, from who commands or without.

    Parameters
    ----------
    numbers : FallbackNumbers
    trim : (4,) array
        Command before any has come.
    """

    def __init__(self, numbers: FallbackNumbers, trim: Array) -> None:
        self._n, self._state = numbers, initial_fallback(trim)

    @property
    def acting(self) -> bool:
        """True while nobody commands."""
        return bool(self._state.counts[_ACTING])

    @property
    def times(self) -> int:
        """How often it has acted."""
        return int(self._state.counts[_TIMES])

    @property
    def ticks(self) -> int:
        """How long it has acted."""
        return int(self._state.counts[_TICKS])

    def hear(self, command: Array) -> None:
        """A command (4,) has come."""
        hear(self._state, self._n, command)

    def step(self, gyro_radps: Array, made_up: int = 0) -> Array:
        """What is flown for a tick.

        Parameters
        ----------
        gyro_radps : (3,) array
            Body rates of now, FRD, measured; NaN counts as none.
        made_up : int
            How many ticks were made at once before this one.

        Returns
        -------
        (4,) array
            Actuators within -1..1; valid until the next call.
        """
        step(self._state, self._n, gyro_radps, made_up)
        return self._state.out

    def after(self, command: Array | None, gyro_radps: Array) -> Array:
        """What is flown for a tick at which a command (4,) has come, or none; as `step`."""
        came = command is not None
        after(self._state, self._n, came, command if came else self._state.command, gyro_radps)
        return self._state.out

    def facts(self) -> dict[str, str]:
        """How often and how long nobody has commanded, for /diagnostics; empty if never."""
        if not self.times:
            return {}
        lasted_s = self.ticks * self._n.tick_s
        return {"without_commands": f"{self.times} times, {lasted_s:.2f} s in all"}
