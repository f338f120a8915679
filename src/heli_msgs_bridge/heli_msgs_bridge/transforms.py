# SPDX-License-Identifier: Apache-2.0
"""Transforms between frames as the bytes of `tf2_msgs/TFMessage`, and the frame `odom`. No ROS.

The wheels of ROS 2 hold no tf2_msgs; where it is installed, these bytes are what its messages are.
"""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from heli_math.rows import NAV
from heli_math.ticks import NS_PER_S, TICK_S
from heli_msgs_bridge.cdr import Layout
from heli_msgs_bridge.frame_ids import BASE, MAP, ODOM, in_namespace
from heli_msgs_bridge.frames import ned_to_enu, quat_ned_frd_to_enu_flu

Array = NDArray[np.float64]
_UNTURNED = (0.0, 0.0, 0.0, 1.0)


class Transform(NamedTuple):
    """Where a frame lies in its parent: m; quaternion x, y, z, w. ENU or FLU, as the parent is."""

    parent: str
    child: str
    xyz_m: Sequence[float]
    xyzw: Sequence[float] = _UNTURNED


def encode_transforms(transforms: Sequence[Transform], stamp_ns: int) -> bytes:
    """Serialised `tf2_msgs/TFMessage`, all of one stamp (ns)."""
    layout = Layout().put("I", len(transforms))
    sec, nanosec = divmod(stamp_ns, NS_PER_S)
    for t in transforms:
        layout.put("i", sec).put("I", nanosec).text(t.parent).text(t.child)
        layout.numbers([*t.xyz_m, *t.xyzw])
    return bytes(layout.data)


def fixed_to_base(mounts: Mapping[str, Sequence[float]], namespace: str) -> list[Transform]:
    """Where frames are fixed to the aircraft's own, by name: m, FLU, not turned."""
    base = in_namespace(BASE, namespace)
    return [Transform(base, in_namespace(child, namespace), at) for child, at in mounts.items()]


def encode_text(text: str) -> bytes:
    """Serialised `std_msgs/String`."""
    return bytes(Layout().text(text).data)


class FrameTree:
    """map -> odom -> base_link of an aircraft, as its navigation says.

    REP-105: in `odom` the aircraft moves without jumps, in `map` it is where the GPS says. So
    base_link moves in odom as the estimated velocity says, summed up, and odom lies in map where
    the estimated position then comes out right. Both begin together.

    Parameters
    ----------
    namespace : str
        Of the aircraft.
    tick_s : float
        Length of a tick.
    """

    def __init__(self, namespace: str, tick_s: float = TICK_S) -> None:
        self._tick_s = tick_s
        self._odom, self._base = (in_namespace(frame, namespace) for frame in (ODOM, BASE))
        self._tick: int | None = None
        self._pos_ned_m, self._vel_ned_mps = np.zeros(3), np.zeros(3)

    def follow(self, nav: Array, tick: int) -> bool:
        """Take the navigation row (31,) of a tick; False while it knows nothing."""
        pos, vel = nav[NAV.pos], nav[NAV.vel]
        if not (np.isfinite(pos).all() and np.isfinite(vel).all()):
            self._tick = None
            return False
        if self._tick is None:
            self._pos_ned_m[:] = pos
        else:
            self._pos_ned_m += (
                0.5 * (self._vel_ned_mps + vel) * ((tick - self._tick) * self._tick_s)
            )
        self._tick, self._vel_ned_mps[:] = tick, vel
        return True

    def transforms(self, nav: Array) -> tuple[Transform, Transform]:
        """map -> odom and odom -> base_link, ENU and FLU, after `follow` of the same row."""
        there, here, xyzw = np.empty(3), np.empty(3), np.empty(4)
        ned_to_enu(nav[NAV.pos] - self._pos_ned_m, there)
        ned_to_enu(self._pos_ned_m, here)
        quat_ned_frd_to_enu_flu(nav[NAV.quat], xyzw)
        return (
            Transform(MAP, self._odom, there.tolist()),
            Transform(self._odom, self._base, here.tolist(), xyzw.tolist()),
        )
