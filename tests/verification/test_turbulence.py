# SPDX-License-Identifier: Apache-2.0
"""Wind: Dryden turbulence as the plant makes it, its profile, discrete gusts.

Reference: MIL-F-8785C, low altitude (spectra, scales), written out here a second time. The air is
recorded at a fixed point of the plant's own tick loop. Tolerances are confidence bands of the
estimates: for 2000 s in CI, for 40 000 s nightly.
"""

import numpy as np
import pytest
from scipy.signal import welch
from scipy.stats import chi2

from heli_core.rows import MEAS

TICK_S = 0.01
SPEED = 5.0
LENGTHS = [2000.0, pytest.param(40_000.0, marks=pytest.mark.nightly)]
# Bound on a deviation in units of its standard error; the seeds are fixed.
SIGMAS = 3.5
FOOT = 0.3048


def standard(altitude_m, w20=SPEED):
    """sigma (3,), m/s, and L (3,), m: along, across, down."""
    h = altitude_m / FOOT
    base = 0.177 + 0.000823 * h
    sigma, length = 0.1 * w20 / base**0.4, h / base**1.2 * FOOT
    return np.array([sigma, sigma, 0.1 * w20]), np.array([length, length, altitude_m])


def spectrum(f, sigma, tau, axis):
    """One-sided density per hertz, (m/s)^2/Hz; tau = L/V."""
    w2 = (2.0 * np.pi * f * tau) ** 2
    if axis == 0:
        return 4.0 * sigma**2 * tau / (1.0 + w2)
    return 2.0 * sigma**2 * tau * (1.0 + 3.0 * w2) / (1.0 + w2) ** 2


def correlation(s, axis):
    """Autocorrelation at lag s (in units of L/V) that belongs to `spectrum`."""
    return np.exp(-s) if axis == 0 else (1.0 - 0.5 * s) * np.exp(-s)


def standard_error(seconds, tau, axis):
    """Of a sample variance, relative: sqrt(2 / N) with N = T / integral of rho^2."""
    s = np.linspace(0.0, 30.0, 30_001)
    width = 2.0 * tau * np.trapezoid(correlation(s, axis) ** 2, s)
    return np.sqrt(2.0 * width / seconds)


@pytest.fixture(scope="module")
def air(plant_config, record):
    """air(seconds, altitude): deviation from the mean wind along, across, down (n, 3), m/s."""
    kept = {}

    def build(seconds, altitude=10.0):
        if (seconds, altitude) not in kept:
            config = plant_config(
                wind__towards_deg=0.0,
                wind__profile_altitude_m=[0.0],
                wind__profile_speed_mps=[SPEED],
                initial__pos_ned_m=[0.0, 0.0, -altitude],
            )
            y = record(config, round(seconds / TICK_S), seed=11)
            kept[seconds, altitude] = y[:, MEAS.wind] - [SPEED, 0.0, 0.0]
        return kept[seconds, altitude]

    return build


