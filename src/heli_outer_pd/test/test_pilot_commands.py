# SPDX-License-Identifier: Apache-2.0
"""Joystick, velocity, modes by name, arming: followed, or refused in one sentence, without a graph.

What is refused leaves the flight as it was.
"""

import math
from functools import partial

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped, QuaternionStamped, TwistStamped
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from std_srvs.srv import SetBool, Trigger

from heli_core.rows import NAV, REFERENCE, SETPOINT
from heli_core.ticks import NS_PER_S
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import encode_joy
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.layouts import CHANNELS
from heli_outer_pd import KeyboardSticks, StickMap
from heli_outer_pd.joystick import KEY_BUTTONS
from heli_outer_pd.modes import Guard, Phase, RefusalCause
from heli_outer_pd.node import OuterLoopNode
from heli_outer_pd.position_health import plight
from heli_outer_pd.state import MEMORY

HOVER = np.array([0.0, 0.0, -10.0])
ROLL_RIGHT, FORWARD = (0.0, 0.0, -1.0, 0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 1.0, 0.0, 0.0)
REST = (0.0,) * 6
PACKAGED = StickMap.from_parameters(OuterLoopNode.SPEC.resolve())
BUTTON = PACKAGED.buttons


class Pilot:
    """Somebody who commands a node on a bench, and what it does."""

    def __init__(self, outer, position=HOVER):
        self.outer, self.node, self.tick = outer, outer.node, 0
        self.position, self.sigma_mps = position, 0.0
        outer.fly()
        self.fly(9)

    def fly(self, ticks):
        for _ in range(ticks):
            nav = np.zeros(CHANNELS[topics.ODOM].size)
            nav[NAV.pos], nav[NAV.quat] = self.position, [1.0, 0.0, 0.0, 0.0]
            # Of the horizontal velocity; the barometer knows the vertical one.
            nav[NAV.sigma_vel] = self.sigma_mps, self.sigma_mps, 0.0
            if self.tick % 2 == 0:
                self.outer.send(topics.ROTOR_SPEED, self.tick, np.array([193.73]))
            self.outer.send(topics.ODOM, self.tick, nav)
            self.tick += 1

    @property
    def phase(self):
        return self.node.run.phases.phase

    @property
    def answer(self):
        return self.node.health.message.removeprefix("message refused: ")

    def stamped(self, message, frame, late_s=0.0):
        stamp_ns = self.node.stamp_ns(self.node.tick) + round(late_s * NS_PER_S)
        message.header.frame_id = frame
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, NS_PER_S)
        return message

    def joy(self, axes=REST, *down, info=None):
        pressed = [int(i in [BUTTON[name] for name in down]) for i in range(15)]
        raw = serialize_message(encode_joy(axes, pressed, 5))
        (sticks,) = [s for s in self.node.subscriptions if s.topic_name == "/joy"]
        sticks.callback(raw, info)
        assert self.node.crash is None
        return self.answer

    def press(self, name):
        self.joy()
        return self.joy(REST, name)

    def move(self, linear=(0.0, 0.0, 0.0), turn=0.0, frame="map", late_s=0.0):
        message = self.stamped(TwistStamped(), frame, late_s)
        v = message.twist.linear
        v.x, v.y, v.z = linear
        message.twist.angular.z = turn
        self.outer.receive(topics.COMMAND_VELOCITY, serialize_message(message))
        self.fly(4)
        return self.answer

    def lean(self, roll_deg=0.0, pitch_deg=0.0, psi_deg=0.0, frame="map", late_s=0.0, length=1.0):
        """Command an attitude: nose up, and to the right of north."""
        message = self.stamped(QuaternionStamped(), frame, late_s)
        half = np.radians([roll_deg, -pitch_deg, 90.0 - psi_deg]) / 2.0
        (sx, sy, sz), (cx, cy, cz) = np.sin(half), np.cos(half)
        q = message.quaternion
        q.w = length * (cx * cy * cz + sx * sy * sz)
        q.x = length * (sx * cy * cz - cx * sy * sz)
        q.y = length * (cx * sy * cz + sx * cy * sz)
        q.z = length * (cx * cy * sz - sx * sy * cz)
        self.outer.receive(topics.COMMAND_ATTITUDE, serialize_message(message))
        self.fly(4)
        return self.answer

    def climb(self, up=0.0, east=0.0, frame="map", late_s=0.0):
        message = self.stamped(TwistStamped(), frame, late_s)
        message.twist.linear.z, message.twist.linear.x = up, east
        self.outer.receive(topics.COMMAND_CLIMB, serialize_message(message))
        self.fly(4)
        return self.answer

    def pose(self, enu):
        message = self.stamped(PoseStamped(), "map")
        p = message.pose.position
        p.x, p.y, p.z = enu
        message.pose.orientation.w = 1.0
        self.outer.receive(topics.COMMAND_POSE, message)
        return self.answer

    def ask(self, name, request=None, kind=Trigger):
        (service,) = [s for s in self.node.services if s.service_name == f"/{name}"]
        answer = service.callback(request or kind.Request(), kind.Response())
        return answer.message

    def arm(self, data):
        return self.ask("arm", SetBool.Request(data=data), SetBool)

    def set_mode(self, name):
        (result,) = self.node.set_parameters([Parameter("mode", value=name)])
        return result.reason


