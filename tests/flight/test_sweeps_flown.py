# SPDX-License-Identifier: Apache-2.0
"""Sweeps and steps of the packaged scenarios: what is flown is what the linear model says."""

import numpy as np
import pytest

from heli_analysis.handling.scoring import AXES, bandwidth, changes, rejection
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_studies.handling import LinearLoop, grid_radps, rejected, swept, true_track


def settings_of(scenario, laws, axis):
    overrides = {"outer_loop": {"sweep.axis": axis}, "inner_loop": {"disturbance.axis": axis}}
    return resolve(scenario, "rtk", 1, world="paper", laws=laws, overrides=overrides)


@pytest.mark.parametrize(("laws", "axis"), [("hinf_output", "pitch"), ("hinf", "roll")])
def test_bandwidth_and_phase_delay_of_a_sweep_are_the_linear_models(laws, axis):
    settings = settings_of("attitude_sweep", laws, axis)
    flight = simulate(settings)
    assert not flight.status
    result = bandwidth(swept(settings, flight.record, AXES.index(axis)))
    linear = bandwidth(LinearLoop(settings).to_command(grid_radps(), axis))
    assert result.phase_radps == pytest.approx(linear.phase_radps, rel=0.02)
    assert result.neutral_radps == pytest.approx(linear.neutral_radps, rel=0.02)
    assert result.phase_delay_s == pytest.approx(linear.phase_delay_s, rel=0.05)


@pytest.mark.parametrize(("laws", "axis"), [("hinf_output", "yaw"), ("pid", "roll")])
def test_the_rejection_of_what_is_added_to_the_measured_attitude_is_the_linear_models(laws, axis):
    settings = settings_of("attitude_disturbance", laws, axis)
    flight = simulate(settings)
    assert not flight.status
    result = rejection(rejected(settings, flight.record, AXES.index(axis)))
    linear = rejection(LinearLoop(settings).to_disturbance(grid_radps(), axis))
    assert result.bandwidth_radps == pytest.approx(linear.bandwidth_radps, rel=0.03)
    assert result.peak_db == pytest.approx(linear.peak_db, abs=0.7)


@pytest.mark.parametrize("axis", ["roll", "pitch"])
def test_a_law_of_the_error_alone_rejects_what_it_does_not_follow(axis):
    """PID: a disturbance of the measured angle acts as the opposite command does: S = 1 - T."""
    loop = LinearLoop(settings_of("attitude_sweep", "pid", axis))
    omega = grid_radps(50)
    T, S = loop.to_command(omega, axis).response, loop.to_disturbance(omega, axis).response
    np.testing.assert_allclose(S, 1.0 - T, atol=1e-9)


def test_steps_are_changes_of_attitude():
    settings = settings_of("attitude_steps", "hinf", "roll")
    track = true_track(simulate(settings).record)
    steps = changes(track.time_s, track.attitude_rad[:, 0])
    assert [round(c.start_s) for c in steps] == [10, 14, 18, 22, 26, 30, 34, 38]
    assert [c.peak_deg for c in steps] == pytest.approx([20.0] * 4 + [10.0] * 4, rel=0.05)
