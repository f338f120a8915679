# SPDX-License-Identifier: Apache-2.0
"""Where a flight's record is, and what is in it, whole or cut off."""

from __future__ import annotations

import contextlib
import math
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import NDArray

from heli_bags.opening import listed_files, storage_files, trouble
from heli_bags.reader import Bag, Remark, Stream, read_bag
from heli_bags.repair import repair
from heli_bags.storage import storage_of
from heli_bags.writer import BagCause, BagError
from heli_core.errors import FlightError
from heli_core.rotations import quat_to_R_nb
from heli_core.rows import NAV, PLANT, REFERENCE
from heli_core.ticks import NS_PER_S, stamp_at
from heli_core.trajectory import MAX_POINTS, Trajectory
from heli_dynamics_sim.ground import GroundParams, ground_contact
from heli_flight import interrupts
from heli_flight.flight_file import NAME, flown_faults
from heli_flight.graph.live import LiveOrder, LiveView, live_view, viewers
from heli_flight.record import NAME as RECORD
from heli_flight.record import FlightRecord, read_record
from heli_flight.report.write import PAGE, BagChoice, with_process_events
from heli_flight.scoring import figures_of
from heli_flight.settings import Settings
from heli_live_view.access import RECORDED, Access
from heli_live_view.replay import (
    FAULT,
    GROUND,
    GUST,
    HEALTH,
    EmptyRecordError,
    FlightEvent,
    FlightRecording,
    Replay,
    ReplayOutcome,
    Viewer,
)
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_MODE, FACT_OFFSET
from heli_msgs_bridge.frames import Datum, datum

if TYPE_CHECKING:
    from heli_live_view.server import PageServer

# -------------------------------------------------------------------------------------------------
# Found.
# -------------------------------------------------------------------------------------------------

# Of the flights in a folder, so many are named.
_NAMED = 4


@dataclass(frozen=True)
class FlightPlace:
    """Where a flight lies.

    Attributes
    ----------
    record : Path
        Its bag (folder or file), or its record.npz.
    beside : Path
        Folder in which params.yaml, result.json and report.html are, if they are.
    """

    record: Path
    beside: Path

    @property
    def is_bag(self) -> bool:
        """False for the record of a flight of one process."""
        return self.record.name != RECORD


def _is_bag(path: Path) -> bool:
    if path.is_file():
        return bool(storage_of(path))
    return path.is_dir() and bool(storage_files(path) or listed_files(path))


def _is_flight(path: Path) -> bool:
    return _is_bag(path / "bag") or (path / RECORD).is_file()


def place_of(path: Path) -> FlightPlace:
    """Where the record of a flight is: of its folder, its bag, or a bag's file.

    Raises
    ------
    FlightError
        There is no such folder, or no flight in it; one line.
    """
    try:
        return _place_of(path)
    except OSError as error:
        raise FlightError(f"{path}: cannot be read: {error.strerror}") from None


def _place_of(path: Path) -> FlightPlace:
    if not path.exists():
        raise FlightError(f"{path}: there is no such flight")
    if _is_bag(path / "bag"):
        return FlightPlace(path / "bag", path)
    if (path / RECORD).is_file():
        return FlightPlace(path / RECORD, path)
    if path.name == RECORD and path.is_file():
        return FlightPlace(path, path.resolve().parent)
    if _is_bag(path):
        # Beside the bag, or of one of its files, beside the folder of these.
        near = path.resolve().parent
        known = next((p for p in (near, near.parent) if (p / NAME).is_file()), near)
        return FlightPlace(path, known)
    if path.is_file():
        raise FlightError(f"{path}: not a flight: neither a bag's file (.mcap, .db3) nor {RECORD}")
    inside = [one.name for one in sorted(path.iterdir()) if _is_flight(one)]
    if inside:
        more = " ..." if len(inside) > _NAMED else ""
        names = f"{', '.join(islice(inside, _NAMED))}{more}"
        raise FlightError(f"{path}: holds several flights: name one ({names})")
    raise FlightError(f"{path}: not a flight: it holds neither a bag nor {RECORD}")


