# SPDX-License-Identifier: Apache-2.0
"""Parameters of an aircraft: one frozen dataclass, read from YAML and checked.

A field carries its place in the file, symbol, unit, bounds and meaning, so that a wrong value is
refused by name. `HelicopterParameters.params` is what the compiled kernels take.
"""

import difflib
import math
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from heli_core.errors import ParameterCause, ParameterRefusal
from heli_core.foreign_files import FileError, read_yaml
from heli_core.jit import by_reference
from heli_core.rcl_yaml import file_refusal, printable
from heli_core.rows import PLANT
from heli_dynamics_sim.airframe import BodyParams, FinParams, FuselageParams, GyroParams
from heli_dynamics_sim.engine import FREE, EngineParams
from heli_dynamics_sim.ground import GroundParams, plane_of
from heli_dynamics_sim.main_rotor import (
    MODELS,
    FlapBackParams,
    FlappingParams,
    GroundEffectParams,
    InflowParams,
    MainRotorParams,
    RotorParams,
    paddle_inflow,
)
from heli_dynamics_sim.servo import Imperfections, ServoParams

# -------------------------------------------------------------------------------------------------
# Aircraft files: where they lie, what a value may be, and how a bad one is refused.
# -------------------------------------------------------------------------------------------------

_LONGEST = 80
COUPLINGS = ("identified", "eq7")


class AircraftError(ParameterRefusal, ValueError):
    """An aircraft file that cannot be used; the message names file, key and bounds."""


def number(
    key: str, symbol: str, unit: str, lower: float, upper: float, meaning: str, closed: bool = False
) -> Any:
    """A field of the file: bounds are open unless `closed` (then the lower one may be met)."""
    return field(
        metadata={
            "key": key,
            "symbol": symbol,
            "unit": unit,
            "lower": lower,
            "upper": upper,
            "closed": closed,
            "meaning": meaning,
        }
    )


def file_fields(aircraft: Any) -> list[Field[Any]]:
    """Fields of the dataclass of an aircraft, or of one, that stand in its file."""
    return [item for item in fields(aircraft) if "key" in item.metadata]


def allowed(rule: Mapping[str, Any]) -> str:
    """What a key may be, in words."""
    if "lower" not in rule:
        return "one of " + ", ".join(rule["choices"])
    left = "[" if rule["closed"] else "("
    unit = "" if rule["unit"] == "1" else f" {rule['unit']}"
    return f"a number in {left}{rule['lower']:g}, {rule['upper']:g}){unit} ({rule['meaning']})"


def check(rule: Mapping[str, Any], value: Any) -> None:
    """Refuse a value that its rule does not allow."""
    if "lower" not in rule:
        good = value in rule["choices"]
    else:
        good = (
            isinstance(value, (int, float))
            and not isinstance(value, bool)
            and abs(value) < math.inf
            and (value >= rule["lower"] if rule["closed"] else value > rule["lower"])
            and value < rule["upper"]
        )
    if not good:
        raise AircraftError(
            f"{_shown(value)} is not allowed",
            _cause(rule, value),
            key=rule["key"],
            value=value,
            allowed=allowed(rule),
        )


def _cause(rule: Mapping[str, Any], value: Any) -> ParameterCause:
    """Why a value that a rule does not allow is not."""
    if "lower" not in rule:
        return ParameterCause.CHOICE
    if not isinstance(value, (int, float)) or isinstance(value, bool):
        return ParameterCause.TYPE
    return ParameterCause.BOUNDS if math.isfinite(value) else ParameterCause.NOT_FINITE


def _shown(value: Any) -> str:
    """A value for a sentence, its beginning if it is long."""
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def flatten(tree: Any) -> dict[str, Any]:
    """`{group: {key: value}}` as `{group.key: value}`."""
    if not isinstance(tree, dict):
        raise AircraftError(
            "expected groups of keys (body:, main_rotor:, ...)", ParameterCause.SYNTAX
        )
    flat: dict[str, Any] = {}
    for group, content in tree.items():
        if not isinstance(content, dict):
            raise AircraftError(
                f"expected a group of keys, found {_shown(content)}",
                ParameterCause.TYPE,
                key=printable(str(group)),
                value=content,
            )
        for key, value in content.items():
            flat[printable(f"{group}.{key}")] = value
    return flat


def config_folders() -> list[Path]:
    """Where the packaged YAML may lie: beside the sources, or in an install space's share/."""
    here = Path(__file__).resolve()
    share = Path("share") / "heli_dynamics_sim" / "config"
    return [here.parents[1] / "config", *(parent / share for parent in here.parents)]


