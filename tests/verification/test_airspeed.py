# SPDX-License-Identifier: Apache-2.0
"""The attitude loop over the airspeed: what its table says, found in another way."""

import numpy as np
import pytest

from heli_core.metrics import attitude_errors
from heli_core.rotations import quat_to_R_nb
from heli_core.rows import PLANT, REFERENCE
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.helicopter import derivative_kernel, same_air
from heli_dynamics_sim.trim import trim
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.robust import contraction_of
from heli_studies.robust import Point, at, feedback_flown, over_airspeed


@pytest.fixture(scope="module")
def settings():
    return resolve()


@pytest.fixture(scope="module")
def schedule(settings):
    return over_airspeed(settings)


def test_to_hover_in_a_headwind_is_to_fly_through_still_air(settings):
    """Galilei: the same accelerations, which is why trims in wind are those of forward flight."""
    aircraft = HelicopterParameters.from_yaml(settings.nodes["plant"]["aircraft_file"])
    velocity = np.array([9.0, -2.0, 0.0])
    hover = trim(aircraft, -velocity, 0.0)
    assert hover.residual < 1e-9
    moving = hover.x.copy()
    moving[PLANT.down] = -1000.0
    moving[PLANT.vel] = quat_to_R_nb(moving[PLANT.quat]).T @ velocity
    rates = np.empty(PLANT.size)
    derivative_kernel(moving, hover.u, same_air(np.zeros(3)), aircraft.params, rates)
    np.testing.assert_allclose(rates[PLANT.pos], velocity, atol=1e-9)
    np.testing.assert_allclose(rates[PLANT.vel], 0.0, atol=1e-8)
    np.testing.assert_allclose(rates[PLANT.rate], 0.0, atol=1e-8)


@pytest.mark.slow
def test_the_nose_goes_down_with_speed_and_the_disc_is_held_against_its_flap_back(schedule):
    ahead = [p for p in schedule.points if p.point.right_mps == 0.0]
    slow, fast = ahead[0], ahead[-1]
    assert fast.attitude_rad[1] < slow.attitude_rad[1] - np.radians(3.0)
    stiff, soft = ahead[-3::2]
    tilt = (soft.point.flap_back_radpmps - stiff.point.flap_back_radpmps) * fast.point.ahead_mps
    assert soft.u[1] - stiff.u[1] == pytest.approx(-tilt / 0.77, rel=0.05)


def test_every_loop_from_hover_to_forward_flight_is_stable_with_margin(schedule):
    assert max(p.judgement.radius for p in schedule.points) < 0.99
    assert min(p.judgement.disk_input for p in schedule.points) > 0.7
    assert min(p.judgement.disk_output for p in schedule.points) > 0.6


def test_one_bound_holds_for_all_speeds_ahead_and_what_lies_between(schedule):
    bound = schedule.bound
    assert np.linalg.eigvalsh(bound.P).min() > 0.0
    loops = [p.loop for p in schedule.points if p.point.right_mps == 0.0]
    assert max(contraction_of(A, bound.P) for A in loops) == pytest.approx(bound.contraction)
    assert max(bound.contraction, schedule.between) < 0.998


def test_speed_may_change_at_every_tick(schedule):
    """A walk among all loops, as wild as can be: what the bound promises, step by step."""
    loops = [p.loop for p in schedule.points if p.point.right_mps == 0.0]
    rng, P = np.random.default_rng(3), schedule.bound.P
    x = rng.standard_normal(P.shape[0])
    for k in rng.integers(len(loops), size=3000):
        before, x = x @ P @ x, loops[k] @ x
        assert x @ P @ x <= schedule.bound.contraction**2 * before * (1.0 + 1e-9)
    assert x @ P @ x < 1e-8


def test_without_enough_gain_there_is_no_such_loop(settings):
    """The law with its signs turned is unstable everywhere: the judgement would show it."""
    law = feedback_flown(settings)
    aircraft = HelicopterParameters.from_yaml(settings.nodes["plant"]["aircraft_file"])
    actuation = AttitudeConfig.from_parameters(settings.nodes["inner_loop"]).actuation
    turned = law._replace(C=-law.C, D=-law.D)
    assert not at(aircraft, turned, actuation, Point(10.0, 0.0, 0.0)).judgement.stable


@pytest.mark.parametrize("seed", [1, 2])
def test_forward_flight_at_10_mps_is_flown(seed):
    """With RTK: altitude within the goal of 1 m, attitude within that of 2 deg; the turn, too."""
    settings = resolve("forward_flight", "rtk", seed)
    flight = simulate(settings)
    assert not flight.status
    r = flight.record
    on = r.time_s >= settings.scenario.windows_s[0, 0]
    speed = np.linalg.norm(r.truth_vel_ned_mps[:, :2], axis=1)
    assert speed.max() > 9.8
    away = r.truth_pos_ned_m - r.reference[:, REFERENCE.pos]
    assert np.abs(away[on, 2]).max() < 0.5
    np.testing.assert_allclose(r.reference[-1, REFERENCE.pos], [0.0, 0.0, -10.0], atol=1e-6)
    errors = attitude_errors(r.truth_q_nb, r.setpoint)
    assert max(np.abs(error[on]).max() for error in errors.values()) < 2.0
