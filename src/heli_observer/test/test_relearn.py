# SPDX-License-Identifier: Apache-2.0
"""A bias that jumps: solved from what was taken, at once and by the right amount."""

import numpy as np
import pytest

from heli_math.rows import MEAS, NAV
from heli_observer import layout as L
from heli_observer.relearn import TICKS
from heli_observer.testing.synthetic import hover_path, synthesize

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
    while not run.state.count[L.C_IMU_DOUBTS] and tick < AT + 400:
        run.fly(flight.y[tick : tick + 1])
        tick += 1
    assert run.state.count[L.C_IMU_DOUBTS] == 1
    return flight, run, tick


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("place", "learnt", "jump"), JUMPS)
def test_the_jump_is_believed_as_large_as_it_was(
    parameters, run_observer, place, learnt, jump, seed
):
    """From the tick of the doubt on; each error widened for itself overshoots by 2 and more."""
    flight, run, tick = flown_until_doubted(parameters, run_observer, place, jump, seed)
    before_m = np.abs(run.out[tick - 2, NAV.vel] - flight.vel[tick - 2]).max()
    run.fly(flight.y[tick:])
    axis, size = int(np.argmax(np.abs(jump))), np.abs(jump).max()
    share = run.out[tick - 1 :, learnt][:, axis] / jump[axis]
    assert share.min() > 0.3 and share.max() < 1.9
    assert abs(share[-1] - 1.0) < 0.2
    others = np.delete(run.out[tick - 1 :, learnt], axis, axis=1)
    assert np.abs(others).max() < 0.6 * size
    velocity = np.abs(run.out[tick - 1 :, NAV.vel] - flight.vel[tick - 1 :]).max(axis=1)
    assert velocity[0] < 0.5 * before_m and velocity[100:].max() < 0.3


@pytest.mark.parametrize(("place", "learnt", "jump"), JUMPS[::2])
def test_what_is_believed_then_is_as_sure_as_is_said(parameters, run_observer, place, learnt, jump):
    """Errors of velocity and tilt over their sigmas, 5 flights at the tick of the doubt."""
    squares = []
    for seed in range(1, 6):
        flight, run, tick = flown_until_doubted(parameters, run_observer, place, jump, seed)
        out = run.out[tick - 1]
        velocity = (out[NAV.vel] - flight.vel[tick - 1]) / out[NAV.sigma_vel]
        tilt = flight.attitude_error(run.out, [tick - 1])[0] / out[NAV.sigma_att]
        squares += [*velocity**2, *tilt[:2] ** 2]
    assert np.mean(squares) < 4.0


def test_what_is_older_than_the_window_is_left(parameters, run_observer):
    """It holds the last fixes only, the newest of them not older than a period."""
    flight = synthesize(hover_path(), parameters, 15.0, seed=1)
    run = run_observer(parameters).fly(flight.y)
    ticks = run.state.window.tick[:-1]
    horizon = len(flight.y) - 1 - run.kernel.horizon_ticks
    assert ticks.max() > horizon - 20 and ticks.min() > horizon - TICKS
    assert sorted(ticks) == list(range(ticks.min(), ticks.max() + 1, 20))
    newest = run.state.window.tick[-1]
    assert run.state.window.tick[newest] == ticks.max()
