# SPDX-License-Identifier: Apache-2.0
"""Identification of a linear aircraft whose numbers are known, flown with turbulence and noise."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.signal import cont2discrete, dlsim

from heli_analysis.identification import fit_actuators, fit_gusts, measured_response, trim_of
from heli_analysis.identification.actuators import sampled_rates
from heli_analysis.identification.estimator import Problem, StartSearch, estimate
from heli_analysis.identification.model import assemble, place_of, transfer, values_of
from heli_analysis.identification.spectra import GUST, U, spectra_of
from heli_analysis.identification.structure import DELAY, FLAPPING, FULL
from heli_core.linear import with_servos
from support.identification_flights import TRIM, Flight, fly, true_model

GUSTS = Flight(seed=7, u_amplitude=(0.0,) * 4, gust_mps=(0.35, 0.35, 0.35))


@pytest.fixture(scope="module")
def flight():
    return fly(Flight(seed=1))


@pytest.fixture(scope="module")
def identified(flight):
    return fit_actuators(flight)


def test_significant_entries_of_A_and_B(identified):
    values = dict(zip(identified.estimate.names, identified.estimate.values, strict=True))
    names = [n for n in identified.sigma if n[0] != "E" and identified.share.get(n, 0.0) >= 0.01]
    assert len(names) >= 15
    for name, true in zip(names, values_of(names, true_model()), strict=True):
        assert values[name] == pytest.approx(true, rel=0.02), name
    assert identified.servo_radps == pytest.approx(35.0, rel=0.005)
    assert identified.servo_damping == pytest.approx(0.55, rel=0.005)
    assert identified.delay_ticks == 1
    assert identified.delay_s == pytest.approx(0.01, abs=1e-4)
    assert identified.fast.A[2, 2] == pytest.approx(-3.4, rel=0.02)


def test_cost_and_sigma_are_believable(identified):
    result = identified.estimate
    assert abs(result.cost - result.expected_cost) < 4.0 * result.cost_sigma
    assert result.distortion < 0.005
    truth = dict(
        zip(identified.sigma, values_of(list(identified.sigma), true_model()), strict=True)
    )
    values = dict(zip(result.names, result.values, strict=True))
    z = [(values.get(n, 0.0) - truth[n]) / s for n, s in identified.sigma.items() if n != DELAY]
    assert np.max(np.abs(z)) < 4.5
    assert np.sqrt(np.mean(np.square(z))) < 1.5


def test_kinematic_rows_come_from_the_trim_attitude(identified):
    phi = identified.phi_rad
    assert phi == pytest.approx(TRIM[0], abs=0.01)
    assert identified.A[1, 6] == pytest.approx(-np.sin(phi))
    assert identified.A[0, 2] == 1.0
    assert np.all(identified.A[:, [0, 1, 8]] == 0.0)
    assert identified.A[4, 3] == identified.A[5, 2] == identified.A[7, 6] == -1.0


def test_E_from_gusts(identified):
    result = fit_gusts(fly(GUSTS), identified, side="mean")
    true = true_model().E[:, :3]
    for i, row in ((0, 2), (1, 3), (4, 6)):
        error = np.abs(result.E[row] - true[i])
        assert np.all(error < 0.03 * np.abs(true[i]).max()), row
    assert result.E_rw["descent"] == pytest.approx(result.E_rw["climb"], abs=0.03)
    assert result.coherence["v"] > 0.9
    with pytest.raises(ValueError, match="side 'left' is not allowed"):
        fit_gusts(fly(GUSTS), identified, side="left")


def test_wrong_by_a_tick_is_seen(flight, identified):
    spectra = spectra_of(flight)
    for tick, sign in ((0, -1.0), (2, 1.0)):
        late = replace(identified.fast, delay_s=0.01 * tick)
        problem = Problem([spectra], (), late)
        assert np.sum(problem.residual(np.zeros(0)) ** 2) > 100.0 * identified.estimate.cost, sign


@pytest.mark.parametrize("delay_s", [0.0, 0.013, 0.02])
def test_fractional_delay_by_superposition(delay_s):
    """A delay of k + f ticks, played out finely in time, against the closed form."""
    fine, h = 10, 0.01
    model = replace(true_model(), delay_s=delay_s)
    F, G = with_servos(model.A, model.B, model.servo_radps, model.servo_damping)
    system = (F, G, np.eye(14)[[0, 1, 4]], np.zeros((3, 4)))
    period, count = 200, 8
    t = np.arange(period * count) * h
    u = np.zeros((t.size, 4))
    omega = 2.0 * np.pi * 5.0 / (period * h)
    u[:, 0] = np.cos(omega * t)
    held = np.repeat(u, fine, axis=0)
    shift = round(delay_s / h * fine)
    held = np.vstack([np.zeros((shift, 4)), held])[: held.shape[0]]
    _, y, _ = dlsim(cont2discrete(system, h / fine)[:4] + (h / fine,), held)
    last = y[::fine][-period:]
    measured = np.fft.rfft(last, axis=0)[5] * 2.0 / period
    expected = transfer(model, np.array([omega]))[0, :, 0]
    assert np.abs(measured - expected).max() < 2e-3 * np.abs(expected).max()


@pytest.mark.parametrize("delay_s", [0.0, 0.013, 0.02])
def test_responses_of_the_fit_are_those_of_python_control(delay_s):
    """The estimator's own closed form against the sampled system with its delay line."""
    model = replace(true_model(), delay_s=delay_s)
    omega = np.array([0.5, 3.0, 20.0, 60.0])
    system = sampled_rates(model)
    theirs = system(np.exp(1j * omega * system.dt))
    inputs = [*range(U.start - 3, U.stop - 3), *range(GUST.start - 3, GUST.stop - 3)]
    ours = np.moveaxis(transfer(model, omega)[:, :, inputs], 0, 2)
    np.testing.assert_allclose(ours, theirs, rtol=1e-9, atol=1e-13)


