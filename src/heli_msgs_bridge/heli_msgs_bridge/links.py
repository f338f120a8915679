# SPDX-License-Identifier: Apache-2.0
"""Links that lose, delay, exchange or repeat what goes over them: numbers and kernel. No ROS.

A link is a topic and one node that hears it. What becomes of a message is decided where it is
heard: all that came still counts as come, so that lockstep waits for nothing that is lost. It is
handed over at the tick at which it would have arrived, if it is newer than what was handed over
before; its stamp says how old it is. What happens to a message depends on seed, link and tick of
sending alone, so it is the same in one process, in the graph, and in real time.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import yaml
from numpy.typing import NDArray

from heli_core import sensors
from heli_core.errors import ParameterCause, ParameterError
from heli_core.faults import LONGEST_S, PAST_S, Fault, FaultEntry, FaultKind, entries
from heli_core.inbox import NOTHING, WIDTH
from heli_core.jit import by_reference, njit
from heli_core.ticks import Rate
from heli_msgs_bridge import topics
from heli_msgs_bridge.layouts import CHANNELS
from heli_msgs_bridge.lockstep import Arrived

# -------------------------------------------------------------------------------------------------
# Links.
# -------------------------------------------------------------------------------------------------

_SHARE = FaultKind(0.0, 1.0, "share of the messages", optional=True)
NUMBERS = {
    "loss": _SHARE,
    "delay": FaultKind(0.0, PAST_S, "s"),
    "reorder": _SHARE,
    "duplicate": _SHARE,
}
KINDS = tuple(NUMBERS)
"""What a link does; a kernel takes the place of its name."""
_LOSS, _DELAY, _REORDER, _DUPLICATE = range(len(KINDS))
_PLAIN = [row.topic for row in sensors.PLAIN]
LINKS = tuple(
    (row.name, sink)
    for row in sorted(topics.TABLE, key=lambda row: (row.name in _PLAIN, row.optional))
    if row.every_ticks
    for sink in row.sinks
)
"""Every link of the graph, topic and receiver, in the order of the table of topics; what is an
option comes behind, and last what the others had their draws before, so that these stay."""
ALWAYS = tuple(link for link in LINKS if not topics.BY_NAME[link[0]].optional)
"""Those that every flight has."""
PLACE = {link: place for place, link in enumerate(LINKS)}
COUNTED = ("lost", "delayed", "overtaken", "twice")
"""What is counted of a link: lost; late; late and older than what came before; repeated."""
_LOST, _DELAYED, _OVERTAKEN, _TWICE = range(len(COUNTED))
# The children of a flight's seed below this one belong to the plant (`heli_dynamics_sim.noise`).
_CHILD = 64


class LinkRow(NamedTuple):
    """A fault of one link as its kernel takes it (5,)."""

    link: int = 0  # place in `LINKS`
    kind: int = 1
    begin: int = 2  # tick of sending from which it acts
    end: int = 3  # and from which it does not
    value: int = 4  # share, or ticks
    size: int = 5


ROW = LinkRow()


@by_reference
class LinkParams(NamedTuple):
    """The faults of a flight's links."""

    faults: NDArray[np.float64]  # (n, 5), a LinkRow each
    faulty: NDArray[np.int64]  # (links,) 1 where a link has any
    keys: NDArray[np.uint64]  # (links,) of its random numbers
    periods: NDArray[np.int64]  # (links,) ticks from message to message
    on: int  # 1 if any link has any


@by_reference
class LinkState(NamedTuple):
    """What is under way; two places for each tick of sending, the second for a repeat."""

    rows: NDArray[np.float64]  # (links, slots, 32)
    stamps: NDArray[np.int64]  # (links, slots)
    arrives: NDArray[np.int64]  # (links, slots) tick of arrival; NOTHING: empty
    newest: NDArray[np.int64]  # (links,) stamp of what was handed over last
    counts: NDArray[np.int64]  # (links, 4) as `COUNTED`


