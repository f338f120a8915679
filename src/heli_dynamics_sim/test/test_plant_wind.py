# SPDX-License-Identifier: Apache-2.0
"""Wind: profile, Dryden filters against MIL-F-8785C, gusts."""

import math

import numpy as np
import pytest
from scipy.linalg import expm

from heli_core.errors import ParameterCause, PlantConfigError
from heli_dynamics_sim import wind
from heli_dynamics_sim.airframe import make_state

A = np.array([[-1.0, 0.0], [1.0, -1.0]])


@pytest.fixture
def kernel(plant_config):
    def build(**changes):
        return plant_config(**{f"wind__{key}": value for key, value in changes.items()}).wind

    return build


@pytest.mark.parametrize(
    ("altitude", "speed"), [(-1.0, 3.0), (0.0, 3.0), (10.0, 3.0), (15.0, 4.0), (50.0, 5.0)]
)
def test_profile_is_linear_between_its_points(kernel, altitude, speed):
    assert wind.mean_speed(altitude, kernel()) == pytest.approx(speed)


def test_wind_blows_towards(kernel):
    out = np.zeros(3)
    k = kernel(towards_deg=90.0, turbulence=False)
    wind.wind_at(np.zeros(5), make_state((0.0, 0.0, -10.0)), 0.0, k, out)
    assert out == pytest.approx([0.0, 3.0, 0.0], abs=1e-12)


def test_turbulence_scales_of_the_standard():
    # h = 10 m, W20 = 5 m/s: sigma_w 0.5, sigma_u 0.94 m/s, L_u 67 m, tau_u 13.5 s
    sigma_h, sigma_w, length_h, length_w = wind.dryden_scales(10.0, 5.0)
    assert (sigma_w, length_w) == pytest.approx((0.5, 10.0))
    assert sigma_h == pytest.approx(0.94, abs=0.005)
    assert length_h == pytest.approx(67.0, abs=0.5)
    assert length_h / 5.0 == pytest.approx(13.5, abs=0.1)
    # at 1000 ft the turbulence is isotropic: the standard's forms meet there
    sigma_h, sigma_w, length_h, length_w = wind.dryden_scales(304.8, 5.0)
    assert sigma_h == pytest.approx(sigma_w) and length_h == pytest.approx(length_w)
    # frozen outside 10 .. 1000 ft
    assert wind.dryden_scales(1.0, 5.0) == wind.dryden_scales(3.048, 5.0)


def test_w20_is_the_wind_at_20_feet(kernel):
    assert kernel(profile_speed_mps=[0.0, 10.0, 10.0]).w20_mps == pytest.approx(6.096)
    assert kernel(w20_mps=7.0).w20_mps == 7.0


@pytest.mark.parametrize("h", [1e-6, 1e-4, 0.01, 0.0499, 0.0501, 0.3, 2.0])
def test_noise_covariance_is_exact(h):
    # Van Loan, IEEE TAC 23 (1978) 395-404
    block = np.zeros((4, 4))
    block[:2, :2], block[2:, 2:] = -A, A.T
    block[0, 2] = 1.0
    phi = expm(block * h)
    Q = phi[2:, 2:].T @ phi[:2, 2:]
    q = wind.second_order_covariance(h)
    assert q == pytest.approx((Q[0, 0], Q[0, 1], Q[1, 1]), rel=1e-5, abs=1e-18)
    x = wind.second_order_step(0.7, -0.4, h, 0.0, 0.0)
    assert x == pytest.approx(expm(A * h) @ [0.7, -0.4], rel=1e-12)


def test_two_steps_are_one_of_twice_the_length():
    """Stationarity of the output: P = Phi P Phi' + Q, and its variance is 1."""
    P = np.array([[0.5, 0.25], [0.25, 0.25]])
    for h in (1e-3, 0.1, 1.0):
        q11, q12, q22 = wind.second_order_covariance(h)
        phi = expm(A * h)
        assert phi @ P @ phi.T + [[q11, q12], [q12, q22]] == pytest.approx(P, abs=1e-12)
    c = np.array([wind.second_order_output(1.0, 0.0), wind.second_order_output(0.0, 1.0)])
    assert c @ P @ c == pytest.approx(1.0)


def test_filter_starts_stationary():
    rng = np.random.default_rng(1)
    x = np.empty((20000, 5))
    for row in x:
        wind.stationary_filter(rng.standard_normal(5), row)
    pair = np.array([[0.5, 0.25], [0.25, 0.25]])
    expected = np.zeros((5, 5))
    expected[0, 0], expected[1:3, 1:3], expected[3:, 3:] = 1.0, pair, pair
    assert np.cov(x.T) == pytest.approx(expected, abs=0.03)


def test_no_mean_wind_no_turbulence(kernel):
    k = kernel(profile_speed_mps=[0.0, 0.0, 0.0])
    x, out = np.ones(5), np.zeros(3)
    wind.step_turbulence(x, 10.0, 0.01, np.ones(5), k)
    wind.wind_at(x, make_state((0.0, 0.0, -10.0)), 0.0, k, out)
    assert np.isfinite(x).all()
    assert out.tolist() == [0.0, 0.0, 0.0]


