# SPDX-License-Identifier: Apache-2.0
"""Every topic's bytes equal those that rclpy's `serialize_message` makes of the same message.

The message objects are built here, field by field, from the definitions of the messages and of the
frames; the codec is not asked. Values are whatever 64 bits can hold.
"""

import contextlib
import functools
import math
import struct
import time

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import (
    Quaternion,
    QuaternionStamped,
    TwistWithCovarianceStamped,
    Vector3,
    Vector3Stamped,
)
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from nav_msgs.msg import Odometry
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message, serialize_message
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import FluidPressure, Imu, JointState, MagneticField, NavSatFix
from std_msgs.msg import Header

from heli_core import sensors
from heli_msgs_bridge import topics
from heli_msgs_bridge.cdr import FixedMessage, Layout, stamp_of
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.layouts import CHANNELS, EXACT_VARIANCE
from heli_msgs_bridge.messages import (
    ClockEncoder,
    CutOffError,
    Decoder,
    Encoder,
    StampDecoder,
    encode_header,
    rclpy_deserializer,
)

ORIGIN = datum(28.17, 112.93, 50.0)
EXTREMES = [
    0.0, -0.0, 1.0, -1.0, 5e-324, -2.2e-308, 1.7976931348623157e308, math.inf, -math.inf, math.nan
]  # fmt: skip
FINITE = st.one_of(
    st.sampled_from([x for x in EXTREMES if math.isfinite(x)]),
    st.floats(allow_nan=False, allow_infinity=False),
)
SMALL = st.floats(-1e3, 1e3)
STAMPS = st.one_of(
    st.sampled_from([0, 1, 999_999_999, 1_000_000_000, (2**31 - 1) * 10**9 + 999_999_999]),
    st.integers(0, (2**31 - 1) * 10**9 + 999_999_999),
)


def arrays(size, values):
    return st.lists(values, min_size=size, max_size=size).map(
        lambda row: np.array(row, dtype=np.float64)
    )


@st.composite
def any_doubles(draw, size):
    """Arbitrary bits, some replaced by the extremes."""
    row = np.frombuffer(draw(st.binary(min_size=8 * size, max_size=8 * size))).copy()
    for at, value in draw(
        st.dictionaries(st.integers(0, size - 1), st.sampled_from(EXTREMES))
    ).items():
        row[at] = value
    return row


def header(stamp_ns, frame):
    sec, nanosec = divmod(stamp_ns, 10**9)
    return Header(stamp=Time(sec=sec, nanosec=nanosec), frame_id=frame)


def place(topic):
    return ORIGIN if topic == topics.GPS_FIX else None


# --- message objects out of the run of doubles, in the order of the definitions ----------------


def xyz(values):
    return Vector3(**dict(zip("xyz", values, strict=True)))


def xyzw(values):
    return Quaternion(**dict(zip("xyzw", values, strict=True)))


def odometry(frame):
    def build(b, stamp_ns):
        message = Odometry(header=header(stamp_ns, frame), child_frame_id="base_link")
        position, pose, twist = message.pose.pose.position, message.pose, message.twist
        position.x, position.y, position.z = b[0:3]
        pose.pose.orientation = xyzw(b[3:7])
        pose.covariance = b[7:43]
        twist.twist.linear, twist.twist.angular = xyz(b[43:46]), xyz(b[46:49])
        twist.covariance = b[49:85]
        return message

    return build


def imu(b, stamp_ns, frame="imu_link"):
    message = Imu(header=header(stamp_ns, frame), orientation=xyzw(b[0:4]))
    message.orientation_covariance = b[4:13]
    message.angular_velocity, message.angular_velocity_covariance = xyz(b[13:16]), b[16:25]
    message.linear_acceleration, message.linear_acceleration_covariance = xyz(b[25:28]), b[28:37]
    return message


def mag(b, stamp_ns, frame="imu_link"):
    message = MagneticField(header=header(stamp_ns, frame), magnetic_field=xyz(b[0:3]))
    message.magnetic_field_covariance = b[3:12]
    return message


