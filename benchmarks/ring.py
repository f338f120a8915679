# SPDX-License-Identifier: Apache-2.0
"""A bare ring of four rclpy nodes, to measure the graph against.

The graph's path from sensor to actuator and nothing else: the plant sends an Imu, the observer
answers it with an Odometry, the outer loop every fourth one (or less often) with a setpoint, the
inner loop with actuators, which begin the next cycle. Types, QoS, discovery and executor are the
graph's; a node does nothing but read the stamp and send. What is sent are messages as an rclpy node
has them (`objects`: made once, converted by rclpy each time), or bytes that were made beforehand
(`bytes`: what DDS and executor cost alone).
"""

import gc
import multiprocessing
import os
import random
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from heli_core.ticks import NS_PER_S, TICK_NS
from heli_flight.graph.nodes import prepare_environment
from heli_flight.graph.processes import DOMAIN, others_in
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of

ROLES = ("plant", "observer", "inner_loop", "outer_loop")
FORMS = ("objects", "bytes")
WARM_CYCLES = 100
OUTER_EVERY = topics.BY_NAME[topics.ATTITUDE_SETPOINT].every_ticks
"""Cycles from one setpoint to the next."""
_HEARS = {
    "plant": (topics.ACTUATORS,),
    "observer": (topics.IMU,),
    "inner_loop": (topics.ODOM, topics.ATTITUDE_SETPOINT),
    "outer_loop": (topics.ODOM,),
}
_SENDS = {
    "plant": topics.IMU,
    "observer": topics.ODOM,
    "inner_loop": topics.ACTUATORS,
    "outer_loop": topics.ATTITUDE_SETPOINT,
}
_LIMIT_S = 120.0
# Above them ports are those that Linux gives to clients.
_DOMAINS = 102


def _blank(topic: str) -> Any:
    """A message of a topic as the graph sends it, with names in it and without numbers."""
    message = topics.message_class(topics.BY_NAME[topic].type)()
    message.header.frame_id = "base_link"
    if topic == topics.ACTUATORS:
        message.name, message.position = list(topics.ACTUATOR_NAMES), [0.0] * 4
    return message


