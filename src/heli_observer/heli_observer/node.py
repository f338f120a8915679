# SPDX-License-Identifier: Apache-2.0
"""Node `observer`: sensors and flown actuators to odometry and rotor state, every tick."""

import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from heli_core.inbox import Inbox, deliver, empty_inbox
from heli_core.jit import direct
from heli_core.rows import NAV
from heli_core.sensors import AIDS
from heli_core.ticks import Rate
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import Level, NodeState
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.lifecycle_node import NodeSpec
from heli_msgs_bridge.lockstep import Arrived, Demand
from heli_msgs_bridge.messages import FrameTree, encode_header, encode_transforms
from heli_msgs_bridge.node_process import run
from heli_msgs_bridge.tick_node import Input, Send, TickCore, TickNode
from heli_observer.dual_imu import NAMES, PAIR, WHY_WORDS
from heli_observer.layout import (
    COUNT,
    COUNTER_NAMES,
    YAW,
    YAW_COUNT,
    ObserverState,
    ObserverStatus,
    YawState,
)
from heli_observer.observer import INPUTS, ObserverConfig, initial_state, status, step
from heli_observer.parameters import NODE_NAME, TABLE

_ALIGNED_S = 1.0
"""Of flight time, in which an alignment should be done."""
_LEVELS = {ObserverStatus.OK: Level.OK, ObserverStatus.NOT_FINITE: Level.ERROR}


@dataclass(kw_only=True)
class Navigation(TickCore):
    """What the observer has while it is configured: numbers, state, what has come, outputs.

    `send_absence` says of a tick that there is no estimate; `send_tf` is None where the type of
    /tf is not installed; `step` and `status` are compiled for these numbers.
    """

    config: ObserverConfig
    state: ObserverState
    send_odom: Send
    send_rotor: Send
    send_absence: Callable[[bytes], None]
    send_tf: Callable[[bytes], None] | None
    frames: FrameTree
    inbox: Inbox = field(default_factory=lambda: empty_inbox(len(INPUTS)))
    out: np.ndarray = field(default_factory=lambda: np.zeros(NAV.size))
    step: Callable[..., None] = field(init=False)
    status: Callable[..., int] = field(init=False)

    def __post_init__(self) -> None:
        state, k = self.state, self.config.params
        self.step = direct(step, state, self.inbox, 0, k, self.out)
        self.status = direct(status, state, k)


def rate_variance(v: Mapping[str, Any]) -> float:
    """Variance of the published rate, (rad/s)^2: the gyro's noise and the bias as first believed.

    The filter learns the bias; its row of numbers does not say how well, so this is a bound.
    """
    bias = v["ekf.initial.gyro_bias_radps"]
    return float(v["ekf.imu.gyro_noise_density"] ** 2 / Rate.of_parameters(v).tick_s + bias**2)


