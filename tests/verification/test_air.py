# SPDX-License-Identifier: Apache-2.0
"""The air at the parts of the aircraft: rotational gusts, frozen field, log profile, random gusts.

References: MIL-F-8785C and MIL-HDBK-1797 (spectra and log law, written out here from the formulas
as the MathWorks' Dryden and Wind Shear blocks print them), Taylor's frozen field, Bramwell's
flapping equation. The air is recorded at an aircraft that is held level at 10 m, the wind blowing
north. Tolerances are confidence bands, as in `test_turbulence`.
"""

import numpy as np
import pytest
from scipy.signal import csd, welch
from scipy.stats import chi2, expon, kstest, uniform

from heli_core.jit import copy, njit
from heli_core.rows import AIR, MEAS
from heli_dynamics_sim import plant
from heli_dynamics_sim.airframe import make_state
from heli_dynamics_sim.helicopter import disc_tilt_of_gust
from heli_dynamics_sim.noise import NoiseStreams
from heli_dynamics_sim.wind import GUST, RandomGusts, draw_gusts

TICK_S = 0.01
SPEED = 5.0
LENGTHS = [2000.0, pytest.param(10_000.0, marks=pytest.mark.nightly)]
SIGMAS = 3.5
FOOT = 0.3048
SPAN = 2.0 * 0.705
ARM = 1.035
N_SEGMENT = 8192


def low_altitude(standard):
    """(sigma_v, sigma_w in m/s, L_v, L_w in m) of a standard at 10 m, W20 = SPEED."""
    h = 10.0 / FOOT
    base = 0.177 + 0.000823 * h
    sigma, length = 0.1 * SPEED / base**0.4, h / base**1.2 * FOOT
    half = 1.0 if standard == "8785C" else 0.5  # 1797: 2 L_v = L_u, 2 L_w = h
    return sigma, 0.1 * SPEED, half * length, half * 10.0


def transverse(omega, sigma, length, standard):
    """Phi_v or Phi_w, one-sided in rad/s, as the standard prints it."""
    x2 = (length * omega / SPEED) ** 2
    if standard == "8785C":
        return sigma**2 * length / (np.pi * SPEED) * (1.0 + 3.0 * x2) / (1.0 + x2) ** 2
    return 2.0 * sigma**2 * length / (np.pi * SPEED) * (1.0 + 12.0 * x2) / (1.0 + 4.0 * x2) ** 2


def rate_spectrum(f, axis, standard):
    """Density per hertz, (rad/s)^2/Hz, of p, q, r."""
    omega = 2.0 * np.pi * f
    sigma_v, sigma_w, length_v, length_w = low_altitude(standard)
    four, three = ((n * SPAN * omega / (np.pi * SPEED)) ** 2 for n in (4.0, 3.0))
    if axis == 0:
        twice = 1.0 if standard == "8785C" else 2.0
        ratio = (twice * np.pi * length_w / (4.0 * SPAN)) ** (1.0 / 3.0)
        phi = sigma_w**2 / (twice * SPEED * length_w) * 0.8 * ratio / (1.0 + four)
    elif axis == 1:
        phi = (omega / SPEED) ** 2 / (1.0 + four) * transverse(omega, sigma_w, length_w, standard)
    else:
        phi = (omega / SPEED) ** 2 / (1.0 + three) * transverse(omega, sigma_v, length_v, standard)
    return 2.0 * np.pi * phi


def velocity_spectrum(f, axis):
    """Density per hertz, (m/s)^2/Hz, along, across, down."""
    omega = 2.0 * np.pi * f
    sigma_v, sigma_w, length_v, length_w = low_altitude("8785C")
    if axis == 0:
        x2 = (length_v * omega / SPEED) ** 2
        phi = 2.0 * sigma_v**2 * length_v / (np.pi * SPEED) / (1.0 + x2)
    else:
        sigma, length = ((sigma_v, length_v), (sigma_w, length_w))[axis - 1]
        phi = transverse(omega, sigma, length, "8785C")
    return 2.0 * np.pi * phi