class Ring:
    """Nodes of the ring in this process, by their roles; the plant's times each cycle.

    Parameters
    ----------
    roles : sequence of str
    form : str
        One of FORMS.
    cycles : int
        After which it is over.
    period_s : float
        0: the next cycle begins when the last one is over; else so many seconds after the last
        one began, by a timer.
    outer_every : int
        Cycles from one setpoint to the next.
    """

    def __init__(
        self,
        roles: Sequence[str],
        form: str,
        cycles: int,
        period_s: float = 0.0,
        outer_every: int = OUTER_EVERY,
    ) -> None:
        import rclpy
        from rclpy.experimental.events_executor import EventsExecutor

        from heli_msgs_bridge.node_process import Spinning

        self.over = self._started = False
        self._next, self._outer_every = 0, outer_every
        self.begun_s = np.zeros(cycles)
        self.taken_s = np.zeros(cycles)
        self._cycles, self._period_s, self._raw = cycles, period_s, form == "bytes"
        self._executor = EventsExecutor()
        self._spinning = Spinning(self._executor)
        self._send: dict[str, Callable[[int], None]] = {}
        self._publishers: dict[str, Any] = {}
        self._arrived = {topics.ODOM: -1, topics.ATTITUDE_SETPOINT: -1}
        self._nodes = [rclpy.create_node(role) for role in roles]
        for role, node in zip(roles, self._nodes, strict=True):
            self._equip(role, node)
            self._executor.add_node(node)

    def _equip(self, role: str, node: Any) -> None:
        topic = _SENDS[role]
        cls, blank = topics.message_class(topics.BY_NAME[topic].type), _blank(topic)
        publisher = node.create_publisher(cls, topic, topics.qos(topic))
        self._publishers[role] = publisher
        self._send[role] = self._sender(publisher, blank)
        for heard in _HEARS[role]:
            kind = topics.message_class(topics.BY_NAME[heard].type)
            call = self._hearer(role, heard)
            node.create_subscription(kind, heard, call, topics.qos(heard), raw=self._raw)
        if role == "plant" and self._period_s:
            node.create_timer(self._period_s, self._begin_on_time)

    def _sender(self, publisher: Any, blank: Any) -> Callable[[int], None]:
        from rclpy.serialization import serialize_message

        if not self._raw:
            stamp = blank.header.stamp

            def send(tick: int) -> None:
                stamp.sec, stamp.nanosec = divmod(tick * TICK_NS, NS_PER_S)
                publisher.publish(blank)

            return send
        frame = bytearray(serialize_message(blank))

        def send_bytes(tick: int) -> None:
            sec, nanosec = divmod(tick * TICK_NS, NS_PER_S)
            frame[4:8], frame[8:12] = sec.to_bytes(4, "little"), nanosec.to_bytes(4, "little")
            publisher.publish(bytes(frame))

        return send_bytes

    def _hearer(self, role: str, topic: str) -> Callable[[Any], None]:
        step = {
            "plant": self._plant,
            "observer": self._send.get("observer"),
            "inner_loop": self._inner(topic),
            "outer_loop": self._outer,
        }[role]

        def hear(message: Any) -> None:
            if self._raw:
                step(stamp_of(message) // TICK_NS)
            else:
                stamp = message.header.stamp
                step((stamp.sec * NS_PER_S + stamp.nanosec) // TICK_NS)

        return hear

    def _inner(self, topic: str) -> Callable[[int], None]:
        arrived = self._arrived

        def step(tick: int) -> None:
            arrived[topic] = tick
            newest = arrived[topics.ODOM]
            if tick % self._outer_every or newest == arrived[topics.ATTITUDE_SETPOINT]:
                self._send["inner_loop"](newest)

        return step

    def _outer(self, tick: int) -> None:
        if tick % self._outer_every == 0:
            self._send["outer_loop"](tick)

    def _plant(self, tick: int) -> None:
        self.taken_s[tick] = time.monotonic()
        if tick + 1 == self._cycles:
            self.over = True
            self._spinning.stop()
        elif not self._period_s:
            self._begin(tick + 1)

    def _begin(self, tick: int) -> None:
        self.begun_s[tick] = time.monotonic()
        self._send["plant"](tick)

    def _begin_on_time(self) -> None:
        if self._started and self._next < self._cycles:
            self._next += 1
            self._begin(self._next - 1)

    def connected(self) -> bool:
        """Whether all listeners of what is sent here are there."""
        wanted = {t: sum(t in heard for heard in _HEARS.values()) for t in _SENDS.values()}
        return all(
            publisher.get_subscription_count() >= wanted[_SENDS[role]]
            for role, publisher in self._publishers.items()
        )

    def spin(self, over: Callable[[], bool]) -> None:
        """Serve the nodes until it is over."""
        gc.collect()
        gc.freeze()
        while not over():
            self._spinning.serve()

    def begin(self) -> None:
        """The first cycle; with a period its timer begins."""
        if self._period_s:
            self._started = True
        else:
            self._begin(0)

    def close(self) -> None:
        """Take the nodes out of the graph."""
        self._executor.shutdown()
        for node in self._nodes:
            node.destroy_node()


@dataclass(frozen=True)
class Order:
    """What is to be measured.

    Attributes
    ----------
    composed : bool
        Whether the four nodes are in one process.
    form : str
        One of FORMS.
    cycles : int
    period_s : float
    outer_every : int
        As for `Ring`.
    """

    composed: bool
    form: str
    cycles: int
    period_s: float = 0.0
    outer_every: int = OUTER_EVERY


def _serve(roles: Sequence[str], order: Order, ready: Any, over: Any, times: Any) -> None:
    """A process of the ring; the plant's tells the times."""
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    # SIGTERM ends the process: so its parent ends those that it no longer waits for.
    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.SIGINT)
    ring = Ring(roles, order.form, order.cycles, order.period_s, order.outer_every)
    limit = time.monotonic() + _LIMIT_S
    while not ring.connected():
        if time.monotonic() > limit:
            raise SystemExit("ring: its nodes do not find each other")
        time.sleep(0.002)
    ready.wait(_LIMIT_S)
    if "plant" in roles:
        ring.begin()
        ring.spin(lambda: ring.over)
        over.value = 1
        times.send((ring.begun_s, ring.taken_s))
    else:
        ring.spin(lambda: bool(over.value))
    ring.close()
    rclpy.shutdown()


def use_free_domain() -> None:
    """Let this process and those that it starts meet in a ROS domain that nobody is in.

    Their discovery is the graph's. A domain that is set stays.
    """
    prepare_environment()
    if not os.environ.get(DOMAIN, "").strip():
        domains = list(range(1, _DOMAINS))
        random.shuffle(domains)
        os.environ[DOMAIN] = str(next(d for d in domains if not others_in(d)))


def run(order: Order) -> tuple[np.ndarray, np.ndarray]:
    """Let the ring run; returns when each cycle began and was over (s, monotonic)."""
    context = multiprocessing.get_context("spawn")
    mine, theirs = context.Pipe(duplex=False)
    shares = [ROLES] if order.composed else [(role,) for role in ROLES]
    ready, over = context.Barrier(len(shares)), context.RawValue("b", 0)
    processes = [
        context.Process(target=_serve, args=(roles, order, ready, over, theirs), daemon=True)
        for roles in shares
    ]
    use_free_domain()
    for process in processes:
        process.start()
    if not mine.poll(_LIMIT_S + order.cycles * order.period_s):
        raise SystemExit("ring: no answer")
    begun_s, taken_s = mine.recv()
    for process in processes:
        process.join(_LIMIT_S)
    return begun_s, taken_s


def cycles_per_s(order: Order) -> float:
    """Cycles per second of wall time, after the first WARM_CYCLES."""
    _, taken_s = run(order)
    return float((order.cycles - WARM_CYCLES) / (taken_s[-1] - taken_s[WARM_CYCLES - 1]))
