# SPDX-License-Identifier: Apache-2.0
"""A recorded flight for the page: greeting, events, states at any moment, the rows between. No ROS.

The record is gone through once: for the rows that charts and track need, for the largest errors so
far, and for the events that the live page would have told. A seek then only looks up.
"""

import bisect
import math
import re
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from heli_bags.reader import Remark, Stream
from heli_core.ticks import NS_PER_S, TICK_NS
from heli_core.trajectory import Trajectory
from heli_live_view.commands import listed
from heli_live_view.state import (
    COUNTED,
    GRAPH_NODES,
    OWN_NAME,
    SHOWN,
    LiveState,
    TimelineEvent,
    compact,
    greeting,
)
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import (
    FACT_FLOOD,
    FACT_MODE,
    FACT_REFUSED,
    NodeState,
    refusal_of,
)

# -------------------------------------------------------------------------------------------------
# A recorded flight by its time: what the live page would have shown at any moment. No ROS.
#
# The newest message of each topic that is not later than the moment goes into the same `LiveState`
# that a flying graph fills, so page and replay cannot differ in what a number means.
# -------------------------------------------------------------------------------------------------

# A node that flies reports once a second of flight; if it has not for so long it has left. Others
# report by the wall clock.
_PRESENT_NS = 3 * NS_PER_S


class EmptyRecordError(ValueError):
    """Nothing was recorded that can be shown; the message is one sentence."""


@dataclass(frozen=True)
class FlightRecording:
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
    _remarks_by_node: Mapping[str, tuple[list[int], list[Remark]]] = field(init=False)

    def __post_init__(self) -> None:
        shown = [self.streams[name] for name in SHOWN if name in self.streams]
        stamps = [stream.stamp_ns for stream in shown if stream.stamp_ns.size]
        if not stamps:
            raise EmptyRecordError("nothing was recorded that can be shown")
        by_node: dict[str, tuple[list[int], list[Remark]]] = {}
        for remark in self.remarks:
            times, of_node = by_node.setdefault(remark.node, ([], []))
            times.append(remark.stamp_ns)
            of_node.append(remark)
        object.__setattr__(self, "first_ns", min(int(stamp[0]) for stamp in stamps))
        object.__setattr__(self, "last_ns", max(int(stamp[-1]) for stamp in stamps))
        object.__setattr__(self, "_remarks_by_node", by_node)

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
            for times, remarks in self._remarks_by_node.values()
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
        for name, (times, _) in self._remarks_by_node.items():
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


# -------------------------------------------------------------------------------------------------
# What happened in a recorded flight and is worth a jump: modes, faults, failsafes, refusals.
#
# Out of what the nodes said in /diagnostics; who reads a record may add what else is known. No
# ROS.
# -------------------------------------------------------------------------------------------------

MODE, FAULT, FAILSAFE, REFUSAL, GROUND, GUST, END, HEALTH = (
    "mode", "fault", "failsafe", "refusal", "ground", "gust", "end", "health",
)  # fmt: skip
"""Kinds of what happens."""
_FAILSAFE = "failsafe"
_QUIET = ("none", "")
_BEFORE_FLIGHT = (
    NodeState.UNCONFIGURED,
    NodeState.CONFIGURED,
    NodeState.ACTIVE,
    NodeState.INACTIVE,
)
_TIMES = re.compile(r" from (?P<start>[-+.e\d]+)(?: to (?P<end>[-+.e\d]+) s| s on)$")
# The same refusal stands in what the node says and in its facts.
_TOGETHER_S = 1.5


@dataclass(frozen=True)
class FlightEvent:
    """One line of a replay's timeline.

    Attributes
    ----------
    time_s : float
        Flight time.
    kind : str
        One of the kinds above.
    level : int
        0 to 2, as in /diagnostics.
    source, text : str
        Who says so, and what.
    """

    time_s: float
    kind: str
    level: int
    source: str
    text: str

    def message(self) -> dict[str, Any]:
        """As sent to a browser."""
        return {
            "type": "event", "t": round(self.time_s, 3), "kind": self.kind, "level": self.level,
            "source": self.source, "text": self.text,
        }  # fmt: skip


def as_flight_event(event: TimelineEvent) -> FlightEvent | None:
    """A line of the live view's timeline, with its kind; None for what is no news of a flight."""
    kind, level = HEALTH, min(event.level, 2)
    if event.state in _BEFORE_FLIGHT and not level or event.text == "mode: over":
        return None
    if event.text.startswith("mode: "):
        kind = MODE
    elif event.text.startswith("fault: "):
        kind = FAULT
    elif "refused" in event.text:
        kind = REFUSAL
    return FlightEvent(event.time_s or 0.0, kind, level, event.source, event.text)


