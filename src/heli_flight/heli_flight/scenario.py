# SPDX-License-Identifier: Apache-2.0
"""Scenarios: what is flown, from which reference, and which stretches of it are scored.

A scenario is an rcl parameter file: the rows of the `scenario` node, and what it changes in the
other nodes. So it is layered, checked and overridden like every other parameter.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_analysis.handling.definitions import (
    FULL_SCALE,
    MANOEUVRES,
    Manoeuvre,
    Scale,
    froude,
    manoeuvre,
)
from heli_core.errors import PathError
from heli_core.metrics import BY_KEY, METRICS, PaperMetric, bound_key, bounded, in_windows
from heli_core.parameters import Parameter
from heli_core.rcl_yaml import ParameterError
from heli_core.rotations import euler_angles, quat_to_R_nb
from heli_core.rows import PLANT, REFERENCE
from heli_core.ticks import TICK_NS, TICKS_PER_S, seconds, ticks_in
from heli_core.trajectory import Trajectory
from heli_dynamics_sim.ground import GroundParams, ground_contact
from heli_flight.record import FlightRecord
from heli_outer_pd.guidance.paths import Circle, FlightPath, Lemniscate, Slalom
from heli_outer_pd.guidance.transfer import MotionLimits

# -------------------------------------------------------------------------------------------------
# The path of a scored manoeuvre: from its published table to the trajectory that is flown.
# -------------------------------------------------------------------------------------------------

FROUDE = "froude"
_OBLIQUE_RAD = math.radians(45.0)
_APPROACH_S = 4.0
"""Flown at the approach's speed before the hover, at full size."""
_PLENTY = 1.1
"""Of what has to be reached at least: to be sure that it is."""
LEAD_IN_S = 3.0
"""Scored from so long before the path begins: what drifts in the hover before it is no part."""
_TURNS = 4
_BEYOND = 0.5
"""Of the room beyond a slalom's gates: how far its turns reach into it."""

MTE_ROWS: tuple[Parameter, ...] = (
    Parameter(
        "path.manoeuvre", "string", "Manoeuvre that path.kind manoeuvre flies",
        choices=tuple(MANOEUVRES),
    ),
    Parameter(
        "path.scale", "string",
        "Size of the manoeuvre: as published, or by the Froude number for path.rotor_diameter_m",
        choices=(FULL_SCALE.name, FROUDE),
    ),
    Parameter(
        "path.rotor_diameter_m", "double", "Main rotor's diameter, for the scale froude", "m",
        lower=0.05, upper=50.0,
    ),
)  # fmt: skip
"""Rows of the `scenario` node."""


def scale_flown(p: Mapping[str, Any]) -> Scale:
    """The size of a scenario's manoeuvre."""
    return FULL_SCALE if p["path.scale"] == FULL_SCALE.name else froude(p["path.rotor_diameter_m"])


def table_of(p: Mapping[str, Any]) -> Manoeuvre:
    """The table of a scenario's manoeuvre, at its scale."""
    return manoeuvre(p["path.manoeuvre"], scale_flown(p))


def target_of(reference: Trajectory, p: Mapping[str, Any]) -> NDArray[np.float64]:
    """What the manoeuvre is scored by (3,), NED, m: its end, or the centre of its circle."""
    table = table_of(p)
    if table.name == "pirouette":
        start, psi = reference.points[0, REFERENCE.pos], reference.points[0, REFERENCE.psi]
        nose = np.array([math.cos(psi), math.sin(psi), 0.0])
        return np.asarray(start + table["radius_m"] * nose)
    return np.asarray(reference.points[-1, REFERENCE.pos])


def fly_manoeuvre(path: FlightPath, p: Mapping[str, Any]) -> Trajectory:
    """A manoeuvre from where a path stands; at its end it stands still for as long as is scored.

    Raises
    ------
    ParameterError
        Within the limits of the path the manoeuvre's speed is not reached.
    PathError
        As the path's pieces raise it.
    """
    table = table_of(p)
    {
        "hover": _hover,
        "vertical": _vertical,
        "pirouette": _pirouette,
        "slalom": _slalom,
        "lateral-reposition": _lateral_reposition,
        "depart-abort": _depart_abort,
    }[table.name](path, table)
    held = table.geometry.get("hold_s", table.geometry.get("still_for_s"))
    path.stay((0.0 if held is None else held[1]) + p["path.stay_s"])
    reference = path.trajectory()
    level = reference.points[:, REFERENCE.vel][:, :2]
    _check_speed(table, float(np.hypot(level[:, 0], level[:, 1]).max()), p)
    return reference


