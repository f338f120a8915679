# SPDX-License-Identifier: Apache-2.0
"""Coherence and lag as the experiment works them out, on signals whose answer is known."""

import numpy as np
import pytest

from evidence.experiments.coupling import coherence, half_time_s, spectra


def test_coherence_is_one_of_what_follows_and_chance_of_what_does_not():
    rng = np.random.default_rng(1)
    x, y = rng.standard_normal((2, 40_000))
    hz, cross = spectra(np.column_stack([x, np.roll(x, 3), y]))
    gamma = coherence(cross)
    assert hz[1] == pytest.approx(0.1)
    assert gamma[0, 1, 1:].min() > 0.99
    assert gamma[0, 2].mean() < 0.05


def test_lag_is_when_the_acceleration_is_half_its_largest():
    """Acceleration 1 - exp(-t / 0.2 s) from 0.1 s on: half at 0.1 + 0.2 ln 2."""
    t = np.arange(1, 301) * 0.01
    late = np.maximum(t - 0.1, 0.0)
    velocity = late - 0.2 * (1.0 - np.exp(-late / 0.2))
    assert half_time_s(velocity) == pytest.approx(0.1 + 0.2 * np.log(2.0), abs=0.011)
