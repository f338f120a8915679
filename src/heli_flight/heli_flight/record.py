# SPDX-License-Identifier: Apache-2.0
"""The record of a flight: arrays, one row per tick, from the one-process loop or from a bag."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class FlightRecord:
    """Arrays over ticks, NED/FRD, SI, rad.

    Attributes
    ----------
    time_s : (N,) ndarray
        Flight time.
    truth_pos_ned_m, truth_vel_ned_mps, truth_rate_body_radps : (N, 3) ndarray
    truth_q_nb : (N, 4) ndarray
        Quaternion body -> NED.
    truth_rotor : (N, 3) ndarray
        a_s, b_s rad and the gyro's integrator d_int.
    wind_ned_mps : (N, 3) ndarray
        Velocity of the air at the aircraft, blowing towards.
    nav_pos_ned_m, nav_vel_ned_mps, nav_rate_body_radps : (N, 3) ndarray
    nav_q_nb : (N, 4) ndarray
        The on-board navigation record (the observer's odom).
    nav_rotor : (N, 3) ndarray
        Estimates of truth_rotor.
    reference : (N, 7) ndarray
        Position NED, velocity NED, heading.
    setpoint : (N, 3) ndarray
        Commanded phi, theta, psi.
    u : (N, 4) ndarray
        Actuators d_lat, d_lon, d_ped, d_col.
    nav_sigma_pos_m, nav_sigma_vel_mps : (N, 3) ndarray, optional
        Standard deviations of the navigation record, NED; None if they were not recorded.
    nav_sigma_att_rad : (N, 3) ndarray, optional
        The same of its attitude, as a rotation about north, east and down.
    excitation_u : (N, 4) ndarray, optional
        What identification added to u; this and the next are None where nothing was excited.
    gust_ned_mps : (N, 3) ndarray, optional
        Injected periodic gust alone, NED.
    imu : (N, 6) ndarray, optional
        As measured: specific force, m/s2, and rates, rad/s, body; None where it is not recorded.
    mode : (N,) ndarray of str, optional
        Mode that was flown; None where it was never another than to follow the reference.
    failsafe : (N,) ndarray of str, optional
        What the position loop did by itself for want of a position or a vertical speed, names of
        `heli_modes.failsafes.Action`; None where it never did anything.
    """

    time_s: np.ndarray
    truth_pos_ned_m: np.ndarray
    truth_vel_ned_mps: np.ndarray
    truth_rate_body_radps: np.ndarray
    truth_q_nb: np.ndarray
    truth_rotor: np.ndarray
    wind_ned_mps: np.ndarray
    nav_pos_ned_m: np.ndarray
    nav_vel_ned_mps: np.ndarray
    nav_rate_body_radps: np.ndarray
    nav_q_nb: np.ndarray
    nav_rotor: np.ndarray
    reference: np.ndarray
    setpoint: np.ndarray
    u: np.ndarray
    nav_sigma_pos_m: np.ndarray | None = None
    nav_sigma_vel_mps: np.ndarray | None = None
    nav_sigma_att_rad: np.ndarray | None = None
    excitation_u: np.ndarray | None = None
    gust_ned_mps: np.ndarray | None = None
    imu: np.ndarray | None = None
    mode: np.ndarray | None = None
    failsafe: np.ndarray | None = None

    def __len__(self) -> int:
        return self.time_s.size
