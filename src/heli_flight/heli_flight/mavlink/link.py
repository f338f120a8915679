# SPDX-License-Identifier: Apache-2.0
"""Datagrams to MAVLink messages and back; what is not for this vehicle is counted and dropped.

No sockets, no clock. A datagram holds whole messages (mavlink.io/en/guide/serialization.html),
so what one leaves over never becomes a part of the next one. The messages are MAVLink 2's common
ones, as pymavlink has them (https://mavlink.io/en/messages/common.html).
"""

from collections import Counter
from enum import Enum
from typing import Any, NamedTuple

from heli_core.errors import ParameterError

try:
    from pymavlink.dialects.v20 import common
except ImportError as error:
    raise ParameterError(
        "MAVLink needs pymavlink, which is not installed here: pip install 'heli-hover[mavlink]'"
    ) from error

MOST_BYTES = 2048
"""Longer datagrams are dropped: the longest message has 280 bytes."""
AUTOPILOT = common.MAV_COMP_ID_AUTOPILOT1
BROADCAST = 0


class Dropped(Enum):
    """Why a datagram or a message is not heard."""

    STRANGER = "from a port to which nothing is sent"
    FLOOD = "more than are read in one step"
    TOO_LONG = "a datagram longer than messages are"
    MALFORMED = "bytes that are no message, or whose checksum is wrong"
    UNKNOWN = "a message that is none of MAVLink's common ones"
    SOURCE = "a system id of 0, or this vehicle's own"
    TARGET = "for another system or component"


class MessageSource(NamedTuple):
    """Who has sent a message."""

    system: int
    component: int
    port: int


class Link:
    """Reads and writes what one vehicle hears and says.

    Parameters
    ----------
    system : int
        Its system id, 1 to 255.

    Attributes
    ----------
    dropped : Counter of Dropped
    """

    def __init__(self, system: int) -> None:
        self.system = system
        self.dropped: Counter[Dropped] = Counter()
        self._writer = common.MAVLink(None, srcSystem=system, srcComponent=AUTOPILOT)

    def read(self, data: bytes, port: int) -> list[tuple[Any, MessageSource]]:
        """The messages of a datagram that are for this vehicle.

        Parameters
        ----------
        data : bytes
        port : int
            From which it has come.
        """
        if len(data) > MOST_BYTES:
            self.dropped[Dropped.TOO_LONG] += 1
            return []
        reader = common.MAVLink(None)
        reader.robust_parsing = True
        heard = []
        for message in reader.parse_buffer(data) or ():
            source = MessageSource(message.get_srcSystem(), message.get_srcComponent(), port)
            if (why := self._refused(message, source)) is None:
                heard.append((message, source))
            else:
                self.dropped[why] += 1
        if reader.buf_len():
            self.dropped[Dropped.MALFORMED] += 1
        return heard

    def _refused(self, message: Any, source: MessageSource) -> Dropped | None:
        kind = message.get_type()
        if kind == "BAD_DATA":
            return Dropped.MALFORMED
        if kind.startswith("UNKNOWN"):
            return Dropped.UNKNOWN
        if source.system == 0 or source[:2] == (self.system, AUTOPILOT):
            return Dropped.SOURCE
        system = getattr(message, "target_system", BROADCAST)
        component = getattr(message, "target_component", BROADCAST)
        if system not in (BROADCAST, self.system) or component not in (BROADCAST, AUTOPILOT):
            return Dropped.TARGET
        return None

    def write(self, message: Any) -> bytes:
        """The bytes of a message."""
        packed: bytes = message.pack(self._writer)
        self._writer.seq = (self._writer.seq + 1) % 256
        return packed
