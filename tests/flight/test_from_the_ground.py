# SPDX-License-Identifier: Apache-2.0
"""From the ground to the ground in the one-process loop: wind from the side, slopes, receivers."""

import numpy as np
import pytest

from heli_flight.loop.closed_loop import simulate
from heli_flight.loop.scoring import score
from heli_flight.loop.settings import resolve
from heli_math.rotations import euler_angles

MODES = ["standing", "takeoff", "hover", "trajectory", "hover", "land", "standing"]


def flown(gps="standalone", seed=1, wind_mps=5.0, towards_deg=225.0, slope=(0.0, 0.0)):
    settings = resolve(
        "takeoff_land",
        gps,
        seed,
        overrides={
            "plant": {
                "wind.profile_speed_mps": [wind_mps] * 3,
                "wind.towards_deg": towards_deg,
                "ground.slope": [float(rise) for rise in slope],
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
    """8 m/s blowing down a slope of 5 deg: it leans too far before it lifts, and is set down."""
    settings, flight = flown("rtk", 4, 8.0, towards_deg=270.0, slope=(0.0, np.tan(np.radians(5.0))))
    assert flight.status == 0, flight.sentence
    modes = flight.record.mode
    changes = np.flatnonzero(np.r_[True, modes[1:] != modes[:-1]])
    assert modes[changes].tolist() == ["standing", "takeoff", "land", "standing"]
    found = {f.metric.key: f for f in score(flight.record, settings.scenario).ground}
    assert found["takeoff_height"].value is None
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
    found = {f.metric.key: f.value for f in score(flight.record, settings.scenario).ground}
    assert found["touch_down_speed"] < 0.5 and found["touch_down_tilt"] < 15.0
    drifted = np.linalg.norm(flight.record.truth_pos_ned_m[-1, :2])
    assert 1.0 < drifted < 20.0, "it does not know where it is"


def test_in_the_honest_world_it_stays_upright_at_idle():
    """Seed 3 leaned over to 45 deg when the inflow took all damping from the disc at idle."""
    record = simulate(resolve("takeoff_land", "rtk", 3, world="honest")).record
    idle = record.mode == "standing"
    idle[: len(idle) // 2] = False
    assert idle.sum() > 1000
    assert np.degrees(np.abs(euler_angles(record.truth_q_nb)[idle, :2])).max() < 3.0
    assert np.abs(record.truth_rotor[idle, :2]).max() < 0.1
