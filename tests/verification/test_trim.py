# SPDX-License-Identifier: Apache-2.0
"""Trim over winds from all directions; a trim that does not exist says why."""

import re
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import root

from heli_core.rotations import euler_from_quat
from heli_core.rows import PLANT
from heli_dynamics_sim.aircraft import HelicopterParameters, ModelOptions
from heli_dynamics_sim.helicopter import state_derivative
from heli_dynamics_sim.main_rotor import rotor_flow
from heli_dynamics_sim.trim import _RESIDUAL_LIMIT, TrimError, trim


@pytest.fixture(scope="module")
def params():
    return HelicopterParameters.from_yaml("helion.yaml")


@pytest.mark.parametrize("speed", [1.0, 3.0, 5.0, 8.0, 12.0])
@pytest.mark.parametrize("vertical", [-1.0, 0.0, 1.0])
def test_wind_from_all_directions(params, speed, vertical):
    """Hover in 1 to 12 m/s from 12 directions, rising and sinking air; all derivatives; 1e-9."""
    for angle in np.radians(np.arange(0.0, 360.0, 30.0)):
        wind = [speed * np.cos(angle), speed * np.sin(angle), vertical]
        point = trim(params, wind, psi=0.4)
        x = point.x.copy()
        x[2] = -100.0
        rates = state_derivative(x, point.u, wind, params)
        assert np.abs(rates).max() <= 1e-9
        assert point.residual <= 1e-9
        assert euler_from_quat(point.x[6:10])[2] == pytest.approx(0.4)


def test_trim_turns_with_wind_and_heading(params):
    """Wind and heading turned together; the same trim; 1e-10."""
    first = trim(params, [3.0, 4.0, 0.0], psi=0.0)
    c, s = np.cos(1.0), np.sin(1.0)
    second = trim(params, [3.0 * c - 4.0 * s, 3.0 * s + 4.0 * c, 0.0], psi=1.0)
    assert second.u == pytest.approx(first.u, abs=1e-10)
    assert euler_from_quat(second.x[6:10])[:2] == pytest.approx(
        euler_from_quat(first.x[6:10])[:2], abs=1e-10
    )


def test_beyond_the_fold_of_the_tails_vortex_ring_there_is_a_trim(params):
    """Wind against the tail's wash, 0 to 12 m/s: in its ring one thrust has three settings."""
    ring = replace(params, terms=ModelOptions(vortex_ring=True, tail_authority=True))
    points = [trim(ring, [0.0, -0.5 * n, 0.0]) for n in range(25)]
    assert max(point.residual for point in points) <= 1e-9
    settings = np.array([point.x[PLANT.d_int] for point in points])
    steps = -np.diff(settings)
    # one leap over the fold, and the same way along the curve before and after
    assert steps.max() > 5.0 * np.median(steps)
    assert settings.argmin() == 24


def test_it_leans_into_the_wind(params):
    """3 m/s from the side and from ahead; 5 deg of roll by the side area; 0.7 deg."""
    from_right = trim(params, [0.0, -3.0, 0.0])
    from_front = trim(params, [-3.0, 0.0, 0.0])
    calm = trim(params)
    roll = [np.degrees(euler_from_quat(t.x[6:10])[0]) for t in (from_right, calm)]
    # 3 m/s from the side: about 5 deg, of which the fuselage's side area has most
    assert roll[0] - roll[1] == pytest.approx(5.0, abs=0.7)
    assert euler_from_quat(from_front.x[6:10])[1] < euler_from_quat(calm.x[6:10])[1]


def test_scipy_finds_the_same_equilibrium(params):
    """Hover in wind; scipy.optimize.root on the derivative; 1e-7."""
    from heli_dynamics_sim.airframe import make_state

    wind = [-4.0, 3.0, 0.5]

    def equations(z):
        x = make_state((0.0, 0.0, -100.0), z[0], z[1])
        x[13], x[14], x[15] = z[2:5]
        u = np.array([z[5], z[6], 0.0, z[7]])
        x[16:20] = u
        return state_derivative(x, u, wind, params)[[3, 4, 5, 10, 11, 12, 13, 14]]

    start = np.array([0.04, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, -0.17])
    other = root(equations, start, tol=1e-12)
    assert np.abs(other.fun).max() < 1e-8
    mine = trim(params, wind)
    assert mine.u == pytest.approx([other.x[5], other.x[6], 0.0, other.x[7]], abs=1e-7)


def number_of(name, error):
    """The number that a refusal gives for a residual or an actuator that it names."""
    return float(re.search(rf" {re.escape(name)} [^\d-]*(-?[\d.]+)", str(error))[1])


def test_too_heavy_names_the_collective(params):
    """A weight that the rotor cannot lift; the refusal names actuator and travel."""
    with pytest.raises(TrimError) as caught:
        trim(replace(params, mass_kg=60.0))
    assert number_of("d_col", caught.value) < -params.servo_travel
    assert str(caught.value).endswith(f"+-{params.servo_travel:g}")


def test_storm_names_the_collective(params):
    """60 m/s; the refusal names the actuator and where it would have to be."""
    with pytest.raises(TrimError) as caught:
        trim(params, [0.0, 60.0, 0.0])
    assert number_of("d_col", caught.value) < -params.servo_travel


def test_no_trim_names_the_residual_and_how_far(params):
    """A disc on the c.g. without spring cannot hold the tail's roll moment; T_tr H_tr / J_xx; 3 %.

    Nothing else rolls: what the sound hub carries in trim remains of p_dot, nearly.
    """
    limp = replace(params, hub_stiffness_nmprad=0.0, hub_height_m=1e-6)
    with pytest.raises(TrimError) as caught:
        trim(limp)
    stays = number_of("p_dot (rad/s2)", caught.value)
    assert str(caught.value).endswith(f" {_RESIDUAL_LIMIT:g}")
    hover = trim(params)
    k, x = params.params, hover.x
    thrust = rotor_flow(x, (0.0, 0.0, 0.0), k)[0]
    roll = (k.main.hub_stiffness + thrust * k.main.hub_height) * np.sin(x[14])
    assert stays == pytest.approx(-roll / k.body.j_xx, rel=0.03)


@pytest.mark.parametrize("wind", [[np.nan, 0.0, 0.0], [0.0, 0.0], [np.inf, 0.0, 0.0]])
def test_unusable_wind_is_refused(params, wind):
    """NaN, inf, a missing component; ValueError."""
    with pytest.raises(ValueError, match="expected"):
        trim(params, wind)
