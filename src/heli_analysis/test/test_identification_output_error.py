# SPDX-License-Identifier: Apache-2.0
"""Output error on chirps and multisines of an aircraft whose numbers are known."""

from dataclasses import replace

import numpy as np
import pytest

from heli_analysis.identification import (
    AperiodicRecord,
    IdentificationCause,
    IdentificationError,
    fit_actuators,
    output_error,
)
from heli_analysis.identification.model import assemble, transfer, values_of
from heli_analysis.identification.output_error import (
    BAND_HZ,
    MethodAgreement,
    RecordPiece,
    fit_output_error,
    pieces_of_experiment,
    pieces_of_record,
    refine,
    simulate,
)
from heli_core.ticks import TICK_S
from support.identification_flights import Flight, fly, true_model

MAIN = ("A(p,b_s)", "A(q,a_s)", "A(r,r)", "B(a_s,d_lon)", "B(b_s,d_lat)", "B(r,d_ped)",
        "servo.frequency_radps", "flapping.rate_1ps")  # fmt: skip
TRUE = values_of(MAIN, true_model())
START = assemble(MAIN, TRUE * np.resize([1.1, 0.92], TRUE.size), true_model())


CHIRPED = Flight(chirps_s=12.0, period_s=36.0, periods=1, u_amplitude=(0.05, 0.05, 0.08, 0.0))


def chirped(seed):
    flight = fly(replace(CHIRPED, seed=seed))
    return AperiodicRecord(
        flight.u, flight.excitation_u, flight.rate_body_radps, flight.vel_body_mps,
        flight.attitude_rad[:, :2], ((500, flight.u.shape[0]),),
    )  # fmt: skip


def test_a_simulated_sine_has_the_gain_and_phase_of_the_frequency_response():
    model = replace(true_model(), delay_s=0.013)
    omega, n = 2.0 * np.pi * 1.5, 6000
    t = np.arange(n) * TICK_S
    u, still = np.zeros((n, 4)), np.zeros((n, 3))
    u[:, 0] = np.sin(omega * t)
    vel = still.copy()
    vel[:, 1] = np.sin(omega * t)
    for k, piece in (
        (0, RecordPiece(u, still, still, still, 0)),
        (9, RecordPiece(0 * u, still, vel, still, 0)),
    ):
        rates = simulate(model, piece)[2000:]
        basis = np.column_stack([np.sin(omega * t), np.cos(omega * t)])[2000:]
        fitted = np.linalg.lstsq(basis, rates, rcond=None)[0]
        want = transfer(model, np.array([omega]))[0][:, k]
        np.testing.assert_allclose(fitted[0] + 1j * fitted[1], want, rtol=2e-3, atol=1e-4)


@pytest.mark.slow
def test_chirps_give_the_main_entries_with_an_honest_interval():
    found = fit_output_error(pieces_of_record(chirped(1), BAND_HZ), START, MAIN)
    np.testing.assert_allclose(found.values, TRUE, rtol=0.05)
    assert np.all(np.abs(found.values - TRUE) < 3.5 * found.sigma)
    # turbulence colours the residuals: the bound of white ones is far too small
    assert np.median(found.sigma / found.white_sigma) > 1.5
    assert np.all(found.fit < 0.25)


def test_periods_are_averaged_and_give_the_same():
    flight = fly(Flight(seed=2, period_s=10.0, periods=4, settle_s=10.0))
    found = fit_output_error(pieces_of_experiment(flight, BAND_HZ), START, MAIN)
    np.testing.assert_allclose(found.values, TRUE, rtol=0.05)


@pytest.mark.slow
def test_the_interval_holds_the_truth_in_95_of_100():
    """20 seeds, 8 entries; less two standard deviations of such a count."""
    z, white = [], []
    for seed in range(1, 21):
        found = fit_output_error(pieces_of_record(chirped(seed), BAND_HZ), START, MAIN)
        assert found.instrumented
        z.append((found.values - TRUE) / found.sigma)
        white.append((found.values - TRUE) / found.white_sigma)
    scatter = np.sqrt(0.95 * 0.05 / np.size(z))
    assert np.mean(np.abs(z) < 1.96) >= 0.95 - 2.0 * scatter
    assert np.mean(np.abs(white) < 1.96) < 0.8


def test_a_step_to_a_model_that_explodes_is_taken_again(monkeypatch):
    pieces, seen = pieces_of_record(chirped(1), BAND_HZ), []

    def refusing(model, piece):
        far = abs(model.A[4, 4] / START.A[4, 4] - 1.0) > 1e-3
        if far and not seen:
            seen.append(model)
            raise IdentificationError(IdentificationCause.UNSTABLE, "too far")
        return simulate(model, piece)

    monkeypatch.setattr(output_error, "simulate", refusing)
    found = fit_output_error(pieces, START, MAIN)
    assert seen
    np.testing.assert_allclose(found.values, TRUE, rtol=0.05)


def test_what_grows_beyond_numbers_and_what_is_too_short_is_named():
    record = chirped(1)
    A = true_model().A.copy()
    A[4, 4] = 40.0
    with pytest.raises(IdentificationError) as refused:
        fit_output_error(pieces_of_record(record, BAND_HZ), replace(START, A=A), MAIN)
    assert refused.value.cause is IdentificationCause.UNSTABLE
    with pytest.raises(IdentificationError) as refused:
        pieces_of_record(replace(record, runs=((0, 900), (1000, 1900))), BAND_HZ)
    assert refused.value.cause is IdentificationCause.TOO_SHORT


def test_agreement_counts_both_spreads():
    assert MethodAgreement("x", 10.0, 0.3, 10.9, 0.4, 0.1).agrees
    apart = MethodAgreement("x", -10.0, 0.3, -11.1, 0.4, 0.1)
    assert not apart.agrees and apart.deviation == pytest.approx(-0.11)


@pytest.mark.slow
def test_both_methods_agree_and_the_second_has_intervals_of_its_own():
    flight = fly(Flight(seed=1))
    first = fit_actuators(flight)
    second, found, rows = refine(flight, first)
    assert np.mean([row.agrees for row in rows]) > 0.8
    assert [row.name for row in rows] == list(found.names) == list(second.estimate.names)
    np.testing.assert_allclose(values_of(MAIN, second.fast), TRUE, rtol=0.05)
    assert second.A_sigma[2, 5] == found.sigma[found.names.index("A(p,b_s)")]
    assert second.delay_ticks == first.delay_ticks
    assert all(row.time_white_sigma < row.time_sigma for row in rows)