def find_aircraft(path: str | Path) -> Path:
    """The file of an aircraft: a bare name in the packaged folder, else a path that exists.

    A packaged name, with or without `.yaml`, means the packaged file, whatever lies in the working
    directory; `./name` is the way to one there.

    Raises
    ------
    AircraftError
        Names the packaged aircraft if there is none of that name.
    """
    bare = Path(path).name == str(path)
    known: set[str] = set()
    for folder in config_folders() if bare else ():
        for candidate in sorted((folder / "aircraft").glob("*.yaml")):
            if str(path) in (candidate.name, candidate.stem):
                return candidate
            known.add(candidate.name)
    if Path(path).is_file():
        return Path(path)
    hint = f"; packaged: {', '.join(sorted(known)) or 'none'}" if bare else ""
    raise AircraftError(f"no such aircraft file{hint}", ParameterCause.UNREADABLE, where=str(path))


def read_groups(file: Path) -> dict[str, Any]:
    """Values of an aircraft file as `{group.key: value}`; raises AircraftError."""
    try:
        tree = read_yaml(file)
    except FileError as error:
        raise AircraftError.like(file_refusal(error, "", "the file")) from error
    return flatten(tree)


# -------------------------------------------------------------------------------------------------
# Parameters that only terms read: servos as they are, engine and governor, limits of the tail.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class DriveParameters:
    """The part of `HelicopterParameters` that they make up."""

    blade_feathering_kgm2: float = number(
        "main_rotor.feathering_kgm2", "I_f", "kg m2", 0.0, 1.0, "pitch inertia of a blade"
    )
    servo_resolution: float = number(
        "servo.resolution", "-", "1", 0.0, 0.5, "step of a servo's command", closed=True
    )
    servo_dead_band: float = number(
        "servo.dead_band", "-", "1", 0.0, 0.5, "errors inside it move nothing", closed=True
    )
    servo_throw_rad: float = number(
        "servo.throw_rad", "-", "rad", 0.0, 3.2, "servo arm at travel 1"
    )
    servo_stall_torque_nm: float = number("servo.stall_torque_nm", "-", "N m", 0.0, 1e3, "at rest")
    servo_slow_share: float = number(
        "servo.slow_share",
        "-",
        "1",
        0.0,
        1.0001,
        "speed of the slowest swash servo over the others'",
    )
    engine_power_w: float = number(
        "engine.power_w", "P_max", "W", 0.0, 1e6, "engine's power at full throttle"
    )
    engine_time_constant_s: float = number(
        "engine.time_constant_s", "tau_e", "s", 1e-2, 10.0, "lag of its power"
    )
    drive_efficiency: float = number(
        "engine.efficiency", "eta", "1", 0.0, 1.0001, "power at the main shaft over the engine's"
    )
    drive_inertia_kgm2: float = number(
        "engine.drive_inertia_kgm2", "J", "kg m2", 0.0, 1e3, "all that turns, at the rotor's speed"
    )
    fuel_per_energy_kgpj: float = number(
        "engine.fuel_per_energy_kgpj", "-", "kg/J", 0.0, 1e-4, "fuel per energy", closed=True
    )
    fuel_kg: float = number("engine.fuel_kg", "-", "kg", 0.0, 1e3, "0: no tank", closed=True)
    governor_proportional_s: float = number(
        "governor.proportional_s", "K_p", "s", 0.0, 10.0, "throttle per rad/s", closed=True
    )
    governor_integral: float = number(
        "governor.integral", "K_i", "1", 0.0, 10.0, "throttle per rad"
    )
    governor_feed_forward: float = number(
        "governor.feed_forward", "-", "1", 0.0, 2.0, "share of hover's power per pitch", closed=True
    )
    tail_drag_coefficient: float = number(
        "tail_rotor.drag_coefficient", "C_D0_tr", "1", 0.0, 1.0, "blade profile drag", closed=True
    )
    tail_lift_coefficient: float = number(
        "tail_rotor.lift_coefficient", "C_l_max", "1", 0.0, 3.0, "mean of the blades at their stall"
    )
    tail_pitch_min_rad: float = number(
        "tail_rotor.pitch_min_rad", "-", "rad", -1.0, 0.5, "least blade pitch"
    )
    tail_pitch_max_rad: float = number(
        "tail_rotor.pitch_max_rad", "-", "rad", 0.0, 1.0, "largest blade pitch"
    )


# -------------------------------------------------------------------------------------------------
# Terms of the aircraft beyond the source's equations, a switch each.
#
# With all of them off (`ModelOptions()`) it is the paper's model; constants of terms stand in
# the
# aircraft files whether they are on or not.
# -------------------------------------------------------------------------------------------------


@by_reference
class ModelOptions(NamedTuple):
    """Which terms are on; a kernel takes it as it is."""

    flap_back: bool = False
    inflow: bool = False
    ground_effect: bool = False
    vortex_ring: bool = False
    rotor_speed: bool = False
    tail_authority: bool = False
    fuel: bool = False
    servo_resolution: bool = False
    servo_dead_band: bool = False
    servo_load: bool = False
    swash_servos: bool = False


