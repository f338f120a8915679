# SPDX-License-Identifier: Apache-2.0
"""The outer loop's parameters; their values stand in config/outer_loop.yaml."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from heli_core.parameters import Parameter
from heli_core.rcl_yaml import ParameterCause, ParameterError
from heli_core.rows import SETPOINT
from heli_core.signals import SweepParams
from heli_core.ticks import NS_PER_S, TICK_S
from heli_outer_pd.disturbance import kept
from heli_outer_pd.goto import FIXED, HEADINGS, HEIGHT_M, WIND
from heli_outer_pd.joystick import BUTTONS, MOST_AXES, MOST_BUTTONS, NO_BUTTON
from heli_outer_pd.manual import STICK_ROWS
from heli_outer_pd.modes import SERVED
from heli_outer_pd.reference import unforeseen_window_ns
from heli_outer_pd.script import SCRIPT_ROWS
from heli_outer_pd.state import OuterParams, RotorMap, blade_pitch

# -------------------------------------------------------------------------------------------------
# Sweeps and steps of the commanded attitude: what `heli score --response` is read from.
#
# Added to what the controller commands, in flight time (`heli_core.signals`).
# -------------------------------------------------------------------------------------------------

NONE, SWEEP, STEPS = "none", "sweep", "steps"
AXES = ("roll", "pitch", "yaw")
_PLACES = (SETPOINT.phi, SETPOINT.theta, SETPOINT.psi)

SWEEP_ROWS: tuple[Parameter, ...] = (
    Parameter(
        "sweep.shape", "string", "What is added to the commanded attitude: nothing, a sine of "
        "growing frequency, or steps up and down", choices=(NONE, SWEEP, STEPS), read_only=True,
    ),
    Parameter("sweep.axis", "string", "Angle that it is added to", choices=AXES, read_only=True),
    Parameter(
        "sweep.amplitude_deg", "double", "Its amplitude", "deg", lower=0.0, upper=30.0,
        read_only=True,
    ),
    Parameter(
        "sweep.from_hz", "double", "Frequency at which a sweep begins", "Hz", lower=0.01,
        upper=10.0, read_only=True,
    ),
    Parameter(
        "sweep.to_hz", "double", "Frequency at which it ends", "Hz", lower=0.01, upper=10.0,
        read_only=True,
    ),
    Parameter(
        "sweep.start_s", "double", "When it begins, since the start of the reference", "s",
        lower=0.0, upper=86400.0, read_only=True,
    ),
    Parameter(
        "sweep.duration_s", "double", "Its length; steps: of all eight parts together", "s",
        lower=1.0, upper=3600.0, read_only=True,
    ),
)  # fmt: skip
"""Rows of the `outer_loop` node."""


def sweep_params(p: Mapping[str, Any]) -> SweepParams:
    """Numbers of the rows `SWEEP_ROWS`."""
    return SweepParams(
        (NONE, SWEEP, STEPS).index(p["sweep.shape"]),
        _PLACES[AXES.index(p["sweep.axis"])],
        math.radians(p["sweep.amplitude_deg"]),
        2.0 * math.pi * p["sweep.from_hz"],
        math.log(p["sweep.to_hz"] / p["sweep.from_hz"]),
        p["sweep.start_s"],
        p["sweep.duration_s"],
    )


# -------------------------------------------------------------------------------------------------
# Parameter table.
# -------------------------------------------------------------------------------------------------

NODE_NAME = "outer_loop"
_MODES = ", ".join(word for command in SERVED for word in command.names)


def _row(name: str, kind: str, description: str, unit: str = "", **bounds) -> Parameter:
    return Parameter(name, kind, description, unit, **bounds)


def _stick(name: str, positive: str) -> tuple[Parameter, ...]:
    """Where a stick is read, and how."""
    return (
        _row(f"joy.{name}.axis", "int", f"Axis of the stick {name}, {positive} positive",
             lower=0, upper=MOST_AXES - 1),
        _row(f"joy.{name}.reversed", "bool", "The axis has its positive end on the other side"),
        _row(f"joy.{name}.dead_zone", "double", "Deflection below which it is none, of 1",
             lower=0.0, upper=0.9),
        _row(f"joy.{name}.expo", "double", "Share of the cubic: softer about the middle",
             lower=0.0, upper=1.0),
    )  # fmt: skip


JOY_ROWS: tuple[Parameter, ...] = (
    *_stick("roll", "right"),
    *_stick("pitch", "nose up"),
    *_stick("yaw", "nose right"),
    *_stick("climb", "up"),
    *(
        _row(f"joy.button.{name}", "int", f"Button that commands {name}; -1 for none",
             lower=NO_BUTTON, upper=MOST_BUTTONS - 1)
        for name in BUTTONS
    ),
)  # fmt: skip

TABLE: tuple[Parameter, ...] = (
    _row("lockstep", "bool", "Act on the set of messages of a tick instead of on arrival",
         read_only=True),
    _row("navigation_timeout_s", "double",
         "Age over which navigation is carried on; older it is none, the last command is held", "s",
         lower=0.01, upper=2.0, read_only=True),
    _row("period_ticks", "int", "Controller runs every so many ticks of 10 ms", "ticks",
         choices=(1, 2, 4, 5, 10, 20), read_only=True),
    _row("rotor_speed_period_ticks", "int", "Period of the rotor speed's samples", "ticks",
         lower=1, upper=100, read_only=True),
    _row("own_law", "string", "A controller in Python that flies in its place, MODULE:NAME or "
         "FILE.py:NAME: its code runs", read_only=True),
    _row("K_P", "double[]", "Position gains, forward, right, down", "1/s2",
         shape=(3,), lower=0.0, upper=20.0),
    _row("K_D", "double[]", "Velocity gains, forward, right, down", "1/s",
         shape=(3,), lower=0.0, upper=40.0),
    _row("approach_speed_mps", "double",
         "Speed at which a large position error is flown back", "m/s", lower=0.1, upper=20.0),
    _row("reference_anchor", "string",
         "Fly the first reference where it says, or from where the aircraft is when hover engages",
         choices=("given", "engagement"), read_only=True),
    _row("reference_shaping_s", "double", "Window over which the reference is averaged", "s",
         lower=0.0, upper=10.0),
    _row("reference_preview", "bool", "Whether a reference that comes by message or from the "
         "scenario is known ahead, so that half of that window lies ahead of now; else the window "
         "is one step of the controller", read_only=True),
    _row("heading_lead_s", "double", "Lead of the commanded heading where the reference turns", "s",
         lower=0.0, upper=3.0),
    _row("reference_limits.altitude_min_m", "double", "Lowest reference that is followed", "m",
         lower=0.0, upper=1e4),
    _row("reference_limits.altitude_max_m", "double", "Highest reference that is followed", "m",
         lower=1.0, upper=1e4),
    _row("reference_limits.distance_m", "double",
         "Largest horizontal distance of a reference from where the flight began", "m",
         lower=1.0, upper=1e5),
    _row("fence.radius_m", "double",
         "Horizontal distance of the aircraft from home beyond which it is brought back", "m",
         lower=5.0, upper=1e5),
    _row("fence.ceiling_m", "double",
         "Height of the aircraft above the ground beyond which it is brought back", "m",
         lower=5.0, upper=1e4),
    _row("fence.margin_m", "double", "It then hovers so far inside the fence", "m",
         lower=0.0, upper=1e3),
    _row("goto.speed_mps", "double", "Largest horizontal speed of a goto", "m/s",
         lower=0.1, upper=20.0),
    _row("goto.climb_mps", "double", "Largest vertical speed of a goto, up and down", "m/s",
         lower=0.1, upper=5.0),
    _row("goto.acceleration_mps2", "double",
         "Largest acceleration of a goto, along its way and across it", "m/s2",
         lower=0.05, upper=8.0),
    _row("goto.jerk_mps3", "double", "Largest jerk of a goto, along its way and across it", "m/s3",
         lower=0.05, upper=50.0),
    _row("goto.yaw_rate_degps", "double", "Largest rate of the heading in a goto", "deg/s",
         lower=1.0, upper=180.0),
    _row("goto.yaw_acceleration_degps2", "double", "Largest angular acceleration of the heading in "
         "a goto, reached in half a second", "deg/s2", lower=1.0, upper=720.0),
    _row("goto.heading", "string", "Heading in a goto: turn on the way to that of the pose; nose "
         "towards the goal on the way, then to that of the pose; as it is; or so, and into the "
         "wind while it hovers", choices=HEADINGS),
    _row("goto.max_age_s", "double", "Oldest goto that is flown, flight time since its stamp", "s",
         lower=0.1, upper=60.0),
    _row("mode", "string", f"Commands a mode by its name when it is set in flight: {_MODES}"),
    *JOY_ROWS,
    _row("start.on_ground", "bool", "Begin standing on the skids, and wait for a take-off",
         read_only=True),
    _row("takeoff.height_m", "double", "Height of the hover after a take-off, above where it stood",
         "m", lower=HEIGHT_M[0], upper=HEIGHT_M[1]),
    _row("takeoff.climb_mps", "double", "Largest speed of the climb to it", "m/s",
         lower=0.1, upper=5.0),
    _row("takeoff.idle_collective", "double", "Collective on the ground", "",
         lower=-1.0, upper=1.0, lower_open=True, upper_open=True),
    _row("takeoff.spool_up_s", "double", "Wait for the rotor's speed before the collective is "
         "raised", "s", lower=0.0, upper=300.0),
    _row("takeoff.ramp_s", "double", "From the collective on the ground to that of hover", "s",
         lower=0.2, upper=30.0),
    _row("takeoff.lean_max_deg", "double", "Largest roll or pitch on the ground, off that of hover,"
         " from which a take-off is begun", "deg", lower=0.5, upper=20.0),
    _row("takeoff.tip_deg", "double", "Leaning so much more than on the ground while it is light, "
         "a take-off is aborted", "deg", lower=1.0, upper=20.0),
    _row("land.descent_mps", "double", "Largest speed of the descent", "m/s", lower=0.1, upper=3.0),
    _row("land.touch_down_mps", "double", "Speed of its last part", "m/s", lower=0.1, upper=1.0),
    _row("land.slow_below_m", "double", "Height, above where the flight began, at which that "
         "begins; the receiver's drift is in it", "m", lower=0.0, upper=50.0),
    _row("land.ramp_s", "double", "From the collective of hover to that on the ground", "s",
         lower=0.2, upper=30.0),
    _row("land.clear_m", "double", "Below this height neither climb nor descent is held", "m",
         lower=0.0, upper=50.0),
    _row("land.heading", "string", "Heading in a landing: turn into the wind before the last "
         "part, or as it is", choices=(WIND, FIXED)),
    _row("land.blind_sigma_mps", "double", "The navigation's standard deviation of the horizontal "
         "velocity with which the position counts as lost: a landing goes on level, without it",
         "m/s", lower=0.2, upper=10.0),
    _row("land.blind_sigma_down_mps", "double", "The same of the vertical velocity, half of it in a"
         " landing: it lands on fixed thrust", "m/s", lower=0.1, upper=10.0),
    _row("land.blind_descent_mps", "double", "Speed of the fixed-thrust descent", "m/s",
         lower=0.2, upper=2.0),
    _row("failsafe.land_after_s", "double", "With its position lost for so long it lands by itself;"
         " what is found again before goes on", "s", lower=1.0, upper=3600.0),
    _row("failsafe.land_astray_m", "double", "Or once it is likely (one sigma, each axis) that "
         "when it is down it will have gone astray by so much since the last fix that was fused",
         "m", lower=0.5, upper=1e4),
    _row("failsafe.land_silent_s", "double", "But not before no fix was fused for so long", "s",
         lower=1.0, upper=3600.0),
    _row("failsafe.descent_mps", "double", "Largest speed of the landing by dead reckoning", "m/s",
         lower=0.2, upper=3.0),
    _row("failsafe.touch_down_mps", "double", "Its speed at the ground", "m/s", lower=0.1,
         upper=1.0),
    _row("failsafe.flare_s", "double", "In its last part the speed above that is the height over "
         "this time", "s", lower=0.5, upper=30.0),
    _row("failsafe.feel_mps", "double", "Its speed all the way where the height of the ground is "
         "not known", "m/s", lower=0.1, upper=1.5),
    _row("failsafe.unfollowed_deg", "double[]", "Attitude swings about what the attitude loop "
         "should have made of its command, standard deviation of a second, pitch and roll: with "
         "more it flies softly", "deg", shape=(2,), lower=1.0, upper=180.0),
    _row("failsafe.rotor_slow_share", "double", "The rotor is too slow below this share of the "
         "governed speed: it autorotates", "1", lower=0.0, upper=0.99),
    _row("failsafe.rotor_slow_s", "double", "For so long", "s", lower=0.0, upper=10.0),
    *STICK_ROWS,
    *SCRIPT_ROWS,
    _row("attitude_lead.lead_s", "double[]",
         "Lead of the wanted acceleration, forward and right, against the attitude loop's lag", "s",
         shape=(2,), lower=0.0, upper=1.0),
    _row("attitude_lead.filter_s", "double", "Time constant of the lead's filter", "s",
         lower=0.02, upper=1.0),
    _row("wind_compensation", "bool", "Subtract the estimated disturbance (false: pure PD)"),
    _row("disturbance.bandwidth_radps", "double[]", "Bandwidth of the disturbance observer",
         "rad/s", shape=(3,), lower=0.0, upper=15.0),
    _row("disturbance.attitude_lag_s", "double[]", "Lag of the attitude loop, pitch and roll", "s",
         shape=(2,), lower=0.02, upper=5.0),
    _row("disturbance.tilt_standing_s", "double", "What tilt stands off its command for longer "
         "counts as disturbance, beside what the measured tilt does not explain; 0: all that the "
         "commanded tilt behind that lag does not explain", "s", lower=0.0, upper=60.0),
    _row("disturbance.limit_mps2", "double[]", "Largest disturbance that is compensated", "m/s2",
         shape=(3,), lower=0.0, upper=9.0),
    _row("horizontal", "string", "Hold position, or command a level attitude (attitude test)",
         choices=("position", "level")),
    _row("level_attitude_deg", "double[]", "Roll and pitch commanded when horizontal is level",
         "deg", shape=(2,), lower=-20.0, upper=20.0),
    *SWEEP_ROWS,
    _row("tilt_limit_deg", "double", "Largest commanded tilt from trim", "deg",
         lower=1.0, upper=45.0),
    _row("exact_tilt", "bool",
         "Tilt whose thrust gives the wanted acceleration (false: asin as printed in (21))"),
    _row("thrust_limits", "double[]", "Smallest and largest thrust, fractions of the weight", "",
         shape=(2,), lower=0.1, upper=2.0),
    _row("collective_lag_s", "double", "Lag of thrust behind its command", "s",
         lower=0.0, upper=0.5),
    _row("collective_prediction_s", "double", "The vertical speed is fed back as it will be in "
         "so long, with the thrust and the estimated disturbance of now; 0: as it is", "s",
         lower=0.0, upper=0.2),
    _row("blade_pitch_floor", "double", "Smallest blade pitch, fraction of hover's", "",
         lower=0.0, upper=0.9),
    _row("mass", "double", "Mass of the aircraft", "kg", lower=0.1, upper=2e4),
    _row("gravity", "double", "Local gravity", "m/s2", lower=9.7, upper=9.9),
    _row("trim.phi", "double", "Roll angle in still-air hover", "rad", lower=-0.5, upper=0.5),
    _row("trim.theta", "double", "Pitch angle in still-air hover", "rad", lower=-0.5, upper=0.5),
    _row("trim.d_col", "double", "Collective in still-air hover", "", lower=-1.0, upper=1.0,
         lower_open=True, upper_open=True),
    _row("rotor.rho", "double", "Air density", "kg/m3", lower=0.3, upper=1.5),
    _row("rotor.omega", "double", "Main rotor speed", "rad/s", lower=10.0, upper=500.0),
    _row("rotor.radius", "double", "Main rotor radius", "m", lower=0.1, upper=20.0),
    _row("rotor.lift_slope", "double", "Blade lift slope", "1/rad", lower=1.0, upper=8.0),
    _row("rotor.blades", "int", "Number of main rotor blades", "", lower=2, upper=8),
    _row("rotor.chord", "double", "Blade chord", "m", lower=0.005, upper=2.0),
    _row("rotor.K_col", "double", "Blade pitch per collective (negative: more thrust is less)",
         "rad", lower=-1.0, upper=1.0),
)  # fmt: skip


# -------------------------------------------------------------------------------------------------
# From the outer loop's checked parameters to the numbers of its controller.
# -------------------------------------------------------------------------------------------------

OBSERVER_DAMPING = 0.8
"""Of the disturbance observer's error dynamics."""
_SWINGS = -0.8
"""Least factor from one step's vertical command to the next's by the prediction alone."""