@pytest.mark.parametrize("seconds", LENGTHS)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_density_lies_in_the_confidence_band_of_the_standard(air, seconds, axis):
    """PSD by Welch (Hann, half overlap) against the analytic spectrum, 0.05 to 5 Hz.

    Bands: chi-square with 1.89 degrees of freedom per segment (Welch 1967; the overlap costs 5.5 %)
    for single bins, of which 95 % +- 3.5 sigma lie in the 95 % band; and for averages over octaves
    at 99.9 %. Hann couples neighbours: a third fewer bins are independent.
    """
    wind, n_segment = air(seconds)[:, axis], 8192
    f, density = welch(wind, 1.0 / TICK_S, nperseg=n_segment)
    sigma, length = standard(10.0)
    analytic = spectrum(f, sigma[axis], length[axis] / SPEED, axis)
    dof = 1.89 * (2 * wind.size // n_segment - 1)
    ratio = density / analytic
    used = (f > 0.05) & (f < 5.0)
    low, high = chi2.ppf([0.025, 0.975], dof) / dof
    inside = ((ratio[used] > low) & (ratio[used] < high)).mean()
    spread = np.sqrt(0.95 * 0.05 / (used.sum() / 1.5))
    assert abs(inside - 0.95) < SIGMAS * spread
    for lower in 0.05 * 2.0 ** np.arange(6):
        octave = (f >= lower) & (f < 2.0 * lower)
        total = dof * octave.sum() / 1.5
        low, high = chi2.ppf([0.0005, 0.9995], total) / total
        assert low < ratio[octave].mean() < high, lower


@pytest.mark.parametrize("seconds", LENGTHS)
@pytest.mark.parametrize("altitude", [10.0, 60.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_variance_follows_the_profile_over_altitude(air, seconds, altitude, axis):
    """Variance at two altitudes; sigma^2 of the standard; 3.5 standard errors of the estimate."""
    sigma, length = standard(altitude)
    error = standard_error(seconds, length[axis] / SPEED, axis)
    mean_square = (air(seconds, altitude)[:, axis] ** 2).mean()
    assert abs(mean_square / sigma[axis] ** 2 - 1.0) < SIGMAS * error


@pytest.mark.parametrize("seconds", LENGTHS)
@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("lag", [0.5, 1.0])
def test_correlation_length_is_that_of_the_standard(air, seconds, axis, lag):
    """Autocorrelation at L/2V and L/V; exp(-s) and (1 - s/2) exp(-s); 3.5 standard errors."""
    wind = air(seconds)[:, axis]
    sigma, length = standard(10.0)
    tau = length[axis] / SPEED
    shift = round(lag * tau / TICK_S)
    coefficient = (wind[shift:] * wind[:-shift]).mean() / sigma[axis] ** 2
    error = standard_error(seconds, tau, axis)
    assert abs(coefficient - correlation(shift * TICK_S / tau, axis)) < SIGMAS * error


@pytest.mark.parametrize("seconds", LENGTHS)
def test_components_are_uncorrelated(air, seconds):
    """Along, across, down: no cross correlation; 3.5 standard errors of the slower one."""
    wind = air(seconds)
    coefficients = np.corrcoef(wind.T)[np.triu_indices(3, 1)]
    assert np.abs(coefficients).max() < SIGMAS * standard_error(
        seconds, standard(10.0)[1][0] / SPEED, 0
    )


def test_mean_wind_over_a_climb_is_the_profile(plant_config, record):
    """3 m/s up to 10 m growing to 5 m/s at 20 m, towards 225 deg; linear; 1e-12 m/s."""
    config = plant_config(wind__turbulence=False)
    y = record(config, 601, velocity_ned=(0.0, 0.0, -2.5))
    altitude = 10.0 + 2.5 * TICK_S * np.arange(601)
    speed = np.interp(altitude, [0.0, 10.0, 20.0], [3.0, 3.0, 5.0])
    wind, level = y[:, MEAS.wind], -np.sqrt(0.5) * np.outer(speed, [1.0, 1.0])
    assert wind[:, :2] == pytest.approx(level, abs=1e-12)
    assert (wind[:, 2] == 0.0).all()


def test_discrete_gust_is_one_minus_cosine(plant_config, record):
    """A gust of 4 m/s east and 1 m/s up over 2 s; A/2 (1 - cos 2 pi t/d), its integral A d / 2."""
    config = plant_config(
        wind__turbulence=False,
        wind__profile_speed_mps=[0.0, 0.0, 0.0],
        wind__gust__start_s=[1.0],
        wind__gust__duration_s=[2.0],
        wind__gust__amplitude_mps=[0.0, 4.0, -1.0],
    )
    y = record(config, 401)[:, MEAS.wind]
    t = np.clip(TICK_S * np.arange(401) - 1.0, 0.0, 2.0)
    shape = 0.5 * (1.0 - np.cos(np.pi * t))
    assert y == pytest.approx(np.outer(shape, [0.0, 4.0, -1.0]), abs=1e-12)
    assert y.max(axis=0) == pytest.approx([0.0, 4.0, 0.0], abs=1e-12)
    assert y.sum(axis=0) * TICK_S == pytest.approx([0.0, 4.0, -1.0], abs=1e-12)