MEANINGS = {
    "flap_back": "Tilt of the disc by the air's speed across it",
    "inflow": "Dynamic inflow of the main rotor, three states",
    "ground_effect": "Less induced velocity near the ground",
    "vortex_ring": "Induced velocity in steep descent as measured",
    "rotor_speed": "Rotor speed, engine and governor",
    "tail_authority": "Loss of the tail rotor's authority in side wind",
    "fuel": "Mass that is used up in flight",
    "servo_resolution": "Steps of the servos' commands",
    "servo_dead_band": "Dead band of the servos",
    "servo_load": "Rate limit of the collective's servos under the propeller moment",
    "swash_servos": "Three swash servos at 120 deg, one of them slower",
}
"""What each term is, for people."""


class OptionState(NamedTuple):
    """A state that a term adds, as trim and linearisation take it."""

    place: int  # of `PLANT`: solved for
    row: int  # of the state's derivative: vanishes in equilibrium
    meaning: str  # of that derivative, with its unit


_STATES = {
    "rotor_speed": (  # the governor keeps its speed: power and integrator are what they must be
        OptionState(PLANT.engine, PLANT.omega, "omega_dot (rad/s2)"),
        OptionState(PLANT.governor, PLANT.engine, "engine_dot (1/s)"),
    ),
    "flap_back": (
        OptionState(PLANT.blade_a, PLANT.blade_a, "blade_a_dot (rad/s)"),
        OptionState(PLANT.blade_b, PLANT.blade_b, "blade_b_dot (rad/s)"),
    ),
    "inflow": (
        OptionState(PLANT.inflow_mean, PLANT.inflow_mean, "v_0_dot (m/s2)"),
        OptionState(PLANT.inflow_right, PLANT.inflow_right, "v_s_dot (m/s2)"),
        OptionState(PLANT.inflow_rear, PLANT.inflow_rear, "v_c_dot (m/s2)"),
    ),
}


def states_of(terms: ModelOptions) -> list[OptionState]:
    """States that the terms that are on add to the equilibrium."""
    return [state for name, states in _STATES.items() if getattr(terms, name) for state in states]


# -------------------------------------------------------------------------------------------------
# From the parameters of an aircraft to the numbers that its compiled kernels take.
# -------------------------------------------------------------------------------------------------

_LEAST_FLOW = 0.25
"""The flow of the inflow's gradients at the least, over hover's (`inflow`)."""
CLIMB_POWER_KINKED, CLIMB_POWER_ON, CLIMB_POWER_OFF = 0.0, 1.0, -1.0


@by_reference
class HelicopterParams(NamedTuple):
    """All that the derivative kernel reads."""

    body: BodyParams
    rotor: RotorParams
    main: MainRotorParams
    flapping: FlappingParams
    tail: RotorParams
    tail_arm: float  # D_tr, m
    tail_height: float  # H_tr, m
    gyro: GyroParams
    fuselage: FuselageParams
    horizontal_fin: FinParams
    vertical_fin: FinParams
    servo: ServoParams
    ground: GroundParams
    climb_power: float  # 0: P_climb only in climb (kink at w_a = 0), 1: always, -1: never
    tail_stall: float  # largest thrust of the tail rotor at the governed speed, N
    engine: EngineParams
    terms: ModelOptions  # which of those beyond the source's equations are on
    flap_back: FlapBackParams
    inflow: InflowParams
    ground_effect: GroundEffectParams


def _rotor_params(
    rho: float, omega: float, blade: tuple[float, float, float, float]
) -> RotorParams:
    """Thrust law of a rotor at speed omega (rad/s); blade = radius, chord, number, lift slope."""
    radius, chord, blades, lift_slope = blade
    return RotorParams(
        thrust_slope=rho * omega * radius**2 * lift_slope * blades * chord / 4.0,
        blade_speed=2.0 / 3.0 * omega * radius,
        disc=2.0 * rho * math.pi * radius**2,
    )


