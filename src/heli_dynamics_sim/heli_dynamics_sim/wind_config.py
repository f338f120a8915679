# SPDX-License-Identifier: Apache-2.0
"""Configuration of the wind: from the plant's parameters to the kernels' numbers."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from heli_dynamics_sim.config_error import PlantConfigError
from heli_dynamics_sim.gusts import RandomGusts
from heli_dynamics_sim.parameters import HelicopterParameters
from heli_dynamics_sim.wind import (
    PLACE,
    W20_ALTITUDE_M,
    PartsKernel,
    SinesKernel,
    WindKernel,
    mean_speed,
)


def wind_kernel(values: Mapping[str, Any], aircraft: HelicopterParameters) -> WindKernel:
    """The wind that a plant's parameters describe, for an aircraft's size.

    Raises
    ------
    PlantConfigError
        Names the key whose length, order or value does not fit.
    """
    altitudes = np.array(values["wind.profile_altitude_m"], dtype=np.float64)
    speeds = np.array(values["wind.profile_speed_mps"], dtype=np.float64)
    if altitudes.size == 0 or (np.diff(altitudes) <= 0.0).any():
        raise PlantConfigError(
            f"wind.profile_altitude_m: {altitudes.tolist()} is not allowed; allowed: at least one "
            "altitude, each above the one before"
        )
    if speeds.size != altitudes.size:
        raise PlantConfigError(
            f"wind.profile_speed_mps: has {speeds.size} values; allowed: {altitudes.size}, one per "
            "wind.profile_altitude_m"
        )
    starts = np.array(values["wind.gust.start_s"], dtype=np.float64)
    durations = np.array(values["wind.gust.duration_s"], dtype=np.float64)
    amplitudes = np.array(values["wind.gust.amplitude_mps"], dtype=np.float64).reshape(-1, 3)
    for key, count in (("duration_s", durations.size), ("amplitude_mps", amplitudes.shape[0])):
        if count != starts.size:
            raise PlantConfigError(
                f"wind.gust.{key}: describes {count} gusts; allowed: {starts.size}, "
                "as wind.gust.start_s"
            )
    towards_rad = math.radians(values["wind.towards_deg"])
    kernel = WindKernel(
        altitudes,
        speeds,
        towards_rad,
        bool(values["wind.turbulence"]),
        0.0,
        values["wind.airspeed_floor_mps"],
        starts,
        durations,
        amplitudes,
        values["wind.gust.frame"] == "body",
        _sines_kernel(values),
        values["wind.profile"] == "log",
        values["wind.roughness_m"],
        bool(values["wind.rotation"]),
        2.0 * aircraft.main_radius_m,
        _parts_kernel(values, aircraft),
        _random_gusts(values),
        (math.cos(towards_rad), math.sin(towards_rad)),
    )
    return kernel._replace(w20_mps=_w20_mps(values["wind.w20_mps"], kernel))


def _w20_mps(given: float, kernel: WindKernel) -> float:
    if given >= 0.0:
        return given
    if kernel.log_profile:
        raise PlantConfigError(
            f"wind.w20_mps: {given:g} is not allowed with wind.profile log, which it scales; "
            "allowed: the wind at 20 ft, at least 0"
        )
    return float(mean_speed(W20_ALTITUDE_M, kernel))


def _parts_kernel(values: Mapping[str, Any], aircraft: HelicopterParameters) -> PartsKernel:
    main, tail, fuselage = (
        bool(values[f"wind.parts.{name}"]) for name in ("main", "tail", "fuselage")
    )
    places, half = np.zeros((len(PLACE), 3)), aircraft.gear_half_length_m
    places[PLACE.main] = 0.0, 0.0, -aircraft.hub_height_m
    places[PLACE.tail] = -aircraft.tail_arm_m, 0.0, -aircraft.tail_height_m
    places[[PLACE.front, PLACE.rear], 0] = half, -half
    needed = np.array([True, main, tail, fuselage, fuselage])
    reach = float(np.linalg.norm(places[needed], axis=1).max())
    return PartsKernel(main, tail, fuselage, main or tail or fuselage, places, needed, reach)


def _random_gusts(values: Mapping[str, Any]) -> RandomGusts:
    def ordered(key: str) -> tuple[float, float]:
        low, high = values[f"wind.random_gusts.{key}"]
        if low > high:
            raise PlantConfigError(
                f"wind.random_gusts.{key}: [{low:g}, {high:g}] is not allowed; allowed: the "
                "smaller number first"
            )
        return low, high

    least_share, most_share = ordered("amplitude_w20")
    least_s, most_s = ordered("duration_s")
    return RandomGusts(
        values["wind.random_gusts.rate_per_min"],
        least_share,
        most_share,
        least_s,
        most_s,
        math.radians(values["wind.random_gusts.spread_deg"]),
        values["duration_s"],
    )


def _sines_kernel(values: Mapping[str, Any]) -> SinesKernel:
    lines = np.array(values["wind.sines.frequency_hz"], dtype=np.float64)
    tables = []
    for key in ("amplitude_mps", "phase_rad"):
        table = np.array(values[f"wind.sines.{key}"], dtype=np.float64).reshape(-1, 3)
        if table.shape[0] != lines.size:
            raise PlantConfigError(
                f"wind.sines.{key}: describes {table.shape[0]} lines; allowed: {lines.size}, "
                "3 numbers per wind.sines.frequency_hz"
            )
        tables.append(table)
    duration, fade = values["wind.sines.duration_s"], values["wind.sines.fade_s"]
    if 2.0 * fade > duration:
        raise PlantConfigError(
            f"wind.sines.fade_s: {fade:g} is not allowed; allowed: at most {0.5 * duration:g}, "
            "half of wind.sines.duration_s"
        )
    return SinesKernel(
        bool((tables[0] != 0.0).any()),
        lines,
        tables[0],
        tables[1],
        values["wind.sines.start_s"],
        duration,
        fade,
        values["wind.sines.frame"] == "body",
    )
