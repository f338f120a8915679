# SPDX-License-Identifier: Apache-2.0
"""Messages together with what DDS says of them: which one of its sender's it is, and when sent."""

import inspect
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

Info = Mapping[str, Any]
"""rclpy's message info: `source_timestamp` (ns), `publication_sequence_number` and others."""
Hearer = Callable[[Any, Info | None], None]
_MESSAGE_AND_INFO = inspect.Signature(
    [inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY) for name in ("message", "info")]
)
_REMEMBERED = 64


def with_info(hearer: Hearer) -> Callable[..., None]:
    """Callback for a subscription, by which every executor hands over the message's info, too.

    The EventsExecutor of Jazzy gives a pair where the others give two arguments. Without info (a
    callback called by hand) it is None.
    """

    def call(message: Any, info: Info | None = None) -> None:
        if isinstance(message, tuple):
            message, info = message
        hearer(message, info)

    # By the signature rclpy decides what it hands over.
    call.__signature__ = _MESSAGE_AND_INFO  # type: ignore[attr-defined]
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
