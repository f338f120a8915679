# SPDX-License-Identifier: Apache-2.0
"""What the paper measures a flight by: its errors and the largest ones it shows (section 4).

Scores, report and live view take both from here. The paper's numbers are from flight. A mission or
an aircraft of one's own has bounds of its own (`bounded`), or none.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np
from numpy.typing import NDArray

from heli_core.rotations import euler_angles
from heli_core.rows import REFERENCE, SETPOINT

# -------------------------------------------------------------------------------------------------
# Paper metrics.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]
_ROLL_PITCH = slice(SETPOINT.phi, SETPOINT.psi)


GOAL, OWN, NONE = "goal", "score.bounds", "none"
"""Where a bound is from that is not the paper's: our goal of a path, the user, nowhere."""


@dataclass(frozen=True)
class PaperMetric:
    """One error and its bound.

    Attributes
    ----------
    key, label, unit : str
    paper : float
        The largest magnitude that is a success: the paper's, unless `source` says else; infinite
        where nothing bounds it.
    source : str
        Figure of the paper, or `GOAL`, `OWN`, `NONE`.
    """

    key: str
    label: str
    unit: str
    paper: float
    source: str

    @property
    def bounded(self) -> bool:
        """Whether there is a bound."""
        return math.isfinite(self.paper)

    @property
    def bound_text(self) -> str:
        """The bound as a table says it: 0.4 m, or a dash."""
        return f"{self.paper:g} {self.unit}" if self.bounded else "-"

    @property
    def bound_name(self) -> str:
        """Whose bound it is, for a table's head: paper, goal, bound; a dash without one."""
        names = {GOAL: "goal", OWN: "your bound", NONE: "-"}
        return names.get(self.source, "paper")

    def as_dict(self) -> dict[str, object]:
        """For JSON, which has no infinity."""
        return {**asdict(self), "paper": self.paper if self.bounded else None}


PATH = "path"
"""The kind of flight that the paper has not."""

ATTITUDE_DEG: Mapping[str, tuple[float, str]] = {"hinf": (1.7, "Fig. 4"), "pid": (4.8, "Fig. 3")}
"""Largest roll or pitch, deg, that the paper shows under an attitude controller, and where."""

METRICS: Mapping[str, tuple[PaperMetric, ...]] = {
    "hover": (
        PaperMetric("v_z", "vertical speed - reference", "m/s", 0.18, "Fig. 5"),
        PaperMetric("v_x", "forward speed", "m/s", 0.30, "Fig. 6"),
        PaperMetric("v_y", "lateral speed", "m/s", 0.30, "Fig. 7"),
        PaperMetric("altitude", "altitude error", "m", 0.40, "Fig. 8"),
        PaperMetric("lateral", "lateral position error", "m", 1.02, "Fig. 9"),
        PaperMetric("longitudinal", "longitudinal position error", "m", 0.65, "Fig. 9"),
    ),
    "attitude": (
        PaperMetric("roll", "roll error", "deg", *ATTITUDE_DEG["hinf"]),
        PaperMetric("pitch", "pitch error", "deg", *ATTITUDE_DEG["hinf"]),
    ),
    PATH: (
        PaperMetric("position", "distance from the path's point", "m", 0.50, GOAL),
        PaperMetric("heading", "heading error", "deg", 5.0, GOAL),
    ),
}
"""Metrics per kind of flight; each attitude controller is judged by the paper's best. It flies no
paths, so their figures are goals."""
POSITIONS = ("altitude", "lateral", "longitudinal")
"""The metrics of hover that a receiver's drift shifts."""
SETTLED_S = 5.0
"""When the navigation's own start is over: its position's error about then is the receiver's drift
at engagement, freed of the first fixes' noise."""
ABOUT_S = 0.5
"""The error is the mean over so long before and after."""
BY_KEY: Mapping[str, PaperMetric] = {
    metric.key: metric for row in METRICS.values() for metric in row
}
_UNIT_ENDINGS = {"m": "m", "m/s": "mps", "deg": "deg"}


def bound_key(metric: PaperMetric) -> str:
    """Name of a metric's bound among parameters, with its unit: altitude_m, or v_z_mps."""
    return f"{metric.key}_{_UNIT_ENDINGS[metric.unit]}"


def bounded(kind: str, own: Mapping[str, float], is_papers_test: bool) -> tuple[PaperMetric, ...]:
    """The metrics of a kind of flight with what bounds them.

    Parameters
    ----------
    kind : str
        Key of `METRICS`.
    own : mapping
        Bounds of the user by `bound_key`; one below 0 is none.
    is_papers_test : bool
        Whether the paper flew this; its figures bound nothing else.

    Returns
    -------
    tuple of PaperMetric
    """
    return tuple(_bounded(metric, own.get(bound_key(metric), -1.0), is_papers_test)
                 for metric in METRICS[kind])  # fmt: skip


