# SPDX-License-Identifier: Apache-2.0
"""A recorded flight as what `heli_handling` scores."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from heli_bags.folder import BagError
from heli_bags.message_text import flatten
from heli_bags.tools import BagReader, bag_of, chosen, opened
from heli_dynamics_sim.parameters import HelicopterParameters
from heli_flight.graph.plant_truth import Heard, judged_truth
from heli_flight.loop.flight_file import NAME
from heli_flight.loop.scenario_mte import LEAD_IN_S, scale_flown, target_of
from heli_flight.loop.settings import resolve
from heli_handling.boundaries import AXES
from heli_handling.definitions import FULL, Scale, froude
from heli_handling.tracks import Array, Track, track_of
from heli_math.rotations import euler_angles
from heli_math.rows import PLANT
from heli_math.ticks import NS_PER_S, stamp_at
from heli_msgs_bridge import topics
from heli_msgs_bridge.messages import Decoder, MessageError
from heli_msgs_bridge.sums import SUM, sum_of

_ODOMETRY = topics.BY_NAME[topics.TRUTH_ODOM].type
_ATTITUDE = topics.BY_NAME[topics.ATTITUDE_SETPOINT].type


@dataclass(frozen=True)
class Flight:
    """A track, and where it is from.

    Attributes
    ----------
    track : Track
        Times from the first message on.
    topic : str
    start_ns : int
        Stamp of the first message.
    remarks : tuple of str
    forged : str
        Why the ground truth in the bag is not the plant's, one sentence; empty if it is.
    """

    track: Track
    topic: str
    start_ns: int
    remarks: tuple[str, ...] = ()
    forged: str = ""


def flight_of(path: Path, topic: str | None = None) -> Flight:
    """The motion that a bag holds.

    Parameters
    ----------
    path : Path
        rosbag2 folder, its file, or a flight's folder.
    topic : str, optional
        Of nav_msgs/Odometry, ENU and FLU; default: the ground truth of our graph, else the only
        one of this type.

    Raises
    ------
    BagError, HandlingError
    """
    with opened(path) as reader:
        name = _odometry(reader, path, topic)
        (connection, *_) = chosen(reader, path, [name])
        decoder = Decoder(
            topics.TRUTH_ODOM, None, lambda raw: reader.deserialize(raw, connection.msgtype)
        )
        stamps, rows, sums, why, refused = [], [], [], "", 0
        for _, bag_ns, raw in reader.messages(connections=chosen(reader, path, [name])):
            try:
                rows.append(decoder.decode(raw).copy())
                stamps.append(decoder.stamp_ns or bag_ns)
                sums.append(sum_of(raw))
            except MessageError as error:
                why, refused = why or str(error).partition(": ")[2], refused + 1
    if not rows:
        raise BagError(f"{bag_of(path)}: no usable message on {name}" + (f": {why}" if why else ""))
    rigid, times = np.array(rows), np.array(stamps, dtype=np.int64)
    quat = rigid[:, PLANT.quat]
    to_ned = Rotation.from_quat(np.roll(quat, -1, axis=1))  # scalar last
    start_ns = int(times.min())
    track = track_of(
        (times - start_ns) / NS_PER_S,
        rigid[:, PLANT.pos],
        to_ned.apply(rigid[:, PLANT.vel]),
        euler_angles(quat),
    )
    said = (f"{refused} messages on {name} could not be used: {why}",) if refused else ()
    forged = unknown = ""
    if name.endswith(f"/{topics.TRUTH_ODOM}"):
        forged, unknown = _judged(path, times, np.frombuffer(b"".join(sums), SUM))
    return Flight(track, name, start_ns, (*said, *([unknown] if unknown else [])), forged)


def _judged(path: Path, stamps_ns: NDArray[np.int64], sums: NDArray[np.uint64]) -> tuple[str, str]:
    """As `judged_truth`, of a bag's ground truth."""
    beside = bag_of(path).resolve().parent
    saved = beside / NAME
    settings = resolve(params=[saved] if saved.is_file() else [])
    rate, first_ns = settings.rate, stamp_at(settings.nodes["plant"]["start_time_s"])
    return judged_truth(Heard((stamps_ns - first_ns) // rate.tick_ns, sums), beside, rate)


def _odometry(reader: BagReader, path: Path, topic: str | None) -> str:
    """Full name of the odometry to score."""
    kinds = {c.topic: c.msgtype for c in reader.connections}
    if topic is not None:
        name = chosen(reader, path, [topic])[0].topic
        if kinds[name] != _ODOMETRY:
            raise BagError(f"{bag_of(path)}: {name} is {kinds[name]}, expected {_ODOMETRY}")
        return name
    names = sorted(name for name, kind in kinds.items() if kind == _ODOMETRY)
    truths = [name for name in names if name.endswith(f"/{topics.TRUTH_ODOM}")]
    for found in (truths, names):
        if len(found) == 1:
            return found[0]
    held = f"it holds {', '.join(names)}" if names else f"it holds no {_ODOMETRY}"
    raise BagError(f"{bag_of(path)}: name the odometry by --odom TOPIC; {held}")


def signal_of(path: Path, source: str, axis: str, start_ns: int) -> tuple[Array, Array]:
    """A recorded number over time.

    Parameters
    ----------
    path : Path
    source : str
        `TOPIC:FIELD` with the field as `heli bag csv` heads its column, or a topic of attitudes
        (geometry_msgs/QuaternionStamped, FLU to ENU), of which the axis is taken, rad.
    axis : str
        roll, pitch or yaw; angles are those of FRD and NED.
    start_ns : int
        Stamp from which times count.

    Returns
    -------
    (N,) array, (N,) array
        Times, s, and values.

    Raises
    ------
    BagError
    """
    topic, _, field = source.partition(":")
    with opened(path) as reader:
        name = _full_name(reader, path, topic)
        lines = chosen(reader, path, [name])
        kind = lines[0].msgtype
        if not field and kind != _ATTITUDE:
            raise BagError(f"{bag_of(path)}: {name} is {kind}: name a field, {name}:FIELD")
        decoder = Decoder(topics.ATTITUDE_SETPOINT, None, lambda raw: reader.deserialize(raw, kind))
        stamps, values = [], []
        for _, bag_ns, raw in reader.messages(connections=lines):
            if not field:
                values.append(float(decoder.decode(raw)[AXES.index(axis)]))
                stamps.append(decoder.stamp_ns or bag_ns)
                continue
            message = reader.deserialize(raw, kind)
            fields = flatten(message)
            if not isinstance(fields.get(field), int | float):
                numbers = [key for key, value in fields.items() if isinstance(value, int | float)]
                has = ", ".join(numbers) or "none"
                raise BagError(f"{bag_of(path)}: {name} has no number {field}; it has {has}")
            values.append(float(fields[field]))
            stamps.append(_stamp_ns(fields) or bag_ns)
    if not values:
        raise BagError(f"{bag_of(path)}: no message on {name}")
    times = (np.array(stamps, dtype=np.int64) - start_ns) / NS_PER_S
    order = np.argsort(times, kind="stable")
    numbers_then = np.array(values)[order]
    return times[order], numbers_then if field else np.unwrap(numbers_then)


def _stamp_ns(fields: dict[str, Any]) -> int:
    """Stamp of a message with a header; 0 without."""
    seconds = fields.get("header.stamp.sec", 0)
    return int(seconds * NS_PER_S + fields.get("header.stamp.nanosec", 0))


def _full_name(reader: BagReader, path: Path, topic: str) -> str:
    """A topic by its name, or by its end where only one ends so."""
    ends = [c.topic for c in reader.connections if c.topic.endswith(f"/{topic.lstrip('/')}")]
    return ends[0] if len(set(ends)) == 1 else chosen(reader, path, [topic])[0].topic


def own_course(path: Path, name: str, scale: Scale) -> tuple[Array, float] | None:
    """Target (3,), NED, m, and beginning, s, of a manoeuvre that a flight of ours was to fly.

    From params.yaml beside the bag; None where there is none, or for another manoeuvre or scale.

    Raises
    ------
    ParameterError
    """
    saved = bag_of(path).resolve().parent / NAME
    if not saved.is_file():
        return None
    settings = resolve(params=[saved])
    p = settings.scenario_parameters
    if p["kind"] != "path" or p["path.kind"] != "manoeuvre" or p["path.manoeuvre"] != name:
        return None
    if not math.isclose(scale_flown(p).ratio, scale.ratio, rel_tol=1e-6):
        return None
    return target_of(settings.scenario.reference, p), p["path.start_s"] - LEAD_IN_S


def scale_of(name: str, path: Path, rotor_diameter_m: float | None) -> tuple[Scale, str]:
    """Scale by its name, and what it was worked out from.

    The rotor's diameter is the given one, else that of the flight's aircraft (params.yaml beside
    the bag), else that of the packaged aircraft.

    Raises
    ------
    ParameterError, HandlingError
    """
    if name == FULL.name:
        return FULL, ""
    if rotor_diameter_m is not None:
        return froude(rotor_diameter_m), f"rotor diameter {rotor_diameter_m:g} m as given"
    saved = bag_of(path).resolve().parent / NAME
    files = [saved] if saved.is_file() else []
    aircraft = resolve(params=files).nodes["plant"]["aircraft_file"]
    radius_m = HelicopterParameters.from_yaml(aircraft).main_radius_m
    whose = "of the flight's aircraft" if files else "of the packaged aircraft: none was recorded"
    return froude(2.0 * radius_m), f"rotor diameter {2.0 * radius_m:g} m {whose}"
