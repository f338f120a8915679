# SPDX-License-Identifier: Apache-2.0
"""Layout of the observer's own arrays, its status values and what they mean, in one place.

What it takes and gives (measurement and navigation row) is laid out in `heli_core.rows`. Here a
place is where a part begins, as the filter's loops count through vectors and matrices from there.
"""

from collections.abc import Iterable, Iterator
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_core.jit import by_reference
from heli_core.rows import INPUT_NAMES, MEASURED, UNMEASURED
from heli_core.sensors import AIDS, BARO, MAG, PLACES, SampledSensor, place_of

_MORE = tuple(row for row in AIDS if row not in (MAG, BARO))
"""Aids beside those that have their lines below; each row of numbers has places for them behind."""
_MORE_SLOTS = sum(1 + row.numbers for row in _MORE)


class NominalRow(NamedTuple):
    """Nominal state of the filter (21,)."""

    pos: int = 0
    vel: int = 3
    quat: int = 6
    gyro_bias: int = 10
    accel_bias: int = 13
    drift: int = 16
    baro_bias: int = 19
    mag_error: int = 20
    size: int = 21


class ErrorRow(NamedTuple):
    """Error state (20,), what the covariance is about; true = nominal (+) error."""

    pos: int = 0
    vel: int = 3
    att: int = 6
    gyro_bias: int = 9
    accel_bias: int = 12
    drift: int = 15
    baro_bias: int = 18
    mag_error: int = 19
    size: int = 20


class AidRow(NamedTuple):
    """A slot (14,) of the ring of aids and fixes."""

    mag_valid: int = 0
    mag: int = 1
    baro_valid: int = 4
    baro: int = 5
    gps_valid: int = 6
    gps_pos: int = 7
    gps_vel: int = 10
    gps_at_imu: int = 13  # 1.0: the fix is no longer that of the antenna
    more: int = 14
    size: int = 14 + _MORE_SLOTS


class RingRow(NamedTuple):
    """A slot (7,) of the ring of the IMU: an ImuRow, and behind it:"""

    replaced: int = 6  # 1.0 if no sensor said so
    size: int = 7


class HeardRow(NamedTuple):
    """What sensors said last (31,), to the last bit; NaN before the first time."""

    force: int = 0
    rate: int = 3
    gps_pos: int = 6
    gps_vel: int = 9
    offset: int = 12  # velocity by which a refused receiver is off, NED, m/s
    offset_var: int = 15  # variance of the filter's velocity when it was refused first
    # Sums of a straight line through how far refused velocities are off: time and its square, the
    # velocities, velocities times time; and when it began, s.
    fit: int = 18
    fit_sum: int = 20
    fit_moment: int = 23
    fit_began: int = 26
    off_last: int = 27  # by how much the fix before was off, NED, m/s
    off_first: int = 30  # by how much in all when that was certain, m/s
    size: int = 31


class CountRow(NamedTuple):
    """Integers (43,)."""

    tick: int = 0  # newest tick seen, NO_TICK before the first
    aligned: int = 1  # 1 after the alignment
    not_finite: int = 2  # 1 while the state is none
    # Tick of the last sample accepted, and judged.
    imu_ok: int = 3
    mag_ok: int = 4
    baro_ok: int = 5
    gps_ok: int = 6
    mag_seen: int = 7
    baro_seen: int = 8
    gps_seen: int = 9
    baro_ready: int = 10  # 1 after the barometer's bias has been started
    # Not finite.
    imu_dropped: int = 11
    mag_dropped: int = 12
    baro_dropped: int = 13
    gps_dropped: int = 14
    gps_late: int = 15  # older than the horizon
    gps_future: int = 16  # stamped later than now
    mag_rejected: int = 17
    baro_rejected: int = 18
    gps_pos_rejected: int = 19
    gps_vel_rejected: int = 20
    mag_fused: int = 21
    baro_fused: int = 22
    gps_fused: int = 23
    tick_gaps: int = 24
    tick_repeated: int = 25
    actuator_dropped: int = 26
    realigned: int = 27
    begun: int = 28  # tick of the first sample since the filter began
    gps_jumps: int = 29
    force_same: int = 30  # samples in a row that repeat the one before to the last bit
    rate_same: int = 31
    imu_replaced: int = 32  # samples in whose place what is likely was integrated
    gps_pos_same: int = 33  # the same of fixes; all that did
    gps_vel_same: int = 34
    gps_repeated: int = 35
    gps_offset: int = 36  # fixes for which the receiver has been off by a velocity that stays
    gps_grows: int = 37  # refused velocities through which a line was drawn so far
    imu_doubts: int = 38  # how often the inertial sensors' errors began anew for that
    gps_kept: int = 39  # tick at which it was so last
    imu_late: int = 40  # tick at which a sample of an earlier tick came last
    imu_mended: int = 41  # samples that came late, and in time for the filter
    recovered: int = 42  # how often the filter went back to what it knew, as its state was none
    more: int = 43
    size: int = 43 + 5 * len(_MORE)


