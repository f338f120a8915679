# SPDX-License-Identifier: Apache-2.0
"""The adapters against the definitions: classes made of heli_interfaces/action/*.action.

Their slots are exactly the fields, and a field takes what its type takes, so a misspelt or unknown
field fails as it would where the types are built. ROS's own parser reads the definitions.
"""

import subprocess
import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from rosidl_adapter.action import convert_action_to_idl
from rosidl_adapter.parser import parse_action_file, parse_message_file
from rosidl_parser.definition import Action, IdlLocator
from rosidl_parser.parser import parse_idl_file

from heli_actions.goals import (
    NOT_KNOWN,
    Code,
    GoalFeedback,
    GoalRequest,
    GoalStatus,
    Kind,
)
from heli_actions.interfaces import NOT_BUILT, Interfaces, interface_types
from heli_core.rotations import quat_from_euler
from heli_core.ticks import NS_PER_S
from heli_core.trajectory import Trajectory
from heli_msgs_bridge.command_messages import encode_reference
from heli_msgs_bridge.layouts import MessageError
from heli_msgs_bridge.status import AircraftStatus, encode_status

PACKAGE = Path(__file__).resolve().parents[2] / "heli_interfaces"
NAMES = [kind.capitalize() for kind in Kind]
STATUS = parse_message_file(PACKAGE.name, str(PACKAGE / "msg" / "Status.msg"))
PLAIN = {"bool": bool, "string": str, "float64": float, "uint8": int}


def definition(name):
    return parse_action_file(PACKAGE.name, str(PACKAGE / "action" / f"{name}.action"))


def class_of(message):
    """A class with the fields of a parsed message."""
    kinds = {}
    for field in message.fields:
        name = field.type.type
        package = field.type.pkg_name
        kinds[field.name] = (
            getattr(import_module(f"{package}.msg"), name) if package else PLAIN[name]
        )

    def start(self):
        for name, kind in kinds.items():
            object.__setattr__(self, name, kind())

    def put(self, name, value):
        assert type(value) is kinds[name], (name, value)
        object.__setattr__(self, name, value)

    body = {"__slots__": tuple(kinds), "__init__": start, "__setattr__": put}
    return type(message.msg_name, (), body)


@pytest.fixture(scope="module")
def types():
    messages = {}
    for kind in Kind:
        parsed = definition(kind.capitalize())
        messages[kind] = SimpleNamespace(
            Goal=class_of(parsed.goal),
            Result=class_of(parsed.result),
            Feedback=class_of(parsed.feedback),
        )
    return messages


@pytest.fixture
def adapters(types):
    return Interfaces(types)


def test_a_status_fills_its_message():
    status = AircraftStatus(
        3 * NS_PER_S + 5, "hover", True, True, False, "LAND", (2.0, 1.0, 0.5), "lands"
    )
    message = encode_status(class_of(STATUS)(), status)
    stamp = message.header.stamp
    assert (message.header.frame_id, stamp.sec, stamp.nanosec) == ("map", 3, 5)
    assert (message.mode, message.failsafe, message.message) == ("hover", "LAND", "lands")
    assert (message.ready, message.armed, message.landed) == (True, True, False)
    assert message.home_known and (message.home.x, message.home.y, message.home.z) == (2, 1, 0.5)
    assert not encode_status(class_of(STATUS)(), AircraftStatus()).home_known


def test_the_package_names_its_definitions():
    assert [path.name for path in (PACKAGE / "msg").iterdir()] == ["Status.msg"]
    there = {path.stem for path in (PACKAGE / "action").iterdir()}
    assert there == set(NAMES)
    built = (PACKAGE / "CMakeLists.txt").read_text()
    manifest = (PACKAGE / "package.xml").read_text()
    for name in NAMES:
        assert f'"action/{name}.action"' in built
    assert '"msg/Status.msg"' in built
    parts = [
        part
        for action in map(definition, NAMES)
        for part in (action.goal, action.result, action.feedback)
    ]
    used = {
        field.type.pkg_name
        for part in (*parts, STATUS)
        for field in part.fields
        if field.type.pkg_name
    }
    for package in used:
        assert f"find_package({package} REQUIRED)" in built
        assert f"<depend>{package}</depend>" in manifest
    (needed,) = [line for line in built.splitlines() if "DEPENDENCIES" in line]
    assert set(needed.split()[1:]) == used


