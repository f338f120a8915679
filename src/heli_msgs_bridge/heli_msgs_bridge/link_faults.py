# SPDX-License-Identifier: Apache-2.0
"""Faults of links as users write them, a mapping of YAML each: read, judged, made numbers. No ROS.

{what: link, from: observer, to: inner_loop, topic: odom, kind: loss, value: 0.5, start_s: 12}
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import yaml

from heli_math.ticks import Rate
from heli_msgs_bridge import topics
from heli_msgs_bridge.links import KINDS, LATEST_S, LINKS, PLACE, ROW
from heli_parameters.entry import entries, mapping, number_of, one_of
from heli_parameters.parameters import ParameterError
from heli_parameters.rcl_dump import number

WHAT = "link"
"""What a fault of a link says under `what`, in a file of faults."""
ANY = "any"
_KEYS = ("what", "from", "to", "topic", "kind", "start_s", "duration_s", "value")
_NODES = tuple(
    dict.fromkeys(name for topic, sink in LINKS for name in (*topics.BY_NAME[topic].source, sink))
)
_TOPICS = tuple(dict.fromkeys(topic for topic, _ in LINKS))
_LONGEST_S, _NEVER = 86400.0, 2.0**52


@dataclass(frozen=True)
class LinkFault:
    """A fault of one or more links.

    Attributes
    ----------
    sender, receiver, topic : str
        Names of nodes and of a topic; `any` for all.
    kind : str
        One of `links.KINDS`.
    start_s, duration_s : float
        Flight time of sending; an infinite duration: to the end.
    value : tuple of float
        Share of the messages, or for a delay s.
    """

    sender: str
    receiver: str
    topic: str
    kind: str
    start_s: float
    duration_s: float
    value: tuple[float, ...]

    @property
    def what(self) -> str:
        """What has the fault, in words."""
        over = "" if self.topic == ANY else f"{self.topic} "
        return f"{WHAT} {over}{self.sender} to {self.receiver}"

    @property
    def end_s(self) -> float:
        """Flight time from which on it does not act."""
        return self.start_s + self.duration_s

    def acts(self, time_s: float) -> bool:
        """Whether it acts at a flight time."""
        return self.start_s <= time_s < self.end_s

    @property
    def links(self) -> tuple[tuple[str, str], ...]:
        """Topic and receiver of each of its links."""
        return tuple(
            (topic, sink)
            for topic, sink in LINKS
            if self.topic in (ANY, topic)
            and self.receiver in (ANY, sink)
            and (self.sender == ANY or self.sender in topics.BY_NAME[topic].source)
        )

    @property
    def text(self) -> str:
        """The mapping that reads back as this fault."""
        parts = [f"what: {WHAT}", f"from: {self.sender}", f"to: {self.receiver}"]
        if self.topic != ANY:
            parts.append(f"topic: {self.topic}")
        parts += [f"kind: {self.kind}", f"start_s: {number(self.start_s)}"]
        if math.isfinite(self.duration_s):
            parts.append(f"duration_s: {number(self.duration_s)}")
        return "{" + ", ".join([*parts, f"value: {number(self.value[0])}"]) + "}"

    def as_dict(self) -> dict[str, Any]:
        """As JSON has it; a duration of null goes on to the end."""
        lasts = self.duration_s if math.isfinite(self.duration_s) else None
        return {"what": WHAT, "from": self.sender, "to": self.receiver, "topic": self.topic,
                "kind": self.kind, "start_s": self.start_s, "duration_s": lasts,
                "value": list(self.value)}  # fmt: skip

    @property
    def words(self) -> str:
        """For people: link odom observer to inner_loop loss 0.5 from 12 s to 20 s."""
        until = f" to {self.end_s:g} s" if math.isfinite(self.duration_s) else " s on"
        return f"{self.what} {self.kind} {self.value[0]:g} from {self.start_s:g}{until}"


def link_faults_of(texts: Iterable[str]) -> tuple[LinkFault, ...]:
    """The faults of the parameter `link_faults`.

    Raises
    ------
    ParameterError
        One sentence: which of them, key, value, and what is allowed.
    """
    return entries(texts, "link_faults", _KEYS, link_fault_of)


def link_fault_of(node: yaml.Node | None, where: str) -> LinkFault:
    """A fault of a YAML mapping; `where` begins the sentence of a ParameterError."""
    said = mapping(node, _KEYS, where)
    one_of(said, "what", (WHAT,), where)
    kind = one_of(said, "kind", KINDS, f"{where}: of a {WHAT}")
    start_s = number_of(said, "start_s", _LONGEST_S, where)
    duration_s = math.inf
    if "duration_s" in said:
        duration_s = number_of(said, "duration_s", _LONGEST_S, where)
    fault = LinkFault(
        one_of(said, "from", (ANY, *_NODES), where),
        one_of(said, "to", (ANY, *_NODES), where),
        one_of({"topic": ANY, **said}, "topic", (ANY, *_TOPICS), where),
        kind,
        start_s,
        duration_s,
        (_value(said, kind, where),),
    )
    if not fault.links:
        over = "no topic" if fault.topic == ANY else f"not {fault.topic}"
        known = ", ".join(
            f"{'/'.join(topics.BY_NAME[topic].source)} to {sink}: {topic}" for topic, sink in LINKS
        )
        raise ParameterError(
            f"{where}: from {fault.sender} to {fault.receiver} goes {over}; known: {known}"
        )
    return fault


def fault_rows(texts: Iterable[str], receiver: str, rate: Rate) -> np.ndarray:
    """Numbers of the faults of the links to a node, a `links.LinkRow` each (n, 5).

    Raises
    ------
    ParameterError
        As `link_faults_of`.
    """
    rows = [
        _row(fault, PLACE[topic, sink], rate)
        for fault in link_faults_of(texts)
        for topic, sink in fault.links
        if sink == receiver
    ]
    return np.array(rows, float).reshape(-1, ROW.size)


def _row(fault: LinkFault, link: int, rate: Rate) -> np.ndarray:
    row = np.zeros(ROW.size)
    row[ROW.link], row[ROW.kind] = link, KINDS.index(fault.kind)
    row[ROW.begin] = rate.ticks_in(fault.start_s)
    row[ROW.end] = rate.ticks_in(fault.end_s) if math.isfinite(fault.end_s) else _NEVER
    row[ROW.value] = fault.value[0]
    if fault.kind == "delay":
        row[ROW.value] = max(1, rate.ticks_in(fault.value[0]))
    return row


def _value(said: Mapping[str, Any], kind: str, where: str) -> float:
    """Share of the messages, all of them if it is left out, or how late they are."""
    delays = kind == "delay"
    if "value" not in said and not delays:
        return 1.0
    largest, meaning = (LATEST_S, "s") if delays else (1.0, "the share of the messages")
    if "value" not in said:
        raise ParameterError(f"{where}: value: missing; allowed: a number in (0, 1] ({meaning})")
    found = number_of(said, "value", largest, where)
    if found == 0.0:
        raise ParameterError(
            f"{where}: value: 0 is not allowed; allowed: a number in (0, {largest:g}] ({meaning})"
        )
    return found
