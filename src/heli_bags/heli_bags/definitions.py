# SPDX-License-Identifier: Apache-2.0
"""Message definitions and type hashes, of standard messages and of those installed here."""

import os
import sys
from pathlib import Path
from typing import Any

from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore


class UnknownTypeError(LookupError):
    """No definition of a message type is here; the message is one line that names it."""


def _installed(type_name: str) -> Path | None:
    """The .msg file of an installed type."""
    package, _, name = type_name.partition("/msg/")
    prefixes = [Path(p) for p in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep) if p]
    for prefix in (*prefixes, Path(sys.prefix)):
        path = prefix / "share" / package / "msg" / f"{name}.msg"
        if name and path.is_file():
            return path
    return None


def _named_in(description: Any) -> set[str]:
    """Message types that a field's description names, at any depth."""
    kind, content = description
    if kind.name == "NAME":
        return {content}
    if kind.name in ("ARRAY", "SEQUENCE"):
        return _named_in(content[0])
    return set()


class Definitions:
    """Definitions by type name; looks into the installation for what is not standard.

    Attributes
    ----------
    store : Typestore
        Of `rosbags`: serialises and deserialises every type that was asked for.
    """

    def __init__(self) -> None:
        self.store: Typestore = get_typestore(Stores.ROS2_JAZZY)

    def require(self, type_name: str) -> None:
        """Make the store know a type and those it is built of.

        Raises
        ------
        UnknownTypeError
            It is neither standard nor installed.
        """
        wanted, found = {type_name}, {}
        while wanted:
            name = wanted.pop()
            if name in self.store.fielddefs or name in found:
                continue
            path = _installed(name)
            if path is None:
                raise UnknownTypeError(f"message type {name} is not installed")
            types = get_types_from_msg(path.read_text(encoding="utf-8"), name)
            found.update(types)
            for _, fields in types.values():
                for _, description in fields:
                    wanted |= _named_in(description)
        if found:
            self.store.register(found)

    def text_and_hash(self, type_name: str) -> tuple[str, str]:
        """Definition with all it depends on (format `ros2msg`) and hash (`RIHS01_...`).

        Raises
        ------
        UnknownTypeError
        """
        self.require(type_name)
        text, _ = self.store.generate_msgdef(type_name, ros_version=2)
        return text, self.store.hash_rihs01(type_name)
