# SPDX-License-Identifier: Apache-2.0
"""All topics of the graph: name, type, who sends, who listens, how often. One table, no ROS needed.

Names are relative, so that a namespace or a remap moves the whole graph; `/clock` and
`/diagnostics` are absolute by ROS convention. A period is a whole number of ticks.
"""

from dataclasses import dataclass
from typing import Any

from heli_core import sensors
from heli_core.ticks import TICKS_PER_S, Rate

# -------------------------------------------------------------------------------------------------
# Topics.
# -------------------------------------------------------------------------------------------------

DEPTH = 2000
"""History depth of every stream. A sender can repeat what a listener's full shared-memory queue did
not take (512 messages of all topics together) only while the message is in its history."""
UNHEARD = 10_000
"""That of a sender which keeps nothing for who comes later: only what is not acknowledged yet takes
memory. Nobody waits for the recorder: in lockstep these are nine seconds in which it cannot run."""

CLOCK = "/clock"
IMU, IMU2 = "imu/data_raw", "imu2/data_raw"
MAG = sensors.MAG.topic
GPS_FIX = "gps/fix"
GPS_VELOCITY = "gps/fix_velocity"
BARO = sensors.BARO.topic
ROTOR_SPEED = sensors.ROTOR_SPEED.topic
ODOM = "odom"
ROTOR_STATE = "rotor_state"
NO_ESTIMATE = "no_estimate"
"""A tick of which the observer knows nothing, in place of `ODOM` and `ROTOR_STATE`."""
REFERENCE = "reference"
GOTO = "goto"
GOTO_GPS = "goto_gps"
COMMAND_POSE, COMMAND_VELOCITY = "command_pose", "command_velocity"
"""Names of REP-147; the first is a goto by another name."""
COMMAND_ATTITUDE, COMMAND_CLIMB = "command_attitude", "command_climb"
JOY = "joy"
GOAL = "goal"
"""A command with an id, by which the outer loop answers it (`command_messages.encode_goal`)."""
ATTITUDE_SETPOINT = "attitude_setpoint"
COLLECTIVE = "collective"
ACTUATORS = "actuators"
TRUTH_ODOM = "ground_truth/odom"
TRUTH_WIND = "ground_truth/wind"
TRUTH_ROTOR = "ground_truth/rotor_state"
EXCITATION_ACTUATORS = "excitation/actuators"
EXCITATION_ATTITUDE = "excitation/attitude"
EXCITATION_WIND = "excitation/wind"
AGREEMENT = "agreement"
"""What each node must agree on with the others (`heli_msgs_bridge.agreement`), told once."""
DIAGNOSTICS = "/diagnostics"
TF, TF_STATIC = "/tf", "/tf_static"
ROBOT_DESCRIPTION = "robot_description"
JOINT_STATES = "joint_states"
"""How far the main rotor has turned, and its speed: of the joint that `ROTOR_SPEED_NAMES` names."""
ORIGIN, HOME = "origin", "home"
"""Where `map` begins: latitude, longitude, height (WGS-84); where the flight began, in `map`."""
STATUS, STATUS_TYPE = "status", "heli_interfaces/msg/Status"
"""The aircraft's state with its types, from the node `actions`, where its type is installed."""
SCENE = "scene"
"""Pictures of the flight (visualization_msgs/MarkerArray) from `live_view`; no part of the graph's
data, so neither in the table nor in bags."""
SCENE_TYPE = "visualization_msgs/msg/MarkerArray"

ACTUATOR_NAMES = ("lateral", "longitudinal", "pedal", "collective")
COLLECTIVE_NAMES = ("collective",)
HAND_NAMES = ("hand_lateral", "hand_longitudinal", "hand_pedal")
"""Named beside the collective while a pilot flies by hand: deflections about trim."""
ROTOR_NAMES = ("a_s", "b_s", "d_int")
ROTOR_SPEED_NAMES = ("main_rotor",)
TRUTH_ROTOR_NAMES = (
    "a_s",
    "b_s",
    "d_int",
    "servo_lateral",
    "servo_longitudinal",
    "servo_pedal",
    "servo_collective",
)


