# SPDX-License-Identifier: Apache-2.0
"""PX4's side of `simulator_mavlink`, as strict as it can be: for tests.

Written from MAVLink's messages and the behaviour of PX4's module, without PX4: HIL_SENSOR sets its
clock; each is answered by one HIL_ACTUATOR_CONTROLS; units, `fields_updated` and ranges are judged.
"""

import math
from collections.abc import Callable, Sequence
from typing import Any

from pymavlink.dialects.v20 import common as c

ACCEL, GYRO, MAG, BARO, DIFF = 0b111, 0b111000, 0b111000000, 0b1101000000000, 0b10000000000
LOCKSTEP, ARMED = 1, c.MAV_MODE_FLAG_SAFETY_ARMED
STAND = (0.0,) * 16


class Px4Refuses(AssertionError):
    """PX4 would read this wrong."""


def _within(name: str, value: float, low: float, high: float) -> None:
    if not low <= value <= high:
        raise Px4Refuses(f"{name} {value}: not within {low} to {high}")


class Px4Peer:
    """Reads what the simulator sends, and makes what PX4 answers.

    Parameters
    ----------
    system : int
        MAV_SYS_ID.
    counts_from_first : bool
        Whether its clock is HIL_SENSOR's less the first one, as in later versions.

    Attributes
    ----------
    sensors, fixes, truths : list
        Messages, oldest first.
    """

    def __init__(self, system: int = 1, counts_from_first: bool = True) -> None:
        self.mav = c.MAVLink(None, srcSystem=system, srcComponent=1)
        self._reader = c.MAVLink(None)  # not robust: what is no message raises
        self._counts_from_first = counts_from_first
        self.sensors: list[Any] = []
        self.fixes: list[Any] = []
        self.truths: list[Any] = []

    def hello(self, truth_every_us: int = 5000) -> bytes:
        """HEARTBEAT and the request for the truth, as PX4 begins."""
        beat = c.MAVLink_heartbeat_message(0, c.MAV_AUTOPILOT_PX4, 0, 0, 0, 3)
        asked = c.MAVLink_command_long_message(
            0, 0, c.MAV_CMD_SET_MESSAGE_INTERVAL, 0, 115, truth_every_us, 0, 0, 0, 0, 0
        )
        return beat.pack(self.mav) + asked.pack(self.mav)

    def hear(self, data: bytes) -> int:
        """Judge what has come; the number of HIL_SENSOR in it."""
        before = len(self.sensors)
        for message in self._reader.parse_buffer(data) or ():
            _JUDGES[message.get_type()](self, message)
        return len(self.sensors) - before

    @property
    def now_us(self) -> int:
        """Its clock."""
        first = self.sensors[0].time_usec if self._counts_from_first else 0
        return int(self.sensors[-1].time_usec - first)

    def answer(
        self,
        controls: Sequence[float] = STAND,
        armed: bool = True,
        flags: int = LOCKSTEP,
        time_us: int | None = None,
    ) -> bytes:
        """HIL_ACTUATOR_CONTROLS."""
        places = [*controls, *([0.0] * (16 - len(controls)))]
        mode = 1 | (ARMED if armed else 0)
        now_us = self.now_us if time_us is None else time_us
        data: bytes = c.MAVLink_hil_actuator_controls_message(now_us, places, mode, flags).pack(
            self.mav
        )
        return data

    # ---------------------------------------------------------------------------------------------

    def _sensor(self, m: Any) -> None:
        if self.sensors and m.time_usec <= self.sensors[-1].time_usec:
            raise Px4Refuses(f"time goes back: {m.time_usec} after {self.sensors[-1].time_usec}")
        if m.time_usec == 0 or m.id != 0:
            raise Px4Refuses("HIL_SENSOR: time 0 means never, and id 0 is the clock")
        known = ACCEL | GYRO | MAG | BARO
        if m.fields_updated & ~known:
            raise Px4Refuses(f"fields_updated {m.fields_updated:#b}: not known or not had")
        for mask in (ACCEL, GYRO, MAG, BARO):
            if m.fields_updated & mask not in (0, mask):
                raise Px4Refuses(f"fields_updated {m.fields_updated:#b}: a sensor in part")
        numbers = [v for v in m.to_dict().values() if isinstance(v, float)]
        if not all(map(math.isfinite, numbers)):
            raise Px4Refuses("HIL_SENSOR: not finite")
        if m.fields_updated & MAG:  # gauss: the Earth's field
            _within("field", math.hypot(m.xmag, m.ymag, m.zmag), 0.2, 0.8)
        if m.fields_updated & BARO:
            _within("abs_pressure", m.abs_pressure, 800.0, 1100.0)  # hPa
            _within("temperature", m.temperature, -40.0, 60.0)
            _within("pressure_alt", m.pressure_alt, -500.0, 2000.0)
        self.sensors.append(m)

    def _fix(self, m: Any) -> None:
        _within("fix_type", m.fix_type, 2, 6)
        _within("eph", m.eph, 1, 1000)  # cm
        _within("epv", m.epv, 1, 2000)
        if m.cog != 65535:
            _within("cog", m.cog, 0, 35999)  # cdeg
        _within("vel", abs(m.vel - math.hypot(m.vn, m.ve)), 0.0, 2.0)
        if self.fixes and m.time_usec <= self.fixes[-1].time_usec:
            raise Px4Refuses("HIL_GPS: time goes back")
        self.fixes.append(m)

    def _truth(self, m: Any) -> None:
        _within("quaternion", math.hypot(*m.attitude_quaternion), 1.0 - 1e-5, 1.0 + 1e-5)
        self.truths.append(m)


_JUDGES: dict[str, Callable[[Px4Peer, Any], None]] = {
    "HIL_SENSOR": Px4Peer._sensor,
    "HIL_GPS": Px4Peer._fix,
    "HIL_STATE_QUATERNION": Px4Peer._truth,
}


def mixed(roll: float, pitch: float, collective: float, yaw: float) -> list[float]:
    """Outputs of PX4's helicopter mixer: motor, tail, three servos at 0, 120, 240 deg, arm 0.5."""
    swash = [
        collective + 0.5 * (pitch * math.cos(math.radians(a)) - roll * math.sin(math.radians(a)))
        for a in (0.0, 120.0, 240.0)
    ]
    return [1.0, yaw, *swash]
