# SPDX-License-Identifier: Apache-2.0
"""A flight's record out of its bag."""

import bisect
import contextlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from heli_bags.reader import Bag, Remark, read_bag
from heli_bags.writer import BagError
from heli_core.coverage import A_FEW
from heli_core.errors import FlightError
from heli_core.foreign_files import FileError
from heli_core.rotations import quat_to_R_nb
from heli_core.rows import ACTUATOR, IMU, JOINTS, NAV, PLANT, REFERENCE, ROTOR
from heli_core.ticks import Rate, stamp_at
from heli_core.trajectory import Trajectory
from heli_flight.record import FlightRecord
from heli_flight.settings import Settings
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import (
    FACT_FAILSAFE,
    FACT_LAW_FAILED,
    FACT_MODE,
    NodeState,
    climb_of,
    offset_of,
    state_of,
)
from heli_msgs_bridge.signatures import SUM, read_checksums
from heli_outer_pd.failsafes import Action
from heli_outer_pd.parameters import NODE_NAME as OUTER_LOOP
from heli_outer_pd.reference import ReferenceLimits, ReferenceRefused, moved

# -------------------------------------------------------------------------------------------------
# Bag record.
# -------------------------------------------------------------------------------------------------

_FOLLOWING = ("hover", "trajectory")


@dataclass(frozen=True)
class _Clock:
    """The ticks of a flight: stamp of the first, and their rate."""

    start_ns: int
    rate: Rate

    def ticks(self, stamp_ns: Any) -> Any:
        """Tick of a stamp, or of an array of them; of the last one that is not later."""
        return (stamp_ns - self.start_ns) // self.rate.tick_ns


def _at(bag: Bag, name: str, ticks: NDArray[np.int64], clock: _Clock, size: int) -> np.ndarray:
    """Rows (N, size) at the ticks: the newest message at or before each.

    NaN before the first one, and in a gap of more than `A_FEW` of its periods: what was said before
    it says nothing of then.
    """
    rows, stream = np.full((ticks.size, size), np.nan), bag.streams.get(name)
    if stream is None or not stream.stamp_ns.size:
        return rows
    known = clock.ticks(stream.stamp_ns)
    index = np.searchsorted(known, ticks, side="right") - 1
    period = clock.rate.every(topics.BY_NAME[name].every_ticks)
    until = np.append(known[1:], ticks[-1] + 1)
    silent = until - known > (A_FEW + 1) * period
    held = (index >= 0) & ~(silent[index] & (ticks - known[index] >= period))
    rows[held] = stream.rows[index[held]]
    return rows


def _modes(bag: Bag) -> list[tuple[int, str]]:
    """Modes that the outer loop told, and from when on, ns; none if it only ever followed."""
    changes = [(r.stamp_ns, r.facts[FACT_MODE]) for r in bag.remarks
            if r.node == OUTER_LOOP and FACT_MODE in r.facts]  # fmt: skip
    # By when it was so, not by when it was heard: a late message of before says nothing of later.
    changes.sort(key=lambda what: what[0])
    return changes if any(mode not in _FOLLOWING for _, mode in changes) else []


def _mode(bag: Bag, ticks: NDArray[np.int64], clock: _Clock) -> np.ndarray | None:
    """Mode (N,) at the ticks; None for a flight that only ever followed."""
    changes = _modes(bag)
    if not changes:
        return None
    modes = np.full(ticks.size, changes[0][1], "U10")
    for stamp_ns, mode in changes:
        modes[np.searchsorted(ticks, clock.ticks(stamp_ns)) :] = mode
    return modes


def _climb(bag: Bag, ticks: NDArray[np.int64], clock: _Clock) -> np.ndarray | None:
    """Own height of the newest take-off (N,) at the ticks, m; None where none had one."""
    told = [(remark.stamp_ns, climb_of(remark.facts)) for remark in bag.remarks
            if remark.node == OUTER_LOOP and FACT_MODE in remark.facts]  # fmt: skip
    told.sort(key=lambda what: what[0])
    if all(height_m is None for _, height_m in told):
        return None
    heights = np.full(ticks.size, np.nan)
    for stamp_ns, height_m in told:
        heights[np.searchsorted(ticks, clock.ticks(stamp_ns)) :] = (
            np.nan if height_m is None else height_m
        )
    return heights