@dataclass(frozen=True)
class Topic:
    """One row of the graph.

    Attributes
    ----------
    name : str
        Relative topic name (absolute for the two that ROS fixes).
    type : str
        Message type, `package/msg/Name`.
    source : tuple of str
        Names of the nodes that send it.
    sinks : tuple of str
        Names of the nodes that need it (the recorder takes all).
    every_ticks : int
        Period in ticks of 10 ms; 1 for every tick of the flight, which may be shorter; 0 for "on
        change".
    latched : bool
        True if a late listener gets the last messages (transient local).
    kept : int
        History depth of a latched topic: how many a late or slow listener gets.
    optional : bool
        True if it is sent, and listened to, only where both are configured for it.
    replaces : tuple of str
        Topics that have no message of a tick of which this one speaks: who waits for theirs goes on
        without.
    """

    name: str
    type: str
    source: tuple[str, ...]
    sinks: tuple[str, ...]
    every_ticks: int
    latched: bool = False
    kept: int = 1
    optional: bool = False
    replaces: tuple[str, ...] = ()

    @property
    def rate_hz(self) -> float:
        """Messages per simulated second at 100 Hz; 0 for "on change"."""
        return 0.0 if self.every_ticks == 0 else TICKS_PER_S / self.every_ticks

    def period_ns(self, rate: Rate) -> int:
        """Time from one message to the next in a flight of this rate, ns; 0 for "on change"."""
        return rate.every(self.every_ticks) * rate.tick_ns


_PLANT, _OBSERVER, _INNER, _OUTER = ("plant",), ("observer",), ("inner_loop",), ("outer_loop",)
_FLYING = ("plant", "observer", "inner_loop", "outer_loop")
_ALL = (*_FLYING, "recorder", "scenario", "live_view")
_JOINTS = "sensor_msgs/msg/JointState"
_ODOMETRY = "nav_msgs/msg/Odometry"
_POSE = "geometry_msgs/msg/PoseStamped"


def _samples(sensor: sensors.SampledSensor) -> Topic:
    """Row of what a sensor says."""
    return Topic(sensor.topic, sensor.message, _PLANT, (sensor.heard_by,), sensor.period_ticks)