def largest_K_D(p: Mapping[str, Any]) -> float:
    """The largest `K_D` down, 1/s, with which the vertical prediction does not swing.

    A command changes the acceleration, behind the collective's lag, that the next command is
    predicted with; by that loop alone it is multiplied by keep - (1 - keep) K_D ahead from step to
    step, and that factor is at least `_SWINGS`.
    """
    keep = kept(p["period_ticks"] * TICK_S, p["collective_lag_s"])
    ahead_s = p["collective_prediction_s"]
    if not (p["wind_compensation"] and ahead_s > 0.0):
        return math.inf
    return float((keep - _SWINGS) / ((1.0 - keep) * ahead_s))


def check_prediction(p: Mapping[str, Any]) -> None:
    """Raise ParameterError where the vertical prediction would make the collective swing."""
    most, K_D = largest_K_D(p), p["K_D"][2]
    if K_D > most:
        ahead_s = p["collective_prediction_s"]
        raise ParameterError(
            f"collective_prediction_s: {ahead_s:g} s makes the collective swing from step to step, "
            f"with K_D {K_D:g} 1/s down, collective_lag_s {p['collective_lag_s']:g} s and "
            f"period_ticks {p['period_ticks']}",
            ParameterCause.CONFLICT,
            value=ahead_s,
            allowed=f"up to {math.floor(1e3 * ahead_s * most / K_D) / 1e3:g} s; a lower K_D takes "
            "more",
        )


