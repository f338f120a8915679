# SPDX-License-Identifier: Apache-2.0
"""What has come for a tick: one place for each message that a loop hears, with its stamp.

A node puts there what its topics bring, the one-process loop what its links let through; the step
of the observer, of the inner and of the outer loop reads it. So what is late, what belongs together
and what is held on to is decided in one place, whoever delivers.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.jit import by_reference, njit

NOTHING = -(2**62)
"""Stamp of what has not come."""
WIDTH = 32
"""Most numbers of a message."""


@by_reference
class Inbox(NamedTuple):
    """Messages of one tick, changed in place."""

    rows: NDArray[np.float64]  # (messages, 32)
    stamps: NDArray[np.int64]  # (messages,) tick of each one's stamp; NOTHING: it has not come


def empty_inbox(messages: int) -> Inbox:
    """An inbox with so many places, into which nothing has come."""
    return Inbox(np.full((messages, WIDTH), np.nan), np.full(messages, NOTHING, np.int64))


def deliver(
    inbox: Inbox,
    topics: Iterable[str],
    arrived: Mapping[str, tuple[int, NDArray[np.float64] | None]],
) -> None:
    """Put what has arrived for a tick into an inbox, and nothing else.

    Parameters
    ----------
    inbox : Inbox
        In place; numbers that a message does not have are NaN.
    topics : iterable of str
        Topic of each place, in order.
    arrived : mapping
        By topic, tick of the stamp and row; None: it says that it has nothing to say.
    """
    for place, topic in enumerate(topics):
        stamp, row = arrived.get(topic, (0, None))
        inbox.stamps[place] = NOTHING if row is None else stamp
        if row is not None:
            inbox.rows[place, : row.size] = row
            inbox.rows[place, row.size :] = np.nan


@njit
def put(inbox, place, stamp, row):
    """Put a row (n,) with the tick of its stamp into a place; NOTHING: it has not come."""
    inbox.stamps[place] = stamp
    if stamp != NOTHING:
        for i in range(row.shape[0]):
            inbox.rows[place, i] = row[i]


@njit
def has_come(inbox, place):
    """Whether there is a message in a place."""
    return inbox.stamps[place] != NOTHING
