# SPDX-License-Identifier: Apache-2.0
"""Wind at one place: steady profile over altitude, Dryden turbulence, discrete and periodic gusts.

The steady wind follows a table, or the log law of MIL-F-8785C (3.7.3.2), given for 3 to 1000 ft,

    u(h) = W20 ln(h / z0) / ln(20 ft / z0),    z0 = 0.15 ft in Category C (terminal flight phases),
                                               2.0 ft in others,

which with that law depends on W20 alone, as turbulence and random gusts do.

Turbulence follows MIL-F-8785C, low altitude (10 to 1000 ft), in the components along the mean wind,
across it (to the right of where it blows) and down:

    sigma_w = 0.1 W20,  sigma_u = sigma_v = sigma_w / (0.177 + 0.000823 h)^0.4,
    L_w = h,            L_u = L_v = h / (0.177 + 0.000823 h)^1.2         (h, L in ft),
    H_u  = sigma sqrt(2 L / (pi V)) / (1 + L s / V),
    H_vw = sigma sqrt(L / (pi V)) (1 + sqrt(3) L s / V) / (1 + L s / V)^2.

V is the speed at which the frozen field passes the aircraft; near hover that is the mean wind speed
at its altitude, floored. In the time scale L/V the filters have no parameter and unit variance, so
the states are dimensionless, altitude and wind enter only through the step `V dt / L` and the scale
sigma, and the discretisation is exact for every step: transition matrix and noise covariance are
those of the continuous filter.

MIL-HDBK-1797 writes the Dryden spectra with twice the lengths, `sigma^2 2 L / (pi V) (1 + 12 x^2) /
(1 + 4 x^2)^2`, x = L w / V, and halves the lengths below 1000 ft: `2 L_w = h`, `L_u = 2 L_v`. So
both standards are one model here, rotational gusts (`air`) included.
"""

import math
from typing import NamedTuple

import numpy as np

from heli_dynamics_sim.gusts import GUST, RandomGusts, gusts_at
from heli_dynamics_sim.rigid_body import to_ned
from heli_dynamics_sim.state import attitude_of
from heli_math.arrays import scratch, scratch_matrix
from heli_math.jit import njit
from heli_math.multisine import fade_in_and_out, sines_at
from heli_math.rows import PLANT

FOOT_M = 0.3048
W20_ALTITUDE_M = 20.0 * FOOT_M
_SQRT3 = math.sqrt(3.0)
_LOWEST_FT, _HIGHEST_FT = 10.0, 1000.0
_N_GUST = GUST.size


class FilterState(NamedTuple):
    """State of the turbulence filters (5,), dimensionless: 1/(1 + s), and for H_vw 1/(1 + s)^2."""

    along: int = 0
    across: int = 1
    across_twice: int = 2
    down: int = 3
    down_twice: int = 4
    size: int = 5


FILTER = FilterState()


class SinesKernel(NamedTuple):
    """Periodic gusts that identification injects."""

    on: bool  # False: nothing is configured
    frequency_hz: np.ndarray  # (n,)
    amplitude_mps: np.ndarray  # (n, 3)
    phase_rad: np.ndarray  # (n, 3)
    start_s: float
    duration_s: float  # with both fades
    fade_s: float
    body: bool  # amplitudes in body axes instead of NED


class PlaceRow(NamedTuple):
    """Where the air is asked for (5)."""

    centre: int = 0  # the c.g.
    main: int = 1  # the main rotor's hub
    tail: int = 2  # the tail rotor
    front: int = 3  # ends of the fuselage
    rear: int = 4


PLACE = PlaceRow()


class PartsKernel(NamedTuple):
    """Which parts of the aircraft have air of their own, and where they are."""

    main: bool  # main rotor
    tail: bool  # tail rotor and fins
    fuselage: bool  # mean over its length
    any: bool
    places: np.ndarray  # (5, 3), rows PLACE: from the c.g., body axes, m
    needed: np.ndarray  # (5,) bool: rows of these
    reach: float  # of the farthest of them from the c.g., m


