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
from numpy.typing import NDArray

from heli_core.jit import by_reference, njit, scratch, scratch_matrix
from heli_core.rows import AIR, PLANT
from heli_core.signals import fade_in_and_out, sines_at
from heli_dynamics_sim.airframe import attitude_of, to_body, to_ned
from heli_dynamics_sim.noise import NOISE, gust_generator

# -------------------------------------------------------------------------------------------------
# Discrete 1-cosine gusts: at given times, and at random ones drawn once per flight.
#
# The shape is the discrete gust of MIL-F-8785C (3.7.1.3), run up to its peak and down again.
# Random
# gusts come one after the other: the pauses between them are exponentially distributed; length,
# peak
# and direction are uniform in their ranges. The peak is given as a share of W20, so that it grows
# with the wind.
# -------------------------------------------------------------------------------------------------


@by_reference
class RandomGusts(NamedTuple):
    """What random gusts are drawn from."""

    rate_per_min: float  # gusts per minute of pause; 0: none
    least_share: float  # of W20, peak of the velocity
    most_share: float
    least_s: float  # length
    most_s: float
    spread_rad: float  # largest angle between a gust and the mean wind
    until_s: float  # the last one starts before


class GustRow(NamedTuple):
    """A random gust (5,)."""

    start: int = 0  # flight time at the c.g., s
    duration: int = 1  # s
    peak: slice = slice(2, 5)  # velocity of the air, NED, m/s
    size: int = 5


GUST = GustRow()


def draw_gusts(
    seed: int, k: RandomGusts, w20_mps: float, towards_rad: float
) -> NDArray[np.float64]:
    """Random gusts of a flight, in the order of their starts.

    Parameters
    ----------
    seed : int
        Of the flight; the gusts have a stream of their own.
    k : RandomGusts
    w20_mps : float
        Wind at 20 ft.
    towards_rad : float
        Direction the mean wind blows to, clockwise from north.

    Returns
    -------
    (m, 5) array
        One row `GUST` per gust; none if the rate is 0. They do not overlap.
    """
    rows: list[list[float]] = []
    rng, time_s = gust_generator(seed), 0.0
    while k.rate_per_min > 0.0:
        time_s += rng.exponential(60.0 / k.rate_per_min)
        if time_s >= k.until_s:
            break
        duration_s = rng.uniform(k.least_s, k.most_s)
        peak_mps = w20_mps * rng.uniform(k.least_share, k.most_share)
        angle = towards_rad + rng.uniform(-k.spread_rad, k.spread_rad)
        peak = [peak_mps * math.cos(angle), peak_mps * math.sin(angle), 0.0]
        rows.append([time_s, duration_s, *peak])
        time_s += duration_s
    return np.array(rows, dtype=np.float64).reshape(-1, GUST.size)


@njit
def gust_shape(time_s, start_s, duration_s):
    """1-cosine gust, 0 to 1 and back to 0 within its duration."""
    phase = (time_s - start_s) / duration_s
    if phase <= 0.0 or phase >= 1.0:
        return 0.0
    return 0.5 * (1.0 - math.cos(2.0 * math.pi * phase))


@njit
def _last_started(time_s, drawn):
    """Index of the last random gust that began before time_s, -1: none."""
    before, after = -1, drawn.shape[0]
    while after - before > 1:
        middle = (before + after) // 2
        if drawn[middle, GUST.start] < time_s:
            before = middle
        else:
            after = middle
    return before


@njit
def gusts_at(x, time_s, k, drawn):
    """Velocity (3 floats) of all discrete gusts, NED, m/s.

    Parameters
    ----------
    x : (PLANT.size,) array
        Plant state: attitude, for gusts in body axes.
    time_s : float
        Flight time.
    k : WindParams
        The gusts at given times.
    drawn : (m, 5) array
        Random gusts, rows `GUST`.
    """
    g0, g1, g2 = 0.0, 0.0, 0.0
    for i in range(k.gust_start_s.shape[0]):
        shape = gust_shape(time_s, k.gust_start_s[i], k.gust_duration_s[i])
        g0 += shape * k.gust_amplitude_mps[i, 0]
        g1 += shape * k.gust_amplitude_mps[i, 1]
        g2 += shape * k.gust_amplitude_mps[i, 2]
    if k.gust_body:
        g0, g1, g2 = to_ned(attitude_of(x), g0, g1, g2)
    i = _last_started(time_s, drawn)
    if i >= 0:
        shape = gust_shape(time_s, drawn[i, GUST.start], drawn[i, GUST.duration])
        peak = drawn[i, GUST.peak]
        g0, g1, g2 = g0 + shape * peak[0], g1 + shape * peak[1], g2 + shape * peak[2]
    return g0, g1, g2


# -------------------------------------------------------------------------------------------------
# Wind.
# -------------------------------------------------------------------------------------------------

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


