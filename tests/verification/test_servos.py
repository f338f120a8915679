# SPDX-License-Identifier: Apache-2.0
"""Imperfections of the servos against closed forms, one term at a time, integrated as they fly."""

from dataclasses import replace

import numpy as np
import pytest

from heli_dynamics_sim.aircraft import CLIMB_POWER_OFF, ModelOptions
from heli_dynamics_sim.airframe import make_state

HIGH = (0.0, 0.0, -1e4)
LAT, LON, PED, COL = 16, 17, 18, 19
HALF_BAND, STEP = 0.005, 0.0025


@pytest.fixture(scope="module")
def servos(helicopter):
    """servos(*terms, **changes): kernel of the aircraft in vacuum with these terms on."""

    def build(*terms, **changes):
        bare = {"air_density_kgpm3": 1e-30, "hub_stiffness_nmprad": 0.0}
        on = ModelOptions(**dict.fromkeys(terms, True))
        made = replace(helicopter, terms=on, **(bare | changes)).params
        return made._replace(climb_power=CLIMB_POWER_OFF)

    return build


def step_response(t, omega=38.0, zeta=0.51):
    """Unit step of a damped second-order system."""
    damped = omega * np.sqrt(1 - zeta**2)
    wave = np.cos(damped * t) + zeta / np.sqrt(1 - zeta**2) * np.sin(damped * t)
    return 1.0 - np.exp(-zeta * omega * t) * wave


def test_no_term_is_on_by_default(helicopter, vacuum):
    """An aircraft from its file: no imperfection at all."""
    assert helicopter.terms == ModelOptions()
    assert not vacuum.servo.real.present


@pytest.mark.parametrize("steps", [0.4, 0.6, 7.3, -2.8])
def test_a_servo_goes_to_the_nearest_step_of_its_resolution(servos, fly, steps):
    """Constant command; the multiple of the resolution next to it, 1e-9 of travel."""
    x = fly(make_state(HIGH), np.full(4, steps * STEP), servos("servo_resolution"), 1.5)
    assert x[16:20] == pytest.approx(np.full(4, round(steps) * STEP), abs=1e-9)


def test_a_dead_band_moves_nothing_inside_and_stops_at_its_edge(servos, fly):
    """Errors below half the band: rest. Well damped from far: stops at the edge, 1e-6 of travel."""
    still = fly(make_state(HIGH), np.full(4, 0.99 * HALF_BAND), servos("servo_dead_band"), 1.0)
    assert (still[16:24] == 0.0).all()
    damped = servos("servo_dead_band", servo_damping=1.5)
    x = fly(make_state(HIGH), [0.1, -0.2, 0.15, -0.05], damped, 3.0)
    edge = np.array([0.1, -0.2, 0.15, -0.05]) + HALF_BAND * np.array([-1, 1, -1, 1])
    assert x[16:20] == pytest.approx(edge, abs=1e-6)


def test_a_servo_coasts_inside_its_dead_band(servos, fly):
    """The motor rests, friction stays: from a rate v it coasts v / (2 zeta omega); 1e-9."""
    x = make_state(HIGH)
    x[20:24] = 0.1
    x = fly(x, np.zeros(4), servos("servo_dead_band"), 1.0)
    assert x[16:20] == pytest.approx(np.full(4, 0.1 / (2 * 0.51 * 38.0)), abs=1e-9)


def test_the_collective_slows_under_the_propeller_moment(servos, fly):
    """Full step up and down at 0.5 1/s; d pos/dt = R (1 - load), load by the moment
    b I_f Omega^2 theta over the stall torque, geared by virtual work: exponentials, 1e-6 after the
    run-up. Cyclic and pedal keep their limit."""
    kernel = servos("servo_load", servo_rate_limit_per_s=0.5)
    # share of the stall torque against a positive speed, at d_col = 0 and per unit of it
    per_rad = 2 * 1.06e-4 * 193.73**2 * (-0.165 / 0.785) / 0.65
    offset, slope = 0.075 * per_rad, -0.165 * per_rad
    for target in (1.0, -1.0):
        x = fly(make_state(HIGH), np.full(4, target), kernel, 0.3)
        later = fly(x, np.full(4, target), kernel, 0.4)
        rate = 0.5 * target
        at_zero, per_position = rate - 0.5 * offset, -0.5 * slope
        far = -at_zero / per_position
        assert later[COL] == pytest.approx(
            far + (x[COL] - far) * np.exp(0.4 * per_position), abs=1e-6
        )
        assert later[LAT] - x[LAT] == pytest.approx(rate * 0.4, abs=1e-9)
        assert later[PED] - x[PED] == pytest.approx(rate * 0.4, abs=1e-9)


def test_three_equal_swash_servos_are_three_channels(servos, fly):
    """The mix is linear: equal servos move as one per channel, 1e-12 of travel."""
    u = [0.05, -0.08, 0.1, -0.06]
    one = fly(make_state(HIGH), u, servos(), 0.08)
    three = fly(make_state(HIGH), u, servos("swash_servos", servo_slow_share=1.0), 0.08)
    assert three[16:24] == pytest.approx(one[16:24], abs=1e-12)


@pytest.mark.parametrize("t", [0.02, 0.05, 0.1])
def test_a_slow_swash_servo_leaks_collective_into_pitch(servos, fly, t):
    """Step of the collective; lon = 2/3 (slow - fast) of two closed step responses, col their
    mean, lat 0 by symmetry; 1e-7 of travel."""
    x = fly(make_state(HIGH), [0.0, 0.0, 0.0, 0.1], servos("swash_servos"), t, dt_s=0.001)
    slow, fast = step_response(t, 0.8 * 38.0), step_response(t)
    assert x[LON] == pytest.approx(0.1 * 2.0 / 3.0 * (slow - fast), abs=1e-7)
    assert x[COL] == pytest.approx(0.1 * (slow + 2.0 * fast) / 3.0, abs=1e-7)
    assert x[LAT] == pytest.approx(0.0, abs=1e-15)


def test_swash_servos_share_the_rate_limit_and_the_load(servos, fly):
    """A full step of the collective with all three equal and loaded: a third of the load each."""
    alone = servos("servo_load", servo_rate_limit_per_s=0.5)
    swash = servos("servo_load", "swash_servos", servo_rate_limit_per_s=0.5, servo_slow_share=1.0)
    rates = []
    for kernel in (alone, swash):
        x = fly(make_state(HIGH), [0.0, 0.0, 0.0, -0.9], kernel, 0.3)
        rates.append(fly(x, [0.0, 0.0, 0.0, -0.9], kernel, 0.002)[COL] - x[COL])
    free = -0.5 * 0.002
    assert rates[0] - free == pytest.approx(3.0 * (rates[1] - free), rel=0.05)
