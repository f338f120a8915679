# SPDX-License-Identifier: Apache-2.0
"""Chirps in closed loop, identified by both methods: errors, and what the intervals hold."""

from dataclasses import replace

import numpy as np
import pytest

from evidence.experiments.identification_proofs import (
    AMPLITUDE,
    LAW,
    SIGMAS,
    TARGET,
    blade_360,
    chirps,
    identified,
    linear_flight,
    played,
)
from heli_analysis.identification.model import values_of
from heli_analysis.identification.output_error import BAND_HZ, fit_output_error, pieces_of_record
from heli_core.signals import sines_at
from heli_core.ticks import TICK_S
from heli_flight.settings import resolve
from heli_inner_hinf.excitation import excitation_params

ROLL_AND_PITCH = (
    "A(p,b_s)", "A(q,a_s)", "A(a_s,b_s)", "A(b_s,a_s)", "B(a_s,d_lat)", "B(a_s,d_lon)",
    "B(b_s,d_lat)", "B(b_s,d_lon)",
)  # fmt: skip
YAW = ("A(r,r)", "A(r,d_int)", "B(r,d_ped)", "B(d_int,d_ped)")
OF_HELION = (*ROLL_AND_PITCH[:-1], "A(r,r)", "B(r,d_ped)", "B(d_int,d_ped)", "B(p,d_ped)", "A(p,r)")
"""Those that are so on every seed of the experiment."""


def held(rows):
    """Share of intervals that hold the truth, and two standard deviations of such a share."""
    inside = np.abs(rows) < SIGMAS
    return inside.mean(), 2.0 * np.sqrt(0.95 * 0.05 / inside.size)


def test_the_stack_plays_the_chirps():
    values = resolve(controller=LAW).nodes["inner_loop"] | played(AMPLITUDE["blade360"])
    k = excitation_params(values)
    want, out = chirps(AMPLITUDE["blade360"]), np.zeros(4)
    for tick in range(1000, want.shape[0], 1571):
        sines_at(tick * TICK_S, k.frequency_hz, k.amplitude, k.phase_rad, out)
        np.testing.assert_allclose(out, want[tick], atol=1e-3)


@pytest.mark.slow
def test_with_the_excitation_as_instrument_a_loop_leaves_no_bias():
    names, truth = (*ROLL_AND_PITCH, *YAW), blade_360()
    true, bare, told = values_of(names, truth), [], []
    for seed in range(1, 4):
        pieces = pieces_of_record(linear_flight(seed), BAND_HZ)
        for rows, one in ((told, pieces), (bare, [replace(p, answer=None) for p in pieces])):
            found = fit_output_error(one, truth, names)
            assert found.instrumented == (rows is told)
            rows.append((found.values - true) / found.sigma)
    share, scatter = held(told)
    assert share >= 0.95 - scatter
    assert held(bare)[0] < 0.7


@pytest.mark.nightly
@pytest.mark.slow
def test_where_the_model_is_right_95_of_100_intervals_hold_the_truth():
    rows = [row for seed in range(1, 5) for row in identified(case="linear", seed=seed)["rows"]]
    for method in ("frequency", "output_error"):
        share, scatter = held([row["z"] for row in rows if row["method"] == method])
        assert share >= 0.95 - scatter, method


@pytest.mark.slow
@pytest.mark.parametrize(("case", "names"), [("blade360", ROLL_AND_PITCH), ("helion", OF_HELION)])
def test_main_entries_are_within_5_percent_of_what_flew(case, names):
    """The Blade 360 flown by its own controller, the search begun 30 % off; HeLion from nothing."""
    found = identified(case=case, seed=1)
    errors = {
        (row["method"], row["name"]): row["relative"]
        for row in found["rows"]
        if row["name"] in names
    }
    assert len(errors) == 2 * len(names)
    assert max(np.abs(list(errors.values()))) < TARGET, errors
