# SPDX-License-Identifier: Apache-2.0
"""H-infinity output feedback as flown: certificate, commands, wind-up, heading, refusals."""

import numpy as np
import pytest

from heli_core.errors import InfeasibleGammaError
from heli_core.rows import MEASURED
from heli_inner_hinf.controller_state import initial_law_state
from heli_inner_hinf.controllers import attitude_law
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import flown_plant

_STEPS = 600


@pytest.fixture
def flown(parameters):
    """The packaged weights, judged."""
    return AttitudeConfig.from_parameters({**parameters, "controller": "hinf_output"})


def respond(config, commands, load=(0.0, 0.0, 0.0), psi_ref=0.0, engaged=0.0):
    """phi, theta, psi (n, 3) and u (n, 3), deviations from trim, by the kernel that flies.

    The heading is commanded to be `engaged` at first, `psi_ref` from the second tick on.
    """
    A, B = flown_plant(config.A, config.B, config.actuation)
    k = config.params
    state, u3, x = initial_law_state(k), np.zeros(3), np.zeros(A.shape[0])
    angles, inputs = [], []
    for tick in range(_STEPS):
        r3 = k.x_trim[[0, 1, 8]] + np.array([*commands, psi_ref if tick else engaged])
        attitude_law(k.x_trim + x[:9], r3, k, state, u3)
        angles.append(x[[0, 1, 8]])
        inputs.append(u3 - k.u_trim)
        x = A @ x + B @ (u3 - k.u_trim + np.array(load))
    return np.array(angles), np.array(inputs)


def test_certificate_holds_on_a_frequency_grid(flown):
    """The closed loop's gain stays below gamma: plain solves, integrals in the plant."""
    A, B, C, D = generalised_plant_of(flown)
    K = flown.output.controller.system
    n_z, n_w = C.shape[0] - 6, B.shape[1] - 3
    gains = []
    for angle in np.geomspace(1e-4, np.pi, 400):
        z = np.exp(1j * angle)
        P = D + C @ np.linalg.solve(z * np.eye(A.shape[0]) - A, B)
        k = K.D + K.C @ np.linalg.solve(z * np.eye(K.A.shape[0]) - K.A, K.B)
        loop = np.linalg.solve(np.eye(3) - k @ P[n_z:, n_w:], k @ P[n_z:, :n_w])
        gains.append(np.linalg.norm(P[:n_z, :n_w] + P[:n_z, n_w:] @ loop, 2))
    assert max(gains) < flown.output.gamma
    assert max(gains) == pytest.approx(flown.output.norm, rel=2e-3)
    assert flown.output.controller.residual < 1e-8


def generalised_plant_of(config):
    return config.output.plant.system


def test_plant_with_integrals_is_the_flown_one(flown):
    """Its first states are those of `flown_plant`; three integrals of what is measured follow."""
    system = generalised_plant_of(flown)
    A, B = flown_plant(flown.A, flown.B, flown.actuation)
    n = A.shape[0]
    assert np.array_equal(system.A[:n, :n], A)
    assert np.array_equal(system.B[:n, -3:], B)
    x = np.zeros(n + 3)
    x[[0, 1, 8]] = 0.1, 0.2, 0.3
    assert np.allclose((system.A @ x - x)[n:], [0.001, 0.002, 0.003])
    assert np.array_equal(system.C[-6:, :n], np.eye(n)[list(MEASURED)])


def test_commands_are_met_with_little_overshoot(flown):
    """Roll with 1 %, pitch, whose integral is slow, with 8 %."""
    for axis in (0, 1):
        commands = np.zeros(2)
        commands[axis] = 0.1
        angles, _ = respond(flown, commands)
        assert angles[-1] == pytest.approx([*commands, 0.0], abs=2e-3)
        assert angles[:, axis].max() < (0.102, 0.109)[axis]
        assert np.argmax(angles[:, axis] > 0.063) < 45


def test_lasting_load_leaves_no_error(flown):
    """A moment that the model lacks; state feedback (17) keeps an error of it."""
    angles, inputs = respond(flown, (0.0, 0.0), load=(0.02, -0.02, 0.01))
    assert np.abs(angles).max() > 1e-3
    assert angles[-1] == pytest.approx(np.zeros(3), abs=1e-3)
    assert inputs[-1] == pytest.approx([-0.02, 0.02, -0.01], abs=1e-3)


def test_new_heading_does_not_kick_roll_and_pitch(flown):
    angles, _ = respond(flown, (0.0, 0.0), psi_ref=0.2)
    assert angles[-1, 2] == pytest.approx(0.2, abs=1e-3)
    assert np.abs(angles[:, :2]).max() < 0.02
    assert angles[:, 2].max() < 0.21


def test_engaged_off_its_heading_it_turns_there(flown):
    """Without a memory of another heading its integral is a reason for an overshoot."""
    angles, _ = respond(flown, (0.0, 0.0), psi_ref=0.2, engaged=0.2)
    assert angles[-1, 2] == pytest.approx(0.2, abs=6e-3)
    assert angles[:, 2].max() < 0.26


def test_law_unwinds_after_a_limit(parameters):
    """While cut off, every state of the law dies out, its integrators, too."""
    config = AttitudeConfig.from_parameters({**parameters, "controller": "hinf_output"})
    law = config.law
    assert np.abs(np.linalg.eigvals(law.A - law.L @ law.C)).max() < 0.99
    assert np.abs(np.linalg.eigvals(law.A)).max() > 1.0 - 1e-6


def test_infeasible_gamma_is_refused_with_its_number(parameters, flown):
    asked = 0.9 * flown.output.gamma_star.lower
    with pytest.raises(InfeasibleGammaError, match=r"^output\.gamma = .*gamma\* = ") as caught:
        AttitudeConfig.from_parameters(
            {**parameters, "controller": "hinf_output", "output.gamma": asked}
        )
    assert caught.value.gamma_star == pytest.approx(flown.output.gamma_star.value, rel=2e-4)


def test_more_delay_makes_another_plant(parameters):
    """The law knows the delay: three states for each tick of it."""
    values = {**parameters, "controller": "hinf_output", "delay_ticks": 2, "output.gamma": 20.0}
    assert AttitudeConfig.from_parameters(values).law.A.shape == (24, 24)
