# SPDX-License-Identifier: Apache-2.0
"""From the outer loop's checked parameters to the numbers of its law."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from heli_math.rows import SETPOINT
from heli_math.ticks import NS_PER_S, TICK_S
from heli_outer_pd.attitude_sweep import sweep_kernel
from heli_outer_pd.position_law import OuterKernel
from heli_outer_pd.thrust_map import RotorMap

OBSERVER_DAMPING = 0.8
"""Of the disturbance observer's error dynamics."""


def outer_kernel(parameters: Mapping[str, Any]) -> OuterKernel:
    """Numbers of the law from the parameters of config/outer_loop.yaml.

    Parameters
    ----------
    parameters : mapping
        Dotted name to value, as checked against `heli_outer_pd.parameter_table.TABLE`.

    Returns
    -------
    OuterKernel
    """
    p = parameters
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
    return OuterKernel(
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
        trim=trim,
        rotor=rotor,
        shaping_ns=round(p["reference_shaping_s"] * NS_PER_S),
        heading_lead_s=p["heading_lead_s"],
        attitude_lag=np.asarray(p["disturbance.attitude_lag_s"], float),
        attitude_lead=np.asarray(p["attitude_lead.lead_s"], float),
        lead_filter_s=p["attitude_lead.filter_s"],
        blind_sigma=p["land.blind_sigma_mps"],
        land_after_s=p["failsafe.land_after_s"],
        land_astray_m=p["failsafe.land_astray_m"],
        blind_sigma_down=p["land.blind_sigma_down_mps"],
        blind_descent_mps=p["land.blind_descent_mps"],
        unfollowed=np.radians(np.asarray(p["failsafe.unfollowed_deg"], float)),
        rotor_slow_share=p["failsafe.rotor_slow_share"],
        rotor_slow_s=p["failsafe.rotor_slow_s"],
        dt_s=p["period_ticks"] * TICK_S,
        sweep=sweep_kernel(p),
    )
