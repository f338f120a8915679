# SPDX-License-Identifier: Apache-2.0
"""The prediction of an axis' rms and margins against second methods."""

from dataclasses import replace

import control
import numpy as np
import pytest
from scipy import integrate

from heli_core.command_line import config_folder
from heli_core.linear import held
from heli_core.parameters import load
from heli_core.rotations import quat_from_euler
from heli_core.rows import SETPOINT
from heli_core.ticks import TICK_S
from heli_outer_pd import position_law
from heli_outer_pd.analysis import (
    Axis,
    Gains,
    Sampled,
    analyse,
    deviations,
    disk_margin,
    drifting,
    dryden_across,
    law,
    limits_of_performance,
    modelled_heave_damping_per_s,
    plant,
)
from heli_outer_pd.disturbance import trim_thrust
from heli_outer_pd.parameters import NODE_NAME, TABLE, outer_params
from heli_outer_pd.state import thrust_for_collective

LAG_S, DAMPING = 0.4, 0.3
GUSTS = ((0.6, 20.0), (0.4, 8.0))  # rms m/s and L / V, s: along and across
NAVIGATION = ((0.02, 2.0), (0.01, 0.5))  # rms m, m/s and correlation time


def lagging(lag_s, damping=DAMPING, late_ticks=1):
    """A first-order lag behind a delay of whole ticks, with drag."""
    A, B = held(np.array([[-1.0 / lag_s]]), np.array([[1.0 / lag_s]]), TICK_S)
    n = late_ticks
    line = np.eye(n + 1, k=-1)
    line[0, 0], line[0, n] = A[0, 0], B[0, 0] if n else 0.0
    if n:
        line[1, 0] = 0.0
    enters = np.zeros((n + 1, 2))
    enters[min(n, 1), 0] = 1.0 if n else B[0, 0]
    # What the tilt explains is what there is without the drag.
    C, D = np.repeat(np.eye(1, n + 1), 2, axis=0), np.array([[0.0, damping], [0.0, 0.0]])
    return Sampled(line, enters, C, D)


AXIS = Axis(
    actuation=lagging(LAG_S),
    modelled_lag_s=0.35,
    modelled_damping_per_s=0.0,
    gusts=(drifting(*GUSTS[0]), dryden_across(*GUSTS[1])),
    position_error=drifting(*NAVIGATION[0]),
    speed_error=drifting(*NAVIGATION[1]),
    period_ticks=4,
)
MEASURED = replace(AXIS, tilt_standing_s=3.0)
AT_100_HZ = replace(MEASURED, period_ticks=1)


def gains(K_P, K_D, bandwidth_radps, lead_s=0.0):
    return Gains(K_P, K_D, 1.6 * bandwidth_radps, bandwidth_radps**2, lead_s, 0.1)


@pytest.fixture(scope="module")
def kernel():
    return outer_params(
        load(TABLE, [config_folder("heli_outer_pd") / "outer_loop.yaml"], NODE_NAME)
    )