def bag_at(
    path: Path,
    settings: Settings,
    progress: Callable[[int, int], None],
    flight: int | None = None,
) -> tuple[Bag, Sequence[str]]:
    """A bag's content, and what to know of it; of one that was cut off, what can be restored.

    Parameters
    ----------
    path : Path
        rosbag2 folder or one of its files; it is never changed.
    settings : Settings
        Give the origin of fixes.
    progress : callable
        Told messages done and in all while a bag is restored.
    flight : int, optional
        Which flight of a bag whose clock goes back, from 1 on; default: the last.

    Raises
    ------
    BagError
        Nothing can be read of it; one line.
    FlightError
        It holds no flight, or several aircraft; one line.
    """
    plant = settings.nodes["plant"]
    axes = ("latitude_deg", "longitude_deg", "altitude_m")
    origin = datum(*(plant[f"origin.{axis}"] for axis in axes))
    notes: list[str] = []
    wrong = trouble(path)
    if not wrong:
        try:
            bag = read_bag(path, origin, flight)
        except BagError as error:
            if error.cause == BagCause.OPTION:
                raise
            # Its file has begin and end; what lies between may still be restored in parts.
            wrong = str(error).removeprefix(f"{path}: ")
    if wrong:
        bag, more = _restored(path, origin, progress, flight)
        notes.append(f"The bag is not whole ({wrong}): shown is what could be restored{more}.")
    notes += [f"The bag: {note}." for note in bag.notes]
    _refuse_none(path, bag)
    if "," in bag.aircraft:
        raise FlightError(f"{path}: holds several aircraft ({bag.aircraft}): a replay shows one")
    return bag, notes


def _restored(
    path: Path, origin: Datum, progress: Callable[[int, int], None], flight: int | None
) -> tuple[Bag, str]:
    """What can be restored of a damaged bag, in a copy that is gone again, and what is lost."""
    with tempfile.TemporaryDirectory(prefix="heli_replay_") as folder:
        copy = Path(folder) / "bag"
        done = repair(path, copy, progress=progress)
        try:
            bag = read_bag(copy if done else path, origin, flight)
        except BagError as error:
            raise BagError(str(error).replace(str(copy), str(path)), error.cause) from None
    lost = done.lost_bytes if done else 0
    return bag, f", {lost} bytes hold no whole message" if lost else ""


def _refuse_none(path: Path, bag: Bag) -> None:
    shown = [bag.streams.get(name) for name in (topics.TRUTH_ODOM, topics.ODOM)]
    if not any(stream is not None and stream.stamp_ns.size for stream in shown):
        other = f"; of other kinds: {', '.join(bag.foreign)}" if bag.foreign else ""
        raise FlightError(
            f"{path}: holds neither {topics.TRUTH_ODOM} nor {topics.ODOM}: no flight{other}"
        )


# -------------------------------------------------------------------------------------------------
# After a live flight: who watched it gets report and replay, at the same address.
# -------------------------------------------------------------------------------------------------

# A browser comes back within a second or two, one in a hidden tab later.
_BACK_S = 10.0
# A page that is loaded anew is away for a moment.
_AWAY_S = 3.0
_LOOK_S = 0.2


def serve_after(folder: Path, live: LiveView, say: Callable[[str], None]) -> None:
    """Serve report and replay while somebody looks who has watched the flight to its end.

    Nobody waits for it: without a browser it returns at once. Ctrl-C ends it and nothing else, as
    the flight is over and written.

    Parameters
    ----------
    folder : Path
        Of the flight.
    live : LiveView
    say : callable
        Takes a line for the user.
    """
    stay_s, address = live.parameters["stay_s"], live.facts.get("page", "")
    if not (viewers(live.facts) and stay_s and address):
        return
    with contextlib.suppress(KeyboardInterrupt):
        try:
            _serve(folder, urlsplit(address).port or 0, stay_s, say)
        except (OSError, ValueError) as error:
            say(f"the page is not served any more: {error}")


