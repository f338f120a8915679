# SPDX-License-Identifier: Apache-2.0
"""Names of the coordinate frames in messages (REP-105); which of them an aircraft owns. No ROS.

`map` is the local tangent plane about the origin that all aircraft share. All other frames belong
to one aircraft and carry its namespace: `heli2/base_link`; in the empty namespace `base_link`.
"""

MAP = "map"
"""ENU about the NED origin. Estimates that hold a GPS are given in it, and so is the truth."""
ODOM = "odom"
"""ENU, drifts, never jumps: the estimated velocity, summed up (`transforms`)."""
BASE = "base_link"
"""FLU, at the centre of gravity."""
IMU_LINK, IMU2_LINK, GPS_LINK = "imu_link", "imu2_link", "gps_link"
"""Where the sensors sit. The simulated ones sit at the centre of gravity."""


def in_namespace(frame: str, namespace: str) -> str:
    """Frame of the aircraft in a namespace (`/heli2`, `heli2` or ``); `map` belongs to all."""
    owner = namespace.strip("/")
    return frame if frame == MAP or not owner else f"{owner}/{frame}"
