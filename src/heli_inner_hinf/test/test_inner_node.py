# SPDX-License-Identifier: Apache-2.0
"""Node `inner_loop` alone: left and taken up in the air, a new flight, changes while it flies."""

import numpy as np
import pytest
from rclpy.parameter import Parameter

from heli_core.rotations import quat_from_euler
from heli_inner_hinf.node import InnerLoopNode
from heli_msgs_bridge import topics
from heli_msgs_bridge.agreement import VERSION_TERM, terms
from heli_msgs_bridge.diagnostics import FACT_DISAGREE, Level, status_array
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.messages import encode_header


@pytest.fixture
def inner(bench):
    made = bench(InnerLoopNode)
    made.fly()
    return made


def tick_of(inner, tick, phi=0.02, collective=-0.1):
    """One tick of lockstep: a banked aircraft that turns; every fourth tick the outer loop."""
    nav = np.zeros(CHANNELS[topics.ODOM].size)
    nav[6:10], nav[10:13] = quat_from_euler(phi, -0.03, 0.4), (0.05, -0.02, 0.1)
    if tick % 4 == 0:
        inner.send(topics.ATTITUDE_SETPOINT, tick, np.array([0.0, 0.01, 0.5]))
        inner.send(topics.COLLECTIVE, tick, np.array([collective]))
    inner.send(topics.ROTOR_STATE, tick, np.array([0.001, 0.002, 0.0]))
    inner.send(topics.ODOM, tick, nav)
    return inner.sent[topics.ACTUATORS][-1]


def test_left_in_the_air_it_goes_on_from_what_is_flown(inner):
    """No jump of any actuator, though the aircraft has rolled meanwhile and nobody commands yet."""
    for tick in range(50):
        flown = tick_of(inner, tick)
    assert np.abs(flown[:3]).max() > 0.01 and flown[3] == -0.1
    inner.again()
    # Without the outer loop's message of this tick: step 61 is none of its ticks.
    first = tick_of(inner, 61, phi=0.12)
    assert first == pytest.approx(flown, abs=1e-12)
    # From tick 64 on the outer loop commands another attitude, which the law answers as any other.
    later = [tick_of(inner, tick, phi=0.12) for tick in range(62, 64)]
    assert np.abs(np.diff([first, *later], axis=0))[:, :3].max() < 0.01
    # In the end it flies as a law that was never left.
    other = [tick_of(inner, tick, phi=0.12) for tick in range(64, 1500)][-1]
    assert np.abs(other - first)[0] > 0.01


def test_a_new_flight_begins_as_the_first_one_did(inner):
    """The plant was started again: nothing of the old flight is left."""
    first = [tick_of(inner, tick) for tick in range(30)]
    inner.again()
    second = [tick_of(inner, tick) for tick in range(30)]
    assert np.array_equal(first, second)


def lost_tick(inner, tick):
    """One tick of lockstep in which the observer has no solution; what inner_loop says of it."""
    stamp_ns = inner.node.stamp_ns(tick)
    inner.receive(topics.NO_ESTIMATE, encode_header(stamp_ns, topics.MAP))
    assert inner.node.tick == tick
    return inner.node.health.level, inner.node.health.message


def test_what_an_observer_of_another_version_sends_is_refused_and_counted(bench):
    """Until one that agrees has taken its place."""
    inner = bench(InnerLoopNode, expects_outer=False)
    inner.fly()
    tick_of(inner, 0)

    def observer_tells(**changes):
        # It has the parameters that all have.
        told = terms("observer", inner.node.values) | changes
        inner.receive(topics.AGREEMENT, status_array(0, "observer", "", "observer", told))

    observer_tells()
    tick_of(inner, 1)
    for changes in ({VERSION_TERM: "1"}, {"rate_hz": "200"}):
        refused = inner.node.core.refusals.get(topics.ODOM)
        before = 0 if refused is None else refused.count
        observer_tells(**changes)
        tick_of(inner, 2)
        assert inner.node.tick == 1 and inner.node.core.refusals[topics.ODOM].count == before + 1
        (term,) = changes
        assert term in inner.node.core.refused[topics.ODOM]
        assert term in inner.node.standing_facts()[FACT_DISAGREE]
    observer_tells()
    assert FACT_DISAGREE not in inner.node.standing_facts()
    tick_of(inner, 2)
    assert inner.node.tick == 2


