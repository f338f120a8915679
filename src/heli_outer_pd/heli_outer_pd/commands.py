# SPDX-License-Identifier: Apache-2.0
"""What pilots ask of the outer loop: by topics, by services, by the parameter `mode`.

Each is done, or refused in one sentence and the flight goes on as before.
"""

from collections.abc import Callable
from enum import Enum
from typing import Any, NamedTuple

import numpy as np

from heli_core.errors import StickError
from heli_core.rotations import euler_from_quat
from heli_core.rows import NAV, REFERENCE
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_core.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import (
    VelocityCommand,
    decode_attitude,
    decode_climb,
    decode_goal,
    decode_goto,
    decode_goto_gps,
    decode_joy,
    decode_velocity,
    encode_reference,
    key_of,
)
from heli_msgs_bridge.layouts import MessageError
from heli_msgs_bridge.lockstep import AHEAD_TICKS, stamp_refusal
from heli_outer_pd.joystick import Presses, StickMap
from heli_outer_pd.modes import (
    SERVED,
    Command,
    Guard,
    Phase,
    Refusal,
    RefusalCause,
    command_named,
    decide,
)
from heli_outer_pd.position_health import plight
from heli_outer_pd.reference import ReferenceRefused

MODE = "mode"
"""Parameter that commands by name when it is set."""
ARM = "arm"
_POSITION = "position"
_ARMED, _DISARMED = "a take-off is obeyed", "the collective stays at idle until it is armed"
_LEAVE = (Command.TAKEOFF, Command.MANUAL)
"""Commands that leave the ground."""
_STEERED = {
    Command.ATTITUDE: "roll, pitch, turn and climb as the sticks say",
    Command.MANUAL: "the sticks move the actuators; the yaw gyro alone helps",
}
_BY_MESSAGES = (
    f"roll, pitch and heading as {topics.COMMAND_ATTITUDE} says, climb as {topics.COMMAND_CLIMB}"
)


class Answer(NamedTuple):
    """Whether a command is done, a sentence, and the name of the cause if it is not."""

    done: bool
    sentence: str
    cause: str = ""

    @classmethod
    def refused(cls, sentence: str, cause: Enum | None) -> "Answer":
        """It is not done."""
        return cls(False, sentence, "" if cause is None else cause.name)


