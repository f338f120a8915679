# SPDX-License-Identifier: Apache-2.0
"""Every message that cannot be used is refused by topic, cause and what is wrong in it."""

import math
import random

import numpy as np
import pytest
from builtin_interfaces.msg import Duration, Time
from geometry_msgs.msg import Transform, Twist
from hypothesis import given
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import JointState, NavSatFix
from trajectory_msgs.msg import MultiDOFJointTrajectory, MultiDOFJointTrajectoryPoint

from heli_core.trajectory import Trajectory
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import stamp_of
from heli_msgs_bridge.command_messages import decode_reference, encode_reference
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.layouts import CHANNELS, CutOffError, FrameError, MessageCause, MessageError
from heli_msgs_bridge.message_size import MOST_BYTES, too_long
from heli_msgs_bridge.messages import Decoder, Encoder

ORIGIN = datum(28.17, 112.93, 50.0)
STAMP_NS = 3_000_000_005
STREAMS = tuple(CHANNELS)
JOINTS = [t for t in STREAMS if topics.BY_NAME[t].type == "sensor_msgs/msg/JointState"]
ATTITUDES = (topics.ODOM, topics.TRUTH_ODOM, topics.ATTITUDE_SETPOINT)


def place(topic):
    return ORIGIN if topic == topics.GPS_FIX else None


def good_row(topic):
    """A row that is accepted: zeros, level where there is an attitude."""
    row = np.zeros(CHANNELS[topic].size)
    if topic in (topics.ODOM, topics.TRUTH_ODOM):
        row[6] = 1.0
    return row


def good_message(topic):
    raw = Encoder(topic, (), place(topic)).encode(good_row(topic), STAMP_NS)
    kind = topics.message_class(topics.BY_NAME[topic].type)
    return deserialize_message(raw, kind)


def refused(topic, raw, cause, value=None, kind=MessageError):
    """With topic, cause and value, in one line; the decoder goes on with the next."""
    decoder = Decoder(topic, place(topic))
    if not isinstance(raw, bytes):
        raw = serialize_message(raw)
    with pytest.raises(kind) as caught:
        decoder.decode(raw)
    error, sentence = caught.value, str(caught.value)
    assert (error.topic, error.cause, error.value) == (topic, cause, value)
    assert sentence.startswith(f"{topic}: ") and "\n" not in sentence
    if kind is not CutOffError:
        assert decoder.stamp_ns == STAMP_NS
    again = Encoder(topic, (), place(topic)).encode(good_row(topic), STAMP_NS + 1)
    assert decoder.decode(again).tolist() == pytest.approx(good_row(topic).tolist(), abs=1e-6)
    assert decoder.stamp_ns == STAMP_NS + 1


@pytest.mark.parametrize("topic", STREAMS)
@pytest.mark.parametrize("size", [0, 3, 11])
def test_cut_off_before_the_end_of_the_stamp(topic, size):
    raw = serialize_message(good_message(topic))[:size]
    refused(topic, raw, MessageCause.CUT_OFF, size, CutOffError)


@pytest.mark.parametrize("topic", STREAMS)
@pytest.mark.parametrize("lost", [1, 9, 20])
def test_cut_off_behind_the_stamp(topic, lost):
    raw = Encoder(topic, (), place(topic)).encode(good_row(topic), STAMP_NS)
    refused(topic, raw[:-lost], MessageCause.UNREADABLE)


@pytest.mark.parametrize("topic", STREAMS)
@pytest.mark.parametrize("frame", ["map_ned", "base_link_frd"])
def test_a_frame_that_says_ned_or_frd(topic, frame):
    message = good_message(topic)
    message.header.frame_id = frame
    refused(topic, message, MessageCause.FRAME, frame, FrameError)


def test_a_child_frame_that_says_frd():
    message = good_message(topics.ODOM)
    message.child_frame_id = "base_link_frd"
    refused(topics.ODOM, message, MessageCause.FRAME, "base_link_frd", FrameError)


