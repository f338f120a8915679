# SPDX-License-Identifier: Apache-2.0
"""Yaw-rate gyro with heading lock: a PI controller between the pedal servo and the tail rotor.

Eq. (8) of the paper, split into its state d_int and its output: `d_int' = K_a d_ped - r`,
`d_ped' = K_P (K_a d_ped - r) + K_I d_int`. With the term `tail_authority` the pitch of the blades
ends at their stops, which is where the gyro's own limits are set, and its integrator rests there.
"""

from typing import NamedTuple

from heli_math.jit import njit


class GyroKernel(NamedTuple):
    """Gains of the gyro and its way to the tail blades."""

    proportional: float  # K_P, rad per rad/s
    integral: float  # K_I, rad per rad
    pedal_gain: float  # K_a, rad/s of commanded yaw rate per unit of pedal
    pitch_gain: float  # K_ped, rad of tail blade pitch per rad of gyro output
    pitch_offset: float  # theta_ped0, rad
    pitch_min: float  # of the tail blades, rad; infinite without the term tail_authority
    pitch_max: float


@njit
def gyro(d_ped, r, d_int, k):
    """(d_int rate in rad/s, output d_ped' in rad) at yaw rate r (rad/s)."""
    error = k.pedal_gain * d_ped - r
    output = k.proportional * error + k.integral * d_int
    pitch = k.pitch_gain * output + k.pitch_offset
    outward = k.pitch_gain * error
    stuck = (pitch > k.pitch_max and outward > 0.0) or (pitch < k.pitch_min and outward < 0.0)
    return 0.0 if stuck else error, output


@njit
def tail_pitch(output, k):
    """Pitch of the tail blades (rad) for the gyro's output (rad)."""
    return min(max(k.pitch_gain * output + k.pitch_offset, k.pitch_min), k.pitch_max)
