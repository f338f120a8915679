# SPDX-License-Identifier: Apache-2.0
"""Take-off and landing beside a body that can only go up and down, and stands on the ground."""

import math

import numpy as np
import pytest

from heli_core.rcl_yaml import ParameterError
from heli_core.rotations import quat_from_euler
from heli_core.rows import NAV, REFERENCE, SETPOINT
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_core.trajectory import Trajectory
from heli_outer_pd import Command, Guard, Phase, Refusal, position_law
from heli_outer_pd import parameters as config
from heli_outer_pd.disturbance import hover_share
from heli_outer_pd.goto import Goto, PhaseNumbers
from heli_outer_pd.node import OuterLoopNode
from heli_outer_pd.phases import Phases
from heli_outer_pd.position_law import follow
from heli_outer_pd.reference import ReferenceLimits, ReferenceRefused
from heli_outer_pd.script import script_of
from heli_outer_pd.state import MACHINE, MEMORY, STANDS

VALUES = OuterLoopNode.SPEC.resolve()
STEP_NS = VALUES["period_ticks"] * TICK_NS
DT_S = STEP_NS / NS_PER_S
RATE = NS_PER_S // STEP_NS  # steps of the law in a second
_LAG_S = 0.035  # as of delay and servos; the gains are for that


class Body:
    """A mass under the rotor's thrust on a floor at height 0, and the law that flies it.

    Only the vertical moves: thrust follows the collective with a lag, `strength` times what the
    law's map says, as on an aircraft that its maker does not know well.
    """

    def __init__(self, on_ground=True, strength=1.0, height_m=0.0, **changes):
        self.values = VALUES | {"start.on_ground": on_ground} | changes
        self.k = config.outer_params(self.values)
        self.state = position_law.initial_state(self.k)
        self.phases = Phases(
            PhaseNumbers.from_parameters(self.values),
            Goto.from_parameters(self.values),
            self.k,
            self.state,
            ReferenceLimits.from_parameters(self.values),
            script_of(self.values),
        )
        if not on_ground:
            self.phases.follow(Trajectory.hover(np.array([0.0, 0.0, -height_m]), 0.3), 0)
        self.strength, self.now_ns = strength, 0
        self.height_m, self.up_mps = height_m, 0.0
        self.thrust = 0.0 if on_ground else 1.0
        self.phi, self.theta, self.psi = 0.02, -0.01, 0.3
        self.touched_mps = None
        self.slip_ned_mps = 0.0, 0.0
        self.out = self.k.trim.copy()
        self.nav = np.zeros(NAV.size)

    def step(self):
        """One period of the law."""
        self.nav[NAV.pos] = 0.0, 0.0, -self.height_m
        self.nav[NAV.vel] = *self.slip_ned_mps, -self.up_mps
        self.nav[NAV.quat] = quat_from_euler(self.phi, self.theta, self.psi)
        way = self.phases.trajectory or Trajectory.hover(np.zeros(3), 0.0)
        follow(self.nav, self.now_ns - way.start_ns, way.times_ns, way.points, self.k, self.state,
               self.out)  # fmt: skip
        self.phases.after(self.now_ns, self.nav, self.out)
        for _ in range(round(DT_S / 0.001)):
            wanted = self.strength * hover_share(self.out[SETPOINT.col], self.k)
            self.thrust += (wanted - self.thrust) * 0.001 / _LAG_S
            self.up_mps += self.k.g * (self.thrust - 1.0) * 0.001
            self.height_m += self.up_mps * 0.001
            if self.height_m <= 0.0:
                if self.up_mps < -0.05:
                    self.touched_mps = -self.up_mps
                self.height_m, self.up_mps = 0.0, max(self.up_mps, 0.0)
        self.now_ns += STEP_NS

    def until(self, phase, most_s=120.0):
        """Fly until a phase is entered; its flight time, s."""
        for _ in range(round(most_s * RATE)):
            if self.phases.phase == phase:
                return self.now_ns / NS_PER_S
            self.step()
        raise AssertionError(f"{phase} is not reached: {self.phases.history}")

    def ask(self, command, goal=None):
        return self.phases.command(command, self.now_ns, self.nav, goal)


def standing(**changes):
    body = Body(**changes)
    for _ in range(RATE):
        body.step()
    return body