class ObserverNode(TickNode[Navigation, None]):
    """Active means: the navigation solution is published."""

    SPEC = NodeSpec(NODE_NAME, "heli_observer", TABLE, f"{NODE_NAME}.yaml")
    CATCHES_UP = True

    def configure(self) -> Navigation:
        """Build the filter, its outputs and inputs."""
        v, of = self.values, self.rate.of
        config = ObserverConfig.from_parameters(v)
        gps = Demand(of(v["schedule.gps_period_ticks"]), of(v["schedule.gps_latency_ticks"]))
        imu = Demand(self.rate.every(v["schedule.imu_period_ticks"]))
        inputs = (
            Input(topics.IMU, imu),
            *([Input(topics.IMU2, imu)] if v["imu2.enabled"] else []),
            *(Input(a.topic, Demand(of(v[f"schedule.{a.name}_period_ticks"]))) for a in AIDS),
            Input(topics.GPS_FIX, gps),
            Input(topics.GPS_VELOCITY, gps),
            Input(topics.ACTUATORS, Demand(lag_ticks=1, first_tick=1)),
        )
        origin = datum(v["origin.latitude_deg"], v["origin.longitude_deg"], v["origin.altitude_m"])
        core = Navigation(
            config=config,
            state=initial_state(config),
            send_odom=self.create_sender(topics.ODOM, (rate_variance(v),)),
            send_rotor=self.create_sender(topics.ROTOR_STATE),
            send_absence=self.create_topic_publisher(topics.NO_ESTIMATE),
            send_tf=self.create_topic_publisher(topics.TF) if topics.installed(topics.TF) else None,
            frames=FrameTree(self.get_namespace(), self.rate.tick_s),
            pace=self.listen(inputs, origin),
        )
        self._warm_up(core)
        return core

    def _warm_up(self, core: Navigation) -> None:
        """Load the compiled filter before the first tick, on a state of its own."""
        state = initial_state(core.config)
        core.step(state, core.inbox, 0, core.config.params, core.out)
        core.status(state, core.config.params)

    def engage(self) -> None:
        """Begin with a new alignment, and a new frame odom."""
        self.begin_anew()

    def begin_anew(self) -> None:
        """Another flight: align again."""
        self.core.state = initial_state(self.core.config)
        self.core.frames = FrameTree(self.get_namespace(), self.rate.tick_s)

    def save_state(self) -> Any:
        """The filter, and the frame odom."""
        return self.core.state, self.core.frames

    def restore_state(self, content: Any, gap: bool) -> None:
        """Go on with the filter of the predecessor, through the samples that it has missed."""
        self.core.state, self.core.frames = content

    def step(self, tick: int, arrived: Arrived) -> None:
        """One tick of the filter."""
        core = self.core
        deliver(core.inbox, INPUTS, arrived)
        core.step(core.state, core.inbox, tick, core.config.params, core.out)
        stamp_ns = self.stamp_ns(tick)
        if np.isfinite(core.out).all():
            core.send_odom(core.out, stamp_ns)
            core.send_rotor(core.out[NAV.rotor], stamp_ns)
        else:
            core.send_absence(encode_header(stamp_ns, topics.MAP))
        if core.send_tf is not None and core.frames.follow(core.out, tick):
            if tick % self.rate.every(topics.KNOWN[topics.TF].every_ticks) == 0:
                core.send_tf(encode_transforms(core.frames.transforms(core.out), stamp_ns))
        self._tell()

    def _tell(self) -> None:
        core = self.core
        named = ObserverStatus(core.status(core.state, core.config.params))
        if self.tick % self.rate.hz == 0 or named.sentence != self.health.message:
            facts = {
                "status": named.name,
                "sigma_position_m": np.round(core.out[NAV.sigma_pos], 3).tolist(),
                "sigma_velocity_mps": np.round(core.out[NAV.sigma_vel], 3).tolist(),
                "sigma_attitude_deg": np.round(np.degrees(core.out[NAV.sigma_att]), 3).tolist(),
                "refused_messages": len(core.refused),
                **_events(core.state),
                **_left(core.state),
                **_motion(core.state),
            }
            aligns = named == ObserverStatus.ALIGNING
            state = NodeState.WAITING if aligns else NodeState.RUNNING
            self.warn_or_ok(self._level(named), named.sentence, facts, state)

    def _level(self, named: ObserverStatus) -> Level:
        """An alignment is no fault, unless it takes long."""
        aligned_s = self.rate.seconds(self.tick - int(self.core.state.count[COUNT.begun]))
        if named == ObserverStatus.ALIGNING and aligned_s < _ALIGNED_S:
            return Level.OK
        return _LEVELS.get(named, Level.WARN)


def _events(state: ObserverState) -> dict[str, int]:
    """What has been fused, rejected and dropped since the alignment began, and how often."""
    counts = {name: int(state.count[place]) for name, place in COUNTER_NAMES.items()}
    return {name: count for name, count in counts.items() if count}


def _left(state: ObserverState) -> dict[str, str | int]:
    """Which of two IMUs is not followed and why, and how often one was left."""
    count = state.pair.count
    if not count[PAIR.switches]:
        return {}
    return {
        "imu_left": NAMES[count[PAIR.left]],
        "imu_left_because": WHY_WORDS[count[PAIR.why]],
        "imus_left": int(count[PAIR.switches]),
    }


def _motion(state: ObserverState) -> dict[str, str | int | float]:
    """What motion says of the heading, and what came of it."""
    now, count = state.yaw.now, state.yaw.count
    told = YawState(count[YAW_COUNT.state])
    facts: dict[str, str | int | float] = {"heading_by_motion": told.name}
    if told != YawState.NOT_OBSERVABLE:
        facts["heading_by_motion_less_flown_deg"] = _deg(now[YAW.difference])
        facts["sigma_heading_by_motion_deg"] = _deg(math.sqrt(now[YAW.variance]))
    if count[YAW_COUNT.resets]:
        facts["heading_resets"] = int(count[YAW_COUNT.resets])
        facts["mag_heading_error_deg"] = _deg(now[YAW.mag_error])
    return facts


def _deg(angle_rad: float) -> float:
    return round(math.degrees(angle_rad), 1)


def main(args: Sequence[str] | None = None) -> int:
    """Entry point of `ros2 run heli_observer observer`."""
    return run(ObserverNode, args)


if __name__ == "__main__":
    sys.exit(main())