@pytest.mark.parametrize("topic", STREAMS)
@pytest.mark.parametrize("namespace", ["", "/heli2"])
def test_a_node_takes_the_frames_of_its_own_aircraft_alone(topic, namespace):
    """Another aircraft's, another sensor's, none: refused by name, and the next one is taken."""
    raw = Encoder(topic, (), place(topic), namespace).encode(good_row(topic), STAMP_NS)
    decoder = Decoder(topic, place(topic), namespace=namespace)
    allowed = decoder.decode(raw).copy()
    kind = topics.message_class(topics.BY_NAME[topic].type)
    frame = deserialize_message(raw, kind).header.frame_id
    for other in ("heli3/imu_link", "camera", "", "\x1b[2J" + "x" * 10_000):
        message = deserialize_message(raw, kind)
        message.header.frame_id = other
        with pytest.raises(FrameError) as caught:
            decoder.decode(serialize_message(message))
        assert (caught.value.value, caught.value.allowed) == (other, f"'{frame}'")
        assert len(str(caught.value)) < 150 and str(caught.value).isprintable()
        assert decoder.decode(raw).tolist() == allowed.tolist()


def test_a_node_takes_the_child_frame_of_its_own_aircraft_alone():
    message = good_message(topics.ODOM)
    message.child_frame_id = "heli2/base_link"
    with pytest.raises(FrameError) as caught:
        Decoder(topics.ODOM, namespace="/").decode(serialize_message(message))
    error = caught.value
    assert (error.topic, error.value, error.allowed) == (
        topics.ODOM,
        "heli2/base_link",
        "'base_link'",
    )


@pytest.mark.parametrize("topic", JOINTS)
def test_so_many_joints_are_not_looked_through(topic):
    message = good_message(topic)
    message.name, message.position = ["x"] * 1000, [0.0] * 1000
    refused(topic, message, MessageCause.TOO_LONG, 1000)


@pytest.mark.parametrize("topic", JOINTS)
def test_a_long_message_is_not_even_deserialised(topic):
    """It would take 20 ms to make objects of a hundred thousand names."""
    message = good_message(topic)
    message.name, message.position = ["x"] * 100_000, [0.0] * 100_000
    raw, asked = serialize_message(message), []
    decoder = Decoder(topic, deserialize=asked.append)
    with pytest.raises(MessageError) as caught:
        decoder.decode(raw)
    assert (caught.value.cause, caught.value.value) == (MessageCause.TOO_LONG, len(raw))
    assert str(caught.value) == too_long(topic, len(raw), MOST_BYTES)
    assert not asked and decoder.stamp_ns == stamp_of(raw)


@pytest.mark.parametrize(
    ("names", "sentence"),
    [
        (["heli2/base_link"], "for 'heli2/base_link'; allowed: 'base_link', or no name"),
        (["a", "b"], "for 'a', 'b'; allowed: 'base_link', or no name"),
    ],
)
def test_a_way_for_another_aircraft_is_refused(names, sentence):
    message = reference(point(0))
    message.joint_names = names
    decode_reference(message)
    with pytest.raises(MessageError) as caught:
        decode_reference(message, "/")
    assert (caught.value.cause, caught.value.value) == (MessageCause.AIRCRAFT, names)
    assert str(caught.value) == f"reference: {sentence}"


def test_a_way_in_another_frame_is_refused():
    message = reference(point(0), frame="odom")
    with pytest.raises(FrameError) as caught:
        decode_reference(message, "/")
    error = caught.value
    assert (error.topic, error.value, error.allowed) == (topics.REFERENCE, "odom", "'map'")


@pytest.mark.parametrize("topic", STREAMS)
@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("usual", [True, False])
def test_a_value_that_is_not_finite(topic, bad, usual):
    """Every number that the row holds, one at a time, whichever way the message is read."""
    raw = Encoder(topic, (), place(topic)).encode(good_row(topic), STAMP_NS)
    layout = CHANNELS[topic].layout()
    kind = topics.message_class(topics.BY_NAME[topic].type)
    used = {topics.IMU: range(13, 16), topics.GPS_VELOCITY: range(3), topics.BARO: [0]}
    used |= {topics.MAG: range(3), topics.GPS_FIX: range(3), topics.IMU2: used[topics.IMU]}
    for number in used.get(topic, range(layout.block_size)):
        at = layout.block_at + 8 * number
        changed = raw[:at] + np.float64(bad).tobytes() + raw[at + 8 :]
        message = deserialize_message(changed, kind)
        if not usual:
            message.header.frame_id = "elsewhere"
        refused(topic, changed if usual else message, MessageCause.NOT_FINITE)


