# SPDX-License-Identifier: Apache-2.0
"""Linearised default aircraft against the published A, B, E of its class and a second method.

Reference: `data/nus_linear_model.yaml` (source in the file). Tolerance: 0.6 % plus half a unit of
the last published digit, for every entry that the model claims to reproduce; the others are listed
in `data/known_deviations.yaml`. `evidence/experiments/deviations.py` prints them all.
"""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from heli_core.rotations import quat_from_euler, quat_to_R_nb
from heli_core.rows import INPUT_NAMES, NINE, PLANT, STATE_NAMES, WIND_NAMES
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.helicopter import derivative_kernel, same_air
from heli_dynamics_sim.trim import (
    ReducedModel,
    linearize,
    linearize_moving,
    reduced_state,
    smooth_params,
    trim,
)

DATA = Path(__file__).parent / "data"
RELATIVE, LAST_DIGIT = 0.006, 0.5e-4
COLUMNS = {"A": STATE_NAMES, "B": INPUT_NAMES, "E": WIND_NAMES}

# Published entries that the equations do not give: (matrix, row, column) -> ours.
KNOWN = {
    tuple(re.match(r"(\w)\((\w+), (\w+)\)", entry).groups()): values["ours"]
    for entry, values in yaml.safe_load((DATA / "known_deviations.yaml").read_text()).items()
}


@pytest.fixture(scope="module")
def params():
    return HelicopterParameters.from_yaml("helion.yaml")


@pytest.fixture(scope="module")
def hover(params):
    return trim(params)


@pytest.fixture(scope="module")
def model(params, hover):
    return linearize(params, hover)


@pytest.fixture(scope="module")
def published():
    tree = yaml.safe_load((DATA / "nus_linear_model.yaml").read_text())
    return {name: np.array(tree[name]) for name in COLUMNS}


def test_trim_without_wind(params, hover):
    """Hover; another implementation and the paper's Table 1; half a digit, class of values."""
    # phi 0.0390, theta 0.0009 of another implementation; class of the paper's Table 1: a_s -0.0011,
    # b_s 0.0042, d_lat 0.0075, d_lon -0.0060, d_col -0.1793
    nine = dict(zip(STATE_NAMES, reduced_state(hover.x), strict=True))
    assert hover.residual <= 1e-9
    assert nine["phi"] == pytest.approx(0.0390, abs=5e-5)
    assert nine["theta"] == pytest.approx(0.0009, abs=5e-5)
    assert nine["a_s"] == pytest.approx(-0.0011, abs=5e-4)
    assert nine["b_s"] == pytest.approx(0.0042, abs=1e-3)
    assert hover.u == pytest.approx([0.0075, -0.0060, 0.0, -0.1793], abs=0.005)


def test_names(model):
    """The model as a system of python-control: every entry under its name."""
    system = model.system
    nine = ["phi", "theta", "p", "q", "a_s", "b_s", "r", "d_int", "psi"]
    assert system.state_labels == system.output_labels == nine
    assert system.input_labels == ["d_lat", "d_lon", "d_ped", "wind_u", "wind_v", "wind_w"]
    assert np.array_equal(system.A, model.A)
    assert np.array_equal(system.B, np.hstack([model.B, model.E]))
    rates = system["r", "d_ped"](1e3j) * 1e3j  # far above all modes only the input itself is left
    assert rates == pytest.approx(model.B[6, 2], rel=0.05)


@pytest.mark.parametrize("name", ["A", "B", "E"])
def test_entries_reproduce_the_published_ones(model, published, name):
    """A, B, E entry by entry; the published ones; 0.6 % + half of the last digit."""
    ours, theirs = getattr(model, name), published[name]
    assert ours.shape == theirs.shape
    for i, row in enumerate(STATE_NAMES):
        for j, column in enumerate(COLUMNS[name]):
            if (name, row, column) in KNOWN:
                continue
            bound = RELATIVE * abs(theirs[i, j]) + LAST_DIGIT
            assert abs(ours[i, j] - theirs[i, j]) <= bound, (name, row, column, ours[i, j])


@pytest.mark.parametrize(("entry", "expected"), KNOWN.items())
def test_known_deviations_stay_what_they_are(model, published, entry, expected):
    """The entries that do not agree; our recorded value, 0.5 %; they do deviate."""
    name, row, column = entry
    i, j = STATE_NAMES.index(row), COLUMNS[name].index(column)
    assert getattr(model, name)[i, j] == pytest.approx(expected, rel=5e-3, abs=1e-6)
    bound = RELATIVE * abs(published[name][i, j]) + LAST_DIGIT
    assert abs(expected - published[name][i, j]) > 0.5 * bound