def test_navigation_is_waited_for_once_and_missed_ever_after(bench):
    """While it aligns nothing is wrong; once the law has flown, its loss for long is an error."""
    inner = bench(InnerLoopNode, expects_outer=False)
    inner.fly()
    waits = (Level.OK, "waits for navigation: the trim is held")
    assert [lost_tick(inner, tick) for tick in range(3)] == 3 * [waits]
    trim = inner.node.core.design.config.u_trim
    assert inner.sent[topics.ACTUATORS][-1][:3] == pytest.approx(trim[:3], abs=0.0)
    tick_of(inner, 3)
    assert inner.node.health.level == Level.OK
    reports = [lost_tick(inner, tick) for tick in range(4, 55)]
    assert {level for level, _ in reports[:5]} == {Level.OK}
    late = (Level.WARN, "the estimate is late: the model carries it on")
    assert set(reports[5:-1]) == {late}
    level, message = reports[-1]
    assert level == Level.ERROR and message.endswith(" is held")
    inner.again()
    assert lost_tick(inner, 60)[0] == Level.ERROR, "left in the air and taken up again: still lost"
    inner.again()
    assert lost_tick(inner, 0) == waits, "another flight"


GAMMA = "output.gamma"


def set_gamma(inner, value):
    return inner.node.set_parameters_atomically([Parameter(GAMMA, value=value)])


def gamma_of(inner):
    return inner.node.core.design.config.output.gamma


def test_judging_changes_nothing(inner):
    before = tick_of(inner, 0)
    node = inner.node
    config = node.core.design.config
    judged = node.validate({**node.values, GAMMA: 5.0}, {GAMMA})
    assert judged.output.gamma == 5.0
    assert not set_gamma(inner, 0.5).successful
    assert node.core.design.config is config and node.values[GAMMA] == gamma_of(inner)
    tick_of(inner, 1)
    assert node.core.design.config is config
    assert before.tolist() == inner.sent[topics.ACTUATORS][0].tolist()


def test_an_accepted_change_is_flown_from_the_next_tick_without_a_jump(inner):
    for tick in range(40):
        flown = tick_of(inner, tick)
    assert set_gamma(inner, 5.0).successful
    assert gamma_of(inner) == 4.3
    first = tick_of(inner, 40)
    assert gamma_of(inner) == inner.node.values[GAMMA] == 5.0
    assert first == pytest.approx(flown, abs=1e-9)


def test_a_change_of_an_unconfigured_node_counts_when_it_is_configured(bench):
    made = bench(InnerLoopNode)
    assert set_gamma(made, 5.0).successful
    made.fly()
    assert gamma_of(made) == 5.0


def test_an_unconfigured_node_refuses_what_it_could_not_fly(bench):
    """The reason at once, not at configuration; the node is as it was, and flies."""
    made = bench(InnerLoopNode)
    before = dict(made.node.values)
    refused = set_gamma(made, 0.5)
    assert not refused.successful and "infeasible" in refused.reason
    assert made.node.values[GAMMA] == before[GAMMA]
    assert made.node.get_parameter(GAMMA).value == before[GAMMA]
    made.fly()
    assert gamma_of(made) == before[GAMMA]


def test_a_setpoint_of_a_later_moment_is_not_fresh(bench):
    """The clock was set back: a setpoint with a negative age would never become too old."""
    inner = bench(InnerLoopNode, lockstep=False)
    inner.fly()
    tick_of(inner, 1_000_000)
    assert "too old" not in inner.node.health.message
    for tick in (5, 6, 7):
        inner.send(
            topics.ODOM, tick, np.where(np.arange(CHANNELS[topics.ODOM].size) == 6, 1.0, 0.0)
        )
    assert inner.node.tick == 7
    expected = "the attitude setpoint is too old: trim attitude is held"
    assert (inner.node.health.level, inner.node.health.message) == (Level.WARN, expected)


def test_what_is_added_to_the_actuators_is_sent_before_them(bench):
    """As bags have the messages of a tick."""
    inner = bench(
        InnerLoopNode, excitation__frequency_hz=[1.0], excitation__amplitude=[0.01] + [0.0] * 3,
        excitation__phase_rad=[0.0] * 4, excitation__start_s=0.0,
    )  # fmt: skip
    inner.fly()
    tick_of(inner, 0)
    assert list(inner.sent) == [name for name in topics.SENDING_ORDER if name in inner.sent]
    assert topics.EXCITATION_ACTUATORS in inner.sent
