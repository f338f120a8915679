# SPDX-License-Identifier: Apache-2.0
"""Excitation of the actuators: what is added, when it is given up and why, what is refused."""

import numpy as np
import pytest

from heli_core.errors import ShapeError
from heli_inner_hinf.controller_state import LAST_U, N_LAW_STATE
from heli_inner_hinf.excitation import (
    ExcitationStatus,
    excitation_params,
    excite,
    initial_excitation_state,
)

TRIM_U = np.array([0.01, -0.02, 0.0, -0.2])


def kernel(**changes):
    values = {
        "excitation.frequency_hz": [1.0, 2.0],
        "excitation.amplitude": [0.1, 0.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0],
        "excitation.phase_rad": [0.0] * 8,
        "excitation.start_s": 1.0,
        "excitation.duration_s": 20.0,
        "excitation.fade_s": 2.0,
        "excitation.attitude_limit_deg": 10.0,
        "excitation.saturation_s": 0.05,
        "trim.x": [0.04, 0.001] + [0.0] * 7,
        "actuator_limit": 0.98,
    }
    return excitation_params(values | {f"excitation.{k}": v for k, v in changes.items()})


class Run:
    """Ticks of the excitation on commands that stay at trim."""

    def __init__(self, k):
        self.k, self.state, self.law = k, initial_excitation_state(), np.zeros(N_LAW_STATE)

    def __call__(self, time_s, x9=None, u=TRIM_U):
        x9 = np.array([0.04, 0.001] + [0.0] * 7) if x9 is None else x9
        out = u.copy()
        status = excite(time_s, x9, self.k, self.state, self.law, out)
        return ExcitationStatus(status), out


def test_sum_of_command_and_sines_from_the_start_on():
    run = Run(kernel())
    status, u = run(0.99)
    assert status is ExcitationStatus.SILENT
    np.testing.assert_array_equal(u, TRIM_U)
    status, u = run(5.0 + 0.0625)
    assert status is ExcitationStatus.EXCITING
    added = [0.1 * np.sin(2.0 * np.pi * 0.0625), 0.2 * np.sin(4.0 * np.pi * 0.0625), 0.0, 0.0]
    np.testing.assert_allclose(u - TRIM_U, added, atol=1e-12)
    np.testing.assert_allclose(run.state[:4], added, atol=1e-12)
    np.testing.assert_array_equal(run.law[LAST_U : LAST_U + 3], u[:3])
    assert run(21.01)[0] is ExcitationStatus.SILENT


@pytest.mark.parametrize("axis", [0, 1])
def test_it_fades_out_for_good_when_the_attitude_leaves_its_limit(axis):
    run = Run(kernel())
    tilted = np.array([0.04, 0.001] + [0.0] * 7)
    tilted[axis] -= np.radians(10.1)
    before = run(5.0625, tilted)[1][0] - TRIM_U[0]
    status, u = run(6.0625)
    assert status is ExcitationStatus.ATTITUDE
    assert "attitude_limit_deg" in status.sentence
    assert u[0] - TRIM_U[0] == pytest.approx(0.5 * before)
    for time_s in (7.07, 12.0, 30.0):
        status, u = run(time_s)
        assert status is ExcitationStatus.ATTITUDE
        np.testing.assert_array_equal(u, TRIM_U)


def test_a_deviation_inside_the_limit_is_borne():
    run = Run(kernel())
    tilted = np.array([0.04 + np.radians(9.9), 0.001] + [0.0] * 7)
    assert run(5.0, tilted)[0] is ExcitationStatus.EXCITING


def test_it_is_given_up_when_an_actuator_stands_at_its_limit():
    run = Run(kernel(amplitude=[0.0, 0.0, 0.0, 0.9, 0.0, 0.0, 0.0, 0.0], phase_rad=[1.57] * 8))
    statuses = [run(4.0 + 0.01 * i, u=np.array([0.0, 0.0, 0.0, 0.5]))[0] for i in range(8)]
    assert statuses[:5] == [ExcitationStatus.EXCITING] * 5
    assert statuses[-1] is ExcitationStatus.SATURATED
    run = Run(kernel(amplitude=[0.0, 0.0, 0.0, 0.9, 0.0, 0.0, 0.0, 0.0], phase_rad=[1.57] * 8))
    assert run(4.0, u=np.array([0.0, 0.0, 0.0, 0.5]))[1][3] == 0.98
    assert run.state[3] == pytest.approx(0.48)


def test_an_estimate_that_is_not_finite_ends_it_at_once():
    run = Run(kernel())
    assert run(5.0, np.full(9, np.nan))[0] is ExcitationStatus.NOT_FINITE
    status, u = run(5.01)
    assert status is ExcitationStatus.NOT_FINITE
    np.testing.assert_array_equal(u, TRIM_U)
    early = Run(kernel(start_s=0.0))
    early(1.0, np.full(9, np.nan))
    status, u = early(1.01)
    assert status is ExcitationStatus.NOT_FINITE
    np.testing.assert_array_equal(u, TRIM_U)


def test_one_line_of_nothing_is_off():
    assert not kernel(frequency_hz=[1.0], amplitude=[0.0] * 4, phase_rad=[0.0] * 4).on
    assert kernel().on


@pytest.mark.parametrize(
    ("changes", "sentence"),
    [
        ({"amplitude": [0.1] * 4}, "excitation.amplitude describes 1 lines; allowed: 2"),
        ({"phase_rad": [0.1] * 12}, "excitation.phase_rad describes 3 lines; allowed: 2"),
        ({"fade_s": 11.0}, "two fades of 11 s do not fit"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(changes, sentence):
    with pytest.raises(ShapeError, match=sentence):
        kernel(**changes)
