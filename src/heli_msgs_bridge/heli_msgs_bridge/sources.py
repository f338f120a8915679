# SPDX-License-Identifier: Apache-2.0
"""Messages together with what DDS says of them: which one of its sender's it is, and when sent.

So a message that two subscriptions hear counts once, and a topic has one owner. No ROS.
"""

import inspect
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from heli_math.ticks import NS_PER_S
from heli_msgs_bridge.cdr import stamp_of

Info = Mapping[str, Any]
"""rclpy's message info: `source_timestamp` (ns), `publication_sequence_number` and others."""
Hearer = Callable[[Any, Info | None], None]
_MESSAGE_AND_INFO = inspect.Signature(
    [inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY) for name in ("message", "info")]
)
_REMEMBERED = 256
_MOST_PERIODS, _MOST_OTHERS = 4, 64
# Of a message that holds a stamp.
_LEAST_BYTES = 12
HEIR_S = 0.08
"""Wall time after which an heir succeeds an owner that is not heard."""


def with_info(hearer: Hearer) -> Callable[..., None]:
    """Callback for a subscription, by which every executor hands over the message's info, too.

    The EventsExecutor of Jazzy gives a pair where the others give two arguments. Without info (a
    callback called by hand) it is None.
    """

    def call(message: Any, info: Info | None = None) -> None:
        if isinstance(message, tuple):
            message, info = message
        hearer(message, info)

    return telling(call)


def telling(call: Callable[..., None]) -> Callable[..., None]:
    """The callback, marked: by its signature rclpy decides whether it hands the info over."""
    call.__signature__ = _MESSAGE_AND_INFO  # type: ignore[attr-defined]
    return call


def owned(
    owner: "Owner", hear: Callable[[bytes], None], ignored: Callable[[], None] | None
) -> Callable[..., None]:
    """Callback that hears the owner's serialised messages, for `telling`; the rest is ignored."""
    admits = owner.admits

    def call(message: Any, info: Info | None = None) -> None:
        if type(message) is tuple:
            message, info = message
        if admits(message, info):
            hear(message)
        elif ignored is not None:
            ignored()

    return call


class Once:
    """Whether a message has not come before, for two subscriptions to one topic.

    A latched topic has two: only one that asks for old messages gets the last one of a latched
    sender, only one that does not hears a sender of default QoS. Both hear a latched sender.
    """

    def __init__(self) -> None:
        self._heard: deque[tuple[int, int]] = deque(maxlen=_REMEMBERED)

    def is_new(self, info: Info | None) -> bool:
        """True the first time; also for a message of which nothing is known."""
        if info is None:
            return True
        key = info["publication_sequence_number"], info["source_timestamp"]
        if key in self._heard:
            return False
        self._heard.append(key)
        return True


class Owner:
    """Whose messages of a topic are used: those of the sender that was heard first.

    Jazzy's rclpy does not say who sent a message, but which one of its sender's it is. The owner's
    next one has the next number; another sender's numbers are elsewhere. Where both are the same,
    the stamps decide, which go on from the owner's last by whole periods: a sender with the same
    numbers and the same stamps is not told from it. If the owner is gone or silent for long,
    the next message's sender succeeds it, until the owner is heard again. An heir, a node of the
    owner's name that was started in its place, need not wait so long.

    Parameters
    ----------
    count : callable
        How many senders the topic has now, by the graph; asked only about unexpected numbers.
    silence_s : float
        Wall time after which a silent owner is succeeded by whoever sends.
    period_ns : int
        Distance of two stamps; 0 where there is none: any later one within a second goes on.
    now_s : callable, optional
        Wall time, s, where the middleware does not say when a message came. What waited in a
        queue came earlier than it is judged: a reader that lags sees no silence in its own time.
    heir : callable, optional
        Whether an unexpected number is that of an heir of the owner, which may be dead; told
        whether the owner has been silent for `HEIR_S`; before that not asked about known others.

    Attributes
    ----------
    ignored : int
        Messages of others, so far.
    successions : int
        How often another sender has become the owner; heirs do not count.
    """

    def __init__(
        self,
        count: Callable[[], int],
        silence_s: float,
        period_ns: int,
        now_s: Callable[[], float] = time.monotonic,
        heir: Callable[[bool], bool] = lambda silent: False,
    ) -> None:
        self._count, self._silence_s, self._now_s = count, silence_s, now_s
        self._heir = heir
        self._period_ns = period_ns
        self._number: int | None = None
        self._before: int | None = None
        self._raw = b""
        self._heard_s = 0.0
        self._others: set[int] = set()
        self.ignored = self.successions = 0

    def admits(self, raw: bytes, info: Info | None) -> bool:
        """Whether a serialised message is the owner's; without info it counts as the owner's."""
        if info is None:
            return True
        number = info["publication_sequence_number"]
        came_s = info.get("received_timestamp", 0) / NS_PER_S or self._now_s()
        if (number - 1 == self._number and not self._others) or self._judge(number, raw, came_s):
            self._number, self._raw, self._heard_s = number, raw, came_s
            return True
        self.ignored += 1
        return False

    def _judge(self, number: int, raw: bytes, came_s: float) -> bool:
        """Whether a message is the owner's, though its number says so not by itself."""
        own, before = self._number, self._before
        if own is None:
            return True
        next_one, known = number == own + 1, number in self._others
        if next_one and (not known or self._continues(raw)):
            return True
        if before is not None and number == before + 1:
            self._others.add(own + 1)
            self._before = None
            return True
        alone, silent_s = not next_one and self._count() <= 1, came_s - self._heard_s
        silent = silent_s > HEIR_S
        if (silent or not (known or next_one)) and self._heir(silent):
            self._others.clear()
            self._before = own
            return True
        if alone or silent_s > self._silence_s:
            # Numbers that go on are the owner's: messages between were lost.
            self.successions += not (alone and number > own)
            self._others.clear()
            self._before = own
            return True
        self._others.discard(number)
        if len(self._others) < _MOST_OTHERS:
            self._others.add(number + 1)
        return False

    def _continues(self, raw: bytes) -> bool:
        """Whether a stamp follows upon the owner's last one."""
        if min(len(raw), len(self._raw)) < _LEAST_BYTES:
            return False
        step_ns = stamp_of(raw) - stamp_of(self._raw)
        if not self._period_ns:
            return 0 < step_ns <= NS_PER_S
        return 0 < step_ns <= _MOST_PERIODS * self._period_ns and step_ns % self._period_ns == 0
