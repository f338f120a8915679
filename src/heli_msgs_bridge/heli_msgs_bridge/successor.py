# SPDX-License-Identifier: Apache-2.0
"""A node that goes on in flight where its predecessor, which was killed, has ended."""

from collections import defaultdict, deque
from collections.abc import Mapping
from functools import partial
from typing import Any, ClassVar

from heli_msgs_bridge import topics
from heli_msgs_bridge.managed_node import Core, ManagedNode, Run
from heli_msgs_bridge.memory import Recalled, memory_of
from heli_msgs_bridge.stamps import AHEAD_TICKS

# After a start in flight, for so many ticks, messages that nobody answers are sent again.
_AGAIN_S, _AGAIN_TICKS = 0.1, 50
# So many of each topic: who hears it may be dead, too, and some ticks behind. None is then so old
# that it could set a clock.
_LAST = AHEAD_TICKS


class Successor(ManagedNode[Core, Run]):
    """Leaves after each step what a successor needs, and begins with what it was left.

    Attributes
    ----------
    memory : Memory or None
        None where nobody is started again.
    """

    CATCHES_UP: ClassVar[bool] = False
    """Whether in real time, too, it steps through what it has missed when it is started again."""

    def __init__(self, values: Mapping[str, Any], **options: Any) -> None:
        self.memory = memory_of(self.SPEC.name)
        self._recalled: Recalled | None = self.memory.recall() if self.memory else None
        # Parameters that the predecessor was told in flight.
        before = self._recalled.content[0] if self._recalled else {}
        super().__init__({**values, **before}, **options)
        self._said_tick: int | None = None
        if self.memory is not None and self.values["lockstep"]:
            self.sent = defaultdict(partial(deque, maxlen=_LAST))

    def remember(self) -> Any:
        """What a successor would go on from, if this node were killed now; None for nothing."""
        return None

    def recall(self, content: Any, gap: bool) -> None:
        """Go on from what a predecessor has remembered; called before the first step.

        Parameters
        ----------
        content : object
            What `remember` gave.
        gap : bool
            Whether ticks were flown without this node that it will not step through.
        """

    def keep(self, tick: int) -> None:
        """After the step of a tick: write down what a successor would need."""
        if self.memory is not None and (content := self.remember()) is not None:
            self.memory.keep(tick, (self.changed, dict(self.sent or {}), content))

    @property
    def heard_until(self) -> int | None:
        """Tick up to which a predecessor has stepped, before the first step; None without one."""
        return self._recalled.tick if self._recalled else None

    def repeated(self) -> Any:
        """QoS by which a node that is started again hears what it has missed; None for others."""
        wanted = self._recalled is not None and (self.values["lockstep"] or self.CATCHES_UP)
        return topics.qos(topics.IMU, repeats=True) if wanted else None

    def take_over(self) -> int | None:
        """Go on in a predecessor's place; its last tick, or None if there was none."""
        known, self._recalled = self._recalled, None
        if known is None:
            return None
        self.tick = known.tick
        self.changed, sent, content = known.content
        self.recall(content, not (self.values["lockstep"] or self.CATCHES_UP))
        said = f"started again in flight, after {self.rate.seconds(known.tick):.2f} s of it"
        self.get_logger().warning(said)
        if self.sent is not None:
            # Each waits for the other there, so whoever did not know this node yet hears it again,
            # and another that died with it what only the dead one had sent.
            for topic, raws in sent.items():
                self.sent[topic].extend(raws)
            self.repeat(_AGAIN_S, partial(self._say_again, known.tick + _AGAIN_TICKS))
        return known.tick

    def _say_again(self, until: int) -> None:
        """Lockstep, soon after a start in flight: send the last messages again if none followed."""
        if self.tick > until or self.sent is None:
            return
        if self.tick == self._said_tick:
            for topic, raws in self.sent.items():
                for raw in raws:
                    self.outputs[topic].handle.publish_raw(raw)
        self._said_tick = self.tick