@pytest.fixture
def flying(bench):
    return Pilot(bench(OuterLoopNode))


@pytest.fixture
def standing(bench):
    return Pilot(bench(OuterLoopNode, start__on_ground=True), np.zeros(3))


IN_THE_AIR = [
    (lambda p: p.set_mode("atitude"), "mode 'atitude': no such mode; did you mean attitude?; "
     "allowed: takeoff, land, hold, hover, "),
    (lambda p: p.set_mode("goto"), "mode 'goto': needs a message of its own; allowed: hold, "),
    (lambda p: p.set_mode("takeoff"), "takeoff: the aircraft is in the air already; allowed: "),
    (lambda p: p.set_mode("manual"), "no sticks are heard; allowed: "),
    (lambda p: p.ask("takeoff"), "takeoff: the aircraft is in the air already; allowed: "),
    (lambda p: p.ask("mode/attitude"), "attitude: not in hover now: neither sticks nor an "
     "attitude are heard; allowed: "),
    (lambda p: p.press("takeoff"), "joy: takeoff: the aircraft is in the air already; allowed: "),
    (lambda p: p.arm(False), "disarm: not in hover; allowed: standing"),
    (lambda p: p.pose((80.0, 80.0, 10.0)), "command_pose: the goal is 113 m from where the flight "
     "began; allowed: at most 100 m"),
    (lambda p: p.pose((0.0, 0.0, 1.0)), "command_pose: the goal is 1.0 m high; allowed: 2 to"),
    (lambda p: p.pose((math.nan, 0.0, 10.0)), "command_pose: position [nan, "),
    (lambda p: p.move((math.nan, 0.0, 0.0)), "command_velocity: linear [nan, 0.0, 0.0], "),
    (lambda p: p.move(frame="odom"), "command_velocity: frame 'odom'; allowed: 'map' ("),
    (lambda p: (p.fly(100), p.move(late_s=-0.7))[1], "command_velocity: stamped 1.38 s, behind "
     "this node's clock, 2.08 s; allowed: 0.5 s before it to 0.04 s after it"),
    (lambda p: p.move(late_s=1.0), "command_velocity: stamped 2.08 s, ahead of this node's clock, "
     "1.08 s; allowed: 0.5 s before"),
    (lambda p: p.lean(length=math.nan), "command_attitude: quaternion [nan, "),
    (lambda p: p.lean(length=0.9), "command_attitude: a quaternion of length 0.9; allowed: 1"),
    (lambda p: p.lean(frame="base_link"), "command_attitude: frame 'base_link'; allowed: 'map' ("),
    (lambda p: p.lean(30.0), "command_attitude: roll 30.0 deg, pitch 0.0 deg nose up; allowed: "
     "roll -17.8 to 22.2 deg, pitch -20.0 to 20.0 deg"),
    (lambda p: p.lean(180.0), "command_attitude: roll 180.0 deg, "),
    (lambda p: p.lean(0.0, 90.0), "pitch 90.0 deg nose up; allowed: "),
    (lambda p: (p.fly(100), p.lean(late_s=-0.7))[1], "command_attitude: stamped 1.38 s, behind "
     "this node's clock, 2.08 s; allowed: 0.5 s before it to 0.04 s after it"),
    (lambda p: p.lean(late_s=1.0), "command_attitude: stamped 2.08 s, ahead of this node's clock, "
     "1.08 s; allowed: 0.5 s before"),
    (lambda p: p.climb(0.5), "climb: no commanded attitude is flown; allowed: beside "
     "command_attitude"),
    (lambda p: p.climb(0.5, east=1.0), "command_climb: linear [1.0, 0.0, 0.5], "),
    (lambda p: p.climb(frame="odom"), "command_climb: frame 'odom'; allowed: 'map', 'base_link'"),
    (lambda p: p.climb(0.5, late_s=1.0), "command_climb: stamped 2.08 s, ahead of this node's"),
    (lambda p: p.joy((0.0, 0.0, math.nan, 0.0)), "joy: axis 2 (roll) is nan; allowed: a number"),
    (lambda p: p.joy((0.0, 0.0)), "joy: roll is on axis 2, the joystick has 2 axes; allowed: "),
    (lambda p: p.joy((0.0, 0.0, 7.0, 0.0)), "joy: axis 2 (roll) is 7; allowed: -1 to 1"),
    (lambda p: (p.joy(), p.joy(REST, "hold", "land"))[1], "joy: the buttons of hold and land were "
     "pressed at once; allowed: one at a time"),
]  # fmt: skip
ON_THE_GROUND = [
    (lambda p: p.ask("land"), "land: the aircraft has landed already; allowed: takeoff"),
    (lambda p: p.set_mode("hover"), "hold: the aircraft is on the ground: take off first"),
    (lambda p: p.press("land"), "joy: land: the aircraft has landed already; allowed: takeoff"),
    (lambda p: p.move((1.0, 0.0, 0.0)), "velocity: the aircraft is on the ground: take off first"),
    (lambda p: p.lean(3.0), "attitude: the aircraft is on the ground: take off first"),
    (lambda p: p.pose((1.0, 0.0, 10.0)), "goto: the aircraft is on the ground: take off first"),
    (lambda p: (p.arm(False), p.ask("takeoff"))[1], "takeoff: the aircraft is disarmed; allowed: "
     "arm"),
    (lambda p: (p.arm(False), p.joy(), p.set_mode("manual"))[2], "manual: the aircraft is "
     "disarmed; allowed: arm"),
]  # fmt: skip