class DiagRow(NamedTuple):
    """Normalised innovations squared of the last judged sample (7,), with its degrees."""

    nis_pos: int = 0
    nis_vel: int = 1
    nis_mag: int = 2
    nis_baro: int = 3
    dof_pos: int = 4
    dof_vel: int = 5
    heading_innovation: int = 6  # rad
    more: int = 7
    size: int = 7 + len(_MORE)


# Of the reduced-order observer: outputs y, and w = [z, servo positions, servo rates].
N_UNMEASURED, N_INPUT = len(UNMEASURED), len(INPUT_NAMES)


class OutputRow(NamedTuple):
    """What the reduced-order observer reads, y."""

    phi: int = 0
    theta: int = 1
    rate: int = 2
    psi: int = 5
    size: int = len(MEASURED)


class RotorStateRow(NamedTuple):
    """What it carries on, w."""

    servo: int = N_UNMEASURED
    servo_rate: int = N_UNMEASURED + N_INPUT
    size: int = N_UNMEASURED + 2 * N_INPUT


class PairRow(NamedTuple):
    """Integers (11,) of an `ImuPair`."""

    left: int = 0  # who is left: 0 none, 1 the first, 2 the second
    why: int = 1  # one of `dual_imu.WHY_...`
    trial: int = 2  # 1 while the two are compared
    began: int = 3  # tick at which that began
    compared: int = 4  # samples through which what stays was learnt
    agreed: int = 5  # ticks in a row for which both agreed
    switches: int = 6  # how often one was left
    same: int = 7  # four: repeats in a row of force and rate, first and second
    size: int = 11


class YawRow(NamedTuple):
    """Numbers (15,) of a `YawBank`: what was summed up since the last fix, and what it says."""

    dv: int = 0  # along both axes of the level frame, m/s
    time: int = 2  # s
    turn: int = 3  # rad, every way
    var_vel: int = 4  # of samples that no sensor said, (m/s)^2
    var_yaw: int = 5  # rad^2
    heading: int = 6  # of the mixture, rad
    variance: int = 7  # rad^2
    difference: int = 8  # of it and of the filter's heading, rad
    vel: int = 9  # north, east, m/s
    bias: int = 11  # acceleration that stays, along both axes of the level frame, m/s2
    mag_error: int = 13  # heading of the compass less that of the bank when they parted, rad
    surprise: int = 14  # least normalised innovation squared, mean over the last fixes
    size: int = 15


class YawCountRow(NamedTuple):
    """Integers (8,) of a `YawBank`."""

    begun: int = 0  # 1 once a fix's velocity has come
    refused: int = 1  # fixes in a row that surprised every hypothesis
    state: int = 2  # a YawState
    since: int = 3  # tick since which it disagrees, NO_TICK: it does not
    left: int = 4  # 1 while the compass is not followed
    resets: int = 5  # how often the filter's heading became the bank's
    agreed: int = 6  # 1 once both headings have agreed for certain
    biased: int = 7  # 1 if the filter knew of a bias of no sound gyro when they began to disagree
    size: int = 8


class YawState(IntEnum):
    """What motion, by fixes and inertial sensors, says of the filter's heading."""

    NOT_OBSERVABLE = 0
    AGREES = 1
    DISAGREES = 2


