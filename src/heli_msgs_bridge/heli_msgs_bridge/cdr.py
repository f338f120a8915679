# SPDX-License-Identifier: Apache-2.0
"""Messages of a fixed layout as bytes: one block of doubles in an otherwise constant frame.

Converting a ROS message object costs tens of microseconds in Python; a flight in lockstep sends
some two thousand messages per simulated second. All streams of this graph are of one shape: a
stamp, constant texts and one run of float64. So their CDR form (OMG DDS-XTypes, XCDR1, little
endian, as ROS 2 uses it) is laid out once; sending writes the doubles into it and receiving
compares the constant part and reads them. Bytes of any other layout are recognised and left to the
ordinary decoder.
"""

import struct
from collections.abc import Sequence

import numpy as np

from heli_core.ticks import NS_PER_S

_HEADER = b"\x00\x01\x00\x00"
_STAMP, _COUNT = struct.Struct("<iI"), struct.Struct("<I")
_STAMP_AT = len(_HEADER)
_SHIFT = 4


class Layout:
    """Builds the bytes of a message field by field, with CDR alignment.

    Attributes
    ----------
    data : bytearray
        Encapsulation header and fields so far.
    block_at, block_size : int
        Offset (bytes) and number of doubles of the block.
    padding : list of int
        Offsets of the bytes that only align what follows. Zero here; other serialisers leave in
        them what was in memory.
    free : list of int
        Offsets of the bytes that may differ from message to message.
    """

    def __init__(self) -> None:
        self.data = bytearray(_HEADER)
        self.block_at = 0
        self.block_size = 0
        self.padding: list[int] = []
        self.free: list[int] = []

    def _align(self, size: int) -> None:
        end = len(self.data)
        gap = -(end - len(_HEADER)) % size
        self.padding += range(end, end + gap)
        self.data += bytes(gap)

    def put(self, kind: str, value: int, free: bool = False) -> "Layout":
        """Append an integer; `kind` is its struct code (b, B, H, i, I), `free` one that varies."""
        size = struct.calcsize(kind)
        self._align(size)
        if free:
            self.free += range(len(self.data), len(self.data) + size)
        self.data += struct.pack(f"<{kind}", value)
        return self

    def stamp(self) -> "Layout":
        """Append a time (seconds, nanoseconds)."""
        return self.put("i", 0).put("I", 0)

    def text(self, value: str) -> "Layout":
        """Append a string."""
        encoded = value.encode() + b"\0"
        self.put("I", len(encoded))
        self.data += encoded
        return self

    def texts(self, values: Sequence[str]) -> "Layout":
        """Append a sequence of strings."""
        self.put("I", len(values))
        for value in values:
            self.text(value)
        return self

    def numbers(self, values: Sequence[float]) -> "Layout":
        """Append doubles that are known."""
        self._align(8)
        self.data += struct.pack(f"<{len(values)}d", *values)
        return self

    def doubles(self, count: int) -> "Layout":
        """Append the block of doubles (once per message)."""
        self._align(8)
        self.block_at, self.block_size = len(self.data), count
        self.data += bytes(8 * count)
        return self


class FixedMessage:
    """Reusable buffer of one fixed-layout message, for sending or receiving.

    Parameters
    ----------
    layout : Layout
        With the stamp first and exactly one block of doubles; what is free in it, and the padding,
        may differ from message to message.

    Attributes
    ----------
    block : ndarray of float64
        The message's doubles; written before `encode`, valid after `decode`.
    stamp_ns : int
        Stamp of the decoded message.
    """

    def __init__(self, layout: Layout) -> None:
        size = len(layout.data)
        # Shifted, so that the doubles behind the 4-byte header are aligned in memory.
        self._memory = np.zeros((size + _SHIFT + 7) // 8, dtype=np.float64)
        self._view = memoryview(self._memory.data).cast("B")[_SHIFT : _SHIFT + size]
        self._view[:] = layout.data
        self._size = size
        first = (layout.block_at + _SHIFT) // 8
        self.block = self._memory[first : first + layout.block_size]
        self.stamp_ns = 0
        block_end = layout.block_at + 8 * layout.block_size
        self._constant: list[tuple[int, bytes]] = [(0, _HEADER[:2])]
        for start, end in ((_STAMP_AT + _STAMP.size, layout.block_at), (block_end, size)):
            cuts = {*layout.free, *layout.padding}
            for cut in sorted(offset for offset in cuts if start <= offset < end):
                self._keep(layout, start, cut)
                start = cut + 1
            self._keep(layout, start, end)

    def _keep(self, layout: Layout, start: int, end: int) -> None:
        if end > start:
            self._constant.append((start, bytes(layout.data[start:end])))

    def encode(self, stamp_ns: int) -> bytes:
        """The message with the present `block`, stamped (ns, not negative)."""
        _STAMP.pack_into(self._view, _STAMP_AT, *divmod(stamp_ns, NS_PER_S))
        return self._view.tobytes()

    def decode(self, raw: bytes) -> bool:
        """Take over a received message; False if it is not of this layout."""
        if len(raw) != self._size:
            return False
        for start, expected in self._constant:
            if not raw.startswith(expected, start):
                return False
        # Not its header: what signs a message stands there (`signatures`).
        self._view[_STAMP_AT:] = raw[_STAMP_AT:]
        sec, nanosec = _STAMP.unpack_from(raw, _STAMP_AT)
        self.stamp_ns = sec * NS_PER_S + nanosec
        return True

    def get_byte(self, offset: int) -> int:
        """One byte of the message, for the free offsets."""
        return self._view[offset]

    def set_byte(self, offset: int, value: int) -> None:
        """Write one of the free bytes."""
        self._view[offset] = value


def stamp_of(raw: bytes) -> int:
    """Stamp (ns) of any serialised message that begins with a stamp, header or bare time."""
    sec, nanosec = _STAMP.unpack_from(raw, _STAMP_AT)
    return sec * NS_PER_S + nanosec


def stamp_of_first(raw: bytes) -> int:
    """Stamp (ns) of the first of a sequence of stamped things (tf2_msgs/TFMessage); -1 of none."""
    at = _STAMP_AT + _COUNT.size
    if len(raw) < at + _STAMP.size or _COUNT.unpack_from(raw, _STAMP_AT) == (0,):
        return -1
    sec, nanosec = _STAMP.unpack_from(raw, at)
    return sec * NS_PER_S + nanosec
