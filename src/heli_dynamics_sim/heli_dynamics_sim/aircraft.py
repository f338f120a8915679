# SPDX-License-Identifier: Apache-2.0
"""From the parameters of an aircraft to the numbers that its compiled kernels take."""

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from heli_dynamics_sim.airframe import FinKernel, FuselageKernel
from heli_dynamics_sim.engine import FREE, EngineKernel
from heli_dynamics_sim.flap_back import FlapBackKernel, paddle_inflow
from heli_dynamics_sim.ground import GroundKernel, plane_of
from heli_dynamics_sim.ground_effect import GroundEffectKernel
from heli_dynamics_sim.inflow import InflowKernel
from heli_dynamics_sim.rigid_body import BodyKernel
from heli_dynamics_sim.rotor import FlappingKernel, MainRotorKernel, RotorKernel
from heli_dynamics_sim.servo import Imperfections, ServoKernel
from heli_dynamics_sim.terms import Terms
from heli_dynamics_sim.yaw_gyro import GyroKernel

if TYPE_CHECKING:
    from heli_dynamics_sim.parameters import HelicopterParameters

_LEAST_FLOW = 0.25
"""The flow of the inflow's gradients at the least, over hover's (`inflow`)."""
CLIMB_POWER_KINKED, CLIMB_POWER_ON, CLIMB_POWER_OFF = 0.0, 1.0, -1.0


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
    tail_stall: float  # largest thrust of the tail rotor at the governed speed, N
    engine: EngineKernel
    terms: Terms  # which of those beyond the source's equations are on
    flap_back: FlapBackKernel
    inflow: InflowKernel
    ground_effect: GroundEffectKernel


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


def helicopter_kernel(p: "HelicopterParameters") -> HelicopterKernel:
    """All kernels' numbers of an aircraft."""
    half_rho = 0.5 * p.air_density_kgpm3
    main_blade = (p.main_radius_m, p.main_chord_m, p.main_blades, p.main_lift_slope)
    tail_blade = (p.tail_radius_m, p.tail_chord_m, p.tail_blades, p.tail_lift_slope)
    tail_speed = p.main_speed_radps * p.tail_gear_ratio
    stall = (p.fin_stall_onset, p.fin_stall_full)
    limited = p.terms.tail_authority
    rotor, main = (
        _rotor_kernel(p.air_density_kgpm3, p.main_speed_radps, main_blade),
        _main_kernel(p),
    )
    return HelicopterKernel(
        body=BodyKernel(
            p.mass_kg, p.inertia_xx_kgm2, p.inertia_yy_kgm2, p.inertia_zz_kgm2, p.gravity_mps2
        ),
        rotor=rotor,
        main=main,
        flapping=_flapping_kernel(p),
        tail=_rotor_kernel(p.air_density_kgpm3, tail_speed, tail_blade),
        tail_arm=p.tail_arm_m,
        tail_height=p.tail_height_m,
        gyro=GyroKernel(
            p.gyro_proportional_s,
            p.gyro_integral,
            p.gyro_pedal_gain_radps,
            p.pedal_gain,
            p.pedal_offset_rad,
            p.tail_pitch_min_rad if limited else -math.inf,
            p.tail_pitch_max_rad if limited else math.inf,
        ),
        fuselage=FuselageKernel(
            half_rho * p.drag_area_x_m2, half_rho * p.drag_area_y_m2, half_rho * p.drag_area_z_m2
        ),
        horizontal_fin=FinKernel(
            half_rho * p.hfin_area_m2, p.hfin_lift_slope, p.hfin_arm_m, 0.0, *stall
        ),
        vertical_fin=FinKernel(
            half_rho * p.vfin_area_m2, p.vfin_lift_slope, p.vfin_arm_m, p.vfin_height_m, *stall
        ),
        servo=_servo_kernel(p),
        ground=_ground_kernel(p),
        climb_power=CLIMB_POWER_KINKED,
        tail_stall=_tail_stall(p) if limited else math.inf,
        engine=_engine_kernel(p, rotor, main),
        terms=p.terms,
        flap_back=_flap_back_kernel(p),
        inflow=InflowKernel(p.main_radius_m, 2.0 * _LEAST_FLOW * math.sqrt(_hover_inflow_sq(p))),
        ground_effect=GroundEffectKernel(
            p.main_radius_m, p.hub_height_m, _hover_inflow_sq(p), p.ground_effect == "hayden"
        ),
    )


