# SPDX-License-Identifier: Apache-2.0
"""Vehicles on UDP ports of this machine that wait for ArduPilot, from order to folders."""

import contextlib
import selectors
import socket
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rich.console import Console

from heli_core.jit import is_compiled
from heli_core.rcl_yaml import ParameterError
from heli_core.ticks import NS_PER_S, Rate
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_flight import interrupts
from heli_flight.ardupilot import live
from heli_flight.ardupilot import physics as physics_kernels
from heli_flight.ardupilot.physics import Physics
from heli_flight.ardupilot.protocol import PORT, PORT_STEP
from heli_flight.ardupilot.recording import (
    FlightFacts,
    FlightFolder,
    FlightUnderWay,
    finished,
)
from heli_flight.ardupilot.servos import ServoNumbers, parameters, read_file, servo_numbers
from heli_flight.ardupilot.session import Flown, Meter, Vehicle
from heli_flight.flight_file import read_faults
from heli_flight.fly import FinishedFlight, UnwrittenFlight, free_name, report_of_flight
from heli_flight.graph.live import LiveOrder
from heli_flight.layers import ARDUPILOT, AUTOPILOTS, section_of
from heli_flight.result import print_table
from heli_flight.settings import MOST_AIRCRAFT, Settings, resolve, seed_of
from heli_flight.terminal import refuse_existing

HOST = "127.0.0.1"
SCENARIO = "by_hand"
"""What is flown where neither option nor file says: on the skids, in the hover test's wind."""
LONGEST_S = 3600.0
_LINE_NS = NS_PER_S
_MOST_BYTES = 2048
_WARM_HZ = 1200
_REACHES = ("imu", "accel", "gyro")
"""Sensors whose faults ArduPilot can feel, and only if it is told what the IMU measures."""


@dataclass(frozen=True)
class ArduPilotOrder:
    """What is asked for; None: what the parameter files say, else the packaged default.

    Attributes
    ----------
    aircraft : str, optional
        Name of a packaged aircraft, or a file.
    swashplate : str
        Name in `servos.SWASHPLATES`.
    parm : Path, optional
        ArduPilot's own parameters, as far as they say how its servos move.
    measured : bool
        Whether ArduPilot is told what our IMU measures, else what is.
    port : int
        Of the first vehicle; 0: any free one.
    vehicles : int
    world : str, optional
    seed : int, optional
    duration_s : float, optional
        Flight time after which it ends.
    params : sequence of Path
    faults : Path, optional
    out : Path, optional
        Folder to make.
    report : bool
    live : LiveOrder, optional
        That the flight is to be shown; of one vehicle only.
    """

    aircraft: str | None = None
    swashplate: str = "H3_120"
    parm: Path | None = None
    measured: bool = False
    port: int = PORT
    vehicles: int = 1
    world: str | None = None
    seed: int | None = None
    duration_s: float | None = None
    params: Sequence[Path] = ()
    faults: Path | None = None
    out: Path | None = None
    report: bool = True
    live: LiveOrder | None = None

    def resolved(self, seed: int | None = None, duration_s: float | None = None) -> Settings:
        """What is flown, or with another seed and length; raises ParameterError."""
        settings = plant_alone(
            ARDUPILOT, self.aircraft, self.params, self.faults, world=self.world,
            seed=self.seed if seed is None else seed,
            duration_s=self.duration_s if duration_s is None else duration_s,
        )  # fmt: skip
        _refuse_unfelt(settings, self.measured)
        return settings

    def servos(self, settings: Settings) -> ServoNumbers:
        """How ArduPilot's servos are to be read; raises ParameterError."""
        helicopter = helicopter_of(settings)
        values = dict(parameters(helicopter, self.swashplate))
        if self.parm is not None:
            values |= read_file(self.parm)
        try:
            return servo_numbers(values, helicopter)
        except ParameterError as error:
            raise ParameterError(f"{self.parm or '--swash'}: {error}") from None


def plant_alone(
    mode: str,
    aircraft: str | None,
    params: Sequence[Path],
    faults: Path | None,
    *,
    world: str | None,
    seed: int | None,
    duration_s: float | None,
    gps: str | None = None,
) -> Settings:
    """What another autopilot flies: it stands on the ground unless a file says otherwise.

    Parameters
    ----------
    mode : str
        One of `layers.AUTOPILOTS`.
    aircraft : str, optional
        Name of a packaged aircraft, or a file.
    params, faults, world, seed, duration_s, gps
        As of a flight; None: what the files say, else the packaged default.

    Raises
    ------
    ParameterError
    """
    read = read_faults(faults)
    over: dict[str, dict[str, Any]] = {n: dict(v) for n, v in (read.nodes or {}).items()}
    # Its controls are the autopilot's from the first command on.
    over.setdefault("plant", {})["initial.pilot_ticks"] = 0
    if aircraft is not None:
        over["plant"]["aircraft_file"] = _aircraft_file(aircraft)
    known = "scenario" in section_of(params)
    if duration_s is None and not known:
        duration_s = LONGEST_S
    return resolve(
        None if known else SCENARIO, gps, seed, duration_s, mode, params, over, world=world,
        process_faults=read.process,
    )  # fmt: skip