def spectral_densities(axis, g, omega):
    """Two-sided spectral densities of position and speed, continuous, from scalar responses.

    Nothing of the code under test: the law's steps are taken for a hold of one period (half of it
    as a delay), the observer in its textbook form, u = -(K_P p + (K_D + (s + d_m) F) v) W /
    (1 - F G_m W), with F its low pass, G_m what it takes for the tilt, W the lead: the modelled lag
    below the standing error's frequency, the tilt as it is above.
    """
    s = 1j * omega
    actuation = np.exp(-(TICK_S + 0.5 * axis.dt_s) * s) / (1.0 + LAG_S * s)
    low_pass = g.l2 / (s**2 + g.l1 * s + g.l2) if g.l2 else 0.0 * s
    lead = 1.0 + g.lead_s * s / (1.0 + g.lead_filter_s * s)
    modelled, stands = 1.0 / (1.0 + axis.modelled_lag_s * s), 1.0 / (1.0 + axis.tilt_standing_s * s)
    explained = stands * modelled + (1.0 - stands) * actuation
    gain = actuation * lead / (1.0 - low_pass * lead * explained)
    on_speed = gain * (g.K_D + (s + axis.modelled_damping_per_s) * low_pass)
    on_position = gain * g.K_P
    difference = s + DAMPING + on_speed + on_position / s
    (sigma_u, t_u), (sigma_v, t_v) = GUSTS
    # MIL-F-8785C, as spectra over rad/s, two-sided with unit integral over 2 pi
    along = sigma_u**2 * 2.0 * t_u / (1.0 + (t_u * omega) ** 2)
    across = sigma_v**2 * t_v * (1.0 + 3.0 * (t_v * omega) ** 2) / (1.0 + (t_v * omega) ** 2) ** 2
    errors = [sigma**2 * 2.0 * t / (1.0 + (t * omega) ** 2) for sigma, t in NAVIGATION]
    force = DAMPING**2 * (along + across)
    force += np.abs(on_position) ** 2 * errors[0] + np.abs(on_speed) ** 2 * errors[1]
    speed = force / np.abs(difference) ** 2
    return speed / omega**2, speed


@pytest.mark.parametrize(
    "g", [gains(0.9, 1.3, 0.4), gains(1.2, 2.4, 0.8, 0.2), Gains(1.0, 1.6, 0, 0)]
)
@pytest.mark.parametrize("damping", [0.0, 0.2])
@pytest.mark.parametrize("axis", [AXIS, MEASURED, AT_100_HZ], ids=["commanded", "measured", "fast"])
def test_predicted_rms_agrees_with_the_integral_over_the_spectrum(g, damping, axis):
    """Second method: Parseval's integral of the continuous loop; 25 Hz is not continuous: 4 %."""
    axis = replace(axis, modelled_damping_per_s=damping)
    omega = np.geomspace(1e-6, 1e4, 40_001)
    sigma = [
        np.sqrt(integrate.simpson(density * omega, x=np.log(omega)) / np.pi)
        for density in spectral_densities(axis, g, omega)
    ]
    np.testing.assert_allclose(deviations(axis, g)[:2], sigma, rtol=0.04)


@pytest.mark.parametrize("axis", [AXIS, MEASURED], ids=["commanded", "measured"])
def test_predicted_rms_is_that_of_the_loop_stepped_in_time(axis):
    """Second method: the impulse response of every noise, tick by tick, summed in squares."""
    g = gains(1.2, 2.4, 0.8, 0.2)
    A, B, W, M, Z = plant(axis)
    k = law(g, axis)
    total = np.zeros(3)
    for column in range(W.shape[1]):
        for phase in range(axis.period_ticks):
            x, memory, command = W[:, column].copy(), np.zeros(len(k.A)), np.zeros(1)
            for tick in range(phase + 1, 20_000):
                if tick % axis.period_ticks == 0:
                    y, before = M @ x, command
                    command = k.C @ memory + k.D @ y
                    total += np.r_[Z @ x, command - before] ** 2
                    memory = k.A @ memory + k.B @ y
                x = A @ x + B @ command
    np.testing.assert_allclose(deviations(axis, g), np.sqrt(total), rtol=1e-3)