def test_roll_by_vertical_gusts_deviates_as_the_trim_does(params, hover, model, published):
    """E(p, w) = -dT/dw H_mr sin b_s / J_xx; with the published trim's b_s the published E.

    b_s is 0.0049 here and 0.0042 in the published trim (to half a digit); 0.6 % + half a digit.
    """
    entry = STATE_NAMES.index("p"), WIND_NAMES.index("w")

    def at(b_s):
        x = hover.x.copy()
        x[14] = b_s
        return linearize(params, replace(hover, x=x)).E[entry]

    ratio = model.E[entry] / np.sin(hover.x[14])
    theirs = published["E"][entry]
    bound = RELATIVE * abs(theirs) + LAST_DIGIT
    assert at(0.00425) - bound <= theirs <= at(0.00415) + bound
    assert at(0.0042) / np.sin(0.0042) == pytest.approx(ratio, rel=1e-3)


def test_half_a_metre_per_second_of_side_wind_shifts_the_model(params, model):
    """What heli_analysis.identification's README says of the mean of turbulence."""
    windy = [linearize(params, trim(params, (0.0, v, 0.0))) for v in (-0.5, 0.5)]
    r, p, v = STATE_NAMES.index("r"), STATE_NAMES.index("p"), WIND_NAMES.index("v")
    side = [abs(w.E[r, v] / model.E[r, v] - 1.0) for w in windy]
    roll = [abs(w.A[r, p] / model.A[r, p] - 1.0) for w in windy]
    assert max(side) == pytest.approx(0.13, abs=0.005)
    assert max(roll) == pytest.approx(0.045, abs=0.002)
    tilts = [np.degrees(abs(w.x_trim[0] - model.x_trim[0])) for w in windy]
    assert tilts == pytest.approx([0.83, 0.83], abs=0.01)


def test_deviation_table_explains_every_deviation():
    """Exit 0, a row per entry, the known ones with their reason."""
    run = subprocess.run(
        [sys.executable, "-m", "evidence.experiments.deviations"],
        cwd=Path(__file__).resolve().parents[2], capture_output=True, text=True, timeout=280,
    )  # fmt: skip
    assert run.returncode == 0, run.stdout + run.stderr
    assert "UNEXPLAINED" not in run.stdout
    entries = [line for line in run.stdout.splitlines() if re.match(r"\| [ABE]\(", line)]
    assert len(entries) > 30
    for name, row, column in KNOWN:
        assert any(line.startswith(f"| {name}({row}, {column}) |") for line in entries)


@pytest.mark.parametrize(
    ("name", "row", "column", "value", "tolerance"),
    [
        ("A", "p", "p", -0.0301, 0.006),
        ("A", "p", "r", 11.440, 0.001),
        ("A", "r", "p", 0.0579, 0.002),
        ("A", "r", "r", -21.9555, 0.001),
        ("A", "r", "d_int", 114.20, 0.001),
        ("A", "p", "d_int", -59.505, 0.001),
        ("A", "q", "q", -0.0703, 0.006),
        ("A", "p", "b_s", 586.7, 0.001),
        ("A", "q", "a_s", 268.7, 0.001),
        ("B", "p", "d_ped", 43.346, 0.001),
        ("B", "r", "d_ped", -83.188, 0.001),
        ("E", "p", "v", 0.1755, 0.001),
        ("E", "r", "v", -0.3396, 0.001),
        ("E", "q", "w", 0.0340, 0.006),
    ],
)
def test_an_independent_implementation_of_the_same_equations_agrees(
    model, name, row, column, value, tolerance
):
    """Values of another implementation of these equations, to its printed digits."""
    i, j = STATE_NAMES.index(row), COLUMNS[name].index(column)
    assert getattr(model, name)[i, j] == pytest.approx(value, rel=tolerance)


def sixth_order(f, step=1e-4):
    """Jacobian by the 7-point stencil: an independent method."""
    weights = {1: 45.0, 2: -9.0, 3: 1.0}
    columns = []
    for i in range(f.z0.size):
        total = 0.0
        for reach, weight in weights.items():
            plus, minus = f.z0.copy(), f.z0.copy()
            plus[i] += reach * step
            minus[i] -= reach * step
            total = total + weight * (f(plus) - f(minus))
        columns.append(total / (60.0 * step))
    return np.column_stack(columns)


