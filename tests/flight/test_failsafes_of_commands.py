# SPDX-License-Identifier: Apache-2.0
"""Rows of the table of failsafes about who commands, flown in one process: fence, silence.

In the paper's wind with turbulence; what is commanded leads away until the aircraft acts by itself.
"""

from dataclasses import replace

import numpy as np
import pytest

from heli_flight.loop import build, fly_loop
from heli_flight.settings import resolve
from heli_outer_pd.failsafes import Action, Condition, of, severest
from heli_outer_pd.goto import outside
from heli_outer_pd.script import ScriptedSticks
from heli_outer_pd.state import OuterStatus

RADIUS_M, CEILING_M, MARGIN_M = 15.0, 16.0, 3.0
FENCE = {"fence.radius_m": RADIUS_M, "fence.ceiling_m": CEILING_M, "fence.margin_m": MARGIN_M}
AT_S = 4.0


def flown(seed, n_ticks=3000, **orders):
    """A hover that is commanded otherwise from `AT_S` on."""
    settings = resolve("hover", "rtk", seed)
    outer = settings.nodes["outer_loop"] | FENCE
    outer |= {f"commands.{name}": value for name, value in orders.items()}
    settings = replace(
        settings,
        nodes=settings.nodes | {"outer_loop": outer},
        scenario=replace(settings.scenario, n_ticks=n_ticks),
    )
    flight = fly_loop(build(settings), settings)
    assert flight.status == 0, flight.sentence
    return flight.record, settings


def attitude(roll_deg, climb_mps):
    """Commanded and renewed for as long as it is followed."""
    return {"attitude_at_s": np.array([AT_S]), "attitude_deg": np.array([[roll_deg, 0.0, 0.0]]),
            "climb_mps": np.array([climb_mps])}  # fmt: skip


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize(("roll_deg", "climb_mps"), [(8.0, 0.0), (2.2, 1.0)])
def test_who_leaves_the_fence_comes_back_and_hovers_inside(seed, roll_deg, climb_mps):
    record, _ = flown(seed, **attitude(roll_deg, climb_mps))
    nav, home = record.nav_pos_ned_m, record.nav_pos_ned_m[100]
    away = np.hypot(*(nav - home)[:, :2].T) - RADIUS_M
    beyond = np.maximum(away, -nav[:, 2] - CEILING_M)
    led = np.flatnonzero(record.mode == "attitude")
    assert led.size and set(record.mode[led[-1] + 1 :]) == {"hover"}
    left = int(np.flatnonzero(beyond > 0.0)[0])
    assert 0.01 * (led[-1] - left) < of(Condition.BEYOND_FENCE).within_s
    assert beyond.max() < 6.0
    end = slice(-300, None)
    assert beyond[end].max() < 0.0
    assert np.linalg.norm(record.truth_vel_ned_mps[end], axis=1).max() < 0.5
    # Without a jump: what is commanded goes on from what was commanded.
    steps = np.degrees(np.abs(np.diff(record.setpoint[led[-1] - 3 : led[-1] + 10 : 4, :2], axis=0)))
    assert steps.max() < 2.0
    assert of(Condition.BEYOND_FENCE).status in outside(2.0, OuterStatus.OK.sentence)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_commander_who_falls_silent_is_held(seed, monkeypatch):
    monkeypatch.setattr(ScriptedSticks, "is_due", lambda self, silent_ns: False)
    record, settings = flown(
        seed, 1500, at_s=np.array([AT_S]), what=("velocity",),
        velocity_ned_mps=np.array([[2.0, 0.0, 0.0]]),
    )  # fmt: skip
    led = np.flatnonzero(record.mode == "velocity")
    silent_s = 0.01 * (led[-1] + 1) - AT_S
    timeout_s = settings.nodes["outer_loop"]["command.timeout_s"]
    assert timeout_s - 0.05 < silent_s < of(Condition.COMMANDER_SILENT).within_s
    assert record.mode[-1] == "hover"
    assert np.linalg.norm(record.truth_vel_ned_mps[-300:], axis=1).max() < 0.5
    steps = np.degrees(np.abs(np.diff(record.setpoint[led[-1] - 3 : led[-1] + 10 : 4, :2], axis=0)))
    assert steps.max() < 2.0


def test_a_lost_position_wins_over_the_fence_and_a_landing_over_both():
    both = [Condition.BEYOND_FENCE, Condition.POSITION_LOST]
    assert severest(both) is Action.HOLD_LEAN
    assert severest([*both, Condition.POSITION_LOST_LONG]) is Action.LAND
