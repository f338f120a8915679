# SPDX-License-Identifier: Apache-2.0
"""From the serialised messages of a topic to rows by tick."""

from collections.abc import Callable
from functools import partial
from typing import Protocol

from heli_math.ticks import Rate
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.messages import (
    ClockDecoder,
    CutOffError,
    Decoder,
    FrameError,
    MessageError,
)
from heli_msgs_bridge.stepping import Pace
from heli_msgs_bridge.tick_core import Input

# Of a message that holds a stamp.
_LEAST_BYTES = 12


class Hearer(Protocol):
    """What is needed of a node that hears."""

    start_ns: int
    tick: int
    rate: Rate

    @property
    def heard_until(self) -> int | None:
        """Tick up to which a predecessor has heard."""

    def refuse(self, topic: str, reason: str) -> None:
        """Say that a message was refused."""

    def refuse_aloud(self, topic: str, why: str) -> None:
        """The same, counted."""

    def refuse_stamp(self, topic: str, tick: int, clock_tick: int) -> None:
        """Say that a stamp does not fit to the clock."""


def receiver(
    node: Hearer, item: Input, decoder: Decoder | ClockDecoder, pace: Pace
) -> Callable[[bytes], None]:
    """Callback for the serialised messages of a topic.

    Parameters
    ----------
    node : Hearer
        Told of what is refused.
    item : Input
    decoder : Decoder or ClockDecoder
        Of its topic.
    pace : Pace
        Takes a row, or None for one that is none, by tick.
    """
    topic, off_tick, start_ns = item.topic, item.off_tick, node.start_ns
    earliest, tick_ns = -item.demand.lag_ticks, node.rate.tick_ns
    decode, refuse = decoder.decode, partial(node.refuse, item.topic)
    aloud = partial(node.refuse_aloud, item.topic)
    since = node.heard_until
    lag = item.demand.lag_ticks

    def receive(raw: bytes) -> None:
        nonlocal since
        if since is not None and len(raw) >= _LEAST_BYTES:
            # Of what is repeated, what the predecessor has heard.
            if (stamp_of(raw) - start_ns) // tick_ns + lag <= since:
                return
            since = None
        try:
            value = decode(raw).copy()
        except CutOffError as error:
            refuse(str(error))
            return
        except FrameError as error:
            value = None
            aloud(str(error))
        except MessageError as error:
            value = None
            refuse(str(error))
        tick, rest = divmod(decoder.stamp_ns - start_ns, tick_ns)
        if tick < earliest:
            node.refuse_stamp(topic, tick, node.tick)
        elif rest and not off_tick:
            refuse(f"{topic}: stamp {decoder.stamp_ns} ns is not on a tick")
        else:
            pace.take(topic, tick, value)

    return receive
