# SPDX-License-Identifier: Apache-2.0
"""Layout of the observer's own arrays, its status values and what they mean, in one place.

What it takes and gives (measurement and navigation row) is laid out in `heli_core.rows`. Here a
name is where a part begins, as the filter's loops count through vectors and matrices from there.
"""

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.jit import by_reference
from heli_core.rows import INPUT_NAMES, MEASURED, UNMEASURED

# --- nominal state of the filter
X_POS, X_VEL, X_QUAT, X_GYRO_BIAS, X_ACCEL_BIAS = 0, 3, 6, 10, 13
X_DRIFT, X_BARO_BIAS, X_MAG_ERROR = 16, 19, 20
N_NOMINAL = 21

# --- error state (what the covariance is about); true = nominal (+) error
E_POS, E_VEL, E_ATT, E_GYRO_BIAS, E_ACCEL_BIAS = 0, 3, 6, 9, 12
E_DRIFT, E_BARO_BIAS, E_MAG_ERROR = 15, 18, 19
N_ERROR = 20

# --- ring buffer columns beside those of the IMU (`heli_core.rows.IMU`)
AID_MAG_VALID, AID_MAG, AID_BARO_VALID, AID_BARO = 0, 1, 4, 5
AID_GPS_VALID, AID_GPS_POS, AID_GPS_VEL = 6, 7, 10
N_AID = 13
I_REPLACED = 6  # in the ring of the IMU, behind `heli_core.rows.IMU`: 1.0 if no sensor said so
N_IMU = 7

# --- record `heard`: what sensors said last, to the last bit; NaN before the first time
H_FORCE, H_RATE, H_GPS_POS, H_GPS_VEL = 0, 3, 6, 9
H_OFFSET = 12  # velocity by which a refused receiver is off, NED, m/s
H_OFFSET_VAR = 15  # variance of the filter's velocity when it was refused first
# Sums of a straight line through how far refused velocities are off: time and its square, the
# velocities, velocities times time; and when it began, s.
H_FIT, H_FIT_SUM, H_FIT_MOMENT, H_FIT_BEGAN = 18, 20, 23, 26
H_OFF_LAST = 27  # by how much the fix before was off, NED, m/s
H_OFF_FIRST = 30  # by how much in all when that was certain, m/s
N_HEARD = 31

# --- integer record `count`
C_TICK = 0  # newest tick seen, NO_TICK before the first
C_ALIGNED = 1  # 1 after the alignment
C_NOT_FINITE = 2  # 1 while the state is none
C_IMU_OK, C_MAG_OK, C_BARO_OK, C_GPS_OK = 3, 4, 5, 6  # tick of the last sample accepted
C_MAG_SEEN, C_BARO_SEEN, C_GPS_SEEN = 7, 8, 9  # tick of the last sample judged
C_BARO_READY = 10  # 1 after the barometer's bias has been started
C_IMU_DROPPED, C_MAG_DROPPED, C_BARO_DROPPED, C_GPS_DROPPED = 11, 12, 13, 14  # not finite
C_GPS_LATE, C_GPS_FUTURE = 15, 16  # older than the horizon; stamped later than now
C_MAG_REJECTED, C_BARO_REJECTED, C_GPS_POS_REJECTED, C_GPS_VEL_REJECTED = 17, 18, 19, 20
C_MAG_FUSED, C_BARO_FUSED, C_GPS_FUSED = 21, 22, 23
C_TICK_GAPS, C_TICK_REPEATED, C_ACTUATOR_DROPPED, C_REALIGNED = 24, 25, 26, 27
C_BEGUN = 28  # tick of the first sample since the filter began
C_GPS_JUMPS = 29
C_FORCE_SAME, C_RATE_SAME = 30, 31  # samples in a row that repeat the one before to the last bit
C_IMU_REPLACED = 32  # samples in whose place what is likely was integrated
C_GPS_POS_SAME, C_GPS_VEL_SAME, C_GPS_REPEATED = 33, 34, 35  # the same of fixes; all that did
C_GPS_OFFSET = 36  # fixes for which the receiver has been off by a velocity that stays
C_GPS_GROWS = 37  # refused velocities through which a line was drawn so far
C_IMU_DOUBTS = 38  # how often the inertial sensors' errors began anew for that
C_GPS_KEPT = 39  # tick at which it was so last
C_IMU_LATE = 40  # tick at which a sample of an earlier tick came last
C_IMU_MENDED = 41  # samples that came late, and in time for the filter
C_RECOVERED = 42  # how often the filter went back to what it knew, as its state was none
N_COUNT = 43
NO_TICK = -(2**40)

