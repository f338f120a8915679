# SPDX-License-Identifier: Apache-2.0
"""What is seen of a flight by who only listens. No ROS."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_actions.table import STANDING

Array = NDArray[np.float64]


class Way(NamedTuple):
    """A reference: where it ends (3,), NED, m, and when, ns of stamps."""

    start_ns: int
    end_ns: int
    end_ned_m: Array


@dataclass
class Seen:
    """The newest of everything; times are stamps in ns, flight time.

    Attributes
    ----------
    now_ns : int
        Newest stamp of all.
    odom_ns, told_ns : int
        Stamp of the navigation and of what the outer loop said; 0 before the first.
    pos_ned_m : (3,) array
    quat : (4,) array
        Navigated attitude, FRD to NED.
    mode, said : str
        Mode that is flown, and the outer loop's sentence.
    given : bool
        Whether the way that is followed is a reference of others, not one of the outer loop's.
    refusals : dict
        Per topic how many messages were refused, and why the last one.
    way : Way or None
        The newest reference.
    ways : int
        How many have come.
    stood_down_m : float
        Height, down, at which it last stood.
    odom_wall_s, told_wall_s : float
        Wall time at which both were heard.
    """

    now_ns: int = 0
    odom_ns: int = 0
    told_ns: int = 0
    pos_ned_m: Array = field(default_factory=lambda: np.zeros(3))
    quat: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))
    mode: str = ""
    said: str = ""
    given: bool = False
    refusals: dict[str, tuple[int, str]] = field(default_factory=dict)
    way: Way | None = None
    ways: int = 0
    stood_down_m: float = 0.0
    odom_wall_s: float = 0.0
    told_wall_s: float = 0.0

    def begin_anew(self) -> None:
        """Another flight: forget the past one, but not that something was heard just now."""
        fresh = Seen(odom_wall_s=self.odom_wall_s, told_wall_s=self.told_wall_s)
        vars(self).update(vars(fresh))

    def odom(
        self,
        stamp_ns: int,
        pos_ned_m: Array,
        quat: Array,
        wall_s: float,
    ) -> None:
        """Navigation: position (3,), NED, m, and attitude (4,), FRD to NED."""
        self.odom_ns, self.now_ns = stamp_ns, max(self.now_ns, stamp_ns)
        self.odom_wall_s = wall_s
        self.pos_ned_m, self.quat = pos_ned_m.copy(), quat.copy()
        if self.mode == STANDING:
            self.stood_down_m = float(pos_ned_m[2])

    def told(self, stamp_ns: int, said: str, facts: Mapping[str, str], wall_s: float) -> None:
        """What the outer loop says of itself; its facts by name."""
        self.told_ns, self.now_ns = stamp_ns, max(self.now_ns, stamp_ns)
        self.told_wall_s = wall_s
        self.said, self.mode = said, facts.get("mode", self.mode)
        self.given = facts.get("reference", "given" if self.given else "") == "given"
        for name, text in facts.items():
            kind, _, topic = name.partition(".")
            count, _, why = text.partition("; ")
            if kind == "refused" and count.isdecimal():
                self.refusals[topic] = int(count), why

    def hear(self, way: Way) -> None:
        """A reference."""
        self.way, self.ways = way, self.ways + 1

    def refused(self, topic: str) -> int:
        """How many messages of a topic were refused."""
        return self.refusals.get(topic, (0, ""))[0]
