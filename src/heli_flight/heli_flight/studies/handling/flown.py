# SPDX-License-Identifier: Apache-2.0
"""Scores of manoeuvres that were flown in this process."""

from heli_flight.loop.record import FlightRecord
from heli_flight.loop.scenario_mte import scale_flown, target_of
from heli_flight.loop.settings import Settings
from heli_handling.scoring import Score, score
from heli_handling.tracks import Track, track_of
from heli_math.rotations import euler_angles


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
    return score(true_track(record), p["path.manoeuvre"], scale_flown(p), target)
