# SPDX-License-Identifier: Apache-2.0
"""Incremental inversion: its effectiveness, what it inverts, what a lasting moment leaves."""

import numpy as np
import pytest

from heli_core.errors import ShapeError
from heli_core.linear import held, with_servos
from heli_inner_hinf.controller_state import initial_law_state
from heli_inner_hinf.controllers import attitude_law
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import flown_plant
from heli_inner_hinf.output_feedback import IndiGains, effectiveness, indi_law

RATES = [2, 3, 6]
ANGLES = [0, 1, 8]


@pytest.fixture
def design(parameters):
    return AttitudeConfig.from_parameters({**parameters, "controller": "indi"})


def test_effectiveness_is_the_lasting_rate_of_a_lasting_command(config):
    Phi, Gamma = held(config.A, config.B, 20.0)
    assert np.allclose(Gamma[RATES], effectiveness(config.A, config.B), atol=1e-9)


def test_an_aircraft_that_cannot_be_inverted_is_refused(config):
    B = config.B.copy()
    B[:, 1] = 0.0
    with pytest.raises(ShapeError) as caught:
        effectiveness(config.A, B)
    assert caught.value.name == "model.B"
    A = config.A.copy()
    A[7] = 0.0
    with pytest.raises(ShapeError, match=r"model\.A "):
        effectiveness(A, config.B)


def test_inversion_of_an_aircraft_that_only_turns(config):
    """Rates that are G times the servos' positions, and a lasting rate on top that nobody knows:
    the wanted rate is flown, whatever the filter, once that has been measured."""
    gains = IndiGains(np.array([1.0, 2.0, 3.0]), np.zeros(3), np.zeros(3), np.array([6.0, 9, 12]))
    law = indi_law(config.A, config.B, gains, config.actuation)
    G, unknown = effectiveness(config.A, config.B), np.array([0.02, -0.03, 0.05])
    servos = with_servos(np.zeros((0, 0)), np.zeros((0, 3)), 38.0, 0.51)
    A, B = held(*servos, 0.01)
    x, z, late = np.zeros(6), np.zeros(law.A.shape[0]), np.zeros(3)
    angle = np.array([0.1, 0.1, 0.1])
    for _ in range(400):
        v = np.zeros(8)
        v[[2, 3, 4]], v[[0, 1, 5]] = G @ x[:3] + unknown, angle
        u = law.C @ z + law.D @ v
        z, x, late = law.A @ z + law.B @ v, A @ x + B @ late, u
    assert np.allclose(G @ x[:3] + unknown, -gains.angle * angle, atol=1e-9)


def test_the_positions_hear_what_was_flown(design):
    """Behind the limits A - L C keeps the filters of the rates and of the positions apart."""
    law = design.law
    apart = law.A - law.L @ law.C
    assert np.allclose(apart[:6, 6:], 0.0) and np.allclose(apart[6:, :6], 0.0, atol=1e-12)
    assert np.allclose((law.B - law.L @ law.D)[6:], 0.0, atol=1e-12)


def test_commands_are_reached_and_a_lasting_moment_leaves_no_error(design):
    k, (A, B) = design.params, flown_plant(design.A, design.B, design.actuation)
    lasting, moment = np.zeros((9, 1)), np.zeros(A.shape[0])
    lasting[RATES, 0] = 0.5, -0.8, 0.2
    moment[:9] = held(design.A, lasting, 0.01)[1][:, 0]
    x, state, u3 = np.zeros(A.shape[0]), initial_law_state(k), np.zeros(3)
    wanted = np.array([0.05, -0.04, 0.3])
    for _ in range(4000):
        attitude_law(k.x_trim + x[:9], k.x_trim[ANGLES] + wanted, k, state, u3)
        x = A @ x + B @ (u3 - k.u_trim) + moment
    assert np.allclose(x[ANGLES], wanted, atol=1e-8)


def test_margins_of_the_packaged_gains(design):
    assert min(design.judgement.disk_input, design.judgement.disk_output) >= 0.65
