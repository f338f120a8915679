# SPDX-License-Identifier: Apache-2.0
"""Hostile messages for the decoder of every topic that a node hears. No rclpy of its own."""

import random
from collections.abc import Callable
from dataclasses import fields, is_dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_typestore

from heli_core.rows import NAV, PLANT
from heli_core.ticks import NS_PER_S
from heli_msgs_bridge import topics
from heli_msgs_bridge.command_messages import (
    decode_attitude,
    decode_climb,
    decode_goal,
    decode_goto,
    decode_goto_gps,
    decode_joy,
    decode_reference,
    decode_velocity,
)
from heli_msgs_bridge.frames import datum
from heli_msgs_bridge.layouts import CHANNELS, MessageError
from heli_msgs_bridge.messages import Decoder, Encoder
from support.fuzzing import NASTY, NASTY_INTS, Target, damaged_bytes

_STORE = get_typestore(Stores.ROS2_JAZZY)
_PLACE = datum(45.0, 10.0, 100.0)
_STAMP_NS = 3 * NS_PER_S
# What is too long is so slow to make that it comes in one of so many cases.
_LONG, _SELDOM = 1_000_000, 40
# Of every stream in the short form: the long one has all, and many streams share a decoder.
_SHORT = 2000
# Of the messages in a sequence.
_LOOKED_AT = 4
_TEXTS = ("", "map", "base_link", "heli2/base_link", "map_ned", "\x1b[2J", "é" * 50, "x" * 100_000)
_NORMALISED = (topics.ACTUATORS, topics.COLLECTIVE)


def place(name: str) -> Any:
    """Where a fix is; None for what speaks of no place."""
    return _PLACE if name == topics.GPS_FIX else None


def good_row(name: str) -> np.ndarray:
    """A row that each stream may hold."""
    row = np.full(CHANNELS[name].size, 0.1)
    if name == topics.ODOM:
        row[NAV.quat] = 1.0, 0.0, 0.0, 0.0
    elif name == topics.TRUTH_ODOM:
        row[PLANT.quat] = 1.0, 0.0, 0.0, 0.0
    return row


def good_bytes(name: str) -> bytes:
    """A serialised message of a stream."""
    return Encoder(name, (), place(name)).encode(good_row(name), _STAMP_NS)


def _spoilt_number(numbers: random.Random, value: Any) -> Any:
    if isinstance(value, bool):
        return not value
    return numbers.choice(NASTY_INTS if isinstance(value, int) else NASTY)


def _length(numbers: random.Random, longest: int, *others: int) -> int:
    """A length for an array or a text, now and then the longest."""
    return longest if numbers.randrange(_SELDOM) == 0 else numbers.choice(others)


def _spoilt_array(numbers: random.Random, array: np.ndarray) -> np.ndarray:
    kind, spoilt = numbers.randrange(5), array.copy()
    if kind == 0 or not array.size:
        return np.zeros(_length(numbers, _LONG, 0, 1, 7), array.dtype)
    if kind == 1:
        return spoilt[: numbers.randrange(array.size)]
    if array.dtype.kind == "f":
        with np.errstate(over="ignore"):
            for _ in range(numbers.randint(1, 4)):
                spoilt[numbers.randrange(array.size)] = numbers.choice(NASTY)
        return spoilt
    return spoilt[::-1].copy()


