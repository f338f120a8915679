# SPDX-License-Identifier: Apache-2.0
"""Errors of an IMU besides noise and bias: vibration, scale and misalignment, range, its clock.

A sensor reads `clip((I + E) (motion + vibration) + bias + white)`; E has scale factors on its
diagonal and misalignments beside it (Groves, Principles of GNSS, Inertial, and Multisensor
Integrated Navigation Systems, 2nd ed. 2013, eq. 4.16 and 4.17).

Vibration is what the rotor shakes: sines at one and at N per revolution (N blades) of the azimuth
that the rotor has turned through (Bramwell, Helicopter Dynamics, 2nd ed. 2001, ch. 8: a rotor of N
equal blades passes N/rev and its multiples on to the fuselage, unequal blades 1/rev). It is read at
the ticks, so what lies above half their rate R comes back below: f is seen at |f - R round(f / R)|.
The IMU's own filters see it before it is sampled: an average over some time T with the response
|sin(pi f T)| / (pi f T), and a second-order Butterworth low-pass, 1 / sqrt(1 + (f / fc)^4). They
act on the vibration alone: the aircraft flies below them, and their delay is not modelled.
"""

import math
from typing import NamedTuple

import numpy as np

from heli_math.jit import njit
from heli_math.rows import IMU


class VibrationKernel(NamedTuple):
    """Amplitudes at the IMU's case, before its filters; forces (m/s2), then rates (rad/s)."""

    on: bool
    rev: np.ndarray  # (6,) at 1/rev, places of `rows.IMU`
    blade: np.ndarray  # (6,) at N/rev
    blades: float  # N
    average_s: float  # 0: none
    lowpass_hz: float  # 0: none


class ImuErrorKernel(NamedTuple):
    """What `distort` and `clip` read, and what their state is drawn with."""

    on: bool
    vibration: VibrationKernel
    clock_s: float  # sigma of the sampling instant about the stamp
    ranges: np.ndarray  # (6,) largest reading, infinite: no limit
    gain_sigma: np.ndarray  # (2, 3, 3) of E at the start: accelerometers, gyros
    tick_s: float  # between samples


class ImuErrorState(NamedTuple):
    """What stays of these errors from tick to tick."""

    gain: np.ndarray  # (2, 3, 3) I + E of accelerometers and gyros
    azimuth: np.ndarray  # (1,) rad that the rotor has turned through, modulo a turn
    before: np.ndarray  # (6,) true motion at the tick before


@njit
def filter_gain(frequency_hz, k):
    """What the IMU's filters leave of a sine of this frequency; negative: its sign turns."""
    gain = 1.0
    phase = math.pi * frequency_hz * k.average_s
    if phase > 0.0:
        gain = math.sin(phase) / phase
    if k.lowpass_hz > 0.0:
        gain /= math.sqrt(1.0 + (frequency_hz / k.lowpass_hz) ** 4)
    return gain


@njit
def _shake(azimuth, speed, k, motion):
    """Add the vibration at an azimuth (rad) and rotor speed (rad/s) to the motion (6,)."""
    turns_hz = speed / (2.0 * math.pi)
    rev, blade = filter_gain(turns_hz, k), filter_gain(k.blades * turns_hz, k)
    for i in range(IMU.size):
        # What is unequal turns with the rotor: the lateral axis follows the longitudinal one by
        # a quarter of a turn.
        quarter = 0.5 * math.pi if i % 3 == 1 else 0.0
        motion[i] += rev * k.rev[i] * math.cos(azimuth - quarter)
        motion[i] += blade * k.blade[i] * math.cos(k.blades * azimuth - quarter)


@njit
def distort(state, tick, speed, clock, k, motion):
    """Turn the true specific force and rates into what the sensors' elements put out.

    Parameters
    ----------
    state : ImuErrorState
        In place.
    tick : int
    speed : float
        Of the rotor, rad/s.
    clock : float
        Standard normal: the sample is `clock * clock_s` later than its stamp.
    k : ImuErrorKernel
    motion : (6,) array
        True motion at the tick, places of `rows.IMU`; changed in place.
    """
    if tick > 0:
        state.azimuth[0] = (state.azimuth[0] + speed * k.tick_s) % (2.0 * math.pi)
    late_s = clock * k.clock_s
    for i in range(IMU.size):
        true = motion[i]
        if tick > 0:
            motion[i] += late_s / k.tick_s * (true - state.before[i])
        state.before[i] = true
    if k.vibration.on:
        _shake(state.azimuth[0] + speed * late_s, speed, k.vibration, motion)
    for sensor in range(2):
        gain, first = state.gain[sensor], 3 * sensor
        a, b, c = motion[first], motion[first + 1], motion[first + 2]
        for i in range(3):
            motion[first + i] = gain[i, 0] * a + gain[i, 1] * b + gain[i, 2] * c


@njit
def clip(k, motion):
    """Cut the readings (6,) at the sensors' ranges, in place."""
    for i in range(IMU.size):
        motion[i] = min(max(motion[i], -k.ranges[i]), k.ranges[i])
