# SPDX-License-Identifier: Apache-2.0
"""Frame conversions, the only place of the stack where they are made.

Inside the cores: NED (north, east, down) and FRD (forward, right, down), as in the paper. On
topics: ENU (east, north, up) and FLU (forward, left, up), REP-103 and REP-105. Every function says
in its name what goes in and what comes out; a vector's output array may be the input itself.

Where only axes swap or change sign no bit is lost.
"""

import math
from typing import NamedTuple

import numpy as np

from heli_core.jit import njit, scratch
from heli_core.ticks import LATITUDE_DEG, LONGITUDE_DEG

WGS84_A_M = 6378137.0
WGS84_F = 1.0 / 298.257223563
_E2 = WGS84_F * (2.0 - WGS84_F)
_SQRT_HALF = math.sqrt(0.5)

R_ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
"""Rotation matrix NED -> ENU; its own inverse."""


@njit
def ned_to_enu(v_ned, v_enu):
    """World vector NED (3,) -> ENU (3,), any unit, into `v_enu`."""
    north, east, down = v_ned[0], v_ned[1], v_ned[2]
    v_enu[0] = east
    v_enu[1] = north
    v_enu[2] = -down


@njit
def enu_to_ned(v_enu, v_ned):
    """World vector ENU (3,) -> NED (3,), any unit, into `v_ned`."""
    east, north, up = v_enu[0], v_enu[1], v_enu[2]
    v_ned[0] = north
    v_ned[1] = east
    v_ned[2] = -up


@njit
def frd_to_flu(v_frd, v_flu):
    """Body vector FRD (3,) -> FLU (3,), any unit, into `v_flu`."""
    v_flu[0] = v_frd[0]
    v_flu[1] = -v_frd[1]
    v_flu[2] = -v_frd[2]


@njit
def flu_to_frd(v_flu, v_frd):
    """Body vector FLU (3,) -> FRD (3,), any unit, into `v_frd`."""
    v_frd[0] = v_flu[0]
    v_frd[1] = -v_flu[1]
    v_frd[2] = -v_flu[2]


@njit
def quat_ned_frd_to_enu_flu(q_nb, q_xyzw):
    """Attitude FRD -> NED (w, x, y, z) becomes FLU -> ENU (**x, y, z, w**), as messages have it.

    The product q(NED->ENU) q_nb q(FLU->FRD) written out, q(NED->ENU) = (0, 1, 1, 0)/sqrt(2),
    q(FLU->FRD) = (0, 1, 0, 0); the common sign is chosen so that the map is its own inverse.
    """
    w, x, y, z = q_nb[0], q_nb[1], q_nb[2], q_nb[3]
    q_xyzw[3] = (w + z) * _SQRT_HALF
    q_xyzw[0] = (x + y) * _SQRT_HALF
    q_xyzw[1] = (x - y) * _SQRT_HALF
    q_xyzw[2] = (w - z) * _SQRT_HALF


@njit
def quat_enu_flu_to_ned_frd(q_xyzw, q_nb):
    """Attitude FLU -> ENU (4,) x, y, z, w becomes FRD -> NED (4,) w, x, y, z."""
    w, x, y, z = q_xyzw[3], q_xyzw[0], q_xyzw[1], q_xyzw[2]
    q_nb[0] = (w + z) * _SQRT_HALF
    q_nb[1] = (x + y) * _SQRT_HALF
    q_nb[2] = (x - y) * _SQRT_HALF
    q_nb[3] = (w - z) * _SQRT_HALF


class Datum(NamedTuple):
    """Origin of the local tangent plane, with what is computed once. Build it with `datum`."""

    lat_deg: float
    lon_deg: float
    alt_m: float
    sin_lat: float
    cos_lat: float
    radius_m: float


