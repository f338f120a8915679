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

from heli_core.jit import njit
from heli_core.rows import PLANT

# -------------------------------------------------------------------------------------------------
# Rotor.
# -------------------------------------------------------------------------------------------------

MAX_ITERATIONS = 60
_STEP_TOLERANCE = 1e-13


class RotorParams(NamedTuple):
    """Thrust law of one rotor."""

    thrust_slope: float  # rho Omega R^2 C_la b c / 4, N per m/s of flow
    blade_speed: float  # 2/3 Omega R, m/s of flow per rad of pitch
    disc: float  # 2 rho pi R^2, kg/m


class MainRotorParams(NamedTuple):
    """What the main rotor has besides its thrust law."""

    hub_stiffness: float  # K_beta, N m/rad
    hub_height: float  # H_mr, m
    speed: float  # Omega_mr, rad/s
    profile_power: float  # rho Omega R^2 C_D0 b c / 8, kg/m s ... times speed^2 gives W
    tip_speed: float  # Omega R, m/s
    pitch_gain: float  # K_col, rad
    pitch_offset: float  # theta_col0, rad


class FlappingParams(NamedTuple):
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
    rotor : RotorParams

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


# -------------------------------------------------------------------------------------------------
# Dynamic inflow of the main rotor: Pitt and Peters, three states.
#
# The air over the disc has inertia, and it answers moments as well as thrust. Induced velocity at
# x
# forward, y to the right: `v_0 + v_s y/R - v_c x/R`. With the loads C = (thrust, lift to the
# right,
# lift to the rear) as coefficients (Pitt and Peters, Theoretical Prediction of Dynamic-Inflow
# Derivatives, Vertica 5, 1981; nonlinear in the mean flow as Peters and HaQuang, Dynamic Inflow
# for
# Practical Applications, J. AHS 33 (4), 1988; survey: Chen, NASA TM-102219, 1989):
#
#     M v' R / (Omega R)^2 + V L^-1 v / (Omega R)^2 = C,   M = diag(8/(3 pi), 16/(45 pi), 16/(45
#     pi)).
#
# L in axes of the flow, X = tan(chi/2), chi the skew of the wake:
#
#     [1/2, 0, -g; 0, 2 (1 + X^2), 0; g, 0, 2 (1 - X^2)],   g = 15 pi/64 X,
#
# V = diag(V_T, V_m, V_m): V_T the resultant flow, V_m = V_T + through v_0 / V_T. Steady, the mean
# is
# Glauert's. Momentum theory ends where no air flows through the disc: without thrust, standing at
# idle, each moment would have a gradient without bound, and the flapping no damping. So V_m is at
# least a share of hover's (ours; nothing that flies comes near it).
# -------------------------------------------------------------------------------------------------

_MEAN = 3.0 * math.pi / 8.0
_GRADIENT = 45.0 * math.pi / 16.0
_SKEW = 15.0 * math.pi / 64.0
_STILL_SQ = 1e-18


class InflowParams(NamedTuple):
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
    k : InflowParams
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


# -------------------------------------------------------------------------------------------------
# Flap-back: what the air's speed across the disc does to its tilt.
#
# The advancing blade meets faster air than the retreating one; the disc tilts until their lifts
# agree. For a blade without twist, uniform inflow and small speed ratio mu (Bramwell, Done,
# Balmford,
# Bramwell's Helicopter Dynamics, 2nd ed., 2001, ch. 3; Padfield, Helicopter Flight Dynamics, 2nd
# ed.,
# 2007, ch. 3):
#
#     a_1 = 2 mu (4/3 theta_0 - lambda) / (1 - mu^2 / 2),   b_1 = 4/3 mu a_0 / (1 + mu^2 / 2),
#
# lambda the flow down through the disc over the tip speed, a_0 = gamma/8 (theta_0 - 4/3 lambda) /
# lambda_beta^2 the coning. a_1 tilts away from the oncoming air, b_1 towards the advancing blade.
#
# A stabiliser bar has the same speed across it but no collective pitch, so it tilts the other way,
# by
# `2 v (w_i - w) / (Omega^2 (r_1^2 + r_2^2))` for paddles from r_1 to r_2 (the flapping balance of
# a
# paddle with theta_0 = 0), and hands `gain` of it to the blades as cyclic pitch: what is left in
# steady flow is a fraction. The inflow at the paddles is that of blade-element momentum theory at
# their radius (Leishman, Principles of Helicopter Aerodynamics, 2nd ed., 2006, eq. (3.61)), less
# than
# the mean.
#
# The blades follow a gust within 16/(gamma Omega), the bar only within its own, ten times longer,
# time: two states keep the blades' part, see `flap_back_rates`.
# -------------------------------------------------------------------------------------------------


