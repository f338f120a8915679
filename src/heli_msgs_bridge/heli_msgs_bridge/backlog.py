# SPDX-License-Identifier: Apache-2.0
"""What a node that was started again has missed, in the order of time. No ROS.

Its senders repeat what they have sent, each topic by itself, as fast as it goes. A step must not be
made before what belongs to it has come, so all of it is collected first.
"""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from heli_msgs_bridge.lockstep import Demand

_LIMIT_S = 0.15


class Backlog:
    """Messages of the past, until the trigger comes at its own pace again.

    Parameters
    ----------
    trigger : str
    demands : mapping of str to Demand
        Of each topic: how often it comes, and how late.
    pace_s : float
        Wall time between two messages of the trigger that are not repeated but new, at the least.
    now_s : callable, optional
        Wall time, s.
    """

    def __init__(
        self,
        trigger: str,
        demands: Mapping[str, Demand],
        pace_s: float,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._trigger, self._demands = trigger, dict(demands)
        self._pace_s, self._now_s = pace_s, now_s
        self._begun_s = self._came_s = 0.0
        self._is_new = False
        self._kept: dict[str, dict[int, Any]] = defaultdict(dict)

    def take(self, topic: str, tick: int, value: Any) -> None:
        """A message stamped with a tick."""
        now_s = self._now_s()
        if not self._kept:
            self._begun_s = self._came_s = now_s
        self._kept[topic].setdefault(tick, value)
        if topic == self._trigger:
            self._is_new, self._came_s = now_s - self._came_s >= self._pace_s, now_s

    def complete(self) -> bool:
        """Whether it can be flown: the trigger is new, and who sends at all has caught up; or
        after a limit."""
        if not self._kept[self._trigger]:
            return False
        newest = max(self._kept[self._trigger])
        level = all(
            newest - max(self._kept[topic]) <= demand.lag_ticks + demand.every_ticks
            for topic, demand in self._demands.items()
            # What answers this node's own messages cannot have come since.
            if self._kept[topic] and not demand.first_tick
        )
        return (self._is_new and level) or self._now_s() - self._begun_s > _LIMIT_S

    def steps(self) -> Iterator[tuple[int, dict[str, tuple[int, Any]]]]:
        """Ticks of the trigger in order, each with the newest of every topic since the one before.

        A message counts from the tick on at which it is due: a fix comes late.
        """
        waiting = {
            topic: sorted(ticks.items(), reverse=True) for topic, ticks in self._kept.items()
        }
        for tick in sorted(self._kept[self._trigger]):
            arrived = {}
            for topic, left in waiting.items():
                while left and left[-1][0] + self._demands[topic].lag_ticks <= tick:
                    arrived[topic] = left.pop()
            yield tick, arrived
