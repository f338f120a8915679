# SPDX-License-Identifier: Apache-2.0
"""Parameters of an aircraft: one frozen dataclass, read from YAML and checked.

A field carries its place in the file, symbol, unit, bounds and meaning, so that a wrong value is
refused by name. `HelicopterParameters.kernel` is what the compiled kernels take.
"""

import difflib
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import yaml

from heli_dynamics_sim.airframe import FinKernel, FuselageKernel
from heli_dynamics_sim.ground import GroundKernel
from heli_dynamics_sim.rigid_body import BodyKernel
from heli_dynamics_sim.rotor import FlappingKernel, MainRotorKernel, RotorKernel
from heli_dynamics_sim.servo import ServoKernel
from heli_dynamics_sim.yaw_gyro import GyroKernel

COUPLINGS = ("identified", "eq7")
CLIMB_POWER_KINKED, CLIMB_POWER_ON, CLIMB_POWER_OFF = 0.0, 1.0, -1.0


class AircraftError(ValueError):
    """An aircraft file that cannot be used; the message names file, key, value and what is allowed."""


class HelicopterKernel(NamedTuple):
    """All that the derivative kernel reads."""

    body: BodyKernel
    rotor: RotorKernel
    main: MainRotorKernel
    flapping: FlappingKernel
    tail: RotorKernel
    tail_arm: float  # D_tr, m
    tail_height: float  # H_tr, m
    gyro: GyroKernel
    fuselage: FuselageKernel
    horizontal_fin: FinKernel
    vertical_fin: FinKernel
    servo: ServoKernel
    ground: GroundKernel
    climb_power: float  # 0: P_climb only in climb (kink at w_a = 0), 1: always, -1: never


