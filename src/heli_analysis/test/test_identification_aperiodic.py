# SPDX-License-Identifier: Apache-2.0
"""Responses and the fit of eq. (10) from chirps, of systems whose numbers are known."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import chirp, lfilter

from heli_analysis.identification import (
    AperiodicRecord,
    IdentificationCause,
    IdentificationError,
    fit_actuators,
    fit_record,
    joint_response,
)
from heli_analysis.identification.aperiodic import cuts, spectra_of_record
from heli_analysis.identification.model import values_of
from heli_analysis.identification.structure import STATE
from heli_core.ticks import TICK_S
from support.identification_flights import Flight, fly, true_model

RUN_S, QUIET_S = 60.0, 15.0
POLES, GAINS = (0.95, 0.9), (0.1, 0.05)


def swept(size):
    """(size, 2): a chirp on one input, then on the other, and quiet before and behind."""
    t = np.arange(round(RUN_S / TICK_S)) * TICK_S
    fade = np.clip(np.minimum(t, t[::-1]) / 5.0, 0.0, 1.0)
    u = np.zeros((size, 2))
    for i in range(2):
        one = 0.1 * fade * chirp(t, 0.2, RUN_S, 12.0, method="logarithmic", phi=-90.0)
        first = i * t.size + round(QUIET_S / TICK_S)
        u[first : first + t.size, i] = one
    return u


def opened(seed, noise=2e-3):
    """Inputs with a little of their own, the output of both, coloured noise on it."""
    rng = np.random.default_rng(seed)
    size = 2 * round((RUN_S + QUIET_S) / TICK_S)
    u = swept(size) + 2e-3 * rng.standard_normal((size, 2))
    y = sum(lfilter([GAINS[i]], [1.0, -POLES[i]], u[:, i]) for i in range(2))
    return u, (y + lfilter([noise], [1.0, -0.9], rng.standard_normal(size)))[:, None]


def truth(omega_radps):
    z = np.exp(1j * omega_radps * TICK_S)
    return np.stack([g / (1.0 - a / z) for a, g in zip(POLES, GAINS, strict=True)], axis=-1)[
        :, None
    ]


def test_the_circle_holds_the_truth_in_95_of_100():
    """Two inputs, one output, 20 seeds: every line, the weak ones too."""
    inside, share = [], []
    for seed in range(20):
        u, y = opened(seed)
        found = joint_response(u, y, TICK_S, highest_hz=11.0)
        error = np.abs(found.value - truth(found.omega_radps))
        inside.append(error <= found.radius(0.95))
        share.append(error / np.maximum(found.sigma, 1e-12))
    assert np.mean(inside) == pytest.approx(0.95, abs=0.025)
    assert np.mean(inside, axis=(0, 1, 2)) == pytest.approx(0.95, abs=0.04)
    assert np.sqrt(0.5 * np.mean(np.square(share))) == pytest.approx(1.0, abs=0.15)


def test_the_main_entries_are_within_5_percent_where_they_are_told():
    u, y = opened(1, noise=4e-4)
    found = joint_response(u, y, TICK_S, highest_hz=8.0)
    error = np.abs(found.value / truth(found.omega_radps) - 1.0)
    for i in range(2):
        good = found.usable(0, i) & (found.random_error[:, 0, i] < 0.03)
        assert good.sum() > 15
        assert np.quantile(error[good, 0, i], 0.95) < 0.05
        assert np.median(error[good, 0, i]) < 0.015


def test_random_error_is_that_of_coherence_for_one_input():
    """Bendat and Piersol, table 9.6: sqrt(1 - c) / (sqrt(c) sqrt(2 n))."""
    rng = np.random.default_rng(3)
    u = rng.standard_normal((60_000, 1))
    y = lfilter([0.1], [1.0, -0.9], u[:, 0])[:, None] + 0.1 * rng.standard_normal((60_000, 1))
    found = joint_response(u, y, TICK_S)
    c = found.coherence[:, 0]
    np.testing.assert_allclose(found.partial_coherence[:, 0, 0], c, rtol=1e-6)
    formula = np.sqrt((1.0 - c) / (2.0 * c * found.dof))
    ratio = found.random_error[:, 0, 0] / formula
    assert np.median(ratio) == pytest.approx(1.0, abs=0.1)


def looped(seed):
    """An output that is fed back into its input with noise as strong as the chirp's answer."""
    rng = np.random.default_rng(seed)
    size = round((RUN_S + QUIET_S) / TICK_S)
    added = swept(2 * size)[:size, :1]
    noise = 0.02 * rng.standard_normal(size)
    u, y, state = np.zeros((size, 1)), np.zeros((size, 1)), 0.0
    for k in range(size):
        y[k] = state + noise[k]
        u[k] = added[k] - 2.0 * y[k]
        state = 0.9 * state + 0.1 * u[k, 0]
    return added, u, y