@pytest.mark.parametrize("strength", [0.85, 1.0, 1.15])
def test_from_the_ground_to_the_ground(strength):
    body = standing(strength=strength)
    assert body.phases.phase == Phase.STANDING
    assert body.out[SETPOINT.col] == VALUES["takeoff.idle_collective"]
    assert body.ask(Command.TAKEOFF) is None
    began_s = body.now_ns / NS_PER_S
    lifted_s = body.until(Phase.LIFTING)
    assert lifted_s - began_s == pytest.approx(VALUES["takeoff.spool_up_s"], abs=0.08)
    ramped_s = body.until(Phase.CLIMBING) - lifted_s
    assert ramped_s == pytest.approx(VALUES["takeoff.ramp_s"], abs=0.08)
    assert body.height_m < 0.2
    body.until(Phase.HOVER)
    assert body.height_m == pytest.approx(VALUES["takeoff.height_m"], abs=0.1)
    for _ in range(4 * RATE):
        body.step()
    assert body.ask(Command.LAND) is None
    body.until(Phase.SETTLING)
    assert body.height_m == 0.0
    assert body.touched_mps == pytest.approx(VALUES["land.touch_down_mps"], abs=0.1)
    assert [phase for _, phase in body.phases.history[-3:]] == [
        Phase.HALTING, Phase.DESCENDING, Phase.SETTLING,
    ]  # fmt: skip
    body.until(Phase.STANDING)
    assert body.out[SETPOINT.col] == VALUES["takeoff.idle_collective"]
    assert not body.state.x[MEMORY.disturbance].any()
    # And again: what the ground did is not remembered.
    assert body.ask(Command.TAKEOFF) is None
    body.until(Phase.HOVER)
    assert body.height_m == pytest.approx(VALUES["takeoff.height_m"], abs=0.1)


def test_an_aircraft_whose_collective_lifts_the_other_way_flies_as_well():
    """The same but for the sign of d_col: the same heights, the collective mirrored."""
    mirrored = {key: -VALUES[key] for key in ("rotor.K_col", "trim.d_col")}
    mirrored["takeoff.idle_collective"] = -VALUES["takeoff.idle_collective"]
    one, other = standing(), standing(**mirrored)
    for body in (one, other):
        body.ask(Command.TAKEOFF)
        body.until(Phase.HOVER)
        body.ask(Command.LAND)
        body.until(Phase.SETTLING)
        body.until(Phase.STANDING)
    assert [p for _, p in one.phases.history] == [p for _, p in other.phases.history]
    assert other.now_ns == one.now_ns
    assert other.out[SETPOINT.col] == -one.out[SETPOINT.col]
    assert other.touched_mps == pytest.approx(one.touched_mps, rel=1e-6)


def test_the_collective_never_jumps():
    body, last = standing(), None
    body.ask(Command.TAKEOFF)
    steps = []
    while body.phases.phase != Phase.HOVER:
        body.step()
        if last is not None:
            steps.append((abs(body.out[SETPOINT.col] - last), body.phases.phase))
        last = body.out[SETPOINT.col]
    ramp = (VALUES["takeoff.idle_collective"] - VALUES["trim.d_col"]) / VALUES["takeoff.ramp_s"]
    assert max(step for step, phase in steps if phase == Phase.LIFTING) <= ramp * DT_S + 1e-12
    # The climb's first step meets the end of the ramp, give or take the feed-forward of a step.
    first = next(step for step, phase in steps if phase == Phase.CLIMBING)
    assert first < ramp * DT_S + 0.01
    assert body.state.machine[MACHINE.guidance] == 0.0


def test_the_disturbance_estimate_rests_on_the_ground():
    """An aircraft too weak to lift pushes up for seconds; nothing of it is taken for wind."""
    body = standing(strength=0.3)
    body.ask(Command.TAKEOFF)
    body.until(Phase.CLIMBING)
    disturbances = []
    while body.phases.phase == Phase.CLIMBING:
        body.step()
        disturbances.append(np.abs(body.state.x[MEMORY.disturbance]).max())
    assert max(disturbances) == 0.0
    assert body.phases.phase == Phase.SETTLING, "it does not lift: broken off"
    assert body.height_m == 0.0
    body.until(Phase.STANDING)


