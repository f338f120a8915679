# SPDX-License-Identifier: Apache-2.0
"""A recorded flight as what `heli_analysis.handling` scores."""

import math
from dataclasses import dataclass, replace
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from scipy.spatial.transform import Rotation

from heli_analysis.handling.definitions import FULL_SCALE, MANOEUVRES, Criterion, Scale, froude
from heli_analysis.handling.manoeuvres import Array, BoundedSignal, MotionTrack, track_of
from heli_analysis.handling.scoring import (
    AXES,
    LEAST_COHERENCE,
    AttitudeChange,
    FrequencyResponse,
    ManoeuvreScore,
    Measure,
    bandwidth,
    changes,
    check_axis,
    frequency_response,
    of_bandwidth,
    of_rejection,
    rejection,
    resampled,
    score,
)
from heli_bags.opening import BagReader, bag_of, chosen, opened
from heli_bags.tools import flatten
from heli_bags.writer import BagError
from heli_core.coverage import Coverage, Span, coverage_of, least, period_of
from heli_core.rcl_yaml import ParameterError
from heli_core.rotations import euler_angles
from heli_core.rows import PLANT
from heli_core.signals import swept_angle
from heli_core.ticks import NS_PER_S, TICK_S, seconds, stamp_at
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_flight.flight_file import NAME
from heli_flight.graph.bag_record import ForeignTruth, judged_truth
from heli_flight.record import FlightRecord
from heli_flight.report.figures import BLUE, GREEN, GREY, ORANGE, RED, picture
from heli_flight.scenario import LEAD_IN_S, scale_flown, target_of
from heli_flight.settings import Settings, resolve
from heli_flight.terminal import table
from heli_inner_hinf.controller_state import ObserverInput
from heli_inner_hinf.design import AttitudeConfig
from heli_inner_hinf.excitation import disturbance_params
from heli_inner_hinf.loops import N_Y, N_Z
from heli_inner_hinf.tuning import loops_of, to_command, to_disturbance
from heli_msgs_bridge import topics
from heli_msgs_bridge.layouts import MessageError
from heli_msgs_bridge.messages import Decoder
from heli_msgs_bridge.signatures import SUM, checksum

# -------------------------------------------------------------------------------------------------
# Data.
# -------------------------------------------------------------------------------------------------

_ODOMETRY = topics.BY_NAME[topics.TRUTH_ODOM].type
_ATTITUDE = topics.BY_NAME[topics.ATTITUDE_SETPOINT].type


@dataclass(frozen=True)
class SourcedTrack:
    """A track, and where it is from.

    Attributes
    ----------
    track : MotionTrack
        Times from the first message on.
    topic : str
    start_ns : int
        Stamp of the first message.
    remarks : tuple of str
    forged : str
        Why the ground truth in the bag is not the plant's, one sentence; empty if it is.
    ordered_s : (float, float) or None
        Begin and end of a flight of ours as it was ordered, in the track's time, by params.yaml
        beside the bag; None: nobody knows.
    """

    track: MotionTrack
    topic: str
    start_ns: int
    remarks: tuple[str, ...] = ()
    forged: str = ""
    ordered_s: Span | None = None

    @property
    def begin_s(self) -> float:
        """Flight time 0 in the track's time; that of the first sample where nobody knows it."""
        return 0.0 if self.ordered_s is None else self.ordered_s[0]

    def asked(self, start_s: float | None, end_s: float | None) -> Span:
        """What should be recorded of the stretch that is asked for; None: from where, to where.

        Ground truth is there from flight time 0 on, the navigation from when it has begun.
        """
        begin, end = float(self.track.time_s[0]), float(self.track.time_s[-1])
        if self.ordered_s is not None:
            is_truth = self.topic.endswith(f"/{topics.TRUTH_ODOM}")
            begin, end = self.begin_s if is_truth else begin, self.ordered_s[1]
        return begin if start_s is None else start_s, end if end_s is None else end_s