class WindKernel(NamedTuple):
    """What the wind is made of."""

    profile_altitude_m: np.ndarray  # (n,), rising
    profile_speed_mps: np.ndarray  # (n,)
    towards_rad: float  # direction the air moves to, clockwise from north
    turbulence: bool
    w20_mps: float  # steady wind at 20 ft
    airspeed_floor_mps: float  # least V
    gust_start_s: np.ndarray  # (m,)
    gust_duration_s: np.ndarray  # (m,)
    gust_amplitude_mps: np.ndarray  # (m, 3), peak velocity of the air
    gust_body: bool  # amplitudes in body axes instead of NED
    sines: SinesKernel
    log_profile: bool  # the log law instead of the table
    roughness_m: float  # z0 of the log law
    rotation: bool  # rotational gusts
    span_m: float  # b of the rotational gusts: diameter of the main rotor
    parts: PartsKernel
    random: RandomGusts
    downwind: tuple[float, float]  # unit vector of the wind's direction, north and east


@njit
def log_law(altitude_m, w20_mps, roughness_m):
    """Steady wind speed (m/s) by the log law; 0 at and below the roughness height."""
    h = min(altitude_m, _HIGHEST_FT * FOOT_M)
    if h <= roughness_m:
        return 0.0
    return w20_mps * math.log(h / roughness_m) / math.log(W20_ALTITUDE_M / roughness_m)


@njit
def mean_speed(altitude_m, k):
    """Steady wind speed (m/s) at an altitude (m): log law, or linear between a table's points."""
    if k.log_profile:
        return log_law(altitude_m, k.w20_mps, k.roughness_m)
    heights, speeds = k.profile_altitude_m, k.profile_speed_mps
    last = heights.shape[0] - 1
    if altitude_m <= heights[0]:
        return speeds[0]
    for i in range(last):
        if altitude_m < heights[i + 1]:
            share = (altitude_m - heights[i]) / (heights[i + 1] - heights[i])
            return speeds[i] + share * (speeds[i + 1] - speeds[i])
    return speeds[last]


@njit
def dryden_scales(altitude_m, w20_mps):
    """(sigma_u = sigma_v, sigma_w in m/s, L_u = L_v, L_w in m) at an altitude (m)."""
    h = min(max(altitude_m / FOOT_M, _LOWEST_FT), _HIGHEST_FT)
    base = 0.177 + 0.000823 * h
    sigma_w = 0.1 * w20_mps
    return sigma_w / base**0.4, sigma_w, h / base**1.2 * FOOT_M, h * FOOT_M


@njit
def first_order_step(x, h, n):
    """Exact step of the unit-variance filter 1/(1 + s) over the time h (in units of L/V)."""
    return math.exp(-h) * x + math.sqrt(-math.expm1(-2.0 * h)) * n


@njit
def second_order_covariance(h):
    """Covariance (q11, q12, q22) that white noise builds up in (1/(1+s), 1/(1+s)^2) over h."""
    if h < 0.05:
        # closed forms cancel here; integrals of s^j exp(-2 s), termwise
        q12, q22, power = 0.0, 0.0, 1.0
        for i in range(10):
            q12 += power * h ** (i + 2) / (i + 2)
            q22 += power * h ** (i + 3) / (i + 3)
            power *= -2.0 / (i + 1)
    else:
        decay = math.exp(-2.0 * h)
        q12 = 0.25 - decay * (2.0 * h + 1.0) / 4.0
        q22 = 0.25 - decay * (2.0 * h * h + 2.0 * h + 1.0) / 4.0
    return -0.5 * math.expm1(-2.0 * h), q12, q22


@njit
def second_order_step(x1, x2, h, n1, n2):
    """Exact step of the two states of the lateral filter over h; white noise of intensity 1."""
    q11, q12, q22 = second_order_covariance(h)
    l11 = math.sqrt(q11)
    l21 = q12 / l11
    l22 = math.sqrt(max(q22 - l21 * l21, 0.0))
    decay = math.exp(-h)
    return decay * x1 + l11 * n1, decay * (x2 + h * x1) + l21 * n1 + l22 * n2


@njit
def second_order_output(x1, x2):
    """Output of unit variance, (1 + sqrt(3) s)/(1 + s)^2, of the states of `second_order_step`."""
    return _SQRT3 * x1 + (1.0 - _SQRT3) * x2


@njit
def stationary_filter(noise, out):
    """Draw the filter states out (5,) from their stationary distribution; noise (5,) normals."""
    out[FILTER.along] = noise[FILTER.along]
    # covariance of a pair: [[1/2, 1/4], [1/4, 1/4]]
    for once, twice in ((FILTER.across, FILTER.across_twice), (FILTER.down, FILTER.down_twice)):
        out[once] = math.sqrt(0.5) * noise[once]
        out[twice] = math.sqrt(0.125) * (noise[once] + noise[twice])