class FlapBackParams(NamedTuple):
    """Numbers of blades and bar."""

    blade_rate: float  # gamma Omega / 16, 1/s
    coning: float  # gamma / (8 lambda_beta^2), rad per rad
    bar_gain: float  # blade pitch per tilt of the bar; 0 without one
    bar_radius_sq: float  # r_1^2 + r_2^2, m2
    bar_inflow: float  # inflow at the paddles over the mean one


def paddle_inflow(thrust_coefficient: float, lift_solidity: float, radius_ratio: float) -> float:
    """Inflow at radius_ratio (r/R) over the mean one, in hover, by blade-element momentum theory.

    lift_solidity is lift slope (1/rad) times solidity.
    """
    mean = math.sqrt(0.5 * thrust_coefficient)
    pitch = 6.0 * thrust_coefficient / lift_solidity + 1.5 * mean
    root = math.sqrt(1.0 + 32.0 * pitch * radius_ratio / lift_solidity)
    return lift_solidity / 16.0 * (root - 1.0) / mean


@njit
def blade_tilts(u_a, v_a, pitch, down, tip_speed, coning):
    """(a, b), rad: steady tilt of the blades alone in the air speed u_a, v_a (m/s).

    The rotor turns clockwise, seen from above. pitch (rad) is theta_0, down (m/s) the flow down
    through the disc.
    """
    flow = down / tip_speed
    mu_sq = (u_a * u_a + v_a * v_a) / (tip_speed * tip_speed)
    back = 2.0 * (4.0 / 3.0 * pitch - flow) / (1.0 - 0.5 * min(mu_sq, 1.0)) / tip_speed
    cone = coning * (pitch - 4.0 / 3.0 * flow)
    aside = 4.0 / 3.0 * cone / (1.0 + 0.5 * mu_sq) / tip_speed
    return back * u_a - aside * v_a, -back * v_a - aside * u_a


@njit
def bar_per_mps(v_i, w_r, speed, k):
    """Pitch that the bar takes off the blades per air speed across it, rad per m/s."""
    return k.bar_gain * 2.0 * (k.bar_inflow * v_i - w_r) / (speed * speed * k.bar_radius_sq)


@njit
def flap_back_rates(x, u_a, v_a, v_i, w_r, pitch, main, rate, k, out):
    """Add the flap-back to the disc's rates in `out`, and fill those of the blades' part.

    The disc is the sum of the blades' own tilt d, `d' = (steady - d) blade_rate`, and of what
    follows with the time 1/rate of blades and bar together: `a' += d' + rate (d - bar)`. Without a
    bar (rate = blade_rate) that is one lag.
    """
    steady_a, steady_b = blade_tilts(u_a, v_a, pitch, v_i - w_r, main.tip_speed, k.coning)
    bar = bar_per_mps(v_i, w_r, main.speed, k)
    own_a, own_b = x[PLANT.blade_a], x[PLANT.blade_b]
    out[PLANT.blade_a] = (steady_a - own_a) * k.blade_rate
    out[PLANT.blade_b] = (steady_b - own_b) * k.blade_rate
    out[PLANT.a_s] += out[PLANT.blade_a] + rate * (own_a - bar * u_a)
    out[PLANT.b_s] += out[PLANT.blade_b] + rate * (own_b + bar * v_a)