@pytest.mark.parametrize("standing_s", [0.0, 3.0, 60.0])
def test_the_law_is_the_one_that_flies(kernel, standing_s):
    """Small signals through `position_law`: the same commands, axis by axis, from its matrices."""
    rng = np.random.default_rng(3)
    kernel = kernel._replace(tilt_standing_s=standing_s)
    path = np.cumsum(rng.normal(0.0, 1e-5, (60, 2, 3)), axis=0)
    tilts = np.cumsum(rng.normal(0.0, 1e-6, (60, 2)), axis=0)  # pitch, roll
    path[0] = tilts[0] = 0.0
    state, out = position_law.initial_state(kernel), np.empty(SETPOINT.size)
    flown = []
    for (pos, vel), (pitch, roll) in zip(path, tilts, strict=True):
        phi, theta = kernel.trim[:2] + [roll, pitch]
        nav = np.r_[pos, vel, quat_from_euler(phi, theta, 0.0)]
        position_law.position_law(nav, np.zeros(10), kernel, state, out)
        flown.append(out[[SETPOINT.theta, SETPOINT.phi]] - kernel.trim[[1, 0]])
    heave = modelled_heave_damping_per_s(kernel)
    for i, sign in enumerate((-1.0, 1.0)):
        lag_s = kernel.attitude_lag[i]
        model = {"modelled_lag_s": lag_s, "tilt_standing_s": standing_s}
        axis = replace(AXIS, **model, period_ticks=round(kernel.dt_s / TICK_S))
        k, modelled = law(Gains.of(kernel, i), axis), []
        x = np.zeros(len(k.A))
        for (pos, vel), tilt in zip(path, tilts, strict=True):
            y = np.array([pos[i], vel[i], sign * kernel.g * tilt[i]])
            modelled.append(sign * (k.C @ x + k.D @ y)[0] / kernel.g)
            x = k.A @ x + k.B @ y
        np.testing.assert_allclose(modelled, np.array(flown)[:, i], atol=2e-9)
    assert heave > 0.0


@pytest.mark.parametrize("ahead_s", [0.0, 0.05])
def test_the_vertical_law_is_the_one_that_flies(kernel, ahead_s):
    """The same downwards, through the thrust map: with and without the speed predicted."""
    rng = np.random.default_rng(4)
    kernel = kernel._replace(collective_prediction_s=ahead_s)
    path = np.cumsum(rng.normal(0.0, 1e-5, (60, 2)), axis=0)
    path[0] = 0.0
    state, out = position_law.initial_state(kernel), np.empty(SETPOINT.size)
    flown = []
    for down, down_vel in path:
        hang = quat_from_euler(*kernel.trim[:2], 0.0)
        nav = np.r_[0.0, 0.0, down, 0.0, 0.0, down_vel, hang]
        position_law.position_law(nav, np.zeros(10), kernel, state, out)
        flown.append(out[SETPOINT.col] - kernel.trim[SETPOINT.col])
    weight = trim_thrust(kernel)
    lift_per_collective = (
        thrust_for_collective(
            kernel.trim[SETPOINT.col] + 1e-6, 0.0, weight, kernel.trim[SETPOINT.col], kernel.rotor
        )
        - weight
    ) * (kernel.g / weight / 1e-6)
    axis = replace(
        AXIS,
        modelled_lag_s=kernel.collective_lag_s,
        modelled_damping_per_s=modelled_heave_damping_per_s(kernel),
        period_ticks=round(kernel.dt_s / TICK_S),
        prediction_s=ahead_s,
    )
    k, x, modelled = law(Gains.of(kernel, 2), axis), np.zeros(6), []
    for down, down_vel in path:
        y = np.array([down, down_vel, 0.0])
        modelled.append(-(k.C @ x + k.D @ y)[0] / lift_per_collective)
        x = k.A @ x + k.B @ y
    np.testing.assert_allclose(modelled, flown, atol=2e-8)
    assert np.abs(flown).max() > 1e-5


def test_a_predicted_speed_keeps_the_margin_at_higher_gains():
    """A servo's lag and a delay, for which the prediction makes up: nearly twice the gains."""
    servo_s = 0.026
    behind = replace(AXIS, actuation=lagging(servo_s), modelled_lag_s=0.0)
    calm, brisk = gains(4.3, 8.2, 5.6), gains(7.5, 15.0, 6.8)
    ahead = replace(behind, prediction_s=TICK_S + servo_s + 0.5 * behind.dt_s)
    assert analyse(behind, brisk).disk_margin < 0.7 * analyse(behind, calm).disk_margin
    assert analyse(ahead, brisk).disk_margin > analyse(behind, calm).disk_margin
    assert analyse(ahead, brisk).speed_rms_mps < analyse(behind, calm).speed_rms_mps


