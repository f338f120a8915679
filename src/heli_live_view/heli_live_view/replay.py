# SPDX-License-Identifier: Apache-2.0
"""A recorded flight for the page: greeting, events, states at any moment, the rows between. No ROS.

The record is gone through once: for the rows that charts and track need, for the largest errors so
far, and for the events that the live page would have told. A seek then only looks up.
"""

import bisect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from heli_live_view.happenings import Happening, as_happening, in_order, of_remarks
from heli_live_view.recording import Recording
from heli_live_view.screen import compact, greeting
from heli_math.ticks import NS_PER_S, TICK_NS

ROW_TICKS = 7
"""Ticks between the rows of charts and track: as many as the live page keeps, 14 a second."""
# In longer records the rows lie further apart, and the largest errors are renewed less often.
_MOST_ROWS, _MOST_COUNTS = 20_000, 3_000
_BODY = ("p", "euler_deg", "error")


@dataclass(frozen=True)
class Telling:
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
    events: list[Happening] = field(default_factory=list)


class Replay:
    """A recorded flight, ready to be shown.

    Parameters
    ----------
    recording : Recording
    values : mapping
        Parameters of the node `live_view`, with what the page says of the flight.
    telling : Telling
    known : iterable of Happening
        Events that are known besides what the nodes said.
    progress : callable
        Told seconds done and in all while the record is gone through.

    Attributes
    ----------
    recording : Recording
    events : list of Happening
        In the order of their times.
    """

    def __init__(
        self,
        recording: Recording,
        values: Mapping[str, Any],
        telling: Telling | None = None,
        known: Iterable[Happening] = (),
        progress: Callable[[int, int], None] = lambda done, total: None,
    ) -> None:
        self.recording = recording
        self._values, self._telling = values, telling or Telling()
        self._passed = self._go_through(progress)
        told = [*self._passed.events, *of_remarks(recording.remarks, recording.start_ns), *known]
        self.events = in_order(told, recording.seconds(recording.last_ns) + 1.0)

    def _go_through(self, progress: Callable[[int, int], None]) -> _Passed:
        r, passed = self.recording, _Passed()
        live, total_s = r.fresh(), int(r.seconds(r.last_ns) - r.seconds(r.first_ns))
        ticks = max(ROW_TICKS, -(-(r.last_ns - r.first_ns) // (TICK_NS * _MOST_ROWS)))
        stamps = [*range(r.first_ns, r.last_ns, ticks * TICK_NS), r.last_ns]
        said = referred = 0
        before_ns = r.first_ns - 1
        batch = -(-len(stamps) // _MOST_COUNTS)
        for k, stamp_ns in enumerate(stamps):
            while referred < len(r.references) and (
                referred == 0 or r.references[referred][0] <= stamp_ns
            ):
                live.take_reference(r.references[referred][1])
                referred += 1
            while said < len(r.remarks) and r.remarks[said].stamp_ns <= stamp_ns:
                r.hear(live, r.remarks[said])
                said += 1
            if k % batch == 0 or stamp_ns == r.last_ns:
                for name, sample_ns, row in r.samples(before_ns, stamp_ns):
                    live.take_sample(name, sample_ns, row)
                before_ns = stamp_ns
            r.fill(live, stamp_ns)
            self._keep(passed, stamp_ns, live.row(stamp_ns / NS_PER_S))
            told = map(as_happening, live.take_events())
            passed.events += [happening for happening in told if happening is not None]
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
        r, told = self.recording, self._telling
        span_s = [round(r.seconds(stamp), 3) for stamp in (r.first_ns, r.last_ns)]
        return compact(
            greeting(self._values, commands=False)
            | {
                "events": [happening.message() for happening in self.events],
                "history": [],
                "replay": {
                    "from_s": span_s[0], "to_s": span_s[1], "at_end": told.at_end,
                    "ended": told.ended, "notes": list(told.notes), "report": told.report or None,
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
