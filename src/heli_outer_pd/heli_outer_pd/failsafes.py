# SPDX-License-Identifier: Apache-2.0
"""Failsafes of navigation and links: what goes wrong, how it is found, what is done and said.

One table, pure. Who detects and who acts stands in the row; `docs/failsafes.md` is drawn from it
(`testing/failsafe_page.py`), and each row is flown in `tests/flight/test_failsafes*.py` or, of
nodes, in `tests/graph/test_respawn.py`.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum, StrEnum


class Action(IntEnum):
    """What the aircraft does by itself; of several the largest."""

    NONE = 0
    NOTE = 1
    MODEL = 2
    OTHER_IMU = 3
    HOLD_COMMAND = 4
    TRIM = 5
    DEAD_RECKON = 6
    RELEARN = 7
    SOFT = 8
    HOVER = 9
    HOLD_SETPOINT = 10
    HOLD_TRIM = 11
    HOLD_LEAN = 12
    LAND = 13
    LAND_BY_THRUST = 14
    AUTOROTATE = 15

    @property
    def words(self) -> str:
        """For people."""
        return _WORDS[self]


_WORDS = {
    Action.NONE: "nothing",
    Action.NOTE: "flies on, and says so",
    Action.OTHER_IMU: "flies on with the other IMU alone",
    Action.MODEL: "flies on by what was heard last, carried on to now",
    Action.HOLD_COMMAND: "holds the last command",
    Action.TRIM: "flies the trim; the actuator side damps rates and takes turns back",
    Action.DEAD_RECKON: "flies on by what the other sensors say",
    Action.RELEARN: "solves tilt, heading and biases again from the fixes of the last seconds",
    Action.SOFT: "holds its place softly: small gains, small tilts, slack attitude",
    Action.HOVER: "comes to rest where it can, inside the fence, and hovers there",
    Action.HOLD_SETPOINT: "holds the last attitude setpoint, soon the trim attitude; no place",
    Action.HOLD_TRIM: "flies the last-known trim with damped rates; no place",
    Action.HOLD_LEAN: "holds altitude, heading and the lean that the wind took; no place",
    Action.LAND: "lands level on the barometer",
    Action.LAND_BY_THRUST: "lands at the thrust that sinks slowly, and feels for the ground",
    Action.AUTOROTATE: "lowers the collective, sinks fast, and spends the rotor's energy on a slow "
    "touch-down",
}


class Condition(StrEnum):
    """What goes wrong."""

    GPS_SILENT = "GPS silent"
    GPS_STUCK = "GPS stuck on one fix"
    GPS_DRIFTS = "GPS off by a velocity that it has from one fix to the next"
    GPS_JUMPS = "GPS position jumps, or drifts without its velocity"
    IMU_STOPS = "IMU not a number, zero or frozen, to 0.2 s"
    IMU_BIASED = "gyro or accelerometer bias jumps"
    ONE_IMU_STOPS = "of two IMUs one silent, not a number, zero or frozen"
    ONE_IMU_WRONG = "of two IMUs one with a bias that jumps or drifts"
    ESTIMATOR_DIVERGED = "estimator's state not finite, not a covariance, or absurd"
    MAG_LOST = "magnetometer silent or contradicting"
    MAG_ASKEW = "magnetometer wrong from the start: heading contradicts the motion"
    BARO_LOST = "barometer silent or contradicting"
    POSITION_LOST = "position lost"
    POSITION_LOST_LONG = "position lost for long"
    BEYOND_FENCE = "beyond the radius or the ceiling of the fence"
    COMMANDER_SILENT = "velocity, attitude or sticks no longer renewed"
    COMMANDS_GONE = "observer or inner loop killed or paused, real time"
    OUTER_GONE = "outer loop killed, real time"
    NODE_GONE = "observer, inner or outer loop killed, lockstep"
    LINK_FAULTY = "messages lost, late, exchanged or repeated on a link"
    IMU_LATE = "IMU samples late, or some of them lost, on their way to the observer"
    ESTIMATE_LATE = "estimate late or missing at the inner loop"
    ESTIMATE_GONE = "no estimate at the inner loop for long"
    NAVIGATION_GONE = "no navigation at the outer loop for long"
    SETPOINT_GONE = "no set-point at the inner loop"
    COMMANDS_LOST = "no command at the actuator side"
    SERVO_SLOW = "a cyclic servo slow: the attitude oscillates"
    SERVO_STUCK = "a cyclic servo stuck, or runs away"
    POSITION_ASTRAY = "dead reckoning has led too far astray"
    ALTITUDE_LOST = "GPS and barometer lost together"
    ROTOR_SLOW = "rotor slow: the engine has stopped, or carries too much"


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
             "fix, which no receiver is", 4.0, Action.RELEARN,
             "at once: tilt and velocity follow from the biases", "counter imu_doubts"),
    Failsafe(Condition.ONE_IMU_STOPS, "observer: range, no force at all, or three samples in a row "
             "the same to the last bit", 0.1, Action.OTHER_IMU,
             "once it agrees with the other for 2 s", "IMU_LEFT"),
    Failsafe(Condition.ONE_IMU_WRONG, "observer: they differ by more than `imu2.apart_*` beside "
             "what stays; then, of two filters with one of them each, which predicts fixes and "
             "compass",
             2.0, Action.OTHER_IMU, "once it agrees with the other for 2 s",
             "IMUS_DISAGREE, then IMU_LEFT"),
    Failsafe(Condition.ESTIMATOR_DIVERGED, "observer: each tick, state and covariance finite, "
             "correlations within 1, unit quaternion, speed below 150 m/s", 0.01, Action.RELEARN,
             "in the same tick, from what the filter knew at its last sound fix; without one it is "
             "aligned anew, and the last command held until then", "counter recoveries"),
    Failsafe(Condition.MAG_LOST, "observer: time-out, field strength, gate of the heading", 1.5,
             Action.NOTE, "the next sample that agrees", "MAG_TIMEOUT or MAG_REJECTED"),
    Failsafe(Condition.MAG_ASKEW, "observer: a bank of filters tells the heading from IMU and "
             "velocities of the fixes alone; it differs by more than `ekf.motion.difference_rad` "
             "for `ekf.motion.hold_s`, once movement tells it", 12.0, Action.RELEARN,
             "heading, level and velocity from that bank at once; the compass stays out of the "
             "flight", "HEADING_DISAGREES, then MAG_LEFT"),
    Failsafe(Condition.BARO_LOST, "observer: time-out, gate", 2.5, Action.NOTE,
             "the next sample that agrees", "BARO_TIMEOUT or BARO_REJECTED"),
    Failsafe(Condition.POSITION_LOST, "outer loop: sigma of the horizontal velocity over "
             "`land.blind_sigma_mps`", 60.0, Action.HOLD_LEAN,
             "half of that sigma: held from there on without a step", "position lost: level"),
    Failsafe(Condition.POSITION_LOST_LONG, "outer loop: so for `failsafe.land_after_s`", 75.0,
             Action.LAND, "what comes back in the descent is used; the landing goes on",
             "position lost: level descent"),
    Failsafe(Condition.BEYOND_FENCE, "outer loop: navigated position beyond `fence.radius_m` or "
             "`fence.ceiling_m`", 0.1, Action.HOVER,
             "hovers `fence.margin_m` inside; commands that lead outward are refused until then",
             "outside the fence: coming back"),
    Failsafe(Condition.COMMANDER_SILENT, "outer loop: none for `command.timeout_s`", 0.6,
             Action.HOVER, "the next command, from the motion that it has", "mode: hover"),
    Failsafe(Condition.COMMANDS_GONE, "plant: no actuators for `actuator_timeout_s`; supervisor: "
             "the process has ended", 0.2, Action.HOLD_TRIM, "the next command; `--respawn` starts "
             "the node again, without it a killed one ends the flight, named",
             "no message on 'actuators'"),
    Failsafe(Condition.OUTER_GONE, "supervisor: the process has ended; inner loop: setpoint older "
             "than `setpoint_timeout_s`", 0.2, Action.HOLD_SETPOINT, "as above; the reference goes "
             "on from its start stamp", "started again"),
    Failsafe(Condition.NODE_GONE, "supervisor: the process has ended", 0.2, Action.NOTE,
             "`--respawn`: time stands still until the node has made up for what it missed",
             "started again"),
    Failsafe(Condition.LINK_FAULTY, "who hears: what came is older than its tick, or did not come",
             1.0, Action.NOTE, "the next message in time",
             "link fault: topic and kind; counted in link.<topic>"),
    Failsafe(Condition.IMU_LATE, "observer: stamp of the sample", 0.01, Action.MODEL,
             "in time for the filter's horizon it is read as if it had come in time; a gap to 0.06 "
             "s is closed by a straight line", "counters imu_samples_late, imu_samples_replaced"),
    Failsafe(Condition.ESTIMATE_LATE, "inner loop: stamp of `odom`; carried on by the linear model "
             "with the commands since", 0.01, Action.MODEL, "the next one", "counted in link.odom"),
    Failsafe(Condition.ESTIMATE_GONE, "inner loop: age over `estimate_timeout_s`", 0.6,
             Action.HOLD_COMMAND, "the next one",
             "the estimate or the setpoint is not finite: the last good command is held"),
    Failsafe(Condition.NAVIGATION_GONE, "outer loop: age over `navigation_timeout_s`; until then "
             "position goes on with its velocity", 0.6, Action.HOLD_COMMAND, "the next one",
             "the navigation solution is not finite: the last command is held"),
    Failsafe(Condition.SETPOINT_GONE, "inner loop: age over `setpoint_timeout_s`", 0.6, Action.TRIM,
             "the next one", "the attitude setpoint is too old: trim attitude is held"),
    Failsafe(Condition.COMMANDS_LOST, "actuator side: age over `actuator_timeout_s`, in real time "
             "or with faults on that link", 0.12, Action.TRIM, "the next one, within "
             "`fallback.blend_s`", "counter without_commands"),
    Failsafe(Condition.SERVO_SLOW, "outer loop: attitude swings about what the attitude loop "
             "should have made of its command, standard deviation of a second over "
             "`failsafe.unfollowed_deg` (off unless set)", 4.0, Action.SOFT,
             "5 s of calm, each time twice as long; full gains fade in",
             "attitude not followed: flown softly"),
    Failsafe(Condition.SERVO_STUCK, "outer loop: as above; in degraded mode it stays on one side "
             "for 2 s", 8.0, Action.NOTE, "calm, as above; full gains hold what the other axes "
             "can, a landing would cost the aircraft",
             "attitude not followed: a servo may be stuck"),
    Failsafe(Condition.POSITION_ASTRAY, "outer loop: no fix for `failsafe.land_silent_s`, and "
             "sigma of the horizontal velocity, summed up since the last one and carried on to the "
             "ground, over `failsafe.land_astray_m`", 15.0, Action.LAND,
             "what comes back in the descent is used; the landing goes on", "position astray"),
    Failsafe(Condition.ALTITUDE_LOST, "outer loop: sigma of the vertical velocity over "
             "`land.blind_sigma_down_mps`, half of it in a landing", 60.0, Action.LAND_BY_THRUST,
             "what comes back is flown from where it says that the aircraft is, without a step",
             "altitude lost: fixed-thrust (open-loop) descent"),
    Failsafe(Condition.ROTOR_SLOW, "outer loop: rotor speed below `failsafe.rotor_slow_share` of "
             "the governed one for `failsafe.rotor_slow_s`, by a sensor that has gone on from "
             "sample to sample as a rotor can", 0.7, Action.AUTOROTATE,
             "the governed speed again at little sink, as by an engine alone: it hovers there",
             "rotor slow: autorotation"),
)  # fmt: skip
"""Every failsafe that is built and flown."""


def of(condition: Condition) -> Failsafe:
    """The row of a condition."""
    return next(row for row in FAILSAFES if row.condition == condition)


def severest(conditions: Iterable[Condition]) -> Action:
    """What is done under several conditions at once."""
    return max((of(condition).action for condition in conditions), default=Action.NONE)
