# SPDX-License-Identifier: Apache-2.0
"""From the ground to the ground in the one-process loop: wind from the side, slopes, receivers."""

import numpy as np
import pytest

from heli_core.rotations import euler_angles
from heli_flight.loop import build, fly_loop, simulate
from heli_flight.scoring import score
from heli_flight.settings import resolve
from heli_outer_pd.position_health import ground_begun_m

MODES = ["standing", "takeoff", "hover", "trajectory", "hover", "land", "standing"]
PERIOD = 2


def flown(gps="standalone", seed=1, wind_mps=5.0, towards_deg=225.0, slope=(0.0, 0.0), drag=1.0):
    settings = resolve(
        "takeoff_land",
        gps,
        seed,
        overrides={
            "plant": {
                "wind.profile_speed_mps": [wind_mps] * 3,
                "wind.towards_deg": towards_deg,
                "ground.slope": [float(rise) for rise in slope],
                "scale.drag": drag,
            }
        },
    )
    return settings, simulate(settings)


CASES = [
    ("standalone", 1, 225.0, (0.0, 0.0)),
    ("rtk", 2, 270.0, (0.0, 0.0)),
    ("rtk", 3, 90.0, (0.0, np.tan(np.radians(5.0)))),
    ("rtk", 5, 180.0, (np.tan(np.radians(5.0)), 0.0)),
    ("rtk", 6, 270.0, (0.0, np.tan(np.radians(5.0)))),
]


@pytest.mark.parametrize(("gps", "seed", "towards_deg", "slope"), CASES)
def test_take_off_and_landing_are_inside_their_goals(gps, seed, towards_deg, slope):
    settings, flight = flown(gps, seed, towards_deg=towards_deg, slope=slope)
    assert flight.status == 0, flight.sentence
    modes = flight.record.mode
    changes = np.flatnonzero(np.r_[True, modes[1:] != modes[:-1]])
    assert modes[changes].tolist() == MODES
    figures = score(flight.record, settings.scenario).ground
    assert [f"{f.metric.key} {f.cell}" for f in figures if not f.inside] == []
    # It has turned into the wind before it touched down.
    nose = np.degrees(euler_angles(flight.record.truth_q_nb)[modes == "land", 2][-1])
    assert abs((nose - towards_deg) % 360.0 - 180.0) < 30.0


def test_what_is_too_much_is_broken_off_and_not_lost():
    """8 m/s down a slope of 5 deg, four times the drag: it leans too far before it lifts."""
    slope = (0.0, np.tan(np.radians(5.0)))
    settings, flight = flown("rtk", 4, 8.0, towards_deg=270.0, slope=slope, drag=4.0)
    assert flight.status == 0, flight.sentence
    modes = flight.record.mode
    changes = np.flatnonzero(np.r_[True, modes[1:] != modes[:-1]])
    assert modes[changes].tolist() == ["standing", "takeoff", "land", "standing"]
    figures = {f.metric.key: f for f in score(flight.record, settings.scenario).ground}
    assert figures["takeoff_height"].value is None
    tilt = np.degrees(np.abs(euler_angles(flight.record.truth_q_nb)[-100:, :2]))
    assert tilt.max() < 10.0


def test_it_lands_without_fixes():
    """The last one 5 s before: by dead reckoning sideways, by the barometer down."""
    orders = {"commands.at_s": [2.0, 30.0], "commands.what": ["takeoff", "land"],
              "commands.goto_ned_m": []}  # fmt: skip
    lost = {"sensors.gps.outage.from_s": 25.0}
    settings = resolve("takeoff_land", "rtk", 1, overrides={"plant": lost, "outer_loop": orders})
    flight = simulate(settings)
    assert flight.status == 0, flight.sentence
    assert flight.record.mode[-1] == "standing"
    figures = {f.metric.key: f.value for f in score(flight.record, settings.scenario).ground}
    assert figures["touch_down_speed"] < 0.5 and figures["touch_down_tilt"] < 15.0
    drifted = np.linalg.norm(flight.record.truth_pos_ned_m[-1, :2])
    assert 1.0 < drifted < 20.0, "it does not know where it is"


def lost_and_landed(seed, gps="standalone", world="paper", until_s=-1.0):
    """Up to 10 m at 1 m/s, the last fix at 8 s, so that it is soon lost; a landing at 26 s."""
    orders = {"commands.at_s": [2.0, 26.0], "commands.what": ["takeoff", "land"],
              "commands.goto_ned_m": [], "failsafe.land_astray_m": 1e4}  # fmt: skip
    lost = {"sensors.gps.outage.from_s": 8.0, "sensors.gps.outage.until_s": until_s}
    overrides = {"plant": lost, "outer_loop": orders}
    settings = resolve("takeoff_land", gps, seed, 62.0, world=world, overrides=overrides)
    flight = simulate(settings)
    assert flight.status == 0, flight.sentence
    assert flight.record.mode[-1] == "standing"
    figures = score(flight.record, settings.scenario).ground
    return flight.record, {f.metric.key: f.value for f in figures}