def of_remarks(remarks: Iterable[Remark], start_ns: int) -> list[FlightEvent]:
    """Modes, failsafes, refusals and faults, out of the facts of /diagnostics.

    Parameters
    ----------
    remarks : iterable of Remark
        Stamps rising.
    start_ns : int
        Stamp of flight time 0.
    """
    events: list[FlightEvent] = []
    known: dict[tuple[str, str], str] = {}
    for remark in remarks:
        time_s = (remark.stamp_ns - start_ns) / 1e9
        if remark.facts.get("over") == "true" != known.get((remark.node, "over")):
            events.append(
                FlightEvent(time_s, END, min(remark.level, 2), remark.node, remark.message)
            )
        for key, value in remark.facts.items():
            before = known.get((remark.node, key))
            known[remark.node, key] = value
            if value == before:
                continue
            if key == FACT_MODE:
                events.append(FlightEvent(time_s, MODE, 0, remark.node, f"mode: {value}"))
            elif key == _FAILSAFE and (before or value.lower() not in _QUIET):
                calm = value.lower() in _QUIET
                words = "failsafe ends" if calm else f"failsafe: {_plain(value)}"
                events.append(FlightEvent(time_s, FAILSAFE, int(not calm), remark.node, words))
            elif key.startswith(FACT_REFUSED) and key != FACT_FLOOD:
                topic, (_, why) = key.removeprefix(FACT_REFUSED), refusal_of(value)
                words = f"refused: {why if topic in why else f'{topic}: {why}'}"
                events.append(FlightEvent(time_s, REFUSAL, 1, remark.node, words))
    return events + of_faults(words for remark in remarks for words in listed(remark.facts))


def _plain(name: str) -> str:
    return name.replace("_", " ").lower()


def of_faults(words: Iterable[str]) -> list[FlightEvent]:
    """Beginning and end of each fault, out of what it is called ("... from 12 to 17 s")."""
    events = []
    for one in dict.fromkeys(words):
        times = _TIMES.search(one)
        if times is None:
            continue
        name = one[: times.start()]
        events.append(FlightEvent(float(times["start"]), FAULT, 1, FAULT, f"{name} begins"))
        if times["end"]:
            events.append(FlightEvent(float(times["end"]), FAULT, 0, FAULT, f"{name} ends"))
    return events


def in_order(events: Iterable[FlightEvent], until_s: float) -> list[FlightEvent]:
    """All up to a time in the order of their times; what is said twice, once."""
    in_span = [one for one in events if one.time_s <= until_s]
    if any(one.kind == MODE and one.source != OWN_NAME for one in in_span):
        # The outer loop has said more than that it sends something.
        in_span = [one for one in in_span if (one.source, one.text) != (OWN_NAME, "mode: hover")]
    if any(one.kind == FAULT and one.source == FAULT for one in in_span):
        # With beginning and end of each the plant's own word of them says nothing more.
        in_span = [one for one in in_span if one.kind != FAULT or one.source != "plant"]
    kept: list[FlightEvent] = []
    for one in sorted(in_span, key=lambda happening: (happening.time_s, happening.kind == HEALTH)):
        if not _is_known(one, kept):
            kept.append(one)
    return kept


def _is_known(one: FlightEvent, before: Sequence[FlightEvent]) -> bool:
    """True if the same was said just before, by whomever; a refusal also in other words."""
    for other in reversed(before):
        if one.time_s - other.time_s > _TOGETHER_S:
            return False
        a, b = (h.text.removeprefix("message ").removeprefix("refused: ") for h in (one, other))
        if a == b or (one.kind == other.kind == REFUSAL and (a in b or b in a)):
            return True
    return False


# -------------------------------------------------------------------------------------------------
# Replay.
# -------------------------------------------------------------------------------------------------

ROW_TICKS = 7
"""Ticks between the rows of charts and track: as many as the live page keeps, 14 a second."""
# In longer records the rows lie further apart, and the largest errors are renewed less often.
_MOST_ROWS, _MOST_COUNTS = 20_000, 3_000
_BODY = ("p", "euler_deg", "error")


