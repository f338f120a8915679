# SPDX-License-Identifier: Apache-2.0
"""The simulator on a TCP port of this machine that PX4 connects to, from order to folders."""

import contextlib
import selectors
import socket
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console

from heli_core.jit import is_compiled
from heli_core.rcl_yaml import ParameterError
from heli_core.ticks import NS_PER_S, TICKS_PER_S, Rate
from heli_flight import interrupts
from heli_flight.ardupilot import live
from heli_flight.ardupilot import physics as physics_kernels
from heli_flight.ardupilot.physics import Physics
from heli_flight.ardupilot.protocol import REPLY
from heli_flight.ardupilot.recording import FlightFolder
from heli_flight.ardupilot.server import COMPILES, HOST, helicopter_of, plant_alone, written
from heli_flight.fly import FinishedFlight, free_name
from heli_flight.graph.live import LiveOrder
from heli_flight.layers import PX4
from heli_flight.px4.servos import USED, px4_parameters, servo_numbers
from heli_flight.px4.session import MOST_BYTES, Px4Flight, Px4Session
from heli_flight.px4.telemetry import SensorTelemetry
from heli_flight.settings import Settings
from heli_flight.terminal import refuse_existing

PORT = 4560
"""Where PX4 looks for a simulator; that of instance n is n higher."""
RATES_HZ = (200, 1000)
"""HIL_SENSOR a second, at least and at most."""
PATIENCE_NS = NS_PER_S // 2
"""PX4 that has answered once gets the next HIL_SENSOR after so long without an answer."""
_LINE_NS = NS_PER_S


@dataclass(frozen=True)
class Px4Order:
    """What is asked for; None: what the parameter files say, else the packaged default.

    Attributes
    ----------
    aircraft : str, optional
        Name of a packaged aircraft, or a file.
    rate_hz : int
        HIL_SENSOR a second, in whole hundreds.
    port : int
        TCP port; 0: any free one.
    world, gps : str, optional
    seed : int, optional
    duration_s : float, optional
        Flight time after which it ends.
    params : sequence of Path
    faults : Path, optional
    out : Path, optional
        Folder to make.
    report : bool
    live : LiveOrder, optional
        That the flight is to be shown.
    """

    aircraft: str | None = None
    rate_hz: int = 400
    port: int = PORT
    world: str | None = None
    gps: str | None = None
    seed: int | None = None
    duration_s: float | None = None
    params: Sequence[Path] = ()
    faults: Path | None = None
    out: Path | None = None
    report: bool = True
    live: LiveOrder | None = None

    def resolved(self, seed: int | None = None, duration_s: float | None = None) -> Settings:
        """What is flown, or with another seed and length; raises ParameterError."""
        least, most = RATES_HZ
        if not least <= self.rate_hz <= most or self.rate_hz % TICKS_PER_S:
            raise ParameterError(
                f"--rate {self.rate_hz}: not allowed; allowed: whole hundreds, {least} to {most}"
            )
        return plant_alone(
            PX4, self.aircraft, self.params, self.faults, world=self.world, gps=self.gps,
            seed=self.seed if seed is None else seed,
            duration_s=self.duration_s if duration_s is None else duration_s,
        )  # fmt: skip

    def parameters(self) -> dict[str, float]:
        """PX4's parameters for the aircraft; raises ParameterError, TrimError."""
        settings = self.resolved()
        latency = int(settings.nodes["plant"]["sensors.gps.latency_ticks"])
        return px4_parameters(helicopter_of(settings), self.rate_hz, latency)


def listening(port: int) -> socket.socket:
    """A TCP socket of this machine alone.

    Raises
    ------
    ParameterError
        Another program has the port, or it is not allowed.
    """
    sock = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        sock.bind((HOST, port))
        sock.listen(1)
    except (OSError, OverflowError) as error:
        sock.close()
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise ParameterError(
            f"--port {port}: TCP {HOST}:{port} cannot be had: {why}; end the program that has it "
            "(another heli px4, Gazebo, jMAVSim?), or name another: PX4's instance N looks on "
            "4560 + N"
        ) from None
    sock.setblocking(False)
    return sock


