# SPDX-License-Identifier: Apache-2.0
"""Objects that fly in place of the compiled parts of the one-process loop, or beside them.

Each has `reset` and `step`; the protocols here say what these get and give. Rows are NumPy arrays
whose places stand in `heli_core.rows`: `MEAS` (31,), `TRUTH` (19,), `NAV` (31,), `ACTUATOR` (4,).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from heli_core.errors import PartError
from heli_core.python_controller import LawError, PythonLaw
from heli_dynamics_sim.linear_aircraft import PARAMETER as LINEAR
from heli_dynamics_sim.linear_plant import LinearPlant

Nodes = Mapping[str, Mapping[str, Any]]


class Plant(Protocol):
    """An aircraft with its sensors, in place of the simulated one.

    It may have a `status`, a `PlantStatus`: other than OK, the flight ends there as lost.
    """

    def reset(self, rng: np.random.Generator, tick_s: float, nodes: Nodes) -> None:
        """Begin a flight.

        Parameters
        ----------
        rng : numpy.random.Generator
            Its own, of the flight's seed.
        tick_s : float
        nodes : mapping
            Parameters of each node, by dotted name.
        """

    def measure(self, tick: int, y: NDArray[np.float64], truth: NDArray[np.float64]) -> None:
        """Fill the measurement row y (31,), places of `MEAS`, and the truth (19,), of `TRUTH`."""

    def step(self, tick: int, u: NDArray[np.float64]) -> None:
        """Go on to the next tick with the actuators u (4,), places of `ACTUATOR`, -1..1."""


class Wind(Protocol):
    """The air around the simulated aircraft, in place of the packaged wind."""

    def reset(self, rng: np.random.Generator, tick_s: float, nodes: Nodes) -> None:
        """Begin a flight; as of `Plant`."""

    def step(self, tick: int, time_s: float, pos_ned_m: NDArray[np.float64]) -> ArrayLike:
        """Velocity of the air (3,), NED, m/s, that the whole aircraft is in."""


class Sensor(Protocol):
    """A sensor besides the packaged ones, or what spoils one of them."""

    def reset(self, rng: np.random.Generator, tick_s: float, nodes: Nodes) -> None:
        """Begin a flight; as of `Plant`."""

    def step(
        self, tick: int, time_s: float, truth: NDArray[np.float64], y: NDArray[np.float64]
    ) -> ArrayLike | None:
        """Measure: what it says, for the estimator that is given; None: nothing at this tick.

        truth (19,): places of `TRUTH`, a copy. y (31,): places of `MEAS`; a sensor that spoils one
        of the packaged ones changes it in place.
        """


class Estimator(Protocol):
    """Sensors to navigation, in place of the observer."""

    def reset(self, rng: np.random.Generator, tick_s: float, nodes: Nodes) -> None:
        """Begin a flight; as of `Plant`."""

    def step(
        self,
        tick: int,
        time_s: float,
        y: NDArray[np.float64],
        u: NDArray[np.float64],
        readings: Mapping[str, NDArray[np.float64]],
    ) -> ArrayLike:
        """The navigation row (31,), places of `NAV`; while the attitude is NaN it is not known.

        y (31,): measurement row. u (4,): last actuators. readings: what the sensors that are given
        say at this tick, by the name of their class.
        """


@dataclass(frozen=True, kw_only=True)
class Parts:
    """Objects that fly in place of the compiled parts; None: the compiled one.

    Attributes
    ----------
    plant, wind, sensors, estimator : objects
        With `reset` and `step`, as their protocols say.
    controllers : sequence of PythonLaw
        At most one of each loop.
    """

    plant: Plant | None = None
    wind: Wind | None = None
    sensors: Sequence[Sensor] = ()
    estimator: Estimator | None = None
    controllers: Sequence[PythonLaw] = ()

    def __post_init__(self) -> None:
        if self.plant is not None and self.wind is not None:
            raise PartError("wind: a plant that is given has its own air; give one of them", "wind")
        if len({law.loop for law in self.controllers}) < len(self.controllers):
            raise LawError("law: two of one loop are given; allowed: one of each")
        kinds = [type(sensor).__name__ for sensor in self.sensors]
        if len(set(kinds)) < len(kinds):
            raise PartError(
                f"sensors: {', '.join(kinds)}: two have one name; allowed: each of a class of its "
                "own, whose name the estimator reads it by",
                "sensors",
            )
        for name, part in self.named():
            wanted = ("reset", "step", "measure") if name == "plant" else ("reset", "step")
            for method in wanted:
                if not callable(getattr(part, method, None)):
                    argument = "sensors" if name == "sensor" else name
                    raise PartError(
                        f"{argument}: {type(part).__name__} has no {method}; allowed: an object "
                        f"with {', '.join(wanted)}",
                        argument,
                    )

    def named(self) -> list[tuple[str, Any]]:
        """Those that are given, but for the controllers, by the word for each."""
        slots: list[tuple[str, Any]] = [
            ("plant", self.plant),
            ("wind", self.wind),
            ("estimator", self.estimator),
        ]
        slots += [("sensor", sensor) for sensor in self.sensors]
        return [(name, part) for name, part in slots if part is not None]

    def __bool__(self) -> bool:
        return bool(self.named() or self.controllers)


def with_linear(parts: Parts, nodes: Nodes) -> Parts:
    """The parts, and the linear aircraft that the parameters name where no plant is given.

    Raises
    ------
    AircraftError, PlantConfigError, PartError
    """
    if parts.plant is not None:
        return parts
    plant = LinearPlant.of_parameters(nodes["plant"])
    return parts if plant is None else replace(parts, plant=plant)


def without_linear(nodes: Nodes) -> dict[str, Any]:
    """The parameters for the compiled loop, which a linear aircraft is no plant of."""
    return {**nodes, "plant": {**nodes["plant"], LINEAR: ""}}