def test_a_modelled_lag_lets_the_disturbance_be_found_faster():
    """What is commanded and not yet flown is no disturbance: a larger margin at the same gains."""
    servo_s = 0.026
    behind = replace(AXIS, actuation=lagging(servo_s), modelled_lag_s=0.0, prediction_s=0.04)
    known = replace(behind, modelled_lag_s=servo_s, prediction_s=0.07)
    calm, brisk = gains(7.5, 15.0, 5.1), gains(8.0, 18.0, 7.5)
    assert analyse(known, brisk).disk_margin > analyse(behind, brisk).disk_margin
    assert analyse(known, brisk).speed_rms_mps < analyse(behind, calm).speed_rms_mps


def test_margins_of_a_known_loop():
    """A double integrator under plain PD, 25 Hz, no lag: its Nyquist curve is known."""
    quick = replace(AXIS, actuation=Sampled(*_at_once()))
    g = Gains(1.0, 2.0, 0.0, 0.0)
    analysis = analyse(quick, g)
    omega = np.geomspace(0.02, np.pi / 0.04, 200_000, endpoint=False)
    z = np.exp(1j * omega * 0.04)
    loop = 1.0 * 0.04**2 / 2.0 * (z + 1.0) / (z - 1.0) ** 2 + 2.0 * 0.04 / (z - 1.0)
    assert analysis.disk_margin == pytest.approx(disk_margin(loop), rel=2e-3)
    at = np.flatnonzero(np.diff(np.sign(np.abs(loop) - 1.0)))[0]
    assert analysis.crossover_radps == pytest.approx(omega[at], rel=1e-3)
    assert analysis.phase_margin_deg == pytest.approx(180 + np.degrees(np.angle(loop[at])), abs=0.1)


def _at_once():
    return np.zeros((0, 0)), np.zeros((0, 2)), np.zeros((1, 0)), np.array([[1.0, 0.0]])


def test_the_loop_goes_unstable_at_its_gain_margin_and_not_within_its_disk():
    """Factors on the command, tried out on the closed loop's poles."""
    g = gains(1.2, 2.4, 0.8, 0.2)
    report = analyse(AXIS, g)
    inside = (2.0 + report.disk_margin) / (2.0 - report.disk_margin)
    edges = 10.0 ** (report.gain_margin_db / 20.0)

    def stable(factor):
        act = AXIS.actuation
        stronger = replace(AXIS, actuation=act._replace(B=act.B * np.array([factor, 1.0])))
        return deviations(stronger, g) is not None

    assert stable(inside) and stable(1.0 / inside)
    assert stable(0.98 * edges) and stable(1.02 / edges)
    assert not (stable(1.02 * edges) and stable(0.98 / edges))


@pytest.mark.parametrize("axis", [AXIS, MEASURED, AT_100_HZ], ids=["commanded", "measured", "fast"])
def test_the_disk_margin_is_where_complex_factors_reach_the_unit_circle(axis):
    """Second method: poles of the closed loop with a complex factor (1 + a) / (1 - a) on the
    command. All with |a| below half of the margin are inside; one on the circle is on it."""
    g = gains(1.2, 2.4, 1.5, 0.2)
    (A, B, _, M, _), k = axis.lifted, law(g, axis)
    alpha = analyse(axis, g).disk_margin

    def radius(half, angle):
        a = half * np.exp(1j * angle)
        enters = B * (1.0 + a) / (1.0 - a)
        closed = np.block([[A + enters @ k.D @ M, enters @ k.C], [k.B @ M, k.A]])
        return np.max(np.abs(np.linalg.eigvals(closed)))

    angles = np.linspace(0.0, np.pi, 181)
    assert max(radius(0.49 * alpha, angle) for angle in angles) < 1.0
    assert max(radius(0.51 * alpha, angle) for angle in angles) > 1.0


