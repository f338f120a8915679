# SPDX-License-Identifier: Apache-2.0
"""What happened in a recorded flight and is worth a jump: modes, faults, failsafes, refusals.

Out of what the nodes said in /diagnostics; who reads a record may add what else is known. No ROS.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from heli_bags.reader import Remark
from heli_live_view.faults import listed
from heli_live_view.live_state import OWN_NAME, Event
from heli_msgs_bridge.diagnostics import FACT_FLOOD, FACT_MODE

MODE, FAULT, FAILSAFE, REFUSAL, GROUND, GUST, END, HEALTH = (
    "mode", "fault", "failsafe", "refusal", "ground", "gust", "end", "health",
)  # fmt: skip
"""Kinds of what happens."""
_FAILSAFE = "failsafe"
_REFUSED = "refused."
_QUIET = ("none", "")
_BEFORE_FLIGHT = ("configured", "active", "inactive", "unconfigured")
_TIMES = re.compile(r" from (?P<start>[-+.e\d]+)(?: to (?P<end>[-+.e\d]+) s| s on)$")
# The same refusal stands in what the node says and in its facts.
_TOGETHER_S = 1.5


@dataclass(frozen=True)
class Happening:
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


def as_happening(event: Event) -> Happening | None:
    """A line of the live view's timeline, with its kind; None for what is no news of a flight."""
    kind, level = HEALTH, min(event.level, 2)
    if event.text in _BEFORE_FLIGHT and not level or event.text == "mode: over":
        return None
    if event.text.startswith("mode: "):
        kind = MODE
    elif event.text.startswith("fault: "):
        kind = FAULT
    elif "refused" in event.text:
        kind = REFUSAL
    return Happening(event.time_s or 0.0, kind, level, event.source, event.text)


def of_remarks(remarks: Iterable[Remark], start_ns: int) -> list[Happening]:
    """Modes, failsafes, refusals and faults, out of the facts of /diagnostics.

    Parameters
    ----------
    remarks : iterable of Remark
        Stamps rising.
    start_ns : int
        Stamp of flight time 0.
    """
    found: list[Happening] = []
    known: dict[tuple[str, str], str] = {}
    for remark in remarks:
        time_s = (remark.stamp_ns - start_ns) / 1e9
        if remark.facts.get("over") == "true" != known.get((remark.node, "over")):
            found.append(Happening(time_s, END, min(remark.level, 2), remark.node, remark.message))
        for key, value in remark.facts.items():
            before = known.get((remark.node, key))
            known[remark.node, key] = value
            if value == before:
                continue
            if key == FACT_MODE:
                found.append(Happening(time_s, MODE, 0, remark.node, f"mode: {value}"))
            elif key == _FAILSAFE and (before or value.lower() not in _QUIET):
                calm = value.lower() in _QUIET
                words = "failsafe ends" if calm else f"failsafe: {_plain(value)}"
                found.append(Happening(time_s, FAILSAFE, int(not calm), remark.node, words))
            elif key.startswith(_REFUSED) and key != FACT_FLOOD:
                topic, (_, _, why) = key.removeprefix(_REFUSED), value.partition("; ")
                words = f"refused: {why if topic in why else f'{topic}: {why}'}"
                found.append(Happening(time_s, REFUSAL, 1, remark.node, words))
    return found + of_faults(words for remark in remarks for words in listed(remark.facts))


def _plain(name: str) -> str:
    return name.replace("_", " ").lower()


def of_faults(words: Iterable[str]) -> list[Happening]:
    """Beginning and end of each fault, out of what it is called ("... from 12 to 17 s")."""
    found = []
    for one in dict.fromkeys(words):
        times = _TIMES.search(one)
        if times is None:
            continue
        name = one[: times.start()]
        found.append(Happening(float(times["start"]), FAULT, 1, FAULT, f"{name} begins"))
        if times["end"]:
            found.append(Happening(float(times["end"]), FAULT, 0, FAULT, f"{name} ends"))
    return found


def in_order(found: Iterable[Happening], until_s: float) -> list[Happening]:
    """All up to a time in the order of their times; what is said twice, once."""
    given = [one for one in found if one.time_s <= until_s]
    if any(one.kind == MODE and one.source != OWN_NAME for one in given):
        # The outer loop has said more than that it sends something.
        given = [one for one in given if (one.source, one.text) != (OWN_NAME, "mode: hover")]
    if any(one.kind == FAULT and one.source == FAULT for one in given):
        # With beginning and end of each the plant's own word of them says nothing more.
        given = [one for one in given if one.kind != FAULT or one.source != "plant"]
    kept: list[Happening] = []
    for one in sorted(given, key=lambda happening: (happening.time_s, happening.kind == HEALTH)):
        if not _is_known(one, kept):
            kept.append(one)
    return kept


def _is_known(one: Happening, before: Sequence[Happening]) -> bool:
    """True if the same was said just before, by whomever; a refusal also in other words."""
    for other in reversed(before):
        if one.time_s - other.time_s > _TOGETHER_S:
            return False
        a, b = (h.text.removeprefix("message ").removeprefix("refused: ") for h in (one, other))
        if a == b or (one.kind == other.kind == REFUSAL and (a in b or b in a)):
            return True
    return False
