# SPDX-License-Identifier: Apache-2.0
"""A rotor that loses its speed: found in time, landed; and a sensor that fails, which is none.

Hover at 10 m; the engine stops, or the sensor fails, at 12 s.
"""

import numpy as np
import pytest

from heli_core.rows import ACTUATOR
from heli_flight import loop as closed_loop
from heli_flight.settings import resolve
from heli_outer_pd.failsafes import Action, Condition, of

BEGIN_S = 12.0
AT = int(BEGIN_S * 100)
STAYS = {"climb.start_s": 200.0, "climb.end_s": 202.0}
OFF = {"failsafe.rotor_slow_share": 0.0}
STOPS = f"{{what: engine, kind: stop, start_s: {BEGIN_S}}}"
SKIDS_M = 0.3
"""Height of the c.g. at which a level aircraft is about to touch, m: gear of 0.25 m."""


def flown(fault, seed, gps="rtk", world="honest", seconds=24.0, **outer):
    over = {"plant": {"faults": (fault,)}, "scenario": STAYS, "outer_loop": outer}
    settings = resolve("hover", gps, seed, seconds, world=world, overrides=over)
    flight = closed_loop.fly_loop(closed_loop.build(settings), settings)
    return flight, flight.record


def touched(record):
    """Tick of the touch-down, speed down, m/s, and tilt, deg, there."""
    low = np.flatnonzero(-record.truth_pos_ned_m[AT:, 2] < SKIDS_M)
    at = AT + low[0] if len(low) else len(record.truth_pos_ned_m) - 1
    _, x, y, _ = record.truth_q_nb[at]
    tilt = np.degrees(np.arccos(1.0 - 2.0 * (x * x + y * y)))
    return at, record.truth_vel_ned_mps[at, 2], tilt


def sensor(kind, value=None, duration_s=None):
    words = f"what: rotor_speed, kind: {kind}, start_s: {BEGIN_S}"
    words += "" if value is None else f", value: {value}"
    return f"{{{words}{'' if duration_s is None else f', duration_s: {duration_s}'}}}"


@pytest.mark.parametrize("world", ["honest", "hard"])
@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5, 6])
def test_an_engine_that_stops_is_found_in_time_and_landed_without(seed, world):
    _, record = flown(STOPS, seed, world=world)
    row = of(Condition.ROTOR_SLOW)
    tick = np.flatnonzero(record.failsafe == row.action.name)[0]
    assert 0 < 0.01 * (tick - AT) < row.within_s
    at, speed, tilt = touched(record)
    assert speed < 1.5, "what the gear bears"
    assert tilt < 20.0
    assert (record.mode[tick + 1 : at] == "land").all()
    assert (record.mode == "standing").any(), "the collective has come down"


@pytest.mark.parametrize("world", ["honest", "hard"])
@pytest.mark.parametrize("seed", [1, 4])
def test_what_has_landed_so_stands_while_its_rotor_runs_down(seed, world):
    flight, record = flown(STOPS, seed, world=world, seconds=45.0)
    at, _, _ = touched(record)
    _, x, y, _ = record.truth_q_nb[at:].T
    assert flight.status == 0
    assert np.degrees(np.arccos(1.0 - 2.0 * (x * x + y * y))).max() < 20.0


@pytest.mark.parametrize("gps", ["rtk", "standalone"])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_without_it_the_outer_loop_stalls_the_rotor(seed, gps):
    flight, record = flown(STOPS, seed, gps, **OFF)
    assert flight.status != 0 and touched(record)[1] > 4.0
    _, landed = flown(STOPS, seed, gps)
    assert touched(landed)[1] < 0.7 * touched(record)[1]


@pytest.mark.parametrize(
    ("kind", "value"),
    [("loss", None), ("loss", 0.5), ("freeze", None), ("zero", None), ("nan", None),
     ("bias", [-20.0]), ("bias", [-100.0]), ("jump", [15.0]), ("noise", 30.0), ("delay", 0.2),
     ("reorder", None), ("duplicate", None)],
)  # fmt: skip
def test_a_sensor_that_fails_is_no_rotor_that_fails(kind, value):
    """To the last bit the flight without a fault."""
    _, sound = flown("none", 3, seconds=20.0)
    _, hurt = flown(sensor(kind, value), 3, seconds=20.0)
    assert sound.failsafe is None and hurt.failsafe is None
    np.testing.assert_array_equal(hurt.truth_pos_ned_m, sound.truth_pos_ned_m)


@pytest.mark.parametrize("kind", ["freeze", "zero", "nan"])
def test_a_sensor_that_fails_soon_after_the_engine_changes_little(kind):
    """The autorotation has begun; it goes on by the last speed that was believed."""
    late = sensor(kind).replace(f"{BEGIN_S}", f"{BEGIN_S + 1.0}")
    over = {"plant": {"faults": (STOPS, late)}, "scenario": STAYS}
    settings = resolve("hover", "rtk", 1, 24.0, world="honest", overrides=over)
    record = closed_loop.simulate(settings).record
    assert touched(record)[1] < 3.5


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_speed_that_comes_back_is_flown_on_with(seed):
    """What the sensor says falls as a rotor does, and is right again; no jump, and it hovers."""
    flight, record = flown(sensor("drift", [-60.0], 0.4), seed, seconds=30.0)
    ticks = np.flatnonzero(record.failsafe == Action.AUTOROTATE.name)
    assert len(ticks) and flight.status == 0
    back = ticks[-1] + 1
    assert back - ticks[0] < 100
    step = np.abs(np.diff(record.setpoint[back - 8 : back + 100, :2], axis=0))
    assert np.degrees(step.max()) < 4.0
    # At once only to the least thrust that the law flies; 0.8 is what lies between.
    assert np.abs(np.diff(record.u[back - 8 : back + 100, ACTUATOR.col])).max() < 0.3
    assert (record.mode[back + 8 :] == "hover").all()
    height = -record.truth_pos_ned_m[:, 2]
    assert height[back:].min() > 5.0
    assert np.abs(np.diff(height[-300:])).max() < 0.01


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("scenario", ["hover", "takeoff_land", "mte_vertical"])
def test_a_sound_flight_raises_no_alarm(scenario, seed):
    settings = resolve(scenario, "rtk", seed, world="hard")
    record = closed_loop.simulate(settings).record
    assert record.failsafe is None
