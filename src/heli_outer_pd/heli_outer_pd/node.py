# SPDX-License-Identifier: Apache-2.0
"""Node `outer_loop`: reference and odometry to attitude setpoint and collective, 50 Hz."""

import sys
import time
from collections import deque
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
from std_srvs.srv import SetBool, Trigger

from heli_core.inbox import NOTHING, Inbox, deliver, empty_inbox
from heli_core.rotations import euler_from_quat
from heli_core.rows import NAV, REFERENCE, SETPOINT
from heli_core.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import (
    decode_reference,
    encode_home,
    encode_origin,
    encode_reference,
    key_of,
)
from heli_msgs_bridge.diagnostics import (
    FACT_ARMED,
    FACT_CLIMB,
    FACT_FAILSAFE,
    FACT_GOALS,
    FACT_HOME,
    FACT_LANDED,
    FACT_LAW_FAILED,
    FACT_MODE,
    FACT_OFFSET,
    FACT_WAYS,
    Level,
)
from heli_msgs_bridge.frames import Datum, datum
from heli_msgs_bridge.layouts import MessageError
from heli_msgs_bridge.lifecycle_node import NodeSpec
from heli_msgs_bridge.lockstep import Arrived, Demand
from heli_msgs_bridge.message_size import MOST_WAY_BYTES
from heli_msgs_bridge.node_process import run
from heli_msgs_bridge.sources import NOT_YET_NAMED, EverSent, TopicSenders
from heli_msgs_bridge.tick_node import Input, Send, TickCore, TickNode
from heli_outer_pd.commands import ARM, MODE, Answer, Commands
from heli_outer_pd.goals import Goals
from heli_outer_pd.goto import Goto, PhaseNumbers, outside
from heli_outer_pd.joystick import StickMap
from heli_outer_pd.manual_controller import with_manual
from heli_outer_pd.modes import SERVED, RefusalCause
from heli_outer_pd.outer_loop import (
    ENGAGEMENT,
    HELD,
    INPUTS,
    MOVED,
    NOT_DUE,
    OuterLoopState,
    begins,
    initial_loop,
    step,
)
from heli_outer_pd.parameters import NODE_NAME, TABLE, outer_params
from heli_outer_pd.phases import ActiveOuterLoop, Phases
from heli_outer_pd.position_health import answer, flown_in_words
from heli_outer_pd.python_controller import OwnPositionLaw, own_law
from heli_outer_pd.reference import ReferenceLimits, ReferenceRefused, warm_up
from heli_outer_pd.script import script_of
from heli_outer_pd.state import (
    MACHINE,
    MEMORY,
    SERVO_NOMINAL,
    OuterParams,
    OuterState,
    OuterStatus,
)

# -------------------------------------------------------------------------------------------------
# What the node `outer_loop` has while it is configured.
# -------------------------------------------------------------------------------------------------

COMMANDS = (topics.REFERENCE, topics.GOTO, topics.GOTO_GPS, topics.COMMAND_POSE)
"""Topics on which references and goals come."""
UNHEARD = topics.BY_NAME[topics.REFERENCE].kept
"""References of its own that may be under way to itself."""
# References that diagnostics name; once a second is often enough for those of a loaded recorder.
_TOLD = 16


