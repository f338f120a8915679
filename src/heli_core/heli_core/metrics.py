# SPDX-License-Identifier: Apache-2.0
"""What the paper measures a flight by: its errors and the largest ones it shows (section 4).

Scores, report and live view take both from here. The paper's numbers are from flight.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from heli_math.rotations import euler_angles
from heli_math.rows import REFERENCE, SETPOINT

Array = NDArray[np.float64]
_ROLL_PITCH = slice(SETPOINT.phi, SETPOINT.psi)


@dataclass(frozen=True)
class Metric:
    """One error, the largest magnitude of it that the paper shows, and where."""

    key: str
    label: str
    unit: str
    paper: float
    source: str


PATH = "path"
"""The kind of flight that the paper has not."""

ATTITUDE_DEG: Mapping[str, tuple[float, str]] = {"hinf": (1.7, "Fig. 4"), "pid": (4.8, "Fig. 3")}
"""Largest roll or pitch, deg, that the paper shows under an attitude law, and where."""

METRICS: Mapping[str, tuple[Metric, ...]] = {
    "hover": (
        Metric("v_z", "vertical speed - reference", "m/s", 0.18, "Fig. 5"),
        Metric("v_x", "forward speed", "m/s", 0.30, "Fig. 6"),
        Metric("v_y", "lateral speed", "m/s", 0.30, "Fig. 7"),
        Metric("altitude", "altitude error", "m", 0.40, "Fig. 8"),
        Metric("lateral", "lateral position error", "m", 1.02, "Fig. 9"),
        Metric("longitudinal", "longitudinal position error", "m", 0.65, "Fig. 9"),
    ),
    "attitude": (
        Metric("roll", "roll error", "deg", *ATTITUDE_DEG["hinf"]),
        Metric("pitch", "pitch error", "deg", *ATTITUDE_DEG["hinf"]),
    ),
    PATH: (
        Metric("position", "distance from the path's point", "m", 0.50, "goal"),
        Metric("heading", "heading error", "deg", 5.0, "goal"),
    ),
}
"""Metrics per kind of flight; any attitude law is judged by the paper's best. The paper flies no
paths, so their figures are goals."""
POSITIONS = ("altitude", "lateral", "longitudinal")
"""The metrics of hover that a receiver's drift shifts."""
SETTLED_S = 5.0
"""When the navigation's own start is over: its position's error about then is the receiver's drift
at engagement, freed of the first fixes' noise."""
ABOUT_S = 0.5
"""The error is the mean over so long before and after."""
BY_KEY: Mapping[str, Metric] = {metric.key: metric for row in METRICS.values() for metric in row}


def heading_frame(vector_ned: Array, psi: Array) -> Array:
    """Rotate (N, 3) NED vectors into the frame of the headings psi (N,): forward, right, down."""
    c, s = np.cos(psi), np.sin(psi)
    forward = c * vector_ned[:, 0] + s * vector_ned[:, 1]
    right = -s * vector_ned[:, 0] + c * vector_ned[:, 1]
    return np.column_stack((forward, right, vector_ned[:, 2]))


def hover_errors(pos_ned_m: Array, vel_ned_mps: Array, reference: Array) -> dict[str, Array]:
    """Errors (N,) by key of the metrics of hover: in the frame of the reference's heading.

    Parameters
    ----------
    pos_ned_m, vel_ned_mps : (N, 3) ndarray
    reference : (N, 7) ndarray
        As `rows.REFERENCE`.

    Returns
    -------
    dict
        Position (m) and velocity (m/s) minus reference: forward, right, **down**.
    """
    psi = reference[:, REFERENCE.psi]
    pos = heading_frame(pos_ned_m - reference[:, REFERENCE.pos], psi)
    vel = heading_frame(vel_ned_mps - reference[:, REFERENCE.vel], psi)
    return {
        "v_z": vel[:, 2],
        "v_x": vel[:, 0],
        "v_y": vel[:, 1],
        "altitude": pos[:, 2],
        "lateral": pos[:, 1],
        "longitudinal": pos[:, 0],
    }


def drift_at_engagement(
    time_s: Array, nav_pos_ned_m: Array, truth_pos_ned_m: Array
) -> Array | None:
    """What the navigation's position (3,), NED, is off by once it has settled, m.

    Parameters
    ----------
    time_s : (N,) ndarray
        Flight time.
    nav_pos_ned_m, truth_pos_ned_m : (N, 3) ndarray

    Returns
    -------
    (3,) ndarray or None
        None if no sample is about `SETTLED_S`, or one of these is not finite.
    """
    error = (nav_pos_ned_m - truth_pos_ned_m)[np.abs(time_s - SETTLED_S) < ABOUT_S]
    return error.mean(axis=0) if error.size and np.isfinite(error).all() else None


def in_windows(time_s: Array, windows_s: Array) -> NDArray[np.bool_]:
    """Mask (N,) of the times (N,), s, in one of the windows (M, 2), s, its end excluded."""
    mask = np.zeros(time_s.shape, bool)
    for start, end in windows_s:
        mask |= (time_s >= start) & (time_s < end)
    return mask


def size(error: Array) -> tuple[float, float]:
    """Largest magnitude and rms of an error (N,), in its unit."""
    return float(np.abs(error).max()), float(np.sqrt(np.mean(error * error)))


def attitude_errors(q_nb: Array, setpoint: Array) -> dict[str, Array]:
    """Errors (N,), deg, by key of the metrics of the attitude test.

    Parameters
    ----------
    q_nb : (N, 4) ndarray
        Body -> NED.
    setpoint : (N, >= 2) ndarray
        Commanded phi, theta, rad.
    """
    error = np.degrees(euler_angles(q_nb)[:, _ROLL_PITCH] - setpoint[:, _ROLL_PITCH])
    return {"roll": error[:, 0], "pitch": error[:, 1]}


def path_errors(pos_ned_m: Array, q_nb: Array, reference: Array) -> dict[str, Array]:
    """Errors (N,) by key of the metrics of a path, which moves with time.

    Parameters
    ----------
    pos_ned_m : (N, 3) ndarray
    q_nb : (N, 4) ndarray
        Body -> NED.
    reference : (N, 7) ndarray
        As `rows.REFERENCE`.

    Returns
    -------
    dict
        Distance, m, and heading minus reference, deg, wrapped.
    """
    away = np.linalg.norm(pos_ned_m - reference[:, REFERENCE.pos], axis=1)
    turned = euler_angles(q_nb)[:, SETPOINT.psi] - reference[:, REFERENCE.psi]
    return {"position": away, "heading": np.degrees(np.angle(np.exp(1j * turned)))}