def _bounded(metric: PaperMetric, own: float, is_papers_test: bool) -> PaperMetric:
    if own >= 0.0:
        return replace(metric, paper=own, source=OWN)
    if is_papers_test or metric.source == GOAL:
        return metric
    return replace(metric, paper=math.inf, source=NONE)


def heading_frame(vector_ned: Array, psi: Array) -> Array:
    """Rotate (N, 3) NED vectors into the frame of the headings psi (N,): forward, right, down."""
    c, s = np.cos(psi), np.sin(psi)
    forward = c * vector_ned[:, 0] + s * vector_ned[:, 1]
    right = -s * vector_ned[:, 0] + c * vector_ned[:, 1]
    return np.column_stack((forward, right, vector_ned[:, 2]))


def hover_errors(pos_ned_m: Array, vel_ned_mps: Array, reference: Array) -> dict[str, Array]:
    """Errors (N,) by key of the metrics of hover: in the frame of the reference's heading.

    Parameters
    ----------
    pos_ned_m, vel_ned_mps : (N, 3) ndarray
    reference : (N, 7) ndarray
        As `rows.REFERENCE`.

    Returns
    -------
    dict
        Position (m) and velocity (m/s) minus reference: forward, right, **down**.
    """
    psi = reference[:, REFERENCE.psi]
    pos = heading_frame(pos_ned_m - reference[:, REFERENCE.pos], psi)
    vel = heading_frame(vel_ned_mps - reference[:, REFERENCE.vel], psi)
    return {
        "v_z": vel[:, 2],
        "v_x": vel[:, 0],
        "v_y": vel[:, 1],
        "altitude": pos[:, 2],
        "lateral": pos[:, 1],
        "longitudinal": pos[:, 0],
    }


def drift_at_engagement(
    time_s: Array, nav_pos_ned_m: Array, truth_pos_ned_m: Array
) -> Array | None:
    """What the navigation's position (3,), NED, is off by once it has settled, m.

    Parameters
    ----------
    time_s : (N,) ndarray
        Flight time.
    nav_pos_ned_m, truth_pos_ned_m : (N, 3) ndarray

    Returns
    -------
    (3,) ndarray or None
        None if no sample is about `SETTLED_S`, or one of these is not finite.
    """
    error = (nav_pos_ned_m - truth_pos_ned_m)[np.abs(time_s - SETTLED_S) < ABOUT_S]
    return error.mean(axis=0) if error.size and np.isfinite(error).all() else None


def in_windows(time_s: Array, windows_s: Array) -> NDArray[np.bool_]:
    """Mask (N,) of the times (N,), s, in one of the windows (M, 2), s, its end excluded."""
    mask = np.zeros(time_s.shape, bool)
    for start, end in windows_s:
        mask |= (time_s >= start) & (time_s < end)
    return mask


def size(error: Array) -> tuple[float, float]:
    """Largest magnitude and rms of an error (N,), in its unit."""
    return float(np.abs(error).max()), float(np.sqrt(np.mean(error * error)))


def attitude_errors(q_nb: Array, setpoint: Array) -> dict[str, Array]:
    """Errors (N,), deg, by key of the metrics of the attitude test.

    Parameters
    ----------
    q_nb : (N, 4) ndarray
        Body -> NED.
    setpoint : (N, >= 2) ndarray
        Commanded phi, theta, rad.
    """
    error = np.degrees(euler_angles(q_nb)[:, _ROLL_PITCH] - setpoint[:, _ROLL_PITCH])
    return {"roll": error[:, 0], "pitch": error[:, 1]}


def path_errors(pos_ned_m: Array, q_nb: Array, reference: Array) -> dict[str, Array]:
    """Errors (N,) by key of the metrics of a path, which moves with time.

    Parameters
    ----------
    pos_ned_m : (N, 3) ndarray
    q_nb : (N, 4) ndarray
        Body -> NED.
    reference : (N, 7) ndarray
        As `rows.REFERENCE`.

    Returns
    -------
    dict
        Distance, m, and heading minus reference, deg, wrapped.
    """
    away = np.linalg.norm(pos_ned_m - reference[:, REFERENCE.pos], axis=1)
    turned = euler_angles(q_nb)[:, SETPOINT.psi] - reference[:, REFERENCE.psi]
    return {"position": away, "heading": np.degrees(np.angle(np.exp(1j * turned)))}


# -------------------------------------------------------------------------------------------------
# Figures of a flight's climb: overshoot, time to the new height, lag behind the command.
#
# The paper climbs at 2.5 m/s between two hovers and gives no figure for it, so none of these has a
# bound. They are taken from the height beside the reference as commanded.
# -------------------------------------------------------------------------------------------------

