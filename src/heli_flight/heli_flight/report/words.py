# SPDX-License-Identifier: Apache-2.0
"""What a flight's simulation holds and what it leaves out, by its parameters: in every report."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from heli_math.ticks import Rate

_ALWAYS = (
    "Rigid body with six degrees of freedom, attitude as a quaternion, eq. (1) to (5).",
    "Main rotor with inflow and first-order flapping, eq. (6), (7); tail rotor, fuselage, fins.",
    "Yaw-rate gyro, eq. (8); servos of second order with limits of rate and travel; transport "
    "delay of the commands.",
    "Wind: mean over height, MIL-F-8785C Dryden turbulence, discrete gusts.",
    "IMU, magnetometer and barometer with noise and bias; GPS with noise, slow drift and latency.",
)
_NEVER = (
    "Blade dynamics beyond first-order flapping; the main rotor's wake on the tail rotor.",
    "Turbulence that decays in time as well as in space; wind that turns with height. MIL-F-8785C "
    "is made for forward flight; in hover it is a convention.",
    "Lever arms of the sensors.",
    "A real flight: the paper's numbers are from flight, all of this is computed.",
)
# Simulated where one of the parameters is not zero; else left out.
_BY_PARAMETER = (
    (("terms.flap_back",), "Flap-back: the disc tilts away from the air that moves across it."),
    (("terms.inflow",), "Dynamic inflow of the main rotor, three states."),
    (("terms.ground_effect",), "Ground effect."),
    (("terms.vortex_ring",), "Vortex-ring state in steep descent, as measured."),
    (("terms.rotor_speed",), "Rotor speed, engine and governor; without it the speed is constant."),
    (("terms.tail_authority",), "Stops and stall of the tail rotor."),
    (("terms.fuel",), "Fuel burnt, and the mass that goes with it."),
    (
        ("terms.servo_resolution", "terms.servo_dead_band", "terms.servo_load"),
        "Servos with steps, a dead band, and a rate that falls under load.",
    ),
    (
        ("wind.parts.main", "wind.parts.tail", "wind.parts.fuselage"),
        "Gusts that meet rotor, tail and fuselage one after the other.",
    ),
    (("wind.rotation",), "Air that turns: rotational gusts."),
    (("sensors.imu.vibration.rev_mps2", "sensors.imu.vibration.blade_mps2"),
     "Vibration of the rotor on the IMU."),
    (("sensors.imu.gyro_scale_sigma", "sensors.imu.accel_scale_sigma"),
     "Scale factors and misalignment of the IMU."),
    (("sensors.mag.power_field_t_per_w",), "Magnetic field of the drive's currents."),
    (("sensors.baro.wind_coefficients", "sensors.baro.wash_coefficient"),
     "Barometer in the wind and in the rotor's wash."),
    (("sensors.gps.multipath.sigma_m",), "GPS multipath."),
    (("sensors.gps.outage.interval_s",), "GPS outages."),
)  # fmt: skip


def _is_on(value: Any) -> bool:
    return bool(np.any(np.asarray(value, dtype=float) != 0.0))


def scope(plant: Mapping[str, Any]) -> dict[str, tuple[str, ...]]:
    """What is simulated and what is not, in sentences.

    Parameters
    ----------
    plant : mapping
        The plant's parameters in that flight.
    """
    holds: list[str] = []
    lacks: list[str] = []
    for keys, sentence in _BY_PARAMETER:
        on = any(_is_on(plant[key]) for key in keys)
        (holds if on else lacks).append(sentence)
    rate = f"{Rate.of_parameters(plant).hz} Hz"
    loop = f"The loop as it would fly: observer at {rate}, attitude law at {rate}, "
    loop += "position law at 25 Hz."
    return {"Simulated": (*_ALWAYS, loop, *holds), "Not simulated": (*lacks, *_NEVER)}