def test_light_on_the_skids_it_leans_against_what_it_slips():
    """As much as the law does in the air, by the share of the weight that the rotor carries."""
    still, slips = standing(), standing()
    for body in (still, slips):
        body.ask(Command.TAKEOFF)
        body.until(Phase.LIFTING)
    slips.slip_ned_mps = 0.2 * math.sin(0.3), -0.2 * math.cos(0.3)  # to the left, heading 0.3
    shares = []
    while still.phases.phase == Phase.LIFTING:
        still.step()
        slips.step()
        share = min(max(2.0 * hover_share(still.out[SETPOINT.col], still.k) - 1.0, 0.0), 1.0)
        against = math.atan(VALUES["K_D"][1] * 0.2 / VALUES["gravity"])
        np.testing.assert_allclose(
            slips.out - still.out, [share * against, 0.0, 0.0, 0.0], atol=1e-12
        )
        shares.append(share)
    assert shares[0] == 0.0 and shares[-1] > 0.9


def test_rolling_over_a_skid_breaks_the_take_off_off():
    body = standing(**{"takeoff.ramp_s": 1.5})
    body.ask(Command.TAKEOFF)
    body.until(Phase.LIFTING)
    stood = abs(body.phi - body.k.trim[SETPOINT.phi])
    for _ in range(round(0.8 * RATE)):
        body.step()
    tip = math.radians(VALUES["takeoff.tip_deg"])
    body.phi = body.k.trim[SETPOINT.phi] - stood - 0.9 * tip
    body.step()
    assert body.phases.phase == Phase.LIFTING
    body.phi -= 0.2 * tip
    body.step()
    assert body.phases.phase == Phase.SETTLING
    higher = body.out[SETPOINT.col]
    body.step()
    assert body.out[SETPOINT.col] > higher, "less thrust"
    body.until(Phase.STANDING)


def test_on_the_ground_the_attitude_follows_the_skids():
    body = standing()
    body.phi, body.theta = 0.08, -0.05
    body.step()
    np.testing.assert_allclose(body.out[:3], [0.08, -0.05, 0.3], atol=1e-12)
    assert body.state.machine[MACHINE.guidance] == STANDS


def test_a_take_off_from_too_steep_a_slope_or_blindly_is_refused_and_changes_nothing():
    body = standing()
    body.phi = body.k.trim[SETPOINT.phi] + math.radians(VALUES["takeoff.lean_max_deg"] + 0.5)
    body.step()
    before = body.state.copy()
    refused = body.ask(Command.TAKEOFF)
    assert isinstance(refused, Refusal) and refused.cause == Guard.UPRIGHT
    body.nav[NAV.vel] = np.nan
    assert body.ask(Command.TAKEOFF).cause == Guard.NAVIGATION
    assert body.phases.phase == Phase.STANDING
    np.testing.assert_array_equal(body.state.x, before.x)
    np.testing.assert_array_equal(body.state.machine, before.machine)


@pytest.mark.parametrize("command", [Command.LAND, Command.HOLD, Command.GOTO])
def test_what_is_not_for_the_ground_is_refused_there(command):
    body = standing()
    way = body.phases.trajectory
    assert isinstance(body.ask(command, (np.array([0.0, 0.0, -9.0]), 0.0)), Refusal)
    assert body.phases.trajectory is way and body.phases.phase == Phase.STANDING


def test_a_take_off_is_broken_off_by_land():
    body = standing()
    body.ask(Command.TAKEOFF)
    body.step()
    assert body.ask(Command.LAND) is None
    assert body.phases.phase == Phase.STANDING
    body.ask(Command.TAKEOFF)
    body.until(Phase.LIFTING)
    assert body.ask(Command.LAND) is None
    body.until(Phase.STANDING)
    assert body.height_m == 0.0


def test_the_navigation_lost_on_the_ground_lowers_the_collective():
    body = standing()
    body.ask(Command.TAKEOFF)
    body.until(Phase.LIFTING)
    body.step()
    nav = np.full(NAV.size, np.nan)
    for _ in range(round(2.4 * RATE)):
        way = body.phases.trajectory
        follow(nav, body.now_ns, way.times_ns, way.points, body.k, body.state, body.out)
        body.phases.after(body.now_ns, nav, body.out)
        body.now_ns += STEP_NS
    assert [phase for _, phase in body.phases.history[-2:]] == [Phase.LIFTING, Phase.SETTLING]
    assert body.out[SETPOINT.col] == VALUES["takeoff.idle_collective"]


def test_a_landing_is_held_but_not_near_the_ground():
    body = Body(on_ground=False, height_m=6.0)
    for _ in range(RATE):
        body.step()
    assert body.ask(Command.LAND) is None
    body.until(Phase.DESCENDING)
    while body.height_m > 3.0:
        body.step()
    assert body.ask(Command.HOLD) is None
    for _ in range(6 * RATE):
        body.step()
    assert body.phases.phase == Phase.HOVER
    held = -body.phases.trajectory.points[-1, REFERENCE.pos][2]
    assert body.height_m == pytest.approx(held, abs=0.05) and 2.0 < held < 3.0
    assert body.ask(Command.LAND) is None
    body.until(Phase.DESCENDING)
    while body.height_m > 1.0:
        body.step()
    assert body.ask(Command.HOLD).cause == Guard.CLEAR
    body.until(Phase.STANDING)


