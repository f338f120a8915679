# SPDX-License-Identifier: Apache-2.0
"""Authority of the tail rotor: stops of its pitch, stall, the gyro at its limit, side wind."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import brentq

from heli_core.rows import PLANT
from heli_dynamics_sim.aircraft import ModelOptions
from heli_dynamics_sim.airframe import gyro, make_state, tail_pitch
from heli_dynamics_sim.helicopter import derivative_kernel, same_air
from heli_dynamics_sim.main_rotor import tail_rotor
from heli_dynamics_sim.trim import TrimError, trim

TIP_MPS = 193.73 * 4.65 * 0.128
SLOPE = 1.29 * 193.73 * 4.65 * 0.128**2 * 2.82 * 2 * 0.029 / 4  # N per m/s
DISC = 2.0 * 1.29 * np.pi * 0.128**2


@pytest.fixture(scope="module")
def limited(helicopter):
    return replace(helicopter, terms=ModelOptions(tail_authority=True))


def pitch_of(aircraft, x):
    """Pitch of the tail blades in a trim (rad)."""
    return aircraft.pedal_gain * aircraft.gyro_integral * x[PLANT.d_int] + aircraft.pedal_offset_rad


def from_the_left(speed):
    """Wind (NED, m/s) that meets an aircraft heading north from its left, against the tail."""
    return np.array([0.0, speed, 0.0])


def test_thrust_ends_where_all_blades_stall(limited):
    """C_T / sigma = C_l / 6 (Leishman, ch. 2), C_l 0.85: by hand, 1e-12; below it as without."""
    k = limited.params
    most = 1.29 * 2 * 0.029 * 0.128 * TIP_MPS**2 * 0.85 / 6
    assert k.tail_stall == pytest.approx(most, rel=1e-12)
    rest = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    assert tail_rotor(*rest, 0.6, 1.035, 0.172, k.tail, k.tail_stall)[0] == k.tail_stall
    assert tail_rotor(*rest, -0.6, 1.035, 0.172, k.tail, k.tail_stall)[0] == -k.tail_stall
    free, flow = tail_rotor(*rest, 0.2, 1.035, 0.172, k.tail, np.inf)
    assert tail_rotor(*rest, 0.2, 1.035, 0.172, k.tail, k.tail_stall) == (free, flow)
    assert 0.0 < free < most


def test_pitch_stays_between_its_stops(limited, helicopter):
    for output, pitch in ((0.1, 0.243), (0.5, 0.45), (-0.5, -0.17)):
        assert tail_pitch(output, limited.params.gyro) == pytest.approx(pitch)
        assert tail_pitch(output, helicopter.params.gyro) == pytest.approx(0.143 + output)


@pytest.mark.parametrize(("d_int", "r", "rests"), [
    (0.2, -0.5, True), (0.2, 0.3, False), (-0.2, 0.8, True), (-0.2, -0.3, False), (0.0, 0.1, False),
])  # fmt: skip
def test_the_gyros_integrator_rests_while_the_blades_are_at_a_stop(limited, d_int, r, rests):
    """It goes on as soon as the error points back, and moves as eq. (8) has it inside."""
    rate, _ = gyro(0.0, r, d_int, limited.params.gyro)
    assert rate == (0.0 if rests else -r)


@pytest.mark.parametrize("against_mps", [0.0, 4.0, 8.0, 12.0])
def test_what_is_left_of_the_tail_in_side_wind(limited, against_mps):
    """Blades at their stop, air through the disc against the thrust: yaw acceleration from blade
    element and momentum theory, solved here by bisection; 1e-9."""
    x, out = make_state((0.0, 0.0, -1e4)), np.empty(PLANT.size)
    x[PLANT.d_int] = 1.0  # far beyond the stop
    bare = replace(limited, main_drag_coefficient=0.0, vfin_area_m2=0.0, drag_area_y_m2=0.0,
                   collective_offset_rad=1e-12, tail_lift_coefficient=2.9)  # fmt: skip
    derivative_kernel(x, np.zeros(4), same_air(from_the_left(against_mps)), bare.params, out)

    def mismatch(v):
        lift = SLOPE * (2 / 3 * TIP_MPS * 0.45 - against_mps - v)
        return DISC * v * (v + against_mps) - lift

    v = brentq(mismatch, 0.0, 60.0, xtol=1e-14)
    thrust = DISC * v * (v + against_mps)
    assert out[PLANT.r] == pytest.approx(thrust * 1.035 / 0.787, rel=1e-9)


def test_hover_is_possible_just_as_far_as_the_tail_reaches(helicopter, limited):
    """Stop at 0.22 rad: the wind from the left that needs so much pitch without the stop; trim
    beyond it is refused, before it is that without the term."""
    short = replace(limited, tail_pitch_max_rad=0.22)
    limit = brentq(
        lambda speed: pitch_of(helicopter, trim(helicopter, from_the_left(speed)).x) - 0.22,
        0.5, 9.0, xtol=1e-3,
    )  # fmt: skip
    free = trim(helicopter, from_the_left(limit - 0.1))
    assert trim(short, from_the_left(limit - 0.1)).x == pytest.approx(free.x, abs=1e-9)
    with pytest.raises(TrimError, match=r"r_dot|no trim"):
        trim(short, from_the_left(limit + 0.1))


def test_beyond_it_the_nose_goes_with_the_wind(helicopter, limited, fly):
    """Trimmed in 6 m/s from the left without stops, then flown with a stop short of it: the nose
    swings; with the stop out of reach it stays."""
    start = trim(helicopter, from_the_left(6.0))
    stop = pitch_of(helicopter, start.x) - 0.02
    x = start.x.copy()
    x[PLANT.down] = -1e4
    yaw = []
    for most in (stop, 0.45):
        kernel = replace(limited, tail_pitch_max_rad=most).params
        yaw.append(fly(x, start.u, kernel, 0.5, wind=from_the_left(6.0))[PLANT.r])
    assert yaw[0] < -0.2
    assert abs(yaw[1]) < 1e-6
