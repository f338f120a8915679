# SPDX-License-Identifier: Apache-2.0
"""Rows of the table of failsafes about servos: found in time, survived; and no false alarm."""

import numpy as np
import pytest

from heli_flight import loop as closed_loop
from heli_flight.settings import resolve
from heli_outer_pd.failsafes import Condition, of
from heli_outer_pd.state import MACHINE, SERVO_DEGRADED, SERVO_NOMINAL, SERVO_STUCK

BEGIN_S = 12.0
AT = int(BEGIN_S * 100)
NEVER = {"failsafe.unfollowed_deg": [180.0, 180.0]}
STAYS = {"climb.start_s": 200.0, "climb.end_s": 202.0}


def flown(fault, seed, seconds, gps="standalone", scenario="hover", world="honest", **outer):
    """The flight, and how the law flies at its end."""
    watched = {"failsafe.unfollowed_deg": [8.0, 5.5]}
    over = {"plant": {"faults": (fault,)}, "outer_loop": watched | outer}
    over |= {"scenario": STAYS} if scenario == "hover" else {}
    settings = resolve(scenario, gps, seed, seconds, world=world, overrides=over)
    loop = closed_loop.build(settings)
    flight = closed_loop.fly_loop(loop, settings)
    return flight, loop.outer_s.law.machine[MACHINE.servo]


def servo(what, kind, value=None):
    words = f"what: {what}, kind: {kind}, start_s: {BEGIN_S}"
    return f"{{{words}{'' if value is None else f', value: {value}'}}}"


SLOW = servo("delta_lat", "slow", 0.5)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_slow_servo_is_found_in_time_and_flown_softly(seed):
    """Without it each of these is lost."""
    _, soon = flown(SLOW, seed, BEGIN_S + of(Condition.SERVO_SLOW).within_s)
    assert soon == SERVO_DEGRADED
    flight, at_last = flown(SLOW, seed, 60.0)
    assert flight.status == 0 and at_last == SERVO_DEGRADED
    pos = flight.record.truth_pos_ned_m
    assert np.linalg.norm(pos[AT:] - pos[AT], axis=1).max() < 15.0
    assert flown(SLOW, seed, 60.0, **NEVER)[0].status != 0


@pytest.mark.parametrize("what", ["delta_lat", "delta_lon"])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_stuck_servo_is_told_from_a_slow_one_in_time(what, seed):
    """And flown with full gains again: a soft flight with it is lost sooner."""
    seconds = BEGIN_S + of(Condition.SERVO_STUCK).within_s
    _, soft = flown(servo(what, "stuck"), seed, min(seconds, 18.0))
    assert soft == SERVO_STUCK


@pytest.mark.parametrize("gps", ["rtk", "standalone"])
@pytest.mark.parametrize(
    ("scenario", "world"),
    [("hover", "paper"), ("hover", "hard"), ("mte_slalom", "honest"), ("waypoints", "honest"),
     ("mte_lateral_reposition", "hard"), ("figure_eight", "paper"), ("attitude_steps", "honest")],
)  # fmt: skip
def test_a_flight_without_a_fault_is_never_taken_for_one(scenario, world, gps):
    """Those of the packaged ones that swing most."""
    for seed in (1, 2):
        flight, soft = flown("none", seed, None, gps, scenario, world)
        assert flight.status == 0 and soft == SERVO_NOMINAL


def test_a_short_pause_of_a_servo_is_flown_out():
    """What is stuck for 0.5 s needs nothing."""
    flight, soft = flown("{what: delta_lat, kind: stuck, start_s: 12.0, duration_s: 0.5}", 3, 40.0,
                         "rtk")  # fmt: skip
    assert flight.status == 0 and soft == SERVO_NOMINAL


def test_it_lands_softly_when_it_is_asked_to():
    """On the ground it has its gains again."""
    asked = {"commands.at_s": (25.0,), "commands.what": ("land",)}
    for seed in (1, 2, 3):
        flight, soft = flown(SLOW, seed, 75.0, **asked)
        assert flight.status == 0 and flight.record.mode[-1] == "standing"
        assert soft == SERVO_NOMINAL
