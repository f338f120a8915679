# SPDX-License-Identifier: Apache-2.0
"""Published linear aircraft: the files, their poles beside the published numbers, the plant."""

import math
from pathlib import Path

import numpy as np
import pytest
import yaml

from heli_core.errors import ParameterCause, PlantConfigError
from heli_core.rotations import quat_from_euler, quat_to_R_nb
from heli_core.rows import ACTUATOR, NINE, PLANT
from heli_dynamics_sim.aircraft import AircraftError
from heli_dynamics_sim.airframe import make_state
from heli_dynamics_sim.config import PlantConfig
from heli_dynamics_sim.helicopter import WORK_ROWS, same_air
from heli_dynamics_sim.linear_aircraft import (
    STATES,
    LinearAircraft,
    find_linear,
    linear_models,
)
from heli_dynamics_sim.linear_plant import (
    LinearPlant,
    linear_derivative,
    linear_force,
    linear_params,
    linear_step,
    linear_trim,
)

NAMES = ("blade360", "heli600", "helion_published", "xcell_tempest")
PLACES = [*range(3, 6), *range(10, 16)]
CALM = same_air((0.0, 0.0, 0.0))


@pytest.fixture(params=NAMES)
def aircraft(request):
    return LinearAircraft.from_yaml(request.param)


def hover(aircraft):
    x = make_state((0.0, 0.0, -10.0), aircraft.phi, aircraft.theta, 0.0)
    x[PLANT.rotor], x[PLANT.servo] = aircraft.rotor, aircraft.u_trim
    return x


def slopes(x, aircraft, air=CALM):
    out = np.empty(PLANT.size)
    linear_derivative(x, x[PLANT.servo].copy(), air, linear_params(aircraft), out)
    return out


def test_all_are_packaged_and_cited():
    assert tuple(linear_models()) == NAMES
    for name in NAMES:
        one = LinearAircraft.from_yaml(name)
        assert one.citation and one.source.startswith("https://")


# -------------------------------------------------------------------------------------------------
# Poles beside the published derivatives, written out anew.
# -------------------------------------------------------------------------------------------------


def roots(A):
    return np.sort_complex(np.linalg.eigvals(np.array(A, float)))


def attitude_poles(aircraft, kept):
    """Poles of a part of the bare aircraft: rows and columns of these states."""
    places = [STATES.index(name) for name in kept]
    return np.sort_complex(np.linalg.eigvals(aircraft.A[np.ix_(places, places)]))


def flapping_block(lb1s, ma1s, tf, lf_a1s, mf_b1s):
    """States p, q, a, b, as ArduPilot's rotor dynamics have them."""
    return [
        [0.0, 0.0, 0.0, lb1s],
        [0.0, 0.0, ma1s, 0.0],
        [0.0, -1.0, -1.0 / tf, mf_b1s / tf],
        [-1.0, 0.0, lf_a1s / tf, -1.0 / tf],
    ]


@pytest.mark.parametrize(
    ("name", "numbers"),
    [
        ("blade360", (5115.2, 796.7, 0.0353, 1.0477, -1.0057)),
        ("heli600", (3588.6, 617.5, 0.068232, 1.2963, -1.3402)),
    ],
)
def test_poles_of_rotor_and_body_are_the_published(name, numbers):
    found = attitude_poles(LinearAircraft.from_yaml(name), ("p", "q", "a_s", "b_s"))
    assert found == pytest.approx(roots(flapping_block(*numbers)), rel=1e-5)


def test_poles_of_the_tempest_are_its_dampings():
    one = LinearAircraft.from_yaml("xcell_tempest")
    for state, damping in zip("uvwpq", (0.18, 0.43, 0.49, 12.78, 10.12), strict=True):
        assert np.abs(one.poles + damping).min() < 1e-9, state


def test_poles_of_the_whole_blade360_are_those_of_its_equations():
    """Ten derivatives of the paper, gravity, and the gyro, assembled by hand."""
    g, phi, tf = 9.80665, 0.055869, 0.0353
    one = LinearAircraft.from_yaml("blade360")
    rows = {name: i for i, name in enumerate(("phi", "theta", *one.states))}
    A = np.zeros((len(rows), len(rows)))

    def put(row, **entries):
        for column, value in entries.items():
            A[rows[row], rows[column]] = value

    put("phi", p=1.0)
    put("theta", q=math.cos(phi), r=-math.sin(phi))
    put("u", u=-0.2270, a_s=-g, theta=-g)
    put("v", v=-0.1852, p=0.2303, b_s=g, phi=g * math.cos(phi))
    put("w", w=-0.5910, phi=-g * math.sin(phi))
    put("p", u=-28.7796, v=-5.5376, b_s=5115.2)
    put("q", u=2.7501, v=-2.3039, a_s=796.7)
    ped = 63.0040 * 1.45
    put("r", v=1.7258, w=5.7574, r=-2.0131 - 0.1 * ped, d_int=0.4 * ped)
    put("d_int", r=-1.0)
    put("a_s", q=-1.0, a_s=-1.0 / tf, b_s=-1.0057 / tf)
    put("b_s", p=-1.0, b_s=-1.0 / tf, a_s=1.0477 / tf)
    assert np.sort_complex(one.poles) == pytest.approx(roots(A), rel=1e-5, abs=1e-6)


