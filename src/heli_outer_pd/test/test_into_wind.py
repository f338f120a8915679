# SPDX-License-Identifier: Apache-2.0
"""Nose into the wind, beside an aircraft whose side drags more than its front, trimmed wrongly."""

import math

import numpy as np
import pytest

from heli_core.ticks import NS_PER_S
from heli_outer_pd.phases import IntoWind

STEP_NS = NS_PER_S // 25
_TURN_NS = 3 * NS_PER_S


def nose_off_the_wind(wind_mps, from_rad, bias_mps2, seconds=180, gusts=None):
    """Angle (rad) between nose and wind after a while, and how often it turned.

    The side force is linear below the downwash, quadratic above: that of the default aircraft.
    """
    into, psi, turns = IntoWind(), 0.0, 0
    for now_ns in range(0, seconds * NS_PER_S, STEP_NS):
        across = -wind_mps * math.sin(from_rad - psi)
        push = 0.0595 * across * max(abs(across), 4.2) + bias_mps2
        if gusts is not None:
            push += 0.2 * wind_mps / 5.0 * gusts.standard_normal()
        angle = into.turn(now_ns, push)
        if angle != 0.0:
            psi, turns = psi + angle, turns + 1
            into.rest(now_ns + _TURN_NS)
    return math.remainder(from_rad - psi, 2.0 * math.pi), turns


@pytest.mark.parametrize("wind_mps", [3.0, 5.0, 8.0, 12.0])
@pytest.mark.parametrize("from_deg", [-170, -120, -60, -15, 30, 90, 150])
def test_it_points_into_the_wind_but_for_what_trim_takes(wind_mps, from_deg):
    bias = 0.1
    off, turns = nose_off_the_wind(wind_mps, math.radians(from_deg), bias)
    dead = 0.15 + 0.45 / 30.0 + bias
    assert abs(off) <= math.asin(dead / (0.0595 * 4.2 * wind_mps)) + 1e-6
    assert turns < 12


@pytest.mark.parametrize("bias", [-0.12, 0.0, 0.12])
def test_in_a_calm_it_stays(bias):
    assert nose_off_the_wind(0.0, 1.0, bias) == (pytest.approx(1.0), 0)


def test_gusts_do_not_have_it_hunt():
    offsets = [
        nose_off_the_wind(5.0, 1.5, 0.05, 300, np.random.default_rng(seed)) for seed in range(5)
    ]
    assert max(abs(off) for off, _ in offsets) < math.radians(15.0)
    assert max(turns for _, turns in offsets) < 8


def test_a_wind_that_shifts_is_followed():
    into, psi, turned_at = IntoWind(), 0.0, []
    for now_ns in range(0, 400 * NS_PER_S, STEP_NS):
        from_rad = 0.0 if now_ns < 200 * NS_PER_S else 1.0
        angle = into.turn(now_ns, -1.25 * math.sin(from_rad - psi))
        if angle != 0.0:
            psi += angle
            turned_at.append(now_ns / NS_PER_S)
            into.rest(now_ns + _TURN_NS)
    assert psi == pytest.approx(1.0, abs=0.15)
    assert 200.0 < turned_at[0] < 235.0
