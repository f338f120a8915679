# SPDX-License-Identifier: Apache-2.0
"""The paper's own sequence: a pilot takes off by hand, laws take over, the pilot lands by hand."""

from functools import cache

import numpy as np
import pytest

from heli_core.rotations import euler_angles, quat_from_euler
from heli_core.rows import ACTUATOR, NAV, REFERENCE, STICKS
from heli_dynamics_sim import PlantConfig
from heli_flight.loop import simulate
from heli_flight.scenario import touching
from heli_flight.scoring import score
from heli_flight.settings import resolve
from heli_outer_pd import Phase, outer_params
from heli_outer_pd.manual import StickNumbers
from heli_outer_pd.script import HumanPilotModel

MODES = ["standing", "manual", "attitude", "trajectory", "hover", "trajectory", "hover", "manual",
         "standing"]  # fmt: skip


@cache
def flown(gps="rtk", seed=1, world="paper"):
    settings = resolve("sequence", gps, seed, world=world)
    flight = simulate(settings)
    assert flight.status == 0, flight.sentence
    return settings, flight.record


def in_order(modes):
    return modes[np.flatnonzero(np.r_[True, modes[1:] != modes[:-1]])].tolist()


@pytest.mark.parametrize(("gps", "seed"), [("rtk", 1), ("standalone", 2)])
def test_from_hand_to_hand(gps, seed):
    settings, record = flown(gps, seed)
    assert in_order(record.mode) == MODES
    figures = score(record, settings.scenario).ground
    assert [f.metric.key for f in figures] == [
        "takeoff_skid", "touch_down_speed", "landing_skid", "touch_down_tilt",
    ]  # fmt: skip
    assert [f"{f.metric.key} {f.cell}" for f in figures if not f.inside] == []
    hover = record.mode == "hover"
    error = record.reference[hover, :3] - record.nav_pos_ned_m[hover]
    assert np.linalg.norm(error, axis=1).max() < 0.3
    assert np.linalg.norm(record.reference[3800, REFERENCE.pos] - [0.0, 0.0, -10.0]) < 0.01
    assert np.linalg.norm(record.reference[5800, REFERENCE.pos] - [0.0, 0.0, -20.0]) < 0.01


def test_by_hand_the_cyclic_is_the_pilots_and_nothing_jumps():
    settings, record = flown()
    hand = np.flatnonzero(record.mode == "manual")
    # Held over the period of the outer loop, but for what fades: no law moves it in between.
    fades = np.isin(hand, np.r_[200:800, 6000:6600])
    still = hand[~fades & (hand % 2 != 0)]
    assert still.size > 1500
    step = np.abs(record.u[still, : ACTUATOR.col] - record.u[still - 1, : ACTUATOR.col])
    assert step.max() < 2e-6
    air = hand[~touching(record, PlantConfig.from_parameters(settings.nodes["plant"]).params
                         .aircraft.ground)[hand]]  # fmt: skip
    assert np.degrees(np.abs(euler_angles(record.truth_q_nb[air])[:, :2])).max() < 12.0
    for change in np.flatnonzero(record.mode[1:] != record.mode[:-1]):
        if 2100 > change or change > 6100:
            continue
        # Up to the next step of the law: then the pilot has his hand on the collective.
        later = record.u[change + 1 : change + 4] - record.u[change : change + 3]
        assert np.abs(later[:, ACTUATOR.col]).max() < 0.01


def test_in_the_honest_world_it_is_not_lost():
    """The pilot skids further than the goal there: the figures say so."""
    _, record = flown("rtk", 3, "honest")
    assert in_order(record.mode) == MODES


def pilot_and_row(standing=False):
    values = resolve("sequence").nodes["outer_loop"]
    k = outer_params(values)
    nav = np.zeros(NAV.size)
    nav[NAV.pos] = 0.0, 0.0, -5.0
    nav[NAV.quat] = quat_from_euler(k.trim[0], k.trim[1], 0.0)
    return HumanPilotModel(k, StickNumbers.from_parameters(values), standing), nav, k


def test_a_pilot_sees_late_and_steers_against_what_he_sees():
    pilot, nav, k = pilot_and_row()
    for _ in range(20):
        sticks = pilot.fly(nav, 5.0, 0.0, Phase.MANUAL)
    np.testing.assert_allclose(sticks, 0.0, atol=1e-9)
    nav[NAV.quat] = quat_from_euler(k.trim[0] + 0.1, k.trim[1] - 0.1, 0.1)
    rows = [pilot.fly(nav, 5.0, 0.0, Phase.MANUAL) for _ in range(13)]
    assert np.abs(rows[:10]).max() < 1e-9, "0.2 s are ten looks"
    roll, pitch, yaw, _ = rows[10]
    assert roll < -0.1 and pitch > 0.1 and yaw < -0.1
    np.testing.assert_allclose(rows[10], rows[12], atol=1e-9)


def test_a_pilot_on_the_ground_has_the_collective_down_until_he_is_to_take_off():
    pilot, nav, _ = pilot_and_row(standing=True)
    nav[NAV.pos] = 0.0
    for _ in range(100):
        assert pilot.fly(nav, 0.0, 0.0, Phase.MANUAL)[STICKS.climb] == -1.0
    raised = [pilot.fly(nav, 5.0, 0.0, Phase.MANUAL)[STICKS.climb] for _ in range(96)]
    assert 0.0 < np.diff(raised).min() and np.diff(raised).max() < 0.03
    assert raised[-1] == pytest.approx(-0.04)
