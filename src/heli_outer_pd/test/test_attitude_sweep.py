# SPDX-License-Identifier: Apache-2.0
"""What is added to the commanded attitude: frequency over time, steps, and nothing if off."""

import math

import numpy as np
import pytest

from heli_core.rows import SETPOINT
from heli_core.signals import add_sweep, swept_angle
from heli_outer_pd.parameters import sweep_params

NUMBERS = {
    "sweep.shape": "sweep",
    "sweep.axis": "pitch",
    "sweep.amplitude_deg": 5.0,
    "sweep.from_hz": 0.1,
    "sweep.to_hz": 5.0,
    "sweep.start_s": 10.0,
    "sweep.duration_s": 90.0,
}


def signal(times_s, **changes):
    kernel = sweep_params(NUMBERS | {f"sweep.{key}": value for key, value in changes.items()})
    return np.array([swept_angle(t, kernel) for t in times_s])


def test_the_frequency_grows_by_the_same_factor_in_equal_times():
    t = np.arange(10.0, 100.0, 0.001)
    rising = np.flatnonzero((signal(t)[:-1] < 0.0) & (signal(t)[1:] >= 0.0))
    middle, cycle_s = 0.5 * (t[rising][1:] + t[rising][:-1]), np.diff(t[rising])
    expected = 0.1 * 50.0 ** ((middle - 10.0) / 90.0)
    # Of the shorter cycles, in which the frequency hardly changes.
    short = cycle_s < 1.0
    np.testing.assert_allclose(1.0 / cycle_s[short], expected[short], rtol=0.01)
    assert 1.0 / cycle_s[-1] == pytest.approx(5.0, rel=0.05)


def test_amplitude_and_ends():
    t = np.arange(0.0, 120.0, 0.01)
    commanded = signal(t)
    assert np.abs(commanded).max() == pytest.approx(math.radians(5.0), rel=1e-3)
    assert not commanded[(t <= 10.0) | (t >= 100.0)].any()
    assert np.abs(np.diff(commanded)).max() < math.radians(5.0) * 2.0 * math.pi * 5.0 * 0.01 * 1.01


def test_a_sweep_of_one_frequency_is_a_sine():
    t = np.array([50.0, 50.25, 50.5, 50.75])
    commanded = signal(t, to_hz=1.0, from_hz=1.0)
    expected = np.radians(5.0) * np.sin(2.0 * np.pi * (t - 10.0))
    np.testing.assert_allclose(commanded, expected, atol=1e-9)


def test_steps_go_up_back_down_and_back_then_half_as_far():
    t = 10.0 + 4.0 * np.arange(9) + 2.0
    steps_deg = np.degrees(signal(t, shape="steps", duration_s=32.0))
    assert steps_deg == pytest.approx([5.0, 0.0, -5.0, 0.0, 2.5, 0.0, -2.5, 0.0, 0.0])


@pytest.mark.parametrize(("axis", "place"), [("roll", 0), ("pitch", 1), ("yaw", 2)])
def test_it_is_added_to_its_axis_alone(axis, place):
    out = np.full(SETPOINT.size, 0.1)
    add_sweep(12.0, sweep_params(NUMBERS | {"sweep.shape": "steps", "sweep.axis": axis}), out)
    expected = np.full(SETPOINT.size, 0.1)
    expected[place] += math.radians(5.0)
    np.testing.assert_array_equal(out, expected)


def test_nothing_is_added_if_it_is_off():
    assert not signal(np.arange(0.0, 120.0, 0.1), shape="none").any()