def assert_in_band(samples, spectrum, loss=1.0):
    """Bands of `test_turbulence`: single bins and averages over octaves, 0.05 to 5 Hz."""
    f, density = welch(samples, 1.0 / TICK_S, nperseg=N_SEGMENT)
    dof = 1.89 * (2 * samples.size // N_SEGMENT - 1)
    used = (f > 0.05) & (f < 5.0)
    ratio = np.ones_like(f)
    ratio[used] = density[used] / spectrum(f[used])
    low, high = chi2.ppf([0.025, 0.975], dof) / dof
    inside = ((ratio[used] > loss * low) & (ratio[used] < high)).mean()
    assert abs(inside - 0.95) < SIGMAS * np.sqrt(0.95 * 0.05 / (used.sum() / 1.5))
    for lower in 0.05 * 2.0 ** np.arange(6):
        octave = used & (f >= lower) & (f < 2.0 * lower)
        total = dof * octave.sum() / 1.5
        low, high = chi2.ppf([0.0005, 0.9995], total) / total
        assert loss * low < ratio[octave].mean() < high, lower


@njit
def _record(state, first, rows, kernel, y, out):
    for i in range(rows.shape[0]):
        plant.measure(state, first + i, rows[i], kernel, y)
        copy(out[i], state.air)


@pytest.fixture(scope="module")
def air(plant_config):
    """air(seconds, **changes): rows AIR (n, 12) at the aircraft."""
    kept = {}

    def build(seconds, **changes):
        key = (seconds, *sorted(changes.items()))
        if key not in kept:
            config = plant_config(
                wind__towards_deg=0.0, wind__profile_altitude_m=[0.0],
                wind__profile_speed_mps=[SPEED], **changes,
            )  # fmt: skip
            state, streams = plant.initial_state(config, 11), NoiseStreams(11)
            state.x[:] = make_state((0.0, 0.0, -10.0))
            out, y = np.zeros((round(seconds / TICK_S), AIR.size)), np.zeros(MEAS.size)
            for first in range(0, len(out), 50_000):
                part = out[first : first + 50_000]
                _record(state, first, streams.rows(len(part)), config.params, y, part)
            kept[key] = out
        return kept[key]

    return build


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rate_spectra_of_both_standards_agree_below_1000_ft(axis):
    """p, q, r as MIL-F-8785C and as MIL-HDBK-1797 print them, lengths and all; 1e-12."""
    f = np.geomspace(1e-3, 50.0, 300)
    one, other = (rate_spectrum(f, axis, name) for name in ("8785C", "1797"))
    assert one == pytest.approx(other, rel=1e-12)


def test_velocity_spectra_of_both_standards_agree_below_1000_ft():
    """v and w as both print them, lengths and all; 1e-12."""
    omega = np.geomspace(1e-3, 300.0, 300)
    for place in (0, 1):
        one, other = (
            transverse(omega, low_altitude(name)[place], low_altitude(name)[2 + place], name)
            for name in ("8785C", "1797")
        )
        assert one == pytest.approx(other, rel=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("seconds", LENGTHS)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_rotational_gusts_have_the_spectra_of_the_standard(air, seconds, axis):
    """PSD of p, q, r by Welch against the printed spectra, 0.05 to 5 Hz; b = 1.41 m."""
    rates = air(seconds, wind__rotation=True)[:, AIR.rates]
    assert_in_band(rates[:, axis], lambda f: rate_spectrum(f, axis, "8785C"))


@pytest.mark.parametrize("seconds", LENGTHS)
def test_rotational_gusts_belong_to_the_gusts_as_the_standard_says(air, seconds):
    """q and r are high passes of w and v: transfer functions; p is independent; 3.5 sigma."""
    rows = air(seconds, wind__rotation=True)
    gusts, (p, q, r) = rows[:, AIR.main], rows[:, AIR.rates].T
    segments = 2 * len(rows) // N_SEGMENT - 1
    for rate, gust, factor, sign in ((q, gusts[:, 2], 4.0, 1.0), (r, gusts[:, 1], 3.0, -1.0)):
        f, cross = csd(gust, rate, 1.0 / TICK_S, nperseg=N_SEGMENT)
        _, power = welch(gust, 1.0 / TICK_S, nperseg=N_SEGMENT)
        used = (f > 0.1) & (f < 3.0)
        s = 2j * np.pi * f[used]
        expected = sign * s / SPEED / (1.0 + factor * SPAN / (np.pi * SPEED) * s)
        assert np.abs((cross / power)[used] / expected - 1.0).max() < 0.05
    for other in (*gusts.T, q, r):
        f, cross = csd(p, other, 1.0 / TICK_S, nperseg=N_SEGMENT)
        _, one = welch(p, 1.0 / TICK_S, nperseg=N_SEGMENT)
        _, two = welch(other, 1.0 / TICK_S, nperseg=N_SEGMENT)
        used = (f > 0.1) & (f < 5.0)
        coherence = (np.abs(cross) ** 2 / (one * two))[used].mean()
        assert coherence < 1.4 / segments * (1.0 + SIGMAS / np.sqrt(used.sum() / 1.5))


PARTS = {f"wind__parts__{name}": True for name in ("main", "tail", "fuselage")}


@pytest.mark.parametrize("seconds", LENGTHS)
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_tail_meets_the_spectra_of_the_standard(air, seconds, axis):
    """The tail's air on its way through the field: same spectra, less 2.4 % at most at 5 Hz."""
    tail = air(seconds, **PARTS)[:, AIR.tail] - [SPEED, 0.0, 0.0]
    assert_in_band(tail[:, axis], lambda f: velocity_spectrum(f, axis), loss=0.976)


def test_tail_is_ahead_of_the_hub_by_its_arm_over_the_wind(air):
    """Wind from behind meets the tail first: phase 2 pi f arm / V of Taylor's field; 0.02 rad."""
    rows = air(2000.0, **PARTS)
    for axis in range(3):
        hub, tail = rows[:, AIR.main][:, axis], rows[:, AIR.tail][:, axis]
        f, cross = csd(hub, tail, 1.0 / TICK_S, nperseg=N_SEGMENT)
        used = (f > 0.05) & (f < 2.0)
        phase = np.unwrap(np.angle(cross[used]))
        assert np.abs(phase - 2.0 * np.pi * f[used] * ARM / SPEED).max() < 0.02


def test_fuselage_loses_the_eddies_that_are_shorter_than_it(air, helicopter):
    """Mean over the length 2 l: Simpson's |(4 + 2 cos w l / V) / 6|^2 of the density; 2 %."""
    rows = air(2000.0, **PARTS)
    half = helicopter.gear_half_length_m
    hub, body = rows[:, AIR.main][:, 2], rows[:, AIR.fuselage][:, 2]
    f, cross = csd(hub, body, 1.0 / TICK_S, nperseg=N_SEGMENT)
    _, power = welch(hub, 1.0 / TICK_S, nperseg=N_SEGMENT)
    used = (f > 0.05) & (f < 5.0)
    expected = (4.0 + 2.0 * np.cos(2.0 * np.pi * f[used] * half / SPEED)) / 6.0
    assert np.abs((cross / power)[used] / expected - 1.0).max() < 0.02


def test_log_profile_over_a_climb_is_that_of_the_standard(plant_config, record):
    """W20 = 4 m/s, Category C: W20 ln(h / 0.15 ft) / ln(20 ft / 0.15 ft); 1e-12 m/s."""
    config = plant_config(
        wind__profile="log", wind__w20_mps=4.0, wind__turbulence=False, wind__towards_deg=0.0
    )
    y = record(config, 601, velocity_ned=(0.0, 0.0, -2.5))
    feet = (10.0 + 2.5 * TICK_S * np.arange(601)) / FOOT
    speed = 4.0 * np.log(feet / 0.15) / np.log(20.0 / 0.15)
    assert y[:, MEAS.wind] == pytest.approx(np.outer(speed, [1.0, 0.0, 0.0]), abs=1e-12)
    # What the paper's winds are in it: 5 m/s aloft is met, 3 m/s is at 1.8 m, not at 10 m.
    at_10, at_20 = speed[0], speed[400]
    assert (at_10, at_20) == pytest.approx((4.40, 4.97), abs=0.005)
    assert abs(at_20 / 5.0 - 1.0) < 0.1 < at_10 / 3.0 - 1.0
    assert 4.0 * np.log(1.794 / FOOT / 0.15) / np.log(20.0 / 0.15) == pytest.approx(3.0, abs=1e-3)


def test_random_gusts_have_the_distributions_that_were_asked_for():
    """Pauses exponential, length, peak and angle uniform; Kolmogorov-Smirnov at 0.1 % each."""
    k = RandomGusts(4.0, 0.2, 0.5, 1.0, 5.0, np.radians(30.0), 86_400.0)
    drawn = draw_gusts(17, k, 8.0, np.radians(225.0))
    start, length = drawn[:, GUST.start], drawn[:, GUST.duration]
    peak = drawn[:, GUST.peak]
    pause = start - np.concatenate([[0.0], (start + length)[:-1]])
    angle = np.arctan2(peak[:, 1], peak[:, 0]) - np.radians(225.0 - 360.0)
    assert len(drawn) > 4000 and (pause >= 0.0).all() and (peak[:, 2] == 0.0).all()
    for sample, wanted in (
        (pause, expon(scale=15.0)),
        (length, uniform(1.0, 4.0)),
        (np.linalg.norm(peak, axis=1), uniform(1.6, 2.4)),
        (angle, uniform(-np.radians(30.0), np.radians(60.0))),
    ):
        assert kstest(sample, wanted.cdf).pvalue > 1e-3


LOCK_NUMBER = 6.0


def steady_flapping(attack):
    """(cos, sin) harmonics of the flapping that the angle of attack cos a + sin b drives.

    Hinged blade without spring, azimuth psi: beta'' + gamma/8 beta' + beta = gamma/8 alpha(psi),
    Bramwell's flapping equation for an angle of attack that is the same at every radius. Once per
    turn beta'' and beta cancel: the blade follows a quarter of a turn later.
    """
    once = 1j
    response = LOCK_NUMBER / 8.0 / (once**2 + LOCK_NUMBER / 8.0 * once + 1.0)
    beta = response * (attack[0] - 1j * attack[1])
    return beta.real, -beta.imag


@pytest.mark.parametrize(("p", "q"), [(0.3, 0.0), (0.0, 0.3), (-0.2, 0.5)])
def test_gust_that_turns_tilts_the_disc_as_the_flapping_equation_says(p, q):
    """Air turning about both axes of the disc; flapping blade, by vectors in body axes; 1e-12."""
    speed = 193.73
    azimuths = np.radians([0.0, 90.0])
    attack = []
    for psi in azimuths:  # clockwise from above, from the nose: the torque's sense
        blade = np.array([np.cos(psi), np.sin(psi), 0.0])
        up = -np.cross([p, q, 0.0], blade)[2]
        attack.append(up / speed)
    nose_up, right_up = steady_flapping(attack)
    a_s, b_s = disc_tilt_of_gust(p, q, speed)  # backwards: nose up; to the right: right side down
    assert (a_s, -b_s) == pytest.approx((nose_up, right_up), abs=1e-12)
