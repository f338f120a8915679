# SPDX-License-Identifier: Apache-2.0
"""How often and how much may be asked of a node, so that a flood costs it next to nothing. No ROS.

What is judged takes time that a tick then lacks: a law that is synthesised, a long message that
becomes objects. What is refused here has cost none of that.
"""

import time
from collections.abc import Callable

REQUESTS_PER_S, REQUESTS_AT_ONCE = 50.0, 100.0
"""Of service calls, per node, while it flies; a panel of sliders asks ten times a second."""
COMMANDS_PER_S, COMMANDS_AT_ONCE = 100.0, 200.0
"""Of messages on a topic of commands, which are planned and judged one by one."""
MOST_ORDERS = 16
"""Changes of parameters that may wait for their judgement."""
MOST_BYTES, MOST_WAY_BYTES = 1 << 16, 1 << 20
"""Of a message; of one that holds a way, whose points are counted afterwards."""


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
