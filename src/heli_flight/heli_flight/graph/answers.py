# SPDX-License-Identifier: Apache-2.0
"""Which nodes have made a transition: by their answers, or by their state where one is lost.

A service's answer is not sent when the asker's reader is not known yet (rmw waits 0.1 s), and many
participants that start together on loaded cores take longer to know each other.
"""

import time
from collections.abc import Callable, Mapping
from typing import Any

ASK_AGAIN_S = 2.0


class Answers:
    """Of nodes that were asked for the same transition.

    Parameters
    ----------
    changes : mapping
        Name to the future of ChangeState.
    ask : callable
        From a name to a future of GetState.
    target : int
        Id of the state to which the transition leads; the nodes were in another one.
    now_s : callable, optional
        Wall time, s.
    """

    def __init__(
        self,
        changes: Mapping[str, Any],
        ask: Callable[[str], Any],
        target: int,
        now_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._changes, self._ask, self._target, self._now_s = changes, ask, target, now_s
        self._asked: dict[str, Any] = {}
        self._arrived: set[str] = set()
        self._due_s = now_s() + ASK_AGAIN_S

    def silent(self) -> list[str]:
        """Nodes of which nothing says yet how it went."""
        return [
            name
            for name, change in self._changes.items()
            if not change.done() and name not in self._arrived
        ]

    def complete(self) -> bool:
        """Whether all are through; asks for the state of those that are silent for long."""
        for name, state in self._asked.items():
            # Another state says nothing: the transition may not have begun.
            if state.done() and state.result().current_state.id == self._target:
                self._arrived.add(name)
        silent = self.silent()
        if silent and self._now_s() >= self._due_s:
            self._due_s = self._now_s() + ASK_AGAIN_S
            self._asked = {name: self._ask(name) for name in silent}
        return not silent

    def refused(self) -> list[str]:
        """Nodes that have answered that they did not."""
        return [
            name
            for name, change in self._changes.items()
            if change.done() and not change.result().success
        ]
