# SPDX-License-Identifier: Apache-2.0
"""The outer loop's parameters; their values stand in config/outer_loop.yaml."""

from heli_parameters.parameters import Parameter

NODE_NAME = "outer_loop"


def _row(name: str, kind: str, description: str, unit: str = "", **bounds) -> Parameter:
    return Parameter(name, kind, description, unit, **bounds)


TABLE: tuple[Parameter, ...] = (
    _row("lockstep", "bool", "Act on the set of messages of a tick instead of on arrival",
         read_only=True),
    _row("period_ticks", "int", "Law runs every so many ticks of 10 ms", "ticks",
         choices=(1, 2, 4, 5, 10, 20), read_only=True),
    _row("K_P", "double[]", "Position gains, forward, right, down", "1/s2",
         shape=(3,), lower=0.0, upper=20.0),
    _row("K_D", "double[]", "Velocity gains, forward, right, down", "1/s",
         shape=(3,), lower=0.0, upper=20.0),
    _row("reference_anchor", "string",
         "Fly the first reference where it says, or from where the aircraft is when hover engages",
         choices=("given", "engagement"), read_only=True),
    _row("reference_shaping_s", "double", "Window over which the reference is averaged", "s",
         lower=0.0, upper=10.0),
    _row("reference_limits.altitude_min_m", "double", "Lowest reference that is followed", "m",
         lower=0.0, upper=1e4),
    _row("reference_limits.altitude_max_m", "double", "Highest reference that is followed", "m",
         lower=1.0, upper=1e4),
    _row("reference_limits.distance_m", "double",
         "Largest horizontal distance of a reference from where the flight began", "m",
         lower=1.0, upper=1e5),
    _row("wind_compensation", "bool", "Subtract the estimated disturbance (false: pure PD)"),
    _row("disturbance.bandwidth_radps", "double[]", "Bandwidth of the disturbance observer",
         "rad/s", shape=(3,), lower=0.0, upper=7.5),
    _row("disturbance.attitude_lag_s", "double[]", "Lag of the attitude loop, pitch and roll", "s",
         shape=(2,), lower=0.02, upper=5.0),
    _row("disturbance.limit_mps2", "double[]", "Largest disturbance that is compensated", "m/s2",
         shape=(3,), lower=0.0, upper=5.0),
    _row("horizontal", "string", "Hold position, or command a level attitude (attitude test)",
         choices=("position", "level")),
    _row("level_attitude_deg", "double[]", "Roll and pitch commanded when horizontal is level",
         "deg", shape=(2,), lower=-20.0, upper=20.0),
    _row("tilt_limit_deg", "double", "Largest commanded tilt from trim", "deg",
         lower=1.0, upper=45.0),
    _row("thrust_limits", "double[]", "Smallest and largest thrust, fractions of the weight", "",
         shape=(2,), lower=0.1, upper=2.0),
    _row("mass", "double", "Mass of the aircraft", "kg", lower=0.1, upper=200.0),
    _row("gravity", "double", "Local gravity", "m/s2", lower=9.7, upper=9.9),
    _row("trim.phi", "double", "Roll angle in still-air hover", "rad", lower=-0.5, upper=0.5),
    _row("trim.theta", "double", "Pitch angle in still-air hover", "rad", lower=-0.5, upper=0.5),
    _row("trim.d_col", "double", "Collective in still-air hover", "", lower=-1.0, upper=1.0,
         lower_open=True, upper_open=True),
    _row("rotor.rho", "double", "Air density", "kg/m3", lower=0.3, upper=1.5),
    _row("rotor.omega", "double", "Main rotor speed", "rad/s", lower=10.0, upper=500.0),
    _row("rotor.radius", "double", "Main rotor radius", "m", lower=0.1, upper=5.0),
    _row("rotor.lift_slope", "double", "Blade lift slope", "1/rad", lower=1.0, upper=8.0),
    _row("rotor.blades", "int", "Number of main rotor blades", "", lower=2, upper=8),
    _row("rotor.chord", "double", "Blade chord", "m", lower=0.005, upper=0.5),
    _row("rotor.K_col", "double", "Blade pitch per collective (negative: more thrust is less)",
         "rad", lower=-1.0, upper=1.0),
)  # fmt: skip