def fix(b, stamp_ns):
    message = NavSatFix(header=header(stamp_ns, "gps_link"))
    message.status.status, message.status.service = 0, 1
    message.latitude, message.longitude, message.altitude = b[0:3]
    message.position_covariance, message.position_covariance_type = b[3:12], 2
    return message


def twist(b, stamp_ns, frame="map"):
    message = TwistWithCovarianceStamped(header=header(stamp_ns, frame))
    message.twist.twist.linear, message.twist.twist.angular = xyz(b[0:3]), xyz(b[3:6])
    message.twist.covariance = b[6:42]
    return message


def pressure(b, stamp_ns, frame="base_link"):
    return FluidPressure(header=header(stamp_ns, frame), fluid_pressure=b[0], variance=b[1])


def joints(*names):
    def build(b, stamp_ns):
        return JointState(header=header(stamp_ns, "base_link"), name=list(names), position=list(b))

    return build


def quaternion(b, stamp_ns):
    return QuaternionStamped(header=header(stamp_ns, "map"), quaternion=xyzw(b))


def vector(b, stamp_ns, frame="map"):
    return Vector3Stamped(header=header(stamp_ns, frame), vector=xyz(b))


ACTUATORS = ("lateral", "longitudinal", "pedal", "collective")
ROTOR = ("a_s", "b_s", "d_int")
SERVOS = tuple(f"servo_{name}" for name in ACTUATORS)
ATTITUDES = (topics.ATTITUDE_SETPOINT, topics.EXCITATION_ATTITUDE)
MESSAGES = {
    "imu/data_raw": imu,
    "imu2/data_raw": lambda b, stamp_ns: imu(b, stamp_ns, "imu2_link"),
    "imu/mag": mag,
    "gps/fix": fix,
    "gps/fix_velocity": twist,
    "baro": pressure,
    "rotor_speed": lambda b, stamp_ns: JointState(
        header=header(stamp_ns, "base_link"), name=["main_rotor"], velocity=list(b)
    ),
    "odom": odometry("map"),
    "rotor_state": joints(*ROTOR),
    "attitude_setpoint": quaternion,
    "collective": joints("collective"),
    "actuators": joints(*ACTUATORS),
    "ground_truth/odom": odometry("map"),
    "ground_truth/wind": vector,
    "ground_truth/rotor_state": joints(*ROTOR, *SERVOS),
    "excitation/actuators": joints(*ACTUATORS),
    "excitation/attitude": quaternion,
    "excitation/wind": vector,
}
# A sensor that has come to the table of sensors since.
OF_SAMPLES = {
    topics.BY_NAME[name].type: MESSAGES[name]
    for name in ("imu/mag", "baro", "gps/fix_velocity", "ground_truth/wind")
}
MESSAGES |= {
    row.topic: functools.partial(OF_SAMPLES[row.message], frame=row.frame)
    for row in sensors.SENSORS
    if row.topic not in MESSAGES
}
# One topic of each message class: the longest joint row stands for the shorter ones.
OF_EACH_LAYOUT = {
    topics.BY_NAME[name].type: name
    for name in sorted(MESSAGES, key=lambda name: CHANNELS[name].layout().block_size)
}