TABLE: tuple[Topic, ...] = (
    Topic(CLOCK, "rosgraph_msgs/msg/Clock", _PLANT, (), 1),
    Topic(IMU, "sensor_msgs/msg/Imu", _PLANT, _OBSERVER, 1),
    Topic(IMU2, "sensor_msgs/msg/Imu", _PLANT, _OBSERVER, 1, optional=True),
    _samples(sensors.MAG),
    Topic(GPS_FIX, "sensor_msgs/msg/NavSatFix", _PLANT, _OBSERVER, 20),
    Topic(GPS_VELOCITY, "geometry_msgs/msg/TwistWithCovarianceStamped", _PLANT, _OBSERVER, 20),
    _samples(sensors.BARO),
    *map(_samples, sensors.PLAIN),
    Topic(ODOM, _ODOMETRY, _OBSERVER, _INNER + _OUTER, 1),
    Topic(ROTOR_STATE, _JOINTS, _OBSERVER, _INNER, 1),
    Topic(
        NO_ESTIMATE,
        "std_msgs/msg/Header",
        _OBSERVER,
        _INNER + _OUTER,
        0,
        replaces=(ROTOR_STATE, ODOM),
    ),
    Topic(
        REFERENCE,
        "trajectory_msgs/msg/MultiDOFJointTrajectory",
        ("scenario",),
        _OUTER,
        0,
        latched=True,
        kept=64,  # commands may follow each other faster than a loaded recorder listens
    ),
    # From whoever commands the flight.
    Topic(GOTO, _POSE, (), _OUTER, 0),
    Topic(GOTO_GPS, "sensor_msgs/msg/NavSatFix", (), _OUTER, 0),
    Topic(COMMAND_POSE, _POSE, (), _OUTER, 0),
    Topic(COMMAND_VELOCITY, "geometry_msgs/msg/TwistStamped", (), _OUTER, 0),
    Topic(COMMAND_ATTITUDE, "geometry_msgs/msg/QuaternionStamped", (), _OUTER, 0),
    Topic(COMMAND_CLIMB, "geometry_msgs/msg/TwistStamped", (), _OUTER, 0),
    Topic(JOY, "sensor_msgs/msg/Joy", (), _OUTER, 0),
    Topic(GOAL, "trajectory_msgs/msg/MultiDOFJointTrajectory", (), _OUTER, 0),
    Topic(ATTITUDE_SETPOINT, "geometry_msgs/msg/QuaternionStamped", _OUTER, _INNER, 2),
    Topic(COLLECTIVE, _JOINTS, _OUTER, _INNER, 2),
    Topic(ACTUATORS, _JOINTS, _INNER, _PLANT + _OBSERVER, 1),
    Topic(TRUTH_ODOM, _ODOMETRY, _PLANT, (), 1),
    Topic(TRUTH_WIND, "geometry_msgs/msg/Vector3Stamped", _PLANT, (), 1),
    Topic(TRUTH_ROTOR, _JOINTS, _PLANT, (), 1),
    Topic(EXCITATION_ACTUATORS, _JOINTS, _INNER, (), 1, optional=True),
    Topic(
        EXCITATION_ATTITUDE,
        "geometry_msgs/msg/QuaternionStamped",
        _INNER,
        (),
        1,
        optional=True,
    ),
    Topic(EXCITATION_WIND, "geometry_msgs/msg/Vector3Stamped", _PLANT, (), 1, optional=True),
    Topic(
        AGREEMENT,
        "diagnostic_msgs/msg/DiagnosticArray",
        (*_FLYING, "recorder"),
        (),
        0,
        latched=True,
        kept=64,  # of all nodes together
    ),
    Topic(DIAGNOSTICS, "diagnostic_msgs/msg/DiagnosticArray", _ALL, (), 0),
)

BY_NAME: dict[str, Topic] = {topic.name: topic for topic in TABLE}

_TRANSFORMS = "tf2_msgs/msg/TFMessage"
TOOLS: tuple[Topic, ...] = (
    Topic(TF, _TRANSFORMS, _OBSERVER, (), 4),
    Topic(TF_STATIC, _TRANSFORMS, _PLANT, (), 0, latched=True),
    Topic(ROBOT_DESCRIPTION, "std_msgs/msg/String", _PLANT, (), 0, latched=True),
    Topic(JOINT_STATES, _JOINTS, _PLANT, (), 4),
    Topic(ORIGIN, "sensor_msgs/msg/NavSatFix", _OUTER, (), 0, latched=True),
    Topic(HOME, "geometry_msgs/msg/PointStamped", _OUTER, (), 0, latched=True),
)
"""What RViz and its like want besides. No node waits for it, no flight needs it, and a type may be
missing: tf2_msgs is not among the wheels. Only `JOINT_STATES` is filed by its own stamp."""

SENSORS = frozenset(t.name for t in TABLE if t.source == _PLANT and t.sinks)
"""What a driver sends in place of the plant; of real drivers many are best effort."""

KNOWN: dict[str, Topic] = {topic.name: topic for topic in (*TABLE, *TOOLS)}


SENDING_ORDER: tuple[str, ...] = (
    *(row.topic for row in sensors.SENSORS),
    GPS_FIX,
    GPS_VELOCITY,
    IMU2,
    IMU,
    TRUTH_ODOM,
    TRUTH_WIND,
    EXCITATION_WIND,
    TRUTH_ROTOR,
    JOINT_STATES,
    CLOCK,
    ODOM,
    ROTOR_STATE,
    NO_ESTIMATE,
    TF,
    ATTITUDE_SETPOINT,
    COLLECTIVE,
    EXCITATION_ATTITUDE,
    EXCITATION_ACTUATORS,
    ACTUATORS,
)
"""In which order the messages of a tick are sent: who sends later has heard those before. All of
them carry the time of the tick, so a bag must tell the order by other means."""