def flight_of(path: Path, topic: str | None = None, number: int | None = None) -> SourcedTrack:
    """The motion that a bag holds.

    Parameters
    ----------
    path : Path
        rosbag2 folder, its file, or a flight's folder.
    topic : str, optional
        Of nav_msgs/Odometry, ENU and FLU; default: the ground truth of our graph, else the only
        one of this type.
    number : int, optional
        Which flight of a bag whose clock goes back, from 1 on; default: the last.

    Raises
    ------
    BagError, HandlingError
    """
    with opened(path, number) as reader:
        name = _odometry(reader, path, topic)
        (connection, *_) = chosen(reader, path, [name])
        decoder = Decoder(topics.TRUTH_ODOM, None, lambda raw: reader.deserialize(connection, raw))
        stamps, rows, sums, why, refused = [], [], [], "", 0
        for _, bag_ns, raw in reader.messages(connections=chosen(reader, path, [name])):
            reader.keep(raw)
            try:
                rows.append(decoder.decode(raw).copy())
                stamps.append(decoder.stamp_ns or bag_ns)
                sums.append(checksum(raw))
            except MessageError as error:
                why, refused = why or str(error).partition(": ")[2], refused + 1
        told = (*reader.remarks, *map(str, reader.lost([connection])))
    if not rows:
        raise BagError(f"{bag_of(path)}: no usable message on {name}" + (f": {why}" if why else ""))
    rigid, times = np.array(rows), np.array(stamps, dtype=np.int64)
    quat = rigid[:, PLANT.quat]
    to_ned = Rotation.from_quat(np.roll(quat, -1, axis=1))  # scalar last
    start_ns = int(times.min())
    track = track_of(
        (times - start_ns) / NS_PER_S,
        rigid[:, PLANT.pos],
        to_ned.apply(rigid[:, PLANT.vel]),
        euler_angles(quat),
    )
    refusals = (f"{refused} messages on {name} could not be used: {why}",) if refused else ()
    forged = unknown = ""
    if name.endswith(f"/{topics.TRUTH_ODOM}"):
        forged, unknown = _judged(path, times, np.frombuffer(b"".join(sums), SUM))
    remarks = (*told, *refusals, *([unknown] if unknown else []))
    return SourcedTrack(track, name, start_ns, remarks, forged, _ordered(path, name, start_ns))


def _ordered(path: Path, name: str, start_ns: int) -> Span | None:
    """As `SourcedTrack.ordered_s`, of a topic whose stamps are those of our clock."""
    saved = bag_of(path).resolve().parent / NAME
    ours = name.rpartition("/")[2] == topics.ODOM or name.endswith(f"/{topics.TRUTH_ODOM}")
    if not saved.is_file() or not ours:
        return None
    settings = resolve(params=[saved])
    begin_s = (stamp_at(settings.nodes["plant"]["start_time_s"]) - start_ns) / NS_PER_S
    end_s = begin_s + seconds(settings.scenario.n_ticks)
    # Of what begins behind the flight's end the clock is another.
    return (begin_s, end_s) if end_s > 0.0 else None


