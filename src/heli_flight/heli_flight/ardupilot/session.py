# SPDX-License-Identifier: Apache-2.0
"""One vehicle as ArduPilot meets it: which packet is a step, which one is answered again, which one
begins anew, and which gets no answer. No sockets, no clock of its own.

SITL sends a packet and blocks until it is answered; after a second it sends it again, with the same
count. One that was started again counts from the beginning, and sends from another port.
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from heli_core.ticks import NS_PER_S, Rate
from heli_flight.ardupilot.physics import Physics
from heli_flight.ardupilot.protocol import (
    REPLY,
    PacketError,
    RefusedCause,
    ServoPacket,
    read_packet,
    reply,
)
from heli_flight.ardupilot.recording import FlightFolder, FlightUnderWay
from heli_flight.ardupilot.servos import ROTOR_CHANNEL

SILENT_NS = 2 * NS_PER_S
"""So long a vehicle belongs to who has flown it: SITL that waits sends again every second."""
_SERVOS = 4
_SHORTEST_US, _LONGEST_US = 500, 2500
_IDLE_MOTOR_US = 1100
Address = tuple[str, int]

MULTICOPTER = (
    f"the pulses are those of a multicopter's motors: channels 1 to 4 alike and none on "
    f"{ROTOR_CHANNEL} (rotor speed); start arducopter-heli and load the parameters of "
    "heli ardupilot --print-params; the aircraft stands meanwhile"
)


@dataclass
class Flown(FlightUnderWay):
    """A flight and what was counted in it.

    Attributes
    ----------
    repeated : int
        Packets that were answered again.
    lost : int
        Frames that never came.
    refused : Counter
        Packets without an answer, by cause.
    """

    repeated: int = 0
    lost: int = 0
    refused: Counter[RefusedCause] = field(default_factory=Counter)


class _Newest(NamedTuple):
    """The packet that was answered last, and its answer."""

    number: int
    text: bytes


class Vehicle:
    """A vehicle that waits for ArduPilot.

    Parameters
    ----------
    begin : callable
        Makes a flight's physics and its folder, for the rate of the plant's steps.
    say : callable
        Takes a line for the user.
    longest_s : float
        Flight time after which it answers no more.
    watch : callable, optional
        Given the physics after each step; must not wait.

    Attributes
    ----------
    flights : list of Flown
        The last one is under way.
    refused : Counter
        Packets without an answer before any flight, by cause.
    pulse_us : (4,) array
        Of swashplate and tail, the last that each has had; 0 of one that has had none.
    """

    def __init__(
        self,
        begin: Callable[[Rate], tuple[Physics, FlightFolder | None]],
        say: Callable[[str], None],
        longest_s: float = float("inf"),
        watch: Callable[[Physics], None] | None = None,
    ) -> None:
        self.flights: list[Flown] = []
        self.refused: Counter[RefusedCause] = Counter()
        self._begin_flight, self._say, self._longest_s = begin, say, longest_s
        self._watch = watch
        self._owner: Address | None = None
        self._newest = _Newest(-1, b"")
        self.pulse_us = np.zeros(_SERVOS)
        self._motors = False
        self._told: set[str] = set()

    @property
    def done(self) -> bool:
        """Whether the flight has reached its length."""
        return bool(self.flights) and self.flights[-1].flown_s >= self._longest_s

    def answer(self, data: bytes, sender: Address, now_ns: int) -> bytes | None:
        """What is sent back for a packet; None for nothing.

        Parameters
        ----------
        data : bytes
        sender : (str, int)
            Where it came from.
        now_ns : int
            Wall time of a clock that only goes on.
        """
        try:
            packet = read_packet(data)
            self._check_sender(sender, now_ns)
        except PacketError as error:
            counts = self.flights[-1].refused if self.flights else self.refused
            counts[error.cause] += 1  # type: ignore[index]
            self._tell(f"refused {error.cause.name}", f"no answer: {error}")
            return None
        if sender != self._owner or packet.frame_count < self._newest.number:
            self._anew(packet, sender, now_ns)
        elif packet.frame_count == self._newest.number:
            self.flights[-1].repeated += 1
            self.flights[-1].newest_ns = now_ns
            return self._newest.text
        else:
            self.flights[-1].lost += packet.frame_count - self._newest.number - 1
        if self.done:
            return None
        return self._step(packet, now_ns)

    def _check_sender(self, sender: Address, now_ns: int) -> None:
        if self._owner in (None, sender):
            return
        if now_ns - self.flights[-1].newest_ns < SILENT_NS:
            raise PacketError(
                RefusedCause.SENDER,
                f"a second ArduPilot sends from port {sender[1]} while that of port "
                f"{self._owner[1]} flies; start it with -I 1 beside --vehicles 2; one that was "
                f"started again is heard in {SILENT_NS // NS_PER_S} s",
            )

    def _anew(self, packet: ServoPacket, sender: Address, now_ns: int) -> None:
        """Begin a flight: the first one, or after ArduPilot was started again."""
        if self._owner is not None:
            again = "started again" if sender == self._owner else f"back, from port {sender[1]}"
            self._say(f"ArduPilot is {again}: the aircraft stands at its start")
            self.close()
        rate = Rate.at_least(packet.frame_rate_hz)
        physics, folder = self._begin_flight(rate)
        self._owner, self._told = sender, set()
        self._newest = _Newest(-1, b"")
        self.pulse_us[:], self._motors = 0.0, False
        self.flights.append(Flown(physics, folder, now_ns, now_ns, self._watch))
        self._say(
            f"ArduPilot on port {sender[1]} asks for {packet.frame_rate_hz} Hz; the plant steps at "
            f"{rate.hz} Hz"
        )

    def _step(self, packet: ServoPacket, now_ns: int) -> bytes:
        flight = self.flights[-1]
        physics = flight.physics
        physics.step(self.pulse_us, self._hear(packet.pulse_us))
        flight.keep(self._tell)
        text = reply(physics.rate.time_ns(physics.tick), physics.told)
        flight.newest_ns, self._newest = now_ns, _Newest(packet.frame_count, text)
        return text

    def _hear(self, pulse_us: tuple[int, ...]) -> bool:
        """Take the pulses that are some; whether all servos have had one, a helicopter's."""
        held = self.pulse_us
        for i in range(_SERVOS):
            pulse = pulse_us[i]
            if _SHORTEST_US <= pulse <= _LONGEST_US:
                held[i] = pulse
            elif pulse:
                self._tell(
                    "pulse",
                    f"channel {i + 1} has a pulse of {pulse} us, which is not flown; allowed: "
                    f"{_SHORTEST_US} to {_LONGEST_US}, or 0 for no output",
                )
        if pulse_us[ROTOR_CHANNEL - 1]:
            self._motors = False
        elif 0 < pulse_us[0] <= _IDLE_MOTOR_US and len(set(pulse_us[:_SERVOS])) == 1:
            self._motors = True
            self._tell("motors", MULTICOPTER)
        return not self._motors and bool(held.all())

    def _tell(self, what: str, sentence: str) -> None:
        """Say a sentence, each of its kind once in a flight."""
        if what in self._told:
            return
        self._told.add(what)
        self._say(sentence)
        if self.flights:
            self.flights[-1].notes.append(sentence)

    def close(self) -> None:
        """Close the bag of the flight that is under way."""
        if self.flights:
            self.flights[-1].close(self._tell)

    def flush(self) -> None:
        """Have what is recorded so far outlive this process."""
        if self.flights:
            self.flights[-1].flush(self._tell)


