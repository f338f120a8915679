# SPDX-License-Identifier: Apache-2.0
"""ROS nodes in this process, one of them a `TickNode`; a decoder that refuses unusual layouts."""

from dataclasses import dataclass, field

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor

from heli_msgs_bridge import topics
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.lifecycle_node import NodeSpec
from heli_msgs_bridge.lockstep import Demand
from heli_msgs_bridge.messages import Decoder
from heli_msgs_bridge.tick_node import Input, TickCore, TickNode


@pytest.fixture
def two_nodes(ros_context):
    """Two nodes, and what spins the second for a time (s) or until something has come."""
    nodes = [rclpy.create_node(name, context=ros_context) for name in ("sender", "listener")]
    executor = SingleThreadedExecutor(context=ros_context)
    executor.add_node(nodes[1])
    yield *nodes, executor.spin_once
    executor.shutdown()
    for node in nodes:
        node.destroy_node()


@pytest.fixture
def fast_decoder():
    """Make a Decoder that reads messages of the usual layout and refuses all others."""

    def slowly(raw):
        raise AssertionError("not the usual layout: it takes the ordinary decoder")

    return lambda topic, datum=None: Decoder(topic, datum, slowly)


@dataclass(kw_only=True)
class ProbeCore(TickCore):
    steps: list = field(default_factory=list)
    ready: bool = True


class Probe(TickNode[ProbeCore, None]):
    """Steps on a pressure per tick; wants a wind every second one, takes a setpoint as it comes."""

    SPEC = NodeSpec("probe", "heli_core", (), "common.yaml")

    def configure(self):
        inputs = (
            Input(topics.BARO, Demand()),
            Input(topics.TRUTH_WIND, Demand(every_ticks=2, first_tick=2)),
            Input(
                topics.ATTITUDE_SETPOINT, Demand(every_ticks=1_000_000, first_tick=1), off_tick=True
            ),
        )
        return ProbeCore(pace=self.listen(inputs))

    def is_ready(self):
        return self.core.ready

    def step(self, tick, arrived):
        self.core.steps.append((tick, dict(arrived)))


class Graph:
    """A `Bench` with a probe on it, whose messages hold one number, and what it made of them."""

    def __init__(self, bench):
        self._bench = bench
        self.node, self.receive, self.fly = bench.node, bench.receive, bench.fly
        self.spin_until = bench.spin_until

    def send(self, topic, tick, value=0.0, late_ns=0):
        self._bench.send(topic, tick, np.full(CHANNELS[topic].size, value), late_ns)

    @property
    def steps(self):
        assert self.node.crash is None
        return self.node.core.steps

    @property
    def ticks(self):
        return [tick for tick, _ in self.steps]


@pytest.fixture
def graph(bench):
    def make(fly=True, **changes):
        made = Graph(bench(Probe, **changes))
        if fly:
            made.fly()
        return made

    return make
