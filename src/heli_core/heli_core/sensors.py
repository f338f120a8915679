# SPDX-License-Identifier: Apache-2.0
"""The sensors that say one sample in one message, every so many ticks: one row each.

Whatever else names such a sensor follows from its row: its places among measurements and random
numbers, its topic, message and link, its faults, its parameters, what the observer keeps and counts
of it. What a row cannot say stands in two places: what the sensor measures in
`heli_dynamics_sim.sensors.true_sample`, how it is fused in `heli_observer.ekf.fuse_aid`. A GPS
receiver and an IMU say more than one thing, and are no rows.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

OBSERVER = "observer"


@dataclass(frozen=True)
class SampledSensor:
    """What is known of a sensor wherever it is named.

    Attributes
    ----------
    name : str
        Of its parameters, faults and counters.
    words : str
        For people.
    topic, message : str
        Of its samples; the message as `package/msg/Name`.
    frame : str
        Of the header.
    axes : str
        What the numbers are: "body" or "ned" for a vector of three (FLU, ENU in the message),
        "each" for numbers that no axis turns.
    unit, suffix : str
        SI; as it ends the names of parameters.
    quantity : str
        What its noise spoils, in words.
    period_ticks : int
        Of the packaged parameters.
    most_noise : float
        Upper bound of the noise that a parameter may give it.
    heard_by : str
        Node that hears it; `OBSERVER`: it is fused.
    fault : float
        An offset to begin the form of a fault with.
    numbers : int
        Of a sample.
    above : float
        A number that is not above it says nothing.
    """

    name: str
    words: str
    topic: str
    message: str
    frame: str
    axes: str
    unit: str
    suffix: str
    quantity: str
    period_ticks: int
    most_noise: float
    heard_by: str
    fault: float
    numbers: int = 1
    above: float = -math.inf


MAG = SampledSensor(
    "mag", "magnetometer", "imu/mag", "sensor_msgs/msg/MagneticField", "imu_link",
    "body", "T", "t", "field", 2, 1e-3, OBSERVER, 1e-5, numbers=3,
)  # fmt: skip
BARO = SampledSensor(
    "baro", "barometer", "baro", "sensor_msgs/msg/FluidPressure", "base_link",
    "each", "Pa", "pa", "pressure", 5, 1e4, OBSERVER, 50.0, above=0.0,
)  # fmt: skip
ROTOR_SPEED = SampledSensor(
    "rotor_speed", "rotor speed sensor", "rotor_speed", "sensor_msgs/msg/JointState", "base_link",
    "each", "rad/s", "radps", "rotor speed", 2, 10.0, "outer_loop", -20.0,
)  # fmt: skip

PLAIN: tuple[SampledSensor, ...] = (ROTOR_SPEED,)
"""Those whose errors are white noise and whole steps. A new one comes last: the others then keep
their places and random numbers, and with them every flight that has been flown."""
SENSORS: tuple[SampledSensor, ...] = (MAG, BARO, *PLAIN)
AIDS: tuple[SampledSensor, ...] = tuple(row for row in SENSORS if row.heard_by == OBSERVER)
"""Those that the observer fuses, beside the fixes of a GPS."""


def place_of(name: str, rows: tuple[SampledSensor, ...]) -> int:
    """Place of a sensor in `PLAIN`, `SENSORS` or `AIDS`."""
    return [row.name for row in rows].index(name)


# -------------------------------------------------------------------------------------------------
# Places: of magnetometer and barometer among those of IMU and GPS, of the others one after another.
# -------------------------------------------------------------------------------------------------


class SensorPlaces(NamedTuple):
    """Where a sensor stands in a measurement row (`rows.MEAS`) and a row of normals (`NOISE`)."""

    first: int  # of its numbers
    numbers: int
    valid: int  # flag: 1.0 if a sample arrived at this tick
    white: int  # first of its normals
    fault: int  # first of those of its faults, for each number
    lost: int  # of the one that decides whether a fault loses the sample


FREE_MEASUREMENT, FREE_NORMAL = 26, 86
"""First places in a measurement row and in a row of normals that these sensors share out."""


def _shared_out() -> tuple[dict[str, SensorPlaces], int, int]:
    places = {
        MAG.name: SensorPlaces(6, MAG.numbers, 16, white=17, fault=51, lost=64),
        BARO.name: SensorPlaces(9, BARO.numbers, 17, white=20, fault=54, lost=65),
    }
    first, normal = FREE_MEASUREMENT, FREE_NORMAL
    for row in PLAIN:
        n = row.numbers
        places[row.name] = SensorPlaces(first, n, first + n, normal, normal + n, normal + 2 * n)
        first, normal = first + n + 1, normal + 2 * n + 1
    return places, first, normal


PLACES, SENSED, NORMALS = _shared_out()
"""By name; length of what all sensors say; of the normals of a tick."""
