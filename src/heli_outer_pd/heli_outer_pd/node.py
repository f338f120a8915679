# SPDX-License-Identifier: Apache-2.0
"""Node `outer_loop`: reference and odometry to attitude setpoint and collective, 25 Hz."""

import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from heli_math.rotations import euler_from_quat
from heli_math.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.lockstep import Demand
from heli_msgs_bridge.managed_node import NodeSpec, run
from heli_msgs_bridge.messages import Encoder, MessageError
from heli_msgs_bridge.packing import N_NAV
from heli_msgs_bridge.reference_message import decode_reference
from heli_msgs_bridge.tick_node import Arrived, Input, TickNode
from heli_outer_pd.config import outer_kernel
from heli_outer_pd.parameter_table import NODE_NAME, TABLE
from heli_outer_pd.position_law import (
    N_OUTPUT,
    OuterStatus,
    follow,
    initial_state,
)

_NOWHERE = Trajectory.hover(np.zeros(3), 0.0)


class OuterLoopNode(TickNode):
    """Active means: the reference is followed; without one, the position of activation is held."""

    SPEC = NodeSpec(NODE_NAME, "heli_outer_pd", TABLE, f"{NODE_NAME}.yaml")

    def setup(self) -> None:
        """Build the law, its outputs and inputs."""
        self.kernel = outer_kernel(self.values)
        self.state = initial_state(self.kernel)
        self._encode_attitude = Encoder(topics.ATTITUDE_SETPOINT).encode
        self._encode_collective = Encoder(topics.COLLECTIVE).encode
        self._send_attitude = self.create_output(topics.ATTITUDE_SETPOINT)
        self._send_collective = self.create_output(topics.COLLECTIVE)
        self._out = np.zeros(N_OUTPUT)
        self._nav = np.full(N_NAV, np.nan)
        self.trajectory: Trajectory | None = None
        self._given = False
        self._warm_up()
        topic = topics.REFERENCE
        cls = topics.message_class(topics.BY_NAME[topic].type)
        self._reference_subscription = self.create_subscription(
            cls, topic, self._on_reference, topics.qos(topic)
        )
        self.listen((Input(topics.ODOM, Demand()),))

    def _warm_up(self) -> None:
        """Load the compiled law before the first tick."""
        hover = Trajectory.hover(np.zeros(3), 0.0)
        state = initial_state(self.kernel)
        follow(self._nav, 0, hover.times_ns, hover.points, self.kernel, state, self._out)
        euler_from_quat(np.array([1.0, 0.0, 0.0, 0.0]))

    def _on_reference(self, message: Any) -> None:
        try:
            self.trajectory = decode_reference(message)
        except MessageError as error:
            self._refuse(topics.REFERENCE, str(error))
            return
        self._given = True
        self.resume()

    def is_ready(self) -> bool:
        """In lockstep a flight with a reference does not begin before it has come."""
        if self._given or self._reference_waived or not self.active:
            return True
        if time.monotonic() - self._engaged_s > self.values["peer_timeout_s"]:
            self._reference_waived = True
            self.get_logger().warning("no reference has come: the present position is held")
        return self._reference_waived

    def engage(self) -> None:
        """Begin; wait for the reference only if somebody is there to send it."""
        self._engaged_s = time.monotonic()
        awaited = "scenario" in self.values["peers"] or self.count_publishers(topics.REFERENCE) > 0
        self._reference_waived = not awaited
        self.state = initial_state(self.kernel)
        super().engage()

    def disengage(self) -> None:
        """Forget a position that was only held; a given reference stays."""
        super().disengage()
        if not self._given:
            self.trajectory = None

    def step(self, tick: int, arrived: Arrived) -> None:
        """Every `period_ticks` ticks: reference of now, law, setpoint and collective."""
        if tick % self.values["period_ticks"]:
            return
        _, nav = arrived.get(topics.ODOM, (0, None))
        if nav is None:
            self._nav[:] = np.nan
        else:
            self._nav[:] = nav
        if self.trajectory is None and nav is not None:
            psi = euler_from_quat(nav[6:10])[2]
            self.trajectory = Trajectory.hover(nav[0:3], psi)
        stamp_ns = self.stamp_ns(tick)
        if self.trajectory is None:
            # Nothing to hold yet: neither reference nor position. Repeat the last command.
            self._nav[:] = np.nan
            way = _NOWHERE
        else:
            way = self.trajectory
        code = follow(
            self._nav,
            stamp_ns - way.start_ns,
            way.times_ns,
            way.points,
            self.kernel,
            self.state,
            self._out,
        )
        self._send_attitude(self._encode_attitude(self._out[:3], stamp_ns))
        self._send_collective(self._encode_collective(self._out[3:], stamp_ns))
        self._tell(code)

    def _tell(self, code: int) -> None:
        status = OuterStatus(code)
        level = Level.OK if status == OuterStatus.OK else Level.ERROR
        if self.tick % 100 == 0 or status.sentence != self._message:
            facts = {
                "reference": "given" if self._given else "held position",
                "wind_compensation": bool(self.values["wind_compensation"]),
                "disturbance_ned_mps2": np.round(self.state[3:6], 4).tolist(),
            }
            self.warn_or_ok(level, status.sentence, facts)

    def judge_change(self, changes: Mapping[str, Any]) -> None:
        """Build the changed law; what does not fit together raises."""
        outer_kernel({**self.values, **changes})

    def apply_change(self, changes: Mapping[str, Any]) -> None:
        """Swap the law between two ticks; its state goes on."""
        self.kernel = outer_kernel(self.values)

    def teardown(self) -> None:
        """Forget the reference."""
        self.trajectory, self._given = None, False

    def _drop_entities(self) -> None:
        super()._drop_entities()
        if getattr(self, "_reference_subscription", None) is not None:
            self.destroy_subscription(self._reference_subscription)
            self._reference_subscription = None


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_outer_pd outer_loop`."""
    return run(OuterLoopNode, args)


if __name__ == "__main__":
    sys.exit(main())