COUNTER_NAMES = {
    "imu_components_not_finite": C_IMU_DROPPED,
    "mag_components_not_finite": C_MAG_DROPPED,
    "baro_samples_not_finite": C_BARO_DROPPED,
    "gps_components_not_finite": C_GPS_DROPPED,
    "gps_fixes_older_than_horizon": C_GPS_LATE,
    "gps_fixes_stamped_in_future": C_GPS_FUTURE,
    "mag_rejected": C_MAG_REJECTED,
    "baro_rejected": C_BARO_REJECTED,
    "gps_position_rejected": C_GPS_POS_REJECTED,
    "gps_velocity_rejected": C_GPS_VEL_REJECTED,
    "mag_fused": C_MAG_FUSED,
    "baro_fused": C_BARO_FUSED,
    "gps_fused": C_GPS_FUSED,
    "tick_gaps": C_TICK_GAPS,
    "ticks_repeated": C_TICK_REPEATED,
    "actuator_components_not_finite": C_ACTUATOR_DROPPED,
    "realignments": C_REALIGNED,
    "gps_jumps": C_GPS_JUMPS,
    "imu_samples_replaced": C_IMU_REPLACED,
    "imu_samples_late": C_IMU_MENDED,
    "gps_fixes_repeated": C_GPS_REPEATED,
    "imu_doubts": C_IMU_DOUBTS,
    "recoveries": C_RECOVERED,
}
"""Name (for diagnostics) of each event counter in `ObserverState.count`."""

# --- record `diag`: normalised innovations squared of the last judged sample, with its degrees
D_NIS_POS, D_NIS_VEL, D_NIS_MAG, D_NIS_BARO, D_DOF_POS, D_DOF_VEL = 0, 1, 2, 3, 4, 5
D_HEADING_INNOVATION = 6  # rad
N_DIAG = 7

# --- reduced-order observer: w = [z, servo positions, servo rates]; outputs y; past commands
N_UNMEASURED, N_OUTPUT, N_INPUT = len(UNMEASURED), len(MEASURED), len(INPUT_NAMES)
W_SERVO, W_SERVO_RATE = N_UNMEASURED, N_UNMEASURED + N_INPUT
N_ROTOR_W = W_SERVO_RATE + N_INPUT
M_PHI, M_THETA, M_RATE, M_PSI = 0, 1, 2, 5  # within y


class ObserverStatus(IntEnum):
    """Health of the observer, worst first reported; `sentence` says what it means."""

    OK = 0
    ALIGNING = 1
    NOT_FINITE = 2
    IMU_TIMEOUT = 3
    GPS_TIMEOUT = 4
    GPS_REJECTED = 5
    MAG_TIMEOUT = 6
    MAG_REJECTED = 7
    BARO_TIMEOUT = 8
    BARO_REJECTED = 9
    GPS_STUCK = 10
    IMU_FROZEN = 11
    IMU_LEFT = 12
    IMUS_DISAGREE = 13

    @property
    def sentence(self) -> str:
        """One sentence for a log or a diagnostic message."""
        return _SENTENCES[self]


_SENTENCES = {
    ObserverStatus.OK: "navigation is aligned and every sensor is being fused",
    ObserverStatus.ALIGNING: "waiting for unaccelerated IMU, magnetometer and a GPS fix to align",
    ObserverStatus.NOT_FINITE: "the filter's state was none; waiting for sensors to align anew",
    ObserverStatus.IMU_TIMEOUT: "no usable IMU sample within its time-out; the last one is held",
    ObserverStatus.GPS_TIMEOUT: "no GPS fix within its time-out; position is dead reckoning",
    ObserverStatus.GPS_REJECTED: "GPS fixes arrive but persistently contradict the filter",
    ObserverStatus.MAG_TIMEOUT: "no magnetometer sample within its time-out; heading drifts",
    ObserverStatus.MAG_REJECTED: "magnetometer persistently contradicts the filter and is not "
    "followed; heading drifts",
    ObserverStatus.BARO_TIMEOUT: "no barometer sample within its time-out",
    ObserverStatus.BARO_REJECTED: "barometer persistently contradicts the filter, not followed",
    ObserverStatus.GPS_STUCK: "GPS receiver repeats one fix and is not followed; position is dead "
    "reckoning",
    ObserverStatus.IMU_FROZEN: "IMU repeats one sample or says zero; what is likely is flown "
    "instead",
    ObserverStatus.IMU_LEFT: "one of two IMUs is not followed; the other one is flown alone",
    ObserverStatus.IMUS_DISAGREE: "two IMUs disagree; their mean is flown until the fixes or the "
    "compass tell which one is wrong",
}


@by_reference
class Window(NamedTuple):
    """What the filter took lately, slot = tick mod TICKS, and what it knew at its last fixes."""

    imu: NDArray[np.float64]  # (TICKS, 7) as the ring of the observer
    aid: NDArray[np.float64]  # (TICKS, 13)
    nominal: NDArray[np.float64]  # (FIXES + 1, 21) and one to spare
    P: NDArray[np.float64]  # (FIXES + 1, 20, 20)
    tick: NDArray[np.int64]  # (FIXES + 1,) of these, NO_TICK: none; then the newest one's place


