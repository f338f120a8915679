# SPDX-License-Identifier: Apache-2.0
"""Parameters of an aircraft: one frozen dataclass, read from YAML and checked.

A field carries its place in the file, symbol, unit, bounds and meaning, so that a wrong value is
refused by name. `HelicopterParameters.kernel` is what the compiled kernels take.
"""

import difflib
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from heli_dynamics_sim.aircraft_file import (
    COUPLINGS,
    AircraftError,
    allowed,
    check,
    file_fields,
    find_aircraft,
    number,
    read_groups,
)
from heli_dynamics_sim.aircraft_kernel import HelicopterKernel, helicopter_kernel
from heli_dynamics_sim.drive_parameters import DriveParameters
from heli_dynamics_sim.ground_effect import MODELS
from heli_dynamics_sim.terms import Terms

__all__ = ["AircraftError", "HelicopterKernel", "HelicopterParameters"]


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
    terms: Terms = Terms()
    """Which terms fly; no part of the file, all off unless `replace` turns them on."""

    def __post_init__(self) -> None:
        for item in file_fields(self):
            check(item.metadata, getattr(self, item.name))
        if self.fin_stall_full <= self.fin_stall_onset:
            raise AircraftError(
                f"fins.stall_full: {self.fin_stall_full} is not allowed; allowed: more than "
                f"fins.stall_onset, {self.fin_stall_onset}"
            )
        a, b, c = sorted((self.inertia_xx_kgm2, self.inertia_yy_kgm2, self.inertia_zz_kgm2))
        if c > a + b:
            raise AircraftError(
                f"body.inertia_*: the largest, {c} kg m2, exceeds the others' sum, {a + b:g}: "
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
            return cls.from_values(read_groups(file))
        except AircraftError as error:
            raise AircraftError(f"{file}: {error}") from None

    @classmethod
    def from_values(cls, flat: Mapping[str, Any]) -> "HelicopterParameters":
        """Build from `{group.key: value}`, all keys of the file; raises AircraftError."""
        by_key = {item.metadata["key"]: item for item in file_fields(cls)}
        for key in flat:
            if key not in by_key:
                near = difflib.get_close_matches(key, by_key, n=1)
                hint = f"; did you mean {near[0]}?" if near else ""
                raise AircraftError(f"{key}: unknown key{hint}")
        values = {}
        for key, item in by_key.items():
            if key not in flat:
                raise AircraftError(f"{key}: missing; allowed: {allowed(item.metadata)}")
            value = flat[key]
            if isinstance(value, int) and not isinstance(value, bool):
                try:
                    value = float(value)
                except OverflowError:
                    asked = allowed(item.metadata)
                    raise AircraftError(f"{key}: too large a number; allowed: {asked}") from None
            values[item.name] = value
        return cls(**values)

    @cached_property
    def kernel(self) -> HelicopterKernel:
        """The values as the compiled kernels take them."""
        return helicopter_kernel(self)
