# SPDX-License-Identifier: Apache-2.0
"""Named places against the layouts spelled out by number, and as constants of a kernel."""

import numpy as np
import pytest

from heli_core import rows
from heli_core import rows as state_names
from heli_core.jit import njit_counted
from heli_core.rows import MEAS, NAV, PLANT, TRUTH
from heli_core.sensors import AIDS, BARO, MAG, NORMALS, PLACES, PLAIN, ROTOR_SPEED, SENSED, SENSORS


def _plain():
    """Numbers and flag of each plain sensor, one sensor after the other."""
    words = []
    for sensor in PLAIN:
        name = "omega" if sensor is ROTOR_SPEED else sensor.name
        each = [name] if sensor.numbers == 1 else [f"{name}_{i}" for i in range(sensor.numbers)]
        words += [*each, f"{name}?"]
    return " ".join(words)


# Spelled out a second time, in words of eq. (1) to (10) and of the topics: bags hold these rows.
SPELLED = {
    "IMU": "fx fy fz p q r",
    "MEAS": "fx fy fz p q r mx my mz baro n e d vn ve vd mag? baro? gps? tick "
    f"fx2 fy2 fz2 p2 q2 r2 {_plain()} wn we wd",
    "NAV": "n e d vn ve vd qw qx qy qz p q r a_s b_s d_int bp bq br bx by bz "
    "sn se sd svn sve svd srn sre srd",
    "TRUTH": "n e d vn ve vd qw qx qy qz p q r a_s b_s d_int wn we wd",
    "PLANT": "n e d u v w qw qx qy qz p q r a_s b_s d_int lat lon ped col lat' lon' ped' col' "
    "v_0 v_s v_c omega governor fuel blade_a blade_b engine engine_out "
    "stick_1n stick_1e stick_2n stick_2e stick_3n stick_3e stick_4n stick_4e",
    "AIR": "main_n main_e main_d tail_n tail_e tail_d fuselage_n fuselage_e fuselage_d p q r",
    "ROTOR": "a_s b_s d_int",
    "JOINTS": "a_s b_s d_int lat lon ped col",
    "ACTUATOR": "lat lon ped col",
    "REFERENCE": "n e d vn ve vd psi",
    "SHAPED": "n e d vn ve vd an ae ad psi",
    "SETPOINT": "phi theta psi col",
    "NINE": "phi theta p q a_s b_s r d_int psi",
    "STICKS": "roll pitch yaw climb",
}
PARTS = {
    "pos": "n e d", "vel": "vn ve vd", "quat": "qw qx qy qz", "rate": "p q r", "force": "fx fy fz",
    "rotor": "a_s b_s d_int", "wind": "wn we wd", "mag": "mx my mz", "gps_pos": "n e d",
    "gps_vel": "vn ve vd", "gyro_bias": "bp bq br", "accel_bias": "bx by bz",
    "sigma_pos": "sn se sd", "sigma_vel": "svn sve svd", "sigma_att": "srn sre srd",
    "servo": "lat lon ped col", "servo_rate": "lat' lon' ped' col'", "acc": "an ae ad",
    "flapping": "a_s b_s", "imu": "fx fy fz p q r",
    "force2": "fx2 fy2 fz2", "rate2": "p2 q2 r2", "imu2": "fx2 fy2 fz2 p2 q2 r2",
    "down_vel": "vd", "down": "d", "north": "n", "east": "e", "mag_valid": "mag?",
    "baro_valid": "baro?", "rotor_valid": "omega?", "gps_valid": "gps?", "gps_tick": "tick",
    "servo_lat": "lat",
    "servo_lon": "lon", "servo_ped": "ped", "servo_col": "col",
    "motion": "n e d vn ve vd qw qx qy qz p q r a_s b_s d_int",
    "rigid": "n e d u v w qw qx qy qz p q r",
    "blades": "blade_a blade_b",
    "inflow": "v_0 v_s v_c", "inflow_mean": "v_0", "inflow_right": "v_s", "inflow_rear": "v_c",
}  # fmt: skip
OF_ONE_ROW = {
    ("AIR", "main"): "main_n main_e main_d",
    ("AIR", "tail"): "tail_n tail_e tail_d",
    ("AIR", "fuselage"): "fuselage_n fuselage_e fuselage_d",
    ("AIR", "velocity"): "main_n main_e main_d tail_n tail_e tail_d "
    "fuselage_n fuselage_e fuselage_d",
    ("AIR", "rates"): "p q r",
    ("MEAS", "rotor"): "omega",
    ("PLANT", "vel"): "u v w",
    ("PLANT", "stick"): "stick_1n stick_1e stick_2n stick_2e stick_3n stick_3e stick_4n stick_4e",
    ("ACTUATOR", "attitude"): "lat lon ped",
    ("SETPOINT", "attitude"): "phi theta psi",
}
_LENGTHS = ("size", "sensed")
CASES = [(name, field) for name in SPELLED for field in getattr(rows, name)._fields]