def _main_kernel(p: "HelicopterParameters") -> MainRotorKernel:
    tip = p.main_speed_radps * p.main_radius_m
    blades = p.main_drag_coefficient * p.main_blades * p.main_chord_m / 8.0
    return MainRotorKernel(
        hub_stiffness=p.hub_stiffness_nmprad,
        hub_height=p.hub_height_m,
        speed=p.main_speed_radps,
        profile_power=p.air_density_kgpm3 * tip * p.main_radius_m * blades,
        tip_speed=tip,
        pitch_gain=p.collective_gain_rad,
        pitch_offset=p.collective_offset_rad,
    )


def _servo_kernel(p: "HelicopterParameters") -> ServoKernel:
    on = p.terms
    # By virtual work: moment of the blades per rad of pitch, times pitch per angle of the servo
    per_rad = p.main_blades * p.blade_feathering_kgm2 * p.main_speed_radps**2
    arm = abs(p.collective_gain_rad) / p.servo_throw_rad
    share = on.servo_load * per_rad * arm / p.servo_stall_torque_nm
    up = math.copysign(share, p.collective_gain_rad)
    return ServoKernel(
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


def _engine_kernel(
    p: "HelicopterParameters", rotor: RotorKernel, main: MainRotorKernel
) -> EngineKernel:
    power = p.drive_efficiency * p.engine_power_w
    # dP/dtheta of hover at constant speed: T = 2 rho A v^2, P = T v, T = slope (blade theta - v)
    v_i = math.sqrt(p.mass_kg * p.gravity_mps2 / rotor.disc)
    lift = rotor.thrust_slope * rotor.blade_speed
    lift /= 1.0 + rotor.thrust_slope / (2.0 * rotor.disc * v_i)
    tip = p.main_speed_radps * p.tail_gear_ratio * p.tail_radius_m
    blades = p.tail_drag_coefficient * p.tail_blades * p.tail_chord_m / 8.0
    return EngineKernel(
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


def _flapping_kernel(p: "HelicopterParameters") -> FlappingKernel:
    rate = 1.0 / p.flap_time_constant_s
    a_bs, b_as = p.flap_a_bs_per_s, p.flap_b_as_per_s
    if p.coupling == "eq7":
        stiffness = lock_number(p) * p.main_speed_radps**2 * p.blade_inertia_kgm2
        # eq. (7) is dimensionless, so it enters eq. (6) divided by tau
        a_bs = 8.0 * p.hub_stiffness_nmprad / stiffness * rate
        b_as = -a_bs
    return FlappingKernel(
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


def _flap_back_kernel(p: "HelicopterParameters") -> FlapBackKernel:
    lock = lock_number(p)
    spring = p.hub_stiffness_nmprad / (p.blade_inertia_kgm2 * p.main_speed_radps**2)
    tip_sq = (p.main_speed_radps * p.main_radius_m) ** 2
    solidity = p.main_blades * p.main_chord_m / (math.pi * p.main_radius_m)
    radius_sq = p.bar_inner_radius_m**2 + p.bar_outer_radius_m**2
    return FlapBackKernel(
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


def _ground_kernel(p: "HelicopterParameters") -> GroundKernel:
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
    return GroundKernel(
        points,
        reach,
        p.gear_stiffness_npm,
        p.gear_damping_nspm,
        p.gear_friction,
        p.gear_hard_impact_mps,
        np.zeros(2),
        plane_of((0.0, 0.0)),
    )
