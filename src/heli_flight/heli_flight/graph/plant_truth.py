# SPDX-License-Identifier: Apache-2.0
"""Whether the ground truth in a flight's bag is what its plant sent."""

from pathlib import Path

import numpy as np

from heli_flight.graph.bag_record import BagFlight
from heli_math.ticks import Rate
from heli_msgs_bridge import topics
from heli_msgs_bridge.sums import read_sums

TRUTH_SUMS = "truth.sums"
"""File in a flight's folder: what the plant says that it sent, on a way that DDS does not have."""


def foreign_truth(flight: BagFlight, path: Path, rate: Rate) -> str:
    """Sentence about recorded ground truth that is not the plant's; empty if all of it is.

    Messages that are lost on the way leave the others as they were.

    Parameters
    ----------
    flight : BagFlight
        With ground truth.
    path : Path
        What the plant wrote (`TRUTH_SUMS`).
    rate : Rate
        Of the ticks.
    """
    if flight.truth_ticks is None or flight.truth_sums is None:
        return f"the bag holds no {topics.TRUTH_ODOM}"
    try:
        sent = read_sums(path)
    except OSError as error:
        return f"what the plant sent is not known: {path.name}: {error.strerror or error}"
    ticks, sums = flight.truth_ticks, flight.truth_sums
    known = (ticks >= 0) & (ticks < sent.size)
    own = np.zeros(ticks.size, dtype=bool)
    own[known] = sums[known] == sent[ticks[known]]
    if own.all():
        return ""
    first_s = rate.seconds(int(ticks[~own][0]))
    return (
        f"{topics.TRUTH_ODOM} in the bag is not what the plant sent: {np.count_nonzero(~own)} of "
        f"{ticks.size} messages, the first at {first_s:.2f} s; somebody else sends on it"
    )
