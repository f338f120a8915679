# SPDX-License-Identifier: Apache-2.0
"""A recorded flight by its time: what the live page would have shown at any moment. No ROS.

The newest message of each topic that is not later than the moment goes into the same `LiveState`
that a flying graph fills, so page and replay cannot differ in what a number means.
"""

import bisect
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from heli_bags.reader import Remark, Stream
from heli_live_view.live_state import COUNTED, GRAPH_NODES, SHOWN, LiveState
from heli_math.ticks import NS_PER_S, TICK_NS
from heli_math.trajectory import Trajectory
from heli_msgs_bridge import topics

# A node that flies reports once a second of flight; if it has not for so long it has left. Others
# report by the wall clock.
_PRESENT_NS = 3 * NS_PER_S


class EmptyRecordError(ValueError):
    """Nothing was recorded that can be shown; the message is one sentence."""


@dataclass(frozen=True)
class Recording:
    """Messages of one flight.

    Attributes
    ----------
    streams : mapping
        Topic name (relative) to its messages, stamps rising.
    remarks : sequence of Remark
        Of /diagnostics, stamps rising.
    references : sequence of (int, Trajectory)
        Each with the stamp at which it came, rising.
    start_ns : int
        Stamp of flight time 0.
    stale_s : float
        Flight time after which a value that was not renewed is no longer shown.
    windows_s : sequence of float
        Pairs of flight times that are scored; none: unknown.

    Raises
    ------
    EmptyRecordError
        No topic that is shown holds a message.
    """

    streams: Mapping[str, Stream]
    remarks: Sequence[Remark]
    references: Sequence[tuple[int, Trajectory]]
    start_ns: int
    stale_s: float
    windows_s: Sequence[float] = ()
    first_ns: int = field(init=False)
    last_ns: int = field(init=False)
    _said: Mapping[str, tuple[list[int], list[Remark]]] = field(init=False)

    def __post_init__(self) -> None:
        shown = [self.streams[name] for name in SHOWN if name in self.streams]
        stamps = [stream.stamp_ns for stream in shown if stream.stamp_ns.size]
        if not stamps:
            raise EmptyRecordError("nothing was recorded that can be shown")
        said: dict[str, tuple[list[int], list[Remark]]] = {}
        for remark in self.remarks:
            times, of_node = said.setdefault(remark.node, ([], []))
            times.append(remark.stamp_ns)
            of_node.append(remark)
        object.__setattr__(self, "first_ns", min(int(stamp[0]) for stamp in stamps))
        object.__setattr__(self, "last_ns", max(int(stamp[-1]) for stamp in stamps))
        object.__setattr__(self, "_said", said)

    def fresh(self) -> LiveState:
        """A state before the flight."""
        return LiveState(self.start_ns, self.stale_s, self.windows_s)

    def seconds(self, stamp_ns: int) -> float:
        """Flight time of a stamp, s."""
        return (stamp_ns - self.start_ns) / NS_PER_S

    def stamp(self, time_s: float) -> int:
        """Stamp of a flight time, within the record."""
        wanted_ns = self.start_ns + round(time_s * NS_PER_S)
        return min(max(wanted_ns, self.first_ns), self.last_ns)

    def at(self, stamp_ns: int) -> LiveState:
        """The state at a stamp, out of the newest messages that are not later."""
        live = self.fresh()
        came = bisect.bisect_right(self.references, stamp_ns, key=lambda pair: pair[0])
        if self.references:
            # Before the first one has come its way is shown already, as the report does.
            live.take_reference(self.references[max(came - 1, 0)][1])
        newest = [
            remarks[i - 1]
            for times, remarks in self._said.values()
            if (i := bisect.bisect_right(times, stamp_ns))
        ]
        # In order: a clock that goes back is another flight.
        for remark in sorted(newest, key=lambda remark: remark.stamp_ns):
            self.hear(live, remark)
        self.fill(live, stamp_ns)
        live.take_events()
        return live

    def hear(self, live: LiveState, remark: Remark) -> None:
        """Give one remark to a state, at its time."""
        live.take_clock(remark.stamp_ns, remark.stamp_ns / NS_PER_S)
        live.take_status(remark.node, remark.level, remark.message, remark.facts)

    def fill(self, live: LiveState, stamp_ns: int) -> None:
        """Give a state the clock, the newest message of each topic, and who is there."""
        live.take_clock(stamp_ns, stamp_ns / NS_PER_S)
        newest_ns = 0
        for name, stream in self.streams.items():
            i = int(np.searchsorted(stream.stamp_ns, stamp_ns, side="right")) - 1
            if i < 0:
                continue
            came_ns = int(stream.stamp_ns[i])
            newest_ns = max(newest_ns, came_ns)
            if name in SHOWN:
                live.take(name, stream.rows[i], came_ns / NS_PER_S)
            else:
                live.take_arrival(name, came_ns, came_ns / NS_PER_S)
        # Of the clock's own topic bags may lack a part; where messages are, it ran.
        live.take_arrival(topics.CLOCK, newest_ns, newest_ns / NS_PER_S)
        self._look_around(live, stamp_ns)

    def _look_around(self, live: LiveState, stamp_ns: int) -> None:
        """Who has spoken so far, and who does still."""
        heard, present = [], []
        for name, (times, _) in self._said.items():
            i = bisect.bisect_right(times, stamp_ns) - 1
            if i >= 0:
                heard.append(name)
                if name not in GRAPH_NODES or stamp_ns - times[i] <= _PRESENT_NS:
                    present.append(name)
        wall_s = stamp_ns / NS_PER_S
        live.take_presence(heard, True, wall_s)
        live.take_presence(present, True, wall_s)

    def samples(self, after_ns: int, until_ns: int) -> Iterator[tuple[str, int, np.ndarray]]:
        """Every message behind the first stamp and up to the second of a topic that is counted."""
        for name in COUNTED:
            stream = self.streams.get(name)
            if stream is None:
                continue
            first, behind = np.searchsorted(stream.stamp_ns, (after_ns, until_ns), side="right")
            for i in range(int(first), int(behind)):
                # The figures count samples of 10 ms; a flight may have more.
                if (int(stream.stamp_ns[i]) - self.start_ns) % TICK_NS:
                    continue
                yield name, int(stream.stamp_ns[i]), stream.rows[i]
