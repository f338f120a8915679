# SPDX-License-Identifier: Apache-2.0
"""examples/mpc_position.py: its optimum by other methods, its limits, no offset, its flights."""

import importlib.util
import json
import math
import sys

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.signal import lfilter

import heli
from evidence.files import checkout
from heli_core.python_controller import LawError, find
from heli_flight.position_axes import NAMES, position_axes
from heli_flight.settings import resolve
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.tuning import model_of
from heli_studies.compare import loop_as_flown

FILE = checkout() / "examples" / "mpc_position.py"
LAW = f"{FILE}:MpcPosition"
_spec = importlib.util.spec_from_file_location("mpc_position", FILE)
mpc = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(mpc)
DT_S, N = mpc.DT_S, mpc.HORIZON
STILL = np.zeros(N)
AXES = range(3)


def axis_of(i, rate=1e9):
    return mpc.AxisMpc(mpc.MODELS[i], mpc.WEIGHTS[i], rate)


def riccati_gain(model, weights, steps=4000):
    """Gain on (position, speed, a(k-1), a(k-2), ..., u(k-1), u(k-2), ...), by plain iteration."""
    num, den = np.array(model.num), np.array(model.den)
    m = len(den)
    a = np.zeros(2 + 2 * m)
    a[1] = -model.damping
    a[2 : 2 + m], a[2 + m :] = -den, num[1:]
    A, B = np.zeros((len(a), len(a))), np.zeros(len(a))
    # The damping acts beside the model's acceleration, of which it remembers nothing.
    flown = a.copy()
    flown[1] = 0.0
    A[0], A[1] = 0.5 * DT_S**2 * a, DT_S * a
    A[0, :2] += [1.0, DT_S]
    A[1, 1] += 1.0
    A[2] = flown
    A[3 : 2 + m, 2 : 1 + m] = np.eye(m - 1)
    A[3 + m :, 2 + m : 1 + 2 * m] = np.eye(m - 1)
    B[[0, 1, 2]] = num[0] * np.array([0.5 * DT_S**2, DT_S, 1.0])
    B[2 + m] = 1.0
    last = np.eye(len(a))[2 + m]
    Q = np.diag([1.0, weights.speed, *np.zeros(2 * m)]) + weights.change * np.outer(last, last)
    P = np.zeros_like(A)
    for _ in range(steps):
        over = weights.command + weights.change + B @ P @ B
        K = (B @ P @ A - weights.change * last) / over
        P = Q + A.T @ P @ A - over * np.outer(K, K)
    return K


@pytest.mark.parametrize("i", AXES)
def test_without_limits_it_is_the_lqr_of_the_difference_equation(i):
    """Dynamic programming on past accelerations and commands, not the controller's own states."""
    axis, rng = axis_of(i), np.random.default_rng(1)
    K = riccati_gain(mpc.MODELS[i], mpc.WEIGHTS[i])
    m = len(mpc.MODELS[i].den)
    for _ in range(5):
        axis.begin(0.0, 0.0)
        u = rng.standard_normal(12)
        for command in u:
            axis.last = command
            axis.observe(0.0, 0.0, 0.0)
        a = lfilter(mpc.MODELS[i].num, (1.0, *mpc.MODELS[i].den), u)
        e, v = rng.standard_normal(2)
        wanted = -K @ [e, v, *a[::-1][:m], *u[::-1][:m]]
        axis.disturbance = 0.0
        assert axis.command(e, v, STILL, -1e9, 1e9) == pytest.approx(wanted, rel=1e-6)
        assert axis.qp.asked == 0


@pytest.mark.parametrize("i", AXES)
@pytest.mark.parametrize("error", [2.0, 20.0])
def test_with_limits_it_is_the_optimum(i, error):
    """Karush, Kuhn, Tucker: the gradient is pushed against by active limits, outwards only.

    Their multipliers are non-negative least squares, not the solver's.
    """
    axis = axis_of(i, rate=20.0)
    axis.x, axis.last, axis.disturbance = axis.stands.copy(), 1.0, 0.5
    made = axis.command(error, 1.0, STILL, -6.0, 6.0)
    assert axis.qp.asked == 1 and axis.qp.unsolved == 0
    U = axis.qp.x
    f = axis.F @ np.array([error, 1.0, *axis.stands, 1.0, *(0.5 + STILL)])
    steps = np.diff(np.eye(N), axis=0, prepend=np.zeros((1, N)))
    rows = np.vstack([np.eye(N), -np.eye(N), steps, -steps])
    begins = np.eye(N)[0]
    room = np.concatenate([6.0 + STILL, 6.0 + STILL, 0.8 + begins, 0.8 - begins]) - rows @ U
    assert room.min() > -1e-3
    active = rows[room < 2e-3]
    _, left = nnls(active.T, -(axis.H @ U + f))
    assert len(active) > 3 and left < 1e-3 * np.linalg.norm(f)
    assert made == pytest.approx(U[0], abs=1e-3)


