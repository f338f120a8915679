# SPDX-License-Identifier: Apache-2.0
"""What the nodes of an aircraft must agree on, told by each; who does not agree. No ROS.

Each node tells its terms on a latched topic when it is built. A peer with other terms is not flown
with: its messages are refused, and to a node that waits for it, it is not there. Who tells none is
a stranger (a driver, a node of a user's own), of whom nothing is known: its messages are judged one
by one, as all are.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from heli_core.sensors import AIDS

VERSION = "2"
"""Of what messages mean to each other, as PX4 counts MESSAGE_VERSION in its messages: it goes up
when a node of before would be misunderstood. 2: what is not known is said by `no_estimate`."""
VERSION_TERM = "messages.version"
_COMMON = (
    "start_time_s", "rate_hz", "origin.latitude_deg", "origin.longitude_deg", "origin.altitude_m",
)  # fmt: skip
_FLYING = ("observer", "inner_loop", "outer_loop")
PAIRS = (
    ("outer_loop", "period_ticks", "inner_loop", "outer_period_ticks"),
    ("plant", "start.on_ground", "outer_loop", "start.on_ground"),
    ("plant", "ground.idle_collective", "outer_loop", "takeoff.idle_collective"),
    ("plant", "sensors.imu2.enabled", "observer", "imu2.enabled"),
    *(
        ("plant", f"sensors.{name}.period_ticks", "observer", f"schedule.{name}_period_ticks")
        for name in (row.name for row in AIDS)
    ),
    ("plant", "sensors.gps.period_ticks", "observer", "schedule.gps_period_ticks"),
    ("plant", "sensors.gps.latency_ticks", "observer", "schedule.gps_latency_ticks"),
    ("plant", "sensors.rotor_speed.period_ticks", "outer_loop", "rotor_speed_period_ticks"),
    *(("plant", key, name, key) for name in _FLYING for key in _COMMON),
    ("plant", "rate_hz", "recorder", "rate_hz"),
)
"""Pairs of parameters that two nodes must agree on: what one sends is what the other waits for."""
# Between those that fly without a plant of ours, on a real aircraft.
_AMONG = tuple(
    (first, key, second, key)
    for first in _FLYING for second in _FLYING if first < second
    for key in _COMMON
)  # fmt: skip
# `lockstep` is none: a bag of a flight in lockstep is heard in real time, too.
_EACH = (*PAIRS, *_AMONG)
NODES = frozenset(name for first, _, second, _ in _EACH for name in (first, second))
"""Who has terms."""
_MOST_TERMS, _MOST_CHARACTERS = 100, 100


@dataclass(frozen=True)
class Disagreement:
    """A term that a peer has otherwise.

    Attributes
    ----------
    peer : str
    key, value : str
        Of the peer.
    own_key, own_value : str
        Of this node.
    """

    peer: str
    key: str
    value: str
    own_key: str
    own_value: str

    @property
    def sentence(self) -> str:
        """All of it."""
        own = "here" if self.own_key == self.key else f"{self.own_key} here"
        return f"{self.peer}: {self.key} is {self.value}, {own} {self.own_value}"


def terms(name: str, values: Mapping[str, Any]) -> dict[str, str]:
    """What a node tells: version, and its values of what others must agree on.

    Parameters
    ----------
    name : str
        Of its kind (`NodeSpec.name`), whatever it was renamed to.
    values : mapping
        Its parameters.
    """
    keys = {key for side in (_EACH, map(_turned, _EACH)) for node, key, *_ in side if node == name}
    told = {key: str(values[key]) for key in sorted(keys) if key in values}
    return {VERSION_TERM: VERSION, **told}


def _turned(pair: tuple[str, str, str, str]) -> tuple[str, str, str, str]:
    first, key, second, other = pair
    return second, other, first, key


def differences(
    name: str, own: Mapping[str, str], peer: str, told: Mapping[str, str]
) -> Iterator[Disagreement]:
    """What a peer of a kind has otherwise than a node of another kind, each with its terms."""
    for first, key, second, other in ((peer, VERSION_TERM, name, VERSION_TERM), *_both_ways()):
        if (first, second) == (peer, name) and key in told and other in own:
            if told[key] != own[other]:
                yield Disagreement(peer, key, told[key], other, own[other])


def _both_ways() -> Iterable[tuple[str, str, str, str]]:
    return (*_EACH, *map(_turned, _EACH))


class Agreement:
    """The terms of a node, and what its peers have told of theirs.

    Parameters
    ----------
    name : str
        Of the node's kind.
    values : mapping
        Its parameters; looked at whenever a peer is judged.

    Attributes
    ----------
    broken : dict of str
        Per peer that has other terms, by the name that it has in the graph, a sentence.
    """

    def __init__(self, name: str, values: Mapping[str, Any]) -> None:
        self._name, self._values = name, values
        self._told: dict[str, tuple[str, dict[str, str]]] = {}
        self.broken: dict[str, str] = {}

    @property
    def own(self) -> dict[str, str]:
        """The node's own terms now."""
        return terms(self._name, self._values)

    def hear(self, node: str, kind: str, told: Mapping[str, str]) -> None:
        """A node of a name and kind has told its terms; the newest of a name count."""
        if kind in NODES and len(told) <= _MOST_TERMS:
            self._told[node] = kind, {k: v[:_MOST_CHARACTERS] for k, v in told.items()}
            self.judge()

    def keep(self, nodes: Iterable[str]) -> None:
        """Forget the terms of nodes that are gone."""
        there = set(nodes)
        self._told = {node: told for node, told in self._told.items() if node in there}
        self.judge()

    def of_kinds(self, kinds: Iterable[str]) -> set[str]:
        """Names of the peers of some kinds that do not agree."""
        wanted = set(kinds)
        return {node for node in self.broken if self._told[node][0] in wanted}

    def judge(self) -> None:
        """Compare anew, as a peer has told its terms, or the node's own have changed."""
        own = self.own
        self.broken = {}
        for node, (kind, told) in self._told.items():
            found = [d.sentence for d in differences(self._name, own, kind, told)]
            if found:
                self.broken[node] = "; ".join(found)