def helicopter_params(p: "HelicopterParameters") -> HelicopterParams:
    """All kernels' numbers of an aircraft."""
    half_rho = 0.5 * p.air_density_kgpm3
    main_blade = (p.main_radius_m, p.main_chord_m, p.main_blades, p.main_lift_slope)
    tail_blade = (p.tail_radius_m, p.tail_chord_m, p.tail_blades, p.tail_lift_slope)
    tail_speed = p.main_speed_radps * p.tail_gear_ratio
    stall = (p.fin_stall_onset, p.fin_stall_full)
    limited = p.terms.tail_authority
    rotor, main = (
        _rotor_params(p.air_density_kgpm3, p.main_speed_radps, main_blade),
        _main_params(p),
    )
    return HelicopterParams(
        body=BodyParams(
            p.mass_kg, p.inertia_xx_kgm2, p.inertia_yy_kgm2, p.inertia_zz_kgm2, p.gravity_mps2
        ),
        rotor=rotor,
        main=main,
        flapping=_flapping_params(p),
        tail=_rotor_params(p.air_density_kgpm3, tail_speed, tail_blade),
        tail_arm=p.tail_arm_m,
        tail_height=p.tail_height_m,
        gyro=GyroParams(
            p.gyro_proportional_s,
            p.gyro_integral,
            p.gyro_pedal_gain_radps,
            p.pedal_gain,
            p.pedal_offset_rad,
            p.tail_pitch_min_rad if limited else -math.inf,
            p.tail_pitch_max_rad if limited else math.inf,
        ),
        fuselage=FuselageParams(
            half_rho * p.drag_area_x_m2,
            half_rho * p.drag_area_y_m2,
            half_rho * p.drag_area_z_m2,
            half_rho * p.wash_area_y_m2,
        ),
        horizontal_fin=FinParams(
            half_rho * p.hfin_area_m2, p.hfin_lift_slope, p.hfin_arm_m, 0.0, *stall
        ),
        vertical_fin=FinParams(
            half_rho * p.vfin_area_m2, p.vfin_lift_slope, p.vfin_arm_m, p.vfin_height_m, *stall
        ),
        servo=_servo_params(p),
        ground=_ground_params(p),
        climb_power=CLIMB_POWER_KINKED,
        tail_stall=_tail_stall(p) if limited else math.inf,
        engine=_engine_params(p, rotor, main),
        terms=p.terms,
        flap_back=_flap_back_params(p),
        inflow=InflowParams(p.main_radius_m, 2.0 * _LEAST_FLOW * math.sqrt(_hover_inflow_sq(p))),
        ground_effect=GroundEffectParams(
            p.main_radius_m, p.hub_height_m, _hover_inflow_sq(p), p.ground_effect == "hayden"
        ),
    )


def _main_params(p: "HelicopterParameters") -> MainRotorParams:
    tip = p.main_speed_radps * p.main_radius_m
    blades = p.main_drag_coefficient * p.main_blades * p.main_chord_m / 8.0
    return MainRotorParams(
        hub_stiffness=p.hub_stiffness_nmprad,
        hub_height=p.hub_height_m,
        speed=p.main_speed_radps,
        profile_power=p.air_density_kgpm3 * tip * p.main_radius_m * blades,
        tip_speed=tip,
        pitch_gain=p.collective_gain_rad,
        pitch_offset=p.collective_offset_rad,
    )


def _servo_params(p: "HelicopterParameters") -> ServoParams:
    on = p.terms
    # By virtual work: moment of the blades per rad of pitch, times pitch per angle of the servo
    per_rad = p.main_blades * p.blade_feathering_kgm2 * p.main_speed_radps**2
    arm = abs(p.collective_gain_rad) / p.servo_throw_rad
    share = on.servo_load * per_rad * arm / p.servo_stall_torque_nm
    up = math.copysign(share, p.collective_gain_rad)
    return ServoParams(
        p.servo_bandwidth_radps**2,
        2.0 * p.servo_damping * p.servo_bandwidth_radps,
        p.servo_rate_limit_per_s,
        p.servo_travel,
        Imperfections(
            present=on.servo_resolution or on.servo_dead_band or on.servo_load or on.swash_servos,
            resolution=on.servo_resolution * p.servo_resolution,
            half_band=on.servo_dead_band * 0.5 * p.servo_dead_band,
            load_slope=up * p.collective_gain_rad,
            load_offset=up * p.collective_offset_rad,
            swash=on.swash_servos,
            slow=p.servo_slow_share if on.swash_servos else 1.0,
        ),
    )


def _tail_stall(p: "HelicopterParameters") -> float:
    """Thrust (N) of the tail rotor with all its blades at their stall: C_T / sigma = C_l / 6."""
    tip = p.main_speed_radps * p.tail_gear_ratio * p.tail_radius_m
    blades = p.tail_blades * p.tail_chord_m * p.tail_radius_m
    return p.air_density_kgpm3 * blades * tip**2 * p.tail_lift_coefficient / 6.0


def _engine_params(
    p: "HelicopterParameters", rotor: RotorParams, main: MainRotorParams
) -> EngineParams:
    power = p.drive_efficiency * p.engine_power_w
    # dP/dtheta of hover at constant speed: T = 2 rho A v^2, P = T v, T = slope (blade theta - v)
    v_i = math.sqrt(p.mass_kg * p.gravity_mps2 / rotor.disc)
    lift = rotor.thrust_slope * rotor.blade_speed
    lift /= 1.0 + rotor.thrust_slope / (2.0 * rotor.disc * v_i)
    tip = p.main_speed_radps * p.tail_gear_ratio * p.tail_radius_m
    blades = p.tail_drag_coefficient * p.tail_blades * p.tail_chord_m / 8.0
    return EngineParams(
        speed=p.main_speed_radps,
        inertia=p.drive_inertia_kgm2,
        main_inertia=p.main_blades * p.blade_inertia_kgm2,
        power=power,
        rate=1.0 / p.engine_time_constant_s,
        proportional=p.governor_proportional_s,
        integral=p.governor_integral,
        feed_forward=p.governor_feed_forward * 1.5 * v_i * lift / power,
        pitch_gain=main.pitch_gain,
        pitch_offset=main.pitch_offset,
        tail_profile=p.air_density_kgpm3 * tip * p.tail_radius_m * blades,
        tail_tip_speed=tip,
        burnt=p.fuel_per_energy_kgpj / p.drive_efficiency,
        tank=p.fuel_kg,
        spool=FREE,
    )


