# SPDX-License-Identifier: Apache-2.0
"""Transforms: their bytes, and the frames map, odom and base_link of an aircraft (REP-105)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation
from std_msgs.msg import String

from heli_core.rows import NAV
from heli_msgs_bridge import topics
from heli_msgs_bridge.messages import FrameTree, Transform, encode_text, encode_transforms

STORE = get_typestore(Stores.ROS2_JAZZY)
NUMBERS = st.floats(allow_nan=False)
FRAMES = st.text("abc/_", max_size=9)
TRANSFORMS = st.lists(
    st.builds(Transform, FRAMES, FRAMES, st.tuples(*[NUMBERS] * 3), st.tuples(*[NUMBERS] * 4)),
    max_size=4,
)


@given(transforms=TRANSFORMS, sec=st.integers(0, 2**31 - 1), nanosec=st.integers(0, 10**9 - 1))
def test_bytes_are_those_of_tf2_msgs(transforms, sec, nanosec):
    """By the definition of Jazzy, which rosbags has; tf2_msgs itself is no wheel."""
    raw = encode_transforms(transforms, sec * 10**9 + nanosec)
    message = STORE.deserialize_cdr(raw, topics.KNOWN[topics.TF].type)
    assert len(message.transforms) == len(transforms)
    for wanted, got in zip(transforms, message.transforms, strict=True):
        assert (got.header.stamp.sec, got.header.stamp.nanosec) == (sec, nanosec)
        assert (got.header.frame_id, got.child_frame_id) == (wanted.parent, wanted.child)
        at, turn = got.transform.translation, got.transform.rotation
        assert (at.x, at.y, at.z) == wanted.xyz_m
        assert (turn.x, turn.y, turn.z, turn.w) == wanted.xyzw
    assert STORE.serialize_cdr(message, topics.KNOWN[topics.TF].type) == raw


@given(text=st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"])))
def test_a_text_is_the_string_of_ros(text):
    assert deserialize_message(encode_text(text), String).data == text


def nav_row(pos, vel=(0.0, 0.0, 0.0), euler=(0.0, 0.0, 0.0)):
    row = np.zeros(NAV.size)
    row[NAV.pos], row[NAV.vel] = pos, vel
    x, y, z, w = Rotation.from_euler("xyz", euler).as_quat()
    row[NAV.quat] = w, x, y, z
    return row


def placed(transform):
    """A 4x4 matrix out of a transform."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(transform.xyzw).as_matrix()
    matrix[:3, 3] = transform.xyz_m
    return matrix


def test_a_jump_of_the_gps_moves_odom_and_not_the_aircraft_in_it():
    tree, rng = FrameTree(""), np.random.default_rng(3)
    pos, jump, in_odom = np.array([3.0, -2.0, -10.0]), np.zeros(3), []
    for tick in range(500):
        vel = np.array([1.0, 0.5 * np.sin(0.01 * tick), -0.1])
        pos = pos + vel * 0.01
        if tick % 100 == 50:
            jump = rng.normal(size=3)
        nav = nav_row(pos + jump, vel, (0.02, -0.01, 0.4))
        assert tree.follow(nav, tick)
        to_odom, to_base = tree.transforms(nav)
        # In map it is where navigation says, whatever odom does (ENU: east, north, up).
        whole = placed(to_odom) @ placed(to_base)
        north, east, down = pos + jump
        assert whole[:3, 3] == pytest.approx([east, north, -down], abs=1e-12)
        in_odom.append(np.array(to_base.xyz_m))
    steps = np.linalg.norm(np.diff(in_odom, axis=0), axis=1)
    assert steps.max() < 1.2 * 0.01, "no faster than it flies"


def test_odom_begins_where_the_aircraft_is_known_first_and_again_when_it_is_lost():
    tree, unknown = FrameTree(""), nav_row([np.nan] * 3)
    assert not tree.follow(unknown, 0)
    for tick in (1, 11):
        nav = nav_row([5.0, 6.0, -7.0], [1.0, 1.0, 1.0])
        assert tree.follow(nav, tick)
        to_odom, to_base = tree.transforms(nav)
        assert list(to_odom.xyz_m) == [0.0] * 3 and to_base.xyz_m == [6.0, 5.0, 7.0]
        assert tree.follow(nav, tick + 5)
        assert tree.transforms(nav)[0].xyz_m != [0.0] * 3
        assert not tree.follow(unknown, tick + 6)


@pytest.mark.parametrize(("namespace", "mine"), [("/", ""), ("/heli2", "heli2/")])
def test_aircraft_share_map_and_own_the_rest(namespace, mine):
    tree, nav = FrameTree(namespace), nav_row([0.0] * 3)
    tree.follow(nav, 0)
    chain = [(t.parent, t.child) for t in tree.transforms(nav)]
    assert chain == [("map", f"{mine}odom"), (f"{mine}odom", f"{mine}base_link")]


def test_nobody_waits_for_those_who_only_draw():
    """What is for RViz is apart from what a flight needs; what stays is latched (REP-105, tf2)."""
    assert not set(topics.BY_NAME) & {topic.name for topic in topics.TOOLS}
    assert topics.qos(topics.TF_STATIC).durability.name == "TRANSIENT_LOCAL"
    assert topics.qos(topics.ROBOT_DESCRIPTION).durability.name == "TRANSIENT_LOCAL"
    assert topics.qos(topics.TF).durability.name == "VOLATILE"
    assert topics.installed(topics.ROBOT_DESCRIPTION)