def link_params(rows: NDArray[np.float64], seed: int, rate: Rate) -> LinkParams:
    """Numbers of a flight with these faults, a `LinkRow` each (n, 5)."""
    faulty = np.zeros(len(LINKS), np.int64)
    faulty[rows[:, ROW.link].astype(int)] = 1
    keys = np.zeros(len(LINKS), np.uint64)
    if len(rows):
        children = np.random.SeedSequence(seed).spawn(_CHILD + len(LINKS))[_CHILD:]
        keys[:] = [child.generate_state(1, np.uint64)[0] for child in children]
    periods = [rate.every(topics.BY_NAME[topic].every_ticks) for topic, _ in LINKS]
    return LinkParams(rows, faulty, keys, np.array(periods, np.int64), int(len(rows) > 0))


def initial_links(k: LinkParams, rate: Rate) -> LinkState:
    """Links with nothing under way; without faults they need no memory."""
    # The longest delay, and behind it the longest period twice: exchanged, and repeated.
    held = rate.ticks_in(PAST_S) + 2 * int(k.periods.max()) if k.on else 0
    slots = 2 * (held + 1)
    return LinkState(
        np.zeros((len(LINKS), slots, WIDTH)),
        np.full((len(LINKS), slots), NOTHING, np.int64),
        np.full((len(LINKS), slots), NOTHING, np.int64),
        np.full(len(LINKS), NOTHING, np.int64),
        np.zeros((len(LINKS), len(COUNTED)), np.int64),
    )


@njit
def chance(key, sent, fault):
    """A number in [0, 1) for a message and a fault: SplitMix64 of a counter.

    Steele, Lea, Flood, Fast splittable pseudorandom number generators, OOPSLA 2014.
    """
    z = key + (np.uint64(sent) * np.uint64(64) + np.uint64(fault) + np.uint64(1)) * np.uint64(
        0x9E3779B97F4A7C15
    )
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    z = z ^ (z >> np.uint64(31))
    return float(z >> np.uint64(11)) / 9007199254740992.0


@njit
def _store(state, link, slot, stamp, arrives, row):
    state.stamps[link, slot], state.arrives[link, slot] = stamp, arrives
    for i in range(row.shape[0]):
        state.rows[link, slot, i] = row[i]


