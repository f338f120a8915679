# SPDX-License-Identifier: Apache-2.0
"""The parameters of the plant's wind; their values stand in config/plant.yaml."""

from typing import Any

from heli_math.ticks import TICK_S
from heli_parameters.parameters import Parameter


def _row(name: str, kind: str, description: str, unit: str = "", **rest: Any) -> Parameter:
    # Gusts may be added in flight; everything else is what the flight was started with.
    fixed = not name.startswith("wind.gust.")
    return Parameter(name, kind, description, unit, read_only=fixed, **rest)


WIND: tuple[Parameter, ...] = (
    _row(
        "wind.towards_deg",
        "double",
        "Direction the air moves to, from north over east",
        "deg",
        lower=-360.0,
        upper=360.0,
    ),
    _row("wind.profile", "string", "Steady wind over altitude", choices=("table", "log")),
    _row(
        "wind.profile_altitude_m",
        "double[]",
        "Altitudes of the table of the steady wind",
        "m",
        shape=(None,),
        lower=0.0,
        upper=1e4,
    ),
    _row(
        "wind.profile_speed_mps",
        "double[]",
        "Steady wind at these altitudes",
        "m/s",
        shape=(None,),
        lower=0.0,
        upper=30.0,
    ),
    _row(
        "wind.roughness_m",
        "double",
        "Height z0 at which the log profile ends",
        "m",
        lower=1e-4,
        upper=2.0,
    ),
    _row("wind.turbulence", "bool", "Dryden turbulence"),
    _row(
        "wind.spectrum",
        "string",
        "Standard of the turbulence; the two agree below 1000 ft",
        choices=("mil_f_8785c", "mil_hdbk_1797"),
    ),
    _row("wind.rotation", "bool", "Rotational gusts p, q, r of the standard"),
    _row(
        "wind.w20_mps",
        "double",
        "Wind at 20 ft that scales turbulence, log profile, random gusts; negative: the table's",
        "m/s",
        lower=-1.0,
        upper=30.0,
    ),
    _row(
        "wind.airspeed_floor_mps",
        "double",
        "Least speed at which turbulence passes",
        "m/s",
        lower=0.1,
        upper=30.0,
    ),
    _row("wind.parts.main", "bool", "The main rotor meets the air at its hub"),
    _row("wind.parts.tail", "bool", "Tail rotor and fins meet the air at the tail"),
    _row("wind.parts.fuselage", "bool", "The fuselage meets the mean of the air over its length"),
    _row(
        "wind.random_gusts.rate_per_min",
        "double",
        "Random gusts per minute without one; 0: none",
        "1/min",
        lower=0.0,
        upper=60.0,
    ),
    _row(
        "wind.random_gusts.amplitude_w20",
        "double[]",
        "Least and largest peak of a random gust, share of the wind at 20 ft",
        shape=(2,),
        lower=0.0,
        upper=3.0,
    ),
    _row(
        "wind.random_gusts.duration_s",
        "double[]",
        "Least and largest length of a random gust",
        "s",
        shape=(2,),
        lower=TICK_S,
        upper=1e3,
    ),
    _row(
        "wind.random_gusts.spread_deg",
        "double",
        "Largest angle between a random gust and the mean wind",
        "deg",
        lower=0.0,
        upper=180.0,
    ),
    _row(
        "wind.gust.start_s",
        "double[]",
        "Start of each 1-cosine gust, flight time",
        "s",
        shape=(None,),
        lower=0.0,
        upper=1e6,
    ),
    _row(
        "wind.gust.duration_s",
        "double[]",
        "Length of each gust",
        "s",
        shape=(None,),
        lower=TICK_S,
        upper=1e4,
    ),
    _row(
        "wind.gust.amplitude_mps",
        "double[]",
        "Peak velocity of the air of each gust",
        "m/s",
        shape=(None, 3),
        lower=-30.0,
        upper=30.0,
    ),
    _row("wind.gust.frame", "string", "Axes of the gusts' amplitudes", choices=("ned", "body")),
    _row(
        "wind.sines.frequency_hz",
        "double[]",
        "Lines of the gusts injected for identification",
        "Hz",
        shape=(None,),
        lower=0.0,
        upper=50.0,
        lower_open=True,
    ),
    _row(
        "wind.sines.amplitude_mps",
        "double[]",
        "Amplitude of each line on the three axes",
        "m/s",
        shape=(None, 3),
        lower=-30.0,
        upper=30.0,
    ),
    _row(
        "wind.sines.phase_rad",
        "double[]",
        "Phase of each line on the three axes",
        "rad",
        shape=(None, 3),
        lower=-10.0,
        upper=10.0,
    ),
    _row("wind.sines.start_s", "double", "Flight time of the start", "s", lower=0.0, upper=1e6),
    _row("wind.sines.duration_s", "double", "Length with both fades", "s", lower=0.0, upper=1e6),
    _row("wind.sines.fade_s", "double", "Length of a fade", "s", lower=0.0, upper=600.0),
    _row("wind.sines.frame", "string", "Axes of the lines' amplitudes", choices=("ned", "body")),
)