def _least_mps(table: Manoeuvre) -> float:
    """Speed over ground without which it is not the manoeuvre, or not even adequate."""
    if table.name == "pirouette":
        return 2.0 * math.pi * table["radius_m"] / table.bounds("time").adequate
    if table.name == "slalom":
        return table.bounds("speed").adequate
    names = {"approach", "peak"}
    return max((c.low for c in table.conditions if c.name in names), default=0.0)


def _aim_mps(table: Manoeuvre) -> float:
    """Speed to fly at: where there is a range its middle, else what is desired, and a little."""
    if table.name == "pirouette":
        return _PLENTY * 2.0 * math.pi * table["radius_m"] / table.bounds("time").desired
    if table.name == "slalom":
        return 1.03 * table.bounds("speed").desired
    (fastest,) = (c for c in table.conditions if c.name in ("approach", "peak"))
    return 0.5 * (fastest.low + fastest.high)


def _check_speed(table: Manoeuvre, reached_mps: float, p: Mapping[str, Any]) -> None:
    least = _least_mps(table)
    if reached_mps < least:
        raise ParameterError(
            f"scenario: path.manoeuvre {table.name}, path.scale {p['path.scale']}: takes at least "
            f"{least:.1f} m/s over ground (ADS-33E-PRF {table.paragraph}); {reached_mps:.1f} m/s "
            f"are reached within path.speed_mps {p['path.speed_mps']:g}, path.acceleration_mps2 "
            f"{p['path.acceleration_mps2']:g} and path.jerk_mps3 {p['path.jerk_mps3']:g}"
        )


def _goal(path: FlightPath, course_rad: float, length_m: float) -> NDArray[np.float64]:
    """Where a level way in a direction ends (3,), NED, m."""
    way = np.array([math.cos(course_rad), math.sin(course_rad), 0.0])
    return np.asarray(path.pos_ned_m) + length_m * way


def _limit(path: FlightPath, speed_mps: float) -> None:
    """Fly no faster from here on."""
    speed = min(speed_mps, path.limits.speed_mps)
    path.limits = replace(path.limits, speed_mps=speed)


def _hover(path: FlightPath, table: Manoeuvre) -> None:
    """Obliquely, forward and to the right, to the hover point."""
    speed, time = _aim_mps(table), table["still_for_s"]
    _limit(path, speed)
    run_m = speed * _APPROACH_S * time + speed**2 / path.limits.acceleration_mps2
    run_m += speed * path.limits.acceleration_mps2 / path.limits.jerk_mps3
    path.go_to(_goal(path, path.psi_rad + _OBLIQUE_RAD, run_m))


def _vertical(path: FlightPath, table: Manoeuvre) -> None:
    """Up, a stay, and down."""
    first = np.asarray(path.pos_ned_m).copy()
    (top,) = (c for c in table.conditions if c.name == "top")
    path.go_to(first - np.array([0.0, 0.0, table["ascent_m"]])).stay(_PLENTY * top.low)
    path.go_to(first)


def _pirouette(path: FlightPath, table: Manoeuvre) -> None:
    """Around a centre ahead, to the left."""
    course = path.psi_rad - 0.5 * math.pi
    circle = Circle(path.pos_ned_m, course, table["radius_m"])
    path.along(circle, _aim_mps(table), 1.0, "centre")


def _slalom(path: FlightPath, table: Manoeuvre) -> None:
    """Along the nose, turning between the gates and as far beyond them as they may be missed."""
    speed = min(_aim_mps(table), path.limits.speed_mps)
    run_in = speed**2 / path.limits.acceleration_mps2
    run_in += speed * path.limits.acceleration_mps2 / path.limits.jerk_mps3
    aside = table["gate_m"] + _BEYOND * table.bounds("error").desired
    weave = Slalom(path.pos_ned_m, path.psi_rad, table["apart_m"], aside, _TURNS, run_in)
    path.along(weave, speed, 1.0, "fixed")


def _lateral_reposition(path: FlightPath, table: Manoeuvre) -> None:
    """To the right."""
    _limit(path, _aim_mps(table))
    path.go_to(_goal(path, path.psi_rad + 0.5 * math.pi, table["course_m"]))


