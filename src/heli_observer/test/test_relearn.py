# SPDX-License-Identifier: Apache-2.0
"""A bias that jumps: solved from what was taken, at once and by the right amount."""

import numpy as np
import pytest

from heli_core.rows import MEAS, NAV
from heli_observer import layout as L
from heli_observer.fault_detection import TICKS
from support.synthetic_sensors import hover_path, synthesize

AT = 1000
JUMPS = [
    (MEAS.rate, NAV.gyro_bias, [0.1, 0.0, 0.0]),
    (MEAS.rate, NAV.gyro_bias, [0.0, -0.1, 0.0]),
    (MEAS.force, NAV.accel_bias, [1.0, 0.0, 0.0]),
    (MEAS.force, NAV.accel_bias, [0.0, 1.0, 0.0]),
]


def flown_until_doubted(parameters, run_observer, place, jump, seed):
    """The flight, and a run of it up to the first tick after the doubt."""
    flight = synthesize(hover_path(), parameters, 20.0, seed=seed)
    flight.y[AT:, place] += jump
    run = run_observer(parameters).fly(flight.y[:AT])
    tick = AT
    while not run.state.count[L.COUNT.imu_doubts] and tick < AT + 400:
        run.fly(flight.y[tick : tick + 1])
        tick += 1
    assert run.state.count[L.COUNT.imu_doubts] == 1
    return flight, run, tick


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("place", "learnt", "jump"), JUMPS)
def test_velocity_follows_at_once(parameters, run_observer, place, learnt, jump, seed):
    """From the tick of the doubt on, which solves it together with what made it wrong."""
    flight, run, tick = flown_until_doubted(parameters, run_observer, place, jump, seed)
    before_mps = np.abs(run.out[tick - 2, NAV.vel] - flight.vel[tick - 2]).max()
    run.fly(flight.y[tick:])
    velocity = np.abs(run.out[tick - 1 :, NAV.vel] - flight.vel[tick - 1 :]).max(axis=1)
    assert velocity[0] < 0.5 * before_mps and velocity[100:].max() < 0.5


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("place", "learnt", "jump"), JUMPS[:2])
def test_a_gyro_is_believed_to_be_off_by_what_it_is(
    parameters, run_observer, place, learnt, jump, seed
):
    """Within what the filter says it knows of it; no attitude but in between is far off."""
    flight, run, tick = flown_until_doubted(parameters, run_observer, place, jump, seed)
    at = slice(L.ERROR.gyro_bias, L.ERROR.gyro_bias + 3)
    far = []
    for row in flight.y[tick : tick + 300]:
        run.fly([row])
        sigma = np.sqrt(np.diag(run.state.P)[at])
        far.append(np.abs(run.out[-1, learnt] - jump) / sigma)
    assert np.max(far[0]) < 3.0 and np.max(far) < 5.0
    run.fly(flight.y[tick + 300 :])
    axis = int(np.argmax(np.abs(jump)))
    share = run.out[tick - 1 :, learnt][:, axis] / jump[axis]
    assert share.min() > 0.5 and share.max() < 1.6 and abs(share[-1] - 1.0) < 0.1
    error = np.abs(flight.attitude_error(run.out, np.arange(tick, len(run.out))))
    assert error.max() < 0.1 and error[300:].max() < 0.03


def test_what_is_older_than_the_window_is_left(parameters, run_observer):
    """It holds the last fixes only, the newest of them not older than a period."""
    flight = synthesize(hover_path(), parameters, 15.0, seed=1)
    run = run_observer(parameters).fly(flight.y)
    ticks = run.state.window.tick[:-1]
    horizon = len(flight.y) - 1 - run.params.horizon_ticks
    assert ticks.max() > horizon - 20 and ticks.min() > horizon - TICKS
    assert sorted(ticks) == list(range(ticks.min(), ticks.max() + 1, 20))
    newest = run.state.window.tick[-1]
    assert run.state.window.tick[newest] == ticks.max()
