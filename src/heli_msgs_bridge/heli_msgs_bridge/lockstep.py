# SPDX-License-Identifier: Apache-2.0
"""Which messages belong to a tick, and whether all of them have come. No ROS."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Demand:
    """What a step needs from one topic.

    Attributes
    ----------
    every_ticks : int
        The step of tick n needs it if n is a multiple of this.
    lag_ticks : int
        The message for step n is stamped n - lag_ticks.
    first_tick : int
        Steps before this one do without it.
    """

    every_ticks: int = 1
    lag_ticks: int = 0
    first_tick: int = 0

    def due(self, tick: int) -> bool:
        """True if the step of this tick needs a message."""
        return tick >= self.first_tick and tick % self.every_ticks == 0


@dataclass
class Counters:
    """What was not used: duplicates, messages of past ticks, and of ticks too far ahead."""

    duplicate: int = 0
    late: int = 0
    ahead: int = 0


class TickAssembler:
    """Collects messages by tick in bounded memory.

    Parameters
    ----------
    demands : mapping of topic to Demand
        What a step needs.
    window_ticks : int
        How many ticks ahead of the next step are kept.
    """

    def __init__(self, demands: Mapping[str, Demand], window_ticks: int = 64) -> None:
        self._demands = dict(demands)
        self._waived: set[str] = set()
        self._window = window_ticks
        self._slots: dict[int, dict[str, Any]] = {}
        self.next_tick: int | None = None
        self.counters = Counters()
        # What the step of a tick waits for; looked at several times a tick, so kept.
        self._needed: frozenset[str] = frozenset()
        self._needed_at: int | None = None

    def reset(self) -> None:
        """Forget everything but the demands."""
        self._slots.clear()
        self.next_tick = None
        self._waived.clear()
        self._needed_at = None

    def waive(self, topic: str, waived: bool = True) -> None:
        """Do (not) wait for a topic; what comes is used nevertheless."""
        if waived:
            self._waived.add(topic)
        else:
            self._waived.discard(topic)
        self._needed_at = None

    def add(self, topic: str, stamp_tick: int, value: Any) -> bool:
        """Take a message; `value` None means that it came but cannot be used.

        Returns
        -------
        bool
            True if it was kept.
        """
        tick = stamp_tick + self._demands[topic].lag_ticks
        first = self.next_tick
        if first is not None and tick < first:
            self.counters.late += 1
            return False
        if first is not None and tick >= first + self._window:
            self.counters.ahead += 1
            return False
        slot = self._slots.get(tick)
        if slot is None:
            slot = self._slots[tick] = {}
        elif topic in slot:
            self.counters.duplicate += 1
            return False
        slot[topic] = value
        if first is None and len(self._slots) > self._window:
            oldest = min(self._slots)
            self.counters.late += len(self._slots.pop(oldest))
            return oldest != tick
        return True

    def start(self, tick: int) -> None:
        """Set the first tick to be stepped; what is outside of its window is dropped."""
        self.next_tick = tick
        for kept in list(self._slots):
            if kept < tick:
                self.counters.late += len(self._slots.pop(kept))
            elif kept >= tick + self._window:
                self.counters.ahead += len(self._slots.pop(kept))

    def kept(self, topic: str) -> list[int]:
        """Ticks for which a message of the topic is kept, ascending."""
        return sorted(tick for tick, slot in self._slots.items() if topic in slot)

    def missing(self) -> tuple[str, ...]:
        """Topics that the next step still waits for; all of them before the first tick is known."""
        tick = self.next_tick
        if tick is None:
            return tuple(self._demands)
        slot, needed = self._slots.get(tick, {}), self._needed_by(tick)
        return tuple(topic for topic in self._demands if topic in needed and topic not in slot)

    def _needed_by(self, tick: int) -> frozenset[str]:
        """Topics that the step of a tick demands and that are waited for."""
        if tick != self._needed_at:
            self._needed_at, waived = tick, self._waived
            self._needed = frozenset(
                t for t, demand in self._demands.items() if demand.due(tick) and t not in waived
            )
        return self._needed

    def complete(self) -> bool:
        """True if everything that the next step demands has come, and at least one message.

        So nothing steps on silence, though all topics be waived or none be due.
        """
        tick = self.next_tick
        if tick is None:
            return False
        slot = self._slots.get(tick)
        return slot is not None and self._needed_by(tick) <= slot.keys()

    def take(self) -> dict[str, Any]:
        """Messages of the next step (complete or not), which thereby is done.

        Raises
        ------
        RuntimeError
            If no first tick has been set.
        """
        if self.next_tick is None:
            raise RuntimeError("take() before start()")
        slot = self._slots.pop(self.next_tick, {})
        self.next_tick += 1
        return slot