def _depart_abort(path: FlightPath, table: Manoeuvre) -> None:
    """Along the nose."""
    _limit(path, _aim_mps(table))
    path.go_to(_goal(path, path.psi_rad, table["course_m"]))


# -------------------------------------------------------------------------------------------------
# The path of a scenario: from its rows to the trajectory that is flown.
# -------------------------------------------------------------------------------------------------

CLIMB, WAYPOINTS, ORBIT, FIGURE_EIGHT = "climb", "waypoints", "orbit", "figure_eight"
MANOEUVRE = "manoeuvre"
FIXED, ALONG, CENTRE = "fixed", "along", "centre"

PATH_ROWS: tuple[Parameter, ...] = (
    Parameter(
        "path.kind",
        "string",
        "What is flown: hover with the climb of climb.*, or from path.start_s on legs between way "
        "points, laps of a circle, or of a figure eight; or a manoeuvre that `heli score` scores",
        choices=(CLIMB, WAYPOINTS, ORBIT, FIGURE_EIGHT, MANOEUVRE),
    ),
    Parameter("path.start_s", "double", "Start of the path", "s", lower=0.0, upper=86400.0),
    Parameter(
        "path.speed_mps", "double", "Speed over ground of legs and laps", "m/s",
        lower=0.1, upper=20.0,
    ),
    Parameter("path.climb_mps", "double", "Vertical speed of legs", "m/s", lower=0.1, upper=5.0),
    Parameter(
        "path.acceleration_mps2", "double", "Largest acceleration: along a leg, across a bend",
        "m/s2", lower=0.05, upper=8.0,
    ),
    Parameter("path.jerk_mps3", "double", "Largest jerk along the way", "m/s3", lower=0.05,
              upper=50.0),
    Parameter("path.yaw_rate_degps", "double", "Largest rate of the heading", "deg/s", lower=1.0,
              upper=180.0),
    Parameter(
        "path.yaw_acceleration_degps2", "double", "Largest angular acceleration of the heading, "
        "reached in half a second", "deg/s2", lower=1.0, upper=720.0,
    ),
    Parameter(
        "path.heading",
        "string",
        "The nose: as at the start; in the direction of flight; in laps of a circle to its centre. "
        "Where it is elsewhere at first it turns on the spot",
        choices=(FIXED, ALONG, CENTRE),
    ),
    Parameter(
        "path.waypoints_ned_m", "double[]", "Way points, NED, each flown to straight and stood "
        "still at", "m", shape=(None, 3), upper=1e5,
    ),
    Parameter("path.stay_s", "double", "Stay at each way point; after a manoeuvre beyond what is "
        "scored", "s", lower=0.0, upper=3600.0),
    Parameter(
        "path.size_m", "double", "Diameter of the circle, or the figure eight from tip to tip", "m",
        lower=0.5, upper=1000.0,
    ),
    Parameter("path.laps", "double", "Laps", lower=0.01, upper=1000.0),
    *MTE_ROWS,
)  # fmt: skip
"""Rows of the `scenario` node."""


def path_of(start_ned_m: NDArray[np.float64], psi_rad: float, p: Mapping[str, Any]) -> Trajectory:
    """Trajectory of a path from a start (3,), NED, m, and a heading, rad.

    Raises
    ------
    ParameterError
        It cannot be flown within its limits; the sentence names the numbers.
    """
    kind, heading = p["path.kind"], p["path.heading"]
    if heading == CENTRE and kind != ORBIT:
        raise ParameterError(
            f"scenario: path.heading is {CENTRE}, path.kind {kind}; only an {ORBIT} has a centre"
        )
    try:
        limits = MotionLimits.from_parameters(p, "path")
        path = FlightPath(start_ned_m, psi_rad, limits).stay(p["path.start_s"])
        if kind == MANOEUVRE:
            return fly_manoeuvre(path, p)
        if kind == WAYPOINTS:
            for goal in np.reshape(p["path.waypoints_ned_m"], (-1, 3)):
                _leg(path, goal, heading).stay(p["path.stay_s"])
        elif kind == ORBIT:
            circle = Circle(start_ned_m, psi_rad, 0.5 * p["path.size_m"])
            path.along(circle, p["path.speed_mps"], p["path.laps"], heading)
        else:
            eight = Lemniscate(start_ned_m, psi_rad, p["path.size_m"])
            path.along(eight, p["path.speed_mps"], p["path.laps"], heading)
        return path.trajectory()
    except PathError as error:
        raise ParameterError(f"scenario: path: {error}") from error


