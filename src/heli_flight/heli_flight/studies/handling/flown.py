# SPDX-License-Identifier: Apache-2.0
"""Scores of manoeuvres and sweeps that were flown in this process."""

import numpy as np

from heli_flight.loop.record import FlightRecord
from heli_flight.loop.scenario_mte import LEAD_IN_S, scale_flown, target_of
from heli_flight.loop.settings import Settings
from heli_handling.response import FrequencyResponse, frequency_response
from heli_handling.scoring import Score, score
from heli_handling.tracks import Track, track_of
from heli_inner_hinf.attitude_disturbance import disturbance_kernel
from heli_math.rotations import euler_angles
from heli_math.sweep import swept_angle


def true_track(record: FlightRecord) -> Track:
    """How the aircraft really moved."""
    return track_of(
        record.time_s,
        record.truth_pos_ned_m,
        record.truth_vel_ned_mps,
        euler_angles(record.truth_q_nb),
    )


def score_flown(settings: Settings, record: FlightRecord) -> Score:
    """Score of a scenario whose path is a manoeuvre, from ground truth and the given place.

    Raises
    ------
    HandlingError
        The manoeuvre is not in the flight.
    """
    p = settings.scenario_parameters
    target = target_of(settings.scenario.reference, p)
    track = true_track(record).between(p["path.start_s"] - LEAD_IN_S)
    return score(track, p["path.manoeuvre"], scale_flown(p), target)


def rejected(settings: Settings, record: FlightRecord, axis: int) -> FrequencyResponse:
    """Response of the disturbed attitude to what was added to it, over the sweep of a flight.

    Raises
    ------
    HandlingError
    """
    p = settings.nodes["inner_loop"]
    kernel = disturbance_kernel(p)
    since = record.time_s - kernel.start_s
    on = (since >= 0.0) & (since < kernel.duration_s)
    time_s = record.time_s[on]
    added = np.array([swept_angle(t, kernel) for t in time_s])
    angle = true_track(record).attitude_rad[on, axis]
    return frequency_response(time_s, added, angle + added)


def swept(settings: Settings, record: FlightRecord, axis: int) -> FrequencyResponse:
    """Response of an angle (0 roll, 1 pitch, 2 yaw) to its command, over the sweep of a flight.

    Raises
    ------
    HandlingError
    """
    p = settings.nodes["outer_loop"]
    since = record.time_s - p["sweep.start_s"]
    on = (since >= 0.0) & (since < p["sweep.duration_s"])
    angle = true_track(record).attitude_rad[on, axis]
    return frequency_response(record.time_s[on], np.unwrap(record.setpoint[on, axis]), angle)
