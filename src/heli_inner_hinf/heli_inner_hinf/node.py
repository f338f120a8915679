# SPDX-License-Identifier: Apache-2.0
"""Node `inner_loop`: attitude setpoint and collective to actuators, 100 Hz."""

import sys
import threading
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from heli_inner_hinf.attitude_law import AttitudeStatus, attitude_law
from heli_inner_hinf.design import LiveDesign
from heli_inner_hinf.excitation import (
    N_CHANNELS,
    SENT,
    ExcitationStatus,
    excitation_kernel,
    excite,
    initial_excitation_state,
)
from heli_inner_hinf.law_state import TICK_S, initial_law_state
from heli_inner_hinf.parameter_table import NODE_NAME, TABLE
from heli_math.rotations import euler_from_quat
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.lockstep import Demand
from heli_msgs_bridge.managed_node import NodeSpec, run
from heli_msgs_bridge.messages import Encoder
from heli_msgs_bridge.tick_node import Arrived, Input, TickNode

_OUTER = (topics.ATTITUDE_SETPOINT, topics.COLLECTIVE)
_TICKS_PER_S = 100


class InnerLoopNode(TickNode):
    """Active means: attitude is held. The collective is passed through, in one message."""

    SPEC = NodeSpec(NODE_NAME, "heli_inner_hinf", TABLE, f"{NODE_NAME}.yaml")

    def setup(self) -> None:
        """Synthesise the controller; an infeasible design is refused here."""
        self.design = LiveDesign(self.values)
        self._margin: tuple[Any, str] = (None, "")
        self._measuring: Any = None
        self._encode = Encoder(topics.ACTUATORS).encode
        self._send = self.create_output(topics.ACTUATORS)
        self._prepare_excitation()
        self._x9, self._u3, self._u = np.full(9, np.nan), np.zeros(3), np.zeros(4)
        self._forget_setpoint()
        self._warm_up()
        outer = Demand(self.values["outer_period_ticks"])
        self.listen(
            (
                Input(topics.ODOM, Demand()),
                Input(topics.ROTOR_STATE, Demand()),
                Input(topics.ATTITUDE_SETPOINT, outer, off_tick=True),
                Input(topics.COLLECTIVE, outer, off_tick=True),
            )
        )
        self._expect_outer(self.values["expects_outer"])

    def _forget_setpoint(self) -> None:
        """Hold the trim attitude, and the heading that will be found."""
        config = self.design.config
        self._r3 = np.array([config.x_trim[0], config.x_trim[1], np.nan])
        self._u[:] = config.u_trim
        self._setpoint_tick: int | None = None

    def _warm_up(self) -> None:
        """Load the compiled law before the first tick."""
        kernel = self.design.config.kernel
        attitude_law(self._x9, self._r3, kernel, initial_law_state(kernel), self._u3)
        euler_from_quat(np.array([1.0, 0.0, 0.0, 0.0]))
        if self._excitation.on:
            spare = initial_law_state(kernel)
            excite(-1.0, spare[9:18], self._excitation, self._excitation_state, spare, self._total)

    def _expect_outer(self, expected: bool) -> None:
        for topic in _OUTER:
            self.assembler.waive(topic, not expected)

    def step(self, tick: int, arrived: Arrived) -> None:
        """One tick: newest setpoint, law, actuators."""
        self._take_navigation(arrived)
        self._take_setpoint(arrived)
        stale = self._setpoint_is_stale(tick)
        r3 = self._trim_attitude(self._r3) if stale else self._r3
        kernel = self.design.take()
        code = attitude_law(self._x9, r3, kernel, self.design.state, self._u3)
        # The outer loop's collective stays as it came: the excitation must not pile up on it.
        self._total[:3], self._total[3] = self._u3, self._u[3]
        self._u[:3] = self._u3
        if self._excitation.on:
            self._excite(tick)
        self._send(self._encode(self._total, self.stamp_ns(tick)))
        self._tell(code, stale)

    def _prepare_excitation(self) -> None:
        """Excitation for identification; its topic exists only while one is configured."""
        self._excitation = excitation_kernel(self.values)
        self._excitation_state = initial_excitation_state()
        self._excited = ExcitationStatus.SILENT
        self._total = np.zeros(N_CHANNELS)
        if self._excitation.on:
            self._encode_excitation = Encoder(topics.EXCITATION_ACTUATORS).encode
            self._send_excitation = self.create_output(topics.EXCITATION_ACTUATORS)

    def _excite(self, tick: int) -> None:
        """Add the excitation to the actuators of this tick and publish it."""
        state = self._excitation_state
        code = excite(
            tick * TICK_S, self._x9, self._excitation, state, self.design.state, self._total
        )
        self._excited = ExcitationStatus(code)
        sent = state[SENT : SENT + N_CHANNELS]
        self._send_excitation(self._encode_excitation(sent, self.stamp_ns(tick)))

    def _take_navigation(self, arrived: Arrived) -> None:
        x9 = self._x9
        _, nav = arrived.get(topics.ODOM, (0, None))
        _, rotor = arrived.get(topics.ROTOR_STATE, (0, None))
        if nav is None or (rotor is None and self.lockstep):
            # Not a number: the law repeats its last command and says so.
            x9[:] = np.nan
            return
        x9[0], x9[1], x9[8] = euler_from_quat(nav[6:10])
        x9[2], x9[3], x9[6] = nav[10], nav[11], nav[12]
        if rotor is not None:
            x9[4], x9[5], x9[7] = rotor
        elif not np.isfinite(x9[4]):
            x9[4], x9[5], x9[7] = self.design.config.x_trim[[4, 5, 7]]
        if np.isnan(self._r3[2]):
            self._r3[2] = x9[8]

    def _take_setpoint(self, arrived: Arrived) -> None:
        stamp, attitude = arrived.get(topics.ATTITUDE_SETPOINT, (0, None))
        if attitude is not None:
            self._r3[:] = attitude
            self._setpoint_tick = stamp
        _, collective = arrived.get(topics.COLLECTIVE, (0, None))
        if collective is not None:
            self._u[3] = collective[0]

    def _setpoint_is_stale(self, tick: int) -> bool:
        if self._setpoint_tick is None:
            return False
        return tick - self._setpoint_tick > self.values["setpoint_timeout_s"] * _TICKS_PER_S

    def _trim_attitude(self, r3: np.ndarray) -> np.ndarray:
        """Trim attitude with the heading of r3."""
        trim = self.design.config.x_trim
        return np.array([trim[0], trim[1], r3[2]])

    def _tell(self, code: int, stale: bool) -> None:
        level, message = Level.OK, AttitudeStatus(code).sentence
        if code == AttitudeStatus.NOT_FINITE:
            level = Level.ERROR
        elif stale:
            level, message = Level.WARN, "the attitude setpoint is too old: trim attitude is held"
        elif self._excited > ExcitationStatus.EXCITING:
            level, message = Level.WARN, self._excited.sentence
        elif self._excited == ExcitationStatus.EXCITING and code == AttitudeStatus.OK:
            message = self._excited.sentence
        if self.tick % _TICKS_PER_S == 0 or message != self._message:
            self.warn_or_ok(level, message, self._facts_now())

    def _measure_margin(self) -> None:
        """Disk margin of the state feedback at the plant input, for /diagnostics.

        In a thread: the first one imports an optimiser, which would hold the flight up.
        """
        config = self.design.config

        def work() -> None:
            from heli_inner_hinf.analysis import model_of
            from heli_inner_hinf.loops import state_feedback_loop
            from heli_inner_hinf.margins import disk_margin

            margin = disk_margin(state_feedback_loop(model_of(config)), "input")
            self._margin = (config, f"{margin.alpha:.3f}")

        if config.controller == "pid":
            self._margin = (config, "none: pid is no state feedback")
        else:
            threading.Thread(target=work, daemon=True).start()

    def _facts_now(self) -> dict[str, Any]:
        facts = dict(self.design.config.summary())
        known_for, margin = self._margin
        if known_for is not self.design.config:
            if self._measuring is not self.design.config:
                self._measuring = self.design.config
                self._measure_margin()
            margin = "being computed"
        facts["disk_margin_input"] = margin
        if self._excitation.on:
            facts["excitation"] = self._excited.sentence
        facts["setpoint_tick"] = "none" if self._setpoint_tick is None else self._setpoint_tick
        return facts

    def disengage(self) -> None:
        """Forget the flown setpoint."""
        super().disengage()
        self._forget_setpoint()

    def engage(self) -> None:
        """Begin to hold attitude, from what was flown last."""
        self._expect_outer(self.values["expects_outer"])
        super().engage()

    def judge_change(self, changes: Mapping[str, Any]) -> None:
        """Synthesise the changed design; infeasible ones raise."""
        design = {key: value for key, value in changes.items() if key != "expects_outer"}
        if design and hasattr(self, "design"):
            self.design.propose(design)

    def apply_change(self, changes: Mapping[str, Any]) -> None:
        """The judged design is swapped in at the next tick; here only what the node itself uses."""
        if "expects_outer" in changes and hasattr(self, "assembler"):
            self._expect_outer(changes["expects_outer"])


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_inner_hinf inner_loop`."""
    return run(InnerLoopNode, args)


if __name__ == "__main__":
    sys.exit(main())
