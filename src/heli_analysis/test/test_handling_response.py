# SPDX-License-Identifier: Apache-2.0
"""Sweeps through systems whose response is a formula; boundaries; quickness of known steps."""

import numpy as np
import pytest
from scipy import signal
from scipy.optimize import brentq

from heli_analysis.handling.definitions import froude
from heli_analysis.handling.scoring import (
    Bandwidth,
    FrequencyResponse,
    Measure,
    Rejection,
    bandwidth,
    changes,
    frequency_response,
    of_bandwidth,
    of_rejection,
    rejection,
)
from heli_core.errors import HandlingCause, HandlingError

STEP_S = 0.01
OMEGA, DAMPING, DELAY_S = 6.0, 0.7, 0.1
TIME_S = np.arange(0.0, 120.0, STEP_S)
SWEEP = 0.1 * signal.chirp(TIME_S, 0.05, TIME_S[-1], 6.0, method="logarithmic", phi=-90.0)


def second_order(omega):
    """Response of the lag of second order behind the delay."""
    s = 1j * omega
    return OMEGA**2 / (s**2 + 2.0 * DAMPING * OMEGA * s + OMEGA**2) * np.exp(-s * DELAY_S)


def phase_deg(omega):
    lag = np.arctan2(2.0 * DAMPING * OMEGA * omega, OMEGA**2 - omega**2)
    return -np.degrees(lag + omega * DELAY_S)


def flown(noise=0.0):
    """The sweep's answer: simulated, not by the formula."""
    system = signal.lti([OMEGA**2], [1.0, 2.0 * DAMPING * OMEGA, OMEGA**2])
    late = np.interp(TIME_S - DELAY_S, TIME_S, SWEEP, left=0.0)
    _, answer, _ = signal.lsim(system, late, TIME_S)
    return answer + noise * np.random.default_rng(3).normal(size=TIME_S.size)


def test_a_sweep_gives_the_formulas_response():
    response = frequency_response(TIME_S, SWEEP, flown())
    inside = (response.omega_radps > 1.0) & (response.omega_radps < 30.0)
    assert np.count_nonzero(inside) > 50
    omega = response.omega_radps[inside]
    error = response.response[inside] / second_order(omega) - 1.0
    assert np.abs(error).max() < 0.05
    assert response.coherence[inside].min() > 0.95


@pytest.mark.parametrize("noise", [0.0, 0.005])
def test_bandwidth_and_phase_delay(noise):
    neutral = brentq(lambda w: phase_deg(w) + 180.0, 1.0, 30.0)
    criterion = bandwidth(frequency_response(TIME_S, SWEEP, flown(noise)))
    assert criterion.neutral_radps == pytest.approx(neutral, rel=0.03)
    by_phase = brentq(lambda w: phase_deg(w) + 135.0, 1.0, 30.0)
    assert criterion.phase_radps == pytest.approx(by_phase, rel=0.03)
    level = 2.0 * abs(second_order(neutral))
    by_gain = brentq(lambda w: abs(second_order(w)) - level, 4.0, neutral)
    assert criterion.gain_radps == pytest.approx(by_gain, rel=0.08)
    delay = -np.radians(phase_deg(2.0 * neutral) + 180.0) / (2.0 * neutral)
    assert criterion.phase_delay_s == pytest.approx(delay, rel=0.1)


def test_what_the_data_do_not_reach_is_none():
    omega = np.linspace(0.5, 8.0, 400)
    criterion = bandwidth(FrequencyResponse(omega, second_order(omega), np.ones(400)))
    assert criterion.neutral_radps is None and criterion.phase_delay_s is None
    assert criterion.phase_radps == pytest.approx(
        brentq(lambda w: phase_deg(w) + 135, 1, 30), rel=1e-3
    )


def test_rejection_of_a_known_sensitivity():
    """S = s^2 / (s^2 + 2 d w s + w^2): -3 dB and peak are formulas."""
    w, d = 2.0, 0.4

    def sensitivity(omega):
        s = 1j * omega
        return s**2 / (s**2 + 2.0 * d * w * s + w**2)

    system = signal.lti([1.0, 0.0, 0.0], [1.0, 2.0 * d * w, w**2])
    _, disturbed, _ = signal.lsim(system, SWEEP, TIME_S)
    criterion = rejection(frequency_response(TIME_S, SWEEP, disturbed))
    least = brentq(lambda o: 20.0 * np.log10(abs(sensitivity(o))) + 3.0, 0.5, w)
    peak = w / np.sqrt(1.0 - 2.0 * d**2)
    assert criterion.bandwidth_radps == pytest.approx(least, rel=0.05)
    assert criterion.peak_db == pytest.approx(20.0 * np.log10(abs(sensitivity(peak))), abs=0.4)
    assert criterion.peak_radps == pytest.approx(peak, rel=0.15)


