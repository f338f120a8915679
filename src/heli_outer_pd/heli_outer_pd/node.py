# SPDX-License-Identifier: Apache-2.0
"""Node `outer_loop`: reference and odometry to attitude setpoint and collective, 25 Hz."""

import sys
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from std_srvs.srv import Trigger

from heli_math.rotations import euler_from_quat
from heli_math.rows import NAV, REFERENCE, SETPOINT
from heli_math.ticks import NS_PER_S, TICK_NS, TICKS_PER_S
from heli_math.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_OFFSET, Level
from heli_msgs_bridge.goto_message import decode_goto
from heli_msgs_bridge.lockstep import Demand
from heli_msgs_bridge.messages import MessageError
from heli_msgs_bridge.node_process import run
from heli_msgs_bridge.node_spec import NodeSpec
from heli_msgs_bridge.reference_message import decode_reference, encode_reference
from heli_msgs_bridge.senders import NOT_YET_NAMED, full_name, senders_of
from heli_msgs_bridge.stamps import AHEAD_TICKS, in_words
from heli_msgs_bridge.tick_node import Arrived, Input, Send, TickCore, TickNode
from heli_outer_pd.config import outer_kernel
from heli_outer_pd.goto import Goto
from heli_outer_pd.parameter_table import NODE_NAME, TABLE
from heli_outer_pd.position_law import (
    MEMORY,
    OuterKernel,
    OuterStatus,
    flyable,
    follow,
    initial_state,
)
from heli_outer_pd.reference import moved, offset_to
from heli_outer_pd.reference_limits import ReferenceLimits, ReferenceRefused

_COMMANDERS_PERIOD_S = 1.0
_COMMANDS = (topics.REFERENCE, topics.GOTO)
_WAITS = "waits for navigation: the trim is commanded"
_POSITION = "position"
HOLD = "hold"
"""Service: stop as soon as the limits of a goto allow, and stay there."""
_NOWHERE = Trajectory.hover(np.zeros(3), 0.0)


@dataclass(kw_only=True)
class Law(TickCore):
    """What the outer loop has while it is configured.

    Attributes
    ----------
    kernel : OuterKernel
        Numbers of the law; swapped when parameters change.
    state : array
        State of the law.
    limits : ReferenceLimits
        What a reference may ask for.
    goto : Goto
        How a goto is flown.
    given : Trajectory or None
        The reference, once it has come.
    way : Trajectory or None
        What is followed of it: itself, or from where the law has engaged.
    offset_ned_m : (3,) array or None
        From `given` to `way`; None until the law has engaged.
    home_ned_m : (3,) array or None
        Where the first reference began, or the first position that was held without one.
    nav, out : arrays
        Navigation row of this tick and what the law makes of it.
    commanders : dict of set of str
        Per topic of commands who sends them, or has sent one.
    own : list of tuple
        References of this node that it has not yet heard back.
    """

    kernel: OuterKernel
    state: np.ndarray
    send_attitude: Send
    send_collective: Send
    limits: ReferenceLimits
    goto: Goto
    given: Trajectory | None = None
    way: Trajectory | None = None
    offset_ned_m: np.ndarray | None = None
    home_ned_m: np.ndarray | None = None
    nav: np.ndarray = field(default_factory=lambda: np.full(NAV.size, np.nan))
    out: np.ndarray = field(default_factory=lambda: np.zeros(SETPOINT.size))
    commanders: dict[str, set[str]] = field(default_factory=lambda: {t: set() for t in _COMMANDS})
    own: list[tuple[Any, ...]] = field(default_factory=list)


@dataclass
class Following:
    """What the outer loop has while it is active.

    Attributes
    ----------
    begun_s : float
        Wall time of the activation.
    awaits_reference : bool
        In lockstep: no step is made before a reference has come.
    held : Trajectory or None
        The position of activation, held while there is no reference.
    engaged : bool
        True once the law has followed; before that its command is the trim.
    diverted : Trajectory or None
        The way of the last goto, followed until a reference comes.
    tell_way : callable or None
        Sends it as a reference; made by the first goto.
    """

    begun_s: float
    awaits_reference: bool
    held: Trajectory | None = None
    engaged: bool = False
    diverted: Trajectory | None = None
    tell_way: Callable[[Any], None] | None = None