def _failsafe(bag: Bag, ticks: NDArray[np.int64], clock: _Clock) -> np.ndarray | None:
    """What the outer loop did by itself (N,) at the ticks; None where it never did anything."""
    changes = [(r.stamp_ns, r.facts[FACT_FAILSAFE]) for r in bag.remarks
            if r.node == OUTER_LOOP and FACT_FAILSAFE in r.facts]  # fmt: skip
    if all(action == Action.NONE.name for _, action in changes):
        return None
    actions = np.full(ticks.size, Action.NONE.name, "U14")
    for stamp_ns, action in sorted(changes, key=lambda what: what[0]):
        actions[np.searchsorted(ticks, clock.ticks(stamp_ns)) :] = action
    return actions


def _followed(bag: Bag, limits: ReferenceLimits) -> list[tuple[int, Trajectory]]:
    """References that the outer loop followed, and from when on, in the order of their arrival."""
    followed: list[tuple[int, Trajectory]] = []
    if _modes(bag):
        # Its own ways lead to the ground: they are outside the limits of others' references.
        return list(bag.references)
    for came_ns, trajectory in bag.references:
        home = (followed[0][1] if followed else trajectory).points[0, REFERENCE.pos]
        with contextlib.suppress(ReferenceRefused):
            limits.judge(trajectory, home, came_ns)
            followed.append((came_ns, trajectory))
    return followed


def _commanded(
    bag: Bag, ticks: NDArray[np.int64], clock: _Clock, limits: ReferenceLimits
) -> np.ndarray | None:
    """Where (N,) it followed another reference than the first, or another mode; None: nowhere."""
    followed = sorted(_followed(bag, limits), key=lambda pair: pair[0])
    others = [came_ns for came_ns, way in followed if not _is_same(way, followed[0][1])]
    began = others + [at_ns for at_ns, mode in _modes(bag) if mode not in _FOLLOWING]
    if not began:
        return None
    return np.asarray(ticks >= clock.ticks(np.array([min(began)]))[0])


def _is_same(one: Trajectory, other: Trajectory) -> bool:
    return np.array_equal(one.times_ns, other.times_ns) and np.array_equal(one.points, other.points)


def _engaged(bag: Bag) -> tuple[int, NDArray[np.float64]] | None:
    """When the outer loop engaged, ns, and by what it then moved its reference, NED, m."""
    for remark in bag.remarks:
        offset = offset_of(remark.facts) if remark.node == OUTER_LOOP else None
        if offset is not None:
            return remark.stamp_ns, np.array(offset)
    return None


def _reference(
    bag: Bag, ticks: NDArray[np.int64], clock: _Clock, limits: ReferenceLimits
) -> np.ndarray:
    """Reference rows (N, 7) at the ticks: of the trajectory come last, the first one before it.

    As the outer loop followed it: moved to where the aircraft was when the controller engaged, if
    it was.
    """
    rows = np.full((ticks.size, REFERENCE.size), np.nan)
    trajectories = sorted(_followed(bag, limits), key=lambda pair: pair[0])
    if not trajectories:
        return rows
    begun = [came_ns for came_ns, _ in trajectories]
    engaged = _engaged(bag)
    if engaged is not None:
        at_ns, offset = engaged
        first = max(bisect.bisect_right(begun, at_ns) - 1, 0)
        trajectories[first] = begun[first], moved(trajectories[first][1], offset)
    for i, tick in enumerate(ticks.tolist()):
        now_ns = clock.start_ns + tick * clock.rate.tick_ns
        rows[i] = trajectories[max(bisect.bisect_right(begun, now_ns) - 1, 0)][1].at(now_ns)
    return rows


@dataclass(frozen=True)
class BagFlight:
    """A bag as a flight.

    Attributes
    ----------
    record : FlightRecord
        NaN where a topic says nothing.
    remarks : sequence of Remark
        The nodes' health.
    foreign : sequence of str
        Recorded topics that are not of the graph.
    aircraft : str
        Namespace of the topics; empty for none.
    truth_ticks, truth_sums : (N,) arrays, optional
        Ticks of the ground truth, and sums of its messages; None: there is none.
    notes : sequence of str
        What to know of the bag (`heli_bags.reader.Bag`).
    """

    record: FlightRecord
    remarks: Sequence[Remark]
    foreign: Sequence[str]
    aircraft: str = ""
    truth_ticks: NDArray[np.int64] | None = None
    truth_sums: NDArray[np.uint64] | None = None
    notes: Sequence[str] = ()


