# SPDX-License-Identifier: Apache-2.0
"""Modes, faults, failsafes and the nodes' health as stretches of flight time, for every chart.

All of it is read from what was recorded: modes and failsafes from what the outer loop told (or the
one process wrote down), faults from the parameters that were flown and from what the plant told of
faults in flight, health from /diagnostics. Nothing is worked out from the motion.
"""

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from heli_bags.reader import Remark
from heli_flight.loop.fault_file import flown_faults
from heli_flight.loop.record import FlightRecord
from heli_flight.loop.settings import Settings
from heli_flight.report.chart import Band
from heli_flight.report.data import LEVELS, Event
from heli_modes.failsafes import Action

MODE, FAULT, FAILSAFE, HEALTH = KINDS = ("mode", "fault", "failsafe", "health")
"""Kinds of bands, in the order in which they are told."""
MODE_ROLES = {
    "standing": "muted", "takeoff": "green", "hover": "nav", "trajectory": "truth",
    "land": "purple", "velocity": "truth", "attitude": "green", "manual": "rival",
}  # fmt: skip
_ROLES = {FAULT: "rival", FAILSAFE: "bad"}
_LEVEL_ROLES = ("good", "warn", "bad", "muted")
_PLANT, _GIVEN = "plant", "faults_in_flight"
_ACTS = "fault: "  # how the plant says that a fault acts, which has a band of its own
_WORDS = re.compile(
    r"(?P<name>.+?) from (?P<start>[\d.e+-]+)(?: to (?P<end>[\d.e+-]+) s| s on)"
    r"(?:, cleared at (?P<cleared>[\d.e+-]+) s)?"
)
_MOST_HEALTH, _MOST_TIMES = 60, 4
_MOMENT_S = 0.005
_START_UP_S = 1.0
"""What is over by then is the start of nodes that wait for each other; the timeline has it."""


def bands_of(
    record: FlightRecord,
    settings: Settings,
    remarks: Iterable[Remark] = (),
    events: Iterable[Event] = (),
) -> list[Band]:
    """The bands of a flight, kind by kind, each in the order of its beginnings.

    Parameters
    ----------
    record : FlightRecord
        What was told of modes and failsafes.
    settings : Settings
        With the faults that were to be flown.
    remarks : iterable of Remark
        What nodes told; of it the faults that were given in flight.
    events : iterable of Event
        Changes of the nodes' health.
    """
    if not len(record):
        return []
    end_s = float(record.time_s[-1])
    found = [
        *_modes(record),
        *_faults(settings, remarks, end_s),
        *_failsafes(record),
        *_health(list(events), end_s),
    ]
    inside = (
        replace(band, start_s=max(0.0, band.start_s), end_s=min(band.end_s, end_s))
        for band in found
        if band.start_s < end_s and band.end_s >= 0.0
    )
    return sorted(inside, key=lambda band: (KINDS.index(band.kind), band.start_s))


def bands_beside(flights: Mapping[str, Sequence[Band]]) -> list[Band]:
    """Bands of flights laid over each other: what all have once, the rest with the flight's name.

    Health is left out; where modes differ they are left out, too: there is one edge for them.
    """
    each = {
        name: [band for band in bands if band.kind != HEALTH] for name, bands in flights.items()
    }
    common = [band for band in next(iter(each.values())) if all(band in b for b in each.values())]
    found = list(common)
    for name, bands in each.items():
        own = [band for band in bands if band not in common and band.kind != MODE]
        found += [replace(band, name=f"{band.name} ({name})") for band in own]
    modes = {tuple(b for b in bands if b.kind == MODE) for bands in each.values()}
    return [band for band in found if band.kind != MODE or len(modes) == 1]


def legend(bands: Sequence[Band]) -> list[Band]:
    """One band for each that has the same kind and name; its `told` says all their times."""
    groups: dict[tuple[str, str, str], list[Band]] = {}
    for band in bands:
        groups.setdefault((band.kind, band.name, band.role), []).append(band)
    found = []
    for (kind, name, _), own in groups.items():
        times = ", ".join(stretch(band) for band in own[:_MOST_TIMES])
        left = len(own) - _MOST_TIMES
        told = f"{times}{f' and {left} more' if left > 0 else ''}"
        shown = name if kind in (MODE, HEALTH) else f"{kind}: {name}"
        found.append(replace(own[0], name=shown, told=told))
    return found


