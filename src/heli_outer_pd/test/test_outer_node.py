# SPDX-License-Identifier: Apache-2.0
"""Node `outer_loop` alone: waits for a reference if somebody sends one, else holds the position."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.parameter import Parameter

from heli_core.command_line import config_folder
from heli_core.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import encode_reference
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.messages import encode_header
from heli_outer_pd.modes import SERVED
from heli_outer_pd.node import OuterLoopNode

SUCCESS = TransitionCallbackReturn.SUCCESS


def nav_at(position):
    nav = np.zeros(CHANNELS[topics.ODOM].size)
    nav[0:3], nav[6] = position, 1.0
    return nav


def fly_ticks(outer, ticks, position=(0.0, 0.0, -10.0)):
    for tick in ticks:
        outer.send(topics.ODOM, tick, nav_at(position))
        if tick % 2 == 0:
            outer.send(topics.ROTOR_SPEED, tick, np.array([193.73]))


def held(outer):
    return outer.node.run.held.points[0, :3].tolist()


def test_every_second_tick_has_a_setpoint_and_a_collective(bench):
    outer = bench(OuterLoopNode)
    outer.fly()
    fly_ticks(outer, range(9))
    assert len(outer.sent[topics.ATTITUDE_SETPOINT]) == len(outer.sent[topics.COLLECTIVE]) == 5


def test_without_a_reference_the_position_of_activation_is_held(bench):
    outer = bench(OuterLoopNode)
    outer.fly()
    fly_ticks(outer, [0], (3.0, -4.0, -10.0))
    fly_ticks(outer, range(1, 200), (3.5, -4.0, -10.0))
    assert held(outer) == [3.0, -4.0, -10.0]
    # It leans back to where it was: north of it, nose up.
    assert outer.sent[topics.ATTITUDE_SETPOINT][-1][1] > outer.sent[topics.ATTITUDE_SETPOINT][0][1]
    outer.again()
    fly_ticks(outer, [300], (7.0, 0.0, -12.0))
    assert held(outer) == [7.0, 0.0, -12.0]


def test_a_reference_that_is_announced_is_waited_for(bench):
    outer = bench(OuterLoopNode, peers=["scenario"])
    outer.fly()
    fly_ticks(outer, range(2))
    assert outer.sent[topics.COLLECTIVE] == []
    trajectory = Trajectory.hover(np.array([0.0, 0.0, -10.0]), 0.3)
    outer.receive(topics.REFERENCE, encode_reference(trajectory))
    assert len(outer.sent[topics.COLLECTIVE]) == 1
    assert outer.node.core.reference.points == pytest.approx(trajectory.points)
    outer.again()
    fly_ticks(outer, [400])
    assert len(outer.sent[topics.COLLECTIVE]) == 2, "a given reference stays"


def test_it_is_waited_for_so_long_and_no_longer(bench):
    outer = bench(OuterLoopNode, peers=["scenario"], peer_timeout_s=0.2)
    outer.fly()
    fly_ticks(outer, range(3))
    assert outer.sent[topics.COLLECTIVE] == []
    outer.spin_until(lambda: outer.sent[topics.COLLECTIVE])
    assert outer.node.run.held is not None


def test_navigation_is_waited_for_once_and_missed_ever_after(bench):
    """While it aligns nothing is wrong; once the law has engaged, its loss for long is an error."""
    outer = bench(OuterLoopNode)
    outer.fly()

    def lost(tick):
        outer.receive(topics.NO_ESTIMATE, encode_header(outer.node.stamp_ns(tick), topics.MAP))
        outer.send(topics.ROTOR_SPEED, tick, np.array([193.73]))
        assert outer.node.tick == tick
        return outer.node.health.level, outer.node.health.message

    waits = (Level.OK, "waits for navigation: the trim is commanded")
    assert lost(0) == lost(4) == waits
    trim = outer.node.core.params.trim
    assert outer.sent[topics.ATTITUDE_SETPOINT][-1] == pytest.approx(trim[:3], abs=1e-12)
    assert outer.sent[topics.COLLECTIVE][-1] == pytest.approx(trim[3:], abs=0.0)
    fly_ticks(outer, [8])
    assert outer.node.health.level == Level.OK
    reports = [lost(tick) for tick in range(10, 62, 2)]
    assert {level for level, _ in reports[:-1]} == {Level.OK}, (
        "carried on by its velocity for 0.5 s"
    )
    level, message = reports[-1]
    assert level == Level.ERROR and message.endswith(" is held")
    fly_ticks(outer, [0])
    outer.node.begin_anew()
    assert lost(4)[0] < Level.ERROR, "another flight"
    fly_ticks(outer, [8])
    outer.again()
    assert lost(12)[0] < Level.ERROR, "left and taken up again: it begins in trim"


def test_a_bad_reference_is_refused_and_the_old_one_flown(bench):
    outer = bench(OuterLoopNode)
    outer.fly()
    good = encode_reference(Trajectory.hover(np.array([1.0, 2.0, -10.0]), 0.0))
    outer.receive(topics.REFERENCE, good)
    reference = outer.node.core.reference
    good.points[0].transforms[0].translation.x = float("nan")
    outer.receive(topics.REFERENCE, good)
    assert outer.node.core.reference is reference
    assert "not finite" in outer.node.core.refused[topics.REFERENCE]


def test_gains_change_between_two_ticks_and_refused_ones_change_nothing(bench):
    outer = bench(OuterLoopNode)
    outer.fly()
    fly_ticks(outer, range(8))
    kernel, state = outer.node.core.params, outer.node.core.state

    def ask(name, value):
        return outer.node.set_parameters_atomically([Parameter(name, value=value)])

    assert not ask("K_P", [0.1, 0.2]).successful
    assert outer.node.core.params is kernel
    changed = [1.1 * k for k in np.ravel(outer.node.values["K_P"]).tolist()]
    assert ask("K_P", changed).successful
    assert outer.node.core.params is not kernel and outer.node.core.state is state


@pytest.mark.parametrize("name", ["core", "run"])
def test_a_stage_that_is_over_has_no_data(bench, name):
    outer = bench(OuterLoopNode)
    with pytest.raises(RuntimeError, match="outer_loop is not"):
        getattr(outer.node, name)
    outer.fly()
    assert getattr(outer.node, name) is not None
    assert outer.node.trigger_deactivate() == SUCCESS
    assert outer.node.trigger_cleanup() == SUCCESS
    with pytest.raises(RuntimeError, match="outer_loop is not"):
        getattr(outer.node, name)


def east_north_up(east, north, up, start_ns=0):
    trajectory = Trajectory.hover(np.array([north, east, -up]), 0.0)
    return encode_reference(replace(trajectory, start_ns=start_ns))


@pytest.mark.parametrize(
    ("message", "sentence"),
    [
        (east_north_up(0.0, 0.0, 1.9), "point 0 is 1.9 m high; allowed: 2 to 100 m"),
        (east_north_up(0.0, 0.0, 101.0), "point 0 is 101.0 m high; allowed: 2 to 100 m"),
        (
            east_north_up(80.0, 80.0, 10.0),
            "point 0 is 111 m from where the flight began; allowed: at most 100 m",
        ),
        (
            east_north_up(0.0, 0.0, 10.0, 1_795_299_400_000_000_000),
            "stamped 1795299400.00 s; now is 1.08 s, allowed: at most 60 s later",
        ),
    ],
    ids=["low", "high", "far", "future"],
)
def test_a_reference_outside_is_refused_with_a_sentence_and_the_old_one_stays(
    bench, message, sentence
):
    """Whoever sends it: the page's bounds, kept by the node. The aircraft here never moves."""
    outer = bench(OuterLoopNode, failsafe__unfollowed_deg=[180.0, 180.0])
    outer.fly()
    outer.receive(topics.REFERENCE, east_north_up(2.0, 1.0, 10.0))
    reference = outer.node.core.reference
    fly_ticks(outer, range(9))
    outer.receive(topics.REFERENCE, message)
    fly_ticks(outer, range(9, 13))
    assert outer.node.core.reference is reference
    health = outer.node.health
    assert health.level == Level.WARN and health.message.endswith(f": reference: {sentence}")
    outer.receive(topics.REFERENCE, east_north_up(60.0, 70.0, 20.0))
    assert outer.node.core.reference is not reference
    fly_ticks(outer, range(13, 213))
    assert outer.node.health.level == Level.OK
    assert outer.node.health.facts["refused.reference"] == f"1; reference: {sentence}"


