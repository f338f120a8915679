# SPDX-License-Identifier: Apache-2.0
"""Sums of a stream's messages, on a way that nobody in the ROS domain has: a file. No ROS.

DDS authenticates nobody, so a bag alone does not tell who sent what is in it. The sender writes a
sum of each message that it sends; whoever reads the bag works them out again.
"""

import hashlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from heli_core.foreign_files import read_bytes

SUM = np.dtype("<u8")
"""Of one message: 64 bits of BLAKE2b (RFC 7693). To find another message with a given one takes
2^63 tries; a message that is lost leaves those of the others as they were."""
VARIABLE = "HELI_TRUTH_SUMS"
"""Environment variable that names the file for the plant's sums of the ground truth."""
_SIZE = SUM.itemsize


def checksum(raw: bytes) -> bytes:
    """Sum of a serialised message."""
    return hashlib.blake2b(raw, digest_size=_SIZE).digest()


class ChecksumWriter:
    """Writes the sums of messages into a file, one after the other, in the order of sending.

    A flight does not end because they cannot be written: then they are missing, which is told.

    Parameters
    ----------
    path : Path
        Made anew.

    Raises
    ------
    OSError
        It cannot be made.
    """

    def __init__(self, path: Path) -> None:
        self._file = open(path, "wb")  # noqa: SIM115  (open as long as the flight)

    def add(self, raw: bytes) -> None:
        """Append the sum of a message."""
        try:
            self._file.write(checksum(raw))
        except (OSError, ValueError):
            self.close()

    def close(self) -> None:
        """Hand over what has been written; the disk may be full. Any number of times."""
        try:
            self._file.close()
        except OSError:
            return


def read_checksums(path: Path) -> NDArray[np.uint64]:
    """Sums (N,) in the order of sending; FileError if there are none."""
    raw = read_bytes(path)
    return np.frombuffer(raw[: len(raw) // _SIZE * _SIZE], SUM)
