# SPDX-License-Identifier: Apache-2.0
"""Every refusal of an identification: its cause, and a sentence with signal and number."""

from dataclasses import replace

import numpy as np
import pytest

from heli_analysis.identification import (
    IdentificationCause,
    IdentificationError,
    RotorGeometry,
    fit_actuators,
    fit_collective,
    fit_gusts,
)
from heli_analysis.identification.actuators import _check_physical
from support.identification_flights import Flight, fly, true_model

ROTOR = RotorGeometry(1.29, 193.73, 0.705, 5.52, 2.0, 0.062)


@pytest.fixture(scope="module")
def flight():
    return fly(Flight(seed=3, periods=4, period_s=10.0, settle_s=10.0))


@pytest.fixture(scope="module")
def known(flight):
    class Known:
        fast = true_model()

    return Known()


def refused(call, cause, *words):
    with pytest.raises(IdentificationError) as caught:
        call()
    assert caught.value.cause is cause
    for word in words:
        assert word in str(caught.value), str(caught.value)
    assert "\n" not in str(caught.value)


def changed(flight, name, row, value, column=0):
    array = getattr(flight, name).copy()
    if array.ndim == 1:
        array[row] = value
    else:
        array[row, column] = value
    return replace(flight, **{name: array})


@pytest.mark.parametrize(
    "name", ["u", "rate_body_radps", "vel_body_mps", "accel_body_mps2", "attitude_rad"]
)
def test_not_finite(flight, name):
    bad = changed(flight, name, 1500, np.nan)
    refused(lambda: fit_actuators(bad), IdentificationCause.NOT_FINITE, name, "15.00 s")


def test_gap(flight):
    time_s = flight.time_s.copy()
    time_s[2000:] += 0.05
    refused(
        lambda: fit_actuators(replace(flight, time_s=time_s)),
        IdentificationCause.GAP,
        "0.06 s",
        "19.99 s",
    )


def test_too_short(flight):
    refused(
        lambda: fit_actuators(replace(flight, periods=6)),
        IdentificationCause.TOO_SHORT,
        "6 periods",
        "49.99",
    )
    refused(
        lambda: fit_actuators(replace(flight, periods=3)),
        IdentificationCause.TOO_SHORT,
        "periods = 3",
    )
    refused(
        lambda: fit_actuators(replace(flight, start_s=-5.0)), IdentificationCause.TOO_SHORT, "-5 s"
    )


def test_shape(flight):
    refused(
        lambda: replace(flight, u=flight.u[:-1]),
        IdentificationCause.SHAPE,
        "u has shape",
        "(5000, 4)",
    )
    refused(
        lambda: fit_actuators(replace(flight, period_s=10.003)), IdentificationCause.SHAPE, "10.003"
    )


def test_no_excitation(flight, known):
    silent = replace(flight, excitation_u=np.zeros_like(flight.u))
    refused(lambda: fit_actuators(silent), IdentificationCause.NO_EXCITATION, "excitation_u")
    one = flight.excitation_u.copy()
    one[:, 1] = 0.0
    bad = replace(flight, excitation_u=one)
    refused(lambda: fit_actuators(bad), IdentificationCause.NO_EXCITATION, "excitation_u.lon")
    refused(lambda: fit_gusts(flight, known), IdentificationCause.NO_EXCITATION, "gust_body_mps.u")
    only = flight.excitation_u.copy()
    only[:, 3] = 0.0
    bad = replace(flight, excitation_u=only)
    refused(
        lambda: fit_collective(bad, known, 9.75, 9.8, ROTOR),
        IdentificationCause.NO_EXCITATION,
        "excitation_u.col",
    )


def test_not_periodic(flight):
    fading = flight.excitation_u.copy()
    fading[3500:] = 0.0
    refused(
        lambda: fit_actuators(replace(flight, excitation_u=fading)),
        IdentificationCause.NOT_PERIODIC,
        "excitation_u.",
        "%",
    )


def test_low_coherence(flight):
    noise = np.random.default_rng(1).standard_normal(flight.rate_body_radps.shape)
    bad = replace(flight, rate_body_radps=noise)
    refused(
        lambda: fit_actuators(bad),
        IdentificationCause.LOW_COHERENCE,
        "p answers excitation_u.lat",
        "0.60",
    )


def test_collective_lost_in_noise(flight, known):
    noise = np.random.default_rng(2).standard_normal(flight.accel_body_mps2.shape)
    bad = replace(flight, accel_body_mps2=1e-3 * noise)
    refused(
        lambda: fit_collective(bad, known, 9.75, 9.8, ROTOR),
        IdentificationCause.LOW_COHERENCE,
        "accel_body_mps2.z",
    )


def test_too_few_lines():
    few = fly(Flight(seed=3, periods=4, period_s=2.0, settle_s=5.0))
    refused(lambda: fit_actuators(few), IdentificationCause.TOO_FEW_LINES, "lines")


def test_unphysical():
    model = true_model()
    A = model.A.copy()
    A[4, 4] = 30.0
    refused(lambda: _check_physical(replace(model, A=A)), IdentificationCause.UNSTABLE, "1/s")
    refused(
        lambda: _check_physical(replace(model, servo_radps=249.0)),
        IdentificationCause.UNSTABLE,
        "249 rad/s",
    )


def test_an_open_loop_that_is_unstable_is_no_reason_to_refuse():
    """A tail that runs away by itself, without a yaw gyro."""
    model = true_model()
    A = model.A.copy()
    A[4, 4], A[4, 5] = 3.0, 0.0
    assert np.linalg.eigvals(A).real.max() > 2.5
    _check_physical(replace(model, A=A))


def test_collective_gain_of_a_known_force(flight, known):
    """A specific force made from the servo's own response gives back its gain."""
    from scipy.signal import cont2discrete, dlsim

    w, zeta = known.fast.servo_radps, known.fast.servo_damping
    parts = ([[0.0, 1.0], [-(w**2), -2.0 * zeta * w]], [[0.0], [w**2]], [[1.0, 0.0]], [[0.0]])
    system = tuple(np.array(part) for part in parts)
    delayed = np.append(flight.u[:1, 3], flight.u[:-1, 3])
    _, servo, _ = dlsim((*cont2discrete(system, 0.01)[:4], 0.01), delayed)
    accel = np.zeros_like(flight.accel_body_mps2)
    accel[:, 2] = 20.0 * servo[:, 0] - 0.7 * flight.vel_body_mps[:, 2]
    fit = fit_collective(replace(flight, accel_body_mps2=accel), known, 9.75, 9.781, ROTOR)
    assert fit.force_per_collective == pytest.approx(20.0, rel=1e-3)
    assert fit.force_per_w == pytest.approx(0.7, rel=1e-2)
    step = 1e-4
    thrust = 9.75 * 9.781
    slope = ROTOR.thrust_per_pitch(thrust)

    def pitch(T):
        s = 1.29 * 193.73 * 5.52 * 0.705**2 * 2 * 0.062 / 4
        return (T / s + np.sqrt(T / (2 * 1.29 * np.pi * 0.705**2))) * 1.5 / (193.73 * 0.705)

    assert slope == pytest.approx(
        2 * step / (pitch(thrust + step) - pitch(thrust - step)), rel=1e-6
    )
    assert fit.K_col == pytest.approx(-20.0 * 9.75 / slope, rel=1e-3)