def _leg(path: FlightPath, goal: NDArray[np.float64], heading: str) -> FlightPath:
    north, east = (goal - path.pos_ned_m)[:2]
    if heading == ALONG and np.hypot(north, east) > 0.0:
        path.turn_to(float(np.arctan2(east, north)))
    return path.go_to(goal)


# -------------------------------------------------------------------------------------------------
# Figures of a flight from the ground to the ground: how it left the skids and came back to them.
#
# The goals are ours (the paper begins in the air). When the skids touch is found from ground truth
# with the plant's own gear; what is measured on board stands in the modes.
# -------------------------------------------------------------------------------------------------

_BRIEF_TICKS = TICKS_PER_S
"""Shorter stretches without contact are hops."""


@dataclass(frozen=True)
class GroundMetric:
    """One figure, and the largest one that is a success."""

    key: str
    label: str
    unit: str
    goal: float


_TAKEOFF_SKID = GroundMetric("takeoff_skid", "skid before lift-off", "m", 0.3)
_SPEED = GroundMetric("touch_down_speed", "speed of the touch-down", "m/s", 0.5)
_LANDING_SKID = GroundMetric("landing_skid", "skid after the touch-down", "m", 0.3)
_TILT = GroundMetric("touch_down_tilt", "largest tilt from the touch-down on", "deg", 15.0)
_HEIGHT = GroundMetric("takeoff_height", "height after the climb, off what was asked", "m", 0.4)
GROUND_METRICS = (_TAKEOFF_SKID, _HEIGHT, _SPEED, _LANDING_SKID, _TILT)


@dataclass(frozen=True)
class GroundFigure:
    """A figure of one flight.

    Attributes
    ----------
    metric : GroundMetric
    value : float or None
        In the metric's unit; None if it did not come to that.
    """

    metric: GroundMetric
    value: float | None

    @property
    def inside(self) -> bool:
        """True if it came to that and the goal is met."""
        return self.value is not None and self.value <= self.metric.goal

    @property
    def cell(self) -> str:
        """The figure as a table says it."""
        return "not reached" if self.value is None else f"{self.value:.2f} {self.metric.unit}"

    def as_dict(self) -> dict[str, object]:
        """For result.json."""
        return {**asdict(self.metric), "value": self.value, "inside": self.inside}


@dataclass(frozen=True)
class Gear:
    """What a scenario that begins on the ground is judged by: contact points, height asked, m."""

    ground: GroundParams
    height_m: float


def touching(record: FlightRecord, ground: GroundParams) -> NDArray[np.bool_]:
    """Mask (N,) of the samples of ground truth at which a skid touches."""
    touches, x = np.zeros(len(record), bool), np.zeros(PLANT.size)
    for i in range(len(record)):
        x[PLANT.pos], x[PLANT.quat] = record.truth_pos_ned_m[i], record.truth_q_nb[i]
        x[PLANT.vel] = quat_to_R_nb(record.truth_q_nb[i]).T @ record.truth_vel_ned_mps[i]
        touches[i] = ground_contact(x, ground)[1]
    return touches


def ground_figures(record: FlightRecord, gear: Gear) -> list[GroundFigure]:
    """Figures of a flight's longest stretch in the air and of what is before and behind it.

    Parameters
    ----------
    record : FlightRecord
        With ground truth.
    gear : Gear
    """
    flown = _longest(~touching(record, gear.ground))
    values: dict[GroundMetric, float] = {}
    if flown is not None:
        lift, touch = flown
        pos, tilt = record.truth_pos_ned_m, np.degrees(np.abs(euler_angles(record.truth_q_nb)))
        values[_TAKEOFF_SKID] = _farthest(pos[: lift + 1])
        climb = _climb(record, gear)
        if climb is not None:
            values[_HEIGHT] = abs(climb[0] - climb[1])
        if touch < len(record):
            values[_SPEED] = float(record.truth_vel_ned_mps[touch - 1, 2])
            values[_LANDING_SKID] = _farthest(pos[touch:])
            values[_TILT] = float(tilt[touch:, :2].max())
    metrics = [m for m in GROUND_METRICS if m != _HEIGHT or not _begins_by_hand(record)]
    return [GroundFigure(metric, values.get(metric)) for metric in metrics]