def refused(pilot, asks, sentence):
    before, way = pilot.phase, pilot.node._followed()
    assert sentence in asks(pilot)
    assert "\n" not in asks(pilot)
    pilot.fly(4)
    assert pilot.phase == before and pilot.node._followed() is way


@pytest.mark.parametrize(
    ("asks", "sentence"), IN_THE_AIR, ids=[sentence[:50] for _, sentence in IN_THE_AIR]
)
def test_in_the_air_it_is_refused_and_the_flight_as_it_was(flying, asks, sentence):
    refused(flying, asks, sentence)


@pytest.mark.parametrize(
    ("asks", "sentence"), ON_THE_GROUND, ids=[sentence[:50] for _, sentence in ON_THE_GROUND]
)
def test_on_the_ground_it_is_refused_and_nothing_moves(standing, asks, sentence):
    refused(standing, asks, sentence)
    assert (
        standing.outer.sent[topics.COLLECTIVE][-1]
        == standing.node.values["takeoff.idle_collective"]
    )


def test_a_velocity_that_cannot_stop_inside_the_fence_is_refused(bench):
    never = {"failsafe__unfollowed_deg": [180.0, 180.0]}  # the aircraft here never moves
    pilot = Pilot(bench(OuterLoopNode, reference_limits__distance_m=4.0, **never))
    answers = [pilot.move((3.0, 0.0, 0.0)) for _ in range(50)]
    assert answers[0] == "velocity" and answers[-1].endswith(": at most 4 m")
    assert 2.0 < pilot.node.run.diverted.points[-1, REFERENCE.pos][1] < 4.0, "it halts inside"
    pilot.fly(800)
    assert pilot.phase == Phase.HOVER


