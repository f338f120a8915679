# SPDX-License-Identifier: Apache-2.0
"""The vehicle on a UDP socket of this machine, paced by the wall clock.

It sends to the ports on which stations wait, as autopilots do, and hears what comes from there; no
other program is heard. A turn reads what has come, flies a step of the position law (20 ms) and
sends; so who holds a `MavlinkDoor` may turn it without a clock.
"""

import contextlib
import select
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from rich.console import Console

from heli_core.errors import ParameterError
from heli_core.rows import NAV
from heli_core.ticks import NS_PER_S
from heli_flight import interrupts
from heli_flight.fly import FlightOrder, tell_if_it_compiles
from heli_flight.layers import section_of
from heli_flight.mavlink.link import MOST_BYTES, Dropped, Link
from heli_flight.mavlink.vehicle import MavlinkVehicle
from heli_flight.settings import Settings
from heli_flight.stepping import SteppedFlight, step

HOST = "127.0.0.1"
SCENARIO = "by_hand"
"""What is flown where neither option nor file says: on the skids, in the hover test's wind."""
MOST_READ = 100
"""Datagrams that are heard in a turn; what has come besides is dropped."""
MOST_DROPPED = 2000
MOST_PORTS = 4
MOST_SPEED = 100.0
_LINE_NS = NS_PER_S
_LATE_NS = NS_PER_S // 2
"""Later than this, what is missed is not made up for: a station would see it rush."""


@dataclass(frozen=True)
class MavlinkOrder:
    """What is asked for.

    Attributes
    ----------
    flight : FlightOrder
    ports : sequence of int
        UDP ports on 127.0.0.1 on which stations wait.
    system : int
        System id, 1 to 250.
    autopilot : int
        MAV_AUTOPILOT that it says it is.
    speed : float
        Times real time.
    duration_s : float, optional
        Flight time after which it ends; None: never.
    local_port : int
        UDP port from which it sends; 0: any free one.
    """

    flight: FlightOrder
    ports: Sequence[int]
    system: int
    autopilot: int
    speed: float = 1.0
    duration_s: float | None = None
    local_port: int = 0

    def resolved(self) -> Settings:
        """What is flown; raises ParameterError."""
        if not 1 <= len(self.ports) <= MOST_PORTS:
            raise ParameterError(f"--port: {len(self.ports)} ports; allowed: 1 to {MOST_PORTS}")
        if not 0.0 < self.speed <= MOST_SPEED:
            raise ParameterError(
                f"--speed {self.speed:g}: not allowed; allowed: above 0 to {MOST_SPEED:g}"
            )
        return self.flight.resolved()


def flight_order(scenario: str | None, params: Sequence[Any], **options: Any) -> FlightOrder:
    """The order of a flight that stands on the ground unless option or file say otherwise."""
    if scenario is None and "scenario" not in section_of(params):
        scenario = SCENARIO
    return FlightOrder(scenario=scenario, params=params, report=False, **options)


@dataclass
class MavlinkDoor:
    """A vehicle at its socket.

    Attributes
    ----------
    vehicle : MavlinkVehicle
    ports : sequence of int
        To which it sends, and from which it hears.
    sock : socket
    link : Link
    """

    vehicle: MavlinkVehicle
    ports: Sequence[int]
    sock: socket.socket
    link: Link = field(init=False)

    def __post_init__(self) -> None:
        self.link = Link(self.vehicle.system)

    def turn(self) -> None:
        """Hear what has come, fly a step, say what is due."""
        self.hear()
        self.vehicle.fly()
        self.send()

    def hear(self) -> None:
        """Take what has come: so much of it, the rest is dropped."""
        read = 0
        while read < MOST_READ + MOST_DROPPED:
            try:
                data, (host, port) = self.sock.recvfrom(MOST_BYTES + 1)
            except (BlockingIOError, ConnectionError):
                return
            read += 1
            if host != HOST or port not in self.ports:
                self.link.dropped[Dropped.STRANGER] += 1
            elif read > MOST_READ:
                self.link.dropped[Dropped.FLOOD] += 1
            else:
                for message, source in self.link.read(data, port):
                    self.vehicle.hear(message, source)

    def send(self) -> None:
        """Send what the vehicle says; where nobody waits it is lost, as it is by radio."""
        for message, port in self.vehicle.take():
            data = self.link.write(message)
            for to in self.ports if port is None else (port,):
                with contextlib.suppress(OSError):
                    self.sock.sendto(data, (HOST, to))

    @property
    def dropped(self) -> int:
        """Datagrams and messages that were not heard."""
        return sum(self.link.dropped.values())