def datum(lat_deg: float, lon_deg: float, alt_m: float) -> Datum:
    """Origin of the local tangent plane.

    Parameters
    ----------
    lat_deg, lon_deg : float
        WGS84, deg; bounds in `heli_core.ticks`.
    alt_m : float
        Height above the WGS84 ellipsoid, m.

    Raises
    ------
    ValueError
        Outside of these bounds.
    """
    inside = abs(lat_deg) <= LATITUDE_DEG and abs(lon_deg) <= LONGITUDE_DEG
    if not (inside and math.isfinite(alt_m)):
        raise ValueError(
            f"datum ({lat_deg}, {lon_deg}, {alt_m}) is not allowed: latitude within "
            f"{LATITUDE_DEG:g} deg, longitude within {LONGITUDE_DEG:g} deg, finite altitude"
        )
    sin_lat = math.sin(math.radians(lat_deg))
    cos_lat = math.cos(math.radians(lat_deg))
    radius_m = WGS84_A_M / math.sqrt(1.0 - _E2 * sin_lat * sin_lat)
    return Datum(lat_deg, lon_deg, alt_m, sin_lat, cos_lat, radius_m)


@njit
def _tangent_ned(dlat, dlon, dalt, d, out):
    """NED (3,), m, of latitude, longitude (rad) and height (m) relative to the datum.

    The difference of two earth-centred vectors, resolved along the datum's axes, with every
    difference of large numbers taken analytically, so that nothing cancels.
    """
    lat0 = math.radians(d.lat_deg)
    sin_lat, cos_lat = math.sin(lat0 + dlat), math.cos(lat0 + dlat)
    half = math.sin(0.5 * dlat)
    dsin = 2.0 * math.cos(lat0 + 0.5 * dlat) * half
    dcos = -2.0 * math.sin(lat0 + 0.5 * dlat) * half
    root = math.sqrt(1.0 - _E2 * sin_lat * sin_lat)
    root0 = math.sqrt(1.0 - _E2 * d.sin_lat * d.sin_lat)
    dsquare = _E2 * dsin * (sin_lat + d.sin_lat)
    dradius = WGS84_A_M * dsquare / (root * root0 * (root + root0))
    r0 = d.radius_m + d.alt_m
    dr = dradius + dalt
    z0 = d.radius_m * (1.0 - _E2) + d.alt_m
    dz = dradius * (1.0 - _E2) + dalt
    half_lon = math.sin(0.5 * dlon)
    outward = dr * cos_lat + r0 * dcos - 2.0 * (r0 + dr) * cos_lat * half_lon * half_lon
    polar = dz * sin_lat + z0 * dsin
    out[0] = -d.sin_lat * outward + d.cos_lat * polar
    out[1] = (r0 + dr) * cos_lat * math.sin(dlon)
    out[2] = -(d.cos_lat * outward + d.sin_lat * polar)


@njit
def geodetic_to_ned(geodetic, d, pos_ned_m):
    """Latitude, longitude (deg), height (m) (3,) -> NED (3,), m, about the datum `d`."""
    dlon_deg = geodetic[1] - d.lon_deg
    if dlon_deg > 180.0:
        dlon_deg -= 360.0
    elif dlon_deg < -180.0:
        dlon_deg += 360.0
    dlat = math.radians(geodetic[0] - d.lat_deg)
    _tangent_ned(dlat, math.radians(dlon_deg), geodetic[2] - d.alt_m, d, pos_ned_m)


@njit
def ned_to_geodetic(pos_ned_m, d, geodetic):
    """NED (3,), m, about the datum `d` -> latitude, longitude (deg), height (m) (3,).

    Fixed-point iteration on `geodetic_to_ned`; the factor is about distance/earth radius, so a few
    rounds reach rounding error within tens of kilometres.
    """
    north, east, down = pos_ned_m[0], pos_ned_m[1], pos_ned_m[2]
    meridian = d.radius_m * (1.0 - _E2) / (1.0 - _E2 * d.sin_lat * d.sin_lat) + d.alt_m
    parallel = (d.radius_m + d.alt_m) * d.cos_lat
    dlat, dlon, dalt = 0.0, 0.0, 0.0
    reached = scratch(3)
    for _ in range(30):
        _tangent_ned(dlat, dlon, dalt, d, reached)
        miss_n, miss_e, miss_d = north - reached[0], east - reached[1], down - reached[2]
        dlat += miss_n / meridian
        dlon += miss_e / parallel
        dalt -= miss_d
        if abs(miss_n) + abs(miss_e) + abs(miss_d) < 1e-12:
            break
    lon = d.lon_deg + math.degrees(dlon)
    if lon > 180.0:
        lon -= 360.0
    elif lon < -180.0:
        lon += 360.0
    geodetic[0] = d.lat_deg + math.degrees(dlat)
    geodetic[1] = lon
    geodetic[2] = d.alt_m + dalt