class OuterLoopNode(TickNode[Law, Following]):
    """Active means: the reference is followed; without one, the position of activation is held."""

    SPEC = NodeSpec(NODE_NAME, "heli_outer_pd", TABLE, f"{NODE_NAME}.yaml")

    def configure(self) -> Law:
        """Build the law, its outputs and inputs."""
        kernel = outer_kernel(self.values)
        core = Law(
            kernel=kernel,
            state=initial_state(kernel),
            send_attitude=self.create_sender(topics.ATTITUDE_SETPOINT),
            send_collective=self.create_sender(topics.COLLECTIVE),
            limits=ReferenceLimits.from_parameters(self.values),
            goto=Goto.from_parameters(self.values),
            pace=self.listen((Input(topics.ODOM, Demand()),)),
        )
        self._warm_up(core)
        self.hear(topics.REFERENCE, self._on_reference)
        self.hear(topics.GOTO, self._on_goto)
        self.serve(Trigger, HOLD, self._on_hold)
        self.repeat(_COMMANDERS_PERIOD_S, self._name_commanders)
        return core

    def _warm_up(self, core: Law) -> None:
        """Load the compiled law before the first tick."""
        state = initial_state(core.kernel)
        follow(core.nav, 0, _NOWHERE.times_ns, _NOWHERE.points, core.kernel, state, core.out)
        offset_to(core.nav[NAV.pos], 0, _NOWHERE.times_ns, _NOWHERE.points)
        moved(_NOWHERE, np.zeros(3))
        encode_reference(core.goto.plan(_NOWHERE, 0, np.ones(3), 1.0))
        euler_from_quat(np.array([1.0, 0.0, 0.0, 0.0]))

    def _name_commanders(self) -> None:
        """Say who sends commands if they are several: each may, so all of them are followed."""
        for topic, known in self.core.commanders.items():
            names = set(map(full_name, senders_of(self, topic)))
            names.discard(self.get_fully_qualified_name())
            if NOT_YET_NAMED not in names and names - known:
                # Its name has come.
                known.discard(NOT_YET_NAMED)
            known |= names
            if len(known) > 1:
                said = f"{topic}: sent by {', '.join(sorted(known))}"
                self.core.senders[topic] = f"{said}; each {topic} is followed as it comes"

    def _on_reference(self, message: Any) -> None:
        core = self.core
        if (key := _key(message)) in core.own:
            core.own.remove(key)
            return
        # Now: who sends once is gone when one looks later.
        self._name_commanders()
        try:
            way = decode_reference(message)
            home = way.points[0, REFERENCE.pos] if core.home_ned_m is None else core.home_ned_m
            core.limits.judge(way, home, self.stamp_ns(self.tick))
        except MessageError as error:
            self.refuse_aloud(topics.REFERENCE, str(error))
            return
        except ReferenceRefused as error:
            self.refuse_aloud(topics.REFERENCE, f"{topics.REFERENCE}: {error}")
            return
        core.given, core.way, core.home_ned_m = way, way, home.copy()
        self._as_given()
        core.pace.resume()

    def _as_given(self) -> None:
        """What is followed from now on is flown where it says, and no goto is any more."""
        if self.core.offset_ned_m is not None:
            self.core.offset_ned_m = np.zeros(3)
        if self.active:
            self.run.diverted = None

    def _on_goto(self, message: Any) -> None:
        """Fly to a pose; or refuse it, and go on as before."""
        self._name_commanders()
        try:
            way = self._way_to(message)
        except MessageError as error:
            self.refuse_aloud(topics.GOTO, str(error))
            return
        except ReferenceRefused as error:
            self.refuse_aloud(topics.GOTO, f"{topics.GOTO}: {error}")
            return
        self.get_logger().info(f"{topics.GOTO}: {self._fly(way)}")

    def _on_hold(self, request: Any, response: Any) -> Any:
        """Stop; or refuse it, and go on as before."""
        try:
            way = self.core.goto.halt(self._followed(), self.stamp_ns(self.tick))
        except ReferenceRefused as error:
            response.message = f"{HOLD}: {error}"
            self.get_logger().warning(response.message)
            return response
        response.success, response.message = True, f"{HOLD}: {self._fly(way)}"
        self.get_logger().info(response.message)
        return response

    def _fly(self, way: Trajectory) -> str:
        """Follow a way from now on and tell it as a reference; a sentence about its end."""
        self._as_given()
        run, told = self.run, encode_reference(way, self.get_namespace())
        run.diverted = way
        if run.tell_way is None:
            run.tell_way = self._way_teller()
        self.core.own.append(_key(told))
        run.tell_way(told)
        last, end_ns = way.points[-1], way.start_ns + way.times_ns[-1]
        north, east, down = last[REFERENCE.pos]
        return (
            f"to {east:.2f} m east, {north:.2f} m north, {-down:.2f} m high, heading "
            f"{np.degrees(last[REFERENCE.psi]):.0f} deg, there in "
            f"{max(end_ns - self.stamp_ns(self.tick), 0) / NS_PER_S:.1f} s"
        )

    def _way_to(self, message: Any) -> Trajectory:
        """The way to a pose; MessageError or ReferenceRefused says why there is none."""
        goal, core, before = decode_goto(message), self.core, self._followed()
        now_ns, most_s = self.stamp_ns(self.tick), self.values["goto.max_age_s"]
        ahead_ns = AHEAD_TICKS * TICK_NS
        oldest_ns = max(now_ns - round(most_s * NS_PER_S), self.start_ns)
        if not oldest_ns <= goal.stamp_ns <= now_ns + ahead_ns:
            raise MessageError(
                f"{in_words(topics.GOTO, goal.stamp_ns, now_ns, self.start_ns)}; allowed: "
                f"{most_s:g} s before it to {ahead_ns / NS_PER_S:g} s after it"
            )
        home = core.home_ned_m
        assert home is not None  # known since there is a way
        return core.goto.judged(before, now_ns, goal.pos_ned_m, goal.psi_rad, core.limits, home)

    def _followed(self) -> Trajectory:
        """What is followed, if a position is held; else ReferenceRefused."""
        if not self.active:
            raise ReferenceRefused("outer_loop is not active; activate it first")
        if self.values["horizontal"] != _POSITION:
            raise ReferenceRefused(
                f"horizontal is {self.values['horizontal']}; allowed: {_POSITION}"
            )
        way = self._way()
        if not self.run.engaged or way is None:
            raise ReferenceRefused("no position is held yet: the law waits for navigation")
        return way

    def _way_teller(self) -> Callable[[Any], None]:
        """Sends ways as references, so that bag, page and report know what is followed."""
        publisher = self.create_publisher(
            topics.message_class(topics.BY_NAME[topics.REFERENCE].type),
            topics.REFERENCE,
            topics.qos(topics.REFERENCE),
        )
        self.at_end(partial(self.destroy_publisher, publisher))
        return publisher.publish

    def _way(self) -> Trajectory | None:
        """What is followed: a goto, a reference, or what was held at first."""
        return self.run.diverted or self.core.way or self.run.held

    def is_ready(self) -> bool:
        """In lockstep a flight with a reference does not begin before it has come."""
        run = self.run
        if not run.awaits_reference or self.core.given is not None:
            return True
        if time.monotonic() - run.begun_s > self.values["peer_timeout_s"]:
            run.awaits_reference = False
            self.get_logger().warning("no reference has come: the present position is held")
        return not run.awaits_reference

    def engage(self) -> Following:
        """Begin; wait for the reference only if somebody is there to send it."""
        self.core.state = initial_state(self.core.kernel)
        awaited = "scenario" in self.values["peers"] or self.count_publishers(topics.REFERENCE) > 0
        return Following(time.monotonic(), awaited)

    def begin_anew(self) -> None:
        """Another flight: the law begins anew, and with it what is held without a reference."""
        self.core.state = initial_state(self.core.kernel)
        self.core.way, self.core.offset_ned_m = self.core.given, None
        self.run.held, self.run.diverted, self.run.engaged = None, None, False

    def step(self, tick: int, arrived: Arrived) -> None:
        """Every `period_ticks` ticks: reference of now, law, setpoint and collective."""
        if tick % self.values["period_ticks"]:
            return
        core, run, stamp_ns = self.core, self.run, self.stamp_ns(tick)
        _, nav = arrived.get(topics.ODOM, (0, None))
        core.nav[:] = np.nan if nav is None else nav
        if core.given is None and run.held is None and nav is not None:
            run.held = Trajectory.hover(nav[NAV.pos], euler_from_quat(nav[NAV.quat])[2])
            if core.home_ned_m is None:
                core.home_ned_m = nav[NAV.pos].copy()
        if core.offset_ned_m is None and flyable(core.nav):
            self._anchor(stamp_ns)
        way = self._way()
        if way is None:
            # Nothing to hold yet: neither reference nor position. Repeat the last command.
            core.nav[:] = np.nan
            way = _NOWHERE
        code = follow(
            core.nav,
            stamp_ns - way.start_ns,
            way.times_ns,
            way.points,
            core.kernel,
            core.state,
            core.out,
        )
        core.send_attitude(core.out[SETPOINT.attitude], stamp_ns)
        core.send_collective(core.out[[SETPOINT.col]], stamp_ns)
        self._tell(code)

    def _anchor(self, stamp_ns: int) -> None:
        """The law engages: the reference begins here, if it is to; later ones stay as given."""
        core = self.core
        core.offset_ned_m = np.zeros(3)
        if core.given is not None and self.values["reference_anchor"] == "engagement":
            way = core.given
            core.offset_ned_m = offset_to(
                core.nav[NAV.pos], stamp_ns - way.start_ns, way.times_ns, way.points
            )
            core.way = moved(way, core.offset_ned_m)

    def _tell(self, code: int) -> None:
        status, core = OuterStatus(code), self.core
        level, message = Level.OK, status.sentence
        if status == OuterStatus.OK:
            self.run.engaged = True
        elif status == OuterStatus.BAD_NAVIGATION and not self.run.engaged:
            level, message = Level.WARN, _WAITS
        else:
            level = Level.ERROR
        if self.tick % TICKS_PER_S == 0 or message != self.health.message:
            facts = {
                "reference": self._what(),
                "wind_compensation": bool(self.values["wind_compensation"]),
                FACT_OFFSET: ([] if core.offset_ned_m is None else core.offset_ned_m.tolist()),
                "disturbance_ned_mps2": np.round(core.state[MEMORY.disturbance], 4).tolist(),
            }
            self.warn_or_ok(level, message, facts)

    def _what(self) -> str:
        if self.run.diverted is not None:
            return "goto"
        return "held position" if self.core.given is None else "given"

    def judge(
        self, values: Mapping[str, Any], changed: Collection[str]
    ) -> tuple[OuterKernel, ReferenceLimits, Goto]:
        """The changed law and limits; what does not fit together raises."""
        limits = ReferenceLimits.from_parameters(values)
        return outer_kernel(values), limits, Goto.from_parameters(values)

    def adopt(
        self, judged: tuple[OuterKernel, ReferenceLimits, Goto], changed: Collection[str]
    ) -> None:
        """Swap the law between two ticks; its state goes on. Limits are for what is to come."""
        if self.configured:
            self.core.kernel, self.core.limits, self.core.goto = judged


def _key(reference: Any) -> tuple[Any, ...]:
    """What tells a reference message from others."""
    stamp, points = reference.header.stamp, reference.points
    ends = [points[i].time_from_start for i in (0, -1)] if points else []
    return (stamp.sec, stamp.nanosec, len(points), *((e.sec, e.nanosec) for e in ends))


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_outer_pd outer_loop`."""
    return run(OuterLoopNode, args)


if __name__ == "__main__":
    sys.exit(main())