@pytest.mark.parametrize("topic", ATTITUDES)
@pytest.mark.parametrize("scale", [0.0, 0.99, 1.01, 1e200])
def test_a_quaternion_that_is_not_of_unit_length(topic, scale):
    message = good_message(topic)
    at = message.quaternion if topic == topics.ATTITUDE_SETPOINT else message.pose.pose.orientation
    at.x, at.y, at.z, at.w = 0.6 * scale, 0.0, 0.8 * scale, 0.0
    refused(topic, message, MessageCause.QUATERNION)


@pytest.mark.parametrize("value", [1.0000001, -1.0000001, 1e300])
@pytest.mark.parametrize("topic", [topics.ACTUATORS, topics.COLLECTIVE])
def test_a_command_beyond_its_stops(topic, value):
    for number in range(CHANNELS[topic].size):
        message = good_message(topic)
        message.position[number] = value
        refused(topic, message, MessageCause.OUT_OF_RANGE)


@pytest.mark.parametrize("topic", [topics.ACTUATORS, topics.COLLECTIVE])
@given(data=st.data())
def test_a_command_up_to_its_stops_is_taken(topic, data):
    row = np.array(
        data.draw(
            st.lists(
                st.one_of(st.sampled_from([-1.0, 1.0]), st.floats(-1.0, 1.0)),
                min_size=CHANNELS[topic].size, max_size=CHANNELS[topic].size,
            )
        )
    )  # fmt: skip
    assert Decoder(topic).decode(Encoder(topic).encode(row, 0)).tolist() == row.tolist()


@pytest.mark.parametrize(("latitude", "longitude"), [(90.1, 0.0), (-91, 0), (0, 180.1), (0, -181)])
def test_a_place_that_is_not_on_the_earth(latitude, longitude):
    message = good_message(topics.GPS_FIX)
    message.latitude, message.longitude = float(latitude), float(longitude)
    refused(topics.GPS_FIX, message, MessageCause.OUT_OF_RANGE)


@pytest.mark.parametrize("topic", STREAMS)
def test_a_row_that_is_too_short_is_not_sent(topic):
    """The compiled conversion would read behind its end."""
    encoder = Encoder(topic, (), place(topic))
    with pytest.raises(ValueError, match=f"{topic}: {len(good_row(topic)) - 1} numbers, expected"):
        encoder.encode(good_row(topic)[:-1], STAMP_NS)


@pytest.mark.parametrize("usual", [True, False])
@pytest.mark.parametrize("status", [-1, -2, -128])
def test_a_receiver_without_a_fix(status, usual):
    """sensor_msgs/NavSatStatus: a fix is valid when status >= STATUS_FIX; unknown is -2."""
    message = good_message(topics.GPS_FIX)
    message.status.status = status
    message.header.frame_id = "gps_link" if usual else "antenna"
    refused(topics.GPS_FIX, message, MessageCause.NO_FIX)


@pytest.mark.parametrize("status", [0, 1, 2])
def test_every_kind_of_fix_is_taken(status, fast_decoder):
    message = good_message(topics.GPS_FIX)
    message.status.status = status
    fast_decoder(topics.GPS_FIX, ORIGIN).decode(serialize_message(message))


@pytest.mark.parametrize("topic", JOINTS)
def test_a_joint_that_is_missing(topic):
    names = list(good_message(topic).name)
    for gone in names:
        message = good_message(topic)
        message.name = [name if name != gone else "rudder" for name in names]
        refused(topic, message, MessageCause.MISSING_JOINT, gone)
    nothing = JointState(header=good_message(topic).header)
    refused(topic, nothing, MessageCause.MISSING_JOINT, names[0])