def _judged(path: Path, stamps_ns: NDArray[np.int64], sums: NDArray[np.uint64]) -> tuple[str, str]:
    """As `judged_truth`, of a bag's ground truth."""
    beside = bag_of(path).resolve().parent
    saved = beside / NAME
    settings = resolve(params=[saved] if saved.is_file() else [])
    rate, first_ns = settings.rate, stamp_at(settings.nodes["plant"]["start_time_s"])
    return judged_truth(ForeignTruth((stamps_ns - first_ns) // rate.tick_ns, sums), beside, rate)


def _odometry(reader: BagReader, path: Path, topic: str | None) -> str:
    """Full name of the odometry to score."""
    kinds = {c.topic: c.msgtype for c in reader.connections}
    if topic is not None:
        name = chosen(reader, path, [topic])[0].topic
        if kinds[name] != _ODOMETRY:
            raise BagError(f"{bag_of(path)}: {name} is {kinds[name]}, expected {_ODOMETRY}")
        return name
    names = sorted(name for name, kind in kinds.items() if kind == _ODOMETRY)
    truths = [name for name in names if name.endswith(f"/{topics.TRUTH_ODOM}")]
    for candidates in (truths, names):
        if len(candidates) == 1:
            return candidates[0]
    held = f"it holds {', '.join(names)}" if names else f"it holds no {_ODOMETRY}"
    raise BagError(f"{bag_of(path)}: name the odometry by --odom TOPIC; {held}")


def signal_of(
    path: Path, source: str, axis: str, start_ns: int, number: int | None = None
) -> tuple[Array, Array]:
    """A recorded number over time.

    Parameters
    ----------
    path : Path
    source : str
        `TOPIC:FIELD` with the field as `heli bag csv` heads its column, or a topic of attitudes
        (geometry_msgs/QuaternionStamped, FLU to ENU), of which the axis is taken, rad.
    axis : str
        roll, pitch or yaw; angles are those of FRD and NED.
    start_ns : int
        Stamp from which times count.
    number : int, optional
        Which flight of a bag whose clock goes back, from 1 on; default: the last.

    Returns
    -------
    (N,) array, (N,) array
        Times, s, and values.

    Raises
    ------
    BagError
    """
    topic, _, field = source.partition(":")
    with opened(path, number) as reader:
        name = _full_name(reader, path, topic)
        lines = chosen(reader, path, [name])
        kind = lines[0].msgtype
        if not field and kind != _ATTITUDE:
            raise BagError(f"{bag_of(path)}: {name} is {kind}: name a field, {name}:FIELD")
        decoder = Decoder(
            topics.ATTITUDE_SETPOINT, None, lambda raw: reader.deserialize(lines[0], raw)
        )
        stamps, values = [], []
        for _, bag_ns, raw in reader.messages(connections=lines):
            reader.keep(raw)
            if not field:
                values.append(float(decoder.decode(raw)[AXES.index(axis)]))
                stamps.append(decoder.stamp_ns or bag_ns)
                continue
            message = reader.deserialize(lines[0], raw)
            fields = flatten(message)
            if not isinstance(fields.get(field), int | float):
                numbers = [key for key, value in fields.items() if isinstance(value, int | float)]
                has = ", ".join(numbers) or "none"
                raise BagError(f"{bag_of(path)}: {name} has no number {field}; it has {has}")
            values.append(float(fields[field]))
            stamps.append(_stamp_ns(fields) or bag_ns)
    if not values:
        raise BagError(f"{bag_of(path)}: no message on {name}")
    times = (np.array(stamps, dtype=np.int64) - start_ns) / NS_PER_S
    order = np.argsort(times, kind="stable")
    numbers_then = np.array(values)[order]
    return times[order], numbers_then if field else np.unwrap(numbers_then)


def _stamp_ns(fields: dict[str, Any]) -> int:
    """Stamp of a message with a header; 0 without."""
    seconds = fields.get("header.stamp.sec", 0)
    return int(seconds * NS_PER_S + fields.get("header.stamp.nanosec", 0))


def _full_name(reader: BagReader, path: Path, topic: str) -> str:
    """A topic by its name, or by its end where only one ends so."""
    ends = [c.topic for c in reader.connections if c.topic.endswith(f"/{topic.lstrip('/')}")]
    return ends[0] if len(set(ends)) == 1 else chosen(reader, path, [topic])[0].topic


def _own_manoeuvre(path: Path, name: str) -> Settings | None:
    """Settings of a flight of ours that was to fly a manoeuvre, from params.yaml beside the bag."""
    saved = bag_of(path).resolve().parent / NAME
    if not saved.is_file():
        return None
    settings = resolve(params=[saved])
    p = settings.scenario_parameters
    ours = p["kind"] == "path" and p["path.kind"] == "manoeuvre" and p["path.manoeuvre"] == name
    return settings if ours else None


def own_course(path: Path, name: str, scale: Scale) -> tuple[Array, float] | None:
    """Target (3,), NED, m, and beginning, s, of a manoeuvre that a flight of ours was to fly.

    From params.yaml beside the bag; None where there is none, or for another manoeuvre or scale.

    Raises
    ------
    ParameterError
    """
    settings = _own_manoeuvre(path, name)
    if settings is None:
        return None
    p = settings.scenario_parameters
    if not math.isclose(scale_flown(p).ratio, scale.ratio, rel_tol=1e-6):
        return None
    return target_of(settings.scenario.reference, p), p["path.start_s"] - LEAD_IN_S


def scale_of(name: str, path: Path, rotor_diameter_m: float | None) -> tuple[Scale, str]:
    """Scale by its name, and what it was worked out from.

    The rotor's diameter is the given one, else that of the flight's aircraft (params.yaml beside
    the bag), else that of the packaged aircraft.

    Raises
    ------
    ParameterError, HandlingError
    """
    if name == FULL_SCALE.name:
        return FULL_SCALE, ""
    if rotor_diameter_m is not None:
        return froude(rotor_diameter_m), f"rotor diameter {rotor_diameter_m:g} m as given"
    saved = bag_of(path).resolve().parent / NAME
    files = [saved] if saved.is_file() else []
    aircraft = resolve(params=files).nodes["plant"]["aircraft_file"]
    radius_m = HelicopterParameters.from_yaml(aircraft).main_radius_m
    whose = "of the flight's aircraft" if files else "of the packaged aircraft: none was recorded"
    return froude(2.0 * radius_m), f"rotor diameter {2.0 * radius_m:g} m {whose}"


# -------------------------------------------------------------------------------------------------
# `heli score --mte`: from a bag to a table of levels.
# -------------------------------------------------------------------------------------------------

SCALES = (FULL_SCALE.name, "froude")
EXIT_NEITHER = 1
"""Outside of the bounds, or not flown as defined."""


@dataclass(frozen=True)
class ScoreOrder:
    """What the user asks for.

    Attributes
    ----------
    path : Path
    odom : str or None
        Topic.
    start_s, end_s : float or None
        Since the topic's first message.
    target_enu_m : (float, float, float) or None
        Hover point, end of the course or centre of the circle.
    ground_m : float
        Height of the ground in the topic's frame.
    number : int or None
        Which flight of a bag whose clock goes back, from 1 on; None: the last.
    """

    path: Path
    odom: str | None = None
    start_s: float | None = None
    end_s: float | None = None
    target_enu_m: tuple[float, float, float] | None = None
    ground_m: float = 0.0
    number: int | None = None


@dataclass(frozen=True)
class Scored:
    """A score, the flight, the stretch of its track, and remarks on both."""

    flight: SourcedTrack
    track: MotionTrack
    score: ManoeuvreScore
    remarks: tuple[str, ...]

    @property
    def exit_code(self) -> int:
        """0 for desired or adequate, if it was the manoeuvre as it is defined, and really flown.

        And if all of the stretch that was asked for is recorded.
        """
        return 0 if self.score.passed and not self.flight.forged else EXIT_NEITHER

    def as_dict(self, path: Path) -> dict[str, Any]:
        """For JSON."""
        return {
            **self.score.as_dict(),
            "flight": str(path),
            "topic": self.flight.topic,
            "start_ns": self.flight.start_ns,
            "forged": self.flight.forged,
            "remarks": list(self.remarks),
        }


def checked_scale(name: str, path: Path, rotor_diameter_m: float | None) -> tuple[Scale, str]:
    """As `scale_of`, and ParameterError for another name."""
    if name not in SCALES:
        raise ParameterError(f"--scale {name}: is none of {', '.join(SCALES)}")
    return scale_of(name, path, rotor_diameter_m)


def _scale_wanted(
    path: Path, name: str, scale_name: str | None, rotor_diameter_m: float | None
) -> tuple[Scale, str]:
    """The scale that is named, else the one that a flight of ours was to fly, else full scale."""
    settings = _own_manoeuvre(path, name) if scale_name is None else None
    if settings is None or rotor_diameter_m is not None:
        return checked_scale(scale_name or FULL_SCALE.name, path, rotor_diameter_m)
    flown = scale_flown(settings.scenario_parameters)
    return flown, f"scale {flown.name}, as it was to be flown"


def score_manoeuvre(
    wanted: ScoreOrder, name: str, scale_name: str | None, rotor_diameter_m: float | None
) -> Scored:
    """Score a manoeuvre of a bag; without a scale at that which a flight of ours was to fly.

    Raises
    ------
    ParameterError, BagError, HandlingError
        With one sentence.
    """
    if name not in MANOEUVRES:
        raise ParameterError(f"--mte {name}: is none of {', '.join(MANOEUVRES)}")
    scale, why = _scale_wanted(wanted.path, name, scale_name, rotor_diameter_m)
    flight = flight_of(wanted.path, wanted.odom, wanted.number)
    target, start_s, ours = None, wanted.start_s, ""
    if wanted.target_enu_m is not None:
        east, north, up = wanted.target_enu_m
        target = np.array([north, east, -up])
    elif wanted.odom is None and (course := own_course(wanted.path, name, scale)) is not None:
        target, begins_s = course
        start_s = flight.begin_s + begins_s if start_s is None else start_s
        north, east, down = target
        ours = (
            f"scored by where it was to be flown (params.yaml): target {east:.2f} {north:.2f} "
            f"{-down:.2f}, from {start_s:g} s on"
        )
    track = flight.track.between(start_s, wanted.end_s)
    asked_s = flight.asked(start_s, wanted.end_s)
    manoeuvre_score = score(track, name, scale, target, wanted.ground_m, asked_s)
    remarks = (*flight.remarks, *filter(None, (why, ours)), *manoeuvre_score.manoeuvre.remarks)
    return Scored(flight, track, manoeuvre_score, remarks)


def print_score(scored: Scored, out: Console) -> None:
    """Criteria, conditions and phases as tables."""
    manoeuvre_score = scored.score
    shown = table(
        f"ADS-33E-PRF {manoeuvre_score.table.paragraph} {manoeuvre_score.table.title}, "
        f"scale {manoeuvre_score.scale.name}: "
        f"{manoeuvre_score.level.value}"
        f"{'' if manoeuvre_score.complete else ', not flown as defined'}"
        f"{'' if manoeuvre_score.coverage.is_whole else ', partial'}",
        out,
    )
    shown.add_column("criterion", no_wrap=True)
    for name in ("worst", "at, s", "desired", "adequate"):
        shown.add_column(name, justify="right")
    shown.add_column("level")
    for result in manoeuvre_score.results:
        c = result.criterion
        sign = ">=" if c.at_least else "<="
        unit = c.quantity.value
        flown = ("not flown", "") if result.value is None else _flown(result.value, result.at_s)
        level = "" if result.level is None else result.level.value
        bounds = (f"{sign} {c.desired:.3g} {unit}", f"{sign} {c.adequate:.3g} {unit}")
        shown.add_row(c.text, *flown, *bounds, level)
    for flown_condition in manoeuvre_score.conditions:
        limits = flown_condition.condition
        value_text = (
            "not flown" if flown_condition.value is None else f"{flown_condition.value:.3g}"
        )
        span = f"{limits.low:.3g} to {limits.high:.3g} {limits.quantity.value}"
        met = (
            "as defined"
            if flown_condition.met
            else ""
            if flown_condition.value is None
            else "not as defined"
        )
        shown.add_row(f"({limits.text})", value_text, "", span, "", met)
    out.print(shown)
    phases = ", ".join(
        f"{p.name} {p.start_s:.2f} to {p.end_s:.2f} s" for p in manoeuvre_score.manoeuvre.phases
    )
    out.print(f"{scored.flight.topic}: {phases}", soft_wrap=True, markup=False)
    for remark in scored.remarks:
        out.print(remark, soft_wrap=True, markup=False)
    print_flaws(scored.flight, manoeuvre_score.coverage, out)


def print_flaws(flight: SourcedTrack, coverage: Coverage, out: Console) -> None:
    """Say where the ground truth is not the plant's, and what is not recorded."""
    if flight.forged:
        out.print(f"FORGED: {flight.forged}", soft_wrap=True, markup=False)
    if coverage.sentence:
        out.print(f"PARTIAL: {coverage.sentence}", soft_wrap=True, markup=False)


def _flown(value: float, at_s: float | None) -> tuple[str, str]:
    return f"{value:.3g}", "" if at_s is None else f"{at_s:.2f}"


# -------------------------------------------------------------------------------------------------
# Scores of manoeuvres and sweeps that were flown in this process.
# -------------------------------------------------------------------------------------------------


def true_track(record: FlightRecord) -> MotionTrack:
    """How the aircraft really moved."""
    return track_of(
        record.time_s,
        record.truth_pos_ned_m,
        record.truth_vel_ned_mps,
        euler_angles(record.truth_q_nb),
    )


def score_flown(settings: Settings, record: FlightRecord) -> ManoeuvreScore:
    """Score of a scenario whose path is a manoeuvre, from ground truth and the given place.

    Raises
    ------
    HandlingError
        The manoeuvre is not in the flight.
    """
    p = settings.scenario_parameters
    target, begin_s = target_of(settings.scenario.reference, p), p["path.start_s"] - LEAD_IN_S
    asked_s = (begin_s, seconds(settings.scenario.n_ticks))
    track = true_track(record).between(begin_s)
    return score(track, p["path.manoeuvre"], scale_flown(p), target, asked_s=asked_s)


def rejected(settings: Settings, record: FlightRecord, axis: int) -> FrequencyResponse:
    """Response of the disturbed attitude to what was added to it, over the sweep of a flight.

    Raises
    ------
    HandlingError
    """
    p = settings.nodes["inner_loop"]
    kernel = disturbance_params(p)
    since = record.time_s - kernel.start_s
    on = (since >= 0.0) & (since < kernel.duration_s)
    time_s = record.time_s[on]
    added = np.array([swept_angle(t, kernel) for t in time_s])
    angle = true_track(record).attitude_rad[on, axis]
    asked_s = (kernel.start_s, kernel.start_s + kernel.duration_s)
    return frequency_response(time_s, added, angle + added, asked_s=asked_s)


def swept(settings: Settings, record: FlightRecord, axis: int) -> FrequencyResponse:
    """Response of an angle (0 roll, 1 pitch, 2 yaw) to its command, over the sweep of a flight.

    Raises
    ------
    HandlingError
    """
    p = settings.nodes["outer_loop"]
    since = record.time_s - p["sweep.start_s"]
    on = (since >= 0.0) & (since < p["sweep.duration_s"])
    time_s, command = record.time_s[on], np.unwrap(record.setpoint[on, axis])
    angle = true_track(record).attitude_rad[on, axis]
    asked_s = (p["sweep.start_s"], p["sweep.start_s"] + p["sweep.duration_s"])
    return frequency_response(time_s, command, angle, asked_s=asked_s)


# -------------------------------------------------------------------------------------------------
# Responses of the attitude loop by its linear model: the second way to what sweeps give.
# -------------------------------------------------------------------------------------------------


class LinearLoop:
    """The attitude loop as flown, about hover, with ideal navigation.

    Parameters
    ----------
    settings : Settings
        Controllers and observer are those of the nodes.

    Raises
    ------
    ParameterError
        The controller is not linear.
    """

    def __init__(self, settings: Settings) -> None:
        config = AttitudeConfig.from_parameters(settings.nodes["inner_loop"])
        observer = settings.nodes["observer"]
        K = np.reshape(observer["K"], (N_Z, N_Y))
        feed = ObserverInput.from_parameters(observer)
        loops = loops_of(config, K, feed, config.actuation)
        if not loops:
            raise ParameterError(f"controller {config.controller}: is not linear")
        self._loop = loops[-1]

    def to_command(self, omega: np.ndarray, axis: str) -> FrequencyResponse:
        """Attitude's response to its command at omega (m,), rad/s, below Nyquist's."""
        k = AXES.index(axis)
        response = to_command(self._loop, omega)[:, k, k]
        return FrequencyResponse(omega, response, np.ones(omega.size))

    def to_disturbance(self, omega: np.ndarray, axis: str) -> FrequencyResponse:
        """The disturbed attitude's response to a disturbance of the measured attitude."""
        k = AXES.index(axis)
        response = to_disturbance(self._loop, omega)[:, k, k]
        return FrequencyResponse(omega, response, np.ones(omega.size))


def grid_radps(points: int = 2000) -> np.ndarray:
    """Frequencies (m,), rad/s, from far below an attitude loop's to Nyquist's."""
    return np.geomspace(0.05, 0.999 * np.pi / TICK_S, points)


# -------------------------------------------------------------------------------------------------
# Pictures of scores: the track over ground by phases, each bounded signal with its bounds.
# -------------------------------------------------------------------------------------------------

FORMATS = (".png", ".svg", ".pdf")
_COLOURS = (BLUE, RED, GREEN, ORANGE)
_STYLES = ("-", "--")
_ENDS = 2
"""Marks of a straight course: where it begins and ends."""


def check_picture(path: Path) -> None:
    """Refuse a picture that cannot be written, before anything is worked out.

    Raises
    ------
    ParameterError
    """
    if path.suffix.lower() not in FORMATS:
        raise ParameterError(f"--plot {path}: ends in none of {', '.join(FORMATS)}")
    if not path.resolve().parent.is_dir():
        raise ParameterError(f"--plot {path}: its folder does not exist")


def draw_score(track: MotionTrack, score: ManoeuvreScore, path: Path) -> None:
    """Draw a manoeuvre: ground track at the left, bounded signals over time at the right."""
    bounded = [c for c in score.table.criteria if c.name in score.manoeuvre.traces]
    rows = max(len(bounded), 1)
    with picture(path, rows, 2, (9.0, 1.2 + 1.9 * rows)) as (figure, axes):
        grid = axes[0, 0].get_gridspec()
        for ax in axes[:, 0]:
            ax.remove()
        _plan(figure.add_subplot(grid[:, 0]), track, score)
        for ax, criterion in zip(axes[:, 1], bounded, strict=False):
            _bounded(ax, criterion, score.manoeuvre.traces[criterion.name])
        axes[-1, 1].set_xlabel("time, s")
        scale = "" if score.scale.ratio == 1.0 else f", lengths x {score.scale.ratio:.4f} (Froude)"
        figure.suptitle(
            f"ADS-33E-PRF {score.table.paragraph} {score.table.title}{scale}: {score.level.value}"
        )


def _plan(ax, track: MotionTrack, score: ManoeuvreScore) -> None:
    """The ground track by phases: east and north of where it begins, or along a straight course."""
    marks = score.manoeuvre.marks_ned_m
    straight = len(marks) == _ENDS
    origin = marks[0] if straight else track.pos_ned_m[0, :2]
    turn = _course_axes(marks) if straight else np.eye(2)
    way, marks = (track.pos_ned_m[:, :2] - origin) @ turn, (marks - origin) @ turn
    ax.plot(way[:, 1], way[:, 0], color="#cccccc", linewidth=0.8)
    for n, phase in enumerate(score.manoeuvre.phases):
        at = (track.time_s >= phase.start_s) & (track.time_s <= phase.end_s)
        label = f"{phase.name}, {phase.end_s - phase.start_s:.1f} s"
        ax.plot(way[at, 1], way[at, 0], color=_COLOURS[n % len(_COLOURS)], label=label)
    style = "k+" if len(marks) == 1 else "k:"
    ax.plot(marks[:, 1], marks[:, 0], style, markersize=10, linewidth=0.8)
    for line, colour in _bounds(track, score, marks):
        ax.plot(line[:, 1], line[:, 0], color=colour, linewidth=0.9)
    if straight:
        ax.set_xlabel("right of the course, m (not to the same scale)")
        ax.set_ylabel("along it, m")
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=2)
        return
    ax.set_aspect("equal", adjustable="datalim")
    ax.set_xlabel("east of the first sample, m")
    ax.set_ylabel("north of it, m")
    ax.legend(loc="best")


def _course_axes(marks: Array) -> Array:
    """Matrix (2, 2) by which north, east become along and right of a straight course."""
    ahead = (marks[1] - marks[0]) / np.hypot(*(marks[1] - marks[0]))
    return np.array([[ahead[0], -ahead[1]], [ahead[1], ahead[0]]])


def _bounds(track: MotionTrack, score: ManoeuvreScore, marks: Array) -> list[tuple[Array, str]]:
    """Lines on the ground that the bounds are, in the axes of the marks, with their colours."""
    lines: list[tuple[Array, str]] = []
    names = {c.name: c for c in score.table.criteria}
    for name, shape in (("position", _boxes), ("track", _sides), ("radius", _rings)):
        if name in names:
            for bound, colour in ((names[name].desired, GREEN), (names[name].adequate, ORANGE)):
                lines += [(line, colour) for line in shape(track, score, marks, bound)]
    if "clearance" in names:
        least, most = names["clearance"].desired, names["error"].desired
        for bound, colour in ((least, GREEN), (least + most, ORANGE)):
            lines += [(line, colour) for line in _sides(track, score, marks, bound)]
    return lines


def _boxes(track: MotionTrack, score: ManoeuvreScore, marks: Array, bound: float) -> list[Array]:
    heading = _heading(track, score)
    corners = bound * np.array([[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]])
    c, s = np.cos(heading), np.sin(heading)
    return [marks[0] + corners @ np.array([[c, s], [-s, c]])]


def _sides(track: MotionTrack, score: ManoeuvreScore, marks: Array, bound: float) -> list[Array]:
    return [marks + [0.0, side] for side in (bound, -bound)]


def _rings(track: MotionTrack, score: ManoeuvreScore, marks: Array, bound: float) -> list[Array]:
    radius = score.table["radius_m"]
    centre = 0.5 * (marks.min(axis=0) + marks.max(axis=0))
    return [centre + (marks - centre) * (radius + off) / radius for off in (bound, -bound)]


def _heading(track: MotionTrack, score: ManoeuvreScore) -> float:
    """Yaw angle of the last phase, rad."""
    last = score.manoeuvre.phases[-1]
    at = (track.time_s >= last.start_s) & (track.time_s <= last.end_s)
    return float(np.median(track.attitude_rad[at, 2]))


def _bounded(ax, criterion: Criterion, trace: BoundedSignal) -> None:
    """A signal with its bounds: desired in green, adequate in orange."""
    for k, label in enumerate(trace.labels):
        colour = (BLUE, GREY)[k % 2]
        ax.plot(trace.time_s, trace.values[:, k], _STYLES[k % 2], color=colour, label=label)
    value, at_s = trace.worst(criterion.at_least)
    ax.axvline(at_s, color=RED, linewidth=0.8, linestyle=":")
    one_sided = criterion.at_least or criterion.name == "height"
    for bound, colour in ((criterion.desired, GREEN), (criterion.adequate, ORANGE)):
        for side in (bound,) if one_sided else (bound, -bound):
            ax.axhline(side, color=colour, linewidth=0.9)
    ax.set_ylabel(f"{criterion.name}, {criterion.quantity.value}")
    ax.set_title(f"{criterion.text}: worst {value:.3g} {criterion.quantity.value}", loc="left")
    if len(trace.labels) > 1:
        # Room for it above the bounds.
        ax.set_ylim(-1.15 * criterion.adequate, 1.6 * criterion.adequate)
        ax.legend(loc="upper right", ncols=2)


# -------------------------------------------------------------------------------------------------
# `heli score --response`: bandwidth, phase delay, quickness, disturbance rejection of a bag.
# -------------------------------------------------------------------------------------------------

SCHEMA = 1
"""Number of the layout of `Responses.as_dict`."""


@dataclass(frozen=True)
class Responses:
    """What a flight says of an axis.

    Attributes
    ----------
    flight : SourcedTrack
    axis : str
    source : str
        What was swept.
    scale : Scale
    response : FrequencyResponse
    measures : tuple of Measure
    changes : tuple of AttitudeChange
        Of attitude, from steady ones.
    remarks : tuple of str
    """

    flight: SourcedTrack
    axis: str
    source: str
    scale: Scale
    response: FrequencyResponse
    measures: tuple[Measure, ...]
    changes: tuple[AttitudeChange, ...]
    remarks: tuple[str, ...]

    @property
    def exit_code(self) -> int:
        """0 unless a measure is below its levels, or the record is forged or not whole."""
        below = any(m.level == "below" for m in self.measures)
        whole = self.response.coverage.is_whole
        return EXIT_NEITHER if below or self.flight.forged or not whole else 0

    def as_dict(self, path: Path) -> dict[str, Any]:
        """For JSON."""
        return {
            "schema": SCHEMA,
            "response": self.axis,
            "source": self.source,
            "scale": {"name": self.scale.name, "length_ratio": self.scale.ratio},
            "coherent_from_radps": float(self.response.omega_radps[0]),
            "coherent_to_radps": float(self.response.omega_radps[-1]),
            "measures": [measure.as_dict() for measure in self.measures],
            "changes": [change.as_dict() for change in self.changes],
            "omega_radps": self.response.omega_radps.tolist(),
            "gain_db": self.response.gain_db.tolist(),
            "phase_deg": self.response.phase_deg.tolist(),
            "coherence": self.response.coherence.tolist(),
            "flight": str(path),
            "topic": self.flight.topic,
            "start_ns": self.flight.start_ns,
            "forged": self.flight.forged,
            "coverage": self.response.coverage.as_dict(),
            "partial": self.response.coverage.sentence,
            "remarks": list(self.remarks),
        }


def score_response(
    wanted: ScoreOrder,
    axis: str,
    command: str | None,
    disturbance: str | None,
    scale_name: str | None,
    rotor_diameter_m: float | None,
) -> Responses:
    """Response of an axis to its command, or of its attitude to a disturbance of the measured one.

    Raises
    ------
    ParameterError, BagError, HandlingError
        With one sentence.
    """
    check_axis(axis)
    scale, why = checked_scale(scale_name or FULL_SCALE.name, wanted.path, rotor_diameter_m)
    flight = flight_of(wanted.path, wanted.odom, wanted.number)
    track = flight.track.between(wanted.start_s, wanted.end_s)
    source = disturbance or command or topics.ATTITUDE_SETPOINT
    input_time_s, swept_input = signal_of(wanted.path, source, axis, flight.start_ns, wanted.number)
    angle = track.attitude_rad[:, AXES.index(axis)]
    both = (max(track.time_s[0], input_time_s[0]), min(track.time_s[-1], input_time_s[-1]))
    step_s = float(np.median(np.diff(track.time_s)))
    at_s = np.arange(both[0], both[1], step_s)
    swept, answer = resampled(input_time_s, swept_input, at_s), resampled(track.time_s, angle, at_s)
    if disturbance:
        # The disturbed attitude is the true one and the disturbance.
        response = frequency_response(at_s, swept, answer + swept)
        measures = of_rejection(rejection(response), axis, scale)
    else:
        response = frequency_response(at_s, swept, answer)
        measures = of_bandwidth(bandwidth(response), axis, scale)
    response = replace(response, coverage=_held_of(wanted, flight, source, input_time_s))
    remarks = (*flight.remarks, *([why] if why else []))
    attitude_changes = tuple(changes(track.time_s, angle))
    return Responses(
        flight, axis, source, scale, response, tuple(measures), attitude_changes, remarks
    )


def _held_of(
    wanted: ScoreOrder, flight: SourcedTrack, source: str, input_time_s: Array
) -> Coverage:
    """What is recorded of the stretch that a response is worked out from: the less of the two.

    What is swept may begin later than the flight, and, as far as nobody knows better, end earlier.
    """
    begin, end = flight.asked(wanted.start_s, wanted.end_s)
    sent_to_the_end = flight.ordered_s is not None and source in topics.BY_NAME
    if wanted.end_s is None and not sent_to_the_end:
        end = min(end, float(input_time_s[-1]))
    later = begin if wanted.start_s is not None else max(begin, float(input_time_s[0]))
    times = flight.track.time_s
    return least(
        (
            coverage_of(times, [(begin, end)], period_of(times)),
            coverage_of(input_time_s, [(later, end)], period_of(input_time_s)),
        )
    )


def print_response(responses: Responses, out: Console) -> None:
    """Measures and changes as tables."""
    shown = table(f"{responses.axis}, {responses.source}, scale {responses.scale.name}", out)
    shown.add_column("measure", no_wrap=True)
    for name in ("value", "Level 1", "Level 2"):
        shown.add_column(name, justify="right")
    shown.add_column("level")
    for m in responses.measures:
        sign = ">=" if m.at_least else "<="
        value = "not reached" if m.value is None else f"{m.value:.3g} {m.unit}"
        bounds = ["" if b is None else f"{sign} {b:.3g} {m.unit}" for b in (m.level1, m.level2)]
        shown.add_row(m.text, value, *bounds, m.level or "")
    for change in responses.changes:
        what = f"quickness, {change.peak_deg:.1f} deg at {change.start_s:.1f} s"
        shown.add_row(what, f"{change.quickness_per_s:.3g} 1/s", "", "", "")
    out.print(shown)
    print_flaws(responses.flight, responses.response.coverage, out)
    omega = responses.response.omega_radps
    out.print(
        f"{responses.flight.topic}: coherence above {LEAST_COHERENCE:g} from {omega[0]:.3g} to "
        f"{omega[-1]:.3g} rad/s",
        soft_wrap=True,
        markup=False,
    )
    for remark in responses.remarks:
        out.print(remark, soft_wrap=True, markup=False)


def draw_response(responses: Responses, path: Path) -> None:
    """Gain, phase and coherence over frequency, with what was read from them."""
    response = responses.response
    with picture(path, 3, 1, (6.0, 6.6), sharex=True) as (figure, axes):
        gain, phase, coherence = axes[:, 0]
        gain.semilogx(response.omega_radps, response.gain_db, color=BLUE)
        gain.set_ylabel("gain, dB")
        phase.semilogx(response.omega_radps, response.phase_deg, color=BLUE)
        phase.set_ylabel("phase, deg")
        coherence.semilogx(response.omega_radps, response.coherence, color=GREY)
        coherence.axhline(LEAST_COHERENCE, color=ORANGE, linewidth=0.9)
        coherence.set_ylim(0.0, 1.05)
        coherence.set_ylabel("coherence")
        coherence.set_xlabel("frequency, rad/s")
        frequencies = (m for m in responses.measures if m.unit == "rad/s")
        for colour, measure in zip(cycle((GREEN, ORANGE, GREY)), frequencies, strict=False):
            if measure.value is not None:
                for ax in (gain, phase):
                    label = f"{measure.text}: {measure.value:.3g} rad/s"
                    ax.axvline(measure.value, color=colour, linestyle=":", label=label)
        gain.legend(loc="lower left")
        figure.suptitle(f"{responses.axis}: {responses.source}")
