# SPDX-License-Identifier: Apache-2.0
"""Scenarios along a path: flown within their goals, and refused where they cannot be flown."""

import numpy as np
import pytest

from heli_core.rcl_yaml import ParameterError
from heli_core.rows import REFERENCE
from heli_flight.loop import simulate
from heli_flight.scoring import TRUTH, WINDOWS, score
from heli_flight.settings import resolve


@pytest.mark.parametrize("scenario", ["figure_eight", "orbit", "waypoints"])
@pytest.mark.parametrize("laws", ["packaged", "hinf"])
def test_a_path_is_flown_within_its_goals(scenario, laws):
    settings = resolve(scenario, "rtk", 1, laws=laws)
    flight = simulate(settings)
    assert not flight.status
    figures = score(flight.record, settings.scenario)
    for key in ("position", "heading"):
        figure = figures.find(WINDOWS, key, TRUTH)
        assert figure.inside, figure
    reference = flight.record.reference
    moved = np.ptp(reference[:, REFERENCE.pos], axis=0)
    assert moved[:2].min() > 5.0


def test_without_the_lead_the_nose_comes_late():
    """By three times the goal of 5 deg."""
    overrides = {"outer_loop": {"heading_lead_s": 0.0}}
    settings = resolve("orbit", "rtk", 1, overrides=overrides)
    figures = score(simulate(settings).record, settings.scenario)
    assert figures.find(WINDOWS, "heading", TRUTH).max > 15.0


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("path.size_m", 6.0, ["bend of 1 m", "9.00 m/s2", "allowed: 3 m/s2"]),
        ("path.heading", "centre", ["path.heading is centre", "figure_eight", "orbit"]),
        ("path.laps", 1000.0, ["way points", "allowed: 4096"]),
        ("path.kind", "loop", ["path.kind", "loop", "figure_eight"]),
        ("path.speed_mps", float("nan"), ["path.speed_mps"]),
        ("duration_s", 41.9, ["duration_s is 41.9", "takes 41.97 s"]),
        ("path.laps", 2.5, ["duration_s is 50", "takes 50.71 s"]),
    ],
)
def test_a_path_that_cannot_be_flown_is_one_sentence(key, value, words):
    with pytest.raises(ParameterError) as error:
        resolve("figure_eight", "rtk", 1, overrides={"scenario": {key: value}})
    assert all(word in str(error.value) for word in words), error.value
    assert len(str(error.value).splitlines()) == 1