NOMINAL, ERROR = NominalRow(), ErrorRow()
YAW, YAW_COUNT = YawRow(), YawCountRow()
AID, RING, HEARD = AidRow(), RingRow(), HeardRow()
COUNT, DIAG, PAIR = CountRow(), DiagRow(), PairRow()
OUTPUT, ROTOR_W = OutputRow(), RotorStateRow()
NO_TICK = -(2**40)


class Aid(NamedTuple):
    """Places of a sensor of `heli_core.sensors.AIDS` in the observer's rows."""

    first: int  # of its numbers in the measurement row
    numbers: int
    arrived: int  # its flag there
    above: float  # what is not above it is not believed
    slot: int  # of its numbers in a slot of the ring
    valid: int  # its flag there
    ok: int  # counters, as those of `CountRow`
    seen: int
    dropped: int
    rejected: int
    fused: int
    nis: int  # in `DIAG`
    timeout: int  # an ObserverStatus; the next one says that it is rejected


def _aid(row: SampledSensor, valid: int, counters: Iterable[int], nis: int, timeout: int) -> Aid:
    at, (ok, seen, dropped, rejected, fused) = PLACES[row.name], counters
    return Aid(
        at.first, at.numbers, at.valid, row.above, valid + 1, valid,
        ok, seen, dropped, rejected, fused, nis, timeout,
    )  # fmt: skip


def _aids() -> Iterator[Aid]:
    c = COUNT
    of_mag = (c.mag_ok, c.mag_seen, c.mag_dropped, c.mag_rejected, c.mag_fused)
    of_baro = (c.baro_ok, c.baro_seen, c.baro_dropped, c.baro_rejected, c.baro_fused)
    yield _aid(MAG, AID.mag_valid, of_mag, DIAG.nis_mag, ObserverStatus.MAG_TIMEOUT)
    yield _aid(BARO, AID.baro_valid, of_baro, DIAG.nis_baro, ObserverStatus.BARO_TIMEOUT)
    valid, counters = AID.more, COUNT.more
    for i, row in enumerate(_MORE):
        timeout = ObserverStatus[f"{row.name.upper()}_TIMEOUT"]
        yield _aid(row, valid, range(counters, counters + 5), DIAG.more + i, timeout)
        valid, counters = valid + 1 + row.numbers, counters + 5


COUNTER_NAMES = {
    "imu_components_not_finite": COUNT.imu_dropped,
    "gps_components_not_finite": COUNT.gps_dropped,
    "gps_fixes_older_than_horizon": COUNT.gps_late,
    "gps_fixes_stamped_in_future": COUNT.gps_future,
    "gps_position_rejected": COUNT.gps_pos_rejected,
    "gps_velocity_rejected": COUNT.gps_vel_rejected,
    "gps_fused": COUNT.gps_fused,
    "tick_gaps": COUNT.tick_gaps,
    "ticks_repeated": COUNT.tick_repeated,
    "actuator_components_not_finite": COUNT.actuator_dropped,
    "realignments": COUNT.realigned,
    "gps_jumps": COUNT.gps_jumps,
    "imu_samples_replaced": COUNT.imu_replaced,
    "imu_samples_late": COUNT.imu_mended,
    "gps_fixes_repeated": COUNT.gps_repeated,
    "imu_doubts": COUNT.imu_doubts,
    "recoveries": COUNT.recovered,
}
"""Name (for diagnostics) of each event counter in `ObserverState.count`."""


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
    MAG_LEFT = 14
    HEADING_DISAGREES = 15
    _ignore_ = ["members", "row"]
    members = vars()
    for row in _MORE:
        members[f"{row.name.upper()}_TIMEOUT"] = 16 + 2 * _MORE.index(row)
        members[f"{row.name.upper()}_REJECTED"] = 17 + 2 * _MORE.index(row)

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
_SENTENCES |= {
    ObserverStatus.MAG_LEFT: "magnetometer contradicts the motion that fixes and IMU see, not "
    "followed; heading comes from that motion",
    ObserverStatus.HEADING_DISAGREES: "heading contradicts the motion that fixes and IMU see",
}
for _row in _MORE:
    _name = _row.name.upper()
    _SENTENCES[ObserverStatus[f"{_name}_TIMEOUT"]] = f"no {_row.words} sample within its time-out"
    _SENTENCES[ObserverStatus[f"{_name}_REJECTED"]] = (
        f"{_row.words} persistently contradicts the filter, not followed"
    )