def lost_with_law(plant_sentence: str, node_facts: Iterable[Mapping[str, str]]) -> str:
    """Why a flight was lost: a failed controller in Python comes before the aircraft's end.

    Parameters
    ----------
    plant_sentence : str
        What the plant said of the aircraft; empty if it flies.
    node_facts : iterable of mapping
        Facts of the nodes' diagnostics.
    """
    failures = dict.fromkeys(
        facts[FACT_LAW_FAILED] for facts in node_facts if FACT_LAW_FAILED in facts
    )
    return ". Then: ".join([*failures, *([plant_sentence] if plant_sentence else [])])


def flight_from_bag(
    path: Path, settings: Settings, truth_needed: bool = True, flight: int | None = None
) -> BagFlight:
    """Record and health of a flight, one row per tick of ground truth.

    Parameters
    ----------
    path : Path
        rosbag2 folder.
    settings : Settings
        Give the stamp of flight time 0 and the rate.
    truth_needed : bool
        False: a bag without ground truth is taken too, one row per tick of `odom`.
    flight : int, optional
        Which flight of a bag whose clock goes back, from 1 on; default: the last.

    Returns
    -------
    BagFlight

    Raises
    ------
    FlightError
        The bag cannot be read or holds no flight.
    """
    try:
        bag = read_bag(path, flight=flight)
    except BagError as error:
        raise FlightError(str(error)) from error
    clock = _Clock(stamp_at(settings.nodes["plant"]["start_time_s"]), settings.rate)
    source = bag.streams.get(topics.TRUTH_ODOM)
    if source is None or not source.stamp_ns.size:
        if truth_needed:
            raise FlightError(f"{path}: holds no {topics.TRUTH_ODOM}")
        source = bag.streams.get(topics.ODOM)
    if source is None or not source.stamp_ns.size:
        other = f"; of other kinds: {', '.join(bag.foreign)}" if bag.foreign else ""
        raise FlightError(
            f"{path}: holds neither {topics.TRUTH_ODOM} nor {topics.ODOM}: no flight{other}"
        )
    ticks = clock.ticks(source.stamp_ns)
    limits = ReferenceLimits.from_parameters(settings.nodes["outer_loop"])
    # Two messages of a tick that differ are judged both, and give one row.
    record = _record(bag, np.unique(ticks), clock, limits)
    # When the plant has flown its last tick, nobody hears it any more: that is no news.
    end_ns = int(source.stamp_ns[-1])
    remarks = [
        r
        for r in bag.remarks
        if r.stamp_ns < end_ns or state_of(r.facts, r.message) != NodeState.WITHOUT_INPUT
    ]
    truth_ticks = ticks if source.sums is not None else None
    return BagFlight(
        record, remarks, bag.foreign, bag.aircraft, truth_ticks, source.sums, bag.notes
    )


def _excited(bag: Bag) -> bool:
    return topics.EXCITATION_ACTUATORS in bag.streams or topics.EXCITATION_WIND in bag.streams


def _record(
    bag: Bag, ticks: NDArray[np.int64], clock: _Clock, limits: ReferenceLimits
) -> FlightRecord:
    def at(name: str, size: int) -> np.ndarray:
        return _at(bag, name, ticks, clock, size)

    excited = _excited(bag)

    truth, nav = at(topics.TRUTH_ODOM, PLANT.rigid.stop), at(topics.ODOM, NAV.size)
    velocity = np.array([quat_to_R_nb(row[PLANT.quat]) @ row[PLANT.vel] for row in truth])
    return FlightRecord(
        time_s=clock.rate.seconds(ticks),
        truth_pos_ned_m=truth[:, PLANT.pos],
        truth_vel_ned_mps=velocity,
        truth_rate_body_radps=truth[:, PLANT.rate],
        truth_q_nb=truth[:, PLANT.quat],
        truth_rotor=at(topics.TRUTH_ROTOR, JOINTS.size)[:, JOINTS.rotor],
        wind_ned_mps=at(topics.TRUTH_WIND, 3),
        nav_pos_ned_m=nav[:, NAV.pos],
        nav_vel_ned_mps=nav[:, NAV.vel],
        nav_rate_body_radps=nav[:, NAV.rate],
        nav_q_nb=nav[:, NAV.quat],
        nav_rotor=at(topics.ROTOR_STATE, ROTOR.size),
        reference=_reference(bag, ticks, clock, limits),
        setpoint=at(topics.ATTITUDE_SETPOINT, 3),
        u=at(topics.ACTUATORS, ACTUATOR.size),
        nav_sigma_pos_m=nav[:, NAV.sigma_pos],
        nav_sigma_vel_mps=nav[:, NAV.sigma_vel],
        nav_sigma_att_rad=nav[:, NAV.sigma_att],
        excitation_u=at(topics.EXCITATION_ACTUATORS, ACTUATOR.size) if excited else None,
        gust_ned_mps=at(topics.EXCITATION_WIND, 3) if excited else None,
        imu=at(topics.IMU, IMU.size) if topics.IMU in bag.streams else None,
        mode=_mode(bag, ticks, clock),
        failsafe=_failsafe(bag, ticks, clock),
        takeoff_height_m=_climb(bag, ticks, clock),
        commanded=_commanded(bag, ticks, clock, limits),
    )


