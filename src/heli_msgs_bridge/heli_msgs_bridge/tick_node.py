# SPDX-License-Identifier: Apache-2.0
"""A managed node that steps once per tick on the messages of that tick."""

import time
from abc import abstractmethod
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rclpy.clock import Clock, ClockType

from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import Level
from heli_msgs_bridge.frames import Datum
from heli_msgs_bridge.lockstep import Demand, TickAssembler
from heli_msgs_bridge.managed_node import ManagedNode
from heli_msgs_bridge.messages import CutOffError, Decoder, MessageError

Arrived = Mapping[str, tuple[int, NDArray[np.float64] | None]]
"""Per topic: stamp tick, and the array or None if the message could not be used."""
_WATCH_PERIOD_S = 0.05


@dataclass(frozen=True)
class Input:
    """A topic that a step uses.

    Attributes
    ----------
    topic : str
    demand : Demand
        When lockstep waits for it.
    off_tick : bool
        True if stamps between ticks are allowed (they count for the tick before).
    """

    topic: str
    demand: Demand
    off_tick: bool = False


class TickNode(ManagedNode):
    """Collects inputs by tick and calls `step`.

    The first input is the trigger: its message begins a tick. In lockstep `step` runs when
    everything demanded has come; in real time when the trigger comes, with what arrived since the
    last step. A trigger of a later tick means that its sender has gone on: then nothing more will
    come for this one.
    """

    @abstractmethod
    def step(self, tick: int, arrived: Arrived) -> None:
        """One tick of the node; topics that did not come are absent from `arrived`."""

    def listen(self, inputs: tuple[Input, ...], datum: Datum | None = None) -> None:
        """Subscribe to the inputs (called from `setup`)."""
        self.lockstep = bool(self.values["lockstep"])
        self.trigger = inputs[0].topic
        self.assembler = TickAssembler({i.topic: i.demand for i in inputs})
        self.refused: dict[str, str] = {}
        self.silent: set[str] = set()
        self._arrived: dict[str, Any] = {}
        self._stepped = -1
        self._fresh = True
        self._progress_s = time.monotonic()
        self._subscriptions_of_ticks = []
        for item in inputs:
            decoder = Decoder(item.topic, datum if item.topic == topics.GPS_FIX else None)
            cls = topics.message_class(topics.BY_NAME[item.topic].type)
            callback = self._receiver(item, decoder)
            self._subscriptions_of_ticks.append(
                self.create_subscription(
                    cls, item.topic, callback, topics.qos(item.topic), raw=True
                )
            )
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._watch = self.create_timer(_WATCH_PERIOD_S, self._look_for_silence, clock=steady)

    def _receiver(self, item: Input, decoder: Decoder) -> Callable[[bytes], None]:
        """Callback for the serialised messages of a topic."""
        topic, off_tick, start_ns = item.topic, item.off_tick, self.start_ns
        decode, tick_ns = decoder.decode, topics.TICK_NS

        def receive(raw: bytes) -> None:
            try:
                value = decode(raw).copy()
            except CutOffError as error:
                self._refuse(topic, str(error))
                return
            except MessageError as error:
                value = None
                self._refuse(topic, str(error))
            tick, rest = divmod(decoder.stamp_ns - start_ns, tick_ns)
            if rest and not off_tick:
                self._refuse(topic, f"{topic}: stamp {decoder.stamp_ns} ns is not on a tick")
            elif self.lockstep:
                self._take_in_lockstep(topic, tick, value)
            else:
                self._take_in_real_time(topic, tick, value)

        return receive

    def _refuse(self, topic: str, reason: str) -> None:
        if self.refused.get(topic) != reason:
            self.get_logger().warning(f"message refused: {reason}")
        self.refused[topic] = reason

    # --- lockstep ----------------------------------------------------------------------------

    def _take_in_lockstep(self, topic: str, tick: int, value: Any) -> None:
        if not self.active and not self._fresh:
            return
        assembler = self.assembler
        if topic in self.silent:
            self.silent.discard(topic)
            assembler.waive(topic, False)
        if not assembler.add(topic, tick, (tick, value)) or not self.active:
            return
        if topic == self.trigger:
            if assembler.next_tick is None:
                assembler.start(tick)
            while assembler.next_tick < tick and not assembler.complete() and self.is_ready():
                self._step_lockstep()
        self.resume()

    def is_ready(self) -> bool:
        """Whether steps may be made at all; a node that waits for something else overrides it."""
        return True

    def resume(self) -> None:
        """Lockstep: make the steps whose messages are all there."""
        if not self.lockstep:
            return
        while self.active and self.assembler.complete() and self.is_ready():
            self._step_lockstep()

    def _step_lockstep(self) -> None:
        tick = self.assembler.next_tick
        self._progress_s = time.monotonic()
        self.tick = tick
        self.step(tick, self.assembler.take())
        self.send_report()

    def start_stepping(self) -> None:
        """On activation: take up what came while the node was getting ready."""
        self._fresh = False
        self._progress_s = time.monotonic()
        waiting = self.assembler.earliest(self.trigger)
        if self.lockstep and waiting is not None:
            self.assembler.start(waiting)
            self.resume()

    def stop_stepping(self) -> None:
        """On deactivation: forget what has been collected."""
        self.assembler.reset()
        self.silent.clear()
        self._arrived.clear()
        self._stepped = -1

    def _look_for_silence(self) -> None:
        """Bounded wait: after it, name the silent topics and go on without them."""
        assembler = self.assembler
        if not (self.lockstep and self.active) or assembler.next_tick is None:
            return
        self.resume()
        waited_s = time.monotonic() - self._progress_s
        missing = assembler.missing()
        if waited_s < self.values["peer_timeout_s"] or not missing or self.trigger in missing:
            return
        self.silent.update(missing)
        for topic in missing:
            assembler.waive(topic)
        self.get_logger().warning(self.silence())
        self.resume()

    def silence(self) -> str:
        """Sentence about silent topics and who should send them; empty if there are none."""
        if not self.silent:
            return ""
        parts = [
            f"'{topic}' from {'/'.join(topics.BY_NAME[topic].source)}"
            for topic in sorted(self.silent)
        ]
        return f"no message on {', '.join(parts)}: going on without"

    # --- real time ---------------------------------------------------------------------------

    def _take_in_real_time(self, topic: str, tick: int, value: Any) -> None:
        if not self.active or not self.assembler.keep_newest(topic, tick, value):
            return
        self._arrived[topic] = (tick, value)
        if topic == self.trigger and tick > self._stepped:
            self._stepped = self.tick = tick
            arrived, self._arrived = self._arrived, {}
            self.step(tick, arrived)
            self.send_report()

    # --- what all of them do -----------------------------------------------------------------

    def engage(self) -> None:
        """Begin to step."""
        self.start_stepping()

    def disengage(self) -> None:
        """Cease to step."""
        self.stop_stepping()

    def _drop_entities(self) -> None:
        super()._drop_entities()
        for subscription in getattr(self, "_subscriptions_of_ticks", []):
            self.destroy_subscription(subscription)
        self._subscriptions_of_ticks = []
        if getattr(self, "_watch", None) is not None:
            self.destroy_timer(self._watch)
            self._watch = None

    def stamp_ns(self, tick: int) -> int:
        """Message stamp of a tick."""
        return self.start_ns + tick * topics.TICK_NS

    def warn_or_ok(self, level: Level, message: str, facts: Mapping[str, Any]) -> None:
        """Report the core's state, or the silence of a peer if that is worse."""
        silence = self.silence()
        if silence and level < Level.WARN:
            level, message = Level.WARN, silence
        if (level, message) != (self._level, self._message) or self.tick % 100 == 0:
            self.report(level, message, facts)