# -------------------------------------------------------------------------------------------------
# Induced velocity in descent as measured: turbulent wake and vortex ring.
#
# Momentum theory fails between hover and a descent of twice the hover's induced velocity v_h,
# where
# air is carried around through the disc. There the mean of rotor measurements in axial descent
# stands
# for it:
#
#     v_i / v_h = 1 + k_1 x + k_2 x^2 + k_3 x^3 + k_4 x^4,   x = V_c / v_h in [-2, 0],
#
# with k = -1.125, -1.372, -1.718, -0.655 and V_c the speed of climb (Leishman, Principles of
# Helicopter Aerodynamics, 2nd ed., 2006, eq. (2.96) with its factor of hover 1: the thrust law
# here
# has none). The printed curve ends at 1.026 where the windmill-brake state begins with 1;
# `-0.026 (x/2)^8` closes the gap (less than 0.3 % of v_h above x = -1.5). Faster descents are the
# windmill-brake branch of momentum theory.
#
# With air speed mu in the disc plane the mass flow is the vector sum, as Glauert has it, see
# `mass_flow`: momentum theory at x = 0, the measured curve at mu = 0, `v_h^2 / mu` in fast flight;
# in
# between no measurement stands behind it. The unsteadiness of the ring is not modelled.
# -------------------------------------------------------------------------------------------------

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


# -------------------------------------------------------------------------------------------------
# Ground effect: the ground turns the wake aside, thrust costs less induced velocity.
#
# Cheeseman and Bennett (The Effect of the Ground on a Helicopter Rotor in Forward Flight, ARC R&M
# 3021, 1955), at the same power:
#
#     T / T_inf = 1 / (1 - (R / 4z)^2 / (1 + (V / v_i)^2)),
#
# z the hub's height, V the speed in the disc plane. At the same thrust the induced power is
# `(T_inf / T)^1.5` of that without ground (Leishman, Principles of Helicopter Aerodynamics, 2nd
# ed.,
# 2006, sec. 5.8), and this factor is what the induced velocity at the disc is multiplied by.
# Hayden
# (The Effect of the Ground on Helicopter Hovering Power Required, AHS Forum 32, 1976) fits flight
# tests: `1 / (0.9926 + 0.0379 (2R/z)^2)` of the power; his speed dependence is taken from the
# former.
# Both hold for z >= R/2.
# -------------------------------------------------------------------------------------------------

MODELS = ("cheeseman_bennett", "hayden")


class GroundEffectParams(NamedTuple):
    """Geometry and law."""

    radius: float  # R, m
    hub_height: float  # of the hub above the c.g., m
    hover_sq: float  # square of the induced velocity of hover, m2/s2
    hayden: bool  # else Cheeseman and Bennett


@njit
def induced_share(altitude_m, in_plane_sq, k):
    """Induced velocity over that without ground, in (0, 1], at an altitude of the c.g. (m)."""
    z = max(altitude_m + k.hub_height, 0.5 * k.radius)
    half = 0.5 * in_plane_sq
    # Glauert's induced velocity in level flight, from that of hover
    v_sq = math.sqrt(half * half + k.hover_sq * k.hover_sq) - half
    near = (k.radius / z) * (k.radius / z) / (1.0 + in_plane_sq / v_sq)
    if k.hayden:
        return min(1.0, 1.0 / (0.9926 + 0.0379 * 4.0 * near))
    return (1.0 - near / 16.0) ** 1.5


# -------------------------------------------------------------------------------------------------
# Main rotor in its air: thrust and induced velocity with the terms that are on, and states.
# -------------------------------------------------------------------------------------------------