def commanded(record):
    """Largest step of the set-point, deg, and of the collective, at each step of the law."""
    attitude = np.degrees(np.unwrap(record.setpoint[::PERIOD], axis=0))
    return np.abs(np.diff(attitude, axis=0)).max(axis=1), np.abs(np.diff(record.u[::PERIOD, 3]))


@pytest.mark.parametrize(
    ("seed", "world"),
    [(1, "paper"), (1, "honest")]
    + [pytest.param(seed, "paper", marks=pytest.mark.slow) for seed in range(2, 6)],
)
def test_it_lands_level_where_it_is_lost(seed, world):
    record, figures = lost_and_landed(seed, world=world)
    assert figures["touch_down_speed"] < 0.5 and figures["touch_down_tilt"] < 15.0
    sigma = record.nav_sigma_vel_mps[::PERIOD, :2].max(axis=1)
    (lost,) = np.flatnonzero((sigma[1:] > 0.5) & (sigma[:-1] <= 0.5))
    assert 12.0 < 0.01 * PERIOD * lost < 24.0
    attitude, collective = commanded(record)
    assert attitude[lost] < 0.5 and collective[lost] < 0.01
    # From there on to the ground, a second later, roll and pitch stay as they are.
    down = np.flatnonzero(record.mode == "land")[-1] // PERIOD - 200
    assert (
        np.degrees(np.ptp(record.setpoint[PERIOD * (lost + 120) : PERIOD * down, :2], axis=0)).max()
        < 0.2
    )


def test_a_fix_that_comes_back_in_the_descent_is_taken_over_without_a_step():
    """It brakes, and lands with less sideways speed than the level descent would."""
    record, figures = lost_and_landed(2, until_s=31.0)
    sigma = record.nav_sigma_vel_mps[::PERIOD, :2].max(axis=1)
    (again,) = np.flatnonzero((sigma[1:] < 0.1) & (sigma[:-1] > 0.5))
    attitude, collective = commanded(record)
    assert attitude[again : again + 2].max() < 0.5 and collective[again : again + 2].max() < 0.01
    assert record.mode[PERIOD * again] == "land"
    sideways = np.linalg.norm(record.truth_vel_ned_mps[:, :2], axis=1)
    assert sideways[PERIOD * again] > 0.4 and figures["landing_skid"] < 0.3


def test_a_plain_hover_that_is_lost_flies_level_and_is_held_where_it_is_found_again():
    """Without a landing, too: the scenario has no commands."""
    lost = {"sensors.gps.outage.from_s": 6.0, "sensors.gps.outage.until_s": 36.0}
    patient = {"failsafe.land_astray_m": 1e4}
    overrides = {"plant": lost, "outer_loop": patient}
    flight = simulate(resolve("hover", "rtk", 3, world="paper", overrides=overrides))
    assert flight.status == 0, flight.sentence
    pos = flight.record.truth_pos_ned_m
    drifted = np.linalg.norm((pos[3600] - pos[600])[:2])
    assert drifted > 1.0
    assert np.linalg.norm((pos[4500:] - pos[3600])[:, :2], axis=1).max() < 5.0
    assert np.abs(pos[4500:, 2] - pos[3600, 2]).max() < 1.0


def test_in_the_honest_world_it_stays_upright_at_idle():
    """Seed 3 leaned over to 45 deg when the inflow took all damping from the disc at idle."""
    record = simulate(resolve("takeoff_land", "rtk", 3, world="honest")).record
    idle = record.mode == "standing"
    idle[: len(idle) // 2] = False
    assert idle.sum() > 1000
    assert np.degrees(np.abs(euler_angles(record.truth_q_nb)[idle, :2])).max() < 3.0
    assert np.abs(record.truth_rotor[idle, :2]).max() < 0.1


def test_the_ground_is_where_it_has_stood_though_the_world_moves_references():
    """Its scenario's reference, which is in the air, says nothing of the ground."""
    settings = resolve("takeoff_land", seed=1, duration_s=3.0, world="honest")
    assert settings.nodes["outer_loop"]["reference_anchor"] == "engagement"
    loop = build(settings)
    record = fly_loop(loop, settings).record
    stands = record.nav_pos_ned_m[np.flatnonzero(np.isfinite(record.nav_pos_ned_m[:, 2]))[0], 2]
    assert ground_begun_m(loop.outer_s.law) == pytest.approx(stands, abs=1.0)
    given = settings.scenario.reference.points[0, :3]
    np.testing.assert_array_equal(record.reference[0, :3], given)
