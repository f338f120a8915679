# SPDX-License-Identifier: Apache-2.0
"""An AH-1S that nobody here modelled, JSBSim's, identified from chirps: what holds, what does not.

JSBSim (https://jsbsim.sourceforge.net, LGPL) is not part of this stack and none of its numbers are
here: the test needs its wheel, `pip install jsbsim`, and is skipped without it. The helicopter
takes off and is held in hover by a simple feedback. Its rotor has no flapping states, its tail no
gyro. Truth is a second flight, of doublets, that the fit has not seen.
"""

import numpy as np
import pytest

from heli_analysis.identification import AperiodicRecord
from heli_analysis.identification.doubts import StructureDoubt, structure_doubts
from heli_analysis.identification.model import FastModel
from heli_analysis.identification.output_error import pieces_of_record, simulate
from heli_analysis.identification.structure import STATE

pytest.importorskip("jsbsim")
from support.ah1s import doublets, hovered  # noqa: E402
from support.ah1s_loops import identified  # noqa: E402

BAND_HZ = (0.2, 4.0)
GOOD_THEIL = 0.25
"""Theil's inequality coefficient below which a prediction is called good (Jategaonkar, 2015)."""


def theil(model: FastModel, record: AperiodicRecord):
    """Of p, q, r (3,) of the simulated model on a record, in the band."""
    piece = pieces_of_record(record, BAND_HZ)[0]
    made, measured = simulate(model, piece)[piece.settled :], piece.rate_body_radps[piece.settled :]
    rms = [np.sqrt(np.mean(x**2, axis=0)) for x in (made - measured, made, measured)]
    return rms[0] / (rms[1] + rms[2])


@pytest.mark.nightly
def test_the_quasi_static_model_predicts_doublets_that_it_has_not_seen():
    assert np.all(theil(identified().fast, hovered(doublets(), 2).record) < GOOD_THEIL)


@pytest.mark.nightly
def test_its_dampings_and_controls_are_those_of_a_large_helicopter():
    """Roll is damped more than pitch, pitch more than yaw; sticks work in their own axes."""
    found = identified()
    A, B = found.fast.A, found.fast.B
    p, q, r = STATE.p, STATE.q, STATE.r
    assert A[p, p] < 3.0 * A[q, q] < 0.0 and A[q, q] < A[r, r] < 0.0
    assert B[p, 0] > 0.0 > B[q, 1] and B[r, 2] < 0.0  # right, forward is down, JSBSim's rudder
    assert abs(B[q, 0]) < 0.05 * abs(B[q, 1]) and abs(B[p, 1]) < 0.05 * abs(B[p, 0])


@pytest.mark.nightly
def test_what_a_quasi_static_rotor_leaves_of_it_is_told():
    """A few percent that no noise explains (JSBSim's inflow lags), and it is said."""
    found = identified()
    assert 0.01 < found.estimate.distortion < 0.05
    assert structure_doubts(found) == (StructureDoubt.UNEXPLAINED,)
