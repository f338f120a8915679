# SPDX-License-Identifier: Apache-2.0
"""Standard atmosphere, troposphere (ICAO Doc 7488): pressure and pressure altitude."""

from heli_core.jit import njit

SEA_LEVEL_PRESSURE_PA = 101325.0
SEA_LEVEL_TEMPERATURE_K = 288.15
LAPSE_RATE_K_PER_M = 0.0065
# g0 / (R_air * lapse rate) with g0 = 9.80665 m/s2 and R_air = 287.05287 J/(kg K)
EXPONENT = 9.80665 / (287.05287 * LAPSE_RATE_K_PER_M)


@njit
def pressure_pa(altitude_m):
    """Static pressure (Pa) at the pressure altitude altitude_m (m, 0..11000)."""
    ratio = 1.0 - LAPSE_RATE_K_PER_M * altitude_m / SEA_LEVEL_TEMPERATURE_K
    return SEA_LEVEL_PRESSURE_PA * ratio**EXPONENT


@njit
def altitude_m(pressure):
    """Pressure altitude (m) of the static pressure (Pa)."""
    ratio = (pressure / SEA_LEVEL_PRESSURE_PA) ** (1.0 / EXPONENT)
    return SEA_LEVEL_TEMPERATURE_K / LAPSE_RATE_K_PER_M * (1.0 - ratio)