def opened(port: int = 0) -> socket.socket:
    """A UDP socket of this machine alone; port 0: any free one.

    Raises
    ------
    ParameterError
        Another program has the port.
    """
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.bind((HOST, port))
    except OSError as error:
        sock.close()
        raise ParameterError(
            f"--local-port {port}: UDP {HOST}:{port} cannot be had: {error.strerror}; "
            "allowed: another one, or 0 for any free one"
        ) from None
    sock.setblocking(False)
    return sock


def serve(
    door: MavlinkDoor, speed: float, until_ns: int | None, say: Callable[[str], None]
) -> None:
    """Turn at the pace of the wall clock until the flight has its length, is lost, or Ctrl-C.

    Parameters
    ----------
    door : MavlinkDoor
    speed : float
        Times real time.
    until_ns : int or None
        Flight time.
    say : callable
        Takes a line once a second.
    """
    vehicle = door.vehicle
    clock = vehicle.telemetry
    begun_ns, flown_ns = time.monotonic_ns(), clock.now_ns
    line_ns, line_flown_ns = begun_ns, flown_ns
    while not vehicle.lost and (until_ns is None or clock.now_ns < until_ns):
        door.turn()
        now_ns = time.monotonic_ns()
        if now_ns >= line_ns + _LINE_NS:
            interrupts.check()
            pace = (clock.now_ns - line_flown_ns) / (now_ns - line_ns)
            say(_line(door, pace))
            line_ns, line_flown_ns = now_ns, clock.now_ns
        due_ns = begun_ns + round((clock.now_ns - flown_ns) / speed)
        if now_ns > due_ns + _LATE_NS:
            begun_ns, flown_ns = now_ns, clock.now_ns
        elif due_ns > now_ns:
            _rest_until(due_ns)


def _rest_until(due_ns: int) -> None:
    while (left_ns := due_ns - time.monotonic_ns()) > 0:
        select.select((), (), (), left_ns / NS_PER_S)


def _line(door: MavlinkDoor, pace: float) -> str:
    vehicle = door.vehicle
    height = "unknown"
    home = vehicle.telemetry.home_ned_m()
    if home is not None and vehicle.telemetry.knows():
        height = f"{home[2] - vehicle.telemetry.nav[NAV.pos][2]:.2f} m"
    return (
        f"{vehicle.telemetry.now_ns / NS_PER_S:.1f} s  mode {vehicle.mode.name}  "
        f"{'armed' if vehicle.armed else 'disarmed'}  height {height}  dropped {door.dropped}  "
        f"{pace:.2f} times real time"
    )


def fly(order: MavlinkOrder, out: Console) -> str:
    """Fly until it ends; why the helicopter was lost, empty if it was not.

    Parameters
    ----------
    order : MavlinkOrder
    out : Console

    Raises
    ------
    ParameterError, TrimError, AircraftError, SynthesisError, OSError
        Bad input.
    """

    def say(line: str) -> None:
        out.print(line, highlight=False, soft_wrap=True, markup=False)

    settings = order.resolved()
    tell_if_it_compiles(out, kernel=step)
    vehicle = MavlinkVehicle(SteppedFlight(settings), order.system, order.autopilot)
    until_ns = None if order.duration_s is None else round(order.duration_s * NS_PER_S)
    with contextlib.closing(opened(order.local_port)) as sock:
        door = MavlinkDoor(vehicle, order.ports, sock)
        ports = ", ".join(map(str, order.ports))
        say(f"MAVLink vehicle {order.system}: sends to udp {HOST}, port {ports}, as QGroundControl "
            "waits there; Ctrl-C ends it")  # fmt: skip
        # Compiled code may have dropped one.
        interrupts.check()
        with contextlib.suppress(KeyboardInterrupt):
            serve(door, order.speed, until_ns, say)
        door.send()
    say(_ended(door))
    return vehicle.lost


def _ended(door: MavlinkDoor) -> str:
    seconds = door.vehicle.telemetry.now_ns / NS_PER_S
    causes = ", ".join(
        f"{count} {cause.name.lower()}" for cause, count in door.link.dropped.items()
    )
    lost = f"LOST: {door.vehicle.lost}; " if door.vehicle.lost else ""
    return f"{lost}{seconds:.2f} s flown; not heard: {causes or 'nothing'}"