def outer_params(parameters: Mapping[str, Any]) -> OuterParams:
    """Numbers of the controller from the parameters of config/outer_loop.yaml.

    Parameters
    ----------
    parameters : mapping
        Dotted name to value, as checked against `heli_outer_pd.parameters.TABLE`.

    Returns
    -------
    OuterParams

    Raises
    ------
    ParameterError
        As `check_prediction` does.
    """
    p = parameters
    check_prediction(p)
    bandwidth = np.asarray(p["disturbance.bandwidth_radps"], float)
    trim = np.zeros(SETPOINT.size)
    trim[SETPOINT.phi], trim[SETPOINT.theta] = p["trim.phi"], p["trim.theta"]
    trim[SETPOINT.col] = p["trim.d_col"]
    rotor = RotorMap(
        rho=p["rotor.rho"],
        omega=p["rotor.omega"],
        radius=p["rotor.radius"],
        lift_slope=p["rotor.lift_slope"],
        blades=float(p["rotor.blades"]),
        chord=p["rotor.chord"],
        K_col=p["rotor.K_col"],
    )
    level = math.cos(p["trim.phi"]) * math.cos(p["trim.theta"])
    hover_pitch = blade_pitch(p["mass"] * p["gravity"] / level, 0.0, rotor)
    less_pitch = (p["blade_pitch_floor"] - 1.0) * hover_pitch
    collective_floor = p["trim.d_col"] + less_pitch / rotor.K_col
    return OuterParams(
        K_P=np.asarray(p["K_P"], float),
        K_D=np.asarray(p["K_D"], float),
        approach_speed_mps=p["approach_speed_mps"],
        observer_l1=2.0 * OBSERVER_DAMPING * bandwidth,
        observer_l2=bandwidth**2,
        disturbance_limit=np.asarray(p["disturbance.limit_mps2"], float),
        wind_compensation=float(p["wind_compensation"]),
        hold_horizontal=float(p["horizontal"] == "position"),
        level_phi_theta=np.radians(np.asarray(p["level_attitude_deg"], float)),
        tilt_limit=math.radians(p["tilt_limit_deg"]),
        exact_tilt=float(p["exact_tilt"]),
        mass=p["mass"],
        g=p["gravity"],
        thrust_limits=np.asarray(p["thrust_limits"], float),
        collective_lag_s=p["collective_lag_s"],
        collective_prediction_s=p["collective_prediction_s"],
        collective_floor=collective_floor,
        trim=trim,
        rotor=rotor,
        shaping_ns=round(p["reference_shaping_s"] * NS_PER_S),
        unforeseen_ns=unforeseen_window_ns(p),
        heading_lead_s=p["heading_lead_s"],
        attitude_lag=np.asarray(p["disturbance.attitude_lag_s"], float),
        tilt_standing_s=p["disturbance.tilt_standing_s"],
        reference_lead=np.array([*p["disturbance.attitude_lag_s"], p["collective_lag_s"]]),
        attitude_lead=np.asarray(p["attitude_lead.lead_s"], float),
        lead_filter_s=p["attitude_lead.filter_s"],
        blind_sigma=p["land.blind_sigma_mps"],
        land_after_s=p["failsafe.land_after_s"],
        land_astray_m=p["failsafe.land_astray_m"],
        land_silent_s=p["failsafe.land_silent_s"],
        quick_mps=np.array(
            [p[f"failsafe.{name}_mps"] for name in ("descent", "touch_down", "feel")]
        ),
        flare_s=p["failsafe.flare_s"],
        blind_sigma_down=p["land.blind_sigma_down_mps"],
        blind_descent_mps=p["land.blind_descent_mps"],
        unfollowed=np.radians(np.asarray(p["failsafe.unfollowed_deg"], float)),
        rotor_slow_share=p["failsafe.rotor_slow_share"],
        rotor_slow_s=p["failsafe.rotor_slow_s"],
        dt_s=p["period_ticks"] * TICK_S,
        sweep=sweep_params(p),
    )