def test_the_bounds_may_be_changed_in_flight_but_not_crossed(bench):
    outer = bench(OuterLoopNode)
    outer.fly()

    def ask(name, value):
        change = [Parameter(f"reference_limits.{name}", value=value)]
        return outer.node.set_parameters_atomically(change)

    crossed = ask("altitude_min_m", 200.0)
    assert not crossed.successful and " altitude_max_m 100" in crossed.reason
    assert ask("altitude_max_m", 300.0).successful
    outer.receive(topics.REFERENCE, east_north_up(0.0, 0.0, 250.0))
    assert outer.node.core.reference is not None


def test_the_page_has_the_same_bounds():
    page = yaml.safe_load((config_folder("heli_live_view") / "live_view.yaml").read_text())
    config = yaml.safe_load((config_folder("heli_outer_pd") / "outer_loop.yaml").read_text())
    limits = config["/**/outer_loop"]["ros__parameters"]["reference_limits"]
    assert limits.items() <= page["/**/live_view"]["ros__parameters"]["command_limits"].items()


def test_whoever_asks_what_mode_takes_is_told_all_that_it_takes(bench):
    outer = bench(OuterLoopNode)
    told = outer.node.describe_parameter("mode").description
    for command in SERVED:
        for name in command.names:
            assert name in told.partition(": ")[2].split(", ")