def test_with_the_chirp_as_reference_a_loop_leaves_no_bias():
    bare, referenced = [], []
    for seed in range(6):
        added, u, y = looped(seed)
        for results, references in ((bare, None), (referenced, added)):
            found = joint_response(u, y, TICK_S, references, highest_hz=10.0)
            z = np.exp(1j * found.omega_radps * TICK_S)
            told = (found.omega_radps > 6.0) & (found.omega_radps < 25.0)
            results.append((found.value[:, 0, 0] / (0.1 / (z - 0.9)))[told].mean())
    assert found.instrumented
    assert abs(np.mean(bare) - 1.0) > 0.06
    assert abs(np.mean(referenced) - 1.0) < 0.03


def test_inputs_that_move_together_are_not_told_apart():
    u, y = opened(2)
    u[:, 1] = u[:, 0]
    found = joint_response(u, y, TICK_S)
    assert np.min(found.input_coherence) > 0.999
    assert not found.usable(0, 0).any()


def test_windows_do_not_reach_over_a_gap():
    size = 12_000
    (first, *_) = cuts(((0, 5000), (5100, size)), TICK_S, 2)
    ends = first.starts + first.size
    assert not np.any((first.starts < 5100) & (ends > 5000))
    assert first.correlation[0, 0] == pytest.approx(1.0)
    assert first.correlation[0, 2] == pytest.approx(1.0 / 6.0, abs=1e-3)


@pytest.mark.parametrize(
    ("harm", "cause"),
    [
        (lambda u, y: (u[:300], y[:300]), IdentificationCause.TOO_SHORT),
        (lambda u, y: (u * [1.0, 0.0], y), IdentificationCause.NO_EXCITATION),
        (lambda u, y: (np.where(u == u[7], np.nan, u), y), IdentificationCause.NOT_FINITE),
        (lambda u, y: (u[:-1], y), IdentificationCause.SHAPE),
        (lambda u, y: (u, y[:, 0]), IdentificationCause.SHAPE),
    ],
)
def test_what_cannot_be_evaluated_is_refused(harm, cause):
    with pytest.raises(IdentificationError) as refused:
        joint_response(*harm(*opened(1)), TICK_S)
    assert refused.value.cause is cause


# -------------------------------------------------------------------------------------------------
# The fit of eq. (10) to chirps in the closed loop, with turbulence, as `fit_actuators` to lines.
# -------------------------------------------------------------------------------------------------

CHIRPS_S = 90.0


def record(seed, model=None):
    flight = fly(
        Flight(
            seed=seed, chirps_s=CHIRPS_S, period_s=4 * CHIRPS_S, periods=1,
            u_amplitude=(0.05, 0.05, 0.08, 0.08), model=model or true_model(),
        )
    )  # fmt: skip
    return AperiodicRecord(
        flight.u, flight.excitation_u, flight.rate_body_radps, flight.vel_body_mps,
        flight.attitude_rad[:, :2], ((2000, flight.u.shape[0]),),
    )  # fmt: skip