@pytest.mark.slow
def test_confidence_over_seeds_and_periods():
    """Errors over sigma have unit variance; four times the periods halve the errors."""
    true = true_model()
    names = tuple(
        name
        for name in FULL.actuator_parameters(collective=True)
        if place_of(name) is not None and values_of([name], true)[0] != 0.0
    ) + (FLAPPING,)
    truth = values_of(names, true)
    z, rms = [], {}
    for periods in (4, 16):
        squares = []
        for seed in range(5):
            spectra = spectra_of(fly(Flight(seed=50 + seed, periods=periods, period_s=10.0)))
            problem = Problem([spectra], names, assemble(names, truth, true))
            result = estimate(problem, truth * 1.02, joint=False)
            error = (result.values - truth) / result.sigma
            z.append(error)
            squares.append((result.values - truth) ** 2)
        rms[periods] = np.sqrt(np.mean(squares, axis=0))
    spread = np.mean(np.square(z))
    assert 0.6 < spread < 1.6
    ratio = np.exp(np.mean(np.log(rms[4] / rms[16])))
    assert 1.4 < ratio < 3.2


@pytest.mark.parametrize(("channel", "rate"), [("lat", "p"), ("lon", "q"), ("ped", "r")])
def test_measured_responses_are_those_of_the_true_model(flight, channel, rate):
    """At every line within its own confidence; the delay is in it."""
    true = true_model()
    measured = measured_response(spectra_of(flight), true, rate, channel)
    assert measured.value.size == 20
    system = sampled_rates(true)
    expected = system[rate, f"d_{channel}"](np.exp(1j * measured.omega_radps * system.dt))
    error = np.abs(measured.value - expected)
    # |H - H_true| has two parts of the standard deviation of |H|
    z_squared = (error / measured.sigma) ** 2
    assert np.all(z_squared < 30.0) and 0.8 < np.mean(z_squared) < 4.0
    strong = (measured.omega_radps > 3.0) & (measured.omega_radps < 44.0)  # noise is below 1 %
    assert np.all(error[strong] < 0.02 * np.abs(expected)[strong])
    assert np.median(measured.coherence) > 0.99


def test_yaw_agrees_with_output_error_in_the_time_domain(flight, identified):
    """Second method: simulate r from the record in time, fit by least squares, no spectra."""
    steady = flight.steady()
    base = identified.fast
    wind = (steady.gust_body_mps - steady.vel_body_mps) @ base.E[4, :3]
    known = steady.rate_body_radps[:, 0] * base.A[4, 0] + wind
    delayed = np.vstack([steady.u[:1], steady.u[:-1]])[:, 2:]
    inputs = np.column_stack([delayed, known])
    w, zeta = base.servo_radps, base.servo_damping

    def simulate(x):
        A = np.zeros((6, 6))
        A[0, :2], A[1, 0] = [x[0], x[1]], -1.0
        A[0, 2], A[1, 2], A[0, 3] = x[2], x[3], x[4]
        A[2:4, 4:] = np.eye(2)
        A[4:, 2:4], A[4:, 4:] = -(w**2) * np.eye(2), -2.0 * zeta * w * np.eye(2)
        B = np.zeros((6, 3))
        B[4:, :2], B[0, 2] = w**2 * np.eye(2), 1.0
        system = cont2discrete((A, B, np.eye(6)[:1], np.zeros((1, 3))), 0.01)[:4]
        _, y, _ = dlsim((*system, 0.01), inputs)
        return (y[:, 0] - steady.rate_body_radps[:, 2])[500:]

    start = np.array([-15.0, 80.0, -60.0, -3.0, 1.0])
    result = least_squares(simulate, start, x_scale=np.abs(start))
    entries = [base.A[4, 4], base.A[4, 5], base.B[4, 2], base.B[5, 2], base.B[4, 3]]
    np.testing.assert_allclose(result.x, entries, rtol=0.05)


def test_trim_of_means_and_flapping_equilibrium(flight, identified):
    trim = trim_of([flight, flight], identified)
    assert trim.x[:2] == pytest.approx(TRIM, abs=0.01)
    residual = identified.fast.A[2:4, 2:4] @ trim.x[4:6] + identified.fast.B[2:4, :2] @ trim.u[:2]
    assert np.abs(residual).max() < 1e-12
    assert np.all(trim.x_sigma[:2] > 0.0)
    assert trim.x[7] == trim.x[8] == 0.0


@pytest.mark.parametrize(("rate", "servo", "stiff"), [(8.3, 36.0, 0.75), (31.0, 60.0, 2.0)])
def test_start_needs_no_hint_of_the_aircraft(rate, servo, stiff):
    base = true_model()
    A, B = base.A.copy(), base.B.copy()
    A[2, 2] = A[3, 3] = -rate
    A[0, 3], A[1, 2] = stiff * A[0, 3], stiff * A[1, 2]
    B[2:4] *= rate / 3.4 * 0.7
    model = replace(base, A=A, B=B, servo_radps=servo)
    start = StartSearch(spectra_of(fly(Flight(seed=2, periods=4, model=model)))).best()
    assert -start.A[2, 2] == pytest.approx(rate, rel=0.1)
    assert start.servo_radps == pytest.approx(servo, rel=0.1)
    assert start.A[0, 3] == pytest.approx(A[0, 3], rel=0.1)
    assert start.A[1, 2] == pytest.approx(A[1, 2], rel=0.1)