def _aircraft_file(name: str) -> str:
    return name if Path(name).suffix in (".yaml", ".yml") else f"{name}.yaml"


def _refuse_unfelt(settings: Settings, measured: bool) -> None:
    """Raise ParameterError for a fault of a sensor that ArduPilot does not hear of."""
    from heli_core.faults import faults_of
    from heli_dynamics_sim.faults import SENSORS

    for fault in faults_of(settings.nodes["plant"]["faults"]):
        if fault.what in SENSORS and not (measured and fault.what in _REACHES):
            allowed = "faults of actuators, engine and air"
            allowed += ", of imu, accel, gyro" + ("" if measured else " with --imu measured")
            raise ParameterError(
                f"faults: {fault.what}: ArduPilot has a {fault.what} of its own and does not hear "
                f"of this; allowed: {allowed}"
            )


def helicopter_of(settings: Settings) -> HelicopterParameters:
    """The aircraft of a flight as its file has it: what ArduPilot's parameters are made for."""
    return HelicopterParameters.from_yaml(settings.nodes["plant"]["aircraft_file"])


# -------------------------------------------------------------------------------------------------
# Sockets.
# -------------------------------------------------------------------------------------------------


def bound(port: int) -> socket.socket:
    """A UDP socket of this machine alone.

    Raises
    ------
    ParameterError
        Another program has the port, or it is not allowed.
    """
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        sock.bind((HOST, port))
    except (OSError, OverflowError) as error:
        sock.close()
        why = error.strerror if isinstance(error, OSError) else str(error)
        raise ParameterError(
            f"--port {port}: UDP {HOST}:{port} cannot be had: {why}; end the program that has it "
            "(another heli ardupilot?), or name another and give it to ArduPilot by --sim-port-out"
        ) from None
    sock.setblocking(False)
    return sock


@dataclass
class Door:
    """A vehicle at its port."""

    name: str
    sock: socket.socket
    vehicle: Vehicle
    meter: Meter = field(init=False)

    def __post_init__(self) -> None:
        self.meter = Meter(self.vehicle)

    def serve(self) -> None:
        """Answer one packet."""
        try:
            data, sender = self.sock.recvfrom(_MOST_BYTES)
        except (BlockingIOError, ConnectionError):
            return
        text = self.vehicle.answer(data, sender, time.monotonic_ns())
        if text is not None:
            with contextlib.suppress(OSError):  # who has gone meanwhile needs no answer
                self.sock.sendto(text, sender)


def serve(doors: Sequence[Door], say: Callable[[str], None]) -> None:
    """Answer until all flights have their length, or Ctrl-C; a line of each vehicle a second."""
    due_ns = time.monotonic_ns() + _LINE_NS
    with selectors.DefaultSelector() as selector:
        for door in doors:
            selector.register(door.sock, selectors.EVENT_READ, door)
        while not all(door.vehicle.done for door in doors):
            now_ns = time.monotonic_ns()
            if now_ns >= due_ns:
                interrupts.check()
                due_ns = now_ns + _LINE_NS
                for door in doors:
                    door.vehicle.flush()
                    if line := door.meter.line(now_ns):
                        say(f"{door.name}: {line}" if len(doors) > 1 else line)
            for key, _ in selector.select((due_ns - now_ns) / NS_PER_S):
                key.data.serve()


# -------------------------------------------------------------------------------------------------
# From order to folders.
# -------------------------------------------------------------------------------------------------

COMPILES = "heli: compiles the plant's step for this machine: once, some 10 to 40 seconds"