@pytest.mark.parametrize("name", NAMES)
def test_the_generators_first_steps_take_it(name, tmp_path):
    """From .action to .idl, and .idl read again: what goes before any code is made."""
    made = convert_action_to_idl(PACKAGE, PACKAGE.name, Path(f"action/{name}.action"), tmp_path)
    parsed = parse_idl_file(IdlLocator(tmp_path, Path(made).relative_to(tmp_path)))
    (action,) = parsed.content.get_elements_of_type(Action)
    assert action.namespaced_type.name == name
    members = {member.name for member in action.feedback.structure.members}
    assert members == {field.name for field in definition(name).feedback.fields}


@pytest.mark.parametrize("name", NAMES)
def test_the_codes_are_the_constants(name):
    constants = {c.name: c.value for c in definition(name).result.constants}
    assert constants == {code.name: int(code) for code in Code}


@pytest.mark.parametrize("name", NAMES)
def test_every_field_is_explained_with_its_unit(name):
    lines = (PACKAGE / "action" / f"{name}.action").read_text().splitlines()
    for before, line in zip(["", *lines], lines, strict=False):
        if line and not line.startswith(("#", "---")):
            assert before.startswith("# "), line
        if line.startswith("float64"):
            unit = line.rsplit("_", 1)[1]
            assert f", {unit}" in before, line


@pytest.mark.parametrize("kind", Kind)
def test_feedback_fills_every_field(adapters, kind):
    q = quat_from_euler(0.0, 0.0, 0.0)
    feedback = GoalFeedback(3 * NS_PER_S + 5, "hover", np.array([1.0, 2.0, -3.0]), q, 4.5, 6.5)
    message = adapters.feedback(kind, feedback)
    assert message.mode == "hover"
    stamp, pose = message.pose.header.stamp, message.pose.pose
    assert (message.pose.header.frame_id, stamp.sec, stamp.nanosec) == ("map", 3, 5)
    assert (pose.position.x, pose.position.y, pose.position.z) == (2.0, 1.0, 3.0)
    # The nose to the north: +y.
    np.testing.assert_allclose([pose.orientation.z, pose.orientation.w], [0.5**0.5] * 2)
    left = {name: getattr(message, name) for name in message.__slots__ if "left" in name}
    assert set(left.values()) == ({4.5} if kind == Kind.LAND else {4.5, 6.5})


@pytest.mark.parametrize("kind", Kind)
def test_feedback_is_read_as_it_was_written(adapters, kind):
    q = quat_from_euler(0.0, 0.0, 0.5)
    given = GoalFeedback(3 * NS_PER_S + 5, "hover", np.array([1.0, 2.0, -3.0]), q, 4.5, 6.5)
    read = adapters.read_feedback(kind, adapters.feedback(kind, given))
    assert (read.stamp_ns, read.mode, read.left_m) == (given.stamp_ns, "hover", 4.5)
    assert read.left_s == (NOT_KNOWN if kind == Kind.LAND else 6.5)
    np.testing.assert_allclose(read.pos_ned_m, given.pos_ned_m)
    np.testing.assert_allclose(np.abs(read.quat @ q), 1.0)


@pytest.mark.parametrize("kind", Kind)
def test_result(adapters, kind):
    message = adapters.result(kind, GoalStatus.SUCCEEDED, Code.DONE, "there", "")
    assert (message.success, message.code, message.message) == (True, 0, "there")
    message = adapters.result(kind, GoalStatus.ABORTED, Code.REFUSED, "no", "FENCE")
    assert (message.success, message.code) == (False, 2)
    assert adapters.read_result(kind, message) == (Code.REFUSED, "no", "FENCE")


def pose_to(east, north, up, frame="map"):
    pose = PoseStamped()
    pose.header.frame_id = frame
    pose.pose.position.x, pose.pose.position.y, pose.pose.position.z = east, north, up
    pose.pose.orientation.w = 1.0
    return pose


