# SPDX-License-Identifier: Apache-2.0
"""Dynamic inflow of the main rotor: Pitt and Peters, three states.

The air over the disc has inertia, and it answers moments as well as thrust. Induced velocity at x
forward, y to the right: `v_0 + v_s y/R - v_c x/R`. With the loads C = (thrust, lift to the right,
lift to the rear) as coefficients (Pitt and Peters, Theoretical Prediction of Dynamic-Inflow
Derivatives, Vertica 5, 1981; nonlinear in the mean flow as Peters and HaQuang, Dynamic Inflow for
Practical Applications, J. AHS 33 (4), 1988; survey: Chen, NASA TM-102219, 1989):

    M v' R / (Omega R)^2 + V L^-1 v / (Omega R)^2 = C,   M = diag(8/(3 pi), 16/(45 pi), 16/(45 pi)).

L in axes of the flow, X = tan(chi/2), chi the skew of the wake:

    [1/2, 0, -g; 0, 2 (1 + X^2), 0; g, 0, 2 (1 - X^2)],   g = 15 pi/64 X,

V = diag(V_T, V_m, V_m): V_T the resultant flow, V_m = V_T + through v_0 / V_T. Steady, the mean is
Glauert's. Momentum theory ends where no air flows through the disc: without thrust, standing at
idle, each moment would have a gradient without bound, and the flapping no damping. So V_m is at
least a share of hover's (ours; nothing that flies comes near it).
"""

import math
from typing import NamedTuple

from heli_math.jit import njit

_MEAN = 3.0 * math.pi / 8.0
_GRADIENT = 45.0 * math.pi / 16.0
_SKEW = 15.0 * math.pi / 64.0
_STILL_SQ = 1e-18


class InflowKernel(NamedTuple):
    """What the inflow has of its own."""

    radius: float  # R, m
    least_flow: float  # of V_m, m/s


@njit
def inflow_rates(v, air, flow, loads, k):
    """Rates (m/s2, 3 floats) of v_0, v_s, v_c.

    Parameters
    ----------
    v : (3,) array
        v_0, v_s, v_c, m/s.
    air : 2 floats
        Air speed in the disc plane, forward and to the right, m/s.
    flow : float
        Resultant flow V_T, m/s, at least the air speed in the plane.
    loads : 3 floats
        Thrust, lift to the right and to the rear over `rho pi R^2` (times R), m2/s2.
    k : InflowKernel
    """
    u_a, v_a = air
    thrust, right, rear = loads
    in_plane_sq = u_a * u_a + v_a * v_a
    cos, sin = 1.0, 0.0
    if in_plane_sq > _STILL_SQ:
        in_plane = math.sqrt(in_plane_sq)
        cos, sin = u_a / in_plane, v_a / in_plane
    flow = max(flow, 1e-3)
    through = math.sqrt(max(flow * flow - in_plane_sq, 0.0))
    skew = math.sqrt(in_plane_sq) / (flow + through)
    gain = _SKEW * skew
    mixed = max(flow + through * abs(v[0]) / flow, k.least_flow)
    along, across = v[2] * cos - v[1] * sin, v[2] * sin + v[1] * cos
    load_along, load_across = rear * cos - right * sin, rear * sin + right * cos
    flat = 1.0 - skew * skew
    det = flat + gain * gain
    mean_rate = thrust - flow * (2.0 * flat * v[0] + gain * along) / det
    along_rate = load_along - mixed * (0.5 * along - gain * v[0]) / det
    across_rate = load_across - mixed * across / (2.0 * (1.0 + skew * skew))
    return (
        _MEAN / k.radius * mean_rate,
        _GRADIENT / k.radius * (across_rate * cos - along_rate * sin),
        _GRADIENT / k.radius * (across_rate * sin + along_rate * cos),
    )