MAIN = (
    "A(p,b_s)", "A(q,a_s)", "A(r,r)", "A(r,d_int)", "A(p,r)", "A(p,d_int)", "A(a_s,b_s)",
    "A(b_s,a_s)", "B(a_s,d_lat)", "B(a_s,d_lon)", "B(b_s,d_lat)", "B(b_s,d_lon)", "B(p,d_ped)",
    "B(r,d_ped)", "B(d_int,d_ped)", "B(r,d_col)",
)  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 2])
def test_a_chirp_on_each_axis_gives_the_model(seed):
    found = fit_record(record(seed))
    values = dict(zip(found.estimate.names, found.estimate.values, strict=True))
    for name, true in zip(MAIN, values_of(MAIN, true_model()), strict=True):
        assert values[name] == pytest.approx(true, rel=0.05), name
    assert found.servo_radps == pytest.approx(35.0, rel=0.02)
    assert found.fast.A[STATE.a_s, STATE.a_s] == pytest.approx(-3.4, rel=0.05)
    assert found.delay_ticks == 1
    assert found.delay_s == pytest.approx(0.01, abs=5e-4)
    names = [n for n in MAIN if n in found.sigma]
    truth_of = dict(zip(names, values_of(names, true_model()), strict=True))
    z = np.array([(values[n] - truth_of[n]) / found.sigma[n] for n in names])
    assert np.mean(np.abs(z) < 2.0) >= 0.9


def test_spectra_of_a_record_are_lines_of_each_channel_with_their_noise():
    spectra = spectra_of_record(record(1))
    assert set(spectra.channel) == {0, 1, 2, 3}
    assert spectra.dof > 20.0
    assert np.all(np.diff(spectra.omega_radps) >= 0.0)
    own = spectra.channel == 0
    assert np.median(np.abs(spectra.z[own, 3]) / np.abs(spectra.z[own, 4])) > 3.0
    covariance = spectra.noise_covariance()
    assert np.all(np.linalg.eigvalsh(covariance) > -1e-12)


def test_a_record_without_excitation_is_refused():
    whole = record(1)
    with pytest.raises(IdentificationError) as refused:
        spectra_of_record(replace(whole, excitation_u=np.zeros_like(whole.u)))
    assert refused.value.cause is IdentificationCause.NO_EXCITATION
    with pytest.raises(IdentificationError) as refused:
        spectra_of_record(replace(whole, runs=((0, 3000),)))
    assert refused.value.cause is IdentificationCause.TOO_SHORT


# -------------------------------------------------------------------------------------------------
# Starts beyond all numbers, and aircraft without a yaw gyro.
# -------------------------------------------------------------------------------------------------


def test_a_start_that_explodes_ends_in_a_named_cause():
    """SciPy would raise a bare ValueError: residuals are not finite in the initial point."""
    model = true_model()
    A = model.A.copy()
    A[STATE.r, STATE.r] = 9e4
    with pytest.raises(IdentificationError) as refused:
        fit_actuators(fly(Flight(seed=1, periods=4)), start=replace(model, A=A))
    assert refused.value.cause is IdentificationCause.NOT_CONVERGED


@pytest.mark.slow
def test_an_aircraft_without_a_yaw_gyro_is_told_by_its_zero():
    model = true_model()
    A, B = model.A.copy(), model.B.copy()
    A[STATE.r, STATE.r], A[STATE.r, STATE.d_int], A[STATE.p, STATE.d_int] = -2.0, 0.0, 0.0
    B[STATE.d_int] = 0.0
    found = fit_actuators(fly(Flight(seed=1, model=replace(model, A=A, B=B))))
    fast = found.fast
    assert fast.A[STATE.r, STATE.r] == pytest.approx(-2.0, rel=0.03)
    assert fast.B[STATE.r, 2] == pytest.approx(-80.0, rel=0.02)
    assert abs(fast.A[STATE.r, STATE.d_int]) < 0.1
