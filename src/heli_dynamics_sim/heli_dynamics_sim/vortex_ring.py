# SPDX-License-Identifier: Apache-2.0
"""Induced velocity in descent as measured: turbulent wake and vortex ring.

Momentum theory fails between hover and a descent of twice the hover's induced velocity v_h, where
air is carried around through the disc. There the mean of rotor measurements in axial descent stands
for it:

    v_i / v_h = 1 + k_1 x + k_2 x^2 + k_3 x^3 + k_4 x^4,   x = V_c / v_h in [-2, 0],

with k = -1.125, -1.372, -1.718, -0.655 and V_c the speed of climb (Leishman, Principles of
Helicopter Aerodynamics, 2nd ed., 2006, eq. (2.96) with its factor of hover 1: the thrust law here
has none). The printed curve ends at 1.026 where the windmill-brake state begins with 1;
`-0.026 (x/2)^8` closes the gap (less than 0.3 % of v_h above x = -1.5). Faster descents are the
windmill-brake branch of momentum theory.

With air speed mu in the disc plane the mass flow is the vector sum, as Glauert has it, see
`mass_flow`: momentum theory at x = 0, the measured curve at mu = 0, `v_h^2 / mu` in fast flight; in
between no measurement stands behind it. The unsteadiness of the ring is not modelled.
"""

import math

from heli_math.jit import njit

K_1, K_2, K_3, K_4 = -1.125, -1.372, -1.718, -0.655
_GAP = 1.0 - 2.0 * K_1 + 4.0 * K_2 - 8.0 * K_3 + 16.0 * K_4 - 1.0
_ITERATIONS = 60
_TOLERANCE = 1e-13


@njit
def axial_ratio(x):
    """v_i / v_h in axial descent at x = V_c / v_h <= 0 (1)."""
    if x <= -2.0:
        return 1.0 / (-0.5 * x + math.sqrt(0.25 * x * x - 1.0))
    half_sq = 0.25 * x * x
    curve = 1.0 + x * (K_1 + x * (K_2 + x * (K_3 + x * K_4)))
    return curve - _GAP * half_sq * half_sq * half_sq * half_sq


@njit
def mass_flow(hover_sq, sinking, in_plane_sq):
    """Speed U (m/s) for which the induced velocity is `v_h^2 / U`.

    hover_sq is v_h^2 = T / (2 rho A), sinking the air speed through the disc against the thrust
    (>= 0), in_plane_sq the square of that in its plane. `U^2 = mu^2 + (v / f^2)^2` with
    `v = v_h^2 / U` and f the axial ratio; at mu = 0 this is U = v_h / f.
    """
    v_h = math.sqrt(hover_sq)
    if sinking >= 2.0 * v_h:
        through = 0.5 * sinking + math.sqrt(0.25 * sinking * sinking - hover_sq)
    else:
        through = v_h / axial_ratio(-sinking / v_h)
    through_sq = through * through
    root = math.sqrt(in_plane_sq * in_plane_sq + 4.0 * through_sq * through_sq)
    return math.sqrt(0.5 * (in_plane_sq + root))


@njit
def _excess(v_h, sinking, w_bl, in_plane_sq, kappa):
    """What is zero at the rotor's v_h, m2/s2; it grows with v_h."""
    hover_sq = v_h * v_h
    return hover_sq + kappa * (hover_sq / mass_flow(hover_sq, sinking, in_plane_sq) - w_bl)


@njit
def solve_descent(sinking, w_bl, in_plane_sq, rotor):
    """(induced velocity in m/s, thrust in N) of a rotor that sinks, both positive.

    sinking and w_bl > 0: air speeds through the disc and as the pitched blade meets it, m/s. The
    zero of `v_h^2 + kappa (v(v_h) - w_bl)`, which grows with v_h, by a guarded secant iteration.
    """
    kappa = rotor.thrust_slope / rotor.disc
    low, high = 0.0, math.sqrt(kappa * w_bl)
    # Where v_i is 1.2 v_h, as in a slow descent, and a Newton step from there.
    half = 0.6 * kappa
    last = math.sqrt(half * half + kappa * w_bl) - half
    f_last = _excess(last, sinking, w_bl, in_plane_sq, kappa)
    v_h = last - f_last / (2.0 * last + 2.0 * half)
    for _ in range(_ITERATIONS):
        if not low < v_h < high:
            v_h = 0.5 * (low + high)
        f = _excess(v_h, sinking, w_bl, in_plane_sq, kappa)
        if abs(f) <= _TOLERANCE * kappa * w_bl:
            break
        if f > 0.0:
            high = v_h
        else:
            low = v_h
        step = f * (v_h - last) / (f - f_last) if f != f_last else 0.0
        last, f_last = v_h, f
        v_h -= step
    thrust = rotor.disc * v_h * v_h
    return w_bl - thrust / rotor.thrust_slope, thrust