class Px4Door:
    """The port, and who is connected to it.

    Parameters
    ----------
    sock : socket
        Listens.
    start : callable
        Makes the session of a new connection.
    say : callable
        Takes a line for the user.

    Attributes
    ----------
    sessions : list of Px4Session
        The last one is under way, or ended.
    turned_away : int
        Connections while another PX4 flew.
    """

    def __init__(
        self,
        sock: socket.socket,
        start: Callable[[], Px4Session],
        say: Callable[[str], None],
    ) -> None:
        self.sock, self.turned_away = sock, 0
        self.sessions: list[Px4Session] = []
        self._start, self._say = start, say
        self.peer: socket.socket | None = None
        self._selector = selectors.DefaultSelector()
        self._selector.register(sock, selectors.EVENT_READ)

    @property
    def session(self) -> Px4Session | None:
        """The newest one."""
        return self.sessions[-1] if self.sessions else None

    @property
    def done(self) -> bool:
        """Whether the flight has reached its length."""
        return self.session is not None and self.session.done

    def turn(self, rest_s: float) -> bool:
        """Wait so long at most for something to come, and answer it; whether something came."""
        ready = [key.fileobj for key, _ in self._selector.select(rest_s)]
        if self.peer is not None and self.peer in ready:
            self._hear()
        if self.sock in ready:
            self._accept()
        return bool(ready)

    def miss(self) -> None:
        """Go on without an answer."""
        if self.peer is not None and self.session is not None:
            self._send(self.session.miss())

    def _accept(self) -> None:
        with contextlib.suppress(BlockingIOError, ConnectionError):
            peer, (_, port) = self.sock.accept()
            if self.peer is not None:
                peer.close()
                self.turned_away += 1
                if self.turned_away == 1:
                    self._say(
                        f"a second PX4 (from port {port}) is turned away while one flies; "
                        "its instance N looks on port 4560 + N: heli px4 --port"
                    )
                return
            peer.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            # Who does not read has half a second; a HIL_SENSOR in flight is all there is.
            peer.settimeout(PATIENCE_NS / NS_PER_S)
            again = bool(self.sessions)
            self._say(
                f"PX4 has connected {'again ' if again else ''}from port {port}"
                f"{': the aircraft stands at its start' if again else ''}"
            )
            self.sessions.append(self._start())
            self.sessions[-1].flight.begun_ns = time.monotonic_ns()
            self.peer = peer
            self._selector.register(peer, selectors.EVENT_READ)
            self._send(self.sessions[-1].begin())

    def _hear(self) -> None:
        assert self.peer is not None and self.session is not None
        try:
            data = self.peer.recv(MOST_BYTES)
        except OSError:
            data = b""
        if not data:
            self._say("PX4 has gone: the flight is over; one that comes back begins another")
            self.drop()
            return
        self.session.flight.newest_ns = time.monotonic_ns()
        self._send(self.session.hear(data))

    def _send(self, data: bytes) -> None:
        if not data or self.peer is None:
            return
        try:
            self.peer.sendall(data)
        except OSError:
            self._say("PX4 does not read what is sent, or has gone: the flight is over")
            self.drop()

    def drop(self) -> None:
        """End the connection and its record."""
        if self.peer is not None:
            self._selector.unregister(self.peer)
            self.peer.close()
            self.peer = None
        if self.session is not None:
            self.session.close()

    def close(self) -> None:
        """End what is under way."""
        self.drop()
        self._selector.close()