def test_an_updraught_is_no_touch_down():
    """It lifts with 2 m/s2 for half a second: less thrust, and it does not fall, for a while."""
    body = Body(on_ground=False, height_m=6.0)
    body.step()
    body.ask(Command.LAND)
    body.until(Phase.DESCENDING)
    while body.height_m > 3.0:
        body.step()
    for _ in range(round(0.48 * RATE)):
        body.up_mps += 2.0 * DT_S
        body.step()
    while body.height_m > 0.5:
        body.step()
        assert body.phases.phase == Phase.DESCENDING


def test_a_gust_that_carries_it_for_seconds_is_no_touch_down():
    """Wind from ahead lifts it with 4 m/s2 for two seconds: it goes on sinking, far from ground."""
    body = Body(on_ground=False, height_m=20.0)
    body.step()
    body.ask(Command.LAND)
    body.until(Phase.DESCENDING)
    while body.height_m > 15.0:
        body.step()
    for _ in range(2 * RATE):
        body.up_mps += 4.0 * DT_S
        body.step()
        assert body.phases.phase == Phase.DESCENDING
    body.until(Phase.STANDING)
    assert body.height_m < 0.1


@pytest.mark.parametrize("heading", ["wind", "pose"])
def test_a_hover_turns_the_nose_into_the_wind_where_that_is_wanted(heading):
    """The air pushes to the west, whatever the heading: the wind comes from the east."""
    body = Body(on_ground=False, height_m=6.0, **{"goto.heading": heading})
    assert body.phases.goto.heading == heading
    body.phases.command(Command.HOLD, 0, body.nav + np.eye(NAV.size)[NAV.quat][0])
    for _ in range(40 * RATE):
        body.state.x[MEMORY.disturbance] = 0.0, -1.25, 0.0
        body.psi = body.phases.trajectory.at(body.now_ns)[REFERENCE.psi]
        body.step()
    assert body.phases.phase == Phase.HOVER
    assert body.phases.is_watched() == (heading == "wind")
    assert body.psi == pytest.approx(math.pi / 2.0 if heading == "wind" else 0.3, abs=0.2)


def test_orders_are_done_in_time_and_what_is_refused_is_remarked():
    body = Body(
        **{
            "commands.at_s": np.array([1.0, 2.0, 30.0, 40.0]),
            "commands.what": ("takeoff", "goto", "goto", "land"),
            "commands.goto_ned_m": np.array([[1.0, 0.0, -9.0], [0.0, 0.0, -1.0]]),
        }
    )
    while body.now_ns < 60 * NS_PER_S:
        body.step()
    began = {phase: at_ns / NS_PER_S for at_ns, phase in body.phases.history}
    assert began[Phase.SPOOLING] == 1.0 and began[Phase.HALTING] == 40.0
    first, second = body.phases.remarks
    assert first.startswith("goto: ") and first.endswith(": land")
    assert second.startswith("goto: ") and second.endswith(": 2 to 100 m")


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        ({"commands.at_s": np.array([1.0])}, "has 1 times, commands.what 2 commands"),
        ({"commands.at_s": np.array([2.0, 1.0])}, "allowed: rising times"),
        ({"commands.what": ("goto", "goto")}, "has 2 times goto, commands.goto_ned_m 1 places"),
    ],
)
def test_a_script_that_does_not_agree_with_itself_is_refused(change, sentence):
    values = {
        "commands.at_s": np.array([1.0, 2.0]),
        "commands.what": ("takeoff", "land"),
        "commands.goto_ned_m": np.array([[0.0, 0.0, -9.0]]),
    }
    with pytest.raises(ParameterError, match=sentence):
        script_of(VALUES | values | change)


def test_a_goto_out_of_the_fence_changes_nothing():
    body = Body(on_ground=False, height_m=6.0)
    body.step()
    way = body.phases.trajectory
    with pytest.raises(ReferenceRefused, match="1.5 m high"):
        body.ask(Command.GOTO, (np.array([0.0, 0.0, -1.5]), 0.0))
    assert body.phases.trajectory is way
