# SPDX-License-Identifier: Apache-2.0
"""Parameters that only terms read: servos as they are, engine and governor, limits of the tail."""

from dataclasses import dataclass

from heli_dynamics_sim.aircraft_file import number


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