def stretch(band: Band) -> str:
    """When a band is, in words."""
    if band.end_s - band.start_s < _MOMENT_S:
        return f"at {band.start_s:.2f} s"
    return f"{band.start_s:.2f} to {band.end_s:.2f} s"


def runs(time_s: np.ndarray, names: np.ndarray) -> Iterator[tuple[float, float, str]]:
    """Start and end, s, and name of each stretch over which (N,) names stay the same.

    A stretch ends where the next one begins.
    """
    first = np.concatenate([[0], np.nonzero(names[1:] != names[:-1])[0] + 1])
    ends = [*first[1:].tolist(), len(names) - 1]
    for begin, end in zip(first.tolist(), ends, strict=True):
        yield float(time_s[begin]), float(time_s[end]), str(names[begin])


def _modes(record: FlightRecord) -> Iterator[Band]:
    """Modes, where there was more than one."""
    if record.mode is None or np.unique(record.mode).size < 2:
        return
    for start_s, end_s, name in runs(record.time_s, record.mode):
        yield Band(start_s, end_s, MODE, name, MODE_ROLES.get(name, "muted"), "told by outer_loop")


def _failsafes(record: FlightRecord) -> Iterator[Band]:
    if record.failsafe is None:
        return
    for start_s, end_s, name in runs(record.time_s, record.failsafe):
        if name != Action.NONE.name:
            known = name in Action.__members__
            told = Action[name].words if known else "told by outer_loop"
            yield Band(start_s, end_s, FAILSAFE, name, _ROLES[FAILSAFE], told)


def _faults(settings: Settings, remarks: Iterable[Remark], end_s: float) -> list[Band]:
    """Faults that were ordered, and those given or taken back in flight."""
    ordered = [
        Band(fault.start_s, fault.end_s, FAULT, _without_times(fault.words), _ROLES[FAULT],
             "ordered by the flight's parameters", fault.what)
        for fault in flown_faults(settings)
    ]  # fmt: skip
    for name, start_s, stop_s, cleared_s in given_in_flight(remarks):
        said, what = "given in flight, told by plant", name.partition(" ")[0]
        band = Band(start_s, stop_s, FAULT, name, _ROLES[FAULT], said, what)
        same = [i for i, old in enumerate(ordered) if (old.name, old.start_s) == (name, start_s)]
        if cleared_s is not None:
            band = replace(band, end_s=cleared_s, told=f"taken back at {cleared_s:g} s")
        if same:
            ordered[same[0]] = replace(ordered[same[0]], end_s=band.end_s, told=band.told)
        else:
            ordered.append(band)
    return [replace(band, end_s=min(band.end_s, end_s)) for band in ordered]


def _without_times(words: str) -> str:
    """A fault's words without when it acts: that stands beside them."""
    return re.sub(r" (?:from .*|at [\d.e+-]+ s)$", "", words)


def given_in_flight(
    remarks: Iterable[Remark],
) -> list[tuple[str, float, float, float | None]]:
    """Name, start, end (inf: none), when taken back (None: not) of faults that the plant told of.

    `heli_dynamics_sim.fault_log` writes the words; what is not such words is left out.
    """
    told = [r.facts[_GIVEN] for r in remarks if r.node == _PLANT and _GIVEN in r.facts]
    found = []
    for line in told[-1].split("; ") if told else ():
        match = _WORDS.fullmatch(line)
        if match is None:
            continue
        try:
            times = [None if match[key] is None else float(match[key]) for key in _TIMES]
        except ValueError:
            continue
        start_s, stop_s, cleared_s = times
        found.append((match["name"], start_s or 0.0, stop_s or np.inf, cleared_s))
    return found


_TIMES = ("start", "end", "cleared")


def _health(events: Sequence[Event], end_s: float) -> Iterator[Band]:
    """What nodes complained of."""
    shown = 0
    for node in dict.fromkeys(event.node for event in events):
        own = [event for event in events if event.node == node]
        after = [*(event.time_s for event in own[1:]), end_s]
        for event, until in zip(own, after, strict=True):
            started = event.time_s < _START_UP_S and until < _START_UP_S
            has_band = node == _PLANT and event.message.startswith(_ACTS)
            if event.level == 0 or started or has_band or shown >= _MOST_HEALTH:
                continue
            shown += 1
            level = min(event.level, len(LEVELS) - 1)
            name = f"{node} {LEVELS[level]}"
            yield Band(event.time_s, until, HEALTH, name, _LEVEL_ROLES[level], event.message)
