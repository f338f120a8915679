# SPDX-License-Identifier: Apache-2.0
"""Failsafes of navigation: what goes wrong, how it is found, what the aircraft does, what is said.

One table, pure. Who detects and who acts stands in the row; `docs/failsafes.md` is drawn from it
(`testing/failsafe_page.py`), and each row is flown in `tests/flight/test_failsafes.py`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum, StrEnum


class Action(IntEnum):
    """What the aircraft does by itself; of several the largest."""

    NONE = 0
    NOTE = 1
    DEAD_RECKON = 2
    RELEARN = 3
    HOLD_LEAN = 4
    LAND = 5
    LAND_BY_THRUST = 6

    @property
    def words(self) -> str:
        """For people."""
        return _WORDS[self]


_WORDS = {
    Action.NONE: "nothing",
    Action.NOTE: "flies on, and says so",
    Action.DEAD_RECKON: "flies on by what the other sensors say",
    Action.RELEARN: "begins anew with tilt and biases, and learns them from the fixes",
    Action.HOLD_LEAN: "holds altitude, heading and the lean that the wind took; no place",
    Action.LAND: "lands level on the barometer",
    Action.LAND_BY_THRUST: "lands at the thrust that sinks slowly, and feels for the ground",
}


class Condition(StrEnum):
    """What goes wrong."""

    GPS_SILENT = "GPS silent"
    GPS_STUCK = "GPS stuck on one fix"
    GPS_DRIFTS = "GPS off by a velocity that it has from one fix to the next"
    GPS_JUMPS = "GPS position jumps, or drifts without its velocity"
    IMU_STOPS = "IMU not a number, zero or frozen, to 0.2 s"
    IMU_BIASED = "gyro or accelerometer bias jumps"
    MAG_LOST = "magnetometer silent or contradicting"
    BARO_LOST = "barometer silent or contradicting"
    POSITION_LOST = "position lost"
    POSITION_LOST_LONG = "position lost for long"
    POSITION_ASTRAY = "dead reckoning has led too far astray"
    ALTITUDE_LOST = "GPS and barometer lost together"


@dataclass(frozen=True)
class Failsafe:
    """A row.

    Attributes
    ----------
    condition : Condition
    detected : str
        By what and where.
    within_s : float
        Time to detect that is flown in a test.
    action : Action
    recovery : str
        How it ends.
    status : str
        Of the observer, or of the outer loop's diagnostics: what a user sees.
    """

    condition: Condition
    detected: str
    within_s: float
    action: Action
    recovery: str
    status: str


FAILSAFES: tuple[Failsafe, ...] = (
    Failsafe(Condition.GPS_SILENT, "observer: no fix within `ekf.timeout.gps_s`", 2.5,
             Action.DEAD_RECKON, "the next fix that agrees within the grown sigma", "GPS_TIMEOUT"),
    Failsafe(Condition.GPS_STUCK, "observer: three fixes in a row the same to the last bit", 1.5,
             Action.DEAD_RECKON, "the first fix that differs and agrees", "GPS_STUCK"),
    Failsafe(Condition.GPS_DRIFTS, "observer: gate of the velocity, then that it stays off by the "
             "same velocity, which the IMU has not felt", 5.0, Action.DEAD_RECKON,
             "a fix that steps back to where the filter is", "GPS_REJECTED"),
    Failsafe(Condition.GPS_JUMPS, "observer: gate of the position, while velocities are fused", 5.0,
             Action.DEAD_RECKON, "after `ekf.timeout.gps_recovery_s` its drifting error takes it",
             "GPS_REJECTED"),
    Failsafe(Condition.IMU_STOPS, "observer: range, no force at all, or three samples in a row the "
             "same to the last bit", 0.2, Action.DEAD_RECKON,
             "the next sample that differs; sigma has grown meanwhile",
             "IMU_FROZEN or IMU_TIMEOUT"),
    Failsafe(Condition.IMU_BIASED, "observer: refused velocities that are further off from fix to "
             "fix, which no receiver is", 4.0, Action.RELEARN, "learnt from the fixes",
             "counter imu_doubts"),
    Failsafe(Condition.MAG_LOST, "observer: time-out, field strength, gate of the heading", 1.5,
             Action.NOTE, "the next sample that agrees", "MAG_TIMEOUT or MAG_REJECTED"),
    Failsafe(Condition.BARO_LOST, "observer: time-out, gate", 2.5, Action.NOTE,
             "the next sample that agrees", "BARO_TIMEOUT or BARO_REJECTED"),
    Failsafe(Condition.POSITION_LOST, "outer loop: sigma of the horizontal velocity over "
             "`land.blind_sigma_mps`", 60.0, Action.HOLD_LEAN,
             "half of that sigma: held from there on without a step", "position lost: level"),
    Failsafe(Condition.POSITION_LOST_LONG, "outer loop: so for `failsafe.land_after_s`", 75.0,
             Action.LAND, "what comes back in the descent is used; the landing goes on",
             "position lost: level descent"),
    Failsafe(Condition.POSITION_ASTRAY, "outer loop: sigma of the horizontal velocity, summed up "
             "since the last fix, over `failsafe.land_astray_m`", 25.0, Action.LAND,
             "what comes back in the descent is used; the landing goes on", "position astray"),
    Failsafe(Condition.ALTITUDE_LOST, "outer loop: sigma of the vertical velocity over "
             "`land.blind_sigma_down_mps`, half of it in a landing", 60.0, Action.LAND_BY_THRUST,
             "what comes back is flown from where it says that the aircraft is, without a step",
             "altitude lost: descent by thrust alone"),
)  # fmt: skip
"""Every failsafe of navigation that is built and flown."""


def of(condition: Condition) -> Failsafe:
    """The row of a condition."""
    return next(row for row in FAILSAFES if row.condition == condition)


def severest(conditions: Iterable[Condition]) -> Action:
    """What is done under several conditions at once."""
    return max((of(condition).action for condition in conditions), default=Action.NONE)
