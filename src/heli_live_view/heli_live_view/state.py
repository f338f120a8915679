# SPDX-License-Identifier: Apache-2.0
"""What a browser is shown 30 times a second, put together from the newest messages. No ROS.

World vectors on the page are ENU, body vectors FLU, as on the topics; attitudes are given as a
quaternion and as the paper's Euler angles (NED/FRD). What has not come or is stale is None.
"""

import json
import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from heli_core.faults import forms
from heli_core.metrics import (
    ABOUT_S,
    BY_KEY,
    OVERSHOOT_S,
    POSITIONS,
    SETTLED_S,
    climb_figures,
    drift_at_engagement,
    hover_errors,
    in_windows,
    size,
)
from heli_core.rotations import euler_from_quat, quat_to_R_nb
from heli_core.rows import NAV, PLANT, REFERENCE, ROTOR
from heli_core.ticks import NS_PER_S, TICK_NS, TICKS_PER_S, seconds
from heli_core.trajectory import Trajectory
from heli_live_view.access import VIEW_ONLY, BrowserCommand
from heli_live_view.commands import listed
from heli_live_view.parameters import BOUNDS, COMMAND_LIMITS
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import NodeState, offset_of, state_of
from heli_msgs_bridge.frames import frd_to_flu, ned_to_enu, quat_ned_frd_to_enu_flu

# -------------------------------------------------------------------------------------------------
# Aircraft and reference as the page gets them: ENU and FLU, with the paper's errors. No ROS.
# -------------------------------------------------------------------------------------------------

Array = NDArray[np.float64]


def plain(values: Iterable[float], digits: int = 4) -> list[float]:
    """Finite values as short floats for JSON, without a negative zero."""
    return [round(float(v), digits) + 0.0 for v in values]


def bounds(parameters: Mapping[str, Any]) -> dict[str, float]:
    """Bounds for the page by name: the parameter's, or the paper's where that is negative."""
    parameter_bounds = {name: parameters[f"bounds.{name}"] for name in BOUNDS}
    return {
        name: value if value >= 0.0 else BY_KEY[BOUNDS[name]].paper
        for name, value in parameter_bounds.items()
    }


def error_row(pos_ned_m: Array, vel_ned_mps: Array, reference: Array) -> dict[str, float]:
    """The paper's errors of a vehicle (3,), (3,) from its reference (7,), by name of the bound.

    In the frame of the reference's heading: forward, right, and **up**, as people look at it.
    """
    errors = hover_errors(pos_ned_m[None], vel_ned_mps[None], reference[None])
    up = {"altitude": -1.0, "v_z": -1.0}
    return {
        name: plain(up.get(key, 1.0) * errors[key])[0]
        for name, key in BOUNDS.items()
        if key in errors
    }


def body_row(
    pos_ned_m: Array,
    vel_ned_mps: Array,
    q_nb: Array,
    rate_body_radps: Array,
    reference: Array | None = None,
) -> dict[str, Any]:
    """A vehicle for the page.

    Parameters
    ----------
    pos_ned_m, vel_ned_mps : (3,) array
    q_nb : (4,) array
        FRD -> NED, w x y z.
    rate_body_radps : (3,) array
        FRD.
    reference : (7,) array, optional
        Where it should be now.

    Returns
    -------
    dict
        p, v_enu (ENU), q (x, y, z, w; FLU -> ENU), v_body (forward, left, up), euler_deg
        (phi, theta, psi) and rates_dps (p, q, r) in NED/FRD; error as of `error_row`, None
        without a reference.
    """
    p, v_enu, v_flu, q = np.empty(3), np.empty(3), np.empty(3), np.empty(4)
    ned_to_enu(pos_ned_m, p)
    ned_to_enu(vel_ned_mps, v_enu)
    frd_to_flu(quat_to_R_nb(q_nb).T @ vel_ned_mps, v_flu)
    quat_ned_frd_to_enu_flu(q_nb, q)
    return {
        "p": plain(p),
        "q": plain(q, 6),
        "v_body": plain(v_flu),
        "v_enu": plain(v_enu),
        "euler_deg": plain(np.degrees(euler_from_quat(q_nb)), 3),
        "rates_dps": plain(np.degrees(rate_body_radps), 3),
        "error": None if reference is None else error_row(pos_ned_m, vel_ned_mps, reference),
    }