def test_levels_of_bandwidth():
    def level(radps, delay_s=0.1, axis="roll", **more):
        return of_bandwidth(Bandwidth(radps, 3.0, 6.0, delay_s), axis, **more)[0].level

    assert [level(1.01), level(0.99), level(0.49)] == ["Level 1", "Level 2", "below"]
    assert [level(2.01, axis="yaw"), level(1.99, axis="yaw")] == ["Level 1", "Level 2"]
    assert level(5.0, delay_s=0.2) is None and level(None) is None
    root = (1.41 / 16.36) ** 0.5
    small = {"scale": froude(1.41), "delay_s": 0.1 * root}
    assert [level(1.01 / root, **small), level(0.99 / root, **small)] == ["Level 1", "Level 2"]


def test_levels_of_rejection():
    def levels(radps, peak_db, axis):
        return [m.level for m in of_rejection(Rejection(radps, peak_db, 3.0), axis)]

    for axis, least in (("roll", 0.9), ("pitch", 0.5), ("yaw", 0.7)):
        assert levels(least, 5.0, axis) == ["Level 1", "Level 1", None]
        assert levels(least - 0.01, 5.01, axis) == ["below", "below", None]
    assert levels(None, 4.0, "yaw") == [None, "Level 1", None]


def test_a_measure_as_json():
    assert list(Measure("a", "b", "s", 1.0).as_dict()) == [
        "name", "text", "unit", "bound", "value", "level_1", "level_2", "level",
    ]  # fmt: skip


@pytest.mark.parametrize(
    ("change", "cause", "words"),
    [
        (lambda x, y: (x[:100], y[:100]), HandlingCause.TOO_SHORT, "100 samples"),
        (lambda x, y: (0.0 * x, y), HandlingCause.NO_EXCITATION, "does not move"),
        (lambda x, y: (x, np.nan * y), HandlingCause.NOT_FINITE, "not finite"),
        (
            lambda x, y: (x, np.random.default_rng(1).normal(size=y.size)),
            HandlingCause.LOW_COHERENCE,
            "lines in a row",
        ),
    ],
)
def test_sweeps_that_say_nothing_are_refused(change, cause, words):
    sweep, answer = change(SWEEP, flown())
    with pytest.raises(HandlingError, match=words) as refused:
        frequency_response(TIME_S[: sweep.size], sweep, answer)
    assert refused.value.cause is cause


def test_an_unknown_axis():
    with pytest.raises(HandlingError, match="axis 'heave' is none of roll, pitch, yaw"):
        of_rejection(Rejection(1.0, 1.0, 1.0), "heave")


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_quickness_of_steps(sign):
    """Step of a second-order lag: peak, smallest change after it and peak rate are formulas."""
    t = np.arange(0.0, 20.0, STEP_S)
    system = signal.lti([OMEGA**2], [1.0, 2.0 * 0.5 * OMEGA, OMEGA**2])
    size = np.radians(20.0)
    _, angle, _ = signal.lsim(system, sign * size * ((t >= 2.0) & (t < 11.0)), t)
    steps = changes(t, angle)
    assert len(steps) == 2  # there and back, nothing of the ringing
    over = np.exp(-np.pi * 0.5 / np.sqrt(0.75))
    for change in steps:
        assert change.peak_deg == pytest.approx(20.0 * (1.0 + over), rel=0.01)
        assert change.least_deg == pytest.approx(20.0 * (1.0 - over**2), rel=0.01)
        rate = OMEGA * size * np.exp(-np.arccos(0.5) * 0.5 / np.sqrt(0.75))
        assert change.rate_radps == pytest.approx(rate, rel=0.01)
        assert change.quickness_per_s == pytest.approx(rate / (size * (1.0 + over)), rel=0.02)
    assert steps[0].start_s == pytest.approx(2.0, abs=0.05)


def test_a_sweep_holds_no_change_from_a_steady_attitude():
    assert changes(TIME_S, 3.0 * SWEEP) == []