@pytest.mark.parametrize("topic", JOINTS)
@pytest.mark.parametrize("change", [-1, 1])
def test_more_names_than_positions_or_fewer(topic, change):
    message = good_message(topic)
    count = len(message.name)
    field = "velocity" if topic == topics.ROTOR_SPEED else "position"
    setattr(message, field, [0.0] * (count + change))
    refused(topic, message, MessageCause.LENGTH, (count, count + change))


@pytest.mark.parametrize("topic", STREAMS)
def test_arbitrary_damage_is_read_or_refused_and_nothing_else(topic, search):
    """Bytes changed and cut anywhere: an array or a MessageError, and then the next message."""
    decoder = Decoder(topic, place(topic))
    whole = Encoder(topic, (), place(topic)).encode(good_row(topic), STAMP_NS)

    @search
    @given(seed=st.integers(0, 2**32), cut=st.booleans())
    def survives(seed, cut):
        numbers = random.Random(seed)
        raw = bytearray(whole)
        for _ in range(numbers.randint(1, 6)):
            raw[numbers.randrange(len(raw))] = numbers.choice([0, 1, 127, 128, 255])
        end = numbers.randint(0, len(raw)) if cut else len(raw)
        try:
            assert decoder.decode(bytes(raw[:end])).shape == (CHANNELS[topic].size,)
        except MessageError as error:
            assert str(error).startswith(f"{topic}: ")
        np.testing.assert_allclose(decoder.decode(whole), good_row(topic), atol=1e-6)

    survives()


def test_what_needs_a_place_says_so():
    for kind in (Encoder, Decoder):
        with pytest.raises(ValueError, match="gps/fix: needs a datum"):
            kind(topics.GPS_FIX)


def test_fix_that_was_never_set_is_none():
    """The message as a driver creates it: its status is `unknown`."""
    fresh = NavSatFix()
    fresh.header.stamp = Time(sec=3, nanosec=5)
    refused(topics.GPS_FIX, fresh, MessageCause.NO_FIX)


# --- the reference, a message object -----------------------------------------------------------

COORDINATE = st.floats(-1e4, 1e4)
HEADING = st.floats(-3.14, 3.14)


@given(
    start_ns=st.integers(0, 2**31 * 10**9 - 1),
    gaps_ns=st.lists(st.integers(1, 10**11), min_size=1, max_size=5),
    data=st.data(),
)
def test_a_reference_comes_back(start_ns, gaps_ns, data):
    """Positions, velocities bit for bit (only axes change); heading to rounding."""
    rows = [[data.draw(COORDINATE) for _ in range(6)] + [data.draw(HEADING)] for _ in gaps_ns]
    sent = Trajectory(start_ns, np.cumsum(gaps_ns), np.array(rows))
    raw = serialize_message(encode_reference(sent))
    got = decode_reference(deserialize_message(raw, MultiDOFJointTrajectory))
    assert got.start_ns == start_ns and got.times_ns.tolist() == np.cumsum(gaps_ns).tolist()
    assert got.points[:, :6].tobytes() == sent.points[:, :6].tobytes()
    assert got.points[:, 6] == pytest.approx(sent.points[:, 6], abs=1e-14)


def point(time_s, **changes):
    pose = Transform()
    pose.rotation.w = 1.0
    row = MultiDOFJointTrajectoryPoint(
        time_from_start=Duration(sec=time_s), transforms=[pose], velocities=[Twist()]
    )
    for name, value in changes.items():
        setattr(row, name, value)
    return row


def reference(*points, frame="map"):
    message = MultiDOFJointTrajectory(points=list(points))
    message.header.frame_id = frame
    return message


def poses(**values):
    pose = Transform()
    pose.rotation.w = 1.0
    for name, value in values.items():
        part, _, axis = name.partition("_")
        setattr(getattr(pose, part), axis, value)
    return [pose]


def fast(value):
    twist = Twist()
    twist.linear.y = value
    return [twist]