@njit
def passing_speed(altitude_m, k):
    """Speed V (m/s) at which the frozen field passes the aircraft at an altitude (m)."""
    return max(mean_speed(altitude_m, k), k.airspeed_floor_mps)


@njit
def step_turbulence(x, altitude_m, dt_s, noise, k):
    """Carry the filter states x (5,) over dt_s at an altitude (m); noise (>= 5,) normals."""
    _, _, length_h, length_w = dryden_scales(altitude_m, k.w20_mps)
    path = dt_s * passing_speed(altitude_m, k)
    along, across, down = FILTER.along, FILTER.across, FILTER.down
    across_twice, down_twice = FILTER.across_twice, FILTER.down_twice
    x[along] = first_order_step(x[along], path / length_h, noise[along])
    x[across], x[across_twice] = second_order_step(
        x[across], x[across_twice], path / length_h, noise[across], noise[across_twice]
    )
    x[down], x[down_twice] = second_order_step(
        x[down], x[down_twice], path / length_w, noise[down], noise[down_twice]
    )


@njit
def injected_gust(x, time_s, k, out):
    """Velocity of the periodic gusts alone, NED, m/s: fills out (3,).

    Parameters
    ----------
    x : (42,) array
        Plant state: attitude, for amplitudes in body axes.
    time_s : float
        Flight time.
    k : SinesKernel
    """
    sines_at(time_s - k.start_s, k.frequency_hz, k.amplitude_mps, k.phase_rad, out)
    share = fade_in_and_out(time_s - k.start_s, k.duration_s, k.fade_s)
    g0, g1, g2 = share * out[0], share * out[1], share * out[2]
    if k.body:
        g0, g1, g2 = to_ned(attitude_of(x), g0, g1, g2)
    out[0], out[1], out[2] = g0, g1, g2


@njit
def turbulence_outputs(f):
    """Turbulence along, across, down in units of its sigma (3 floats), of filter states (5,)."""
    return (
        f[FILTER.along],
        second_order_output(f[FILTER.across], f[FILTER.across_twice]),
        second_order_output(f[FILTER.down], f[FILTER.down_twice]),
    )


@njit
def turbulence_sigmas(altitude_m, k):
    """Sigma (m/s) of the horizontal and of the vertical turbulence at an altitude (m)."""
    if not k.turbulence:
        return 0.0, 0.0
    sigma_h, sigma_w, _, _ = dryden_scales(altitude_m, k.w20_mps)
    return sigma_h, sigma_w


@njit
def air_velocity(turbulence, sigmas, altitude_m, x, time_s, k, drawn):
    """Velocity of the air at one place, NED, m/s (3 floats), without the periodic gusts.

    Parameters
    ----------
    turbulence : 3 floats
        Along, across, down, in units of sigma.
    sigmas : 2 floats
        Of `turbulence_sigmas`.
    altitude_m : float
        Of the place, for the mean wind.
    x, time_s, k, drawn
        As in `gusts_at`.
    """
    along = mean_speed(altitude_m, k) + sigmas[0] * turbulence[0]
    across, down = sigmas[0] * turbulence[1], sigmas[1] * turbulence[2]
    c, s = k.downwind
    g0, g1, g2 = gusts_at(x, time_s, k, drawn)
    return c * along - s * across + g0, s * along + c * across + g1, down + g2


@njit
def wind_at(filter_state, x, time_s, k, out):
    """Velocity of the air at the c.g. without random gusts, NED, m/s: fills out (3,).

    Parameters
    ----------
    filter_state : (5,) array
        Turbulence filter, places of `FILTER`.
    x : (42,) array
        Plant state: altitude, and attitude for gusts in body axes.
    time_s : float
        Flight time.
    k : WindKernel
    """
    altitude_m = -x[PLANT.down]
    outputs, sigmas = turbulence_outputs(filter_state), turbulence_sigmas(altitude_m, k)
    out[0], out[1], out[2] = air_velocity(
        outputs, sigmas, altitude_m, x, time_s, k, scratch_matrix(0, _N_GUST)
    )
    if k.sines.on:
        gust = scratch(3)
        injected_gust(x, time_s, k.sines, gust)
        for i in range(3):
            out[i] += gust[i]