@dataclass(frozen=True)
class ReplayOutcome:
    """What stands beside a replay.

    Attributes
    ----------
    ended : str
        How the flight ended, a sentence; empty: as the record says.
    notes : sequence of str
        What is not in the record, and what was taken instead.
    report : str
        Address of the flight's report on the same server; empty: there is none.
    at_end : bool
        Whether a browser begins at the end, standing, rather than at the beginning, running.
    """

    ended: str = ""
    notes: Sequence[str] = ()
    report: str = ""
    at_end: bool = False


def _slim(row: Mapping[str, Any]) -> str:
    """What charts and track need of a state."""
    slim: dict[str, Any] = {key: row[key] for key in ("t", "setpoint_deg", "u")}
    for source in ("truth", "nav"):
        body = row[source]
        slim[source] = None if body is None else {key: body[key] for key in _BODY}
    return compact(slim)


@dataclass
class _Passed:
    """What one way through the record leaves behind."""

    row_ns: list[int] = field(default_factory=list)
    rows: list[str] = field(default_factory=list)
    largest_ns: list[int] = field(default_factory=list)
    largest: list[dict[str, object] | None] = field(default_factory=list)
    events: list[FlightEvent] = field(default_factory=list)


class Replay:
    """A recorded flight, ready to be shown.

    Parameters
    ----------
    recording : FlightRecording
    values : mapping
        Parameters of the node `live_view`, with what the page says of the flight.
    telling : ReplayOutcome
    known : iterable of FlightEvent
        Events that are known besides what the nodes said.
    progress : callable
        Told seconds done and in all while the record is gone through.

    Attributes
    ----------
    recording : FlightRecording
    events : list of FlightEvent
        In the order of their times.
    """

    def __init__(
        self,
        recording: FlightRecording,
        values: Mapping[str, Any],
        telling: ReplayOutcome | None = None,
        known: Iterable[FlightEvent] = (),
        progress: Callable[[int, int], None] = lambda done, total: None,
    ) -> None:
        self.recording = recording
        self._values, self._telling = values, telling or ReplayOutcome()
        self._passed = self._go_through(progress)
        events = [*self._passed.events, *of_remarks(recording.remarks, recording.start_ns), *known]
        self.events = in_order(events, recording.seconds(recording.last_ns) + 1.0)

    def _go_through(self, progress: Callable[[int, int], None]) -> _Passed:
        r, passed = self.recording, _Passed()
        live, total_s = r.fresh(), int(r.seconds(r.last_ns) - r.seconds(r.first_ns))
        ticks = max(ROW_TICKS, -(-(r.last_ns - r.first_ns) // (TICK_NS * _MOST_ROWS)))
        stamps = [*range(r.first_ns, r.last_ns, ticks * TICK_NS), r.last_ns]
        heard = referred = 0
        before_ns = r.first_ns - 1
        batch = -(-len(stamps) // _MOST_COUNTS)
        for k, stamp_ns in enumerate(stamps):
            while referred < len(r.references) and (
                referred == 0 or r.references[referred][0] <= stamp_ns
            ):
                live.take_reference(r.references[referred][1])
                referred += 1
            while heard < len(r.remarks) and r.remarks[heard].stamp_ns <= stamp_ns:
                r.hear(live, r.remarks[heard])
                heard += 1
            if k % batch == 0 or stamp_ns == r.last_ns:
                for name, sample_ns, row in r.samples(before_ns, stamp_ns):
                    live.take_sample(name, sample_ns, row)
                before_ns = stamp_ns
            r.fill(live, stamp_ns)
            self._keep(passed, stamp_ns, live.row(stamp_ns / NS_PER_S))
            flight_events = map(as_flight_event, live.take_events())
            passed.events += [happening for happening in flight_events if happening is not None]
            progress(int(r.seconds(stamp_ns) - r.seconds(r.first_ns)), total_s)
        return passed

    @staticmethod
    def _keep(passed: _Passed, stamp_ns: int, row: Mapping[str, Any]) -> None:
        passed.row_ns.append(stamp_ns)
        passed.rows.append(_slim(row))
        if not passed.largest or row["largest"] != passed.largest[-1]:
            passed.largest_ns.append(stamp_ns)
            passed.largest.append(row["largest"])

    @property
    def at_end(self) -> bool:
        """Whether a browser begins at the end."""
        return self._telling.at_end

    @property
    def notes(self) -> Sequence[str]:
        """What is not in the record, and what was taken instead."""
        return self._telling.notes

    # --- what a browser gets -----------------------------------------------------------------

    def hello(self) -> str:
        """First message of a connection."""
        r, telling = self.recording, self._telling
        span_s = [round(r.seconds(stamp), 3) for stamp in (r.first_ns, r.last_ns)]
        return compact(
            greeting(self._values, commands=False)
            | {
                "events": [happening.message() for happening in self.events],
                "history": [],
                "replay": {
                    "from_s": span_s[0], "to_s": span_s[1], "at_end": telling.at_end,
                    "ended": telling.ended, "notes": list(telling.notes),
                    "report": telling.report or None,
                },
            }
        )  # fmt: skip

    def state(self, stamp_ns: int) -> dict[str, Any]:
        """The state at a stamp, as the live view would have shown it: the record's own values."""
        row = self.recording.at(stamp_ns).row(stamp_ns / NS_PER_S)
        i = bisect.bisect_right(self._passed.largest_ns, stamp_ns) - 1
        row["largest"] = self._passed.largest[i] if i >= 0 else None
        row["rtf"] = None
        return row

    def past(self, after_ns: int, until_ns: int) -> list[str]:
        """Rows (JSON texts) for charts and track, behind the first stamp and up to the second."""
        times = self._passed.row_ns
        return self._passed.rows[
            bisect.bisect_right(times, after_ns) : bisect.bisect_right(times, until_ns)
        ]


# -------------------------------------------------------------------------------------------------
# One browser's way through a replay: where it is, how fast, what it is sent next. No ROS.
# -------------------------------------------------------------------------------------------------

SLOWEST, FASTEST = 0.25, 16.0
"""Flight seconds per second of the wall clock."""
_SHOWN_NS = 32 * NS_PER_S
"""What charts, track and trail show of the past, and a little more."""


class ReplayError(ValueError):
    """A wish that is refused; the message is one sentence."""


def _number(wish: Mapping[str, Any], name: str, lower: float, upper: float) -> float:
    value = wish[name]
    known = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not known or not lower <= value <= upper:
        raise ReplayError(f"{name}: {value!r} is not allowed; allowed: {lower:g} to {upper:g}")
    return float(value)


class Viewer:
    """Where one browser is in the record.

    Parameters
    ----------
    replay : Replay
    now : callable
        Steady time, s.

    Attributes
    ----------
    runs : bool
        Whether time goes on.
    """

    def __init__(self, replay: Replay, now: Callable[[], float] = time.monotonic) -> None:
        self._replay, self._now = replay, now
        r = replay.recording
        self._speed, self.runs = 1.0, False
        self._from_ns, self._since_s = r.last_ns if replay.at_end else r.first_ns, now()
        self._sent_ns: int | None = None
        self._wish: int | str | None = None

    def ask(self, wish: Mapping[str, Any]) -> None:
        """Take a wish: `at` (flight time, s), `speed`, `run` (bool), any of them; `id` is echoed.

        Raises
        ------
        ReplayError
            Nothing has changed then.
        """
        speed = _number(wish, "speed", SLOWEST, FASTEST) if "speed" in wish else self._speed
        runs = wish.get("run", self.runs)
        if not isinstance(runs, bool):
            raise ReplayError(f"run: {runs!r} is not allowed; allowed: true or false")
        at_ns = self.place()
        if "at" in wish:
            at_ns = self._replay.recording.stamp(_number(wish, "at", -1e6, 1e6))
            self._sent_ns = None
        if runs and at_ns >= self._replay.recording.last_ns:
            # Played on at the end: from the beginning.
            at_ns, self._sent_ns = self._replay.recording.first_ns, None
        number = wish.get("id")
        self._wish = number if isinstance(number, (int, str)) else None
        self._from_ns, self._since_s = at_ns, self._now()
        self._speed, self.runs = speed, runs

    def place(self) -> int:
        """Stamp at which it is now; at the end time stands."""
        if not self.runs:
            return self._from_ns
        gone_ns = self._speed * (self._now() - self._since_s) * NS_PER_S
        last_ns = self._replay.recording.last_ns
        if not math.isfinite(gone_ns) or self._from_ns + gone_ns >= last_ns:
            self._from_ns, self.runs = last_ns, False
            return last_ns
        return self._from_ns + int(gone_ns)

    def text(self) -> str:
        """The state where it is now, with the rows since the last one, as JSON."""
        at_ns = self.place()
        anew = self._sent_ns is None
        after_ns = at_ns - _SHOWN_NS if self._sent_ns is None else self._sent_ns
        self._sent_ns = at_ns
        state = self._replay.state(at_ns) | {
            "replay": {"runs": self.runs, "speed": self._speed, "anew": anew, "wish": self._wish}
        }
        past = ",".join(self._replay.past(after_ns, at_ns))
        return f'{compact(state)[:-1]},"past":[{past}]}}'