def test_one_cosine_gusts_in_both_frames(kernel):
    changes = {
        "turbulence": False,
        "profile_speed_mps": [0.0, 0.0, 0.0],
        "gust__start_s": [1.0, 10.0],
        "gust__duration_s": [2.0, 1.0],
        "gust__amplitude_mps": [4.0, 0.0, 0.0, 0.0, 0.0, -1.0],
    }
    x, out = make_state((0.0, 0.0, -10.0), 0.0, 0.0, np.pi / 2), np.zeros(3)
    for frame, direction in (("ned", [1.0, 0.0, 0.0]), ("body", [0.0, 1.0, 0.0])):
        k = kernel(**changes, gust__frame=frame)
        for t, size in ((0.5, 0.0), (1.5, 2.0), (2.0, 4.0), (2.5, 2.0), (3.1, 0.0)):
            wind.wind_at(np.zeros(5), x, t, k, out)
            assert out == pytest.approx(size * np.array(direction), abs=1e-12)
        wind.wind_at(np.zeros(5), x, 10.5, k, out)
        assert out == pytest.approx([0.0, 0.0, -1.0], abs=1e-12)


def test_turbulence_is_added_along_across_and_down(kernel):
    """Blowing north: along is north, across is to the right (east), each with its own sigma."""
    k = kernel(towards_deg=0.0, w20_mps=5.0)
    sigma_h, sigma_w, _, _ = wind.dryden_scales(10.0, 5.0)
    x, out = make_state((0.0, 0.0, -10.0)), np.zeros(3)
    one = 1.0 / np.sqrt(3.0)  # filter states (one, 0) have output 1
    for place, axis, sigma in ((0, 0, sigma_h), (1, 1, sigma_h), (3, 2, sigma_w)):
        states = np.zeros(5)
        states[place] = 1.0 if place == 0 else one
        wind.wind_at(states, x, 0.0, k, out)
        expected = np.array([3.0, 0.0, 0.0])
        expected[axis] += sigma
        assert out == pytest.approx(expected, abs=1e-12)
    k = kernel(towards_deg=90.0, w20_mps=5.0)
    wind.wind_at(np.array([0.0, one, 0.0, 0.0, 0.0]), x, 0.0, k, out)
    assert out == pytest.approx([-sigma_h, 3.0, 0.0], abs=1e-12)  # right of east is south


SINES = {
    "wind__sines__frequency_hz": [0.5, 2.0],
    "wind__sines__amplitude_mps": [1.0, 0.0, 0.0, 0.0, 0.5, 0.0],
    "wind__sines__phase_rad": [0.3, 0.0, 0.0, 0.0, 0.0, 0.0],
    "wind__sines__start_s": 2.0,
    "wind__sines__duration_s": 10.0,
    "wind__sines__fade_s": 1.0,
}


def test_injected_sines_are_their_sum_and_turn_with_the_aircraft(plant_config):
    """By hand, body axes at 90 deg of heading: forward is east, right is south."""
    k = plant_config(**SINES).params.wind.sines
    x, gust = make_state(psi=math.pi / 2.0), np.zeros(3)
    wind.injected_gust(x, 5.1, k, gust)
    forward = math.sin(2.0 * math.pi * 0.5 * 3.1 + 0.3)
    right = 0.5 * math.sin(2.0 * math.pi * 2.0 * 3.1)
    np.testing.assert_allclose(gust, [-right, forward, 0.0], atol=1e-12)
    ned = plant_config(**SINES, wind__sines__frame="ned").params.wind.sines
    wind.injected_gust(x, 5.1, ned, gust)
    np.testing.assert_allclose(gust, [forward, right, 0.0], atol=1e-12)


def test_injected_sines_add_to_the_wind_and_are_silent_outside_their_time(plant_config):
    with_sines, without = plant_config(**SINES).params, plant_config().params
    x, filters = make_state(pos_ned_m=(0.0, 0.0, -10.0)), np.full(5, 0.4)
    total, rest, gust = np.zeros(3), np.zeros(3), np.zeros(3)
    for time_s in (1.9, 2.5, 6.3, 12.1):
        wind.wind_at(filters, x, time_s, with_sines.wind, total)
        wind.wind_at(filters, x, time_s, without.wind, rest)
        wind.injected_gust(x, time_s, with_sines.wind.sines, gust)
        np.testing.assert_allclose(total - rest, gust, atol=1e-12)
        assert (np.abs(gust).max() > 0.0) == (2.0 < time_s < 12.0)
    assert not without.wind.sines.on


@pytest.mark.parametrize(
    ("key", "value", "cause"),
    [
        ("amplitude_mps", [0.0] * 3, ParameterCause.LENGTH),
        ("phase_rad", [0.0] * 9, ParameterCause.LENGTH),
        ("fade_s", 6.0, ParameterCause.BOUNDS),
    ],
)
def test_sines_that_do_not_fit_are_refused(plant_config, key, value, cause):
    with pytest.raises(PlantConfigError) as caught:
        plant_config(**(SINES | {f"wind__sines__{key}": value}))
    assert (caught.value.cause, caught.value.key) == (cause, f"wind.sines.{key}")
