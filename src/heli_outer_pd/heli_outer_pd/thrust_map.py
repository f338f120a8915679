# SPDX-License-Identifier: Apache-2.0
"""The main rotor's own thrust map, inverted: thrust and climb speed to collective.

Blade element and momentum theory in axial flow (Cai, Chen, Lee, Unmanned Rotorcraft Systems, 2011,
ch. 6): T = rho Omega R^2 C_la b c / 4 (w_bl - v_i), w_bl = w_r + 2/3 Omega R theta_col,
v_i (v_i - w_r) = T / (2 rho pi R^2). For given T and w_r both are explicit in theta_col. w_r is the
hub's speed along body z relative to the air: positive in a descent.
"""

import math
from typing import NamedTuple

from heli_math.jit import njit


class RotorMap(NamedTuple):
    """Rotor constants of the thrust map (SI)."""

    rho: float  # kg/m3
    omega: float  # rad/s
    radius: float  # m
    lift_slope: float  # 1/rad
    blades: float
    chord: float  # m
    K_col: float  # rad of blade pitch per unit collective, negative on this aircraft


@njit
def _slope(rotor):
    """Thrust per speed through the blades, N s/m."""
    area = rotor.radius * rotor.radius * rotor.blades * rotor.chord
    return rotor.rho * rotor.omega * rotor.lift_slope * area / 4.0


@njit
def _disk(rotor):
    """2 rho times the disk's area, kg/m."""
    return 2.0 * rotor.rho * math.pi * rotor.radius * rotor.radius


@njit
def blade_pitch(thrust, w_r, rotor):
    """Blade pitch (rad) that gives thrust (N, > 0) at the hub speed w_r (m/s, down)."""
    v_i = 0.5 * w_r + math.sqrt(0.25 * w_r * w_r + thrust / _disk(rotor))
    return (thrust / _slope(rotor) + v_i - w_r) * 1.5 / (rotor.omega * rotor.radius)


@njit
def thrust_of(pitch, w_r, rotor):
    """Thrust (N) at blade pitch (rad) and hub speed w_r (m/s, down); the inverse of blade_pitch.

    0 where the disk would have to push downwards, which the map does not cover.
    """
    w_bl = w_r + rotor.omega * rotor.radius * pitch / 1.5
    if w_bl <= max(w_r, 0.0):
        return 0.0
    kappa = _slope(rotor) / _disk(rotor)
    half = 0.5 * (kappa - w_r)
    v_i = math.sqrt(half * half + kappa * w_bl) - half
    return _slope(rotor) * (w_bl - v_i)


@njit
def collective_for_thrust(thrust, w_r, thrust_trim, d_col_trim, rotor):
    """Collective (-) that gives thrust (N) at hub speed w_r, anchored at the trim point.

    Only differences of the map are used, so a constant error of the rotor model cancels at trim.
    """
    step = blade_pitch(thrust, w_r, rotor) - blade_pitch(thrust_trim, 0.0, rotor)
    return d_col_trim + step / rotor.K_col


@njit
def thrust_for_collective(d_col, w_r, thrust_trim, d_col_trim, rotor):
    """Thrust (N) at collective (-) and hub speed w_r: the inverse of collective_for_thrust."""
    pitch = blade_pitch(thrust_trim, 0.0, rotor) + rotor.K_col * (d_col - d_col_trim)
    return thrust_of(pitch, w_r, rotor)
