# SPDX-License-Identifier: Apache-2.0
"""What the one-process loop writes down tick by tick, and the record that becomes of it."""

from typing import NamedTuple

import numpy as np

from heli_flight.loop.record import FlightRecord
from heli_math.rows import ACTUATOR, IMU, NAV, REFERENCE, SETPOINT, TRUTH
from heli_math.ticks import Rate


class Track(NamedTuple):
    """What is recorded, one row per tick; places of `heli_math.rows`."""

    truth: np.ndarray  # (n, 19) TRUTH
    nav: np.ndarray  # (n, 31) NAV
    reference: np.ndarray  # (n, 7) REFERENCE
    setpoint: np.ndarray  # (n, 4) SETPOINT
    u: np.ndarray  # (n, 4) ACTUATOR
    imu: np.ndarray  # (n, 6) IMU
    # no rows unless something is excited:
    excitation: np.ndarray  # (n, 4) ACTUATOR, what was added to u
    gust: np.ndarray  # (n, 3) NED, m/s


def empty_track(n: int, excited: bool) -> Track:
    """Rows for n ticks; those of what is excited only if something is."""
    sizes = (TRUTH.size, NAV.size, REFERENCE.size, SETPOINT.size, ACTUATOR.size, IMU.size)
    added = (ACTUATOR.size, 3)
    return Track(
        *(np.zeros((n, size)) for size in sizes),
        *(np.zeros((n if excited else 0, size)) for size in added),
    )


def record_of(track: Track, n: int, rate: Rate) -> FlightRecord:
    """The first n ticks as a record."""
    truth, nav = track.truth[:n], track.nav[:n]
    return FlightRecord(
        time_s=rate.seconds(np.arange(n)),
        truth_pos_ned_m=truth[:, TRUTH.pos],
        truth_vel_ned_mps=truth[:, TRUTH.vel],
        truth_rate_body_radps=truth[:, TRUTH.rate],
        truth_q_nb=truth[:, TRUTH.quat],
        truth_rotor=truth[:, TRUTH.rotor],
        wind_ned_mps=truth[:, TRUTH.wind],
        nav_pos_ned_m=nav[:, NAV.pos],
        nav_vel_ned_mps=nav[:, NAV.vel],
        nav_rate_body_radps=nav[:, NAV.rate],
        nav_q_nb=nav[:, NAV.quat],
        nav_rotor=nav[:, NAV.rotor],
        reference=track.reference[:n],
        setpoint=track.setpoint[:n, SETPOINT.attitude],
        u=track.u[:n],
        nav_sigma_pos_m=nav[:, NAV.sigma_pos],
        nav_sigma_vel_mps=nav[:, NAV.sigma_vel],
        nav_sigma_att_rad=nav[:, NAV.sigma_att],
        excitation_u=track.excitation[:n] if track.gust.size else None,
        gust_ned_mps=track.gust[:n] if track.gust.size else None,
        imu=track.imu[:n],
    )
