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
from heli_identification import Experiment
from heli_math.rotations import euler_angles, quat_to_R_nb
from heli_math.ticks import TICK_NS
from heli_msgs_bridge import topics

EXCITATION = {"actuators": topics.EXCITATION_ACTUATORS, "gusts": topics.EXCITATION_WIND}
"""Topic that makes a bag one of an experiment."""
_COMMON = (topics.ODOM, topics.IMU, topics.ACTUATORS)
_CHANNELS = {
    "actuators": ("d_lat", "d_lon", "d_ped", "d_col"),
    "gusts": ("u", "v", "w"),
}
_SENDERS = {
    "actuators": "inner_loop sends it only while its excitation.* is configured",
    "gusts": "plant sends it only while its wind.sines.* is configured",
}
_TICK_S = TICK_NS / 1e9
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
    nav = np.hstack([record.nav_vel_ned_mps, record.nav_q_nb])
    return _experiment(
        record.time_s, nav, record.imu, record.u, record.excitation_u, record.gust_ned_mps, given
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
    start_ns = round(start_time_s * 1e9)
    first, count = round(given.start_s / _TICK_S), round(given.periods * given.period_s / _TICK_S)
    ticks = np.arange(first, first + count)
    rows = {name: _rows(bag, name, kind, path, start_ns, ticks) for name in needed}
    _refuse_silence(rows[excitation], kind, path, bag)
    nav = rows[topics.ODOM]
    none = np.zeros((count, 4)), np.zeros((count, 3))
    added = rows[excitation] if kind == "actuators" else none[0]
    gust = rows[excitation] if kind == "gusts" else none[1]
    both = np.hstack([nav[:, 3:6], nav[:, 6:10]])
    return _experiment(
        np.asarray(ticks * _TICK_S, np.float64),
        both,
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
    end_s = (ticks[-1] + 1) * _TICK_S
    if known[0] > ticks[0] or known[-1] < ticks[-1]:
        raise BagDataError(
            f"{path}: '{name}' covers flight time {known[0] * _TICK_S:g} to "
            f"{known[-1] * _TICK_S:g} s, but {ticks[0] * _TICK_S:g} to {end_s:g} s are needed: "
            "too short"
        )
    at = np.searchsorted(known, ticks)
    gone = known[at] != ticks
    if gone.any():
        raise BagDataError(
            f"{path}: '{name}': {int(gone.sum())} of {ticks.size} messages are missing, the first "
            f"at flight time {ticks[int(np.argmax(gone))] * _TICK_S:.2f} s"
        )
    return stream.rows[at]


def _ticks_of(stream: Stream, name: str, path: Path, start_ns: int) -> NDArray[np.int64]:
    ticks, rest = np.divmod(stream.stamp_ns - start_ns, TICK_NS)
    if np.any(rest != 0):
        raise BagDataError(
            f"{path}: '{name}': stamps are not whole multiples of 10 ms after start_time_s = "
            f"{start_ns / 1e9:g} s"
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
    nav: NDArray[np.float64],
    imu: NDArray[np.float64],
    u: NDArray[np.float64],
    excitation_u: NDArray[np.float64],
    gust_ned_mps: NDArray[np.float64],
    given: Given,
) -> Experiment:
    """Velocities into body axes of the navigation's own attitude; nav: velocity NED 3, q_nb 4."""
    R_nb = np.array([quat_to_R_nb(np.ascontiguousarray(q)) for q in nav[:, 3:7]])
    attitude = euler_angles(nav[:, 3:7])
    attitude[:, 2] = np.unwrap(attitude[:, 2])
    return Experiment(
        time_s=time_s,
        u=u,
        excitation_u=excitation_u,
        attitude_rad=attitude,
        rate_body_radps=imu[:, 3:6],
        vel_body_mps=np.einsum("nji,nj->ni", R_nb, nav[:, 0:3]),
        accel_body_mps2=imu[:, 0:3],
        gust_body_mps=np.einsum("nji,nj->ni", R_nb, gust_ned_mps),
        period_s=given.period_s,
        start_s=given.start_s,
        periods=given.periods,
    )
