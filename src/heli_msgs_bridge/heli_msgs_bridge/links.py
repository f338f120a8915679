# SPDX-License-Identifier: Apache-2.0
"""Links that lose, delay, exchange or repeat what goes over them: numbers and kernel. No ROS.

A link is a topic and one node that hears it. What becomes of a message is decided where it is
heard: all that came still counts as come, so that lockstep waits for nothing that is lost. It is
handed over at the tick at which it would have arrived, if it is newer than what was handed over
before; its stamp says how old it is. What happens to a message depends on seed, link and tick of
sending alone, so it is the same in one process, in the graph, and in real time.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_math.jit import njit
from heli_math.ticks import Rate
from heli_msgs_bridge import topics

KINDS = ("loss", "delay", "reorder", "duplicate")
"""What a link does; a kernel takes the place of its name."""
_LOSS, _DELAY, _REORDER, _DUPLICATE = range(len(KINDS))
LINKS = tuple(
    (row.name, sink)
    for row in sorted(topics.TABLE, key=lambda row: (row.name == topics.ROTOR_SPEED, row.optional))
    if row.every_ticks
    for sink in row.sinks
)
"""Every link of the graph, topic and receiver, in the order of the table of topics; what is an
option comes behind, and last what the others had their draws before, so that these stay."""
ALWAYS = tuple(link for link in LINKS if not topics.BY_NAME[link[0]].optional)
"""Those that every flight has."""
PLACE = {link: place for place, link in enumerate(LINKS)}
LATEST_S = 1.0
"""The longest delay, s."""
NOTHING = -(2**62)
"""Stamp of what has not arrived."""
WIDTH = 32
"""Most numbers of a message."""
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


class LinkKernel(NamedTuple):
    """The faults of a flight's links."""

    faults: NDArray[np.float64]  # (n, 5), a LinkRow each
    faulty: NDArray[np.int64]  # (links,) 1 where a link has any
    keys: NDArray[np.uint64]  # (links,) of its random numbers
    periods: NDArray[np.int64]  # (links,) ticks from message to message
    on: int  # 1 if any link has any


class LinkState(NamedTuple):
    """What is under way; two places for each tick of sending, the second for a repeat."""

    rows: NDArray[np.float64]  # (links, slots, 32)
    stamps: NDArray[np.int64]  # (links, slots)
    arrives: NDArray[np.int64]  # (links, slots) tick of arrival; NOTHING: empty
    newest: NDArray[np.int64]  # (links,) stamp of what was handed over last
    counts: NDArray[np.int64]  # (links, 4) as `COUNTED`


def link_kernel(rows: NDArray[np.float64], seed: int, rate: Rate) -> LinkKernel:
    """Numbers of a flight with these faults, a `LinkRow` each (n, 5)."""
    faulty = np.zeros(len(LINKS), np.int64)
    faulty[rows[:, ROW.link].astype(int)] = 1
    keys = np.zeros(len(LINKS), np.uint64)
    if len(rows):
        children = np.random.SeedSequence(seed).spawn(_CHILD + len(LINKS))[_CHILD:]
        keys[:] = [child.generate_state(1, np.uint64)[0] for child in children]
    periods = [rate.every(topics.BY_NAME[topic].every_ticks) for topic, _ in LINKS]
    return LinkKernel(rows, faulty, keys, np.array(periods, np.int64), int(len(rows) > 0))


def initial_links(k: LinkKernel, rate: Rate) -> LinkState:
    """Links with nothing under way; without faults they need no memory."""
    # The longest delay, and behind it the longest period twice: exchanged, and repeated.
    held = rate.ticks_in(LATEST_S) + 2 * int(k.periods.max()) if k.on else 0
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
    k : LinkKernel
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
    newest, found = state.newest[link], stamps[best]
    for slot in range(arrives.shape[0]):
        if arrives[slot] == NOTHING or arrives[slot] > tick:
            continue
        if slot % 2 == 1 and not (slot == best and found > newest):
            counts[_TWICE] += 1
        elif stamps[slot] < found or found <= newest:
            counts[_OVERTAKEN] += 1
        arrives[slot] = NOTHING
    if found <= newest:
        return NOTHING
    state.newest[link] = found
    for i in range(out.shape[0]):
        out[i] = state.rows[link, best, i]
    return found


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
