# SPDX-License-Identifier: Apache-2.0
"""The aircraft as URDF: whole, of its parameters' size, its links the frames of the messages."""

import math
from xml.etree import ElementTree as Xml

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import JointState
from std_msgs.msg import String

from heli_dynamics_sim import node as description
from heli_dynamics_sim.aircraft import HelicopterParameters
from heli_dynamics_sim.node import PlantNode, mounts, robot_description
from heli_msgs_bridge import topics
from heli_msgs_bridge import topics as frame_ids
from heli_msgs_bridge.layouts import CHANNELS

AIRCRAFT = ("helion", "logo600", "xcell60")


def urdf(name, **options):
    aircraft = HelicopterParameters.from_yaml(f"{name}.yaml")
    return aircraft, Xml.fromstring(robot_description(aircraft, name, **options))


def links(robot):
    return {link.get("name") for link in robot.findall("link")}


@pytest.mark.parametrize("name", AIRCRAFT)
def test_links_hang_together_as_a_tree_with_the_base_as_root(name):
    _, robot = urdf(name)
    assert robot.tag == "robot" and robot.get("name") == name
    children = [joint.find("child").get("link") for joint in robot.findall("joint")]
    parents = {joint.find("parent").get("link") for joint in robot.findall("joint")}
    assert len(children) == len(set(children))
    assert links(robot) - set(children) == {"base_link"} and parents <= links(robot)
    names = [joint.get("name") for joint in robot.findall("joint")]
    assert len(names) == len(set(names))
    colours = {material.get("name") for material in robot.findall("material")}
    assert {m.get("name") for m in robot.findall("link/visual/material")} == colours


@pytest.mark.parametrize("name", AIRCRAFT)
def test_mass_inertia_and_sizes_are_those_of_the_parameters(name):
    aircraft, robot = urdf(name)
    (inertial,) = robot.findall("link/inertial")
    assert float(inertial.find("mass").get("value")) == pytest.approx(aircraft.mass_kg, rel=1e-5)
    wanted = aircraft.inertia_xx_kgm2, aircraft.inertia_yy_kgm2, aircraft.inertia_zz_kgm2
    moments = [float(inertial.find("inertia").get(key)) for key in ("ixx", "iyy", "izz")]
    assert moments == pytest.approx(wanted, rel=1e-5)
    # A root with inertia is refused by KDL, so by robot_state_publisher.
    assert robot.find("link[@name='base_link']/inertial") is None
    for rotor, radius_m in (
        ("main_rotor", aircraft.main_radius_m),
        ("tail_rotor", aircraft.tail_radius_m),
    ):
        disc = robot.find(f"link[@name='{rotor}']/visual/geometry/cylinder")
        assert float(disc.get("radius")) == pytest.approx(radius_m, rel=1e-5)
    for joint in robot.findall("joint[@type='fixed']"):
        at = [float(value) for value in joint.find("origin").get("xyz").split()]
        assert at == pytest.approx(mounts(aircraft)[joint.find("child").get("link")], rel=1e-5)
    assert mounts(aircraft)["main_rotor"] == (0.0, 0.0, aircraft.hub_height_m)
    assert mounts(aircraft)["tail_rotor"][0] == -aircraft.tail_arm_m
    lowest = min(
        float(origin.get("xyz").split()[2]) for origin in robot.findall("link/visual/origin")
    )
    assert lowest == pytest.approx(-aircraft.gear_height_m, abs=0.02), "the skids"


def test_every_frame_of_a_message_is_a_link_or_of_the_world():
    assert description.BASE == frame_ids.BASE
    _, robot = urdf("helion")
    frames = {frame for channel in CHANNELS.values() for frame in channel.frames}
    assert frames - {frame_ids.MAP} <= links(robot)


@pytest.mark.parametrize("frame", [str, "heli2/{}".format])
def test_the_joint_that_turns_is_the_one_that_joint_states_and_rotor_speed_name(frame):
    """Of robot_state_publisher: who has no position for a name, or another name, turns nothing."""
    _, robot = urdf("helion", frame=frame)
    (joint,) = [j for j in robot.findall("joint") if j.get("type") != "fixed"]
    assert (joint.get("type"), joint.get("name")) == ("continuous", *topics.ROTOR_SPEED_NAMES)
    assert joint.find("parent").get("link") == frame("main_rotor")
    assert joint.find("axis").get("xyz") == "0 0 -1", "clockwise from above, z is up"


def test_joint_states_turn_with_the_rotor(bench):
    plant = bench(PlantNode)
    plant.fly()
    for tick in range(40):
        plant.send(topics.ACTUATORS, tick, np.zeros(4))
    sent = [deserialize_message(raw, JointState) for raw in plant.sent[topics.JOINT_STATES]]
    assert {tuple(m.name) for m in sent} == {topics.ROTOR_SPEED_NAMES}
    assert {(len(m.position), len(m.velocity), len(m.effort)) for m in sent} == {(1, 1, 0)}
    stamps_s = [m.header.stamp.sec + m.header.stamp.nanosec / 1e9 for m in sent]
    assert np.diff(stamps_s) == pytest.approx(0.04) and len(sent) == 11
    (measured,) = plant.sent[topics.ROTOR_SPEED][-1]
    assert sent[-1].velocity[0] == pytest.approx(measured, rel=0.02)
    turned = (sent[-1].position[0] - sent[0].position[0]) % math.tau
    mean = np.mean([m.velocity[0] for m in sent])
    assert math.remainder(turned - mean * 0.4, math.tau) == pytest.approx(0.0, abs=0.2)


def test_links_carry_the_namespace_as_the_frames_do():
    plain, owned = urdf("helion")[1], urdf("helion", frame=lambda frame: f"heli2/{frame}")[1]
    assert links(owned) == {f"heli2/{name}" for name in links(plain)}
    assert owned.find("joint/parent").get("link") == "heli2/base_link"


def test_who_comes_late_gets_it(bench):
    """Sent once, latched: RViz begins when the flight is long under way."""
    plant = bench(PlantNode, aircraft_file="xcell60.yaml")
    plant.fly()
    raw = plant.sent[topics.ROBOT_DESCRIPTION]
    assert len(raw) == 1
    heard, context = [], plant.node.context
    listener = rclpy.create_node("late", context=context)
    listener.create_subscription(
        String, "/robot_description", heard.append, topics.qos(topics.ROBOT_DESCRIPTION)
    )
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(listener)
    for _ in range(60):
        if heard:
            break
        executor.spin_once(timeout_sec=0.5)
    executor.shutdown()
    listener.destroy_node()
    assert heard == [deserialize_message(raw[0], String)]
    assert 'name="xcell60"' in heard[0].data