def _serve(folder: Path, port: int, stay_s: float, say: Callable[[str], None]) -> None:
    # Only who is watched needs all this.

    replay, beside = replay_of(folder, at_end=True)
    with served(replay, port, beside, ("port", "--live-port")) as server:
        say(f"report and replay: {server.url} (while the page is open; Ctrl-C ends it)")
        if not server.came.wait(_BACK_S):
            return
        begun_s = watched_s = time.monotonic()
        pause = threading.Event()
        while (now_s := time.monotonic()) - watched_s < _AWAY_S and now_s - begun_s < stay_s:
            if server.viewers:
                watched_s = now_s
            pause.wait(_LOOK_S)


# -------------------------------------------------------------------------------------------------
# What else is known of a recorded flight: touch-down, gusts, restarts, and how it ended.
# -------------------------------------------------------------------------------------------------

# Shorter stretches without contact are hops.
_BRIEF_NS = NS_PER_S


def touching(truth: Stream, ground: GroundParams) -> np.ndarray:
    """Mask (N,) of the messages of ground truth at which the gear touches."""
    touches, x = np.zeros(len(truth.rows), bool), np.zeros(PLANT.size)
    for i, row in enumerate(truth.rows):
        x[PLANT.rigid] = row
        touches[i] = ground_contact(x, ground)[1]
    return touches


def of_ground(truth: Stream, ground: GroundParams, start_ns: int) -> list[FlightEvent]:
    """Lift-off and touch-down, out of ground truth and the plant's own gear."""
    touches = touching(truth, ground)
    edges = np.flatnonzero(np.diff(touches.astype(np.int8)))
    stamps = truth.stamp_ns
    events: list[FlightEvent] = []
    kept: list[int] = []
    for i in edges.tolist():
        # Contact that comes back at once, and the hop before it, are one.
        if kept and touches[i + 1] and stamps[i + 1] - stamps[kept[-1] + 1] < _BRIEF_NS:
            kept.pop()
        else:
            kept.append(i)
    for i in kept:
        time_s = float((stamps[i + 1] - start_ns) / NS_PER_S)
        if touches[i + 1]:
            speed = _down_mps(truth.rows[i])
            events.append(
                FlightEvent(time_s, GROUND, 0, "ground", f"touch-down at {speed:.2f} m/s")
            )
        else:
            events.append(FlightEvent(time_s, GROUND, 0, "ground", "lift-off"))
    return events


def _down_mps(row: np.ndarray) -> float:
    """Speed downwards of a row of ground truth."""
    w, x, y, z = row[PLANT.quat]
    u, v, down = row[PLANT.vel]
    return float(
        2 * (x * z - w * y) * u + 2 * (y * z + w * x) * v + (1 - 2 * (x * x + y * y)) * down
    )


def of_result(result_json: Mapping[str, Any]) -> Iterator[FlightEvent]:
    """What result.json has a time of and nobody said in flight; it may hold anything."""
    for gust in _entries(result_json, "random_gusts", "start_s"):
        peak = gust.get("peak_ned_mps")
        known = isinstance(peak, list) and all(isinstance(v, int | float) for v in peak)
        speed = f" of {math.hypot(*peak):.1f} m/s" if known and peak else ""
        yield FlightEvent(gust["start_s"], GUST, 0, "wind", f"gust{speed} begins")
    for fault in _entries(result_json, "process_faults_done", "begun_s"):
        yield FlightEvent(
            fault["begun_s"], FAULT, 1, str(fault.get("what")), f"{fault.get('kind')}"
        )
    for restart in _entries(result_json, "restarts", "noticed_s"):
        node, why = restart.get("node"), restart.get("why")
        yield FlightEvent(restart["noticed_s"], HEALTH, 2, str(node), f"{why}; started again")