@njit
def send(state, k, link, sent, stamp, row):
    """A message has been sent: decide what becomes of it.

    Parameters
    ----------
    state : LinkState
        In place.
    k : LinkParams
    link : int
        Place in `LINKS`.
    sent, stamp : int
        Tick of sending, and that of its stamp.
    row : (n,) array
        What it says; n up to `WIDTH`.
    """
    late, behind, again, period = 0, 0, False, k.periods[link]
    counts, nth = state.counts[link], 0
    for n in range(k.faults.shape[0]):
        fault = k.faults[n]
        if int(fault[ROW.link]) != link:
            continue
        # Counted by link: a receiver does not know of the faults of others.
        nth += 1
        if not fault[ROW.begin] <= sent < fault[ROW.end]:
            continue
        kind, value = int(fault[ROW.kind]), fault[ROW.value]
        if kind == _DELAY:
            late += int(value)
        elif chance(k.keys[link], sent, nth) >= value:
            continue
        elif kind == _LOSS:
            counts[_LOST] += 1
            return
        elif kind == _REORDER:
            # Of a pair the first one comes behind the second.
            behind = period if (sent // period) % 2 == 0 else behind
        else:
            again = True
    counts[_DELAYED] += late > 0 or behind > 0
    slots = state.arrives.shape[1]
    # Several delays add up, to no more than is remembered.
    late = min(late, slots // 2 - 1 - 2 * period)
    slot = 2 * (sent % (slots // 2))
    _store(state, link, slot, stamp, sent + late + behind, row)
    if again:
        _store(state, link, slot + 1, stamp, sent + late + behind + period, row)


@njit
def receive(state, link, tick, out):
    """What has arrived at a tick: the newest, if it is newer than what came before.

    Returns
    -------
    int
        Its stamp, its numbers in out (n,); `NOTHING` if there is none.
    """
    arrives, stamps, counts = state.arrives[link], state.stamps[link], state.counts[link]
    best = -1
    for slot in range(arrives.shape[0]):
        if arrives[slot] == NOTHING or arrives[slot] > tick:
            continue
        if best >= 0 and stamps[slot] <= stamps[best]:
            continue
        best = slot
    if best < 0:
        return NOTHING
    newest, stamp = state.newest[link], stamps[best]
    for slot in range(arrives.shape[0]):
        if arrives[slot] == NOTHING or arrives[slot] > tick:
            continue
        if slot % 2 == 1 and not (slot == best and stamp > newest):
            counts[_TWICE] += 1
        elif stamps[slot] < stamp or stamp <= newest:
            counts[_OVERTAKEN] += 1
        arrives[slot] = NOTHING
    if stamp <= newest:
        return NOTHING
    state.newest[link] = stamp
    for i in range(out.shape[0]):
        out[i] = state.rows[link, best, i]
    return stamp


@njit
def pass_on(state, k, link, tick, stamp, came, row, out):
    """One tick of a link on which a message comes as it is sent: `send` if it came, `receive`.

    Parameters
    ----------
    state, k, link, stamp, row, out
        As of `send` and `receive`; out may be row.
    tick : int
        Of sending and of hearing.
    came : bool
        Whether there is a message that can be used.

    Returns
    -------
    int
        As of `receive`.
    """
    if k.faulty[link] == 0:
        if not came:
            return NOTHING
        for i in range(out.shape[0]):
            out[i] = row[i]
        return stamp
    if came:
        send(state, k, link, tick, stamp, row)
    return receive(state, link, tick, out)


# -------------------------------------------------------------------------------------------------
# Faults of links as users write them, a mapping of YAML each: read, judged, made numbers. No ROS.
#
# {what: link, from: observer, to: inner_loop, topic: odom, kind: loss, value: 0.5, start_s: 12}
# -------------------------------------------------------------------------------------------------

WHAT = "link"
"""What a fault of a link says under `what`, in a file of faults."""
ANY = "any"
_KEYS = ("what", "from", "to", "topic", "kind", "start_s", "duration_s", "value")
_NODES = tuple(
    dict.fromkeys(name for topic, sink in LINKS for name in (*topics.BY_NAME[topic].source, sink))
)
_TOPICS = tuple(dict.fromkeys(topic for topic, _ in LINKS))
_NEVER = 2.0**52


@dataclass(frozen=True)
class LinkFault(Fault):
    """A fault of one or more links; `value`: share of the messages, or of a delay s.

    Attributes
    ----------
    sender, receiver, topic : str
        Names of nodes and of a topic; `any` for all.
    """

    sender: str = ANY
    receiver: str = ANY
    topic: str = ANY

    @property
    def which(self) -> dict[str, str]:
        """Keys that say which link it is."""
        return {"from": self.sender, "to": self.receiver, "topic": self.topic}

    @property
    def name(self) -> str:
        """What has the fault, in words."""
        over = "" if self.topic == ANY else f"{self.topic} "
        return f"{WHAT} {over}{self.sender} to {self.receiver}"

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
    entry = FaultEntry(node, _KEYS, where)
    what = entry.word("what", (WHAT,))
    kind = entry.word("kind", KINDS, f"a {WHAT}")
    fault = LinkFault(
        what,
        kind,
        entry.number("start_s", LONGEST_S),
        entry.duration_s(),
        entry.numbers(1, NUMBERS[kind], f"{WHAT} {kind}") or (1.0,),
        entry.word("from", (ANY, *_NODES)),
        entry.word("to", (ANY, *_NODES)),
        entry.word("topic", (ANY, *_TOPICS), default=ANY),
    )
    if not fault.links:
        over = "no topic" if fault.topic == ANY else f"not {fault.topic}"
        known = ", ".join(
            f"{'/'.join(topics.BY_NAME[topic].source)} to {sink}: {topic}" for topic, sink in LINKS
        )
        problem = f"{fault.sender} to {fault.receiver} goes {over}; known: {known}"
        raise ParameterError(f"from {problem}", ParameterCause.CONFLICT, where=where)
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


# -------------------------------------------------------------------------------------------------
# What a node hears over links that have faults: between what came and its step. No ROS.
# -------------------------------------------------------------------------------------------------


class HeardLinks:
    """The links to one node.

    Parameters
    ----------
    node : str
        Its name in the table of topics.
    lags : mapping
        Per topic that it hears ticks from a message's stamp to its sending.
    values : mapping
        Parameters: `link_faults`, `link_seed`, `rate_hz`.

    Raises
    ------
    ParameterError
        A fault that is none.
    """

    def __init__(self, node: str, lags: Mapping[str, int], values: Mapping[str, Any]) -> None:
        self._rate = Rate.of_parameters(values)
        rows = fault_rows(values["link_faults"], node, self._rate)
        self._kernel = link_params(rows, values["link_seed"], self._rate)
        self._faults = [
            (fault, topic)
            for fault in link_faults_of(values["link_faults"])
            for topic, sink in fault.links
            if sink == node and topic in lags
        ]
        self._lags = {
            topic: lag
            for topic, lag in lags.items()
            if (topic, node) in PLACE and self._kernel.faulty[PLACE[topic, node]]
        }
        self._places = {topic: PLACE[topic, node] for topic in self._lags}
        self._state = initial_links(self._kernel, self._rate)
        self._rows = {topic: np.empty(_size(topic)) for topic in self._lags}

    @property
    def faulty(self) -> bool:
        """Whether any link has a fault at some time."""
        return bool(self._lags)

    def has(self, topic: str) -> bool:
        """Whether the link of a topic has a fault at some time."""
        return topic in self._lags

    def begin_anew(self) -> None:
        """Another flight: nothing is under way."""
        self._state = initial_links(self._kernel, self._rate)

    def through(self, tick: int, came: Arrived) -> Arrived:
        """What of a tick's messages has arrived: topics that did not are absent.

        Parameters
        ----------
        tick : int
        came : Arrived
            What the sender has sent.
        """
        if not self._lags:
            return came
        state, k = self._state, self._kernel
        heard = {topic: message for topic, message in came.items() if topic not in self._lags}
        for topic, link in self._places.items():
            row = self._rows[topic]
            stamp, value = came.get(topic, (0, None))
            if value is not None:
                row.fill(np.nan)
                row[: value.size] = value
                send(state, k, link, stamp + self._lags[topic], stamp, row)
            stamp = receive(state, link, tick, row)
            if stamp != NOTHING:
                heard[topic] = (stamp, row.copy())
        return heard

    def acting_on(self, time_s: float) -> list[tuple[str, str]]:
        """Topic and kind of each fault that acts at a flight time, each once."""
        now = [(topic, fault.kind) for fault, topic in self._faults if fault.acts(time_s)]
        return list(dict.fromkeys(now))

    def acting(self, time_s: float) -> str:
        """The same in words; empty for nothing."""
        now = [f"{topic} {kind}" for topic, kind in self.acting_on(time_s)]
        return f"link fault: {', '.join(now)}" if now else ""

    def facts(self) -> dict[str, str]:
        """What has become of messages so far, by link, for /diagnostics."""
        return {f"link.{topic}": _counted(self._state.counts[place])
                for topic, place in self._places.items()}  # fmt: skip


def _size(topic: str) -> int:
    channel = CHANNELS[topic]
    return channel.wider.size if channel.wider is not None else channel.size


def _counted(counts: Iterable[int]) -> str:
    counted = [f"{name} {count}" for name, count in zip(COUNTED, counts, strict=True) if count]
    return ", ".join(counted) or "nothing lost"