class Meter:
    """The terminal's line of a vehicle, now and then."""

    def __init__(self, vehicle: Vehicle) -> None:
        self._vehicle = vehicle
        self._flight: Flown | None = None
        self._flown_s, self._at_ns = 0.0, 0

    def line(self, now_ns: int) -> str:
        """What has become of the flight; empty if nothing has since the last call."""
        flight = self._vehicle.flights[-1] if self._vehicle.flights else None
        if flight is None:
            return ""
        if flight is not self._flight:
            self._flight, self._flown_s, self._at_ns = flight, 0.0, flight.begun_ns
        if flight.flown_s == self._flown_s:
            return ""
        factor = (flight.flown_s - self._flown_s) / max((now_ns - self._at_ns) / NS_PER_S, 1e-9)
        self._flown_s, self._at_ns = flight.flown_s, now_ns
        physics = flight.physics
        qw, qx, qy, qz = physics.told[REPLY.quat]
        tilt = np.degrees(np.arccos(np.clip(1.0 - 2.0 * (qx * qx + qy * qy), -1.0, 1.0)))
        pulses = " ".join(f"{pulse:.0f}" for pulse in self._vehicle.pulse_us)
        refused = sum(flight.refused.values())
        return (
            f"{flight.flown_s:.1f} s  mode unknown  height {-physics.told[REPLY.pos][2]:.2f} m  "
            f"tilt {tilt:.1f} deg  servos {pulses} us  frames {physics.tick}  lost {flight.lost}  "
            f"repeated {flight.repeated}  refused {refused}  {factor:.2f} times real time"
        )