def _number(
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


@dataclass(frozen=True)
class HelicopterParameters:
    """An aircraft, SI units and rad.

    Raises
    ------
    AircraftError
        From the constructor or `from_yaml`: a value missing, unknown, of the wrong type, not finite
        or out of bounds.
    """

    mass_kg: float = _number("body.mass_kg", "m", "kg", 0.0, 1e3, "mass")
    inertia_xx_kgm2: float = _number(
        "body.inertia_xx_kgm2", "Jxx", "kg m2", 0.0, 1e3, "roll inertia"
    )
    inertia_yy_kgm2: float = _number(
        "body.inertia_yy_kgm2", "Jyy", "kg m2", 0.0, 1e3, "pitch inertia"
    )
    inertia_zz_kgm2: float = _number(
        "body.inertia_zz_kgm2", "Jzz", "kg m2", 0.0, 1e3, "yaw inertia"
    )
    gravity_mps2: float = _number("environment.gravity_mps2", "g", "m/s2", 0.0, 30.0, "gravity")
    air_density_kgpm3: float = _number(
        "environment.air_density_kgpm3", "rho", "kg/m3", 0.0, 3.0, "air density"
    )
    main_speed_radps: float = _number(
        "main_rotor.speed_radps", "Omega_mr", "rad/s", 0.0, 1e3, "main rotor speed"
    )
    main_blades: float = _number("main_rotor.blades", "b_mr", "1", 0.0, 10.0, "number of blades")
    main_radius_m: float = _number("main_rotor.radius_m", "R_mr", "m", 0.0, 10.0, "radius")
    main_chord_m: float = _number("main_rotor.chord_m", "c_mr", "m", 0.0, 2.0, "blade chord")
    main_lift_slope: float = _number(
        "main_rotor.lift_slope_per_rad", "C_la_mr", "1/rad", 0.0, 10.0, "blade lift slope"
    )
    main_drag_coefficient: float = _number(
        "main_rotor.drag_coefficient", "C_D0", "1", 0.0, 1.0, "blade profile drag", closed=True
    )
    hub_stiffness_nmprad: float = _number(
        "main_rotor.hub_stiffness_nmprad",
        "K_beta",
        "N m/rad",
        0.0,
        1e5,
        "hub stiffness",
        closed=True,
    )
    hub_height_m: float = _number(
        "main_rotor.hub_height_m", "H_mr", "m", 0.0, 5.0, "hub above the c.g."
    )
    blade_inertia_kgm2: float = _number(
        "main_rotor.blade_inertia_kgm2", "I_beta", "kg m2", 0.0, 1e2, "flapping inertia of a blade"
    )
    collective_gain_rad: float = _number(
        "main_rotor.collective_gain_rad", "K_col", "rad", -2.0, 2.0, "blade pitch per unit of d_col"
    )
    collective_offset_rad: float = _number(
        "main_rotor.collective_offset_rad",
        "theta_col0",
        "rad",
        -1.0,
        1.0,
        "blade pitch at d_col = 0",
    )
    flap_time_constant_s: float = _number(
        "flapping.time_constant_s", "tau", "s", 1e-3, 10.0, "flapping with stabiliser bar"
    )
    flap_a_bs_per_s: float = _number(
        "flapping.a_bs_per_s", "A_bs", "1/s", -100.0, 100.0, "lateral into longitudinal flapping"
    )
    flap_b_as_per_s: float = _number(
        "flapping.b_as_per_s", "B_as", "1/s", -100.0, 100.0, "longitudinal into lateral flapping"
    )
    flap_lon_from_lon_rad: float = _number(
        "flapping.lon_from_lon_rad", "A_lon", "rad", -2.0, 2.0, "longitudinal cyclic per d_lon"
    )
    flap_lon_from_lat_rad: float = _number(
        "flapping.lon_from_lat_rad", "A_lat", "rad", -2.0, 2.0, "longitudinal cyclic per d_lat"
    )
    flap_lat_from_lat_rad: float = _number(
        "flapping.lat_from_lat_rad", "B_lat", "rad", -2.0, 2.0, "lateral cyclic per d_lat"
    )
    flap_lat_from_lon_rad: float = _number(
        "flapping.lat_from_lon_rad", "B_lon", "rad", -2.0, 2.0, "lateral cyclic per d_lon"
    )
    flap_back_radpmps: float = _number(
        "flapping.flap_back_radpmps", "da_s/du", "rad s/m", 0.0, 0.1, "flap-back", closed=True
    )
    tail_gear_ratio: float = _number(
        "tail_rotor.gear_ratio", "n_tr", "1", 0.0, 20.0, "tail rotor speed over main rotor speed"
    )
    tail_blades: float = _number("tail_rotor.blades", "b_tr", "1", 0.0, 10.0, "number of blades")
    tail_radius_m: float = _number("tail_rotor.radius_m", "R_tr", "m", 0.0, 2.0, "radius")
    tail_chord_m: float = _number("tail_rotor.chord_m", "c_tr", "m", 0.0, 1.0, "blade chord")
    tail_lift_slope: float = _number(
        "tail_rotor.lift_slope_per_rad", "C_la_tr", "1/rad", 0.0, 10.0, "blade lift slope"
    )
    tail_arm_m: float = _number("tail_rotor.arm_m", "D_tr", "m", 0.0, 10.0, "behind the c.g.")
    tail_height_m: float = _number("tail_rotor.height_m", "H_tr", "m", -2.0, 2.0, "above the c.g.")
    pedal_gain: float = _number(
        "tail_rotor.pedal_gain", "K_ped", "1", -10.0, 10.0, "blade pitch per gyro output"
    )
    pedal_offset_rad: float = _number(
        "tail_rotor.pedal_offset_rad", "theta_ped0", "rad", -1.0, 1.0, "blade pitch at output 0"
    )
    drag_area_x_m2: float = _number(
        "fuselage.drag_area_x_m2", "S_fx", "m2", 0.0, 10.0, "drag area, front", closed=True
    )
    drag_area_y_m2: float = _number(
        "fuselage.drag_area_y_m2", "S_fy", "m2", 0.0, 10.0, "drag area, side", closed=True
    )
    drag_area_z_m2: float = _number(
        "fuselage.drag_area_z_m2", "S_fz", "m2", 0.0, 10.0, "drag area, top", closed=True
    )
    hfin_area_m2: float = _number(
        "horizontal_fin.area_m2", "S_hf", "m2", 0.0, 5.0, "area", closed=True
    )
    hfin_lift_slope: float = _number(
        "horizontal_fin.lift_slope_per_rad", "C_la_hf", "1/rad", 0.0, 10.0, "lift slope"
    )
    hfin_arm_m: float = _number("horizontal_fin.arm_m", "D_hf", "m", 0.0, 10.0, "behind the c.g.")
    vfin_area_m2: float = _number(
        "vertical_fin.area_m2", "S_vf", "m2", 0.0, 5.0, "area", closed=True
    )
    vfin_lift_slope: float = _number(
        "vertical_fin.lift_slope_per_rad", "C_la_vf", "1/rad", 0.0, 10.0, "lift slope"
    )
    vfin_arm_m: float = _number("vertical_fin.arm_m", "D_vf", "m", 0.0, 10.0, "behind the c.g.")
    vfin_height_m: float = _number(
        "vertical_fin.height_m", "H_vf", "m", -2.0, 2.0, "above the c.g."
    )
    fin_stall_onset: float = _number(
        "fins.stall_onset", "-", "1", 0.0, 1.0, "flow ratio where stall begins"
    )
    fin_stall_full: float = _number(
        "fins.stall_full", "-", "1", 0.0, 10.0, "flow ratio where stall is complete"
    )
    gyro_proportional_s: float = _number(
        "yaw_gyro.proportional_s", "K_P", "s", 0.0, 100.0, "proportional gain", closed=True
    )
    gyro_integral: float = _number("yaw_gyro.integral", "K_I", "1", 0.0, 1e3, "integral gain")
    gyro_pedal_gain_radps: float = _number(
        "yaw_gyro.pedal_gain_radps", "K_a", "rad/s", -100.0, 100.0, "yaw rate per unit of d_ped"
    )
    servo_bandwidth_radps: float = _number(
        "servo.bandwidth_radps", "omega_s", "rad/s", 0.0, 300.0, "natural frequency"
    )
    servo_damping: float = _number("servo.damping", "zeta_s", "1", 0.0, 3.0, "damping ratio")
    servo_rate_limit_per_s: float = _number(
        "servo.rate_limit_per_s", "-", "1/s", 0.0, 1e3, "largest speed"
    )
    servo_travel: float = _number("servo.travel", "-", "1", 0.0, 1.0001, "end stops at +- this")
    gear_height_m: float = _number(
        "landing_gear.height_m", "-", "m", 0.0, 5.0, "skids below the c.g."
    )
    gear_half_length_m: float = _number(
        "landing_gear.half_length_m", "-", "m", 0.0, 5.0, "skid ends before and behind the c.g."
    )
    gear_half_width_m: float = _number(
        "landing_gear.half_width_m", "-", "m", 0.0, 5.0, "skids beside the c.g."
    )
    gear_stiffness_npm: float = _number(
        "landing_gear.stiffness_npm", "-", "N/m", 0.0, 1e6, "stiffness of one contact point"
    )
    gear_damping_nspm: float = _number(
        "landing_gear.damping_nspm",
        "-",
        "N s/m",
        0.0,
        1e5,
        "damping of one contact point",
        closed=True,
    )
    gear_friction: float = _number(
        "landing_gear.friction", "-", "1", 0.0, 2.0, "Coulomb friction", closed=True
    )
    gear_hard_impact_mps: float = _number(
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
            "meaning": "identified: A_bs, B_as of the file; eq7: from hub stiffness by eq. (7)",
        },
    )

    def __post_init__(self) -> None:
        for item in fields(self):
            _check(item.metadata, getattr(self, item.name))
        if self.fin_stall_full <= self.fin_stall_onset:
            raise AircraftError(
                f"fins.stall_full: {self.fin_stall_full} is not allowed; allowed: more than "
                f"fins.stall_onset, {self.fin_stall_onset}"
            )
        a, b, c = sorted((self.inertia_xx_kgm2, self.inertia_yy_kgm2, self.inertia_zz_kgm2))
        if c > a + b:
            raise AircraftError(
                f"body.inertia_*: the largest, {c} kg m2, exceeds the sum of the other two, {a + b:g}: "
                "no rigid body is like that"
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
            tree = yaml.safe_load(file.read_text(encoding="utf-8"))
        except (OSError, UnicodeDecodeError) as error:
            raise AircraftError(f"{file}: cannot be read: {error}") from error
        except yaml.YAMLError as error:
            reason = str(error).replace("\n", " ")
            raise AircraftError(f"{file}: is not valid YAML: {reason}") from error
        try:
            return cls.from_mapping(tree)
        except AircraftError as error:
            raise AircraftError(f"{file}: {error}") from None

    @classmethod
    def from_mapping(cls, tree: Any) -> "HelicopterParameters":
        """Build from groups of values as in the file, see `from_yaml`."""
        flat = _flatten(tree)
        by_key = {item.metadata["key"]: item for item in fields(cls)}
        for key in flat:
            if key not in by_key:
                near = difflib.get_close_matches(key, by_key, n=1)
                hint = f"; did you mean {near[0]}?" if near else ""
                raise AircraftError(f"{key}: unknown key{hint}")
        values = {}
        for key, item in by_key.items():
            if key not in flat:
                raise AircraftError(f"{key}: missing; allowed: {_allowed(item.metadata)}")
            value = flat[key]
            if isinstance(value, int) and not isinstance(value, bool):
                value = float(value)
            values[item.name] = value
        return cls(**values)

    @cached_property
    def kernel(self) -> HelicopterKernel:
        """The values as the compiled kernels take them."""
        rho = self.air_density_kgpm3
        rotor = _rotor_kernel(
            rho,
            self.main_speed_radps,
            (self.main_radius_m, self.main_chord_m, self.main_blades, self.main_lift_slope),
        )
        tail = _rotor_kernel(
            rho,
            self.main_speed_radps * self.tail_gear_ratio,
            (self.tail_radius_m, self.tail_chord_m, self.tail_blades, self.tail_lift_slope),
        )
        tip = self.main_speed_radps * self.main_radius_m
        solidity = self.main_drag_coefficient * self.main_blades * self.main_chord_m / 8.0
        return HelicopterKernel(
            body=BodyKernel(
                self.mass_kg,
                self.inertia_xx_kgm2,
                self.inertia_yy_kgm2,
                self.inertia_zz_kgm2,
                self.gravity_mps2,
            ),
            rotor=rotor,
            main=MainRotorKernel(
                hub_stiffness=self.hub_stiffness_nmprad,
                hub_height=self.hub_height_m,
                speed=self.main_speed_radps,
                profile_power=rho * tip * self.main_radius_m * solidity,
                tip_speed=tip,
                pitch_gain=self.collective_gain_rad,
                pitch_offset=self.collective_offset_rad,
            ),
            flapping=self._flapping_kernel(),
            tail=tail,
            tail_arm=self.tail_arm_m,
            tail_height=self.tail_height_m,
            gyro=GyroKernel(
                self.gyro_proportional_s,
                self.gyro_integral,
                self.gyro_pedal_gain_radps,
                self.pedal_gain,
                self.pedal_offset_rad,
            ),
            fuselage=FuselageKernel(
                0.5 * rho * self.drag_area_x_m2,
                0.5 * rho * self.drag_area_y_m2,
                0.5 * rho * self.drag_area_z_m2,
            ),
            horizontal_fin=FinKernel(
                0.5 * rho * self.hfin_area_m2,
                self.hfin_lift_slope,
                self.hfin_arm_m,
                0.0,
                self.fin_stall_onset,
                self.fin_stall_full,
            ),
            vertical_fin=FinKernel(
                0.5 * rho * self.vfin_area_m2,
                self.vfin_lift_slope,
                self.vfin_arm_m,
                self.vfin_height_m,
                self.fin_stall_onset,
                self.fin_stall_full,
            ),
            servo=ServoKernel(
                self.servo_bandwidth_radps**2,
                2.0 * self.servo_damping * self.servo_bandwidth_radps,
                self.servo_rate_limit_per_s,
                self.servo_travel,
            ),
            ground=self._ground_kernel(),
            climb_power=CLIMB_POWER_KINKED,
        )

    def _flapping_kernel(self) -> FlappingKernel:
        rate = 1.0 / self.flap_time_constant_s
        a_bs, b_as = self.flap_a_bs_per_s, self.flap_b_as_per_s
        if self.coupling == "eq7":
            lock = (
                self.air_density_kgpm3
                * self.main_chord_m
                * self.main_lift_slope
                * self.main_radius_m**4
                / self.blade_inertia_kgm2
            )
            ratio = 8.0 * self.hub_stiffness_nmprad
            ratio /= lock * self.main_speed_radps**2 * self.blade_inertia_kgm2
            # eq. (7) is dimensionless, so it enters eq. (6) divided by tau
            a_bs, b_as = ratio * rate, -ratio * rate
        return FlappingKernel(
            rate,
            a_bs,
            b_as,
            self.flap_lon_from_lon_rad,
            self.flap_lon_from_lat_rad,
            self.flap_lat_from_lat_rad,
            self.flap_lat_from_lon_rad,
            self.flap_back_radpmps,
        )

    def _ground_kernel(self) -> GroundKernel:
        length, width, down = self.gear_half_length_m, self.gear_half_width_m, self.gear_height_m
        points = np.array(
            [
                [length, width, down],
                [length, -width, down],
                [-length, width, down],
                [-length, -width, down],
                [-self.tail_arm_m, 0.0, -self.tail_height_m],
                [0.0, 0.0, -self.hub_height_m],
            ]
        )
        return GroundKernel(
            points,
            float(np.linalg.norm(points, axis=1).max()),
            self.gear_stiffness_npm,
            self.gear_damping_nspm,
            self.gear_friction,
            self.gear_hard_impact_mps,
        )


def _rotor_kernel(
    rho: float, omega: float, blade: tuple[float, float, float, float]
) -> RotorKernel:
    """Thrust law of a rotor at speed omega (rad/s); blade = radius, chord, number, lift slope."""
    radius, chord, blades, lift_slope = blade
    return RotorKernel(
        thrust_slope=rho * omega * radius**2 * lift_slope * blades * chord / 4.0,
        blade_speed=2.0 / 3.0 * omega * radius,
        disc=2.0 * rho * math.pi * radius**2,
    )


def _allowed(rule: Mapping[str, Any]) -> str:
    """What a key may be, in words."""
    if "lower" not in rule:
        return "one of " + ", ".join(COUPLINGS)
    left = "[" if rule["closed"] else "("
    unit = "" if rule["unit"] == "1" else f" {rule['unit']}"
    return f"a number in {left}{rule['lower']:g}, {rule['upper']:g}){unit} ({rule['meaning']})"


def _check(rule: Mapping[str, Any], value: Any) -> None:
    """Refuse a value that its rule does not allow."""
    if "lower" not in rule:
        good = value in COUPLINGS
    else:
        good = (
            isinstance(value, (int, float))
            and not isinstance(value, bool)
            and math.isfinite(value)
            and (value >= rule["lower"] if rule["closed"] else value > rule["lower"])
            and value < rule["upper"]
        )
    if not good:
        raise AircraftError(f"{rule['key']}: {value!r} is not allowed; allowed: {_allowed(rule)}")


def _flatten(tree: Any) -> dict[str, Any]:
    """`{group: {key: value}}` as `{group.key: value}`."""
    if not isinstance(tree, dict):
        raise AircraftError("expected groups of keys (body:, main_rotor:, ...)")
    flat: dict[str, Any] = {}
    for group, content in tree.items():
        if not isinstance(content, dict):
            raise AircraftError(f"{group}: expected a group of keys, found {content!r}")
        for key, value in content.items():
            flat[f"{group}.{key}"] = value
    return flat


def config_folders() -> list[Path]:
    """Folders where the packaged YAML may lie: beside the sources, or in an install space's share/."""
    here = Path(__file__).resolve()
    share = Path("share") / "heli_dynamics_sim" / "config"
    return [here.parents[1] / "config", *(parent / share for parent in here.parents)]


def find_aircraft(path: str | Path) -> Path:
    """The file of an aircraft: a path that exists, or a bare name in the packaged folder.

    Raises
    ------
    AircraftError
        Names the packaged aircraft if there is none of that name.
    """
    file = Path(path)
    if file.is_file():
        return file
    known: set[str] = set()
    if file.name == str(path):
        for folder in config_folders():
            for candidate in sorted((folder / "aircraft").glob("*.yaml")):
                if candidate.name == file.name:
                    return candidate
                known.add(candidate.name)
        raise AircraftError(
            f"{path}: no such aircraft file; packaged ones: {', '.join(sorted(known)) or 'none found'}"
        )
    raise AircraftError(f"{path}: no such aircraft file")