def test_a_goto_is_a_pose_stamped_now(adapters, types):
    goal = types[Kind.GOTO].Goal()
    goal.pose = pose_to(8.0, 6.0, 10.0)
    order = adapters.order(Kind.GOTO, goal, 7 * NS_PER_S + 9)
    np.testing.assert_allclose(order.end_ned_m, [6.0, 8.0, -10.0])
    assert order.message is goal.pose
    assert (goal.pose.header.stamp.sec, goal.pose.header.stamp.nanosec) == (7, 9)
    # A stamp of the client's own stays.
    adapters.order(Kind.GOTO, goal, 60 * NS_PER_S)
    assert goal.pose.header.stamp.sec == 7


def test_a_trajectory_ends_where_its_last_point_is(adapters, types):
    times = np.array([0, 4]) * NS_PER_S
    points = np.zeros((2, 7))
    points[:, 2], points[1, 0] = -10.0, 8.0
    goal = types[Kind.FOLLOW].Goal()
    goal.trajectory = encode_reference(Trajectory(0, times, points))
    order = adapters.order(Kind.FOLLOW, goal, 7 * NS_PER_S)
    assert order.message.header.stamp.sec == 7
    np.testing.assert_allclose(order.end_ned_m, [8.0, 0.0, -10.0])
    goal.trajectory.header.frame_id = "base_link"
    with pytest.raises(MessageError, match="follow: frame 'base_link'; allowed: 'map'"):
        adapters.order(Kind.FOLLOW, goal, 7 * NS_PER_S)


@pytest.mark.parametrize(
    ("pose", "reason"),
    [
        (pose_to(np.nan, 0.0, 10.0), "finite"),
        (pose_to(1.0, 0.0, 10.0, "odom"), "frame 'odom'; allowed: 'map'"),
    ],
)
def test_what_is_no_goal_is_told_and_sent_nowhere(adapters, types, pose, reason):
    goal = types[Kind.GOTO].Goal()
    goal.pose = pose
    with pytest.raises(MessageError, match=reason):
        adapters.order(Kind.GOTO, goal, NS_PER_S)


def test_a_landing_is_empty_and_a_takeoff_may_be(adapters, types):
    assert not types[Kind.LAND].Goal().__slots__
    for kind in (Kind.TAKEOFF, Kind.LAND):
        order = adapters.order(kind, types[kind].Goal(), NS_PER_S)
        assert (order.kind, order.end_ned_m, order.message) == (kind, None, None)
    goal = types[Kind.TAKEOFF].Goal()
    goal.height_m = 6.5
    assert adapters.order(Kind.TAKEOFF, goal, NS_PER_S).message == 6.5


def test_goals_are_read_as_they_were_written(adapters):
    trajectory = encode_reference(Trajectory(NS_PER_S, np.array([0, 4]), np.zeros((2, 7))))
    for kind, message in (
        (Kind.TAKEOFF, 6.5), (Kind.GOTO, pose_to(8.0, 6.0, 10.0)), (Kind.FOLLOW, trajectory),
        (Kind.LAND, None),
    ):  # fmt: skip
        goal = adapters.goal(GoalRequest(kind, message=message))
        assert adapters.order(kind, goal, NS_PER_S).message == message


def test_a_misspelt_field_would_fail(types):
    message = types[Kind.GOTO].Feedback()
    with pytest.raises(KeyError):
        message.distance_m = 1.0
    with pytest.raises(AssertionError):
        message.distance_left_m = 1


def test_the_real_types_are_looked_up_by_name(monkeypatch, types):
    module = ModuleType("heli_interfaces.action")
    vars(module).update({kind.capitalize(): types[kind] for kind in Kind})
    monkeypatch.setitem(sys.modules, "heli_interfaces", ModuleType("heli_interfaces"))
    monkeypatch.setitem(sys.modules, "heli_interfaces.action", module)
    assert interface_types() == types
    del module.Land
    with pytest.raises(LookupError, match="heli_interfaces is not built"):
        interface_types()


def test_without_the_types_the_node_says_what_to_do():
    # Where they are built, they are hidden.
    code = "import sys; sys.modules['heli_interfaces'] = None; import heli_actions.node as n; "
    command = [sys.executable, "-c", f"{code}sys.exit(n.main([]))"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"actions: {NOT_BUILT}\n"
