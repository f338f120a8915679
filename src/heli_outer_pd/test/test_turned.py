# SPDX-License-Identifier: Apache-2.0
"""A turn put into a trajectory: by the angle, within the limits, the places as they were."""

import math

import numpy as np
import pytest

from heli_core.errors import PathCause
from heli_core.rows import REFERENCE
from heli_core.ticks import NS_PER_S
from heli_core.trajectory import Trajectory
from heli_outer_pd.guidance import FlightPath, MotionLimits, PathError, turned

LIMITS = MotionLimits(3.0, 1.5, 1.5, 1.5, math.radians(45.0), math.radians(60.0), 2.0)
STEP_NS = NS_PER_S // 100


def descent():
    """5 m down from 10 m, from the stamp of 7 s on."""
    path = FlightPath(np.array([1.0, 2.0, -10.0]), 0.4, LIMITS)
    flown = path.go_to(np.array([1.0, 2.0, -5.0])).trajectory()
    return Trajectory(7 * NS_PER_S, flown.times_ns, flown.points)


@pytest.mark.parametrize("angle_deg", [3.0, 40.0, -170.0])
def test_it_turns_by_the_angle_within_the_limits_where_it_would_have_been(angle_deg):
    before, leave_ns = descent(), 9 * NS_PER_S
    after = turned(before, leave_ns, 60 * NS_PER_S, math.radians(angle_deg), LIMITS)
    stamps = 7 * NS_PER_S + np.arange(0, 1500) * STEP_NS
    old, new = (np.array([trajectory.at(int(s)) for s in stamps]) for trajectory in (before, after))
    np.testing.assert_allclose(new[:, REFERENCE.pos], old[:, REFERENCE.pos], atol=1e-12)
    np.testing.assert_allclose(new[:, REFERENCE.vel], old[:, REFERENCE.vel], atol=1e-12)
    psi = new[:, REFERENCE.psi] - 0.4
    np.testing.assert_allclose(psi[stamps < leave_ns], 0.0, atol=1e-12)
    assert psi[-1] == pytest.approx(math.radians(angle_deg), abs=1e-12)
    # The heading is held between way points 0.04 s apart: looked at there.
    turns = psi[np.flatnonzero(stamps == leave_ns)[0] :: 4]
    rate = np.diff(turns) / 0.04
    assert np.abs(rate).max() <= LIMITS.yaw_rate_radps * (1.0 + 1e-9)
    # The cubic begins with its largest acceleration, which the limit is; a second difference over
    # its first way points sees at most that.
    acceleration = np.abs(np.diff(rate)).max() / 0.04
    assert acceleration <= LIMITS.yaw_acceleration_radps2 * (1.0 + 1e-9)
    assert max(np.abs(rate).max() / LIMITS.yaw_rate_radps,
               acceleration / LIMITS.yaw_acceleration_radps2) > 0.85  # fmt: skip


def test_what_is_long_past_is_dropped_and_a_hover_takes_a_turn():
    hover = Trajectory.hover(np.array([0.0, 0.0, -5.0]), 1.0)
    for k in range(50):
        hover = turned(hover, 10 * k * NS_PER_S, 5 * NS_PER_S, 0.3, LIMITS)
    assert hover.times_ns.size < 120
    assert hover.at(3600 * NS_PER_S)[REFERENCE.psi] == pytest.approx(1.0 + 50 * 0.3)


def test_a_turn_that_is_no_number_is_refused():
    with pytest.raises(PathError, match="nan") as refused:
        turned(descent(), 9 * NS_PER_S, NS_PER_S, math.nan, LIMITS)
    assert refused.value.cause is PathCause.NOT_FINITE