def _begins_by_hand(record: FlightRecord) -> bool:
    """A pilot has taken off, so no height was asked of a take-off."""
    if record.mode is None:
        return False
    began = record.mode[record.mode != "standing"]
    return bool(began.size and began[0] == "manual")


def _climb(record: FlightRecord, gear: Gear) -> tuple[float, float] | None:
    """Height at which the climb was done, above the start, by the state estimate, and asked, m.

    Asked is what the take-off had of its own, else the gear's.
    """
    if record.mode is None:
        return None
    # Only a hover is open to a goal; a pilot who asks for one without end ends it within a tick.
    done = np.isin(record.mode, ("hover", "trajectory"))
    hovers = np.flatnonzero(done & np.isfinite(record.nav_pos_ned_m[:, 2]))
    began = np.flatnonzero((record.mode == "takeoff") & np.isfinite(record.nav_pos_ned_m[:, 2]))
    if not hovers.size or not began.size:
        return None
    down = record.nav_pos_ned_m[:, 2]
    own = record.takeoff_height_m
    told = own is not None and np.isfinite(own[hovers[0]])
    asked = float(own[hovers[0]]) if own is not None and told else gear.height_m
    return float(down[began[0]] - down[hovers[0]]), asked


def _farthest(pos_ned_m: NDArray[np.float64]) -> float:
    """Largest horizontal distance of positions (N, 3) from the first one, m."""
    return float(np.hypot(*(pos_ned_m - pos_ned_m[0])[:, :2].T).max())


def _longest(mask: NDArray[np.bool_]) -> tuple[int, int] | None:
    """First and behind-last index of the longest run of True; None if it is brief."""
    edges = np.flatnonzero(np.diff(np.r_[False, mask, False].astype(np.int8)))
    runs = edges.reshape(-1, 2)
    if not runs.size:
        return None
    first, behind = runs[int(np.argmax(runs[:, 1] - runs[:, 0]))]
    return (int(first), int(behind)) if behind - first > _BRIEF_TICKS else None


# -------------------------------------------------------------------------------------------------
# Scenario.
# -------------------------------------------------------------------------------------------------

NODE_NAME = "scenario"
BOUNDS = "score.bounds."
PAPERS_TESTS = ("hover", "attitude")
"""Packaged scenarios that the paper flew: its figures bound these alone."""
MISSION = ("kind", "path.kind", "climb.start_s", "climb.end_s", "climb.speed_mps")
"""What makes one of them another mission, where it is changed."""

TABLE: tuple[Parameter, ...] = (
    Parameter("kind", "string", "Which metrics are scored", choices=("hover", "attitude", "path")),
    Parameter("duration_s", "double", "Length of the flight", "s", lower=0.04, upper=86400.0),
    Parameter(
        "start_pos_ned_m", "double[]", "Where the flight starts, NED", "m", shape=(3,), upper=1e5
    ),
    Parameter(
        "heading_deg", "double", "Heading to hold, 0 is north", "deg", lower=-180.0, upper=180.0
    ),
    Parameter("climb.start_s", "double", "When the climb is commanded", "s", lower=0.0),
    Parameter(
        "climb.end_s",
        "double",
        "When the end of the climb is commanded; as start: no climb",
        "s",
        lower=0.0,
    ),
    Parameter("climb.speed_mps", "double", "Climb speed", "m/s", lower=-3.0, upper=5.0),
    Parameter(
        "climb.acceleration_mps2",
        "double",
        "Largest acceleration of the climb",
        "m/s2",
        lower=0.05,
        upper=8.0,
    ),
    Parameter(
        "climb.jerk_mps3", "double", "Largest jerk of the climb", "m/s3", lower=0.05, upper=50.0
    ),
    *PATH_ROWS,
    Parameter(
        "score.windows_s",
        "double[]",
        "Pairs of flight times that are scored; a negative begin counts from the end of the "
        "flight, a negative end means the end",
        "s",
        shape=(None, 2),
    ),
    *(
        Parameter(
            f"{BOUNDS}{bound_key(metric)}",
            "double",
            f"Largest {metric.label} that is a success; negative: the paper's figure in the "
            "paper's test, the goal of a path, else none",
            metric.unit,
            lower=-1.0,
            upper=1e6,
        )
        for metric in BY_KEY.values()
    ),
)