@by_reference
class SinesParams(NamedTuple):
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


@by_reference
class PartsParams(NamedTuple):
    """Which parts of the aircraft have air of their own, and where they are."""

    main: bool  # main rotor
    tail: bool  # tail rotor and fins
    fuselage: bool  # mean over its length
    any: bool
    places: np.ndarray  # (5, 3), rows PLACE: from the c.g., body axes, m
    needed: np.ndarray  # (5,) bool: rows of these
    reach: float  # of the farthest of them from the c.g., m


@by_reference
class WindParams(NamedTuple):
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
    sines: SinesParams
    log_profile: bool  # the log law instead of the table
    roughness_m: float  # z0 of the log law
    rotation: bool  # rotational gusts
    span_m: float  # b of the rotational gusts: diameter of the main rotor
    parts: PartsParams
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
    k : SinesParams
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
    k : WindParams
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


# -------------------------------------------------------------------------------------------------
# The air at main rotor, tail and fuselage: a frozen field that moves past, and how it turns.
#
# **Places.** The turbulence that the filters of `wind` make is laid down along the wind's path,
# and a
# part at `d` metres downwind of the c.g. meets what the c.g. met `d` metres of path before
# (Taylor's
# frozen field, which the spectra assume, too). Parts upwind of the c.g. meet it earlier: so the
# field
# is made as far upwind as the farthest part reaches. Between ticks the field is linear, which
# costs
# at most `1 - cos^2(pi f 10 ms)` of the density: 2.4 % at 5 Hz, at the parts, when they are on.
# Discrete gusts arrive `d / V` later. The mean wind is that at each part's height; sigma changes
# too
# little over an aircraft (1e-3) to be told apart. The fuselage meets the mean over its length
# (Simpson). Across the wind the field does not change: an aircraft that stands across it meets the
# same air at its tail, but for the rotational gust below. The aircraft's own way through the field
# is neglected, as in `wind`.
#
# **Rotational gusts** of MIL-F-8785C (3.7.1.2), which stand for the air's gradient over the span
# b,
# here the diameter of the main rotor; in wind axes (along, right, down), V and L as in `wind`,
#
#     Phi_p = sigma_w^2 / (V L_w) 0.8 (pi L_w / 4b)^(1/3) / (1 + (4 b o / pi V)^2),
#     Phi_q = (o / V)^2 / (1 + (4 b o / pi V)^2) Phi_w,
#     Phi_r = (o / V)^2 / (1 + (3 b o / pi V)^2) Phi_v,      o: angular frequency.
#
# p has noise of its own; q and r are high passes of w and v, `q = (w - w_lag) pi / 4b` with w_lag
# the
# first-order lag of w, exact for an input that is linear during a tick. Signs are those of the
# frozen
# field that blows along +x: `q = -dw/dx`, `r = dv/dx`. p and q tilt the rotor's disc
# (`helicopter`).
# At the tail the rotation adds `w = p y - q x`, `v = r x`; where the tail has air of its own, p
# alone, for the field brings the other two.
# -------------------------------------------------------------------------------------------------

# Lags of the rotational gusts are stationary after so many of their lengths.
_SETTLED = 6.0


class TurnState(NamedTuple):
    """State of the rotational gusts (3,), in units of the turbulence's sigma."""

    roll: int = 0
    across_lag: int = 1
    down_lag: int = 2
    size: int = 3


class FieldRow(NamedTuple):
    """The field at a point of its path (7,), in units of sigma."""

    path: int = 0  # m
    along: int = 1
    across: int = 2
    down: int = 3
    roll: int = 4
    across_less_lag: int = 5
    down_less_lag: int = 6
    size: int = 7


TURN = TurnState()
FIELD = FieldRow()
_N_FIELD = FIELD.size


@by_reference
class AirState(NamedTuple):
    """Where the turbulence is; the arrays are changed in place."""

    filter: np.ndarray  # (5,) places of `wind.FILTER`
    turn: np.ndarray  # (3,) places of TURN
    field: np.ndarray  # (n, 7) ring of rows FIELD, one per tick
    newest: np.ndarray  # (2,) int64: index of the newest row, number of rows laid down
    gusts: np.ndarray  # (m, 5) random gusts, rows `wind.GUST`
    velocity: np.ndarray  # (5, 3) scratch: the air at the rows of `wind.PLACE`


@njit
def has_field(k):
    """Whether the field is laid down: a part has air of its own, or the air turns."""
    return k.turbulence and (k.parts.any or k.rotation)