def reference_row(reference: Array) -> dict[str, Any]:
    """Where the aircraft should be (7,), for the page: p, v (ENU), yaw_deg clockwise from north."""
    return {
        "p": plain(enu(reference[REFERENCE.pos])),
        "v": plain(enu(reference[REFERENCE.vel])),
        "yaw_deg": round(math.degrees(reference[REFERENCE.psi]), 3),
    }


def enu(v_ned: Array) -> Array:
    """A NED vector (3,) in ENU."""
    v_enu = np.empty(3)
    ned_to_enu(v_ned, v_enu)
    return v_enu


# -------------------------------------------------------------------------------------------------
# The flight's climb as the live page gives it, by the function that makes the report's. No ROS.
# -------------------------------------------------------------------------------------------------

# A height that is not reached so long after the reference's arrival is not waited for any longer.
_LONGEST_S = 60.0
Figures = dict[str, float | None]


@dataclass
class _Kept:
    """Samples of one record from the climb's start on, batch by batch."""

    time_s: list[Array] = field(default_factory=list)
    height_m: list[Array] = field(default_factory=list)
    reference: list[Array] = field(default_factory=list)
    over: bool = False


class RunningClimb:
    """Figures of the first commanded climb, per record, once the reference has arrived."""

    def __init__(self) -> None:
        self._kept: dict[str, _Kept] = {}
        self._figures: dict[str, Figures] = {}

    def hold(self, record: str, time_s: Array, height_m: Array, reference: Array) -> None:
        """Samples (N,) of a record, times rising, with the reference (N, 7) at each."""
        kept = self._kept.setdefault(record, _Kept())
        if kept.over:
            return
        moving = np.flatnonzero(reference[:, REFERENCE.down_vel])
        first = 0 if kept.time_s else (int(moving[0]) if moving.size else time_s.size)
        if first == time_s.size:
            return
        kept.time_s.append(time_s[first:])
        kept.height_m.append(height_m[first:])
        kept.reference.append(reference[first:])
        if moving.size and moving[-1] == time_s.size - 1:
            return
        self._measure(record, kept)

    def _measure(self, record: str, kept: _Kept) -> None:
        time_s, reference = np.concatenate(kept.time_s), np.concatenate(kept.reference)
        figures = climb_figures(time_s, np.concatenate(kept.height_m), reference, record)
        self._figures[record] = {
            figure.metric.key: None if figure.value is None else round(figure.value, 4)
            for figure in figures
        }
        still = np.flatnonzero(reference[:, REFERENCE.down_vel] == 0.0)
        since_s = time_s[-1] - time_s[still[0]]
        known = None not in self._figures[record].values()
        if since_s > OVERSHOOT_S and (known or since_s > _LONGEST_S):
            kept.over = True
            kept.time_s, kept.height_m, kept.reference = [], [], []

    def row(self) -> dict[str, Figures]:
        """Per record the figures by key; a value that was not reached is None."""
        return self._figures


# -------------------------------------------------------------------------------------------------
# The receiver's drift at engagement, by the function that gives the report's. No ROS.
# -------------------------------------------------------------------------------------------------

_FIRST, _LAST = (round((SETTLED_S + side) * TICKS_PER_S) for side in (-ABOUT_S, ABOUT_S))


class RunningDrift:
    """What the navigation's position is off by once it has settled.

    Attributes
    ----------
    ned_m : (3,) array or None
        None before, and for good if what is needed was missed.
    """

    def __init__(self) -> None:
        self._pos: dict[str, dict[int, Array]] = {"nav": {}, "truth": {}}
        self._over: set[str] = set()
        self.ned_m: Array | None = None

    def add(self, record: str, tick: int, pos_ned_m: Array) -> None:
        """A sample of a record, "nav" or "truth": position (3,)."""
        if record in self._over:
            return
        if tick <= _LAST:
            self._pos[record][tick] = pos_ned_m
            return
        self._over.add(record)
        if self._over == self._pos.keys():
            self._measure()

    def _measure(self) -> None:
        nav, truth = self._pos["nav"], self._pos["truth"]
        ticks = sorted(nav.keys() & truth.keys())
        if ticks and ticks[0] <= _FIRST:
            pos = (np.array([record[tick] for tick in ticks]) for record in (nav, truth))
            self.ned_m = drift_at_engagement(seconds(np.array(ticks)), *pos)
        nav.clear()
        truth.clear()