@dataclass(frozen=True)
class Scenario:
    """A flight to be flown and scored.

    Attributes
    ----------
    kind : str
        "hover", "attitude" or "path": which metrics are scored.
    n_ticks : int
        Length in ticks of 10 ms.
    reference : Trajectory
        For the outer loop, times from the start of the flight.
    windows_s : (N, 2) ndarray
        Scored stretches, s of flight time.
    gear : Gear, optional
        What a flight that begins on the ground is judged by.
    begin_s : float
        Flight time at which it begins; 0 of every flight whose order is known.
    metrics : tuple of PaperMetric
        What is scored, with what bounds it; empty stands for the kind's own.
    """

    kind: str
    n_ticks: int
    reference: Trajectory
    windows_s: np.ndarray
    gear: Gear | None = None
    begin_s: float = 0.0
    metrics: tuple[PaperMetric, ...] = ()

    def __post_init__(self) -> None:
        if not self.metrics:
            object.__setattr__(self, "metrics", METRICS[self.kind])

    @classmethod
    def from_parameters(cls, p: Mapping[str, Any], is_papers_test: bool = True) -> "Scenario":
        """From checked parameters (`TABLE`); ParameterError if the path cannot be flown."""
        n_ticks = ticks_in(p["duration_s"])
        windows = np.array(p["score.windows_s"], float).reshape(-1, 2)
        end_s, begin_s = seconds(n_ticks), windows[:, 0]
        windows[windows[:, 1] < 0.0, 1] = end_s
        windows[:, 0] = np.where(begin_s < 0.0, np.maximum(0.0, end_s + begin_s), begin_s)
        start, heading = np.asarray(p["start_pos_ned_m"], float), np.radians(p["heading_deg"])
        if p["path.kind"] != CLIMB:
            reference = path_of(start, heading, p)
            _check_length(reference, n_ticks)
        elif p["climb.end_s"] > p["climb.start_s"] and p["climb.speed_mps"] != 0.0:
            reference = climb_of(start, heading, p)
        else:
            reference = Trajectory.hover(start, heading)
        own = {key.removeprefix(BOUNDS): p[key] for key in p if key.startswith(BOUNDS)}
        metrics = bounded(p["kind"], own, is_papers_test)
        return cls(p["kind"], n_ticks, reference, windows, metrics=metrics)

    def scored(self, time_s: np.ndarray) -> np.ndarray:
        """Mask (N,) of the samples at time_s (N,) in a scored stretch, its end excluded."""
        return in_windows(time_s, self.windows_s)

    def cut_to(self, begin_s: float, end_s: float) -> "Scenario":
        """The part of it that is between two flight times, s; also longer than it was."""
        windows = np.clip(self.windows_s, begin_s, end_s)
        windows = windows[windows[:, 1] > windows[:, 0]]
        return replace(self, begin_s=begin_s, n_ticks=ticks_in(end_s), windows_s=windows)


def climb_of(start_ned_m: NDArray[np.float64], psi_rad: float, p: Mapping[str, Any]) -> Trajectory:
    """Hover, climb, hover: nothing of it moves before the climb is commanded.

    Its height is its speed times the time between the commands that begin and end it. Speed,
    acceleration and jerk are limited (`heli_outer_pd.guidance.transfer`), so it stands at the new
    height `speed / acceleration + acceleration / jerk` after the second one.
    """
    speed, limits = p["climb.speed_mps"], MotionLimits.from_parameters(p, "path")
    limits = replace(
        limits,
        climb_mps=abs(speed),
        acceleration_mps2=p["climb.acceleration_mps2"],
        jerk_mps3=p["climb.jerk_mps3"],
    )
    top = start_ned_m - [0.0, 0.0, speed * (p["climb.end_s"] - p["climb.start_s"])]
    path = FlightPath(start_ned_m, psi_rad, limits).stay(p["climb.start_s"])
    return path.go_to(top).trajectory()


def _check_length(reference: Trajectory, n_ticks: int) -> None:
    """Refuse a flight that ends on the way."""
    end_ticks = math.ceil(reference.times_ns[-1] / TICK_NS)
    if end_ticks > n_ticks:
        raise ParameterError(
            f"scenario: duration_s is {seconds(n_ticks):g}, but the path takes "
            f"{seconds(end_ticks):g} s; allowed: at least that, or a shorter path"
        )
