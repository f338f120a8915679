# SPDX-License-Identifier: Apache-2.0
"""Chirps on a published helicopter, the Blade 360, identified in the time domain.

Its fast states, stepped here in the textbook's way, with air speed that is measured, gusts that are
not, and a noisy gyro.
"""

import numpy as np
import pytest
from scipy.signal import chirp, lfilter

from heli_analysis.identification import AperiodicRecord
from heli_analysis.identification.model import FAST, RATE_PLACES, FastModel, assemble, values_of
from heli_analysis.identification.output_error import BAND_HZ, fit_output_error, pieces_of_record
from heli_analysis.identification.structure import AIR, N_FAST
from heli_core.linear import held, with_servos
from heli_core.rows import ACTUATOR
from heli_core.ticks import TICK_S
from heli_dynamics_sim.linear_aircraft import LinearAircraft

MAIN = ("A(p,b_s)", "A(q,a_s)", "A(a_s,b_s)", "A(b_s,a_s)", "B(a_s,d_lat)", "B(a_s,d_lon)",
        "B(b_s,d_lat)", "B(b_s,d_lon)", "A(r,r)", "B(r,d_ped)", "flapping.rate_1ps")  # fmt: skip
CHIRP_S = 20.0


def published():
    """Its fast states behind quick servos, with the delay of the publication."""
    aircraft = LinearAircraft.from_yaml("blade360")
    A, B9, E9, _ = aircraft.nine()
    B, E = np.zeros((N_FAST, ACTUATOR.size)), np.zeros((N_FAST, AIR.size))
    B[:, ACTUATOR.attitude], E[:, AIR.velocity] = B9[FAST], E9[FAST]
    return FastModel(A[FAST, FAST], B, E, 200.0, 0.7, aircraft.delay_s)


def flown(truth, seed):
    rng = np.random.default_rng(seed)
    t = np.arange(round(CHIRP_S / TICK_S)) * TICK_S
    one = np.clip(np.minimum(t, t[::-1]) / 2.0, 0.0, 1.0) * chirp(t, 0.2, CHIRP_S, 11.0, "log")
    n = 3 * t.size
    u = np.zeros((n, ACTUATOR.size))
    for i in range(3):
        u[i * t.size : (i + 1) * t.size, i] = 0.08 * one
    slow, noise = 0.995, rng.standard_normal
    vel, gust = (lfilter([s], [1.0, -slow], noise((n, 3)), axis=0) for s in (0.03, 0.01))
    F, G = with_servos(truth.A, truth.B, truth.servo_radps, truth.servo_damping)
    wind = np.vstack([truth.E[:, AIR.velocity], np.zeros((2 * ACTUATOR.size, 3))])
    Phi, Gamma = held(F, np.hstack([G, wind]), TICK_S)
    late = np.roll(u, round(truth.delay_s / TICK_S), axis=0)
    x, rates = np.zeros(F.shape[0]), np.empty((n, 3))
    for k in range(n):
        rates[k] = x[RATE_PLACES]
        air = gust[k] - 0.5 * (vel[k] + vel[min(k + 1, n - 1)])
        x = Phi @ x + Gamma @ np.concatenate([late[k], air])
    return AperiodicRecord(u, u, rates + 1e-3 * noise((n, 3)), vel, np.zeros((n, 2)))


@pytest.mark.slow
def test_main_entries_of_the_blade_360_are_within_5_percent():
    truth = published()
    true = values_of(MAIN, truth)
    start = assemble(MAIN, true * np.resize([1.06, 0.95], true.size), truth)
    found = fit_output_error(pieces_of_record(flown(truth, 1), BAND_HZ), start, MAIN)
    np.testing.assert_allclose(found.values, true, rtol=0.05)
    assert np.mean(np.abs(found.values - true) < 2.0 * found.sigma) > 0.7