def _entries(result_json: Mapping[str, Any], key: str, time: str) -> list[dict[str, Any]]:
    """Entries of a list that have a finite time."""
    entries = result_json.get(key)
    return [
        one
        for one in (entries if isinstance(entries, list) else [])
        if isinstance(one, dict)
        and isinstance(one.get(time), int | float)
        and math.isfinite(one[time])
    ]


def ended(result_json: Mapping[str, Any], figures: str) -> str:
    """How the flight ended, by its result.json: one or two sentences; empty: it says nothing.

    Parameters
    ----------
    result_json : mapping
        Content of result.json; it may hold anything.
    figures : str
        What a flight of this kind is judged by.
    """
    if result_json.get("forged"):
        return f"Forged: {result_json['forged']}"
    if result_json.get("partial"):
        return f"Partial: {result_json['partial']}"
    flown, lost = result_json.get("flown_s"), result_json.get("lost")
    after = f" after {flown:.2f} s" if isinstance(flown, int | float) else ""
    if lost:
        return f"Lost{after}: {lost}"
    rows = result_json.get("verdicts")
    if not isinstance(rows, dict):
        return ""
    judged = [v for v in rows.values() if isinstance(v, dict) and v.get("decides")]
    return f"Flown to its end{after}. " + " ".join(_verdict(v, figures) for v in judged)


def _verdict(row: Mapping[str, Any], figures: str) -> str:
    stretch = str(row.get("stretch", "")).capitalize()
    where = f"{stretch} ({row.get('when')})"
    if row.get("inside") is None:
        return f"{where}: not scored."
    outside = row.get("outside")
    if row["inside"] or not isinstance(outside, list):
        return f"{where}: inside {figures}." if figures else f"{where}: measured, not judged."
    return f"{where}: outside in {', '.join(map(str, outside))}."


def gear_of(settings: Settings) -> GroundParams | None:
    """The gear, of a flight that begins or ends on the ground."""
    gear = settings.scenario.gear
    return None if gear is None else gear.ground


# -------------------------------------------------------------------------------------------------
# The record of a flight of one process as messages: what its graph would have sent.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]
_UNMOVED = "[0.0, 0.0, 0.0]"


def stamps_of(record: FlightRecord, start_ns: int) -> NDArray[np.int64]:
    """Stamps (N,) of a record's rows, ns."""
    return start_ns + np.round(record.time_s * NS_PER_S).astype(np.int64)


def streams_of(record: FlightRecord, stamp_ns: NDArray[np.int64]) -> dict[str, Stream]:
    """Topics of the graph that the record holds; rows that say nothing are left out."""
    velocity = [
        quat_to_R_nb(q).T @ v
        for q, v in zip(record.truth_q_nb, record.truth_vel_ned_mps, strict=True)
    ]
    truth = np.zeros((len(record), PLANT.rigid.stop))
    truth[:, PLANT.pos], truth[:, PLANT.vel] = record.truth_pos_ned_m, np.array(velocity)
    truth[:, PLANT.quat], truth[:, PLANT.rate] = record.truth_q_nb, record.truth_rate_body_radps
    nav = np.zeros((len(record), NAV.size))
    nav[:, NAV.pos], nav[:, NAV.vel] = record.nav_pos_ned_m, record.nav_vel_ned_mps
    nav[:, NAV.quat], nav[:, NAV.rate] = record.nav_q_nb, record.nav_rate_body_radps
    if record.nav_sigma_pos_m is not None:
        nav[:, NAV.sigma_pos] = record.nav_sigma_pos_m
    rows = {
        topics.TRUTH_ODOM: truth, topics.ODOM: nav, topics.ATTITUDE_SETPOINT: record.setpoint,
        topics.ACTUATORS: record.u, topics.ROTOR_STATE: record.nav_rotor,
        topics.TRUTH_ROTOR: record.truth_rotor, topics.TRUTH_WIND: record.wind_ned_mps,
    }  # fmt: skip
    streams = {}
    for name, array in rows.items():
        known = np.isfinite(array).all(axis=1)
        if known.any():
            streams[name] = Stream(stamp_ns[known], array[known])
    return streams


