# SPDX-License-Identifier: Apache-2.0
"""Pulses of ArduPilot's servos: the right axis, by the right amount, and the parameters for it."""

import math

import numpy as np
import pytest

from heli_core.rcl_yaml import ParameterError
from heli_core.rows import ACTUATOR
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_flight.ardupilot.servos import (
    SWASHPLATES,
    deflections,
    file_text,
    parameters,
    pulses,
    read_file,
    servo_numbers,
)
from support.sitl_client import h3_120

AIRCRAFT = ("helion.yaml", "logo600.yaml", "xcell60.yaml")
_HELION = HelicopterParameters.from_yaml("helion.yaml")
LAT, LON, PED, COL = ACTUATOR.lat, ACTUATOR.lon, ACTUATOR.ped, ACTUATOR.col


def deflected(pulse_us, k):
    u = np.zeros(4)
    deflections(np.array(pulse_us, float), k, u)
    return u


def of(swashplate, aircraft=_HELION):
    return servo_numbers(parameters(aircraft, swashplate), aircraft)


def test_ardupilots_signs():
    k = of("H3_120")
    middle = deflected(h3_120(0.0, 0.0, 0.5, 0.0)[:4], k)
    right, up, turned, high = (
        deflected(h3_120(*command)[:4], k) - middle
        for command in ((0.2, 0, 0.5, 0), (0, 0.2, 0.5, 0), (0, 0, 0.5, 0.2), (0, 0, 0.6, 0))
    )
    np.testing.assert_allclose(right, [0.2, 0.0, 0.0, 0.0], atol=0.003)
    np.testing.assert_allclose(up, [0.0, 0.2, 0.0, 0.0], atol=0.003)
    np.testing.assert_allclose(turned, [0.0, 0.0, -0.2, 0.0], atol=1e-12)
    assert high[COL] < 0.0
    np.testing.assert_allclose(high[:3], 0.0, atol=1e-12)


@pytest.mark.parametrize("side", [20.0, -20.0])
@pytest.mark.parametrize(
    ("swashplate", "per_unit"),
    [
        # roll, pitch and collective of a unit of each servo
        ("H3_120", [(1.283, 0.741, 1 / 3), (-1.283, 0.741, 1 / 3), (0.0, -1.481, 1 / 3)]),
        ("H3_140", [(1 / 0.9, 0.5 / 0.9, 0.25), (-1 / 0.9, 0.5 / 0.9, 0.25), (0.0, -1 / 0.9, 0.5)]),
        ("H1", [(1 / 0.45, 0.0, 0.0), (0.0, 1 / 0.45, 0.0), (0.0, 0.0, 1.0)]),
    ],
)
def test_20_us_of_a_servo_move_the_right_axes_by_the_right_amount(swashplate, per_unit, side):
    k = of(swashplate)
    middle = np.array([1500.0] * 4)
    blades_per_col = k.pitch_per_col / _HELION.collective_gain_rad
    for servo, (roll, pitch, col) in enumerate(per_unit):
        moved = middle.copy()
        moved[servo] += side
        change = deflected(moved, k) - deflected(middle, k)
        expected = np.array([roll, pitch, 0.0, col * blades_per_col]) * side / 1000.0
        np.testing.assert_allclose(change, expected, atol=1e-5)
    moved = middle.copy()
    moved[3] += side
    np.testing.assert_allclose(
        deflected(moved, k) - deflected(middle, k), [0.0, 0.0, -side / 500.0, 0.0], atol=1e-12
    )


@pytest.mark.parametrize("name", AIRCRAFT)
def test_the_collectives_range_is_that_of_the_blades_angle(name):
    aircraft = HelicopterParameters.from_yaml(name)
    values = parameters(aircraft)
    k = servo_numbers(values, aircraft)
    for end in ("MIN", "MAX"):
        servo = values[f"H_COL_{end}"]
        u = deflected([servo] * 3 + [1500.0], k)
        blades = aircraft.collective_offset_rad + aircraft.collective_gain_rad * u[COL]
        assert math.degrees(blades) == pytest.approx(values[f"H_COL_ANG_{end}"], abs=1e-9)


@pytest.mark.parametrize("swashplate", SWASHPLATES)
@pytest.mark.parametrize("name", AIRCRAFT)
def test_pulses_and_deflections_are_inverse(swashplate, name):
    k = of(swashplate, HelicopterParameters.from_yaml(name))
    u = np.array([0.1, -0.2, 0.3, -0.1])
    np.testing.assert_allclose(deflected(pulses(u, k), k), u, atol=1e-12)


def test_the_tails_ends_are_its_servos():
    narrow = servo_numbers({"SERVO4_MIN": 1100, "SERVO4_MAX": 1900}, _HELION)
    u = deflected([1500.0, 1500.0, 1500.0, 1900.0], narrow)
    assert u[PED] == -1.0
    assert deflected([1500.0, 1500.0, 1500.0, 1300.0], narrow)[PED] == 0.5


def test_the_file_is_read_back_as_it_was_written(tmp_path):
    values = parameters(_HELION)
    path = tmp_path / "helion.parm"
    path.write_text(file_text(values, "ArduPilot (heli) on helion"))
    assert read_file(path) == {
        name: pytest.approx(value, rel=1e-5) for name, value in values.items()
    }
    path.write_text("H_COL_MIN,1300\n# H_COL_MAX 1\n\nH_COL_MAX 1700  # as bought\n")
    assert read_file(path) == {"H_COL_MIN": 1300.0, "H_COL_MAX": 1700.0}


@pytest.mark.parametrize("line", ["H_COL_MIN", "H_COL_MIN high", "H_COL_MIN nan"])
def test_a_line_that_is_none_is_named_by_its_number(tmp_path, line):
    path = tmp_path / "a.parm"
    path.write_text(f"H_COL_MAX 1700\n{line}\n")
    with pytest.raises(ParameterError, match=r"a\.parm:2: expected a name and a number"):
        read_file(path)


@pytest.mark.parametrize(
    ("changed", "name"),
    [
        ({"H_SW_TYPE": 4}, "H_SW_TYPE"),
        ({"H_SW_COL_DIR": 1}, "H_SW_COL_DIR"),
        ({"SERVO2_REVERSED": 1}, "SERVO2_REVERSED"),
        ({"H_COL_MIN": 1750}, "H_COL_MIN"),
        ({"H_COL_ANG_MIN": 20}, "H_COL_ANG_MIN"),
        ({"SERVO4_TRIM": 1000}, "SERVO4_MIN"),
    ],
)
def test_what_cannot_be_flown_is_refused_by_its_name(changed, name):
    with pytest.raises(ParameterError, match=name):
        servo_numbers(changed, _HELION)


def test_helions_parameters_are_those_that_have_flown():
    values = parameters(_HELION)
    flown = {
        "FRAME_CLASS": 6, "H_SW_TYPE": 3, "H_RSC_MODE": 2, "H_RSC_SETPOINT": 66,
        "ATC_RAT_RLL_FF": 0.386, "ATC_RAT_PIT_FF": 0.386, "ATC_RAT_RLL_D": 0.004,
        "ATC_RAT_PIT_D": 0.008, "ATC_HOVR_ROL_TRM": 223,
    }  # fmt: skip
    assert {name: values[name] for name in flown} == flown
