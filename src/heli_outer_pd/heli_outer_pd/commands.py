# SPDX-License-Identifier: Apache-2.0
"""What pilots ask of the outer loop: topic `goto`, services `hold`, `takeoff`, `land`.

Each is done, or refused in one sentence and the flight goes on as before.
"""

from collections.abc import Callable
from typing import Any

import numpy as np

from heli_math.rows import REFERENCE
from heli_math.ticks import NS_PER_S, TICK_NS
from heli_math.trajectory import Trajectory
from heli_modes.machine import Refusal, decide
from heli_modes.table import Command
from heli_msgs_bridge import topics
from heli_msgs_bridge.goto_message import decode_goto
from heli_msgs_bridge.messages import MessageError
from heli_msgs_bridge.reference_message import encode_reference
from heli_msgs_bridge.stamps import AHEAD_TICKS, in_words
from heli_outer_pd.reference_limits import ReferenceRefused

SERVED = (Command.HOLD, Command.TAKEOFF, Command.LAND)
"""Commands with a service of their name: `std_srvs/Trigger`."""
_POSITION = "position"


class Commands:
    """Commands of a node `outer_loop`.

    Parameters
    ----------
    node : OuterLoopNode
    """

    def __init__(self, node: Any) -> None:
        self._node = node

    def on_goto(self, message: Any) -> None:
        """Fly to a pose; or refuse it, and go on as before."""
        node = self._node
        # Now: who sends once is gone when one looks later.
        node._name_commanders()
        try:
            goal = self._goal_of(message)
            refused = self._do(Command.GOTO, goal)
        except MessageError as error:
            node.refuse_aloud(topics.GOTO, str(error))
            return
        except ReferenceRefused as error:
            node.refuse_aloud(topics.GOTO, f"{topics.GOTO}: {error}")
            return
        if refused is not None:
            node.refuse_aloud(topics.GOTO, refused.sentence)
            return
        node.get_logger().info(f"{topics.GOTO}: {self.fly(node.run.phases.way)}")

    def service(self, command: Command) -> Callable[[Any, Any], Any]:
        """The callback of a command's service: done, or refused, in a sentence."""

        def answer(request: Any, response: Any) -> Any:
            node = self._node
            try:
                self._check_held()
                refused = self._do(command)
                said = None if refused is None else refused.sentence
            except ReferenceRefused as error:
                said = f"{command}: {error}"
            if said is not None:
                response.message = said
                node.get_logger().warning(said)
                return response
            response.success, response.message = True, f"{command}: {self._done(command)}"
            node.get_logger().info(response.message)
            return response

        return answer

    def refusal_of_reference(self) -> str:
        """Why no reference is followed now; empty if one is."""
        found = decide(self._node.run.phases.phase, Command.FOLLOW)
        return found.sentence if isinstance(found, Refusal) else ""

    def fly(self, way: Trajectory) -> str:
        """Follow a way from now on and tell it as a reference; a sentence about its end."""
        node = self._node
        run, told = node.run, encode_reference(way, node.get_namespace())
        run.diverted = way
        if run.tell_way is None:
            run.tell_way = node._way_teller()
        node.core.own.append(key_of(told))
        run.tell_way(told)
        last, end_ns = way.points[-1], way.start_ns + way.times_ns[-1]
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
                f"{numbers.height_m:g} m at {numbers.climb.climb_mps:g} m/s"
            )
        if command == Command.LAND and phases.phase.on_ground:
            return "take-off broken off, the collective goes down"
        said = self.fly(phases.way)
        if command == Command.LAND:
            return f"comes to rest {said}, then down at {numbers.descent.climb_mps:g} m/s"
        return said

    def _do(self, command: Command, goal: Any = None) -> Refusal | None:
        node = self._node
        phases = node.run.phases
        return phases.command(command, node.stamp_ns(node.tick), node.core.nav, goal)

    def _goal_of(self, message: Any) -> tuple[np.ndarray, float]:
        """Position and heading; MessageError or ReferenceRefused says why there are none."""
        node = self._node
        goal = decode_goto(message)
        self._check_held()
        now_ns, most_s = node.stamp_ns(node.tick), node.values["goto.max_age_s"]
        ahead_ns = AHEAD_TICKS * TICK_NS
        oldest_ns = max(now_ns - round(most_s * NS_PER_S), node.start_ns)
        if not oldest_ns <= goal.stamp_ns <= now_ns + ahead_ns:
            raise MessageError(
                f"{in_words(topics.GOTO, goal.stamp_ns, now_ns, node.start_ns)}; allowed: "
                f"{most_s:g} s before it to {ahead_ns / NS_PER_S:g} s after it"
            )
        return goal.pos_ned_m, goal.psi_rad

    def _check_held(self) -> None:
        """ReferenceRefused unless a position is held, in the air or on the ground."""
        node = self._node
        if not node.active:
            raise ReferenceRefused("outer_loop is not active; activate it first")
        if node.values["horizontal"] != _POSITION:
            raise ReferenceRefused(
                f"horizontal is {node.values['horizontal']}; allowed: {_POSITION}"
            )
        if not node.run.engaged or node.run.phases.way is None:
            raise ReferenceRefused("no position is held yet: the law waits for navigation")


def key_of(reference: Any) -> tuple[Any, ...]:
    """What tells a reference message from others."""
    stamp, points = reference.header.stamp, reference.points
    ends = [points[i].time_from_start for i in (0, -1)] if points else []
    return (stamp.sec, stamp.nanosec, len(points), *((e.sec, e.nanosec) for e in ends))