def references_of(
    record: FlightRecord, stamp_ns: NDArray[np.int64]
) -> list[tuple[int, Trajectory]]:
    """The reference as it was followed, as trajectories of as many points as one may have."""
    known = np.isfinite(record.reference).all(axis=1)
    times, rows = stamp_ns[known], record.reference[known]
    if times.size > 1:
        # The last point of a trajectory stands still: one more, which is never reached.
        step_ns = times[-1] - times[-2]
        beyond = rows[-1].copy()
        beyond[REFERENCE.pos] += beyond[REFERENCE.vel] * (step_ns / NS_PER_S)
        times, rows = np.append(times, times[-1] + step_ns), np.vstack([rows, beyond])
    trajectories = []
    for first in range(0, max(times.size - 1, min(times.size, 1)), MAX_POINTS - 1):
        part = slice(first, first + MAX_POINTS)
        trajectories.append((int(times[first]), Trajectory(0, times[part], rows[part])))
    return trajectories


def remarks_of(
    record: FlightRecord,
    stamp_ns: NDArray[np.int64],
    settings: Settings,
    result_json: Mapping[str, object],
) -> Sequence[Remark]:
    """What outer loop and plant would have said of modes, faults and the end."""
    modes = ["hover"] * len(record) if record.mode is None else [str(m) for m in record.mode]
    remarks = [
        Remark(int(stamp_ns[i]), "outer_loop", 0, "", {FACT_MODE: mode, FACT_OFFSET: _UNMOVED})
        for i, mode in enumerate(modes)
        if i == 0 or mode != modes[i - 1]
    ]
    faults = {"faults": "; ".join(fault.words for fault in flown_faults(settings))}
    lost, end_ns = str(result_json.get("lost") or ""), int(stamp_ns[-1])
    over = lost or f"flight over after {record.time_s[-1] + settings.rate.tick_s:g} s"
    first = Remark(int(stamp_ns[0]), "plant", 0, "flying", faults)
    last = Remark(end_ns, "plant", 2 if lost else 0, over, {**faults, "over": "true"})
    return [first, *remarks, last]


# -------------------------------------------------------------------------------------------------
# A flight's folder, or its bag, as a replay.
# -------------------------------------------------------------------------------------------------

Progress = Callable[[int, int], None]
# A first message so long after the start that is assumed is of a flight that began at another.
_ASSUMED_NS = 3600 * NS_PER_S


