# SPDX-License-Identifier: Apache-2.0
"""Messages as plain data, as text like `ros2 topic echo`, as one level of fields. No rclpy."""

import dataclasses
import json
import math
from typing import Any

import numpy as np
import yaml

_SHOWN = 128
# What a message without fields has instead.
_PLACEHOLDER = "structure_needs_at_least_one_member"


def plain(value: Any) -> Any:
    """A message of rclpy or `rosbags` as dictionaries, lists, numbers and texts."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, np.generic):
        return value.item()
    if isinstance(value, bytes):
        return value[0] if len(value) == 1 else list(value)
    if dataclasses.is_dataclass(value):
        names = [f.name for f in dataclasses.fields(value) if not f.name.startswith("__")]
        return {name: plain(getattr(value, name)) for name in names if name != _PLACEHOLDER}
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, (str, bool, int, float)) or value is None:
        return value
    return [plain(item) for item in value]


def _shortened(value: Any) -> Any:
    """Long sequences cut, as `ros2 topic echo` does."""
    if isinstance(value, dict):
        return {key: _shortened(item) for key, item in value.items()}
    if isinstance(value, list):
        short = [_shortened(item) for item in value[:_SHOWN]]
        return [*short, "..."] if len(value) > _SHOWN else short
    return value


def as_yaml(message: Any, full: bool = False) -> str:
    """Text of a message as `ros2 topic echo` prints it, with the closing `---`."""
    content = plain(message)
    text = yaml.safe_dump(
        content if full else _shortened(content),
        sort_keys=False,
        allow_unicode=True,
        default_flow_style=False,
        width=10**6,
    )
    return f"{text}---"


def _finite(value: Any) -> Any:
    """Not-a-number and infinity as None: JSON has no such numbers."""
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def as_json(message: Any, **beside: Any) -> str:
    """One line of JSON with the message's fields; `beside` goes in front."""
    return json.dumps({**beside, **_finite(plain(message))}, allow_nan=False)


def flatten(message: Any) -> dict[str, Any]:
    """Every field on one level: `pose.pose.position.x`, `position[0]`."""
    found: dict[str, Any] = {}
    _flatten(plain(message), "", found)
    return found


def _flatten(value: Any, name: str, found: dict[str, Any]) -> None:
    if isinstance(value, dict):
        for key, item in value.items():
            _flatten(item, f"{name}.{key}" if name else key, found)
    elif isinstance(value, list):
        for index, item in enumerate(value):
            _flatten(item, f"{name}[{index}]", found)
    else:
        found[name] = value
