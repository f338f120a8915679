# SPDX-License-Identifier: Apache-2.0
"""Laws as a choice: what a file of laws changes and what it may not, and that a flight says its."""

import numpy as np
import pytest
from scipy.linalg import block_diag, solve_continuous_are
from scipy.signal import lsim

from heli_core.rcl_yaml import ParameterError, read
from heli_core.rotations import euler_from_quat, wrap_pi
from heli_core.rows import MEASURED as M
from heli_core.rows import REFERENCE
from heli_core.rows import UNMEASURED as U
from heli_flight.cli.app import main
from heli_flight.loop import simulate
from heli_flight.settings import resolve
from heli_flight.worlds import LAWS
from heli_outer_pd.parameters import outer_params
from heli_outer_pd.state import thrust_for_collective

MEASURED, UNMEASURED = list(M), list(U)


def different(first, second):
    """Parameters that two flights do not share, by node."""
    return {
        name: {
            key
            for key, value in values.items()
            if not np.array_equal(value, second.nodes[name][key])
        }
        for name, values in first.nodes.items()
    }


def test_the_papers_laws_change_what_they_say_and_nothing_else():
    paper, packaged = (resolve(seed=3, world="hard", laws=laws) for laws in ("paper", "packaged"))
    stated = {(entry.pattern, entry.key): entry.value for entry in read(LAWS.file("paper")).entries}
    for name, keys in different(paper, packaged).items():
        assert keys <= {key for pattern, key in stated if pattern == f"/**/{name}"}, name
    for (pattern, key), value in stated.items():
        np.testing.assert_array_equal(paper.nodes[pattern.rsplit("/", 1)[-1]][key], value)
    assert {"K_P", "K_D", "wind_compensation"} <= different(paper, packaged)["outer_loop"]
    np.testing.assert_equal(dict(packaged.nodes), dict(resolve(seed=3, world="hard").nodes))


@pytest.fixture(scope="module")
def flown():
    """Hover, gusts and the begin of the climb, under the paper's laws."""
    settings = resolve("hover", "rtk", 3, 21.0, world="paper", laws="paper")
    return settings, simulate(settings).record


def attitude(record):
    """phi, theta, psi (N, 3) by the navigation record."""
    return np.array([euler_from_quat(q) for q in record.nav_q_nb])


def test_the_commands_are_those_of_eq_20_and_21(flown):
    """phi_ref and theta_ref from record and reference, by hand; d_col by the weight they carry."""
    settings, record = flown
    p, (phi, theta, psi) = settings.nodes["outer_loop"], attitude(record).T
    c, s, n, o = np.cos(psi), np.sin(psi), np.zeros(len(psi)), np.ones(len(psi))
    to_heading = np.array([[c, s, n], [-s, c, n], [n, n, o]])
    away = record.reference[:, REFERENCE.pos] - record.nav_pos_ned_m
    slower = record.reference[:, REFERENCE.vel] - record.nav_vel_ned_mps
    error = p["K_P"] * np.einsum("ijk,kj->ki", to_heading, away)
    error += p["K_D"] * np.einsum("ijk,kj->ki", to_heading, slower)
    ahead, right = error[:, 0], error[:, 1]
    most = np.sin(np.radians(p["tilt_limit_deg"]))
    wanted = [
        p["trim.phi"] + np.arcsin(np.clip(right / p["gravity"], -most, most)),
        p["trim.theta"] - np.arcsin(np.clip(ahead / p["gravity"], -most, most)),
    ]
    due = slice(0, None, p["period_ticks"])
    np.testing.assert_allclose(record.setpoint[due, :2], np.column_stack(wanted)[due], atol=1e-12)
    # The thrust of eq. (20), from the collective that flew, by the rotor's map read the other way.
    k = outer_params(p)
    trim = k.mass * k.g / np.cos(p["trim.phi"]) / np.cos(p["trim.theta"])
    thrust = p["mass"] * (p["gravity"] - error[:, 2]) / np.cos(phi) / np.cos(theta)
    thrust = np.clip(thrust, *(p["mass"] * p["gravity"] * np.asarray(p["thrust_limits"])))
    for row in range(0, len(record), p["period_ticks"]):
        climb = record.reference[row, REFERENCE.down_vel]
        thrust_n = thrust_for_collective(record.u[row, 3], climb, trim, p["trim.d_col"], k.rotor)
        assert thrust_n == pytest.approx(thrust[row], rel=1e-9)