REFERENCES = {
    "frame": (
        reference(point(0), frame="map_ned"),
        MessageCause.FRAME,
        "map_ned",
        "frame 'map_ned' says NED",
    ),
    "empty": (reference(), MessageCause.NO_POINTS, None, "holds no points"),
    "same time": (
        reference(point(1), point(1)),
        MessageCause.TRAJECTORY,
        None,
        "time of point 1 does not increase",
    ),
    "back in time": (
        reference(point(2), point(1)),
        MessageCause.TRAJECTORY,
        None,
        "time of point 1 does not increase",
    ),
    "no pose": (
        reference(point(0, transforms=[])),
        MessageCause.LENGTH,
        (0, 0, 1),
        "point 0 has 0 transforms and 1 velocities",
    ),
    "two poses": (
        reference(point(0), point(1, transforms=poses() * 2)),
        MessageCause.LENGTH,
        (1, 2, 1),
        "point 1 has 2 transforms and 1 velocities",
    ),
    "two velocities": (
        reference(point(0, velocities=[Twist(), Twist()])),
        MessageCause.LENGTH,
        (0, 1, 2),
        "point 0 has 1 transforms and 2 velocities",
    ),
    "quaternion": (
        reference(point(0, transforms=poses(rotation_w=0.9))),
        MessageCause.QUATERNION,
        0,
        "point 0: not a unit quaternion",
    ),
    "nan quaternion": (
        reference(point(0, transforms=poses(rotation_x=math.nan))),
        MessageCause.QUATERNION,
        0,
        "point 0: not a unit quaternion",
    ),
    "position": (
        reference(point(0), point(1, transforms=poses(translation_z=math.inf))),
        MessageCause.NOT_FINITE,
        None,
        "point 1 is not finite",
    ),
    "velocity": (
        reference(point(0, velocities=fast(math.nan))),
        MessageCause.NOT_FINITE,
        None,
        "point 0 is not finite",
    ),
}


@pytest.mark.parametrize(
    ("message", "cause", "value", "words"), REFERENCES.values(), ids=REFERENCES
)
def test_a_reference_that_cannot_be_followed(message, cause, value, words):
    with pytest.raises(MessageError) as caught:
        decode_reference(message)
    error = caught.value
    assert (error.topic, error.cause, error.value) == (topics.REFERENCE, cause, value)
    assert str(error).startswith("reference: ") and words in str(error)


# --- the wording -------------------------------------------------------------------------------


def with_joints(count, positions):
    message = good_message(topics.COLLECTIVE)
    message.name, message.position = ["x"] * count, [0.0] * positions
    return message


def with_frame(frame):
    message = good_message(topics.IMU)
    message.header.frame_id = frame
    return message


SENTENCES = [
    (topics.IMU, bytes(11), "imu/data_raw: a message of 11 bytes is cut off"),
    (topics.IMU, with_frame("x_ned"), "imu/data_raw: frame 'x_ned' says NED or FRD; "
     "expected ENU and FLU (REP-103)"),
    (topics.IMU, with_frame("x"), "imu/data_raw: frame 'x'; allowed: 'imu_link'"),
    (topics.COLLECTIVE, with_joints(1000, 1000),
     "collective: names 1000 joints; allowed: at most 64"),
    (topics.COLLECTIVE, with_joints(2, 1), "collective: 2 names but 1 positions"),
    (topics.COLLECTIVE, with_joints(2, 2),
     "collective: no joint 'collective'; the message names x, x"),
    (topics.COLLECTIVE, with_joints(0, 0),
     "collective: no joint 'collective'; the message names none"),
]  # fmt: skip


@pytest.mark.parametrize(("topic", "message", "sentence"), SENTENCES)
def test_the_sentence_of_a_refusal(topic, message, sentence):
    raw = message if isinstance(message, bytes) else serialize_message(message)
    with pytest.raises(MessageError) as caught:
        Decoder(topic, namespace="").decode(raw)
    assert str(caught.value) == sentence


def test_a_reference_without_velocities_stands_still():
    got = decode_reference(reference(point(0, velocities=[])))
    assert got.points[0, 3:6].tolist() == [0.0, 0.0, 0.0]