@dataclass(kw_only=True)
class ConfiguredOuterLoop(TickCore):
    """What the outer loop has while it is configured.

    Attributes
    ----------
    commands : Commands
        What pilots ask, done or refused.
    params : OuterParams
        Numbers of the controller; swapped when parameters change.
    loop : OuterLoopState
        What the outer loop knows; of it `state` is the controller's, `nav` the navigation that the
        controller has flown by, `offset_ned_m` by how much the reference was moved where the
        controller engaged (None before).
    limits : ReferenceLimits
        What a reference may ask for.
    goto : Goto
        How a goto is flown.
    reference : Trajectory or None
        The reference, once it has come.
    trajectory : Trajectory or None
        What is followed of it: itself, or from where the controller has engaged.
    home_ned_m : (3,) array or None
        Where the first reference began, or the first position that was held without one.
    inbox : Inbox
        What has come for a tick.
    out : (4,) array
        The controller's last command.
    commanders : dict of EverSent
        Per topic of commands who sends them, or has sent one.
    send_trajectory : callable
        Sends a way that is followed as a reference.
    unheard_keys : deque of int
        References of this node that it has not yet heard back, each by its key.
    followed : deque of int
        Those of others that were followed.
    trajectories : deque of (int, int)
        Of both the newest, each with the stamp from which it counts, ns, before its key.
    repeated : list of int
        Of those, what a predecessor has heard and this node will hear once more.
    armed : bool
        Whether a take-off is obeyed.
    send_home : callable
        Sends where the flight began.
    origin : Datum
        Where `map` begins.
    landed : bool
        Whether it stands, as it was told last.
    told_home_ned_m : list of float
        Where the flight began, as it was told last; empty before.
    goals : Goals
        Commands with an id, and what has become of them.
    flies : OwnPositionLaw
        The controller's place, taken by one in Python or by none.
    """

    commands: Commands
    params: OuterParams
    loop: OuterLoopState
    send_attitude: Send
    send_collective: Send
    send_trajectory: Callable[[Any], None]
    send_home: Callable[[Any], None]
    origin: Datum
    limits: ReferenceLimits
    goto: Goto
    inbox: Inbox = field(default_factory=lambda: empty_inbox(len(INPUTS)))
    reference: Trajectory | None = None
    trajectory: Trajectory | None = None
    home_ned_m: np.ndarray | None = None
    out: np.ndarray = field(default_factory=lambda: np.zeros(SETPOINT.size))
    commanders: dict[str, EverSent] = field(
        default_factory=lambda: {t: EverSent() for t in COMMANDS}
    )
    unheard_keys: deque[int] = field(default_factory=lambda: deque(maxlen=UNHEARD))
    followed: deque[int] = field(default_factory=lambda: deque(maxlen=UNHEARD))
    trajectories: deque[tuple[int, int]] = field(default_factory=lambda: deque(maxlen=_TOLD))
    repeated: list[int] = field(default_factory=list)
    armed: bool = True
    landed: bool = False
    told_home_ned_m: list[float] = field(default_factory=list)
    goals: Goals = field(default_factory=Goals)
    flies: OwnPositionLaw = field(default_factory=lambda: OwnPositionLaw(None))

    @property
    def state(self) -> OuterState:
        """State of the controller."""
        return self.loop.law

    @property
    def nav(self) -> np.ndarray:
        """Navigation row (31,) that the controller has flown by."""
        return self.loop.nav

    @property
    def engaged(self) -> bool:
        """Whether the controller has had a position; from then on the reference stays put."""
        return bool(self.loop.engagement[ENGAGEMENT.tick] != NOTHING)

    @property
    def offset_ned_m(self) -> np.ndarray | None:
        """From `reference` to `trajectory`, NED, m; None until the controller has engaged."""
        return self.loop.offset_ned_m if self.engaged else None


# -------------------------------------------------------------------------------------------------
# Node.
# -------------------------------------------------------------------------------------------------

_ORIGIN = ("latitude_deg", "longitude_deg", "altitude_m")
_COMMANDERS_PERIOD_S = 1.0
_WAITS = "waits for navigation: the trim is commanded"
Judged = tuple[tuple[PhaseNumbers, Goto, OuterParams, ReferenceLimits], StickMap]
"""What a change of parameters makes of the node."""
_NOWHERE = Trajectory.hover(np.zeros(3), 0.0)