class Commands:
    """Commands of a node `outer_loop`.

    Parameters
    ----------
    node : OuterLoopNode
    """

    def __init__(self, node: Any) -> None:
        self._node = node
        self._sticks, self._presses = StickMap.from_parameters(node.values), Presses()
        self._velocity: VelocityCommand | None = None

    def begin(self) -> None:
        """A flight begins: what was sent before it is not obeyed."""
        self._presses.forget()
        self._velocity = None

    def adopt(self, sticks: StickMap) -> None:
        """Another layout of the joystick."""
        self._sticks = sticks
        self._presses.forget()

    # --- topics ----------------------------------------------------------------------------------

    def on_goto(self, topic: str) -> Callable[[Any], None]:
        """The callback of a topic of poses: fly there; or refuse it, and go on as before."""

        def take(message: Any) -> None:
            node = self._node
            # Now: who sends once is gone when one looks later.
            node._name_commanders()
            self._go_to(message, topic)

        return take

    def _go_to(self, message: Any, topic: str) -> Answer:
        """Whether a place is flown to, and a sentence: where it is, or why not."""
        node, answer = self._node, None
        goal_of = self._goal_by_gps if topic == topics.GOTO_GPS else self._goal_of
        try:
            refused = self._do(Command.GOTO, goal_of(message, topic))
            if refused is not None:
                answer = Answer.refused(refused.sentence, refused.cause)
        except MessageError as error:
            answer = Answer.refused(str(error), error.cause)
        except ReferenceRefused as error:
            answer = Answer.refused(f"{topic}: {error}", error.cause)
        if answer is not None:
            node.refuse_aloud(topic, answer.sentence)
            return answer
        sentence = f"{topic}: {self.fly(node.run.phases.trajectory)}"
        node.get_logger().info(sentence)
        return Answer(True, sentence)

    def on_goal(self, message: Any) -> None:
        """Do what a command with an id asks, or refuse it; answer by the id, in /diagnostics."""
        node, goals = self._node, self._node.core.goals
        try:
            command, goal_id, argument = decode_goal(message)
        except MessageError as error:
            node.refuse_aloud(topics.GOAL, str(error))
            return
        if goals.knows(goal_id):
            return  # it is sent again until it is answered
        match asked := Command(command):
            case Command.GOTO:
                answer = self._go_to(argument, topics.GOTO)
            case Command.FOLLOW:
                answer = node.follow_goal(argument)
            case _:
                answer = self._asked(asked, argument)
                self._log(answer.done, answer.sentence)
        if answer.done:
            goals.begin(goal_id, asked, answer.sentence, node.run.phases)
        else:
            goals.refuse(goal_id, asked, answer.sentence, answer.cause)
        node.tell_goals()

    def on_velocity(self, message: Any) -> None:
        """Move so from the controller's next step on; or refuse it, and go on as before."""
        node, topic = self._node, topics.COMMAND_VELOCITY
        psi = euler_from_quat(node.core.nav[NAV.quat])[2]
        try:
            # Without navigation there is no heading; the command is refused for that.
            asked = decode_velocity(message, psi if np.isfinite(psi) else 0.0, node.get_namespace())
            self._check_renewed(topic, asked.stamp_ns)
        except MessageError as error:
            node.refuse_aloud(topic, str(error))
        except ReferenceRefused as error:
            node.refuse_aloud(topic, f"{topic}: {error}")
        else:
            self._velocity = asked

    def after_step(self) -> None:
        """Follow the velocity commanded last, if there was one since the controller's last step."""
        asked, self._velocity = self._velocity, None
        if asked is None:
            return
        node, topic = self._node, topics.COMMAND_VELOCITY
        now_ns, phases = node.stamp_ns(node.tick), node.run.phases
        try:
            refused = phases.velocity(
                asked.vel_ned_mps, asked.yaw_rate_radps, now_ns, node.core.nav
            )
        except ReferenceRefused as error:
            node.refuse_aloud(topic, f"{topic}: {error}")
            return
        if refused is not None:
            node.refuse_aloud(topic, refused.sentence)
        else:
            self.fly(phases.trajectory)

    def on_attitude(self, message: Any) -> None:
        """Fly this attitude from the controller's next step on, or refuse it and go on."""

        def take() -> Refusal | None:
            asked, node = decode_attitude(message), self._node
            self._check_renewed(topics.COMMAND_ATTITUDE, asked.stamp_ns)
            now_ns, nav = node.stamp_ns(node.tick), node.core.nav
            refused: Refusal | None = node.run.phases.attitude(asked.attitude_rad, now_ns, nav)
            return refused

        self._try(topics.COMMAND_ATTITUDE, take)

    def on_climb(self, message: Any) -> None:
        """Climb so beside an attitude; or refuse it, and go on as before."""

        def take() -> Refusal | None:
            node = self._node
            asked = decode_climb(message, node.get_namespace())
            self._check_renewed(topics.COMMAND_CLIMB, asked.stamp_ns)
            phases, now_ns = node.run.phases, node.stamp_ns(node.tick)
            refused: Refusal | None = phases.sticks.climb(phases.phase, asked.climb_mps, now_ns)
            return refused

        self._try(topics.COMMAND_CLIMB, take)

    def _check_renewed(self, topic: str, stamp_ns: int) -> None:
        """MessageError or ReferenceRefused unless what lives on renewal may be obeyed now."""
        self._check_held()
        self._check_stamp(topic, stamp_ns, self._node.values["command.timeout_s"])

    def _try(self, topic: str, take: Callable[[], Refusal | None]) -> None:
        """Do what a message asks, or say why not."""
        try:
            refused = take()
        except MessageError as error:
            self._node.refuse_aloud(topic, str(error))
        except ReferenceRefused as error:
            self._node.refuse_aloud(topic, f"{topic}: {error}")
        else:
            if refused is not None:
                self._node.refuse_aloud(topic, refused.sentence)

    def on_joy(self, message: Any) -> None:
        """Steer by a pilot's sticks, do what his buttons say."""
        node = self._node
        if not node.active:
            self._presses.forget()
            return
        try:
            sticks, down = self._sticks.read(*decode_joy(message))
            node.run.phases.steer(np.array(sticks), node.stamp_ns(node.tick))
            name = self._presses.pressed(down)
        except (StickError, ReferenceRefused) as error:
            node.refuse_aloud(topics.JOY, f"{topics.JOY}: {error}")
            return
        if name == Command.ATTITUDE:
            node.run.phases.sticks.steering.lead_by_sticks()
        if name is not None:
            self._obey(Command(name), topics.JOY)

    # --- services and the parameter `mode` -------------------------------------------------------

    def service(self, command: Command) -> Callable[[Any, Any], Any]:
        """The callback of a command's service: done, or refused, in a sentence."""

        def answer(request: Any, response: Any) -> Any:
            response.success, response.message, _ = self._asked(command)
            self._log(response.success, response.message)
            return response

        return answer

    def arm(self, request: Any, response: Any) -> Any:
        """The callback of the service that arms and disarms; disarming is for the ground."""
        node = self._node
        asked = "arm" if request.data else "disarm"
        phase = node.run.phases.phase if node.active else Phase.STANDING
        if not request.data and phase != Phase.STANDING:
            response.message = f"{asked}: not in {phase.mode}; allowed: {Phase.STANDING}"
        elif not request.data and node.active and node.run.phases.next_order_ns() is not None:
            response.message = f"{asked}: commands.* are still to come; allowed: after the last"
        else:
            node.core.armed, response.success = request.data, True
            response.message = f"{asked}: {_ARMED if request.data else _DISARMED}"
        self._log(response.success, response.message)
        return response

    def origin(self, request: Any, response: Any) -> Any:
        """The callback of the service that tells where `map` begins, as a YAML mapping."""
        place, response.success = self._node.core.origin, True
        response.message = (
            f"{{latitude_deg: {place.lat_deg!r}, longitude_deg: {place.lon_deg!r}, "
            f"altitude_m: {place.alt_m!r}}}"
        )
        return response

    def judge_mode(self, name: str) -> None:
        """Whether a mode may be commanded by this name now; ValueError says why not."""
        named = command_named(name)
        if isinstance(named, Refusal):
            raise ValueError(named.sentence)
        if named not in SERVED:
            others = ", ".join(SERVED)
            raise ValueError(f"{MODE} {name!r}: needs a message of its own; allowed: {others}")
        try:
            self._check_held()
        except ReferenceRefused as error:
            raise ValueError(f"{named}: {error}") from None
        node = self._node
        phases = node.run.phases
        fails = phases.fails(node.stamp_ns(node.tick), node.core.nav)
        decision = self._disarmed(named) or decide(phases.phase, named, fails)
        if isinstance(decision, Refusal):
            raise ValueError(decision.sentence)

    def obey_mode(self, name: str) -> None:
        """Do what was judged; between the two a tick may have passed."""
        named = command_named(name)
        assert isinstance(named, Command)  # it was judged
        self._obey(named, MODE)

    def _obey(self, command: Command, source: str) -> None:
        """Do what nobody waits for an answer to."""
        answer = self._asked(command)
        if answer.done:
            self._node.get_logger().info(f"{source}: {answer.sentence}")
        else:
            self._node.refuse_aloud(source, f"{source}: {answer.sentence}")

    def _asked(self, command: Command, height_m: float | None = None) -> Answer:
        """Whether a command is done, and a sentence: what follows, or why not.

        A take-off may have a height of its own.
        """
        try:
            self._check_held()
            refused = self._do(command) if height_m is None else self._take_off(height_m)
        except ReferenceRefused as error:
            return Answer.refused(f"{command}: {error}", error.cause)
        if refused is not None:
            return Answer.refused(refused.sentence, refused.cause)
        return Answer(True, f"{command}: {self._done(command)}")

    def _log(self, done: bool, sentence: str) -> None:
        logger = self._node.get_logger()
        # rclpy ties a severity to the calling line: two lines are needed.
        if done:
            logger.info(sentence)
        else:
            logger.warning(sentence)

    # --- references ------------------------------------------------------------------------------

    def refusal_of_reference(self) -> Refusal | None:
        """Why no reference is followed now; None if one is."""
        phases = self._node.run.phases
        fails = {Guard.NAVIGATION} if phases.lost else set[Guard]()
        if phases.fence_distance_m > 0.0:
            fails.add(Guard.FENCE)
        decision = decide(phases.phase, Command.FOLLOW, fails)
        return decision if isinstance(decision, Refusal) else None

    def fly(self, trajectory: Trajectory) -> str:
        """Follow a way from now on and tell it as a reference; a sentence about its end."""
        node = self._node
        run, message = node.run, encode_reference(trajectory, node.get_namespace())
        run.diverted = trajectory
        key = key_of(message)
        node.core.unheard_keys.append(key)
        node.core.trajectories.append((node.stamp_ns(node.tick + 1), key))
        node.core.send_trajectory(message)
        last, end_ns = trajectory.points[-1], trajectory.start_ns + trajectory.times_ns[-1]
        north, east, down = last[REFERENCE.pos]
        return (
            f"to {east:.2f} m east, {north:.2f} m north, {-down:.2f} m high, heading "
            f"{np.degrees(last[REFERENCE.psi]):.0f} deg, there in "
            f"{max(end_ns - node.stamp_ns(node.tick), 0) / NS_PER_S:.1f} s"
        )

    def _done(self, command: Command) -> str:
        """What follows from a command that is done."""
        node = self._node
        phases = node.run.phases
        numbers = phases.numbers
        if command == Command.TAKEOFF:
            return (
                f"collective in {numbers.spool_up_ns / NS_PER_S:g} s, then up by "
                f"{phases.climb_m:g} m at {numbers.climb.climb_mps:g} m/s"
            )
        if command == Command.LAND and phases.phase.on_ground:
            return "take-off broken off, the collective goes down"
        if command == Command.ATTITUDE and phases.sticks.steering.asked.leads:
            return _BY_MESSAGES
        if command in _STEERED:
            return _STEERED[command]
        destination = self.fly(phases.trajectory)
        if command == Command.LAND and phases.lost:
            return plight(phases.phase)
        if command == Command.LAND:
            return f"comes to rest {destination}, then down at {numbers.descent.climb_mps:g} m/s"
        return destination

    def _do(self, command: Command, goal: Any = None) -> Refusal | None:
        node = self._node
        now_ns, nav = node.stamp_ns(node.tick), node.core.nav
        return self._disarmed(command) or node.run.phases.command(command, now_ns, nav, goal)

    def _take_off(self, height_m: float) -> Refusal | None:
        node = self._node
        now_ns, nav = node.stamp_ns(node.tick), node.core.nav
        refused = self._disarmed(Command.TAKEOFF)
        return refused or node.run.phases.take_off(height_m, now_ns, nav)

    def _disarmed(self, command: Command) -> Refusal | None:
        """Why nothing that raises the collective is done while it stands disarmed."""
        node = self._node
        leaves = command in _LEAVE and node.run.phases.phase == Phase.STANDING
        if node.core.armed or not leaves:
            return None
        cause = RefusalCause.DISARMED
        return Refusal(command.value, cause, cause.value, (ARM,))

    def _goal_of(self, message: Any, topic: str) -> tuple[np.ndarray, float]:
        """Position and heading; MessageError or ReferenceRefused says why there are none."""
        goal = decode_goto(message, topic)
        self._check_goal(topic, goal.stamp_ns)
        return goal.pos_ned_m, goal.psi_rad

    def _goal_by_gps(self, message: Any, topic: str) -> tuple[np.ndarray, float]:
        """The same of a place by latitude and longitude; the heading stays as it is."""
        node = self._node
        goal = decode_goto_gps(message, node.core.origin)
        self._check_goal(topic, goal.stamp_ns)
        now = node.run.phases.trajectory.at(node.stamp_ns(node.tick))
        return goal.pos_ned_m, float(now[REFERENCE.psi])

    def _check_goal(self, topic: str, stamp_ns: int) -> None:
        """MessageError or ReferenceRefused unless a place may be flown to; zero stands for now."""
        self._check_held()
        # Without a stamp it means now, as by the action, and as `ros2 topic pub` sends it.
        if stamp_ns:
            self._check_stamp(topic, stamp_ns, self._node.values["goto.max_age_s"])

    def _check_stamp(self, topic: str, stamp_ns: int, most_s: float) -> None:
        """MessageError unless a stamp is of the flight's time and young enough."""
        node = self._node
        now_ns, ahead_ns = node.stamp_ns(node.now_tick), AHEAD_TICKS * TICK_NS
        oldest_ns = max(now_ns - round(most_s * NS_PER_S), node.start_ns)
        if not oldest_ns <= stamp_ns <= now_ns + ahead_ns:
            raise MessageError(
                f"{stamp_refusal(topic, stamp_ns, now_ns, node.start_ns)}; allowed: "
                f"{most_s:g} s before it to {ahead_ns / NS_PER_S:g} s after it"
            )

    def _check_held(self) -> None:
        """ReferenceRefused unless a position is held, in the air or on the ground."""
        node = self._node
        if not node.active:
            raise _refused(RefusalCause.INACTIVE)
        if node.values["horizontal"] != _POSITION:
            raise ReferenceRefused(
                RefusalCause.NO_POSITION_LOOP,
                f"horizontal is {node.values['horizontal']}; allowed: {_POSITION}",
            )
        if not node.run.engaged or node.run.phases.trajectory is None:
            raise _refused(RefusalCause.NO_NAVIGATION_YET)


def _refused(cause: RefusalCause) -> ReferenceRefused:
    """A refusal that has no numbers."""
    return ReferenceRefused(cause, cause.value)