@by_reference
class ImuPair(NamedTuple):
    """What is remembered of two IMUs."""

    ring: NDArray[np.float64]  # (2, TICKS, 7) of each, as the mean would say it
    heard: NDArray[np.float64]  # (2, 6) what each said last
    offset: NDArray[np.float64]  # (6,) second - first, what stays
    apart: NDArray[np.float64]  # (6,) what they differ by besides, smoothed
    nominal: NDArray[np.float64]  # (2, 21) filters with one of them alone
    P: NDArray[np.float64]  # (2, 20, 20)
    score: NDArray[np.float64]  # (2, 2) sums of innovations: velocity, heading; of each
    count: NDArray[np.int64]  # type: ignore[assignment]  # (11,) indices P_*


@by_reference
class PairParams(NamedTuple):
    """How two IMUs are judged; offset and apart: places of `rows.IMU`."""

    on: bool
    offset: NDArray[np.float64]  # (6,) largest difference that stays
    apart: NDArray[np.float64]  # (6,) largest one besides


@by_reference
class ObserverState(NamedTuple):
    """All memory of the observer, mutated in place (arrays of float64, `count` int64).

    Attributes
    ----------
    nominal : ndarray (21,)
        Filter state at the delayed horizon, indices X_*.
    P : ndarray (20, 20)
        Covariance of the error state, indices E_*.
    trial : ndarray (20, 20)
        Scratch covariance of a measurement that is still to pass its gate.
    dx : ndarray (2, 20)
        Scratch: accumulated correction, and a column of P H'.
    imu : ndarray (N, 7)
        Ring of IMU samples, slot = tick mod N: specific force, rate, 1.0 if no sensor said so.
    aid : ndarray (N, 13)
        Ring of magnetometer, barometer and GPS samples by their time of validity, indices AID_*.
    now : ndarray (21,)
        Nominal state propagated to the newest tick.
    rotor : ndarray (9,)
        Reduced-order observer and servo model, deviations from trim.
    y : ndarray (2, 6)
        phi theta p q r psi of the last tick (psi unwrapped) as deviations from trim; row 1: the
        step before.
    u : ndarray (3, 4)
        Actuator commands, newest first (absolute).
    diag : ndarray (7,)
        Innovation record, indices D_*.
    heard : ndarray (31,)
        What the sensors said last, indices H_*.
    count : ndarray of int64 (40,)
        Ticks, flags and counters, indices C_*.
    window : Window
        What was taken lately, to be taken again.
    pair : ImuPair
        What is remembered of two IMUs.
    """

    nominal: NDArray[np.float64]
    P: NDArray[np.float64]
    trial: NDArray[np.float64]
    dx: NDArray[np.float64]
    imu: NDArray[np.float64]
    aid: NDArray[np.float64]
    now: NDArray[np.float64]
    rotor: NDArray[np.float64]
    y: NDArray[np.float64]
    u: NDArray[np.float64]
    diag: NDArray[np.float64]
    heard: NDArray[np.float64]
    count: NDArray[np.int64]  # type: ignore[assignment]  # hides tuple.count, which nobody needs
    window: "Window"
    pair: "ImuPair"


@by_reference
class EkfParams(NamedTuple):
    """Constants of the filter (SI, rad); variances are per tick where they drive the prediction."""

    dt_s: float
    gravity_mps2: float
    var_vel_step: float
    var_att_step: float
    var_gyro_bias_step: float
    var_accel_bias_step: float
    drift_decay: float
    var_drift_step_horizontal: float
    var_drift_step_vertical: float
    var_baro_bias_step: float
    mag_error_decay: float
    var_mag_error_step: float
    var_gps_pos_horizontal: float
    var_gps_pos_vertical: float
    var_gps_vel_horizontal: float
    var_gps_vel_vertical: float
    var_baro: float
    var_mag: float
    field_ned_t: NDArray[np.float64]
    field_tolerance: float
    max_heading_innovation_rad: float
    origin_altitude_m: float
    gates: NDArray[np.float64]
    accel_limit_mps2: float
    rate_limit_radps: float
    var0: NDArray[np.float64]


@by_reference
class ReducedOrderParams(NamedTuple):
    """Discrete reduced-order observer: w+ = Phi w + Gu u + G0 y(n-1) + G1 y(n); x_u = z + K y."""

    Phi: NDArray[np.float64]
    Gu: NDArray[np.float64]
    G0: NDArray[np.float64]
    G1: NDArray[np.float64]
    K: NDArray[np.float64]
    y_trim: NDArray[np.float64]
    x_u_trim: NDArray[np.float64]
    u_trim: NDArray[np.float64]
    u_delay_ticks: int
    with_servo: int


@by_reference
class ObserverParams(NamedTuple):
    """Everything `observe` needs besides its state."""

    ekf: EkfParams
    rotor: ReducedOrderParams
    pair: "PairParams"
    horizon_ticks: int
    align_ticks: int
    max_gap_ticks: int
    imu_timeout_ticks: int
    gps_timeout_ticks: int
    gps_recovery_ticks: int
    mag_timeout_ticks: int
    baro_timeout_ticks: int