@pytest.mark.parametrize("wind", [(0.0, 0.0, 0.0), (3.0, -4.0, 0.5)])
def test_second_method_agrees_to_1e_minus_7(params, wind):
    """A, B, E in calm and wind, smooth fins; 7-point stencil; 1e-7."""
    # Smooth fins: at the kinks of v |v| any difference quotient is first order only.
    smooth = replace(params, vfin_area_m2=0.0)
    hover = trim(smooth, wind)
    model = linearize(smooth, hover)
    other = sixth_order(ReducedModel(smooth_params(smooth, hover, "descent"), hover))
    mine = np.hstack([model.A, model.B, model.E])
    assert np.abs(mine - other).max() <= 1e-7


def test_with_fins_the_second_method_agrees_to_the_kinks_own_error(params, hover, model):
    """The same with fins (v |v| has a kink); 7-point stencil; 1e-7."""
    other = sixth_order(ReducedModel(smooth_params(params, hover, "descent"), hover), 1e-5)
    assert np.abs(np.hstack([model.A, model.B, model.E]) - other).max() <= 1e-7


def test_linear_model_predicts_the_nonlinear_one(params, hover, model):
    """The tangent: the error of the prediction shrinks with the square of the deviation."""
    f = ReducedModel(params.params, hover)
    jacobian = np.hstack([model.A, model.B])
    rng = np.random.default_rng(2)
    for _ in range(20):
        d = np.zeros(15)
        d[:12] = rng.standard_normal(12)
        errors = [
            np.abs(f(f.z0 + s * d) - f(f.z0) - s * (jacobian @ d[:12])).max() for s in (1e-3, 1e-4)
        ]
        assert errors[1] < 0.02 * errors[0] + 1e-9


def test_kink_of_the_climb_power(params, hover, model):
    """E(r, w): one value for rising air, another for sinking air."""
    climb = linearize(params, hover, "climb")
    r, w = STATE_NAMES.index("r"), 2
    # dN = -dP/Omega, P_climb = -m g w_a, w_a = -w
    step = -9.75 * 9.781 / 193.73 / 0.787
    assert climb.E[r, w] - model.E[r, w] == pytest.approx(step, rel=1e-6)
    other = np.abs(climb.E - model.E)
    other[r, w] = 0.0
    assert other.max() < 1e-9
    with pytest.raises(ValueError, match="side"):
        linearize(params, hover, "sideways")


@pytest.mark.parametrize("wind_mps", [0.0, 4.0])
def test_moving_model_is_what_the_plant_does(params, wind_mps):
    """Second method: NED velocities of the nonlinear aircraft, a moment apart, when displaced."""
    at = trim(params, wind_mps * np.array([-0.6, -0.8, 0.0]), 0.0)
    linear = linearize_moving(params, at)
    kernel, still = params.params, np.empty(PLANT.size)

    def acceleration(d):
        x = at.x.copy()
        x[PLANT.down] = -1000.0
        nine = reduced_state(at.x) + d[:9]
        x[PLANT.quat] = quat_from_euler(nine[NINE.phi], nine[NINE.theta], nine[NINE.psi])
        x[PLANT.rate], x[PLANT.rotor] = nine[2:4].tolist() + [nine[6]], nine[[4, 5, 7]]
        x[PLANT.servo] = at.u + d[9:13]
        air = at.wind_ned_mps + quat_to_R_nb(x[PLANT.quat]) @ d[13:]
        velocity = []
        for step in (0.0, 1e-5):
            derivative_kernel(x, at.u, same_air(air), kernel, still)
            moved = x + step * still
            moved[PLANT.quat] /= np.linalg.norm(moved[PLANT.quat])
            velocity.append(quat_to_R_nb(moved[PLANT.quat]) @ moved[PLANT.vel])
        return (velocity[1] - velocity[0]) / 1e-5

    rng = np.random.default_rng(5)
    for _ in range(5):
        d = 1e-4 * rng.standard_normal(16)
        d[15] = abs(d[15])  # air that sinks or rises: a kink at none
        change = 0.5 * (acceleration(d) - acceleration(-d))
        predicted = np.hstack([linear.A, linear.B, linear.E]) @ d
        np.testing.assert_allclose(change, predicted[9:], atol=2e-6)
    nine = linearize(params, at)
    np.testing.assert_allclose(linear.A[:9], nine.A, atol=1e-9)
    np.testing.assert_allclose(linear.B[:9, :3], nine.B, atol=1e-9)
    np.testing.assert_allclose(linear.E[:9], nine.E, atol=1e-9)