def test_nine_states_of_helion_are_the_published_matrices():
    data = Path(__file__).parents[3] / "tests/verification/data/nus_linear_model.yaml"
    published = yaml.safe_load(data.read_text())
    A, B, E, _ = LinearAircraft.from_yaml("helion_published").nine()
    assert pytest.approx(np.array(published["A"], float), abs=1e-4) == A
    assert pytest.approx(np.array(published["B"], float), abs=1e-9) == B
    assert pytest.approx(np.array(published["E"], float), abs=1e-9) == E


def test_a_disc_that_a_law_is_given_keeps_pole_and_steady_rate():
    A, B, _, _ = LinearAircraft.from_yaml("xcell_tempest").nine()
    for rate, disc, lever, damping, push in (
        (NINE.p, NINE.b_s, ACTUATOR.lat, 12.78, 33.04),
        (NINE.q, NINE.a_s, ACTUATOR.lon, 10.12, -33.32),
    ):
        block = np.ix_([rate, disc], [rate, disc])
        assert np.linalg.eigvals(A[block]).real.max() == pytest.approx(-damping)
        steady = np.linalg.solve(A[block], -B[[rate, disc], lever])
        assert steady[0] == pytest.approx(push / damping)


# -------------------------------------------------------------------------------------------------
# The plant: linear about hover, a rigid body under gravity everywhere.
# -------------------------------------------------------------------------------------------------


def test_linearised_about_hover_it_is_the_file(aircraft):
    x, k = hover(aircraft), linear_params(aircraft)
    assert np.abs(slopes(x, aircraft)[PLACES]).max() < 0.05  # rounded trims
    for matrix, places in ((aircraft.A, PLACES), (aircraft.B, range(16, 20))):
        for j, place in enumerate(places):
            plus, minus = x.copy(), x.copy()
            plus[place] += 1e-5
            minus[place] -= 1e-5
            found = (slopes(plus, aircraft) - slopes(minus, aircraft))[PLACES] / 2e-5
            assert found == pytest.approx(matrix[:, j], abs=1e-5, rel=1e-7)
    assert k.lags == (aircraft.servo is not None)


def test_the_whole_model_is_the_plant_with_gravity(aircraft):
    """Phi, theta beside the file's states, by differences of the plant against `whole`."""
    A, _ = aircraft.whole()
    x, kept = hover(aircraft), [STATES.index(name) for name in aircraft.states]
    for j, turned in enumerate(((1e-5, 0.0), (0.0, 1e-5))):
        both = []
        for sign in (1.0, -1.0):
            moved = x.copy()
            moved[PLANT.quat] = quat_from_euler(
                aircraft.phi + sign * turned[0], aircraft.theta + sign * turned[1], 0.0
            )
            both.append(slopes(moved, aircraft)[PLACES])
        found = (both[0] - both[1])[kept] / 2e-5
        assert found == pytest.approx(A[2:, j], abs=1e-5)


def test_wind_is_the_opposite_of_its_velocity(aircraft):
    x = hover(aircraft)
    wind = np.array([0.3, -0.2, 0.1])
    moving, blown = x.copy(), slopes(x, aircraft, same_air(wind))
    moving[PLANT.vel] = -quat_to_R_nb(x[PLANT.quat]).T @ wind
    assert blown[PLACES] == pytest.approx(slopes(moving, aircraft)[PLACES], abs=1e-12)
    body = quat_to_R_nb(x[PLANT.quat]).T @ wind
    still = slopes(x, aircraft)[PLACES]
    assert blown[PLACES] - still == pytest.approx(aircraft.E @ body, abs=1e-9)