class OuterLoopNode(TickNode[ConfiguredOuterLoop, ActiveOuterLoop]):
    """Active means: the reference is followed; without one, the position of activation is held."""

    SPEC = NodeSpec(NODE_NAME, "heli_outer_pd", TABLE, f"{NODE_NAME}.yaml")

    def configure(self) -> ConfiguredOuterLoop:
        """Build the controller, its outputs and inputs."""
        kernel, commands = outer_params(self.values), Commands(self)
        core = ConfiguredOuterLoop(
            commands=commands,
            params=kernel,
            loop=self._initial_loop(kernel),
            send_attitude=self.create_sender(topics.ATTITUDE_SETPOINT),
            send_collective=self.create_sender(topics.COLLECTIVE),
            send_trajectory=self._way_teller(),
            send_home=self._latched(topics.HOME),
            origin=datum(*(self.values[f"origin.{name}"] for name in _ORIGIN)),
            limits=ReferenceLimits.from_parameters(self.values),
            goto=Goto.from_parameters(self.values),
            flies=own_law(self.values["own_law"]),
            pace=self.listen((Input(topics.ODOM, Demand()), self._rotor_speed())),
        )
        script_of(self.values)  # now: an order that cannot be is no matter of the flight
        self._warm_up(core)
        self.hear_commands(topics.REFERENCE, self._on_reference, MOST_WAY_BYTES)
        for topic in (topics.GOTO, topics.GOTO_GPS, topics.COMMAND_POSE):
            self.hear_commands(topic, commands.on_goto(topic))
        self.hear_commands(topics.GOAL, commands.on_goal, MOST_WAY_BYTES)
        self.hear_one(topics.COMMAND_VELOCITY, commands.on_velocity)
        self.hear_one(topics.COMMAND_ATTITUDE, commands.on_attitude)
        self.hear_one(topics.COMMAND_CLIMB, commands.on_climb)
        self.hear_one(topics.JOY, commands.on_joy)
        for command, name in SERVED.items():
            self.create_guarded_service(Trigger, name, commands.service(command))
        self.create_guarded_service(SetBool, ARM, commands.arm)
        self.create_guarded_service(Trigger, topics.ORIGIN, commands.origin)
        self._latched(topics.ORIGIN)(encode_origin(core.origin))
        self.create_wall_timer(_COMMANDERS_PERIOD_S, self._name_commanders)
        return core

    def _initial_loop(self, k: OuterParams) -> OuterLoopState:
        return initial_loop(k, self.values["navigation_timeout_s"], self.rate)

    def _rotor_speed(self) -> Input:
        every = self.rate.of(self.values["rotor_speed_period_ticks"])
        return Input(topics.ROTOR_SPEED, Demand(every))

    def _warm_up(self, core: ConfiguredOuterLoop) -> None:
        """Load the compiled controller before the first tick."""
        spare, points = self._initial_loop(core.params), _NOWHERE.points.copy()
        step(spare, core.inbox, 0, 1, 0, _NOWHERE.times_ns, points, core.params, core.out)
        encode_reference(core.goto.plan(_NOWHERE, 0, np.ones(3), 1.0))
        euler_from_quat(np.array([1.0, 0.0, 0.0, 0.0]))
        warm_up(core.params, spare.law)

    def _name_commanders(self) -> None:
        """Say who sends commands if they are several: each may, so all of them are followed."""
        for topic, commanders in self.core.commanders.items():
            commanders.look(self, topic)
            names = commanders.names(besides=self.get_fully_qualified_name())
            if self.respawns and NOT_YET_NAMED in names:
                # This node's predecessor stays in the graph for some seconds, dead and nameless.
                names.remove(NOT_YET_NAMED)
            if len(names) > 1:
                self.core.senders[topic] = TopicSenders(topic, tuple(names), each=True)
            else:
                # What had no name was of this node, or of the other one.
                self.core.senders.pop(topic, None)

    def _on_reference(self, message: Any) -> None:
        core = self.core
        key = key_of(message)
        if key in core.repeated:
            # Latched: the predecessor has heard it, and may have gone on to something else.
            core.repeated.remove(key)
            return
        if key in core.unheard_keys:
            core.unheard_keys.remove(key)
            return
        # Now: who sends once is gone when one looks later.
        self._name_commanders()
        trajectory, refused = self._judged_reference(message)
        if refused is None and self.active and core.reference is not None:
            refused = self._refused_now()
        if refused is not None:
            self.refuse_aloud(topics.REFERENCE, refused.sentence)
            return
        core.followed.append(key)
        core.trajectories.append((self.stamp_ns(self.tick + 1), key))
        self._follow_reference(trajectory)

    def _refused_now(self) -> Answer | None:
        """Why no reference is followed now; None if one is."""
        refused = self.core.commands.refusal_of_reference()
        return None if refused is None else Answer.refused(refused.sentence, refused.cause)

    def _judged_reference(self, message: Any) -> tuple[Trajectory, Answer | None]:
        """The way of a message; why it cannot be followed, or None."""
        core = self.core
        try:
            trajectory = decode_reference(message, self.get_namespace())
            home = (
                trajectory.points[0, REFERENCE.pos] if core.home_ned_m is None else core.home_ned_m
            )
            core.limits.judge(trajectory, home, self.stamp_ns(self.tick))
        except MessageError as error:
            return _NOWHERE, Answer.refused(str(error), error.cause)
        except ReferenceRefused as error:
            return _NOWHERE, Answer.refused(f"{topics.REFERENCE}: {error}", error.cause)
        return trajectory, None

    def _follow_reference(self, planned: Trajectory) -> None:
        core = self.core
        if core.home_ned_m is None:
            core.home_ned_m = planned.points[0, REFERENCE.pos].copy()
        core.reference, core.trajectory = planned, planned
        if not self.active or not self.run.phases.phase.on_ground:
            self._as_given(planned)
        core.pace.resume()

    def follow_goal(self, message: Any) -> Answer:
        """Whether the reference of a goal is followed, told then as one; and a sentence."""
        core = self.core
        trajectory, refused = self._judged_reference(message)
        if refused is None:
            cause = RefusalCause.INACTIVE
            inactive = Answer.refused(f"{topics.REFERENCE}: {cause.value}", cause)
            refused = self._refused_now() if self.active else inactive
        if refused is not None:
            self.refuse_aloud(topics.REFERENCE, refused.sentence)
            return refused
        reference = encode_reference(trajectory, self.get_namespace())
        key = key_of(reference)
        core.unheard_keys.append(key)
        core.trajectories.append((self.stamp_ns(self.tick + 1), key))
        self._follow_reference(trajectory)
        core.send_trajectory(reference)
        return Answer(True, f"{topics.REFERENCE}: followed")

    def tell_goals(self) -> None:
        """Say what has become of goals, at once."""
        health, self.urgent = self.health, True
        facts = {**health.facts, **self._goal_facts()}
        if self.active:
            facts[FACT_MODE] = self.run.phases.phase.mode
        self.report(health.level, health.message, facts, health.state)

    def _goal_facts(self) -> dict[str, str]:
        answers = self.core.goals.as_text()
        return {FACT_GOALS: answers} if answers else {}

    def _as_given(self, trajectory: Trajectory) -> None:
        """What is followed from now on is flown where it says, and no goto is any more."""
        self.core.loop.offset_ned_m[:] = 0.0
        if self.active:
            self.run.diverted = None
            self.run.phases.follow(trajectory, self.stamp_ns(self.tick))

    def _way_teller(self) -> Callable[[Any], None]:
        """Sends trajectories as references, so that bag, page and report know what is followed.

        Made before the flight: who listens has found it by the time of the first way.
        """
        publisher = self.create_publisher(
            topics.message_class(topics.BY_NAME[topics.REFERENCE].type),
            topics.REFERENCE,
            topics.qos(topics.REFERENCE),
        )
        self.at_end(partial(self.destroy_publisher, publisher))
        return publisher.publish

    def _latched(self, topic: str) -> Callable[[Any], None]:
        """Sends what who comes later gets, too."""
        cls = topics.message_class(topics.KNOWN[topic].type)
        publisher = self.create_publisher(cls, topic, topics.qos(topic))
        self.at_end(partial(self.destroy_publisher, publisher))
        return publisher.publish

    def _followed(self) -> Trajectory | None:
        """What is followed: a goto, a reference, or what was held at first."""
        return self.run.diverted or self.core.trajectory or self.run.held

    def is_ready(self) -> bool:
        """In lockstep a flight with a reference does not begin before it has come."""
        run = self.run
        if not run.awaits_reference or self.core.reference is not None:
            return True
        if time.monotonic() - run.begun_s > self.values["peer_timeout_s"]:
            run.awaits_reference = False
            self.get_logger().warning("no reference has come: the present position is held")
        return not run.awaits_reference

    def engage(self) -> ActiveOuterLoop:
        """Begin; wait for the reference only if somebody is there to send it."""
        core, loop = self.core, self._initial_loop(self.core.params)
        if core.reference is not None:
            # Where it has begun it stays, though the controller engages again.
            loop.engagement[ENGAGEMENT.tick] = core.loop.engagement[ENGAGEMENT.tick]
            loop.offset_ned_m[:] = core.loop.offset_ned_m
        core.loop = loop
        others = self.count_publishers(topics.REFERENCE) - 1  # it is one itself
        awaited = "scenario" in self.values["peers"] or others > 0
        return ActiveOuterLoop(time.monotonic(), awaited, self._phases())

    def _phases(self) -> Phases:
        """The phases of a flight that begins now."""
        core, numbers = self.core, PhaseNumbers.from_parameters(self.values)
        orders = script_of(self.values)
        core.commands.begin()
        core.goals.end()
        core.flies.begin()
        return Phases(
            numbers, core.goto, core.params, core.state, core.limits, orders, self.start_ns
        )

    def begin_anew(self) -> None:
        """Another flight: the controller restarts, and with it what is held without reference."""
        self.core.loop = self._initial_loop(self.core.params)
        self.core.trajectory = self.core.reference
        self.run.held, self.run.diverted, self.run.engaged = None, None, False
        self.run.phases = self._phases()

    def save_state(self) -> Any:
        """Law, references, and where the flight is between the ground and the ground."""
        core, run = self.core, self.run
        trajectories = (
            core.reference,
            core.trajectory,
            core.home_ned_m,
            core.followed,
            core.armed,
            core.goals,
        )
        engagement = core.loop.engagement, core.loop.offset_ned_m
        return core.state, engagement, trajectories, vars(run)

    def restore_state(self, content: Any, gap: bool) -> None:
        """Go on in the same phase, along the same reference."""
        core = self.core
        law, (engagement, offset_ned_m), trajectories, run = content
        engagement[ENGAGEMENT.velocity] |= gap
        core.loop = core.loop._replace(law=law, engagement=engagement, offset_ned_m=offset_ned_m)
        (
            core.reference,
            core.trajectory,
            core.home_ned_m,
            core.followed,
            core.armed,
            core.goals,
        ) = trajectories
        core.repeated = list(core.followed)
        self.run.take(run)

    def step(self, tick: int, arrived: Arrived) -> None:
        """Every `period_ticks` ticks: reference of now, controller, setpoint and collective."""
        core, stamp_ns = self.core, self.stamp_ns(tick)
        deliver(core.inbox, INPUTS, arrived)
        engaged = core.engaged
        trajectory = self._followed() if engaged else self._to_engage_on()
        assert trajectory is not None  # what the controller has engaged on is kept
        reference = stamp_ns - trajectory.start_ns, trajectory.times_ns, trajectory.points
        period_ticks = self.rate.of(self.values["period_ticks"])
        inputs = core.inbox, tick, period_ticks, *reference, core.params
        code = core.flies.step(core.loop, *inputs, core.out)
        if code == NOT_DUE:
            return
        if core.engaged and not engaged and core.reference is None:
            self.run.held = trajectory
            if core.home_ned_m is None:
                core.home_ned_m = core.nav[NAV.pos].copy()
        core.send_attitude(core.out[SETPOINT.attitude], stamp_ns)
        core.send_collective(with_manual(core.out[[SETPOINT.col]], core.state), stamp_ns)
        self._look(stamp_ns)
        self._tell(code)

    def _to_engage_on(self) -> Trajectory:
        """What the step that engages the controller flies as it is, moves, or fills in."""
        core, engagement = self.core, self.core.loop.engagement
        if core.trajectory is None:
            engagement[ENGAGEMENT.reference] = HELD
            return Trajectory.hover(np.zeros(3), 0.0)
        engagement[ENGAGEMENT.reference] = begins(self.values)
        if engagement[ENGAGEMENT.reference] == MOVED and core.trajectory is core.reference:
            core.trajectory = replace(core.trajectory, points=core.trajectory.points.copy())
        return core.trajectory

    def _look(self, stamp_ns: int) -> None:
        """After a step: what follows from it, and what was ordered for now."""
        core, run = self.core, self.run
        phases = run.phases
        if phases.trajectory is not None or not phases.numbers.on_ground:
            phases.trajectory = self._followed()
            phases.others = core.trajectory if run.diverted is None else None
            if core.home_ned_m is not None and not phases.numbers.on_ground:
                phases.home_ned_m = core.home_ned_m
        if phases.after(stamp_ns, core.nav, core.out) and phases.trajectory is not None:
            self.core.commands.fly(phases.trajectory)
        core.commands.after_step()
        self.urgent = core.goals.look(phases)
        self.urgent |= core.landed != phases.stands
        core.landed = phases.stands
        if phases.trajectory is not None and core.told_home_ned_m != phases.home_ned_m.tolist():
            core.told_home_ned_m, self.urgent = phases.home_ned_m.tolist(), True
            core.send_home(encode_home(phases.home_ned_m, stamp_ns))
        while phases.remarks:
            self.get_logger().warning(phases.remarks.pop(0))

    def _tell(self, code: int) -> None:
        status, core = OuterStatus(code), self.core
        message, phases = status.sentence, self.run.phases
        if status == OuterStatus.OK:
            self.run.engaged = True
            adrift = (
                phases.lost or phases.gone or core.state.machine[MACHINE.servo] != SERVO_NOMINAL
            )
            level = Level.WARN if adrift or phases.fence_distance_m > 0.0 else Level.OK
            message = flown_in_words(phases.phase, core.state, message)
            message = outside(phases.fence_distance_m, message)
        elif status == OuterStatus.BAD_NAVIGATION and not self.run.engaged:
            level, message = Level.OK, _WAITS
        else:
            level = Level.ERROR
        if core.flies.failure:
            level, message = Level.ERROR, core.flies.failure
        if self.urgent or self.tick % self.rate.hz == 0 or message != self.health.message:
            facts = {
                "reference": self._what(),
                FACT_MODE: self.run.phases.phase.mode,
                FACT_FAILSAFE: answer(phases.phase, core.state).name,
                FACT_WAYS: [list(trajectory) for trajectory in core.trajectories],
                FACT_ARMED: core.armed,
                FACT_LANDED: core.landed,
                FACT_HOME: core.told_home_ned_m,
                "wind_compensation": bool(self.values["wind_compensation"]),
                FACT_OFFSET: ([] if core.offset_ned_m is None else core.offset_ned_m.tolist()),
                "disturbance_ned_mps2": np.round(core.state.x[MEMORY.disturbance], 4).tolist(),
                **self._goal_facts(),
                **({} if phases.own_climb_m is None else {FACT_CLIMB: phases.own_climb_m}),
                **({FACT_LAW_FAILED: core.flies.failure} if core.flies.failure else {}),
            }
            self.warn_or_ok(level, message, facts)

    def _what(self) -> str:
        if self.run.diverted is not None:
            return "goto"
        return "held position" if self.core.reference is None else "given"

    def validate(self, values: Mapping[str, Any], changed: Collection[str]) -> Judged:
        """The changed controller and limits; what does not fit together raises."""
        if MODE in changed:
            if not self.configured:
                raise ValueError(f"{MODE}: {RefusalCause.INACTIVE.value}")
            self.core.commands.judge_mode(values[MODE])
        limits = ReferenceLimits.from_parameters(values)
        numbers = PhaseNumbers.from_parameters(values)
        flown = numbers, Goto.from_parameters(values), outer_params(values), limits
        return flown, StickMap.from_parameters(values)

    def apply(self, judged: Judged, changed: Collection[str]) -> None:
        """Swap the controller between two ticks; its state goes on. Limits are for what follows."""
        flown, sticks = judged
        if self.configured:
            _, self.core.goto, self.core.params, self.core.limits = flown
            self.core.commands.adopt(sticks)
        if self.active:
            self.run.phases.adopt(*flown)
        if MODE in changed:
            self.core.commands.obey_mode(self.values[MODE])


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_outer_pd outer_loop`."""
    return run(OuterLoopNode, args)


if __name__ == "__main__":
    sys.exit(main())
