# SPDX-License-Identifier: Apache-2.0
"""One tick of the outer loop: late navigation, the step that engages, what waits between steps."""

import numpy as np
import pytest

from heli_core.inbox import deliver, empty_inbox
from heli_core.python_controller import OUTER, PythonLaw
from heli_core.rotations import quat_from_euler
from heli_core.rows import NAV, REFERENCE
from heli_core.ticks import TICK_NS, TICK_S, Rate
from heli_core.trajectory import Trajectory
from heli_outer_pd import OuterStatus, outer_params
from heli_outer_pd.node import OuterLoopNode
from heli_outer_pd.outer_loop import (
    AS_GIVEN,
    ENGAGEMENT,
    HELD,
    INPUTS,
    MOVED,
    NOT_DUE,
    initial_loop,
    keep_newest,
    navigation_at,
    no_navigation,
)
from heli_outer_pd.python_controller import OwnPositionLaw
from heli_outer_pd.state import MEMORY

VALUES = OuterLoopNode.SPEC.resolve()
K, PERIOD = outer_params(VALUES), VALUES["period_ticks"]
HERE, PSI = np.array([1.5, -0.7, -10.9]), 0.4


def row(north_m):
    nav = np.arange(float(NAV.size))
    nav[NAV.pos], nav[NAV.vel] = [north_m, 0.0, -10.0], [2.0, -1.0, 0.5]
    return nav


def nothing():
    return no_navigation(0.5, Rate())


def at(heard, tick):
    out = np.zeros(NAV.size)
    navigation_at(heard, tick, out)
    return out


def test_that_of_now_is_flown_to_the_last_bit():
    heard = nothing()
    assert np.isnan(at(heard, 0)).all()
    keep_newest(heard, 5, row(3.0))
    np.testing.assert_array_equal(at(heard, 5), row(3.0))


def test_an_old_one_goes_on_and_nothing_else_of_it_changes():
    heard = nothing()
    keep_newest(heard, 5, row(3.0))
    carried, moved = at(heard, 15), row(3.0)
    moved[NAV.pos] += 0.1 * moved[NAV.vel]
    np.testing.assert_allclose(carried, moved, rtol=0, atol=1e-15)
    assert np.isfinite(at(heard, 55)).all() and np.isnan(at(heard, 56)).all()


def test_what_comes_behind_a_newer_one_is_not_used():
    heard = nothing()
    keep_newest(heard, 5, row(3.0))
    keep_newest(heard, 4, row(9.0))
    np.testing.assert_array_equal(at(heard, 5), row(3.0))


class Loop:
    """An outer loop in front of a hover over the origin, 10 m high."""

    def __init__(self, reference, law=None):
        self.state = initial_loop(K, 0.5, Rate(), reference)
        self.inbox, self.out = empty_inbox(len(INPUTS)), np.zeros(4)
        self.hover = Trajectory.hover(np.array([0.0, 0.0, -10.0]), 0.0)
        self.controller = OwnPositionLaw(law)

    def tick(self, tick, **changes):
        """The outcome of a tick at which navigation came: HERE, but for what changes."""
        nav = np.zeros(NAV.size)
        nav[NAV.pos], nav[NAV.quat] = HERE, quat_from_euler(0.0, 0.0, PSI)
        for name, value in changes.items():
            nav[getattr(NAV, name)] = value
        deliver(self.inbox, INPUTS, {INPUTS[0]: (tick, nav)})
        reference = tick * TICK_NS, self.hover.times_ns, self.hover.points
        return self.controller.step(self.state, self.inbox, tick, PERIOD, *reference, K, self.out)


def test_between_two_steps_of_the_law_it_hears_and_nothing_else():
    loop = Loop(AS_GIVEN)
    assert loop.tick(0) == OuterStatus.OK
    before, nav = loop.out.copy(), loop.state.nav.copy()
    assert {loop.tick(tick, vel=tick) for tick in range(1, PERIOD)} == {NOT_DUE}
    np.testing.assert_array_equal(loop.out, before)
    np.testing.assert_array_equal(loop.state.nav, nav)
    assert loop.state.heard.tick[0] == PERIOD - 1
    assert loop.tick(PERIOD) == OuterStatus.OK


@pytest.mark.parametrize(
    ("reference", "points", "offset", "psi"),
    [
        (AS_GIVEN, [0.0, 0.0, -10.0], [0.0, 0.0, 0.0], 0.0),
        (MOVED, HERE, HERE - [0.0, 0.0, -10.0], 0.0),
        (HELD, HERE, [0.0, 0.0, 0.0], PSI),
    ],
    ids=["as given", "moved", "held"],
)
def test_the_first_step_with_a_position_says_where_the_reference_begins(
    reference, points, offset, psi
):
    loop = Loop(reference)
    given = loop.hover.points.copy()
    assert loop.tick(0, pos=np.nan) == OuterStatus.BAD_NAVIGATION
    np.testing.assert_array_equal(loop.hover.points, given)
    assert np.isnan(loop.state.nav).all() == (reference == HELD), "nothing to hold yet"
    assert loop.tick(PERIOD) == OuterStatus.OK
    # Later steps leave it there.
    assert loop.tick(2 * PERIOD, pos=HERE + 1.0) == OuterStatus.OK
    np.testing.assert_allclose(loop.hover.points[0, REFERENCE.pos], points, atol=1e-15)
    np.testing.assert_allclose(loop.state.offset_ned_m, offset, atol=1e-15)
    assert loop.hover.points[0, REFERENCE.psi] == pytest.approx(psi)
    assert loop.state.engagement[ENGAGEMENT.tick] == PERIOD
    height = loop.state.law.x[[MEMORY.ground_known, MEMORY.ground_off_m]].tolist()
    assert height == ([1.0, offset[2]] if reference == MOVED else [0.0, 0.0])


def test_after_a_gap_the_velocity_begins_from_that_of_the_navigation_and_the_wind_is_known():
    """Once, as soon as there is navigation; the reference stays where it was."""
    vel = np.array([3.0, 1.0, -0.5])
    loop = Loop(MOVED)
    loop.tick(0)
    points = loop.hover.points.copy()
    state = loop.state.law.x
    state[MEMORY.disturbance] = wind = np.array([0.4, -0.3, 0.2])
    loop.state.engagement[ENGAGEMENT.velocity] = 1
    loop.tick(PERIOD, pos=np.nan, vel=vel)
    assert loop.state.engagement[ENGAGEMENT.velocity] == 1
    loop.tick(2 * PERIOD, vel=vel)
    assert loop.state.engagement[ENGAGEMENT.velocity] == 0
    np.testing.assert_allclose(state[MEMORY.vel], vel, atol=0.1)
    np.testing.assert_allclose(state[MEMORY.disturbance], wind, atol=0.1)
    loop.tick(3 * PERIOD, vel=-vel)
    assert np.abs(state[MEMORY.vel] - -vel).max() > 1.0, "afterwards it is estimated"
    np.testing.assert_array_equal(loop.hover.points, points)


def test_a_law_in_python_takes_the_place_of_the_packaged_one_where_that_steps():
    asked = []

    def level(x, r, t):
        asked.append((x[NAV.pos].tolist(), t))
        return 0.01, 0.02, 0.03, 0.04

    level.loop = OUTER
    loop = Loop(AS_GIVEN, PythonLaw(level))
    for tick in range(PERIOD + 2):
        loop.tick(tick)
    assert asked == [(HERE.tolist(), 0.0), (HERE.tolist(), PERIOD * TICK_S)]
    np.testing.assert_allclose(loop.out, [0.01, 0.02, 0.03, 0.04], atol=1e-15)
