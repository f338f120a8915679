# SPDX-License-Identifier: Apache-2.0
"""The parameters of the plant's wind; their values stand in config/plant.yaml."""

from heli_dynamics_sim.parameter_row import real, row
from heli_math.ticks import TICK_S
from heli_parameters.parameters import Parameter

WIND: tuple[Parameter, ...] = (
    real(
        "wind.towards_deg", "Direction the air moves to, from north over east", "deg", -360.0, 360.0
    ),
    row("wind.profile", "string", "Steady wind over altitude", choices=("table", "log")),
    real(
        "wind.profile_altitude_m",
        "Altitudes of the table of the steady wind",
        "m",
        0.0,
        1e4,
        (None,),
    ),
    real("wind.profile_speed_mps", "Steady wind at these altitudes", "m/s", 0.0, 30.0, (None,)),
    real("wind.roughness_m", "Height z0 at which the log profile ends", "m", 1e-4, 2.0),
    row("wind.turbulence", "bool", "Dryden turbulence"),
    row(
        "wind.spectrum",
        "string",
        "Standard of the turbulence; the two agree below 1000 ft",
        choices=("mil_f_8785c", "mil_hdbk_1797"),
    ),
    row("wind.rotation", "bool", "Rotational gusts p, q, r of the standard"),
    real(
        "wind.w20_mps",
        "Wind at 20 ft that scales turbulence, log profile, random gusts; negative: the table's",
        "m/s",
        -1.0,
        30.0,
    ),
    real("wind.airspeed_floor_mps", "Least speed at which turbulence passes", "m/s", 0.1, 30.0),
    row("wind.parts.main", "bool", "The main rotor meets the air at its hub"),
    row("wind.parts.tail", "bool", "Tail rotor and fins meet the air at the tail"),
    row("wind.parts.fuselage", "bool", "The fuselage meets the mean of the air over its length"),
    real(
        "wind.random_gusts.rate_per_min",
        "Random gusts per minute without one; 0: none",
        "1/min",
        0.0,
        60.0,
    ),
    real(
        "wind.random_gusts.amplitude_w20",
        "Least and largest peak of a random gust, share of the wind at 20 ft",
        "",
        0.0,
        3.0,
        (2,),
    ),
    real(
        "wind.random_gusts.duration_s",
        "Least and largest length of a random gust",
        "s",
        TICK_S,
        1e3,
        (2,),
    ),
    real(
        "wind.random_gusts.spread_deg",
        "Largest angle between a random gust and the mean wind",
        "deg",
        0.0,
        180.0,
    ),
    real("wind.gust.start_s", "Start of each 1-cosine gust, flight time", "s", 0.0, 1e6, (None,)),
    real("wind.gust.duration_s", "Length of each gust", "s", TICK_S, 1e4, (None,)),
    real(
        "wind.gust.amplitude_mps",
        "Peak velocity of the air of each gust",
        "m/s",
        -30.0,
        30.0,
        (None, 3),
    ),
    row("wind.gust.frame", "string", "Axes of the gusts' amplitudes", choices=("ned", "body")),
    real(
        "wind.sines.frequency_hz",
        "Lines of the gusts injected for identification",
        "Hz",
        0.0,
        50.0,
        (None,),
        lower_open=True,
    ),
    real(
        "wind.sines.amplitude_mps",
        "Amplitude of each line on the three axes",
        "m/s",
        -30.0,
        30.0,
        (None, 3),
    ),
    real(
        "wind.sines.phase_rad",
        "Phase of each line on the three axes",
        "rad",
        -10.0,
        10.0,
        (None, 3),
    ),
    real("wind.sines.start_s", "Flight time of the start", "s", 0.0, 1e6),
    real("wind.sines.duration_s", "Length with both fades", "s", 0.0, 1e6),
    real("wind.sines.fade_s", "Length of a fade", "s", 0.0, 600.0),
    row("wind.sines.frame", "string", "Axes of the lines' amplitudes", choices=("ned", "body")),
)
