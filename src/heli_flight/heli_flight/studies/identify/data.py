# SPDX-License-Identifier: Apache-2.0
"""From a bag or a flight's record to the experiment that the fits take; what a bag lacks is named.

Only topics that a real aircraft has are read: navigation, inertial sensors, actuators and the
excitation. Ground truth is never touched.
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from heli_bags.reader import Bag, Stream, read_bag
from heli_bags.recorder import BagError
from heli_flight.loop.record import FlightRecord
from heli_flight.studies.identify.parameter_table import Given
from heli_identification.experiment import Experiment
from heli_math.rotations import euler_angles, quat_to_R_nb
from heli_math.rows import ACTUATOR, IMU, NAV
from heli_math.state_names import ACTUATOR_NAMES, WIND_NAMES
from heli_math.ticks import NS_PER_S, TICK_NS, TICK_S, stamp_at, ticks_in
from heli_msgs_bridge import topics

EXCITATION = {"actuators": topics.EXCITATION_ACTUATORS, "gusts": topics.EXCITATION_WIND}
"""Topic that makes a bag one of an experiment."""
_COMMON = (topics.ODOM, topics.IMU, topics.ACTUATORS)
_CHANNELS = {
    "actuators": ACTUATOR_NAMES,
    "gusts": WIND_NAMES,
}
_SENDERS = {
    "actuators": "inner_loop sends it only while its excitation.* is configured",
    "gusts": "plant sends it only while its wind.sines.* is configured",
}
_SMALLEST = 1e-9


class BagDataError(ValueError):
    """A bag that cannot be identified from; one sentence with the topic and the reason."""


def experiment_of_record(record: FlightRecord, given: Given) -> Experiment:
    """Experiment out of the one-process loop's record.

    Raises
    ------
    BagDataError
        Nothing was excited in that flight.
    """
    if record.excitation_u is None or record.gust_ned_mps is None or record.imu is None:
        raise BagDataError(
            "the flight was not excited: neither excitation.* nor wind.sines.* is on"
        )
    return _experiment(
        record.time_s,
        record.nav_vel_ned_mps,
        record.nav_q_nb,
        record.imu,
        record.u,
        record.excitation_u,
        record.gust_ned_mps,
        given,
    )


def experiment_of_bag(path: Path, kind: str, given: Given, start_time_s: float) -> Experiment:
    """Experiment out of a bag.

    Parameters
    ----------
    path : Path
        rosbag2 folder, or a flight's folder with one in `bag`.
    kind : str
        "actuators" or "gusts".
    given : Given
    start_time_s : float
        Stamp of flight time 0.

    Raises
    ------
    BagDataError
        No bag, a topic is missing, its messages cannot be used, it is too short, has gaps, or
        nothing is excited.
    """
    folder = path / "bag" if (path / "bag").is_dir() else path
    try:
        bag = read_bag(folder)
    except BagError as error:
        raise BagDataError(str(error)) from error
    excitation = EXCITATION[kind]
    needed = (*_COMMON, excitation)
    start_ns = stamp_at(start_time_s)
    first, count = ticks_in(given.start_s), ticks_in(given.periods * given.period_s)
    ticks = np.arange(first, first + count)
    rows = {name: _rows(bag, name, kind, path, start_ns, ticks) for name in needed}
    _refuse_silence(rows[excitation], kind, path, bag)
    nav = rows[topics.ODOM]
    added = rows[excitation] if kind == "actuators" else np.zeros((count, ACTUATOR.size))
    gust = rows[excitation] if kind == "gusts" else np.zeros((count, 3))
    return _experiment(
        np.asarray(ticks * TICK_S, np.float64),
        nav[:, NAV.vel],
        nav[:, NAV.quat],
        rows[topics.IMU],
        rows[topics.ACTUATORS],
        added,
        gust,
        given,
    )


def _rows(
    bag: Bag, name: str, kind: str, path: Path, start_ns: int, ticks: NDArray[np.int64]
) -> NDArray[np.float64]:
    """Rows of a topic at the ticks, all of them."""
    stream = bag.streams.get(name)
    if name in bag.refused:
        raise BagDataError(
            f"{path}: '{name}': {bag.refused[name]} messages cannot be used: "
            f"{bag.reasons.get(name, 'unreadable')}"
        )
    if stream is None or not stream.stamp_ns.size:
        hint = f" ({_SENDERS[kind]})" if name == EXCITATION[kind] else ""
        raise BagDataError(f"{path}: no message on '{name}'{hint}")
    known = _ticks_of(stream, name, path, start_ns)
    end_s = (ticks[-1] + 1) * TICK_S
    if known[0] > ticks[0] or known[-1] < ticks[-1]:
        raise BagDataError(
            f"{path}: '{name}' covers flight time {known[0] * TICK_S:g} to "
            f"{known[-1] * TICK_S:g} s, but {ticks[0] * TICK_S:g} to {end_s:g} s are needed: "
            "too short"
        )
    at = np.searchsorted(known, ticks)
    gone = known[at] != ticks
    if gone.any():
        raise BagDataError(
            f"{path}: '{name}': {int(gone.sum())} of {ticks.size} messages are missing, the first "
            f"at flight time {ticks[int(np.argmax(gone))] * TICK_S:.2f} s"
        )
    return stream.rows[at]


def _ticks_of(stream: Stream, name: str, path: Path, start_ns: int) -> NDArray[np.int64]:
    ticks, rest = np.divmod(stream.stamp_ns - start_ns, TICK_NS)
    if np.any(rest != 0):
        raise BagDataError(
            f"{path}: '{name}': stamps are not whole multiples of 10 ms after start_time_s = "
            f"{start_ns / NS_PER_S:g} s"
        )
    return ticks


def _refuse_silence(rows: NDArray[np.float64], kind: str, path: Path, bag: Bag) -> None:
    """Every channel must be excited; if it was given up in flight, say why."""
    topic = EXCITATION[kind]
    for remark in bag.remarks:
        if remark.node == "inner_loop" and "excitation was given up" in remark.message:
            raise BagDataError(f"{path}: '{topic}': {remark.message}")
    for name, strength in zip(_CHANNELS[kind], rows.std(axis=0), strict=True):
        if strength < _SMALLEST:
            raise BagDataError(f"{path}: '{topic}': {name} is not excited in the evaluated periods")


def _experiment(
    time_s: NDArray[np.float64],
    vel_ned_mps: NDArray[np.float64],
    q_nb: NDArray[np.float64],
    imu: NDArray[np.float64],
    u: NDArray[np.float64],
    excitation_u: NDArray[np.float64],
    gust_ned_mps: NDArray[np.float64],
    given: Given,
) -> Experiment:
    """Velocities into body axes of the navigation's own attitude."""
    R_nb = np.array([quat_to_R_nb(np.ascontiguousarray(q)) for q in q_nb])
    attitude = euler_angles(q_nb)
    attitude[:, 2] = np.unwrap(attitude[:, 2])
    return Experiment(
        time_s=time_s,
        u=u,
        excitation_u=excitation_u,
        attitude_rad=attitude,
        rate_body_radps=imu[:, IMU.rate],
        vel_body_mps=np.einsum("nji,nj->ni", R_nb, vel_ned_mps),
        accel_body_mps2=imu[:, IMU.force],
        gust_body_mps=np.einsum("nji,nj->ni", R_nb, gust_ned_mps),
        period_s=given.period_s,
        start_s=given.start_s,
        periods=given.periods,
    )