def test_the_actuators_are_those_of_eq_17(flown):
    """u = F x + G (r - trim) of the estimated state now, F from SciPy's Riccati equation."""
    settings, record = flown
    p = settings.nodes["inner_loop"]
    A, B, E = (np.reshape(p[f"model.{name}"], (9, -1)) for name in "ABE")
    C11, C22 = np.reshape(p["C11"], (4, 4)), np.reshape(p["C22"], (2, 5))
    D11 = np.reshape(p["D11"], (3, 3))
    Q = np.zeros((9, 9))
    Q[:4, :4], Q[4:, 4:] = C11.T @ C11, C22.T @ C22
    R = block_diag(D11.T @ D11, -(p["gamma"] ** 2) * np.eye(3))
    P = solve_continuous_are(A, np.hstack([B, E]), Q, R)
    F = -np.linalg.solve(D11.T @ D11, B.T @ P)
    G = -np.linalg.inv(np.eye(9)[[0, 1, 8]] @ np.linalg.solve(A + B @ F, B))
    x = np.zeros((len(record), 9))
    x[:, [0, 1, 8]] = attitude(record)
    x[:, [2, 3, 6]], x[:, UNMEASURED] = record.nav_rate_body_radps, record.nav_rotor
    trim, u_trim = np.asarray(p["trim.x"]), np.asarray(p["trim.u"])
    x[:, 8] = [wrap_pi(turn) for turn in x[:, 8] - record.setpoint[:, 2]]
    command = record.setpoint - trim[[0, 1, 8]]
    command[:, 2] = 0.0
    wanted = u_trim[:3] + (x - np.where(np.arange(9) == 8, 0.0, trim)) @ F.T + command @ G.T
    assert np.abs(wanted).max() < p["actuator_limit"]
    np.testing.assert_allclose(record.u[:, :3], wanted, atol=1e-7)


def test_the_rotors_state_is_that_of_eq_19(flown):
    """z' = A' z + B' y + H' u over the record, by SciPy: y linear, u held between two ticks."""
    settings, record = flown
    p = settings.nodes["observer"]
    A, B, K = (
        np.reshape(p[name], (-1, columns))
        for name, columns in (("model.A", 9), ("model.B", 3), ("K", 6))
    )
    trim, u_trim = np.asarray(p["trim.x"]), np.asarray(p["trim.u"])[:3]
    auu, aum = A[np.ix_(UNMEASURED, UNMEASURED)], A[np.ix_(UNMEASURED, MEASURED)]
    amu, amm = A[np.ix_(MEASURED, UNMEASURED)], A[np.ix_(MEASURED, MEASURED)]
    prime = auu - K @ amu
    into = {True: aum - K @ amm + prime @ K, False: B[UNMEASURED] - K @ B[MEASURED]}
    angles, rates = attitude(record), record.nav_rate_body_radps
    y = np.column_stack([angles[:, :2], rates, np.unwrap(angles[:, 2])]) - trim[MEASURED]
    start = record.nav_rotor[0] - trim[UNMEASURED] - K @ y[0]
    z = sum(
        lsim((prime, matrix, np.eye(3), np.zeros_like(matrix)), signal, record.time_s,
             start * linear, interp=linear)[1]
        for linear, matrix, signal in ((True, into[True], y), (False, into[False],
                                                              record.u[:, :3] - u_trim))
    )  # fmt: skip
    np.testing.assert_allclose(record.nav_rotor, trim[UNMEASURED] + z + y @ K.T, atol=1e-9)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("/**/outer_loop:\n  ros__parameters:\n    K_Q: [1.0, 1.0, 1.0]\n", "mean 'K_P'"),
        ("/**/plant:\n  ros__parameters:\n    seed: 2\n",
         "unknown node 'plant'; allowed: inner_loop, observer, outer_loop"),
        ("/**/inner_loop:\n  ros__parameters:\n    controller: mpc\n", "hinf"),
    ],
)  # fmt: skip
def test_laws_that_cannot_be_flown_are_named(tmp_path, text, expected):
    file = tmp_path / "bad.yaml"
    file.write_text(text)
    with pytest.raises(ParameterError) as error:
        resolve(laws=str(file))
    assert expected in str(error.value) and "bad.yaml" in str(error.value)


