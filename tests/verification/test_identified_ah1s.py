# SPDX-License-Identifier: Apache-2.0
"""An AH-1S that nobody here modelled, JSBSim's, identified from chirps: what holds, what does not.

JSBSim (https://jsbsim.sourceforge.net, LGPL) is not part of this stack and none of its numbers are
here: the test needs its wheel, `pip install jsbsim`, and is skipped without it. The helicopter
takes off and is held in hover by a simple feedback. Its rotor has no flapping states, its tail no
gyro. Truth is a second flight, of doublets, that the fit has not seen.
"""

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import chirp

from heli_analysis.identification import AperiodicRecord, fit_record
from heli_analysis.identification.doubts import StructureDoubt, structure_doubts
from heli_analysis.identification.model import FastModel
from heli_analysis.identification.output_error import pieces_of_record, simulate
from heli_analysis.identification.structure import STATE, ModelStructure, Rotor
from heli_core.ticks import TICK_S

jsbsim = pytest.importorskip("jsbsim")

RIGID = ModelStructure(Rotor.QUASI_STATIC, yaw_gyro=False)
M_PER_FT = 0.3048
STEPS = 4  # of JSBSim in a tick
SPIN_UP_S, CLIMB_MPS, HEIGHT_M, STEADY_S = 10.0, 2.0, 100.0, 80.0
CONTROLS = ("aileron", "elevator", "rudder", "collective")
CENTRE = np.array([0.22, -0.18, 0.39, 0.5])  # of the sticks in hover, about
BAND_HZ = (0.2, 4.0)
AMPLITUDE = np.array([0.10, 0.06, 0.08, 0.02])
CHIRP_S, DOUBLET_S = 80.0, 20.0
GOOD_THEIL = 0.25
"""Theil's inequality coefficient below which a prediction is called good (Jategaonkar, 2015)."""


def chirps():
    """(n, 4): one on each stick in its turn."""
    t = np.arange(round(CHIRP_S / TICK_S)) * TICK_S
    fade = np.clip(np.minimum(t, t[::-1]) / 3.0, 0.0, 1.0)
    one = fade * chirp(t, 0.1, CHIRP_S, 4.0, method="logarithmic", phi=-90.0)
    return np.kron(np.diag(AMPLITUDE), one[:, None])


def doublets():
    """(n, 4): one a second long on each stick in its turn."""
    t = np.arange(round(DOUBLET_S / TICK_S)) * TICK_S
    one = np.where((t >= 8.0) & (t < 9.0), np.sign(8.5 - t), 0.0)
    return np.kron(np.diag(0.7 * AMPLITUDE), one[:, None])


def hovered(added, seed):
    """A record of the flight in hover with `added` (n, 4) on the sticks, in still air."""
    fdm = jsbsim.FGFDMExec(str(Path(jsbsim.__file__).parent))
    fdm.set_debug_level(0)
    fdm.load_model("ah1s")
    fdm.set_dt(TICK_S / STEPS)
    fdm["ic/h-agl-ft"] = 6.3
    fdm.run_ic()
    fdm["fcs/adj/collective-profile"], fdm["fcs/adj/center-sensitivity"] = 0.0, 1.0
    fdm["fcs/rpm-governor-active-norm"] = 1.0
    first = round(STEADY_S / TICK_S)
    n = first + added.shape[0]
    extra = np.vstack([np.zeros((first, 4)), added])
    speed_sum, yaw, lift = np.zeros(2), CENTRE[2], CENTRE[3]
    rows = np.empty((n, 12))
    for k in range(n):
        t = k * TICK_S
        phi, theta, psi = (fdm[f"attitude/{name}-rad"] for name in ("phi", "theta", "psi"))
        psi = (psi + np.pi) % (2.0 * np.pi) - np.pi
        p, q, r = (fdm[f"velocities/{name}-rad_sec"] for name in "pqr")
        vel = np.array([fdm[f"velocities/{name}-fps"] for name in "uvw"]) * M_PER_FT
        u = np.array([0.0, 0.0, 0.35, 0.0])
        if t >= SPIN_UP_S:
            wanted = min(2.0 + CLIMB_MPS * (t - SPIN_UP_S), HEIGHT_M)
            high = wanted - fdm["position/h-agl-ft"] * M_PER_FT
            speed_sum += 0.002 * vel[:2] * TICK_S
            yaw += 0.1 * psi * TICK_S
            lift += 0.01 * high * TICK_S
            theta_c = np.clip(0.03 * vel[0] + speed_sum[0], -0.2, 0.2)
            phi_c = np.clip(-0.03 * vel[1] - speed_sum[1], -0.2, 0.2)
            u = np.array(
                [
                    CENTRE[0] - (phi - phi_c) - 0.5 * p,
                    CENTRE[1] + (theta - theta_c) + q,
                    1.5 * psi + r + yaw,
                    np.clip(0.05 * high + 0.1 * vel[2] + lift, 0.0, 1.0),
                ]
            )
        u = u + extra[k]
        for name, value in zip(CONTROLS, u, strict=True):
            fdm[f"fcs/{name}-cmd-norm"] = value
        rows[k] = *u, p, q, r, *vel, phi, theta
        for _ in range(STEPS):
            fdm.run()
    rng = np.random.default_rng(seed)
    rates = rows[first:, 4:7] + 5e-4 * rng.standard_normal((n - first, 3))
    vel = rows[first:, 7:10] + 0.01 * rng.standard_normal((n - first, 3))
    return AperiodicRecord(rows[first:, :4], added, rates, vel, rows[first:, 10:])


@cache
def identified():
    return fit_record(hovered(chirps(), 1), structure=RIGID)


def theil(model: FastModel, record: AperiodicRecord):
    """Of p, q, r (3,) of the simulated model on a record, in the band."""
    piece = pieces_of_record(record, BAND_HZ)[0]
    made, measured = simulate(model, piece)[piece.settled :], piece.rate_body_radps[piece.settled :]
    rms = [np.sqrt(np.mean(x**2, axis=0)) for x in (made - measured, made, measured)]
    return rms[0] / (rms[1] + rms[2])


@pytest.mark.nightly
def test_the_quasi_static_model_predicts_doublets_that_it_has_not_seen():
    assert np.all(theil(identified().fast, hovered(doublets(), 2)) < GOOD_THEIL)


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
