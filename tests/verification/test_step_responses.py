# SPDX-License-Identifier: Apache-2.0
"""Servo, yaw gyro and flapping: step responses of the integrated plant against closed forms.

Integrated with the equations and the step that fly; the air is set aside by parameters where the
closed form knows none.
"""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from heli_dynamics_sim.aircraft import lock_number
from heli_dynamics_sim.airframe import make_state
from heli_dynamics_sim.trim import linearize, trim

HIGH = (0.0, 0.0, -1e4)


def servo_step(t, omega=38.0, zeta=0.51):
    damped = omega * np.sqrt(1 - zeta**2)
    wave = np.cos(damped * t) + zeta / np.sqrt(1 - zeta**2) * np.sin(damped * t)
    return 1.0 - np.exp(-zeta * omega * t) * wave


@pytest.mark.parametrize("t", [0.02, 0.05, 0.1, 0.4])
def test_servo_step_is_a_second_order_system(vacuum, fly, t):
    """Step of all four servos; damped second-order step, 38 rad/s, 0.51; 2e-7 of travel."""
    u = np.array([0.1, -0.2, 0.15, -0.05])
    x = fly(make_state(HIGH), u, vacuum, t, dt_s=0.001)
    assert x[16:20] == pytest.approx(u * servo_step(t), abs=2e-7)


def test_servo_speed_and_travel_are_limited(vacuum, fly):
    """Full step; never faster than 10 1/s (1e-9), never beyond the stops, which it reaches."""
    fast, far = 0.0, 0.0
    x = make_state(HIGH)
    x[16:20] = -1.0
    for _ in range(300):
        x = fly(x, [1.0, 1.0, 1.0, 3.0], vacuum, 0.002)
        assert x[19] == x[16]  # a command beyond the travel is one to its end
        fast, far = max(fast, np.abs(x[20:24]).max()), max(far, np.abs(x[16:20]).max())
    assert fast == pytest.approx(10.0, abs=1e-9)
    assert far == 1.0
    assert x[16:20] == pytest.approx(np.ones(4), abs=1e-6)


def test_slow_servo_needs_the_travel_over_its_rate(vacuum, fly):
    """Rate-limited step; the ramp at the limit, less its run-up (0.06 of travel)."""
    x = make_state(HIGH)
    x[16:20] = -1.0
    slow = vacuum._replace(servo=vacuum.servo._replace(rate_limit=2.0))
    x = fly(x, np.ones(4), slow, 0.8)
    # ramp at 2 1/s after a run-up of 1/20 s or so
    assert x[16] == pytest.approx(-1.0 + 2.0 * 0.8, abs=0.06)


def test_yaw_gyro_integrates_the_rate_error(helicopter, vacuum, fly):
    """Eq. (8), integrator; (K_a d_ped - r) t; 1e-12."""
    x = make_state(HIGH)
    x[18], x[12] = 0.1, 0.3
    end = fly(x, [0.0, 0.0, 0.1, 0.0], vacuum, 0.5)
    assert end[12] == pytest.approx(0.3, abs=1e-12)
    assert end[15] == pytest.approx((-3.85 * 0.1 - 0.3) * 0.5, abs=1e-12)


def test_yaw_gyro_closes_the_loop_with_its_own_poles(helicopter, fly):
    """Small yaw motion in hover; exponential of the linear model's 2 x 2 block; 1 %, 1e-6."""
    hover = trim(helicopter)
    A = linearize(helicopter, hover).A[np.ix_([6, 7], [6, 7])]
    x = hover.x.copy()
    x[2] = -1e4
    x[12] += 1e-4
    end = fly(x, hover.u, helicopter.params, 0.3)
    expected = expm(A * 0.3) @ [1e-4, 0.0]
    assert end[[12, 15]] - hover.x[[12, 15]] == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("t", [0.1, 0.5, 2.0])
def test_flapping_step_is_the_matrix_exponential(vacuum, fly, t):
    """Step of both cyclics and of the pitch rate, eq. (6); matrix exponential; 1e-11 rad."""
    x = make_state(HIGH)
    x[16], x[17] = 0.05, -0.03
    x[11] = 0.2  # a constant pitch rate in vacuum
    end = fly(x, x[16:20], vacuum, t)
    rate = 1.0 / 0.29756
    A = np.array([[-rate, 2.2223], [2.4483, -rate]])
    drive = rate * np.array(
        [0.77 * -0.03 + 0.0603 * 0.05, 0.77 * 0.05 - 0.0197 * -0.03]
    ) + np.array([-0.2, 0.0])
    expected = np.linalg.solve(A, (expm(A * t) - np.eye(2)) @ drive)
    assert end[13:15] == pytest.approx(expected, abs=1e-11)


@pytest.mark.parametrize("channel", [0, 1])
def test_flapping_in_turn_of_the_switched_couplings(in_vacuum, fly, channel):
    """A cyclic step with couplings by eq. (7): the settled tilt; the 2 x 2 solution; 1e-9 rad."""
    kernel = in_vacuum(coupling="eq7", hub_stiffness_nmprad=114.65, air_density_kgpm3=1.29)
    flapping = kernel.flapping
    assert flapping.a_bs == -flapping.b_as > 0.0
    x = make_state(HIGH)
    x[16 + channel] = 0.04
    free = in_vacuum()._replace(flapping=flapping)
    end = fly(x, x[16:20], free, 12.0)
    A = np.array([[-flapping.rate, flapping.a_bs], [flapping.b_as, -flapping.rate]])
    theta = 0.04 * np.array([(0.0603, 0.77), (0.77, -0.0197)][channel])
    assert end[13:15] == pytest.approx(-np.linalg.solve(A, flapping.rate * theta), abs=1e-9)


@pytest.mark.parametrize("speed", [(4.0, 0.0), (0.0, 3.0), (-2.0, 1.0)])
def test_flap_back_settles_at_its_slope(in_vacuum, fly, speed):
    """Switch flap_back_radpmps in steady flight; da_s/du times speed, coupled; 1e-9 rad."""
    slope = 0.0003
    x = make_state(HIGH)
    x[3:5] = speed
    end = fly(x, np.zeros(4), in_vacuum(flap_back_radpmps=slope, gravity_mps2=1e-12), 25.0)
    rate = 1.0 / 0.29756
    A = np.array([[-rate, 2.2223], [2.4483, -rate]])
    drive = rate * slope * np.array([speed[0], -speed[1]])
    assert end[3:5] == pytest.approx(speed, abs=1e-9)
    assert end[13:15] == pytest.approx(-np.linalg.solve(A, drive), abs=1e-9)


def test_coupling_by_equation_7(helicopter):
    """Switch flapping.coupling: eq7, couplings by Lock number and hub spring; by hand; 1e-6."""
    k = replace(helicopter, coupling="eq7").params.flapping
    lock = 1.29 * 0.062 * 5.52 * 0.705**4 / 0.055
    assert lock_number(helicopter) == pytest.approx(lock)
    ratio = 8 * 114.65 / (lock * 193.73**2 * 0.055)
    assert k.a_bs == pytest.approx(ratio / 0.29756)
    assert k.b_as == -k.a_bs