def test_no_linear_law_is_below_the_limit():
    """LQG with perfect actuators is below every PD with them, and above nothing at all."""
    at_once = replace(AXIS, actuation=Sampled(*_at_once()[:3], np.array([[1.0, DAMPING]])))
    limit = limits_of_performance(AXIS)
    assert limit == pytest.approx(limits_of_performance(at_once), rel=1e-9)
    for g in (
        gains(1.2, 2.4, 0.8),
        gains(9.0, 6.0, 3.0),
        gains(20.0, 12.0, 6.0),
        gains(40.0, 15.0, 7.0),
    ):
        rms = deviations(at_once, replace(g, lead_s=0.0))
        assert rms is not None and rms[0] > limit[0] and rms[1] > limit[1] > 0.0


def test_unstable_gains_are_called_unstable():
    analysis = analyse(AXIS, gains(9.0, 0.2, 0.4))
    assert not analysis.stable and analysis.disk_margin == 0.0 and np.isinf(analysis.position_rms_m)


def test_steady_wind_is_trimmed_out_with_the_observer_only():
    """Final value of the position in a step of the wind: d / K_P for the plain law, else zero."""
    A, B, _, M, Z = plant(replace(AXIS, gusts=(Sampled(*_steady()),)))
    for g, expected in ((gains(0.5, 1.0, 0.4), 0.0), (Gains(0.5, 1.0, 0, 0), DAMPING / 0.5)):
        k, x, command = law(g, AXIS), np.zeros(len(A)), np.zeros(1)
        memory = np.zeros(len(k.A))
        x[2 + len(AXIS.actuation.A)] = 1.0
        for tick in range(20_000):
            if tick % AXIS.period_ticks == 0:
                command = k.C @ memory + k.D @ (M @ x)
                memory = k.A @ memory + k.B @ (M @ x)
            x = A @ x + B @ command
        assert Z[0] @ x == pytest.approx(expected, abs=1e-9)


def _steady():
    return np.eye(1), np.zeros((1, 1)), np.eye(1), np.zeros((1, 1))


def test_gusts_have_the_spectra_of_the_standard():
    """Variance and correlation over two seconds, beside the standard's closed forms."""
    for noise, sigma, correlation in (
        (drifting(0.6, 20.0), 0.6, np.exp(-0.1)),
        (dryden_across(0.4, 8.0), 0.4, (1.0 - 0.25 / 2.0) * np.exp(-0.25)),
    ):
        X = control.dlyap(noise.A, noise.B @ noise.B.T)
        assert (noise.C @ X @ noise.C.T)[0, 0] == pytest.approx(sigma**2, rel=1e-4)
        later = noise.C @ np.linalg.matrix_power(noise.A, 200) @ X @ noise.C.T
        assert later[0, 0] == pytest.approx(sigma**2 * correlation, rel=1e-3)


def test_gains_are_those_that_fly(kernel):
    flown = kernel.K_P[2], kernel.K_D[2], kernel.observer_l1[2], kernel.observer_l2[2]
    assert Gains.of(kernel, 2) == Gains(*flown, 0.0, kernel.lead_filter_s)
    without = kernel._replace(wind_compensation=0.0)
    right = kernel.K_P[1], kernel.K_D[1], 0.0, 0.0, kernel.attitude_lead[1]
    assert Gains.of(without, 1) == Gains(*right, kernel.lead_filter_s)


def test_heave_damping_is_that_of_momentum_theory(kernel):
    """T = s (w - v), v (v - w) = T / D differentiated by hand at w = 0; s: slope of the blades."""
    r = kernel.rotor
    slope = r.rho * r.omega * r.lift_slope * r.radius**2 * r.blades * r.chord / 4.0
    disk = 2.0 * r.rho * np.pi * r.radius**2
    inflow = np.sqrt(kernel.mass * kernel.g / disk)
    expected = 0.5 * slope / (1.0 + slope / (2.0 * inflow * disk)) / kernel.mass
    assert modelled_heave_damping_per_s(kernel) == pytest.approx(expected, rel=1e-6)
