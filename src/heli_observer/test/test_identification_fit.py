# SPDX-License-Identifier: Apache-2.0
"""Identification of a linear aircraft whose numbers are known."""

import numpy as np
import pytest

from heli_observer.identification import fit_actuators, fit_gusts
from heli_observer.identification.structure import values_of
from heli_observer.identification.synthetic import Flight, fly, true_model


@pytest.fixture(scope="module")
def identified():
    return fit_actuators(fly(Flight(seed=1)))


def test_significant_entries_of_A_and_B(identified):
    truth = values_of(list(identified.sigma), true_model())
    for name, true in zip(identified.sigma, truth, strict=True):
        if identified.share.get(name, 0.0) < 0.01 or name.startswith("E"):
            continue
        place = dict(zip(identified.estimate.names, identified.estimate.values, strict=True))
        assert place[name] == pytest.approx(true, rel=0.03), name
    assert identified.servo_radps == pytest.approx(35.0, rel=0.01)
    assert identified.servo_damping == pytest.approx(0.55, rel=0.01)
    assert identified.delay_ticks == 1


def test_E_from_gusts(identified):
    gusts = fly(Flight(seed=7, u_amplitude=(0.0,) * 4, gust_mps=(0.35, 0.35, 0.35)))
    result = fit_gusts(gusts, identified, side="mean")
    true = true_model().E[:, :3]
    for i, row in ((0, 2), (1, 3), (4, 6)):
        error = np.abs(result.E[row] - true[i])
        assert np.all(error < 0.02 * np.abs(true[i]).max()), row