OVERSHOOT_S = 10.0
"""How long after the reference's arrival an overshoot is looked for; later it is a gust's work."""


@dataclass(frozen=True)
class ClimbMetric:
    """One figure of a climb."""

    key: str
    label: str
    unit: str


_OVERSHOOT = ClimbMetric("climb_overshoot", "overshoot", "m")
_TIME = ClimbMetric("climb_time", "time to the new height", "s")
_LAG = ClimbMetric("climb_lag", "lag at half the climb", "s")
CLIMB_METRICS = (_OVERSHOOT, _TIME, _LAG)


@dataclass(frozen=True)
class ClimbFigure:
    """A figure of one flight's climb.

    Attributes
    ----------
    metric : ClimbMetric
    source : str
        What it is measured from.
    value : float or None
        In the metric's unit; None if the height was not reached.
    """

    metric: ClimbMetric
    source: str
    value: float | None

    def as_dict(self) -> dict[str, object]:
        """For result.json."""
        return {**asdict(self.metric), "measured_from": self.source, "value": self.value}


@dataclass(frozen=True)
class Climb:
    """A commanded change of height; a descent is one, too.

    Attributes
    ----------
    start, arrival : int
        Rows at which the reference leaves the old height and stands at the new one.
    old_m, new_m : float
        Heights, m, up.
    """

    start: int
    arrival: int
    old_m: float
    new_m: float

    @property
    def trajectory(self) -> float:
        """1.0 upwards, -1.0 downwards."""
        return float(np.sign(self.new_m - self.old_m))

    def duration_s(self, time_s: Array) -> float:
        """How long the reference takes, s."""
        return float(time_s[self.arrival] - time_s[self.start])


def commanded_climb(reference: Array) -> Climb | None:
    """The first commanded climb that ends within the record; None without one.

    Parameters
    ----------
    reference : (N, 7) ndarray
        As commanded, `rows.REFERENCE`.
    """
    speed = np.nan_to_num(reference[:, REFERENCE.down_vel])
    edges = np.flatnonzero(np.diff(speed != 0.0)) + 1
    if speed.size and speed[0] != 0.0:
        edges = np.r_[0, edges]
    if edges.size < 2:
        return None
    start, arrival = int(edges[0]), int(edges[1])
    old_m, new_m = (-float(reference[i, REFERENCE.pos][2]) for i in (start, arrival))
    return Climb(start, arrival, old_m, new_m) if new_m != old_m else None


def climb_figures(
    time_s: Array, height_m: Array, reference: Array, source: str
) -> list[ClimbFigure]:
    """Figures of the first climb, in the order of `CLIMB_METRICS`.

    Parameters
    ----------
    time_s : (N,) ndarray
        Flight time.
    height_m : (N,) ndarray
        Up, from the same ground as the reference.
    reference : (N, 7) ndarray
        As commanded.
    source : str
        What the height is of.

    Returns
    -------
    list of ClimbFigure
        - overshoot, m: largest height beyond the new one until `OVERSHOOT_S` after the reference
          has arrived;
        - time to the new height, s: from the start of the commanded climb until the height is first
          within the paper's altitude figure of the new one;
        - lag, s: how much later than the reference the aircraft passes half of the climb.

        Empty without a climb that ends within the record, or without heights during it.
    """
    climb = commanded_climb(reference)
    if climb is None or not np.isfinite(height_m[climb.start : climb.arrival]).all():
        return []
    beyond = climb.trajectory * (height_m - climb.new_m)
    near = climb.trajectory * (height_m - 0.5 * (climb.old_m + climb.new_m)) >= 0.0
    asked = -reference[:, REFERENCE.pos][:, 2]
    asked_near = climb.trajectory * (asked - 0.5 * (climb.old_m + climb.new_m)) >= 0.0
    until = time_s <= time_s[climb.arrival] + OVERSHOOT_S
    until[: climb.start] = False
    reached = _first(np.abs(beyond) <= BY_KEY["altitude"].paper, climb.start)
    passed, asked_at = _first(near, climb.start), _first(asked_near, climb.start)
    lag_s = None
    if passed is not None and asked_at is not None:
        lag_s = float(time_s[passed] - time_s[asked_at])
    return [
        ClimbFigure(_OVERSHOOT, source, float(max(0.0, np.nanmax(beyond[until])))),
        ClimbFigure(
            _TIME, source, None if reached is None else float(time_s[reached] - time_s[climb.start])
        ),
        ClimbFigure(_LAG, source, lag_s),
    ]


def _first(mask: NDArray[np.bool_], start: int) -> int | None:
    """First row from start on that is set."""
    places = np.flatnonzero(mask[start:])
    return int(places[0]) + start if places.size else None
