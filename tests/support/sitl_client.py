# SPDX-License-Identifier: Apache-2.0
"""ArduPilot's side of its JSON protocol, as strict as its parser: for tests and benchmarks.

Written from the protocol's description, without ArduPilot: packets as SITL sends them, text as SITL
reads it (by the place of names, not as JSON), and what it would not take.
"""

import math
import re
import struct
from collections.abc import Callable, Sequence

MAGICS = {16: 18458, 32: 29569}
_NUMBER = r"[+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?"
_SCALAR = re.compile(_NUMBER)
_VECTORS = {n: re.compile(r"\[" + ",".join([f"({_NUMBER})"] * n) + r"\]") for n in (3, 4)}
_FIELDS = (
    ("", "timestamp", 1), ("imu", "gyro", 3), ("imu", "accel_body", 3), ("", "position", 3),
    ("", "velocity", 3), ("", "quaternion", 4), ("", "airspeed", 1),
)  # fmt: skip


class SitlRefuses(AssertionError):
    """ArduPilot would not take this."""


def packet(pulse_us: Sequence[int], count: int, rate_hz: int = 400, channels: int = 16) -> bytes:
    """A packet with pulses from channel 1 on; the others have no output."""
    pulses = [*pulse_us, *([0] * (channels - len(pulse_us)))]
    return struct.pack(f"<HHI{channels}H", MAGICS[channels], rate_hz, count, *pulses)


def read(text: bytes) -> dict[str, tuple[float, ...]]:
    """Fields of an answer, found as SITL finds them.

    Raises
    ------
    SitlRefuses
        A field that it needs is not where it looks, or is no number.
    """
    words = text.decode("ascii")
    end = words.rfind("\n")
    begin = words.rfind("\n", 0, end) if end > 0 else -1
    if begin < 0:
        raise SitlRefuses(f"no line between two newlines: {words!r}")
    line, found = words[begin + 1 : end], {}
    for section, key, count in _FIELDS:
        at = line.find(section) + len(section)
        place = line.find(key, at)
        if place < 0:
            raise SitlRefuses(f"no {section} {key} in {line!r}")
        place += len(key) + 2  # behind the quote and the colon
        match = (_SCALAR if count == 1 else _VECTORS[count]).match(line, place)
        if match is None:
            raise SitlRefuses(f"{key} is not read at {line[place : place + 20]!r}")
        found[key] = tuple(map(float, match.groups() or match.group(0).split()))
        if not all(map(math.isfinite, found[key])):
            raise SitlRefuses(f"{key} is not finite: {found[key]}")
    return found


class SitlClient:
    """SITL in lockstep: a packet, an answer, its own clock by what the answer says.

    Parameters
    ----------
    exchange : callable
        Takes a packet and gives the answer, None for none.
    rate_hz : int
    channels : int

    Attributes
    ----------
    count : int
        Of the newest frame.
    time_s : float
        SITL's clock.
    state : dict
        Fields of the newest answer.
    """

    def __init__(
        self, exchange: Callable[[bytes], bytes | None], rate_hz: int = 400, channels: int = 16
    ) -> None:
        self._exchange, self.rate_hz, self._channels = exchange, rate_hz, channels
        self.count, self.time_s = 0, 0.0
        self.state: dict[str, tuple[float, ...]] = {}

    def frame(self, pulse_us: Sequence[int]) -> dict[str, tuple[float, ...]]:
        """The next frame; raises SitlRefuses if there is no answer, or none that SITL takes."""
        self.count += 1
        text = self._exchange(packet(pulse_us, self.count, self.rate_hz, self._channels))
        if text is None:
            raise SitlRefuses(f"no answer to frame {self.count}")
        state = read(text)
        (now_s,) = state["timestamp"]
        if not 0.0 < now_s - self.time_s < 0.1:
            raise SitlRefuses(f"a step from {self.time_s} to {now_s} s")
        if abs(math.hypot(*state["quaternion"]) - 1.0) > 1e-6:
            raise SitlRefuses(f"no rotation: {state['quaternion']}")
        self.time_s, self.state = now_s, state
        return state


# -------------------------------------------------------------------------------------------------
# A pilot of few lines, with ArduPilot's signs: positive roll to the right, pitch nose up, yaw nose
# to the right, more collective up.
# -------------------------------------------------------------------------------------------------


def angles(quaternion: Sequence[float]) -> tuple[float, float, float]:
    """Roll, pitch and yaw, rad."""
    w, x, y, z = quaternion
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    return roll, pitch, math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))


def h3_120(roll: float, pitch: float, col: float, yaw: float) -> list[int]:
    """Pulses of channels 1 to 8 for a swashplate with servos at -60, 60 and 180 deg."""

    def servo(angle_deg: float) -> int:
        a = math.radians(angle_deg)
        mixed = 0.45 * (math.cos(a + 0.5 * math.pi) * roll + math.cos(a) * pitch) + col
        return max(1000, min(2000, round(1000.0 + 1000.0 * mixed)))

    tail = max(1000, min(2000, round(1500.0 + 500.0 * yaw)))
    return [servo(-60.0), servo(60.0), servo(180.0), tail, 0, 0, 0, 1660]


class SmallPilot:
    """Holds level, heading and a height by the answers alone.

    Parameters
    ----------
    hover_col : float
        Collective that carries the weight, of the servos' range 0 to 1.
    roll_rad, pitch_rad : float
        Attitude of hover.
    """

    def __init__(self, hover_col: float, roll_rad: float, pitch_rad: float) -> None:
        self._col, self._roll, self._pitch = hover_col, roll_rad, pitch_rad

    def pulses(self, state: dict[str, tuple[float, ...]], height_m: float) -> list[int]:
        """Pulses for the newest answer."""
        roll, pitch, yaw = angles(state["quaternion"])
        p, q, r = state["gyro"]
        north, east, down = state["position"]
        v_north, v_east, v_down = state["velocity"]
        # Back to the start, slowly: forwards is nose down, to the right is roll to the right.
        lean = [0.02 * a + 0.06 * v for a, v in ((north, v_north), (east, v_east))]
        ahead = math.cos(yaw) * lean[0] + math.sin(yaw) * lean[1]
        aside = math.cos(yaw) * lean[1] - math.sin(yaw) * lean[0]
        wanted = self._roll - max(-0.1, min(0.1, aside)), self._pitch + max(-0.1, min(0.1, ahead))
        sink = max(-1.0, min(1.0, 0.8 * (-height_m - down))) - v_down
        return h3_120(
            0.386 * (2.0 * (wanted[0] - roll) - 0.1 * p),
            0.386 * (2.0 * (wanted[1] - pitch) - 0.1 * q),
            self._col - 0.06 * sink,
            -0.3 * yaw - 0.1 * r,
        )
