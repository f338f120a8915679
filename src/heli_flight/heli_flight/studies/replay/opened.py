# SPDX-License-Identifier: Apache-2.0
"""A flight's folder, or its bag, as a replay."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from heli_flight.errors import FlightError
from heli_flight.graph.live import LiveOrder, live_view
from heli_flight.loop.record_file import read_record
from heli_flight.loop.scoring import figures_of
from heli_flight.loop.settings import Settings
from heli_flight.report.from_bag import Choice, told_beside
from heli_flight.report.write import PAGE
from heli_flight.studies.replay import known
from heli_flight.studies.replay.found import Place, bag_at, place_of
from heli_flight.studies.replay.of_record import references_of, remarks_of, stamps_of, streams_of
from heli_live_view.recording import EmptyRecordError, Recording
from heli_live_view.replay import Replay, Telling
from heli_math.ticks import NS_PER_S, stamp_at
from heli_msgs_bridge import topics

Progress = Callable[[int, int], None]
# A first message so long after the start that is assumed is of a flight that began at another.
_ASSUMED_NS = 3600 * NS_PER_S


def replay_of(
    path: Path,
    choice: Choice | None = None,
    progress: Progress = lambda done, total: None,
    at_end: bool = False,
) -> tuple[Replay, dict[str, Path]]:
    """A recorded flight for the page.

    Parameters
    ----------
    path : Path
        Folder of a flight, rosbag2 folder or a file of one; also of a bag that was cut off.
    choice : Choice, optional
        What the user says of it.
    progress : callable
        Told how much is done, and of how much.
    at_end : bool
        Whether browsers begin at the end.

    Returns
    -------
    Replay, dict
        The replay, and what is to be served beside the page, by name.

    Raises
    ------
    FlightError, BagError, ParameterError
        One line that names the file.
    """
    place = place_of(path)
    told, settings, is_known = told_beside(place.beside, choice)
    recording, notes = _recorded(place, settings, told, is_known, progress)
    if not is_known:
        notes.append(
            "No params.yaml beside the record and none given: scenario, limits and scored windows "
            "are the packaged ones and may not be this flight's."
        )
    told_notes = told.get("notes")
    notes += [str(note) for note in told_notes] if isinstance(told_notes, list) else []
    report = place.beside / PAGE
    beside = {PAGE: report} if report.is_file() else {}
    page = PAGE if beside else ""
    telling = Telling(known.ended(told, figures_of(settings.scenario.kind)), notes, page, at_end)
    events = [*known.of_result(told), *_ground(recording, settings)]
    values = _values(settings, is_known)
    return Replay(recording, values, telling, events, progress), beside


def _recorded(
    place: Place, settings: Settings, told: dict[str, Any], is_known: bool, progress: Progress
) -> tuple[Recording, list[str]]:
    start_ns = stamp_at(settings.nodes["plant"]["start_time_s"])
    values = live_view(LiveOrder(), settings).parameters
    windows_s = settings.scenario.windows_s
    windows = [v for pair in windows_s for v in pair] if is_known else []
    try:
        if not place.is_bag:
            record = read_record(place.record)
            if not len(record):
                raise EmptyRecordError("holds no tick")
            stamps = stamps_of(record, start_ns)
            streams, references = streams_of(record, stamps), references_of(record, stamps)
            remarks = remarks_of(record, stamps, settings, told)
            return Recording(streams, remarks, references, start_ns, values["stale_s"], windows), []
        bag, notes = bag_at(place.record, settings, progress)
        first_ns = min(int(s.stamp_ns[0]) for s in bag.streams.values() if s.stamp_ns.size)
        if not is_known and not 0 <= first_ns - start_ns <= _ASSUMED_NS:
            start_ns = first_ns
        return Recording(
            bag.streams, bag.remarks, sorted(bag.references, key=lambda pair: pair[0]), start_ns,
            values["stale_s"], windows,
        ), list(notes)  # fmt: skip
    except EmptyRecordError as error:
        raise FlightError(f"{place.record}: {error}") from None


def _ground(recording: Recording, settings: Settings) -> Sequence[Any]:
    ground, truth = known.gear_of(settings), recording.streams.get(topics.TRUTH_ODOM)
    if ground is None or truth is None:
        return []
    return known.of_ground(truth, ground, recording.start_ns)


def _values(settings: Settings, is_known: bool) -> dict[str, Any]:
    """What the page says of the flight; nothing that is only assumed."""
    values = dict(live_view(LiveOrder(), settings).parameters)
    if not is_known:
        values |= {"flight.scenario": "", "flight.seed": -1, "flight.duration_s": 0.0}
        values["lockstep"] = False
    return values
