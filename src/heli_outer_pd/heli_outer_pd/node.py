# SPDX-License-Identifier: Apache-2.0
"""Node `outer_loop`: reference and odometry to attitude setpoint and collective, 25 Hz."""

import sys
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from heli_math.rotations import euler_from_quat
from heli_math.rows import NAV, REFERENCE, SETPOINT
from heli_math.ticks import TICKS_PER_S
from heli_math.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_OFFSET, Level
from heli_msgs_bridge.lockstep import Demand
from heli_msgs_bridge.messages import MessageError
from heli_msgs_bridge.node_process import run
from heli_msgs_bridge.node_spec import NodeSpec
from heli_msgs_bridge.reference_message import decode_reference
from heli_msgs_bridge.senders import NOT_YET_NAMED, full_name, senders_of
from heli_msgs_bridge.tick_node import Arrived, Input, Send, TickCore, TickNode
from heli_outer_pd.config import outer_kernel
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
    commanders : set of str
        Who sends references, or has sent one.
    """

    kernel: OuterKernel
    state: np.ndarray
    send_attitude: Send
    send_collective: Send
    limits: ReferenceLimits
    given: Trajectory | None = None
    way: Trajectory | None = None
    offset_ned_m: np.ndarray | None = None
    home_ned_m: np.ndarray | None = None
    nav: np.ndarray = field(default_factory=lambda: np.full(NAV.size, np.nan))
    out: np.ndarray = field(default_factory=lambda: np.zeros(SETPOINT.size))
    commanders: set[str] = field(default_factory=set)


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
    """

    begun_s: float
    awaits_reference: bool
    held: Trajectory | None = None


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
            pace=self.listen((Input(topics.ODOM, Demand()),)),
        )
        self._warm_up(core)
        self.hear(topics.REFERENCE, self._on_reference)
        self.repeat(_COMMANDERS_PERIOD_S, self._name_commanders)
        return core

    def _warm_up(self, core: Law) -> None:
        """Load the compiled law before the first tick."""
        state = initial_state(core.kernel)
        follow(core.nav, 0, _NOWHERE.times_ns, _NOWHERE.points, core.kernel, state, core.out)
        offset_to(core.nav[NAV.pos], 0, _NOWHERE.times_ns, _NOWHERE.points)
        moved(_NOWHERE, np.zeros(3))
        euler_from_quat(np.array([1.0, 0.0, 0.0, 0.0]))

    def _name_commanders(self) -> None:
        """Say who sends references if they are several: each may, so all of them are followed."""
        names = set(map(full_name, senders_of(self, topics.REFERENCE)))
        core = self.core
        if NOT_YET_NAMED not in names and names - core.commanders:
            # Its name has come.
            core.commanders.discard(NOT_YET_NAMED)
        core.commanders |= names
        if len(core.commanders) > 1:
            said = f"{topics.REFERENCE}: sent by {', '.join(sorted(core.commanders))}"
            core.senders[topics.REFERENCE] = f"{said}; each reference is followed as it comes"

    def _on_reference(self, message: Any) -> None:
        core = self.core
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
        if core.offset_ned_m is not None:
            core.offset_ned_m = np.zeros(3)
        core.pace.resume()

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
        self.run.held = None

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
        way = core.way or run.held
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
        level = Level.OK if status == OuterStatus.OK else Level.ERROR
        if self.tick % TICKS_PER_S == 0 or status.sentence != self.health.message:
            facts = {
                "reference": "held position" if core.given is None else "given",
                "wind_compensation": bool(self.values["wind_compensation"]),
                FACT_OFFSET: ([] if core.offset_ned_m is None else core.offset_ned_m.tolist()),
                "disturbance_ned_mps2": np.round(core.state[MEMORY.disturbance], 4).tolist(),
            }
            self.warn_or_ok(level, status.sentence, facts)

    def judge(
        self, values: Mapping[str, Any], changed: Collection[str]
    ) -> tuple[OuterKernel, ReferenceLimits]:
        """The changed law and limits; what does not fit together raises."""
        return outer_kernel(values), ReferenceLimits.from_parameters(values)

    def adopt(self, judged: tuple[OuterKernel, ReferenceLimits], changed: Collection[str]) -> None:
        """Swap the law between two ticks; its state goes on. Limits are for references to come."""
        if self.configured:
            self.core.kernel, self.core.limits = judged


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_outer_pd outer_loop`."""
    return run(OuterLoopNode, args)


if __name__ == "__main__":
    sys.exit(main())
