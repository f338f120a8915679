# SPDX-License-Identifier: Apache-2.0
"""ArduPilot's JSON protocol for software in the loop (SITL), as the physics sees it: bytes only.

SITL sends a binary packet of servo pulses and waits for one line of text, the state of the vehicle.
Nothing else moves its clock. Source: ArduPilot, "JSON SITL" (libraries/SITL/examples/JSON/readme.md
of its repository), and what its parser takes: no blank behind a colon, a newline before and after
the text, `imu` before what else has a rate or an acceleration in it.
"""

import struct
from enum import Enum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.errors import CausedError
from heli_core.ticks import NS_PER_S

PORT = 9002
"""Where the physics listens; that of instance n is 10 n higher."""
PORT_STEP = 10
LONGEST_STEP_S = 0.1
"""SITL takes no longer step: its clock would stand still."""
FASTEST_HZ = 4000
"""Above it a step is shorter than any loop of an autopilot asks for."""
_SLOWEST_HZ = round(1.0 / LONGEST_STEP_S)

_HEAD = struct.Struct("<HHI")
_MAGIC_16, _MAGIC_32 = 18458, 29569
_BODIES = {_MAGIC_16: struct.Struct("<16H"), _MAGIC_32: struct.Struct("<32H")}


class RefusedCause(Enum):
    """Why a packet gets no answer."""

    LENGTH = "it has not the length of a packet"
    MAGIC = "it does not begin as a packet does"
    STEP = "it asks for a step that SITL would not take"
    SENDER = "another ArduPilot flies this vehicle"


class PacketError(CausedError):
    """A packet that gets no answer; `cause` is a `RefusedCause`."""


class ServoPacket(NamedTuple):
    """What SITL sends.

    Attributes
    ----------
    frame_rate_hz : int
        Steps per second that it asks for.
    frame_count : int
        One more with each step; the same again while an answer is missing.
    pulse_us : tuple of int
        16 or 32 channels; 0 of one that has no output yet.
    """

    frame_rate_hz: int
    frame_count: int
    pulse_us: tuple[int, ...]


def read_packet(data: bytes) -> ServoPacket:
    """The packet in some bytes.

    Raises
    ------
    PacketError
        It is none, or asks for a step that SITL itself would not take.
    """
    if len(data) < _HEAD.size:
        raise PacketError(
            RefusedCause.LENGTH,
            f"a packet of {len(data)} bytes is too short; allowed: 40 with 16 channels, 72 with 32",
        )
    magic, rate_hz, count = _HEAD.unpack_from(data)
    body = _BODIES.get(magic)
    if body is None:
        raise PacketError(
            RefusedCause.MAGIC,
            f"a packet begins with {magic}; allowed: {_MAGIC_16} (16 channels), {_MAGIC_32} (32): "
            "is it from another program?",
        )
    if len(data) != _HEAD.size + body.size:
        raise PacketError(
            RefusedCause.LENGTH,
            f"a packet of {len(data)} bytes begins with {magic}; allowed: "
            f"{_HEAD.size + body.size} bytes",
        )
    if not _SLOWEST_HZ < rate_hz <= FASTEST_HZ:
        raise PacketError(
            RefusedCause.STEP,
            f"a packet asks for {rate_hz} steps a second; allowed: more than {_SLOWEST_HZ} (a step "
            f"below {LONGEST_STEP_S:g} s) to {FASTEST_HZ}; set SIM_RATE_HZ",
        )
    return ServoPacket(rate_hz, count, body.unpack_from(data, _HEAD.size))


class ReplyRow(NamedTuple):
    """What is told of a vehicle (17,): FRD, NED from where it started, SI, rad."""

    gyro: slice = slice(0, 3)  # body rates, rad/s
    force: slice = slice(3, 6)  # specific force, body, m/s2: [0, 0, -g] at rest
    pos: slice = slice(6, 9)  # NED, m
    vel: slice = slice(9, 12)  # NED, m/s
    quat: slice = slice(12, 16)  # (w, x, y, z), body -> NED
    airspeed: int = 16  # along the nose, m/s
    size: int = 17


REPLY = ReplyRow()
_NUMBER = "%.12g"
_THREE = f"[{_NUMBER},{_NUMBER},{_NUMBER}]"
_TEXT = (
    '\n{"timestamp":%d.%09d,'
    f'"imu":{{"gyro":{_THREE},"accel_body":{_THREE}}},'
    f'"position":{_THREE},"velocity":{_THREE},'
    f'"quaternion":[{_NUMBER},{_NUMBER},{_NUMBER},{_NUMBER}],"airspeed":{_NUMBER}}}\n'
)


def reply(time_ns: int, row: NDArray[np.float64]) -> bytes:
    """The line of text for a time (ns) since the start and a `ReplyRow` (17,) of finite numbers."""
    return (_TEXT % (*divmod(time_ns, NS_PER_S), *row.tolist())).encode("ascii")
