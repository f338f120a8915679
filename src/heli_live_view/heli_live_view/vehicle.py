# SPDX-License-Identifier: Apache-2.0
"""Aircraft and reference as the page gets them: ENU and FLU, with the paper's errors. No ROS."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from heli_live_view.parameter_table import BOUNDS
from heli_math.paper_metrics import BY_KEY, hover_errors
from heli_math.rotations import euler_from_quat, quat_to_R_nb
from heli_math.rows import REFERENCE
from heli_msgs_bridge.frames import frd_to_flu, ned_to_enu, quat_ned_frd_to_enu_flu

Array = NDArray[np.float64]


def plain(values: Iterable[float], digits: int = 4) -> list[float]:
    """Finite values as short floats for JSON, without a negative zero."""
    return [round(float(v), digits) + 0.0 for v in values]


def bounds(parameters: Mapping[str, Any]) -> dict[str, float]:
    """Bounds for the page by name: the parameter's, or the paper's where that is negative."""
    given = {name: parameters[f"bounds.{name}"] for name in BOUNDS}
    return {
        name: value if value >= 0.0 else BY_KEY[BOUNDS[name]].paper for name, value in given.items()
    }


def error_row(pos_ned_m: Array, vel_ned_mps: Array, reference: Array) -> dict[str, float]:
    """The paper's errors of a vehicle (3,), (3,) from its reference (7,), by name of the bound.

    In the frame of the reference's heading: forward, right, and **up**, as people look at it.
    """
    found = hover_errors(pos_ned_m[None], vel_ned_mps[None], reference[None])
    up = {"altitude": -1.0, "v_z": -1.0}
    return {
        name: plain(up.get(key, 1.0) * found[key])[0]
        for name, key in BOUNDS.items()
        if key in found
    }


def body_row(
    pos_ned_m: Array,
    vel_ned_mps: Array,
    q_nb: Array,
    rate_body_radps: Array,
    reference: Array | None = None,
) -> dict[str, Any]:
    """A vehicle for the page.

    Parameters
    ----------
    pos_ned_m, vel_ned_mps : (3,) array
    q_nb : (4,) array
        FRD -> NED, w x y z.
    rate_body_radps : (3,) array
        FRD.
    reference : (7,) array, optional
        Where it should be now.

    Returns
    -------
    dict
        p, v_enu (ENU), q (x, y, z, w; FLU -> ENU), v_body (forward, left, up), euler_deg
        (phi, theta, psi) and rates_dps (p, q, r) in NED/FRD; error as of `error_row`, None
        without a reference.
    """
    p, v_enu, v_flu, q = np.empty(3), np.empty(3), np.empty(3), np.empty(4)
    ned_to_enu(pos_ned_m, p)
    ned_to_enu(vel_ned_mps, v_enu)
    frd_to_flu(quat_to_R_nb(q_nb).T @ vel_ned_mps, v_flu)
    quat_ned_frd_to_enu_flu(q_nb, q)
    return {
        "p": plain(p),
        "q": plain(q, 6),
        "v_body": plain(v_flu),
        "v_enu": plain(v_enu),
        "euler_deg": plain(np.degrees(euler_from_quat(q_nb)), 3),
        "rates_dps": plain(np.degrees(rate_body_radps), 3),
        "error": None if reference is None else error_row(pos_ned_m, vel_ned_mps, reference),
    }


def reference_row(reference: Array) -> dict[str, Any]:
    """Where the aircraft should be (7,), for the page: p, v (ENU), yaw_deg clockwise from north."""
    return {
        "p": plain(enu(reference[REFERENCE.pos])),
        "v": plain(enu(reference[REFERENCE.vel])),
        "yaw_deg": round(math.degrees(reference[REFERENCE.psi]), 3),
    }


def enu(v_ned: Array) -> Array:
    """A NED vector (3,) in ENU."""
    v_enu = np.empty(3)
    ned_to_enu(v_ned, v_enu)
    return v_enu