def lock_number(p: "HelicopterParameters") -> float:
    """gamma_mr = rho c C_la R^4 / I_beta of the main rotor's blades."""
    lift = p.air_density_kgpm3 * p.main_chord_m * p.main_lift_slope * p.main_radius_m**4
    return lift / p.blade_inertia_kgm2


def _flapping_params(p: "HelicopterParameters") -> FlappingParams:
    rate = 1.0 / p.flap_time_constant_s
    a_bs, b_as = p.flap_a_bs_per_s, p.flap_b_as_per_s
    if p.coupling == "eq7":
        stiffness = lock_number(p) * p.main_speed_radps**2 * p.blade_inertia_kgm2
        # eq. (7) is dimensionless, so it enters eq. (6) divided by tau
        a_bs = 8.0 * p.hub_stiffness_nmprad / stiffness * rate
        b_as = -a_bs
    return FlappingParams(
        rate,
        a_bs,
        b_as,
        p.flap_lon_from_lon_rad,
        p.flap_lon_from_lat_rad,
        p.flap_lat_from_lat_rad,
        p.flap_lat_from_lon_rad,
        p.flap_back_radpmps,
    )


def _hover_inflow_sq(p: "HelicopterParameters") -> float:
    """Square of the induced velocity that carries the weight in hover, m2/s2."""
    disc = 2.0 * p.air_density_kgpm3 * math.pi * p.main_radius_m**2
    return p.mass_kg * p.gravity_mps2 / disc


def _flap_back_params(p: "HelicopterParameters") -> FlapBackParams:
    lock = lock_number(p)
    spring = p.hub_stiffness_nmprad / (p.blade_inertia_kgm2 * p.main_speed_radps**2)
    tip_sq = (p.main_speed_radps * p.main_radius_m) ** 2
    solidity = p.main_blades * p.main_chord_m / (math.pi * p.main_radius_m)
    radius_sq = p.bar_inner_radius_m**2 + p.bar_outer_radius_m**2
    return FlapBackParams(
        blade_rate=lock * p.main_speed_radps / 16.0,
        coning=lock / 8.0 / (1.0 + spring),
        bar_gain=p.bar_gain,
        bar_radius_sq=radius_sq,
        bar_inflow=paddle_inflow(
            2.0 * _hover_inflow_sq(p) / tip_sq,
            p.main_lift_slope * solidity,
            math.sqrt(0.5 * radius_sq) / p.main_radius_m,
        ),
    )


def _ground_params(p: "HelicopterParameters") -> GroundParams:
    length, width, down = p.gear_half_length_m, p.gear_half_width_m, p.gear_height_m
    points = np.array(
        [
            [length, width, down],
            [length, -width, down],
            [-length, width, down],
            [-length, -width, down],
            [-p.tail_arm_m, 0.0, -p.tail_height_m],
            [0.0, 0.0, -p.hub_height_m],
        ]
    )
    reach = float(np.linalg.norm(points, axis=1).max())
    return GroundParams(
        points,
        reach,
        p.gear_stiffness_npm,
        p.gear_damping_nspm,
        p.gear_friction,
        p.gear_hard_impact_mps,
        np.zeros(2),
        plane_of((0.0, 0.0)),
    )


# -------------------------------------------------------------------------------------------------
# Parameters.
# -------------------------------------------------------------------------------------------------

__all__ = ["AircraftError", "HelicopterParams", "HelicopterParameters"]