def replay_of(
    path: Path,
    choice: BagChoice | None = None,
    progress: Progress = lambda done, total: None,
    at_end: bool = False,
) -> tuple[Replay, dict[str, Path]]:
    """A recorded flight for the page.

    Parameters
    ----------
    path : Path
        Folder of a flight, rosbag2 folder or a file of one; also of a bag that was cut off.
    choice : BagChoice, optional
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
    result_json, settings, is_known = with_process_events(place.beside, choice)
    which = None if choice is None else choice.flight
    recording, notes = _recorded(place, settings, result_json, is_known, progress, which)
    if not is_known:
        notes.append(
            "No params.yaml beside the record and none given: scenario, limits and scored windows "
            "are the packaged ones and may not be this flight's."
        )
    recorded_notes = result_json.get("notes")
    notes += [str(note) for note in recorded_notes] if isinstance(recorded_notes, list) else []
    report = place.beside / PAGE
    beside = {PAGE: report} if report.is_file() else {}
    page = PAGE if beside else ""
    telling = ReplayOutcome(
        ended(result_json, figures_of(settings.scenario.metrics)), notes, page, at_end
    )
    events = [*of_result(result_json), *_ground(recording, settings)]
    values = _values(settings, is_known)
    return Replay(recording, values, telling, events, progress), beside


def _recorded(
    place: FlightPlace,
    settings: Settings,
    result_json: dict[str, Any],
    is_known: bool,
    progress: Progress,
    flight: int | None,
) -> tuple[FlightRecording, list[str]]:
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
            remarks = remarks_of(record, stamps, settings, result_json)
            return FlightRecording(
                streams, remarks, references, start_ns, values["stale_s"], windows
            ), []
        bag, notes = bag_at(place.record, settings, progress, flight)
        first_ns = min(int(s.stamp_ns[0]) for s in bag.streams.values() if s.stamp_ns.size)
        if not is_known and not 0 <= first_ns - start_ns <= _ASSUMED_NS:
            start_ns = first_ns
        return FlightRecording(
            bag.streams, bag.remarks, sorted(bag.references, key=lambda pair: pair[0]), start_ns,
            values["stale_s"], windows,
        ), list(notes)  # fmt: skip
    except EmptyRecordError as error:
        raise FlightError(f"{place.record}: {error}") from None


def _ground(recording: FlightRecording, settings: Settings) -> Sequence[Any]:
    ground, truth = gear_of(settings), recording.streams.get(topics.TRUTH_ODOM)
    if ground is None or truth is None:
        return []
    return of_ground(truth, ground, recording.start_ns)


def _values(settings: Settings, is_known: bool) -> dict[str, Any]:
    """What the page says of the flight; nothing that is only assumed."""
    values = dict(live_view(LiveOrder(), settings).parameters)
    if not is_known:
        values |= {"flight.scenario": "", "flight.seed": -1, "flight.duration_s": 0.0}
        values["lockstep"] = False
    return values


# -------------------------------------------------------------------------------------------------
# A replay served to browsers of this machine until the user, or the last of them, leaves.
# -------------------------------------------------------------------------------------------------


def server_of(
    replay: Replay,
    port: int,
    beside: Mapping[str, Path],
    port_names: tuple[str, str] = ("", "--port"),
) -> PageServer:
    """A server of the replay that has not begun to serve.

    Parameters
    ----------
    replay : Replay
    port : int
        0: any free one.
    beside : mapping
        What is served beside the page, by name.
    port_names : (str, str)
        Parameter and option by which the user names the port, for the error.

    Raises
    ------
    PortError
        The port is in use or not allowed; one line.
    MissingFileError
        The page is not installed.
    """
    from heli_live_view.server import PageServer, web_folder

    return PageServer(
        web_folder(), port, Access("", RECORDED), replay.hello, lambda command: None,
        lambda: Viewer(replay), beside, port_names,
    )  # fmt: skip


@contextlib.contextmanager
def served(
    replay: Replay,
    port: int,
    beside: Mapping[str, Path],
    port_names: tuple[str, str] = ("", "--port"),
) -> Iterator[PageServer]:
    """The same, serving while the block runs."""
    server = server_of(replay, port, beside, port_names)
    try:
        server.start()
        yield server
    finally:
        server.stop()


def serve(
    replay: Replay, port: int, beside: Mapping[str, Path], say: Callable[[str], None]
) -> None:
    """Serve until Ctrl-C, which is raised.

    Parameters
    ----------
    replay : Replay
    port : int
        0: any free one.
    beside : mapping
        What is served beside the page, by name.
    say : callable
        Takes a line for the user.
    """
    with served(replay, port, beside) as server:
        for note in replay.notes:
            say(f"note: {note}")
        r = replay.recording
        length_s = r.seconds(r.last_ns) - r.seconds(r.first_ns)
        say(f"replay: {server.url} ({length_s:.1f} s, {len(replay.events)} events; Ctrl-C ends it)")
        interrupts.check()
        threading.Event().wait()