@njit
def rotor_flow(x, at_main, k):
    """Thrust (N), induced velocity and air speed through the disc (m/s), blade pitch (rad).

    at_main: air speed (3 floats) of the rotor, body, m/s. The speed through the disc is positive in
    descent.
    """
    u_a, v_a, w_a = at_main
    w_r = w_a + x[PLANT.a_s] * u_a - x[PLANT.b_s] * v_a
    pitch = k.main.pitch_gain * x[PLANT.servo_col] + k.main.pitch_offset
    w_bl = w_r + k.rotor.blade_speed * pitch
    in_plane_sq = u_a * u_a + v_a * v_a
    rotor, share = k.rotor, 1.0
    if k.terms.ground_effect:
        # The disc pays `share` of momentum theory's velocity: the same law with scaled numbers.
        share = induced_share(-x[PLANT.down], in_plane_sq, k.ground_effect)
        rotor = RotorParams(share * rotor.thrust_slope, rotor.blade_speed, rotor.disc)
        w_bl /= share
    if k.terms.inflow:
        v_i = x[PLANT.inflow_mean]
        thrust = rotor.thrust_slope * (w_bl - v_i)
    elif k.terms.vortex_ring and w_r * w_bl > 0.0:
        v_i, thrust = solve_descent(abs(w_r), abs(w_bl), in_plane_sq, rotor)
        v_i, thrust = math.copysign(v_i, w_bl), math.copysign(thrust, w_bl)
    else:
        v_i, thrust, _ = solve_inflow(w_r, w_bl, in_plane_sq, rotor)
    return thrust, share * v_i, w_r, pitch


@njit
def resultant_flow(v_i, thrust, w_r, in_plane_sq, k):
    """Speed (m/s) of the air that the disc takes part in, where the mean inflow v_i is a state."""
    if k.terms.vortex_ring and w_r * thrust > 0.0:
        return mass_flow(abs(thrust) / k.rotor.disc, abs(w_r), in_plane_sq)
    ring = ring_term(w_r, thrust, k.rotor.thrust_slope / k.rotor.disc)
    return math.sqrt(in_plane_sq + ring + (v_i - w_r) * (v_i - w_r))


@njit
def rotor_term_rates(x, at_main, flow, k, out):
    """Add flap-back and dynamic inflow to the disc's rates in `out`, and fill their states' rates.

    flow is that of `rotor_flow`; `out` has the disc's rates without the two.
    """
    thrust, v_i, w_r, pitch = flow
    u_a, v_a, _ = at_main
    if k.terms.flap_back and k.flapping.flap_back == 0.0:
        flap_back_rates(x, u_a, v_a, v_i, w_r, pitch, k.main, k.flapping.rate, k.flap_back, out)
    if not k.terms.inflow:
        return
    v = x[PLANT.inflow]
    # More downwash on one side is a cyclic pitch of the blades there, at every radius alike.
    out[PLANT.a_s] += k.flapping.rate * v[1] / k.main.tip_speed
    out[PLANT.b_s] -= k.flapping.rate * v[2] / k.main.tip_speed
    # What turns the disc against its inertia is lift: on the left for a_s, at the rear for b_s.
    gain = 0.5 * k.rotor.thrust_slope / k.rotor.disc * k.main.tip_speed / k.flap_back.blade_rate
    left = gain * (out[PLANT.a_s] + x[PLANT.q] - k.flapping.a_bs * x[PLANT.b_s])
    rear = gain * (out[PLANT.b_s] + x[PLANT.p] - k.flapping.b_as * x[PLANT.a_s])
    speed = resultant_flow(v[0], thrust, w_r, u_a * u_a + v_a * v_a, k)
    loads = (2.0 * thrust / k.rotor.disc, -left, rear)
    rates = inflow_rates(v, (u_a, v_a), speed, loads, k.inflow)
    for i in range(3):
        out[PLANT.inflow.start + i] = rates[i]
