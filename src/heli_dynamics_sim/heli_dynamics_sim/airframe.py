# SPDX-License-Identifier: Apache-2.0
"""Fuselage and fins: aerodynamic forces in body axes.

Source: Cai, Chen, Lee, Unmanned Rotorcraft Systems (Springer 2011), ch. 6. The source switches a
fin from its unstalled to its stalled law at |v| = 0.3 |u|, where the force would jump by a factor
of almost ten; here the two are blended by a cubic between 0.3 and a second ratio (a parameter),
so the force is continuous.
"""

from typing import NamedTuple

from heli_math.jit import njit


class FuselageKernel(NamedTuple):
    """rho/2 times the drag areas, kg/m."""

    x: float
    y: float
    z: float


class FinKernel(NamedTuple):
    """One fin."""

    dynamic_area: float  # rho/2 S, kg/m
    lift_slope: float  # 1/rad
    arm: float  # behind the c.g., m
    height: float  # above the c.g., m
    stall_onset: float  # ratio |across| / |u| where the stall begins
    stall_full: float  # and where it is complete


@njit
def fuselage_force(u_a, v_a, w_a, v_i, k):
    """Drag (N, 3 floats) of the fuselage in the body airspeed and the downwash v_i (m/s)."""
    w_f = w_a - v_i
    wash = abs(v_i)
    x = -k.x * u_a * max(wash, abs(u_a))
    y = -k.y * v_a * max(wash, abs(v_a))
    z = -k.z * w_f * max(wash, abs(w_f))
    return x, y, z


@njit
def fin_force(across, u_a, k):
    """Force (N) of a fin against the flow across it (m/s), with the axial airspeed u_a (m/s)."""
    speed = abs(across)
    along = abs(u_a)
    attached = -k.dynamic_area * k.lift_slope * across * along
    stalled = -k.dynamic_area * across * speed
    if speed <= k.stall_onset * along:
        return attached
    if speed >= k.stall_full * along:
        return stalled
    s = (speed / along - k.stall_onset) / (k.stall_full - k.stall_onset)
    share = s * s * (3.0 - 2.0 * s)
    return attached + share * (stalled - attached)
