# SPDX-License-Identifier: Apache-2.0
"""The air at main rotor, tail and fuselage: a frozen field that moves past, and how it turns.

**Places.** The turbulence that the filters of `wind` make is laid down along the wind's path, and a
part at `d` metres downwind of the c.g. meets what the c.g. met `d` metres of path before (Taylor's
frozen field, which the spectra assume, too). Parts upwind of the c.g. meet it earlier: so the field
is made as far upwind as the farthest part reaches. Between ticks the field is linear, which costs
at most `1 - cos^2(pi f 10 ms)` of the density: 2.4 % at 5 Hz, at the parts, when they are on.
Discrete gusts arrive `d / V` later. The mean wind is that at each part's height; sigma changes too
little over an aircraft (1e-3) to be told apart. The fuselage meets the mean over its length
(Simpson). Across the wind the field does not change: an aircraft that stands across it meets the
same air at its tail, but for the rotational gust below. The aircraft's own way through the field
is neglected, as in `wind`.

**Rotational gusts** of MIL-F-8785C (3.7.1.2), which stand for the air's gradient over the span b,
here the diameter of the main rotor; in wind axes (along, right, down), V and L as in `wind`,

    Phi_p = sigma_w^2 / (V L_w) 0.8 (pi L_w / 4b)^(1/3) / (1 + (4 b o / pi V)^2),
    Phi_q = (o / V)^2 / (1 + (4 b o / pi V)^2) Phi_w,
    Phi_r = (o / V)^2 / (1 + (3 b o / pi V)^2) Phi_v,      o: angular frequency.

p has noise of its own; q and r are high passes of w and v, `q = (w - w_lag) pi / 4b` with w_lag the
first-order lag of w, exact for an input that is linear during a tick. Signs are those of the frozen
field that blows along +x: `q = -dw/dx`, `r = dv/dx`. p and q tilt the rotor's disc (`helicopter`).
At the tail the rotation adds `w = p y - q x`, `v = r x`; where the tail has air of its own, p
alone, for the field brings the other two.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_dynamics_sim.gusts import draw_gusts, gusts_at
from heli_dynamics_sim.noise import NOISE
from heli_dynamics_sim.rigid_body import to_body, to_ned
from heli_dynamics_sim.state import attitude_of
from heli_dynamics_sim.wind import (
    FILTER,
    PLACE,
    WindKernel,
    air_velocity,
    dryden_scales,
    first_order_step,
    injected_gust,
    mean_speed,
    passing_speed,
    stationary_filter,
    step_turbulence,
    turbulence_outputs,
    turbulence_sigmas,
)
from heli_math.arrays import scratch
from heli_math.jit import njit
from heli_math.rows import AIR, PLANT

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


class AirState(NamedTuple):
    """Where the turbulence is; the arrays are changed in place."""

    filter: np.ndarray  # (5,) places of `wind.FILTER`
    turn: np.ndarray  # (3,) places of TURN
    field: np.ndarray  # (n, 7) ring of rows FIELD, one per tick
    newest: np.ndarray  # (2,) int64: index of the newest row, number of rows laid down
    gusts: np.ndarray  # (m, 5) random gusts, rows `gusts.GUST`
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
    k : WindKernel
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


def run_in_ticks(k: WindKernel, altitude_m: float, tick_s: float) -> int:
    """Ticks that the turbulence runs before the start: field and lags reach back so far."""
    if not has_field(k):
        return 0
    path_m = 2.0 * k.parts.reach + _SETTLED * 4.0 * k.span_m / math.pi
    return math.ceil(path_m / (tick_s * passing_speed(altitude_m, k))) + 1


def initial_air(
    k: WindKernel, altitude_m: float, rows: NDArray[np.float64], seed: int, tick_s: float
) -> AirState:
    """Turbulence from its stationary distribution, and a flight's random gusts.

    Parameters
    ----------
    k : WindKernel
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
    k : WindKernel
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
