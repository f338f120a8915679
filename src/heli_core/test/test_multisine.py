# SPDX-License-Identifier: Apache-2.0
"""Multisines: values by hand, lines on the grid and apart, strength, crest factor, fades."""

import numpy as np
import pytest

from heli_core.signals import (
    design_multisine,
    fade_in_and_out,
    low_crest_phases,
    sines_at,
    zippered_lines,
)

PERIOD_S = 20.0
BANDS_HZ = [[0.1, 8.0], [0.1, 8.0], [0.2, 6.0]]


@pytest.fixture(scope="module")
def multisine():
    lines, channel = zippered_lines(PERIOD_S, BANDS_HZ, [16, 16, 10])
    weight = np.where(lines > 2.0, 2.0, 1.0)
    return design_multisine(PERIOD_S, lines, channel, weight, [0.1, 0.2, 0.05])


def test_sum_of_two_sines_by_hand():
    out = np.full(2, 9.0)
    amplitude, phase = np.array([[2.0, 0.0], [0.0, 3.0]]), np.array([[0.0, 7.0], [7.0, 0.5]])
    sines_at(0.125, np.array([1.0, 4.0]), amplitude, phase, out)
    np.testing.assert_allclose(out, [2.0 * np.sin(np.pi / 4.0), 3.0 * np.sin(np.pi + 0.5)])


def test_lines_are_whole_multiples_of_the_grid_inside_their_bands_and_never_shared(multisine):
    cycles = multisine.frequency_hz * PERIOD_S
    np.testing.assert_allclose(cycles, np.rint(cycles), atol=1e-12)
    assert np.all(np.diff(cycles) > 0.5)
    assert np.all(np.count_nonzero(multisine.amplitude, axis=1) == 1)
    assert np.count_nonzero(multisine.amplitude, axis=0).tolist() == [16, 16, 10]
    for j, (low, high) in enumerate(BANDS_HZ):
        lines_hz = multisine.frequency_hz[multisine.amplitude[:, j] > 0.0]
        assert low - 1e-9 <= lines_hz.min() < lines_hz.max() <= high + 1e-9
        assert lines_hz.max() > 0.7 * high


def test_even_distortion_falls_between_odd_lines():
    lines, channel = zippered_lines(PERIOD_S, BANDS_HZ, [12, 12, 10], odd=True)
    assert np.all(np.rint(lines * PERIOD_S) % 2 == 1)
    x = design_multisine(PERIOD_S, lines, channel, np.ones(34), [1.0, 1.0, 1.0]).at(
        np.arange(4000) / 200.0
    )
    for even in (x[:, 0] ** 2, x[:, 0] * x[:, 1], np.abs(x[:, 2])):
        spectrum = np.abs(np.fft.rfft(even)) / 4000
        assert spectrum[1::2].max() < 1e-12 < 1e-3 < spectrum[2::2].max()


def test_periods_repeat_and_strength_and_shape_are_as_wanted(multisine):
    time_s = np.arange(2000) / 100.0
    values = multisine.at(time_s)
    np.testing.assert_allclose(multisine.at(time_s + 3.0 * PERIOD_S), values, atol=1e-10)
    np.testing.assert_allclose(values.std(axis=0), [0.1, 0.2, 0.05], rtol=1e-10)
    np.testing.assert_allclose(multisine.rms, [0.1, 0.2, 0.05])
    of_channel = multisine.amplitude[:, 0] > 0.0
    high = multisine.frequency_hz[of_channel] > 2.0
    ratio = (
        multisine.amplitude[of_channel, 0][high].mean()
        / multisine.amplitude[of_channel, 0][~high].mean()
    )
    assert ratio == pytest.approx(2.0)


def test_spectrum_holds_each_channels_lines_and_nothing_else(multisine):
    count = 2000
    spectrum = 2.0 * np.abs(np.fft.rfft(multisine.at(np.arange(count) / 100.0), axis=0)) / count
    expected = np.zeros_like(spectrum)
    expected[np.rint(multisine.frequency_hz * PERIOD_S).astype(int)] = multisine.amplitude
    np.testing.assert_allclose(spectrum, expected, atol=1e-12)


def test_crest_factor_is_far_below_that_of_random_phases(multisine):
    of_channel = multisine.amplitude[:, 0] > 0.0
    lines, size = multisine.frequency_hz[of_channel], multisine.amplitude[of_channel, 0]
    rng, time_s = np.random.default_rng(1), np.arange(4000) / 200.0
    random = []
    for _ in range(200):
        phase = rng.uniform(-np.pi, np.pi, lines.size)
        x = np.sin(2.0 * np.pi * time_s[:, None] * lines + phase) @ size
        random.append(np.abs(x).max() / x.std())
    assert multisine.crest[0] < min(random)
    assert multisine.crest[0] < 0.9 * np.median(random)
    again = low_crest_phases(PERIOD_S, lines, size)
    np.testing.assert_array_equal(again, low_crest_phases(PERIOD_S, lines, size))


def test_fades_are_smooth_and_silent_outside():
    shares = [fade_in_and_out(t, 10.0, 2.0) for t in (-0.1, 0.0, 1.0, 2.0, 5.0, 9.0, 10.0, 10.1)]
    np.testing.assert_allclose(shares, [0.0, 0.0, 0.5, 1.0, 1.0, 0.5, 0.0, 0.0], atol=1e-12)
    assert fade_in_and_out(0.0, 10.0, 0.0) == 1.0


def test_a_line_off_the_grid_and_a_crowded_band_are_refused():
    with pytest.raises(ValueError, match=r"1\.03 Hz"):
        design_multisine(PERIOD_S, [1.03], [0], [1.0], [0.1])
    with pytest.raises(ValueError, match="channel 1: .* 9 "):
        zippered_lines(1.0, [[1.0, 4.0], [1.0, 4.0]], [2, 9])


def test_channels_of_one_band_interleave_down_to_its_lower_end():
    lines, channel = zippered_lines(PERIOD_S, [[0.05, 4.0]] * 3, [12] * 3, odd=True)
    for j in range(3):
        of_channel = lines[channel == j]
        assert of_channel.size == 12
        assert of_channel.min() < 0.3
        assert of_channel.max() > 2.0