@dataclass(frozen=True)
class HelicopterParameters(DriveParameters):
    """An aircraft, SI units and rad; `terms`, which no file holds, says what it flies with.

    Raises
    ------
    AircraftError
        From the constructor or `from_yaml`: a value missing, unknown, of the wrong type, not finite
        or out of bounds.
    """

    mass_kg: float = number("body.mass_kg", "m", "kg", 0.0, 1e3, "mass")
    inertia_xx_kgm2: float = number(
        "body.inertia_xx_kgm2", "Jxx", "kg m2", 0.0, 1e3, "roll inertia"
    )
    inertia_yy_kgm2: float = number(
        "body.inertia_yy_kgm2", "Jyy", "kg m2", 0.0, 1e3, "pitch inertia"
    )
    inertia_zz_kgm2: float = number("body.inertia_zz_kgm2", "Jzz", "kg m2", 0.0, 1e3, "yaw inertia")
    gravity_mps2: float = number("environment.gravity_mps2", "g", "m/s2", 0.0, 30.0, "gravity")
    air_density_kgpm3: float = number(
        "environment.air_density_kgpm3", "rho", "kg/m3", 0.0, 3.0, "air density"
    )
    main_speed_radps: float = number(
        "main_rotor.speed_radps", "Omega_mr", "rad/s", 0.0, 1e3, "main rotor speed"
    )
    main_blades: float = number("main_rotor.blades", "b_mr", "1", 0.0, 10.0, "number of blades")
    main_radius_m: float = number("main_rotor.radius_m", "R_mr", "m", 0.0, 10.0, "radius")
    main_chord_m: float = number("main_rotor.chord_m", "c_mr", "m", 0.0, 2.0, "blade chord")
    main_lift_slope: float = number(
        "main_rotor.lift_slope_per_rad", "C_la_mr", "1/rad", 0.0, 10.0, "blade lift slope"
    )
    main_drag_coefficient: float = number(
        "main_rotor.drag_coefficient", "C_D0", "1", 0.0, 1.0, "blade profile drag", closed=True
    )
    hub_stiffness_nmprad: float = number(
        "main_rotor.hub_stiffness_nmprad",
        "K_beta",
        "N m/rad",
        0.0,
        1e5,
        "hub stiffness",
        closed=True,
    )
    hub_height_m: float = number(
        "main_rotor.hub_height_m", "H_mr", "m", 0.0, 5.0, "hub above the c.g."
    )
    blade_inertia_kgm2: float = number(
        "main_rotor.blade_inertia_kgm2", "I_beta", "kg m2", 0.0, 1e2, "flapping inertia of a blade"
    )
    collective_gain_rad: float = number(
        "main_rotor.collective_gain_rad", "K_col", "rad", -2.0, 2.0, "blade pitch per unit of d_col"
    )
    collective_offset_rad: float = number(
        "main_rotor.collective_offset_rad",
        "theta_col0",
        "rad",
        -1.0,
        1.0,
        "blade pitch at d_col = 0",
    )
    flap_time_constant_s: float = number(
        "flapping.time_constant_s", "tau", "s", 1e-3, 10.0, "flapping with stabiliser bar"
    )
    flap_a_bs_per_s: float = number(
        "flapping.a_bs_per_s", "A_bs", "1/s", -100.0, 100.0, "lateral into longitudinal flapping"
    )
    flap_b_as_per_s: float = number(
        "flapping.b_as_per_s", "B_as", "1/s", -100.0, 100.0, "longitudinal into lateral flapping"
    )
    flap_lon_from_lon_rad: float = number(
        "flapping.lon_from_lon_rad", "A_lon", "rad", -2.0, 2.0, "longitudinal cyclic per d_lon"
    )
    flap_lon_from_lat_rad: float = number(
        "flapping.lon_from_lat_rad", "A_lat", "rad", -2.0, 2.0, "longitudinal cyclic per d_lat"
    )
    flap_lat_from_lat_rad: float = number(
        "flapping.lat_from_lat_rad", "B_lat", "rad", -2.0, 2.0, "lateral cyclic per d_lat"
    )
    flap_lat_from_lon_rad: float = number(
        "flapping.lat_from_lon_rad", "B_lon", "rad", -2.0, 2.0, "lateral cyclic per d_lon"
    )
    flap_back_radpmps: float = number(
        "flapping.flap_back_radpmps", "da_s/du", "rad s/m", 0.0, 0.1, "flap-back", closed=True
    )
    bar_gain: float = number(
        "stabiliser_bar.gain",
        "K_sb",
        "1",
        0.0,
        5.0,
        "blade pitch per tilt of the bar; 0: no bar",
        closed=True,
    )
    bar_inner_radius_m: float = number(
        "stabiliser_bar.inner_radius_m", "r_1", "m", 0.0, 5.0, "where the paddles begin"
    )
    bar_outer_radius_m: float = number(
        "stabiliser_bar.outer_radius_m", "r_2", "m", 0.0, 5.0, "where the paddles end"
    )
    tail_gear_ratio: float = number(
        "tail_rotor.gear_ratio", "n_tr", "1", 0.0, 20.0, "tail rotor speed over main rotor speed"
    )
    tail_blades: float = number("tail_rotor.blades", "b_tr", "1", 0.0, 10.0, "number of blades")
    tail_radius_m: float = number("tail_rotor.radius_m", "R_tr", "m", 0.0, 2.0, "radius")
    tail_chord_m: float = number("tail_rotor.chord_m", "c_tr", "m", 0.0, 1.0, "blade chord")
    tail_lift_slope: float = number(
        "tail_rotor.lift_slope_per_rad", "C_la_tr", "1/rad", 0.0, 10.0, "blade lift slope"
    )
    tail_arm_m: float = number("tail_rotor.arm_m", "D_tr", "m", 0.0, 10.0, "behind the c.g.")
    tail_height_m: float = number("tail_rotor.height_m", "H_tr", "m", -2.0, 2.0, "above the c.g.")
    pedal_gain: float = number(
        "tail_rotor.pedal_gain", "K_ped", "1", -10.0, 10.0, "blade pitch per gyro output"
    )
    pedal_offset_rad: float = number(
        "tail_rotor.pedal_offset_rad", "theta_ped0", "rad", -1.0, 1.0, "blade pitch at output 0"
    )
    drag_area_x_m2: float = number(
        "fuselage.drag_area_x_m2", "S_fx", "m2", 0.0, 10.0, "drag area, front", closed=True
    )
    drag_area_y_m2: float = number(
        "fuselage.drag_area_y_m2", "S_fy", "m2", 0.0, 10.0, "drag area, side", closed=True
    )
    drag_area_z_m2: float = number(
        "fuselage.drag_area_z_m2", "S_fz", "m2", 0.0, 10.0, "drag area, top", closed=True
    )
    wash_area_y_m2: float = number(
        "fuselage.wash_area_y_m2", "S_wy", "m2", 0.0, 10.0, "side, in the downwash", closed=True
    )
    hfin_area_m2: float = number(
        "horizontal_fin.area_m2", "S_hf", "m2", 0.0, 5.0, "area", closed=True
    )
    hfin_lift_slope: float = number(
        "horizontal_fin.lift_slope_per_rad", "C_la_hf", "1/rad", 0.0, 10.0, "lift slope"
    )
    hfin_arm_m: float = number("horizontal_fin.arm_m", "D_hf", "m", 0.0, 10.0, "behind the c.g.")
    vfin_area_m2: float = number(
        "vertical_fin.area_m2", "S_vf", "m2", 0.0, 5.0, "area", closed=True
    )
    vfin_lift_slope: float = number(
        "vertical_fin.lift_slope_per_rad", "C_la_vf", "1/rad", 0.0, 10.0, "lift slope"
    )
    vfin_arm_m: float = number("vertical_fin.arm_m", "D_vf", "m", 0.0, 10.0, "behind the c.g.")
    vfin_height_m: float = number("vertical_fin.height_m", "H_vf", "m", -2.0, 2.0, "above the c.g.")
    fin_stall_onset: float = number(
        "fins.stall_onset", "-", "1", 0.0, 1.0, "flow ratio where stall begins"
    )
    fin_stall_full: float = number(
        "fins.stall_full", "-", "1", 0.0, 10.0, "flow ratio where stall is complete"
    )
    gyro_proportional_s: float = number(
        "yaw_gyro.proportional_s", "K_P", "s", 0.0, 100.0, "proportional gain", closed=True
    )
    gyro_integral: float = number("yaw_gyro.integral", "K_I", "1", 0.0, 1e3, "integral gain")
    gyro_pedal_gain_radps: float = number(
        "yaw_gyro.pedal_gain_radps", "K_a", "rad/s", -100.0, 100.0, "yaw rate per unit of d_ped"
    )
    servo_bandwidth_radps: float = number(
        "servo.bandwidth_radps", "omega_s", "rad/s", 0.0, 300.0, "natural frequency"
    )
    servo_damping: float = number("servo.damping", "zeta_s", "1", 0.0, 3.0, "damping ratio")
    servo_rate_limit_per_s: float = number(
        "servo.rate_limit_per_s", "-", "1/s", 0.0, 1e3, "largest speed"
    )
    servo_travel: float = number("servo.travel", "-", "1", 0.0, 1.0001, "end stops at +- this")
    gear_height_m: float = number(
        "landing_gear.height_m", "-", "m", 0.0, 5.0, "skids below the c.g."
    )
    gear_half_length_m: float = number(
        "landing_gear.half_length_m", "-", "m", 0.0, 5.0, "skid ends before and behind the c.g."
    )
    gear_half_width_m: float = number(
        "landing_gear.half_width_m", "-", "m", 0.0, 5.0, "skids beside the c.g."
    )
    gear_stiffness_npm: float = number(
        "landing_gear.stiffness_npm", "-", "N/m", 0.0, 1e6, "stiffness of one contact point"
    )
    gear_damping_nspm: float = number(
        "landing_gear.damping_nspm",
        "-",
        "N s/m",
        0.0,
        1e5,
        "damping of one contact point",
        closed=True,
    )
    gear_friction: float = number(
        "landing_gear.friction", "-", "1", 0.0, 2.0, "Coulomb friction", closed=True
    )
    gear_hard_impact_mps: float = number(
        "landing_gear.hard_impact_mps",
        "-",
        "m/s",
        0.0,
        100.0,
        "vertical speed that breaks the gear",
    )
    coupling: str = field(
        default="identified",
        metadata={
            "key": "flapping.coupling",
            "choices": COUPLINGS,
            "meaning": "identified: A_bs, B_as of the file; eq7: from hub stiffness by eq. (7)",
        },
    )
    ground_effect: str = field(
        default="cheeseman_bennett",
        metadata={
            "key": "main_rotor.ground_effect",
            "choices": MODELS,
            "meaning": "law of the induced velocity near the ground",
        },
    )
    terms: ModelOptions = ModelOptions()
    """Which terms fly; no part of the file, all off unless `replace` turns them on."""

    def __post_init__(self) -> None:
        for item in file_fields(self):
            check(item.metadata, getattr(self, item.name))
        if self.fin_stall_full <= self.fin_stall_onset:
            raise AircraftError(
                f"{self.fin_stall_full} is not allowed",
                ParameterCause.CONFLICT,
                key="fins.stall_full",
                value=self.fin_stall_full,
                allowed=f"more than fins.stall_onset, {self.fin_stall_onset}",
            )
        a, b, c = sorted((self.inertia_xx_kgm2, self.inertia_yy_kgm2, self.inertia_zz_kgm2))
        if c > a + b:
            raise AircraftError(
                f"the largest, {c} kg m2, exceeds the others' sum, {a + b:g}: "
                "no rigid body is like that",
                ParameterCause.CONFLICT,
                key="body.inertia_*",
                value=c,
            )

    @classmethod
    def from_yaml(cls, path: str | Path) -> "HelicopterParameters":
        """Read an aircraft file.

        Parameters
        ----------
        path : path
            A YAML file; a bare name such as `helion.yaml` is looked up in the packaged folder.

        Raises
        ------
        AircraftError
        """
        file = find_aircraft(path)
        try:
            return cls.from_values(read_groups(file))
        except AircraftError as error:
            raise error.placed(str(file), error.key) from None

    @classmethod
    def from_values(cls, flat: Mapping[str, Any]) -> "HelicopterParameters":
        """Build from `{group.key: value}`, all keys of the file; raises AircraftError."""
        by_key = {item.metadata["key"]: item for item in file_fields(cls)}
        for key in flat:
            if key not in by_key:
                near = difflib.get_close_matches(key, by_key, n=1)
                hint = f"; did you mean {near[0]}?" if near else ""
                raise AircraftError(
                    f"unknown key{hint}", ParameterCause.UNKNOWN_KEY, key=key, meant="".join(near)
                )
        values = {}
        for key, item in by_key.items():
            if key not in flat:
                raise AircraftError(
                    "missing", ParameterCause.MISSING, key=key, allowed=allowed(item.metadata)
                )
            value = flat[key]
            if isinstance(value, int) and not isinstance(value, bool):
                try:
                    value = float(value)
                except OverflowError:
                    raise AircraftError(
                        "too large a number",
                        ParameterCause.BOUNDS,
                        key=key,
                        value=value,
                        allowed=allowed(item.metadata),
                    ) from None
            values[item.name] = value
        return cls(**values)

    @cached_property
    def params(self) -> HelicopterParams:
        """The values as the compiled kernels take them."""
        return helicopter_params(self)


