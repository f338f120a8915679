# SPDX-License-Identifier: Apache-2.0
"""Who sent a message: DDS without its security plug-ins authenticates nobody. No ROS.

The nodes of a supervised flight share a key, in a file that other users cannot read, and sign each
message with it; rclpy tells nobody who sent one (its message info has no GID). A bag alone does not
tell who sent what is in it either: the plant writes a sum of each ground truth that it sends into a
file, and whoever reads the bag works them out again.
"""

import hashlib
import os
import secrets
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_core.foreign_files import read_bytes
from heli_core.parameters import ParameterError

# -------------------------------------------------------------------------------------------------
# The key of a flight, and messages that are signed with it.
# -------------------------------------------------------------------------------------------------

KEY_VARIABLE = "HELI_GRAPH_KEY"
"""Environment variable that names the key's file. Where it is not set nobody signs, and unsigned
messages count: nodes that are started one by one, or somebody's own among them."""
KEY_BYTES = 32
_OPTIONS = slice(2, 4)
"""Of a serialised message, the options of its encapsulation: two bytes that readers pass over
(OMG DDS-XTypes 1.3, 7.6.3.1.2), but for the two bits that count what was padded."""
_PADDING_BITS = 0b11
_CONTENT = slice(4, None)
"""Behind the encapsulation."""


class KeyFileError(ParameterError):
    """The key of a flight cannot be used; the message names the file and why."""


@contextmanager
def flight_key(path: Path) -> Iterator[Path | None]:
    """Make a key's file, readable for this user alone; it is gone behind the block.

    None where the folder's file system knows no such rights: a key that others can read is none.

    Raises
    ------
    KeyFileError
        It cannot be made, or there is something of this name.
    """
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW
    try:
        with open(os.open(path, flags, 0o600), "wb") as file:
            file.write(secrets.token_bytes(KEY_BYTES))
            private = _is_private(os.fstat(file.fileno()))
    except OSError as error:
        raise KeyFileError(
            f"{path}: the flight's key cannot be written: {error.strerror}"
        ) from error
    try:
        yield path if private else None
    finally:
        with suppress(OSError):
            path.unlink()


def _is_private(state: os.stat_result) -> bool:
    """Whether nobody else has rights on a file."""
    return not stat.S_IMODE(state.st_mode) & (stat.S_IRWXG | stat.S_IRWXO)


@cache
def read_key(path: Path) -> bytes:
    """The key in a file.

    Raises
    ------
    KeyFileError
        There is none, or somebody else may know it.
    """
    try:
        file = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError as error:
        raise KeyFileError(f"{KEY_VARIABLE}={path}: {error.strerror}") from error
    try:
        state = os.fstat(file)
        if not stat.S_ISREG(state.st_mode) or state.st_uid != os.getuid():
            raise KeyFileError(f"{KEY_VARIABLE}={path}: not a file of this user")
        if not _is_private(state):
            raise KeyFileError(f"{KEY_VARIABLE}={path}: others have rights on it; allowed: 0600")
        key = os.read(file, KEY_BYTES + 1)
    finally:
        os.close(file)
    if len(key) != KEY_BYTES:
        raise KeyFileError(f"{KEY_VARIABLE}={path}: not {KEY_BYTES} bytes long")
    return key


class Signature:
    """Signs the serialised messages of one topic, and says whether one is signed so.

    A signature is 14 bits of the keyed BLAKE2s (RFC 7693) of topic and content: who does not know
    the key forges one message in 16,384, and every other one is counted. It stands where readers
    look at nothing, so `ros2 topic echo`, `ros2 bag` and foreign readers are none the wiser.

    Parameters
    ----------
    key : bytes
        (`KEY_BYTES`,)
    topic : str
        Fully resolved: what was signed for one topic counts for no other.
    """

    def __init__(self, key: bytes, topic: str) -> None:
        self._key = hashlib.blake2s(topic.encode(), key=key).digest()

    def sign(self, raw: bytes) -> bytes:
        """The message, signed."""
        return raw[:2] + self._of(raw) + raw[_CONTENT]

    def is_genuine(self, raw: bytes) -> bool:
        """Whether a message was signed with this key, and for this topic."""
        return raw[_OPTIONS] == self._of(raw)

    def _of(self, raw: bytes) -> bytes:
        if len(raw) & 3:  # as RTPS pads what it sends
            raw += bytes(-len(raw) & 3)
        first, second = hashlib.blake2s(raw[_CONTENT], key=self._key, digest_size=2).digest()
        return bytes((first, second & ~_PADDING_BITS))


def unsigned(raw: bytes) -> bytes:
    """A message as its sender made it, whether or not it was signed: two flights' are alike."""
    return raw[:2] + b"\0\0" + raw[_CONTENT]


def signature_of(topic: str, key: Path | None = None) -> Signature | None:
    """What signs a topic (fully resolved) in this process; None where nobody signs.

    Raises
    ------
    KeyFileError
        The environment, or `key`, names a file that is no key.
    """
    path = os.environ.get(KEY_VARIABLE) if key is None else key
    return Signature(read_key(Path(path)), topic) if path else None


class SignedPublisher:
    """A publisher of rclpy whose messages are signed."""

    def __init__(self, publisher: Any, signature: Signature) -> None:
        self._publisher, self._signature = publisher, signature

    def publish(self, message: Any) -> None:
        """Publish a message, serialised or not."""
        from rclpy.serialization import serialize_message

        raw = message if isinstance(message, bytes) else serialize_message(message)
        self._publisher.publish(self._signature.sign(raw))


def signing(publisher: Any, key: Path | None = None) -> Any:
    """A publisher of rclpy, or one that signs for it; arguments and errors as `signature_of`."""
    signature = signature_of(publisher.topic_name, key)
    return publisher if signature is None else SignedPublisher(publisher, signature)


# -------------------------------------------------------------------------------------------------
# Sums of a stream's messages, on a way that nobody in the ROS domain has: a file.
# -------------------------------------------------------------------------------------------------

SUM = np.dtype("<u8")
"""Of one message: 64 bits of BLAKE2b (RFC 7693). To find another message with a given one takes
2^63 tries; a message that is lost leaves those of the others as they were."""
SUMS_VARIABLE = "HELI_TRUTH_SUMS"
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
