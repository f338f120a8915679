# SPDX-License-Identifier: Apache-2.0
"""Without commands: the trim, rates and turns against it, no jump in and none out, and it flies."""

import numpy as np
import pytest

from heli_core.rows import ACTUATOR, MEAS, PLANT
from heli_dynamics_sim import plant
from heli_dynamics_sim.node import PlantNode
from heli_dynamics_sim.noise import NoiseStreams
from heli_dynamics_sim.servo import Fallback, FallbackNumbers

VALUES = PlantNode.SPEC.resolve()
NUMBERS = FallbackNumbers.from_parameters(VALUES)
TRIM = np.array([0.01, -0.02, 0.0, -0.17])
STILL = np.zeros(3)
TIMEOUT = NUMBERS.timeout_ticks
BLEND = NUMBERS.blend_ticks


def commanded(u, ticks, fallback=None, gyro=STILL):
    fallback = fallback or Fallback(NUMBERS, TRIM)
    for _ in range(ticks):
        fallback.hear(u)
        out = fallback.step(gyro).copy()
        np.testing.assert_array_equal(out, u)
    return fallback


def alone(fallback, ticks, gyro=STILL):
    return np.array([fallback.step(gyro).copy() for _ in range(ticks)])


def test_commands_pass_as_they_come():
    commanded(np.array([0.1, 0.2, -0.3, 0.4]), 50)


def test_the_last_one_is_held_for_the_timeout_then_the_trim_is_flown():
    fallback = commanded(TRIM, 1000)
    last = TRIM + [0.2, 0.0, 0.0, 0.1]
    commanded(last, 1, fallback)
    held = TIMEOUT - 1
    rows = alone(fallback, held + BLEND + 50)
    np.testing.assert_array_equal(rows[:held], np.tile(last, (held, 1)))
    assert TIMEOUT == 10 and fallback.acting and fallback.times == 1
    np.testing.assert_allclose(rows[-1], TRIM, atol=0.02)
    assert np.abs(np.diff(rows, axis=0)).max() < 0.2 / BLEND + 1e-9, "no jump"
    assert fallback.facts()["without_commands"].startswith("1 times, 0.70 s")


def test_a_command_that_comes_takes_over_without_a_jump():
    fallback = commanded(TRIM, 500)
    alone(fallback, TIMEOUT + BLEND + 5)
    wanted, rows = TRIM + [0.1, -0.1, 0.05, 0.2], []
    for _ in range(BLEND + 1):
        fallback.hear(wanted)
        rows.append(fallback.step(STILL).copy())
    assert not fallback.acting
    np.testing.assert_array_equal(rows[-1], wanted)
    steps = np.diff([TRIM, *rows], axis=0)
    assert np.abs(steps).max() < 0.2 / BLEND + 1e-9


def test_rates_and_turns_are_worked_against():
    fallback = commanded(TRIM, 500)
    alone(fallback, TIMEOUT + BLEND)
    rows = alone(fallback, 20, np.array([0.5, -0.5, 0.5]))
    off = rows - TRIM
    assert (off[:, 0] < 0).all() and (off[:, 1] > 0).all() and (off[:, 2] > 0).all()
    assert (np.diff(off[:, 0]) < 0).all(), "the further it turns the more"
    np.testing.assert_array_equal(off[:, ACTUATOR.col], 0.0)


def test_a_gyro_that_says_nothing_or_too_much_breaks_nothing():
    fallback = commanded(TRIM, 500)
    rows = alone(fallback, 100, np.full(3, np.nan))
    np.testing.assert_allclose(rows[-1], TRIM, atol=1e-9)
    assert np.abs(alone(fallback, 100, np.full(3, 1e6))).max() <= 0.98


def test_ticks_that_are_made_up_for_at_once_do_not_count():
    """The plant was held up itself: nobody could answer."""
    fallback = commanded(TRIM, 10)
    for _ in range(3):
        for made_up in range(10):
            fallback.step(STILL, made_up)
    assert not fallback.acting


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_aircraft_stays_in_the_air_with_it(seed):
    """The last command before it is off by a twentieth, which alone tilts it by 30 deg in 4 s."""
    off_m, tilts = {}, {}
    for flown in ("fallback", "last command"):
        config = plant.PlantConfig.from_parameters(VALUES | {"seed": seed})
        state, y = plant.initial_state(config, seed), np.zeros(MEAS.size)
        u = state.commands[-1].copy()
        fallback, begun = Fallback(NUMBERS, u), state.x[PLANT.pos].copy()
        u[:2] += 0.05
        fallback.hear(u)
        for tick, row in enumerate(NoiseStreams(seed).rows(400)):
            plant.measure(state, tick, row, config.params, y)
            if flown == "fallback":
                u[:] = fallback.step(y[MEAS.rate])
            plant.advance(state, u, config.params)
        off_m[flown] = np.linalg.norm(state.x[PLANT.pos] - begun)
        _, qx, qy, _ = state.x[PLANT.quat]
        tilts[flown] = np.degrees(np.arccos(1.0 - 2.0 * (qx * qx + qy * qy)))
    assert off_m["fallback"] < 2.0 and tilts["fallback"] < 9.0
    assert off_m["last command"] > 10.0 and tilts["last command"] > 25.0