# -------------------------------------------------------------------------------------------------
# The aircraft that flies as a multiple of that of its file, which the controllers keep.
# -------------------------------------------------------------------------------------------------

PREFIX = "scale."
SCALED: Mapping[str, tuple[str, ...]] = {
    "mass": ("mass_kg",),
    "inertia": ("inertia_xx_kgm2", "inertia_yy_kgm2", "inertia_zz_kgm2"),
    "rotor_stiffness": ("hub_stiffness_nmprad",),
    # The thrust map, T = slope (blade speed - inflow): its slope is proportional to this one.
    "thrust": ("main_lift_slope",),
    "servo_speed": ("servo_bandwidth_radps", "servo_rate_limit_per_s"),
    "drag": ("drag_area_x_m2", "drag_area_y_m2", "drag_area_z_m2", "wash_area_y_m2"),
}
"""Per scale what it multiplies. One factor for the three inertias: they stay a rigid body's."""


def scaled(aircraft: HelicopterParameters, values: Mapping[str, Any]) -> HelicopterParameters:
    """The aircraft times the plant's parameters `scale.*`.

    Parameters
    ----------
    aircraft : HelicopterParameters
        Of the file.
    values : mapping
        Parameters of the node `plant`.

    Raises
    ------
    AircraftError
        A product is out of bounds.
    """
    changes = {
        name: getattr(aircraft, name) * values[PREFIX + scale]
        for scale, names in SCALED.items()
        for name in names
    }
    return replace(aircraft, **changes)
