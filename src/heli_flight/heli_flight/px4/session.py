# SPDX-License-Identifier: Apache-2.0
"""A connection of PX4: bytes in, bytes out, one step of the plant for each answer. No sockets, no
clock of its own.

HIL_SENSOR is PX4's clock. PX4 answers each with one HIL_ACTUATOR_CONTROLS, whose time is its clock:
the time of the HIL_SENSOR that is answered, or in later versions that less the first one's
(PX4-Autopilot, platforms/posix/src/px4/common/drv_hrt.cpp). So an answer to an older HIL_SENSOR, or
one of another clock, is told from the one that is waited for, and only that one is a step.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Any

import numpy as np

from heli_flight.ardupilot.recording import FlightUnderWay
from heli_flight.mavlink.link import AUTOPILOT, common
from heli_flight.px4.servos import SWASH, TAIL, pulses_of
from heli_flight.px4.telemetry import SensorTelemetry

MOST_BYTES = 4096
"""That are read at once."""
_COMPONENT = 200
_LOCKSTEP = 1
_MOST_MOTORS = 4
_WHOLE = 1.0 + 1e-6

NO_LOCKSTEP = (
    "this PX4 is built without lockstep (HIL_ACTUATOR_CONTROLS.flags bit 0 is 0): it does not wait "
    "for HIL_SENSOR; allowed: a build with lockstep, as make px4_sitl makes it; its commands are "
    "not flown"
)
MULTICOPTER = (
    "the outputs are those of a multicopter's motors: 1 to 4 run and none behind them; load the "
    "parameters of heli px4 --print-params; the aircraft stands meanwhile"
)
SLOW = "PX4 has not answered a HIL_SENSOR; the next one is sent: is IMU_GYRO_RATEMAX below --rate?"


class AnswerRefused(Enum):
    """Why a message or some bytes bring nothing about."""

    MALFORMED = "bytes that are no message, or whose checksum is wrong"
    UNKNOWN = "a message that is none of MAVLink's common ones"
    SYSTEM = "from another system or component than the one that flies"
    OLD = "an answer to an older HIL_SENSOR, or a second one to the same"
    CLOCK = "an answer of a clock that is not HIL_SENSOR's"
    LOCKSTEP = "from a PX4 that does not wait for HIL_SENSOR"


@dataclass
class Px4Flight(FlightUnderWay):
    """A flight and what was counted in it.

    Attributes
    ----------
    heard : bool
        Whether PX4 answers by now, be it an older HIL_SENSOR.
    answers : int
        Steps that PX4's answers have made.
    unanswered : int
        Steps that were made without one: while PX4 starts, or where it has missed one.
    refused : Counter of AnswerRefused
    """

    heard: bool = False
    answers: int = 0
    unanswered: int = 0
    refused: Counter[AnswerRefused] = field(default_factory=Counter)


class Px4Session:
    """PX4 on one connection.

    Parameters
    ----------
    flight : Px4Flight
    telemetry : SensorTelemetry
    say : callable
        Takes a line for the user.
    longest_s : float
        Flight time after which no step is made.

    Attributes
    ----------
    armed : bool
    servos : (16,) array
        HIL_ACTUATOR_CONTROLS' places, the last that each has had.
    """

    def __init__(
        self,
        flight: Px4Flight,
        telemetry: SensorTelemetry,
        say: Callable[[str], None],
        longest_s: float = float("inf"),
    ) -> None:
        self.flight, self.armed, self.servos = flight, False, np.zeros(16)
        self._telemetry, self._say, self._longest_s = telemetry, say, longest_s
        self._reader = common.MAVLink(None)
        self._reader.robust_parsing = True
        self._writer = common.MAVLink(None, srcSystem=1, srcComponent=_COMPONENT)
        self._system: int | None = None
        self._motors = False
        self._truth_every_us, self._truth_due_us = 0, 0
        self._pulse_us = np.zeros(4)
        self._told: set[str] = set()

    @property
    def done(self) -> bool:
        """Whether the flight has reached its length."""
        return self.flight.flown_s >= self._longest_s

    def begin(self) -> bytes:
        """What is sent when PX4 has connected: the first HIL_SENSOR, which sets its clock."""
        return self._sensors()

    def hear(self, data: bytes) -> bytes:
        """What is sent for some bytes: HIL_SENSOR and what is due with it, once for each answer."""
        out = b""
        for message in self._reader.parse_buffer(data) or ():
            out += self._take(message)
        return out

    def miss(self) -> bytes:
        """Go on without an answer, with the last commands: the next HIL_SENSOR."""
        if self.done:
            return b""
        if self.flight.heard:
            self._tell("slow", SLOW)
        self.flight.unanswered += 1
        self._step()
        return self._sensors()

    # ---------------------------------------------------------------------------------------------

    def _take(self, message: Any) -> bytes:
        kind = message.get_type()
        if kind == "BAD_DATA":
            self._refuse(AnswerRefused.MALFORMED)
        elif kind.startswith("UNKNOWN"):
            self._refuse(AnswerRefused.UNKNOWN)
        elif not self._is_ours(message):
            self._refuse(AnswerRefused.SYSTEM)
        elif kind == "HIL_ACTUATOR_CONTROLS":
            return self._answered(message)
        elif kind == "COMMAND_LONG":
            self._set_interval(message)
        return b""

    def _is_ours(self, message: Any) -> bool:
        system = message.get_srcSystem()
        if self._system is None and system > 0 and message.get_srcComponent() == AUTOPILOT:
            self._system = system
        return bool(system == self._system and message.get_srcComponent() == AUTOPILOT)

    def _set_interval(self, m: Any) -> None:
        """MAV_CMD_SET_MESSAGE_INTERVAL of HIL_STATE_QUATERNION; nothing else is asked here."""
        asked = m.command == common.MAV_CMD_SET_MESSAGE_INTERVAL
        if not asked or m.param1 != common.MAVLINK_MSG_ID_HIL_STATE_QUATERNION:
            return
        every = m.param2
        if every == every and abs(every) < 1e9:
            self._truth_every_us = max(round(every), 0)
            self._truth_due_us = self._telemetry.time_us() + self._truth_every_us

    def _answered(self, m: Any) -> bytes:
        if not m.flags & _LOCKSTEP:
            self._refuse(AnswerRefused.LOCKSTEP)
            self._tell("lockstep", NO_LOCKSTEP)
            return b""
        now_us = self._telemetry.time_us()
        if m.time_usec not in (now_us, now_us - self._telemetry.first_us):
            is_old = m.time_usec < now_us
            self._refuse(AnswerRefused.OLD if is_old else AnswerRefused.CLOCK)
            self.flight.heard |= is_old
            return b""
        if self.done:
            return b""
        self._listen(m)
        self.flight.heard = True
        self.flight.answers += 1
        self._step()
        return self._sensors()

    def _listen(self, m: Any) -> None:
        controls = np.array(m.controls, float)
        inside = np.isfinite(controls) & (np.abs(controls) <= _WHOLE)
        self.servos[inside] = np.clip(controls[inside], -1.0, 1.0)
        if not inside[TAIL : SWASH.stop].all():
            self._tell(
                "range", "an output is not within -1 to 1: it keeps its last value, as it was flown"
            )
        armed = bool(m.mode & common.MAV_MODE_FLAG_SAFETY_ARMED)
        if armed != self.armed:
            self._say("PX4 has armed" if armed else "PX4 has disarmed")
        self.armed = armed
        motors, others = controls[:_MOST_MOTORS], controls[_MOST_MOTORS:]
        self._motors = armed and bool((motors > 0.0).all() and not others.any())
        if self._motors:
            self._tell("motors", MULTICOPTER)

    def _step(self) -> None:
        pulses_of(self.servos, self._pulse_us)
        self.flight.physics.step(self._pulse_us, self.armed and not self._motors)
        self.flight.keep(self._tell)

    def _sensors(self) -> bytes:
        """Fix and truth first, as HIL_SENSOR is what sets PX4 going."""
        telemetry = self._telemetry
        now_us = telemetry.time_us()
        messages = []
        if (fix := telemetry.fix()) is not None:
            messages.append(fix)
        if self._truth_every_us > 0 and now_us >= self._truth_due_us:
            self._truth_due_us = max(self._truth_due_us + self._truth_every_us, now_us + 1)
            messages.append(telemetry.truth())
        messages.append(telemetry.sensor())
        out = b""
        for message in messages:
            out += message.pack(self._writer)
            self._writer.seq = (self._writer.seq + 1) % 256
        return out

    def _refuse(self, cause: AnswerRefused) -> None:
        self.flight.refused[cause] += 1

    def _tell(self, what: str, sentence: str) -> None:
        """Say a sentence, each of its kind once in a flight."""
        if what in self._told:
            return
        self._told.add(what)
        self._say(sentence)
        self.flight.notes.append(sentence)

    def close(self) -> None:
        """Close the bag."""
        self.flight.close(self._tell)

    def flush(self) -> None:
        """Have what is recorded so far outlive this process."""
        self.flight.flush(self._tell)