def test_without_its_forces_it_falls_freely(aircraft):
    """The acceleration over the ground is gravity and the specific force, nothing else."""
    rng, k = np.random.default_rng(1), linear_params(aircraft)
    x = hover(aircraft)
    x[PLANT.quat] = quat_from_euler(0.4, -0.3, 1.0)
    x[PLANT.vel], x[PLANT.rate] = rng.normal(size=3), rng.normal(size=3)
    force, out = np.empty(3), slopes(x, aircraft)
    linear_force(x, CALM, k, force)
    R_nb = quat_to_R_nb(x[PLANT.quat])
    over_ground = R_nb @ (out[PLANT.vel] + np.cross(x[PLANT.rate], x[PLANT.vel]))
    falls = over_ground - R_nb @ force
    assert falls == pytest.approx([0.0, 0.0, aircraft.gravity_mps2], abs=1e-9)


def test_in_hover_it_stays(aircraft):
    k, work = linear_params(aircraft), np.zeros((WORK_ROWS, PLANT.size))
    x, u = linear_trim(aircraft, np.zeros(3), 0.5)
    begun = x.copy()
    for _ in range(50):
        linear_step(x, u, CALM, k, 0.002, work)
    assert x == pytest.approx(begun, abs=1e-6)


def test_heavier_it_hovers_on_more_collective(aircraft):
    values = {f"scale.{name}": 1.0 for name in
              ("mass", "inertia", "rotor_stiffness", "thrust", "servo_speed", "drag")}  # fmt: skip
    plain, _ = linear_trim(aircraft.scaled(values), np.zeros(3), 0.0)
    heavy, u = linear_trim(aircraft.scaled({**values, "scale.mass": 1.2}), np.zeros(3), 0.0)
    assert aircraft.scaled(values).u_trim == pytest.approx(aircraft.u_trim)
    assert heavy[PLANT.servo_col] < plain[PLANT.servo_col] and abs(u).max() < 1.0


# -------------------------------------------------------------------------------------------------
# What is refused.
# -------------------------------------------------------------------------------------------------


def changed(tmp_path, change):
    tree = yaml.safe_load(find_linear("blade360").read_text())
    change(tree)
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump(tree))
    return file


def _set(*path, to):
    def change(tree):
        for key in path[:-1]:
            tree = tree[key]
        tree[path[-1]] = to

    return change


@pytest.mark.parametrize(
    ("change", "key", "cause"),
    [
        (_set("A", "p", "bs", to=1.0), "A: p: bs", ParameterCause.UNKNOWN_KEY),
        (_set("B", "pp", to={}), "B: pp", ParameterCause.UNKNOWN_KEY),
        (_set("bodi", to={}), "bodi", ParameterCause.UNKNOWN_KEY),
        (_set("trim", "fi_rad", to=0.0), "trim.fi_rad", ParameterCause.UNKNOWN_KEY),
        (_set("A", "p", to=[1.0, 2.0]), "A: p", ParameterCause.LENGTH),
        (_set("A", "p", "u", to=math.nan), "A: p: u", ParameterCause.NOT_FINITE),
        (_set("A", "p", "u", to="much"), "A: p: u", ParameterCause.TYPE),
        (_set("A", "p", "u", to=1e6), "A: p: u", ParameterCause.BOUNDS),
        (_set("A", "r", "r", to=100.0), "A", ParameterCause.BOUNDS),
        (_set("A", "p", "p", to=-5000.0), "A", ParameterCause.BOUNDS),
        (_set("B", "w", to={}), "B: w: d_col", ParameterCause.BOUNDS),
        (_set("states", to=["u", "v"]), "states", ParameterCause.LENGTH),
        (_set("delay_s", to=2.0), "delay_s", ParameterCause.BOUNDS),
        (_set("citation", to=""), "citation", ParameterCause.TYPE),
        (lambda tree: tree.pop("body"), "body.mass_kg", ParameterCause.MISSING),
        (lambda tree: tree.pop("A"), "A", ParameterCause.MISSING),
    ],
)
def test_what_is_wrong_is_named(tmp_path, change, key, cause):
    with pytest.raises(AircraftError) as refused:
        LinearAircraft.from_yaml(changed(tmp_path, change))
    assert (refused.value.key, refused.value.cause) == (key, cause)
    assert "mine.yaml" in str(refused.value) and "\n" not in str(refused.value)


def test_an_unknown_name_names_those_that_are():
    with pytest.raises(AircraftError, match="blade360"):
        LinearAircraft.from_yaml("blade361")


def test_the_simulated_helicopter_takes_none():
    with pytest.raises(PlantConfigError) as refused:
        PlantConfig.from_parameters({"linear_model": "blade360"})
    assert refused.value.key == "linear_model"
    with pytest.raises(PlantConfigError) as refused:
        LinearPlant.of_parameters({"linear_model": "blade360", "start.on_ground": True})
    assert refused.value.key == "start.on_ground"