@pytest.mark.parametrize("i", AXES)
def test_no_command_exceeds_a_limit_or_the_rate(i):
    axis, rng, last = axis_of(i, rate=20.0), np.random.default_rng(2), 0.0
    for _ in range(300):
        error, speed = 10.0 * rng.standard_normal(2)
        low, high = -4.0 + rng.random(), 4.0 - rng.random()
        made = axis.command(error, speed, 3.0 * rng.standard_normal(N), low, high)
        assert abs(made - last) <= axis.step_limit + 1e-12
        # A limit that has moved past the last command is gone to at the rate.
        assert min(low, last + axis.step_limit) - 1e-12 <= made
        assert made <= max(high, last - axis.step_limit) + 1e-12
        last = made
        axis.observe(speed, speed, 4.0)
    assert axis.qp.asked > 100


@pytest.mark.parametrize("i", AXES)
def test_steady_wind_leaves_no_offset_though_the_aircraft_is_not_the_model(i):
    axis, model = axis_of(i), mpc.MODELS[i]
    e, v, past = 0.0, 0.0, []
    for _ in range(2000):
        axis.observe(v, v, 4.0)
        past.append(axis.command(e, v, STILL, -8.0, 8.0))
        a = 1.2 * lfilter(model.num, (1.0, *model.den), past[-200:])[-1] - model.damping * v + 1.5
        e, v = e + DT_S * v + 0.5 * DT_S**2 * a, v + DT_S * a
    assert abs(e) < 1e-6 and abs(v) < 1e-6


def test_the_models_are_those_of_the_loop_as_flown():
    """The acceleration after a step of the command, of the axes that margins are worked out of."""
    nodes = resolve("hover", "rtk", world="honest").nodes
    config = AttitudeConfig.from_parameters(nodes["inner_loop"])
    loop = loop_as_flown(nodes), model_of(config)
    around = position_axes(nodes["plant"], nodes["outer_loop"], *loop)
    for i, axis in enumerate(around.axes(config.actuation)):
        A, B, C, _ = axis.actuation
        x, flown = np.zeros(len(A)), []
        for _ in range(4 * 75):
            flown.append(C[0] @ x)
            x = A @ x + B[:, 0]
        mean = np.reshape(flown, (-1, 4)).mean(axis=1)
        known = lfilter(mpc.MODELS[i].num, (1.0, *mpc.MODELS[i].den), np.ones(75))
        assert np.abs(known - mean).max() < 0.06, NAMES[i]
        assert np.sqrt(np.mean((known - mean) ** 2)) < 0.02, NAMES[i]


def test_the_weights_are_those_that_the_search_has_found():
    found = json.loads((checkout() / "docs/results/mpc.json").read_text("utf-8"))["found"]
    for row, weights in zip(found["weights"], mpc.WEIGHTS, strict=True):
        assert tuple(row["weights"]) == (
            weights.speed, weights.command, weights.change, weights.bandwidth_radps,
        )  # fmt: skip


def test_it_flies_20_m_at_the_limit_of_tilt_twice_to_the_same_bytes():
    path = {
        "path.waypoints_ned_m": [20.0, 0.0, -10.0], "path.start_s": 1.0, "path.speed_mps": 20.0,
        "path.acceleration_mps2": 8.0, "path.jerk_mps3": 20.0,
    }  # fmt: skip
    options = {"seed": 1, "gps": "rtk", "world": "honest", "duration_s": 11, "quiet": True}
    law = mpc.MpcPosition()
    one, two = (
        heli.fly("waypoints", law=of, params={"scenario": path}, **options) for of in (law, LAW)
    )
    assert not one.lost and sum(axis.qp.asked for axis in law.axes) > 50
    for name, column in one.columns().items():
        assert np.array_equal(two.columns()[name], column, equal_nan=True), name
    outer = one.parameters["outer_loop"]
    tilts = np.column_stack([one.setpoint.phi_rad - outer["trim.phi"],
                             one.setpoint.theta_rad - outer["trim.theta"]])  # fmt: skip
    limit = math.radians(outer["tilt_limit_deg"])
    assert 0.99 * limit < np.abs(tilts).max() <= limit + 1e-9
    assert np.abs(np.diff(tilts, axis=0)).max() <= mpc.TILT_RATE * DT_S + 1e-9
    assert abs(one.truth.north_m[-1] - 20.0) < 1.0


def test_it_flies_step_by_step_and_from_a_saved_state():
    sim = heli.Simulation(world="honest", seed=3, gps="rtk", law=LAW)
    sim.reset()
    for _ in range(100):
        sim.step()
    state = sim.save()
    ahead = [sim.step().truth.row for _ in range(100)]
    sim.restore(state)
    again = [sim.step().truth.row for _ in range(100)]
    assert np.array_equal(ahead, again)


def test_without_osqp_it_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "osqp", None)
    with pytest.raises(LawError, match=r"needs osqp.*pip install osqp"):
        find(LAW)
