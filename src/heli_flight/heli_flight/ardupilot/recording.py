# SPDX-License-Identifier: Apache-2.0
"""A flight of another autopilot as a folder: params.yaml, a bag at 100 Hz of what the plant
knows, and after it result.json and the report, as every flight has them.

What it estimates is not in its protocol: there is no `odom`, and nothing to score by it.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_bags.writer import BagRecorder
from heli_core.rows import JOINTS, PLANT
from heli_core.ticks import TICK_NS, Rate, stamp_at
from heli_dynamics_sim.config import message_variances
from heli_flight.ardupilot.physics import STEP
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
        self._joints = np.zeros(JOINTS.size)
        self._bag = BagRecorder(folder / "bag", _TOPICS, start_ns=self._start_ns)
        self.ticks = 0

    def write(self, step: int, row: NDArray[np.float64]) -> None:
        """Record what was at a step (a `StepRow`), if it is one of a whole tick."""
        tick, rest = divmod(step, self._rate.fold)
        if rest:
            return
        x = row[STEP.plant]
        self._joints[:] = x[_JOINTS]
        parts = (row[STEP.imu], x, row[STEP.wind], self._joints, row[STEP.u])
        stamp_ns = self._start_ns + tick * TICK_NS
        for name, part in zip(_TOPICS, parts, strict=True):
            self._bag.write(name, bytes(self._encoders[name].encode(part, stamp_ns)))
        self.ticks = tick + 1

    def flush(self) -> None:
        """Have what is recorded outlive this process."""
        self._bag.flush()

    def close(self) -> None:
        """Have the bag open everywhere."""
        self._bag.close()


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
