# SPDX-License-Identifier: Apache-2.0
"""How far a message's stamp may be from the clock of the node that hears it. No ROS.

A node knows time from its trigger. A stamp of another clock must neither be flown nor make what
comes after it late.
"""

from collections.abc import Callable

from heli_math.ticks import NS_PER_S

Refused = Callable[[str, int, int], None]
"""Told of a message whose stamp does not fit: topic, its tick, the tick of the node's clock."""

AHEAD_TICKS = 4
"""How far a stamp may be ahead of the node's clock; in real time in ticks of 10 ms. No node stamps
the future, so a message is ahead only by what the listener has not heard yet: in lockstep one tick,
as nobody goes on before this node has stepped; in real time the same, as the clock runs on by wall
time. The rest is for messages of the trigger that were lost on the way."""


class Setting:
    """When the trigger, which is the clock of a node, may set it anew.

    One message that does not fit is refused. Two in a row that fit to each other are the time of
    whoever sends: the clock was wrong, or time was begun anew.
    """

    def __init__(self) -> None:
        self._doubted: int | None = None

    def fits(self) -> None:
        """A message has come that fits."""
        self._doubted = None

    def sets_clock(self, tick: int, most_ticks: int) -> bool:
        """Whether a message that does not fit continues the one before it."""
        before, self._doubted = self._doubted, tick
        sets = before is not None and 0 < tick - before <= most_ticks
        if sets:
            self._doubted = None
        return sets


def in_words(topic: str, stamp_ns: int, clock_ns: int, start_ns: int) -> str:
    """Why a stamp is refused.

    Parameters
    ----------
    topic : str
    stamp_ns, clock_ns, start_ns : int
        Of the message, of the node that heard it, and of tick 0.
    """
    stamp_s, clock_s, start_s = (ns / NS_PER_S for ns in (stamp_ns, clock_ns, start_ns))
    if stamp_ns == 0:
        return f"{topic}: the stamp is zero; stamp messages with the flight's time, /clock"
    if stamp_ns < start_ns:
        return f"{topic}: stamped {stamp_s:.2f} s, before the flight's first moment, {start_s:g} s"
    side = "ahead of" if stamp_ns > clock_ns else "behind"
    return f"{topic}: stamped {stamp_s:.2f} s, {side} this node's clock, {clock_s:.2f} s"
