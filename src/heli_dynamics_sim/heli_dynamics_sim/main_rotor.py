# SPDX-License-Identifier: Apache-2.0
"""Rotors: thrust and inflow (momentum theory), main-rotor power, flapping.

Source: Cai, Chen, Lee, Unmanned Rotorcraft Systems (Springer 2011), ch. 6; flapping is eq. (6) and
(7) of the paper, corrected.

Thrust and induced velocity of a rotor are one scalar equation. With `T = slope (w_bl - v)` and
Glauert's `v^2 = sqrt((v2/2)^2 + (T/(2 rho A))^2) - v2/2`, `v2 = mu^2 + w (w - 2 v)`, squaring gives

    g(v) = v sqrt(mu^2 + (w - v)^2) - kappa (w_bl - v) = 0,   kappa = slope / (2 rho A),

where mu is the air speed in the disc plane, w the air speed through the disc (positive: descent)
and v carries the sign of the thrust. g changes sign between v = 0 and v = w_bl, so a solution
always exists.

In a descent faster than kappa (5.3 m/s for the default main rotor) momentum theory has up to three
solutions (vortex ring): thrust would jump. There the speed through the disc is given an additional
component `(|w| - kappa) / sqrt(8)` in quadrature, enough for g to be monotone: the solution is
unique and continuous everywhere, and the printed law holds exactly up to |w| = kappa and in every
climb.
"""

import math
from typing import NamedTuple

from heli_math.jit import njit

MAX_ITERATIONS = 60
_STEP_TOLERANCE = 1e-13


class RotorKernel(NamedTuple):
    """Thrust law of one rotor."""

    thrust_slope: float  # rho Omega R^2 C_la b c / 4, N per m/s of flow
    blade_speed: float  # 2/3 Omega R, m/s of flow per rad of pitch
    disc: float  # 2 rho pi R^2, kg/m


class MainRotorKernel(NamedTuple):
    """What the main rotor has besides its thrust law."""

    hub_stiffness: float  # K_beta, N m/rad
    hub_height: float  # H_mr, m
    speed: float  # Omega_mr, rad/s
    profile_power: float  # rho Omega R^2 C_D0 b c / 8, kg/m s ... times speed^2 gives W
    tip_speed: float  # Omega R, m/s
    pitch_gain: float  # K_col, rad
    pitch_offset: float  # theta_col0, rad


class FlappingKernel(NamedTuple):
    """Eq. (6), corrected."""

    rate: float  # 1/tau, 1/s
    a_bs: float  # 1/s
    b_as: float  # 1/s
    lon_from_lon: float  # rad
    lon_from_lat: float  # rad
    lat_from_lat: float  # rad
    lat_from_lon: float  # rad
    flap_back: float  # rad per m/s: da_s/du in equilibrium


@njit
def ring_term(w_r, w_bl, kappa):
    """Square of the additional flow speed (m2/s2) in fast descent, see the module's text."""
    if w_r * w_bl <= 0.0:
        return 0.0
    excess = abs(w_r) - kappa
    if excess <= 0.0:
        return 0.0
    return 0.125 * excess * excess


@njit
def solve_inflow(w_r, w_bl, mu_sq, rotor):
    """Induced velocity and thrust of a rotor, together.

    A Newton iteration kept inside the bracket [0, w_bl], bisecting where it does not halve the
    residual: a pure function, bounded in time.

    Parameters
    ----------
    w_r : float
        Air speed through the disc, m/s, positive in descent.
    w_bl : float
        The same as seen by the pitched blade, m/s.
    mu_sq : float
        Square of the air speed in the disc plane, m2/s2.
    rotor : RotorKernel

    Returns
    -------
    v_i : float
        Induced velocity, m/s, with the sign of the thrust.
    thrust : float
        N.
    iterations : int
        `MAX_ITERATIONS` means: not converged (only for inputs that are not finite).
    """
    kappa = rotor.thrust_slope / rotor.disc
    in_plane = mu_sq + ring_term(w_r, w_bl, kappa)
    low = min(0.0, w_bl)
    high = max(0.0, w_bl)
    half = 0.5 * (kappa + math.sqrt(in_plane + w_r * w_r))
    v = math.copysign(math.sqrt(half * half + kappa * abs(w_bl)) - half, w_bl)
    last = math.inf
    iterations = MAX_ITERATIONS
    for i in range(MAX_ITERATIONS):
        flow = math.sqrt(in_plane + (v - w_r) * (v - w_r))
        g = v * flow - kappa * (w_bl - v)
        if g > 0.0:
            high = v
        else:
            low = v
        slope = flow + kappa
        if flow > 0.0:
            slope += v * (v - w_r) / flow
        trial = v - g / slope
        if not (low <= trial <= high) or abs(g) > 0.5 * last:
            trial = 0.5 * (low + high)
        last = abs(g)
        step = abs(trial - v)
        v = trial
        if step <= _STEP_TOLERANCE * (1.0 + abs(v)):
            iterations = i + 1
            break
    return v, rotor.thrust_slope * (w_bl - v), iterations


@njit
def tail_rotor(u_a, v_a, w_a, p, q, r, pitch, arm, height, rotor, stall):
    """Thrust (N, pushing to the left, -y) of the tail rotor with blade pitch in rad, and the air's
    speed through its disc against the thrust, m/s; the thrust ends at +- stall (N)."""
    w_r = v_a - r * arm + p * height
    w_disc = w_a + q * arm
    v_i, thrust, _ = solve_inflow(
        w_r, w_r + rotor.blade_speed * pitch, w_disc * w_disc + u_a * u_a, rotor
    )
    return min(max(thrust, -stall), stall), v_i - w_r


@njit
def flapping_rates(a_s, b_s, p, q, u_a, v_a, d_lat, d_lon, k):
    """(da_s/dt, db_s/dt), rad/s: eq. (6), corrected, with the optional flap-back.

    Corrected: the couplings multiply the other flapping angle. Flap-back (Gavrilets' X-Cell model)
    tilts the disc away from the oncoming air: backwards in forward flight, to the left in flight to
    the right; the NUS model has none, so its default is 0.
    """
    theta_a = k.lon_from_lon * d_lon + k.lon_from_lat * d_lat + k.flap_back * u_a
    theta_b = k.lat_from_lat * d_lat + k.lat_from_lon * d_lon - k.flap_back * v_a
    a_rate = -q + k.rate * (theta_a - a_s) + k.a_bs * b_s
    b_rate = -p + k.rate * (theta_b - b_s) + k.b_as * a_s
    return a_rate, b_rate