def test_a_second_pilot_is_named_and_not_followed(flying, monkeypatch):
    """The first one is; by the numbers of its messages, as DDS does not say whose they are."""
    pilots = [("/", "one")]
    monkeypatch.setattr("heli_msgs_bridge.tick_node.senders_of", lambda node, topic: pilots)
    monkeypatch.setattr(flying.node, "count_publishers", lambda name: len(pilots))
    hear = lambda number, *down: flying.joy(  # noqa: E731
        REST, *down, info={"publication_sequence_number": number}
    )
    hear(1)
    hear(2)
    pilots.append(("/", "two"))
    for number in (1, 2, 3):
        hear(number, *(["land"] if number == 2 else []))
    assert flying.phase == Phase.HOVER
    assert flying.node.core.pace is not None
    senders = flying.node.core.senders["joy"]
    assert (senders.names, senders.ignored) == (("/one", "/two"), 3)
    hear(3, "land")
    assert flying.phase == Phase.HALTING, "the first one is obeyed"


def test_a_velocity_is_flown_and_ends_in_a_hover(flying):
    flying.move((0.0, 1.5, 0.0))
    assert flying.phase == Phase.VELOCITY
    for _ in range(50):
        flying.move((0.0, 1.5, 0.0))
    vel = flying.node.run.diverted.at(flying.node.stamp_ns(flying.node.tick) + NS_PER_S // 2)
    np.testing.assert_allclose(vel[REFERENCE.vel], [1.5, 0.0, 0.0], atol=0.02)
    pitch = np.array(flying.outer.sent[topics.ATTITUDE_SETPOINT])[:, 1]
    assert pitch[-1] < pitch[0] - 0.02, "to the north, the nose goes down"
    flying.fly(100)
    assert flying.phase == Phase.HOVER


def test_forward_in_the_own_frame_is_north_where_the_nose_is(flying):
    flying.move((1.0, 0.0, 0.0), frame="base_link")
    later = flying.node.run.diverted.at(flying.node.stamp_ns(flying.node.tick) + NS_PER_S)
    assert later[REFERENCE.vel][0] > 0.1 and abs(later[REFERENCE.vel][1]) < 1e-9


def test_an_attitude_is_flown_as_it_is_sent_and_ends_in_a_hover(flying):
    for _ in range(60):
        assert flying.lean(8.0, -3.0, 25.0) == "attitude"
        flying.climb(0.5)
    assert flying.phase == Phase.ATTITUDE
    flown = np.degrees(flying.outer.sent[topics.ATTITUDE_SETPOINT][-1])
    np.testing.assert_allclose(flown, [8.0, -3.0, 25.0], atol=0.05)
    state = flying.node.core.state
    assert state.x[MEMORY.steer_down_vel] == pytest.approx(-0.5, abs=1e-6)
    done = flying.ask("mode/attitude")
    assert done.startswith("attitude: ") and topics.COMMAND_ATTITUDE in done
    flying.fly(100)
    assert flying.phase == Phase.HOVER


def test_a_pilot_takes_over_from_messages_by_a_button_too(flying):
    for _ in range(5):
        flying.joy()
        flying.lean(8.0)
    flying.joy()
    assert flying.node.run.phases.sticks.steering.asked.leads
    flying.joy(REST, "attitude")
    assert RefusalCause.PILOT_STEERS.value in flying.lean(8.0)
    done = flying.ask("mode/attitude")
    assert done.startswith("attitude: ") and done.endswith(" sticks say")
    assert flying.phase == Phase.ATTITUDE


def test_sticks_fly_the_attitude_and_a_button_ends_it(flying):
    flying.press("attitude")
    assert flying.phase == Phase.ATTITUDE
    for _ in range(30):
        flying.joy(ROLL_RIGHT)
        flying.fly(4)
    attitudes = np.array(flying.outer.sent[topics.ATTITUDE_SETPOINT])
    tilt = math.radians(flying.node.values["sticks.tilt_max_deg"])
    trim = flying.node.core.params.trim
    assert attitudes[-1, 0] == pytest.approx(trim[SETPOINT.phi] + tilt, abs=0.02)
    assert attitudes[-1, 1] == pytest.approx(trim[SETPOINT.theta], abs=0.02)
    flying.press("hold")
    assert flying.phase == Phase.HOVER


@pytest.mark.parametrize(
    "asks",
    [
        lambda p: p.set_mode("attitude"),
        lambda p: p.ask("mode/attitude"),
        lambda p: p.press("attitude"),
    ],
)
def test_a_mode_by_parameter_by_service_and_by_button_is_the_same(flying, asks):
    flying.joy()
    asks(flying)
    assert flying.phase == Phase.ATTITUDE


def test_a_mode_may_be_set_twice(flying):
    for _ in range(2):
        assert flying.set_mode("hover") == ""
    assert flying.phase == Phase.HOVER


def test_who_is_armed_again_takes_off(standing):
    assert standing.arm(False).startswith("disarm: ") and not standing.node.core.armed
    standing.fly(100)
    assert standing.node.health.facts["armed"] is False
    standing.outer.again()
    standing.fly(9)
    assert RefusalCause.DISARMED.value in standing.ask("takeoff"), "for as long as the node lives"
    assert standing.arm(True).startswith("arm: ") and standing.node.core.armed
    standing.ask("takeoff")
    assert standing.phase == Phase.SPOOLING
    assert standing.arm(False).endswith("; allowed: standing") and standing.node.core.armed


def test_a_button_that_is_down_when_the_flight_begins_is_not_obeyed(flying):
    flying.joy(REST, "land")
    assert flying.phase == Phase.HOVER
    flying.outer.again()
    flying.fly(9)
    flying.joy(REST, "land")
    assert flying.phase == Phase.HOVER


def test_a_joystick_may_be_laid_out_anew_in_flight(flying):
    ask = partial(Parameter, "joy.roll.axis")
    taken = flying.node.set_parameters_atomically([ask(value=3)])
    assert not taken.successful and " axis 3" in taken.reason
    assert flying.node.set_parameters_atomically([ask(value=4)]).successful
    flying.press("attitude")
    for _ in range(10):
        flying.joy((0.0, 0.0, 0.0, 0.0, -1.0, 0.0))
        flying.fly(4)
    roll = np.array(flying.outer.sent[topics.ATTITUDE_SETPOINT])[:, 0]
    assert roll[-1] > roll[0] + 0.1


def test_before_the_flight_a_mode_is_refused(bench):
    outer = bench(OuterLoopNode)
    (result,) = outer.node.set_parameters([Parameter("mode", value="hover")])
    assert result.reason == f"mode: {RefusalCause.INACTIVE.value}"
    assert outer.node.health.level == Level.OK


@pytest.mark.parametrize(
    ("key", "stick", "sign"),
    [
        ("w", "climb", 1), ("s", "climb", -1), ("a", "yaw", -1), ("d", "yaw", 1),
        ("\x1b[A", "pitch", -1), ("\x1b[B", "pitch", 1),
        ("\x1b[C", "roll", 1), ("\x1b[D", "roll", -1),
    ],
)  # fmt: skip
def test_keys_move_the_sticks_of_the_packaged_layout(key, stick, sign):
    keys = KeyboardSticks()
    keys.press(key, 0.0)
    sticks, _ = PACKAGED.read(*keys.read(0.0))
    moved = {name: np.sign(value) for name, value in sticks._asdict().items() if value}
    assert moved == {stick: sign}


def test_keys_press_the_buttons_of_the_packaged_layout():
    commands = {"t": "takeoff", "l": "land", "h": "hold", "v": "velocity", "f": "attitude"}
    commands |= {"m": "manual"}
    assert {key: PACKAGED.buttons[name] for key, name in commands.items()} == KEY_BUTTONS


def test_a_landing_is_obeyed_without_a_position_and_says_how(flying):
    flying.sigma_mps = 1.0
    flying.fly(8)
    health = flying.node.health
    assert health.level == Level.WARN
    assert health.message == plight(Phase.HOVER)
    reason = Guard.NAVIGATION.value
    assert f"{reason}; allowed: land" in flying.ask("hold")
    flying.pose((3.0, 0.0, 10.0))
    assert reason in flying.node.core.refused[topics.COMMAND_POSE]
    assert reason in flying.set_mode("hold")
    expected = plight(Phase.DESCENDING)
    assert flying.ask("land") == f"land: {expected}"
    flying.fly(8)
    assert (flying.node.health.level, flying.node.health.message) == (Level.WARN, expected)