# -------------------------------------------------------------------------------------------------
# Whether the ground truth in a flight's bag is what its plant sent.
# -------------------------------------------------------------------------------------------------

TRUTH_SUMS = "truth.sums"
"""File in a flight's folder: what the plant says that it sent, on a way that DDS does not have."""
_RESULT, _GRAPH = "result.json", "graph.yaml"  # of a flight that ended; of any of the graph


class RecordedTruth(Protocol):
    """Ground truth as it was recorded: ticks and sums (N,) of its messages; None: there is none."""

    @property
    def truth_ticks(self) -> NDArray[np.int64] | None:
        """Ticks of the messages."""

    @property
    def truth_sums(self) -> NDArray[np.uint64] | None:
        """Sums of their bytes (`heli_msgs_bridge.node_process`)."""


class ForeignTruth(NamedTuple):
    """The ground truth of a bag of anybody."""

    truth_ticks: NDArray[np.int64] | None
    truth_sums: NDArray[np.uint64] | None


def foreign_truth(flight: RecordedTruth, path: Path, rate: Rate, broken_off: bool = False) -> str:
    """Sentence about recorded ground truth that is not the plant's; empty if all of it is.

    Messages that are lost on the way leave the others as they were.

    Parameters
    ----------
    flight : RecordedTruth
        With ground truth.
    path : Path
        What the plant wrote (`TRUTH_SUMS`).
    rate : Rate
        Of the ticks.
    broken_off : bool
        Whether the plant may have been killed before it wrote the last sums: then nothing is said
        of messages beyond them.
    """
    if flight.truth_ticks is None or flight.truth_sums is None:
        return f"the bag holds no {topics.TRUTH_ODOM}"
    try:
        sent = read_checksums(path)
    except FileError as error:
        return f"what the plant sent is not known: {path.name}: {error.problem}"
    ticks, sums = flight.truth_ticks, flight.truth_sums
    known = (ticks >= 0) & (ticks < sent.size)
    matches = np.zeros(ticks.size, dtype=bool)
    matches[known] = sums[known] == sent[ticks[known]]
    if broken_off:
        matches |= ticks >= sent.size
    if matches.all():
        return ""
    first_s = rate.seconds(int(ticks[~matches][0]))
    return (
        f"{topics.TRUTH_ODOM} in the bag is not what the plant sent: "
        f"{np.count_nonzero(~matches)} of {ticks.size} messages, "
        f"the first at {first_s:.2f} s; somebody else sends on it"
    )


def judged_truth(flight: RecordedTruth, folder: Path, rate: Rate) -> tuple[str, str]:
    """The same of a flight that lies in a folder: what is false of it, and what is not known.

    Parameters
    ----------
    flight : RecordedTruth
    folder : Path
        That holds the bag; of a foreign bag nothing is said.
    rate : Rate

    Returns
    -------
    str, str
        Two sentences, each empty where there is nothing to say.
    """
    path = folder / TRUTH_SUMS
    if flight.truth_ticks is None:
        return "", ""
    if not path.is_file():
        flown_here = (folder / _GRAPH).is_file()
        unknown = f"{TRUTH_SUMS} is not beside the bag: whether its ground truth is what the plant "
        return "", f"{unknown}sent is not known." if flown_here else ""
    ended = (folder / _RESULT).is_file()
    forged = foreign_truth(flight, path, rate, broken_off=not ended)
    beyond = int(np.count_nonzero(flight.truth_ticks >= path.stat().st_size // SUM.itemsize))
    if forged or ended or not beyond:
        return forged, ""
    return "", (
        f"The flight was interrupted: whether the last {beyond} messages of ground truth are what "
        "the plant sent is not known."
    )