@njit
def _lay_down(s, path_m, k):
    """Put the filters' present outputs path_m behind the row before."""
    row = (s.newest[0] + 1) % s.field.shape[0]
    before = s.field[s.newest[0], FIELD.path]
    along, across, down = turbulence_outputs(s.filter)
    at = s.field[row]
    at[FIELD.path] = before + path_m
    at[FIELD.along], at[FIELD.across], at[FIELD.down] = along, across, down
    at[FIELD.roll] = s.turn[TURN.roll]
    at[FIELD.across_less_lag] = across - s.turn[TURN.across_lag]
    at[FIELD.down_less_lag] = down - s.turn[TURN.down_lag]
    s.newest[0] = row
    s.newest[1] = min(s.newest[1] + 1, s.field.shape[0])


@njit
def lag_step(lag, before, after, h):
    """First-order lag over h time constants; its input goes linearly from before to after."""
    rise = -math.expm1(-h)
    late = 1.0 - rise / h
    return lag + rise * (before - lag) + late * (after - before)


@njit
def step_air(s, altitude_m, dt_s, noise_row, k):
    """Carry the turbulence over dt_s at an altitude (m).

    Parameters
    ----------
    s : AirState
    altitude_m, dt_s : float
    noise_row : (NOISE.size,) array
        Standard normals, places of `noise.NOISE`.
    k : WindParams
    """
    _, across_before, down_before = turbulence_outputs(s.filter)
    step_turbulence(s.filter, altitude_m, dt_s, noise_row[NOISE.wind], k)
    if not has_field(k):
        return
    _, across, down = turbulence_outputs(s.filter)
    path = dt_s * passing_speed(altitude_m, k)
    vertical, lateral = math.pi * path / (4.0 * k.span_m), math.pi * path / (3.0 * k.span_m)
    turn = s.turn
    turn[TURN.roll] = first_order_step(turn[TURN.roll], vertical, noise_row[NOISE.turn])
    turn[TURN.across_lag] = lag_step(turn[TURN.across_lag], across_before, across, lateral)
    turn[TURN.down_lag] = lag_step(turn[TURN.down_lag], down_before, down, vertical)
    _lay_down(s, path, k)


@njit
def _run_in(s, altitude_m, tick_s, rows, k):
    for i in range(rows.shape[0]):
        step_air(s, altitude_m, tick_s, rows[i], k)


def run_in_ticks(k: WindParams, altitude_m: float, tick_s: float) -> int:
    """Ticks that the turbulence runs before the start: field and lags reach back so far."""
    if not has_field(k):
        return 0
    path_m = 2.0 * k.parts.reach + _SETTLED * 4.0 * k.span_m / math.pi
    return math.ceil(path_m / (tick_s * passing_speed(altitude_m, k))) + 1


def initial_air(
    k: WindParams, altitude_m: float, rows: NDArray[np.float64], seed: int, tick_s: float
) -> AirState:
    """Turbulence from its stationary distribution, and a flight's random gusts.

    Parameters
    ----------
    k : WindParams
    altitude_m : float
    rows : (1 + run_in_ticks, NOISE.size) array
        Standard normals.
    seed : int
    tick_s : float
    """
    slots = 2
    if has_field(k):
        slots += math.ceil(2.0 * k.parts.reach / (k.airspeed_floor_mps * tick_s))
    s = AirState(
        np.zeros(FILTER.size),
        np.zeros(TURN.size),
        np.zeros((slots, FIELD.size)),
        np.zeros(2, dtype=np.int64),
        draw_gusts(seed, k.random, k.w20_mps, k.towards_rad),
        np.zeros((len(PLACE), 3)),
    )
    stationary_filter(rows[0, NOISE.wind], s.filter)
    if has_field(k):
        s.turn[TURN.roll] = rows[0, NOISE.turn]
        _, s.turn[TURN.across_lag], s.turn[TURN.down_lag] = turbulence_outputs(s.filter)
        _lay_down(s, 0.0, k)
        _run_in(s, altitude_m, tick_s, rows[1:], k)
    return s


@njit
def field_behind(s, behind_m, out):
    """The field so many metres of path behind the newest row, into a row FIELD (7,)."""
    rows, newest = s.field, s.newest[0]
    n = rows.shape[0]
    path = rows[newest, FIELD.path] - behind_m
    young, old = 0, s.newest[1] - 1  # ages, in ticks, of the rows around the path
    spacing = rows[newest, FIELD.path] - rows[newest - 1, FIELD.path]  # -1 is the ring's end
    middle = min(int(behind_m / spacing), old - 1)  # the wind has been steady, or nearly
    while old - young > 1:
        if rows[(newest - middle) % n, FIELD.path] >= path:
            young = middle
            middle += 1
        else:
            old = middle
            middle -= 1
        middle = min(max(middle, young + 1), old - 1)
    a, b = rows[(newest - young) % n], rows[(newest - old) % n]
    share = (a[FIELD.path] - path) / (a[FIELD.path] - b[FIELD.path])
    for i in range(out.shape[0]):
        out[i] = a[i] + share * (b[i] - a[i])


