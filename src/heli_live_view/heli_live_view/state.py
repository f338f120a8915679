# SPDX-License-Identifier: Apache-2.0
"""What a browser is shown 30 times a second, put together from the newest messages. No ROS.

World vectors on the page are ENU, body vectors FLU, as on the topics; attitudes are given as a
quaternion and as the paper's Euler angles (NED/FRD). What has not come or is stale is None.
"""

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_live_view.faults import listed
from heli_live_view.largest import Largest
from heli_live_view.vehicle import body_row, enu, plain, reference_row
from heli_math.rotations import quat_to_R_nb
from heli_math.rows import NAV, PLANT, REFERENCE, ROTOR
from heli_math.ticks import NS_PER_S
from heli_math.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import offset_of

Array = NDArray[np.float64]
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
class End:
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
class Event:
    """One line of the timeline: flight time s (None before the clock), level 0 to 2, who, what."""

    time_s: float | None
    level: int
    source: str
    text: str

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
    """

    def __init__(self, start_ns: int, stale_s: float, windows_s: Sequence[float] = ()) -> None:
        self.start_ns, self.stale_s, self._windows_s = start_ns, stale_s, windows_s
        self.reset()

    def reset(self) -> None:
        """Forget the flight."""
        self.now_ns = 0
        self.end: End | None = None
        self.reference: Trajectory | None = None
        self.home_ned_m: Array | None = None
        self.nodes: dict[str, NodeNews] = {name: NodeNews() for name in GRAPH_NODES}
        self._present: set[str] = set()
        self._known: set[str] = set()
        self._values: dict[str, tuple[Array, float]] = {}
        self._arrived: dict[str, float] = {}
        self._fix_ns = 0
        self._pace: deque[tuple[float, int]] = deque()
        self._events: list[Event] = []
        self._mode, self._mode_since_s = "idle", 0.0
        self._largest = Largest(self.start_ns, self._windows_s)

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
            self.tell(min(level, _ERROR), name, message)
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
            self.end = End(SILENT, "The plant has left the graph without a word.")
            self.tell(_ERROR, "plant", self.end.text)

    def interrupt(self) -> None:
        """Whoever shows the flight has been asked to end; before the flight's end: interrupted."""
        if self.now_ns and not self.end:
            self.end = End(INTERRUPTED, "The flight was stopped before its end.")
            self.tell(_WARN, OWN_NAME, self.end.text)

    def _end_by_plant(self, level: int, message: str) -> End:
        """The end that the plant tells; a loss with what had been given up before."""
        if level < _ERROR:
            return End(OVER, message)
        held_s = (self.time_s or 0.0) - self._mode_since_s
        if self._mode == "attitude":
            message += f" Nothing had held position and altitude for {held_s:.0f} s."
        return End(LOST, message)

    def tell(self, level: int, source: str, text: str) -> None:
        """Put a line on the timeline."""
        self._events.append(Event(self.time_s, level, source, text))

    def take_events(self) -> list[Event]:
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
        """hover, attitude, idle or over, by who sends: an inactive node sends nothing."""
        if self.end:
            return "over"
        if not self.is_fresh(topics.ACTUATORS, wall_s):
            return "idle"
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
