# SPDX-License-Identifier: Apache-2.0
"""LQG: nothing near it is better, commands overshoot little, a lasting moment leaves no error."""

import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from heli_core.linear import held
from heli_inner_hinf.controller_state import initial_law_state
from heli_inner_hinf.controllers import attitude_law
from heli_inner_hinf.design import AttitudeConfig, added_weights
from heli_inner_hinf.loops import flown_plant
from heli_inner_hinf.output_feedback import generalised_plant

ANGLES, RATES = [0, 1, 8], [2, 3, 6]


@pytest.fixture
def lqg_parameters(parameters):
    return {**parameters, "controller": "lqg"}


@pytest.fixture
def design(lqg_parameters):
    return AttitudeConfig.from_parameters(lqg_parameters)


def mean_square(plant, law):
    """Mean square of (h, weighted integrals) in white noise; law and plant share the integrals."""
    A, B, C, D = plant.system
    n, n_w, n_z = A.shape[0] - 3, B.shape[1] - 3, C.shape[0] - plant.n_y
    y, b = C[n_z:, :n], B[:n, n_w:]
    to_u = np.hstack([law["D"] @ y, law["C"]])
    step = np.block([[A[:n, :n], np.zeros((n, n + 3))], [law["B"] @ y, law["A"]]])
    step[:n] += b @ to_u
    enters = np.vstack([B[:n, :n_w] + b @ law["D"] @ D[n_z:, :n_w], law["B"] @ D[n_z:, :n_w]])
    C_z = np.hstack([C[:n_z, :n], np.zeros((n_z, n)), C[:n_z, n:]]) + D[:n_z, n_w:] @ to_u
    through = D[:n_z, n_w:] @ law["D"] @ D[n_z:, :n_w]
    spread = solve_discrete_lyapunov(step, enters @ enters.T)
    return np.trace(C_z @ spread @ C_z.T + through @ through.T)


def test_no_law_nearby_is_better(lqg_parameters, design):
    """The mean square of the closed loop, by its Lyapunov equation, is stationary in every matrix
    of the law and grows in random directions."""
    plant = generalised_plant(
        design.A,
        design.B,
        design.E,
        design.C,
        design.D,
        added_weights(lqg_parameters, "lqg"),
        design.actuation,
    )
    parts = {name: getattr(design.law, name).copy() for name in "ABCD"}
    parts["B"], parts["D"] = parts["B"][:, :6], parts["D"][:, :6]
    g, best = np.random.default_rng(11), mean_square(plant, parts)
    for name, size in (("A", 1e-3), ("B", 1e-2), ("C", 1e-2), ("D", 1e-2)):
        change = size * g.standard_normal(parts[name].shape) * np.abs(parts[name])
        if name in "AB":
            change[-3:] = 0.0  # the integrals are integrals
        more, less = (
            mean_square(plant, {**parts, name: parts[name] + s * change}) for s in (1, -1)
        )
        bend = more + less - 2.0 * best
        assert more > best and less > best, name
        assert abs(more - less) < 0.1 * bend, name


def test_commands_overshoot_little_and_a_lasting_moment_leaves_no_error(design):
    k, (A, B) = design.params, flown_plant(design.A, design.B, design.actuation)
    lasting, moment = np.zeros((9, 1)), np.zeros(A.shape[0])
    lasting[RATES, 0] = 0.5, -0.8, 0.2
    moment[:9] = held(design.A, lasting, 0.01)[1][:, 0]
    wanted = np.array([0.05, -0.04, 0.3])
    for load, most in ((0.0, 1.1), (1.0, np.inf)):
        x, state, u3, peak = np.zeros(A.shape[0]), initial_law_state(k), np.zeros(3), 0.0
        attitude_law(k.x_trim, k.x_trim[ANGLES], k, state, u3)
        for _ in range(4000):
            attitude_law(k.x_trim + x[:9], k.x_trim[ANGLES] + wanted, k, state, u3)
            x = A @ x + B @ (u3 - k.u_trim) + load * moment
            peak = max(peak, np.max(x[ANGLES] / wanted))
        assert np.allclose(x[ANGLES], wanted, atol=1e-8)
        assert peak < most
