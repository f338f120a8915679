# SPDX-License-Identifier: Apache-2.0
"""`heli design` says what its certificate is worth for the loop as flown."""

import pytest

from heli_flight.worlds import LAWS
from heli_studies.design.make import make_design, norms_on_the_way
from heli_studies.design.report import said_of_the_flown_norm


@pytest.fixture(scope="module")
def tight():
    """The paper's state feedback with a gamma so near gamma* that the loop as flown exceeds it."""
    return make_design([LAWS.file("hinf")], gamma_factor=1.01)


@pytest.mark.slow
def test_the_flown_norm_is_enclosed_and_near_that_of_the_samples(tight):
    """Wind and h are slow against 100 Hz, so the two differ by less than a percent."""
    norm, sampled = tight.between_samples, tight.reports[-1]
    assert norm.lower <= norm.upper <= norm.lower * (1 + 1e-6)
    assert norm.upper == pytest.approx(sampled.norm, rel=1e-2)
    assert abs(norm.upper / sampled.norm - 1) > 1e-5
    assert norm.frequency_radps == pytest.approx(sampled.norm_frequency, rel=1e-2)


def test_where_it_exceeds_gamma_it_says_by_what(tight):
    sentence, gamma = said_of_the_flown_norm(tight), tight.attitude.synthesis.gamma
    assert tight.between_samples.upper > gamma
    assert f"gamma = {gamma:.6g}" in sentence
    steps = dict(
        norms_on_the_way(
            tight.model,
            tight.observer.K,
            tight.attitude.prediction_s,
            tight.observer_input,
            tight.actuation,
        )
    )
    assert steps["state feedback"] == pytest.approx(tight.attitude.synthesis.norm, rel=1e-8)
    observer, delay = steps["with the observer"], steps["with transport delay"]
    assert observer == pytest.approx(tight.reports[1].norm, rel=1e-6)
    assert steps["with prediction"] == pytest.approx(tight.between_samples.upper, rel=1e-6)
    assert delay > steps["with servos"] > steps["at 100 Hz"]
    assert all(f"{name} {norm:.6g}" in sentence for name, norm in steps.items())