@pytest.mark.parametrize(("name", "field"), [c for c in CASES if c[1] not in _LENGTHS])
def test_each_place_is_where_the_layout_has_it(name, field):
    named = np.array(SPELLED[name].split())[getattr(getattr(rows, name), field)]
    wanted = OF_ONE_ROW.get((name, field)) or PARTS.get(field, field)
    assert " ".join(np.atleast_1d(named)) == wanted


@pytest.mark.parametrize("name", SPELLED)
def test_each_place_has_a_name_and_the_size_fits(name):
    row, length = getattr(rows, name), len(SPELLED[name].split())
    named = np.zeros(length, dtype=int)
    for field in set(row._fields) - set(_LENGTHS):
        named[getattr(row, field)] += 1
    for sensor in SENSORS if name == "MEAS" else ():
        at = PLACES[sensor.name]
        named[[*range(at.first, at.first + at.numbers), at.valid]] += 1
    assert named.all()
    assert getattr(row, "size", length) == length


def test_sensors_have_places_of_their_own():
    """No number of a measurement row, and no normal, belongs to two of them."""
    taken, drawn = [], []
    for row in SENSORS:
        at = PLACES[row.name]
        taken += [*range(at.first, at.first + at.numbers), at.valid]
        drawn += [*range(at.white, at.white + at.numbers), at.lost]
        drawn += range(at.fault, at.fault + at.numbers)
    for places, length in ((taken, SENSED), (drawn, NORMALS)):
        assert len(places) == len(set(places)) and max(places) == length - 1
    mag, baro = PLACES[MAG.name], PLACES[BARO.name]
    assert (slice(mag.first, mag.first + mag.numbers), mag.valid) == (MEAS.mag, MEAS.mag_valid)
    assert (baro.first, baro.valid) == (MEAS.baro, MEAS.baro_valid)
    assert AIDS[:2] == (MAG, BARO)


def test_all_rows_are_spelled_out():
    defined = {
        name for name, row in vars(rows).items() if hasattr(row, "_asdict") and name.isupper()
    }
    assert defined == set(SPELLED)


def test_rows_that_share_their_first_places_agree():
    assert MEAS.sensed == MEAS.wind.start
    assert NAV.motion == TRUTH.motion
    assert PLANT.rigid.stop == PLANT.a_s


@njit_counted
def _kernel(nav, out):
    attitude, sigma = nav[NAV.quat], out[NAV.sigma_pos]
    for i in range(3):
        sigma[i] = attitude[i]
    out[NAV.r] = nav[NAV.down_vel] + NAV.size
    out[NAV.rotor] = nav[NAV.rate]
    for i in range(NAV.gyro_bias.start, NAV.gyro_bias.stop):
        out[i] = 1.0


def test_a_kernel_finds_the_same_places_as_numpy():
    nav = np.arange(100.0, 131.0)
    compiled, plain = np.zeros(31), np.zeros(31)
    _kernel(nav, compiled)
    _kernel.py_func(nav, plain)
    assert np.array_equal(compiled, plain)
    wanted = np.zeros(31)
    wanted[12], wanted[13:16], wanted[16:19] = 105.0 + 31, [110.0, 111.0, 112.0], 1.0
    wanted[22:25] = [106.0, 107.0, 108.0]
    assert np.array_equal(compiled, wanted)


def test_names_of_the_linear_model_have_their_order():
    assert list(state_names.STATE_NAMES) == [
        "phi",
        "theta",
        "p",
        "q",
        "a_s",
        "b_s",
        "r",
        "d_int",
        "psi",
    ]
    named = np.array(state_names.STATE_NAMES)
    assert named[list(state_names.MEASURED)].tolist() == ["phi", "theta", "p", "q", "r", "psi"]
    assert named[list(state_names.UNMEASURED)].tolist() == SPELLED["ROTOR"].split()
    assert named[list(state_names.ATTITUDE)].tolist() == ["phi", "theta", "psi"]
    assert state_names.INPUT_NAMES == ("d_lat", "d_lon", "d_ped")
    assert state_names.WIND_NAMES == ("u", "v", "w")
