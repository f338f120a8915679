# SPDX-License-Identifier: Apache-2.0
"""The record of a flight of one process as messages: what its graph would have sent."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from heli_bags.reader import Remark, Stream
from heli_flight.loop.fault_file import flown_faults
from heli_flight.loop.record import FlightRecord
from heli_flight.loop.settings import Settings
from heli_math.rotations import quat_to_R_nb
from heli_math.rows import NAV, PLANT, REFERENCE
from heli_math.ticks import NS_PER_S
from heli_math.trajectory import MAX_POINTS, Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.diagnostics import FACT_MODE, FACT_OFFSET

Array = NDArray[np.float64]
_UNMOVED = "[0.0, 0.0, 0.0]"


def stamps_of(record: FlightRecord, start_ns: int) -> NDArray[np.int64]:
    """Stamps (N,) of a record's rows, ns."""
    return start_ns + np.round(record.time_s * NS_PER_S).astype(np.int64)


def streams_of(record: FlightRecord, stamp_ns: NDArray[np.int64]) -> dict[str, Stream]:
    """Topics of the graph that the record holds; rows that say nothing are left out."""
    velocity = [
        quat_to_R_nb(q).T @ v
        for q, v in zip(record.truth_q_nb, record.truth_vel_ned_mps, strict=True)
    ]
    truth = np.zeros((len(record), PLANT.rigid.stop))
    truth[:, PLANT.pos], truth[:, PLANT.vel] = record.truth_pos_ned_m, np.array(velocity)
    truth[:, PLANT.quat], truth[:, PLANT.rate] = record.truth_q_nb, record.truth_rate_body_radps
    nav = np.zeros((len(record), NAV.size))
    nav[:, NAV.pos], nav[:, NAV.vel] = record.nav_pos_ned_m, record.nav_vel_ned_mps
    nav[:, NAV.quat], nav[:, NAV.rate] = record.nav_q_nb, record.nav_rate_body_radps
    if record.nav_sigma_pos_m is not None:
        nav[:, NAV.sigma_pos] = record.nav_sigma_pos_m
    rows = {
        topics.TRUTH_ODOM: truth, topics.ODOM: nav, topics.ATTITUDE_SETPOINT: record.setpoint,
        topics.ACTUATORS: record.u, topics.ROTOR_STATE: record.nav_rotor,
        topics.TRUTH_ROTOR: record.truth_rotor, topics.TRUTH_WIND: record.wind_ned_mps,
    }  # fmt: skip
    found = {}
    for name, array in rows.items():
        known = np.isfinite(array).all(axis=1)
        if known.any():
            found[name] = Stream(stamp_ns[known], array[known])
    return found


def references_of(
    record: FlightRecord, stamp_ns: NDArray[np.int64]
) -> list[tuple[int, Trajectory]]:
    """The reference as it was followed, as trajectories of as many points as one may have."""
    known = np.isfinite(record.reference).all(axis=1)
    times, rows = stamp_ns[known], record.reference[known]
    if times.size > 1:
        # The last point of a trajectory stands still: one more, which is never reached.
        step_ns = times[-1] - times[-2]
        beyond = rows[-1].copy()
        beyond[REFERENCE.pos] += beyond[REFERENCE.vel] * (step_ns / NS_PER_S)
        times, rows = np.append(times, times[-1] + step_ns), np.vstack([rows, beyond])
    found = []
    for first in range(0, max(times.size - 1, min(times.size, 1)), MAX_POINTS - 1):
        part = slice(first, first + MAX_POINTS)
        found.append((int(times[first]), Trajectory(0, times[part], rows[part])))
    return found


def remarks_of(
    record: FlightRecord,
    stamp_ns: NDArray[np.int64],
    settings: Settings,
    told: Mapping[str, object],
) -> Sequence[Remark]:
    """What outer loop and plant would have said of modes, faults and the end."""
    modes = ["hover"] * len(record) if record.mode is None else [str(m) for m in record.mode]
    remarks = [
        Remark(int(stamp_ns[i]), "outer_loop", 0, "", {FACT_MODE: mode, FACT_OFFSET: _UNMOVED})
        for i, mode in enumerate(modes)
        if i == 0 or mode != modes[i - 1]
    ]
    faults = {"faults": "; ".join(fault.words for fault in flown_faults(settings))}
    lost, end_ns = str(told.get("lost") or ""), int(stamp_ns[-1])
    over = lost or f"flight over after {record.time_s[-1] + settings.rate.tick_s:g} s"
    first = Remark(int(stamp_ns[0]), "plant", 0, "flying", faults)
    last = Remark(end_ns, "plant", 2 if lost else 0, over, {**faults, "over": "true"})
    return [first, *remarks, last]