AID_PLACES: tuple[Aid, ...] = tuple(_aids())
"""Places of each sensor of `AIDS`, in its order."""
MAG_AID, BARO_AID = place_of(MAG.name, AIDS), place_of(BARO.name, AIDS)
for _row, _at in zip(AIDS, AID_PLACES, strict=True):
    _dropped = "components" if _row.numbers > 1 else "samples"
    COUNTER_NAMES |= {
        f"{_row.name}_{_dropped}_not_finite": _at.dropped,
        f"{_row.name}_rejected": _at.rejected,
        f"{_row.name}_fused": _at.fused,
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
    count: NDArray[np.int64]  # type: ignore[assignment]  # (11,) places of `PAIR`


@by_reference
class PairParams(NamedTuple):
    """How two IMUs are judged; offset and apart: places of `rows.IMU`."""

    on: bool
    offset: NDArray[np.float64]  # (6,) largest difference that stays
    apart: NDArray[np.float64]  # (6,) largest one besides


@by_reference
class YawBank(NamedTuple):
    """What motion says of the heading (`yaw_bank`)."""

    quat: NDArray[np.float64]  # (4,) attitude with a free azimuth
    x: NDArray[np.float64]  # (hypotheses, 5) velocity N, E, yaw, acceleration that stays
    P: NDArray[np.float64]  # (hypotheses, 5, 5)
    weight: NDArray[np.float64]  # (hypotheses,) sum 1
    now: NDArray[np.float64]  # (15,) places of `YAW`
    count: NDArray[np.int64]  # type: ignore[assignment]  # (8,) places of `YAW_COUNT`


@by_reference
class YawParams(NamedTuple):
    """When motion is believed against the filter's heading."""

    difference_rad: float
    sigma_rad: float
    hold_ticks: int


@by_reference
class ObserverState(NamedTuple):
    """All memory of the observer, mutated in place (arrays of float64, `count` int64).

    Attributes
    ----------
    nominal : ndarray (21,)
        Filter state at the delayed horizon, indices NOMINAL.
    P : ndarray (20, 20)
        Covariance of the error state, indices ERROR.
    trial : ndarray (20, 20)
        Scratch covariance of a measurement that is still to pass its gate.
    dx : ndarray (2, 20)
        Scratch: accumulated correction, and a column of P H'.
    imu : ndarray (N, 7)
        Ring of IMU samples, slot = tick mod N: specific force, rate, 1.0 if no sensor said so.
    aid : ndarray (N, 13)
        Ring of samples of the aids and of fixes by their time of validity, indices AID.
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
        Innovation record, indices DIAG.
    heard : ndarray (31,)
        What the sensors said last, indices HEARD.
    count : ndarray of int64 (40,)
        Ticks, flags and counters, indices COUNT.
    window : Window
        What was taken lately, to be taken again.
    pair : ImuPair
        What is remembered of two IMUs.
    yaw : YawBank
        What motion says of the heading.
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
    yaw: "YawBank"


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
    var_aid: NDArray[np.float64]  # (aids,) of each number of a sample, in the order of `AIDS`
    field_ned_t: NDArray[np.float64]
    field_tolerance: float
    max_heading_innovation_rad: float
    origin_altitude_m: float
    gates: NDArray[np.float64]
    accel_limit_mps2: float
    rate_limit_radps: float
    var0: NDArray[np.float64]
    arms: bool  # whether IMU or antenna are elsewhere than at the c.g.
    imu_arm_m: NDArray[np.float64]  # (3,) from the c.g., body FRD
    antenna_m: NDArray[np.float64]  # (3,) from the IMU, body FRD
    late_ticks: int  # a sample of the IMU is of the motion so long before, and of a part of a
    late_part: float  # tick more
    mean_ticks: int  # over which a mean is taken that goes on behind the newest sample


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
    yaw: "YawParams"
    horizon_ticks: int
    align_ticks: int
    max_gap_ticks: int
    imu_timeout_ticks: int
    gps_timeout_ticks: int
    gps_recovery_ticks: int
    aid_timeout_ticks: NDArray[np.int64]  # (aids,) in the order of `AIDS`