def fly(order: ArduPilotOrder, out: Console) -> list[FinishedFlight]:
    """Wait for ArduPilot, be flown, write what was flown.

    Parameters
    ----------
    order : ArduPilotOrder
    out : Console

    Returns
    -------
    list of FinishedFlight
        Empty if ArduPilot never came.

    Raises
    ------
    ParameterError, TrimError, AircraftError, PlantConfigError, OSError, MissingFileError
        Bad input; nothing has been written.
    """

    def say(line: str) -> None:
        out.print(line, highlight=False, soft_wrap=True, markup=False)

    if order.live and order.vehicles > 1:
        raise ParameterError("--live: shows one aircraft; it does not go with --vehicles")
    if not 1 <= order.vehicles <= MOST_AIRCRAFT:
        raise ParameterError(f"--vehicles {order.vehicles}: allowed are 1 to {MOST_AIRCRAFT}")
    refuse_existing(order.out)
    base = order.resolved()
    several = order.vehicles > 1
    settings = [base] if not several else [
        order.resolved(seed_of(base.seed, i)) for i in range(order.vehicles)
    ]  # fmt: skip
    servos = order.servos(base)
    folder = order.out or free_name(base)
    names = [f"heli{i + 1}" for i in range(order.vehicles)]
    with contextlib.ExitStack() as sockets:
        socks = [
            sockets.enter_context(
                contextlib.closing(bound(order.port and order.port + PORT_STEP * i))
            )
            for i in range(order.vehicles)
        ]
        if not is_compiled(physics_kernels.step):
            say(COMPILES)
        shown = live.opened(order.live, base, say)
        if shown is not None:
            sockets.callback(shown.close)
        for one in settings:
            Physics(one, Rate.at_least(_WARM_HZ), servos, order.measured)
        doors = [
            Door(name, sock, Vehicle(
                _flights(one, servos, order.measured, folder / name if several else folder),
                _named(say, name) if several else say,
                one.scenario_parameters["duration_s"],
                None if shown is None else shown.watch,
            ))
            for name, sock, one in zip(names, socks, settings, strict=True)
        ]  # fmt: skip
        for door in doors:
            port = door.sock.getsockname()[1]
            say(f"waits for ArduPilot on udp {HOST}:{port}: arducopter-heli --model JSON:{HOST}")
        # Compiled code may have dropped one.
        interrupts.check()
        with contextlib.suppress(KeyboardInterrupt):
            serve(doors, say)
    done = []
    for door, one in zip(doors, settings, strict=True):
        door.vehicle.close()
        for flight in door.vehicle.flights:
            done += _written(order, one, flight, out)
    if done:
        live.stay(shown, done[-1].folder, say)
    return done


def _named(say: Callable[[str], None], name: str) -> Callable[[str], None]:
    return lambda line: say(f"{name}: {line}")


def _flights(
    settings: Settings, servos: ServoNumbers, measured: bool, folder: Path
) -> Callable[[Rate], tuple[Physics, FlightFolder]]:
    """What begins the flights of a vehicle: the first in `folder`, others in folder-2, ..."""
    count = 0

    def begin(rate: Rate) -> tuple[Physics, FlightFolder]:
        nonlocal count
        count += 1
        place = folder if count == 1 else folder.with_name(f"{folder.name}-{count}")
        return Physics(settings, rate, servos, measured), FlightFolder(place, settings, rate)

    return begin


def _written(
    order: ArduPilotOrder, settings: Settings, flight: Flown, out: Console
) -> list[FinishedFlight]:
    """Result and report of a flight; none of one that ended before its first tick."""
    counted = {
        "frames": flight.physics.tick, "lost": flight.lost, "repeated": flight.repeated,
        "refused": {cause.name.lower(): count for cause, count in flight.refused.items()},
    }  # fmt: skip
    return written(
        flight, counted, lambda length_s: order.resolved(settings.seed, length_s), order.report, out
    )


def written(
    flight: FlightUnderWay,
    counted: Mapping[str, Any],
    resolved: Callable[[float], Settings],
    report: bool,
    out: Console,
) -> list[FinishedFlight]:
    """Result and report of a flight that has ended; none if it has before its first tick.

    Parameters
    ----------
    flight : FlightUnderWay
    counted : mapping
        What was counted in it, for result.json.
    resolved : callable
        Gives its settings for the length that was flown, s.
    report : bool
    out : Console
    """
    folder, rate = flight.folder, flight.physics.rate
    if folder is None or not folder.ticks:
        return []

    def say(line: str) -> None:
        out.print(line, highlight=False, soft_wrap=True, markup=False)

    seconds = folder.ticks * rate.fold * rate.tick_s
    flown = resolved(max(seconds, 0.04))
    wall_s = max(flight.newest_ns - flight.begun_ns, 0) / NS_PER_S
    numbers = {"steps_per_s": rate.hz, **counted}
    done = finished(folder, flown, FlightFacts(flight.loss, wall_s, tuple(flight.notes), numbers))
    print_table(done.result, flown, out)
    if report:
        unwritten = UnwrittenFlight(done.result, {"mode": flown.mode}, done.record, done.remarks)
        report_of_flight(unwritten, flown, folder.path, say, False)
    by = AUTOPILOTS[flown.mode]
    say(f"{seconds:.2f} s flown by {by} at {rate.hz} Hz in {wall_s:.2f} s")
    say(f"written: {folder.path}")
    return [FinishedFlight(flown, done.result, folder.path)]
