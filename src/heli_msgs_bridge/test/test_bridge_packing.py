# SPDX-License-Identifier: Apache-2.0
"""Navigation rows as Odometry: covariances in the axes that the message definition asks for."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from heli_core.rows import NAV
from heli_msgs_bridge import layouts
from heli_msgs_bridge.layouts import ODOMETRY

R_ENU_NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
R_FRD_FLU = np.diag([1.0, -1.0, -1.0])


@pytest.fixture
def nav():
    """A row with values that are all different; rotor states and biases are not sent."""
    row = np.zeros(NAV.size)
    row[0:3], row[3:6] = [10.0, -4.0, -12.0], [1.0, -2.0, 0.5]
    q = Rotation.from_euler("ZYX", [2.0, -0.3, 0.2]).as_quat()
    row[6:10] = q[3], q[0], q[1], q[2]
    row[10:13] = [0.1, -0.2, 0.3]
    row[22:25], row[25:28], row[28:31] = [0.1, 0.2, 0.3], [0.4, 0.5, 0.6], [0.01, 0.02, 0.03]
    return row


def test_navigation_comes_back(nav):
    """Packed and unpacked; 1e-12."""
    block, back = np.zeros(ODOMETRY.size), np.zeros(NAV.size)
    layouts.pack_nav(nav, block)
    assert layouts.unpack_nav(block, back) == layouts.OK
    assert back == pytest.approx(nav, abs=1e-12)


def test_covariances_are_in_the_frames_of_the_message(nav):
    """Pose: position, then rotation about the fixed axes of the header's frame (ENU). Twist: FLU.

    nav_msgs/Odometry, geometry_msgs/PoseWithCovariance; by matrix products; 1e-12.
    """
    block = np.zeros(ODOMETRY.size)
    layouts.pack_nav(nav, block)
    pose, twist = block[7:43].reshape(6, 6), block[49:85].reshape(6, 6)
    R_nb = Rotation.from_quat(np.roll(nav[6:10], -1)).as_matrix()
    R_flu_ned = R_FRD_FLU @ R_nb.T
    position, velocity, rotation = (np.diag(nav[i : i + 3] ** 2) for i in (22, 25, 28))
    assert pose[:3, :3] == pytest.approx(R_ENU_NED @ position @ R_ENU_NED.T, abs=1e-12)
    assert pose[3:, 3:] == pytest.approx(R_ENU_NED @ rotation @ R_ENU_NED.T, abs=1e-12)
    assert twist[:3, :3] == pytest.approx(R_flu_ned @ velocity @ R_flu_ned.T, abs=1e-12)
    assert (pose[:3, 3:] == 0.0).all() and (twist[3:, :] == 0.0).all()


def test_an_odometry_without_covariance_is_taken(nav):
    """Another publisher may leave them zero."""
    block, back = np.zeros(ODOMETRY.size), np.zeros(NAV.size)
    layouts.pack_nav(nav, block)
    block[7:43] = block[49:85] = 0.0
    assert layouts.unpack_nav(block, back) == layouts.OK
    assert (back[22:31] == 0.0).all()