def _spoilt(numbers: random.Random, owner: Any, name: str) -> Any:
    """Another value for a field of a message."""
    value = getattr(owner, name)
    if isinstance(value, str):
        return numbers.choice(_TEXTS)
    if isinstance(value, np.ndarray):
        return _spoilt_array(numbers, value)
    if isinstance(value, list):
        kind = numbers.randrange(5)
        if kind == 0 or not value:
            return []
        if kind == 1:
            return value * _length(numbers, 1000, 2, 3)
        if kind == 2 and isinstance(value[0], str):
            return ["x"] * _length(numbers, _LONG // 10, 1, 2)
        return numbers.sample(value, len(value))
    return _spoilt_number(numbers, value)


def _places(message: Any) -> list[tuple[Any, str]]:
    """All fields of a message that hold no message, each with its owner."""
    places: list[tuple[Any, str]] = []
    for item in fields(message):
        if item.name.startswith("__"):
            continue
        value = getattr(message, item.name)
        if is_dataclass(value):
            places += _places(value)
        else:
            places.append((message, item.name))
            inner = value if isinstance(value, list) else []
            places += [
                place for one in inner[:_LOOKED_AT] if is_dataclass(one) for place in _places(one)
            ]
    return places


def _zero_quaternion(message: Any) -> None:
    for owner, name in _places(message):
        if name in "xyzw" and type(owner).__name__.endswith("Quaternion"):
            object.__setattr__(owner, name, 0.0)


def spoil(numbers: random.Random, message: Any) -> Any:
    """The message with some of its fields spoilt; numbers stay within what their type can hold."""
    if numbers.random() < 0.1:
        _zero_quaternion(message)
    for _ in range(numbers.randint(1, 3)):
        owner, name = numbers.choice(_places(message))
        object.__setattr__(owner, name, _spoilt(numbers, owner, name))
    return message


def serialised(message: Any, type_name: str) -> bytes:
    """Bytes of a message object; OverflowError, as struct has it, for what cannot be sent."""
    return bytes(_STORE.serialize_cdr(message, type_name))


def hostile(numbers: random.Random, raw: bytes, type_name: str) -> bytes:
    """A message in bytes as a stranger may send it."""
    if numbers.random() < 0.5:
        return damaged_bytes(numbers, raw)
    while True:
        message = spoil(numbers, _STORE.deserialize_cdr(raw, type_name))
        try:
            return serialised(message, type_name)
        except Exception:
            # A number that its type does not hold, an array of a wrong fixed length.
            continue


def _stream(name: str) -> Target:
    whole, type_name = good_bytes(name), topics.BY_NAME[name].type
    # Not all of a row is in its message.
    expected = Decoder(name, place(name)).decode(whole).copy()

    def attempt(numbers: random.Random, folder: Path) -> str:
        decoder = Decoder(name, place(name), namespace="")
        raw = hostile(numbers, whole, type_name)
        sentence = ""
        try:
            row = decoder.decode(raw)
        except MessageError as error:
            sentence = str(error)
            assert sentence.startswith(f"{name}: "), sentence
        else:
            assert np.isfinite(row).all(), row
            assert name not in _NORMALISED or np.abs(row).max() <= 1.0, row
        # And the next one of the sender is as it was.
        np.testing.assert_array_equal(decoder.decode(whole), expected)
        return sentence

    return Target(f"message {name}", attempt, _SHORT)


def _object(name: str, decode: Callable[[Any], Any], good: Callable[[], Any]) -> Target:
    type_name = topics.BY_NAME[name].type
    whole: list[bytes] = []

    def attempt(numbers: random.Random, folder: Path) -> str:
        from rclpy.serialization import deserialize_message

        if not whole:
            whole.append(good())
        raw = hostile(numbers, whole[0], type_name)
        try:
            message = deserialize_message(raw, topics.message_class(type_name))
        except Exception as error:
            # rclpy's own refusal: such a message reaches no callback.
            return f"{name}: not a message of its type ({type(error).__name__})"
        try:
            _check_finite(decode(message))
        except MessageError as error:
            return str(error)
        return ""

    return Target(f"message {name}", attempt)


def _check_finite(decoded: Any) -> None:
    parts = decoded if isinstance(decoded, tuple) else (decoded.points, decoded.times_ns)
    for part in parts:
        assert np.isfinite(np.asarray(part, dtype=float)).all(), decoded


def _good(name: str, **values: Any) -> Callable[[], bytes]:
    """Bytes of a message of a topic; values by the path of their fields."""

    def make() -> bytes:
        from rclpy.serialization import serialize_message

        message = topics.message_class(topics.BY_NAME[name].type)()
        message.header.frame_id, message.header.stamp.sec = "map", 3
        for path, value in values.items():
            *owners, leaf = path.split("__")
            at = message
            for owner in owners:
                at = getattr(at, owner)
            setattr(at, leaf, value)
        return bytes(serialize_message(message))

    return make


def _good_reference() -> bytes:
    from rclpy.serialization import serialize_message

    from heli_core.trajectory import Trajectory
    from heli_msgs_bridge.command_messages import encode_reference

    way = Trajectory(_STAMP_NS, np.array([0, NS_PER_S, 2 * NS_PER_S]), np.zeros((3, 7)))
    return bytes(serialize_message(encode_reference(way)))


def _good_goal() -> bytes:
    from geometry_msgs.msg import PoseStamped
    from rclpy.serialization import serialize_message

    from heli_msgs_bridge.command_messages import encode_goal

    return bytes(serialize_message(encode_goal("goto", "1", PoseStamped())))


def _goal(message: Any) -> Any:
    """A goal with its argument read, as the outer loop does."""
    command, _, argument = decode_goal(message)
    read = {"goto": decode_goto, "follow": lambda way: decode_reference(way, "")}
    return read[command](argument) if command in read else ()


def _joy(message: Any) -> Any:
    """Sticks as the outer loop reads them."""
    from heli_core.errors import StickError
    from heli_flight.settings import resolve
    from heli_outer_pd.joystick import StickMap

    global _STICKS
    _STICKS = _STICKS or StickMap.from_parameters(resolve().nodes["outer_loop"])
    try:
        sticks, _ = _STICKS.read(*decode_joy(message))
    except StickError as error:
        raise MessageError(f"{topics.JOY}: {error}") from error
    assert np.abs(sticks).max() <= 1.0
    return (sticks,)


_STICKS: Any = None
TARGETS = (
    *(_stream(name) for name in CHANNELS),
    _object(topics.REFERENCE, lambda m: decode_reference(m, ""), _good_reference),
    *(
        _object(name, partial(decode_goto, name=name), _good(name, pose__orientation__w=1.0))
        for name in (topics.GOTO, topics.COMMAND_POSE)
    ),
    _object(topics.GOTO_GPS, partial(decode_goto_gps, origin=_PLACE), _good(topics.GOTO_GPS)),
    _object(
        topics.COMMAND_VELOCITY, lambda m: decode_velocity(m, 0.3), _good(topics.COMMAND_VELOCITY)
    ),
    _object(topics.COMMAND_ATTITUDE, decode_attitude, _good(topics.COMMAND_ATTITUDE)),
    _object(topics.COMMAND_CLIMB, decode_climb, _good(topics.COMMAND_CLIMB)),
    _object(topics.GOAL, _goal, _good_goal),
    _object(topics.JOY, _joy, _good(topics.JOY, axes=[0.0] * 8, buttons=[0] * 11)),
)
