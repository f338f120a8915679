# SPDX-License-Identifier: Apache-2.0
"""The record of a flight: arrays, one row per tick, from the one-process loop or from a bag."""

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from heli_core.errors import FlightError
from heli_core.foreign_files import FileError, read_arrays
from heli_core.jit import by_reference
from heli_core.rows import ACTUATOR, IMU, NAV, REFERENCE, SETPOINT, TRUTH
from heli_core.ticks import Rate

# -------------------------------------------------------------------------------------------------
# Record.
# -------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class FlightRecord:
    """Arrays over ticks, NED/FRD, SI, rad.

    Attributes
    ----------
    time_s : (N,) ndarray
        Flight time.
    truth_pos_ned_m, truth_vel_ned_mps, truth_rate_body_radps : (N, 3) ndarray
    truth_q_nb : (N, 4) ndarray
        Quaternion body -> NED.
    truth_rotor : (N, 3) ndarray
        a_s, b_s rad and the gyro's integrator d_int.
    wind_ned_mps : (N, 3) ndarray
        Velocity of the air at the aircraft, blowing towards.
    nav_pos_ned_m, nav_vel_ned_mps, nav_rate_body_radps : (N, 3) ndarray
    nav_q_nb : (N, 4) ndarray
        The on-board state estimate (the observer's odom).
    nav_rotor : (N, 3) ndarray
        Estimates of truth_rotor.
    reference : (N, 7) ndarray
        Position NED, velocity NED, heading.
    setpoint : (N, 3) ndarray
        Commanded phi, theta, psi.
    u : (N, 4) ndarray
        Actuators d_lat, d_lon, d_ped, d_col.
    nav_sigma_pos_m, nav_sigma_vel_mps : (N, 3) ndarray, optional
        Standard deviations of the state estimate, NED; None if they were not recorded.
    nav_sigma_att_rad : (N, 3) ndarray, optional
        The same of its attitude, as a rotation about north, east and down.
    excitation_u : (N, 4) ndarray, optional
        What identification added to u; this and the next are None where nothing was excited.
    gust_ned_mps : (N, 3) ndarray, optional
        Injected periodic gust alone, NED.
    imu : (N, 6) ndarray, optional
        As measured: specific force, m/s2, and rates, rad/s, body; None where it is not recorded.
    mode : (N,) ndarray of str, optional
        Mode that was flown; None where it was never another than to follow the reference.
    failsafe : (N,) ndarray of str, optional
        What the position loop did by itself for want of a position or a vertical speed, names of
        `heli_outer_pd.failsafes.Action`; None where it never did anything.
    takeoff_height_m : (N,) ndarray, optional
        Height of the newest take-off that had one of its own, NaN before; None where none had.
    commanded : (N,) ndarray of bool, optional
        Where it followed what a pilot had commanded in flight, not the scenario; None: nowhere.
    """

    time_s: np.ndarray
    truth_pos_ned_m: np.ndarray
    truth_vel_ned_mps: np.ndarray
    truth_rate_body_radps: np.ndarray
    truth_q_nb: np.ndarray
    truth_rotor: np.ndarray
    wind_ned_mps: np.ndarray
    nav_pos_ned_m: np.ndarray
    nav_vel_ned_mps: np.ndarray
    nav_rate_body_radps: np.ndarray
    nav_q_nb: np.ndarray
    nav_rotor: np.ndarray
    reference: np.ndarray
    setpoint: np.ndarray
    u: np.ndarray
    nav_sigma_pos_m: np.ndarray | None = None
    nav_sigma_vel_mps: np.ndarray | None = None
    nav_sigma_att_rad: np.ndarray | None = None
    excitation_u: np.ndarray | None = None
    gust_ned_mps: np.ndarray | None = None
    imu: np.ndarray | None = None
    mode: np.ndarray | None = None
    failsafe: np.ndarray | None = None
    takeoff_height_m: np.ndarray | None = None
    commanded: np.ndarray | None = None

    def __len__(self) -> int:
        return self.time_s.size


def record_until(record: FlightRecord, end_s: float) -> FlightRecord:
    """The rows of a record before a flight time, s."""
    rows = record.time_s < end_s
    arrays = ((field.name, getattr(record, field.name)) for field in fields(record))
    kept: dict[str, Any] = {name: a if a is None else a[rows] for name, a in arrays}
    return FlightRecord(**kept)


# -------------------------------------------------------------------------------------------------
# The record of a flight in a file: what a flight of one process leaves in place of a bag.
# -------------------------------------------------------------------------------------------------

NAME = "record.npz"


def write_record(record: FlightRecord, folder: Path) -> Path:
    """Write the arrays of a record into a folder; what was not recorded is left out.

    Raises
    ------
    OSError
        The folder cannot be written.
    """
    arrays = {field.name: getattr(record, field.name) for field in fields(record)}
    path = folder / NAME
    with path.open("wb") as file:
        np.savez(file, **{name: array for name, array in arrays.items() if array is not None})
    return path


def read_record(path: Path) -> FlightRecord:
    """Read what `write_record` wrote.

    Raises
    ------
    FlightError
        The file cannot be read, or holds no record; one sentence.
    """
    try:
        arrays = read_arrays(path)
        record = FlightRecord(**arrays)
    except FileError as error:
        raise FlightError(f"{path}: holds no record of a flight: {error.problem}") from None
    except TypeError as error:
        raise FlightError(f"{path}: holds no record of a flight: {error}") from None
    wrong = [name for name, array in arrays.items() if array.shape[:1] != record.time_s.shape]
    if wrong or record.time_s.ndim != 1:
        raise FlightError(f"{path}: {wrong or 'time_s'} and time_s differ in length")
    return record


# -------------------------------------------------------------------------------------------------
# What the one-process loop writes down tick by tick, and the record that becomes of it.
# -------------------------------------------------------------------------------------------------


@by_reference
class FlightTrack(NamedTuple):
    """What is recorded, one row per tick; places of `heli_core.rows`."""

    truth: np.ndarray  # (n, 19) TRUTH
    nav: np.ndarray  # (n, 31) NAV
    reference: np.ndarray  # (n, 7) REFERENCE
    setpoint: np.ndarray  # (n, 4) SETPOINT
    u: np.ndarray  # (n, 4) ACTUATOR
    imu: np.ndarray  # (n, 6) IMU
    # no rows unless something is excited:
    excitation: np.ndarray  # (n, 4) ACTUATOR, what was added to u
    gust: np.ndarray  # (n, 3) NED, m/s


def empty_track(n: int, excited: bool) -> FlightTrack:
    """Rows for n ticks; those of what is excited only if something is."""
    sizes = (TRUTH.size, NAV.size, REFERENCE.size, SETPOINT.size, ACTUATOR.size, IMU.size)
    added = (ACTUATOR.size, 3)
    return FlightTrack(
        *(np.zeros((n, size)) for size in sizes),
        *(np.zeros((n if excited else 0, size)) for size in added),
    )


def record_of(track: FlightTrack, n: int, rate: Rate) -> FlightRecord:
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