def installed(name: str) -> bool:
    """True if the type of a topic in `KNOWN` is on this machine (imports ROS messages)."""
    try:
        message_class(KNOWN[name].type)
    except LookupError:
        return False
    return True


def due(name: str, tick: int) -> bool:
    """True if the schedule demands a message of this topic at this tick."""
    every = BY_NAME[name].every_ticks
    return every != 0 and tick % every == 0


def message_class(type_name: str) -> Any:
    """Python class of a message type such as `sensor_msgs/msg/Imu` (imports ROS messages).

    Raises
    ------
    LookupError
        If no such message is installed.
    """
    from importlib import import_module

    package, _, name = type_name.partition("/msg/")
    if not (package.isidentifier() and name.isidentifier()):
        # A bag may say anything.
        raise LookupError(f"{type_name!r:.80} is no message type")
    try:
        return getattr(import_module(f"{package}.msg"), name)
    except (ImportError, AttributeError) as error:
        raise LookupError(f"message type {type_name} is not installed") from error


def qos(name: str, depth: int = DEPTH, repeats: bool = False) -> Any:
    """QoS profile of a topic (imports rclpy).

    Everything that is sent is reliable: in lockstep a lost message is a stopped flight, and a
    best-effort publisher would never meet a reliable listener. With `repeats` a sender keeps what
    it has sent for a listener that is started again, and such a listener gets it.
    """
    latched = name in KNOWN and KNOWN[name].latched
    return _profile(KNOWN[name].kept if latched else depth, latched or repeats)


def qos_to_hear(name: str, depth: int = DEPTH, lockstep: bool = True) -> tuple[Any, ...]:
    """QoS profiles of those who listen to a topic, one per subscription (imports rclpy).

    Sensors are heard with best effort where nothing waits for each of their messages, as ROS has it
    for sensor data: a best-effort driver and a reliable one both meet such a listener.

    A latched topic needs two: who asks for old messages meets no sender of default QoS (`ros2 topic
    pub`), who does not gets none of what was sent before. `sources.Once` makes one of them.
    """
    if name in SENSORS and not lockstep:
        return (_profile(depth, False, reliable=False),)
    profile = qos(name, depth)
    return (
        (profile, _profile(depth, False)) if name in KNOWN and KNOWN[name].latched else (profile,)
    )


def _profile(depth: int, latched: bool, reliable: bool = True) -> Any:
    # As `message_class`: whoever reads the table alone is not bound to ROS.
    from importlib import import_module

    ros = import_module("rclpy.qos")
    kept = ros.DurabilityPolicy.TRANSIENT_LOCAL if latched else ros.DurabilityPolicy.VOLATILE
    return ros.QoSProfile(
        history=ros.HistoryPolicy.KEEP_LAST,
        depth=depth,
        reliability=(
            ros.ReliabilityPolicy.RELIABLE if reliable else ros.ReliabilityPolicy.BEST_EFFORT
        ),
        durability=kept,
    )


# -------------------------------------------------------------------------------------------------
# Names of the coordinate frames in messages (REP-105); which of them an aircraft owns. No ROS.
#
# `map` is the local tangent plane about the origin that all aircraft share. All other frames
# belong
# to one aircraft and carry its namespace: `heli2/base_link`; in the empty namespace `base_link`.
# -------------------------------------------------------------------------------------------------

MAP = "map"
"""ENU about the NED origin. Estimates that hold a GPS are given in it, and so is the truth."""
"""ENU, drifts, never jumps: the estimated velocity, summed up (`transforms`)."""
BASE = "base_link"
"""FLU, at the centre of gravity."""
IMU_LINK, IMU2_LINK, GPS_LINK = "imu_link", "imu2_link", "gps_link"
"""Where the sensors sit. The simulated ones sit at the centre of gravity."""


def in_namespace(frame: str, namespace: str) -> str:
    """Frame of the aircraft in a namespace (`/heli2`, `heli2` or ``); `map` belongs to all."""
    owner = namespace.strip("/")
    return frame if frame == MAP or not owner else f"{owner}/{frame}"
