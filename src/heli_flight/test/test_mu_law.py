# SPDX-License-Identifier: Apache-2.0
"""The laws `mu`: the set that they are made for is the aircraft's, and they hold it."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from heli_core.errors import RobustCause, RobustError
from heli_core.rows import MEASURED, NINE
from heli_core.ticks import TICK_S
from heli_flight.settings import resolve
from heli_inner_hinf.controller_state import Actuation
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.loops import flown_plant
from heli_studies.design.rivals import N_PARAMETERS, MuWeights, mu_plant

SCRIPT = Path(__file__).resolve().parents[3] / "scripts/write_mu_law.py"


@pytest.fixture(scope="module")
def config():
    return AttitudeConfig.from_parameters(resolve(laws="mu").nodes["inner_loop"])


def test_diagnostics_show_no_bound_of_a_law_that_is_not_flown(config):
    """Its own certificate is in the file's head; gamma and norm of eq. (15) are another law's."""
    shown = config.summary()
    assert shown["controller"] == "matrices"
    assert not {"gamma", "gamma_star", "norm"} & shown.keys()


def changed(A, B, number, share):
    """A, B of the aircraft whose parameter of this number is off by a share of itself."""
    A, B = A.copy(), B.copy()
    if number < 2:
        rate, flap = ((NINE.p, NINE.b_s), (NINE.q, NINE.a_s))[number]
        A[rate, flap] *= 1.0 + share
        return A, B
    row = (NINE.b_s, NINE.a_s, NINE.r)[number - 2]
    kept = A[row, [NINE.p, NINE.q]]
    A[row] *= 1.0 + share
    B[row] *= 1.0 + share
    if number < 4:
        A[row, [NINE.p, NINE.q]] = kept
    return A, B


def answer(A, B):
    """The nine states over 0.3 s after a step of each command, on the trimmed plant at rest."""
    x, states = np.zeros_like(B), []
    for _ in range(30):
        x = A @ x + B
        states.append(x[: len(NINE)])
    return np.array(states)


def radius(config, A, B, actuation):
    """Largest modulus of the loop's eigenvalues with another aircraft."""
    law = config.law
    Ad, Bd = flown_plant(A, B, actuation)
    y = np.eye(Ad.shape[0])[list(MEASURED)]
    n_y = len(MEASURED)
    step = np.block(
        [[Ad + Bd @ law.D[:, :n_y] @ y, Bd @ law.C], [law.B[:, :n_y] @ y, law.A]],
    )
    return np.max(np.abs(np.linalg.eigvals(step)))


@pytest.mark.parametrize("number", range(N_PARAMETERS))
@pytest.mark.parametrize("share", [-0.2, 0.2])
def test_a_member_of_the_set_is_the_aircraft_with_that_parameter(config, number, share):
    """The set's error is held over a tick, the parameter acts at every instant: nearly the same."""
    weights = MuWeights()
    width = [weights.stiffness] * 2 + [weights.flapping] * 2 + [weights.yaw]
    plant = mu_plant(config.A, config.B, config.E, config.actuation, weights).system
    A, B = flown_plant(config.A, config.B, config.actuation)
    into, out = plant.B[: A.shape[0], number], plant.C[number, : A.shape[0]]
    member = answer(A + np.outer(into, out) * share / width[number], B)
    exact = answer(*flown_plant(*changed(config.A, config.B, number, share), config.actuation))
    assert np.linalg.norm(member - exact) < 0.2 * np.linalg.norm(exact - answer(A, B))


def test_every_corner_of_what_is_proved_is_held(config):
    """1 / 1.5 of the set, with servos and delays that its error at the servos contains."""
    nominal, weights = config.actuation, MuWeights()
    size = np.array([weights.stiffness, weights.flapping, weights.yaw, 0.15]) / 1.5
    for corner in np.ndindex(2, 2, 2, 2, 3):
        stiff, flap, yaw, servo = size * (2 * np.array(corner[:4]) - 1)
        A, B = config.A, config.B
        for number, share in enumerate((stiff, stiff, flap, flap, yaw)):
            A, B = changed(A, B, number, share)
        actuation = Actuation(
            nominal.servo_radps * (1.0 + servo), nominal.servo_damping, corner[4] * TICK_S
        )
        assert radius(config, A, B, actuation) < 1.0, corner


def test_the_measure_is_able_to_say_no(config):
    """Ten times the gain is outside of any set."""
    assert radius(config, config.A, config.B, config.actuation) < 1.0
    assert radius(config, config.A, 10.0 * config.B, config.actuation) > 1.0
    assert config.law.A.shape[0] == 17
    assert config.controller == "matrices"


@pytest.fixture(scope="module")
def script():
    spec = importlib.util.spec_from_file_location("write_mu_law", SCRIPT)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_a_law_that_is_not_what_is_yielded_is_told(script, config):
    """In other states it is the same law; with a percent more gain, or fewer states, it is not."""
    law, inner = config.law, resolve(laws="mu").nodes["inner_loop"]
    T = np.eye(17) + np.triu(np.full((17, 17), 0.1), 1)
    back = np.linalg.inv(T)
    turned = law._replace(A=T @ law.A @ back, B=T @ law.B, C=law.C @ back, L=T @ law.L)
    assert script.difference(inner, turned) == ""
    assert "off by" in script.difference(inner, law._replace(C=1.01 * law.C, D=1.01 * law.D))
    less = law._replace(A=law.A[1:, 1:], B=law.B[1:], C=law.C[:, 1:], L=law.L[1:])
    assert "17 states" in script.difference(inner, less)


@pytest.mark.nightly
def test_what_is_shipped_is_what_the_iteration_yields(script, monkeypatch, capsys):
    monkeypatch.setattr(script.sys, "argv", ["write_mu_law.py", "--check"])
    assert script.main() == 0, capsys.readouterr().out


def test_an_iteration_that_finds_no_law_is_said(script, monkeypatch, tmp_path, capsys):
    refusal = RobustError(RobustCause.NOT_CONVERGED, "not finite")

    def refuses(config, weights):
        raise refusal

    monkeypatch.setattr(script, "mu_design", refuses)
    monkeypatch.setattr(script.sys, "argv", ["write_mu_law.py", str(tmp_path / "mu.yaml")])
    assert script.main() == 2
    assert capsys.readouterr().err == f"error: {refusal}\n"
    assert not (tmp_path / "mu.yaml").exists()
