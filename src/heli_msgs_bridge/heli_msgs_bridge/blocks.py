# SPDX-License-Identifier: Apache-2.0
"""Places in the block of doubles of each message type, field by field as its definition has them.

ENU, FLU, SI. Covariances are row by row; as everywhere, a place of one number is an int and of
several a slice.
"""

from typing import NamedTuple


class OdometryBlock(NamedTuple):
    """nav_msgs/Odometry (85,)."""

    pos: slice = slice(0, 3)
    quat: slice = slice(3, 7)  # x, y, z, w
    pose: slice = slice(0, 7)  # both
    pose_cov: slice = slice(7, 43)  # 6 x 6: position, rotation about the fixed axes
    rotation_cov: slice = slice(28, 43)  # the same from its lower right 3 x 3 on
    linear: slice = slice(43, 46)
    angular: slice = slice(46, 49)
    twist: slice = slice(43, 49)  # both
    twist_cov: slice = slice(49, 85)  # 6 x 6: linear, angular
    size: int = 85


class ImuBlock(NamedTuple):
    """sensor_msgs/Imu (37,)."""

    quat: slice = slice(0, 4)  # x, y, z, w
    quat_cov: slice = slice(4, 13)
    rate: slice = slice(13, 16)
    rate_cov: slice = slice(16, 25)
    accel: slice = slice(25, 28)
    accel_cov: slice = slice(28, 37)
    size: int = 37


class FieldBlock(NamedTuple):
    """sensor_msgs/MagneticField (12,)."""

    field: slice = slice(0, 3)
    cov: slice = slice(3, 12)
    size: int = 12


class FixBlock(NamedTuple):
    """sensor_msgs/NavSatFix (12,)."""

    latitude: int = 0
    longitude: int = 1
    geodetic: slice = slice(0, 3)  # both, deg, and the altitude, m
    cov: slice = slice(3, 12)  # ENU
    size: int = 12


class TwistBlock(NamedTuple):
    """geometry_msgs/TwistWithCovarianceStamped (42,)."""

    linear: slice = slice(0, 3)
    angular: slice = slice(3, 6)
    twist: slice = slice(0, 6)  # both
    cov: slice = slice(6, 42)  # 6 x 6
    size: int = 42


class PressureBlock(NamedTuple):
    """sensor_msgs/FluidPressure (2,)."""

    pressure: int = 0
    variance: int = 1
    size: int = 2


class QuaternionBlock(NamedTuple):
    """geometry_msgs/QuaternionStamped (4,)."""

    xyzw: slice = slice(0, 4)
    size: int = 4


class VectorBlock(NamedTuple):
    """geometry_msgs/Vector3Stamped (3,), and the three first doubles of other messages."""

    xyz: slice = slice(0, 3)
    size: int = 3


ODOMETRY = OdometryBlock()
IMU = ImuBlock()
FIELD = FieldBlock()
FIX = FixBlock()
TWIST = TwistBlock()
PRESSURE = PressureBlock()
QUATERNION = QuaternionBlock()
VECTOR = VectorBlock()