def serve(door: Px4Door, step_ns: int, say: Callable[[str], None]) -> None:
    """Answer until the flight has its length, or Ctrl-C; a line a second.

    Until PX4 answers HIL_SENSOR goes out at the pace of the wall clock, as PX4 starts by
    that clock; then one for each answer.
    """
    begun_ns = newest_ns = time.monotonic_ns()
    due_ns, flown_s = begun_ns + _LINE_NS, 0.0
    while not door.done:
        session = door.session
        started = session is not None and session.flight.heard
        patience_ns = PATIENCE_NS if started else step_ns
        now_ns = time.monotonic_ns()
        if now_ns >= due_ns:
            interrupts.check()
            due_ns = now_ns + _LINE_NS
            if session is not None and door.peer is not None:
                session.flush()
                say(line(session, session.flight.flown_s - flown_s))
                flown_s = session.flight.flown_s
        wait_ns = due_ns - now_ns
        if door.peer is not None:
            wait_ns = min(wait_ns, newest_ns + patience_ns - now_ns)
        if door.turn(max(wait_ns, 0) / NS_PER_S):
            newest_ns = time.monotonic_ns()
        elif time.monotonic_ns() - newest_ns >= patience_ns:
            door.miss()
            newest_ns = time.monotonic_ns()


def line(session: Px4Session, pace: float) -> str:
    """The terminal's line of a flight; pace: times real time."""
    flight = session.flight
    told = flight.physics.told
    _, qx, qy, _ = told[REPLY.quat]
    tilt = np.degrees(np.arccos(np.clip(1.0 - 2.0 * (qx * qx + qy * qy), -1.0, 1.0)))
    servos = " ".join(f"{value:+.2f}" for value in session.servos[USED])
    return (
        f"{flight.flown_s:.1f} s  {'armed' if session.armed else 'disarmed'}  height "
        f"{-told[REPLY.pos][2]:.2f} m  tilt {tilt:.1f} deg  outputs {servos}  answers "
        f"{flight.answers}  unanswered {flight.unanswered}  refused {flight.refused.total()}  "
        f"{max(pace, 0.0):.2f} times real time"
    )


def fly(order: Px4Order, out: Console) -> list[FinishedFlight]:
    """Wait for PX4, be flown, write what was flown; empty if PX4 never came.

    Raises
    ------
    ParameterError, TrimError, AircraftError, PlantConfigError, OSError, MissingFileError
        Bad input; nothing has been written.
    """

    def say(words: str) -> None:
        out.print(words, highlight=False, soft_wrap=True, markup=False)

    refuse_existing(order.out)
    settings = order.resolved()
    rate, servos = Rate.at_least(order.rate_hz), servo_numbers(helicopter_of(settings))
    folder = order.out or free_name(settings)

    def start() -> Px4Session:
        count = len(door.sessions) + 1
        place = folder if count == 1 else folder.with_name(f"{folder.name}-{count}")
        physics = Physics(settings, rate, servos)
        watch = None if shown is None else shown.watch
        flight = Px4Flight(physics, FlightFolder(place, settings, rate), watch=watch)
        longest_s = settings.scenario_parameters["duration_s"]
        return Px4Session(flight, SensorTelemetry(settings, physics), say, longest_s)

    with contextlib.ExitStack() as sockets:
        sock = sockets.enter_context(contextlib.closing(listening(order.port)))
        shown = live.opened(order.live, settings, say)
        if shown is not None:
            sockets.callback(shown.close)
        if not is_compiled(physics_kernels.step):
            say(COMPILES)
        Physics(settings, rate, servos)
        door = Px4Door(sock, start, say)
        say(f"waits for PX4 on tcp {HOST}:{sock.getsockname()[1]}: PX4's simulator_mavlink")
        # Compiled code may have dropped one.
        interrupts.check()
        with contextlib.suppress(KeyboardInterrupt):
            serve(door, rate.tick_ns, say)
        door.close()
    done = []
    for one in door.sessions:
        done += _written(order, settings, one, out)
    if done:
        live.stay(shown, done[-1].folder, say)
    return done


def _written(
    order: Px4Order, settings: Settings, session: Px4Session, out: Console
) -> list[FinishedFlight]:
    """Result and report of a flight; none of one that ended before its first tick."""
    flight = session.flight
    counted = {
        "answers": flight.answers, "unanswered": flight.unanswered,
        "refused": {cause.name.lower(): count for cause, count in flight.refused.items()},
    }  # fmt: skip
    return written(
        flight, counted, lambda length_s: order.resolved(settings.seed, length_s), order.report, out
    )
