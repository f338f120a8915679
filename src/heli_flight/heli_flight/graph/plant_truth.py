# SPDX-License-Identifier: Apache-2.0
"""Whether the ground truth in a flight's bag is what its plant sent."""

from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from heli_math.ticks import Rate
from heli_msgs_bridge import topics
from heli_msgs_bridge.sums import SUM, read_sums

TRUTH_SUMS = "truth.sums"
"""File in a flight's folder: what the plant says that it sent, on a way that DDS does not have."""
_RESULT, _GRAPH = "result.json", "graph.yaml"  # of a flight that ended; of any of the graph


class Recorded(Protocol):
    """Ground truth as it was recorded: ticks and sums (N,) of its messages; None: there is none."""

    @property
    def truth_ticks(self) -> NDArray[np.int64] | None:
        """Ticks of the messages."""

    @property
    def truth_sums(self) -> NDArray[np.uint64] | None:
        """Sums of their bytes (`heli_msgs_bridge.sums`)."""


class Heard(NamedTuple):
    """The ground truth of a bag of anybody."""

    truth_ticks: NDArray[np.int64] | None
    truth_sums: NDArray[np.uint64] | None


def foreign_truth(flight: Recorded, path: Path, rate: Rate, broken_off: bool = False) -> str:
    """Sentence about recorded ground truth that is not the plant's; empty if all of it is.

    Messages that are lost on the way leave the others as they were.

    Parameters
    ----------
    flight : Recorded
        With ground truth.
    path : Path
        What the plant wrote (`TRUTH_SUMS`).
    rate : Rate
        Of the ticks.
    broken_off : bool
        Whether the plant may have been killed before it wrote the last sums: then nothing is said
        of messages beyond them.
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
    if broken_off:
        own |= ticks >= sent.size
    if own.all():
        return ""
    first_s = rate.seconds(int(ticks[~own][0]))
    return (
        f"{topics.TRUTH_ODOM} in the bag is not what the plant sent: {np.count_nonzero(~own)} of "
        f"{ticks.size} messages, the first at {first_s:.2f} s; somebody else sends on it"
    )


def judged_truth(flight: Recorded, folder: Path, rate: Rate) -> tuple[str, str]:
    """The same of a flight that lies in a folder: what is false of it, and what is not known.

    Parameters
    ----------
    flight : Recorded
    folder : Path
        That holds the bag; of a foreign bag nothing is said.
    rate : Rate

    Returns
    -------
    str, str
        Two sentences, each empty where there is nothing to say.
    """
    path = folder / TRUTH_SUMS
    if flight.truth_ticks is None:
        return "", ""
    if not path.is_file():
        flown_here = (folder / _GRAPH).is_file()
        unknown = f"{TRUTH_SUMS} is not beside the bag: whether its ground truth is what the plant "
        return "", f"{unknown}sent is not known." if flown_here else ""
    ended = (folder / _RESULT).is_file()
    forged = foreign_truth(flight, path, rate, broken_off=not ended)
    beyond = int(np.count_nonzero(flight.truth_ticks >= path.stat().st_size // SUM.itemsize))
    if forged or ended or not beyond:
        return forged, ""
    return "", (
        f"The flight was broken off: whether the last {beyond} messages of ground truth are what "
        "the plant sent is not known."
    )