def by_need(search, topic):
    """All examples for one topic of each layout, a twelfth for those that only repeat it."""
    if topic in OF_EACH_LAYOUT.values():
        return search
    return settings(search, max_examples=search.max_examples // 12)


@functools.cache
def length_of(topic):
    """Bytes of a topic's message: the least of them from which rclpy still reads the same message.

    `serialize_message` returns its buffer, which for empty sequences is longer than the message;
    what is sent is not (`test_what_rclpy_sends_is_read_the_fast_way`).
    """
    message = MESSAGES[topic]([0.0] * CHANNELS[topic].layout().block_size, 0)
    raw = serialize_message(message)
    length = len(raw)
    with contextlib.suppress(Exception):
        while deserialize_message(raw[: length - 1], type(message)) == message:
            length -= 1
    return length


def bytes_of(topic, message):
    """What rclpy makes of a message."""
    return serialize_message(message)[: length_of(topic)]


def equal(topic, ours, message):
    """All bytes but those that only align; rclpy leaves in them what was in memory, we zeros."""
    theirs, padding = bytes_of(topic, message), CHANNELS[topic].layout().padding
    assert len(ours) == len(theirs)
    differing = {i for i, pair in enumerate(zip(ours, theirs, strict=True)) if pair[0] != pair[1]}
    assert differing <= set(padding)
    assert not any(ours[i] for i in padding)


@pytest.mark.parametrize("topic", MESSAGES)
def test_nobody_reads_the_padding(topic, fast_decoder):
    """Other bytes there are the same message to rclpy and to us, and no unusual one."""
    layout = CHANNELS[topic].layout()
    doubles = (
        [0.5] * layout.block_size if layout.block_size != 85 else [0.0] * 6 + [1.0] + [0.0] * 78
    )
    kind = topics.message_class(topics.BY_NAME[topic].type)
    decoder = fast_decoder(topic, place(topic))
    raw = bytes_of(topic, MESSAGES[topic](doubles, 5))
    for byte in (0x00, 0xA5, 0xFF):
        other = bytearray(raw)
        for at in layout.padding:
            other[at] = byte
        assert deserialize_message(bytes(other), kind) == MESSAGES[topic](doubles, 5)
        decoder.decode(bytes(other))


def test_every_stream_of_the_graph_is_here():
    """All that is sent as bytes; reference, pilots' and diagnostics are message objects."""
    of_pilots = {topics.GOTO, topics.COMMAND_POSE, topics.COMMAND_VELOCITY, topics.JOY}
    of_pilots |= {topics.GOTO_GPS}
    of_pilots |= {topics.COMMAND_ATTITUDE, topics.COMMAND_CLIMB, topics.GOAL}
    objects = {topics.REFERENCE, topics.DIAGNOSTICS, topics.CLOCK} | of_pilots
    objects |= {topics.AGREEMENT, topics.NO_ESTIMATE}
    assert set(MESSAGES) == set(CHANNELS) == set(topics.BY_NAME) - objects
    for name, build in MESSAGES.items():
        size = CHANNELS[name].layout().block_size
        kind = topics.message_class(topics.BY_NAME[name].type)
        assert isinstance(build([0.0] * size, 0), kind)


@pytest.mark.parametrize("topic", MESSAGES)
def test_any_doubles_at_any_time_are_the_bytes_of_rclpy(topic, search):
    """The layout itself, below all conversions: header, texts, padding, doubles, tail."""
    size = CHANNELS[topic].layout().block_size

    @by_need(search, topic)
    @given(block=any_doubles(size), stamp_ns=STAMPS)
    def same(block, stamp_ns):
        fixed = FixedMessage(CHANNELS[topic].layout())
        fixed.block[:] = block
        raw = fixed.encode(stamp_ns)
        equal(topic, raw, MESSAGES[topic](block.tolist(), stamp_ns))
        assert stamp_of(raw) == stamp_ns
        other = FixedMessage(CHANNELS[topic].layout())
        assert other.decode(raw) and other.stamp_ns == stamp_ns
        assert other.block.tobytes() == block.tobytes()

    same()


@given(sec=st.integers(0, 2**31 - 1), nanosec=st.integers(0, 999_999_999))
def test_clock_is_the_bytes_of_rclpy(sec, nanosec):
    clock = Clock(clock=Time(sec=sec, nanosec=nanosec))
    assert ClockEncoder().encode(sec * 10**9 + nanosec) == serialize_message(clock)


def test_a_header_is_the_bytes_of_rclpy():
    header = Header(frame_id="map")
    header.stamp.sec, header.stamp.nanosec = 12, 340_000_000
    raw = encode_header(12_340_000_000, "map")
    assert raw == serialize_message(header)
    decoder = StampDecoder(topics.NO_ESTIMATE)
    assert decoder.decode(raw).size == 0 and decoder.stamp_ns == 12_340_000_000
    with pytest.raises(CutOffError):
        decoder.decode(raw[:11])


# --- arrays of the cores (NED, FRD) as messages (ENU, FLU), and back ---------------------------


def enu(v):
    return [v[1], v[0], -v[2]]


def flu(v):
    return [v[0], -v[1], -v[2]]


def expected_odometry(frame, pos_ned, q_nb, linear_flu, rate_frd):
    R = np.array([[0, 1, 0], [1, 0, 0], [0, 0, -1]]) @ q_nb.as_matrix() @ np.diag([1, -1, -1])
    block = np.zeros(85)
    block[0:3], block[3:7] = enu(pos_ned), Rotation.from_matrix(R).as_quat()
    block[43:46], block[46:49] = linear_flu, flu(rate_frd)
    return odometry(frame)(block.tolist(), 0)


SAMPLED = {row.topic: row for row in sensors.SENSORS}


def simple_block(topic, row):
    """The doubles of a row that only swaps axes and signs; variances as Encoder gets them."""
    if topic in (topics.IMU, topics.IMU2):
        block = np.zeros(37)
        block[4] = -1.0
        block[13:16], block[25:28] = flu(row[3:6]), flu(row[0:3])
        block[[16, 20, 24]], block[[28, 32, 36]] = 0.25, 4.0
    elif topic == topics.GPS_VELOCITY:
        block = np.zeros(42)
        block[0:3], block[[6, 13, 20]], block[[27, 34, 41]] = enu(row), 0.25, 4.0
    elif topic == topics.ROTOR_SPEED:
        block = -row
    elif topic in SAMPLED:
        sensor = SAMPLED[topic]
        kind = sensor.message.rsplit("/", 1)[1]
        size, variances = {
            "MagneticField": (12, [3, 7, 11]),
            "FluidPressure": (2, [1]),
            "TwistWithCovarianceStamped": (42, [6, 13, 20]),
            "Vector3Stamped": (3, []),
        }[kind]
        block = np.zeros(size)
        block[: sensor.numbers] = {"body": flu, "ned": enu, "each": list}[sensor.axes](row)
        block[variances] = 0.25
        if kind == "TwistWithCovarianceStamped":
            block[[27, 34, 41]] = 4.0
    elif topic in (topics.TRUTH_WIND, topics.EXCITATION_WIND):
        block = np.array(enu(row))
    else:
        block = row
    return block.tolist()


SIMPLE = sorted(set(MESSAGES) - {topics.ODOM, topics.TRUTH_ODOM, topics.GPS_FIX, *ATTITUDES})
NORMALISED = (topics.ACTUATORS, topics.COLLECTIVE)


@pytest.mark.parametrize("topic", SIMPLE)
def test_a_row_is_the_message_that_its_numbers_make(topic, search, fast_decoder):
    """Bit for bit where only axes change, whatever the values; back bit for bit when finite."""
    size = CHANNELS[topic].size
    encoder = Encoder(topic, (0.25, 4.0))
    decoder = fast_decoder(topic)

    @by_need(search, topic)
    @given(row=any_doubles(size), stamp_ns=STAMPS)
    def sent(row, stamp_ns):
        message = MESSAGES[topic](simple_block(topic, row), stamp_ns)
        equal(topic, encoder.encode(row, stamp_ns), message)

    @by_need(search, topic)
    @given(row=arrays(size, st.floats(-1.0, 1.0) if topic in NORMALISED else FINITE), ns=STAMPS)
    def received(row, ns):
        message = MESSAGES[topic](simple_block(topic, row), ns)
        assert decoder.decode(bytes_of(topic, message)).tobytes() == row.tobytes()
        assert decoder.stamp_ns == ns

    sent()
    received()


QUATERNIONS = arrays(4, st.floats(-1.0, 1.0)).filter(lambda q: np.linalg.norm(q) > 0.1)


def near(message, expected):
    """Two message objects: equal texts and stamps, numbers to 1e-11 of their size."""
    kind = type(message)
    for name in kind.get_fields_and_field_types():
        a, b = getattr(message, name), getattr(expected, name)
        if hasattr(a, "get_fields_and_field_types"):
            near(a, b)
        elif isinstance(a, Quaternion | float | np.ndarray):
            assert a == pytest.approx(b, rel=1e-11, abs=1e-11), name
        else:
            assert a == b, name


def same_attitude(message, expected):
    """Quaternions of one sign."""
    if np.dot([message.x, message.y, message.z, message.w],
              [expected.x, expected.y, expected.z, expected.w]) < 0.0:  # fmt: skip
        expected.x, expected.y, expected.z, expected.w = (
            -expected.x, -expected.y, -expected.z, -expected.w
        )  # fmt: skip


def test_navigation_is_the_odometry_of_its_attitude(search, fast_decoder):
    """Position ENU, twist in FLU, covariances turned; rotations by scipy."""
    encoder, decoder = Encoder(topics.ODOM, (0.25,)), fast_decoder(topics.ODOM)

    @search
    @given(row=arrays(31, SMALL), q=QUATERNIONS, sigma=arrays(9, st.floats(0.0, 100.0)))
    def holds(row, q, sigma):
        rotation = Rotation.from_quat(q)
        row[6:10] = np.roll(rotation.as_quat(), 1)
        row[13:22], row[22:31] = 0.0, sigma
        raw = encoder.encode(row, 7)
        message = deserialize_message(raw, Odometry)
        equal(topics.ODOM, raw, message)
        linear = flu(rotation.inv().apply(row[3:6]))
        expected = expected_odometry("map", row[0:3], rotation, linear, row[10:13])
        expected.header.stamp.nanosec = 7
        turned = np.diag([1, -1, -1]) @ rotation.inv().as_matrix()
        pose, twisted = np.zeros((6, 6)), np.zeros((6, 6))
        pose[:3, :3], pose[3:, 3:] = np.diag(enu(sigma[0:3])) ** 2, np.diag(enu(sigma[6:9])) ** 2
        twisted[:3, :3] = turned @ np.diag(sigma[3:6] ** 2) @ turned.T
        twisted[3:, 3:] = np.diag([0.25] * 3)
        expected.pose.covariance, expected.twist.covariance = pose.ravel(), twisted.ravel()
        same_attitude(message.pose.pose.orientation, expected.pose.pose.orientation)
        near(message, expected)
        back = decoder.decode(raw)
        assert back[:22] == pytest.approx(row[:22], rel=1e-11, abs=1e-11)
        assert back[22:] == pytest.approx(row[22:], rel=1e-6, abs=1e-6)

    holds()


def test_truth_is_the_odometry_of_its_attitude(search):
    """Position, velocity and rates only change axes: bit for bit there and back."""
    encoder, decoder = Encoder(topics.TRUTH_ODOM), Decoder(topics.TRUTH_ODOM)

    @search
    @given(row=arrays(13, FINITE), q=QUATERNIONS)
    def holds(row, q):
        rotation = Rotation.from_quat(q)
        row[6:10] = np.roll(rotation.as_quat(), 1)
        raw = encoder.encode(row, 0)
        message = deserialize_message(raw, Odometry)
        equal(topics.TRUTH_ODOM, raw, message)
        expected = expected_odometry("map", row[0:3], rotation, flu(row[3:6]), row[10:13])
        exact = (np.eye(6) * EXACT_VARIANCE).ravel()
        expected.pose.covariance = expected.twist.covariance = exact
        same_attitude(message.pose.pose.orientation, expected.pose.pose.orientation)
        near(message, expected)
        back = decoder.decode(raw)
        exact = [*range(0, 6), *range(10, 13)]
        assert back[exact].tobytes() == row[exact].tobytes()
        assert back[6:10] == pytest.approx(row[6:10], abs=1e-15 * 4)

    holds()


@pytest.mark.parametrize("topic", ATTITUDES)
def test_attitude_is_the_quaternion_of_its_angles(search, topic):
    encoder, decoder = Encoder(topic), Decoder(topic)
    angle = st.floats(-3.14, 3.14)

    @search
    @given(phi=angle, theta=st.floats(-1.5, 1.5), psi=angle, stamp_ns=STAMPS)
    def holds(phi, theta, psi, stamp_ns):
        raw = encoder.encode(np.array([phi, theta, psi]), stamp_ns)
        message = deserialize_message(raw, QuaternionStamped)
        equal(topic, raw, message)
        rotation = Rotation.from_euler("ZYX", [psi, theta, phi])
        expected = expected_odometry("map", np.zeros(3), rotation, np.zeros(3), np.zeros(3))
        wanted = QuaternionStamped(
            header=header(stamp_ns, "map"), quaternion=expected.pose.pose.orientation
        )
        same_attitude(message.quaternion, wanted.quaternion)
        near(message, wanted)
        # Close to straight up or down, roll and heading are known to the root of the rounding.
        assert decoder.decode(raw) == pytest.approx([phi, theta, psi], abs=1e-12)

    holds()


def test_fix_is_where_it_was_measured(search, fast_decoder):
    encoder = Encoder(topics.GPS_FIX, (0.25,), ORIGIN)
    decoder = fast_decoder(topics.GPS_FIX, ORIGIN)

    @search
    @given(ned=arrays(3, st.floats(-5e3, 5e3)), stamp_ns=STAMPS)
    def holds(ned, stamp_ns):
        raw = encoder.encode(ned, stamp_ns)
        message = deserialize_message(raw, NavSatFix)
        block = [message.latitude, message.longitude, message.altitude]
        block += np.diag([0.25] * 3).ravel().tolist()
        equal(topics.GPS_FIX, raw, fix(block, stamp_ns))
        assert decoder.decode(raw) == pytest.approx(ned, abs=1e-7)
        assert decoder.stamp_ns == stamp_ns

    holds()


@pytest.mark.parametrize("lost", [math.nan, math.inf, -math.inf])
def test_a_receiver_without_a_position_says_so(lost):
    raw = Encoder(topics.GPS_FIX, (0.25,), ORIGIN).encode(np.array([0.0, lost, 0.0]), 5)
    message = deserialize_message(raw, NavSatFix)
    assert message.status.status == message.status.STATUS_NO_FIX
    assert math.isnan(message.latitude) and math.isnan(message.altitude)


def test_what_rclpy_sends_is_read_the_fast_way(two_nodes, fast_decoder):
    """Messages published as objects, over DDS: bytes as long as ours, no unusual one."""
    sender, listener, spin = two_nodes
    got, publishers = {}, []
    for topic, build in MESSAGES.items():
        size = CHANNELS[topic].layout().block_size
        message = build([0.0] * size, 7)
        if topic in (topics.ODOM, topics.TRUTH_ODOM):
            message.pose.pose.orientation.w = 1.0
        elif topic in ATTITUDES:
            message.quaternion.w = 1.0
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        publishers.append(sender.create_publisher(type(message), topic, latched))
        publishers[-1].publish(message)
        listener.create_subscription(
            type(message), topic, functools.partial(got.__setitem__, topic), latched, raw=True
        )
    deadline = time.monotonic() + 120.0
    while len(got) < len(MESSAGES):
        assert time.monotonic() < deadline, f"nothing came on {set(MESSAGES) - set(got)}"
        spin(0.1)
    for topic, raw in got.items():
        decoder = fast_decoder(topic, place(topic))
        decoder.decode(raw)
        assert (len(raw), decoder.stamp_ns) == (length_of(topic), 7), topic


# --- other layouts of the same message ---------------------------------------------------------


@pytest.mark.parametrize("topic", SIMPLE)
def test_another_frame_of_the_same_convention_is_read(topic, search):
    """A pilot's own frame_id: the same array; the ordinary decoder whenever the frame changes."""
    size, slow = CHANNELS[topic].size, []
    deserialize = rclpy_deserializer(topic)
    decoder = Decoder(topic, deserialize=lambda raw: slow.append(raw) or deserialize(raw))

    @by_need(search, topic)
    @given(row=arrays(size, st.floats(-1.0, 1.0)), frame=st.text("abc_/é", max_size=12))
    def same(row, frame):
        message = MESSAGES[topic](simple_block(topic, row), 12)
        assume(not frame.endswith(("_ned", "_frd")))
        message.header.frame_id = frame
        assert decoder.decode(serialize_message(message)).tobytes() == row.tobytes()
        assert decoder.stamp_ns == 12

    same()
    assert slow


@given(order=st.permutations([*ACTUATORS, "tail_light"]), data=st.data())
def test_joints_are_known_by_name_not_by_place(order, data):
    values = dict(zip(order, data.draw(arrays(5, st.floats(-1.0, 1.0))), strict=True))
    message = JointState(header=header(3, "base_link"), name=order)
    message.position = [values[name] for name in order]
    got = Decoder(topics.ACTUATORS).decode(serialize_message(message))
    assert got.tolist() == [values[name] for name in ACTUATORS]


def test_big_endian_is_read():
    """Another machine's order of bytes, XCDR1 big endian: 44 header, texts and one double."""
    text = b"odom\0"
    raw = b"\x00\x00\x00\x00" + struct.pack(">iI", 3, 5) + struct.pack(">I", len(text)) + text
    raw += bytes(-(len(raw) - 4) % 8) + struct.pack(">4d", 0.6, 0.0, 0.8, 0.0)
    decoder = Decoder(topics.ATTITUDE_SETPOINT)
    angles = decoder.decode(raw).copy()
    assert decoder.stamp_ns == 3_000_000_005
    little = QuaternionStamped(header=header(0, "odom"), quaternion=xyzw([0.6, 0.0, 0.8, 0.0]))
    assert angles.tolist() == decoder.decode(serialize_message(little)).tolist()


def test_layout_aligns_as_the_standard_says():
    """XCDR1: every field on a multiple of its size, counted behind the four-byte header."""
    layout = Layout().put("B", 1).put("H", 2).put("b", -1).put("I", 3).put("B", 4).doubles(1)
    wanted = "01 00 02 00 ff 00 00 00 03 00 00 00 04 00 00 00" + " 00" * 8
    assert bytes(layout.data) == b"\x00\x01\x00\x00" + bytes.fromhex(wanted.replace(" ", ""))
    assert (layout.block_at, layout.block_size) == (20, 1)


def test_a_hand_is_named_beside_the_collective_and_only_then():
    """Both messages as rclpy writes them, one after the other through the same decoder."""
    encoder, decoder = Encoder(topics.COLLECTIVE), Decoder(topics.COLLECTIVE)
    rows = [[-0.1], [-0.2, 0.1, 0.2, -0.3], [-0.25, 0.0, 0.0, 0.0], [-0.3]]
    for number, row in enumerate(rows):
        names = [*topics.COLLECTIVE_NAMES, *topics.HAND_NAMES][: len(row)]
        header = Header(stamp=Time(sec=number, nanosec=40_000_000), frame_id="base_link")
        message = JointState(header=header, name=names, position=row)
        raw = encoder.encode(np.array(row), number * 10**9 + 40_000_000)
        assert deserialize_message(raw, JointState) == message
        for _ in range(2):
            np.testing.assert_array_equal(decoder.decode(serialize_message(message)), row)
        assert decoder.stamp_ns == number * 10**9 + 40_000_000
    # A part of a hand is none.
    message.name, message.position = ["collective", "hand_pedal"], [0.1, 0.2]
    np.testing.assert_array_equal(decoder.decode(serialize_message(message)), [0.1])