class Passage(NamedTuple):
    """How the field passes the aircraft at a tick."""

    speed: float  # V, m/s
    sigmas: tuple[float, float]  # of `turbulence_sigmas`, m/s


@njit
def _velocities(s, x, time_s, passage, k):
    """Fill the rows of s.velocity that are needed: the air at `parts.places`, NED, m/s."""
    parts, attitude, (c, e) = k.parts, attitude_of(x), k.downwind
    sigma_h, sigma_w = passage.sigmas
    f = scratch(_N_FIELD)
    for i in range(parts.places.shape[0]):
        if not parts.needed[i]:
            continue
        place, out = parts.places[i], s.velocity[i]
        north, east, down = to_ned(attitude, place[0], place[1], place[2])
        downwind = c * north + e * east
        along, across, sinking = mean_speed(-x[PLANT.down] - down, k), 0.0, 0.0
        if k.turbulence:
            field_behind(s, parts.reach + downwind, f)
            along += sigma_h * f[FIELD.along]
            across, sinking = sigma_h * f[FIELD.across], sigma_w * f[FIELD.down]
        g0, g1, g2 = gusts_at(x, time_s - downwind / passage.speed, k, s.gusts)
        out[0], out[1] = c * along - e * across + g0, e * along + c * across + g1
        out[2] = sinking + g2


@njit
def roll_gust_sigma(sigma_w_mps, length_w_m, span_m):
    """Standard deviation (rad/s) of the rotational gust about the wind's axis: of Phi_p."""
    ratio = math.pi * length_w_m / (4.0 * span_m)
    variance = 0.1 * math.pi**2 * ratio ** (1.0 / 3.0) / (length_w_m * span_m)
    return sigma_w_mps * math.sqrt(variance)


@njit
def _turning(s, x, air, passage, k):
    """Fill the rates of the row air, and add what they make at the tail to it."""
    sigma_h, sigma_w = passage.sigmas
    _, _, _, length_w = dryden_scales(-x[PLANT.down], k.w20_mps)
    f = scratch(_N_FIELD)
    field_behind(s, k.parts.reach, f)
    p = roll_gust_sigma(sigma_w, length_w, k.span_m) * f[FIELD.roll]
    q = sigma_w * f[FIELD.down_less_lag] * math.pi / (4.0 * k.span_m)
    r = -sigma_h * f[FIELD.across_less_lag] * math.pi / (3.0 * k.span_m)
    cos, sin = k.downwind
    attitude = attitude_of(x)
    rates = air[AIR.rates]
    rates[0], rates[1], rates[2] = to_body(attitude, cos * p - sin * q, sin * p + cos * q, r)
    place = k.parts.places[PLACE.tail]
    north, east, _ = to_ned(attitude, place[0], place[1], place[2])
    along, right = cos * north + sin * east, cos * east - sin * north
    across, down = 0.0, p * right
    if not k.parts.tail:
        across, down = r * along, down - q * along
    tail = air[AIR.tail]
    tail[0], tail[1], tail[2] = tail[0] - sin * across, tail[1] + cos * across, tail[2] + down


@njit
def air_at(s, x, time_s, k, air):
    """What the air does at the aircraft: fills the row air (12,), places of `rows.AIR`.

    With no part that has air of its own and no rotational gusts, all parts meet `wind.wind_at` and
    the random gusts.

    Parameters
    ----------
    s : AirState
    x : (PLANT.size,) array
        Plant state: position and attitude.
    time_s : float
        Flight time.
    k : WindParams
    air : (12,) array
    """
    parts, altitude = k.parts, -x[PLANT.down]
    main, tail, fuselage = air[AIR.main], air[AIR.tail], air[AIR.fuselage]
    passage = Passage(passing_speed(altitude, k), turbulence_sigmas(altitude, k))
    v = s.velocity
    if parts.any or has_field(k):
        _velocities(s, x, time_s, passage, k)
    else:
        v[PLACE.centre, 0], v[PLACE.centre, 1], v[PLACE.centre, 2] = air_velocity(
            turbulence_outputs(s.filter), passage.sigmas, altitude, x, time_s, k, s.gusts
        )
    for i in range(3):
        centre = v[PLACE.centre, i]
        main[i] = v[PLACE.main, i] if parts.main else centre
        tail[i] = v[PLACE.tail, i] if parts.tail else centre
        fuselage[i] = centre
        if parts.fuselage:
            fuselage[i] = (v[PLACE.front, i] + 4.0 * centre + v[PLACE.rear, i]) / 6.0
    if k.rotation and k.turbulence:
        _turning(s, x, air, passage, k)
    if k.sines.on:
        gust = scratch(3)
        injected_gust(x, time_s, k.sines, gust)
        for i in range(3):
            main[i] += gust[i]
            tail[i] += gust[i]
            fuselage[i] += gust[i]
