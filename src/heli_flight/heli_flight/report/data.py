# SPDX-License-Identifier: Apache-2.0
"""What a report is made of, and the signals that its charts share."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from heli_bags.reader import Remark
from heli_flight.loop.flight_file import drawn, drawn_words
from heli_flight.loop.laws import own_laws
from heli_flight.loop.record import FlightRecord
from heli_flight.loop.result import Result, conditions
from heli_flight.loop.scoring import WINDOWS, Figures, Score, counted, errors
from heli_flight.loop.settings import Settings
from heli_flight.report.chart import Band
from heli_math.rotations import euler_angles
from heli_parameters.python_law import INNER, short_name

LEVELS = ("OK", "WARN", "ERROR", "STALE")


@dataclass(frozen=True)
class Event:
    """What a node said on /diagnostics.

    Attributes
    ----------
    time_s : float
        Flight time.
    node : str
    level : int
        0 OK, 1 WARN, 2 ERROR, 3 STALE.
    message : str
    """

    time_s: float
    node: str
    level: int
    message: str


def events_of(remarks: Iterable[Remark], settings: Settings) -> list[Event]:
    """Changes of the nodes' health out of /diagnostics; what only repeats is left out."""
    start_ns = round(settings.nodes["plant"]["start_time_s"] * 1e9)
    said: dict[str, tuple[int, str]] = {}
    events = []
    for remark in remarks:
        if said.get(remark.node) == (remark.level, remark.message):
            continue
        said[remark.node] = (remark.level, remark.message)
        time_s = (remark.stamp_ns - start_ns) / 1e9
        events.append(Event(time_s, remark.node, remark.level, remark.message))
    return events


@dataclass(frozen=True)
class Rival:
    """The same flight under another controller."""

    controller: str
    record: FlightRecord
    figures: Figures
    lost: str


@dataclass(frozen=True)
class Report:
    """All that the pages show.

    Attributes
    ----------
    record : FlightRecord
        Ground truth that was not recorded is NaN.
    settings : Settings
    result : Result
    how : str
        How it was flown: "ROS 2 graph, lockstep", "one process".
    events : sequence of Event
        Changes of the nodes' health; empty where nothing of the kind was recorded.
    rival : Rival, optional
        Same wind, same seed, another controller: Fig. 3 against Fig. 4.
    missing : sequence of str
        Sentences: what could not be shown, and why.
    assumed : bool
        True if the settings are not known to be those of the flight.
    commit : str
        Of the sources that flew; empty if it was not recorded.
    bands : sequence of Band
        Modes, faults, failsafes, health as they were recorded.
    """

    record: FlightRecord
    settings: Settings
    result: Result
    how: str
    events: Sequence[Event] = ()
    rival: Rival | None = None
    missing: Sequence[str] = field(default=())
    assumed: bool = False
    commit: str = ""
    bands: Sequence[Band] = ()

    @property
    def kind(self) -> str:
        """Kind of scenario: hover or attitude."""
        return self.settings.scenario.kind

    @property
    def controller(self) -> str:
        """The attitude law that flew: one of `CONTROLLERS`, or the name of one's own."""
        own = own_laws(self.settings).get(INNER, "")
        return short_name(own) if own else str(self.settings.nodes["inner_loop"]["controller"])

    @property
    def conditions(self) -> str:
        """Wind, sensors and seed in one line; stands next to every comparison."""
        told = conditions(self.settings).replace("\n", "; ")
        if drawn(self.settings):
            told += f"; {drawn_words(self.settings)}"
        return f"assumed, not recorded with the flight: {told}" if self.assumed else told

    @cached_property
    def has_truth(self) -> bool:
        """Whether ground truth was recorded."""
        return bool(np.isfinite(self.record.truth_pos_ned_m).any())

    @cached_property
    def has_rotor_truth(self) -> bool:
        """Whether flapping and gyro state were recorded."""
        return bool(np.isfinite(self.record.truth_rotor).any())

    @cached_property
    def has_wind(self) -> bool:
        """Whether the wind was recorded."""
        return bool(np.isfinite(self.record.wind_ned_mps).any())

    @cached_property
    def spans(self) -> list[tuple[float, float]]:
        """Scored stretches inside the flight, s."""
        if not len(self.record):
            return []
        end = float(self.record.time_s[-1])
        windows = self.settings.scenario.windows_s
        return [(float(a), min(float(b), end)) for a, b in windows if a < end]

    def sources(self) -> list[str]:
        """Of navigation and truth, those that were recorded; navigation if neither was."""
        known = {"navigation": self.record.nav_pos_ned_m, "truth": self.record.truth_pos_ned_m}
        found = [source for source, array in known.items() if np.isfinite(array).any()]
        return found or ["navigation"]

    def error(self, key: str, source: str) -> np.ndarray:
        """Error (N,) of a metric of hover, in its unit."""
        return errors(self.record, source, "hover")[key]

    def counted(self, stretch: str) -> np.ndarray:
        """Mask (N,) of the samples of a stretch."""
        return counted(self.record, self.settings.scenario, stretch)

    def euler_deg(self, source: str, record: FlightRecord | None = None) -> np.ndarray:
        """phi, theta, psi (N, 3), deg."""
        r = self.record if record is None else record
        return np.degrees(euler_angles(r.nav_q_nb if source == "navigation" else r.truth_q_nb))

    def score(self, key: str, source: str, stretch: str = WINDOWS) -> Score | None:
        """One score of this flight, None if it was not scored."""
        return self.result.figures.find(stretch, key, source)
