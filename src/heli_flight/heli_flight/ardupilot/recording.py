# SPDX-License-Identifier: Apache-2.0
"""A flight of another autopilot as a folder: params.yaml, a bag at 100 Hz of what the plant
knows, and after it result.json and the report, as every flight has them.

What it estimates is not in its protocol: there is no `odom`, and nothing to score by it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_bags.writer import BagError, BagRecorder
from heli_core.rows import PLANT
from heli_core.ticks import NS_PER_S, TICK_NS, Rate, stamp_at
from heli_dynamics_sim.config import message_variances
from heli_dynamics_sim.plant import PlantStatus
from heli_flight.ardupilot.physics import STEP, Physics
from heli_flight.flight_file import NAME, write_parameters
from heli_flight.report.write import RecordedFlight, recorded
from heli_flight.result import write_result
from heli_flight.settings import Settings
from heli_msgs_bridge import topics
from heli_msgs_bridge.messages import Encoder

_TOPICS = (
    topics.IMU, topics.TRUTH_ODOM, topics.TRUTH_WIND, topics.TRUTH_ROTOR, topics.ACTUATORS,
)  # fmt: skip
_JOINTS = np.r_[PLANT.rotor, PLANT.servo]


def rows_of(row: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """What was at a step (a `StepRow`), by the topic that tells it."""
    x = row[STEP.plant]
    parts = (row[STEP.imu], x, row[STEP.wind], x[_JOINTS], row[STEP.u])
    return dict(zip(_TOPICS, parts, strict=True))


class FlightFolder:
    """A folder that is being filled while another autopilot flies.

    Parameters
    ----------
    folder : Path
        Must not exist.
    settings : Settings
    rate : Rate
        Of the plant's steps, of which every one of a whole tick of 10 ms is recorded.

    Raises
    ------
    OSError, BagError, ParameterError
        It exists, or cannot be written.
    """

    def __init__(self, folder: Path, settings: Settings, rate: Rate) -> None:
        folder.mkdir(parents=True)
        self.path, self.settings, self._rate = folder, settings, rate
        self._start_ns = stamp_at(settings.nodes["plant"]["start_time_s"])
        write_parameters(settings, folder / NAME)
        variances = message_variances(settings.nodes["plant"])["imu"]
        self._encoders = {
            name: Encoder(name, variances if name == topics.IMU else ()) for name in _TOPICS
        }
        self._bag = BagRecorder(folder / "bag", _TOPICS, start_ns=self._start_ns)
        self.ticks = 0

    def write(self, step: int, row: NDArray[np.float64]) -> None:
        """Record what was at a step (a `StepRow`), if it is one of a whole tick."""
        tick, rest = divmod(step, self._rate.fold)
        if rest:
            return
        stamp_ns = self._start_ns + tick * TICK_NS
        for name, part in rows_of(row).items():
            self._bag.write(name, bytes(self._encoders[name].encode(part, stamp_ns)))
        self.ticks = tick + 1

    def flush(self) -> None:
        """Have what is recorded outlive this process."""
        self._bag.flush()

    def close(self) -> None:
        """Have the bag open everywhere."""
        self._bag.close()


@dataclass
class FlightUnderWay:
    """A flight of another autopilot, under way or ended.

    Attributes
    ----------
    physics : Physics
    folder : FlightFolder or None
        None: nothing is recorded.
    begun_ns, newest_ns : int
        Wall time of its beginning and of what was heard last, of a clock that only goes on.
    watch : callable or None
        Given the physics after each step; must not wait.
    notes : list of str
        What the reader should know, each said once.
    """

    physics: Physics
    folder: FlightFolder | None
    begun_ns: int = 0
    newest_ns: int = 0
    watch: Callable[[Physics], None] | None = None
    notes: list[str] = field(default_factory=list)

    @property
    def flown_s(self) -> float:
        """Flight time."""
        return self.physics.rate.time_ns(self.physics.tick) / NS_PER_S

    @property
    def loss(self) -> str:
        """Why the helicopter was lost, one sentence; empty if it was not."""
        status = self.physics.status
        return "" if status == PlantStatus.OK else status.sentence

    def keep(self, tell: Callable[[str, str], None]) -> None:
        """Record and show the step that was made; `tell` takes a kind and a sentence."""
        physics = self.physics
        if self.watch is not None:
            self.watch(physics)
        if self.loss:
            tell("lost", f"LOST after {self.flown_s:.2f} s: {self.loss}")
        elif self.folder is not None:
            try:
                self.folder.write(physics.tick - 1, physics.row)
            except BagError as error:
                tell("bag", str(error))
                self.folder = None

    def flush(self, tell: Callable[[str, str], None]) -> None:
        """Have what is recorded so far outlive this process."""
        if self.folder is not None:
            try:
                self.folder.flush()
            except BagError as error:
                tell("bag", str(error))
                self.folder = None

    def close(self, tell: Callable[[str, str], None]) -> None:
        """Close the bag; what is in the folder stays a flight."""
        if self.folder is not None:
            try:
                self.folder.close()
            except BagError as error:
                tell("bag", str(error))


@dataclass(frozen=True)
class FlightFacts:
    """What is known of a flight besides its record.

    Attributes
    ----------
    lost : str
        Why the helicopter was lost, one sentence; empty if it was not.
    wall_s : float
    notes : sequence of str
    numbers : mapping
        Frames, lost ones and what else was counted, for result.json.
    """

    lost: str
    wall_s: float
    notes: tuple[str, ...] = ()
    numbers: Mapping[str, Any] = field(default_factory=dict)


def finished(folder: FlightFolder, settings: Settings, facts: FlightFacts) -> RecordedFlight:
    """Write what a flight leaves when it has ended; settings: of the length that was flown.

    Raises
    ------
    OSError, FlightError, ParameterError
    """
    folder.close()
    write_parameters(settings, folder.path / NAME)
    flight = recorded(folder.path)
    result = replace(flight.result, lost=facts.lost, wall_s=facts.wall_s, notes=facts.notes)
    extra = {"mode": settings.mode, settings.mode: dict(facts.numbers)}
    write_result(result, settings, folder.path, extra)
    return replace(flight, result=result)
