# SPDX-License-Identifier: Apache-2.0
"""/tf, /tf_static and robot_description of a flight, as a bag for RViz holds them.

The wheels have no tf2_msgs. A class under its name stands in for it here: the graph sends bytes,
so any class lets it send them, and what they say is read by the definition of tf2_msgs.
"""

from xml.etree import ElementTree

import numpy as np
import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore
from scipy.spatial.transform import Rotation

from heli_bags.reader import read_bag
from heli_msgs_bridge import topics

STAND_IN = "from visualization_msgs.msg import MarkerArray as TFMessage\n"
TF = topics.KNOWN[topics.TF].type


@pytest.fixture
def stand_in(tmp_path, ros_env):
    """A folder on the path of the test's processes with a package tf2_msgs."""
    if topics.installed(topics.TF):
        return
    (tmp_path / "path/tf2_msgs/msg").mkdir(parents=True)
    (tmp_path / "path/tf2_msgs/__init__.py").write_text("")
    (tmp_path / "path/tf2_msgs/msg/__init__.py").write_text(STAND_IN)
    before = ros_env.get("PYTHONPATH")
    ros_env["PYTHONPATH"] = f"{tmp_path / 'path'}{f':{before}' if before else ''}"


def recorded(bag, topic):
    """Messages of a topic: stamp in the bag, message."""
    store = get_typestore(Stores.ROS2_JAZZY)
    with Reader(bag) as reader:
        connections = [c for c in reader.connections if c.topic == topic]
        return [
            (stamp_ns, store.deserialize_cdr(raw, connection.msgtype))
            for connection, stamp_ns, raw in reader.messages(connections=connections)
        ]


def placed(transform):
    """Position (3,) and Rotation of a geometry_msgs/Transform."""
    at, q = transform.translation, transform.rotation
    return np.array([at.x, at.y, at.z]), Rotation.from_quat([q.x, q.y, q.z, q.w])


@pytest.mark.slow
def test_a_flight_tells_where_its_frames_are(stand_in, hover_test, tmp_path):
    done = hover_test("--out", tmp_path / "flight", "--duration", 8, "--seed", 2)
    assert done.returncode == 0, done.stdout + done.stderr
    bag = tmp_path / "flight/bag"
    ((_, description),) = recorded(bag, "/robot_description")
    robot = ElementTree.fromstring(description.data)
    joints = robot.findall("joint[@type='fixed']")
    links = {joint.find("child").get("link") for joint in joints}
    ((_, static),) = recorded(bag, "/tf_static")
    fixed = {(t.header.frame_id, t.child_frame_id) for t in static.transforms}
    assert fixed == {("base_link", link) for link in links}
    (turning,) = {j.get("name") for j in robot.findall("joint[@type='continuous']")}
    assert {tuple(m.name) for _, m in recorded(bag, "/joint_states")} == {(turning,)}

    moving = [message.transforms for _, message in recorded(bag, "/tf")]
    assert 8 * 25 * 0.8 < len(moving) <= 8 * 25
    stamps = [t[0].header.stamp.sec * 10**9 + t[0].header.stamp.nanosec for t in moving]
    assert set(np.diff(stamps)) == {40_000_000}
    frames = {((a.header.frame_id, a.child_frame_id), (b.header.frame_id, b.child_frame_id))
              for a, b in moving}  # fmt: skip
    assert frames == {(("map", "odom"), ("odom", "base_link"))}

    odometry = {
        m.header.stamp.sec * 10**9 + m.header.stamp.nanosec: m for _, m in recorded(bag, "/odom")
    }
    before = None
    for stamp_ns, (to_odom, to_base) in zip(stamps, moving, strict=True):
        there, turned = placed(to_odom.transform)
        here, attitude = placed(to_base.transform)
        odom = odometry[stamp_ns]
        assert odom.header.frame_id == "map" and odom.child_frame_id == "base_link"
        at, q = odom.pose.pose.position, odom.pose.pose.orientation
        np.testing.assert_allclose(there + turned.apply(here), [at.x, at.y, at.z], atol=1e-9)
        wanted = Rotation.from_quat([q.x, q.y, q.z, q.w])
        assert (wanted.inv() * turned * attitude).magnitude() < 1e-9
        speed = np.linalg.norm([odom.twist.twist.linear.x, odom.twist.twist.linear.y,
                                odom.twist.twist.linear.z])  # fmt: skip
        if before is not None:
            assert np.linalg.norm(here - before) < (speed + 0.5) * 0.04, "no jumps in odom"
        before = here
    # What is for tools is no surprise to the reader of flights.
    assert read_bag(bag).foreign == []
