# SPDX-License-Identifier: Apache-2.0
"""The time of a bag that is being recorded: the flight's, whatever stamps arrive."""

from collections.abc import Iterable

from heli_core.ticks import NS_PER_S
from heli_msgs_bridge import topics

# -------------------------------------------------------------------------------------------------
# The time of a bag that is being recorded: the flight's, whatever stamps arrive. No rclpy.
#
# A message of the graph belongs where it was sent: where its stamp says, or a known latency later.
# When the recorder hears it says nothing: nobody waits for a recorder that lags. Not every stamp is
# of the flight's time: a pilot's `topic pub` has the wall clock's, zero or anything. Such a message
# is put where it was heard, and is no sign of a gap.
#
# In simulated time the messages of a tick are sent one after another at the same time: "superdense"
# time (Lee and Zheng, Operational semantics of hybrid systems, HSCC 2005) counts the steps besides.
# A bag has one number. Each step is a nanosecond of it, so that all readers keep the order, also
# those (`rosbags`) that put messages of one time in the order of their topics.
# -------------------------------------------------------------------------------------------------

LATE = (topics.GPS_FIX, topics.GPS_VELOCITY)
"""Stamped with the time of validity, and sent later: `BagRecorder` is told by how much."""
WINDOW_NS = 2 * NS_PER_S
"""A stamp so far ahead of the newest is of another time: each sender's messages come in order. How
far one is behind says nothing: DDS repeats what a full queue did not take after seconds."""


def steps_of(names: Iterable[str]) -> dict[str, int]:
    """Place of each topic among those of a bag, in the order in which a tick's messages are sent.

    That of a topic which no tick sends is 0.
    """
    recorded = set(names)
    in_order = [name for name in topics.SENDING_ORDER if name in recorded]
    return dict.fromkeys(recorded, 0) | {name: place for place, name in enumerate(in_order)}


def is_stream(name: str) -> bool:
    """Whether a topic has a message every so many ticks, so that its stamps tell the time."""
    return name in topics.BY_NAME and topics.BY_NAME[name].every_ticks > 0 and name not in LATE


class BagClock:
    """Which stamps are of the flight's time, and what time it is.

    Two messages in a row of `/clock` (of any stream if that is not recorded) that fit to each other
    set it: the recorder was started in flight, or time was begun anew.

    Parameters
    ----------
    start_ns : int
        Stamp of the flight's first tick.
    names : iterable of str
        What is recorded.

    Attributes
    ----------
    now_ns : int
        Newest stamp of the flight.
    known : bool
        False until a stream has confirmed or set the time.
    """

    def __init__(self, start_ns: int, names: Iterable[str]) -> None:
        streams = {name for name in names if is_stream(name)}
        self.now_ns, self.known = start_ns, False
        self._start_ns = start_ns
        self._streams = streams
        self._setters = streams & {topics.CLOCK} or streams
        self._doubted: dict[str, int] = {}

    @property
    def likely_ns(self) -> int:
        """The time; before it is known, what was last said of it."""
        doubted = [] if self.known else list(self._doubted.values())
        return doubted[-1] if doubted else self.now_ns

    def admits(self, name: str, sent_ns: int) -> bool:
        """Whether a message was sent in the flight's time, which it may move."""
        first_ns, row = self._start_ns, topics.KNOWN[name]
        if row.latched or not row.source:
            # A latched message may be as old as the flight, and a command may be stamped with
            # anything; it belongs where it was heard.
            first_ns = max(first_ns, self.now_ns - WINDOW_NS)
        if first_ns <= sent_ns <= self.now_ns + WINDOW_NS:
            if name in self._streams:
                self.known, self.now_ns = True, max(self.now_ns, sent_ns)
                self._doubted.pop(name, None)
            return True
        if name not in self._setters or sent_ns < 0:
            return False
        before, self._doubted[name] = self._doubted.get(name), sent_ns
        if before is None or not 0 < sent_ns - before <= WINDOW_NS:
            return False
        self.known, self.now_ns = True, sent_ns
        self._start_ns = min(self._start_ns, sent_ns)
        self._doubted.clear()
        return True