def test_unknown_laws_are_refused_with_those_that_are_known(tmp_path, capsys):
    assert main(["hover", "--control-preset", "papers", "--out", str(tmp_path / "none")]) == 2
    printed = capsys.readouterr().err
    assert (
        printed.count("\n") == 1
        and "--control-preset papers: " in printed
        and "paper" in printed.split("; ")[1]
    )
    assert not (tmp_path / "none").exists()


def test_a_flight_says_its_laws_and_flies_again(fly, tmp_path, capsys):
    words = ("--one-process", "--control-preset", "paper", "--seed", 3)
    _, first = fly(tmp_path / "a", *words, "--duration", 8)
    assert "controllers: paper" in capsys.readouterr().out
    assert (first["laws"], first["changed"]) == ("paper", [])
    assert "control preset paper" in (tmp_path / "a" / "params.yaml").read_text().splitlines()[1]
    _, again = fly(tmp_path / "b", "--params", tmp_path / "a" / "params.yaml")
    same = ["laws", "metrics", "changed", "world", "seed"]
    assert {k: again[k] for k in same} == {k: first[k] for k in same}
    # Under other laws: what these packaged stays behind, what the user changed comes along.
    mine = tmp_path / "mine.yaml"
    mine.write_text("/**/outer_loop:\n  ros__parameters:\n    tilt_limit_deg: 12.0\n")
    fly(tmp_path / "c", *words, "--duration", 6, "--params", mine)
    params = ("--params", tmp_path / "c" / "params.yaml")
    settings = resolve(params=params[1:], laws="packaged")
    assert settings.nodes["outer_loop"]["tilt_limit_deg"] == 12.0
    assert different(settings, resolve(seed=3, duration_s=6.0, world="honest"))["outer_loop"] == {
        "tilt_limit_deg"
    }
    replaced = {o.option: (o.value, o.entry.value) for o in settings.overridden}
    assert replaced["laws"] == ("packaged", "paper")


def test_a_law_of_ones_own_says_only_what_differs(tmp_path):
    """And --attitude-controller wins over it, as it wins over every file."""
    file = tmp_path / "my_laws.yaml"
    file.write_text("/**/inner_loop:\n  ros__parameters:\n    controller: lqr\n")
    settings = resolve(laws=str(file))
    assert settings.laws == str(file) and file in settings.files
    assert different(settings, resolve())["outer_loop"] == set()
    assert settings.nodes["inner_loop"]["controller"] == "lqr"
    assert resolve(laws=str(file), controller="pid").nodes["inner_loop"]["controller"] == "pid"


@pytest.mark.parametrize("controller", ["hinf", "lqr", "pid", "indi", "hinf_output"])
def test_a_controller_takes_its_laws_along(tmp_path, controller):
    """Unless laws are named; the user's own gains stay over both."""
    settings = resolve(controller=controller)
    assert settings.laws == controller
    np.testing.assert_equal(dict(settings.nodes), dict(resolve(laws=controller).nodes))
    named = resolve(controller=controller, laws="paper")
    assert named.laws == "paper" and named.nodes["inner_loop"]["controller"] == controller
    assert resolve(controller="matrices").laws == "packaged"
    mine = tmp_path / "mine.yaml"
    mine.write_text("/**/outer_loop:\n  ros__parameters:\n    K_P: [0.5, 0.5, 2.0]\n")
    K_P = resolve(controller=controller, params=[mine]).nodes["outer_loop"]["K_P"]
    assert np.array_equal(K_P, [0.5, 0.5, 2.0])
