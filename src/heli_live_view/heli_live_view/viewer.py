# SPDX-License-Identifier: Apache-2.0
"""One browser's way through a replay: where it is, how fast, what it is sent next. No ROS."""

import math
import time
from collections.abc import Callable, Mapping
from typing import Any

from heli_live_view.replay import Replay
from heli_live_view.screen import compact
from heli_math.ticks import NS_PER_S

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
