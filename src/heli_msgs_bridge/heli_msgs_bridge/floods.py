# SPDX-License-Identifier: Apache-2.0
"""How often and how much may be asked of a node, so that a flood costs it next to nothing. No ROS.

What is judged takes time that a tick then lacks: a law that is synthesised, a long message that
becomes objects. What is refused here has cost none of that.
"""

import math
import time
from collections.abc import Callable
from typing import Any

REQUESTS_PER_S, REQUESTS_AT_ONCE = 50.0, 100.0
"""Of service calls, per node, while it flies; a panel of sliders asks ten times a second."""
COMMANDS_PER_S, COMMANDS_AT_ONCE = 100.0, 200.0
"""Of messages on a topic of commands, which are planned and judged one by one."""
MOST_ORDERS = 16
"""Changes of parameters that may wait for their judgement."""
MOST_BYTES, MOST_WAY_BYTES = 1 << 16, 1 << 20
"""Of a message; of one that holds a way, whose points are counted afterwards."""

_TELL_AGAIN_S = 1.0


class Limit:
    """Lets so many through per second of wall time, and so many at once after a quiet time.

    Parameters
    ----------
    per_s, at_once : float
    what : str
        For the sentence: "requests to this node".
    now_s : callable, optional
        Wall time, s.

    Attributes
    ----------
    refused : int
        So far.
    """

    def __init__(
        self, per_s: float, at_once: float, what: str, now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._per_s, self._at_once, self._now_s = per_s, at_once, now_s
        self._left, self._looked_s = at_once, now_s()
        self.sentence = f"more than {per_s:g} {what} a second; ask less often"
        self.refused = 0

    def admits(self) -> bool:
        """Whether one more may pass now."""
        now_s = self._now_s()
        grown = self._left + (now_s - self._looked_s) * self._per_s
        self._left, self._looked_s = min(grown, self._at_once), now_s
        if self._left < 1.0:
            self.refused += 1
            return False
        self._left -= 1.0
        return True


def too_long(topic: str, size: int, most: int = MOST_BYTES) -> str:
    """Why a serialised message is not even looked into; empty if it may be."""
    return f"{topic}: a message of {size} bytes; allowed: at most {most}" if size > most else ""


class Requests:
    """Service calls of a node: while it flies, those that come too often are refused unheard.

    Parameters
    ----------
    flies : callable
        Whether it does.
    warn : callable
        Takes a line for the log.
    """

    def __init__(self, flies: Callable[[], bool], warn: Callable[[str], Any]) -> None:
        self.warn, self._flies, self._told_s = warn, flies, -math.inf
        self._limit = Limit(REQUESTS_PER_S, REQUESTS_AT_ONCE, "requests to this node")

    def flooded(self) -> str:
        """Why a call is refused; empty for one that is answered."""
        if not self._flies() or self._limit.admits():
            return ""
        now_s = time.monotonic()
        if now_s - self._told_s > _TELL_AGAIN_S:
            self._told_s = now_s
            self.warn(f"request refused: {self._limit.sentence}")
        return self._limit.sentence

    def told(self) -> str:
        """How many came too often, and why that is too often; empty if none did."""
        return f"{self._limit.refused}; {self._limit.sentence}" if self._limit.refused else ""