# -------------------------------------------------------------------------------------------------
# Largest errors of the flight so far, beside the paper's: every sample counts. No ROS.
#
# The same functions give the figures of result.json and report (`heli_flight.scoring`): errors
# from the reference as commanded, over the whole flight and over the scenario's windows; of
# positions
# also those of ground truth less the receiver's drift at engagement.
# -------------------------------------------------------------------------------------------------

WHOLE, WINDOWS = "whole", "windows"
LESS_DRIFT = "truth_less_drift"
# Samples that wait for the outer loop to say from where its reference counts: half a minute.
_MOST_WAITING = 3000


class RunningMaxima:
    """Largest magnitudes by stretch, record and metric.

    Parameters
    ----------
    start_ns : int
        Stamp of flight time 0.
    windows_s : sequence of float
        Pairs of flight times that are scored; none: unknown.
    """

    def __init__(self, start_ns: int, windows_s: Sequence[float]) -> None:
        self._start_ns = start_ns
        self._windows_s = np.asarray(windows_s, float).reshape(-1, 2)
        self._waiting: dict[str, deque[tuple[int, Array, Array]]] = {}
        self._maxima: dict[str, dict[str, dict[str, float]]] = {WHOLE: {}, WINDOWS: {}}
        self._since_s: float | None = None
        self._climb, self._drift = RunningClimb(), RunningDrift()

    def add(self, record: str, stamp_ns: int, pos_ned_m: Array, vel_ned_mps: Array) -> None:
        """A sample of a record, "nav" or "truth": position and velocity (3,)."""
        sample = stamp_ns, pos_ned_m.copy(), vel_ned_mps.copy()
        for name in (record, LESS_DRIFT) if record == "truth" else (record,):
            self._waiting.setdefault(name, deque(maxlen=_MOST_WAITING)).append(sample)
        self._drift.add(record, (stamp_ns - self._start_ns) // TICK_NS, sample[1])

    def count(self, trajectory: Trajectory, offset_ned_m: Sequence[float]) -> None:
        """Hold what has come against the reference, moved by an offset (3,), NED, m."""
        for record, samples in self._waiting.items():
            drift_ned_m = self._drift.ned_m if record == LESS_DRIFT else np.zeros(3)
            if drift_ned_m is None:
                continue
            known = [s for s in samples if np.isfinite(s[1]).all() and np.isfinite(s[2]).all()]
            samples.clear()
            if not known:
                continue
            reference = np.array([trajectory.at(stamp_ns) for stamp_ns, _, _ in known])
            reference[:, REFERENCE.pos] += np.asarray(offset_ned_m)
            pos, vel = (np.array([sample[i] for sample in known]) for i in (1, 2))
            pos += drift_ned_m
            ticks = (np.array([stamp_ns for stamp_ns, _, _ in known]) - self._start_ns) // TICK_NS
            errors = hover_errors(pos, vel, reference)
            if record == LESS_DRIFT:
                errors = {key: errors[key] for key in POSITIONS}
            self._hold(record, seconds(ticks), errors)
            self._climb.hold(record, seconds(ticks), -pos[:, 2], reference)

    def _hold(self, record: str, time_s: Array, errors: dict[str, Array]) -> None:
        if self._since_s is None:
            self._since_s = float(time_s[0])
        masks = {WHOLE: np.ones(time_s.shape, bool), WINDOWS: in_windows(time_s, self._windows_s)}
        for stretch, mask in masks.items():
            if not mask.any():
                continue
            maxima = self._maxima[stretch].setdefault(record, {})
            for name, key in BOUNDS.items():
                if key in errors:
                    largest, _ = size(errors[key][mask])
                    maxima[name] = max(largest, maxima.get(name, 0.0))

    def row(self) -> dict[str, object] | None:
        """For the page: per stretch and record the largest by name of the bound, the climb's
        figures per record, and from when on; None before.
        """
        if self._since_s is None:
            return None
        shown = {
            stretch: {
                record: {name: round(value, 4) for name, value in values.items()}
                for record, values in records.items()
            }
            for stretch, records in self._maxima.items()
        }
        return {**shown, "climb": self._climb.row(), "since_s": round(self._since_s, 2)}


# -------------------------------------------------------------------------------------------------
# Live state.
# -------------------------------------------------------------------------------------------------

GRAPH_NODES = ("plant", "observer", "inner_loop", "outer_loop")
SHOWN = (
    topics.TRUTH_ODOM, topics.ODOM, topics.ATTITUDE_SETPOINT, topics.ACTUATORS, topics.ROTOR_STATE,
    topics.TRUTH_ROTOR, topics.TRUTH_WIND,
)  # fmt: skip
"""Topics whose content the page shows; of the others only the arrival counts."""
COUNTED = (topics.TRUTH_ODOM, topics.ODOM)
"""Topics of which every message counts, for the largest errors."""
OWN_NAME = "live_view"
_RATE_WINDOW_S = 2.0
_GPS_LATE_S = 1.0
_WARN, _ERROR, _GONE = 1, 2, 3
_NO_TIME = -math.inf
_NOT_HELD = "attitude only: nothing holds position and altitude"


@dataclass
class NodeNews:
    """What a node last said in /diagnostics."""

    level: int = 0
    message: str = ""
    facts: Mapping[str, str] = field(default_factory=dict)


LOST, OVER, INTERRUPTED, SILENT = "lost", "over", "interrupted", "silent"
"""Kinds of an end: by the plant's word lost or flown to its end; stopped before; gone silent."""


@dataclass(frozen=True)
class FlightEnd:
    """How a flight ended.

    Attributes
    ----------
    kind : str
        LOST, OVER, INTERRUPTED or SILENT.
    text : str
        The cause, a sentence for people.
    """

    kind: str
    text: str

    def message(self) -> dict[str, str]:
        """As sent to a browser."""
        return {"kind": self.kind, "text": self.text}


@dataclass(frozen=True)
class TimelineEvent:
    """One line of the timeline: flight time s (None before the clock), level 0 to 2, who, what.

    `state` is that of the node which says it.
    """

    time_s: float | None
    level: int
    source: str
    text: str
    state: NodeState = NodeState.RUNNING

    def message(self) -> dict[str, Any]:
        """As sent to a browser."""
        t = None if self.time_s is None else round(self.time_s, 2)
        return {
            "type": "event", "t": t, "level": self.level, "source": self.source, "text": self.text
        }  # fmt: skip


class LiveState:
    """Collects newest values and makes state rows.

    Parameters
    ----------
    start_ns : int
        Stamp of flight time 0.
    stale_s : float
        Wall time after which a value that is not renewed is no longer shown.
    windows_s : sequence of float
        Pairs of flight times that are scored; none: unknown.
    autopilot : str
        Name of another autopilot that flies, whose modes are not known; empty: ours.
    """

    def __init__(
        self,
        start_ns: int,
        stale_s: float,
        windows_s: Sequence[float] = (),
        autopilot: str = "",
    ) -> None:
        self.start_ns, self.stale_s, self._windows_s = start_ns, stale_s, windows_s
        self._autopilot = autopilot
        self.reset()

    def reset(self) -> None:
        """Forget the flight."""
        self.now_ns = 0
        self.end: FlightEnd | None = None
        self.reference: Trajectory | None = None
        self.home_ned_m: Array | None = None
        self.nodes: dict[str, NodeNews] = {name: NodeNews() for name in GRAPH_NODES}
        self._present: set[str] = set()
        self._known: set[str] = set()
        self._values: dict[str, tuple[Array, float]] = {}
        self._arrived: dict[str, float] = {}
        self._fix_ns = 0
        self._pace: deque[tuple[float, int]] = deque()
        self._events: list[TimelineEvent] = []
        self._mode, self._mode_since_s = "idle", 0.0
        self._largest = RunningMaxima(self.start_ns, self._windows_s)

    # --- what comes in -----------------------------------------------------------------------

    @property
    def time_s(self) -> float | None:
        """Flight time, s; None before the clock has started."""
        return (self.now_ns - self.start_ns) * 1e-9 if self.now_ns else None

    def take_clock(self, stamp_ns: int, wall_s: float) -> bool:
        """Take the simulation time; True if it went back: another flight has begun."""
        restarted = stamp_ns < self.now_ns - NS_PER_S
        if restarted:
            reference = self.reference
            self.reset()
            if reference is not None:
                self.take_reference(reference)
        self.now_ns = max(stamp_ns, self.now_ns)
        pace = self._pace
        pace.append((wall_s, self.now_ns))
        while len(pace) > 2 and wall_s - pace[0][0] > _RATE_WINDOW_S:
            pace.popleft()
        return restarted

    def take(self, topic: str, array: Array, wall_s: float) -> None:
        """Take a decoded message (core's array, NED/FRD) of a topic in `SHOWN`."""
        self._values[topic] = (array.copy(), wall_s)
        self._arrived[topic] = wall_s

    def take_sample(self, topic: str, stamp_ns: int, array: Array) -> None:
        """Every message of a topic in `COUNTED`: none of them may be missed by a largest error."""
        if topic == topics.ODOM:
            self._largest.add("nav", stamp_ns, array[NAV.pos], array[NAV.vel])
        else:
            velocity = quat_to_R_nb(array[PLANT.quat]) @ array[PLANT.vel]
            self._largest.add("truth", stamp_ns, array[PLANT.pos], velocity)

    def take_arrival(self, topic: str, stamp_ns: int, wall_s: float) -> None:
        """A message of any topic has come; its content is not shown."""
        self._arrived[topic] = wall_s
        if topic == topics.GPS_FIX:
            self._fix_ns = max(self._fix_ns, stamp_ns)

    def forget(self, topic: str) -> None:
        """Its sender has been stopped: do not wait until it is stale."""
        self._arrived.pop(topic, None)
        self._values.pop(topic, None)

    def take_reference(self, reference: Trajectory) -> None:
        """Take a reference trajectory; the flight began where the first one does."""
        self.reference = reference
        if self.home_ned_m is None:
            self.home_ned_m = reference.points[0, REFERENCE.pos].copy()

    def take_status(self, name: str, level: int, message: str, facts: Mapping[str, str]) -> None:
        """Take a node's diagnostics; a change becomes an event."""
        news = self.nodes.setdefault(name, NodeNews())
        changed = (level, message) != (news.level, news.message)
        if changed and (level or name != OWN_NAME):
            self.tell(min(level, _ERROR), name, message, state_of(facts, message))
        news.level, news.message, news.facts = level, message, dict(facts)
        if name == "plant":
            over = facts.get("over") == "true"
            self.end = self._end_by_plant(level, message) if over else None

    def take_presence(self, names: Iterable[str], truth_is_sent: bool, wall_s: float) -> None:
        """Take the names of the nodes that are in the graph now; without the plant it is over.

        A plant that ends takes with it what it has sent and nobody has fetched, its last word too.
        A short flight may be over before its nodes' names have come: then nobody sends the truth
        any more (`truth_is_sent`), which somebody did while time went on.
        """
        self._present = set(names)
        self._known |= self._present
        left = "plant" not in self._present and ("plant" in self._known or not truth_is_sent)
        if left and self.now_ns and not self.end and not self.is_fresh(topics.CLOCK, wall_s):
            self.end = FlightEnd(SILENT, "The plant has left the graph without a word.")
            self.tell(_ERROR, "plant", self.end.text)

    def interrupt(self) -> None:
        """Whoever shows the flight has been asked to end; before the flight's end: interrupted."""
        if self.now_ns and not self.end:
            self.end = FlightEnd(INTERRUPTED, "The flight was stopped before its end.")
            self.tell(_WARN, OWN_NAME, self.end.text)

    def _end_by_plant(self, level: int, message: str) -> FlightEnd:
        """The end that the plant tells; a loss with what had been given up before."""
        if level < _ERROR:
            return FlightEnd(OVER, message)
        held_s = (self.time_s or 0.0) - self._mode_since_s
        if self._mode == "attitude":
            message += f" Nothing had held position and altitude for {held_s:.0f} s."
        return FlightEnd(LOST, message)

    def tell(
        self, level: int, source: str, text: str, state: NodeState = NodeState.RUNNING
    ) -> None:
        """Put a line on the timeline."""
        self._events.append(TimelineEvent(self.time_s, level, source, text, state))

    def take_events(self) -> list[TimelineEvent]:
        """Events since the last call."""
        events, self._events = self._events, []
        return events

    # --- what goes out -----------------------------------------------------------------------

    def is_fresh(self, topic: str, wall_s: float) -> bool:
        """True if the topic has come lately, or the flight is over and its end is being shown."""
        age_s = wall_s - self._arrived.get(topic, _NO_TIME)
        return age_s <= self.stale_s or (self.end is not None and topic in self._arrived)

    def value(self, topic: str, wall_s: float) -> Array | None:
        """Newest array of a shown topic; None if it has not come or is stale."""
        if topic not in self._values or not self.is_fresh(topic, wall_s):
            return None
        return self._values[topic][0]

    def mode(self, wall_s: float) -> str:
        """hover, attitude, idle or over, by who sends: an inactive node sends nothing.

        Of another autopilot that sends, its name.
        """
        if self.end:
            return "over"
        if not self.is_fresh(topics.ACTUATORS, wall_s):
            return "idle"
        if self._autopilot:
            return self._autopilot
        return "hover" if self.is_fresh(topics.ATTITUDE_SETPOINT, wall_s) else "attitude"

    def real_time_factor(self) -> float | None:
        """Simulated over wall time of the last two seconds."""
        if len(self._pace) < 2:
            return None
        (wall_0, ns_0), (wall_1, ns_1) = self._pace[0], self._pace[-1]
        return (ns_1 - ns_0) * 1e-9 / (wall_1 - wall_0) if wall_1 > wall_0 else None

    def row(self, wall_s: float) -> dict[str, Any]:
        """The state as a browser gets it (the keys are in the package's README)."""
        factor, time_s = self.real_time_factor(), self.time_s
        mode = self.mode(wall_s)
        if mode != self._mode:
            self.tell(_WARN if mode == "attitude" else 0, OWN_NAME, f"mode: {mode}")
            self._mode, self._mode_since_s = mode, time_s or 0.0
        nodes = self._nodes(wall_s)
        nav, reference = self.value(topics.ODOM, wall_s), self._reference_row()
        shown = None
        if nav is not None:
            shown = body_row(nav[NAV.pos], nav[NAV.vel], nav[NAV.quat], nav[NAV.rate], reference)
        return {
            "type": "state",
            "t": None if time_s is None else round(time_s, 3),
            "rtf": None if factor is None else round(factor, 3),
            "truth": self._truth(wall_s, reference),
            "nav": shown,
            "ref": None if reference is None else reference_row(reference),
            "setpoint_deg": self._shown(topics.ATTITUDE_SETPOINT, wall_s, np.degrees),
            "u": self._shown(topics.ACTUATORS, wall_s),
            "rotor": self._rotor(topics.ROTOR_STATE, wall_s),
            "rotor_truth": self._rotor(topics.TRUTH_ROTOR, wall_s),
            "wind_enu": self._shown(topics.TRUTH_WIND, wall_s, enu),
            "sigma_p": None if nav is None else plain(nav[NAV.sigma_pos][[1, 0, 2]]),
            "mode": mode,
            "end": self.end.message() if self.end else None,
            "nodes": nodes,
            "alarms": self._alarms(nodes, wall_s),
            "gps": {"age_s": round(self._fix_age_s(), 3)} if self._fix_ns else None,
            "largest": self._largest_row(),
            "faults": [] if self.end else listed(self.nodes["plant"].facts),
        }

    def _shown(self, topic: str, wall_s: float, convert: Any = None) -> list[float] | None:
        value = self.value(topic, wall_s)
        if value is None:
            return None
        return plain(value if convert is None else convert(value))

    def _truth(self, wall_s: float, reference: Array | None) -> dict[str, Any] | None:
        x = self.value(topics.TRUTH_ODOM, wall_s)
        if x is None:
            return None
        velocity = quat_to_R_nb(x[PLANT.quat]) @ x[PLANT.vel]
        return body_row(x[PLANT.pos], velocity, x[PLANT.quat], x[PLANT.rate], reference)

    def _rotor(self, topic: str, wall_s: float) -> dict[str, float] | None:
        value = self.value(topic, wall_s)
        if value is None:
            return None
        a_s, b_s = plain(np.degrees(value[ROTOR.flapping]))
        return {"a_s_deg": a_s, "b_s_deg": b_s, "d_int": plain(value[[ROTOR.d_int]], 5)[0]}

    def _reference_row(self) -> Array | None:
        if self.reference is None:
            return None
        row = self.reference.at(self.now_ns or self.reference.start_ns)
        row[REFERENCE.pos] += offset_of(self.nodes["outer_loop"].facts) or 0.0
        return row

    def _largest_row(self) -> dict[str, object] | None:
        """Largest errors so far; None until the outer loop has told from where it flies."""
        offset = offset_of(self.nodes["outer_loop"].facts)
        if self.reference is not None and offset is not None:
            self._largest.count(self.reference, offset)
        return self._largest.row()

    def _fix_age_s(self) -> float:
        return max(0.0, (self.now_ns - self._fix_ns) * 1e-9)

    def _nodes(self, wall_s: float) -> dict[str, dict[str, Any]]:
        shown = {}
        for name, news in self.nodes.items():
            sends = [t.name for t in topics.TABLE if name in t.source and t.every_ticks]
            level, message = news.level, news.message
            if self.end:
                state = "ended"
            elif any(self.is_fresh(topic, wall_s) for topic in sends):
                state = "active"
            elif name in self._present:
                state = "inactive" if sends else "active"
            elif name in self._known:
                state, level, message = "lost", _GONE, "is not in the graph any more"
            else:
                state = "absent"
            shown[name] = {"state": state, "level": level, "message": message}
        return shown

    def _alarms(self, nodes: Mapping[str, Mapping[str, Any]], wall_s: float) -> list[dict]:
        alarms = [
            {"level": min(node["level"], _ERROR), "source": name, "text": node["message"]}
            for name, node in nodes.items()
            if node["level"] >= _WARN
        ]
        flying = not self.end and self.is_fresh(topics.CLOCK, wall_s)
        if flying and self._fix_ns and self._fix_age_s() > _GPS_LATE_S:
            alarms.append({"level": _WARN, "source": "gps", "text": "no fix for more than 1 s"})
        if flying and self._mode == "attitude":
            alarms.append({"level": _WARN, "source": "mode", "text": _NOT_HELD})
        if flying and topics.ODOM in self._arrived and not self.is_fresh(topics.ODOM, wall_s):
            alarms.append({"level": _ERROR, "source": "observer", "text": "no navigation"})
        return alarms


# -------------------------------------------------------------------------------------------------
# Past states for browsers that join late: thinned, bounded, the whole flight. No ROS.
# -------------------------------------------------------------------------------------------------

MAX_ROWS = 1200
_FIRST_PERIOD_S = 0.1


class History:
    """State rows, ready as JSON texts, at most ten a second and at most `limit`.

    When it is full, every second row is dropped and the spacing doubles, so that it always covers
    the flight from its beginning.
    """

    def __init__(self, limit: int = MAX_ROWS) -> None:
        self._limit = limit
        self.clear()

    def clear(self) -> None:
        """Forget the flight."""
        self._period_s = _FIRST_PERIOD_S
        self._next_s = -float("inf")
        self.rows: list[str] = []

    def wants(self, time_s: float) -> bool:
        """True if a row of this flight time is to be kept."""
        return time_s >= self._next_s

    def add(self, time_s: float, row: str) -> None:
        """Keep a row (JSON text) of a flight time (s)."""
        if len(self.rows) >= self._limit:
            self.rows = self.rows[::2]
            self._period_s *= 2.0
        self.rows.append(row)
        self._next_s = time_s + self._period_s - 1e-6


# -------------------------------------------------------------------------------------------------
# What the browsers are told: greeting, the state, its past, events. No ROS.
# -------------------------------------------------------------------------------------------------

STATE_HZ = 30
"""States that a browser gets per second."""
_EVENTS_KEPT = 200


def compact(content: Any) -> str:
    """JSON without blanks; a number that is not finite is null."""
    try:
        return json.dumps(content, separators=(",", ":"), allow_nan=False)
    except ValueError:
        return json.dumps(_finite(content), separators=(",", ":"), allow_nan=False)


def _finite(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_finite(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def greeting(values: Mapping[str, Any], commands: bool) -> dict[str, Any]:
    """What a connection is told first of flight and aircraft, by the live view's parameters.

    Parameters
    ----------
    values : mapping
        Parameters of the node `live_view`.
    commands : bool
        Whether commands are admitted.
    """
    return {
        "type": "hello",
        "commands": commands,
        "flight": {
            "scenario": values["flight.scenario"],
            "seed": values["flight.seed"] if values["flight.seed"] >= 0 else None,
            "duration_s": values["flight.duration_s"] or None,
            "realtime": not values["lockstep"],
        },
        "aircraft": {
            "name": values["aircraft.name"],
            "rotor_radius_m": values["aircraft.rotor_radius_m"],
        },
        "bounds": bounds(values),
        "faults": forms(),
        "limits": {name.partition(".")[2]: values[name] for name in COMMAND_LIMITS},
        "foxglove_url": None,
        "state_hz": STATE_HZ,
    }


class TakesCommands(Protocol):
    """Who judges commands and carries them out."""

    obeyed: int

    def put(self, command: BrowserCommand) -> None:
        """Take a command, from any thread."""

    def poll(self) -> None:
        """Go on with what was taken."""


class Screen:
    """What the browsers are told: the state, its past, events; commands that come back.

    Parameters
    ----------
    values : mapping
        Parameters of the node.
    start_ns : int
        Message stamp of tick 0.
    commands : bool
        Whether commands are admitted.
    autopilot : str
        Name of another autopilot that flies; empty: ours.

    Attributes
    ----------
    live : LiveState
    foxglove_url : str or None
        Where Foxglove is served, once it is.
    commander : TakesCommands or None
        Who carries commands out, once there is one.
    """

    def __init__(
        self, values: Mapping[str, Any], start_ns: int, commands: bool, autopilot: str = ""
    ) -> None:
        self._values, self._commands = values, commands
        self._history, self._past_events = History(), list[dict[str, Any]]()
        windows_s = values["flight.windows_s"].ravel().tolist()
        self.live = LiveState(start_ns, values["stale_s"], windows_s, autopilot)
        self.foxglove_url: str | None = None
        self.commander: TakesCommands | None = None

    def hello(self) -> str:
        """First message of a connection; called by the page server's thread."""
        head = greeting(self._values, self._commands) | {
            "foxglove_url": self.foxglove_url,
            "after": self._values["flight.report"],
            "events": list(self._past_events),
        }
        return f'{compact(head)[:-1]},"history":[{",".join(list(self._history.rows))}]}}'

    def obey(self, command: BrowserCommand) -> None:
        """Called by the page server's thread, for commands of the token's owner only."""
        if self.commander is None:
            command.reply(False, VIEW_ONLY)
        else:
            self.commander.put(command)

    def row(self, wall_s: float) -> dict[str, Any]:
        """The present state, kept for those who come later."""
        row = self.live.row(wall_s)
        time_s = row["t"]
        if time_s is not None and self._history.wants(time_s):
            self._history.add(time_s, compact({**row, "nodes": {}, "alarms": [], "largest": None}))
        return row

    def events(self) -> list[dict[str, Any]]:
        """Messages of what has happened since the last call."""
        messages = [event.message() for event in self.live.take_events()]
        self._past_events += messages
        del self._past_events[:-_EVENTS_KEPT]
        return messages

    def begin_anew(self) -> None:
        """Another flight: forget the past one."""
        self._history.clear()
        self._past_events.clear()
